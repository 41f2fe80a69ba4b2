//! How a pool handles outliers, split groups and many flights.

use delay_network::{FlightLateness, pool};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

const DATUM_S: f64 = 0.005;

fn flight(at: usize, lateness_s: f64) -> FlightLateness {
    FlightLateness {
        flight: format!("flight-{at:05}"),
        lateness_s,
        standard_uncertainty_s: 0.0081,
        model_uncertainty_s: 0.0078,
    }
}

fn flights(latenesses_s: &[f64]) -> Vec<FlightLateness> {
    latenesses_s.iter().enumerate().map(|(at, late)| flight(at, *late)).collect()
}

/// Flights around a mean, scattered by their uncertainties less datum and model.
fn drawn(count: usize, mean_s: f64, sd_s: f64, rng: &mut Pcg64) -> Vec<f64> {
    (0..count).map(|_| mean_s + sd_s * rng.sample::<f64, _>(StandardNormal)).collect()
}

/// Seven flights at 250 ms and one at 450 ms: the mean is of the seven, and the eighth is named.
#[test]
fn outliers_are_excluded_from_the_mean_of_a_group() {
    let found = pool(&flights(&[0.2500, 0.2497, 0.2503, 0.2501, 0.2499, 0.2502, 0.4500, 0.2498]), DATUM_S).unwrap();
    assert_eq!(
        found.members.iter().filter(|m| m.outlier).map(|m| m.flight.as_str()).collect::<Vec<_>>(),
        ["flight-00006"]
    );
    assert!(found.mean_s.value > 0.27, "includes the outlier: {:?}", found.mean_s);
    let described = found.described().unwrap();
    assert_eq!(described.flights, 7);
    assert!((described.mean_s.value - 0.25).abs() < 0.1e-3, "{described:?}");
    assert!(described.half_width_95_s < 0.02, "the model's part remains: {described:?}");
    // Without outliers it is the mean of all.
    let all = pool(&flights(&[0.25, 0.252, 0.249]), DATUM_S).unwrap();
    assert_eq!((all.described().unwrap().mean_s, all.without_outliers), (all.mean_s, None));
}

#[test]
fn two_receivers_in_one_group_are_split() {
    let mut rng = Pcg64::seed_from_u64(1);
    for (early, late) in [(2, 2), (2, 5), (8, 8), (3, 40), (500, 500)] {
        let mut latenesses = drawn(early, 0.2, 0.001, &mut rng);
        latenesses.extend(drawn(late, 0.3, 0.001, &mut rng));
        latenesses.rotate_left(1);
        let split = pool(&flights(&latenesses), DATUM_S).unwrap().split.unwrap();
        assert_eq!((split.early.len(), split.late.len()), (early, late));
        assert!((split.early_s.value - 0.2).abs() < 0.003 && (split.late_s.value - 0.3).abs() < 0.003);
        assert!(split.gap_s > 0.09 && split.p < 0.01, "{early} + {late}: {}", split.p);
        assert!(split.words.starts_with("This group has two different delays"), "{}", split.words);
    }
}

#[test]
fn a_single_group_is_not_split() {
    let mut rng = Pcg64::seed_from_u64(2);
    let mut split = 0;
    for trial in 0..600 {
        let count = [4, 6, 10, 30, 100][trial % 5];
        // scatter between flights from as large as within to much larger
        let sd_s = [0.003, 0.015, 0.060][trial % 3];
        split += u32::from(pool(&flights(&drawn(count, 0.2, sd_s, &mut rng)), DATUM_S).unwrap().split.is_some());
    }
    // the limit on p is 0.01, and p is conservative
    assert!(split <= 12, "{split} of 600");
    let even: Vec<f64> = (0..200).map(|i| 0.1 + 0.001 * f64::from(i)).collect();
    assert_eq!(pool(&flights(&even), DATUM_S).unwrap().split, None, "a slow drift is not two receivers");
}

#[test]
fn clusters_closer_than_their_uncertainty_are_one_group() {
    let latenesses = [0.2, 0.2, 0.2, 0.2005, 0.2005, 0.2005];
    assert_eq!(pool(&flights(&latenesses), DATUM_S).unwrap().split, None);
}

#[test]
fn a_flight_that_differs_by_thirty_milliseconds_is_an_outlier() {
    let base = [0.2, 0.201, 0.199, 0.202, 0.198, 0.2005, 0.1995, 0.2];
    for odd in 0..base.len() {
        let mut latenesses = base;
        latenesses[odd] += 0.03;
        let found = pool(&flights(&latenesses), DATUM_S).unwrap();
        for (at, member) in found.members.iter().enumerate() {
            assert_eq!(member.outlier, at == odd, "{at}: {:?}", member.z);
        }
        assert_eq!(found.split, None, "one flight is not a cluster");
    }
}

#[test]
fn equal_uncertainties_give_the_hartung_knapp_interval() {
    let latenesses = [0.19, 0.20, 0.23];
    let found = pool(&flights(&latenesses), DATUM_S).unwrap();
    let mean = latenesses.iter().sum::<f64>() / 3.0;
    let variance = latenesses.iter().map(|late| (late - mean).powi(2)).sum::<f64>() / 2.0;
    assert!((found.mean_s.value - mean).abs() < 1e-12);
    // τ² + u² is the sample variance, so q is 1; t with 2 degrees of freedom is 4.3027
    let se = (variance / 3.0).sqrt();
    let half = (4.302_652_7 * se).hypot(1.96 * 0.0078);
    assert!((found.half_width_95_s / half - 1.0).abs() < 1e-6);
    let own = 0.0081_f64.powi(2) - 0.0078_f64.powi(2);
    assert!((found.tau_s.unwrap() - (variance - own).sqrt()).abs() < 1e-7);
}

#[test]
fn the_mean_of_a_group_has_its_stated_coverage() {
    // own parts and τ are drawn without a common error: the half width without the common part must cover 95 %
    let (mut rng, trials, mut inside) = (Pcg64::seed_from_u64(3), 1500, 0);
    let flights_of = |rng: &mut Pcg64| -> Vec<FlightLateness> {
        let own_s = 0.003;
        drawn(6, 0.2, f64::hypot(own_s, 0.004), rng)
            .iter()
            .enumerate()
            .map(|(at, late)| FlightLateness {
                flight: at.to_string(),
                lateness_s: *late,
                standard_uncertainty_s: own_s,
                model_uncertainty_s: 0.0,
            })
            .collect()
    };
    for _ in 0..trials {
        let found = pool(&flights_of(&mut rng), DATUM_S).unwrap();
        let [low, high] = found.interval_95_s;
        inside += u32::from((low..=high).contains(&0.2));
    }
    let share = f64::from(inside) / f64::from(trials);
    // Hartung–Knapp with q ≥ 1 may cover more, by 1 % here; 4 standard deviations of the count are 2.3 %
    assert!((0.927..0.983).contains(&share), "{share}");
}

#[test]
fn single_flights_and_invalid_input_are_handled() {
    let one = pool(&flights(&[0.2]), DATUM_S).unwrap();
    assert!((one.half_width_95_s - 1.96 * 0.0081).abs() < 1e-12);
    assert_eq!((one.tau_s, one.difference), (None, None));
    assert_eq!(one.members[0].z, None);
    assert_eq!(pool(&[], DATUM_S), None);
    assert_eq!(pool(&[flight(0, f64::NAN)], DATUM_S), None);
    let infinite = FlightLateness { standard_uncertainty_s: f64::INFINITY, ..flight(0, 0.2) };
    let negative = FlightLateness { model_uncertainty_s: -1.0, ..flight(1, 0.2) };
    assert_eq!(pool(&[infinite, negative], DATUM_S), None);
    let equal = pool(&flights(&[0.2; 5]), DATUM_S).unwrap();
    assert_eq!((equal.tau_s, equal.split), (Some(0.0), None));
}
