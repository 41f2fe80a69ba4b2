//! The acceptance vectors of the specification: 8 networks and 4 pools.

use delay_network::{FlightLateness, NetworkSettings, PairObservation, difference, lineage_from_name, pool, solve};
use record::{DelayNetwork, DelayPairKind, EffectKind, EffectName, Estimate, NetworkDatum};
use serde_json::Value;

/// Tolerance of latenesses and uncertainties, s.
const TIME_TOLERANCE_S: f64 = 1e-5;
/// Tolerance of test values.
const TEST_TOLERANCE: f64 = 1e-3;

fn vectors() -> Value {
    serde_json::from_str(include_str!("data/vectors.json")).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap()
}

fn items(value: &Value) -> &[Value] {
    value.as_array().unwrap()
}

fn assert_near(name: &str, what: &str, found: f64, wanted: &Value, tolerance: f64) {
    let wanted = number(wanted);
    assert!((found - wanted).abs() <= tolerance, "{name}, {what}: {found} instead of {wanted}");
}

fn observations(network: &Value) -> Vec<PairObservation> {
    items(&network["pairs"])
        .iter()
        .map(|pair| {
            let kind: DelayPairKind = serde_json::from_value(pair["kind"].clone()).unwrap();
            let (first, second) = (text(&pair["first"]), text(&pair["second"]));
            PairObservation::measured(
                kind,
                first,
                second,
                number(&pair["delay_s"]),
                number(&pair["standard_uncertainty_s"]),
            )
        })
        .collect()
}

fn effect_name(value: &Value) -> EffectName {
    let kind = match text(&value[0]) {
        "ss" => EffectKind::MeasuredMeasured,
        "sd" => EffectKind::MeasuredDerived,
        "dd" => EffectKind::DerivedDerived,
        "sacc" => EffectKind::MeasuredAcceleration,
        "dacc" => EffectKind::DerivedAcceleration,
        other => panic!("{other} is not a type of pair"),
    };
    EffectName { kind, first: text(&value[1]).to_owned(), second: text(&value[2]).to_owned() }
}

fn solved(network: &Value) -> DelayNetwork {
    solve(&observations(network), &lineage_from_name, &NetworkSettings::default()).unwrap()
}

#[test]
fn the_constants_match_the_specification() {
    let (constants, settings) = (&vectors()["constants"], NetworkSettings::default());
    let model = &constants["model_s"];
    assert_eq!(settings.model.measured_measured_s, number(&model["ss"]));
    assert_eq!(settings.model.measured_derived_s, number(&model["sd"]));
    assert_eq!(settings.model.derived_derived_s, number(&model["dd"]));
    assert_eq!(settings.model.measured_acceleration_s, number(&model["sacc"]));
    assert_eq!(settings.model.derived_acceleration_s, number(&model["dacc"]));
    assert_eq!(settings.model.measured_reference_s, number(&model["sref"]));
    assert_eq!(settings.model.derived_reference_s, number(&model["dref"]));
    assert_eq!(settings.shared_noise, number(&constants["rho"]));
    assert_eq!(settings.datum_uncertainty_s, number(&constants["u_datum_s"]));
    assert_eq!(settings.acceleration_pin_s, number(&constants["pin_acc_s"]));
    assert_eq!(settings.closure_p, number(&constants["alpha"]));
    assert_eq!(settings.suspect_w, number(&constants["w_least"]));
    assert_eq!(settings.rival_w, number(&constants["rival"]));
}

#[test]
fn latenesses_and_uncertainties_match_the_vectors() {
    let vectors = vectors();
    for vector in items(&vectors["networks"]) {
        let (name, network, expect) = (text(&vector["name"]), solved(vector), &vector["expect"]);
        let lateness = expect["lateness"].as_object().unwrap();
        assert_eq!(network.channels.len(), lateness.len(), "{name}");
        for channel in &network.channels {
            let wanted = &lateness[&channel.channel];
            // the vectors keep figures against a refused datum; the record shows them next to relative ones
            let found = channel.against_refused_datum_s.unwrap_or(channel.lateness_s);
            assert_near(name, &channel.channel, found.value, &wanted["value_s"], TIME_TOLERANCE_S);
            let u = found.standard_uncertainty.unwrap();
            assert_near(name, &channel.channel, u, &wanted["standard_uncertainty_s"], TIME_TOLERANCE_S);
            if channel.datum != NetworkDatum::Refused {
                for end in 0..2 {
                    let wanted = &wanted["interval_95_s"][end];
                    assert_near(name, &channel.channel, channel.interval_95_s[end], wanted, 2.0 * TIME_TOLERANCE_S);
                }
                let model = &expect["least_model_error_s"][&channel.channel];
                assert_near(name, &channel.channel, channel.model_uncertainty_s, model, TIME_TOLERANCE_S);
            }
            let zero = items(&expect["zero_by_convention"]).iter().any(|zero| text(zero) == channel.channel);
            if channel.datum != NetworkDatum::Refused {
                assert_eq!(zero, channel.relative_to.as_ref() == Some(&channel.channel), "{name}");
            }
        }
    }
}

#[test]
fn verdicts_and_closures_match_the_vectors() {
    let vectors = vectors();
    for vector in items(&vectors["networks"]) {
        let (name, network, expect) = (text(&vector["name"]), solved(vector), &vector["expect"]);
        assert_eq!(serde_json::to_value(network.datum).unwrap(), expect["datum"], "{name}");
        assert_eq!(serde_json::to_value(network.verdict).unwrap(), expect["verdict"], "{name}");
        assert_eq!(u64::from(network.degrees_of_freedom), expect["degrees_of_freedom"].as_u64().unwrap(), "{name}");
        match &expect["p"] {
            Value::Null => assert_eq!(network.p, None, "{name}"),
            p => {
                assert_near(name, "p", network.p.unwrap(), p, TEST_TOLERANCE);
                assert_near(name, "chi2", network.chi2, &expect["chi2"], TEST_TOLERANCE);
            }
        }
        let mut earlier: Vec<&str> = items(&expect["earlier_than_datum"]).iter().map(text).collect();
        earlier.sort_unstable();
        let found: Vec<&str> =
            network.channels.iter().filter(|c| c.earlier_than_datum).map(|c| c.channel.as_str()).collect();
        assert_eq!(found, earlier, "{name}");
    }
}

#[test]
fn residuals_match_the_vectors() {
    let vectors = vectors();
    for vector in items(&vectors["networks"]) {
        let (name, network) = (text(&vector["name"]), solved(vector));
        for pair in &network.used_pairs {
            let key = format!("{} - {}", pair.first, pair.second);
            assert_near(name, &key, pair.residual_s, &vector["expect"]["residual_s"][&key], TIME_TOLERANCE_S);
        }
    }
}

#[test]
fn wrong_effects_and_rivals_match_the_vectors() {
    let vectors = vectors();
    for vector in items(&vectors["networks"]) {
        let (name, network) = (text(&vector["name"]), solved(vector));
        let log = items(&vector["expect"]["named"]);
        let (mut named, mut undecided) = (Vec::new(), Vec::new());
        for entry in log {
            let rivals = items(&entry["rivals"]);
            if rivals.is_empty() {
                named.push(effect_name(&entry["effect"]));
                continue;
            }
            undecided.push(effect_name(&entry["effect"]));
            undecided.extend(rivals.iter().map(effect_name));
            let found = network.effects.iter().find(|e| e.name == undecided[0]).unwrap();
            assert_near(name, "w", found.w.unwrap().abs(), &entry["w"], TEST_TOLERANCE);
            assert_near(name, "size", found.size_s.unwrap().abs(), &entry["size_s"], TIME_TOLERANCE_S);
        }
        undecided.sort();
        assert_eq!(network.named, named, "{name}");
        assert_eq!(network.undecided_between, undecided, "{name}");
    }
}

#[test]
fn reliabilities_match_the_vectors() {
    let vectors = vectors();
    for vector in items(&vectors["networks"]) {
        let (name, network) = (text(&vector["name"]), solved(vector));
        let wanted = items(&vector["expect"]["reliability"]);
        assert_eq!(network.effects.len(), wanted.len(), "{name}");
        for wanted in wanted {
            let key = effect_name(&wanted["effect"]);
            let found = network.effects.iter().find(|effect| effect.name == key).unwrap();
            assert_near(name, "redundancy", found.redundancy, &wanted["redundancy"], 1e-4);
            match &wanted["least_error_found_s"] {
                Value::Null => assert_eq!(found.least_error_found_s, None, "{name}: {key:?}"),
                least => {
                    assert_near(name, "least error", found.least_error_found_s.unwrap(), least, TIME_TOLERANCE_S);
                }
            }
        }
    }
}

#[test]
fn a_refused_datum_leaves_relative_figures_and_a_lower_bound() {
    let vectors = vectors();
    let vector = items(&vectors["networks"]).iter().find(|v| text(&v["name"]) == "filter-before-imu").unwrap();
    let network = solved(vector);
    let position = network.channel("position.gps").unwrap();
    assert_eq!(position.relative_to.as_deref(), Some("velocity.ekf"));
    let latenesses = &vector["expect"]["lateness"];
    let value = |name: &str| number(&latenesses[name]["value_s"]);
    assert!((position.lateness_s.value - (value("position.gps") - value("velocity.ekf"))).abs() < TIME_TOLERANCE_S);
    assert!((position.at_least_s.unwrap() - (value("position.gps") - value("position.ekf"))).abs() < TIME_TOLERANCE_S);
    assert!(network.datum_words.contains("relative to velocity.ekf"), "{}", network.datum_words);
}

#[test]
fn the_bare_pair_equals_the_network_difference() {
    let vectors = vectors();
    let network = solved(&vectors["networks"][2]);
    let Estimate { value, standard_uncertainty } = difference(&network, "position.gps", "velocity.ekf").unwrap();
    assert!((value - 0.1471).abs() < 1e-9);
    assert!((standard_uncertainty.unwrap() - 0.00335_f64.hypot(0.008)).abs() < 1e-6, "pair and its model error");
}

fn pool_flights(vector: &Value) -> Vec<FlightLateness> {
    let column = |key: &str| items(&vector[key]).iter().map(number).collect::<Vec<f64>>();
    let (t, u, model) = (column("lateness_s"), column("standard_uncertainty_s"), column("model_part_s"));
    (0..t.len())
        .map(|i| FlightLateness {
            flight: format!("flight-{i}"),
            lateness_s: t[i],
            standard_uncertainty_s: u[i],
            model_uncertainty_s: model[i],
        })
        .collect()
}

#[test]
fn pools_match_the_vectors() {
    let vectors = vectors();
    for vector in items(&vectors["pools"]) {
        let (name, expect) = (text(&vector["name"]), &vector["expect"]);
        let found = pool(&pool_flights(vector), 0.005).unwrap();
        assert_near(name, "mean", found.mean_s.value, &expect["mean_s"], TIME_TOLERANCE_S);
        let u = found.mean_s.standard_uncertainty.unwrap();
        assert_near(name, "u", u, &expect["standard_uncertainty_s"], TIME_TOLERANCE_S);
        assert_near(name, "half", found.half_width_95_s, &expect["half_width_95_s"], TIME_TOLERANCE_S);
        assert_near(name, "tau", found.tau_s.unwrap(), &expect["tau_s"], TIME_TOLERANCE_S);
        assert_near(name, "common", found.common_s, &expect["common_s"], TIME_TOLERANCE_S);
        let difference = found.difference.unwrap();
        assert_near(name, "Q", difference.q, &expect["q_full"], TEST_TOLERANCE);
        assert_near(name, "p", difference.p, &expect["p_full"], TEST_TOLERANCE);
        assert_near(name, "I2", difference.i2, &expect["i2_full"], TEST_TOLERANCE);
        assert_near(name, "tau full", difference.tau_s, &expect["tau_full_s"], TIME_TOLERANCE_S);
        for (i, member) in found.members.iter().enumerate() {
            assert_near(name, "z", member.z.unwrap(), &expect["outlier_z"][i], TEST_TOLERANCE);
            let others = &expect["leave_one_out"][i];
            assert_near(name, "others", member.others_s.unwrap().value, &others["mean_s"], TIME_TOLERANCE_S);
            let half = member.others_half_width_95_s.unwrap();
            assert_near(name, "others' half", half, &others["half_width_95_s"], TIME_TOLERANCE_S);
        }
        assert_eq!(found.split, None, "{name}");
    }
}
