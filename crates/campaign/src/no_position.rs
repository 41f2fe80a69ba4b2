//! The message about a log without a position.

use compensation_replay::some_of;
use flight::{Binding, ChannelHealth, Code, Flight};

/// Maximum number of channels named.
const NAMED: usize = 12;

/// Why there is no position to measure: a receiver without a fix, or no receiver; and what the log has instead.
pub(crate) fn no_position(flight: &Flight, binding: &Binding, wanted: &[String]) -> String {
    let empty = |c: &&ChannelHealth| wanted.contains(&c.name) && c.used == 0;
    let held = held(flight);
    match binding.channels.iter().find(empty) {
        Some(channel) => {
            let reasons: Vec<String> = channel.rejected.iter().map(|r| format!("{} ({})", r.reason, r.count)).collect();
            format!(
                "no position: {} is bound to {} ({}), but none of its {} rows is a usable fix: {}. {held}",
                channel.name,
                channel.source.topic,
                channel.source.fields.join(", "),
                channel.rows,
                reasons.join(", "),
            )
        }
        None if never_fixed(flight).is_some() => {
            let (fix, rows) = never_fixed(flight).unwrap_or_default();
            format!(
                "no position: the receiver never had a fix. {fix} is 0 in all {rows} rows, so no row has a latitude \
                 and a longitude. {held}"
            )
        }
        None if ambiguous(flight, wanted).is_some() => {
            format!("no position: {}. {held}", ambiguous(flight, wanted).unwrap_or_default())
        }
        None => {
            format!(
                "no position channel: the pipeline asks for {}, but the log has none of them. {held}",
                some_of(wanted)
            )
        }
    }
}

/// The notice about topics that fit a position equally well.
fn ambiguous<'a>(flight: &'a Flight, wanted: &[String]) -> Option<&'a str> {
    let is_of = |text: &str| wanted.iter().any(|name| text.starts_with(&format!("channel {name} is not bound")));
    let notice = flight.notices.iter().find(|n| n.code == Code::SeveralSources && is_of(&n.text))?;
    Some(&notice.text)
}

/// A channel with the fix quality that is 0 throughout, and its number of rows.
fn never_fixed(flight: &Flight) -> Option<(&str, usize)> {
    let (name, channel) = flight.channels.iter().find(|(name, _)| name.starts_with("fix."))?;
    let values = channel.series.components().first()?;
    (!values.is_empty() && values.iter().all(|value| *value == 0.0)).then_some((name.as_str(), values.len()))
}

fn held(flight: &Flight) -> String {
    let names: Vec<&str> = flight.channels.keys().take(NAMED).map(String::as_str).collect();
    match flight.channels.len().saturating_sub(names.len()) {
        0 if names.is_empty() => "There is no other channel".to_owned(),
        0 => format!("The channels are: {}", names.join(", ")),
        more => format!("The channels are: {} and {more} more", names.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn binding(channels: serde_json::Value) -> Binding {
        serde_json::from_value(serde_json::json!({ "map": "m", "why": "", "others": [], "channels": channels }))
            .unwrap()
    }

    #[test]
    fn a_receiver_without_a_fix_is_distinguished_from_no_receiver() {
        let gps = serde_json::json!([{
            "name": "position.gps", "quantity": "position-geodetic", "absent": [], "rows": 310, "used": 0,
            "source": { "topic": "GPS", "type_name": "", "fields": ["Lat", "Lng"] },
            "rejected": [{ "reason": "Status is below 3", "count": 310, "first": "row 0" }],
            "stamps": null, "offsets": [], "held": null,
        }]);
        let wanted = ["position.gps".to_owned(), "position.gnss".to_owned()];
        let words = |channels| no_position(&Flight::default(), &binding(channels), &wanted);
        assert_eq!(
            words(gps),
            "no position: position.gps is bound to GPS (Lat, Lng), but none of its 310 rows is a usable fix: Status is \
             below 3 (310). There is no other channel"
        );
        assert_eq!(
            words(serde_json::json!([])),
            "no position channel: the pipeline asks for position.gps, position.gnss, but the log has none of them. There is no other channel"
        );
    }

    #[test]
    fn a_receiver_whose_fix_is_0_throughout_is_reported() {
        let channel = |values: Vec<f64>| {
            let stamps = (0..values.len() as i64).map(flight::Stamp).collect();
            let timeline = flight::Timeline::new(flight::StampKind::Measured, flight::Clock::Elapsed, stamps).unwrap();
            let series = flight::Series::new(timeline, vec![values]).unwrap();
            flight::Channel {
                quantity: flight::Quantity::Scalar,
                present: vec![true],
                other_stamps: vec![],
                held: vec![false; series.timeline().stamps().len()],
                source: flight::ChannelSource { topic: "GGA".into(), type_name: String::new(), fields: vec![] },
                series,
            }
        };
        let words = |values| {
            let mut flight = Flight::default();
            flight.channels.insert("fix.gps".to_owned(), channel(values));
            no_position(&flight, &binding(serde_json::json!([])), &["position.gps".to_owned()])
        };
        let none = words(vec![0.0; 3]);
        assert!(none.starts_with("no position: the receiver never had a fix. fix.gps is 0 in all 3 rows"), "{none}");
        assert!(words(vec![0.0, 1.0]).starts_with("no position channel"));
    }
}
