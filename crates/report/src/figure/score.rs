//! Where each compensator helps, over what the flight moved at.

use super::axis::Tick;
use super::{Axis, Figure, Line, Panel, Pen, is_drawable, outline};
use crate::number;
use crate::text::short_label;
use record::{HelpfulBand, MotionSpectrum, ReplayScores};

/// Most compensators drawn; the table has all.
const MOST_ROWS: usize = 8;

/// Delays that are drawn, s: an axis over other frequencies has no ticks that anybody could read.
const SHORTEST_S: f64 = 1e-4;
const LONGEST_S: f64 = 1e4;

/// The bands of the compensators below the spectrum of the motion; `None` without a band. Its number is the page's.
pub(crate) fn bands_figure(scores: &ReplayScores, number: u32) -> Option<Figure> {
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
        number,
        title: "Error by frequency, and where this flight moved".to_owned(),
        caption,
        how_to_read: "Good: all bars of the motion stand over the blue band. Over the pale part more of the error is left, \
                      over the thin line at its end it is more than raw's; noise of the velocity spreads thinly to the right.",
        panels,
        panel_size: (860, 150),
        fine: false,
    })
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
