//! Files for maps: `GeoJSON`, KML, GPX.

use super::{Instant, LINES, Place, Track};
use jiff::Timestamp;
use serde_json::{Value, json};
use std::io::{self, Write};

/// Colours of raw and compensated: `RRGGBB`, as on the pages.
pub(super) const COLOURS: [&str; 2] = ["4d5761", "0072b2"];

/// RFC 7946: longitude first, heights in metres. Times are in `coordTimes`, as in toGeoJSON.
pub(super) fn geojson(track: &Track, out: &mut impl Write) -> io::Result<()> {
    let line = |n: usize| {
        let pieces: Vec<Vec<(&Instant, Place)>> = track.pieces(n).filter(|piece| piece.len() > 1).collect();
        let coordinates: Vec<Vec<Value>> = pieces
            .iter()
            .map(|piece| {
                let place =
                    |(_, p): &(&Instant, Place)| json!([degrees(p.longitude_deg), degrees(p.latitude_deg), p.height_m]);
                piece.iter().map(place).collect()
            })
            .collect();
        let times: Vec<Vec<Option<String>>> =
            pieces.iter().map(|piece| piece.iter().map(|(i, _)| utc(i)).collect()).collect();
        let (name, _, what) = LINES[n];
        json!({
            "type": "Feature",
            "properties": {
                "name": format!("{}, {name}", track.name), "description": what, "stroke": format!("#{}", COLOURS[n]),
                "coordTimes": times, "flightlag": serde_json::from_str::<Value>(&track.about).unwrap_or_default(),
            },
            "geometry": { "type": "MultiLineString", "coordinates": coordinates },
        })
    };
    let features: Vec<Value> = (0..LINES.len()).map(line).collect();
    serde_json::to_writer(&mut *out, &json!({ "type": "FeatureCollection", "features": features }))?;
    out.write_all(b"\n")
}

/// Rounded to 0.1 mm, so that no digit is conversion noise.
fn degrees(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

/// KML 2.2 with `gx:Track` where UTC is known, otherwise plain lines. Lines are clamped to the ground: a logged height
/// may be above the ellipsoid or above mean sea level, and Google Earth would assume the latter.
pub(super) fn kml(track: &Track, out: &mut impl Write) -> io::Result<()> {
    writeln!(
        out,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\" \
         xmlns:gx=\"http://www.google.com/kml/ext/2.2\">\n<Document>\n<name>{}</name>\n<description>{}</description>",
        escaped(&track.name),
        escaped(&track.about)
    )?;
    // Styles come before the elements that use them.
    for ((name, ..), rgb) in LINES.iter().zip(COLOURS) {
        // KML colours are in the order alpha, blue, green, red.
        let colour = format!("ff{}{}{}", &rgb[4..6], &rgb[2..4], &rgb[0..2]);
        writeln!(out, "<Style id=\"{name}\"><LineStyle><color>{colour}</color><width>2</width></LineStyle></Style>")?;
    }
    let is_dated = track.instants.iter().all(|i| i.utc_ns.is_some());
    for (n, (name, _, what)) in LINES.iter().enumerate() {
        writeln!(
            out,
            "<Placemark>\n<name>{name}</name>\n<description>{what}</description>\n<styleUrl>#{name}</styleUrl>"
        )?;
        match is_dated {
            true => kml_track(track, n, out)?,
            false => kml_lines(track, n, out)?,
        }
        writeln!(out, "</Placemark>")?;
    }
    writeln!(out, "</Document>\n</kml>")
}

fn kml_track(track: &Track, line: usize, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "<gx:MultiTrack>")?;
    for piece in track.pieces(line) {
        writeln!(out, "<gx:Track>")?;
        for (instant, _) in &piece {
            writeln!(out, "<when>{}</when>", utc(instant).unwrap_or_default())?;
        }
        for (_, p) in &piece {
            writeln!(out, "<gx:coord>{:.9} {:.9} {:.3}</gx:coord>", p.longitude_deg, p.latitude_deg, p.height_m)?;
        }
        writeln!(out, "</gx:Track>")?;
    }
    writeln!(out, "</gx:MultiTrack>")
}

fn kml_lines(track: &Track, line: usize, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "<MultiGeometry>")?;
    for piece in track.pieces(line).filter(|piece| piece.len() > 1) {
        write!(out, "<LineString><tessellate>1</tessellate><coordinates>")?;
        for (_, p) in &piece {
            write!(out, "{:.9},{:.9},{:.3} ", p.longitude_deg, p.latitude_deg, p.height_m)?;
        }
        writeln!(out, "</coordinates></LineString>")?;
    }
    writeln!(out, "</MultiGeometry>")
}

/// GPX 1.1.
pub(super) fn gpx(track: &Track, out: &mut impl Write) -> io::Result<()> {
    writeln!(
        out,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<gpx version=\"1.1\" creator=\"flightlag\" \
         xmlns=\"http://www.topografix.com/GPX/1/1\">\n<metadata><name>{}</name><desc>{}</desc></metadata>",
        escaped(&track.name),
        escaped(&track.about)
    )?;
    for (n, (name, _, what)) in LINES.iter().enumerate() {
        writeln!(out, "<trk>\n<name>{name}</name>\n<desc>{what}</desc>")?;
        for piece in track.pieces(n) {
            writeln!(out, "<trkseg>")?;
            for (instant, p) in piece {
                let time = utc(instant).map(|t| format!("<time>{t}</time>")).unwrap_or_default();
                let (latitude, longitude) = (p.latitude_deg, p.longitude_deg);
                writeln!(
                    out,
                    "<trkpt lat=\"{latitude:.9}\" lon=\"{longitude:.9}\"><ele>{:.3}</ele>{time}</trkpt>",
                    p.height_m
                )?;
            }
            writeln!(out, "</trkseg>")?;
        }
        writeln!(out, "</trk>")?;
    }
    writeln!(out, "</gpx>")
}

/// UTC to the millisecond (ISO 8601).
fn utc(instant: &Instant) -> Option<String> {
    let milliseconds = (instant.utc_ns? + 500_000).div_euclid(1_000_000);
    Timestamp::from_millisecond(milliseconds).ok().map(|t| format!("{t:.3}"))
}

/// Text of an XML element: characters not allowed in XML 1.0 are removed.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() && !matches!(c, '\t' | '\n') => {}
            '\u{fffe}' | '\u{ffff}' => {}
            c => out.push(c),
        }
    }
    out
}
