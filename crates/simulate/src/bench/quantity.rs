//! The channels of a simulated sensor.

use flight::Quantity;
use serde::{Deserialize, Serialize};

/// A channel of the simulated sensor, in the order of the logs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BenchChannel {
    /// Position of the receiver.
    PositionGps,
    /// Position of the navigation filter.
    PositionIns,
    /// Velocity of the receiver.
    VelocityGps,
    /// Velocity of the navigation filter.
    VelocityIns,
    /// Attitude of the navigation filter.
    Attitude,
    /// Gyroscope.
    AngularRate,
    /// Accelerometer.
    SpecificForce,
    /// Magnetometer in tesla.
    MagneticField,
    /// Magnetometer in units of the local field, as Xsens' sensors send it.
    MagneticDirection,
    /// Height from the barometer.
    Height,
}

impl BenchChannel {
    /// All of them.
    pub const ALL: [BenchChannel; 10] = [
        BenchChannel::PositionGps,
        BenchChannel::PositionIns,
        BenchChannel::VelocityGps,
        BenchChannel::VelocityIns,
        BenchChannel::Attitude,
        BenchChannel::AngularRate,
        BenchChannel::SpecificForce,
        BenchChannel::MagneticField,
        BenchChannel::MagneticDirection,
        BenchChannel::Height,
    ];

    /// Its name in a [`flight::Flight`].
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            BenchChannel::PositionGps => "position.gps",
            BenchChannel::PositionIns => "position.ins",
            BenchChannel::VelocityGps => "velocity.gps",
            BenchChannel::VelocityIns => "velocity.ins",
            BenchChannel::Attitude => "attitude.ins",
            BenchChannel::AngularRate => "angular-rate.imu",
            BenchChannel::SpecificForce => "specific-force.imu",
            BenchChannel::MagneticField => "magnetic-field.imu",
            BenchChannel::MagneticDirection => "magnetic-direction.imu",
            BenchChannel::Height => "height.baro",
        }
    }

    /// Its quantity.
    #[must_use]
    pub fn quantity(self) -> Quantity {
        match self {
            BenchChannel::PositionGps | BenchChannel::PositionIns => Quantity::PositionGeodetic,
            BenchChannel::VelocityGps | BenchChannel::VelocityIns => Quantity::VelocityNed,
            BenchChannel::Attitude => Quantity::Attitude,
            BenchChannel::AngularRate => Quantity::AngularRate,
            BenchChannel::SpecificForce => Quantity::SpecificForce,
            BenchChannel::MagneticField => Quantity::MagneticField,
            BenchChannel::MagneticDirection => Quantity::MagneticDirection,
            BenchChannel::Height => Quantity::Height,
        }
    }

    /// Its topic in a log with a single clock.
    #[must_use]
    pub(super) fn topic(self) -> &'static str {
        match self {
            BenchChannel::PositionGps => "/bench/gps/fix",
            BenchChannel::PositionIns => "/bench/ins/fix",
            BenchChannel::VelocityGps => "/bench/gps/vel",
            BenchChannel::VelocityIns => "/bench/ins/vel",
            BenchChannel::Attitude => "/bench/ins/quaternion",
            BenchChannel::AngularRate => "/bench/imu/angular_velocity",
            BenchChannel::SpecificForce => "/bench/imu/acceleration",
            BenchChannel::MagneticField => "/bench/imu/mag",
            BenchChannel::MagneticDirection => "/bench/imu/mag_direction",
            BenchChannel::Height => "/bench/baro/height",
        }
    }

    /// Type of its messages, as named in ROS 1.
    #[must_use]
    pub fn type_name(self) -> &'static str {
        match self {
            BenchChannel::PositionGps | BenchChannel::PositionIns => "sensor_msgs/NavSatFix",
            BenchChannel::VelocityGps | BenchChannel::VelocityIns => "geometry_msgs/TwistStamped",
            BenchChannel::Attitude => "geometry_msgs/QuaternionStamped",
            BenchChannel::AngularRate | BenchChannel::SpecificForce | BenchChannel::MagneticDirection => {
                "geometry_msgs/Vector3Stamped"
            }
            BenchChannel::MagneticField => "sensor_msgs/MagneticField",
            BenchChannel::Height => "geometry_msgs/PointStamped",
        }
    }
}
