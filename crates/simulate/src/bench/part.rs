//! A bench may log to one file or to two.

/// Contents of a log of the bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// Encoder, pulses and sensor.
    Whole,
    /// Encoder and pulses.
    Encoder,
    /// The sensor.
    Sensor,
}

impl Part {
    pub(super) fn has_encoder(self) -> bool {
        self != Part::Sensor
    }

    pub(super) fn has_sensor(self) -> bool {
        self != Part::Encoder
    }
}
