use super::*;
use record::Finding;

fn noise(white_std: f64, wander: Option<(f64, f64)>) -> DelayNoise {
    DelayNoise { wander_std: wander.map(|w| w.0), time_constant_s: wander.map(|w| w.1), white_std }
}

fn piece(span: (f64, f64), noise: [DelayNoise; 2], drift: [f64; 2]) -> DelayPiece {
    let drift = drift.map(|value| Estimate { value, standard_uncertainty: Some(0.01) });
    DelayPiece { start_s: span.0, end_s: span.1, begun_by: String::new(), drift, noise }
}

fn pair(
    kind: DelayPairKind,
    names: (&str, &str),
    delay: (f64, f64),
    samples: u64,
    pieces: Vec<DelayPiece>,
) -> PairDelay {
    let delay_s = Estimate { value: delay.0, standard_uncertainty: Some(delay.1) };
    let measured = MeasuredDelay {
        delay_s,
        interval_95_s: [0.0; 2],
        hessian_s: delay.1,
        hac_s: delay.1,
        widened_s: 0.0,
        crlb_s: delay.1,
        smallest_detectable_s: 0.0,
        samples,
        downweighted_share: 0.0,
        rival_s: None,
        objective: None,
        pieces,
        over_time: vec![],
        homogeneity: None,
        alarm: None,
        splits: vec![],
        injections: vec![],
        remarks: vec![],
        alarms: vec![],
    };
    PairDelay {
        kind,
        first: names.0.to_owned(),
        second: names.1.to_owned(),
        meaning: String::new(),
        origin: None,
        excitation: None,
        delay: Finding::Found(measured),
        varies: None,
        not_for_network: None,
        is_attitude_untested: false,
        lever_arm_s_per_decimetre: None,
    }
}

const PV: DelayPairKind = DelayPairKind::PositionAgainstVelocity;
const VA: DelayPairKind = DelayPairKind::VelocityAgainstAcceleration;

fn close(found: Option<&EkfValue>, value: f64, u: f64) {
    let found = found.unwrap();
    assert!((found.value / value - 1.0).abs() < 1e-12, "{found:?} is not {value}");
    assert!((found.standard_uncertainty.unwrap() / u - 1.0).abs() < 1e-12, "{found:?} is not ± {u}");
}

/// 400 s at 4 Hz, both axes alike: 0.3 m white, wander of 1.5 m over 50 s.
fn one() -> FlightDelays {
    let alike = [noise(0.3, Some((1.5, 50.0))); 2];
    let pieces = vec![piece((0.0, 400.0), alike, [0.03, -0.04])];
    FlightDelays { pairs: vec![pair(PV, ("position.gps", "velocity.ekf"), (0.2, 0.004), 3200, pieces)] }
}

#[test]
fn values_follow_from_the_pair_noise_by_their_formulas() {
    let values = ekf_values(&one(), &BTreeMap::new());
    let [channel] = &values.channels[..] else { panic!() };
    assert_eq!((channel.rate_hz, channel.rests_on.as_str()), (Some(4.0), "position.gps against velocity.ekf"));
    close(channel.value(EkfValueKind::WhiteStd), 0.3, 0.3 / 80.0);
    close(channel.value(EkfValueKind::NoiseDensity), 0.15, 0.15 / 80.0);
    // 2 axes × 400 s / 50 s = 16; a variance from n·D/τ of these has the uncertainty √(2τ/(nD)), its root half of that.
    close(channel.value(EkfValueKind::WanderStd), 1.5, 1.5 / 32.0_f64.sqrt());
    close(channel.value(EkfValueKind::WanderTimeConstant), 50.0, 50.0 * (2.0 / 16.0_f64).sqrt());
    // √(2 · 1.5² / 50) = 0.3.
    close(channel.value(EkfValueKind::RandomWalkDensity), 0.3, 0.3 / 80.0);
    // √((0.03² + 0.04²) / 2).
    close(channel.value(EkfValueKind::BiasStd), 0.00125_f64.sqrt(), 0.00125_f64.sqrt() / 2.0);
    close(channel.value(EkfValueKind::Delay), 0.2, 0.004);
    assert_eq!(channel.remarks, ["the wander includes the integrated noise of velocity.ekf: it is an upper limit"]);
}

#[test]
fn pieces_are_pooled_by_duration_and_their_spread_adds_uncertainty() {
    let pieces = vec![
        piece((0.0, 100.0), [noise(0.1, None), noise(0.1, None)], [0.0; 2]),
        piece((150.0, 450.0), [noise(0.3, None), noise(0.3, None)], [0.0; 2]),
    ];
    let delays = FlightDelays { pairs: vec![pair(PV, ("p", "v"), (0.0, 0.01), 1_000_000, pieces)] };
    let values = ekf_values(&delays, &BTreeMap::new());
    let white = values.channels[0].value(EkfValueKind::WhiteStd).unwrap();
    // Variance (100 · 0.01 + 300 · 0.09) / 400 = 0.07.
    assert!((white.value - 0.07_f64.sqrt()).abs() < 1e-12);
    // Deviations −0.06 (weight 100) and 0.02 (weight 300), each twice: every term is 36, n/(n−1) = 4/3, Σw = 800.
    let u = (4.0 * 36.0 * 4.0 / 3.0_f64).sqrt() / 800.0 / (2.0 * white.value);
    assert!((white.standard_uncertainty.unwrap() - u).abs() < 1e-12);
    assert_eq!(values.channels[0].value(EkfValueKind::WanderStd), None);
    assert_eq!(values.channels[0].remarks, ["no wander was found: the noise is white"]);
}

/// Three pairs of the GPS position that show a delay, one that does not, and one of its velocity.
fn several() -> FlightDelays {
    let pieces = |white| vec![piece((0.0, 100.0), [noise(white, None); 2], [0.0; 2])];
    let mut refused = pair(PV, ("position.gps", "velocity.none"), (0.0, 1e-9), 1, vec![]);
    refused.delay = Finding::CannotTell("still".to_owned());
    let reference = ("position.gps", "position.truth");
    let acceleration = ("velocity.gps", "attitude.ekf + specific-force.imu");
    let pairs = vec![
        pair(PV, ("position.gps", "velocity.ekf"), (0.15, 0.006), 1000, pieces(0.5)),
        pair(PV, ("position.gps", "velocity.gps"), (0.01, 0.002), 1000, pieces(0.3)),
        refused,
        pair(VA, acceleration, (0.19, 0.003), 4000, pieces(0.05)),
        pair(DelayPairKind::PositionAgainstReference, reference, (0.2, 1e-5), 1000, pieces(9.0)),
    ];
    FlightDelays { pairs }
}

#[test]
fn the_pair_with_the_most_certain_delay_is_used() {
    let values = ekf_values(&several(), &BTreeMap::new());
    let names: Vec<&str> = values.channels.iter().map(|c| c.rests_on.as_str()).collect();
    assert_eq!(names, ["position.gps against velocity.gps", "velocity.gps against attitude.ekf + specific-force.imu"]);
    assert_eq!(values.channels[1].rate_hz, Some(20.0));
    assert_eq!(values.channels[1].value(EkfValueKind::NoiseDensity).unwrap().unit, "m/s/sqrt(Hz)");
}

#[test]
fn facts_about_the_channel_take_precedence() {
    let lateness_s = Some((Estimate { value: 0.203, standard_uncertainty: Some(0.008) }, "the IMU".to_owned()));
    let facts = [("position.gps".to_owned(), EkfChannelFacts { rate_hz: Some(25.0), lateness_s })].into();
    let values = ekf_values(&several(), &facts);
    let position = &values.channels[0];
    assert!((position.value(EkfValueKind::NoiseDensity).unwrap().value - 0.06).abs() < 1e-12);
    assert_eq!(position.value(EkfValueKind::Delay).unwrap().formula, "how late the channel is, against the IMU");
    assert_eq!(position.value(EkfValueKind::Delay).unwrap().value, 0.203);
}

#[test]
fn a_wander_slower_than_the_record_is_a_random_walk() {
    let slow = [noise(0.3, Some((5.0, 300.0))); 2];
    let delays = FlightDelays {
        pairs: vec![pair(PV, ("p", "v"), (0.0, 0.01), 1000, vec![piece((0.0, 100.0), slow, [0.0; 2])])],
    };
    let values = ekf_values(&delays, &BTreeMap::new());
    assert!(values.channels[0].remarks[0].contains("use the random walk"), "{values:?}");
    let walk = values.channels[0].value(EkfValueKind::RandomWalkDensity).unwrap();
    assert!((walk.value - (50.0 / 300.0_f64).sqrt()).abs() < 1e-12);
}

#[test]
fn unobservable_white_noise_gives_no_value() {
    // √(2 · 0.09 / 50) / √4 = 0.03 m from one sample to the next.
    let white = |white_std| {
        let pieces = vec![piece((0.0, 400.0), [noise(white_std, Some((0.3, 50.0))); 2], [0.0; 2])];
        let delays = FlightDelays { pairs: vec![pair(PV, ("p", "v"), (0.0, 0.01), 3200, pieces)] };
        let channel = ekf_values(&delays, &BTreeMap::new()).channels.remove(0);
        (
            channel.value(EkfValueKind::WhiteStd).is_some(),
            channel.value(EkfValueKind::NoiseDensity).is_some(),
            channel.remarks,
        )
    };
    let (std, density, remarks) = white(1e-6);
    assert!(!std && !density);
    assert_eq!(remarks[0], "no white noise was found: it is below the wander of one sample (3.00e-2 m)");
    assert_eq!((white(0.002).0, white(0.001).0), (true, false));
}

#[test]
fn no_pair_gives_no_value_and_no_samples_never_panic() {
    assert_eq!(ekf_values(&FlightDelays::default(), &BTreeMap::new()).channels, []);
    let delays = FlightDelays { pairs: vec![pair(PV, ("p", "v"), (0.1, 0.01), 0, vec![])] };
    let values = ekf_values(&delays, &BTreeMap::new());
    assert_eq!(values.channels[0].values.iter().map(|v| v.kind).collect::<Vec<_>>(), [EkfValueKind::Delay]);
}

#[test]
fn the_export_is_toml_with_a_formula_for_each_value() {
    let mut values = ekf_values(&one(), &BTreeMap::new());
    values.channels[0].rests_on = "a \"b\"\n\\".to_owned();
    let text = ekf_values_toml(&values);
    for line in [
        "rests_on = \"a \\\"b\\\"\\u000A\\\\\"",
        "rate_hz = 4.00000e0",
        "# standard deviation of the white noise of one sample",
        "white-std = { value = 3.00000e-1, u = 3.75000e-3, unit = \"m\" }",
        "noise-density = { value = 1.50000e-1, u = 1.87500e-3, unit = \"m/sqrt(Hz)\" }",
        "random-walk-density = { value = 3.00000e-1, u = 3.75000e-3, unit = \"m/sqrt(s)\" }",
        "delay = { value = 2.00000e-1, u = 4.00000e-3, unit = \"s\" }",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}\n{text}");
    }
    // Named as in the record.
    for value in &values.channels[0].values {
        let name = serde_json::to_string(&value.kind).unwrap();
        assert!(text.contains(&format!("\n{} = {{", name.trim_matches('"'))), "{name}");
    }
}
