//! The frequencies at which each compensator helps, over the spectrum of the flight's motion.

use super::axis::Tick;
use super::{Axis, Figure, Line, Panel, Pen, extent, is_drawable, outline, stroke};
use crate::number::{self, COVERAGE_FACTOR};
use crate::text::{label, short_label};
use record::{BudgetTerm, Estimate, HelpfulBand, MotionSpectrum, ReplayScores};

/// Maximum number of compensators drawn; the table has all.
const MOST_ROWS: usize = 8;

/// Range of delays that are drawn, s: outside it, the frequency axis would have no readable ticks.
const SHORTEST_S: f64 = 1e-4;
const LONGEST_S: f64 = 1e4;

/// The bands of the compensators below the spectrum of the motion; `None` without a band.
pub(crate) fn bands_figure(scores: &ReplayScores) -> Option<Figure> {
    let rows: Vec<(&str, &HelpfulBand)> = scores
        .compensators
        .iter()
        .filter_map(|c| Some((c.name.as_str(), c.band.found()?)))
        .filter(|(_, band)| (SHORTEST_S..=LONGEST_S).contains(&band.delays_s[0]))
        .take(MOST_ROWS)
        .collect();
    let (_, first) = rows.first()?;
    let motion = scores.motion.found().filter(|m| m.edges_hz.len() == m.share.len() + 1 && m.share.len() > 1);
    let drawable = |m: &&MotionSpectrum| m.edges_hz.iter().chain(&m.share).all(|x| is_drawable(*x));
    let motion = motion.filter(drawable);
    let (low, high) = match motion {
        Some(m) => (m.edges_hz[0].max(1e-3), m.edges_hz[m.edges_hz.len() - 1].clamp(1.0 / first.delays_s[0], 1e5)),
        None => (0.01, 1.0 / first.delays_s[0]),
    };
    let x = Axis::logarithmic("frequency (Hz)", (low, high));
    let mut panels: Vec<Panel> = motion.map(|m| spectrum(m, &x)).into_iter().collect();
    panels.push(bars(&rows, &x));
    let mut caption = format!(
        "Power of the horizontal velocity by frequency, percent in each twelfth of a decade, and below it for each \
         compensator, from slow motion to one over the delay: where its error is below {} of the raw one, and where it is \
         worse than raw.",
        number::exact(first.factor)
    );
    match motion {
        Some(m) => caption += &format!(" Spectrum over {} s.", number::significant(m.duration_s, 3)),
        None => caption += " The record holds no spectrum.",
    }
    Some(Figure {
        id: "bands".to_owned(),
        number: 0,
        title: finding(&rows),
        caption,
        how_to_read: "Good: all bars of the motion are above the blue band. Above the pale part, more of the error \
                      remains. Above the thin line at its end, the error exceeds raw's. Noise of the velocity spreads \
                      thinly to the right.",
        panels,
        panel_size: (860, 150),
        fine: false,
    })
}

/// Frequency below which the exact form, or else the first compensator with a limit, helps.
fn finding(rows: &[(&str, &HelpfulBand)]) -> String {
    let of = rows.iter().find(|(name, _)| *name == "exact-async").or(rows.first());
    match of.and_then(|(name, band)| Some((name, band.helps_below_hz?, band.motion_share))) {
        Some((name, hz, share)) => {
            let of_motion = share.map(|s| format!(", {}\u{a0}% of this flight's motion", number::percent(s[0])));
            let (name, hz) = (short_label(name), number::significant(hz, 2));
            format!("{name} removes most of the error up to {hz}\u{a0}Hz{}", of_motion.unwrap_or_default())
        }
        None => "No motion is slow enough for most of the error to be removed".to_owned(),
    }
}

/// Name of a term, short enough for an axis; the table has its formula.
fn without_formula(name: &str) -> String {
    label(name.split(',').next().unwrap_or_default()).chars().take(30).collect()
}

/// Error terms of the exact form as bars, their sum and the measured error; `None` if no term is known.
pub(crate) fn budget_figure(scores: &ReplayScores) -> Option<Figure> {
    let of = scores.compensators.iter().find(|c| c.name == "exact-async")?;
    let known = |t: &BudgetTerm| Some((without_formula(&t.name), *t.size_m.found()?)).filter(|(_, m)| is_drawable(*m));
    let terms: Vec<(String, f64)> = of.budget.terms.iter().filter_map(known).take(MOST_ROWS).collect();
    let sum = of.budget.total_m.unwrap_or(of.budget.known_m);
    if terms.is_empty() || !is_drawable(sum) {
        return None;
    }
    let together = if of.budget.total_m.is_some() { "together" } else { "together, without the unknown terms" };
    let measured = of.budget.measured_m.filter(|m| is_drawable(m.value));
    let (names, lines) = budget_rows(&terms, (together, sum), measured.as_ref());
    let (low, high) = extent(&lines, |p| p.0)?;
    let mut title = format!("Error of the compensated position: expected {}\u{a0}m", number::significant(sum, 2));
    if let Some(measured) = measured {
        title += &format!(", measured {}\u{a0}m", number::with_uncertainty(&measured));
    }
    let mut caption =
        "Terms of the error of the exact form, 2‑D rms in metres; together is the root of the sum of their squares."
            .to_owned();
    let unknown = of.budget.terms.len() - terms.len();
    if unknown > 0 {
        caption += &format!(" Not known, so not drawn: {}.", number::counted(unknown as u64, "term", "terms"));
    }
    let x = Axis::linear("2‑D rms (m)", (low.min(0.0), high), 8);
    Some(Figure {
        id: "budget".to_owned(),
        number: 0,
        title,
        caption,
        how_to_read: "The longest bar is what to work on. Good: measured lies at the end of the bar of all together. \
                      Bad: it lies beyond, because then something is missing in the budget.",
        panels: vec![Panel::of(x, Axis::rows(&names), lines)],
        panel_size: (700, 20 + 24 * names.len() as u32),
        fine: false,
    })
}

/// Row names from the top, and the contents of the rows: the terms, their sum and the measured error.
fn budget_rows(
    terms: &[(String, f64)],
    (together, sum): (&str, f64),
    measured: Option<&Estimate>,
) -> (Vec<String>, Vec<Line>) {
    let bar = |row: usize, m: f64| vec![(0.0, row as f64 - 0.3), (m, row as f64 + 0.3)];
    let expected = (0..).zip(terms).map(|(row, (_, m))| bar(row, *m)).collect();
    let mut names: Vec<String> = terms.iter().map(|(name, _)| name.clone()).collect();
    let row = names.len() as f64;
    let whole = outline((0.0, row - 0.3), (sum, row + 0.3));
    let mut lines = vec![
        Line { name: "expected, each term".to_owned(), pen: Pen::Bars, pieces: expected },
        stroke(together, Pen::Uncertainty, whole),
    ];
    names.push(together.to_owned());
    if let Some(measured) = measured {
        let half = COVERAGE_FACTOR * measured.standard_uncertainty.unwrap_or(0.0);
        let row = names.len() as f64;
        let point = vec![(measured.value, row), (measured.value - half, row), (measured.value + half, row)];
        lines.push(stroke("measured ± U (k = 2)", Pen::Points, point));
        names.push("measured".to_owned());
    }
    (names, lines)
}

fn spectrum(motion: &MotionSpectrum, x: &Axis) -> Panel {
    let inside = |from: f64, to: f64| (from.max(x.low), to.min(x.high));
    let bars = motion.edges_hz.windows(2).zip(&motion.share).filter_map(|(edge, share)| {
        let (from, to) = inside(edge[0], edge[1]);
        (to > from && *share > 0.0).then(|| vec![(from, 0.0), (to, 100.0 * share)])
    });
    let line = Line { name: "velocity of this flight".to_owned(), pen: Pen::Bars, pieces: bars.collect() };
    let most = motion.share.iter().copied().fold(0.0, f64::max);
    let y = Axis::exactly("power (%)", (0.0, 105.0 * most.max(0.01)), 5);
    Panel::of(x.clone(), y, vec![line])
}

fn bars(rows: &[(&str, &HelpfulBand)], x: &Axis) -> Panel {
    let (mut helps, mut between, mut worse) = (vec![], vec![], vec![]);
    let end = |band: &HelpfulBand| (1.0 / band.delays_s[0]).clamp(x.low, x.high);
    for (row, (_, band)) in rows.iter().enumerate() {
        let (bottom, top) = (row as f64 - 0.1, row as f64 + 0.1);
        let inside = |hz: f64| hz.clamp(x.low, end(band));
        let helped = band.helps_below_hz.map_or(x.low, inside);
        let harmed = band.worse_above_hz.map_or(end(band), inside).max(helped);
        let middle = row as f64;
        if helped > x.low {
            helps.push(vec![(x.low, middle), (helped, middle)]);
        }
        if harmed > helped {
            between.push(outline((helped, bottom), (harmed, top)));
        }
        if end(band) > harmed {
            worse.push(vec![(harmed, middle), (end(band), middle)]);
        }
    }
    let ticks = rows.iter().enumerate().map(|(row, (name, _))| Tick { at: row as f64, label: short_label(name) });
    let y = Axis::ticked("", (-0.6, rows.len() as f64 - 0.4), ticks.collect());
    let mut lines = vec![
        Line { name: "error less than raw's".to_owned(), pen: Pen::Uncertainty, pieces: between },
        Line { name: "less than a tenth of raw's".to_owned(), pen: Pen::Band, pieces: helps },
        Line { name: "worse than raw".to_owned(), pen: Pen::Rule, pieces: worse },
    ];
    lines.retain(|line| !line.pieces.is_empty());
    Panel::of(x.clone(), y, lines)
}
