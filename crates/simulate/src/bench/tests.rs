//! Compares truth with closed formulas, and samples with truth.

use super::lag::Lagged;
use super::*;
use crate::sensor::{Interval, SensorSettings};
use crate::write::{BagSettings, Container, McapEncoding, McapSettings};
use flight::{Clock, LocalFrame, Stamp};
use std::f64::consts::{PI, TAU};

const MOMENTS: [f64; 7] = [11.3, 14.07, 20.001, 33.3335, 47.9, 55.5, 68.2];

fn bench(settings: &BenchSettings) -> SimulatedBench {
    simulate_bench(settings).unwrap()
}

fn still() -> BenchSettings {
    BenchSettings { sensor: Default::default(), ..BenchSettings::default() }
}

fn clean(channel: BenchChannel, sensor: BenchSensor) -> BenchSettings {
    still().with(channel, sensor)
}

/// Fourth-order central difference.
fn slope(h: f64, t: f64, of: impl Fn(f64) -> f64) -> f64 {
    (of(t - 2.0 * h) - 8.0 * of(t - h) + 8.0 * of(t + h) - of(t + 2.0 * h)) / (12.0 * h)
}

fn swings() -> [Swing; 3] {
    [Swing::hand(), Swing::pushed(), Swing::Sine { amplitude_rad: 1.0, frequency_hz: 0.7 }]
}

#[test]
fn rate_acceleration_and_jerk_are_derivatives_of_the_angle() {
    for swing in swings() {
        for flexible in [None, Some(FlexibleBar::of_tip_mass(0.5, 4.0, 0.02))] {
            let mut settings = BenchSettings { swing, ..still() };
            settings.bar.flexible = flexible;
            let truth = bench(&settings).truth;
            for (which, at) in [
                ("axis", (|b: &BenchTruth, t| b.at(t)) as fn(&BenchTruth, f64) -> BarMotion),
                ("chord", |b, t| b.chord_at(t)),
                ("slope", |b, t| b.slope_at(t)),
            ] {
                for t in MOMENTS {
                    let h = 0.004;
                    let now = at(&truth, t);
                    let pairs = [
                        (slope(h, t, |t| at(&truth, t).angle), now.rate),
                        (slope(h, t, |t| at(&truth, t).rate), now.acceleration),
                        (slope(h, t, |t| at(&truth, t).acceleration), now.jerk),
                    ];
                    // h⁴/30 of a fifth derivative below 1e5 is 1e-6; it has a step at the start of a push.
                    for (order, (numeric, exact)) in pairs.into_iter().enumerate() {
                        let limit = [2e-5, 2e-4, 2e-2][order] * (1.0 + exact.abs());
                        assert!((numeric - exact).abs() < limit, "{swing:?} {which} {order} at {t}: {numeric} {exact}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_swing_rests_before_and_after_and_reaches_the_requested_angle() {
    for (swing, amplitude, within) in [(swings()[0], PI / 3.0, 0.001), (swings()[1], PI / 3.0, 0.01)] {
        for seed in 1..4 {
            let truth = bench(&BenchSettings { swing, seed, rest_angle_rad: 0.2, ..still() }).truth;
            for t in [-5.0, 0.0, 9.99, 70.01, 80.0, 85.0] {
                let rest = BarMotion { angle: 0.2, rate: 0.0, acceleration: 0.0, jerk: 0.0 };
                assert_eq!(truth.at(t), rest, "{t}");
            }
            let largest =
                (0..6000).map(|i| (truth.at(10.0 + f64::from(i) * 0.01).angle - 0.2).abs()).fold(0.0, f64::max);
            assert!((largest / amplitude - 1.0).abs() < within, "{swing:?} {seed}: {largest}");
        }
    }
}

#[test]
fn between_pushes_a_hanging_pendulum_only_measures_damping() {
    // Design note 1.6: f_X = L ξ″ + g sin ξ = L (push − c ξ′).
    let mut settings = clean(BenchChannel::SpecificForce, BenchSensor::clean(100.0));
    settings.bar.mount = Mount::Hanging;
    settings.swing = Swing::pushed();
    let truth = bench(&settings).truth;
    let free = (0..5000).map(|i| 14.0 + f64::from(i) * 0.01).filter(|&t| {
        let force = truth.value(BenchChannel::SpecificForce, t)[0];
        (force + 1.3 * 0.12 * truth.at(t).rate).abs() < 1e-5
    });
    let share = free.count() as f64 / 5000.0;
    // A push of 0.35 to 0.6 s every 1.22 s.
    assert!((0.5..0.75).contains(&share), "{share}");
}

#[test]
fn position_velocity_and_specific_force_are_consistent_for_any_arm() {
    let arms = [[0.0, 0.0, -1.3], [0.0, 0.0, 1.3], [0.21, -0.1, -1.15]];
    for (arm, flexible) in arms
        .into_iter()
        .flat_map(|arm| [None, Some(FlexibleBar::of_tip_mass(1.0, 5.0, 0.02))].map(|flexible| (arm, flexible)))
    {
        let mut settings = still();
        settings.bar.mount = Mount::Custom(arm);
        settings.bar.flexible = flexible;
        let truth = bench(&settings).truth;
        let g = settings.site.gravity_mps2;
        for t in MOMENTS {
            let p = |t: f64, k: usize| truth.value(BenchChannel::PositionIns, t)[k];
            let v = |t: f64, k: usize| truth.value(BenchChannel::VelocityIns, t)[k];
            let acceleration = [0, 1, 2].map(|k| slope(0.003, t, |t| v(t, k)));
            (0..3).for_each(|k| assert!((slope(0.003, t, |t| p(t, k)) - v(t, k)).abs() < 1e-6, "{arm:?} {t}"));
            // Rotated back by the attitude: f_NED = a − g.
            let f = truth.value(BenchChannel::SpecificForce, t);
            let q = truth.value(BenchChannel::Attitude, t);
            let q = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3]));
            let ned = q * nalgebra::Vector3::new(f[0], f[1], f[2]);
            let expected = [acceleration[0], acceleration[1], acceleration[2] - g];
            (0..3).for_each(|k| assert!((ned[k] - expected[k]).abs() < 1e-5, "{arm:?} {t} {k}: {ned} {expected:?}"));
            assert_eq!(truth.value(BenchChannel::Height, t), [-p(t, 2)]);
            // The magnetometer reads the field of the site, rotated to the body.
            let field = q.inverse() * nalgebra::Vector3::from(settings.site.field_t);
            let read = truth.value(BenchChannel::MagneticField, t);
            (0..3).for_each(|k| assert!((read[k] - field[k]).abs() < 1e-18));
        }
    }
}

/// The bar's motion and what a channel of the upright bench must read, by Park & Lee 2010, eq. 1 and 2 (design note 1.2).
fn assert_upright(channel: BenchChannel, expected: impl Fn(BarMotion) -> Vec<f64>) {
    let truth = bench(&still()).truth;
    for t in MOMENTS {
        let (value, expected) = (truth.value(channel, t), expected(truth.at(t)));
        value.iter().zip(&expected).for_each(|(v, e)| assert!((v - e).abs() < 1e-13, "{channel:?} {v} {e}"));
    }
}

#[test]
fn the_upright_bench_moves_as_in_the_paper() {
    let (l, eta) = (1.3, 30f64.to_radians());
    assert_upright(BenchChannel::PositionGps, |BarMotion { angle: xi, .. }| {
        vec![-l * eta.cos() * xi.sin(), -l * eta.sin() * xi.sin(), -l * xi.cos()]
    });
    assert_upright(BenchChannel::VelocityGps, |BarMotion { angle: xi, rate, .. }| {
        let horizontal = -l * rate * xi.cos();
        vec![horizontal * eta.cos(), horizontal * eta.sin(), l * rate * xi.sin()]
    });
    assert_upright(BenchChannel::Attitude, |BarMotion { angle: xi, .. }| {
        let (e, x) = (eta / 2.0, xi / 2.0);
        vec![e.cos() * x.cos(), -e.sin() * x.sin(), e.cos() * x.sin(), e.sin() * x.cos()]
    });
}

#[test]
fn the_upright_bench_measures_the_forces_of_the_paper() {
    let (l, g) = (1.3, still().site.gravity_mps2);
    assert_upright(BenchChannel::SpecificForce, |BarMotion { angle: xi, rate, acceleration, .. }| {
        vec![-l * acceleration + g * xi.sin(), 0.0, l * rate * rate - g * xi.cos()]
    });
    assert_upright(BenchChannel::AngularRate, |BarMotion { rate, .. }| vec![0.0, rate, 0.0]);
}

#[test]
fn a_late_sensor_reads_gain_times_earlier_truth_plus_bias() {
    for channel in BenchChannel::ALL {
        let sensor = BenchSensor { gain: 1.05, ..BenchSensor::clean(50.0) }.late(0.137).biased([0.1, -0.2, 0.3]);
        let bench = bench(&clean(channel, sensor));
        let samples = &bench.channels[&channel];
        assert_eq!(samples.at_s.len(), 4001);
        for (row, t) in samples.at_s.iter().enumerate().step_by(101) {
            let truth = bench.truth.value(channel, t - 0.137);
            if channel == BenchChannel::Attitude {
                let angle = 1.05 * bench.truth.slope_at(t - 0.137).angle;
                let about = |axis: nalgebra::Unit<nalgebra::Vector3<f64>>, angle| {
                    nalgebra::UnitQuaternion::from_axis_angle(&axis, angle)
                };
                let q = about(nalgebra::Vector3::z_axis(), 30f64.to_radians())
                    * about(nalgebra::Vector3::y_axis(), angle)
                    * nalgebra::UnitQuaternion::from_scaled_axis(nalgebra::Vector3::new(0.1, -0.2, 0.3));
                let expected = [q.w, q.i, q.j, q.k];
                samples.values[row].iter().zip(expected).for_each(|(v, e)| assert!((v - e).abs() < 1e-14));
                continue;
            }
            for (k, truth) in truth.iter().enumerate() {
                let expected = 1.05 * truth + [0.1, -0.2, 0.3][k];
                assert!((samples.values[row][k] - expected).abs() < 1e-14, "{channel:?} {t}");
            }
        }
    }
}

#[test]
fn a_rotated_sensor_reads_the_body_in_its_own_axes() {
    // A quarter turn about x maps the sensor's y to the body's z: it measures along y what is along the body's z.
    let sensor = BenchSensor { rotation_rad: [PI / 2.0, 0.0, 0.0], ..BenchSensor::clean(100.0) };
    let bench = bench(&clean(BenchChannel::SpecificForce, sensor));
    let force = bench.truth.value(BenchChannel::SpecificForce, 0.0);
    let g = bench.settings.site.gravity_mps2;
    assert!((force[1] + g).abs() < 1e-12 && force[0].abs() < 1e-12 && force[2].abs() < 1e-12, "{force:?}");
}

#[test]
fn a_lag_attenuates_and_delays_a_sine_as_predicted() {
    for (tau, f) in [(0.02, 0.5), (0.15, 2.0), (0.0005, 1.0)] {
        let omega = TAU * f;
        let input = |t: f64| if t < 0.0 { [0.0; 3] } else { [(omega * t).sin(), 1.0, t] };
        let lagged = Lagged::new(input, tau, -1.0, 10.0);
        for t in [4.0, 4.1234, 6.78901, 9.5] {
            let x = omega * tau;
            let sine = ((omega * t).sin() - x * (omega * t).cos()) / (1.0 + x * x);
            let [a, b, c] = lagged.at(t);
            // A parabola over 2 ms misses a sine by (ω h)³/200 or so.
            assert!((a - sine).abs() < 2e-8, "{tau} {f} {t}: {a} {sine}");
            assert!((b - 1.0).abs() < 1e-9 && (c - (t - tau)).abs() < 1e-9, "{b} {c}");
        }
    }
}

#[test]
fn two_lags_in_series_shift_a_slow_swing_by_their_sum() {
    // d/dt of the height is far below 1/τ: delay = sum of the lags, to second order.
    let sensor = BenchSensor { lags_s: vec![0.01, 0.02], ..BenchSensor::clean(100.0) }.late(0.1);
    let bench = bench(&clean(BenchChannel::PositionIns, sensor));
    let samples = &bench.channels[&BenchChannel::PositionIns];
    let error = |late: f64| {
        let squares = samples
            .at_s
            .iter()
            .zip(&samples.values)
            .map(|(t, v)| (v[0] - bench.truth.value(BenchChannel::PositionIns, t - late)[0]).powi(2));
        (squares.sum::<f64>() / samples.at_s.len() as f64).sqrt()
    };
    assert!(error(0.13) < 0.1 * error(0.12) && error(0.13) < 0.1 * error(0.14), "{} {}", error(0.13), error(0.12));
}

#[test]
fn a_bending_bar_swings_further_by_the_response_of_its_mode() {
    let mode = FlexibleBar { frequency_hz: 4.0, damping: 0.05, participation: 1.031, slope_ratio: 1.4767 };
    let mut settings = BenchSettings { swing: Swing::Sine { amplitude_rad: 0.5, frequency_hz: 0.55 }, ..still() };
    settings.bar.flexible = Some(mode);
    let truth = bench(&settings).truth;
    // H = 1 − Γ s²/(s² + 2ζω s + ω²) at s = jΩ: q/ξ = Γ Ω²/(ω² − Ω² + 2jζωΩ).
    let (o, w) = (TAU * 0.55, TAU * 4.0);
    let (re, im) = (w * w - o * o, 2.0 * 0.05 * w * o);
    let scale = 1.031 * o * o / (re * re + im * im);
    for t in [40.0, 45.123, 51.7, 60.0] {
        let phase = o * (t - 10.0);
        let deflection = 0.5 * scale * (re * phase.sin() - im * phase.cos());
        let (axis, chord, slope) = (truth.at(t), truth.chord_at(t), truth.slope_at(t));
        assert!((chord.angle - axis.angle - deflection).abs() < 1e-7, "{t}: {} {deflection}", chord.angle - axis.angle);
        assert!((slope.angle - axis.angle - 1.4767 * deflection).abs() < 1.5e-7);
    }
    // Design note 1.6: 1.0199 minus its terms of higher order at 0.55 Hz and 4 Hz.
    assert!((scale * re - 0.0199).abs() < 1e-3, "{}", scale * re);
}

#[test]
fn a_held_position_repeats_the_last_update_and_its_truth() {
    let sensor = BenchSensor { update_hz: Some(4.0), ..BenchSensor::noisy(100.0, 0.01) }.late(0.4);
    let bench = bench(&clean(BenchChannel::PositionGps, sensor));
    let samples = &bench.channels[&BenchChannel::PositionGps];
    for (row, (t, update)) in samples.at_s.iter().zip(&samples.update_s).enumerate() {
        assert!((update - (t * 4.0 + 1e-9).floor() / 4.0).abs() < 1e-12);
        let truth = bench.truth.value(BenchChannel::PositionGps, update - 0.4);
        // Six standard deviations of 321 updates.
        (0..3).for_each(|k| assert!((samples.values[row][k] - truth[k]).abs() < 0.06));
    }
    let flight = bench.to_flight().unwrap();
    let channel = &flight.channels["position.gps"];
    assert_eq!((channel.update_rows().len(), channel.series.len()), (321, 8001));
    assert_eq!(channel.update_rows()[..3], [0, 25, 50]);
    // The degrees sent are that position.
    let frame = LocalFrame::new(bench.settings.site.pivot());
    let [latitude, longitude, height] = samples.geodetic_deg[700];
    let ned = frame.to_ned(flight::Geodetic::from_degrees(latitude, longitude, height));
    (0..3).for_each(|k| assert!((ned[k] - samples.values[700][k]).abs() < 1e-7));
}

#[test]
fn counts_are_the_quantised_angle_with_the_encoders_sign_and_zero() {
    for (lines, decoding, sign, wrap) in [(2000, 1, 1.0, None), (2000, 4, -1.0, None), (1024, 4, 1.0, Some(4096))] {
        let mut settings = still();
        settings.encoder = Encoder {
            lines,
            decoding,
            sign,
            zero_rad: 0.3,
            wrap_counts: wrap,
            sampling: SensorSettings { delay_s: 0.002, ..SensorSettings::clean(250.0) },
            ..settings.encoder
        };
        let bench = bench(&settings);
        let step = TAU / f64::from(lines * decoding);
        let mut squares = 0.0;
        for (t, &count) in bench.encoder.at_s.iter().zip(&bench.encoder.counts) {
            let angle = bench.truth.at(t - 0.002).angle;
            let off = (sign * count as f64 * step + 0.3 - angle).rem_euclid(TAU);
            let off = if off > PI { off - TAU } else { off };
            assert!(off.abs() <= step / 2.0 + 1e-12, "{off} {step}");
            if (10.0..70.0).contains(t) {
                squares += off * off / 15_000.0;
            }
            assert!(wrap.is_none() || (0..4096).contains(&count));
        }
        // A uniform error: step/√12, here within 5 %.
        assert!((squares.sqrt() / step * 12f64.sqrt() - 1.0).abs() < 0.05, "{}", squares.sqrt() / step);
    }
}

#[test]
fn a_device_clock_timestamps_samples_and_the_logger_arrivals() {
    let mut settings = clean(BenchChannel::AngularRate, BenchSensor::clean(100.0));
    settings.clocks.device = Some(ClockError { offset_s: 500.0, skew: 1e-3 });
    settings.clocks.logger = ClockError { offset_s: -2.0, skew: -1e-4 };
    let sampling = &mut settings.sensor.get_mut(&BenchChannel::AngularRate).unwrap().sampling;
    (sampling.log_latency_s, sampling.log_jitter_s) = (0.005, 0.001);
    let bench = bench(&settings);
    let samples = &bench.channels[&BenchChannel::AngularRate];
    let mut excess = 0.0;
    for (row, &t) in samples.at_s.iter().enumerate() {
        assert_eq!(samples.measured[row], Stamp(500_000_000_000 + row as i64 * 10_000_000));
        assert!((t - row as f64 * 0.01 / 1.001).abs() < 1e-12);
        let arrived = (samples.logged[row].seconds_since(settings.start) + 2.0) / (1.0 - 1e-4);
        assert!(arrived - t > 0.005 - 1e-8);
        excess += (arrived - t - 0.005) / samples.at_s.len() as f64;
        assert!((samples.values[row][1] - bench.truth.at(t).rate).abs() < 1e-12);
    }
    // Mean of an exponential: five standard errors over 8009 rows.
    assert!((excess - 0.001).abs() < 5.0 * 0.001 / 8000f64.sqrt(), "{excess}");
    let (encoder, sensor) = bench.to_flights().unwrap();
    assert_eq!(sensor.channels["angular-rate.imu"].series.timeline().clock(), Clock::Boot);
    assert_eq!(encoder.channels["encoder.bar"].series.timeline().clock(), Clock::Unix);
}

#[test]
fn pulses_mark_the_full_seconds_of_the_sensors_clock() {
    let device = Some(ClockError { offset_s: 99.6, skew: 5e-5 });
    for (clock, first) in [(None, 1_287_964_800), (device, 100)] {
        let mut settings = BenchSettings { pulses: Some(Pulses { stamp_jitter_s: 0.0, drop_share: 0.0 }), ..still() };
        settings.clocks.device = clock;
        let bench = bench(&settings);
        let pulses = bench.pulses.as_ref().unwrap();
        assert_eq!((pulses.second[0], pulses.second.len()), (first, if clock.is_some() { 80 } else { 81 }));
        for (edge, second) in pulses.edge.iter().zip(&pulses.second) {
            let t = edge.seconds_since(settings.start);
            let shown = clock.map_or(first as f64 + t, |c| c.shows_s(t));
            assert!((shown - *second as f64).abs() < 2e-9, "{shown} {second}");
        }
        assert_eq!(bench.to_flight().unwrap().channels["pps.sensor"].series.component(0)[0], first as f64);
    }
}

#[test]
fn outliers_and_losses_have_the_requested_shares() {
    let mut sensor = BenchSensor { outliers: Some(Outliers { share: 0.02, std: 1.0 }), ..BenchSensor::clean(100.0) };
    sensor.sampling.drop_share = 0.1;
    sensor.sampling.gaps = vec![Interval { from_s: 30.0, to_s: 40.0 }];
    let bench = bench(&clean(BenchChannel::AngularRate, sensor));
    let samples = &bench.channels[&BenchChannel::AngularRate];
    assert!(!samples.at_s.iter().any(|t| (30.0..40.0).contains(t)));
    // 7001 rows, five standard deviations of a binomial.
    let left = samples.at_s.len() as f64;
    assert!((left - 6300.9).abs() < 5.0 * (7001.0 * 0.09f64).sqrt(), "{left}");
    let far = samples.values.iter().filter(|v| v[0] != 0.0).count() as f64;
    assert!((far - 0.02 * left).abs() < 5.0 * (left * 0.02 * 0.98).sqrt(), "{far}");
}

#[test]
fn benches_are_reproducible_and_channel_noise_is_independent() {
    let settings = BenchSettings { swing_s: 10.0, ..BenchSettings::default() };
    assert_eq!(bench(&settings), bench(&settings));
    let other = settings.clone().with(BenchChannel::Height, BenchSensor::noisy(20.0, 5.0));
    let (a, b) = (bench(&settings), bench(&other));
    assert_ne!(a.channels[&BenchChannel::Height], b.channels[&BenchChannel::Height]);
    assert_eq!(a.channels[&BenchChannel::Attitude], b.channels[&BenchChannel::Attitude]);
    assert_eq!(a.encoder, b.encoder);
    assert_ne!(a.encoder, bench(&BenchSettings { seed: 2, ..settings }).encoder);
}

#[test]
fn invalid_settings_are_rejected_by_name() {
    let refused = |change: &dyn Fn(&mut BenchSettings)| {
        let mut settings = BenchSettings::default();
        change(&mut settings);
        simulate_bench(&settings).unwrap_err().to_string()
    };
    let gps = BenchChannel::PositionGps;
    for (name, error) in [
        ("swing_s", refused(&|s| s.swing_s = f64::NAN)),
        ("bar.length_m", refused(&|s| s.bar.length_m = 0.0)),
        ("encoder.sign", refused(&|s| s.encoder.sign = 0.5)),
        ("lags_s", refused(&|s| s.sensor.get_mut(&gps).unwrap().lags_s = vec![0.0])),
        ("delay_s", refused(&|s| s.sensor.get_mut(&gps).unwrap().sampling.delay_s = f64::INFINITY)),
        ("clock.skew", refused(&|s| s.clocks.logger.skew = 1.0)),
        ("swing.amplitude_rad", refused(&|s| s.swing = Swing::Sine { amplitude_rad: 4.0, frequency_hz: 1.0 })),
    ] {
        assert!(error.starts_with(name), "{error}");
    }
}

#[test]
fn every_bench_format_is_reproducible_and_depends_on_the_seed() {
    let settings = BenchSettings { swing_s: 5.0, rest_s: [1.0, 1.0], ..BenchSettings::default() };
    let (one, again) = (bench(&settings), bench(&settings));
    let other = bench(&BenchSettings { seed: 2, ..settings });
    let mcap = |encoding| Container::Mcap(McapSettings { encoding, ..McapSettings::default() });
    let encodings = [McapEncoding::Cdr, McapEncoding::Ros1, McapEncoding::Json].map(mcap);
    let others = [Container::CsvWide, Container::CsvFolder, Container::Bag(BagSettings::default())];
    for container in encodings.into_iter().chain(others) {
        let files = one.files(container, "b").unwrap();
        assert_eq!(files, again.files(container, "b").unwrap(), "{container:?}");
        assert_ne!(files, other.files(container, "b").unwrap(), "{container:?}");
    }
}

#[test]
fn the_bench_demo_writes_the_truth_next_to_its_logs() {
    let folder = tempfile::tempdir().unwrap();
    let demo = write_bench_demo(folder.path(), 1).unwrap();
    let size = |path: &str| std::fs::metadata(folder.path().join(path)).unwrap().len();
    let text = std::fs::read_to_string(folder.path().join(crate::TRUTH_FILE)).unwrap();
    assert_eq!(serde_json::from_str::<BenchDemo>(&text).unwrap(), demo);
    for record in &demo.records {
        assert!((300..3000).contains(&size(&record.rig)), "{}", record.rig);
        assert!((10_000..20_000_000).contains(&size(&record.encoder)), "{}", record.encoder);
        assert!((1_000_000..20_000_000).contains(&size(&record.sensor)), "{}", record.sensor);
    }
    assert_eq!(demo.records.len(), 5);
    assert_eq!(demo.records[0].date, "2010-10-25");
    assert_eq!(demo.records.iter().filter(|r| r.serial == demo.records[0].serial).count(), 4);
    assert_eq!(demo.records[0].channels["position.gps"].sampling.delay_s, 0.4);
}

#[test]
fn days_are_calendar_days() {
    let day = |s: i64| rig::day(s * flight::NANOS_PER_SECOND);
    // date -u -d @N +%F
    assert_eq!(
        [0, 951_782_399, 951_782_400, 1_287_964_800, -1].map(day),
        ["1970-01-01", "2000-02-28", "2000-02-29", "2010-10-25", "1969-12-31"]
    );
}
