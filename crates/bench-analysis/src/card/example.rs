//! A card and records for tests.

use flight::{Clock, Delay, Notices, Quantity, StampKind};
use record::{
    BenchFindings, BenchLog, BenchOutcome, BenchRecord, CARD_VERSION, CardChannel, CardMagnetometer, CardSource,
    ChannelDynamics, ClockFinding, ComponentDynamics, DelayFinding, Estimate, Finding, InputFile, IronCalibration,
    ModelCandidate, ModelFinding, MountFinding, QualityGate, ReferenceFinding, RigUse, SensorCard, SensorIdentity,
    TimeBasis, Verdict,
};

pub(crate) fn sensor() -> SensorIdentity {
    SensorIdentity {
        model: "Xsens MTi-G".into(),
        serial: Some("00500123".into()),
        firmware: Some("2.6".into()),
        baud: Some(115_200),
        configuration: None,
    }
}

fn position() -> CardChannel {
    CardChannel {
        name: "position.gps".into(),
        quantity: Quantity::PositionGeodetic,
        verdict: Verdict::Delayed,
        delay_s: 0.4,
        delay_standard_uncertainty_s: 0.002,
        as_seen_delay_s: Some(0.525),
        lags_s: vec![],
        lags_standard_uncertainty_s: vec![],
        model: "delay".into(),
        gain: 1.001,
        gain_standard_uncertainty: 0.002,
        update_rate_hz: Some(4.0),
        stamp_kind: StampKind::Measured,
        basis: TimeBasis::OneClock,
        records: 1,
        between_runs_s: None,
        outliers: vec![],
        slow_motion_delay_s: None,
        slow_motion_standard_uncertainty_s: None,
        contradicted: vec![],
    }
}

fn magnetometer() -> CardMagnetometer {
    CardMagnetometer {
        channel: "magnetic-field.imu".into(),
        unit: "T".into(),
        azimuths_rad: vec![0.5, 2.6, -1.6],
        iron: Finding::Found(IronCalibration {
            hard_iron: [1.2e-5, -7e-6, 2e-5],
            hard_iron_standard_uncertainty: [1e-7, 2e-7, 1e-7],
            soft_iron: [[1.04, 0.02, -0.03], [0.01, 0.96, 0.04], [-0.02, 0.03, 1.0]],
            soft_iron_standard_uncertainty: [[0.002; 3]; 3],
            scale: Some(1.01),
            scale_standard_uncertainty: Some(0.001),
            residual_rms: 2e-7,
            condition: 6.5,
            text: "From 3 swings".into(),
        }),
    }
}

pub(crate) fn card() -> SensorCard {
    let velocity = CardChannel {
        name: "velocity.ins".into(),
        quantity: Quantity::VelocityNed,
        verdict: Verdict::EquivalentToZero,
        delay_s: -0.0003,
        delay_standard_uncertainty_s: 0.0005,
        as_seen_delay_s: None,
        update_rate_hz: Some(100.0),
        basis: TimeBasis::Anchor { channel: "angular-rate.imu".into() },
        ..position()
    };
    SensorCard {
        card_version: CARD_VERSION,
        sensor: sensor(),
        rig: "Swing bench".into(),
        method: "against the encoder".into(),
        flightlag_version: "0.1.0".into(),
        analysis_version: 2,
        measured_on: Some("2010-10-25".into()),
        valid_from: Some("2010-10-25".into()),
        valid_until: Some("2011-10-25".into()),
        magnetometer: Some(magnetometer()),
        channels: vec![position(), velocity],
        records: vec![CardSource {
            files: vec!["a.csv".into()],
            blake3: vec!["ab12".into()],
            date: Some("2010-10-25".into()),
            rig_blake3: "cd34".into(),
        }],
    }
}

/// A delay with this standard uncertainty.
fn delay(delay_s: f64, u_s: f64) -> DelayFinding {
    DelayFinding {
        delay: Delay::from_seconds(delay_s).unwrap(),
        standard_uncertainty_s: u_s,
        hessian_s: u_s,
        hac_s: u_s,
        reference_s: 0.0,
        stamps_s: 0.0,
        anchor_s: 0.0,
        change_s: 0.0,
        interval_95_s: [delay_s - 2.0 * u_s, delay_s + 2.0 * u_s],
        degrees_of_freedom: 100.0,
        crlb_s: u_s,
        as_seen_s: Some(Estimate { value: delay_s + 0.125, standard_uncertainty: Some(u_s) }),
        held_fit_s: None,
        minimum_detectable_s: 2.8 * u_s,
        margin_s: 0.005,
        strict_margin_s: 0.005,
        deciding_length_s: None,
    }
}

/// A channel measured with this delay.
pub(crate) fn channel(name: &str, delay_s: f64, u_s: f64) -> ChannelDynamics {
    let estimate = |value, u| Estimate { value, standard_uncertainty: Some(u) };
    ChannelDynamics {
        name: name.into(),
        quantity: Quantity::PositionGeodetic,
        stamp_kind: StampKind::Measured,
        clock: Clock::Unix,
        basis: TimeBasis::OneClock,
        samples: 240,
        rejected: vec![],
        rate_hz: Some(100.0),
        update_rate_hz: Some(4.0),
        held_rows: 0,
        verdict: Verdict::Delayed,
        reason: "late".into(),
        predicted_s: None,
        delay: Some(delay(delay_s, u_s)),
        components: vec![ComponentDynamics {
            name: "north".into(),
            unit: "m".into(),
            excited: true,
            why_not: String::new(),
            gain: Some(estimate(1.0, 0.01)),
            gain_frequency_hz: Some(0.6),
            offset: None,
            drift: None,
            noise: None,
            delay_s: None,
            curves: vec![],
            zoom: vec![],
            residual: None,
            overlay: None,
        }],
        model: model("D", &[]),
        response: Finding::CannotTell(String::new()),
        checks: None,
        stationarity: Finding::CannotTell(String::new()),
        jitter_s: Finding::CannotTell(String::new()),
        latency: Finding::CannotTell(String::new()),
        injections: vec![],
    }
}

pub(crate) fn model(name: &str, lags_s: &[f64]) -> Finding<ModelFinding> {
    let plain = |value| Estimate { value, standard_uncertainty: None };
    Finding::Found(ModelFinding {
        candidates: vec![ModelCandidate {
            name: name.into(),
            delta_bic: 0.0,
            delay_s: None,
            lags_s: lags_s.iter().copied().map(plain).collect(),
            square_s2: None,
            gain: plain(1.0),
        }],
        chosen: Some(name.into()),
        text: String::new(),
        sum_s: plain(0.4),
    })
}

/// A record from that day with these channels.
pub(crate) fn record(day: &str, channels: Vec<ChannelDynamics>) -> BenchRecord {
    let input = InputFile { name: format!("{day}.csv"), bytes: 1, blake3: format!("hash of {day}") };
    BenchRecord {
        record_version: 1,
        analysis_version: 1,
        sensor: sensor(),
        rig: RigUse { title: "Swing bench".into(), blake3: "rig".into(), toml: String::new() },
        logs: vec![BenchLog {
            role: "encoder and sensor".into(),
            inputs: vec![input],
            health: flight::LogHealth::default(),
            binding: None,
        }],
        date: Some(day.into()),
        outcome: BenchOutcome::Measured,
        findings: Some(findings(channels)),
        notices: Notices::new(),
    }
}

fn findings(channels: Vec<ChannelDynamics>) -> BenchFindings {
    let nothing = || "not in this test".to_owned();
    let zero = Estimate { value: 0.0, standard_uncertainty: None };
    BenchFindings {
        origin_ns: 0,
        clock: Clock::Unix,
        reference: ReferenceFinding {
            channel: "encoder.bar".into(),
            samples: 0,
            rate_hz: 100.0,
            duration_s: 60.0,
            counts_per_rev: 2000.0,
            counts_source: nothing(),
            sign: 1.0,
            sign_source: nothing(),
            zero_rad: zero,
            zero_source: nothing(),
            azimuth_rad: None,
            azimuth_source: nothing(),
            log10_q: 0.0,
            residual_rms_counts: 0.289,
            uncertainty: [0.0; 3],
            angle_range_rad: [-1.0, 1.0],
            gravity_mps2: 9.8,
            gravity_source: nothing(),
            field_t: None,
            field_source: nothing(),
            angle: vec![],
            acceleration: vec![],
        },
        gate: QualityGate {
            checks: vec![],
            excited_band_hz: [0.3, 0.9],
            rms_frequency_hz: 0.6,
            swings: 30,
            not_observable: vec![],
        },
        clocks: ClockFinding {
            basis: TimeBasis::OneClock,
            statement: nothing(),
            skew: Finding::CannotTell(nothing()),
            anchor_lag_s: None,
            hull: None,
            pps: None,
        },
        mount: MountFinding {
            detected: Finding::CannotTell(nothing()),
            stated: "upright".into(),
            checks: vec![],
            magnetometer: Finding::CannotTell(nothing()),
        },
        flexibility: Finding::CannotTell(nothing()),
        geometry: None,
        channels,
    }
}
