//! Alarms of one flight.

use super::counted;
use record::{
    DelayAlarm, DelayNetwork, DelayOverTime, DelayTerm, DelayTermKind, FlightLateness, Gravity, MeasuredDelay,
    NetworkDatum, NetworkVerdict,
};
use std::collections::BTreeSet;

/// Outliers above this share are an alarm.
const MANY_OUTLIERS: f64 = 0.05;
/// Share of normal noise that Huber's weights (k = 1.345) hold back, and that is no outlier.
const HELD_BACK_BY_CHANCE: f64 = 0.179;
/// A step this close to a whole second is one of the clock, s.
const CLOCK_STEP_S: f64 = 0.05;
/// Delays of this size are between two time scales, s: GPS time is ahead of UTC by 13 s since 1999 and 18 s since 2017.
const TIME_SCALES_APART_S: [f64; 2] = [12.5, 19.0];

/// Everything that a reader must know, the gravest first.
pub(super) fn of(
    out: &FlightLateness,
    network: Option<&DelayNetwork>,
    measured: Option<&MeasuredDelay>,
    over_time: Option<&DelayOverTime>,
) -> Vec<DelayAlarm> {
    let mut all = vec![];
    let mut raise = |gravity, code: &str, text: String| {
        all.push(DelayAlarm { gravity, code: code.to_owned(), text });
    };
    for text in over_time.iter().filter(|o| o.kind.varies()).flat_map(|o| leap_seconds(&o.terms)) {
        raise(Gravity::Red, "leap-second", text);
    }
    if let Some(text) = out.position_minus_velocity_s.and_then(|apart| other_time_scale(apart.value)) {
        raise(Gravity::Red, "other-time-scale", text);
    }
    if let Some(o) = over_time {
        if o.kind.varies() {
            raise(Gravity::Red, &format!("delay-{}", o.kind.word().replace(' ', "-")), o.words.clone());
        }
        if let Some(note) = &o.constancy.note {
            raise(Gravity::Grey, "delay-differs-between-parts", note.clone());
        }
        if let Some([a, b]) = o.two_delays_fit.filter(|_| out.lateness.is_some()) {
            raise(Gravity::Red, "two-delays-fit", format!("two delays fit: {:.0} and {:.0} ms", 1e3 * a, 1e3 * b));
        }
        if let Some(jitter) = &o.jitters {
            let text = format!(
                "the delay jitters by {:.0} ms from fix to fix; {:.2} m remain after its mean is removed",
                1e3 * jitter.standard_deviation_s,
                jitter.remains_m
            );
            raise(Gravity::Amber, "delay-jitters", text);
        }
        if !o.late_fixes.is_empty() {
            let text = format!("{} lie far behind the others", counted(o.late_fixes.len(), "fix"));
            raise(Gravity::Amber, "late-fixes", text);
        }
        if !o.bursts.is_empty() {
            let text = format!("{} of fixes after a pause: they waited in a queue", counted(o.bursts.len(), "burst"));
            raise(Gravity::Amber, "bursts", text);
        }
        for remark in &o.remarks {
            raise(Gravity::Grey, "delay-remark", remark.clone());
        }
    }
    match (network, out.verdict) {
        (Some(n), Some(NetworkVerdict::Undecided | NetworkVerdict::Scattered)) => {
            raise(Gravity::Amber, "pairs-disagree", n.verdict_words.clone());
        }
        (Some(n), Some(NetworkVerdict::Named)) => raise(Gravity::Amber, "channel-lies", n.verdict_words.clone()),
        _ => {}
    }
    if out.datum == NetworkDatum::Refused {
        let text = network.map(|n| n.datum_words.clone()).unwrap_or_default();
        raise(Gravity::Amber, "datum-refused", text);
    }
    if let Some(m) = measured {
        let name = |channel: &Option<String>| channel.clone().unwrap_or_default();
        let compared = format!("{} against {}", name(&out.position), name(&out.velocity));
        if let Some(rival) = m.rival_s {
            let text = format!("{:.0} and {:.0} ms explain it almost equally well", 1e3 * m.delay_s.value, 1e3 * rival);
            raise(Gravity::Red, "two-delays-fit", text);
        }
        let outliers = (m.downweighted_share - HELD_BACK_BY_CHANCE) / (1.0 - HELD_BACK_BY_CHANCE);
        if outliers > MANY_OUTLIERS {
            let text = format!("about {:.0} % of the samples are outliers", 100.0 * outliers);
            raise(Gravity::Amber, "outliers", text);
        }
        let is_one = !over_time.is_some_and(|o| o.kind.varies());
        if let Some(h) = m.homogeneity.filter(|h| is_one && h.scatters()) {
            let text = format!(
                "the windows of the delay scatter by more than their uncertainties (chi-squared {:.0}, {} degrees of freedom), \
                 and no step, drift or queue explains it. U includes that scatter",
                h.chi2, h.degrees_of_freedom
            );
            raise(Gravity::Grey, "delay-windows-scatter", text);
        }
        for text in &m.alarms {
            raise(Gravity::Amber, "delay-doubtful", format!("{compared}: {text}"));
        }
    }
    all.sort();
    let mut said = BTreeSet::new();
    all.retain(|alarm| said.insert(alarm.text.clone()));
    all
}

/// Steps of the delay by a whole second, which clocks make and links do not.
fn leap_seconds(terms: &[DelayTerm]) -> Vec<String> {
    let is_clock = |step: &&DelayTerm| {
        let off_s = (step.size.abs() - step.size.abs().round()).abs();
        let allowed_s = (2.0 * step.standard_uncertainty).clamp(CLOCK_STEP_S, 3.0 * CLOCK_STEP_S);
        step.kind == DelayTermKind::Step && step.size.abs() > 0.5 && off_s < allowed_s
    };
    let words = |step: &DelayTerm| {
        format!(
            "at {:.0} s the delay steps by {:.2} s, a whole second: one clock counts a leap second, or was set, and the \
             other not",
            step.at_s, step.size
        )
    };
    terms.iter().filter(is_clock).map(words).collect()
}

/// Position and velocity that are as far apart as two time scales.
fn other_time_scale(apart_s: f64) -> Option<String> {
    (TIME_SCALES_APART_S[0]..TIME_SCALES_APART_S[1]).contains(&apart_s.abs()).then(|| {
        format!(
            "position and velocity are {:.1} s apart, and GPS time is 18 s ahead of UTC (13 to 17 s before 2017): their stamps \
             may be of different time scales",
            apart_s.abs()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_a_whole_second_is_one_of_a_clock() {
        let step = |size, standard_uncertainty| DelayTerm {
            kind: DelayTermKind::Step,
            at_s: 100.0,
            at_interval_s: None,
            size,
            standard_uncertainty,
        };
        let [told] = &leap_seconds(&[step(0.15, 0.01), step(-1.02, 0.004), step(0.8, 0.3)])[..] else { panic!() };
        assert!(told.starts_with("at 100 s the delay steps by -1.02 s, a whole second"), "{told}");
        let bend = DelayTerm { kind: DelayTermKind::Bend, ..step(1.0, 0.004) };
        assert_eq!(leap_seconds(&[bend]), [""; 0]);
    }

    #[test]
    fn eighteen_seconds_are_between_time_scales() {
        assert!(other_time_scale(18.2).is_some_and(|text| text.starts_with("position and velocity are 18.2 s apart")));
        assert!(other_time_scale(-17.8).is_some());
        assert_eq!(other_time_scale(11.9), None, "a queue of twelve seconds is a delay");
    }
}
