//! Text for the reader.

use crate::delays::Effect;
use crate::settings::OverTimeSettings;
use crate::stages::Found;
use crate::verdict::{Unknown, Verdict, estimate, milliseconds, plus_minus};
use record::{DelayKind, DelayTermKind};

/// Slopes below this may come from clocks that run at different rates, s/s.
const CLOCK_SKEW: f64 = 2e-4;
/// A trend over the flight that is smaller than this many scatters of the windows is not named.
const SKEW_SCATTERS: f64 = 3.0;
/// Shortest flight that is recommended, s.
const SHORTEST_S: f64 = 120.0;

/// The result as one plain sentence.
pub(crate) fn sentence(found: &Found, v: &Verdict) -> String {
    let mut text = match v.kind {
        DelayKind::CannotTell => cannot_tell(found, v),
        DelayKind::NotTested | DelayKind::Scatters => format!("{}. {}", late(v.level), detectable_change(found, v)),
        DelayKind::OnTime => {
            format!("Position and velocity agree in time: {}. {}", late(v.level), detectable_change(found, v))
        }
        DelayKind::Constant | DelayKind::Early => match &v.constancy.note {
            Some(note) => format!("{} on average. {note}", late(v.level)),
            None => format!("{}, the same all through the flight. {}", late(v.level), detectable_change(found, v)),
        },
        _ => changes(found, v),
    };
    if let Some(j) = found.jitter.found_s {
        text += &format!(" It jitters by {} (standard deviation) from fix to fix.", milliseconds(j));
    }
    if !found.odd.late.is_empty() {
        text += &format!(" {} single fixes came late.", found.odd.late.len());
    }
    match found.queued.bursts.len() {
        0 => {}
        1 => text += " Some fixes arrived at once, in a burst.",
        n => text += &format!(" Fixes arrived in {n} bursts."),
    }
    text
}

/// "The position is 203 ± 6 ms late".
fn late(level: Option<Effect>) -> String {
    let Some(level) = level else { return "The delay is unknown".to_owned() };
    let of = |size: f64| plus_minus(record::Estimate { value: size, standard_uncertainty: Some(level.uncertainty) });
    if level.size < 0.0 && level.size + 1.96 * level.uncertainty < 0.0 {
        format!("The velocity is {} later than the position", of(-level.size))
    } else {
        format!("The position is {} late", of(level.size))
    }
}

/// The detectable change, and between which instants after the first fix.
fn detectable_change(found: &Found, v: &Verdict) -> String {
    if !v.constancy.tested {
        let windows = v.constancy.windows;
        let what = match v.change_on_bins {
            Some(_) => "The delay may change within this flight, which could not be tested",
            None => "Whether the delay changes could not be tested",
        };
        return format!("{what}: of the 8 windows needed, {windows} could be measured.");
    }
    let (Some(x), Some(between)) = (v.constancy.detectable_s, v.constancy.detectable_between_s) else {
        return "No change was detectable: one window has nearly all the information.".to_owned();
    };
    let [from, to] = between.map(|t| t - found.span_s[0]);
    let change = milliseconds(x);
    if x <= 0.15 {
        format!("A lasting change of {change} or more between {from:.0} s and {to:.0} s would have been seen.")
    } else {
        format!(
            "As far as can be seen: only a change of {change} or more between {from:.0} s and {to:.0} s would have shown."
        )
    }
}

fn cannot_tell(found: &Found, v: &Verdict) -> String {
    let why = match &v.unknown {
        None | Some(Unknown::NoMotion) => "the flight has too little motion while both are logged".to_owned(),
        Some(Unknown::Wide(u)) => {
            format!("the motion gives the delay only to ± {}", milliseconds((2.0 * u).min(99.0)))
        }
        Some(Unknown::Edge) => format!(
            "the best delay lies at the edge of the search ({:.1} s to {:.1} s)",
            found.search_s[0], found.search_s[1]
        ),
        Some(Unknown::Foreign(share)) => {
            format!("{:.0} % of the displacement is not explained by this velocity at any delay", 100.0 * share)
        }
        Some(Unknown::TwoFit([a, b])) => format!("two delays fit equally well, {a:.1} s and {b:.1} s"),
    };
    let mut text = format!("Cannot tell how late the position is: {why}.");
    if v.change_on_bins.is_some() {
        text += " But the delay changes, or the position was reset along the track.";
    }
    text
}

/// A step is reported with its levels if it makes up all of the change except this share.
const MORE: f64 = 0.1;

fn changes(found: &Found, v: &Verdict) -> String {
    let Some(shape) = &v.shape else {
        let by = v.constancy.difference_s.map_or(String::new(), |b| format!(" by {}", plus_minus(b)));
        return format!(
            "The delay wanders: it differs{by} between parts of the flight, and no simple description fits."
        );
    };
    let range = format!("between {} and {}", milliseconds(shape.least_s), milliseconds(shape.most_s));
    match v.kind {
        DelayKind::Steps | DelayKind::Switches => {
            let steps = steps(found);
            let how = if v.kind == DelayKind::Switches { "switches to and fro" } else { "jumps" };
            match steps.as_slice() {
                [(at, size)] if shape.span_s() > (1.0 + MORE) * size.value.abs() => format!(
                    "The delay jumps by {} at {at:.0} s of the flight, and also changes slowly: {range}.",
                    plus_minus(*size)
                ),
                [(at, size)] => format!(
                    "The delay jumps by {} at {at:.0} s of the flight, from {} to {}.",
                    plus_minus(*size),
                    milliseconds(if size.value > 0.0 { shape.least_s } else { shape.most_s }),
                    milliseconds(if size.value > 0.0 { shape.most_s } else { shape.least_s }),
                ),
                many => format!("The delay {how} {} times {range}.", many.len()),
            }
        }
        DelayKind::Queues => format!("The delay grows and falls back, {range}: messages wait in a queue."),
        DelayKind::BuildsUp => format!("The delay builds up {range} and does not fall back."),
        _ if shape.steepest.abs() < CLOCK_SKEW => {
            format!("The delay drifts {range}, by {:.0} ppm as clocks do.", 1e6 * shape.steepest)
        }
        _ => format!("The delay drifts {range}."),
    }
}

/// Steps with their instants after the first fix.
fn steps(found: &Found) -> Vec<(f64, record::Estimate)> {
    let Some(refined) = &found.refined else { return vec![] };
    let terms = refined.description.terms.iter().enumerate().filter(|(_, t)| t.kind == DelayTermKind::Step);
    let size =
        |i: usize, value: f64| record::Estimate { value, standard_uncertainty: Some(refined.size_uncertainty(i)) };
    terms.map(|(i, t)| (t.at_s - found.span_s[0], size(i, t.size))).collect()
}

/// Consequence for a compensation.
pub(crate) fn advice(v: &Verdict) -> String {
    let text = match v.kind {
        DelayKind::CannotTell => "Remove no delay. A configured delay is not verified by this flight.",
        DelayKind::NotTested | DelayKind::Scatters => "Remove this delay if other flights of the same receiver agree.",
        DelayKind::OnTime => "Remove no delay.",
        DelayKind::Constant => "Remove this delay.",
        DelayKind::Early => "Leave the position as it is. Off-line, shift the velocity instead: it is the later one.",
        DelayKind::Steps | DelayKind::Switches => {
            "No single delay fits. Off-line, remove each level's own delay and mark the fixes near the steps invalid."
        }
        DelayKind::Drifts => "No single delay fits. Off-line, remove the curve.",
        DelayKind::Queues | DelayKind::BuildsUp => {
            "No single delay fits. Off-line, remove the curve and mark fixes in bursts. In flight, use the device's \
             own time."
        }
        DelayKind::Wanders => "No single delay fits. Off-line, remove the curve and keep its uncertainty.",
    };
    text.to_owned()
}

/// What to fly for a better result: minutes of turns at the speed of this flight.
pub(crate) fn what_to_fly(found: &Found, v: &Verdict, settings: &OverTimeSettings) -> Option<String> {
    let missing = matches!(v.kind, DelayKind::CannotTell | DelayKind::NotTested);
    let blind = v.constancy.detectable_s.is_some_and(|x| x > settings.detectable_limit_s);
    if !missing && !blind {
        return None;
    }
    if let Some(Unknown::TwoFit(_)) = v.unknown {
        return Some(
            "Fly turns of different radius and duration: a strictly periodic motion fits two delays.".to_owned(),
        );
    }
    if let Some(Unknown::Foreign(_)) = v.unknown {
        return Some("Check that position and velocity are of the same vehicle and in the same frame.".to_owned());
    }
    let speed = found.motion.fast_mps.max(1.0);
    let sigma = 0.25 * settings.known_limit_s;
    let inflation = found.test.as_ref().map_or(2.0, |t| 2.0 * t.all.inflation);
    let fixes = inflation * (found.noise.white_m / (speed * sigma)).powi(2);
    let duration = (fixes * found.interval_s).clamp(SHORTEST_S, 1800.0);
    Some(format!(
        "Fly {:.0} minutes of turns at {speed:.0} m/s, left and right, with the heading changing all the time.",
        (duration / 60.0).ceil()
    ))
}

/// Other causes that could look like this delay.
pub(crate) fn remarks(found: &Found, v: &Verdict) -> Vec<String> {
    let mut out = vec![];
    if v.unknown.is_none() && !v.kind.varies() {
        out.push(detectable_change(found, v));
    }
    if let Some(test) = &found.test {
        let lever = test.all.lever_m;
        if let Some(l) = sure(lever) {
            out.push(format!(
                "The antenna seems to be {:.2} ± {:.2} m ahead of the point whose velocity is known.",
                l.value,
                2.0 * lever.uncertainty
            ));
        }
        if let Some(s) = sure(test.all.speed_lag_s) {
            let [late, early] = if s.value < 0.0 { ["direction", "speed"] } else { ["speed", "direction"] };
            let apart = plus_minus(record::Estimate { value: s.value.abs(), ..s });
            out.push(format!("The {late} follows {apart} later than the {early}."));
        }
        if let Some(skew) = clock_skew(found, v) {
            out.push(skew);
        }
    }
    if v.kind == DelayKind::Steps {
        out.push("On a straight piece a step looks the same as a reset of the position along the track.".to_owned());
    }
    if found.fixes_used > 0 && found.noise.shape.jitter == 0.0 && found.fixes_used * 2 < found.queued.rows.len() {
        let every = found.queued.rows.len().div_ceil(found.fixes_used);
        out.push(format!("Every {} fix was used for the test of change.", ordinal(every)));
    }
    out
}

/// `3rd`, `4th`, `11th`, `21st`.
fn ordinal(n: usize) -> String {
    let ending = match (n % 100, n % 10) {
        (11..=13, _) => "th",
        (_, 1) => "st",
        (_, 2) => "nd",
        (_, 3) => "rd",
        _ => "th",
    };
    format!("{n}{ending}")
}

fn sure(e: Effect) -> Option<record::Estimate> {
    estimate(e).filter(|_| e.size.abs() > 3.0 * e.uncertainty)
}

/// A trend as small as that of clocks.
fn clock_skew(found: &Found, v: &Verdict) -> Option<String> {
    // The rate of a flight of which one window differs is that of the window.
    let is_one = !v.kind.varies() && v.constancy.left_out_window_s.is_none();
    let c = found.test.as_ref()?.comparison.as_ref().filter(|_| is_one)?;
    let rate = sure(c.rate)?;
    let [start, end] = found.span_s;
    let stands_out = (rate.value * (end - start)).abs() > SKEW_SCATTERS * c.scatter_s;
    (stands_out && rate.value.abs() < CLOCK_SKEW).then(|| {
        let u = rate.standard_uncertainty.unwrap_or(0.0);
        let changes = if rate.value < 0.0 { "shrinks" } else { "grows" };
        format!(
            "The delay {changes} by {:.1} ± {:.1} ppm, as between clocks that run at different rates.",
            1e6 * rate.value.abs(),
            2e6 * u
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::{WINDOW_S, described, found};
    use crate::verdict::judge;
    use record::DelayTermKind::{Bend, Step};

    fn judged(found: &Found) -> Verdict {
        judge(found, &OverTimeSettings::default())
    }

    fn text_of(found: &Found) -> String {
        sentence(found, &judged(found))
    }

    /// Twelve windows of ± 10 ms. At the worst place, after the third window, a step with one window left out has
    /// u = 10 ms √(1/2 + 1/9). A change of 50 ms plus 3.3 u is detectable. Instants count from the first fix.
    #[test]
    fn a_constant_is_reported_with_the_detectable_change() {
        let f = found(&[0.2; 12], 0.01);
        let text = "The position is 200 ± 6 ms late, the same all through the flight. A lasting change of 76 ms or more between \
                    50 s and 190 s would have been seen.";
        assert_eq!(text_of(&f), text);
        assert_eq!(
            remarks(&f, &judged(&f)),
            [&text["The position is 200 ± 6 ms late, the same all through the flight. ".len()..]]
        );
        // ± 40 ms: 50 ms + 3.3 · 31.3 ms.
        let f = found(&[0.2; 12], 0.04);
        let text = text_of(&f);
        assert!(
            text.contains("As far as can be seen: only a change of 153 ms or more between 50 s and 190 s"),
            "{text}"
        );
    }

    #[test]
    fn an_early_position_is_reported_as_a_late_velocity() {
        let f = found(&[-0.2; 12], 0.01);
        assert!(
            text_of(&f).starts_with("The velocity is 200 ± 6 ms later than the position, the same"),
            "{}",
            text_of(&f)
        );
        let f = found(&[0.0; 12], 0.01);
        assert!(
            text_of(&f).starts_with("Position and velocity agree in time: The position is 0.0 ± 5.8 ms late."),
            "{}",
            text_of(&f)
        );
    }

    #[test]
    fn a_step_is_reported_with_its_instant_and_both_levels() {
        let says = |terms: &[(DelayTermKind, f64, f64)], expected: &str| {
            let f = described(terms, 0.2);
            assert_eq!(text_of(&f), format!("The delay {expected}."));
        };
        says(&[(Step, 120.0, 0.3)], "jumps by 300 ± 4 ms at 120 s of the flight, from 200 ms to 500 ms");
        says(&[(Step, 100.0, -0.15)], "jumps by \u{2212}150 ± 4 ms at 100 s of the flight, from 200 ms to 50 ms");
        says(&[(Step, 80.0, 0.1), (Step, 160.0, 0.3)], "jumps 2 times between 200 ms and 600 ms");
        let to_and_fro = [(Step, 40.0, 0.3), (Step, 100.0, -0.3), (Step, 160.0, 0.3)];
        says(&to_and_fro, "switches to and fro 3 times between 200 ms and 500 ms");
        // 240 s of 0.25 ms/s in addition to a step of 0.3 s: a span of 360 ms.
        let text = "jumps by 300 ± 4 ms at 120 s of the flight, and also changes slowly: between 200 ms and 560 ms";
        says(&[(Bend, 0.0, 2.5e-4), (Step, 120.0, 0.3)], text);
    }

    #[test]
    fn slow_changes_are_reported_with_their_range() {
        let says = |terms: &[(DelayTermKind, f64, f64)], expected: &str| {
            assert_eq!(text_of(&described(terms, 0.1)), expected);
        };
        says(&[(Bend, 0.0, 0.001)], "The delay drifts between 100 ms and 340 ms.");
        says(&[(Bend, 0.0, 0.01)], "The delay builds up between 100 ms and 2500 ms and does not fall back.");
        let queue = "The delay grows and falls back, between 100 ms and 2100 ms: messages wait in a queue.";
        says(&[(Bend, 20.0, 0.02), (Bend, 120.0, -0.02), (Step, 120.0, -2.0)], queue);
        let clocks = found(&(0..12).map(|k| 0.1 + 0.004 * f64::from(k)).collect::<Vec<f64>>(), 1e-4);
        let skewed = Found { refined: described(&[(Bend, 0.0, 1.5e-4)], 0.1).refined, ..clocks };
        let v = Verdict { kind: DelayKind::Drifts, ..judged(&skewed) };
        assert_eq!(sentence(&skewed, &v), "The delay drifts between 100 ms and 136 ms, by 150 ppm as clocks do.");
    }

    #[test]
    fn significant_effects_are_remarked_with_two_uncertainties() {
        let mut f = found(&[0.2; 12], 0.01);
        let all = &mut f.test.as_mut().unwrap().all;
        all.lever_m = Effect { size: 0.4, uncertainty: 0.05 };
        all.speed_lag_s = Effect { size: -0.12, uncertainty: 0.01 };
        let texts = remarks(&f, &judged(&f));
        assert_eq!(texts[1], "The antenna seems to be 0.40 ± 0.10 m ahead of the point whose velocity is known.");
        assert_eq!(texts[2], "The direction follows 120 ± 20 ms later than the speed.");
        let all = &mut f.test.as_mut().unwrap().all;
        all.lever_m.uncertainty = 0.14;
        all.speed_lag_s.size = 0.12;
        assert_eq!(remarks(&f, &judged(&f))[1..], ["The speed follows 120 ± 20 ms later than the direction."]);
    }

    /// 12 windows 20 s apart: the uncertainty of the rate is u / √(143 · 20²).
    #[test]
    fn differing_clock_rates_are_remarked_in_parts_per_million() {
        let skew = |rate: f64| {
            let f = found(&(0..12).map(|k| 0.2 + rate * WINDOW_S * f64::from(k)).collect::<Vec<f64>>(), 1e-3);
            remarks(&f, &judged(&f)).into_iter().find(|r| r.contains("clocks"))
        };
        let u = 1e-3 / (143.0 * 400.0f64).sqrt();
        let text = |ppm: &str| {
            Some(format!(
                "The delay grows by {ppm} ± {:.1} ppm, as between clocks that run at different rates.",
                2e6 * u
            ))
        };
        assert_eq!(skew(5e-5), text("50.0"));
        assert!(skew(-5e-5).unwrap().starts_with("The delay shrinks by 50.0 ± "));
        assert_eq!(skew(2.9 * u), None);
        assert_eq!(skew(2.1e-4), None);
        // 11 ms of trend among windows that scatter by 20 ms.
        let to_and_fro = |k: i32| 0.2 + 1e-3 * f64::from(k) + if k % 2 == 0 { 0.02 } else { -0.02 };
        let f = found(&(0..12).map(to_and_fro).collect::<Vec<f64>>(), 1e-3);
        assert!(!remarks(&f, &judged(&f)).iter().any(|r| r.contains("clocks")));
    }

    #[test]
    fn ordinals_have_their_endings() {
        let all = [3, 4, 11, 12, 13, 21, 22, 103, 111].map(ordinal);
        assert_eq!(all, ["3rd", "4th", "11th", "12th", "13th", "21st", "22nd", "103rd", "111th"]);
    }

    #[test]
    fn thinning_and_single_late_fixes_are_reported() {
        let mut f = found(&[0.2; 12], 0.01);
        f.fixes_used = 500;
        assert_eq!(remarks(&f, &judged(&f)).last().unwrap(), "Every 3rd fix was used for the test of change.");
        f.fixes_used = 600;
        assert_eq!(remarks(&f, &judged(&f)).len(), 1);
        f.odd.late = vec![record::LateFix { t_s: 120.0, late_s: 0.4 }; 3];
        f.jitter.found_s = Some(0.05);
        f.queued.bursts = vec![record::Burst { start_s: 130.0, fixes: 5, hold_s: 1.0 }; 2];
        let text = text_of(&f);
        let end = " It jitters by 50 ms (standard deviation) from fix to fix. 3 single fixes came late. Fixes arrived in 2 bursts.";
        assert!(text.ends_with(end), "{text}");
    }

    /// White noise of 30 m at 20 m/s and a target of ± 12.5 ms: 2 · (30 / (20 · 0.0125))² fixes of 0.01 s are 288 s.
    #[test]
    fn the_advised_minutes_follow_from_the_noise() {
        let settings = OverTimeSettings::default();
        let mut f = found(&[0.2; 12], 0.01);
        assert_eq!(what_to_fly(&f, &judged(&f), &settings), None);
        f.test.as_mut().unwrap().comparison = None;
        f.interval_s = 0.01;
        let speed = f.motion.fast_mps;
        for (white_m, minutes) in [(1.5 * speed, 5), (0.3, 2), (1e3 * speed, 30)] {
            f.noise.white_m = white_m;
            let text = what_to_fly(&f, &judged(&f), &settings).unwrap();
            assert!(text.starts_with(&format!("Fly {minutes} minutes of turns at {speed:.0} m/s,")), "{text}");
        }
        f.test.as_mut().unwrap().all.inflation = 2.0;
        f.noise.white_m = 1.5 * speed;
        assert!(what_to_fly(&f, &judged(&f), &settings).unwrap().starts_with("Fly 10 minutes"));
    }
}
