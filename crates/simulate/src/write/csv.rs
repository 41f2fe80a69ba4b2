//! Tables. Numbers are written with enough digits to be read back bit for bit.

use super::message::Message;
use super::{LogFile, Logbook};
use crate::simulated::SimulatedFlight;

/// Columns of the wide table, and their units in the row below.
const WIDE_HEADER: &str = "time_ns,latitude,longitude,altitude,velocity_north,velocity_east,velocity_down,\
    truth_latitude,truth_longitude,truth_altitude\nns,deg,deg,m,m/s,m/s,m/s,deg,deg,m\n";

/// A row for each velocity with the last received position: the fixes' own timestamps are lost, as in hand-made tables.
/// A cell of the truth is empty if the truth has no row at that instant.
pub(super) fn wide(flight: &SimulatedFlight) -> Vec<u8> {
    let mut text = WIDE_HEADER.to_owned();
    for (velocity, position) in flight.held_rows() {
        let cells = [flight.position.geodetic_deg[position], flight.velocity.ned[velocity]].map(cells);
        let truth = truth_at(flight, flight.velocity.at_s[velocity]).map_or(",,".to_owned(), cells_of);
        let time_ns = flight.velocity.measured[velocity].0;
        text.push_str(&format!("{time_ns},{},{truth}\n", cells.join(",")));
    }
    text.into_bytes()
}

fn cells(values: [f64; 3]) -> String {
    values.map(|value| value.to_string()).join(",")
}

fn cells_of(values: &[f64; 3]) -> String {
    cells(*values)
}

fn truth_at(flight: &SimulatedFlight, at_s: f64) -> Option<&[f64; 3]> {
    let row = flight.reference.at_s.binary_search_by(|t| t.total_cmp(&at_s)).ok()?;
    flight.reference.geodetic_deg.get(row)
}

/// One table per topic with messages, in the columns of `rostopic echo -p`.
pub(super) fn folder(log: &Logbook, stem: &str) -> Vec<LogFile> {
    let table = |(index, topic): (usize, &super::Topic)| {
        let mut messages = log.messages.iter().filter(|m| m.topic == index).peekable();
        let header = messages.peek()?.csv_header();
        let rows: String = messages.map(Message::csv_row).collect();
        let name = topic.name.trim_start_matches('/').replace('/', "-");
        Some(LogFile { path: format!("{stem}/{name}.csv").into(), bytes: (header + &rows).into_bytes() })
    };
    log.topics.iter().enumerate().filter_map(table).collect()
}
