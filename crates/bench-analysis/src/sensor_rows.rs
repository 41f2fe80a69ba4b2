//! The data of a channel, as rows of numbers in the frame of the rig.

use crate::kinematics::swing_angle;
use crate::pattern::{Pattern, Samples};
use crate::rig::Rig;
use flight::{Channel, Geodetic, LocalFrame, Quantity, Stamp};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// The components of a channel that the swing can move, one value for each row of the channel, SI.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SensorRows {
    pub(crate) names: Vec<&'static str>,
    pub(crate) unit: &'static str,
    /// Which component of the kinematics each column is.
    pub(crate) component: Vec<usize>,
    pub(crate) columns: Vec<Vec<f64>>,
}

/// Kinematics of a quantity, and its pattern in the encoder's angle.
pub(crate) fn pattern_of(quantity: Quantity) -> Option<Pattern> {
    match quantity {
        Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::Height => Some(Pattern::CircleWithDrift),
        Quantity::VelocityNed => Some(Pattern::CircleRate),
        Quantity::Attitude => Some(Pattern::Angle),
        Quantity::AngularRate => Some(Pattern::Rate),
        Quantity::SpecificForce => Some(Pattern::Force),
        Quantity::MagneticField | Quantity::MagneticDirection => Some(Pattern::Circle),
        Quantity::EncoderCount | Quantity::EncoderAngle | Quantity::Pulse | Quantity::Scalar => None,
    }
}

/// The rows of `channel` in the rig's frames: geodetic positions as north, east, down from the first fix; body vectors
/// rotated into body axes by the mount; an attitude as swing angle. `None` if the swing does not affect this quantity,
/// or the log lacks some of its components.
pub(crate) fn sensor_rows(name: &str, channel: &Channel, rig: &Rig) -> Option<SensorRows> {
    match channel.quantity {
        Quantity::PositionGeodetic => Some(local_position(channel)),
        Quantity::PositionNed => Some(present(channel, &["north", "east", "down"], "m")),
        Quantity::VelocityNed => Some(present(channel, &["north", "east", "down"], "m/s")),
        Quantity::Height => Some(SensorRows { component: vec![2], ..present(channel, &["height"], "m") }),
        Quantity::Attitude => swing(name, channel, rig),
        Quantity::AngularRate => body(name, channel, rig, "rad/s"),
        Quantity::SpecificForce => body(name, channel, rig, "m/s²"),
        Quantity::MagneticField => body(name, channel, rig, "T"),
        Quantity::MagneticDirection => body(name, channel, rig, "1"),
        Quantity::EncoderCount | Quantity::EncoderAngle | Quantity::Pulse | Quantity::Scalar => None,
    }
    .filter(|rows| !rows.columns.is_empty())
}

fn present(channel: &Channel, names: &[&'static str], unit: &'static str) -> SensorRows {
    let there: Vec<usize> = (0..names.len().min(channel.series.components().len()))
        .filter(|&k| channel.present.get(k).copied().unwrap_or(true))
        .collect();
    SensorRows {
        names: there.iter().map(|&k| names[k]).collect(),
        unit,
        columns: there.iter().map(|&k| channel.series.component(k).to_vec()).collect(),
        component: there,
    }
}

fn row3(channel: &Channel, row: usize) -> [f64; 3] {
    [0, 1, 2].map(|k| channel.series.components().get(k).and_then(|c| c.get(row)).copied().unwrap_or(0.0))
}

fn local_position(channel: &Channel) -> SensorRows {
    let fix = |row: usize| {
        let [latitude, longitude, height] = row3(channel, row);
        Geodetic { latitude, longitude, height }
    };
    let frame = LocalFrame::new(fix(0));
    let ned: Vec<[f64; 3]> = (0..channel.series.len()).map(|row| frame.to_ned(fix(row))).collect();
    let has_height = channel.present.get(2).copied().unwrap_or(true);
    let there: Vec<usize> = (0..if has_height { 3 } else { 2 }).collect();
    SensorRows {
        names: there.iter().map(|&k| ["north", "east", "down"][k]).collect(),
        unit: "m",
        columns: there.iter().map(|&k| ned.iter().map(|p| p[k]).collect()).collect(),
        component: there,
    }
}

/// Body vectors in the body's axes. A mount that mixes axes needs all three.
fn body(name: &str, channel: &Channel, rig: &Rig, unit: &'static str) -> Option<SensorRows> {
    let turn = rig.mount_of(name).body_from_sensor();
    let names = ["x", "y", "z"];
    if turn == Matrix3::identity() {
        return Some(present(channel, &names, unit));
    }
    let all_there = channel.series.components().len() >= 3 && channel.present.iter().all(|p| *p);
    if !all_there {
        return None;
    }
    let turned: Vec<Vector3<f64>> =
        (0..channel.series.len()).map(|row| turn * Vector3::from(row3(channel, row))).collect();
    Some(SensorRows {
        names: names.to_vec(),
        unit,
        columns: (0..3).map(|k| turned.iter().map(|v| v[k]).collect()).collect(),
        component: vec![0, 1, 2],
    })
}

/// The attitude of the body: the sensor's, rotated back by the mount. Rows of w, x, y, z.
pub(crate) fn body_attitude(name: &str, channel: &Channel, rig: &Rig) -> Option<Vec<[f64; 4]>> {
    let [w, x, y, z] = channel.series.components() else { return None };
    let turn = rig.mount_of(name).body_from_sensor();
    let sensor_from_body = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn.transpose()));
    let rows = w.iter().zip(x).zip(y).zip(z).map(|(((w, x), y), z)| {
        let turned = Quaternion::new(*w, *x, *y, *z) * sensor_from_body.quaternion();
        [turned.w, turned.i, turned.j, turned.k]
    });
    Some(rows.collect())
}

fn swing(name: &str, channel: &Channel, rig: &Rig) -> Option<SensorRows> {
    let mut angle: Vec<f64> = body_attitude(name, channel, rig)?.into_iter().map(swing_angle).collect();
    unwrap(&mut angle);
    Some(SensorRows { names: vec!["swing angle"], unit: "rad", component: vec![0], columns: vec![angle] })
}

/// Removes jumps of whole turns.
pub(crate) fn unwrap(angle: &mut [f64]) {
    let mut turns = 0.0;
    let mut before: Option<f64> = None;
    for value in angle {
        if let Some(before) = before {
            turns -= ((*value - before) / std::f64::consts::TAU).round();
        }
        before = Some(*value);
        *value += turns * std::f64::consts::TAU;
    }
}

/// The rows that are measurements (no held repeats), with their times after `origin`.
pub(crate) fn update_samples(channel: &Channel, rows: &SensorRows, origin: Stamp) -> Samples {
    let t = channel.series.timeline().seconds_since(origin);
    let updates = channel.update_rows();
    Samples {
        t: updates.iter().map(|&row| t[row]).collect(),
        components: rows.columns.iter().map(|c| updates.iter().map(|&row| c[row]).collect()).collect(),
    }
}
