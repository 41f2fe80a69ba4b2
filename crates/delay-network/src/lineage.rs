//! Where a channel comes from, and which channels count as one witness.

use record::EffectKind;

/// Lineage of a channel: what it is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Lineage {
    /// Output of a sensor.
    Measured,
    /// Made from other channels of this vehicle: EKF, AHRS, local position, odometry, fused, INS output.
    Derived,
    /// Reference with its own clock: truth, motion capture, RTK with its own clock.
    Reference,
}

/// Source names of references, up to their first hyphen.
const REFERENCES: [&str; 5] = ["truth", "mocap", "vicon", "rtk", "reference"];

/// Lineage inferred from a name such as `position.ekf`. A `measured` or `made-from` key in the channel map takes
/// precedence.
///
/// ```
/// use delay_network::{Lineage, lineage_from_name};
/// assert_eq!(lineage_from_name("velocity.ekf-2"), Lineage::Derived);
/// assert_eq!(lineage_from_name("position.truth-sim"), Lineage::Reference);
/// assert_eq!(lineage_from_name("position.gps"), Lineage::Measured);
/// ```
#[must_use]
pub fn lineage_from_name(channel: &str) -> Lineage {
    let source = channel.split_once('.').map_or(channel, |(_, source)| source).to_ascii_lowercase();
    let stem = source.split('-').next().unwrap_or_default();
    if REFERENCES.contains(&stem) {
        Lineage::Reference
    } else if record::is_filter_output(channel) {
        Lineage::Derived
    } else {
        Lineage::Measured
    }
}

/// Role of a channel in the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    Measured,
    Derived,
    Reference,
    Acceleration,
}

impl From<Lineage> for Role {
    fn from(lineage: Lineage) -> Self {
        match lineage {
            Lineage::Measured => Role::Measured,
            Lineage::Derived => Role::Derived,
            Lineage::Reference => Role::Reference,
        }
    }
}

/// Kind of the model error between two roles.
pub(crate) fn effect_kind(first: Role, second: Role) -> EffectKind {
    let derived = [first, second].iter().filter(|role| **role == Role::Derived).count();
    let any = |wanted| first == wanted || second == wanted;
    match (any(Role::Acceleration), any(Role::Reference), derived) {
        (true, _, 0) => EffectKind::MeasuredAcceleration,
        (true, _, _) => EffectKind::DerivedAcceleration,
        (_, true, 0) => EffectKind::MeasuredReference,
        (_, true, _) => EffectKind::DerivedReference,
        (_, _, 0) => EffectKind::MeasuredMeasured,
        (_, _, 1) => EffectKind::MeasuredDerived,
        _ => EffectKind::DerivedDerived,
    }
}

/// Name of the family of all accelerations.
pub(crate) const ACCELERATION_FAMILY: &str = "acc";

/// Family of a channel. Lanes of one filter (`velocity.ekf`, `velocity.ekf-2`) are one witness, and so are all
/// accelerations. A second receiver (`position.gps-2`) is a separate witness.
pub(crate) fn family(channel: &str, role: Role) -> String {
    match role {
        Role::Acceleration => ACCELERATION_FAMILY.to_owned(),
        Role::Derived => match channel.rsplit_once('-') {
            Some((stem, lane)) if !lane.is_empty() && lane.bytes().all(|b| b.is_ascii_digit()) => stem.to_owned(),
            _ => channel.to_owned(),
        },
        Role::Measured | Role::Reference => channel.to_owned(),
    }
}

/// Whether a channel of a network stands for attitude and specific force together.
#[must_use]
pub fn is_acceleration(channel: &str) -> bool {
    channel.starts_with("acc[")
}

/// Name of attitude and specific force as one channel: `attitude.ahrs2 + specific-force.imu` is `acc[ahrs2+imu]`.
pub(crate) fn acceleration_name(second: &str) -> String {
    if is_acceleration(second) {
        return second.to_owned();
    }
    let parts: Vec<&str> = second
        .split('+')
        .map(str::trim)
        .map(|part| part.strip_prefix("attitude.").or_else(|| part.strip_prefix("specific-force.")).unwrap_or(part))
        .collect();
    format!("acc[{}]", parts.join("+"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_of_one_filter_are_one_witness_but_receivers_are_not() {
        assert_eq!(family("velocity.ekf-2", Role::Derived), "velocity.ekf");
        assert_eq!(family("position.gps-2", Role::Measured), "position.gps-2");
        assert_eq!(family("velocity.ekf-global", Role::Derived), "velocity.ekf-global");
    }

    #[test]
    fn attitude_and_specific_force_are_one_channel() {
        assert_eq!(acceleration_name("attitude.ahrs2 + specific-force.imu"), "acc[ahrs2+imu]");
        assert_eq!(acceleration_name("acc[ahrs2+imu]"), "acc[ahrs2+imu]");
    }
}
