//! Which delay was removed and why, and the effect of the other candidates.

use super::Head::{Number, Text};
use super::{badge, estimate, expanded, finding, maybe, maybe_estimate, or_why, plain, rows, table};
use crate::figure::{Figure, objective_figure, sweep_figure};
use crate::number;
use crate::text::{ended, shown};
use crate::verdict::{in_millis, source_phrase};
use maud::{Markup, html};
use record::{
    DelayCandidate, DelayChoice, DelaySource, DelaySweep, Estimate, FlightRecord, ReplayRecord, SweepMethod,
    SweepOptimum, SweepScore,
};

/// Figures of the section, not yet numbered.
pub(super) fn figures(record: &FlightRecord) -> Vec<Figure> {
    let Some(replay) = &record.replay else { return vec![] };
    let sweep = replay.sweep.as_ref().and_then(|s| sweep_figure(s, replay.choice.as_ref()));
    let pair = record.delays.iter().flat_map(|d| &d.pairs).find(|pair| {
        pair.kind == record::DelayPairKind::PositionAgainstVelocity
            && pair.first == replay.pair.position
            && pair.second == replay.pair.velocity
    });
    let objective = pair.and_then(|pair| objective_figure(pair, pair.delay.found()?));
    sweep.into_iter().chain(objective).collect()
}

/// The section; empty for a record made before this analysis existed.
pub(super) fn section(replay: &ReplayRecord, figures: &Markup) -> Markup {
    html! {
        @if replay.choice.is_some() || replay.sweep.is_some() {
            h2 id="choice" { "Delays that could be removed" }
            @if let Some(choice) = &replay.choice {
                (remarks(choice, replay.sweep.as_ref()))
                (candidates(choice, replay.sweep.as_ref()))
            }
            @match &replay.sweep {
                Some(sweep) => { (swept(sweep)) }
                None => { p { "No delay sweep: too little of the flight has position and velocity together." } }
            }
            (figures)
        }
    }
}

fn remarks(choice: &DelayChoice, sweep: Option<&DelaySweep>) -> Markup {
    html! {
        @if is_fallback(choice) {
            p { (badge("unsure", "!", "Fallback")) " This is not the delay that the pipeline asks for first: " (ended(&choice.why)) }
        }
        @if choice.circular { p.why.unsure { (circularity(choice, sweep)) } }
    }
}

/// The network is requested by one name but reports one of two sources.
fn is_fallback(choice: &DelayChoice) -> bool {
    let of_network = matches!(choice.used, DelaySource::OthersFlights | DelaySource::OwnNetwork);
    choice.asked != choice.used && !(choice.asked == DelaySource::Network && of_network)
}

/// Why the same data cannot test a delay that was found in them.
fn circularity(choice: &DelayChoice, sweep: Option<&DelaySweep>) -> &'static str {
    let method = sweep.and_then(|s| s.optimum.found()).map(|o| o.method);
    match (choice.used, method) {
        (DelaySource::Sweep, Some(SweepMethod::Jackknife)) => {
            "The delay was found by minimizing the error against the reference. A small error afterwards does not test \
             the delay; another flight or the sensor card does."
        }
        _ => {
            "The delay was found in the same data that it is removed from. Their residual delay is then zero by \
             construction and tests nothing; a reference, another flight or the sensor card does."
        }
    }
}

/// Ends of the bars of the candidates, s. All share one scale, so that the table is a forest plot.
struct Scale(Option<(f64, f64)>);

impl Scale {
    fn of(choice: &DelayChoice, sweep: Option<&DelaySweep>) -> Scale {
        let best = sweep.and_then(|s| s.optimum.found()).map(|best| &best.delay_s);
        let all = choice.candidates.iter().filter_map(|c| c.delay_s.found()).chain(best);
        let ends = all.flat_map(|e| [-1.0, 1.0].map(|side| e.value + side * expanded(e).unwrap_or(0.0)));
        let ends: Vec<f64> = ends.filter(|end| end.is_finite()).collect();
        let (low, high) = (ends.iter().copied().reduce(f64::min), ends.iter().copied().reduce(f64::max));
        Scale(low.zip(high).filter(|(low, high)| high > low))
    }

    fn cell(&self, delay: Option<&Estimate>) -> Markup {
        let place = |at: f64| self.0.map_or(0.0, |(low, high)| (100.0 * (at - low) / (high - low)).clamp(0.0, 100.0));
        let style = delay.filter(|_| self.0.is_some()).map(|e| {
            let half = expanded(e).unwrap_or(0.0);
            let (from, to) = (place(e.value - half), place(e.value + half));
            format!("--a:{:.0}%;--b:{:.0}%", from.min(98.0), to.max(from + 2.0))
        });
        html! { td.n.range style=[style] { (maybe_estimate(delay.map(in_millis).as_ref())) } }
    }
}

fn candidates(choice: &DelayChoice, sweep: Option<&DelaySweep>) -> Markup {
    let score = match sweep.map(|s| &s.score) {
        Some(SweepScore::ErrorAgainst(_)) => "Error with it, 2‑D rms (m)",
        _ => "Step at a fix with it, 2‑D rms (m)",
    };
    let head = [
        Text("Delay"),
        Number("Td ± U (ms)"),
        Number("E_n against the removed one"),
        Number(score),
        Text("Where it comes from, or why it is missing"),
    ];
    let scale = Scale::of(choice, sweep);
    let row = |c: &DelayCandidate| {
        html! {
            tr {
                th scope="row" { (source_phrase(c.source)) @if c.source == choice.used { " " (badge("off", "●", "removed")) } }
                (scale.cell(c.delay_s.found()))
                td.n { (maybe(choice.e_n(c.source), agreement)) }
                td.n { (maybe_estimate(sweep.and_then(|s| s.score_at(c.source)).map(|p| &p.rms_m))) }
                td.any { (finding(&c.delay_s, |_| html! { (shown(&c.words)) })) }
            }
        }
    };
    let best = sweep.filter(|_| choice.candidates.iter().all(|c| c.source != DelaySource::Sweep));
    html! {
        (table("Delays that could be removed; U with k = 2", &head, html! {
            (rows(&choice.candidates, 10, head.len(), row))
            @if let Some(best) = best { (optimum_row(best, choice, &scale)) }
        }))
        p.note {
            "E_n = (Td − Td removed)/√(U₁² + U₂²) (ISO 13528): up to 1 in size they agree. An uncertainty that is not \
             stated counts as zero. The U of an error includes that of its delay. — where a delay is compared with itself, and for position against velocity, which \
             is not a lateness: it differs by the lateness of the velocity."
        }
    }
}

fn optimum_row(sweep: &DelaySweep, choice: &DelayChoice, scale: &Scale) -> Markup {
    html! {
        tr {
            th scope="row" { (source_phrase(DelaySource::Sweep)) }
            (scale.cell(sweep.optimum.found().map(|o| &o.delay_s)))
            td.n { (maybe(choice.e_n(DelaySource::Sweep), agreement)) }
            td.n { (maybe_estimate(sweep.score_at(DelaySource::Sweep).map(|p| &p.rms_m))) }
            td.any { (finding(&sweep.optimum, |o| html! { (method(o)) })) }
        }
    }
}

fn agreement(e_n: f64) -> Markup {
    html! {
        @if e_n.abs() <= 1.0 { (badge("ok", "✓", "agrees")) } @else { (badge("unsure", "!", "differs")) } " " (plain(e_n, 2))
    }
}

fn method(optimum: &SweepOptimum) -> &'static str {
    match optimum.method {
        SweepMethod::Jackknife => {
            "least error against the reference; interval by a delete-one jackknife over ten stretches of the flight"
        }
        SweepMethod::Estimator => {
            "no reference in the log: the delay estimator's objective decides, with the estimator's own interval"
        }
    }
}

fn swept(sweep: &DelaySweep) -> Markup {
    let bench = sweep.score_at(DelaySource::Card).map(|p| ("the bench value", p));
    let said = bench.or_else(|| sweep.score_at(DelaySource::Fixed).map(|p| ("the stated value", p)));
    html! {
        h3 { "What other delays would have done" }
        @if let Some((name, point)) = said {
            p.answer {
                "At " (name) ", " (estimate(&in_millis(&point.delay_s))) "\u{a0}ms, this flight would have had "
                b { (estimate(&point.rms_m)) "\u{a0}m" } " rms " (words(&sweep.score))
                @if let Some(best) = sweep.score_at(DelaySource::Sweep) {
                    ", at its best delay, " (estimate(&in_millis(&best.delay_s))) "\u{a0}ms, " b { (estimate(&best.rms_m)) "\u{a0}m" }
                }
                "."
            }
        }
        p {
            "Best delay: "
            (finding(&sweep.optimum, |o| html! {
                b { (estimate(&in_millis(&o.delay_s))) "\u{a0}ms" } ", 95 % interval "
                (interval(o)) "\u{a0}ms; " (method(o))
            }))
            ". " (note(sweep))
        }
    }
}

fn interval(optimum: &SweepOptimum) -> Markup {
    or_why(optimum.delay_s.standard_uncertainty, "no uncertainty is given", |u| {
        html! { (number::interval(optimum.interval_95_s.map(|s| s * 1e3), u * 1e3)) }
    })
}

fn words(score: &SweepScore) -> Markup {
    match score {
        SweepScore::ErrorAgainst(reference) => html! { "error against " code { (shown(reference)) } },
        SweepScore::StepAtFixes => html! { "step at a fix" },
    }
}

fn note(sweep: &DelaySweep) -> Markup {
    let samples = |one, many| number::counted(sweep.samples, one, many);
    match &sweep.score {
        SweepScore::ErrorAgainst(reference) => html! {
            "Scored are the same " (samples("row", "rows")) " with every delay, against " code { (shown(reference)) }
            ": a constant offset between position and reference counts as error, and the best delay is that of the position, \
             however late the velocity is."
        },
        SweepScore::StepAtFixes => html! {
            "Scored are the same " (samples("fix", "fixes"))
            " with every delay. The least step at a fix is drawn but not used: steps depend mostly on the noise of \
             single fixes."
        },
    }
}
