//! The paper's compensator as an implementation of the common trait.

use crate::compensator::filtered::VelocityFilter;
use crate::pade::PadeTustin;
use record::StartRule;

/// [`PadeTustin`] as a [`VelocityFilter`], bit for bit. Over a gap it applies the trapezoidal rule with the long step,
/// as the paper's formula would.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PaperFilter {
    delay_s: f64,
    velocity: f64,
    filter: PadeTustin,
}

impl PaperFilter {
    /// Starts at rest. `None` if the delay is not positive and finite.
    pub(crate) fn new(delay_s: f64) -> Option<PaperFilter> {
        let positive = delay_s > 0.0 && delay_s.is_finite();
        positive.then(|| PaperFilter { delay_s, velocity: 0.0, filter: PadeTustin::warm(delay_s, 0.0) })
    }
}

impl VelocityFilter for PaperFilter {
    fn delay_s(&self) -> f64 {
        self.delay_s
    }

    fn start(&mut self, velocity: f64, rule: StartRule, step_s: f64) {
        self.velocity = velocity;
        self.filter = match rule {
            StartRule::Cold => PadeTustin::cold(self.delay_s, velocity, step_s),
            StartRule::Warm | StartRule::InvalidUntilTd => PadeTustin::warm(self.delay_s, velocity),
        };
    }

    fn step(&mut self, h: f64, velocity: f64) -> f64 {
        self.velocity = velocity;
        self.filter.step(h, velocity)
    }

    fn displacement(&self) -> f64 {
        self.filter.output()
    }
}
