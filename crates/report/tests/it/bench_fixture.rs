//! A bench record with known numbers: a hand-driven swing of a 1.3 m bar, sensor above the pivot,
//! position 400.3 ms late, everything else roughly on time. Noise from a fixed sequence.

use flight::{
    Binding, ByteLedger, ChannelHealth, ChannelSource, Clock, Code, Delay, Distribution, Held, LogHealth, Notices,
    Quantity, RejectCount, StampHealth, StampKind,
};
use record::*;
use std::sync::LazyLock;

pub const DURATION: f64 = 64.0;
const L: f64 = 1.3;
const ETA: f64 = std::f64::consts::FRAC_PI_6;
const G: f64 = 9.7996;
/// Amplitude rad, angular rate rad/s, phase of the bar's angle.
const HARMONICS: [(f64, f64, f64); 4] = [(0.62, 3.46, 0.2), (0.21, 2.31, 1.9), (0.09, 7.1, 0.7), (0.05, 0.63, 2.2)];

fn bar(t: f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (a, w, p) in HARMONICS {
        let (s, c) = (w * t + p).sin_cos();
        sum[0] += a * s;
        sum[1] += a * w * c;
        sum[2] -= a * w * w * s;
    }
    sum
}

/// Output of a perfect sensor: the components of a channel.
fn truth(quantity: Quantity, t: f64) -> Vec<f64> {
    let [x, v, a] = bar(t);
    let (s, c) = x.sin_cos();
    let (se, ce) = ETA.sin_cos();
    match quantity {
        Quantity::PositionGeodetic => vec![-L * ce * s, -L * se * s, -L * c],
        Quantity::VelocityNed => vec![-L * v * ce * c, -L * v * se * c, L * v * s],
        Quantity::SpecificForce => vec![-L * a + G * s, 0.0, L * v * v - G * c],
        Quantity::Attitude => vec![x.to_degrees()],
        Quantity::AngularRate => vec![0.0, v, 0.0],
        Quantity::MagneticField => vec![c * 23.4 - s * 41.3, -18.2, s * 23.4 + c * 41.3],
        _ => vec![L * c],
    }
}

/// Roughly normal, from a linear congruential generator: the sum of twelve uniform numbers minus six.
struct Noise(u32);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.0) / f64::from(u32::MAX)
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

fn sampled(name: &str, (from, to): (f64, f64), step: f64, stands_for: u64, mut of: impl FnMut(f64) -> f64) -> Curve {
    let count = ((to - from) / step).round() as usize;
    let t_s: Vec<f64> = (0..=count).map(|i| from + i as f64 * step).collect();
    let y = t_s.iter().map(|&t| of(t)).collect();
    Curve { name: name.into(), t_s, y, breaks: vec![], stands_for }
}

pub fn estimate(value: f64, u: f64) -> Estimate {
    Estimate { value, standard_uncertainty: Some(u) }
}

/// The channels of the fixture.
struct Kind {
    name: &'static str,
    quantity: Quantity,
    components: &'static [&'static str],
    excited: &'static [bool],
    unit: &'static str,
    rate: f64,
    noise: f64,
    gain: f64,
    delay_s: f64,
    u_s: f64,
    verdict: Verdict,
}

const NED: &[&str] = &["north", "east", "down"];
const XYZ: &[&str] = &["x", "y", "z"];

#[rustfmt::skip]
const KINDS: [Kind; 8] = [
    Kind { name: "angular-rate.imu", quantity: Quantity::AngularRate, components: XYZ, excited: &[false, true, false], unit: "rad/s", rate: 100.0, noise: 0.011, gain: 1.004, delay_s: 0.000_03, u_s: 0.000_026, verdict: Verdict::EquivalentToZero },
    Kind { name: "attitude.ins", quantity: Quantity::Attitude, components: &["swing angle"], excited: &[true], unit: "°", rate: 100.0, noise: 0.31, gain: 1.021, delay_s: 0.000_41, u_s: 0.000_31, verdict: Verdict::EquivalentToZero },
    Kind { name: "height.baro", quantity: Quantity::Height, components: &["height"], excited: &[true], unit: "m", rate: 10.0, noise: 0.35, gain: 0.93, delay_s: 0.031, u_s: 0.024, verdict: Verdict::Inconclusive },
    Kind { name: "magnetic-field.imu", quantity: Quantity::MagneticField, components: XYZ, excited: &[true, false, true], unit: "µT", rate: 100.0, noise: 0.4, gain: 1.018, delay_s: -0.000_6, u_s: 0.000_11, verdict: Verdict::Early },
    Kind { name: "position.gps", quantity: Quantity::PositionGeodetic, components: NED, excited: &[true, true, true], unit: "m", rate: 4.0, noise: 0.12, gain: 0.99, delay_s: 0.412, u_s: 0.0061, verdict: Verdict::Delayed },
    Kind { name: "position.ins", quantity: Quantity::PositionGeodetic, components: NED, excited: &[true, true, true], unit: "m", rate: 100.0, noise: 0.02, gain: 1.014, delay_s: 0.4003, u_s: 0.0008, verdict: Verdict::Delayed },
    Kind { name: "specific-force.imu", quantity: Quantity::SpecificForce, components: XYZ, excited: &[true, false, true], unit: "m/s²", rate: 100.0, noise: 0.06, gain: 1.002, delay_s: 0.000_02, u_s: 0.000_019, verdict: Verdict::EquivalentToZero },
    Kind { name: "velocity.ins", quantity: Quantity::VelocityNed, components: NED, excited: &[true, true, true], unit: "m/s", rate: 100.0, noise: 0.05, gain: 1.016, delay_s: 0.000_12, u_s: 0.000_09, verdict: Verdict::EquivalentToZero },
];

fn component(kind: &Kind, index: usize) -> ComponentDynamics {
    let mut noise = Noise(index as u32 + kind.name.len() as u32 * 77);
    let value = |t: f64, delay: f64| truth(kind.quantity, t - delay)[index];
    let curves = |window: (f64, f64), step: f64, stands_for: u64, noise: &mut Noise| {
        let fine = step.min(0.02);
        let steps = ((window.1 - window.0) / fine) as u64;
        let measured = |t: f64| kind.gain * value(t, kind.delay_s) + kind.noise * noise.next() + 0.01;
        vec![
            sampled("reference", window, fine, steps, |t| value(t, 0.0)),
            sampled("reference, delayed", window, fine, steps, |t| value(t, kind.delay_s)),
            sampled("measured", window, step, stands_for, measured),
        ]
    };
    let samples = (DURATION * kind.rate) as u64;
    let step = 1.0 / kind.rate;
    let excited = kind.excited[index];
    ComponentDynamics {
        name: kind.components[index].into(),
        unit: kind.unit.into(),
        excited,
        why_not: if excited { String::new() } else { "constant in a planar swing".into() },
        gain: excited.then(|| estimate(kind.gain, 0.0011)),
        gain_frequency_hz: excited.then_some(0.55),
        offset: Some(estimate(0.0123, 0.0021)),
        drift: kind.name.starts_with("position").then(|| estimate(-0.000_31, 0.000_12)),
        noise: excited.then_some(NoiseFinding {
            wander_std: if kind.name.ends_with("ins") { kind.noise / 2.0 } else { 0.0 },
            time_constant_s: 2.1,
            white_std: kind.noise,
            static_std: kind.name.ends_with("imu").then_some(kind.noise * 0.9),
            resolution: Some(kind.noise / 40.0),
        }),
        delay_s: excited.then(|| estimate(kind.delay_s, kind.u_s * (1.5 + index as f64))),
        curves: curves((0.0, DURATION), step.max(0.05), samples, &mut noise),
        zoom: curves((22.0, 29.0), step, (7.0 * kind.rate) as u64, &mut noise),
        residual: excited
            .then(|| sampled("residual", (0.0, DURATION), step.max(0.06), samples, |_| kind.noise * noise.next())),
        overlay: excited.then(|| overlay(kind, index)),
    }
}

/// Rms of `gain · (truth(t − delay) − truth(t − shift))` and noise: the residual of a shifted reference.
fn overlay(kind: &Kind, index: usize) -> Overlay {
    let mut noise = Noise(index as u32 + 5);
    let value = |t: f64| truth(kind.quantity, t)[index];
    let (window, reach, step_s) = ((22.0, 29.0), if kind.delay_s > 0.3 { 0.615 } else { 0.5 }, 0.005);
    let count = (7.0 * kind.rate) as u64;
    let measured = |t: f64| kind.gain * value(t - kind.delay_s) + kind.noise * noise.next();
    let left = |shift: f64| {
        let differences = (0..400).map(|k| 5.0 + f64::from(k) * 0.13);
        let mean = differences.map(|t| (kind.gain * (value(t - kind.delay_s) - value(t - shift))).powi(2)).sum::<f64>()
            / 400.0;
        (mean + kind.noise * kind.noise).sqrt()
    };
    Overlay {
        reference: sampled("reference", (window.0 - reach, window.1 + reach), 0.01, 700, value),
        measured: sampled("measured", window, 1.0 / kind.rate, count, measured),
        wander: kind.name.starts_with("position").then_some(WanderTaken {
            window_s: 6.9,
            rms: 0.4321,
            range_in_view: 0.2345,
        }),
        shifts: ShiftCurve {
            from_s: -reach,
            step_s,
            rms: (0..=(2.0 * reach / step_s).round() as u32).map(|k| left(f64::from(k) * step_s - reach)).collect(),
        },
    }
}

fn delay(kind: &Kind) -> DelayFinding {
    let held = kind.name == "position.gps";
    DelayFinding {
        delay: Delay::from_seconds(kind.delay_s).unwrap(),
        standard_uncertainty_s: kind.u_s,
        hessian_s: kind.u_s * 0.93,
        hac_s: kind.u_s * 0.99,
        reference_s: kind.u_s * 0.02,
        stamps_s: kind.u_s * 0.1,
        change_s: 0.0,
        anchor_s: kind.u_s * 0.03,
        interval_95_s: [kind.delay_s - 1.97 * kind.u_s, kind.delay_s + 1.97 * kind.u_s],
        degrees_of_freedom: DURATION * kind.rate * 3.0 - 11.0,
        crlb_s: kind.u_s * 0.97,
        as_seen_s: held.then(|| estimate(kind.delay_s + 0.125, kind.u_s * 1.02)),
        held_fit_s: held.then(|| estimate(kind.delay_s + 0.12, kind.u_s * 0.7)),
        minimum_detectable_s: 2.8 * kind.u_s,
        margin_s: 0.005,
        strict_margin_s: 0.005,
        deciding_length_s: (kind.verdict == Verdict::Inconclusive).then(|| DURATION * (2.8 * kind.u_s / 0.005).powi(2)),
    }
}

fn model(kind: &Kind) -> Finding<ModelFinding> {
    if kind.verdict != Verdict::Delayed {
        return Finding::CannotTell("delay and lag are told apart only where there is a delay to speak of".into());
    }
    let candidate = |name: &str, delta_bic, delay: Option<f64>, lags: &[f64]| ModelCandidate {
        name: name.into(),
        delta_bic,
        delay_s: delay.map(|d| estimate(d, kind.u_s * 3.0)),
        lags_s: lags.iter().map(|&l| estimate(l, kind.u_s * 4.0)).collect(),
        square_s2: None,
        gain: estimate(kind.gain, 0.002),
    };
    let decided = kind.name == "position.ins";
    Finding::Found(ModelFinding {
        candidates: vec![
            candidate("D", 0.0, Some(kind.delay_s), &[]),
            candidate("L", 5123.4, None, &[0.612]),
            candidate("DL", if decided { 8.4 } else { 3.1 }, Some(kind.delay_s - 0.004), &[0.004]),
            candidate("DLL", 17.2, Some(kind.delay_s - 0.006), &[0.003, 0.003]),
        ],
        chosen: decided.then(|| "D".into()),
        text: if decided {
            "A delay: the next best, delay and lag, is worse by ΔBIC 8.4.".into()
        } else {
            "Not distinguished between D and DL: ΔBIC 3.1, 6 is needed.".into()
        },
        sum_s: estimate(kind.delay_s, kind.u_s),
    })
}

fn response(kind: &Kind) -> Finding<ResponseFinding> {
    if kind.rate < 5.0 {
        return Finding::CannotTell("4 updates per second leave too few bins below half that rate".into());
    }
    let mut noise = Noise(kind.name.len() as u32);
    let points: Vec<ResponsePoint> = (1..=22)
        .map(|i| {
            let frequency_hz = 0.125 * f64::from(i);
            let reliable = frequency_hz < 1.3;
            let u95 = if reliable { 0.012 + 0.02 * frequency_hz } else { 0.4 + frequency_hz };
            ResponsePoint {
                frequency_hz,
                gain: kind.gain + u95 * 0.4 * noise.next(),
                gain_u95: u95,
                phase_rad: -frequency_hz * std::f64::consts::TAU * kind.delay_s + u95 * 0.4 * noise.next(),
                phase_u95: u95,
                coherence: if reliable { 0.999 - 0.03 * frequency_hz } else { (0.7 - 0.2 * frequency_hz).max(0.05) },
                reliable,
            }
        })
        .collect();
    Finding::Found(ResponseFinding {
        component: kind.components[0].into(),
        segment_s: 8.0,
        averages: 12.6,
        model_phase_rad: points.iter().map(|p| -p.frequency_hz * std::f64::consts::TAU * kind.delay_s).collect(),
        model_gain: points.iter().map(|_| kind.gain).collect(),
        points,
        bandwidth: "> 1.25 Hz, the last reliable bin".into(),
        bandwidth_hz: None,
        bandwidth_u_hz: None,
    })
}

fn checks(kind: &Kind) -> FitChecks {
    let mut noise = Noise(3 + kind.name.len() as u32);
    let curve = |d: f64| {
        let x: f64 = d - kind.delay_s;
        (x / 0.3).powi(2).min(1.0) * 0.4 + 1.0 - (3.46 * x).cos()
    };
    let scale = 1.0 / (kind.u_s.powi(2) * (2.0 * 0.4 / 0.09 + 3.46 * 3.46)) * 2.0;
    let delay_s: Vec<f64> = (0..=125).map(|i| -1.0 + 0.02 * f64::from(i)).collect();
    let near: Vec<f64> = (-20..=20).map(|i| kind.delay_s + kind.u_s * 0.2 * f64::from(i)).collect();
    FitChecks {
        autocorrelation: (0..40).map(|_| 0.012 * noise.next()).collect(),
        autocorrelation_u95: 0.0248,
        ljung_box_p: 0.31,
        kurtosis: 3.04,
        downweighted_share: if kind.name == "position.gps" { 0.013 } else { 0.0 },
        outlier_share: 0.0,
        objective: ObjectiveCurve {
            value: delay_s.iter().map(|&d| scale * curve(d)).collect(),
            delay_s,
            near_value: near.iter().map(|&d| ((d - kind.delay_s) / kind.u_s).powi(2)).collect(),
            near_delay_s: near,
        },
        second_minimum_s: (kind.name == "height.baro").then_some(-0.83),
    }
}

fn stationarity(kind: &Kind) -> Finding<Stationarity> {
    if kind.rate < 5.0 {
        return Finding::CannotTell("windows of 15 s hold 60 updates: too few for a delay each".into());
    }
    let mut noise = Noise(9 + kind.name.len() as u32);
    let t_s: Vec<f64> = (0..7).map(|i| 7.5 + 7.5 * f64::from(i)).collect();
    let u = kind.u_s * 2.1;
    Finding::Found(Stationarity {
        window_s: 15.0,
        delay_s: t_s.iter().map(|_| estimate(kind.delay_s + u * noise.next(), u)).collect(),
        t_s,
        constant_p: 0.42,
        changes: false,
        slope: estimate(kind.u_s / 60.0, kind.u_s / 20.0),
        text: "Constant as far as this record can show.".into(),
    })
}

fn latency() -> LatencyHistogram {
    let edges_s: Vec<f64> = (0..=24).map(|i| 0.001 * f64::from(i)).collect();
    let counts = (0..24).map(|i| (2600.0 * (-f64::from(i) / 4.0).exp()) as u64).collect();
    LatencyHistogram {
        text: "Logged less measured stamps, above the fastest: the least transport latency is not in it".into(),
        edges_s,
        counts,
        beyond: 14,
        latency_s: Distribution { min: 0.0, p01: 0.000_04, median: 0.0028, p99: 0.0181, max: 0.041 },
    }
}

fn channel(kind: &Kind) -> ChannelDynamics {
    let samples = (DURATION * kind.rate) as u64;
    let held = kind.name == "position.gps";
    ChannelDynamics {
        name: kind.name.into(),
        quantity: kind.quantity,
        stamp_kind: StampKind::Logged,
        clock: Clock::Unix,
        basis: TimeBasis::Anchor { channel: "angular-rate.imu".into() },
        samples,
        rejected: if held {
            vec![RejectCount { reason: "no fix".into(), count: 3, first: "message 17".into() }]
        } else {
            vec![]
        },
        rate_hz: Some(if held { 100.0 } else { kind.rate }),
        update_rate_hz: Some(kind.rate),
        held_rows: if held { 6144 } else { 0 },
        verdict: kind.verdict,
        reason: match kind.verdict {
            Verdict::Delayed => "The 95 % interval excludes zero, and all of it lies beyond the margin.".into(),
            Verdict::Early => "The 95 % interval excludes zero: the value is stamped before it was true.".into(),
            Verdict::EquivalentToZero => "The 90 % interval lies within ±5 ms.".into(),
            _ => "The 95 % interval holds zero, and is wider than the margin: 67 ms would have been seen.".into(),
        },
        predicted_s: Some(kind.u_s * 0.95),
        delay: Some(delay(kind)),
        components: (0..kind.components.len()).map(|i| component(kind, i)).collect(),
        model: model(kind),
        response: response(kind),
        checks: Some(checks(kind)),
        stationarity: stationarity(kind),
        jitter_s: if kind.rate > 50.0 {
            Finding::Found(estimate(0.0021, 0.0003))
        } else {
            Finding::CannotTell("too few residuals where the swing is fast".into())
        },
        latency: if kind.name.ends_with("imu") {
            Finding::Found(latency())
        } else {
            Finding::CannotTell("the log has no timestamp later than the logged one".into())
        },
        injections: if kind.verdict == Verdict::Inconclusive {
            vec![Injection {
                injected_s: 0.005,
                injected_gain: 1.0,
                recovered: Finding::CannotTell("the first half alone cannot be fitted: the reference rests".into()),
            }]
        } else {
            [(0.005, 1.0), (0.05, 1.05)]
                .map(|(injected_s, injected_gain)| Injection {
                    injected_s,
                    injected_gain,
                    recovered: Finding::Found(Recovery {
                        delay_error_s: estimate(kind.u_s * 0.2, kind.u_s),
                        gain_error: estimate(-0.0004, 0.0011),
                    }),
                })
                .into()
        },
    }
}

/// A channel without any result.
fn silent_channel() -> ChannelDynamics {
    let cannot = || "no row of it falls into the swing".to_owned();
    ChannelDynamics {
        name: "velocity.gps".into(),
        samples: 2,
        rate_hz: None,
        update_rate_hz: None,
        verdict: Verdict::NotMeasurable,
        reason: "Two rows: no row of it falls into the swing.".into(),
        predicted_s: None,
        delay: None,
        components: vec![],
        model: Finding::CannotTell(cannot()),
        response: Finding::CannotTell(cannot()),
        checks: None,
        stationarity: Finding::CannotTell(cannot()),
        jitter_s: Finding::CannotTell(cannot()),
        latency: Finding::CannotTell(cannot()),
        injections: vec![],
        ..channel(&KINDS[7])
    }
}

fn reference() -> ReferenceFinding {
    let mut noise = Noise(1);
    let lsb = std::f64::consts::TAU / 2000.0;
    let whole = (0.0, DURATION);
    ReferenceFinding {
        channel: "encoder.bar".into(),
        samples: 6400,
        rate_hz: 100.0,
        duration_s: DURATION,
        counts_per_rev: 2000.0,
        counts_source: "rig file: 2000 lines, decoding ×1".into(),
        sign: 1.0,
        sign_source: "rig file".into(),
        zero_rad: estimate(0.0021, 0.0004),
        zero_source: "fitted with the accelerometer".into(),
        azimuth_rad: Some(estimate(ETA, 0.0011)),
        azimuth_source: "principal axis of velocity.ins".into(),
        log10_q: 3.42,
        residual_rms_counts: 0.291,
        uncertainty: [0.000_26, 0.0041, 0.082],
        angle_range_rad: [0.91, -0.88],
        gravity_mps2: 9.799_516_171,
        gravity_source: "Somigliana at 37.6° N, 20 m".into(),
        field_t: Some([29.579e-6, -4.122e-6, 41.280e-6]),
        field_source: "WMM2010 at 2010.8, within its five years".into(),
        angle: vec![
            sampled("encoder", whole, 0.02, 6400, |t| (bar(t)[0] / lsb).round() * lsb),
            sampled("smoothed", whole, 0.02, 6400, |t| bar(t)[0]),
        ],
        acceleration: vec![
            sampled("smoothed", whole, 0.02, 6400, |t| L * bar(t)[2]),
            sampled("second central difference (the paper)", whole, 0.02, 6400, |t| {
                L * bar(t)[2] + 28.9 * noise.next()
            }),
        ],
    }
}

fn gate() -> QualityGate {
    let check = |name: &str, passed, text: &str| GateCheck { name: name.into(), passed, text: text.into() };
    QualityGate {
        checks: vec![
            check("swing amplitude", true, "52° to −50°; at least 15° are needed."),
            check("full swings", true, "35; at least 5 are needed."),
            check("predicted uncertainty", true, "position.ins 0.76 ms, velocity.ins 0.09 ms; limit 5 ms."),
            check(
                "saturation",
                false,
                "specific-force.imu z stands at its largest value in 41 rows: the gain may read low.",
            ),
            check("free pendulum", true, "accX has 25 m/s² per rad: the bar is driven, not free."),
        ],
        excited_band_hz: [0.31, 1.21],
        rms_frequency_hz: 0.583,
        swings: 35,
        not_observable: vec![
            "the y column of scale and misalignment of the accelerometer".into(),
            "hard iron against the y column of soft iron, from one azimuth".into(),
        ],
    }
}

fn clocks() -> ClockFinding {
    ClockFinding {
        basis: TimeBasis::Anchor { channel: "angular-rate.imu".into() },
        statement: "Encoder and sensor carry stamps of different clocks: every delay is relative to angular-rate.imu, \
                    which is assumed to be on time."
            .into(),
        skew: Finding::Found(estimate(21.4e-6, 2.4e-6)),
        anchor_lag_s: Some(estimate(12.345_678, 0.000_026)),
        hull: Some(HullFinding {
            channel: "angular-rate.imu".into(),
            device: Clock::Boot,
            arrival: Clock::Unix,
            offset_s: 1_288_000_123.456,
            skew: -21.9e-6,
            latency_s: Distribution { min: 0.0, p01: 0.000_04, median: 0.0028, p99: 0.0181, max: 0.041 },
            remark: "Holds the least transport latency.".into(),
        }),
        pps: Some(PpsFinding {
            channel: "pps.sensor".into(),
            pulses: 62,
            rejected: vec![RejectCount {
                reason: "0.4 s after the one before".into(),
                count: 1,
                first: "pulse 7".into(),
            }],
            skew: estimate(-3.1e-6, 0.2e-6),
            residual_rms_s: 4.1e-6,
        }),
    }
}

fn mount() -> MountFinding {
    let check = |name: &str, unit: &str, fitted, stated, agrees, text: &str| MountCheck {
        name: name.into(),
        unit: unit.into(),
        fitted,
        stated,
        agrees,
        of_rig: false,
        text: text.into(),
    };
    let found = |value, u| Finding::Found(estimate(value, u));
    MountFinding {
        detected: Finding::Found("upright".into()),
        stated: "upright".into(),
        checks: vec![
            check(
                "lever arm z of imu",
                "m",
                found(-1.2812, 0.0003),
                Some(-1.28),
                Some(true),
                "Within the tolerance of 5 mm.",
            ),
            check(
                "misalignment y of imu",
                "°",
                found(1.31, 0.04),
                Some(0.0),
                Some(false),
                "Turned by more than 1°: check the clamp.",
            ),
            check(
                "misalignment x of imu",
                "°",
                Finding::CannotTell("a planar swing does not show it".into()),
                Some(0.0),
                None,
                "",
            ),
            check("gyro bias y", "rad/s", found(0.0031, 0.0001), None, None, "The rig file states none."),
        ],
        magnetometer: Finding::Found(MagnetometerFinding {
            kind: "planar".into(),
            azimuths: 1,
            hard_iron: [
                Finding::Found(estimate(1.21, 0.05)),
                Finding::CannotTell("one azimuth: not told from soft iron y".into()),
                Finding::Found(estimate(-0.42, 0.05)),
            ],
            soft_iron: vec![[1.018, 0.0, 0.004], [0.0, 1.0, 0.0], [-0.003, 0.0, 1.021]],
            soft_iron_standard_uncertainty: vec![],
            condition: None,
            residual_rms: 0.41,
            magnitude_ratio: Some(estimate(1.011, 0.002)),
            dip_error_rad: Some(estimate(0.0051, 0.0012)),
            text: "Planar fit of one azimuth; two more azimuths would give the rest.".into(),
        }),
    }
}

fn log(role: &str, file: &str, channel: &str, quantity: Quantity) -> BenchLog {
    let stamps = StampHealth {
        kind: StampKind::Logged,
        clock: Clock::Unix,
        source: "log".into(),
        first_ns: 1_288_000_000_000_000_000,
        last_ns: 1_288_000_064_000_000_000,
        count: 6401,
        rate_hz: Some(100.0),
        steps_s: Some(Distribution { min: 0.0091, p01: 0.0096, median: 0.01, p99: 0.0131, max: 0.021 }),
        gap_count: 0,
        gaps: vec![],
        duplicates: 0,
        back_jumps: 0,
    };
    BenchLog {
        role: role.into(),
        inputs: vec![InputFile { name: file.into(), bytes: 412_345, blake3: "77aa01fe".repeat(8) }],
        health: LogHealth {
            format: "CSV, comma, 1 header line".into(),
            bytes: ByteLedger { size: 412_345, decoded: 412_000, skipped: 0, structure: 345, damaged: 0, tail_cut: 0 },
            messages: 6401,
            ..LogHealth::default()
        },
        binding: Some(Binding {
            map: "bench-csv".into(),
            why: format!("binds {channel}"),
            others: vec![],
            channels: vec![ChannelHealth {
                name: channel.into(),
                quantity,
                source: ChannelSource { topic: "rows".into(), type_name: String::new(), fields: vec!["count".into()] },
                absent: vec![],
                rows: 6401,
                used: 6401,
                rejected: vec![],
                stamps: Some(stamps),
                offsets: vec![],
                held: (quantity != Quantity::EncoderCount).then_some(Held {
                    repeats: 6144,
                    modal_run: 25,
                    update_interval_s: 0.25,
                }),
            }],
        }),
    }
}

pub fn sensor() -> SensorIdentity {
    SensorIdentity {
        model: "Xsens MTi-G".into(),
        serial: Some("00500123".into()),
        firmware: Some("2.6".into()),
        baud: Some(115_200),
        configuration: Some("GPS, aerospace scenario".into()),
    }
}

/// A record with everything.
pub fn bench_record() -> BenchRecord {
    static RECORD: LazyLock<BenchRecord> = LazyLock::new(whole_record);
    RECORD.clone()
}

fn whole_record() -> BenchRecord {
    let mut channels: Vec<ChannelDynamics> = KINDS.iter().map(channel).collect();
    channels.insert(7, silent_channel());
    let mut notices = Notices::new();
    notices.push(Code::RejectedRow, "specific-force.imu z", 41, "41 rows stand at the largest value");
    notices.push(Code::HeldRows, "position.gps", 6144, "6144 rows repeat a held value and are left out");
    BenchRecord {
        record_version: RECORD_VERSION,
        analysis_version: 1,
        sensor: sensor(),
        rig: RigUse {
            title: "Swing bench, Goyang".into(),
            blake3: "ab12cd34".repeat(8),
            toml: "schema = 1\ntitle = \"Swing bench, Goyang\"\n\n[bar]\nlength_m = 1.3\nmount = \"upright\"\n\n\
                   [encoder]\ncounts_per_rev = 2000\ndecoding = 1\n"
                .into(),
        },
        logs: vec![
            log("encoder", "swing-07-encoder.csv", "encoder.bar", Quantity::EncoderCount),
            log("sensor", "swing-07-mtig.csv", "position.gps", Quantity::PositionGeodetic),
        ],
        date: Some("2010-10-25".into()),
        outcome: BenchOutcome::Measured,
        findings: Some(BenchFindings {
            origin_ns: 1_288_000_000_000_000_000,
            clock: Clock::Unix,
            reference: reference(),
            gate: gate(),
            clocks: clocks(),
            mount: mount(),
            flexibility: Finding::Found(Flexibility {
                frequency_hz: Some(0.55),
                translation_gain: estimate(1.0142, 0.0007),
                rotation_gain: estimate(1.0203, 0.0009),
                ratio: Finding::Found(estimate(1.43, 0.09)),
                first_mode_hz: Finding::Found(estimate(4.6, 0.3)),
                expected_hz: Some(4.0),
                text: "The bar bends: rotation exceeds translation by the ratio of a cantilever's first mode.".into(),
            }),
            geometry: Some(RigGeometry {
                bar_length_m: L,
                mount: "upright".into(),
                parts: vec![
                    RigPart {
                        channels: vec!["position.gps".into(), "position.ins".into()],
                        lever_arm_m: [0.04, -0.02, -1.36],
                        is_stated: true,
                    },
                    RigPart {
                        channels: vec!["specific-force.imu".into()],
                        lever_arm_m: [0.0, 0.0, -L],
                        is_stated: false,
                    },
                ],
            }),
            channels,
        }),
        notices,
    }
}

/// The same with curves short enough for tests that change every value in turn.
pub fn light_bench_record() -> BenchRecord {
    light_bench(bench_record())
}

/// A record with two channels and a few points of each curve.
pub fn light_bench(mut record: BenchRecord) -> BenchRecord {
    let Some(findings) = record.findings.as_mut() else { return record };
    findings.channels.retain(|c| ["height.baro", "position.gps"].contains(&c.name.as_str()));
    for c in &mut findings.channels {
        c.components.truncate(2);
        if let Finding::Found(response) = &mut c.response {
            response.points.truncate(4);
            response.model_gain.truncate(4);
            response.model_phase_rad.truncate(4);
        }
        if let Some(checks) = &mut c.checks {
            let o = &mut checks.objective;
            let lists = [&mut o.delay_s, &mut o.value, &mut o.near_delay_s, &mut o.near_value];
            lists.into_iter().chain([&mut checks.autocorrelation]).for_each(|list| list.truncate(5));
        }
        c.latency = Finding::Found(latency());
    }
    let components = findings.channels.iter_mut().flat_map(|c| &mut c.components);
    let curves = components.flat_map(|c| c.curves.iter_mut().chain(&mut c.zoom).chain(&mut c.residual));
    for curve in curves.chain(&mut findings.reference.angle).chain(&mut findings.reference.acceleration) {
        curve.t_s.truncate(8);
        curve.y.truncate(8);
    }
    record
}

/// A readable record without channels or results.
pub fn silent_bench_record() -> BenchRecord {
    let mut record = bench_record();
    record.outcome =
        BenchOutcome::NotMeasurable { reason: "The bar moves by 0.4°: swing it by at least 15°.".into() };
    let findings = record.findings.as_mut().unwrap();
    let cannot = || "the bar stands still".to_owned();
    findings.channels.clear();
    findings.flexibility = Finding::CannotTell(cannot());
    findings.mount.detected = Finding::CannotTell(cannot());
    findings.mount.magnetometer = Finding::CannotTell(cannot());
    findings.clocks.skew = Finding::CannotTell(cannot());
    (findings.clocks.hull, findings.clocks.pps, findings.clocks.anchor_lag_s) = (None, None, None);
    record
}

/// A record whose logs could not be used.
pub fn failed_bench_record() -> BenchRecord {
    BenchRecord {
        outcome: BenchOutcome::Failed { reason: "swing-09.csv: line 3: column \"count\" holds \"x\"".into() },
        logs: vec![],
        date: None,
        findings: None,
        notices: Notices::new(),
        ..bench_record()
    }
}

/// Three records of one sensor, the last an outlier in position.ins, and their card.
pub fn card() -> (SensorCard, Vec<BenchRecord>) {
    let whole = bench_record();
    let run = |i: usize, shift: f64| {
        let mut record = whole.clone();
        for input in record.logs.iter_mut().flat_map(|l| &mut l.inputs) {
            input.name = input.name.replace("07", &format!("{i:02}"));
        }
        let channels = record.findings.iter_mut().flat_map(|f| &mut f.channels);
        for delay in channels.filter_map(|c| c.delay.as_mut()) {
            let u = delay.standard_uncertainty_s;
            delay.delay = Delay::from_seconds(delay.delay.seconds() + shift * u).unwrap();
        }
        record
    };
    let records = vec![run(7, 0.4), run(8, -0.9), run(9, 14.0), run(10, 0.2)];
    let channel = |kind: &Kind| CardChannel {
        name: kind.name.into(),
        quantity: kind.quantity,
        verdict: kind.verdict,
        delay_s: kind.delay_s,
        delay_standard_uncertainty_s: kind.u_s * 0.7,
        as_seen_delay_s: (kind.name == "position.gps").then_some(kind.delay_s + 0.125),
        lags_s: vec![],
        lags_standard_uncertainty_s: vec![],
        model: "delay".into(),
        gain: kind.gain,
        gain_standard_uncertainty: 0.0009,
        update_rate_hz: Some(kind.rate),
        stamp_kind: StampKind::Logged,
        basis: TimeBasis::Anchor { channel: "angular-rate.imu".into() },
        records: 3,
        between_runs_s: Some(kind.u_s * 0.6),
        outliers: vec!["swing-09-mtig.csv".into()],
        slow_motion_delay_s: (kind.name == "height.baro").then_some(kind.delay_s + 0.03),
        slow_motion_standard_uncertainty_s: None,
        contradicted: if kind.name == "height.baro" { vec!["swing-07: azimuth by <imu>".into()] } else { vec![] },
    };
    let source = |record: &BenchRecord| CardSource {
        files: record.logs.iter().flat_map(|l| &l.inputs).map(|i| i.name.clone()).collect(),
        blake3: record.logs.iter().flat_map(|l| &l.inputs).map(|i| i.blake3.clone()).collect(),
        date: record.date.clone(),
        rig_blake3: record.rig.blake3.clone(),
    };
    let card = SensorCard {
        card_version: CARD_VERSION,
        sensor: sensor(),
        rig: "Swing bench, Goyang".into(),
        method: "REML-GLS against a smoothed encoder; weighted mean over records, spread between them included.".into(),
        flightlag_version: "0.1.0".into(),
        analysis_version: 1,
        measured_on: Some("2010-10-25".into()),
        valid_from: Some("2010-10-25".into()),
        valid_until: Some("2011-10-25".into()),
        magnetometer: Some(CardMagnetometer {
            channel: "magnetic-field.imu".into(),
            unit: "T".into(),
            azimuths_rad: vec![0.5, 2.6, -1.5],
            iron: Finding::Found(IronCalibration {
                hard_iron: [1.21e-5, -6.9e-6, 2.02e-5],
                hard_iron_standard_uncertainty: [1.1e-7, 2.1e-7, 0.9e-7],
                soft_iron: [[1.041, 0.02, -0.03], [0.01, 0.962, 0.04], [-0.02, 0.03, 1.001]],
                soft_iron_standard_uncertainty: [[0.0021, 0.0042, 0.0017]; 3],
                scale: Some(1.009),
                scale_standard_uncertainty: Some(0.0012),
                residual_rms: 2.03e-7,
                condition: 6.52,
                text: "From 3 swings at 3 azimuths.".into(),
            }),
        }),
        channels: KINDS.iter().map(channel).collect(),
        records: records.iter().map(source).collect(),
    };
    (card, records)
}

/// The given number of noise samples over the zoom.
pub fn noise_curve(samples: usize) -> Curve {
    let mut noise = Noise(11);
    let step = 7.0 / samples as f64;
    sampled("measured", (22.0, 29.0), step, samples as u64, |_| noise.next())
}
