//! How late positions are, by receiver, firmware, rate and baud.

use crate::brief::Brief;
use crate::change_points::{spread, weighted_mean};
use crate::row::Dimension;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;

/// One line of the table of latencies.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LatencyLine {
    /// Make and model of the receiver; `null` if it is not known.
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
    /// Weighted mean, s.
    pub lateness_s: f64,
    /// Its standard uncertainty, s.
    pub lateness_u_s: f64,
    /// Standard deviation between flights beyond their own uncertainties, s.
    pub between_s: f64,
    /// Smallest, s.
    pub low_s: f64,
    /// Largest, s.
    pub high_s: f64,
}

/// One line for each receiver, firmware, rate, baud and datum. Copies of a flight count once.
#[must_use]
pub fn latency(latest: &[&Brief]) -> Vec<LatencyLine> {
    type Key = ([Option<String>; 4], String);
    let mut lines: BTreeMap<Key, Vec<&Brief>> = BTreeMap::new();
    for row in latest.iter().copied().filter(|row| row.duplicate_of.is_none()) {
        if row.lateness_s.is_some() && row.lateness_u_s.is_some_and(|u| u > 0.0) {
            let facts = [Dimension::Receiver, Dimension::Firmware, Dimension::Rate, Dimension::Baud].map(|d| row.of(d));
            lines.entry((facts, row.datum.as_deref().unwrap_or_default().to_owned())).or_default().push(row);
        }
    }
    let line = |(([receiver, firmware, rate, baud], datum), mut rows): (Key, Vec<&Brief>)| {
        rows.sort_by_key(|row| row.order());
        let of = |of: &dyn Fn(&Brief) -> Option<f64>| rows.iter().filter_map(|row| of(row)).collect::<Vec<f64>>();
        let (x, u) = (of(&|row| row.lateness_s), of(&|row| row.lateness_u_s));
        let between_s = spread(&x, &u);
        let (lateness_s, lateness_u_s) = weighted_mean(&x, &u, between_s)?;
        let end = |pick: fn(f64, f64) -> f64| x.iter().copied().reduce(pick);
        let (low_s, high_s, flights) = (end(f64::min)?, end(f64::max)?, x.len() as u64);
        Some(LatencyLine {
            receiver,
            firmware,
            rate,
            baud,
            datum,
            flights,
            lateness_s,
            lateness_u_s,
            between_s,
            low_s,
            high_s,
        })
    };
    lines.into_iter().filter_map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brief::latest_briefs;
    use crate::row::Row;

    #[test]
    fn receivers_and_firmwares_are_lines_of_their_own() {
        let row = |n: usize, firmware: &str, late_s: f64| Row {
            flight: format!("{n}"),
            receiver: Some("u-blox M8".into()),
            firmware: Some(firmware.into()),
            baud: Some(115_200),
            datum: Some("imu".into()),
            lateness_s: Some(late_s),
            lateness_u_s: Some(0.002),
            ..Row::default()
        };
        let rows = [row(1, "3.01", 0.118), row(2, "3.01", 0.119), row(3, "4.04", 0.100)];
        let copy = Row { duplicate_of: Some("3".into()), ..row(4, "4.04", 0.3) };
        let briefs: Vec<Brief> = rows.iter().chain([&copy]).map(Brief::from).collect();
        let table = latency(&latest_briefs(&briefs));
        let short: Vec<(u64, f64)> = table.iter().map(|line| (line.flights, (line.lateness_s * 1e6).round())).collect();
        assert_eq!(short, [(2, 118_500.0), (1, 100_000.0)]);
        assert!((table[0].lateness_u_s - 0.002 / 2f64.sqrt()).abs() < 1e-9);
        assert_eq!(table[0].baud.as_deref(), Some("115200 baud"));
    }
}
