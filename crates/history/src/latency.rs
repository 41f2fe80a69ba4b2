//! Lateness of positions, by receiver, firmware, rate and baud.

use crate::brief::Brief;
use crate::change_points::{SharedMean, few_odd};
use crate::row::Dimension;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;

/// Flights that differ as much as theirs with a smaller probability have no common lateness.
const DIFFER_P: f64 = 0.01;

/// One line of the table of latencies.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LatencyLine {
    /// Make and model of the receiver. If they are unknown: `unknown receiver of map M`, or `null` without a group.
    pub receiver: Option<String>,
    /// Firmware of the receiver.
    pub firmware: Option<String>,
    /// Rate of the position.
    pub rate: Option<String>,
    /// Speed of the serial line.
    pub baud: Option<String>,
    /// What the lateness is counted from.
    pub datum: String,
    /// Flights.
    pub flights: u64,
    /// Those of them that differ from the others by more than the uncertainties: a few, and not in the mean.
    pub odd_flights: u64,
    /// Weighted mean, s.
    pub lateness_s: f64,
    /// Its standard uncertainty, s, with Student's t for few flights. The part of the model error that all flights share
    /// is not averaged down.
    pub lateness_u_s: f64,
    /// That shared part, s: the smallest of any of these flights.
    pub lateness_common_u_s: f64,
    /// Standard deviation between flights in addition to their own uncertainties, s.
    pub between_s: f64,
    /// Probability that flights with one lateness differ as much as these in the mean; `None` for one flight.
    /// Below 0.01 the mean describes none of them.
    pub differ_p: Option<f64>,
    /// Smallest, s.
    pub low_s: f64,
    /// Largest, s.
    pub high_s: f64,
}

impl LatencyLine {
    /// Whether the flights have no common lateness.
    #[must_use]
    pub fn differs(&self) -> bool {
        self.differ_p.is_some_and(|p| p < DIFFER_P)
    }
}

/// One line for each receiver, firmware, rate, baud and datum. Copies of a flight count once.
#[must_use]
pub fn latency(latest: &[&Brief]) -> Vec<LatencyLine> {
    type Key = ([Option<String>; 4], String);
    let mut lines: BTreeMap<Key, Vec<&Brief>> = BTreeMap::new();
    for row in latest.iter().copied().filter(|row| row.duplicate_of.is_none()) {
        if row.lateness_s.is_some() && row.lateness_u_s.is_some_and(|u| u > 0.0) {
            let [firmware, rate, baud] = [Dimension::Firmware, Dimension::Rate, Dimension::Baud].map(|d| row.of(d));
            // Unknown receivers of different maps are different receivers.
            let receiver =
                row.of(Dimension::Receiver).or_else(|| Some(row.group.as_deref()?.split(", ").next()?.to_owned()));
            let facts = [receiver, firmware, rate, baud];
            lines.entry((facts, row.datum.as_deref().unwrap_or_default().to_owned())).or_default().push(row);
        }
    }
    let line = |(([receiver, firmware, rate, baud], datum), mut rows): (Key, Vec<&Brief>)| {
        rows.sort_by_key(|row| row.order());
        let latenesses =
            rows.iter().filter_map(|row| Some((row.lateness_s?, row.lateness_u_s?, row.lateness_model_u_s)));
        let (x, u, model): (Vec<f64>, Vec<f64>, Vec<Option<f64>>) = latenesses.collect();
        let end = |pick: fn(f64, f64) -> f64| x.iter().copied().reduce(pick);
        let (low_s, high_s, flights) = (end(f64::min)?, end(f64::max)?, x.len() as u64);
        let (mean, kept, differ_p) = without_few_odd(&x, &u, &model).or_else(|| mean_of(&x, &u, &model))?;
        Some(LatencyLine {
            receiver,
            firmware,
            rate,
            baud,
            datum,
            flights,
            odd_flights: flights - kept as u64,
            lateness_s: mean.mean,
            lateness_u_s: mean.u_of(kept),
            lateness_common_u_s: mean.common,
            between_s: mean.between,
            differ_p,
            low_s,
            high_s,
        })
    };
    lines.into_iter().filter_map(line).collect()
}

/// A mean, its number of flights, and the probability that flights of one lateness differ as much as these.
type Pooled = (SharedMean, usize, Option<f64>);

fn mean_of(x: &[f64], u: &[f64], model: &[Option<f64>]) -> Option<Pooled> {
    let mean = SharedMean::of_one_line(x, u, model)?;
    Some((mean, x.len(), mean.differ_p(x, u)))
}

/// The mean without a few odd flights, if the rest have one lateness.
fn without_few_odd(x: &[f64], u: &[f64], model: &[Option<f64>]) -> Option<Pooled> {
    let odd = few_odd(x, u, model);
    let alike = x.iter().zip(u).zip(model).zip(&odd).filter(|(_, odd)| !**odd);
    let (x, u, model): (Vec<f64>, Vec<f64>, Vec<Option<f64>>) =
        alike.map(|(((x, u), model), _)| (*x, *u, *model)).collect();
    mean_of(&x, &u, &model).filter(|(_, _, differ_p)| differ_p.is_none_or(|p| p >= DIFFER_P))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brief::latest_briefs;
    use crate::row::Row;

    #[test]
    fn each_receiver_and_firmware_has_its_own_line() {
        let row = |n: usize, firmware: &str, late_s: f64| Row {
            flight: format!("{n}"),
            receiver: Some("u-blox M8".into()),
            firmware: Some(firmware.into()),
            baud: Some(115_200),
            datum: Some("imu".into()),
            lateness_s: Some(late_s),
            lateness_u_s: Some(0.002),
            lateness_model_u_s: Some(0.0),
            ..Row::default()
        };
        let rows = [row(1, "3.01", 0.118), row(2, "3.01", 0.119), row(3, "4.04", 0.100)];
        let copy = Row { duplicate_of: Some("3".into()), ..row(4, "4.04", 0.3) };
        let briefs: Vec<Brief> = rows.iter().chain([&copy]).map(Brief::from).collect();
        let table = latency(&latest_briefs(&briefs));
        let short: Vec<(u64, f64)> = table.iter().map(|line| (line.flights, (line.lateness_s * 1e6).round())).collect();
        assert_eq!(short, [(2, 118_500.0), (1, 100_000.0)]);
        // Half of Student's half-width: t = 12.7062 for two flights.
        assert!((table[0].lateness_u_s - 0.5 * 12.706_205 * 0.002 / 2f64.sqrt()).abs() < 1e-8);
        assert!((table[1].lateness_u_s - 0.002).abs() < 1e-9, "one flight has its own");
        assert_eq!(table[0].baud.as_deref(), Some("115200 baud"));
    }

    #[test]
    fn unknown_receivers_of_two_maps_have_a_line_each() {
        let row = |n: usize, map: &str, late_s: f64| Row {
            flight: format!("{n}"),
            group: Some(format!("unknown receiver of map {map}, 5 Hz, CSV")),
            datum: Some("relative to velocity.gps".into()),
            lateness_s: Some(late_s),
            lateness_u_s: Some(0.002),
            ..Row::default()
        };
        let briefs = [row(1, "a", 0.1), row(2, "b", 0.4), row(3, "a", 0.1)].map(|row| Brief::from(&row));
        let lines = latency(&latest_briefs(&briefs));
        let short: Vec<(&str, u64)> = lines.iter().map(|l| (l.receiver.as_deref().unwrap(), l.flights)).collect();
        assert_eq!(short, [("unknown receiver of map a", 2), ("unknown receiver of map b", 1)]);
    }

    #[test]
    fn a_step_between_flights_is_in_the_spread_and_in_the_uncertainty() {
        let row = |n: usize| Row {
            flight: format!("{n:03}"),
            flown_ns: i64::try_from(n).ok(),
            datum: Some("imu".into()),
            lateness_s: Some(if n < 10 { 0.4 } else { 0.45 }),
            lateness_u_s: Some(0.0005),
            lateness_model_u_s: Some(0.0),
            ..Row::default()
        };
        let rows: Vec<Brief> = (0..16).map(|n| Brief::from(&row(n))).collect();
        let found = latency(&latest_briefs(&rows)).into_iter().next().unwrap();
        // Ten at 400 ms and six at 450 ms: mean 418.75 ms, sample standard deviation 25.0 ms.
        assert!((found.lateness_s - 0.41875).abs() < 0.1e-3 && (found.between_s - 0.025).abs() < 0.2e-3, "{found:?}");
        // t = 2.13145 for 16 flights.
        assert!((found.lateness_u_s - 0.5 * 2.131_45 * 0.025 / 4.0).abs() < 0.1e-3, "{found:?}");
        // Former bug: a mean of two firmwares looked like any other.
        assert!(found.differ_p.unwrap() < 1e-6, "{found:?}");
        assert!(line(8, Some(0.0075)).differ_p.unwrap() > 0.99 && line(1, None).differ_p.is_none());
    }

    /// Former bug: one odd flight of eight moved the mean, which `trend` said is without it.
    #[test]
    fn a_few_odd_flights_are_counted_and_not_in_the_mean() {
        let line = |odd: usize| {
            let row = |n: usize| Row {
                flight: format!("{n:03}"),
                datum: Some("imu".into()),
                lateness_s: Some(if n < odd { 0.33 } else { 0.3 }),
                lateness_u_s: Some(0.002),
                lateness_model_u_s: Some(0.0),
                ..Row::default()
            };
            let rows: Vec<Brief> = (0..8).map(|n| Brief::from(&row(n))).collect();
            latency(&latest_briefs(&rows)).into_iter().next().unwrap()
        };
        let one = line(1);
        assert_eq!((one.flights, one.odd_flights, one.high_s), (8, 1, 0.33), "{one:?}");
        assert!((one.lateness_s - 0.3).abs() < 1e-9 && !one.differs(), "{one:?}");
        let three = line(3);
        assert!(three.odd_flights == 0 && three.differs(), "more than a quarter are another kind of flight: {three:?}");
    }

    /// One flight known to 1 ms and seven to 20 ms, spread over 0.5 s: the certain one does not decide.
    #[test]
    fn one_certain_flight_does_not_hide_the_spread() {
        let row = |n: usize| Row {
            flight: format!("{n:03}"),
            datum: Some("imu".into()),
            lateness_s: Some([0.40, -0.10, 0.38, 0.02, 0.35, 0.36, 0.01, 0.39][n]),
            lateness_u_s: Some(if n == 0 { 0.001 } else { 0.02 }),
            lateness_model_u_s: Some(0.0),
            ..Row::default()
        };
        let rows: Vec<Brief> = (0..8).map(|n| Brief::from(&row(n))).collect();
        let found = latency(&latest_briefs(&rows)).into_iter().next().unwrap();
        // Mean 226 ms and sample standard deviation 210 ms of the eight.
        assert!((found.between_s - 0.210).abs() < 0.01, "{found:?}");
        assert!((found.lateness_s - 0.226).abs() < 0.01 && found.lateness_u_s > 0.06, "{found:?}");
    }

    /// The line for some flights that agree, each with U = 16 ms, of which `model_u_s` is the model's part.
    fn line(flights: usize, model_u_s: Option<f64>) -> LatencyLine {
        let row = |n: usize| Row {
            flight: format!("{n:03}"),
            datum: Some("imu".into()),
            lateness_s: Some(0.201),
            lateness_u_s: Some(0.008),
            lateness_model_u_s: model_u_s,
            ..Row::default()
        };
        let rows: Vec<Brief> = (0..flights).map(|n| Brief::from(&row(n))).collect();
        latency(&latest_briefs(&rows)).into_iter().next().unwrap()
    }

    #[test]
    fn a_shared_error_is_not_averaged_down() {
        for flights in [1, 8, 400] {
            let exact = ((0.008f64.powi(2) - 0.0075f64.powi(2)) / flights as f64 + 0.0075f64.powi(2)).sqrt();
            let found = line(flights, Some(0.0075));
            assert!((found.lateness_u_s - exact).abs() < 1e-9, "{flights}: {found:?}");
            assert!((found.lateness_common_u_s - 0.0075).abs() < 1e-12);
        }
    }

    #[test]
    fn more_flights_do_not_help_if_the_shared_part_is_unknown() {
        for flights in [1, 8, 400] {
            assert!((line(flights, None).lateness_u_s - 0.008).abs() < 0.1e-3);
        }
    }

    #[test]
    fn the_mean_of_a_history_matches_the_campaigns_group() {
        let (late, u) = ([0.1949, 0.2021, 0.2034, 0.2045, 0.2002, 0.2011, 0.1987, 0.2030], 0.0082);
        let model = [0.0078, 0.0079, 0.0078, 0.0080, 0.0078, 0.0078, 0.0081, 0.0078];
        let rows = late.iter().zip(model).enumerate().map(|(n, (late, model))| Row {
            flight: format!("{n}"),
            lateness_s: Some(*late),
            lateness_u_s: Some(u),
            lateness_model_u_s: Some(model),
            ..Row::default()
        });
        let rows: Vec<Row> = rows.collect();
        let group: Vec<delay_network::FlightLateness> = rows
            .iter()
            .map(|row| delay_network::FlightLateness {
                flight: row.flight.clone(),
                lateness_s: row.lateness_s.unwrap(),
                standard_uncertainty_s: u,
                model_uncertainty_s: row.lateness_model_u_s.unwrap(),
            })
            .collect();
        let pool = delay_network::pool(&group, 0.005).unwrap();
        let briefs: Vec<Brief> = rows.iter().map(Brief::from).collect();
        let found = &latency(&latest_briefs(&briefs))[0];
        assert!((found.lateness_s - pool.mean_s.value).abs() < 0.1e-3, "{found:?} {pool:?}");
        assert!(
            (found.lateness_u_s / pool.mean_s.standard_uncertainty.unwrap() - 1.0).abs() < 0.02,
            "{found:?} {pool:?}"
        );
    }
}
