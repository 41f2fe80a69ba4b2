//! Delays over the flights of a campaign: mean, test, control chart, pooled curve.

use record::{
    CampaignDelay, ControlPoint, DelayOverFlights, DelaySweep, Estimate, Finding, FlightHomogeneity, FlightRow,
    PooledSweep, SweepScore,
};
use signal::{CubicSpline, Reading, SegmentDelay, homogeneity, mean_of};

/// Limits of the control chart, in standard uncertainties.
const LIMIT: f64 = 3.0;
/// Points of the pooled curve.
const POINTS: usize = 41;
/// Sweeps with less overlap than this have no common curve, s.
const LEAST_SHARED_S: f64 = 0.01;

/// The combined delays of the flights; `None` if no flight has one. A flight with a changing delay is excluded.
/// `outliers` are in no mean, but keep their place in time order.
pub(crate) fn campaign_delay(rows: &[&FlightRow], outliers: &[String]) -> Option<CampaignDelay> {
    let of = |row: &FlightRow| reading(&row.measured_delay_s?);
    let optimum = |row: &FlightRow| reading(&row.sweep.as_ref()?.optimum.found()?.delay_s);
    let varies = |row: &FlightRow| row.lateness.as_ref().is_some_and(|lateness| lateness.kind.varies());
    let rows: Vec<&FlightRow> = rows.iter().copied().filter(|row| !varies(row)).collect();
    let alike: Vec<&FlightRow> = rows.iter().copied().filter(|row| !outliers.contains(&row.flight)).collect();
    let (measured, swept) = (over_flights(&alike, of), over_flights(&alike, optimum));
    let (control, in_time_order) = control(&rows, measured.found());
    if control.is_empty() && rows.iter().all(|row| row.sweep.is_none()) {
        return None;
    }
    Some(CampaignDelay { card_s: card(&rows), curve: pooled(&alike), measured, swept, control, in_time_order })
}

fn reading(delay_s: &Estimate) -> Option<Reading> {
    let standard_uncertainty = delay_s.standard_uncertainty.filter(|u| *u > 0.0 && u.is_finite())?;
    Some(Reading { value: delay_s.value, standard_uncertainty }).filter(|r| r.value.is_finite())
}

fn over_flights(rows: &[&FlightRow], of: impl Fn(&FlightRow) -> Option<Reading>) -> Finding<DelayOverFlights> {
    let readings: Vec<Reading> = rows.iter().copied().filter_map(of).collect();
    let Some(mean) = mean_of(&readings) else {
        return Finding::CannotTell("no flight shows its delay with an uncertainty".to_owned());
    };
    let segments: Vec<SegmentDelay> = readings
        .iter()
        .map(|r| SegmentDelay { middle_s: 0.0, delay_s: r.value, standard_uncertainty_s: r.standard_uncertainty })
        .collect();
    let homogeneity = homogeneity(&segments).map(|(chi2, p)| FlightHomogeneity {
        chi2,
        degrees_of_freedom: readings.len() as u64 - 1,
        p,
    });
    Finding::Found(DelayOverFlights {
        flights: readings.len() as u64,
        delay_s: Estimate { value: mean.value, standard_uncertainty: Some(mean.standard_uncertainty) },
        between_s: mean.between,
        homogeneity,
    })
}

/// The card's delay of position against velocity, if it is the same for all flights that have one. A card with the
/// position alone is not compared in a flight whose velocity is known to be late or on time.
fn card(rows: &[&FlightRow]) -> Option<Estimate> {
    let of = |row: &&FlightRow| {
        let (position_s, lateness) = (row.card_delay_s?, row.lateness.as_ref());
        let velocity_s = lateness.and_then(|l| l.card.as_ref()?.found()?.card.velocity_delay_s);
        let is_absolute = lateness.is_some_and(|l| l.lateness.as_ref().is_some_and(|c| c.relative_to.is_none()));
        match velocity_s {
            Some(velocity_s) => {
                let both = position_s.standard_uncertainty.zip(velocity_s.standard_uncertainty);
                let standard_uncertainty = both.map(|(u, v)| u.hypot(v));
                Some(Estimate { value: position_s.value - velocity_s.value, standard_uncertainty })
            }
            None => Some(position_s).filter(|_| !is_absolute),
        }
    };
    let mut all = rows.iter().filter_map(of);
    let first = all.next()?;
    all.all(|other| other == first).then_some(first)
}

/// The measured delays in order of time (if all times are known) or of names. The expected value is that of the card,
/// else the mean over the flights.
fn control(rows: &[&FlightRow], mean: Option<&DelayOverFlights>) -> (Vec<ControlPoint>, bool) {
    let point = |row: &FlightRow| {
        let measured = reading(&row.measured_delay_s?)?;
        let (centre_s, u) = match (row.card_delay_s, mean) {
            (Some(card), _) => (card.value, card.standard_uncertainty.unwrap_or(0.0)),
            (None, Some(mean)) => (mean.delay_s.value, mean.between_s.unwrap_or(0.0)),
            (None, None) => return None,
        };
        let limit_s = LIMIT * measured.standard_uncertainty.hypot(u);
        Some(ControlPoint {
            flight: row.flight.clone(),
            flown_at: row.flown_at.clone(),
            delay_s: row.measured_delay_s?,
            centre_s,
            limit_s,
            is_outside: (measured.value - centre_s).abs() > limit_s,
        })
    };
    let mut points: Vec<ControlPoint> = rows.iter().copied().filter_map(point).collect();
    let in_time_order = !points.is_empty() && points.iter().all(|p| p.flown_at.is_some());
    if in_time_order {
        points.sort_by(|a, b| (&a.flown_at, &a.flight).cmp(&(&b.flown_at, &b.flight)));
    }
    (points, in_time_order)
}

/// Mean squares of the flights' sweeps over their common delays. Weighted by flight time where errors are pooled, and
/// by fixes where steps are.
fn pooled(rows: &[&FlightRow]) -> Finding<PooledSweep> {
    let swept = |against| rows.iter().filter_map(|row| weighted(row, against)).collect::<Vec<_>>();
    let with_reference = swept(true);
    let against_reference = !with_reference.is_empty();
    let all = if against_reference { with_reference } else { swept(false) };
    if all.is_empty() {
        return Finding::CannotTell("no flight has a delay sweep".to_owned());
    }
    let low = all.iter().filter_map(|(s, _)| s.delay_s.first()).copied().fold(f64::NEG_INFINITY, f64::max);
    let high = all.iter().filter_map(|(s, _)| s.delay_s.last()).copied().fold(f64::INFINITY, f64::min);
    if high - low < LEAST_SHARED_S {
        return Finding::CannotTell("the delay sweeps of the flights have no delays in common".to_owned());
    }
    let delay_s: Vec<f64> = (0..POINTS).map(|k| low + (high - low) * k as f64 / (POINTS - 1) as f64).collect();
    let (mut squares, mut weights, mut flights, mut samples) = (vec![0.0; POINTS], 0.0, 0, 0);
    for (sweep, weight) in all {
        let Some(curve) = mean_squares(sweep) else { continue };
        delay_s.iter().zip(&mut squares).for_each(|(d, sum)| *sum += weight * curve.value(*d).max(0.0));
        weights += weight;
        flights += 1;
        samples += sweep.samples;
    }
    let rms_m = squares.iter().map(|s| (s / weights).sqrt()).collect();
    Finding::Found(PooledSweep { against_reference, flights, samples, delay_s, rms_m })
}

/// The sweep of a flight and its weight, if it scores errors (`against_reference`) or steps.
fn weighted(row: &FlightRow, against_reference: bool) -> Option<(&DelaySweep, f64)> {
    let sweep = row.sweep.as_ref()?;
    match (&sweep.score, against_reference) {
        (SweepScore::ErrorAgainst(_), true) => Some((sweep, row.duration_s?)),
        (SweepScore::StepAtFixes, false) => Some((sweep, sweep.samples as f64)),
        _ => None,
    }
}

/// The mean square of a sweep over its delay. Marked delays may lie close to grid points: of two close ones, one is
/// used.
fn mean_squares(sweep: &DelaySweep) -> Option<CubicSpline> {
    let (first, last) = (sweep.delay_s.first()?, sweep.delay_s.last()?);
    let close = 0.4 * (last - first) / sweep.delay_s.len() as f64;
    let (mut t, mut y): (Vec<f64>, Vec<f64>) = (vec![], vec![]);
    for (delay, rms) in sweep.delay_s.iter().zip(&sweep.rms_m) {
        if t.last().is_none_or(|before| delay - before > close) {
            t.push(*delay);
            y.push(rms * rms);
        }
    }
    CubicSpline::new(&t, &y).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::{Outcome, SweepMethod, SweepOptimum};

    fn campaign_delay_of(rows: &[FlightRow]) -> Option<CampaignDelay> {
        campaign_delay(&rows.iter().collect::<Vec<_>>(), &[])
    }

    fn row(flight: &str, delay_s: f64, u: f64) -> FlightRow {
        let json = serde_json::json!({
            "flight": flight, "key": "", "page": "", "outcome": "compensated", "lossy": false, "format": "",
            "bytes": 0, "duration_s": 100.0, "attention": [], "warnings": 0, "losses": 0,
        });
        let row: FlightRow = serde_json::from_value(json).unwrap();
        assert_eq!(row.outcome, Outcome::Compensated);
        FlightRow { measured_delay_s: Some(Estimate { value: delay_s, standard_uncertainty: Some(u) }), ..row }
    }

    /// Former bug: a right card, 200 ms, "differs" from the difference to a velocity that is 200 ms late, too.
    #[test]
    fn a_card_with_the_position_alone_is_not_compared_with_a_difference_to_a_late_velocity() {
        let with_card = |is_absolute: bool| {
            let row = row("a", 0.0, 0.002);
            let zero = (!is_absolute).then(|| "velocity.gps".to_owned());
            let lateness = crate::answer::tests::late(0.2, zero.as_deref());
            let card_delay_s = Some(Estimate { value: 0.2, standard_uncertainty: Some(0.004) });
            card(&[&FlightRow { card_delay_s, lateness: Some(lateness), ..row }])
        };
        assert_eq!(with_card(true), None);
        assert!(with_card(false).is_some());
    }

    /// rms² = floor² + speed² (Td − best)², at multiples of 5 ms and at the best delay.
    fn sweep(best: f64, speed: f64, (from, to): (i32, i32)) -> DelaySweep {
        let mut delay_s: Vec<f64> = (from..=to).map(|k| f64::from(k) * 0.005).collect();
        delay_s.push(best);
        delay_s.sort_by(f64::total_cmp);
        let rms_m = delay_s.iter().map(|d| 0.3_f64.hypot(speed * (d - best))).collect();
        DelaySweep {
            score: SweepScore::ErrorAgainst("position.truth".into()),
            samples: 1000,
            delay_s,
            rms_m,
            at: vec![],
            optimum: Finding::Found(SweepOptimum {
                delay_s: Estimate { value: best, standard_uncertainty: Some(0.001) },
                interval_95_s: [best - 0.002, best + 0.002],
                method: SweepMethod::Jackknife,
            }),
        }
    }

    #[test]
    fn consistent_flights_have_one_delay_and_an_outlier_exceeds_its_limits() {
        let mut rows: Vec<FlightRow> = [0.401, 0.399, 0.4, 0.4005].iter().map(|d| row("a", *d, 0.001)).collect();
        let together = campaign_delay_of(&rows).unwrap();
        let found = *together.measured.found().unwrap();
        assert!((found.delay_s.value - 0.400_125).abs() < 1e-12, "equal weights: the plain mean");
        assert_eq!(found.between_s, Some(0.0));
        // Σ (x − mean)²/u², by hand: 0.875² + 1.125² + 0.125² + 0.375².
        let h = found.homogeneity.unwrap();
        assert!((h.chi2 - 2.187_5).abs() < 1e-9 && h.degrees_of_freedom == 3);
        rows.push(row("late", 0.43, 0.001));
        // An outlier of the group is in no mean, and outside the limits of the others.
        let all: Vec<&FlightRow> = rows.iter().collect();
        let apart = campaign_delay(&all, &["late".to_owned()]).unwrap();
        assert_eq!(apart.measured, together.measured);
        let is_outside: Vec<bool> = apart.control.iter().map(|point| point.is_outside).collect();
        assert_eq!(is_outside, [false, false, false, false, true]);
        rows.iter_mut().for_each(|r| r.card_delay_s = Some(Estimate { value: 0.4, standard_uncertainty: Some(0.002) }));
        let together = campaign_delay_of(&rows).unwrap();
        let outside: Vec<&str> = together.control.iter().filter(|p| p.is_outside).map(|p| p.flight.as_str()).collect();
        assert_eq!(outside, ["late"]);
        assert!((together.control[0].limit_s - 3.0 * 5f64.sqrt() * 1e-3).abs() < 1e-12, "3 √(1² + 2²) ms");
        assert!(together.measured.found().unwrap().homogeneity.unwrap().p < 1e-6);
        assert_eq!(together.card_s.map(|c| c.value), Some(0.4));
    }

    #[test]
    fn flights_are_in_order_of_time_if_all_times_are_known() {
        let mut rows = vec![row("b", 0.4, 0.001), row("a", 0.4, 0.001)];
        let names = |rows: &[FlightRow]| {
            let all = campaign_delay_of(rows).unwrap();
            (all.control.iter().map(|p| p.flight.clone()).collect::<Vec<_>>().concat(), all.in_time_order)
        };
        assert_eq!(names(&rows), ("ba".to_owned(), false), "the order of the rows");
        rows[0].flown_at = Some("2026-05-04T12:00:00Z".into());
        rows[1].flown_at = Some("2026-05-03T12:00:00Z".into());
        assert_eq!(names(&rows), ("ab".to_owned(), true));
    }

    /// Weights 100 s and 300 s: mean squares about 0.40 and 0.42 s at 20 and 10 m/s.
    #[test]
    fn the_pooled_curve_is_the_time_weighted_mean_of_the_squares() {
        let mut rows = vec![row("a", 0.4, 0.001), row("b", 0.42, 0.001)];
        rows[0].sweep = Some(sweep(0.4, 20.0, (60, 100)));
        rows[1].sweep = Some(sweep(0.4213, 10.0, (64, 104)));
        rows[1].duration_s = Some(300.0);
        let all = campaign_delay_of(&rows).unwrap();
        let pooled = all.curve.found().unwrap();
        assert_eq!((pooled.flights, pooled.samples, pooled.against_reference), (2, 2000, true));
        assert!((pooled.delay_s[0] - 0.32).abs() < 1e-12 && (pooled.delay_s[POINTS - 1] - 0.5).abs() < 1e-12);
        for (d, rms) in pooled.delay_s.iter().zip(&pooled.rms_m) {
            let squares = 0.09 + 0.25 * (20.0 * (d - 0.4)).powi(2) + 0.75 * (10.0 * (d - 0.4213)).powi(2);
            assert!((rms - squares.sqrt()).abs() < 1e-9, "{d}: {rms} and {}", squares.sqrt());
        }
        rows[1].sweep = Some(sweep(0.9, 10.0, (160, 200)));
        assert!(campaign_delay_of(&rows).unwrap().curve.found().is_none(), "no delay is in both");
    }

    /// No cubic has a bend: a spline with fewer knots would not pass through these points.
    #[test]
    fn the_mean_square_of_a_sweep_passes_through_each_delay_that_is_not_close_to_another() {
        let mut sharp = sweep(0.4, 20.0, (60, 100));
        sharp.rms_m = sharp.delay_s.iter().map(|d| 0.3 + 20.0 * (d - 0.4).abs()).collect();
        let curve = mean_squares(&sharp).unwrap();
        for (d, rms) in sharp.delay_s.iter().zip(&sharp.rms_m) {
            assert!((curve.value(*d) - rms * rms).abs() < 1e-9, "{d}");
        }
    }

    #[test]
    fn without_any_delay_there_is_no_summary() {
        let mut only = row("a", 0.4, 0.001);
        only.measured_delay_s = None;
        assert_eq!(campaign_delay_of(&[only]), None);
    }
}
