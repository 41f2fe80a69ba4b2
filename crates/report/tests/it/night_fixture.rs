//! A night with one change of each kind, its trend, and two reports that are compared.

use record::{
    CampaignTotals, ChangeCause, ComparedReport, DiffRecord, Estimate, FlightWords, LeftLog, MovedAdvice, MovedDelay,
    MovedNumber, NamedFlight, NewTrendChange, NightCampaign, NightGroup, NightRecord, ProofVerdict, RECORD_VERSION,
    RerunCause, RunChanges, SettingProof, TrendChange, TrendChart, TrendPoint, TrendRecord, TrendSegment,
};

fn late(value: f64, u: f64) -> Estimate {
    Estimate { value, standard_uncertainty: Some(u) }
}

fn flight(k: u32) -> NamedFlight {
    NamedFlight {
        campaign: "autumn".into(),
        flight: format!("2026-11-{:02}/flight-{k:02}.ulg", k + 1),
        page: (k != 3).then(|| format!("autumn/flights/flight-{k:02}/index.html")),
    }
}

fn flown_at(k: u32) -> Option<String> {
    Some(format!("2026-11-{:02}T10:00:00Z", k + 1))
}

fn change() -> TrendChange {
    TrendChange {
        at: flight(8),
        flown_at: flown_at(8),
        earliest: flight(7),
        latest: flight(9),
        step_s: late(0.06, 0.004),
        sigmas: 15.0,
        with_it: vec!["firmware: was 1.14, is 1.15".into()],
    }
}

/// Sixteen flights, 60 ms later from the ninth on, the fourth outside its limits.
pub fn trend() -> TrendRecord {
    let point = |k: u32| TrendPoint {
        flight: flight(k),
        flown_at: flown_at(k),
        lateness_s: late(0.2 + f64::from(k % 3) * 0.001 + if k < 8 { 0.0 } else { 0.06 }, 0.002),
        centre_s: if k < 8 { 0.2 } else { 0.26 },
        limit_s: 0.009,
        is_outside: k == 3,
        is_odd: k == 3,
    };
    let segment = |from: u32, to: u32, mean_s: f64| TrendSegment {
        first: flight(from),
        last: flight(to),
        flights: u64::from(to - from + 1),
        mean_s: late(mean_s, 0.001),
    };
    let chart = |value: &str, changes: Vec<TrendChange>| TrendChart {
        dimension: "receiver".into(),
        value: value.into(),
        datum: "velocity.gps".into(),
        between_s: 0.001,
        threshold: Some(3.9),
        older_points: 2,
        points: (0..16).map(point).collect(),
        segments: if changes.is_empty() {
            vec![segment(0, 15, 0.23)]
        } else {
            vec![segment(0, 7, 0.2), segment(8, 15, 0.26)]
        },
        changes,
    };
    TrendRecord {
        record_version: RECORD_VERSION,
        false_alarm: 0.01,
        every_look: true,
        charts: vec![chart("u-blox F9P", vec![]), chart("u-blox M8", vec![change()])],
        left_out: vec!["autumn/odd.ulg: no lateness".into()],
        without_change: 3,
    }
}

fn changes() -> RunChanges {
    let words = |k: u32, word: &str| FlightWords {
        flight: flight(k),
        words: vec![word.into()],
        error: (k == 5).then(|| "flight-05.ulg: truncated at byte 13".into()),
        texts: vec![format!("what flight {k} says")],
    };
    let moved = |k: u32, sigmas: Option<f64>| MovedNumber {
        flight: flight(k),
        quantity: "lateness of position.gps".into(),
        unit: "ms".into(),
        before: late(0.2, 0.002),
        now: late(0.21, 0.002),
        sigmas,
        causes: vec![ChangeCause::Build, ChangeCause::Settings],
    };
    RunChanges {
        compared: 14,
        new: vec![flight(0)],
        new_answers: vec!["position.gps is 210 ± 4 ms late. Removing 210 ms helped.".into()],
        gone: vec![flight(1)],
        rerun: vec![RerunCause { flight: flight(2), causes: vec![ChangeCause::Log] }],
        moved: vec![moved(3, Some(3.5)), moved(4, None)],
        failing: vec![words(5, "failed"), words(0, "log damaged")],
        new_not_measurable: vec![flight(6)],
        recovered: vec![words(7, "harmed")],
        verdicts: vec![words(13, "FAIL → INCONCLUSIVE, because of criteria")],
        alarms_new: vec![words(8, "changes during the flight")],
        alarms_cleared: vec![words(9, "differs from its group")],
        remarks_new: vec![words(10, "guessed columns")],
        remarks_cleared: vec![words(11, "one clock is unknown")],
        advice: vec![MovedAdvice {
            flight: flight(12),
            parameter: "GPS_DELAY_MS".into(),
            before_s: Some(0.2),
            now_s: None,
        }],
    }
}

/// The morning after.
pub fn night() -> NightRecord {
    let new = |chart: &str| NewTrendChange { chart: chart.into(), change: change() };
    NightRecord {
        record_version: RECORD_VERSION,
        title: "Test fleet".into(),
        run_id: "2026-11-29T02-00-00Z".into(),
        started: "2026-11-29T02:00:00Z".into(),
        seconds: 754.0,
        flightlag_version: "0.1.0".into(),
        before: Some("2026-11-28T02-00-00Z".into()),
        exit: 3,
        summary: vec!["2 campaigns, 16 flights".into(), "1 flight failed".into()],
        campaigns: vec![
            NightCampaign {
                name: "autumn".into(),
                flights: "/data/autumn".into(),
                report: "autumn/index.html".into(),
                totals: Some(CampaignTotals {
                    flights: 16,
                    compensated: 12,
                    not_measurable: 2,
                    failed: 1,
                    lossy: 1,
                    harmed: 1,
                    helped: 9,
                    ..CampaignTotals::default()
                }),
                criteria_failed: 2,
                exit: 3,
                error: None,
                nothing_changed: false,
            },
            NightCampaign {
                name: "spring".into(),
                flights: "/data/spring".into(),
                report: "spring/index.html".into(),
                totals: None,
                criteria_failed: 0,
                exit: 1,
                error: Some("/data/spring: no such folder".into()),
                nothing_changed: false,
            },
        ],
        changes: changes(),
        left: vec![LeftLog { campaign: "autumn".into(), path: "x/y.ulg".into(), reason: "out of memory".into() }],
        groups: vec![NightGroup {
            campaign: "autumn".into(),
            group: "u-blox M8".into(),
            words: "no common delay: position 200 to 260 ms later".into(),
            is_new: true,
        }],
        new_trend_changes: vec![new("receiver u-blox M8")],
        withdrawn_trend_changes: vec![new("receiver u-blox F9P")],
        trend: trend(),
        proofs: vec![SettingProof {
            campaign: "autumn".into(),
            of: "u-blox M8".into(),
            parameter: "GPS_DELAY_MS".into(),
            recommended_by: "2026-11-20".into(),
            was_s: Some(0.0),
            recommended_s: 0.2,
            set_s: Some(0.2),
            before_s: Some(late(0.2, 0.002)),
            predicted_s: late(0.0, 0.003),
            measured_s: Some(late(0.002, 0.002)),
            flights: vec![flight(13), flight(14)],
            verdict: ProofVerdict::Pass,
            words: "the lateness is as predicted".into(),
        }],
        problems: vec!["history.parquet was locked for 3 s".into()],
    }
}

/// Two reports with other settings and a group that moved.
pub fn diff() -> DiffRecord {
    let report = |folder: &str, version: &str| ComparedReport {
        folder: folder.into(),
        name: "autumn".into(),
        flights: 16,
        flightlag_version: version.into(),
        analysis_version: 37,
        settings: "Replay".into(),
        settings_blake3: "ab".repeat(32),
        criteria_blake3: (folder == "now").then(|| "cd".repeat(32)),
    };
    DiffRecord {
        record_version: RECORD_VERSION,
        before: report("before", "0.1.0"),
        now: report("now", "0.2.0"),
        settings: vec!["delay.position_s: was 0.4, is 0.35".into()],
        changes: changes(),
        moved_groups: vec![MovedDelay {
            name: "u-blox M8".into(),
            before_s: late(0.2, 0.001),
            now_s: late(0.21, 0.001),
            sigmas: 7.07,
        }],
    }
}
