//! Curves for the figures: every extreme is kept, and lines break at gaps.

mod lead;

use crate::estimate::Positions;
use crate::input::Input;
use crate::rows::{Rows, median_step};
use crate::settings::Settings;
use record::{AxisCurves, Curve, LeadCurves, Zoom};

/// Time bins per curve: with four rows kept per bin, this is finer than a page's pixel columns.
const BINS: usize = 450;

pub(crate) struct Curves {
    pub(crate) axes: Vec<AxisCurves>,
    pub(crate) zoom: Option<Zoom>,
    pub(crate) lead: Option<LeadCurves>,
}

/// Further compensators that are drawn in addition to the default ones; more would hide each other.
const FURTHER_DRAWN: usize = 2;

/// The default ones and the first two of the others; the rest appear in the tables and the track only.
fn drawn(estimates: &[Positions]) -> Vec<&Positions> {
    let always = estimates.iter().filter(|e| e.further.is_none());
    always.chain(estimates.iter().filter(|e| e.further.is_some()).take(FURTHER_DRAWN)).collect()
}

pub(crate) fn draw(input: &Input, settings: &Settings, rows: &Rows, estimates: &[Positions]) -> Curves {
    let drawing = Drawing { input, rows, estimates: drawn(estimates) };
    Curves {
        axes: drawing.axes((rows.t[0], rows.t[rows.t.len() - 1])),
        zoom: hardest(input, rows, settings).map(|(start_s, end_s, why)| Zoom {
            start_s,
            end_s,
            why,
            axes: drawing.axes((start_s, end_s)),
        }),
        lead: lead::lead(input, rows, &drawing.estimates),
    }
}

/// Sources of the curves.
struct Drawing<'a> {
    input: &'a Input,
    rows: &'a Rows,
    estimates: Vec<&'a Positions>,
}

impl Drawing<'_> {
    fn axes(&self, window: (f64, f64)) -> Vec<AxisCurves> {
        let axis =
            |(k, name): (usize, &str)| AxisCurves { axis: name.to_owned(), position_m: self.positions(k, window) };
        ["north", "east"].into_iter().enumerate().map(axis).collect()
    }

    /// Positions of all estimates and of the reference.
    fn positions(&self, axis: usize, window: (f64, f64)) -> Vec<Curve> {
        let rows = self.rows;
        let of = |e: &&Positions| curve(e.title.clone(), rows, &e.axes[axis], |r| e.shown(rows, r), window);
        let reference = self.input.reference.as_ref();
        let reference = reference
            .map(|r| pen("reference".to_owned(), &r.t, &r.axes[axis], |_| true, 2.5 * median_step(&r.t), window));
        self.estimates.iter().map(of).chain(reference).collect()
    }
}

fn curve(name: String, rows: &Rows, y: &[f64], shown: impl Fn(usize) -> bool, window: (f64, f64)) -> Curve {
    pen(name, &rows.t, y, shown, rows.gap_s, window)
}

/// Draws the shown rows of a window, in strokes without gaps longer than `gap`.
fn pen(name: String, t: &[f64], y: &[f64], shown: impl Fn(usize) -> bool, gap: f64, window: (f64, f64)) -> Curve {
    let mut out = Curve { name, t_s: vec![], y: vec![], breaks: vec![], stands_for: 0 };
    for stroke in strokes(t, shown, gap, window) {
        let (t, y) = (&t[stroke.clone()], &y[stroke]);
        let kept = signal::min_max(t, y, bins(t, window));
        if !out.t_s.is_empty() {
            out.breaks.push(out.t_s.len() as u32);
        }
        out.t_s.extend(kept.rows.iter().map(|&r| t[r]));
        out.y.extend(kept.rows.iter().map(|&r| y[r]));
        out.stands_for += kept.stands_for as u64;
    }
    out
}

fn bins(t: &[f64], window: (f64, f64)) -> usize {
    let share = (t[t.len() - 1] - t[0]) / (window.1 - window.0).max(f64::MIN_POSITIVE);
    ((BINS as f64 * share) as usize).clamp(1, BINS)
}

fn strokes(t: &[f64], shown: impl Fn(usize) -> bool, gap: f64, window: (f64, f64)) -> Vec<std::ops::Range<usize>> {
    let mut out: Vec<std::ops::Range<usize>> = vec![];
    for row in t.partition_point(|&x| x < window.0)..t.partition_point(|&x| x <= window.1) {
        if !shown(row) {
            continue;
        }
        match out.last_mut() {
            Some(stroke) if stroke.end == row && t[row] - t[row - 1] <= gap => stroke.end = row + 1,
            _ => out.push(row..row + 1),
        }
    }
    out
}

/// The window with the most horizontal acceleration, from velocity differences over a second; differences across a gap
/// do not count.
fn hardest(input: &Input, rows: &Rows, settings: &Settings) -> Option<(f64, f64, String)> {
    const BASE_S: f64 = 1.0;
    let (first, last) = (rows.t[0], rows.t[rows.t.len() - 1]);
    if last - first <= 2.0 * settings.zoom_s {
        return None;
    }
    let [north, east] = &input.velocity.axes;
    let times = &input.velocity.t;
    let longest = 2.5 * median_step(times).max(BASE_S);
    let (mut t, mut gained, mut before) = (vec![], vec![], 0);
    for now in 1..times.len() {
        while times[now] - times[before] > BASE_S && before + 1 < now {
            before += 1;
        }
        let (h, step) = (times[now] - times[before], times[now] - times[now - 1]);
        if h <= longest && times[now] >= first && times[now] <= last {
            t.push(times[now]);
            gained.push((north[now] - north[before]).hypot(east[now] - east[before]) / h * step);
        }
    }
    let window = signal::largest_sum(&t, &gained, settings.zoom_s)?;
    let start = t[window.first];
    let mean = window.sum / settings.zoom_s;
    let why = format!("the {:.0} s with the largest mean horizontal acceleration, {mean:.1} m/s²", settings.zoom_s);
    Some((start, (start + settings.zoom_s).min(last), why))
}
