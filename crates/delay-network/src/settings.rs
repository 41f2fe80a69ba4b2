//! Constants of the network and their origin.

use record::EffectKind;

/// Standard deviations of the model errors by kind of pair, s (table of section 2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelErrors {
    /// Position and velocity, both measured.
    pub measured_measured_s: f64,
    /// One of the two derived.
    pub measured_derived_s: f64,
    /// Both derived.
    pub derived_derived_s: f64,
    /// Measured velocity against acceleration.
    pub measured_acceleration_s: f64,
    /// Derived velocity against acceleration: a filter integrates this IMU and has no single delay against it.
    pub derived_acceleration_s: f64,
    /// Measured channel against a reference.
    pub measured_reference_s: f64,
    /// Derived channel against a reference.
    pub derived_reference_s: f64,
}

impl Default for ModelErrors {
    fn default() -> Self {
        ModelErrors {
            measured_measured_s: 0.0005,
            measured_derived_s: 0.008,
            derived_derived_s: 0.007,
            measured_acceleration_s: 0.006,
            derived_acceleration_s: 0.060,
            measured_reference_s: 0.0005,
            derived_reference_s: 0.010,
        }
    }
}

impl ModelErrors {
    /// Standard deviation of one kind, s.
    #[must_use]
    pub fn of(&self, kind: EffectKind) -> f64 {
        match kind {
            EffectKind::MeasuredMeasured => self.measured_measured_s,
            EffectKind::MeasuredDerived => self.measured_derived_s,
            EffectKind::DerivedDerived => self.derived_derived_s,
            EffectKind::MeasuredAcceleration => self.measured_acceleration_s,
            EffectKind::DerivedAcceleration => self.derived_acceleration_s,
            EffectKind::MeasuredReference => self.measured_reference_s,
            EffectKind::DerivedReference => self.derived_reference_s,
        }
    }
}

/// How references are used in the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReferenceUse {
    /// They judge channels but are not part of the network.
    Judges,
    /// They are the datum: on time by definition.
    Datum,
    /// They are part of it, each with its own lateness: their clock was tied to a channel of the log.
    OwnClock,
}

/// Settings of [`solve`](crate::solve). The defaults are the constants of the specification.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkSettings {
    /// Model errors by kind of pair.
    pub model: ModelErrors,
    /// Share ρ of the variance of a pair that comes from the noise of its channels and cancels in loops, 0 to 1.
    pub shared_noise: f64,
    /// Uncertainty of the IMU's own lateness, common to all, s.
    pub datum_uncertainty_s: f64,
    /// Lateness of one acceleration against the others, s.
    pub acceleration_pin_s: f64,
    /// Probability below which the closure test fails.
    pub closure_p: f64,
    /// Least |w| of a suspect.
    pub suspect_w: f64,
    /// Suspects whose |w| is within this distance of the largest are its rivals.
    pub rival_w: f64,
    /// Maximum number of effects freed.
    pub most_freed: usize,
    /// Lead of a filter over true time that is accepted without refusing the datum, s.
    pub filter_lead_s: f64,
    /// Model part of the uncertainty above which a figure is weak, s.
    pub weak_above_s: f64,
    /// How references are used. By default they only judge.
    pub reference: ReferenceUse,
    /// Velocity that compensation uses: it is the zero of a part without a datum.
    pub compensation_velocity: Option<String>,
}

impl Default for NetworkSettings {
    fn default() -> Self {
        NetworkSettings {
            model: ModelErrors::default(),
            shared_noise: 0.91,
            datum_uncertainty_s: 0.005,
            acceleration_pin_s: 0.002,
            closure_p: 0.001,
            suspect_w: 3.29,
            rival_w: 1.0,
            most_freed: 3,
            filter_lead_s: 0.030,
            weak_above_s: 0.020,
            reference: ReferenceUse::Judges,
            compensation_velocity: None,
        }
    }
}
