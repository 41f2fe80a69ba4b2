//! The figures in the details of one channel.

use super::super::curve::{Tally, lines};
use super::super::{Axis, Figure, Line, Panel, Pen, extent, is_drawable, outline, pieces, stroke, upright};
use super::paper;
use crate::number::{self, COVERAGE_FACTOR};
use crate::text::{label, short_label};
use record::{
    ChannelDynamics, ComponentDynamics, DelayFinding, FitChecks, LatencyHistogram, ResponseFinding, ResponsePoint,
    Stationarity,
};

/// Two of these fit side by side.
const SMALL: (u32, u32) = (420, 150);
const TIME: &str = "time since the encoder's first sample";

/// Figures that every channel has, and how to read them: explained once on a page.
pub(crate) const KINDS: [(&str, &str); 9] = [
    (
        "components over a few swings",
        "Good: the dots lie on the dashes. A component that the swing does not move has no information about the \
         delay: it shows only offset, drift and noise.",
    ),
    (
        "measured against reference",
        "A delay opens a loop; a gain turns the line. Good: the lower panel is one line on the dashes. Bad: a loop stays \
         (a lag, or a delay that changes).",
    ),
    (
        "frequency response",
        "Rely only on the blue points: γ² above 0.6 and reference power above 1 % of its peak. Good: their bars reach \
         the dashes. A pure delay has gain 1 and a phase that falls in proportion to frequency; a gain that falls as \
         well is a lag.",
    ),
    (
        "residuals",
        "Good: noise of constant size around zero, without the rhythm of the swing. Bad: waves at the swing's \
         frequency (gain or model wrong), a step, a noisier stretch.",
    ),
    (
        "autocorrelation of the residuals",
        "Good: 19 bars of 20 inside the band. Bad: a row of bars on one side (noise that wanders more than the model \
         allows), or a rhythm (remaining motion). The interval of the delay allows for both.",
    ),
    (
        "objective over the search",
        "Good: one deep valley at the vertical line. Bad: a second valley nearly as deep, a swing's period away: the \
         delay is ambiguous by a swing.",
    ),
    (
        "objective near its minimum",
        "Good: a round valley whose width at 3.84 is the band. The band may be wider than the curve at 3.84: the larger of two \
         uncertainties is used.",
    ),
    (
        "delay over the record",
        "Good: nearly all bars reach the band. Bad: a slope (clocks that drift apart, a queue that fills), a step (the \
         sensor changed its mode). Neighbouring windows share half of their data, so the bars look smoother than they \
         are.",
    ),
    ("latency", "Good: one narrow hill. Bad: two hills (a scheduler, a retry), a long tail (a link that is full)."),
];

/// Figures of one channel; each is absent where the record has nothing to draw.
#[derive(Debug, Default)]
pub(crate) struct ChannelFigures {
    /// Part of the ids of the channel.
    pub(crate) anchor: String,
    /// All components over a few swings.
    pub(crate) components: Option<Figure>,
    /// Measured over reference, before and after the shift.
    pub(crate) hysteresis: Option<Figure>,
    /// Gain, phase, coherence.
    pub(crate) response: Option<Figure>,
    /// Measured − fitted.
    pub(crate) residuals: Option<Figure>,
    /// Autocorrelation of the whitened residuals.
    pub(crate) autocorrelation: Option<Figure>,
    /// Objective over the range of the search.
    pub(crate) objective: Option<Figure>,
    /// Objective near its minimum.
    pub(crate) minimum: Option<Figure>,
    /// Delay over the record.
    pub(crate) stationarity: Option<Figure>,
    /// Arrival time minus device time.
    pub(crate) latency: Option<Figure>,
}

impl ChannelFigures {
    pub(super) fn of(channel: &ChannelDynamics, anchor: String) -> ChannelFigures {
        let named = Named { channel: label(&channel.name), anchor: &anchor };
        let delay = channel.delay.as_ref();
        let checks = channel.checks.as_ref();
        ChannelFigures {
            components: paper::components(channel, named.id("components")),
            hysteresis: hysteresis(&named, channel),
            response: channel.response.found().and_then(|r| response(&named, r)),
            residuals: residuals(&named, &channel.components),
            autocorrelation: checks.and_then(|c| autocorrelation(&named, c)),
            objective: checks.and_then(|c| objective(&named, c, delay)),
            minimum: checks.and_then(|c| minimum(&named, c, delay)),
            stationarity: channel.stationarity.found().and_then(|s| stationarity(&named, s, delay)),
            latency: channel.latency.found().and_then(|l| latency(&named, l)),
            anchor,
        }
    }

    /// One slot for each of [`KINDS`].
    pub(crate) fn slots(&self) -> [&Option<Figure>; 9] {
        [
            &self.components,
            &self.hysteresis,
            &self.response,
            &self.residuals,
            &self.autocorrelation,
            &self.objective,
            &self.minimum,
            &self.stationarity,
            &self.latency,
        ]
    }

    pub(super) fn slots_mut(&mut self) -> [&mut Option<Figure>; 9] {
        [
            &mut self.components,
            &mut self.hysteresis,
            &mut self.response,
            &mut self.residuals,
            &mut self.autocorrelation,
            &mut self.objective,
            &mut self.minimum,
            &mut self.stationarity,
            &mut self.latency,
        ]
    }
}

/// Names of the figures of one channel.
struct Named<'a> {
    channel: String,
    anchor: &'a str,
}

impl Named<'_> {
    fn id(&self, what: &str) -> String {
        format!("{}-{what}", self.anchor)
    }

    /// A small figure with this title, without panels.
    fn figure(&self, id: &str, title: &str, caption: String, panels: Vec<Panel>) -> Figure {
        Figure {
            id: self.id(id),
            number: 0,
            title: format!("{}: {title}", self.channel),
            caption,
            how_to_read: "",
            panels,
            panel_size: SMALL,
            fine: false,
        }
    }
}

/// Seconds as milliseconds.
fn millis(seconds: f64) -> f64 {
    seconds * 1e3
}

fn range(lines: &[Line]) -> (f64, f64) {
    extent(lines, |p| p.1).unwrap_or((0.0, 0.0))
}

// Frequency response

fn response(named: &Named, found: &ResponseFinding) -> Option<Figure> {
    let frequencies = || found.points.iter().map(|p| p.frequency_hz).filter(|f| *f > 0.0 && is_drawable(*f));
    let (low, high) = (frequencies().reduce(f64::min)?, frequencies().reduce(f64::max)?);
    let x = Axis::logarithmic("frequency (Hz)", (low / 1.15, high * 1.15));
    let degrees = f64::to_degrees;
    let gain = |p: &ResponsePoint| (p.gain, p.gain_u95);
    let phase = |p: &ResponsePoint| (degrees(p.phase_rad), degrees(p.phase_u95));
    let mut beyond = 0;
    let mut panel = |label: &str, value: &dyn Fn(&ResponsePoint) -> (f64, f64), model: Vec<f64>| {
        let (pale, mut lines): (Vec<Line>, Vec<Line>) =
            bins(found, value).into_iter().partition(|l| l.pen == Pen::DoubtfulPoints);
        lines.extend(model_line(found, &model));
        // Unreliable bins must not set the scale.
        let y = Axis::linear(label, extent(&lines, |p| p.1).unwrap_or_else(|| range(&pale)), 5);
        for mut line in pale {
            let count = line.pieces.len();
            line.pieces.retain(|piece| (y.low..=y.high).contains(&piece[0].1));
            beyond += count - line.pieces.len();
            lines.push(line);
        }
        Panel::of(x.clone(), y, lines)
    };
    let panels = vec![
        panel("gain", &gain, found.model_gain.clone()),
        panel("phase (°)", &phase, found.model_phase_rad.iter().map(|p| degrees(*p)).collect()),
        coherence_panel(found, &x),
    ];
    let caption = format!(
        "Gain (measured over reference), phase in degrees (unwrapped, negative is late) and magnitude-squared coherence \
         of {} over frequency in Hz. Bars: 95 %. Segments of {} s, {} effective averages. Pale bins beyond \
         their axis, not drawn: {}.",
        label(&found.component),
        number::significant(found.segment_s, 3),
        number::significant(found.averages, 3),
        beyond
    );
    Some(named.figure("response", "frequency response", caption, panels))
}

fn coherence_panel(found: &ResponseFinding, x: &Axis) -> Panel {
    let mut lines = bins(found, &|p: &ResponsePoint| (p.coherence, 0.0));
    lines.push(stroke("γ² = 0.6", Pen::Rule, vec![(x.low, 0.6), (x.high, 0.6)]));
    Panel::of(x.clone(), Axis::exactly("coherence γ²", (0.0, 1.05), 5), lines)
}

fn bins(found: &ResponseFinding, value: &dyn Fn(&ResponsePoint) -> (f64, f64)) -> Vec<Line> {
    let line = |name: &str, pen, reliable: bool| {
        let points = found.points.iter().filter(|p| p.reliable == reliable && p.frequency_hz > 0.0);
        let point = |p: &ResponsePoint| {
            let (y, half) = value(p);
            upright(p.frequency_hz, y, if reliable { half } else { 0.0 })
        };
        Line { name: name.to_owned(), pen, pieces: points.filter_map(point).collect() }
    };
    let lines = [line("reliable bin", Pen::Points, true), line("unreliable", Pen::DoubtfulPoints, false)];
    lines.into_iter().filter(|line| !line.pieces.is_empty()).collect()
}

fn model_line(found: &ResponseFinding, model: &[f64]) -> Option<Line> {
    let frequencies: Vec<f64> = found.points.iter().map(|p| p.frequency_hz).collect();
    let (mut pieces, _) = pieces(&frequencies, model, &[]);
    pieces.iter_mut().for_each(|piece| piece.retain(|p| p.0 > 0.0));
    pieces.retain(|piece| !piece.is_empty());
    (!pieces.is_empty()).then(|| Line { name: "fitted model".to_owned(), pen: Pen::Dashed, pieces })
}

// Checks of the fit

fn residuals(named: &Named, components: &[ComponentDynamics]) -> Option<Figure> {
    /// Maximum number of panels.
    const MOST: usize = 4;
    let mut tally = Tally::default();
    let with_curve = components.iter().filter_map(|c| Some((c, c.residual.as_ref()?))).take(MOST);
    let drawn: Vec<_> = with_curve
        .map(|(component, curve)| {
            let mut lines = lines(std::slice::from_ref(curve), &[Pen::Raw], &mut tally);
            lines.iter_mut().for_each(|line| line.name = "measured − fitted".to_owned());
            (component, lines)
        })
        .filter(|(_, lines)| extent(lines, |p| p.0).is_some())
        .collect();
    let time = Axis::record_time(TIME, extent(drawn.iter().flat_map(|(_, lines)| lines), |p| p.0)?, 6);
    let panel = |(component, mut lines): (&ComponentDynamics, Vec<Line>)| {
        let y = Axis::linear(
            &format!("{} ({})", short_label(&component.name), short_label(&component.unit)),
            range(&lines),
            6,
        );
        lines.push(stroke("", Pen::Faint, vec![(time.low, 0.0), (time.high, 0.0)]));
        Panel::of(time.clone(), y, lines)
    };
    let caption = tally.caption("Measured − fitted over time, in the unit of each axis.");
    let panels = drawn.into_iter().map(panel).collect();
    Some(Figure { panel_size: (SMALL.0, 110), fine: true, ..named.figure("residuals", "residuals", caption, panels) })
}

fn autocorrelation(named: &Named, checks: &FitChecks) -> Option<Figure> {
    let values = &checks.autocorrelation;
    let last = values.len() as f64;
    let bar = |(i, &r): (u32, &f64)| is_drawable(r).then(|| vec![(f64::from(i) - 0.36, 0.0), (f64::from(i) + 0.36, r)]);
    let bars: Vec<_> = (1u32..).zip(values).filter_map(bar).collect();
    let lines = vec![Line { name: "autocorrelation".to_owned(), pen: Pen::Bars, pieces: bars }];
    extent(&lines, |p| p.1)?;
    let x = Axis::exactly("lag (samples)", (0.0, last + 1.0), 8);
    let u95 = if is_drawable(checks.autocorrelation_u95) { checks.autocorrelation_u95 } else { 0.0 };
    let (low, high) = range(&lines);
    let y = Axis::linear("correlation", (low.min(-u95).max(-1.0), high.max(u95).min(1.0)), 5);
    let band = Line {
        name: "95 % if white".to_owned(),
        pen: Pen::Uncertainty,
        pieces: vec![outline((x.low, -u95), (x.high, u95))],
    };
    let zero = stroke("", Pen::Faint, vec![(x.low, 0.0), (x.high, 0.0)]);
    let caption = format!(
        "Autocorrelation of the whitened residuals at lags of 1 to {} samples. Ljung–Box {}.",
        values.len(),
        number::probability(checks.ljung_box_p)
    );
    let panels = vec![Panel::of(x, y, [vec![band], lines, vec![zero]].concat())];
    Some(named.figure("autocorrelation", "autocorrelation of the residuals", caption, panels))
}

fn objective(named: &Named, checks: &FitChecks, delay: Option<&DelayFinding>) -> Option<Figure> {
    let curve = &checks.objective;
    let mut panel = objective_panel(&curve.delay_s, &curve.value, delay.map(found))?;
    if let Some(second) = checks.second_minimum_s.filter(|s| is_drawable(*s)) {
        let at = millis(second);
        panel.lines.push(stroke("another minimum", Pen::Dotted, vec![(at, panel.y.low), (at, panel.y.high)]));
    }
    let caption = "−2 ln L above its least over delay in ms, over the range of the search; noise as fitted, gain and \
                   offset free at each delay."
        .to_owned();
    Some(named.figure("objective", "objective over the search", caption, vec![panel]))
}

fn minimum(named: &Named, checks: &FitChecks, delay: Option<&DelayFinding>) -> Option<Figure> {
    /// 95 % quantile of chi-squared with one degree of freedom.
    const LIMIT: f64 = 3.841;
    let curve = &checks.objective;
    let mut panel = objective_panel(&curve.near_delay_s, &curve.near_value, delay.map(found))?;
    panel.lines.push(stroke("3.84, 95 % of χ²", Pen::Dotted, vec![(panel.x.low, LIMIT), (panel.x.high, LIMIT)]));
    let caption = "The same near its least. The band is the 95 % interval (Student) that the record states.".to_owned();
    Some(named.figure("minimum", "objective near its minimum", caption, vec![panel]))
}

fn found(delay: &DelayFinding) -> (f64, [f64; 2]) {
    (delay.delay.seconds(), delay.interval_95_s)
}

/// An objective over delay (ms), with the estimated delay and its interval (s).
pub(in crate::figure) fn objective_panel(
    delay_s: &[f64],
    value: &[f64],
    found: Option<(f64, [f64; 2])>,
) -> Option<Panel> {
    let delay_ms: Vec<f64> = delay_s.iter().copied().map(millis).collect();
    let (mut pieces, _) = pieces(&delay_ms, value, &[]);
    // Axis labels have room for five digits.
    let largest = value.iter().copied().filter(|v| is_drawable(*v)).fold(0.0, f64::max);
    let (scale, label) = match largest {
        v if v >= 1e8 => (1e-9, "−2 ln L above least (10⁹)"),
        v if v >= 1e5 => (1e-6, "−2 ln L above least (10⁶)"),
        _ => (1.0, "−2 ln L above least"),
    };
    pieces.iter_mut().flatten().for_each(|point| point.1 *= scale);
    let mut lines = vec![Line { name: "−2 ln L above least".to_owned(), pen: Pen::Raw, pieces }];
    let x = Axis::linear("delay (ms)", extent(&lines, |p| p.0)?, 6);
    let (low, high) = range(&lines);
    let y = Axis::linear(label, (low.min(0.0), high), 5);
    if let Some((delay_s, interval_95_s)) = found {
        let [from, to] = interval_95_s.map(millis);
        if is_drawable(from) && is_drawable(to) {
            let pieces = vec![outline((from, y.low), (to, y.high))];
            lines.push(Line { name: "95 % interval".to_owned(), pen: Pen::Uncertainty, pieces });
        }
        if is_drawable(millis(delay_s)) {
            let at = millis(delay_s);
            lines.push(stroke("delay as found", Pen::Rule, vec![(at, y.low), (at, y.high)]));
        }
    }
    Some(Panel::of(x, y, lines))
}

fn hysteresis(named: &Named, channel: &ChannelDynamics) -> Option<Figure> {
    let (component, panels) = paper::hysteresis(channel)?;
    let caption = format!(
        "{} over the reference within a few swings, offset, drift and slow wander removed. Above at the same time, \
         below with the delay removed.",
        label(&component)
    );
    Some(named.figure("hysteresis", "measured against reference", caption, panels))
}

// Over the record

fn stationarity(named: &Named, found: &Stationarity, delay: Option<&DelayFinding>) -> Option<Figure> {
    let point = |(&t, d): (&f64, &record::Estimate)| {
        upright(t, millis(d.value), millis(COVERAGE_FACTOR * d.standard_uncertainty.unwrap_or(0.0)))
    };
    let pieces: Vec<_> = found.t_s.iter().zip(&found.delay_s).filter_map(point).collect();
    let mut lines = vec![Line { name: "window, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces }];
    let (start, end) = extent(&lines, |p| p.0)?;
    let x = Axis::record_time(
        TIME,
        (start - found.window_s.abs().min(1e6) / 2.0, end + found.window_s.abs().min(1e6) / 2.0),
        6,
    );
    lines.extend(whole_record(delay, &x));
    lines.extend(delay.and_then(|d| slope_line(found, d, (start, end))));
    let y = Axis::linear("delay (ms)", range(&lines), 7);
    let caption = format!(
        "Delay in ms in windows of {} s, half overlapping, over the time of their middles.",
        number::exact(found.window_s)
    );
    Some(named.figure("stationarity", "delay over the record", caption, vec![Panel::of(x, y, lines)]))
}

/// The delay of the whole record, with its expanded uncertainty.
fn whole_record(delay: Option<&DelayFinding>, x: &Axis) -> Vec<Line> {
    let Some(delay) = delay else { return vec![] };
    let (value, half) = (delay.delay.millis(), millis(COVERAGE_FACTOR * delay.standard_uncertainty_s));
    if !is_drawable(value) || !is_drawable(half) {
        return vec![];
    }
    let band = outline((x.low, value - half), (x.high, value + half));
    vec![
        Line { name: "whole record, ± U".to_owned(), pen: Pen::Uncertainty, pieces: vec![band] },
        stroke("whole record", Pen::Rule, vec![(x.low, value), (x.high, value)]),
    ]
}

fn slope_line(found: &Stationarity, delay: &DelayFinding, (start, end): (f64, f64)) -> Option<Line> {
    let middle = (start + end) / 2.0;
    let at = |t: f64| (t, delay.delay.millis() + millis(found.slope.value) * (t - middle));
    let ends = [at(start), at(end)];
    let drawable = ends.iter().all(|p| is_drawable(p.1)) && end > start;
    drawable.then(|| stroke("slope", Pen::Dotted, ends.to_vec()))
}

fn latency(named: &Named, found: &LatencyHistogram) -> Option<Figure> {
    let bar = |(edges, &count): (&[f64], &u64)| {
        let (from, to) = (millis(edges[0]), millis(edges[1]));
        (is_drawable(from) && is_drawable(to)).then(|| vec![(from, 0.0), (to, count as f64)])
    };
    let pieces: Vec<_> = found.edges_s.windows(2).zip(&found.counts).filter_map(bar).collect();
    let mut lines = vec![Line { name: "samples".to_owned(), pen: Pen::Bars, pieces }];
    let x = Axis::linear("latency (ms)", extent(&lines, |p| p.0)?, 6);
    let y = Axis::linear("samples", (0.0, range(&lines).1), 5);
    for (name, pen, at) in
        [("median", Pen::Rule, found.latency_s.median), ("99th percentile", Pen::Dotted, found.latency_s.p99)]
    {
        if is_drawable(millis(at)) {
            lines.push(stroke(name, pen, vec![(millis(at), y.low), (millis(at), y.high)]));
        }
    }
    let mut caption = "Samples in each bin of latency, in ms.".to_owned();
    if found.beyond > 0 {
        caption += &format!(" Beyond the last edge: {}.", number::counted(found.beyond, "sample", "samples"));
    }
    Some(named.figure("latency", "latency", caption, vec![Panel::of(x, y, lines)]))
}
