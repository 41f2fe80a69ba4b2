//! Results of the network in plain English.

use crate::graph::Graph;
use crate::isolate::Isolation;
use crate::lineage::ACCELERATION_FAMILY;
use crate::settings::NetworkSettings;
use record::{EffectName, NetworkDatum, NetworkVerdict};

/// Seconds as text in milliseconds.
pub(crate) fn ms(seconds: f64) -> String {
    flight::fixed(1e3 * seconds, 1)
}

/// `a`, `a and b`, `a, b and c`.
pub(crate) fn list(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// Effect as `velocity.gps against acceleration`.
pub(crate) fn effect(name: &EffectName) -> String {
    let family = |name: &str| if name == ACCELERATION_FAMILY { "acceleration".to_owned() } else { name.to_owned() };
    format!("{} against {}", family(&name.first), family(&name.second))
}

/// What the latenesses refer to, part by part.
pub(crate) fn datum(graph: &Graph, isolation: &Isolation, settings: &NetworkSettings, earlier: &[usize]) -> String {
    let mut sentences: Vec<String> = Vec::new();
    for (part, zero) in isolation.adjustment.parts.iter().enumerate() {
        let name = |node: usize| graph.nodes[node].name.clone();
        let relative = || zero.zero.map_or_else(String::new, |node| format!("relative to {}", name(node)));
        let sentence = match zero.datum {
            NetworkDatum::Imu => format!(
                "Against the IMU, assumed to be on time within {} ms. Its own lateness cannot be seen in a flight: a \
                 bench card, a reference or a pulse per second would show it.",
                ms(settings.datum_uncertainty_s)
            ),
            NetworkDatum::Reference => "Against the reference, assumed to be on time.".to_owned(),
            NetworkDatum::None => format!("Figures are {}: the lateness of both is unknown.", relative()),
            NetworkDatum::Refused => {
                let names: Vec<String> =
                    earlier.iter().filter(|at| graph.nodes[**at].part == part).map(|at| name(*at)).collect();
                format!(
                    "{} would be earlier than the IMU, which is not possible: the IMU itself is late, so it is not \
                     used as the zero. Figures are {}: the lateness of both is unknown.",
                    list(&names),
                    relative()
                )
            }
        };
        if !sentences.contains(&sentence) {
            sentences.push(sentence);
        }
    }
    sentences.join(" ")
}

/// Verdict with the names that belong to it.
pub(crate) fn verdict(graph: &Graph, isolation: &Isolation) -> String {
    let names = |effects: &[usize]| {
        list(&effects.iter().filter_map(|at| graph.effects.get(*at)).map(|e| effect(&e.name)).collect::<Vec<_>>())
    };
    let freed = match isolation.freed.as_slice() {
        [] => String::new(),
        freed => format!(" Already not used: {}.", names(freed)),
    };
    match isolation.verdict {
        NetworkVerdict::Consistent => "All pairs agree with one lateness per channel.".to_owned(),
        NetworkVerdict::Unchecked => "No pair is checked by another.".to_owned(),
        NetworkVerdict::Named => {
            format!(
                "The pairs do not agree. One explanation fits: {} is wrong and is not used.",
                names(&isolation.freed)
            )
        }
        NetworkVerdict::Undecided => format!(
            "The pairs do not agree. One of {} is wrong, and this flight cannot tell which: the intervals cover every \
             case.{freed}",
            names(&isolation.suspects)
        ),
        NetworkVerdict::Scattered => format!(
            "The pairs do not agree and no single one explains it: all uncertainties are multiplied by {:.1}.{freed}",
            isolation.birge
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_has_one_and_before_its_last_item() {
        let of = |items: &[&str]| list(&items.iter().map(|item| (*item).to_owned()).collect::<Vec<_>>());
        assert_eq!([of(&[]), of(&["a"]), of(&["a", "b"]), of(&["a", "b", "c"])], ["", "a", "a and b", "a, b and c"]);
    }
}
