//! Scores of the compensators with and without a reference, their error budget, and the aircraft's own solution.

use super::Head::{self, Number, Text};
use super::{badge, estimate, finding, maybe, no_number, plain, rows, table, table_of};
use crate::figure::{Figure, bands_figure, budget_figure};
use crate::number::{self, COVERAGE_FACTOR};
use crate::text::{ended, shown, shown_block};
use crate::verdict::in_millis;
use maud::{Markup, html};
use record::{
    CompensatorScore, Effect, EffectVerdict, ErrorBudget, Estimate, Finding, HelpfulBand, OnboardAgainst,
    OnboardComparison, ReferenceScore, ReplayRecord, ReplayScores, ResidualDelay,
};
use std::collections::BTreeMap;

/// Maximum number of compensators in a table; the record has all.
const MOST: usize = 20;

/// Figures of the section, not yet numbered: budget and bands.
pub(super) fn figures(replay: Option<&ReplayRecord>) -> Vec<Figure> {
    let Some(scores) = replay.and_then(|r| r.scores.as_ref()) else { return vec![] };
    budget_figure(scores).into_iter().chain(bands_figure(scores)).collect()
}

pub(super) fn section(replay: &ReplayRecord, effect: Option<&Effect>, of_budget: &Markup, of_bands: &Markup) -> Markup {
    html! {
        @if let Some(scores) = &replay.scores {
            h2 id="score" { "What the compensators are worth" }
            (without_reference(scores))
            @if replay.pair.reference.is_some() { (with_reference(scores)) }
            (budget(scores, of_budget))
            (validity(scores, effect, of_bands))
        }
        @if let Some(onboard) = &replay.onboard { (aircraft(onboard)) }
    }
}

/// A cell of a score table: the number, or a dash. The reason for a dash is below the table.
fn cell<T>(found: &Finding<T>, show: impl FnOnce(&T) -> Markup) -> Markup {
    maybe(found.found(), show)
}

/// Why some cells have no number, each reason once.
#[derive(Default)]
struct Reasons<'a>(BTreeMap<(&'static str, &'a str), Vec<&'a str>>);

impl<'a> Reasons<'a> {
    fn add<T>(&mut self, what: &'static str, compensator: &'a str, found: &'a Finding<T>) {
        if let Finding::CannotTell(why) = found {
            let why = why.strip_prefix(what).and_then(|rest| rest.strip_prefix(": ")).unwrap_or(why);
            let names = self.0.entry((what, why)).or_default();
            if !names.contains(&compensator) {
                names.push(compensator);
            }
        }
    }

    fn show(&self) -> Markup {
        html! {
            @if !self.0.is_empty() {
                ul.note {
                    @for ((what, why), names) in self.0.iter().take(2 * MOST) {
                        li {
                            "— " (what) ", "
                            @for (i, name) in names.iter().take(MOST).enumerate() { @if i > 0 { ", " } code { (shown(name)) } }
                            ": " (shown(why)) "."
                        }
                    }
                }
            }
        }
    }
}

// Without a reference

fn without_reference(scores: &ReplayScores) -> Markup {
    let head = [
        Text("Compensator"),
        Number("Delay left against ∫v ± U of the fit (ms)"),
        Number("Expected, from all pairs ± U (ms)"),
        Text("Agrees"),
        Number("Lead over raw ± U (ms)"),
        Number("Delay given (ms)"),
        Number("Step correlation"),
        Number("Raw − this, north (m)"),
        Number("Raw − this, east (m)"),
    ];
    let row = |c: &CompensatorScore| {
        html! {
            tr {
                th scope="row" { code { (shown(&c.name)) } }
                td.n { (cell(&c.residual_delay, |r| estimate(&in_millis(&r.delay_s)))) }
                td.n { (cell(&c.residual_delay, |r| estimate(&in_millis(&r.expected_s)))) }
                td { (cell(&c.residual_delay, agreement)) }
                td.n { @if is_raw(c) { "ref." } @else { (cell(&c.lead_s, |lead| estimate(&in_millis(lead)))) } }
                td.n { (plain(c.expected_lead_s * 1e3, 4)) }
                td.n { (cell(&c.step_correlation, estimate)) }
                @for axis in &c.raw_minus_this_axes_rms_m { td.n { (estimate(axis)) } }
            }
        }
    };
    let mut reasons = Reasons::default();
    for c in scores.compensators.iter().take(MOST) {
        reasons.add("delay left", &c.name, &c.residual_delay);
        if !is_raw(c) {
            reasons.add("lead", &c.name, &c.lead_s);
        }
        reasons.add("steps", &c.name, &c.step_correlation);
    }
    let [north, east] = scores.predicted_axes_rms_m;
    html! {
        h3 { "Without a reference" }
        (table("What the flight itself says of each output; U with k = 2", &head,
            rows(&scores.compensators, MOST, head.len(), row)))
        p.note {
            "Delay left: how much later than the integrated velocity the output is at fresh fixes, by the estimator of "
            a href="#delay" { "Delays of pairs of channels" }
            ", with the U of the fit alone; raw shows Tp − Tv. A correct compensation leaves −Tv: it puts the position \
             where it is, not where a late velocity is. A Padé filter leaves its truncation delay (± 50 %) and the fix \
             age. Lead: distance ahead of raw along the track, over the speed. Step correlation: 1 = each fix jumps by \
             the whole distance flown; 0 = no predictable jump (ideal). One velocity, half way back, predicts for raw \
             − compensated " (plain(north, 3)) "\u{a0}m north and " (plain(east, 3))
            "\u{a0}m east rms. None of these shows a delay that position and velocity share."
        }
        (reasons.show())
        (passes_and_legs(scores))
    }
}

/// Whether this is the raw position, which leads are measured against.
fn is_raw(score: &CompensatorScore) -> bool {
    score.name == "raw"
}

/// Whether the residual delay agrees with the expected one within U. A difference here is not harm: see the effect.
fn agreement(residual: &ResidualDelay) -> Markup {
    let expected = residual.expected_s;
    let apart = (residual.delay_s.value - expected.value).abs();
    let both = |u: f64| COVERAGE_FACTOR * u.hypot(expected.standard_uncertainty.unwrap_or(0.0));
    match residual.delay_s.standard_uncertainty.filter(|u| *u > 0.0) {
        None => badge("unsure", "?", "no U"),
        Some(u) if apart <= both(u) => badge("ok", "✓", "agrees"),
        Some(_) => badge("unsure", "!", "differs"),
    }
}

fn passes_and_legs(scores: &ReplayScores) -> Markup {
    let head = [
        Text("Compensator"),
        Number("Opposite passes, apart along the track (m)"),
        Number("Expected (m)"),
        Number("Apart across (m)"),
        Number("Straight legs: distance beyond speed × Td, mean (m)"),
        Number("Moved across, rms (m)"),
        Number("Noise across, over raw's"),
    ];
    let row = |c: &CompensatorScore| {
        html! {
            tr {
                th scope="row" { code { (shown(&c.name)) } }
                td.n { (cell(&c.hysteresis, |h| estimate(&h.along_m))) }
                td.n { (cell(&c.hysteresis, |h| plain(h.expected_along_m, 3))) }
                td.n { (cell(&c.hysteresis, |h| estimate(&h.across_m))) }
                td.n { (cell(&c.straight, |s| estimate(&s.along_excess_m))) }
                td.n { (cell(&c.straight, |s| estimate(&s.across_rms_m))) }
                td.n { (cell(&c.straight, |s| estimate(&s.noise_ratio))) }
            }
        }
    };
    html! {
        @if scores.opposite_passes.found().is_some() || scores.straight_legs.found().is_some() {
            (table("Opposite passes and straight legs; U with k = 2", &head,
                rows(&scores.compensators, MOST, head.len(), row)))
        }
        p.note {
            "Opposite passes: "
            (finding(&scores.opposite_passes, |p| html! {
                (number::counted(p.pairs, "pair", "pairs")) " within " (plain(p.within_m, 2)) "\u{a0}m, "
                (number::count(p.fixes)) " fixes, closing at " (plain(p.closing_speed_mps, 3)) "\u{a0}m/s; where velocity \
                 brings the aircraft back to the same place, a position that is later than it by T is 2\u{a0}U\u{a0}T apart."
            }))
        }
        p.note {
            "Straight legs: "
            (finding(&scores.straight_legs, |l| html! {
                (number::counted(l.legs, "leg", "legs")) ", " (plain(l.duration_s, 3)) "\u{a0}s, acceleration across below "
                (plain(l.lateral_limit_mps2, 2)) "\u{a0}m/s²; there an output may differ from raw by speed × Td along the track \
                 and by nothing else."
            }))
        }
    }
}

// With a reference

const REFERENCE_HEAD: [Head; 14] = [
    Text("Compensator"),
    Number("2‑D rms"),
    Number("50 % below"),
    Number("68 %"),
    Number("95 %"),
    Number("99 %"),
    Number("Largest"),
    Number("Along, mean"),
    Number("Along, rms"),
    Number("Across, mean"),
    Number("Across, rms"),
    Number("North, rms"),
    Number("East, rms"),
    Number("Delay left ± U (ms)"),
];

fn with_reference(scores: &ReplayScores) -> Markup {
    let scored: Vec<(&str, &ReferenceScore)> =
        scores.compensators.iter().filter_map(|c| Some((c.name.as_str(), c.reference.found()?))).collect();
    let row = |(name, s): &(&str, &ReferenceScore)| {
        html! {
            tr {
                th scope="row" { code { (shown(name)) } }
                td.n { (estimate(&s.rms_m)) }
                @for p in s.percentiles_m { td.n { (plain(p, 3)) } }
                td.n { (plain(s.max_m, 3)) }
                @for e in s.along_m.iter().chain(&s.across_m) { td.n { (estimate(e)) } }
                td.n { (estimate(&s.north_m[1])) }
                td.n { (estimate(&s.east_m[1])) }
                td.n { (cell(&s.residual_delay_s, |d| estimate(&in_millis(d)))) }
            }
        }
    };
    let mut reasons = Reasons::default();
    for c in scores.compensators.iter().take(MOST) {
        reasons.add("error", &c.name, &c.reference);
        if let Finding::Found(s) = &c.reference {
            reasons.add("delay left", &c.name, &s.residual_delay_s);
            reasons.add("frequency bands", &c.name, &s.bands_rms_m);
        }
    }
    html! {
        h3 { "Against the reference" }
        @if !scored.is_empty() {
            (table("Error against the reference, m; ± is U with k = 2; ahead and to the right are positive", &REFERENCE_HEAD,
                rows(&scored, MOST, REFERENCE_HEAD.len(), row)))
            (split("Error by ground speed, 2‑D rms, m", "Ground speed (m/s)", &scores.speeds_mps, &scored,
                |s, bin| s.by_speed.get(bin).copied().flatten()))
            (split("Error by frequency, 2‑D rms, m", "Frequency (Hz)", &scores.bands_hz, &scored, |s, bin| {
                let value = *s.bands_rms_m.found()?.get(bin)?;
                Some(Estimate { value, standard_uncertainty: None })
            }))
            p.note {
                "By frequency: spectrum of the error about its mean over the longest stretch without a gap, averaged down \
                 to about ten rows a second. Delay left against the reference: regression of the error on the velocity. \
                 Delay of the velocity itself (what is late against the reference beyond what is late against ∫v): "
                (finding(&scores.velocity_delay_s, |d| html! { (estimate(&in_millis(d))) "\u{a0}ms" })) "."
            }
        }
        (reasons.show())
    }
}

/// A table with a row for each bin and a column for each compensator.
fn split(
    caption: &str,
    by: &'static str,
    bins: &[[f64; 2]],
    scored: &[(&str, &ReferenceScore)],
    value: impl Fn(&ReferenceScore, usize) -> Option<Estimate>,
) -> Markup {
    let columns = &scored[..scored.len().min(MOST)];
    let head = html! {
        tr { th scope="col" { (by) } @for (name, _) in columns { th.n scope="col" { code { (shown(name)) } } } }
    };
    let numbered: Vec<(usize, &[f64; 2])> = bins.iter().enumerate().collect();
    let row = |(bin, [from, to]): &(usize, &[f64; 2])| {
        html! {
            tr {
                th scope="row" { (number::significant(*from, 3)) " to " (number::significant(*to, 3)) }
                @for (_, s) in columns { td.n { (maybe(value(s, *bin), |e| estimate(&e))) } }
            }
        }
    };
    html! { @if !bins.is_empty() { (table_of(caption, head, rows(&numbered, MOST, columns.len() + 1, row))) } }
}

// Budget

fn budget(scores: &ReplayScores, of_budget: &Markup) -> Markup {
    let columns = &scores.compensators[..scores.compensators.len().min(MOST)];
    let mut names: Vec<(&str, &str)> = vec![];
    for t in columns.iter().flat_map(|c| &c.budget.terms) {
        match names.iter_mut().find(|(name, _)| *name == t.name) {
            Some((_, source)) if source.is_empty() => *source = &t.source,
            Some(_) => {}
            None => names.push((&t.name, &t.source)),
        }
    }
    let head = html! {
        tr {
            th scope="col" { "Term" }
            @for c in columns { th.n scope="col" { code { (shown(&c.name)) } } }
            th scope="col" { "Where it comes from" }
        }
    };
    let row = |(name, source): &(&str, &str)| {
        html! {
            tr {
                th scope="row" { (shown(name)) }
                @for c in columns {
                    td.n {
                        @match c.budget.terms.iter().find(|t| t.name == *name).map(|t| &t.size_m) {
                            Some(Finding::Found(size)) => { (plain(*size, 2)) }
                            Some(Finding::CannotTell(why)) => { span.none title=(why) { "unknown" } }
                            None => { span.none title="not a term of this compensator" { "·" } }
                        }
                    }
                }
                td.any { (shown(source)) }
            }
        }
    };
    let total = html! {
        tr {
            th scope="row" { "Together, √Σ" }
            @for c in columns { td.n { (together(&c.budget)) } }
            td.any { "terms are assumed to be independent; “from the others” where one of them is unknown" }
        }
        tr {
            th scope="row" { "Measured against the reference" }
            @for c in columns { td.n { (maybe(c.budget.measured_m.as_ref(), estimate)) } }
            td.any { "2‑D rms" }
        }
    };
    let mut reasons = Reasons::default();
    for c in columns {
        c.budget.terms.iter().for_each(|t| reasons.add("unknown", &c.name, &t.size_m));
    }
    html! {
        h3 id="error-budget" { "Error budget" }
        (of_budget)
        (table_of("What the error should be, 2‑D rms, m", head, html! { (rows(&names, 30, columns.len() + 2, row)) (total) }))
        (reasons.show())
    }
}

fn together(budget: &ErrorBudget) -> Markup {
    match budget.total_m {
        Some(total_m) => html! { b { (plain(total_m, 3)) } },
        None => html! { span title="a term is unknown" { (plain(budget.known_m, 3)) " from the others" } },
    }
}

// Where it helps

fn validity(scores: &ReplayScores, effect: Option<&Effect>, of_bands: &Markup) -> Markup {
    let is_shown = effect.is_none_or(|e| e.verdict != EffectVerdict::CannotTell);
    html! {
        h3 { "At which frequencies" }
        @if let Some(effect) = effect { p { "Over the whole flight: " (ended(&effect.words)) } }
        @if is_shown { (bands_of(scores, of_bands)) } @else { p { "By frequency: " (no_number("the whole is unknown")) "." } }
    }
}

fn bands_of(scores: &ReplayScores, of_bands: &Markup) -> Markup {
    let head = [
        Text("Compensator"),
        Number("Error below a tenth of raw, up to (Hz)"),
        Number("below a half, up to (Hz)"),
        Number("above raw, from (Hz)"),
        Number("Motion with less than a tenth (%)"),
        Number("in between (%)"),
        Number("above raw (%)"),
        Number("Lateness of position / of velocity / delay removed (ms)"),
    ];
    let found: Vec<(&str, &HelpfulBand)> =
        scores.compensators.iter().filter_map(|c| Some((c.name.as_str(), c.band.found()?))).collect();
    let hz = |value: Option<f64>, none: &'static str| html! { @match value { Some(f) => { (plain(f, 3)) } None => { (none) } } };
    let row = |(name, band): &(&str, &HelpfulBand)| {
        html! {
            tr {
                th scope="row" { code { (shown(name)) } }
                td.n { (hz(band.helps_below_hz, "nowhere")) }
                td.n { (hz(band.halves_below_hz, "nowhere")) }
                td.n { (hz(band.worse_above_hz, "never")) }
                @for k in 0..3 { td.n { (maybe(band.motion_share, |s| html! { (number::percent(s[k])) })) } }
                td.n { @for (k, s) in band.delays_s.iter().enumerate() { @if k > 0 { " / " } (plain(s * 1e3, 4)) } }
            }
        }
    };
    let mut reasons = Reasons::default();
    scores.compensators.iter().take(MOST).for_each(|c| reasons.add("band", &c.name, &c.band));
    html! {
        (of_bands)
        @if !found.is_empty() {
            (table("Frequencies and shares of the motion (power of the velocity)", &head, rows(&found, MOST, head.len(), row)))
        }
        p.note {
            "All up to one over the delay, where the raw error vanishes by chance; continuous time, fixes not held; \
             the filter that knows the mean age of a fix takes it as a part of both delays. Latenesses are those used \
             to judge the effect; one that does not differ significantly from the delay removed, or from zero, counts \
             as equal to it."
        }
        @if let Finding::CannotTell(why) = &scores.motion { p { "Motion: " (no_number(why)) } }
        (reasons.show())
    }
}

// What the aircraft computed

fn aircraft(onboard: &Finding<OnboardComparison>) -> Markup {
    html! {
        h2 id="onboard" { "What the aircraft computed in flight" }
        @match onboard {
            Finding::Found(found) => { (compared(found)) }
            Finding::CannotTell(why) => { p.why.unsure { (shown_block(why)) } }
        }
    }
}

fn compared(found: &OnboardComparison) -> Markup {
    let head = [
        Text("Compensator of the replay"),
        Number("On-board − this, 2‑D rms (m)"),
        Number("95 % below (m)"),
        Number("Largest (m)"),
        Number("Largest at the start (m)"),
        Number("On-board late by ± U (ms)"),
    ];
    let row = |a: &OnboardAgainst| {
        html! {
            tr {
                th scope="row" { code { (shown(&a.name)) } }
                @for x in [a.rms_m, a.p95_m, a.max_m] { td.n { (plain(x, 3)) } }
                td.n { (maybe(a.start_max_m, |x| plain(x, 3))) }
                td.n { (cell(&a.delay_s, |d| estimate(&in_millis(d)))) }
            }
        }
    };
    html! {
        p.answer {
            @match &found.reproduced_by {
                Finding::Found(name) => {
                    (badge("ok", "✓", "reproduced")) " " code { (shown(&found.channel)) } " is what " code { (shown(name)) }
                    " gives in the replay, to within " (plain(found.tolerance_m, 2)) "\u{a0}m."
                }
                Finding::CannotTell(why) => {
                    (badge("bad", "✗", "not reproduced")) " No compensator of the replay gives "
                    code { (shown(&found.channel)) } ": " (shown(why)) "."
                }
            }
        }
        (table("On-board minus replay, after the start; U with k = 2", &head, rows(&found.against, MOST, head.len(), row)))
        p.note {
            (number::count(found.compared)) " of " (number::counted(found.samples, "sample", "samples")) " compared, "
            @if found.same_stamps { "at the timestamps of the replay's rows. " }
            @else { "interpolated between the replay's rows. " }
            "Allowed: " (plain(found.tolerance_m, 2)) "\u{a0}m, " (shown(&found.tolerance_source)) ". The start is the first "
            (plain(found.start_s, 2)) "\u{a0}s and as long after every gap: the effect of the initial state has then \
                                       decayed."
        }
    }
}
