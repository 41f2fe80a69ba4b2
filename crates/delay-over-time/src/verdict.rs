//! From what was found to the record: kind, level, constancy, curve, terms.

use crate::bin_statistics::bin_statistics;
use crate::delays::Effect;
use crate::settings::OverTimeSettings;
use crate::shape::Shape;
use crate::stages::{FOREIGN_SHARE, Found, Test};
use record::{Constancy, CurvePoint, DelayJitter, DelayKind, DelayTerm, DelayTermKind, Estimate};

/// Points of the curve.
const CURVE_POINTS: usize = 160;
const MOST_POINTS: usize = 200;
/// Cost by which the best delay must win against one further away.
const RUNNER_UP_COST: f64 = 12.0;
/// Chi-squared of a change on bins above which it is reported although no window knows its level.
const SURE_CHANGE: f64 = 40.0;

/// Why nothing is said of the level.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Unknown {
    /// Too little motion within the velocity's record.
    NoMotion,
    /// The level is known too badly, s.
    Wide(f64),
    /// The best delay lies at the edge of the search.
    Edge,
    /// The position does not follow the velocity: share that is unexplained.
    Foreign(f64),
    /// Two delays fit, s.
    TwoFit([f64; 2]),
}

/// Kind, and what it rests on.
pub(crate) struct Verdict {
    pub(crate) kind: DelayKind,
    pub(crate) unknown: Option<Unknown>,
    pub(crate) level: Option<Effect>,
    pub(crate) constancy: Constancy,
    pub(crate) widening_s: f64,
    /// Rises and falls of the description, if it varies.
    pub(crate) shape: Option<Shape>,
    /// Chi-squared of the largest change on bins over the noise, if it is sure.
    pub(crate) change_on_bins: Option<f64>,
    pub(crate) two_delays: Option<[f64; 2]>,
}

pub(crate) fn judge(found: &Found, settings: &OverTimeSettings) -> Verdict {
    let level = level_of(found);
    let (mut constancy, widening_s) = constancy_of(found.test.as_ref(), settings);
    if found.explained {
        constancy.varies = true;
        constancy.note = Some("The windows alone are not sure of the change. The curve explains more than half of what a constant delay leaves.".to_owned());
    }
    let varies = constancy.varies;
    let two_delays =
        found.map.as_ref().filter(|m| m.runner_up_cost < RUNNER_UP_COST).map(|m| [m.constant_s, m.runner_up_s]);
    let unknown = unknown_of(found, level, varies, two_delays, settings);
    let shape = found.refined.as_ref().map(|r| Shape::new(&r.description, found.span_s));
    let kind = match (&unknown, varies) {
        (Some(_), _) => DelayKind::CannotTell,
        (None, true) => shape.as_ref().map_or(DelayKind::Wanders, Shape::word),
        (None, false) => constant_kind(level, &constancy, settings),
    };
    let change_on_bins = change_on_bins(found);
    Verdict { kind, unknown, level, constancy, widening_s, shape, change_on_bins, two_delays }
}

/// Level with the scatter between windows, if that is known.
fn level_of(found: &Found) -> Option<Effect> {
    let test = found.test.as_ref()?;
    let level = test.all.level;
    let scattered = test.comparison.as_ref().map_or(0.0, |c| c.level.uncertainty);
    Some(Effect { uncertainty: level.uncertainty.max(scattered), ..level }).filter(|l| l.uncertainty.is_finite())
}

fn unknown_of(
    found: &Found,
    level: Option<Effect>,
    varies: bool,
    two: Option<[f64; 2]>,
    settings: &OverTimeSettings,
) -> Option<Unknown> {
    let (Some(map), Some(level)) = (&found.map, level) else { return Some(Unknown::NoMotion) };
    if level.uncertainty > settings.known_limit_s && !varies {
        return Some(Unknown::Wide(level.uncertainty));
    }
    if map.edge {
        return Some(Unknown::Edge);
    }
    if map.unexplained_share > FOREIGN_SHARE {
        return Some(Unknown::Foreign(map.unexplained_share));
    }
    two.filter(|_| !varies).map(Unknown::TwoFit)
}

fn constant_kind(level: Option<Effect>, constancy: &Constancy, settings: &OverTimeSettings) -> DelayKind {
    let Some(level) = level.filter(|_| constancy.tested) else { return DelayKind::NotTested };
    if level.size.abs() + 1.645 * level.uncertainty < settings.on_time_margin_s {
        DelayKind::OnTime
    } else if level.size + 1.96 * level.uncertainty < 0.0 {
        DelayKind::Early
    } else {
        DelayKind::Constant
    }
}

/// The test of constancy as a record, and what it adds to the uncertainty of a constant.
fn constancy_of(test: Option<&Test>, settings: &OverTimeSettings) -> (Constancy, f64) {
    let mut out = Constancy {
        tested: false,
        varies: false,
        windows: 0,
        window_s: 0.0,
        p: None,
        difference_s: None,
        limit_s: settings.least_change_s,
        scatter_s: None,
        detectable_s: None,
        detectable_between_s: None,
        left_out_window_s: None,
        window_delays: vec![],
        note: None,
    };
    let Some(test) = test else { return (out, 0.0) };
    out.windows = test.known.len() as u64;
    out.window_s = test.length_s;
    let rows = test.known.middle_s.iter().zip(&test.known.delay_s).zip(&test.known.uncertainty_s);
    out.window_delays =
        rows.map(|((t, d), u)| CurvePoint { t_s: *t, delay_s: *d, standard_uncertainty_s: *u }).collect();
    let (Some(c), Some(d)) = (&test.comparison, &test.decision) else { return (out, 0.0) };
    out.tested = true;
    out.varies = d.varies;
    out.p = Some(d.p);
    out.limit_s = c.limit_s;
    out.scatter_s = Some(c.scatter_s);
    out.detectable_s = c.detectable_s;
    out.detectable_between_s = c.between_s;
    let difference = d.rests_on.as_ref().map_or(c.difference, |w| w.difference);
    out.difference_s = estimate(difference);
    let window = |row: usize| test.known.window.get(row).and_then(|w| test.windows.get(*w)).map(|w| [w.from_s, w.to_s]);
    out.left_out_window_s = d.rests_on.as_ref().and_then(|w| window(w.row));
    let differs = d.p < settings.significance && !d.varies;
    out.note = note_of(&out, differs);
    // A lone window that differs: the standard deviation of such a delay over the flight. Else any course between the two.
    let deviation = out.left_out_window_s.map_or(12f64.recip(), |[from, to]| {
        let flown: f64 = test.windows.iter().map(|w| w.to_s - w.from_s).sum();
        let share = (to - from) / flown.max(1e-9);
        share * (1.0 - share)
    });
    let widening_s = if differs { difference.size.abs() * deviation.max(0.0).sqrt() } else { 0.0 };
    (out, widening_s)
}

fn note_of(c: &Constancy, differs: bool) -> Option<String> {
    if let (true, Some(b)) = (differs, c.difference_s) {
        let by = plus_minus(b);
        return Some(match c.left_out_window_s {
            Some([from, to]) => format!(
                "The delay differs by {by} in the {:.0} s that begin at {from:.0} s. Nothing else in the flight shows a change.",
                to - from
            ),
            None => format!(
                "The delay differs by {by} between parts of the flight. That is not surely above the limit of {}.",
                milliseconds(c.limit_s)
            ),
        });
    }
    let scatter = c.scatter_s.filter(|s| *s > c.limit_s)?;
    Some(format!("The delay scatters by {} from window to window.", milliseconds(scatter)))
}

/// A change that the bins are sure of, though no window knows its level.
fn change_on_bins(found: &Found) -> Option<f64> {
    let (flexible, test) = (found.flexible.as_ref()?, found.test.as_ref()?);
    let statistics = bin_statistics(&flexible.a, &flexible.z, &flexible.middle_s)?;
    let size = statistics.step_or_excursion / test.all.inflation;
    (size > SURE_CHANGE).then_some(size)
}

/// Curve of at most 200 points.
pub(crate) fn curve(found: &Found, verdict: &Verdict) -> Vec<CurvePoint> {
    if let Some(refined) = found.refined.as_ref().filter(|_| verdict.shape.is_some()) {
        let [from, to] = found.span_s;
        let step = (to - from) / (CURVE_POINTS - 1) as f64;
        let mut times: Vec<f64> = (0..CURVE_POINTS).map(|k| from + step * k as f64).collect();
        let edges = refined.description.terms.iter().filter(|t| t.kind == DelayTermKind::Step);
        times.extend(edges.take((MOST_POINTS - CURVE_POINTS) / 2).flat_map(|e| [e.at_s - 1e-3, e.at_s]));
        times.retain(|t| *t >= from && *t <= to);
        times.sort_by(f64::total_cmp);
        let point = |t: f64| CurvePoint {
            t_s: t,
            delay_s: refined.description.at(t),
            standard_uncertainty_s: refined.uncertainty_at(t),
        };
        return times.into_iter().map(point).collect();
    }
    let Some(flexible) = &found.flexible else { return vec![] };
    let every = flexible.middle_s.len().div_ceil(MOST_POINTS).max(1);
    let scale = found.test.as_ref().map_or(1.0, |t| t.all.inflation.sqrt());
    let rows = flexible.middle_s.iter().zip(&flexible.delay_s).zip(&flexible.uncertainty_s);
    rows.step_by(every)
        .map(|((t, d), u)| CurvePoint { t_s: *t, delay_s: *d, standard_uncertainty_s: u * scale })
        .filter(|p| p.delay_s.is_finite() && p.standard_uncertainty_s.is_finite())
        .collect()
}

pub(crate) fn terms(found: &Found) -> Vec<DelayTerm> {
    let Some(refined) = &found.refined else { return vec![] };
    let term = |(i, t): (usize, &crate::describe::Term)| DelayTerm {
        kind: t.kind,
        at_s: t.at_s,
        at_interval_s: refined.when.get(i).copied().flatten(),
        size: t.size,
        standard_uncertainty: refined.size_uncertainty(i),
    };
    refined.description.terms.iter().enumerate().map(term).collect()
}

pub(crate) fn jitter_record(found: &Found) -> Option<DelayJitter> {
    let standard_deviation_s = found.jitter.found_s?;
    let remains_m = standard_deviation_s * found.motion.rms_mps;
    Some(DelayJitter { standard_deviation_s, remains_m, half_width_95_s: 1.96 * standard_deviation_s })
}

pub(crate) fn estimate(e: Effect) -> Option<Estimate> {
    (e.size.is_finite() && e.uncertainty.is_finite())
        .then_some(Estimate { value: e.size, standard_uncertainty: Some(e.uncertainty) })
}

/// "203 ± 6 ms", with k = 2.
pub(crate) fn plus_minus(e: Estimate) -> String {
    match e.standard_uncertainty {
        Some(u) => {
            let decimals = usize::from(2e3 * u < 0.95 || 2e3 * u < 9.95 && e.value.abs() < 0.0995);
            format!("{} ± {:.decimals$} ms", flight::fixed(1e3 * e.value, decimals), 2e3 * u)
        }
        None => milliseconds(e.value),
    }
}

/// "203 ms"; below 10 ms with one decimal.
pub(crate) fn milliseconds(s: f64) -> String {
    format!("{} ms", number(s))
}

fn number(s: f64) -> String {
    let ms = 1e3 * s;
    flight::fixed(ms, usize::from(ms.abs() < 9.95))
}
