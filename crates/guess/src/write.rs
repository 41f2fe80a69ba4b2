//! Writes a guess as a channel map file.

use super::body::Body;
use super::compare::{Motion, Place, UNSHOWN, Vertical};
use super::found::{Found, Guess};
use super::names::quoted;
use flight::Unit;
use std::fmt::{Display, Write};

/// Sources that the default pipeline uses.
const USUAL: [&str; 3] = ["gps", "ins", "ekf"];

/// All that was found.
pub(super) struct GuessedChannels<'l> {
    pub(super) places: Vec<Found<'l, Place>>,
    pub(super) motions: Vec<Found<'l, Motion>>,
    pub(super) bodies: Vec<Found<'l, Body>>,
}

/// Writes the map; if there are several tables, each channel names its own.
pub(super) fn map(
    GuessedChannels { places, motions, bodies }: &GuessedChannels<'_>,
    reasons: &[String],
    several: bool,
) -> Guess {
    let mut text = String::from(HEAD);
    let mut summary = vec![];
    for reason in reasons {
        let _ = writeln!(text, "# Not bound: {}.", one_line(reason));
    }
    let names = names("position", places.iter().map(|p| (p.what.group.source.as_str(), p.what.group.is_geodetic)));
    for (place, name) in places.iter().zip(&names) {
        summary.push(channel(&mut text, name, &of_place(&place.what), &Where::of(place, several)));
    }
    let names = self::names("velocity", motions.iter().map(|m| (m.what.group.source.as_str(), true)));
    for (motion, name) in motions.iter().zip(&names) {
        summary.push(channel(&mut text, name, &of_motion(&motion.what), &Where::of(motion, several)));
    }
    for (body, name) in bodies.iter().zip(body_names(bodies)) {
        summary.push(channel(&mut text, &name, &of_body(&body.what), &Where::of(body, several)));
    }
    summary.extend(times(places, motions));
    summary.extend(left_out(places, motions));
    let both = !places.is_empty() && !motions.is_empty();
    let channels = (places.len() + motions.len() + bodies.len()) as u64;
    Guess { text, summary: summary.join("; "), channels, both }
}

/// The times of all channels in words: once, if they are the same.
fn times(places: &[Found<'_, Place>], motions: &[Found<'_, Motion>]) -> Vec<String> {
    let of_places = places.iter().map(|place| (place.timing.label.as_str(), place.timing.kind));
    let all = of_places.chain(motions.iter().map(|motion| (motion.timing.label.as_str(), motion.timing.kind)));
    let mut lines: Vec<String> = vec![];
    for (time, kind) in all {
        let time = format!("time = {time}, {kind}");
        if !lines.contains(&time) {
            lines.push(time);
        }
    }
    lines
}

/// Vertical columns that are not bound, or whose unit is assumed, with the reason.
fn left_out(places: &[Found<'_, Place>], motions: &[Found<'_, Motion>]) -> Vec<String> {
    let is_out = |third: &Option<(Unit, Vertical)>| matches!(third, Some((_, Vertical::LeftOut)));
    let heights = places.iter().filter(|place| is_out(&place.what.third)).filter_map(|p| p.what.group.third.as_ref());
    let speeds = motions.iter().filter(|motion| is_out(&motion.what.third)).filter_map(|m| m.what.group.third.as_ref());
    let whys = places.iter().map(|place| &place.what.why).chain(motions.iter().map(|motion| &motion.what.why));
    let assumed = whys.flatten().filter(|why| why.ends_with(UNSHOWN)).cloned();
    let heights = heights.map(|column| match column.role {
        super::names::Role::Height => format!("not bound: {}: its unit is unknown", column.path),
        _ => format!("not bound: {}: its unit is unknown, and whether it is positive up or down", column.path),
    });
    let speeds =
        speeds.map(|column| format!("not bound: {}: it may be positive up or down; nothing shows which", column.path));
    heights.chain(speeds).chain(assumed).collect()
}

fn of_body(body: &Body) -> Channel<'_> {
    let columns = body.group.columns.iter().map(|column| column.path.as_str());
    let fields = body.roles.into_iter().zip(columns).map(|(role, column)| (role, column, body.unit)).collect();
    Channel { quantity: body.quantity, frame: Some(body.frame), fields, why: &body.why }
}

/// A name for each attitude, rate and force: after its source, or `attitude.ins` and `angular-rate.imu` without one.
fn body_names(bodies: &[Found<'_, Body>]) -> Vec<String> {
    let mut names: Vec<String> = vec![];
    for Body { group, quantity, .. } in bodies.iter().map(|body| &body.what) {
        let source = match group.source.as_str() {
            "" if *quantity == "attitude" => "ins",
            "" => "imu",
            other => other,
        };
        let numbered = |count: usize| if count == 1 { String::new() } else { format!("-{count}") };
        let mut all = (1..).map(|count| format!("{quantity}.{source}{}", numbered(count)));
        names.extend(all.find(|name| !names.contains(name)));
    }
    names
}

const HEAD: &str = "# Columns bound by guess: by names, by units, and by the agreement of position, velocity,
# attitude, rates and forces.
# Check every line. `--maps DIR` uses all maps in a folder.
schema = 1
name = \"guess\"
title = \"Columns bound by guess\"
";

/// The text of a guessed map under another name.
pub fn renamed(text: &str, name: &str) -> String {
    text.replacen("name = \"guess\"", &format!("name = {}", quoted(name)), 1)
}

/// The location of a channel.
struct Where<'f> {
    topic: Option<&'f str>,
    kind: &'f str,
    entry: &'f str,
    why: &'f str,
}

impl<'f> Where<'f> {
    fn of<T>(found: &'f Found<'_, T>, several: bool) -> Where<'f> {
        let timing = &found.timing;
        let topic = several.then_some(found.topic);
        Where { topic, kind: timing.kind, entry: &timing.entry, why: &timing.why }
    }
}

/// Role, column and unit.
type Field<'a> = (&'static str, &'a str, Unit);

/// The content of a channel, and the evidence.
struct Channel<'f> {
    quantity: &'f str,
    frame: Option<&'f str>,
    fields: Vec<Field<'f>>,
    why: &'f [String],
}

fn vertical<'a>(third: Option<(Unit, Vertical)>, column: Option<&'a str>, is_height: bool) -> Option<Field<'a>> {
    let ((unit, side), column) = third.zip(column)?;
    match side {
        Vertical::LeftOut => None,
        _ if is_height => Some(("height", column, unit)),
        Vertical::Up => Some(("up", column, unit)),
        Vertical::Down => Some(("down", column, unit)),
    }
}

fn of_place(place: &Place) -> Channel<'_> {
    let group = &place.group;
    let third = vertical(place.third, group.third.as_ref().map(|c| c.path.as_str()), group.is_geodetic);
    let roles = match (group.is_geodetic, place.is_west) {
        (true, _) => ["latitude", "longitude"],
        (false, false) => ["north", "east"],
        (false, true) => ["north", "west"],
    };
    let (first, second) = if place.swapped { (&group.second, &group.first) } else { (&group.first, &group.second) };
    let pair = [(roles[0], first.path.as_str(), place.unit), (roles[1], second.path.as_str(), place.unit)];
    let quantity = if group.is_geodetic { "position-geodetic" } else { "position-ned" };
    Channel { quantity, frame: None, fields: pair.into_iter().chain(third).collect(), why: &place.why }
}

fn of_motion(motion: &Motion) -> Channel<'_> {
    let group = &motion.group;
    let third = vertical(motion.third, group.third.as_ref().map(|c| c.path.as_str()), false);
    let (first, second) = if motion.swapped { (&group.second, &group.first) } else { (&group.first, &group.second) };
    let (first, second) = (first.path.as_str(), second.path.as_str());
    let pair = match motion.angle {
        Some(angle) => [("speed", first, motion.unit), ("track", second, angle)],
        None => [("north", first, motion.unit), (if motion.is_west { "west" } else { "east" }, second, motion.unit)],
    };
    let fields = pair.into_iter().chain(third).collect();
    Channel { quantity: "velocity-ned", frame: None, fields, why: &motion.why }
}

/// A name for each channel: after its source, or `gps` without one; the first one has a name that pipelines use.
fn names<'s>(what: &str, sources: impl Iterator<Item = (&'s str, bool)>) -> Vec<String> {
    let sources: Vec<(&str, bool)> = sources.collect();
    // Receivers count from 0 or from 1: the first is `gps`, the second `gps-2`.
    let first: u64 = if sources.iter().any(|(source, _)| *source == "0") { 0 } else { 1 };
    let plain = |source: &str, is_geodetic: bool| match source {
        "" if is_geodetic => "gps".to_owned(),
        "" => "local".to_owned(),
        "gnss" => "gps".to_owned(),
        "ref" | "reference" | "gt" | "groundtruth" | "ground-truth" => "truth".to_owned(),
        other => match other.parse::<u64>() {
            Ok(number) if number <= first => "gps".to_owned(),
            Ok(number) => format!("gps-{}", number - first + 1),
            Err(_) => other.to_owned(),
        },
    };
    let says_gps = sources.iter().any(|(source, _)| matches!(*source, "gps" | "gnss"));
    let name = |(source, is_geodetic): &(&str, bool)| match *source {
        // Next to columns named after the GPS, plain ones belong to something else.
        "" if says_gps => "plain".to_owned(),
        source => plain(source, *is_geodetic),
    };
    let mut names: Vec<String> = sources.iter().map(name).collect();
    let is_usual = |name: &String| USUAL.contains(&name.as_str());
    if !names.iter().any(is_usual)
        && let Some(first) = names.iter_mut().find(|name| *name != "truth")
    {
        *first = "gps".to_owned();
    }
    let mut free: Vec<String> = vec![];
    for name in names {
        let mut count = 1;
        let mut own = format!("{what}.{name}");
        while free.contains(&own) {
            count += 1;
            own = format!("{what}.{name}-{count}");
        }
        free.push(own);
    }
    free
}

/// Writes a channel and returns its one-line summary.
fn channel(text: &mut String, name: &str, channel: &Channel<'_>, at: &Where<'_>) -> String {
    let Channel { quantity, frame, fields, why } = channel;
    let _ = writeln!(text);
    for why in *why {
        let _ = writeln!(text, "# {}.", one_line(why));
    }
    let _ = writeln!(text, "[[channel]]\nname = {}\nquantity = \"{quantity}\"", quoted(name));
    if let Some(topic) = at.topic {
        let _ = writeln!(text, "topic = [{}]", quoted(topic));
    }
    if let Some(frame) = frame {
        let _ = writeln!(text, "frame = \"{frame}\"");
    }
    let _ = writeln!(text, "timeline = \"{}\"", at.kind);
    let _ = writeln!(
        text,
        "# The time: {}.\n[channel.time]\n{} = [{}]\n\n[channel.fields]",
        one_line(at.why),
        at.kind,
        at.entry
    );
    for (role, column, unit) in fields {
        let _ = writeln!(text, "{role} = {{ field = {}, unit = \"{unit}\" }}", quoted(column));
    }
    let columns: Vec<String> =
        fields.iter().map(|(role, column, unit)| format!("{role} = {}", with_unit(column, unit))).collect();
    format!("{name}: {}", columns.join(", "))
}

/// A column with its unit, unless its name ends with it.
pub(crate) fn with_unit(column: &str, unit: impl Display) -> String {
    let ends = [format!("[{unit}]"), format!("({unit})")].iter().any(|end| column.ends_with(end.as_str()));
    if ends { column.to_owned() } else { format!("{column} [{unit}]") }
}

/// Column names may contain anything.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_named_after_their_sources_and_one_has_a_name_that_pipelines_use() {
        type Sources = &'static [(&'static str, bool)];
        let cases: [(Sources, &[&str]); 13] = [
            (&[("", true), ("", false)], &["p.gps", "p.local"]),
            (&[("", false)], &["p.gps"]),
            (&[("gnss", true), ("", true)], &["p.gps", "p.plain"]),
            (&[("0", true), ("1", true)], &["p.gps", "p.gps-2"]),
            (&[("0", true), ("1", true), ("2", true)], &["p.gps", "p.gps-2", "p.gps-3"]),
            (&[("1", true), ("2", true)], &["p.gps", "p.gps-2"]),
            (&[("2", true), ("3", true)], &["p.gps", "p.gps-3"]),
            (&[("camera", true), ("lidar", true)], &["p.gps", "p.lidar"]),
            (&[("camera", true), ("ins", true)], &["p.camera", "p.ins"]),
            (&[("ekf", true), ("ekf", true)], &["p.ekf", "p.ekf-2"]),
            // The truth is the last to be taken for the channel whose delay is asked for.
            (&[("gt", true), ("camera", true)], &["p.truth", "p.gps"]),
            (&[("ref", true), ("ground-truth", true)], &["p.truth", "p.truth-2"]),
            (&[], &[]),
        ];
        for (sources, expected) in cases {
            assert_eq!(names("p", sources.iter().copied()), expected, "{sources:?}");
        }
    }
}
