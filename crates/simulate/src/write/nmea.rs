//! NMEA 0183 as written by a receiver: a position is a `GGA`, a velocity an `RMC` without a position.
//!
//! Resolution: 1e-5 minutes, 1 mm (half of it in the undulation, which is a whole number), 1e-4 knots and degrees of
//! track, whole milliseconds. There is no vertical speed, and no truth.

use crate::simulated::SimulatedFlight;
use flight::Stamp;
use std::fmt::Write;

/// Height of the geoid above the ellipsoid, m.
const UNDULATION: f64 = 47.0;
const DAY_MS: i64 = 86_400_000;

/// The flight as lines of text.
pub(super) fn write(flight: &SimulatedFlight) -> Vec<u8> {
    let mut lines: Vec<(Stamp, String)> = vec![];
    let position = &flight.position;
    for ((measured, logged), [latitude, longitude, height]) in
        position.measured.iter().zip(&position.logged).zip(&position.geodetic_deg)
    {
        let place = format!("{},{}", angle(*latitude, 2, ["N", "S"]), angle(*longitude, 3, ["E", "W"]));
        let above_sea = height - UNDULATION;
        let body = format!("GNGGA,{},{place},1,14,0.72,{above_sea:.3},M,{UNDULATION:.1},M,,", time(*measured).1);
        lines.push((*logged, body));
    }
    let velocity = &flight.velocity;
    for ((measured, logged), [north, east, _]) in velocity.measured.iter().zip(&velocity.logged).zip(&velocity.ned) {
        let (date, time) = time(*measured);
        let knots = north.hypot(*east) * 3600.0 / 1852.0;
        let track = east.atan2(*north).to_degrees().rem_euclid(360.0);
        lines.push((*logged, format!("GNRMC,{time},A,,,,,{knots:.4},{track:.4},{date},,,A")));
    }
    lines.sort_by_key(|(logged, _)| *logged);
    let mut text = sentence("GNTXT,01,01,02,simulated receiver");
    let (date, clock) = time(flight.settings.start);
    let date = format!("{},{},20{}", &date[..2], &date[2..4], &date[4..]);
    text.push_str(&sentence(&format!("GNZDA,{clock},{date},00,00")));
    for (_, body) in lines {
        text.push_str(&sentence(&body));
    }
    text.into_bytes()
}

/// The sentence with its checksum.
fn sentence(body: &str) -> String {
    format!("${body}*{:02X}\r\n", body.bytes().fold(0, |sum, byte| sum ^ byte))
}

/// `ddmm.mmmmm` and the hemisphere.
fn angle(degrees: f64, digits: usize, [positive, negative]: [&str; 2]) -> String {
    let parts = (degrees.abs() * 60e5).round() as u64;
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write!(text, "{:0digits$}{:02}.{:05}", parts / 6_000_000, parts / 100_000 % 60, parts % 100_000);
    text + "," + if degrees < 0.0 { negative } else { positive }
}

/// `ddmmyy` and `hhmmss.sss` of UTC.
fn time(stamp: Stamp) -> (String, String) {
    let ms = (stamp.0 + 500_000).div_euclid(1_000_000);
    let (days, ms) = (ms.div_euclid(DAY_MS), ms.rem_euclid(DAY_MS));
    let (year, month, day) = civil(days);
    let (seconds, thousandths) = (ms / 1000, ms % 1000);
    let clock = format!("{:02}{:02}{:02}.{thousandths:03}", seconds / 3600, seconds / 60 % 60, seconds % 60);
    (format!("{day:02}{month:02}{:02}", year.rem_euclid(100)), clock)
}

/// Year, month and day from days since 1970, by cycles of 400 years that start in March.
fn civil(days: i64) -> (i64, i64, i64) {
    let since = days + 719_468;
    let (era, day) = (since.div_euclid(146_097), since.rem_euclid(146_097));
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let date = day - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    (year + era * 400 + i64::from(month <= 2), month, date)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_converted_to_dates() {
        // date -u -d @$((days * 86400)) +%F
        for (days, date) in
            [(0, (1970, 1, 1)), (11_016, (2000, 2, 29)), (20_778, (2026, 11, 21)), (20_819, (2027, 1, 1))]
        {
            assert_eq!(civil(days), date);
        }
    }

    #[test]
    fn an_angle_is_degrees_and_minutes() {
        assert_eq!(angle(48.1173, 2, ["N", "S"]), "4807.03800,N");
        assert_eq!(angle(-0.999_999_999, 3, ["E", "W"]), "00100.00000,W");
    }

    #[test]
    fn a_sentence_has_its_checksum() {
        let body = "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,";
        assert!(sentence(body).ends_with("*47\r\n"));
    }
}
