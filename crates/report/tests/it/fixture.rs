//! Records with known numbers, for the tests and the specimen.
//!
//! The aircraft flies a sum of two harmonics, so every compensator has a closed form: for
//! a motion `a e^(iωt)` the raw position is `a e^(iω(t − Td))`, Padé [1/1] adds
//! `iω Td / (1 + iωTd/2)` times the motion, and the exact form recovers the motion.

use flight::{
    Binding, ByteLedger, ChannelHealth, ChannelSource, Clock, Code, DamagedRange, Delay, Distribution, Gap, Geodetic,
    Held, LogHealth, MapCandidate, Notices, Quantity, RejectCount, Severity, StampHealth, StampKind, StampOffset,
    TopicHealth,
};
use record::{
    AxisCurves, BudgetTerm, CampaignRecord, CampaignTotals, CompensatorResult, CompensatorScore, Coverage, Curve,
    DelayExcitation, DelayGroup, DelayHomogeneity, DelayNoise, DelayOrigin, DelayPairKind, DelayPiece, DelaySource,
    DelaySplit, DelayStep, Effect, EffectVerdict, ErrorBudget, Estimate, Finding, FlightDelays, FlightInjection,
    FlightRecord, FlightRow, HelpfulBand, Hysteresis, IgnoredInput, InputFile, JudgedBy, Lead, LeadCurves, LeadTrack,
    MeasuredDelay, MotionSpectrum, OnboardAgainst, OnboardComparison, OppositePasses, Outcome, PairDelay, PairUse,
    PipelineUse, RECORD_VERSION, ReferenceScore, ReplayRecord, ReplayScores, ReplaySettings, ResidualDelay, StartRule,
    StraightLegs, StraightScore, WindowDelay, Zoom,
};

#[path = "sweep_fixture.rs"]
pub mod sweep;

/// Delay of the fixture, s.
pub const TD: f64 = 0.4;
const DURATION: f64 = 725.0;
pub const RAW: &str = "raw, newest fix held";
const PADE: &str = "Padé [1/1], Tustin (the paper)";
pub const EXACT: &str = "exact asynchronous, p + ∫v";
/// Amplitude m and angular rate rad/s of the motion: 17.5 m/s on a 30 m circle, and a slow drift.
const HARMONICS: [(f64, f64); 2] = [(30.0, 17.5 / 30.0), (220.0, 0.021)];

/// Output of a compensator at `t`: the real part is north, the imaginary part is east.
fn position(kind: &str, t: f64) -> (f64, f64) {
    HARMONICS.iter().fold((0.0, 0.0), |sum, &(a, w)| {
        let rotated = |angle: f64| (a * angle.cos(), a * angle.sin());
        let raw = rotated(w * (t - TD));
        let (north, east) = match kind {
            RAW => raw,
            PADE => {
                // i w Td / (1 + i w Td/2), times the motion.
                let (x, h) = (w * TD, w * TD / 2.0);
                let (re, im) = (x * h / (1.0 + h * h), x / (1.0 + h * h));
                let (c, s) = rotated(w * t);
                (raw.0 + re * c - im * s, raw.1 + re * s + im * c)
            }
            _ => rotated(w * t),
        };
        (sum.0 + north, sum.1 + east)
    })
}

/// 2-D rms of raw − exact: for each harmonic the chord 2 a sin(w Td / 2).
pub fn correction_rms() -> f64 {
    HARMONICS.iter().map(|(a, w)| (2.0 * a * (w * TD / 2.0).sin()).powi(2)).sum::<f64>().sqrt()
}

fn sampled(name: &str, (from, to): (f64, f64), step: f64, of: impl Fn(f64) -> f64) -> Curve {
    let count = ((to - from) / step) as usize;
    let t_s: Vec<f64> = (0..=count).map(|i| from + i as f64 * step).collect();
    let y = t_s.iter().map(|&t| of(t)).collect();
    let breaks = if from < 400.0 && to > 410.0 { vec![((400.0 - from) / step) as u32] } else { vec![] };
    Curve { name: name.into(), t_s, y, breaks, stands_for: 25 * count as u64 }
}

fn axes(window: (f64, f64), step: f64) -> Vec<AxisCurves> {
    let side = |p: (f64, f64), axis: &str| if axis == "north" { p.0 } else { p.1 };
    let axis = |axis: &str| {
        let shown = |kind: &'static str| sampled(kind, window, step, |t| side(position(kind, t), axis));
        AxisCurves { axis: axis.into(), position_m: vec![shown(RAW), shown(PADE), shown(EXACT)] }
    };
    vec![axis("north"), axis("east")]
}

/// Distance from raw to exact along the track at `t`, m, and the ground speed, m/s.
fn ahead(t: f64) -> (f64, f64) {
    let (now, next) = (position(EXACT, t - 5e-4), position(EXACT, t + 5e-4));
    let (vn, ve) = ((next.0 - now.0) / 1e-3, (next.1 - now.1) / 1e-3);
    let (exact, raw) = (position(EXACT, t), position(RAW, t));
    let speed = vn.hypot(ve);
    (((exact.0 - raw.0) * vn + (exact.1 - raw.1) * ve) / speed, speed)
}

fn lead() -> LeadCurves {
    let points: Vec<(f64, f64)> = (0..2900).map(|i| position(EXACT, f64::from(i) * 0.25)).collect();
    LeadCurves {
        of: vec![Lead {
            median_m: 7.01,
            over_time_m: sampled(EXACT, (0.0, DURATION), 1.0, |t| ahead(t).0),
            over_time_ms: sampled(EXACT, (0.0, DURATION), 1.0, |t| 1e3 * ahead(t).0 / ahead(t).1),
        }],
        least_speed_mps: 4.4,
        track: LeadTrack {
            lead_m: (0..2900).map(|i| ahead(f64::from(i) * 0.25).0).collect(),
            east_m: points.iter().map(|p| p.1).collect(),
            north_m: points.iter().map(|p| p.0).collect(),
            breaks: vec![1600],
            stands_for: 72_500,
        },
    }
}

fn estimate(value: f64, u: f64) -> Estimate {
    Estimate { value, standard_uncertainty: Some(u) }
}

/// The replay of one flight.
pub fn replay() -> ReplayRecord {
    let compensator = |name: &str, title: &str, correction: f64, error: f64| CompensatorResult {
        name: name.into(),
        title: title.into(),
        delay: Delay::from_seconds(if name == "raw" { 0.0 } else { TD }).unwrap(),
        raw_minus_this_rms_m: estimate(correction, if name == "raw" { 0.0 } else { 0.0104 }),
        step_at_fix_rms_m: Some(estimate(1.75 - correction / 5.0, 0.006)),
        error_rms_m: Some(estimate(error, error * 0.021)),
        error_p95_m: Some(estimate(error * 1.6, error * 0.05)),
    };
    ReplayRecord {
        settings: ReplaySettings {
            delay: Delay::from_seconds(TD).unwrap(),
            delay_uncertainty_s: Some(0.0065),
            delay_source: "pipeline, from Park and Lee 2010".into(),
            card: None,
            start: StartRule::Warm,
            bridge_s: 0.8,
        },
        pair: PairUse {
            position: "position.gps".into(),
            velocity: "velocity.ekf".into(),
            reference: Some("position.truth".into()),
        },
        origin_ns: 1_700_000_000_123_456_789,
        clock: Clock::Unix,
        origin: Some(Geodetic::from_degrees(34.437_214, 127.513_9, 61.2)),
        coverage: Coverage {
            duration_s: DURATION,
            rows: 72_501,
            valid_rows: 71_402,
            valid_s: 714.02,
            invalid: vec![
                RejectCount { reason: "warm-up".into(), count: 40, first: "t = 0.000 s".into() },
                RejectCount { reason: "no velocity".into(), count: 1059, first: "t = 400.010 s".into() },
            ],
            bridged_gaps: 3,
            restarts: 1,
            fixes: 2890,
            position_resets: 0,
            longest_position_gap_s: 1.25,
        },
        speed_mps: Distribution { min: 0.2, p01: 11.0, median: 17.48, p99: 22.1, max: 23.0 },
        predicted_rms_m: estimate(7.242, 0.009),
        compensators: vec![
            compensator("raw", RAW, 0.0, 7.25),
            compensator("pade-1-1", PADE, correction_rms() - 0.031, 0.0371),
            compensator("exact-async", EXACT, correction_rms(), 0.0197),
        ],
        scores: Some(scores()),
        onboard: Some(Finding::Found(onboard())),
        axes: axes((0.0, DURATION), 0.25),
        zoom: Some(Zoom {
            start_s: 232.0,
            end_s: 262.0,
            why: "the 30 s with the largest mean horizontal acceleration, 10.2 m/s²".into(),
            axes: axes((232.0, 262.0), 0.02),
        }),
        lead: Some(lead()),
        choice: Some(sweep::choice()),
        sweep: Some(sweep::swept()),
    }
}

/// Scores of the three: raw without lead, the paper's with a residual delay due to its truncation.
pub fn scores() -> ReplayScores {
    let compensator = |name: &str, left_s: f64, expected_s: f64, error: f64| {
        let is_raw = name == "raw";
        let none = |why: &str| why.to_owned();
        CompensatorScore {
            name: name.into(),
            residual_delay: Finding::Found(ResidualDelay {
                delay_s: estimate(left_s, 0.0006),
                interval_95_s: [left_s - 0.0012, left_s + 0.0012],
                samples: 5780,
                expected_s: Estimate {
                    value: expected_s,
                    standard_uncertainty: Some(if is_raw { 0.0 } else { 0.5 * expected_s }),
                },
            }),
            lead_s: if is_raw {
                Finding::CannotTell(none("the lead is that over raw"))
            } else {
                Finding::Found(estimate(TD - expected_s, 0.0004))
            },
            expected_lead_s: if is_raw { 0.0 } else { TD },
            step_correlation: Finding::Found(estimate(if name == "exact-async" { 0.004 } else { 0.998 }, 0.003)),
            hysteresis: Finding::Found(Hysteresis {
                along_m: estimate(if is_raw { 13.94 } else { 0.021 }, 0.03),
                across_m: estimate(-0.012, 0.025),
                expected_along_m: if is_raw { 14.0 } else { 0.0 },
            }),
            raw_minus_this_axes_rms_m: [estimate(if is_raw { 0.0 } else { 4.94 }, 0.02); 2],
            straight: if is_raw {
                Finding::CannotTell(none("it is raw itself"))
            } else {
                Finding::Found(StraightScore {
                    along_excess_m: estimate(0.0021, 0.0013),
                    across_rms_m: estimate(0.028, 0.001),
                    noise_ratio: estimate(1.003, 0.004),
                })
            },
            reference: Finding::Found(ReferenceScore {
                rows: 71_402,
                rms_m: estimate(error, error * 0.021),
                percentiles_m: [0.9, 1.05, 1.6, 2.1].map(|k| k * error),
                max_m: 2.7 * error,
                along_m: [estimate(-0.9 * error, 0.01), estimate(0.95 * error, 0.01)],
                across_m: [estimate(0.001, 0.01), estimate(0.31 * error, 0.01)],
                north_m: [estimate(0.002, 0.01), estimate(0.7 * error, 0.01)],
                east_m: [estimate(-0.001, 0.01), estimate(0.714 * error, 0.01)],
                by_speed: vec![Some(estimate(0.9 * error, 0.02)), None],
                bands_rms_m: Finding::Found(vec![0.4 * error, 0.9 * error, 0.05 * error]),
                residual_delay_s: Finding::Found(estimate(left_s + 0.0002, 0.0009)),
            }),
            budget: ErrorBudget {
                terms: vec![
                    BudgetTerm {
                        name: "delay set wrongly, speed × δTd".into(),
                        size_m: Finding::Found(0.0105),
                        source: "U times the standard uncertainty of Td as stated".into(),
                    },
                    BudgetTerm {
                        name: "bias of the velocity, Td·b".into(),
                        size_m: Finding::CannotTell("velocity bias not known: <the flight is too straight>".into()),
                        source: String::new(),
                    },
                ],
                total_m: None,
                known_m: 0.98 * error,
                measured_m: Some(estimate(error, error * 0.021)),
            },
            band: if is_raw {
                Finding::CannotTell(none("raw is what the others are compared with"))
            } else {
                Finding::Found(HelpfulBand {
                    factor: 0.1,
                    helps_below_hz: Some(if name == "pade-1-1" { 0.424 } else { 1.0 / TD }),
                    halves_below_hz: Some(1.2),
                    worse_above_hz: (name == "pade-1-1").then_some(1.7),
                    delays_s: [TD, 0.0, TD],
                    motion_share: Some([0.962, 0.031, 0.007]),
                })
            },
        }
    };
    let edges_hz: Vec<f64> = (-24..=12).map(|k| 10f64.powf(f64::from(k) / 12.0)).collect();
    let share = |f: f64| (-((f / 0.0928).ln() / 0.5).powi(2)).exp() + 2e-3 * f;
    let total: f64 = edges_hz[1..].iter().map(|f| share(*f)).sum();
    ReplayScores {
        compensators: vec![
            compensator("raw", TD, TD, 7.25),
            compensator("pade-1-1", 0.0018, 0.0013, 0.0371),
            compensator("exact-async", 0.0031, 0.0, 0.0197),
        ],
        predicted_axes_rms_m: [5.1, 5.14],
        straight_legs: Finding::Found(StraightLegs { legs: 17, duration_s: 38.2, lateral_limit_mps2: 0.5 }),
        opposite_passes: Finding::Found(OppositePasses {
            pairs: 5,
            fixes: 212,
            within_m: 15.0,
            closing_speed_mps: 35.0,
        }),
        velocity_delay_s: Finding::Found(estimate(0.0002, 0.0011)),
        motion: Finding::Found(MotionSpectrum {
            share: edges_hz[1..].iter().map(|f| share(*f) / total).collect(),
            edges_hz,
            duration_s: 400.0,
            noise_floor: [2e-4; 2],
        }),
        bands_hz: vec![[0.0, 0.05], [0.05, 0.1], [0.1, 5.0]],
        speeds_mps: vec![[0.2, 17.5], [17.5, 23.0]],
    }
}

/// The onboard output, identified as the paper's filter.
pub fn onboard() -> OnboardComparison {
    let against = |name: &str, rms_m: f64, delay_s: f64| OnboardAgainst {
        name: name.into(),
        rms_m,
        p95_m: 1.9 * rms_m,
        max_m: 2.4 * rms_m,
        start_max_m: (name != "raw").then_some(0.31),
        delay_s: Finding::Found(estimate(delay_s, 2e-5)),
    };
    OnboardComparison {
        channel: "position.compensated".into(),
        samples: 72_501,
        compared: 71_402,
        same_stamps: true,
        tolerance_m: 0.0142,
        tolerance_source: "one step of its values on each axis (0.0111 m north, 0.0088 m east)".into(),
        start_s: 3.2,
        reproduced_by: Finding::Found("pade-1-1".into()),
        against: vec![
            against("raw", 7.0, -0.4),
            against("pade-1-1", 0.0041, 0.0),
            against("exact-async", 0.035, 0.002),
        ],
    }
}

/// Three pairs: the replay's own, one without a result, one against the reference.
pub fn delays() -> FlightDelays {
    let against_truth = PairDelay {
        kind: DelayPairKind::PositionAgainstReference,
        second: "position.truth".into(),
        meaning: "δ = Tp: how late position.gps is against position.truth, which is assumed to be on time".into(),
        delay: Finding::Found(MeasuredDelay { alarm: None, ..measured_delay(0.398_2, 0.000_9) }),
        varies: None,
        not_for_network: None,
        is_attitude_untested: false,
        lever_arm_s_per_decimetre: None,
        ..replayed_pair()
    };
    FlightDelays { pairs: vec![replayed_pair(), still_pair(), against_truth] }
}

/// 9.3 ms above what was removed, with U = 4.2 ms: E_n = 9.3/√(13² + 4.2²).
fn replayed_pair() -> PairDelay {
    PairDelay {
        kind: DelayPairKind::PositionAgainstVelocity,
        first: "position.gps".into(),
        second: "velocity.ekf".into(),
        meaning:
            "δ = Tp − Tv: how much later position.gps is than velocity.ekf. A delay that both share cannot be seen"
                .into(),
        origin: Some(DelayOrigin { origin_ns: 1_700_000_000_123_456_789, clock: Clock::Unix }),
        excitation: Some(DelayExcitation {
            samples: 2890,
            duration_s: 714.0,
            pieces: 2,
            speed_p95_mps: 21.3,
            moving_share: 0.93,
            unexplained_share: Some(0.004),
            predicted_s: Some(0.0018),
        }),
        delay: Finding::Found(measured_delay(TD + 0.0093, 0.0021)),
        varies: None,
        not_for_network: None,
        is_attitude_untested: false,
        lever_arm_s_per_decimetre: None,
    }
}

/// A pair that was tried without a result.
fn still_pair() -> PairDelay {
    PairDelay {
        kind: DelayPairKind::VelocityAgainstAcceleration,
        first: "velocity.ekf".into(),
        second: "attitude.ins + specific-force.imu".into(),
        meaning: "δ = Tv − Ta".into(),
        origin: None,
        excitation: None,
        delay: Finding::CannotTell("the log holds no attitude on this clock: log it beside the specific force".into()),
        varies: None,
        not_for_network: None,
        is_attitude_untested: false,
        lever_arm_s_per_decimetre: None,
    }
}

fn measured_delay(delay_s: f64, u: f64) -> MeasuredDelay {
    let windows = [0.6, -0.9, 0.2, 1.1, -1.3, 0.4];
    let piece = |start_s: f64, end_s: f64, begun_by: &str| DelayPiece {
        start_s,
        end_s,
        begun_by: begun_by.into(),
        drift: [estimate(0.031, 0.004), estimate(-0.018, 0.004)],
        noise: [
            DelayNoise { wander_std: Some(0.61), time_constant_s: Some(41.0), white_std: 0.052 },
            DelayNoise { wander_std: None, time_constant_s: None, white_std: 0.049 },
        ],
    };
    let group =
        |range: [f64; 2], off: f64| DelayGroup { range, samples: 1926, delay_s: estimate(delay_s + off, 2.0 * u) };
    MeasuredDelay {
        delay_s: estimate(delay_s, u),
        interval_95_s: [delay_s - 1.96 * u, delay_s + 1.96 * u],
        hessian_s: 0.8 * u,
        hac_s: u,
        widened_s: 0.0,
        crlb_s: 0.7 * u,
        smallest_detectable_s: 2.8 * u,
        samples: 5780,
        downweighted_share: 0.004,
        rival_s: None,
        objective: Some(sweep::objective(delay_s, u)),
        pieces: vec![
            piece(0.0, 399.8, ""),
            piece(410.0, DURATION, "a gap of 10.200 s in velocity.ekf (or a jump of its clock)"),
        ],
        over_time: (0..)
            .zip(windows)
            .map(|(i, z): (i32, f64)| WindowDelay {
                start_s: 120.0 * f64::from(i),
                end_s: 120.0 * f64::from(i) + 119.0,
                delay_s: estimate(delay_s + 2.4 * z * u, 2.4 * u),
            })
            .collect(),
        homogeneity: Some(DelayHomogeneity {
            chi2: 4.67,
            degrees_of_freedom: 5,
            p: 0.46,
            largest_step: DelayStep {
                at_s: 479.5,
                before_s: estimate(delay_s + 0.6 * u, 1.2 * u),
                after_s: estimate(delay_s - 1.1 * u, 1.7 * u),
                p: 1.0,
            },
        }),
        alarm: None,
        splits: vec![
            DelaySplit {
                by: "ground speed, m/s".into(),
                groups: vec![group([0.2, 15.1], 0.001), group([15.1, 18.9], -0.002), group([18.9, 23.0], 0.0005)],
                p: Some(0.71),
            },
            DelaySplit { by: "satellites.gps".into(), groups: vec![group([9.0, 9.0], 0.0004)], p: None },
        ],
        injections: vec![FlightInjection {
            injected_s: 0.1,
            error_s: estimate(-0.0016, 0.0042),
            interval_95_s: [-0.0098, 0.0066],
            split_s: 351.0,
        }],
        remarks: vec![],
        alarms: vec![],
    }
}

fn stamps(rate: f64, gap_count: u64) -> StampHealth {
    StampHealth {
        kind: StampKind::Measured,
        clock: Clock::Unix,
        source: "header.stamp".into(),
        first_ns: 1_700_000_000_123_456_789,
        last_ns: 1_700_000_725_123_456_789,
        count: (725.0 * rate) as u64,
        rate_hz: Some(rate),
        steps_s: Some(Distribution {
            min: 0.6 / rate,
            p01: 0.9 / rate,
            median: 1.0 / rate,
            p99: 1.13 / rate,
            max: 5.0 / rate,
        }),
        gap_count,
        gaps: (0..gap_count).map(|i| Gap { start_s: 400.0 + i as f64, length_s: 1.25 / (i + 1) as f64 }).collect(),
        duplicates: 2,
        back_jumps: 0,
    }
}

fn channel(name: &str, quantity: Quantity, rate: f64) -> ChannelHealth {
    let rows = (725.0 * rate) as u64;
    ChannelHealth {
        name: name.into(),
        quantity,
        source: ChannelSource {
            topic: format!("/mavros/{name}"),
            type_name: "sensor_msgs/NavSatFix".into(),
            fields: quantity.components().iter().map(|c| format!("{c} [SI]")).collect(),
        },
        absent: vec!["down".into()],
        rows,
        used: rows - 12,
        rejected: vec![RejectCount {
            reason: "repeats the stamp before".into(),
            count: 12,
            first: "message 311".into(),
        }],
        stamps: Some(stamps(rate, 3)),
        offsets: vec![StampOffset {
            of: StampKind::Logged,
            against: StampKind::Measured,
            offset_s: Distribution { min: 0.002, p01: 0.0041, median: 0.0123, p99: 0.0302, max: 0.31 },
        }],
        held: (rate > 50.0).then_some(Held { repeats: 71_000, modal_run: 25, update_interval_s: 0.25 }),
    }
}

fn topic(i: usize) -> TopicHealth {
    TopicHealth {
        name: format!("/mavros/topic_{i:02}/data"),
        type_name: "geometry_msgs/TwistStamped".into(),
        encoding: "cdr".into(),
        messages: 1000 * i as u64,
        payload_bytes: 123_456 * i as u64,
        stamps: vec![stamps(10.0, 1)],
        decoded: i < 3,
        reason: if i == 7 { "type definition is missing".into() } else { String::new() },
    }
}

fn log() -> LogHealth {
    LogHealth {
        format: "MCAP, profile ros2, library libmcap 1.4.0".into(),
        bytes: ByteLedger {
            size: 48_237_551,
            decoded: 40_000_000,
            skipped: 8_000_000,
            structure: 233_455,
            damaged: 4_096,
            tail_cut: 0,
        },
        messages: 212_004,
        undecodable: 3,
        damage: vec![DamagedRange {
            file: "flight-07.mcap".into(),
            offset: 31_887_360,
            length: 4_096,
            reason: "chunk: CRC-32 is 0x8d2f11a0, the header says 0x11e0ffab".into(),
            after_ns: Some(112_480_000_000),
        }],
        damage_count: 1,
        topics: (0..18).map(topic).collect(),
        extras: vec!["params.yaml (attachment, 8231 bytes)".into()],
        about: flight::About::default(),
        utc: None,
    }
}

fn binding() -> Binding {
    Binding {
        map: "mavros".into(),
        why: "binds position.gps and velocity.ekf; the topics are its own".into(),
        others: vec![MapCandidate {
            map: "navsatfix-twist".into(),
            binds: vec!["position.gps".into()],
            why: "no velocity topic of its kind".into(),
        }],
        channels: vec![
            channel("position.gps", Quantity::PositionGeodetic, 4.0),
            channel("velocity.ekf", Quantity::VelocityNed, 100.0),
        ],
    }
}

fn notices() -> Notices {
    let mut notices = Notices::new();
    notices.push(
        Code::Assumption.at(Severity::Info),
        "/mavros/position.gps",
        1,
        "height stands for the ellipsoidal one",
    );
    notices.push(Code::DuplicateStamp, "/mavros/position.gps", 12, "12 rows repeat the stamp before");
    notices.push(
        Code::Corrupt,
        "flight-07.mcap, byte 31887360",
        4_096,
        "a chunk fails its checksum; its messages are not used",
    );
    notices
}

fn pipeline() -> PipelineUse {
    PipelineUse {
        title: "Replay with the delay of Park and Lee 2010".into(),
        blake3: "5f3c0f6e".repeat(8),
        toml: "title = \"Replay\"\n\n[delay]\nposition_s = 0.4\nuncertainty_s = 0.0065\n\n[replay]\nstart = \"warm\"\n"
            .into(),
    }
}

/// A flight with results, damage and notices.
pub fn flight_record() -> FlightRecord {
    FlightRecord {
        record_version: RECORD_VERSION,
        analysis_version: 1,
        key: "9b1d44aa".repeat(8),
        inputs: vec![InputFile { name: "flight-07.mcap".into(), bytes: 48_237_551, blake3: "c01dbeef".repeat(8) }],
        pipeline: pipeline(),
        outcome: Outcome::Compensated,
        log: Some(log()),
        binding: Some(binding()),
        trial: None,
        replay: Some(replay()),
        delays: Some(delays()),
        lateness: None,
        network: None,
        decision: None,
        effect: Some(helped()),
        criteria: None,
        test: None,
        notices: notices(),
        details: vec![],
    }
}

/// An effect judged against the truth.
pub fn helped() -> Effect {
    Effect {
        verdict: EffectVerdict::Helped,
        judged_by: JudgedBy::Truth("position.truth".into()),
        error_raw_m: Some(estimate(7.03, 0.1)),
        error_compensated_m: Some(estimate(0.037, 0.002)),
        best_m: Some(0.031),
        short_by: None,
        words: "helped: 7.03 → 0.04 m (against position.truth)".into(),
    }
}

/// A flight that could not be opened: every option is `None`.
pub fn failed_record() -> FlightRecord {
    FlightRecord {
        outcome: Outcome::Failed {
            reason: "flight-09.bag: byte 4096: the record's length 4294967295 is longer than the file".into(),
        },
        log: None,
        binding: None,
        trial: None,
        replay: None,
        delays: None,
        effect: None,
        notices: Notices::new(),
        ..flight_record()
    }
}

/// A readable flight without results.
pub fn parked_record() -> FlightRecord {
    FlightRecord {
        outcome: Outcome::NotMeasurable {
            reason: "95 % of the ground speed is below 0.11 m/s, at least 3 m/s is needed: fly a circuit".into(),
        },
        trial: None,
        replay: None,
        effect: None,
        delays: Some(FlightDelays { pairs: vec![still_pair()] }),
        ..flight_record()
    }
}

/// A row of the campaign table; every 7th flight lost data, every 11th failed, every 13th did not move.
pub fn row(i: usize) -> FlightRow {
    let outcome = match i {
        _ if i % 11 == 10 => {
            Outcome::Failed { reason: format!("flight-{i:04}.bag: no index and no record at byte 13") }
        }
        _ if i % 13 == 12 => Outcome::NotMeasurable { reason: "the aircraft never moves".into() },
        _ => Outcome::Compensated,
    };
    let done = outcome == Outcome::Compensated;
    let x = i as f64;
    let speed = 12.0 + 8.0 * (x * 0.7).sin();
    let some = |value: f64| done.then_some(value);
    FlightRow {
        flight: format!("2026-11-{:02}/flight-{i:04}.mcap", i % 28 + 1),
        key: format!("{i:064x}"),
        page: format!("flights/2026-11-{:02}-flight-{i:04}/index.html", i % 28 + 1),
        outcome,
        lossy: i % 7 == 6,
        minor_loss: false,
        damage: None,
        tail_cut_bytes: if i % 7 == 3 { 23 } else { 0 },
        format: "MCAP, ros2".into(),
        map: done.then(|| "mavros".into()),
        bytes: 48_000_000 + 1_000 * i as u64,
        duration_s: some(600.0 + x),
        position: Some("position.gps".into()),
        velocity: Some("velocity.ekf".into()),
        position_rate_hz: Some(4.0),
        velocity_rate_hz: Some(100.0),
        speed_median_mps: some(speed),
        delay_s: some(TD),
        measured_delay_s: done.then(|| estimate(TD + 0.001 * (x * 1.7).sin(), 0.002)),
        delay_from: done.then_some(DelaySource::Fixed),
        card_delay_s: None,
        flown_at: None,
        track_sketch_m: None,
        sweep: None,
        correction_rms_m: done.then(|| estimate(speed * TD * (1.02 + 0.02 * (x * 1.3).cos()), 0.05)),
        raw_error_rms_m: (done && i.is_multiple_of(2)).then(|| estimate(7.0, 0.1)),
        pade_error_rms_m: (done && i.is_multiple_of(2)).then(|| estimate(0.0371, 0.002)),
        exact_error_rms_m: (done && i.is_multiple_of(2)).then(|| estimate(0.0197, 0.001)),
        criteria: None,
        cards: vec![],
        lateness: None,
        decision: None,
        effect: None,
        duplicate_of: None,
        valid_share: some(1.0 - 0.3 * (x * 0.37).sin().abs()),
        warnings: i as u64 % 4,
        losses: u64::from(i % 7 == 6),
        attention: if i % 7 == 6 { vec!["4096 bytes of the log are damaged".to_owned()] } else { vec![] },
    }
}

/// A campaign with the given number of flights.
pub fn campaign_record(flights: usize) -> CampaignRecord {
    let rows: Vec<FlightRow> = (0..flights).map(row).collect();
    let count = |wanted: fn(&FlightRow) -> bool| rows.iter().filter(|r| wanted(r)).count() as u64;
    CampaignRecord {
        record_version: RECORD_VERSION,
        analysis_version: 1,
        flightlag_version: "0.1.0".into(),
        name: "Goheung autumn campaign".into(),
        pipeline: pipeline(),
        command: "flightlag campaign flights --pipeline pipelines/replay.toml --out reports/goheung".into(),
        criteria: None,
        test: None,
        groups: vec![],
        ignored: (0..5)
            .map(|i| IgnoredInput { path: format!("notes/{i}.txt"), reason: "no reader knows this format".into() })
            .chain([IgnoredInput { path: "empty.csv".into(), reason: "the file is empty".into() }])
            .collect(),
        totals: CampaignTotals {
            flights: flights as u64,
            compensated: count(|r| r.outcome == Outcome::Compensated),
            uncompensated: 0,
            harmed: 0,
            helped: 0,
            varying: 0,
            not_measurable: count(|r| matches!(r.outcome, Outcome::NotMeasurable { .. })),
            pending: count(|r| matches!(r.outcome, Outcome::Pending { .. })),
            failed: count(|r| matches!(r.outcome, Outcome::Failed { .. })),
            lossy: count(|r| r.lossy),
            bytes: rows.iter().map(|r| r.bytes).sum(),
            duration_s: rows.iter().filter_map(|r| r.duration_s).sum(),
        },
        flights: rows,
    }
}
