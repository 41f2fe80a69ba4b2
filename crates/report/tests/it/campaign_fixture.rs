//! Large campaigns with varied receivers, dates, alarms, criteria and effects, for tests, specimen and browser.

use record::{
    CampaignCriteria, CampaignDelay, CampaignRecord, CampaignTotals, ChannelLateness, ControlPoint, CriteriaUse,
    CriterionSummary, CriterionVerdict, Decision, DelayAdvice, DelayAlarm, DelayKind, DelayOverFlights, DelaySetting,
    DelaySource, Effect, EffectVerdict, Estimate, Finding, FlightHomogeneity, FlightLateness, FlightRow, FlightsDiffer,
    Gravity, GroupLateness, IgnoredInput, JudgedBy, NetworkDatum, Outcome, PassRate, PipelineUse, PooledSweep,
    RECORD_VERSION, ReceiverGroup, RowVerdict, RowVerdicts, VerdictTally,
};

/// Name and lateness (s) of each receiver; half the flights have the first.
const RECEIVERS: [(&str, f64); 4] = [
    ("u-blox F9P 1.32, 5 Hz, 115200 baud, ArduPilot DataFlash", 0.203),
    ("u-blox M8 3.01, 5 Hz, 38400 baud, PX4 ULog", 0.118),
    ("VectorNav VN-200 2.1.0, 10 Hz, VectorNav CSV", 0.0465),
    ("unknown receiver of map g1000, 1 Hz, Garmin G1000 CSV", 0.31),
];
const CRITERIA: [&str; 6] = [
    "Delay of the position is at most 150 ms",
    "Error after compensation is at most 1 m",
    "Position at 4 Hz or more",
    "Valid for 99 % of the time",
    "No damaged bytes",
    "Delay does not change",
];
/// Delay that was removed from all flights, s.
pub const REMOVED_S: f64 = 0.2;

fn estimate(value: f64, u: f64) -> Estimate {
    Estimate { value, standard_uncertainty: Some(u) }
}

/// A number between 0 and 1, determined by the arguments alone.
fn chance(i: usize, salt: u64) -> f64 {
    let mut x = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ salt.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 31)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 29)) >> 11) as f64 / (1u64 << 53) as f64
}

fn receiver(i: usize) -> usize {
    [0.5, 0.8, 0.95, 1.0].iter().position(|end| chance(i, 1) < *end).unwrap_or(3)
}

fn group(k: usize) -> ReceiverGroup {
    let name = RECEIVERS[k].0.to_owned();
    ReceiverGroup { key: format!("receiver={k}"), name, parts: vec![], told_by_log: k < 3 }
}

/// Lateness of a flight, s: every fortieth is off by 40 ms.
fn late_s(i: usize) -> f64 {
    let off = if i % 40 == 17 { 0.04 } else { 0.0 };
    RECEIVERS[receiver(i)].1 + off + 0.002 * (chance(i, 2) + chance(i, 3) - 1.0)
}

fn is_outlier(i: usize) -> bool {
    i % 40 == 17
}

fn alarms(i: usize) -> Vec<DelayAlarm> {
    let alarm = |gravity, code: &str, text: String| DelayAlarm { gravity, code: code.into(), text };
    match i % 23 {
        4 => {
            vec![alarm(Gravity::Amber, "delay-steps", format!("the delay steps by {} ms at {} s", 12 + i % 9, 100 + i))]
        }
        11 => vec![alarm(
            Gravity::Red,
            "two-delays-fit",
            format!("two delays fit: {} and {} ms", 100 + i % 50, 480 + i % 7),
        )],
        _ => vec![],
    }
}

fn lateness(i: usize) -> FlightLateness {
    let late = estimate(late_s(i), 0.004 + 0.004 * chance(i, 4));
    FlightLateness {
        reference_file: None,
        key: format!("m{i}"),
        failed: None,
        position: Some("position.gps".into()),
        velocity: Some("velocity.ekf".into()),
        group: group(receiver(i)),
        content: None,
        kind: if i % 23 == 4 { DelayKind::NotTested } else { DelayKind::Constant },
        also: vec![],
        words: "position.gps is late against the IMU".into(),
        lateness: Some(ChannelLateness {
            channel: "position.gps".into(),
            lateness_s: late,
            model_uncertainty_s: 0.004,
            interval_95_s: [late.value - 0.016, late.value + 0.016],
            part: 0,
            datum: NetworkDatum::Imu,
            relative_to: None,
            derived: false,
            weak: false,
            at_least_s: None,
            filter_not_a_delay: None,
            earlier_than_datum: false,
            against_refused_datum_s: None,
            rests_on: None,
        }),
        datum: NetworkDatum::Imu,
        against: "imu".into(),
        verdict: None,
        position_minus_velocity_s: Some(estimate(late.value - 0.01, 0.001)),
        card: None,
        speed_rms_mps: Some(17.5),
        acceleration_rms_mps2: Some(2.0),
        jitter_s: None,
        lever_arm_s_per_decimetre: None,
        other_receivers: vec![],
        checked_against: None,
        alarms: alarms(i),
        advice: DelayAdvice::default(),
    }
}

fn effect(i: usize) -> Effect {
    let speed = 10.0 + 10.0 * chance(i, 5);
    let (raw, after) = (speed * late_s(i), speed * (late_s(i) - REMOVED_S).abs() + 0.02);
    let verdict = if after > raw { EffectVerdict::Harmed } else { EffectVerdict::Helped };
    Effect {
        verdict,
        judged_by: JudgedBy::Lateness,
        error_raw_m: Some(estimate(raw, 0.05 * raw)),
        error_compensated_m: Some(estimate(after, 0.05 * after)),
        best_m: Some(0.02),
        short_by: (after > 0.1).then_some(after / 0.02),
        words: format!("{}: error {raw:.2} m, after {after:.2} m", if after > raw { "harmed" } else { "helped" }),
    }
}

fn verdicts(i: usize) -> RowVerdicts {
    let of = |k: usize| match chance(i, 10 + k as u64) {
        x if x < 0.04 => CriterionVerdict::Fail,
        x if x < 0.08 => CriterionVerdict::Inconclusive,
        x if x < 0.12 => CriterionVerdict::NotEvaluated,
        _ => CriterionVerdict::Pass,
    };
    let each: Vec<RowVerdict> =
        (0..CRITERIA.len()).map(|k| RowVerdict { id: format!("c{k}"), verdict: of(k), words: String::new() }).collect();
    RowVerdicts { overall: each.iter().map(|v| v.verdict).min().unwrap(), each }
}

/// Flight `i`: one in 29 is unreadable, one in 31 has no delay, one in 13 is damaged.
pub fn row(i: usize) -> FlightRow {
    let outcome = match i {
        _ if i % 29 == 28 => Outcome::Failed { reason: format!("no channel map fits flight-{i:04}; nearest is g1000") },
        _ if i % 31 == 30 => Outcome::NotMeasurable { reason: "the aircraft never turns".into() },
        _ => Outcome::Compensated,
    };
    let done = outcome == Outcome::Compensated;
    let read = !matches!(outcome, Outcome::Failed { .. });
    let lossy = i % 13 == 12;
    let day = i / 4;
    let flown_at = jiff::civil::date(2026, 3, 1).checked_add(jiff::Span::new().days(day as i64)).unwrap();
    let mut attention: Vec<String> = if read { alarms(i).into_iter().map(|a| a.text).collect() } else { vec![] };
    if lossy {
        attention.push(format!("{} bytes of the log are damaged", 512 + i));
    }
    FlightRow {
        flight: format!("{flown_at}/flight-{i:04}.mcap"),
        key: format!("{i:064x}"),
        page: format!("flights/{flown_at}-flight-{i:04}/index.html"),
        outcome,
        lossy,
        minor_loss: false,
        damage: None,
        tail_cut_bytes: if i % 7 == 3 { 23 } else { 0 },
        format: "MCAP, ros2".into(),
        map: read.then(|| "mavros".into()),
        bytes: 48_000_000 + 1_000 * i as u64,
        duration_s: done.then_some(600.0 + i as f64),
        position: read.then(|| "position.gps".into()),
        velocity: read.then(|| "velocity.ekf".into()),
        position_rate_hz: read.then_some(5.0),
        velocity_rate_hz: read.then_some(50.0),
        speed_median_mps: done.then(|| 10.0 + 10.0 * chance(i, 5)),
        delay_s: done.then_some(REMOVED_S),
        measured_delay_s: done.then(|| estimate(late_s(i) - 0.01, 0.001)),
        delay_from: done.then_some(DelaySource::Fixed),
        card_delay_s: (receiver(i) == 0).then(|| estimate(0.2012, 0.002)),
        flown_at: read.then(|| format!("{flown_at}T{:02}:{:02}:07.250Z", 8 + 2 * (i % 4), i % 60)),
        track_sketch_m: done.then(|| track_sketch(i)),
        sweep: None,
        correction_rms_m: done.then(|| estimate(3.1, 0.05)),
        raw_error_rms_m: None,
        pade_error_rms_m: None,
        exact_error_rms_m: None,
        valid_share: done.then(|| 1.0 - 0.1 * chance(i, 6)),
        criteria: Some(verdicts(i)),
        lateness: read.then(|| lateness(i)).map(|l| if done { l } else { FlightLateness { lateness: None, ..l } }),
        decision: done.then(|| Decision {
            asked: DelaySource::Fixed,
            row: 5,
            used: Some(DelaySource::Fixed),
            delay_s: Some(REMOVED_S),
            standard_uncertainty_s: None,
            circular: false,
            words: "stated".into(),
            contradicted: None,
        }),
        effect: done.then(|| effect(i)),
        cards: vec![],
        duplicate_of: None,
        attention,
        warnings: i as u64 % 4,
        losses: u64::from(lossy),
    }
}

/// Four circuits with eight corners each: the number of points in a sketch.
fn track_sketch(i: usize) -> String {
    let corner = |k: usize| {
        let angle = std::f64::consts::TAU * k as f64 / 8.0;
        let radius = 200.0 + 150.0 * chance(i, 7 + k as u64);
        format!("{:.0},{:.0}", radius * angle.sin(), radius * angle.cos())
    };
    (0..32).map(corner).collect::<Vec<_>>().join(" ")
}

fn group_lateness(k: usize, rows: &[(usize, &FlightRow)]) -> GroupLateness {
    let of: Vec<&(usize, &FlightRow)> =
        rows.iter().filter(|(i, r)| receiver(*i) == k && r.lateness.is_some()).collect();
    let timed: Vec<&&(usize, &FlightRow)> = of.iter().filter(|(_, r)| r.delay_s.is_some()).collect();
    let mean = estimate(RECEIVERS[k].1, 0.0005);
    let velocity = |e: Estimate| estimate(e.value - 0.01, 0.0004);
    let control = timed.iter().map(|(i, r)| ControlPoint {
        flight: r.flight.clone(),
        flown_at: r.flown_at.clone(),
        delay_s: r.measured_delay_s.unwrap(),
        centre_s: RECEIVERS[k].1 - 0.01,
        limit_s: 0.006,
        is_outside: is_outlier(*i),
    });
    let over = DelayOverFlights {
        flights: timed.len() as u64,
        delay_s: velocity(mean),
        between_s: Some(0.0008),
        homogeneity: Some(FlightHomogeneity { chi2: 41.0, degrees_of_freedom: 40, p: 0.43 }),
    };
    let delay_s: Vec<f64> = (0..=60).map(|k| 0.005 * f64::from(k)).collect();
    let rms_m = delay_s.iter().map(|d| 0.1 + 15.0 * (d - mean.value).abs()).collect();
    let curve = PooledSweep { against_reference: false, flights: timed.len() as u64, samples: 71_000, rms_m, delay_s };
    GroupLateness {
        group: group(k),
        flights: of.len() as u64,
        pooled: timed.len() as u64,
        lateness_s: (!timed.is_empty()).then_some(mean),
        interval_95_s: Some([mean.value - 0.001, mean.value + 0.001]),
        against: "imu".into(),
        between_s: Some(0.0008),
        words: "position late against imu".into(),
        outliers: timed.iter().filter(|(i, _)| is_outlier(*i)).map(|(_, r)| r.flight.clone()).collect(),
        advice: DelayAdvice {
            set: vec![DelaySetting {
                name: "position_s".into(),
                value: mean.value,
                unit: "s".into(),
                in_log: None,
                note: String::new(),
                unsuitable: false,
            }],
            fly: None,
        },
        members: of.iter().map(|(_, r)| r.flight.clone()).collect(),
        split: None,
        difference: Some(FlightsDiffer { q: 41.0, degrees_of_freedom: 40, p: 0.41, i2: 0.0, tau_s: 0.0008 }),
        consistency: (timed.len() > 1).then(|| CampaignDelay {
            measured: Finding::Found(over),
            swept: Finding::Found(over),
            card_s: (k == 0).then(|| estimate(0.1912, 0.002)),
            control: control.collect(),
            in_time_order: true,
            curve: Finding::Found(curve),
        }),
    }
}

fn criteria(rows: &[FlightRow]) -> CampaignCriteria {
    let used = CriteriaUse {
        title: "Autumn".into(),
        file: "autumn.toml".into(),
        blake3: "ab".repeat(32),
        toml: "schema = 1\n".into(),
    };
    let rate = |tally: &VerdictTally| {
        let judged = tally.pass + tally.fail + tally.inconclusive;
        let share = tally.pass as f64 / judged as f64;
        (judged > 0).then_some(PassRate {
            passed: tally.pass,
            judged,
            interval_95: [share * 0.9, (share * 1.1).min(1.0)],
        })
    };
    let summary = |k: usize| {
        let of = |row: &FlightRow| row.criteria.as_ref().unwrap().each[k].verdict;
        let tally: VerdictTally = rows.iter().map(of).collect();
        CriterionSummary {
            id: format!("c{k}"),
            title: CRITERIA[k].into(),
            metric: "delay".into(),
            limit: "≤ 150 ms".into(),
            pass_rate: rate(&tally),
            failed: rows.iter().filter(|r| of(r) == CriterionVerdict::Fail).map(|r| r.flight.clone()).collect(),
            never_evaluated: None,
            tally,
        }
    };
    let flights: VerdictTally = rows.iter().map(|r| r.criteria.as_ref().unwrap().overall).collect();
    CampaignCriteria {
        criteria: used,
        pass_rate: rate(&flights),
        flights,
        each: (0..CRITERIA.len()).map(summary).collect(),
    }
}

/// A campaign with the given number of flights.
pub fn varied(flights: usize) -> CampaignRecord {
    let rows: Vec<FlightRow> = (0..flights).map(row).collect();
    let count = |wanted: &dyn Fn(&FlightRow) -> bool| rows.iter().filter(|r| wanted(r)).count() as u64;
    let effect = |wanted: EffectVerdict| count(&|r| r.effect.as_ref().is_some_and(|e| e.verdict == wanted));
    let numbered: Vec<(usize, &FlightRow)> = rows.iter().enumerate().collect();
    let groups: Vec<GroupLateness> =
        (0..RECEIVERS.len()).map(|k| group_lateness(k, &numbered)).filter(|g| g.flights > 0).collect();
    let ignored =
        (0..7).map(|i| IgnoredInput { path: format!("notes/{i}.txt"), reason: "no reader knows this format".into() });
    CampaignRecord {
        record_version: RECORD_VERSION,
        analysis_version: 1,
        flightlag_version: "0.1.0".into(),
        name: "Goheung autumn campaign".into(),
        pipeline: PipelineUse { title: "A stated delay".into(), blake3: "cd".repeat(32), toml: "schema = 1\n".into() },
        command: "flightlag campaign flights --pipeline p.toml --out REPORT".into(),
        criteria: Some(criteria(&rows)),
        test: None,
        groups,
        ignored: ignored.collect(),
        totals: CampaignTotals {
            flights: flights as u64,
            compensated: count(&|r| r.outcome == Outcome::Compensated),
            uncompensated: 0,
            not_measurable: count(&|r| matches!(r.outcome, Outcome::NotMeasurable { .. })),
            failed: count(&|r| matches!(r.outcome, Outcome::Failed { .. })),
            pending: 0,
            lossy: count(&|r| r.lossy),
            harmed: effect(EffectVerdict::Harmed),
            helped: effect(EffectVerdict::Helped),
            varying: 0,
            bytes: rows.iter().map(|r| r.bytes).sum(),
            duration_s: rows.iter().filter_map(|r| r.duration_s).sum(),
        },
        flights: rows,
    }
}
