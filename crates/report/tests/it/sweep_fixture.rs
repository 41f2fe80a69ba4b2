//! A delay choice and a sweep with known numbers.

use super::TD;
use record::{
    DelayCandidate, DelayChoice, DelaySource, DelaySweep, Estimate, Finding, ObjectiveCurve, SweepMethod, SweepOptimum,
    SweepPoint, SweepScore,
};

pub fn estimate(value: f64, u: f64) -> Estimate {
    Estimate { value, standard_uncertainty: Some(u) }
}

/// The pipeline's number was removed; the flight shows 9.3 ms more.
pub fn choice() -> DelayChoice {
    let mut choice = DelayChoice {
        asked: DelaySource::Fixed,
        used: DelaySource::Fixed,
        why: "the pipeline states it".into(),
        circular: false,
        candidates: vec![
            DelayCandidate {
                source: DelaySource::Fixed,
                delay_s: Finding::Found(estimate(TD, 0.0065)),
                words: "pipeline, from Park and Lee 2010".into(),
            },
            DelayCandidate {
                source: DelaySource::Card,
                delay_s: Finding::CannotTell("no card of <sensor> 7".into()),
                words: String::new(),
            },
            DelayCandidate {
                source: DelaySource::Flight,
                delay_s: Finding::Found(estimate(TD + 0.0093, 0.0021)),
                words: "measured in this flight: position.gps against velocity.ekf, 409.3 ± 4.2 ms (k = 2)".into(),
            },
        ],
        differences: vec![],
    };
    choice.compare(Some(&swept()));
    choice
}

/// Errors of 17.5 m/s times the delay error, over a floor of 2 cm.
pub fn error(delay_s: f64) -> f64 {
    0.02_f64.hypot(17.5 * (delay_s - TD))
}

/// A sweep whose best delay is the true one.
pub fn swept() -> DelaySweep {
    let delay_s: Vec<f64> = (60..=102).map(|k| 0.005 * f64::from(k)).collect();
    let point = |source, delay_s: f64, u: f64| SweepPoint {
        source,
        delay_s: estimate(delay_s, u),
        rms_m: estimate(error(delay_s), 0.001 + 17.5 * u),
    };
    DelaySweep {
        score: SweepScore::ErrorAgainst("position.truth".into()),
        samples: 71_000,
        rms_m: delay_s.iter().map(|d| error(*d)).collect(),
        delay_s,
        at: vec![
            point(DelaySource::Fixed, TD, 0.0065),
            point(DelaySource::Flight, TD + 0.0093, 0.0021),
            point(DelaySource::Sweep, TD + 0.0002, 0.0004),
        ],
        optimum: Finding::Found(SweepOptimum {
            delay_s: estimate(TD + 0.0002, 0.0004),
            interval_95_s: [TD - 0.0007, TD + 0.0011],
            method: SweepMethod::Jackknife,
        }),
    }
}

/// A parabola centred on a delay.
pub fn objective(delay_s: f64, u: f64) -> ObjectiveCurve {
    let grid = |half: f64| (-10..=10).map(|k| delay_s + half * f64::from(k) / 10.0).collect::<Vec<f64>>();
    let value = |x: &[f64]| x.iter().map(|d| ((d - delay_s) / u).powi(2)).collect::<Vec<f64>>();
    let (wide, near) = (grid(1.0), grid(5.0 * u));
    ObjectiveCurve { value: value(&wide), delay_s: wide, near_value: value(&near), near_delay_s: near }
}
