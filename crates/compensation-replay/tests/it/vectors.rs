//! The acceptance vectors of the design note for these two compensators.

use compensation_replay::{ExactAsync, PadeTustin};
use serde_json::Value;

fn vectors() -> Value {
    serde_json::from_str(include_str!("../vectors.json")).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn close(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found} instead of {expected} ± {tolerance}");
}

/// The filter at rest before its first sample, at which `v[0]` arrives.
fn response(velocities: &[f64]) -> Vec<f64> {
    let mut filter = PadeTustin::cold(0.4, velocities[0], 0.01);
    let mut out = vec![filter.output()];
    out.extend(velocities[1..].iter().map(|&v| filter.step(0.01, v)));
    out
}

#[test]
fn step_and_ramp_responses_hold() {
    let filter = &vectors()["filter"];
    let tolerance = filter["tol"].as_f64().unwrap();
    for (name, velocity) in [("step", [1.0; 10].to_vec()), ("ramp", (0..10).map(|k| f64::from(k) * 0.01).collect())] {
        let expected = numbers(&filter[format!("{name}_cold")]);
        for (k, (found, expected)) in response(&velocity).into_iter().zip(expected).enumerate() {
            close(found, expected, tolerance, &format!("{name} {k}"));
        }
    }
}

/// `y = b·v − a·y` with the vector's coefficients, on a velocity without any structure.
#[test]
fn the_difference_equation_matches_the_vectors() {
    let filter = &vectors()["filter"];
    let (b, a) = (numbers(&filter["b"]), numbers(&filter["a"]));
    let velocity: Vec<f64> = (0..200).map(|k| (f64::from(k * k) * 1.2345).sin()).collect();
    let found = response(&velocity);
    for k in 1..velocity.len() {
        let expected = b[0] * velocity[k] + b[1] * velocity[k - 1] - a[1] * found[k - 1];
        close(found[k], expected, 1e-12, &format!("sample {k}"));
    }
}

/// Pole, DC gain and noise gain of `Td N(x)/Q(x)`, x = s Td.
#[test]
fn the_filter_is_the_first_order_pade_form() {
    let pade = &vectors()["pade"];
    assert_eq!((pade["N"].to_string(), pade["Q"].to_string()), (r#"["1"]"#.into(), r#"["1","1/2"]"#.into()));
    let (td, h) = (0.4, 1e-4);
    let impulse: Vec<f64> = {
        let mut filter = PadeTustin::cold(td, 1.0 / h, h);
        let mut out = vec![filter.output()];
        out.extend((0..80_000).map(|_| filter.step(h, 0.0)));
        out
    };
    // From a clean stretch, past the first two samples: e^{λ h}, λ = pole / Td.
    let pole = (impulse[2000] / impulse[1000]).ln() / (1000.0 * h) * td;
    close(pole, pade["poles_times_Td"][0][0].as_f64().unwrap(), 1e-6, "pole · Td");
    close(impulse.iter().sum::<f64>() * h, td, 1e-9, "DC gain");
    let noise_gain: f64 = impulse.iter().map(|y| y * y).sum::<f64>() * h / td;
    close(noise_gain, pade["noise_gain_over_Td"].as_f64().unwrap(), 3.0 * h / td, "noise gain / Td");
}

/// On a circle the continuous filter leaves R |e^{−jωTd} − R(jωTd)|; at 1 kHz Tustin adds less than 1e-5 m.
#[test]
fn the_error_on_a_circle_matches_the_closed_form() {
    for row in vectors()["circle_error"]["rows"].as_array().unwrap() {
        let [radius, speed, expected] = ["R", "U", "pade11"].map(|k| row[k].as_f64().unwrap());
        let (td, h, omega) = (0.4, 0.001, speed / radius);
        let mut filter = PadeTustin::warm(td, speed);
        let mut worst: f64 = 0.0;
        for k in 1..60_000 {
            let t = f64::from(k) * h;
            let estimate = radius * (omega * (t - td)).sin() + filter.step(h, speed * (omega * t).cos());
            if t > 5.0 {
                worst = worst.max((estimate - radius * (omega * t).sin()).abs());
            }
        }
        close(worst, expected, 1e-5, &format!("R = {radius} m, U = {speed} m/s"));
    }
}

#[test]
fn a_quadratic_track_is_recovered_exactly() {
    let case = &vectors()["exact_async"];
    let [t, v, stamps, measured, queries, expected] =
        ["t_v", "v", "t_p", "p_meas", "query", "x_est"].map(|k| numbers(&case[k]));
    let compensator = ExactAsync::new(&t, &v, 0.4);
    for (now, expected) in queries.into_iter().zip(expected) {
        let j = stamps.iter().rposition(|s| *s <= now).unwrap();
        close(
            compensator.at(now, measured[j], stamps[j]),
            expected,
            case["tol"].as_f64().unwrap(),
            &format!("{now} s"),
        );
    }
}

#[test]
fn the_integral_of_velocity_is_exact_at_any_instant() {
    let case = &vectors()["cumulative_integral"];
    let [t, v, queries, expected] = ["t", "v", "query", "I"].map(|k| numbers(&case[k]));
    let compensator = ExactAsync::new(&t, &v, 0.4);
    for (query, expected) in queries.into_iter().zip(expected) {
        close(compensator.flown(t[0], query), expected, case["tol"].as_f64().unwrap(), &format!("I({query})"));
    }
}
