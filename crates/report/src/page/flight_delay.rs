//! Delays measured in the flight itself: the main pair first, then all pairs.

use super::Head::{Number, Text};
use super::campaign::p_value;
use super::{badge, estimate, exact, figure, maybe, maybe_estimate, no_number, plain, rows, table};
use crate::figure::{Figure, delay_over_time};
use crate::number;
use crate::text::{ended, shown, shown_block};
use crate::verdict::in_millis;
use maud::{Markup, html};
use record::{
    DelayGroup, DelayHomogeneity, DelayNoise, DelayPairKind, DelayPiece, DelaySplit, Estimate, Finding, FlightDelays,
    FlightInjection, FlightLateness, FlightRecord, MeasuredDelay, PairDelay, ReplayRecord,
};

/// Maximum number of rows in each table; the record has all.
const MOST: usize = 40;

/// Content of the section: all pairs and the main pair.
#[derive(Debug, Clone, Copy)]
pub(super) struct DelaySection<'a> {
    delays: &'a FlightDelays,
    replay: Option<&'a ReplayRecord>,
    main: Option<&'a PairDelay>,
}

/// `None` if the record has no delay analysis.
pub(super) fn of(record: &FlightRecord) -> Option<DelaySection<'_>> {
    let delays = record.delays.as_ref()?;
    let replay = record.replay.as_ref();
    let is_answer = |p: &&PairDelay| {
        record
            .lateness
            .as_ref()
            .is_some_and(|l| l.position.as_deref() == Some(&*p.first) && l.velocity.as_deref() == Some(&*p.second))
    };
    let is_told = |p: &&PairDelay| p.delay.found().is_some();
    let answers = || delays.pairs.iter().filter(is_told).find(is_answer);
    let first_measured = || delays.pairs.iter().find(is_told);
    let main = replay.and_then(|r| replayed(delays, r)).or_else(answers).or_else(first_measured);
    Some(DelaySection { delays, replay, main })
}

/// The main pair of a flight: the one that is replayed, or else the one that the answer rests on.
pub(super) fn main_pair(record: &FlightRecord) -> Option<&PairDelay> {
    of(record)?.main
}

/// The pair that the replay compensates.
pub(super) fn replayed<'a>(delays: &'a FlightDelays, replay: &ReplayRecord) -> Option<&'a PairDelay> {
    delays.pairs.iter().find(|p| is_replayed(p, replay))
}

fn is_replayed(pair: &PairDelay, replay: &ReplayRecord) -> bool {
    pair.kind == DelayPairKind::PositionAgainstVelocity
        && pair.first == replay.pair.position
        && pair.second == replay.pair.velocity
}

impl<'a> DelaySection<'a> {
    /// The main pair with its delay, if it was measured.
    fn measured(&self) -> Option<(&'a PairDelay, &'a MeasuredDelay)> {
        self.main.and_then(|pair| pair.delay.found().map(|found| (pair, found)))
    }

    /// The delay of the main pair over the flight.
    pub(super) fn figure(&self) -> Option<Figure> {
        self.measured().and_then(|(pair, found)| delay_over_time(pair, found))
    }
}

pub(super) fn section(all: &DelaySection, lateness: Option<&FlightLateness>, over_time: Option<&Figure>) -> Markup {
    html! {
        h2 id="delay" { "Delays of pairs of channels" }
        @match (all.main, all.measured()) {
            (_, Some((pair, found))) => { (answer(all, pair, found, lateness)) }
            (Some(pair), None) => { (no_answer(pair)) }
            (None, None) if all.delays.pairs.is_empty() => {
                p { "No two channels of this flight can be compared: a position and a velocity would do, or two positions." }
            }
            (None, None) => { p { "No pair of channels gives a delay; the table says why." } }
        }
        @if !all.delays.pairs.is_empty() { (pairs(&all.delays.pairs)) }
        @if let Some((pair, found)) = all.measured() { (details(pair, found, over_time)) }
    }
}

// The main pair in a sentence

fn answer(all: &DelaySection, pair: &PairDelay, found: &MeasuredDelay, lateness: Option<&FlightLateness>) -> Markup {
    let is_replayed = all.replay.is_some_and(|replay| is_replayed(pair, replay));
    let by_all = lateness.filter(|_| is_replayed).and_then(|l| l.position_minus_velocity_s);
    html! {
        p.answer {
            (sentence(pair, found))
            @if let Some(by_all) = by_all {
                " All pairs together: " b { (estimate(&in_millis(&by_all))) "\u{a0}ms" }
                ", as in the answer: its U comes from all pairs and from the errors of their models."
            }
        }
        @if let Some(alarm) = &found.alarm { p.why.unsure { (badge("unsure", "!", "Warning")) " " (shown_block(alarm)) } }
        @if let Some(rival) = found.rival_s {
            p.why.unsure {
                (badge("unsure", "!", "Warning")) " Another delay explains the data almost as well: " (plain(rival * 1e3, 4)) "\u{a0}ms."
            }
        }
    }
}

/// The result of a pair. A pair shows only a difference, not which of its channels is late.
fn sentence(pair: &PairDelay, found: &MeasuredDelay) -> Markup {
    let (word, sign) = if found.delay_s.value < 0.0 { ("earlier", -1e3) } else { ("later", 1e3) };
    let [low, high] = found.interval_95_s;
    let is_difference =
        matches!(pair.kind, DelayPairKind::PositionAgainstVelocity | DelayPairKind::VelocityAgainstAcceleration);
    html! {
        "This pair alone: " code { (shown(&pair.first)) } " is " b { (estimate(&number::scaled(&found.delay_s, sign))) "\u{a0}ms" } " "
        (word) " than " code { (shown(&pair.second)) }
        @if found.delay_s.standard_uncertainty.is_some() { " (k = 2)" } @else { " (no uncertainty given)" }
        @if low <= 0.0 && 0.0 <= high {
            "; its 95 % interval, " (interval_ms(found.interval_95_s, &found.delay_s)) "\u{a0}ms, includes zero"
        }
        @if is_difference { ". This pair does not show how late either is." } @else { "." }
    }
}

fn no_answer(pair: &PairDelay) -> Markup {
    html! {
        p.answer {
            "How much later " code { (shown(&pair.first)) } " is than " code { (shown(&pair.second))}
            " is unknown from this flight."
        }
        @if let Finding::CannotTell(why) = &pair.delay { p.why.unsure { (shown_block(why)) } }
    }
}

// All pairs

fn pairs(pairs: &[PairDelay]) -> Markup {
    let head = [
        Text("First"),
        Text("Second"),
        Number("δ ± U (ms)"),
        Number("95 % interval (ms)"),
        Number("Smallest detectable delay (ms)"),
        Number("Samples"),
        Text("What it means, or why it is missing"),
    ];
    // The first row of each kind of pair explains what the kind means.
    let is_first = |i: usize| pairs[..i].iter().all(|p| p.kind != pairs[i].kind || p.delay.found().is_none());
    let numbered: Vec<(bool, &PairDelay)> = pairs.iter().enumerate().map(|(i, pair)| (is_first(i), pair)).collect();
    html! {
        details {
            summary { (number::counted(pairs.len() as u64, "pair was", "pairs were")) " tried" }
            (table("All pairs that were tried; positive: the first is later than the second; U with k = 2", &head,
                rows(&numbered, MOST, head.len(), pair_row)))
        }
    }
}

fn pair_row(&(says_meaning, pair): &(bool, &PairDelay)) -> Markup {
    let found = pair.delay.found();
    html! {
        tr {
            th scope="row" { code { (shown(&pair.first)) } }
            td.any { code { (shown(&pair.second)) } }
            td.n { (maybe_estimate(found.map(|f| in_millis(&f.delay_s)).as_ref())) }
            td.n { (maybe(found, |f| interval_ms(f.interval_95_s, &f.delay_s))) }
            td.n { (maybe(found, |f| plain(f.smallest_detectable_s * 1e3, 2))) }
            td.n { (maybe(found, |f| html! { (number::count(f.samples)) })) }
            td.any {
                @match &pair.delay {
                    Finding::Found(_) if says_meaning => { (shown(&pair.meaning)) }
                    Finding::Found(_) => { "as above" }
                    Finding::CannotTell(why) => { (no_number(why)) }
                }
            }
        }
    }
}

/// The interval, rounded to the digits of the value.
fn interval_ms(interval_s: [f64; 2], of: &Estimate) -> Markup {
    let [low, high] = interval_s.map(|s| s * 1e3);
    match of.standard_uncertainty {
        Some(u) => html! { (number::interval([low, high], u * 1e3)) },
        None => html! { (number::significant(low, 3)) "\u{a0}to\u{a0}" (number::significant(high, 3)) },
    }
}

// More about the main pair

fn details(pair: &PairDelay, found: &MeasuredDelay, over_time: Option<&Figure>) -> Markup {
    html! {
        @match over_time {
            Some(over_time) => { (figure(over_time)) }
            None => { p { (no_number("the record has no window of the delay over time")) } }
        }
        (constancy(pair, found.homogeneity.filter(record::DelayHomogeneity::scatters)))
        h3 { code { (shown(&pair.first)) } " against " code { (shown(&pair.second)) } }
        (uncertainty(pair, found))
        (operating_points(found))
        (injections(&found.injections))
        (pieces(pair, &found.pieces))
    }
}

/// The test of constancy that determines the kind of the delay.
fn constancy(pair: &PairDelay, scatter: Option<DelayHomogeneity>) -> Markup {
    let Some(varies) = &pair.varies else { return html! {} };
    let constancy = &varies.constancy;
    html! {
        p {
            @if varies.kind.varies() {
                (ended(&varies.words))
            } @else if varies.unplaced_change {
                "The delay changes during the flight, or the position was reset along the track. The motion does not \
                 show when or by how much."
            } @else if let Some(scatter) = scatter {
                "The windows scatter by more than their bars (χ² = " (plain(scatter.chi2, 3)) ", "
                (number::counted(scatter.degrees_of_freedom, "degree", "degrees")) " of freedom, " (p_value(scatter.p))
                "), and "
                @if constancy.tested { "no step, drift or queue large enough to count was detected" } @else { "whether a step, drift or queue explains it was not tested" }
                ". U includes that scatter."
            } @else if let (true, Some(least_s)) = (constancy.tested, constancy.detectable_s) {
                @if constancy.note.is_none() { "No change of the delay was detected. " }
                "A lasting change of " (detectable(least_s * 1e3))
                "\u{a0}ms or more would have been detected."
            } @else {
                "Whether the delay changes was not tested: "
                (number::counted(constancy.windows, "window shows", "windows show")) " their delay, which is too few."
            }
            @if let Some(note) = &constancy.note { " " (ended(note)) }
        }
    }
}

/// The detectable change, ms, rounded as in the remarks of the record.
fn detectable(least_ms: f64) -> Markup {
    html! { data value=[Some(least_ms).filter(|v| v.is_finite())] { (number::fixed(least_ms, i32::from(least_ms < 9.95))) } }
}

fn uncertainty(pair: &PairDelay, found: &MeasuredDelay) -> Markup {
    let ms = |seconds: f64| html! { (plain(seconds * 1e3, 2)) "\u{a0}ms" };
    html! {
        p.note {
            "The position is fitted by the integral of the velocity (or the one track by the other), shifted by δ, with an \
             offset and a drift for each piece. Standard uncertainty from the curvature alone " (ms(found.hessian_s))
            ", allowing for autocorrelation (sandwich, HAC) " (ms(found.hac_s))
            @if found.widened_s > 0.0 { ", for what one delay does not explain " (ms(found.widened_s)) }
            "; Cramér–Rao bound at the fitted noise "
            (ms(found.crlb_s)) ". Outliers: about " (number::percent(found.outlier_share())) "\u{a0}% of the samples."
            @if let Some(origin) = &pair.origin { " t = 0: " (super::method::instant(origin.origin_ns, origin.clock)) "." }
        }
    }
}

/// A group with its split criterion. The first row also has the test of the split.
struct OperatingPoint<'a> {
    by: &'a str,
    group: &'a DelayGroup,
    p: Option<f64>,
}

fn points_of(split: &DelaySplit) -> impl Iterator<Item = OperatingPoint<'_>> {
    let point = |(i, group)| OperatingPoint { by: &split.by, group, p: split.p.filter(|_| i == 0) };
    split.groups.iter().enumerate().map(point)
}

fn operating_points(found: &MeasuredDelay) -> Markup {
    let points: Vec<OperatingPoint> = found.splits.iter().flat_map(points_of).collect();
    let row = |point: &OperatingPoint| {
        html! {
            tr {
                th scope="row" { (shown(point.by)) }
                td.n { (range(point.group.range)) }
                td.n { (number::count(point.group.samples)) }
                td.n { (estimate(&in_millis(&point.group.delay_s))) }
                td.n { @if let Some(p) = point.p { (plain(p, 2)) } }
            }
        }
    };
    let head = [Text("Split by"), Number("Range"), Number("Samples"), Number("δ ± U (ms)"), Number("p of one delay")];
    html! {
        @if points.is_empty() { p { "By operating point: " (no_number("the flight has no two that differ enough")) } }
        @else { (table("By operating point; U with k = 2", &head, rows(&points, MOST, head.len(), row))) }
    }
}

/// A range, or one number if both ends are equal, such as a number of satellites.
fn range([low, high]: [f64; 2]) -> String {
    if low == high {
        return number::exact(low);
    }
    format!("{}\u{a0}to\u{a0}{}", number::significant(low, 3), number::significant(high, 3))
}

fn injections(injections: &[FlightInjection]) -> Markup {
    let row = |i: &FlightInjection| {
        html! {
            tr {
                td.n { (exact(i.injected_s * 1e3)) }
                td.n { (estimate(&in_millis(&i.error_s))) }
                td.n { (interval_ms(i.interval_95_s, &i.error_s)) }
                td.n { (number::clock(i.split_s, 0)) }
            }
        }
    };
    let head = [
        Number("Delay added (ms)"),
        Number("Recovered − added ± U (ms)"),
        Number("95 % interval (ms)"),
        Number("Second half begins (h:mm:ss)"),
    ];
    html! {
        @if injections.is_empty() { p { "Injection and recovery: " (no_number("nothing was injected")) } }
        @else {
            (table("Known delays added to the second half of the flight and measured again; U with k = 2", &head,
                rows(injections, MOST, head.len(), row)))
            p.note { "Expected: 19 of 20 intervals contain zero. Both halves carry the same information." }
        }
    }
}

fn pieces(pair: &PairDelay, pieces: &[DelayPiece]) -> Markup {
    let (drift, noise) = match pair.kind {
        DelayPairKind::VelocityAgainstAcceleration => ("m/s²", "m/s"),
        _ => ("m/s", "m"),
    };
    let row = |piece: &DelayPiece| {
        html! {
            tr {
                td.n { (number::clock(piece.start_s, 1)) }
                td.n { (number::clock(piece.end_s, 1)) }
                td.any { @if piece.begun_by.is_empty() { "the record begins" } @else { (shown(&piece.begun_by)) } }
                @for drift in &piece.drift { td.n { (estimate(drift)) } }
                @for noise in &piece.noise { td.any { (noise_words(noise)) } }
            }
        }
    };
    let head = [
        Number("From (h:mm:ss)"),
        Number("To (h:mm:ss)"),
        Text("Started by"),
        Number("Drift north"),
        Number("Drift east"),
        Text("Noise north"),
        Text("Noise east"),
    ];
    let caption =
        format!("Segments, each with its own offset and drift; drift in {drift} (± U, k = 2), noise (σ) in {noise}");
    html! {
        @if pieces.is_empty() { p { "Pieces: " (no_number("the record holds none")) } }
        @else { (table(&caption, &head, rows(pieces, MOST, head.len(), row))) }
    }
}

fn noise_words(noise: &DelayNoise) -> Markup {
    html! {
        "white noise " (plain(noise.white_std, 2))
        @if let Some(wander) = noise.wander_std {
            "; slow wander " (plain(wander, 2))
            @if let Some(s) = noise.time_constant_s { ", time constant " (plain(s, 2)) " s" }
        }
    }
}
