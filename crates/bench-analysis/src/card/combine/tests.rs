use super::*;
use crate::card::example::{channel, record};
use crate::card::{card_text, example, parse_card};
use std::path::Path;

const TERMS: CardTerms<'_> = CardTerms { valid_days: Some(365), flightlag_version: "0.1.0" };

fn named(records: Vec<BenchRecord>) -> Vec<(String, BenchRecord)> {
    records.into_iter().enumerate().map(|(i, r)| (format!("swing-{:02}", i + 1), r)).collect()
}

/// One record for each delay of `position.gps` in ms, each ± 2 ms.
fn runs(delays_ms: &[f64]) -> Vec<(String, BenchRecord)> {
    let of = |(i, ms): (usize, &f64)| {
        record(&format!("2010-10-{:02}", 20 + i), vec![channel("position.gps", ms * 1e-3, 0.002)])
    };
    named(delays_ms.iter().enumerate().map(of).collect())
}

fn reported(combined: &Combined) -> Vec<(&str, &str)> {
    combined.notices.iter().map(|n| (n.code.as_str(), n.place.as_str())).collect()
}

#[test]
fn a_card_of_one_record_is_that_record() {
    let combined = combine(&runs(&[400.0]), &TERMS).unwrap();
    let card = &combined.card;
    let [position] = card.channels.as_slice() else { panic!("{card:?}") };
    assert_eq!((position.delay_s, position.delay_standard_uncertainty_s), (0.4, 0.002));
    assert_eq!((position.as_seen_delay_s, position.gain), (Some(0.525), 1.0));
    assert_eq!((position.records, position.between_runs_s, position.verdict), (1, None, Verdict::Delayed));
    assert_eq!(card.measured_on.as_deref(), Some("2010-10-20"));
    assert_eq!(card.valid_until.as_deref(), Some("2011-10-20"), "365 days");
    assert_eq!(card.records[0].blake3, ["hash of 2010-10-20"]);
    assert!(combined.notices.is_empty());
    assert_eq!(parse_card(&card_text(card), Path::new("c")).unwrap(), *card);
}

/// Former bug: three copies of one file were three records, and U was smaller than that of the file alone.
#[test]
fn a_copy_of_a_recording_is_left_out_and_reported() {
    let mut all = runs(&[400.0, 404.0, 400.0]);
    all[2].1.logs = all[0].1.logs.clone();
    let combined = combine(&all, &TERMS).unwrap();
    assert_eq!(combined.card.channels[0].records, 2);
    let copy = combined.notices.iter().find(|n| n.place == "swing-03").unwrap();
    assert_eq!((copy.code.as_str(), copy.text.as_str()), ("left-off-card", "not on the card: a copy of swing-01"));
}

#[test]
fn records_that_differ_by_more_than_stated_widen_the_uncertainty() {
    let combined = combine(&runs(&[390.0, 400.0, 410.0]), &TERMS).unwrap();
    let position = &combined.card.channels[0];
    assert!((position.delay_s - 0.4).abs() < 1e-9);
    // s = 10 ms, u = 2 ms: τ² = 100 − 4, and s t/(1.96 √3) with t = 4.3027.
    assert!((position.between_runs_s.unwrap() - 0.096f64.sqrt() / 31.622_776_601_683_793).abs() < 1e-9);
    assert!((position.delay_standard_uncertainty_s - 0.01 / 3f64.sqrt() * 4.302_653 / 1.959_964).abs() < 1e-8);
    assert_eq!(position.verdict, Verdict::Delayed);
    assert_eq!(combined.card.measured_on.as_deref(), Some("2010-10-22"), "the newest record");
    assert_eq!(combined.card.valid_from.as_deref(), Some("2010-10-20"), "the oldest");
}

#[test]
fn errors_common_to_all_records_are_not_averaged_away() {
    let mut all = runs(&[400.0; 5]);
    for (_, record) in &mut all {
        let delay = record.findings.as_mut().unwrap().channels[0].delay.as_mut().unwrap();
        delay.stamps_s = 0.0016;
    }
    let combined = combine(&all, &TERMS).unwrap();
    // Of the 2 ms, 1.6 ms are shared: √(2² − 1.6²) = 1.2 ms are each record's own.
    let expected = (0.0012f64.powi(2) / 5.0 + 0.0016f64.powi(2)).sqrt();
    assert!((combined.card.channels[0].delay_standard_uncertainty_s - expected).abs() < 1e-12);
}

#[test]
fn an_outlying_record_is_excluded_and_named() {
    let combined = combine(&runs(&[400.0, 401.0, 799.0, 399.0, 400.5]), &TERMS).unwrap();
    let position = &combined.card.channels[0];
    assert_eq!((position.outliers.as_slice(), position.records), (["swing-03".to_owned()].as_slice(), 4));
    assert!((position.delay_s - 0.4).abs() < 0.001);
    assert_eq!(reported(&combined), [("left-off-card", "swing-03")]);
}

#[test]
fn a_record_of_another_sensor_is_rejected_with_the_differing_part() {
    let mut all = runs(&[400.0, 400.0]);
    all[1].1.sensor.serial = Some("00500999".into());
    let error = combine(&all, &TERMS).unwrap_err();
    assert_eq!(
        error.to_string(),
        "swing-02: a different sensor from the records before: serial `00500123` and `00500999`"
    );
}

#[test]
fn a_sensor_is_compared_with_all_previous_records() {
    let mut all = runs(&[400.0; 3]);
    all[0].1.sensor.serial = None;
    all[2].1.sensor.serial = Some("other".into());
    assert!(combine(&all, &TERMS).unwrap_err().to_string().starts_with("swing-03"));
}

#[test]
fn a_missing_channel_is_reported_with_its_record_and_reason() {
    let mut all = runs(&[400.0, 400.0]);
    let mut silent = channel("velocity.ins", 0.0, 0.001);
    silent.quantity = Quantity::VelocityNed;
    all[0].1.findings.as_mut().unwrap().channels.push(silent.clone());
    silent.verdict = Verdict::NotMeasurable;
    silent.reason = "the swing does not move it".into();
    all[1].1.findings.as_mut().unwrap().channels.push(silent);
    let combined = combine(&all, &TERMS).unwrap();
    assert_eq!(reported(&combined), [("left-off-card", "swing-02")]);
    assert_eq!(combined.notices.iter().next().unwrap().text, "velocity.ins: the swing does not move it");
    let records: Vec<(&str, u64)> = combined.card.channels.iter().map(|c| (c.name.as_str(), c.records)).collect();
    assert_eq!(records, [("position.gps", 2), ("velocity.ins", 1)]);
}

#[test]
fn channels_missing_for_one_reason_are_reported_once() {
    let mut all = runs(&[400.0, 400.0]);
    for name in ["position.ins", "position.ekf"] {
        all[0].1.findings.as_mut().unwrap().channels.push(channel(name, 0.1, 0.001));
    }
    let combined = combine(&all, &TERMS).unwrap();
    let texts: Vec<&str> = combined.notices.iter().map(|n| n.text.as_str()).collect();
    assert_eq!(texts, ["position.ekf, position.ins: the record has no such channel"]);
}

#[test]
fn the_anchor_is_not_reported_as_left_out() {
    let mut all = runs(&[400.0, 400.0]);
    for (_, record) in &mut all {
        let mut anchor = channel("angular-rate.imu", 0.0, 0.001);
        anchor.basis = TimeBasis::Anchor { channel: "angular-rate.imu".into() };
        anchor.verdict = Verdict::NotMeasurable;
        record.findings.as_mut().unwrap().channels.push(anchor);
    }
    let combined = combine(&all, &TERMS).unwrap();
    assert!(combined.notices.is_empty());
    assert_eq!(combined.card.channels.len(), 1);
}

/// A pure delay of 204 ms fits a lag of 300 ms; one of −821 ms does not.
#[test]
fn lags_that_do_not_explain_the_delay_are_no_lag() {
    let position = example::card().channels.remove(0);
    let lagged = CardChannel { delay_s: 0.204, lags_s: vec![0.3], slow_motion_delay_s: Some(0.3), ..position };
    assert!(lagged.has_lag());
    assert!(!CardChannel { delay_s: -0.821, ..lagged }.has_lag());
}

#[test]
fn an_absolute_and_a_relative_delay_are_not_averaged() {
    let mut all = runs(&[400.0, 700.0]);
    let relative = &mut all[1].1.findings.as_mut().unwrap().channels[0];
    relative.basis = TimeBasis::Anchor { channel: "angular-rate.imu".into() };
    let combined = combine(&all, &TERMS).unwrap();
    assert_eq!(combined.card.channels[0].delay_s, 0.4);
    assert_eq!(reported(&combined), [("not-comparable", "swing-02")]);
    assert!(
        combined.card.method.contains("swing-02: position.gps: measured timestamps, relative to angular-rate.imu: not")
    );
    assert_eq!(combined.card.measured_on.as_deref(), Some("2010-10-20"), "not the day of the record left out");
    assert_eq!((combined.card.channels[0].records, combined.card.records.len()), (1, 2), "measured, if not averaged");
}

#[test]
fn the_model_is_that_of_most_records_or_reported_to_differ() {
    let with = |models: &[(&str, &[f64])]| {
        let mut all = runs(&vec![400.0; models.len()]);
        for ((_, record), (name, lags)) in all.iter_mut().zip(models) {
            record.findings.as_mut().unwrap().channels[0].model = example::model(name, lags);
        }
        let channel = combine(&all, &TERMS).unwrap().card.channels.remove(0);
        (channel.model, channel.lags_s)
    };
    assert_eq!(with(&[("D", &[]), ("D", &[])]), ("delay".into(), vec![]));
    let (model, lags) = with(&[("L", &[0.1]), ("L", &[0.3]), ("D", &[])]);
    assert_eq!((model.as_str(), lags), ("first-order lag (2 of 3 records)", vec![0.2]));
    let (model, lags) = with(&[("L", &[0.1]), ("D", &[])]);
    assert_eq!((model.as_str(), lags), ("differs between records: delay (1), first-order lag (1)", vec![]));
}

#[test]
fn several_records_near_zero_are_judged_by_their_mean() {
    // A single ±4 ms is inconclusive for a margin of 5 ms; sixteen that agree are not: 4/√16 = 1 ms.
    let mut all = runs(&[0.0; 16]);
    for (_, record) in &mut all {
        let channel = &mut record.findings.as_mut().unwrap().channels[0];
        channel.verdict = Verdict::Inconclusive;
        channel.delay.as_mut().unwrap().standard_uncertainty_s = 0.004;
    }
    let position = combine(&all, &TERMS).unwrap().card.channels.remove(0);
    assert!((position.delay_standard_uncertainty_s - 0.001).abs() < 1e-12);
    assert_eq!(position.verdict, Verdict::EquivalentToZero);
}

#[test]
fn a_failed_record_is_reported_and_a_card_without_numbers_rejected() {
    let mut all = runs(&[400.0, 400.0]);
    all[0].1.outcome = BenchOutcome::Failed { reason: "cut off".into() };
    all[0].1.findings = None;
    let combined = combine(&all, &TERMS).unwrap();
    assert_eq!(reported(&combined), [("left-off-card", "swing-01")]);
    assert_eq!(combined.card.records.len(), 1);
    let error = combine(&all[..1], &TERMS).unwrap_err();
    assert!(error.to_string().contains("nothing was measured of Xsens MTi-G 00500123"), "{error}");
    assert!(combine(&[], &TERMS).is_err());
}

#[test]
fn a_card_without_a_day_has_no_validity_and_reports_it() {
    let mut all = runs(&[400.0]);
    all[0].1.date = None;
    let combined = combine(&all, &TERMS).unwrap();
    assert_eq!((combined.card.valid_until, codes_of(&combined.notices)), (None, vec!["card-conditions"]));
}

fn codes_of(notices: &Notices) -> Vec<&str> {
    notices.iter().map(|n| n.code.as_str()).collect()
}

/// Sign, lever arm, azimuth or mount: an error in the rig file affects every channel measured with it.
#[test]
fn a_record_that_contradicts_its_rig_file_marks_its_channels() {
    let check = |name: &str, of_rig: bool, agrees: Option<bool>| record::MountCheck {
        name: name.into(),
        unit: "m".into(),
        fitted: record::Finding::Found(Estimate { value: 1.201, standard_uncertainty: Some(0.002) }),
        stated: Some(1.3),
        agrees,
        of_rig,
        text: String::new(),
    };
    let mut all = runs(&[400.0, 401.0, 399.0]);
    let findings = all[1].1.findings.as_mut().unwrap();
    findings.mount.checks = vec![
        check("lever arm z of imu", true, Some(false)),
        check("lever arm x of imu", true, Some(true)),
        check("azimuth by imu", true, None),
        check("scale of imu", false, Some(false)),
    ];
    all[2].1.notices.push(Code::RigContradicted, record::ENCODER_SIGN, 1, "the other way round");
    let combined = combine(&all, &TERMS).unwrap();
    let position = &combined.card.channels[0];
    let arm = "swing-02: lever arm z of imu: 1.2010 ± 0.0040 m by the data, 1.3000 m by the rig file";
    assert_eq!(position.contradicted, [arm, "swing-03: the other way round"]);
    assert_eq!(reported(&combined), [("rig-contradicted", "swing-02"), ("rig-contradicted", "swing-03")]);
    assert_eq!(parse_card(&card_text(&combined.card), Path::new("c")).unwrap(), combined.card);
    assert!(combine(&runs(&[400.0]), &TERMS).unwrap().card.channels[0].contradicted.is_empty());
}

#[test]
fn an_encoder_whose_angle_scatters_marks_the_channels() {
    let mut all = runs(&[400.0, 401.0, 399.0]);
    let check =
        |passed: bool, text: &str| record::GateCheck { name: "encoder residual".into(), passed, text: text.into() };
    let of = |record: &mut BenchRecord, check| record.findings.as_mut().unwrap().gate.checks.push(check);
    of(&mut all[0].1, check(true, "0.30 counts rms about the smoothed motion, as a quantiser leaves (0.29)"));
    of(
        &mut all[1].1,
        check(
            false,
            "1.70 counts rms about the smoothed motion, a quantiser leaves 0.29: counts are lost or timestamps jitter",
        ),
    );
    let combined = combine(&all, &TERMS).unwrap();
    let why =
        "1.70 counts rms about the smoothed motion, a quantiser leaves 0.29: counts are lost or timestamps jitter";
    assert_eq!(combined.card.channels[0].contradicted, [format!("swing-02: encoder residual: {why}")]);
    assert_eq!(reported(&combined), [("rig-contradicted", "swing-02")]);
}

/// Two records at 400 and two at 600 ms gave "400.1 ± 0.5 ms" from two records: the other two were called outliers.
#[test]
fn records_without_a_clear_majority_have_no_common_delay() {
    let mut all = runs(&[400.0, 400.1, 600.0, 600.1]);
    for (_, record) in &mut all {
        record.findings.as_mut().unwrap().channels.push(channel("velocity.gps", 0.1, 0.002));
    }
    let combined = combine(&all, &TERMS).unwrap();
    let names: Vec<&str> = combined.card.channels.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["velocity.gps"]);
    let said = combined.notices.iter().find(|n| n.code == Code::NotComparable && n.place.is_empty()).unwrap();
    assert!(
        ["position.gps", "swing-01 400.0 ± 4.0 ms", "swing-04 600.1 ± 4.0 ms"].iter().all(|w| said.text.contains(w))
    );
    assert!(combined.card.method.contains("disagree"));
    let alone = combine(&runs(&[400.0, 400.1, 600.0, 600.1]), &TERMS).unwrap_err();
    assert!(alone.to_string().contains("disagree"), "{alone}");
    let five = combine(&runs(&[400.0, 400.1, 399.9, 400.0, 600.0]), &TERMS).unwrap();
    assert_eq!(five.card.channels[0].outliers, ["swing-05"]);
}

/// Too few or too scattered for outliers: the mean of 470 ± 290 ms was reported without doubt.
#[test]
fn a_delay_that_varies_between_records_is_in_doubt() {
    let what = |last: &str| format!("the delay differs from record to record, from 398.0 to {last} ms");
    for (delays, last) in
        [(&[398.0, 402.0, 600.0][..], "600.0"), (&[398.0, 600.0][..], "600.0"), (&[402.0, 398.0, 430.0][..], "430.0")]
    {
        let combined = combine(&runs(delays), &TERMS).unwrap();
        assert_eq!(combined.card.channels[0].contradicted, [what(last)]);
        assert_eq!(reported(&combined), [("flight-delay-changes", "")]);
    }
    // Within 20 ms the uncertainty of the card covers the spread.
    let close = combine(&runs(&[398.0, 402.0, 415.0]), &TERMS).unwrap();
    assert!(close.card.channels[0].contradicted.is_empty());
}

#[test]
fn a_delay_that_changes_puts_its_channel_in_doubt() {
    let mut all = runs(&[400.0, 401.0, 399.0]);
    let estimate = |value| Estimate { value, standard_uncertainty: Some(0.002) };
    all[1].1.findings.as_mut().unwrap().channels[0].stationarity = record::Finding::Found(record::Stationarity {
        window_s: 15.0,
        t_s: vec![10.0, 25.0],
        delay_s: vec![estimate(0.35), estimate(0.45)],
        constant_p: 1e-6,
        changes: true,
        slope: estimate(0.0),
        text: String::new(),
    });
    let combined = combine(&all, &TERMS).unwrap();
    let said = "swing-02: the delay changes over the record, from 350.0 to 450.0 ms in windows";
    assert_eq!(combined.card.channels[0].contradicted, [said]);
    assert_eq!(reported(&combined), [("flight-delay-changes", "swing-02")]);
}
