//! The encoder's channel: scale, wrap-arounds, glitches.

use crate::support::{Noise, Swing, channel, close, encoder_channel, grid, motion, rig, vectors};
use bench_analysis::{EncoderError, EncoderSeries, Rig, encoder_channel as channel_of};
use flight::{Channel, Flight, Quantity};
use std::f64::consts::TAU;

fn no_counts() -> Rig {
    let text = rig("", "", "").as_used().toml.replace("counts_per_rev = 2000\n", "");
    Rig::parse(&text, std::path::Path::new("r.toml")).unwrap()
}

fn counts(swing: &Swing) -> Channel {
    encoder_channel(swing, 100.0, 2000.0, 1.0, 0.0)
}

fn with_values(of: &Channel, change: impl Fn(usize, f64) -> f64) -> Channel {
    let t: Vec<f64> = of.series.timeline().stamps().iter().map(|s| s.0 as f64 * 1e-9).collect();
    let values = of.series.component(0).iter().enumerate().map(|(k, v)| change(k, *v)).collect();
    channel(of.quantity, &t, vec![values])
}

#[test]
fn counts_become_the_angles_of_the_acceptance_vector() {
    let case = &vectors()["encoder"];
    let example = &case["example"];
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    // A ramp there and back keeps the steps plausible.
    let values: Vec<f64> =
        (0..60i32).map(|k| (number(&example["count"]) * f64::from(30 - (30 - k).abs()) / 30.0).round()).collect();
    let encoder = channel(Quantity::EncoderCount, &grid(100.0, 0.6), vec![values]);
    let series = EncoderSeries::of("encoder.bar", &encoder, &rig("", "", "")).unwrap();
    close(&[number(&case["lsb_rad"])], &[series.lsb_rad()], 1e-15);
    close(&[number(&case["rms_quant_arc_m"])], &[1.3 * series.variance().sqrt()], 1e-15);
    let xi = number(&example["sign"]) * series.angle_rad[30] + number(&example["xi0"]);
    close(&[number(&example["xi"])], &[xi], 1e-14);
}

#[test]
fn counts_without_counts_per_revolution_are_rejected() {
    let error = EncoderSeries::of("encoder.bar", &counts(&Swing::by_hand(0.0)), &no_counts()).unwrap_err();
    assert!(matches!(error, EncoderError::CountsPerRevUnknown { .. }));
    assert!(error.to_string().contains("encoder.counts_per_rev"), "{error}");
}

#[test]
fn the_counts_of_an_angle_are_inferred_from_steps_with_few_decimals() {
    let swing = Swing::by_hand(0.4);
    for (per_rev, decimals) in [(2000.0, 9), (2000.0, 2), (8000.0, 3), (4096.0, 3), (1024.0, 1), (8000.0, 2)] {
        let printed = |counts: f64| {
            let degrees = counts * 360.0 / per_rev;
            (degrees * 10f64.powi(decimals)).round() / 10f64.powi(decimals)
        };
        let t = grid(100.0, swing.duration);
        let angle = t.iter().map(|t| printed((swing.at(*t).angle / TAU * per_rev).round()).to_radians()).collect();
        let encoder = channel(Quantity::EncoderAngle, &t, vec![angle]);
        let series = EncoderSeries::of("encoder.bar", &encoder, &no_counts()).unwrap();
        assert_eq!(series.counts_per_rev, per_rev, "{decimals} decimals: {}", series.counts_source);
    }
}

#[test]
fn an_angle_without_steps_gets_the_counts_of_its_scatter_with_a_notice() {
    let swing = Swing::by_hand(0.0);
    let mut noise = Noise::seeded(3);
    let t = grid(100.0, swing.duration);
    let sigma = 1e-3;
    let angle = t.iter().map(|t| swing.at(*t).angle + noise.gauss(sigma)).collect();
    let encoder = channel(Quantity::EncoderAngle, &t, vec![angle]);
    let series = EncoderSeries::of("encoder.bar", &encoder, &no_counts()).unwrap();
    assert!(series.counts_source.contains("no steps"), "{}", series.counts_source);
    // 4000 second differences: the robust scatter is good to about 3 %; the swing adds its own curvature.
    assert!((series.variance().sqrt() / sigma - 1.0).abs() < 0.15, "{}", series.variance().sqrt());
}

#[test]
fn stated_counts_that_the_angle_contradicts_are_reported() {
    let swing = Swing::by_hand(0.0);
    let t = grid(100.0, swing.duration);
    let angle = t.iter().map(|t| (swing.at(*t).angle / TAU * 8000.0).round() / 8000.0 * TAU).collect();
    let encoder = channel(Quantity::EncoderAngle, &t, vec![angle]);
    let series = EncoderSeries::of("encoder.bar", &encoder, &rig("", "", "")).unwrap();
    let codes: Vec<&str> = series.notices.iter().map(|n| n.code.as_str()).collect();
    assert_eq!(codes, ["rig-contradicted"]);
}

#[test]
fn a_counter_that_wraps_around_is_unwrapped_and_reported() {
    let swing = Swing::by_hand(0.0);
    let plain = counts(&swing);
    let truth = EncoderSeries::of("encoder.bar", &plain, &rig("", "", "")).unwrap();
    assert!(truth.notices.is_empty());
    let m16 = 65_536.0;
    type Wrapped<'a> = (&'a str, &'a dyn Fn(f64) -> f64);
    let wrapped: [Wrapped; 4] = [
        ("2^16", &|v| (v + 65_500.0).rem_euclid(m16)),
        ("2^16", &|v| (v + 32_700.0 + m16 / 2.0).rem_euclid(m16) - m16 / 2.0),
        ("2^32", &|v| (v + 10.0).rem_euclid(4_294_967_296.0)),
        ("one revolution", &|v| (v + 1900.0).rem_euclid(2000.0)),
    ];
    for (what, wrap) in wrapped {
        let encoder = with_values(&plain, |_, v| wrap(v));
        let series = EncoderSeries::of("encoder.bar", &encoder, &rig("", "", "")).unwrap();
        let notices: Vec<&flight::Notice> = series.notices.iter().collect();
        assert!(
            notices.len() == 1 && notices[0].code == "encoder-repaired" && notices[0].text.contains(what),
            "{notices:?}"
        );
        let shift = series.angle_rad[0] - truth.angle_rad[0];
        let back: Vec<f64> = series.angle_rad.iter().map(|a| a - shift).collect();
        close(&truth.angle_rad, &back, 1e-6);
    }
}

#[test]
fn an_absolute_angle_that_passes_zero_is_unwrapped() {
    let swing = Swing::by_hand(6.0);
    let t = grid(100.0, swing.duration);
    let lsb = TAU / 2000.0;
    let truth: Vec<f64> = t.iter().map(|t| (swing.at(*t).angle / lsb).round() * lsb).collect();
    let angle = truth.iter().map(|a| a.rem_euclid(TAU)).collect();
    let encoder = channel(Quantity::EncoderAngle, &t, vec![angle]);
    let series = EncoderSeries::of("encoder.bar", &encoder, &rig("", "", "")).unwrap();
    let shift = series.angle_rad[0] - truth[0];
    let back: Vec<f64> = series.angle_rad.iter().map(|a| a - shift).collect();
    close(&truth, &back, 1e-9);
}

#[test]
fn single_glitches_are_rejected_counted_and_reported() {
    let swing = Swing::by_hand(0.0);
    let plain = counts(&swing);
    let bad = [0, 100, 777, 778 + 500, 3999];
    let glitched = with_values(&plain, |k, v| if bad.contains(&k) { v + 700.0 } else { v });
    let series = EncoderSeries::of("encoder.bar", &glitched, &rig("", "", "")).unwrap();
    assert_eq!(series.rejected.iter().map(|r| r.count).sum::<u64>(), bad.len() as u64);
    let notice = series.notices.iter().find(|n| n.code == "encoder-repaired").unwrap();
    assert_eq!(notice.count, bad.len() as u64);
    assert_eq!(series.t_s.len(), 4000 - bad.len());
    let truth = EncoderSeries::of("encoder.bar", &plain, &rig("", "", "")).unwrap();
    let kept: Vec<f64> = (0..4000).filter(|k| !bad.contains(k)).map(|k| truth.angle_rad[k]).collect();
    close(&kept, &series.angle_rad, 1e-12);
}

#[test]
fn a_bar_at_rest_is_rejected() {
    let still = channel(Quantity::EncoderCount, &grid(100.0, 5.0), vec![vec![17.0; 500]]);
    let error = EncoderSeries::of("encoder.bar", &still, &rig("", "", "")).unwrap_err();
    assert!(matches!(error, EncoderError::Still { .. }), "{error}");
}

#[test]
fn the_encoder_is_the_one_named_in_the_rig_file_or_the_only_one() {
    let swing = Swing::by_hand(0.0);
    let flight = |names: &[&str]| Flight {
        channels: names.iter().map(|n| ((*n).to_owned(), counts(&swing))).collect(),
        ..Flight::default()
    };
    let plain = rig("", "", "");
    let named = rig("", "channel = \"encoder.b\"", "");
    assert_eq!(channel_of(&flight(&["encoder.bar"]), &plain).unwrap().0, "encoder.bar");
    assert_eq!(channel_of(&flight(&["encoder.a", "encoder.b"]), &named).unwrap().0, "encoder.b");
    assert!(matches!(channel_of(&flight(&[]), &plain), Err(EncoderError::NoEncoder)));
    let several = channel_of(&flight(&["encoder.a", "encoder.c"]), &plain).unwrap_err();
    assert!(several.to_string().contains("encoder.a, encoder.c"), "{several}");
    let missing = channel_of(&flight(&["encoder.a"]), &named).unwrap_err();
    assert!(missing.to_string().contains("`encoder.b`"), "{missing}");
}

/// Design note 2: about 0.07 to 0.11 m/s² at 2000 counts and 100 Hz, where the second difference has 29 m/s².
#[test]
fn smoothed_acceleration_is_far_better_than_second_differences() {
    let swing = Swing::by_hand(0.2);
    let motion = motion(&counts(&swing), &rig("", "", ""));
    let rms = |pairs: &mut dyn Iterator<Item = (f64, f64)>| {
        let inner = pairs.filter(|(t, _)| *t > 1.0 && *t < swing.duration - 1.0);
        let (n, sum) =
            inner.fold((0.0, 0.0), |(n, sum), (t, a)| (n + 1.0, sum + (a - swing.at(t).acceleration).powi(2)));
        1.3 * f64::sqrt(sum / n)
    };
    let smoothed = rms(&mut motion.states().map(|(t, s)| (t, s.acceleration)));
    let (t, second) = motion.second_central_difference();
    let raw = rms(&mut t.into_iter().zip(second));
    println!("smoothed {smoothed:.4} m/s², second difference {raw:.2} m/s²");
    assert!(smoothed < 0.12, "{smoothed}");
    // White quantisation noise would give 28.9 m/s²; that of a slow swing is partly correlated.
    assert!((20.0..32.0).contains(&raw), "{raw}");
    assert!((motion.residual_rms_counts() - 0.289).abs() < 0.06, "{}", motion.residual_rms_counts());
}

#[test]
fn sign_and_zero_change_the_motion_but_not_its_uncertainty() {
    let swing = Swing::by_hand(0.2);
    let encoder = encoder_channel(&swing, 100.0, 2000.0, -1.0, 0.5);
    let raw = motion(&encoder, &rig("", "", ""));
    let covariance = raw.covariance_at(10.0).unwrap();
    let turned = raw.oriented(-1.0, 0.5);
    for k in 0..30 {
        let t = 2.0 + f64::from(k) * 1.1;
        let (found, truth) = (turned.at(t).unwrap(), swing.at(t));
        // 4 smoothed standard deviations, about 0.3 mm at 1.3 m each.
        assert!((found.angle - truth.angle).abs() < 1.5e-3, "{t}: {found:?} {truth:?}");
        assert!((found.rate - truth.rate).abs() < 0.03, "{t}: {found:?} {truth:?}");
    }
    assert_eq!(turned.covariance_at(10.0).unwrap(), covariance);
    assert!(turned.at(-0.1).is_none() && turned.at(1e3).is_none());
}

/// 50 counts are 9°: the smoother turned them into motion, and gyro and accelerometer came out early by 5 and 4 ms,
/// with passing gates.
#[test]
fn an_encoder_slip_splits_the_record_and_is_reported() {
    let swing = Swing::by_hand(0.0);
    let honest = counts(&swing);
    let rig = rig("", "", "");
    for (slip, seconds) in [(50.0, 22.0), (-10.0, 13.0), (200.0, 30.0)] {
        let slipped = with_values(&honest, |k, v| if k as f64 / 100.0 >= seconds { v + slip } else { v });
        let series = EncoderSeries::of("encoder.bar", &slipped, &rig).unwrap();
        let [found] = series.slips[..] else { panic!("{:?}", series.slips) };
        assert!((found.counts - slip).abs() < 1.5 && (found.t_s - seconds).abs() < 0.015, "{found:?}");
        assert!(series.notices.iter().any(|n| n.code == "encoder-repaired"), "{:?}", series.notices);
        let longer_s = f64::max(seconds, 40.0 - seconds);
        assert!((series.t_s.len() as f64 / 100.0 - longer_s).abs() < 0.02, "{}", series.t_s.len());
        assert_eq!(series.rejected[0].count as usize + series.t_s.len(), honest.series.len());
    }
}

/// The dead part is the longer one, and has no motion.
#[test]
fn an_encoder_that_dies_is_used_up_to_then() {
    let honest = counts(&Swing::by_hand(0.0));
    let dead = with_values(&honest, |k, v| if k < 1500 { v } else { 777.0 });
    let series = EncoderSeries::of("encoder.bar", &dead, &rig("", "", "")).unwrap();
    assert!((1499..=1500).contains(&series.t_s.len()), "{} {:?}", series.t_s.len(), series.slips);
    assert!(series.t_s[0] < 0.01, "{}", series.t_s[0]);
    assert!(series.notices.iter().any(|n| n.code == "encoder-repaired"), "{:?}", series.notices);
}

/// False alarms: swings of many speeds and phases, coarse and fine encoders.
#[test]
fn an_encoder_without_slips_reports_no_slip() {
    let mut alarms = 0;
    for k in 0..60u32 {
        let x = f64::from(k);
        let swing = Swing {
            middle: 0.1 * x.sin(),
            sines: vec![(0.7, 0.5 + 0.004 * x, x), (0.2, 0.9 + 0.01 * x, 2.0 * x), (0.06, 2.4, 0.3 * x)],
            duration: 40.0,
        };
        let (rate, per_rev) = [(100.0, 2000.0), (50.0, 2000.0), (200.0, 8000.0), (100.0, 200.0)][k as usize % 4];
        let channel = encoder_channel(&swing, rate, per_rev, 1.0, 0.0);
        let mut rig = rig("", "", "");
        rig.encoder.counts_per_rev = Some(per_rev);
        alarms += EncoderSeries::of("encoder.bar", &channel, &rig).unwrap().slips.len();
    }
    assert_eq!(alarms, 0);
}
