use super::*;
use delay_from_flight::{FlightDelaySettings, measure_delays};
use flight::{Channel, ChannelSource, Clock, Flight, LeverArm, Quantity, Series, Stamp, StampKind, Timeline};
use std::f64::consts::TAU;

/// A path by its heading and speed: time, position, velocity, every `step_s`.
struct Path {
    time_s: Vec<f64>,
    place: [Vec<f64>; 2],
    velocity: [Vec<f64>; 2],
}

fn path(duration_s: f64, step_s: f64, heading: impl Fn(f64) -> f64, speed: impl Fn(f64) -> f64) -> Path {
    let mut out = Path { time_s: vec![], place: [vec![], vec![]], velocity: [vec![], vec![]] };
    let fine = 20;
    let (mut place, h) = ([0.0; 2], step_s / fine as f64);
    for row in 0..(duration_s / step_s) as usize {
        let t = row as f64 * step_s;
        out.time_s.push(t);
        let velocity = velocity_at(&heading, &speed, t);
        for (axis, (x, v)) in place.into_iter().zip(velocity).enumerate() {
            out.place[axis].push(x);
            out.velocity[axis].push(v);
        }
        for part in 0..fine {
            let v = velocity_at(&heading, &speed, t + (part as f64 + 0.5) * h);
            place = [place[0] + h * v[0], place[1] + h * v[1]];
        }
    }
    out
}

fn velocity_at(heading: &impl Fn(f64) -> f64, speed: &impl Fn(f64) -> f64, t: f64) -> [f64; 2] {
    let (sin, cos) = heading(t).sin_cos();
    [speed(t) * cos, speed(t) * sin]
}

fn motion(path: &Path) -> LeverMotion<'_> {
    LeverMotion { time_s: &path.time_s, velocity_mps: [&path.velocity[0], &path.velocity[1]], ..LeverMotion::default() }
}

#[test]
fn in_turns_at_constant_speed_the_shift_is_the_arm_over_the_speed() {
    for speed in [3.0, 11.0, 40.0] {
        let circle = path(70.0, 0.1, |t| TAU * t / 23.0, |_| speed);
        let found = lever_sensitivity(&motion(&circle)).unwrap();
        assert!((found.shift_s_per_m + 1.0 / speed).abs() < 1e-12, "{found:?}");
        assert!((found.speed_mps().unwrap() - speed).abs() < 1e-9);
        // With the nose across the path, an antenna ahead is one to the side, and one to the right is one to the rear.
        let across = [circle.velocity[1].iter().map(|e| -e).collect::<Vec<f64>>(), circle.velocity[0].clone()];
        let nose = Some([&across[0][..], &across[1][..]]);
        let crabbed = lever_sensitivity(&LeverMotion { nose, ..motion(&circle) }).unwrap();
        assert!((crabbed.sideways_s_per_m - 1.0 / speed).abs() < 1e-12, "{crabbed:?}");
        assert!(crabbed.shift_s_per_m.abs() < 0.2 / speed);
    }
}

#[test]
fn a_straight_and_steady_path_gives_no_sensitivity() {
    let straight = path(60.0, 0.1, |_| 0.3, |_| 15.0);
    assert_eq!(lever_sensitivity(&motion(&straight)), None);
    assert_eq!(lever_sensitivity(&LeverMotion::default()), None);
    // A straight path with varying speed: the nose direction is constant, so an arm is an offset and shifts nothing.
    let varied = path(60.0, 0.1, |_| 0.3, |t| 15.0 + 5.0 * (t / 3.0).sin());
    assert!(lever_sensitivity(&motion(&varied)).unwrap().shift_s_per_m.abs() < 1e-9);
}

#[test]
fn each_piece_has_its_own_offset_and_drift() {
    let circle = path(60.0, 0.1, |t| TAU * t / 23.0, |t| 9.0 + 4.0 * (t / 5.0).sin());
    let piece: Vec<usize> = circle.time_s.iter().map(|t| usize::from(*t > 31.0)).collect();
    let both = lever_sensitivity(&LeverMotion { piece: &piece, ..motion(&circle) }).unwrap();
    // By hand: the separate products of each piece, summed.
    let mut sums = [0.0; 2];
    for number in 0..2 {
        let weight: Vec<f64> = piece.iter().map(|p| if *p == number { 2.0 } else { 0.0 }).collect();
        let [forward, _, power] = {
            let mut projected = Projected::default();
            let rows = 0..piece.len();
            let one = LeverMotion { weight: &weight, ..motion(&circle) };
            rows.filter_map(|row| sample_of(&one, row)).for_each(|sample| projected.add(&sample));
            projected.products(true)
        };
        sums = [sums[0] + forward, sums[1] + power];
    }
    assert!((both.shift_s_per_m + sums[0] / sums[1]).abs() < 1e-12);
}

fn channel(quantity: Quantity, time_s: &[f64], components: Vec<Vec<f64>>) -> Channel {
    let stamps: Vec<Stamp> = time_s.iter().map(|t| Stamp((t * 1e9).round() as i64)).collect();
    let timeline = Timeline::new(StampKind::Measured, Clock::Boot, stamps).unwrap();
    Channel {
        quantity,
        held: vec![false; time_s.len()],
        series: Series::new(timeline, components).unwrap(),
        present: vec![true; 3],
        other_stamps: vec![],
        source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
    }
}

/// Small noise without a generator: phases that do not repeat.
fn pseudo_noise(row: usize, scale: f64) -> f64 {
    let row = row as f64;
    scale * ((row * 12.9898).sin() * 43_758.545).sin()
}

/// Delay of a receiver 0.2 s late with an antenna `arm_m` ahead, as measured by the delay network's pair.
fn measured(flown: &Path, arm_m: f64) -> f64 {
    let late = 4;
    let rows: Vec<usize> = (late..flown.time_s.len()).step_by(2).collect();
    let at: Vec<f64> = rows.iter().map(|row| flown.time_s[*row]).collect();
    let position: Vec<Vec<f64>> = (0..2)
        .map(|axis| {
            let of = |row: &usize| {
                let then = row - late;
                let speed = flown.velocity[0][then].hypot(flown.velocity[1][then]);
                flown.place[axis][then]
                    + arm_m * flown.velocity[axis][then] / speed
                    + pseudo_noise(3 * row + axis, 0.05)
            };
            rows.iter().map(of).collect()
        })
        .chain([vec![0.0; rows.len()]])
        .collect();
    let velocity = vec![flown.velocity[0].clone(), flown.velocity[1].clone(), vec![0.0; flown.time_s.len()]];
    let channels = [
        ("position.gps".to_owned(), channel(Quantity::PositionNed, &at, position)),
        ("velocity.ekf".to_owned(), channel(Quantity::VelocityNed, &flown.time_s, velocity)),
    ];
    let flight = Flight { channels: channels.into(), ..Flight::default() };
    let (delays, _) = measure_delays(&flight, &FlightDelaySettings::default());
    delays.pairs[0].delay.found().unwrap().delay_s.value
}

#[test]
fn the_shift_matches_the_delay_estimator() {
    // Constant speed: a simulation of the campaign showed −88 ms for 1 m at 11.36 m/s. And a varying speed.
    type Case = (&'static str, fn(f64) -> f64, f64);
    let cases: [Case; 3] = [
        ("steady", |_| 11.36, 0.5),
        ("slow changes", |t| 11.0 + 2.0 * (t / 9.0).sin(), 0.5),
        ("strong", |t| 12.0 + 5.0 * (t / 4.0).sin(), 1.5),
    ];
    for (name, speed, within_ms) in cases {
        let flown = path(120.0, 0.05, |t| 1.5 * (TAU * t / 17.0).sin() + t / 25.0, speed);
        let predicted = 1e3 * lever_sensitivity(&motion(&flown)).unwrap().shift_s_per_m;
        let measured_ms = 1e3 * (measured(&flown, 1.0) - measured(&flown, 0.0));
        println!("{name}: predicted {predicted:.2} ms, measured {measured_ms:.2} ms");
        assert!(
            (predicted - measured_ms).abs() < within_ms,
            "{name}: predicted {predicted:.2} ms, measured {measured_ms:.2} ms"
        );
    }
}

fn about(arms: &[(&str, f64, f64)]) -> About {
    let arm = |(sensor, forward_m, right_m): &(&str, f64, f64)| LeverArm {
        sensor: (*sensor).to_owned(),
        parameter: format!("{}_POS", sensor.to_uppercase()),
        forward_m: *forward_m,
        right_m: *right_m,
        down_m: 0.0,
    };
    About { lever_arms: arms.iter().map(arm).collect(), ..About::default() }
}

#[test]
fn the_arm_starts_at_the_point_of_the_velocity() {
    let set = about(&[("gps", 0.5, 0.1), ("imu", 0.2, 0.0), ("gps-2", -0.4, 0.0)]);
    let forward = |receiver, point| antenna_arm(&set, receiver, point).map(|arm| (arm.forward_m * 1e9).round() / 1e9);
    assert_eq!(forward(1, VelocityPoint::Antenna), Some(0.0));
    assert_eq!(forward(1, VelocityPoint::Origin), Some(0.5));
    assert_eq!(forward(1, VelocityPoint::Imu), Some(0.3));
    assert_eq!(forward(2, VelocityPoint::Origin), Some(-0.4));
    let right = |right_m| {
        let set = about(&[("gps", 0.5, 0.1), ("imu", 0.2, right_m)]);
        antenna_arm(&set, 1, VelocityPoint::Imu).map(|arm| (arm.right_m * 1e9).round() / 1e9)
    };
    assert_eq!((right(0.3), right(-0.3)), (Some(-0.2), Some(0.4)));
    // Parameters at their default of zero are not a configuration.
    let unset = about(&[("gps", 0.0, 0.0), ("imu", 0.2, 0.0)]);
    assert_eq!(antenna_arm(&unset, 1, VelocityPoint::Imu), None);
    assert_eq!(antenna_arm(&About::default(), 1, VelocityPoint::Antenna).map(|arm| arm.forward_m), Some(0.0));
}

#[test]
fn the_correction_removes_the_shift_and_adds_its_uncertainty() {
    let sensitivity = LeverSensitivity { shift_s_per_m: -0.1, sideways_s_per_m: 0.0, samples: 1 };
    let arm =
        AntennaArm { forward_m: 0.5, right_m: 0.3, tolerance_m: 0.03_f64.sqrt(), from: "the pipeline".to_owned() };
    let shift = sensitivity.shift_s(&arm);
    assert_eq!(shift.value, -0.05);
    assert!((shift.standard_uncertainty.unwrap() - 0.01).abs() < 1e-12);
    let delay_s = Estimate { value: 0.15, standard_uncertainty: Some(0.02) };
    let corrected = sensitivity.corrected(delay_s, &arm);
    assert!((corrected.value - 0.2).abs() < 1e-12);
    assert!((corrected.standard_uncertainty.unwrap() - 0.0005_f64.sqrt()).abs() < 1e-12);
    assert_eq!(sensitivity.words(), "± 10.0 ms per 0.1 m of unknown lever arm (antenna ahead or behind)");
    assert_eq!(
        sensitivity.words_of(&arm),
        "the antenna is 0.50 m ahead of the point where velocity is taken (the pipeline): that makes the position look \
         50.0 ± 20.0 ms earlier, which is corrected"
    );
}
