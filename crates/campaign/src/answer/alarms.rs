//! Alarms of one flight.

use super::{counted, in_ms};
use flight::Alarm;
use record::{
    ChannelLateness, DelayAlarm, DelayKind, DelayNetwork, DelayOverTime, DelayTerm, DelayTermKind, Estimate,
    FlightLateness, MeasuredDelay, NetworkDatum, NetworkVerdict,
};
use std::collections::BTreeSet;

/// Share of outliers above which an alarm is raised.
const MANY_OUTLIERS: f64 = 0.05;
/// A step this close to a whole second is a clock step, s.
const CLOCK_STEP_S: f64 = 0.05;
/// Lateness of accelerations above which an IMU is not on time, s. Filters of an attitude delay them by less.
const IMU_OFF_TIME_S: f64 = 0.05;
/// Delays that indicate a mix of time scales, s: GPS time is ahead of UTC by 13 s since 1999 and 18 s since 2017.
const TIME_SCALES_APART_S: [f64; 2] = [12.5, 19.0];

/// All alarms, the most severe first.
pub(super) fn of(
    out: &FlightLateness,
    network: Option<&DelayNetwork>,
    measured: Option<&MeasuredDelay>,
    over_time: Option<&DelayOverTime>,
) -> Vec<DelayAlarm> {
    let mut alarms = Alarms::default();
    if let Some(text) = out.position_minus_velocity_s.and_then(|apart| other_time_scale(apart.value)) {
        alarms.raise(Alarm::OtherTimeScale, text);
    }
    if let Some(over_time) = over_time {
        alarms.over_time(over_time, out.lateness.is_some());
    }
    alarms.network(out, network);
    if let Some(measured) = measured {
        alarms.pair(measured, out, over_time);
    }
    alarms.0.sort();
    let mut texts = BTreeSet::new();
    alarms.0.retain(|alarm| texts.insert(alarm.text.clone()));
    alarms.0
}

#[derive(Default)]
struct Alarms(Vec<DelayAlarm>);

impl Alarms {
    fn raise(&mut self, alarm: Alarm, text: String) {
        self.0.push(DelayAlarm::of(alarm, text));
    }

    /// Findings of the test for a varying delay.
    fn over_time(&mut self, found: &DelayOverTime, is_known: bool) {
        if let Some(change) = of_change(found.kind) {
            // When a queue empties, the delay drops by any number of seconds.
            let jumps = matches!(found.kind, DelayKind::Steps | DelayKind::Switches);
            let terms = if jumps { found.terms.as_slice() } else { &[] };
            leap_seconds(terms).into_iter().for_each(|text| self.raise(Alarm::LeapSecond, text));
            self.raise(change, found.words.clone());
        }
        if let Some(note) = &found.constancy.note {
            self.raise(Alarm::DelayDiffersBetweenParts, note.clone());
        }
        if let Some([a, b]) = found.two_delays_fit.filter(|_| is_known) {
            self.raise(Alarm::TwoDelaysFit, format!("two delays fit: {:.0} and {:.0} ms", 1e3 * a, 1e3 * b));
        }
        if let Some(jitter) = &found.jitters {
            let text = format!(
                "the delay jitters by {:.0} ms from fix to fix; an error of {:.2} m remains after its mean is \
                 removed",
                1e3 * jitter.standard_deviation_s,
                jitter.remains_m
            );
            self.raise(Alarm::DelayJitters, text);
        }
        if !found.late_fixes.is_empty() {
            let text = format!("{} are far later than the others", counted(found.late_fixes.len(), "fix"));
            self.raise(Alarm::LateFixes, text);
        }
        if !found.bursts.is_empty() {
            let bursts = counted(found.bursts.len(), "burst");
            self.raise(Alarm::Bursts, format!("{bursts} of fixes after a pause: the fixes waited in a queue"));
        }
        found.remarks.iter().for_each(|remark| self.raise(Alarm::DelayRemark, remark.clone()));
    }

    /// Pairs that contradict each other.
    fn network(&mut self, out: &FlightLateness, network: Option<&DelayNetwork>) {
        match (network, out.verdict) {
            (Some(n), Some(NetworkVerdict::Undecided | NetworkVerdict::Scattered)) => {
                self.raise(Alarm::PairsDisagree, n.verdict_words.clone());
            }
            (Some(n), Some(NetworkVerdict::Named)) => {
                self.raise(Alarm::ChannelLies, n.verdict_words.clone());
            }
            _ => {}
        }
        if out.datum == NetworkDatum::Refused {
            let text = network.map(|n| n.datum_words.clone()).unwrap_or_default();
            self.raise(Alarm::DatumRefused, text);
        }
        let off_time = network.iter().flat_map(|n| &n.channels).filter(|channel| is_imu_off_time(channel));
        for channel in off_time {
            let (size, side) = sized(&channel.lateness_s);
            self.raise(
                Alarm::ReferenceContradicted,
                format!(
                    "the IMU ({}) is {size} ms {side} against the reference, and an IMU is on time to some milliseconds: the \
                     clock of the reference is off, or that of the IMU",
                    channel.channel
                ),
            );
        }
    }

    /// Doubts about the fit of position against velocity.
    fn pair(&mut self, fit: &MeasuredDelay, out: &FlightLateness, over_time: Option<&DelayOverTime>) {
        let varies = over_time.is_some_and(|o| o.kind.varies());
        if let Some(rival) = fit.rival_s {
            let delay_ms = 1e3 * fit.delay_s.value;
            let text = format!("{delay_ms:.0} and {:.0} ms fit it almost equally well", 1e3 * rival);
            self.raise(Alarm::TwoDelaysFit, text);
        }
        let outliers = fit.outlier_share();
        if outliers > MANY_OUTLIERS {
            let text = format!("about {:.0} % of the samples are outliers", 100.0 * outliers);
            self.raise(Alarm::Outliers, text);
        }
        if let Some(h) = fit.homogeneity.filter(|h| !varies && h.scatters()) {
            let cause = match over_time {
                Some(over_time) if super::tested(over_time) => {
                    "no step, drift or queue large enough to count was detected"
                }
                _ => "whether a step, drift or queue explains it was not tested",
            };
            let text = format!(
                "the windows of the delay scatter by more than their uncertainties (chi-squared {:.0}, {} degrees of freedom), \
                 and {cause}. U includes that scatter",
                h.chi2, h.degrees_of_freedom
            );
            self.raise(Alarm::DelayWindowsScatter, text);
        }
        let name = |channel: &Option<String>| channel.clone().unwrap_or_default();
        let compared = format!("{} against {}", name(&out.position), name(&out.velocity));
        for text in &fit.alarms {
            self.raise(Alarm::DelayDoubtful, format!("{compared}: {text}"));
        }
    }
}

/// The size of a lateness with its uncertainty, ms, and its side.
fn sized(lateness_s: &Estimate) -> (String, &'static str) {
    let size = Estimate { value: lateness_s.value.abs(), ..*lateness_s };
    (in_ms(&size), if lateness_s.value < 0.0 { "early" } else { "late" })
}

/// Whether accelerations are further from the reference in time than an IMU and its attitude can be.
fn is_imu_off_time(channel: &ChannelLateness) -> bool {
    let Estimate { value, standard_uncertainty } = channel.lateness_s;
    let is_imu = delay_network::is_acceleration(&channel.channel) && channel.datum == NetworkDatum::Reference;
    is_imu && value.abs() > IMU_OFF_TIME_S.max(3.0 * standard_uncertainty.unwrap_or_default())
}

/// The alarm for a varying delay.
fn of_change(kind: DelayKind) -> Option<Alarm> {
    match kind {
        DelayKind::Steps => Some(Alarm::DelaySteps),
        DelayKind::Switches => Some(Alarm::DelaySwitches),
        DelayKind::Drifts => Some(Alarm::DelayDrifts),
        DelayKind::Queues => Some(Alarm::DelayQueues),
        DelayKind::BuildsUp => Some(Alarm::DelayBuildsUp),
        DelayKind::Wanders => Some(Alarm::DelayWanders),
        DelayKind::CannotTell
        | DelayKind::NotTested
        | DelayKind::Scatters
        | DelayKind::OnTime
        | DelayKind::Constant
        | DelayKind::Early => None,
    }
}

/// Steps of the delay by a whole second, which come from clocks and not from links.
fn leap_seconds(terms: &[DelayTerm]) -> Vec<String> {
    let is_clock = |step: &&DelayTerm| {
        let off_s = (step.size.abs() - step.size.abs().round()).abs();
        let allowed_s = (2.0 * step.standard_uncertainty).clamp(CLOCK_STEP_S, 3.0 * CLOCK_STEP_S);
        step.kind == DelayTermKind::Step && step.size.abs() > 0.5 && off_s < allowed_s
    };
    let words = |step: &DelayTerm| {
        format!(
            "at {:.0} s the delay steps by {:.2} s, a whole second: one clock applied a leap second or was set, the \
             other was not",
            step.at_s, step.size
        )
    };
    terms.iter().filter(is_clock).map(words).collect()
}

/// A difference between position and velocity as large as between two time scales.
fn other_time_scale(apart_s: f64) -> Option<String> {
    (TIME_SCALES_APART_S[0]..TIME_SCALES_APART_S[1]).contains(&apart_s.abs()).then(|| {
        format!(
            "position and velocity are {:.1} s apart, and GPS time is 18 s ahead of UTC (13 to 17 s before 2017): \
             their timestamps may be in different time scales",
            apart_s.abs()
        )
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use serde_json::json;

    /// Former bug: a reference 0.3 s off in time gave a delay of 551 ms, although the IMU of the log said 251 ms.
    #[test]
    fn an_imu_that_is_not_on_time_against_the_reference_is_an_alarm() {
        use delay_network::{NetworkSettings, PairObservation, ReferenceUse, lineage_from_name, solve};
        use record::DelayPairKind::{PositionAgainstReference, PositionAgainstVelocity, VelocityAgainstAcceleration};
        let raised = |reference, imu_late_s: f64| {
            let pair = |kind, first: &str, second: &str, delay_s| {
                PairObservation::measured(kind, first, second, delay_s, 0.001)
            };
            let pairs = [
                pair(PositionAgainstReference, "position.gps", "position.truth", 0.55),
                pair(PositionAgainstVelocity, "position.gps", "velocity.gps", 0.15),
                pair(
                    VelocityAgainstAcceleration,
                    "velocity.gps",
                    "attitude.ins + specific-force.imu",
                    0.4 - imu_late_s,
                ),
            ];
            let settings = NetworkSettings { reference, ..NetworkSettings::default() };
            let network = solve(&pairs, &lineage_from_name, &settings).unwrap();
            let alarms = of(&crate::answer::unknown("f"), Some(&network), None, None);
            let of_imu = |alarm: &DelayAlarm| alarm.code == Alarm::ReferenceContradicted;
            alarms.into_iter().filter(of_imu).map(|alarm| alarm.text).collect::<Vec<_>>()
        };
        for (imu_late_s, side) in [(0.3, " ms late against"), (-0.3, " ms early against")] {
            let texts = raised(ReferenceUse::Datum, imu_late_s);
            assert!(texts.len() == 1 && texts[0].starts_with("the IMU (acc[ins+imu]) is 300"), "{texts:?}");
            assert!(texts[0].contains(side), "{texts:?}");
            assert!(raised(ReferenceUse::Judges, imu_late_s).is_empty(), "{imu_late_s}");
        }
        assert!(raised(ReferenceUse::Datum, 0.02).is_empty());
    }

    #[test]
    fn a_step_of_a_whole_second_is_a_clock_step() {
        let step = |size, standard_uncertainty| DelayTerm {
            kind: DelayTermKind::Step,
            at_s: 100.0,
            at_interval_s: None,
            size,
            standard_uncertainty,
        };
        let [text] = &leap_seconds(&[step(0.15, 0.01), step(-1.02, 0.004), step(0.8, 0.3)])[..] else { panic!() };
        assert!(text.starts_with("at 100 s the delay steps by -1.02 s, a whole second"), "{text}");
        let bend = DelayTerm { kind: DelayTermKind::Bend, ..step(1.0, 0.004) };
        assert_eq!(leap_seconds(&[bend]), [""; 0]);
    }

    #[test]
    fn eighteen_seconds_indicate_different_time_scales() {
        assert!(other_time_scale(18.2).is_some_and(|text| text.starts_with("position and velocity are 18.2 s apart")));
        assert!(other_time_scale(-17.8).is_some());
        assert_eq!(other_time_scale(11.9), None, "a queue of twelve seconds is a delay");
    }

    /// A delay over time of this kind, without other findings.
    pub(in crate::answer) fn over_time(kind: DelayKind) -> DelayOverTime {
        let level = json!({ "value": 0.4, "standard_uncertainty": 0.01 });
        let quiet = json!({
            "kind": "constant", "words": "it varies", "level_s": level, "level_widening_s": 0.0,
            "constancy": { "tested": true, "varies": false, "windows": 9, "window_s": 30.0, "limit_s": 0.1, "window_delays": [] },
            "late_fixes": [], "odd_fixes": 0, "bursts": [], "curve": [], "terms": [], "span_s": 0.0, "remarks": [],
            "search_s": [-1.0, 1.0], "edge_hit": false, "advice": "", "fixes_used": 1, "fixes_given": 1,
        });
        DelayOverTime { kind, ..serde_json::from_value(quiet).unwrap() }
    }

    fn codes(alarms: &[DelayAlarm]) -> Vec<&str> {
        alarms.iter().map(|alarm| alarm.code.as_str()).collect()
    }

    fn of_over_time(found: &DelayOverTime) -> Vec<DelayAlarm> {
        of(&crate::answer::unknown("f"), None, None, Some(found))
    }

    #[test]
    fn each_kind_of_change_has_its_own_red_alarm() {
        let kinds = [
            (DelayKind::Steps, "delay-steps"),
            (DelayKind::Switches, "delay-switches"),
            (DelayKind::Drifts, "delay-drifts"),
            (DelayKind::Queues, "delay-queues"),
            (DelayKind::BuildsUp, "delay-builds-up"),
            (DelayKind::Wanders, "delay-wanders"),
        ];
        for (kind, code) in kinds {
            let alarms = of_over_time(&over_time(kind));
            assert_eq!((codes(&alarms), alarms[0].gravity), (vec![code], record::Gravity::Red));
        }
        for kind in [
            DelayKind::Constant,
            DelayKind::Early,
            DelayKind::OnTime,
            DelayKind::Scatters,
            DelayKind::NotTested,
            DelayKind::CannotTell,
        ] {
            assert_eq!(of_over_time(&over_time(kind)), []);
        }
    }

    #[test]
    fn further_findings_of_the_test_over_time_are_reported_by_severity() {
        let mut found = over_time(DelayKind::Steps);
        found.terms = vec![DelayTerm {
            kind: DelayTermKind::Step,
            at_s: 100.0,
            at_interval_s: None,
            size: 1.0,
            standard_uncertainty: 0.004,
        }];
        found.constancy.note = Some("the parts differ".into());
        found.jitters = Some(record::DelayJitter { standard_deviation_s: 0.1, remains_m: 2.0, half_width_95_s: 0.2 });
        found.late_fixes = vec![record::LateFix { t_s: 5.0, late_s: 1.0 }];
        found.bursts = vec![serde_json::from_value(json!({ "start_s": 5.0, "fixes": 4, "hold_s": 1.0 })).unwrap()];
        found.remarks = vec!["the lever arm is unknown".into()];
        let red = ["delay-steps", "leap-second"];
        let amber = ["bursts", "delay-jitters", "late-fixes"];
        let grey = ["delay-differs-between-parts", "delay-remark"];
        assert_eq!(codes(&of_over_time(&found)), [&red[..], &amber, &grey].concat());

        let two = DelayOverTime { two_delays_fit: Some([0.1, 0.5]), ..over_time(DelayKind::Constant) };
        assert_eq!(of_over_time(&two), [], "where no delay is known none is doubted");
    }

    #[test]
    fn contradictory_pairs_raise_an_amber_alarm() {
        let network = DelayNetwork {
            datum_words: "a fix is earlier than the IMU".into(),
            verdict_words: "the pairs disagree".into(),
            ..serde_json::from_value(json!({
                "channels": [], "covariance_s2": [], "datum": "none", "datum_words": "", "verdict": "unchecked",
                "verdict_words": "", "named": [], "undecided_between": [], "chi2": 0.0, "degrees_of_freedom": 0, "p": null,
                "birge": 1.0, "loops": [], "effects": [], "used_pairs": [], "unused_pairs": [], "suggestions": [], "judged": [],
            }))
            .unwrap()
        };
        let alarms = |verdict, datum| {
            let out = FlightLateness { verdict: Some(verdict), datum, ..crate::answer::unknown("f") };
            of(&out, Some(&network), None, None)
        };
        let none = NetworkDatum::None;
        assert_eq!(codes(&alarms(NetworkVerdict::Undecided, none)), ["pairs-disagree"]);
        assert_eq!(codes(&alarms(NetworkVerdict::Scattered, none)), ["pairs-disagree"]);
        assert_eq!(codes(&alarms(NetworkVerdict::Named, none)), ["channel-lies"]);
        assert_eq!(codes(&alarms(NetworkVerdict::Unchecked, NetworkDatum::Refused)), ["datum-refused"]);
        assert_eq!(alarms(NetworkVerdict::Unchecked, none), []);
        let apart = record::Estimate { value: 18.0, standard_uncertainty: None };
        let out = FlightLateness { position_minus_velocity_s: Some(apart), ..crate::answer::unknown("f") };
        assert_eq!(codes(&of(&out, None, None, None)), ["other-time-scale"]);
    }

    #[test]
    fn doubts_about_a_fit_raise_an_alarm() {
        let fit: MeasuredDelay = serde_json::from_value(json!({
            "delay_s": { "value": 0.4, "standard_uncertainty": 0.001 }, "interval_95_s": [0.398, 0.402], "hessian_s": 0.001,
            "hac_s": 0.001, "crlb_s": 0.001, "smallest_detectable_s": 0.003, "samples": 100, "downweighted_share": 0.179,
            "rival_s": null, "pieces": [], "over_time": [], "homogeneity": null, "alarm": null, "splits": [], "injections": [],
        }))
        .unwrap();
        let alarms = |fit: &MeasuredDelay| of(&crate::answer::unknown("f"), None, Some(fit), None);
        assert_eq!(alarms(&fit), [], "as many are held back by chance");
        let estimate = json!({ "value": 0.1, "standard_uncertainty": 0.01 });
        let homogeneity = json!({
            "chi2": 40.0, "degrees_of_freedom": 9, "p": 1e-5,
            "largest_step": { "at_s": 50.0, "before_s": estimate, "after_s": estimate, "p": 1e-5 },
        });
        let doubtful = MeasuredDelay {
            rival_s: Some(0.9),
            downweighted_share: 0.25,
            homogeneity: serde_json::from_value(homogeneity).unwrap(),
            alarms: vec!["the noise is not white".into()],
            ..fit
        };
        assert_eq!(
            codes(&alarms(&doubtful)),
            ["two-delays-fit", "delay-doubtful", "outliers", "delay-windows-scatter"]
        );
        // Former bug: "no step, drift or queue large enough to count was detected" where none was tried.
        let text = |over_time: Option<&DelayOverTime>| {
            let alarms = of(&crate::answer::unknown("f"), None, Some(&doubtful), over_time);
            alarms.into_iter().find(|alarm| alarm.code == "delay-windows-scatter").unwrap().text
        };
        assert!(text(None).contains("whether a step, drift or queue explains it was not tested"));
        assert!(
            text(Some(&over_time(DelayKind::Constant)))
                .contains("no step, drift or queue large enough to count was detected.")
        );
        let kind =
            |over_time| crate::answer::kind_of(&crate::answer::tests::late(0.2, None), over_time, Some(&doubtful));
        assert_eq!(kind(None), DelayKind::NotTested);
        assert_eq!(kind(Some(&over_time(DelayKind::Constant))), DelayKind::Scatters);
    }
}
