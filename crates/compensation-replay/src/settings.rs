//! Pipeline settings of a replay.

use crate::compensator::{CompensatorKind, Discretisation};
use flight::Delay;
use record::{CardUse, Estimate, StartRule};

/// Settings of a replay, as configured.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Delay of the position to remove; positive means late.
    pub delay: Delay,
    /// Its standard uncertainty, s, if known.
    pub delay_uncertainty_s: Option<f64>,
    /// Source of the delay, in words, for the page.
    pub delay_source: String,
    /// The sensor card that is its source, if any.
    pub card: Option<CardUse>,
    /// How much later the position is than the velocity, s, if known independently of the lateness of each. A correct
    /// compensation leaves this between the two.
    pub position_minus_velocity_s: Option<Estimate>,
    /// Lateness of the position, s: the effect is judged by it. `None` if unknown; the fallback is the position against
    /// this flight's velocity.
    pub position_lateness_s: Option<Estimate>,
    /// Lateness of the velocity, s, against the same datum. `None` if unknown.
    pub velocity_lateness_s: Option<Estimate>,
    /// Assumption for the time before the first velocity.
    pub start: StartRule,
    /// Velocity gaps up to this long are bridged by a straight line, s. `None`: 2 Td, at least 2.5 median velocity
    /// intervals.
    pub bridge_s: Option<f64>,
    /// A flight whose 95th percentile of ground speed is lower does not count as moving, m/s.
    pub min_speed_mps: f64,
    /// Length of the window around the hardest manoeuvre, s.
    pub zoom_s: f64,
    /// Rows at this rate instead of one per velocity sample, Hz. The paper's compensator then sees the velocity held
    /// between its samples, like a faster loop.
    pub output_rate_hz: Option<f64>,
    /// If a channel has more samples, neighbours are averaged, so memory does not grow with the length of a record:
    /// 500,000 are 1.4 hours at 100 Hz.
    pub most_samples: usize,
    /// Compensators in addition to the default ones (raw, `pade-1-1`, `pade-1-1-as-seen`, `exact-async`), in table
    /// order. They receive each velocity when it arrives, even with `output_rate_hz`. Default ones are not run twice.
    pub compensators: Vec<CompensatorKind>,
    /// Position channels in order of preference.
    pub position: Vec<String>,
    /// Velocity channels in order of preference.
    pub velocity: Vec<String>,
    /// Reference position channels in order of preference; may be empty.
    pub reference: Vec<String>,
    /// Channels with the compensated position computed by the aircraft in flight, in order of preference; may be empty.
    pub onboard: Vec<String>,
}

impl Settings {
    /// Default of [`Settings::most_samples`].
    pub const MOST_SAMPLES: usize = 500_000;

    /// Default settings for a delay.
    #[must_use]
    pub fn with_delay(delay: Delay, source: &str) -> Settings {
        let names = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect();
        Settings {
            delay,
            delay_uncertainty_s: None,
            delay_source: source.to_owned(),
            card: None,
            position_minus_velocity_s: None,
            position_lateness_s: None,
            velocity_lateness_s: None,
            start: StartRule::Warm,
            bridge_s: None,
            min_speed_mps: 2.0,
            zoom_s: 20.0,
            output_rate_hz: None,
            most_samples: Settings::MOST_SAMPLES,
            compensators: vec![],
            position: names(&["position.gps", "position.ins", "position.ekf"]),
            velocity: names(&["velocity.ekf", "velocity.ins", "velocity.gps"]),
            reference: names(&["position.truth"]),
            onboard: names(&["position.compensated"]),
        }
    }

    /// Whether a compensator always runs: the paper's and the exact asynchronous form.
    #[must_use]
    pub fn always_runs(kind: CompensatorKind) -> bool {
        let paper = CompensatorKind::Pade { m: 1, n: 1, rule: Discretisation::Tustin };
        kind == paper || kind == CompensatorKind::ExactAsync
    }
}
