//! The answer: how late the position is, what was removed, whether that helped, what to do.

use super::Head::{Number, Text};
use super::{badge, estimate, expanded, maybe, maybe_estimate, plain, table};
use crate::number;
use crate::text::{ended, shown, shown_block};
use crate::verdict::{in_millis, source_phrase};
use maud::{Markup, html};
use record::{
    ChannelLateness, Decision, DelayAdvice, DelayAlarm, DelayKind, DelayNetwork, DelaySource, Effect, EffectVerdict,
    Estimate, FlightLateness, FlightRecord, FlightRow, Gravity, JudgedBy, NetworkDatum, Outcome, SweepMethod,
    SweepScore, flight_alarms,
};

/// An interval is asymmetric if its halves differ by more than this share of its length.
const UNEVEN: f64 = 0.1;

/// Result of a flight in one word: whether compensation helped, or why there was no comparison.
pub(super) fn result_badge(outcome: &Outcome, effect: Option<&Effect>) -> Markup {
    let (class, icon, word) = result_look(outcome, effect);
    badge(class, icon, word)
}

/// The result with less markup, for the table of flights.
pub(super) fn result_cell(outcome: &Outcome, effect: Option<&Effect>) -> Markup {
    let (class, icon, word) = result_look(outcome, effect);
    html! { b class=(class) { (icon) " " (word) } }
}

fn result_look(outcome: &Outcome, effect: Option<&Effect>) -> (&'static str, &'static str, &'static str) {
    match (outcome, effect) {
        (Outcome::Failed { .. }, _) => ("bad", "✗", "Failed"),
        (Outcome::Pending { .. }, _) => ("off", "…", "Pending"),
        (Outcome::NotMeasurable { .. }, _) => ("unsure", "○", "Not measurable"),
        (Outcome::Uncompensated { .. }, _) => ("off", "○", "Nothing removed"),
        (_, Some(effect)) => effect_look(effect.verdict),
        (Outcome::Compensated, None) => ("unsure", "?", "Effect unknown"),
    }
}

/// The result as the word that the table of flights is filtered by.
pub(super) fn result_word(outcome: &Outcome, effect: Option<&Effect>) -> &'static str {
    match (outcome, effect.map(|e| e.verdict)) {
        (Outcome::Failed { .. }, _) => "failed",
        (Outcome::Pending { .. }, _) => "pending",
        (Outcome::NotMeasurable { .. }, _) => "not measurable",
        (Outcome::Uncompensated { .. }, _) => "nothing removed",
        (_, Some(EffectVerdict::Helped)) => "helped",
        (_, Some(EffectVerdict::NoChange)) => "no change",
        (_, Some(EffectVerdict::Harmed)) => "harmed",
        (_, Some(EffectVerdict::CannotTell)) => "cannot tell",
        (Outcome::Compensated, None) => "unknown",
    }
}

fn effect_badge(verdict: EffectVerdict) -> Markup {
    let (class, icon, word) = effect_look(verdict);
    badge(class, icon, word)
}

fn effect_look(verdict: EffectVerdict) -> (&'static str, &'static str, &'static str) {
    match verdict {
        EffectVerdict::Helped => ("ok", "✓", "Helped"),
        EffectVerdict::NoChange => ("off", "○", "No change"),
        EffectVerdict::Harmed => ("bad", "✗", "HARMED"),
        EffectVerdict::CannotTell => ("unsure", "?", "Cannot tell"),
    }
}

/// The answer in four rows: how late, what was removed, the effect on the error, what to do. Then what the reader must
/// know.
pub(super) fn answer(record: &FlightRecord) -> Markup {
    let lateness = record.lateness.as_ref();
    html! {
        dl.answer {
            @if let Some(lateness) = lateness { dt { "How late" } dd { (late(lateness)) } }
            @if let Some(decision) = &record.decision { dt { "Removed" } dd { (removed(record, decision)) } }
            @if let Some(effect) = &record.effect { dt { "Error" } dd { (error(record, effect)) (held(record, effect)) } }
            @if let Some(lateness) = lateness { dt { "Do" } dd { (todo(record, lateness)) } }
        }
        (alarms(&flight_alarms(lateness, record.decision.as_ref())))
        @if let Some(file) = lateness.and_then(|l| l.reference_file.as_ref()) { p.note { "Reference file: " (ended(&file.words)) } }
    }
}

/// How late, then whether the delay is constant and what the answer is based on.
fn late(lateness: &FlightLateness) -> Markup {
    let first = lateness.words.find(". ").map_or(lateness.words.len(), |end| end + 1);
    let (first, rest) = lateness.words.split_at(first);
    let kind = kind_words(lateness);
    html! {
        @if lateness.kind == DelayKind::CannotTell { b { (kind) ": " (ended(first)) } }
        @else { b { (ended(first)) } " " (ended(&kind)) }
        @if !rest.is_empty() { span.note { (ended(rest)) } }
        (interval(lateness.lateness.as_ref()))
    }
}

/// The interval, if it is asymmetric about the value. Otherwise ± U is enough.
fn interval(channel: Option<&ChannelLateness>) -> Markup {
    let ends = channel.and_then(|c| Some((c.interval_95_s, c.lateness_s.value, c.lateness_s.standard_uncertainty?)));
    let uneven = ends.filter(|([low, high], value, _)| ((high - value) - (value - low)).abs() > UNEVEN * (high - low));
    html! {
        @if let Some((ends_s, _, u)) = uneven {
            " 95\u{a0}% interval: " (number::interval(ends_s.map(|s| s * 1e3), u * 1e3)) "\u{a0}ms."
        }
    }
}

/// Effect of the removal on the error, and the best possible result.
fn error(record: &FlightRecord, effect: &Effect) -> Markup {
    // If nothing was removed, nothing can have changed.
    let is_judged = matches!(record.outcome, Outcome::Compensated);
    html! {
        @if is_judged { (effect_badge(effect.verdict)) " " }
        (ended(&capitalised(after_verdict(&effect.words))))
        @if let Some(best) = effect.best_m.filter(|_| effect.short_by.is_some()) {
            " With the best delay it would be " b { (plain(best, 2)) "\u{a0}m" } "."
        }
    }
}

/// The error of the raw position while each fix is held, if it differs from the error at the fixes.
fn held(record: &FlightRecord, effect: &Effect) -> Markup {
    let raw =
        record.replay.iter().filter_map(|r| r.scores.as_ref()).flat_map(|s| &s.compensators).find(|c| c.name == "raw");
    let held_m = raw.and_then(|raw| raw.reference.found()).map(|r| r.rms_m);
    let fresh_m = effect.error_raw_m.filter(|_| matches!(effect.judged_by, JudgedBy::Truth(_)));
    html! {
        @if let (Some(held), Some(fresh)) = (held_m, fresh_m) {
            @if held.value > 1.05 * fresh.value {
                span.note { " This is at the fixes. Held until the next fix, the raw position is wrong by " (estimate(&held)) "\u{a0}m." }
            }
        }
    }
}

/// Test of the removed delay by the error against a reference: the best delay, and whether it agrees.
struct Tested<'a> {
    reference: &'a str,
    best_s: Estimate,
    e_n: f64,
    /// The removed delay leaves clearly more than the smallest possible error: a large U is no agreement.
    is_short: bool,
}

impl Tested<'_> {
    fn agrees(&self) -> bool {
        self.e_n.abs() <= 1.0 && !self.is_short
    }
}

fn tested(record: &FlightRecord) -> Option<Tested<'_>> {
    let replay = record.replay.as_ref()?;
    let sweep = replay.sweep.as_ref()?;
    let SweepScore::ErrorAgainst(reference) = &sweep.score else { return None };
    let best_s = sweep.optimum.found().filter(|o| o.method == SweepMethod::Jackknife)?.delay_s;
    let is_short = record.effect.as_ref().is_some_and(|effect| effect.short_by.is_some());
    Some(Tested { reference, best_s, e_n: replay.choice.as_ref()?.e_n(DelaySource::Sweep)?, is_short })
}

fn todo(record: &FlightRecord, lateness: &FlightLateness) -> Markup {
    let advice = &lateness.advice;
    let tested = tested(record).filter(|_| !lateness.kind.varies());
    let is_contradicted = record.decision.as_ref().is_some_and(|decision| decision.contradicted.is_some());
    html! {
        @if lateness.kind.varies() && advice.set.is_empty() { "Do not set one delay: it changes during the flight." }
        @else if let Some(tested) = tested.as_ref().filter(|_| advice.set.is_empty()) {
            @if tested.agrees() && is_contradicted { "The delay that was removed agrees with " code { (shown(tested.reference)) } ", but see the alarm below." }
            @else if tested.agrees() { "Nothing to set: the delay that was removed agrees with " code { (shown(tested.reference)) } "." }
            @else { "Remove " b { (estimate(&in_millis(&tested.best_s))) "\u{a0}ms" } " instead: the error against " code { (shown(tested.reference)) } " is least there." }
        } @else if advice.set.is_empty() && advice.fly.is_none() {
            @match lateness.lateness.as_ref().and_then(|l| l.relative_to.as_deref()) {
                Some(than) => {
                    "No setting can be recommended: the lateness of " code { (shown(than)) } " itself is unknown."
                    @if let Some(reference) = &lateness.checked_against {
                        " If " code { (shown(reference)) } " is on time, " code { "--reference-clock same" } " measures against it."
                    }
                }
                None => { "Nothing to set." }
            }
        }
        @if !advice.set.is_empty() { "By this flight alone, set " (settings(advice)) "." (unsuitable(&advice.set)) }
        @if let Some(fly) = &advice.fly { @if tested.is_some() || !advice.set.is_empty() { " " } "To know more: " (ended(&uncapitalised(fly))) }
    }
}

fn settings(advice: &DelayAdvice) -> Markup {
    html! {
        @for (i, s) in advice.set.iter().filter(|s| !s.unsuitable).enumerate() {
            @if i > 0 { " or " }
            code { (shown(&s.name)) " = " (s.value) } @if s.unit == "ms" { " (ms)" }
            @if !s.note.is_empty() { " (" (shown(&s.note)) ")" }
        }
    }
}

/// ` GPS1_DELAY_MS cannot remove it: it takes 0 to 250 ms.` for each setting that cannot.
pub(super) fn unsuitable(set: &[record::DelaySetting]) -> Markup {
    html! {
        @for s in set.iter().filter(|s| s.unsuitable) {
            " " code { (shown(&s.name)) } " cannot remove it: " (shown(&s.note)) "."
        }
    }
}

/// What was removed. Without a replay nothing was removed, whatever was decided.
fn removed(record: &FlightRecord, decision: &Decision) -> Markup {
    let of_replay = record.replay.as_ref().map(|replay| (&replay.settings, decision.used));
    html! {
        @match (of_replay, &record.outcome) {
            (Some((settings, used)), _) => {
                b {
                    (estimate(&in_millis(&Estimate {
                        value: settings.delay.seconds(),
                        standard_uncertainty: settings.delay_uncertainty_s,
                    }))) "\u{a0}ms"
                }
                @if let Some(used) = used { " (" (source_phrase(used)) ")" }
                ". " (ended(&capitalised(&decision.words)))
                @if let Some(tested) = tested(record) {
                    " The error against " code { (shown(tested.reference)) } " is least at " b { (estimate(&in_millis(&tested.best_s))) "\u{a0}ms" }
                    @if tested.agrees() { ", which agrees." }
                    @else if tested.is_short { ", and the removed delay leaves a clearly larger error." }
                    @else { ", which differs (E_n = " (plain(tested.e_n, 2)) ")." }
                }
                @if decision.circular { " The delay was found in this flight, so the residual does not show whether it \
                                         is right." }
            }
            (None, Outcome::Uncompensated { reason } | Outcome::NotMeasurable { reason } | Outcome::Failed { reason })
                if decision.used.is_some() =>
            {
                b { "Nothing." } " " (ended(&capitalised(reason)))
            }
            (None, _) => { b { "Nothing." } " " (ended(&capitalised(decision.words.trim_end_matches(" Nothing is removed.")))) }
        }
    }
}

/// The text with a capital first letter, unless it begins with the name of a file or of a channel.
fn capitalised(words: &str) -> String {
    let is_name = words
        .split_whitespace()
        .next()
        .is_some_and(|first| first.trim_end_matches([':', '.', ',']).contains(['.', '_', '/']));
    if is_name {
        return words.to_owned();
    }
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// The text with a small first letter, as after a colon.
fn uncapitalised(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

/// The sentence of an effect without the verdict, which is in the badge.
fn after_verdict(words: &str) -> &str {
    let verdicts = ["helped: ", "harmed: ", "no change: ", "cannot tell: "];
    verdicts.iter().find_map(|verdict| words.strip_prefix(verdict)).unwrap_or(words)
}

fn kind_words(lateness: &FlightLateness) -> String {
    let is_relative = lateness.lateness.as_ref().is_some_and(|l| l.relative_to.is_some());
    let words = match lateness.kind {
        DelayKind::OnTime if is_relative => "nearly at the same time",
        DelayKind::Early if is_relative => "earlier",
        DelayKind::NotTested if lateness.position.as_deref().is_some_and(record::is_filter_output) => {
            "not tested for changes, because it is the output of a filter"
        }
        DelayKind::NotTested => "not tested for changes",
        DelayKind::Scatters => "differs between windows by more than their uncertainties, for an unknown reason",
        kind => kind.word(),
    };
    lateness.also.iter().fold(capitalised(words), |words, also| format!("{words}, {}", also.replace('-', " ")))
}

fn alarms(alarms: &[DelayAlarm]) -> Markup {
    html! {
        @for alarm in alarms {
            @match alarm.gravity {
                Gravity::Red => { p.why { (badge("bad", "!", "Red alarm")) " " (shown_block(&alarm.text)) } }
                Gravity::Amber => { p.why.unsure { (badge("unsure", "!", "Amber alarm")) " " (shown_block(&alarm.text)) } }
                Gravity::Grey => { p.note { (shown(&alarm.text)) } }
            }
        }
    }
}

/// The lateness of each channel, with its evidence.
pub(super) fn network(network: &DelayNetwork) -> Markup {
    let has_datum = network.channels.iter().any(|c| c.relative_to.is_none());
    let (title, what, caption) = match has_datum {
        true => (
            "One lateness for each channel",
            "Lateness ± U (ms)",
            "Lateness of each channel from all pairs together; U with k = 2",
        ),
        false => (
            "One difference for each channel",
            "Later by ± U (ms)",
            "How much later each channel is, from all pairs together; the lateness of each is unknown; U with k = 2",
        ),
    };
    let head = [
        Text("Channel"),
        Number(what),
        Number("95 % interval (ms)"),
        Text("Against"),
        Number("Part of U from model errors (ms)"),
        Text("Based on"),
    ];
    let body = html! { @for channel in &network.channels { (channel_row(channel)) } };
    html! {
        h2 #network { (title) }
        p { (shown(&network.datum_words)) }
        p { (shown(&network.verdict_words)) }
        (table(caption, &head, body))
        @if !network.unused_pairs.is_empty() {
            details {
                summary { (number::counted(network.unused_pairs.len() as u64, "pair", "pairs")) " not used" }
                ul { @for p in &network.unused_pairs { li { code { (shown(&p.first)) } " against " code { (shown(&p.second)) } ": " (shown(&p.why)) } } }
            }
        }
    }
}

fn channel_row(c: &ChannelLateness) -> Markup {
    let against = match (&c.relative_to, c.datum) {
        (Some(zero), _) => format!("relative to {zero}"),
        (None, NetworkDatum::Reference) => "the reference".to_owned(),
        (None, _) => "the IMU".to_owned(),
    };
    html! {
        tr {
            th scope="row" { code { (shown(&c.channel)) } }
            td.n { (maybe_estimate(Some(&in_millis(&c.lateness_s)))) }
            td.n { @match c.lateness_s.standard_uncertainty.filter(|u| *u > 0.0) {
                Some(u) => { (number::interval(c.interval_95_s.map(|s| s * 1e3), u * 1e3)) }
                None => { "—" }
            } }
            td { (shown(&against)) }
            // Rounding leaves 1e-17 where there is no such part.
            td.n { (plain(if c.model_uncertainty_s < 1e-9 { 0.0 } else { c.model_uncertainty_s * 2e3 }, 2)) }
            td.any {
                (maybe(c.rests_on.as_deref(), |text| html! { (shown(text)) }))
                @if let Some(own) = &c.filter_not_a_delay { ". A filter, not a delay: " (estimate(&in_millis(own))) "\u{a0}ms against its own IMU." }
            }
        }
    }
}

/// Kind of delay and what it is relative to, in the table of all flights.
pub(super) fn kind_cells(row: &FlightRow) -> Markup {
    let lateness = row.lateness.as_ref();
    html! {
        td { @match lateness { Some(l) => { (shown(&l.kind_name())) } None => { "—" } } }
        td { @match lateness.filter(|l| l.lateness.is_some()) { Some(l) => { (shown(&l.against)) } None => { "—" } } }
    }
}

/// Number of alarms of a flight by severity. Grey ones do not count as alarms.
pub(super) fn alarm_badges(alarms: &[DelayAlarm]) -> Markup {
    let of = |gravity| alarms.iter().filter(move |a| a.gravity == gravity);
    let one = |gravity, class, word| {
        let count = of(gravity).count();
        let plural = if count == 1 { "" } else { "s" };
        html! { @if count > 0 { (badge(class, "!", &format!("{count} {word}{plural}"))) } }
    };
    html! { (one(Gravity::Red, "bad", "red alarm")) (one(Gravity::Amber, "unsure", "amber alarm")) }
}

/// Error before and after, in the table of all flights.
pub(super) fn effect_cells(row: &FlightRow) -> Markup {
    let effect = row.effect.as_ref();
    let cell = |value: Option<&record::Estimate>| match value {
        Some(value) => html! { td data-v=(value.value) data-u=[expanded(value)] { (number::with_uncertainty(value)) } },
        None => html! { td.n { "—" } },
    };
    html! {
        @match effect.and_then(|e| Some((e.error_raw_m.as_ref()?, &e.judged_by))) {
            Some((error, JudgedBy::Velocity(name))) => {
                td data-v=(error.value) data-u=[expanded(error)] {
                    (number::with_uncertainty(error)) ", if " code { (shown(name)) } " is on time"
                }
            }
            error => { (cell(error.map(|(error, _)| error))) }
        }
        (cell(effect.filter(|_| row.delay_s.is_some()).and_then(|e| e.error_compensated_m.as_ref())))
    }
}
