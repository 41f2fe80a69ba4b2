//! What the pipeline decides about a replay.

use crate::compensator::{CompensatorKind, Discretisation};
use flight::Delay;
use record::{CardUse, Estimate, StartRule};

/// Settings of a replay, as they are meant.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Delay of the position to remove; positive means late.
    pub delay: Delay,
    /// Its standard uncertainty, s, if known.
    pub delay_uncertainty_s: Option<f64>,
    /// Where the delay comes from, in words, for the page.
    pub delay_source: String,
    /// The sensor card that it comes from, if it does.
    pub card: Option<CardUse>,
    /// How much later the position is than the velocity, s, if that is known apart from how late each is: what a right
    /// compensation leaves between the two.
    pub position_minus_velocity_s: Option<Estimate>,
    /// How late the position is, s: the number that the effect is judged by. `None` if it is not known; the position against
    /// this flight's velocity stands in then.
    pub position_lateness_s: Option<Estimate>,
    /// How late the velocity is, s, from the same datum. `None` if it is not known.
    pub velocity_lateness_s: Option<Estimate>,
    /// What is assumed before the first velocity.
    pub start: StartRule,
    /// Velocity gaps up to this long are bridged by a straight line, s. `None`: 2 Td, and
    /// never less than 2.5 median velocity intervals.
    pub bridge_s: Option<f64>,
    /// A flight whose 95th percentile of ground speed is lower does not move, m/s.
    pub min_speed_mps: f64,
    /// Length of the window around the hardest manoeuvre, s.
    pub zoom_s: f64,
    /// Rows at this rate instead of one for each velocity sample, Hz. The paper's compensator
    /// then sees the velocity held between its samples, as a faster loop would.
    pub output_rate_hz: Option<f64>,
    /// Of a record with more samples of a channel, neighbouring samples are averaged, so that the memory does not grow with
    /// its length: 500,000 are 1.4 hours at 100 Hz.
    pub most_samples: usize,
    /// Compensators beside those that always run (raw, `pade-1-1`, `pade-1-1-as-seen`, `exact-async`), in the order of
    /// the tables. They see each velocity when it comes, also with `output_rate_hz`; what always runs is not run twice.
    pub compensators: Vec<CompensatorKind>,
    /// Position channels in order of preference.
    pub position: Vec<String>,
    /// Velocity channels in order of preference.
    pub velocity: Vec<String>,
    /// Reference position channels in order of preference; none is fine.
    pub reference: Vec<String>,
    /// Channels with the compensated position that the aircraft computed in flight, in order of preference; none is fine.
    pub onboard: Vec<String>,
}

impl Settings {
    /// Usual value of [`Settings::most_samples`].
    pub const MOST_SAMPLES: usize = 500_000;

    /// The usual settings for a delay.
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

    /// Whether a compensator runs without being asked for: the paper's and the exact asynchronous form.
    #[must_use]
    pub fn always_runs(kind: CompensatorKind) -> bool {
        let paper = CompensatorKind::Pade { m: 1, n: 1, rule: Discretisation::Tustin };
        kind == paper || kind == CompensatorKind::ExactAsync
    }
}
