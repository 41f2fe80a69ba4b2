//! The figures of a flight: Fig. 7 of the paper in its hardest turn, the turn from above, the lead, the track.

use super::curve::{Tally, lines};
use super::{Axis, Dimension, Figure, Ground, LEADS, Line, Mark, Panel, Pen, Span, extent, outline, stroke};
use crate::number::{self, COVERAGE_FACTOR};
use crate::text::{sentence, short_label};
use crate::verdict::in_millis;
use record::{AxisCurves, Curve, Estimate, FlightRecord, Lead, LeadCurves, LeadTrack, ReplayRecord, Zoom};

const WIDE: (u32, u32) = (860, 215);
const TIME: &str = "time since the first sample";
const RAW: &str = "raw, newest fix held";
const EXACT: &str = "compensated (exact form)";
const REFERENCE: &str = "reference";

/// All figures of a flight that have something to show, not yet numbered.
pub(crate) fn flight_figures(record: &FlightRecord) -> Vec<Figure> {
    let Some(replay) = record.drawable() else { return vec![] };
    let is_trial = record.replay.is_none();
    let late = Late::of(record);
    let lead = replay.lead.as_ref();
    let turn_from_above = replay.zoom.as_ref().and_then(|zoom| turn(replay, zoom));
    [
        fig_7(replay, late.as_ref(), is_trial),
        turn_from_above,
        lead.and_then(|lead| track(&lead.track, replay)),
        lead.and_then(|lead| lead_over_time(replay, lead, late.as_ref())),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// The curves of the record that a figure of a flight draws: raw, the exact form, the reference.
fn chosen<'a>(replay: &ReplayRecord, curves: &'a [Curve]) -> Vec<(&'static str, Pen, &'a Curve)> {
    let kind = |curve: &Curve| {
        let of = replay.compensators.iter().find(|c| !c.title.is_empty() && curve.name.ends_with(&c.title));
        match of.map(|c| c.name.as_str()) {
            Some("raw") => Some((RAW, Pen::Raw)),
            Some("exact-async") => Some((EXACT, Pen::Exact)),
            None if curve.name == REFERENCE => Some((REFERENCE, Pen::Reference)),
            _ => None,
        }
    };
    curves.iter().filter_map(|curve| kind(curve).map(|(name, pen)| (name, pen, curve))).collect()
}

fn drawn(replay: &ReplayRecord, curves: &[Curve], tally: &mut Tally) -> Vec<Line> {
    let of = |(name, pen, curve): (&str, Pen, &Curve)| {
        let lines = lines(std::slice::from_ref(curve), &[pen], tally);
        lines.into_iter().map(|line| Line { name: name.to_owned(), ..line }).collect::<Vec<_>>()
    };
    chosen(replay, curves).into_iter().flat_map(of).collect()
}

/// What was removed, in ms.
fn removed(replay: &ReplayRecord) -> String {
    let delay = Estimate {
        value: replay.settings.delay.millis(),
        standard_uncertainty: replay.settings.delay_uncertainty_s.map(|s| s * 1e3),
    };
    format!("{}\u{a0}ms", number::with_uncertainty(&delay))
}

fn millis(seconds: &Estimate) -> String {
    format!("{}\u{a0}ms", number::with_uncertainty(&in_millis(seconds)))
}

/// Measured lateness of the position, and its reference.
struct Late<'a> {
    lateness_s: Estimate,
    /// The channel it is compared with, if the lateness of both is unknown.
    than: Option<&'a str>,
}

impl Late<'_> {
    fn of(record: &FlightRecord) -> Option<Late<'_>> {
        let channel = record.lateness.as_ref()?.lateness.as_ref()?;
        Some(Late { lateness_s: channel.lateness_s, than: channel.relative_to.as_deref() })
    }

    /// `203.3 ± 0.4 ms late`, `12 ± 3 ms earlier than velocity.ekf`.
    fn words(&self) -> String {
        let value = self.lateness_s.value;
        let size = Estimate { value: value.abs(), ..self.lateness_s };
        match self.than {
            None => format!("{} {}", millis(&size), if value < 0.0 { "early" } else { "late" }),
            Some(than) => format!(
                "{} {} than {}",
                millis(&size),
                if value < 0.0 { "earlier" } else { "later" },
                short_label(than)
            ),
        }
    }
}

/// The subject of the figures, in one line.
fn finding(replay: &ReplayRecord, late: Option<&Late>, is_trial: bool) -> String {
    match late {
        Some(late) if is_trial => {
            format!("The position is {}; nothing was removed, {} is a trial", late.words(), removed(replay))
        }
        None if is_trial => "Nothing was removed; this flight does not show how late the position is".to_owned(),
        Some(late) => format!("The position is {}; {} were removed", late.words(), removed(replay)),
        None => format!("{} were removed; this flight does not show how late the position is", removed(replay)),
    }
}

// Fig. 7

fn fig_7(replay: &ReplayRecord, late: Option<&Late>, is_trial: bool) -> Option<Figure> {
    let axes = replay.zoom.as_ref().map_or(&replay.axes, |zoom| &zoom.axes);
    let mut tally = Tally::default();
    let of_axes: Vec<(&AxisCurves, Vec<Line>)> =
        axes.iter().take(2).map(|axis| (axis, drawn(replay, &axis.position_m, &mut tally))).collect();
    let time = Axis::time(TIME, extent(of_axes.iter().flat_map(|(_, lines)| lines), |p| p.0)?, 10);
    // One bracket in each panel: the removed delay, and the measured lateness of the position.
    let brackets = [
        Some((
            replay.settings.delay.seconds(),
            format!("{}: {}", if is_trial { "trial" } else { "removed" }, removed(replay)),
        )),
        late.map(|late| (late.lateness_s.value, format!("measured: {}", late.words()))),
    ];
    let panels = of_axes.into_iter().zip(brackets).map(|((axis, lines), bracket)| {
        let range = extent(&lines, |p| p.1).unwrap_or((0.0, 0.0));
        let y = Axis::linear(&format!("{} (m)", crate::text::label(&axis.axis)), range, 6);
        let bracket = bracket.and_then(|(delay_s, label)| bracket_at(axis, replay, &time, delay_s, label));
        Panel { dimensions: bracket.into_iter().collect(), ..Panel::of(time.clone(), y, lines) }
    });
    let panels: Vec<Panel> = panels.collect();
    let mut window = replay.zoom.as_ref().map_or(String::new(), window_words);
    window += "Position north and east in metres over time, as Fig. 7 of Park and Lee.";
    Some(Figure {
        id: "fig-7".to_owned(),
        number: 0,
        title: finding(replay, late, is_trial),
        caption: tally.caption(&window),
        how_to_read: "Good: the compensated curve lies on the reference, or reaches each turning point as long before raw \
                      as raw is late, at the same height. Bad: it runs ahead of the reference, or its peaks differ in height.",
        panels,
        panel_size: WIDE,
        fine: false,
    })
}

/// `0:01:02.0 to 0:01:12.0, the 10 s with the largest acceleration. `
fn window_words(zoom: &Zoom) -> String {
    let why = sentence(zoom.why.trim_end_matches('.'));
    format!("{} to {}, {why}. ", number::clock(zoom.start_s, 1), number::clock(zoom.end_s, 1))
}

/// A bracket from the timestamp of a fix back by a delay, where the position changes fastest.
fn bracket_at(axis: &AxisCurves, replay: &ReplayRecord, time: &Axis, delay_s: f64, label: String) -> Option<Dimension> {
    let all = chosen(replay, &axis.position_m);
    let of = |name: &str| all.iter().find(|(n, _, _)| *n == name).map(|(_, _, curve)| *curve);
    let (raw, exact) = (of(RAW)?, of(EXACT)?);
    let room = (time.high - time.low) * 0.12;
    let slope = |t: f64| {
        let (a, b) = (value_at(exact, t - delay_s - 0.5)?, value_at(exact, t - delay_s + 0.5)?);
        Some((b - a).abs())
    };
    let inside = |t: f64| t - delay_s.max(0.0) - room > time.low && t + room < time.high;
    let steepest = fixes(raw)
        .into_iter()
        .filter(|(t, _)| inside(*t))
        .filter_map(|(t, y)| Some((slope(t)?, t, y)))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    let (_, t, y) = steepest;
    Some(Dimension { from: t - delay_s, to: t, at: y, label })
}

/// Times and values at which a held curve changes; every point of a curve that is not held.
fn fixes(raw: &Curve) -> Vec<(f64, f64)> {
    let points = raw.t_s.iter().copied().zip(raw.y.iter().copied());
    let mut out: Vec<(f64, f64)> = vec![];
    for (t, y) in points {
        if out.last().is_none_or(|last| last.1 != y) {
            out.push((t, y));
        }
    }
    out
}

/// Value of a curve at a time, interpolated linearly; `None` outside its ends and in its breaks.
fn value_at(curve: &Curve, t: f64) -> Option<f64> {
    let after = curve.t_s.partition_point(|x| *x < t);
    if curve.t_s.get(after) == Some(&t) {
        return curve.y.get(after).copied();
    }
    if curve.breaks.contains(&u32::try_from(after).ok()?) {
        return None;
    }
    let before = after.checked_sub(1)?;
    let (t0, t1) = (*curve.t_s.get(before)?, *curve.t_s.get(after)?);
    let (y0, y1) = (*curve.y.get(before)?, *curve.y.get(after)?);
    Some(y0 + (y1 - y0) * (t - t0) / (t1 - t0)).filter(|y| y.is_finite())
}

// The turn from above

/// Steps of the tracks of the turn, s.
const STEP_S: f64 = 0.1;

/// One position in the plane.
struct Plane<'a> {
    north: &'a Curve,
    east: &'a Curve,
}

impl<'a> Plane<'a> {
    fn of(replay: &ReplayRecord, zoom: &'a Zoom, name: &str) -> Option<Plane<'a>> {
        let curve = |axis: &'a AxisCurves| {
            chosen(replay, &axis.position_m).into_iter().find(|(n, _, _)| *n == name).map(|(_, _, c)| c)
        };
        let [north, east] = zoom.axes.get(..2)? else { return None };
        Some(Plane { north: curve(north)?, east: curve(east)? })
    }

    fn at(&self, t: f64) -> Option<(f64, f64)> {
        Some((value_at(self.east, t)?, value_at(self.north, t)?))
    }

    /// Over the window, in short steps.
    fn track(&self, zoom: &Zoom) -> Vec<(f64, f64)> {
        let steps = 0..=((zoom.end_s - zoom.start_s) / STEP_S) as u32;
        steps.filter_map(|k| self.at(zoom.start_s + f64::from(k) * STEP_S)).collect()
    }

    /// Times of its fixes. The first point is the edge of the window; its fix is older. Thinning keeps different fixes
    /// for each axis.
    fn fix_times(&self) -> Vec<f64> {
        let of_axis = |curve: &Curve| fixes(curve).into_iter().skip(1).map(|(t, _)| t).collect::<Vec<f64>>();
        let mut at = [of_axis(self.north), of_axis(self.east)].concat();
        at.sort_by(f64::total_cmp);
        at.dedup();
        at
    }
}

/// Links from raw to compensated, one per second, at the first fix in that second.
fn each_second(at: &[f64], raw: &Plane, exact: &Plane) -> Vec<Vec<(f64, f64)>> {
    let mut ticks = vec![];
    let mut second = f64::NEG_INFINITY;
    for &t in at {
        if t.floor() > second
            && let (Some(from), Some(to)) = (raw.at(t), exact.at(t))
        {
            second = t.floor();
            ticks.push(vec![from, to]);
        }
    }
    ticks
}

fn turn(replay: &ReplayRecord, zoom: &Zoom) -> Option<Figure> {
    let (raw, exact) = (Plane::of(replay, zoom, RAW)?, Plane::of(replay, zoom, EXACT)?);
    let at = raw.fix_times();
    let ticks = each_second(&at, &raw, &exact);
    let longest = ticks.iter().map(|p| (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1)).fold(0.0, f64::max);
    let mut drawn = vec![
        stroke(RAW, Pen::Raw, at.iter().filter_map(|&t| raw.at(t)).collect()),
        stroke(EXACT, Pen::Exact, exact.track(zoom)),
        Line { name: "from raw to compensated, each second".to_owned(), pen: Pen::Band, pieces: ticks },
    ];
    let reference = Plane::of(replay, zoom, REFERENCE);
    drawn.extend(reference.map(|of| stroke(REFERENCE, Pen::Reference, of.track(zoom))));
    drawn.retain(|line| line.pieces.iter().any(|piece| !piece.is_empty()));
    let (panel, panel_size) = ground(drawn, 430.0)?;
    Some(Figure {
        id: "turn".to_owned(),
        number: 0,
        title: format!(
            "Raw to compensated, with the age of the fix: up to {}\u{a0}m in the hardest turn",
            number::significant(longest, 2)
        ),
        caption: format!(
            "The turn of Fig. 7 from above, {} to {}, equal scales; a wide line each second from a fix to where the compensated \
             position then is.",
            number::clock(zoom.start_s, 1),
            number::clock(zoom.end_s, 1)
        ),
        how_to_read: "Good: both tracks have one shape, and all lines lie along the track. Bad: lines that point across it \
                      (heading or frame wrong).",
        panels: vec![panel],
        panel_size,
        fine: false,
    })
}

// The lead over the flight

fn lead_over_time(replay: &ReplayRecord, lead: &LeadCurves, late: Option<&Late>) -> Option<Figure> {
    let mut tally = Tally::default();
    let mut of = |curve: fn(&Lead) -> &Curve| -> Vec<Line> {
        let pens = [(EXACT, Pen::Exact), (REFERENCE, Pen::Reference)];
        let line = |(of, (name, pen)): (&Lead, (&str, Pen))| {
            let lines = lines(std::slice::from_ref(curve(of)), &[pen], &mut tally);
            lines.into_iter().map(|line| Line { name: name.to_owned(), ..line }).collect::<Vec<_>>()
        };
        lead.of.iter().zip(pens).flat_map(line).collect()
    };
    let (in_m, mut in_ms) = (of(|lead| &lead.over_time_m), of(|lead| &lead.over_time_ms));
    let time = Axis::time(TIME, extent(&in_m, |p| p.0)?, 10);
    in_ms.extend(late.and_then(|late| measured_band(late, &time)));
    let panel = |label: &str, lines: Vec<Line>| {
        let (low, high) = extent(&lines, |p| p.1)?;
        Some(Panel::of(time.clone(), Axis::linear(label, (low.min(0.0), high.max(0.0)), 5), lines))
    };
    let mut panels: Vec<Panel> = [("lead (m)", in_m), ("lead (ms)", in_ms)]
        .into_iter()
        .filter_map(|(label, lines)| panel(label, lines))
        .collect();
    if let Some(zoom) = &replay.zoom {
        panels.iter_mut().take(1).for_each(|panel| panel.spans.extend(span(zoom, panel, "hardest turn")));
    }
    let title = lead_title(lead)?;
    let caption = format!(
        "Lead over raw along the track at each fix, without its age, medians in the title; in ms where the ground speed is \
         {}\u{a0}m/s and more.",
        number::significant(lead.least_speed_mps, 2)
    );
    Some(Figure {
        id: "lead".to_owned(),
        number: 0,
        title,
        caption: tally.caption(&caption),
        how_to_read: "Good: both curves lie on one another, and below on the band of the measured lateness. Bad: the \
                      compensated position leads more than the reference (too much removed) or less (too little). \
                      Without a reference, the compensated curve shows what was removed, and the band what was \
                      measured.",
        panels,
        panel_size: (860, 150),
        fine: true,
    })
}

/// The measured lateness with its uncertainty, ms, over the whole flight.
fn measured_band(late: &Late, time: &Axis) -> Option<Line> {
    let Estimate { value, standard_uncertainty } = late.lateness_s;
    let half = COVERAGE_FACTOR * standard_uncertainty? * 1e3;
    let (low, high) = (value * 1e3 - half, value * 1e3 + half);
    let name = match late.than {
        None => "measured lateness ± U (k = 2)".to_owned(),
        Some(than) => format!("measured, later than {}, ± U (k = 2)", short_label(than)),
    };
    let band = || outline((time.low, low), (time.high, high));
    (low.is_finite() && high.is_finite()).then(|| Line { name, pen: Pen::Uncertainty, pieces: vec![band()] })
}

fn lead_title(lead: &LeadCurves) -> Option<String> {
    let metres = |lead: &Lead| format!("{}\u{a0}m", number::significant(lead.median_m, 3));
    let moved = format!("Compensation moves the position ahead by {}", metres(lead.of.first()?));
    let reference = lead.of.get(1).map(|reference| format!("; the reference is {} ahead", metres(reference)));
    Some(moved + &reference.unwrap_or_default())
}

fn span(zoom: &Zoom, panel: &Panel, name: &str) -> Option<Span> {
    let (from, to) = (zoom.start_s.max(panel.x.low), zoom.end_s.min(panel.x.high));
    (from < to).then(|| Span { from, to, label: name.to_owned() })
}

// The ground track

fn track(track: &LeadTrack, replay: &ReplayRecord) -> Option<Figure> {
    let most = track.lead_m.iter().fold(0.0, |most: f64, lead| most.max(lead.abs()));
    let (lines, lost) = coloured(track, most);
    let drawn = lines.iter().flat_map(|line| &line.pieces).map(Vec::len).sum::<usize>();
    let marks = ends(track);
    let (panel, panel_size) = ground(lines, 430.0)?;
    let panel =
        Panel { marks: marks.into_iter().map(|m| Mark { at: panel.ground_scale(m.at), ..m }).collect(), ..panel };
    let mut tally = Tally::default();
    tally.add(drawn, track.stands_for, lost);
    let origin = if replay.origin.is_some() { "the first fix" } else { "the log's own origin" };
    Some(Figure {
        id: "track".to_owned(),
        number: 0,
        title: format!("Ground track, coloured by lead: up to {}\u{a0}m", number::significant(most, 2)),
        caption: tally.caption(&format!(
            "Compensated position, east and north of {origin}, equal scales; the lead over raw along the track as the colour. \
             Dots where fixes are missing."
        )),
        how_to_read: "In fast, straight flight the lead is large: the colour is the distance by which raw trails. Once \
                      compensated, opposite passes over one line coincide.",
        panels: vec![panel],
        panel_size,
        fine: false,
    })
}

/// Width and height of the small track next to a page's heading, CSS pixels.
pub(crate) const THUMBNAIL: (f64, f64) = (240.0, 150.0);
/// Maximum number of its points.
const MOST_THUMBNAIL: usize = 600;

/// The small track: index of each colour and its path, in CSS pixels, equal scales. Empty if nothing can be drawn.
pub(crate) fn thumbnail(track: &LeadTrack) -> Vec<(u8, String)> {
    let most = track.lead_m.iter().fold(0.0, |most: f64, lead| most.max(lead.abs()));
    let (lines, _) = coloured(track, most);
    let (Some(east), Some(north)) = (extent(&lines, |p| p.0), extent(&lines, |p| p.1)) else { return vec![] };
    let scale = ((THUMBNAIL.0 - 8.0) / (east.1 - east.0)).min((THUMBNAIL.1 - 8.0) / (north.1 - north.0));
    if !scale.is_finite() {
        return vec![];
    }
    let middle = |(low, high): (f64, f64)| (low + high) / 2.0;
    let place = |p: &(f64, f64)| {
        let (x, y) =
            (THUMBNAIL.0 / 2.0 + scale * (p.0 - middle(east)), THUMBNAIL.1 / 2.0 - scale * (p.1 - middle(north)));
        (x.round() as i32, y.round() as i32)
    };
    let step = track.east_m.len().div_ceil(MOST_THUMBNAIL).max(1);
    let thin = |piece: &Vec<(f64, f64)>| {
        let last = piece.len().saturating_sub(1);
        let kept = piece.iter().enumerate().filter(|(k, _)| k % step == 0 || *k == last);
        let mut points: Vec<(i32, i32)> = kept.map(|(_, p)| place(p)).collect();
        points.dedup();
        crate::draw::curve(&points)
    };
    let path = |line: &Line| match line.pen {
        Pen::Lead(colour) => Some((colour, line.pieces.iter().map(thin).collect())),
        _ => None,
    };
    lines.iter().filter_map(path).collect()
}

/// The track in pieces of one colour each, the gaps between them, and the number of points that cannot be drawn.
fn coloured(track: &LeadTrack, most: f64) -> (Vec<Line>, usize) {
    let step = most / f64::from(LEADS);
    let bin = |lead: f64| ((lead.abs() / step) as u8).min(LEADS - 1);
    let mut pieces: Vec<Vec<Vec<(f64, f64)>>> = vec![vec![]; usize::from(LEADS)];
    let (mut gaps, mut lost) = (vec![], 0);
    let mut breaks = track.breaks.iter().copied().peekable();
    let mut last: Option<((f64, f64), u8)> = None;
    for (row, ((&e, &n), &lead)) in track.east_m.iter().zip(&track.north_m).zip(&track.lead_m).enumerate() {
        let is_break = breaks.next_if(|&b| b as usize <= row).is_some();
        if ![e, n, lead].into_iter().all(super::is_drawable) {
            lost += 1;
            continue;
        }
        let (at, bin) = ((e, n), bin(lead));
        match last {
            Some((before, _)) if is_break => {
                gaps.push(vec![before, at]);
                pieces[usize::from(bin)].push(vec![at]);
            }
            Some((before, of)) if of != bin => pieces[usize::from(bin)].push(vec![before, at]),
            None => pieces[usize::from(bin)].push(vec![at]),
            Some(_) => {
                if let Some(piece) = pieces[usize::from(bin)].last_mut() {
                    piece.push(at);
                }
            }
        }
        last = Some((at, bin));
    }
    let name = |k: u8| {
        let edge = |k: u8| number::significant(f64::from(k) * step, 2);
        format!("{} to {}\u{a0}m", edge(k), edge(k + 1))
    };
    let lines = (0..LEADS).zip(pieces).map(|(k, pieces)| Line { name: name(k), pen: Pen::Lead(k), pieces });
    let gap = Line { name: "no fix".to_owned(), pen: Pen::Dotted, pieces: gaps };
    (lines.chain([gap]).filter(|line| !line.pieces.is_empty()).collect(), lost)
}

/// Where the track begins and ends.
fn ends(track: &LeadTrack) -> Vec<Mark> {
    let points = || track.east_m.iter().copied().zip(track.north_m.iter().copied());
    let mark = |at: Option<(f64, f64)>, label: &str| at.map(|at| Mark { at, label: label.to_owned() });
    mark(points().next(), "start").into_iter().chain(mark(points().next_back(), "end")).collect()
}

// The ground

/// A map panel with equal scales, a scale bar and north up; in km if it is wide.
fn ground(lines: Vec<Line>, width: f64) -> Option<(Panel, (u32, u32))> {
    let (east, north) = (extent(&lines, |p| p.0)?, extent(&lines, |p| p.1)?);
    let largest = [east.0, east.1, north.0, north.1].into_iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let (scale, unit) = if largest > 10_000.0 { (1e-3, "km") } else { (1.0, "m") };
    let lines = lines.into_iter().map(|line| scaled(line, scale)).collect::<Vec<_>>();
    let (panel_size, east, north) =
        equal_axes((east.0 * scale, east.1 * scale), (north.0 * scale, north.1 * scale), width);
    let x = Axis::exactly(&format!("east ({unit})"), east, 5);
    let y = Axis::exactly(&format!("north ({unit})"), north, 6);
    let length = nice_length((east.1 - east.0) / 4.0);
    let ground = Ground { length, label: format!("{} {unit}", number::exact(length)), scale };
    Some((Panel { ground: Some(ground), ..Panel::of(x, y, lines) }, panel_size))
}

/// The largest of 1, 2 and 5 times a power of ten that does not exceed the length.
fn nice_length(most: f64) -> f64 {
    let power = 10f64.powf(most.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|k| k * power).find(|length| *length <= most).unwrap_or(power)
}

fn scaled(mut line: Line, scale: f64) -> Line {
    for point in line.pieces.iter_mut().flatten() {
        *point = (point.0 * scale, point.1 * scale);
    }
    line
}

/// A plotting area and ranges with equal scales east and north.
fn equal_axes(east: (f64, f64), north: (f64, f64), width: f64) -> ((u32, u32), (f64, f64), (f64, f64)) {
    let with_air = |(low, high): (f64, f64)| ((low + high) / 2.0, ((high - low) * 1.12).max(1e-6));
    let ((east_middle, east_span), (north_middle, north_span)) = (with_air(east), with_air(north));
    let height = (width * north_span / east_span).clamp(0.5 * width, width).round();
    let per_pixel = (east_span / width).max(north_span / height).max(1e-6);
    let around = |middle: f64, pixels: f64| (middle - per_pixel * pixels / 2.0, middle + per_pixel * pixels / 2.0);
    ((width as u32, height as u32), around(east_middle, width), around(north_middle, height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_metre_has_the_same_length_east_and_north() {
        for (east, north) in [((0.0, 1000.0), (0.0, 10.0)), ((-5.0, 5.0), (0.0, 9000.0)), ((3.0, 3.0), (1.0, 1.0))] {
            let ((width, height), e, n) = equal_axes(east, north, 430.0);
            let (per_x, per_y) = ((e.1 - e.0) / f64::from(width), (n.1 - n.0) / f64::from(height));
            assert!((per_x / per_y - 1.0).abs() < 1e-9);
            assert!(e.0 <= east.0 && e.1 >= east.1 && n.0 <= north.0 && n.1 >= north.1);
        }
    }

    #[test]
    fn a_scale_bar_has_a_round_length() {
        assert_eq!([0.9, 1.0, 4.99, 730.0].map(nice_length), [0.5, 1.0, 2.0, 500.0]);
    }

    #[test]
    fn a_track_is_split_by_colour_and_dotted_where_fixes_are_missing() {
        let track = LeadTrack {
            east_m: vec![0.0, 1.0, 2.0, 3.0, 9.0, 10.0],
            north_m: vec![0.0; 6],
            lead_m: vec![0.0, 0.1, 9.0, -10.0, 10.0, 10.0],
            breaks: vec![4],
            stands_for: 6,
        };
        let (lines, lost) = coloured(&track, 10.0);
        let pieces = |pen| lines.iter().find(|l| l.pen == pen).map(|l| l.pieces.clone()).unwrap_or_default();
        assert_eq!(pieces(Pen::Lead(0)), [vec![(0.0, 0.0), (1.0, 0.0)]]);
        // A line has the colour of its end.
        let last = [vec![(1.0, 0.0), (2.0, 0.0), (3.0, 0.0)], vec![(9.0, 0.0), (10.0, 0.0)]];
        assert_eq!(pieces(Pen::Lead(LEADS - 1)), last);
        assert_eq!((pieces(Pen::Dotted), lost), (vec![vec![(3.0, 0.0), (9.0, 0.0)]], 0));
    }

    #[test]
    fn values_are_interpolated_between_points_but_not_across_a_break() {
        let curve = Curve {
            name: String::new(),
            t_s: vec![0.0, 1.0, 3.0],
            y: vec![0.0, 2.0, 6.0],
            breaks: vec![2],
            stands_for: 3,
        };
        assert_eq!([0.5, 1.0, 2.0, 4.0].map(|t| value_at(&curve, t)), [Some(1.0), Some(2.0), None, None]);
    }
}
