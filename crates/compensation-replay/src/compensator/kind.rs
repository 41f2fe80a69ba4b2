//! Compensators by name.

use crate::compensator::axis::{AxisSamples, Replayed, VelocityView, replay_axis};
use crate::compensator::pade_tustin::PaperFilter;
use crate::compensator::{
    Compensator, DelayedKalman, Discretisation, ExactFir, Filtered, KalmanSettings, ModalFilter, OfflineShift,
    PadeForm, PadeRefusal, StreamingAsync, rts_smooth,
};
use record::StartRule;
use std::str::FromStr;

/// Compensator kind, as named in a pipeline.
///
/// ```
/// use compensation_replay::{CompensatorKind, Discretisation};
/// let kind: CompensatorKind = "pade-2-2-foh".parse()?;
/// assert_eq!(kind, CompensatorKind::Pade { m: 2, n: 2, rule: Discretisation::Foh });
/// assert!("pade-0-5-foh".parse::<CompensatorKind>().unwrap_err().to_string().contains("unstable"));
/// # Ok::<(), compensation_replay::CompensatorError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CompensatorKind {
    /// Position plus a Padé filter of velocity. \[1/1\] with Tustin is the paper's, bit for bit.
    Pade {
        /// Degree of P.
        m: usize,
        /// Degree of Q.
        n: usize,
        /// Discretisation.
        rule: Discretisation,
    },
    /// [`ExactFir`].
    ExactFir,
    /// [`StreamingAsync`].
    ExactAsync,
    /// [`DelayedKalman`].
    Kalman,
    /// [`OfflineShift`]; not causal.
    OfflineShift,
    /// [`rts_smooth`]; not causal.
    RtsSmoother,
}

/// Parameters of a compensator besides its name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompensatorOptions {
    /// Delay of the position to remove, s; positive is late.
    pub delay_s: f64,
    /// Nominal velocity step, s: the duration of the ramp of a cold start.
    pub step_s: f64,
    /// Largest age of a position against the newest velocity, s: the longest gap that is bridged.
    pub max_gap_s: f64,
    /// For the Kalman filter and the smoother; estimated by [`fit_kalman`](crate::fit_kalman).
    pub kalman: Option<KalmanSettings>,
}

impl CompensatorOptions {
    /// For a delay and a velocity step: gaps up to `2 Td` and at least 2.5 steps, no Kalman settings.
    #[must_use]
    pub fn new(delay_s: f64, step_s: f64) -> CompensatorOptions {
        CompensatorOptions { delay_s, step_s, max_gap_s: (2.0 * delay_s).max(2.5 * step_s), kalman: None }
    }
}

/// Why the compensator cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CompensatorError {
    /// No compensator has this name.
    #[error("no compensator is called {name:?}{meant} `flightlag compensator --help` lists the names")]
    Unknown {
        /// The name.
        name: String,
        /// A semicolon, then a suggested name as a question if one is similar.
        meant: String,
    },
    /// The Padé form is rejected.
    #[error("{name:?}: {reason}")]
    Pade {
        /// The name.
        name: String,
        /// Reason.
        reason: PadeRefusal,
    },
    /// The matched rule places a zero at first order only.
    #[error("{name:?}: matched is first order only; use foh")]
    MatchedOrder {
        /// The name.
        name: String,
    },
    /// It needs the whole record.
    #[error("{name} is not causal: it cannot run sample by sample")]
    NotCausal {
        /// The name.
        name: String,
    },
    /// A setting is invalid.
    #[error("{name}: {setting} must be positive and finite, not {value}")]
    Setting {
        /// The compensator.
        name: String,
        /// The setting.
        setting: &'static str,
        /// Its value.
        value: f64,
    },
    /// Kalman filters need noise levels.
    #[error("{name} needs jerk density and noise levels, all positive")]
    KalmanSettings {
        /// The name.
        name: String,
    },
    /// No spline fits the positions.
    #[error("{name}: {reason}")]
    Spline {
        /// The name.
        name: String,
        /// Reason.
        reason: signal::SplineError,
    },
}

/// Forms offered by name; others up to \[8/8\] with n − 2 ≤ m ≤ n are also accepted.
const OFFERED: [(usize, usize); 11] =
    [(0, 1), (1, 1), (0, 2), (1, 2), (2, 2), (1, 3), (2, 3), (3, 3), (2, 4), (3, 4), (4, 4)];

impl CompensatorError {
    /// No compensator has this name; suggests the nearest of `names`.
    #[must_use]
    pub fn unknown<'n>(name: String, names: impl IntoIterator<Item = &'n str>) -> CompensatorError {
        let near = settings::likely(&name, names);
        let meant = near.map_or_else(|| ";".to_owned(), |near| format!("; did you mean {near:?}?"));
        CompensatorError::Unknown { name, meant }
    }

    /// The same error with the name as typed, if the user abbreviated it.
    fn called(self, typed: &str) -> CompensatorError {
        let name = typed.to_owned();
        match self {
            CompensatorError::Pade { reason, .. } => CompensatorError::Pade { name, reason },
            CompensatorError::MatchedOrder { .. } => CompensatorError::MatchedOrder { name },
            other => other,
        }
    }
}

impl CompensatorKind {
    /// All offered kinds, ordered by merit: Padé by order, then exact, then the optimal ones.
    #[must_use]
    pub fn all() -> Vec<CompensatorKind> {
        let rules = [Discretisation::Tustin, Discretisation::Foh, Discretisation::Zoh, Discretisation::Matched];
        let pade = OFFERED.iter().flat_map(|&(m, n)| rules.map(|rule| CompensatorKind::Pade { m, n, rule }));
        let sound = pade.filter(|k| !matches!(k, CompensatorKind::Pade { n: 2.., rule: Discretisation::Matched, .. }));
        sound
            .chain([
                CompensatorKind::ExactFir,
                CompensatorKind::ExactAsync,
                CompensatorKind::Kalman,
                CompensatorKind::OfflineShift,
                CompensatorKind::RtsSmoother,
            ])
            .collect()
    }

    /// Whether it can run on an aircraft.
    #[must_use]
    pub fn causal(self) -> bool {
        !matches!(self, CompensatorKind::OfflineShift | CompensatorKind::RtsSmoother)
    }

    /// Title for a page.
    #[must_use]
    pub fn title(self) -> String {
        match self {
            CompensatorKind::Pade { m, n, rule } => {
                let rule_name = match rule {
                    Discretisation::Tustin => "Tustin",
                    Discretisation::Foh => "first-order hold",
                    Discretisation::Zoh => "zero-order hold",
                    Discretisation::Matched => "matched",
                };
                let paper = if (m, n, rule) == (1, 1, Discretisation::Tustin) { " (the paper)" } else { "" };
                format!("Padé [{m}/{n}], {rule_name}{paper}")
            }
            CompensatorKind::ExactFir => "exact FIR, held position".to_owned(),
            CompensatorKind::ExactAsync => "exact asynchronous, p + ∫v".to_owned(),
            CompensatorKind::Kalman => "Kalman filter with delayed positions".to_owned(),
            CompensatorKind::OfflineShift => "p(t + Td), spline, offline".to_owned(),
            CompensatorKind::RtsSmoother => "smoother on shifted data, offline: the bound".to_owned(),
        }
    }

    /// Builds a compensator that runs sample by sample, not started yet.
    ///
    /// # Errors
    /// Not causal, or a setting that is missing or invalid.
    pub fn build(self, options: &CompensatorOptions) -> Result<Box<dyn Compensator>, CompensatorError> {
        self.check(options)?;
        let (td, gap) = (options.delay_s, options.max_gap_s);
        let no_delay = || self.setting("delay", td);
        Ok(match self {
            CompensatorKind::Pade { m: 1, n: 1, rule: Discretisation::Tustin } => {
                Box::new(Filtered::new(PaperFilter::new(td).ok_or_else(no_delay)?, options.step_s))
            }
            CompensatorKind::Pade { .. } => Box::new(Filtered::new(self.filter(td)?, options.step_s)),
            CompensatorKind::ExactFir => Box::new(ExactFir::new(td, gap)),
            CompensatorKind::ExactAsync => Box::new(StreamingAsync::new(td, gap)),
            CompensatorKind::Kalman => {
                let filter = options.kalman.and_then(|settings| DelayedKalman::new(td, gap, settings));
                Box::new(filter.ok_or_else(|| CompensatorError::KalmanSettings { name: self.to_string() })?)
            }
            CompensatorKind::OfflineShift | CompensatorKind::RtsSmoother => {
                return Err(CompensatorError::NotCausal { name: self.to_string() });
            }
        })
    }

    /// The modal filter of a Padé form.
    ///
    /// # Errors
    /// Rejected forms, a delay that is not positive, and kinds that are not Padé ([`CompensatorError::Unknown`]).
    pub fn filter(self, delay_s: f64) -> Result<ModalFilter, CompensatorError> {
        let CompensatorKind::Pade { m, n, rule } = self else {
            return Err(unknown(&format!("{self} as a filter")));
        };
        let name = || self.to_string();
        let form = PadeForm::new(m, n).map_err(|reason| CompensatorError::Pade { name: name(), reason })?;
        if rule == Discretisation::Matched && n > 1 {
            return Err(CompensatorError::MatchedOrder { name: name() });
        }
        ModalFilter::new(&form, rule, delay_s).ok_or_else(|| self.setting("delay", delay_s))
    }

    /// Replays a whole record of one axis, causal or not: position at every row, m.
    ///
    /// # Errors
    /// As [`build`](CompensatorKind::build), and positions that no spline fits.
    pub fn replay(
        self,
        options: &CompensatorOptions,
        samples: &AxisSamples<'_>,
        start: StartRule,
        view: VelocityView,
        rows: &[f64],
    ) -> Result<Replayed, CompensatorError> {
        let whole = |output| Replayed { output, refused: 0, first_refusal: None };
        match self {
            CompensatorKind::OfflineShift => {
                self.check(options)?;
                let shift = OfflineShift::new(samples.position_t, samples.position, options.delay_s)
                    .map_err(|reason| CompensatorError::Spline { name: self.to_string(), reason })?;
                Ok(whole(rows.iter().map(|&t| shift.at(t)).collect()))
            }
            CompensatorKind::RtsSmoother => {
                self.check(options)?;
                let settings = options.kalman.filter(KalmanSettings::is_sound);
                let settings = settings.ok_or_else(|| CompensatorError::KalmanSettings { name: self.to_string() })?;
                let smoothed = rts_smooth(samples, options.delay_s, &settings, rows);
                Ok(whole(smoothed.into_iter().map(|s| s.map(|s| s.position)).collect()))
            }
            _ => Ok(replay_axis(self.build(options)?.as_mut(), samples, start, view, rows)),
        }
    }

    fn check(self, options: &CompensatorOptions) -> Result<(), CompensatorError> {
        let settings = [("delay", options.delay_s), ("step", options.step_s), ("longest gap", options.max_gap_s)];
        match settings.into_iter().find(|(_, value)| !(*value > 0.0 && value.is_finite())) {
            Some((setting, value)) => Err(self.setting(setting, value)),
            None => Ok(()),
        }
    }

    fn setting(self, setting: &'static str, value: f64) -> CompensatorError {
        CompensatorError::Setting { name: self.to_string(), setting, value }
    }
}

impl std::fmt::Display for CompensatorKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            CompensatorKind::Pade { m, n, rule } => write!(f, "pade-{m}-{n}-{}", rule.name()),
            CompensatorKind::ExactFir => f.write_str("exact-fir"),
            CompensatorKind::ExactAsync => f.write_str("exact-async"),
            CompensatorKind::Kalman => f.write_str("kalman"),
            CompensatorKind::OfflineShift => f.write_str("offline-shift"),
            CompensatorKind::RtsSmoother => f.write_str("rts-smoother"),
        }
    }
}

impl FromStr for CompensatorKind {
    type Err = CompensatorError;

    /// `pade-<m>-<n>-<tustin|foh|zoh|matched>`, or one of the other names. The default discretisation is that of the
    /// paper for `pade-1-1` and `foh` for all others.
    fn from_str(name: &str) -> Result<CompensatorKind, CompensatorError> {
        let others = CompensatorKind::all().into_iter().filter(|k| !matches!(k, CompensatorKind::Pade { .. }));
        if let Some(kind) = others.into_iter().find(|k| k.to_string() == name) {
            return Ok(kind);
        }
        let kind = pade(name).ok_or_else(|| unknown(name))?;
        // With a delay of 1 s: only checks that the filter exists.
        kind.filter(1.0).map_err(|error| error.called(name))?;
        Ok(kind)
    }
}

fn pade(name: &str) -> Option<CompensatorKind> {
    let parts: Vec<&str> = name.strip_prefix("pade-")?.split('-').collect();
    let degree = |text: &str| text.parse::<usize>().ok().filter(|d| *d < 100 && d.to_string() == text);
    let (m, n) = (degree(parts.first()?)?, degree(parts.get(1)?)?);
    let rule = match parts.get(2..)? {
        [] if (m, n) == (1, 1) => Discretisation::Tustin,
        [] | ["foh"] => Discretisation::Foh,
        ["tustin"] => Discretisation::Tustin,
        ["zoh"] => Discretisation::Zoh,
        ["matched"] => Discretisation::Matched,
        _ => return None,
    };
    Some(CompensatorKind::Pade { m, n, rule })
}

fn unknown(name: &str) -> CompensatorError {
    let all: Vec<String> = CompensatorKind::all().iter().map(ToString::to_string).collect();
    CompensatorError::unknown(name.to_owned(), all.iter().map(String::as_str))
}
