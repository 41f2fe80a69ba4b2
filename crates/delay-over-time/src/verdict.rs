//! Turns the results into the record: kind, level, constancy, curve, terms.

use crate::bin_statistics::step_or_excursion;
use crate::delays::Effect;
use crate::settings::OverTimeSettings;
use crate::shape::Shape;
use crate::stages::{FOREIGN_SHARE, Found, Test};
use record::{Constancy, CurvePoint, DelayJitter, DelayKind, DelayTerm, DelayTermKind, Estimate};

/// Points of the curve.
const CURVE_POINTS: usize = 160;
const MOST_POINTS: usize = 200;
/// Cost by which the best delay must beat a distant one.
const RUNNER_UP_COST: f64 = 12.0;
/// Chi-squared of a change on bins above which it is reported although no window has a usable level.
const SURE_CHANGE: f64 = 40.0;

/// Why no level is reported.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Unknown {
    /// Too little motion within the velocity's record.
    NoMotion,
    /// The level is too uncertain, s.
    Wide(f64),
    /// The best delay is at the edge of the search.
    Edge,
    /// The position does not follow the velocity: unexplained share.
    Foreign(f64),
    /// Two delays fit, s.
    TwoFit([f64; 2]),
}

/// Kind, and its supporting figures.
pub(crate) struct Verdict {
    pub(crate) kind: DelayKind,
    pub(crate) unknown: Option<Unknown>,
    pub(crate) level: Option<Effect>,
    pub(crate) constancy: Constancy,
    pub(crate) widening_s: f64,
    /// Rises and falls of the description, if it varies.
    pub(crate) shape: Option<Shape>,
    /// Chi-squared of the largest change on bins over the noise, if it is significant.
    pub(crate) change_on_bins: Option<f64>,
    pub(crate) two_delays: Option<[f64; 2]>,
}

pub(crate) fn judge(found: &Found, settings: &OverTimeSettings) -> Verdict {
    let level = level_of(found);
    let (mut constancy, widening_s) = constancy_of(found.test.as_ref(), found.span_s[0], settings);
    if found.explained {
        constancy.varies = true;
        constancy.note = Some("The windows alone do not confirm the change. The curve explains more than half of the residual of a constant delay.".to_owned());
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

/// Level with the scatter between windows, if known.
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

/// For a flight without a test.
fn untested(settings: &OverTimeSettings) -> Constancy {
    Constancy {
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
    }
}

/// The test of constancy as a record, and the uncertainty that it adds to a constant.
fn constancy_of(test: Option<&Test>, first_s: f64, settings: &OverTimeSettings) -> (Constancy, f64) {
    let mut out = untested(settings);
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
    out.note = note_of(&out, first_s, differs);
    // A lone window differs: standard deviation of such a delay over the flight. Else any course between the two.
    let deviation = out.left_out_window_s.map_or(12f64.recip(), |[from, to]| {
        let flown: f64 = test.windows.iter().map(|w| w.to_s - w.from_s).sum();
        let share = (to - from) / flown.max(1e-9);
        share * (1.0 - share)
    });
    let widening_s = if differs { difference.size.abs() * deviation.max(0.0).sqrt() } else { 0.0 };
    (out, widening_s)
}

/// Instants are counted from the first fix, at `first_s`.
fn note_of(c: &Constancy, first_s: f64, differs: bool) -> Option<String> {
    if let (true, Some(b)) = (differs, c.difference_s) {
        let by = plus_minus(b);
        return Some(match c.left_out_window_s {
            Some([from, to]) => {
                format!("The delay differs by {by} in the {:.0} s that begin at {:.0} s.", to - from, from - first_s)
            }
            None => format!(
                "The delay differs by {by} between parts of the flight. That is not surely above the limit of {}.",
                milliseconds(c.limit_s)
            ),
        });
    }
    let scatter = c.scatter_s.filter(|s| *s > c.limit_s)?;
    Some(format!("The delay scatters by {} from window to window.", milliseconds(scatter)))
}

/// A change that is significant on bins, although no window has a usable level.
fn change_on_bins(found: &Found) -> Option<f64> {
    let (flexible, test) = (found.flexible.as_ref()?, found.test.as_ref()?);
    let size = step_or_excursion(&flexible.a, &flexible.z)? / test.all.inflation;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::Flexible;
    use crate::constancy::{Decision, LoneWindow};
    use crate::example::{FIRST_S, described, found};
    use nalgebra::{DMatrix, DVector};

    fn judged(found: &Found) -> Verdict {
        judge(found, &OverTimeSettings::default())
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    /// Twelve windows of ± 1 ms, 20 ms to either side of their mean: the level's uncertainty is their scatter / √12.
    #[test]
    fn a_level_is_as_uncertain_as_its_windows_disagree() {
        let delay_s: Vec<f64> = (0..12).map(|k| if k % 2 == 0 { 0.22 } else { 0.18 }).collect();
        let mut f = found(&delay_s, 1e-3);
        let level = judged(&f).level.unwrap();
        let scatter = (12.0 * 0.02 * 0.02 / 11.0f64).sqrt();
        assert!(
            near(level.size, 0.2) && (level.uncertainty / (scatter / 12f64.sqrt()) - 1.0).abs() < 0.15,
            "{level:?}"
        );
        let compared = f.test.as_ref().unwrap().comparison.as_ref().unwrap().level.uncertainty;
        assert!(near(level.uncertainty, compared));
        // Nor more certain than the noise allows.
        f.test.as_mut().unwrap().all.level.uncertainty = 0.03;
        assert!(near(judged(&f).level.unwrap().uncertainty, 0.03));
        f.test.as_mut().unwrap().comparison = None;
        f.test.as_mut().unwrap().all.level.uncertainty = 1e-4;
        assert!(near(judged(&f).level.unwrap().uncertainty, 1e-4));
        f.test.as_mut().unwrap().all.level.uncertainty = f64::INFINITY;
        assert!(judged(&f).level.is_none());
        f.test = None;
        assert!(judged(&f).level.is_none() && judged(&f).unknown == Some(Unknown::NoMotion));
    }

    #[test]
    fn an_unknown_level_is_not_reported() {
        let with = |change: &dyn Fn(&mut Found)| {
            let mut f = found(&[0.2; 12], 1e-3);
            change(&mut f);
            let v = judged(&f);
            assert_eq!(v.unknown.is_some(), v.kind == DelayKind::CannotTell);
            v.unknown
        };
        let map = |f: &mut Found, change: &dyn Fn(&mut crate::coarse::CoarseMap)| change(f.map.as_mut().unwrap());
        assert_eq!(with(&|_| ()), None);
        assert_eq!(with(&|f| f.map = None), Some(Unknown::NoMotion));
        assert_eq!(with(&|f| map(f, &|m| m.edge = true)), Some(Unknown::Edge));
        assert_eq!(with(&|f| map(f, &|m| m.unexplained_share = 0.51)), Some(Unknown::Foreign(0.51)));
        assert_eq!(with(&|f| map(f, &|m| m.unexplained_share = 0.49)), None);
        assert_eq!(with(&|f| map(f, &|m| m.runner_up_cost = 11.9)), Some(Unknown::TwoFit([0.2, 3.0])));
        assert_eq!(with(&|f| map(f, &|m| m.runner_up_cost = 12.1)), None);
        let level = |u: f64| move |f: &mut Found| f.test.as_mut().unwrap().all.level.uncertainty = u;
        assert_eq!(with(&level(0.051)), Some(Unknown::Wide(0.051)));
        assert_eq!(with(&level(0.049)), None);
        // If the delay varies, the level need not be known, and a second delay that fits does not matter.
        let varying = |f: &mut Found| f.test.as_mut().unwrap().decision.as_mut().unwrap().varies = true;
        assert_eq!(with(&|f| (varying(f), level(0.051)(f)).1), None);
        assert_eq!(with(&|f| (varying(f), map(f, &|m| m.runner_up_cost = 1.0)).1), None);
    }

    /// The margin is 20 ms; 95 % lie within 1.645 standard uncertainties on one side and within 1.96 on both.
    #[test]
    fn the_kind_of_a_constant_follows_from_its_level_and_uncertainty() {
        let kind = |size: f64, u: f64| {
            let mut f = found(&[size; 12], 1e-3);
            f.test.as_mut().unwrap().all.level = Effect { size, uncertainty: u };
            judged(&f).kind
        };
        let u = 0.002;
        assert_eq!(kind(0.02 - 1.7 * u, u), DelayKind::OnTime);
        assert_eq!(kind(0.02 - 1.6 * u, u), DelayKind::Constant);
        assert_eq!(kind(-0.02 + 1.7 * u, u), DelayKind::OnTime);
        assert_eq!(kind(-0.02 + 1.6 * u, u), DelayKind::Early);
        assert_eq!(kind(-0.05, 0.026), DelayKind::Constant);
        assert_eq!(kind(-0.05, 0.025), DelayKind::Early);
        let mut f = found(&[0.2; 12], 1e-3);
        f.test.as_mut().unwrap().comparison = None;
        assert_eq!(judged(&f).kind, DelayKind::NotTested);
    }

    /// The verdict on twelve windows where, with probability `p`, something differs by 90 ms.
    fn with_difference(p: f64, varies: bool, rests_on: Option<LoneWindow>) -> Verdict {
        let mut f = found(&[0.2; 12], 1e-3);
        let test = f.test.as_mut().unwrap();
        test.comparison.as_mut().unwrap().difference = Effect { size: 0.09, uncertainty: 0.01 };
        test.decision = Some(Decision { p, varies, rests_on });
        judged(&f)
    }

    /// A delay that is `d` longer for a share p of the flight has the standard deviation d √(p (1 − p)).
    #[test]
    fn a_differing_window_widens_a_constant_by_its_duration() {
        let rests_on = LoneWindow { row: 3, difference: Effect { size: -0.06, uncertainty: 0.004 } };
        let lone = with_difference(1e-4, false, Some(rests_on));
        assert!(near(lone.widening_s, 0.06 * (1.0 / 12.0 * 11.0 / 12.0f64).sqrt()), "{}", lone.widening_s);
        assert_eq!(lone.constancy.left_out_window_s, Some([FIRST_S + 60.0, FIRST_S + 80.0]));
        let note = lone.constancy.note.unwrap();
        assert!(note.starts_with("The delay differs by \u{2212}60.0 ± 8.0 ms in the 20 s that begin at "), "{note}");
    }

    /// A delay anywhere between two values that are `d` apart has the standard deviation d / √12.
    #[test]
    fn differing_parts_widen_a_constant() {
        let parts = with_difference(1e-4, false, None);
        assert!(near(parts.widening_s, 0.09 / 12f64.sqrt()), "{}", parts.widening_s);
        let note =
            "The delay differs by 90 ± 20 ms between parts of the flight. That is not surely above the limit of 50 ms.";
        assert_eq!(parts.constancy.note.unwrap(), note);
        assert_eq!((parts.constancy.windows, parts.constancy.window_s, parts.constancy.p), (12, 20.0, Some(1e-4)));
        for (p, varies) in [(2e-3, false), (1e-4, true)] {
            let calm = with_difference(p, varies, None);
            assert!(calm.widening_s == 0.0 && calm.constancy.note.is_none() && calm.constancy.varies == varies);
        }
        let mut f = found(&[0.2; 12], 1e-3);
        f.test.as_mut().unwrap().comparison.as_mut().unwrap().scatter_s = 0.06;
        let scatters = judged(&f).constancy.note.unwrap();
        assert_eq!(scatters, "The delay scatters by 60 ms from window to window.");
    }

    /// A step of `s` between two times ten bins of ± u has chi-squared s² / u² · 10 · 10 / 20.
    #[test]
    fn a_change_on_bins_is_reported_if_significant() {
        let change = |chi_squared: f64, inflation: f64| {
            let (u, n) = (0.01, 20);
            let size = u * (chi_squared / 5.0f64).sqrt();
            let a = DMatrix::from_diagonal(&DVector::from_element(n, 1.0 / (u * u)));
            let z = DVector::from_fn(n, |i, _| (0.2 + if i < 10 { 0.0 } else { size }) / (u * u));
            let mut f = found(&[0.2; 12], 1e-3);
            f.flexible = Some(Flexible::example((0..n).map(|k| 2.0 * k as f64).collect(), a, z));
            f.test.as_mut().unwrap().all.inflation = inflation;
            judged(&f).change_on_bins
        };
        assert!((change(80.0, 1.0).unwrap() - 80.0).abs() < 1e-6);
        assert!((change(100.0, 2.0).unwrap() - 50.0).abs() < 1e-6);
        assert_eq!((change(39.0, 1.0), change(78.0, 2.0)), (None, None));
    }

    #[test]
    fn the_curve_follows_the_description_and_shows_both_sides_of_a_step() {
        use DelayTermKind::{Bend, Step};
        let f = described(&[(Step, 90.0, 0.3), (Bend, 150.0, 0.002)], 0.2);
        let v = judged(&f);
        let curve = curve(&f, &v);
        assert!(curve.len() == CURVE_POINTS + 2 && curve.windows(2).all(|w| w[0].t_s < w[1].t_s));
        assert_eq!((curve[0].t_s, curve[161].t_s), (FIRST_S, FIRST_S + 240.0));
        for p in &curve {
            let (after, bent) = (p.t_s >= FIRST_S + 90.0, (p.t_s - FIRST_S - 150.0).max(0.0));
            assert!(near(p.delay_s, 0.2 + if after { 0.3 } else { 0.0 } + 0.002 * bent), "{p:?}");
            // Level known to 1 ms, sizes to 2 ms and 2 ms/s.
            let variance = 1e-6 + if after { 4e-6 } else { 0.0 } + 4e-6 * bent * bent;
            assert!(near(p.standard_uncertainty_s, variance.sqrt()), "{p:?}");
        }
        let at = curve.iter().position(|p| near(p.t_s, FIRST_S + 90.0)).unwrap();
        assert!(near(curve[at].delay_s - curve[at - 1].delay_s, 0.3) && curve[at].t_s - curve[at - 1].t_s < 2e-3);
        let terms = terms(&f);
        assert_eq!((terms[0].at_s, terms[0].size, terms[1].size), (FIRST_S + 90.0, 0.3, 0.002));
        assert!(terms.iter().all(|t| near(t.standard_uncertainty, 2e-3)));
    }

    /// 300 bins become 150 points, and variances are 2.25 times those of white noise.
    #[test]
    fn without_a_description_the_curve_is_from_the_bins() {
        let n = 300;
        let a = DMatrix::from_diagonal(&DVector::from_element(n, 1e4));
        let z = DVector::from_fn(n, |i, _| 1e4 * 0.001 * i as f64);
        let mut f = found(&[0.2; 12], 1e-3);
        f.flexible = Some(Flexible::example((0..n).map(|k| k as f64).collect(), a, z));
        f.test.as_mut().unwrap().all.inflation = 2.25;
        let curve = curve(&f, &judged(&f));
        assert_eq!(curve.len(), 150);
        for (k, p) in curve.iter().enumerate() {
            assert!(near(p.t_s, 2.0 * k as f64) && near(p.delay_s, 0.002 * k as f64), "{p:?}");
            assert!(near(p.standard_uncertainty_s, 0.015), "{p:?}");
        }
    }

    #[test]
    fn jitter_leaves_metres_at_the_speed_of_the_flight() {
        let mut f = found(&[0.2; 12], 1e-3);
        assert!(jitter_record(&f).is_none());
        f.jitter.found_s = Some(0.05);
        let jitter = jitter_record(&f).unwrap();
        assert!(near(jitter.remains_m, 0.05 * f.motion.rms_mps) && near(jitter.half_width_95_s, 0.098));
        assert_eq!(jitter.standard_deviation_s, 0.05);
    }

    #[test]
    fn numbers_have_the_decimals_their_uncertainty_allows() {
        let text = |value: f64, u: f64| plus_minus(Estimate { value, standard_uncertainty: Some(u) });
        assert_eq!(text(0.2034, 0.003), "203 ± 6 ms");
        assert_eq!(text(0.2034, 4e-4), "203.4 ± 0.8 ms");
        assert_eq!(text(0.0234, 0.003), "23.4 ± 6.0 ms");
        assert_eq!(text(-0.0234, 0.006), "\u{2212}23 ± 12 ms");
        assert_eq!(plus_minus(Estimate { value: 0.2034, standard_uncertainty: None }), "203 ms");
        let texts = [0.0123, 0.0099, -0.0099, 0.00996, 1.5].map(milliseconds);
        assert_eq!(texts, ["12 ms", "9.9 ms", "\u{2212}9.9 ms", "10 ms", "1500 ms"]);
        let of = |size: f64, uncertainty: f64| estimate(Effect { size, uncertainty });
        assert!(of(1.0, 1.0).is_some() && of(f64::NAN, 1.0).is_none() && of(1.0, f64::INFINITY).is_none());
    }
}
