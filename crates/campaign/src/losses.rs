//! Which losses of a log affect its results.
//!
//! A loss is red and gives exit code 3, unless it is minor: then it is amber, counted and named, and the exit code is
//! 0. A loss is minor under two conditions. Less than a thousandth of the log is lost. And the loss is in topics that
//! no channel is bound from, or the analysis bridges every hole in bound channels.

use flight::{Alarm, Binding, ByteLedger, ChannelHealth, Code, LogHealth, Notice, Notices, Severity};
use record::DelayAlarm;
use std::collections::BTreeSet;

/// A step between timestamps longer than this many usual steps is a hole: one row is missing.
const HOLE: f64 = 1.5;
/// A hole up to this length is bridged in every compared channel and changes no result, s.
const BRIDGED_S: f64 = 0.5;

/// Turns the losses of a log into warnings, if all of them are minor, and gives the reason.
pub(crate) fn weigh(notices: &mut Notices, health: &LogHealth, binding: &Binding) {
    let losses = || notices.iter().filter(|notice| notice.severity == Severity::Loss);
    if losses().next().is_none() || !is_small(health) {
        return;
    }
    let elsewhere: BTreeSet<&str> = losses().filter_map(|loss| unused_topic(loss, health, binding)).collect();
    let harmless = |loss: &Notice| {
        unused_topic(loss, health, binding).is_some() || loss.code == Code::Damaged && is_without_hole(binding)
    };
    if !losses().all(harmless) {
        return;
    }
    let why = match elsewhere.into_iter().collect::<Vec<_>>()[..] {
        [] => format!("no channel that is used has a hole of more than {BRIDGED_S} s"),
        [topic] => format!("no result uses {topic}"),
        [topic, ..] => format!("no result uses {topic} or the other damaged topics"),
    };
    let count = losses().count() as u64;
    notices.lower_losses();
    let text = format!("less than 0.1 % of the log could not be read, and no result is affected: {why}");
    notices.push(Code::MinorLoss, "", count, text);
}

/// Whether less than a thousandth of the bytes and of the messages is lost.
fn is_small(health: &LogHealth) -> bool {
    let small = |part: u64, whole: u64| part == 0 || (part as f64) < ByteLedger::LARGEST_TAIL * whole as f64;
    small(health.bytes.damaged, health.bytes.size) && small(health.undecodable, health.messages)
}

/// The topic of a loss, if the notice names one and no channel is bound from it. A text table is a topic with the name
/// of its file.
fn unused_topic<'n>(loss: &'n Notice, health: &LogHealth, binding: &Binding) -> Option<&'n str> {
    let place = &loss.place;
    let file = || place.split(", ").next().map(|file| file.strip_suffix(".csv").unwrap_or(file));
    let topic = place.strip_prefix("topic ").or_else(file)?;
    let is_topic = health.topics.iter().any(|known| known.name == topic);
    let is_used = binding.channels.iter().any(|channel| channel.source.topic == topic);
    (is_topic && !is_used).then_some(topic)
}

/// The alarm of a log with more than minor losses.
pub(crate) fn alarm(notices: &Notices, health: &LogHealth) -> Option<DelayAlarm> {
    damage(notices, health).map(|text| DelayAlarm::of(Alarm::LogDamaged, text))
}

/// How much of a log was lost and where, if the loss is not minor.
pub(crate) fn damage(notices: &Notices, health: &LogHealth) -> Option<String> {
    let losses = || notices.iter().filter(|notice| notice.severity == Severity::Loss);
    let first = losses().next()?;
    let bytes = (health.bytes.damaged > 0).then(|| {
        let range = health.damage.first();
        let at =
            range.map_or(String::new(), |r| format!(", the first in {} at byte {}: {}", r.file, r.offset, r.reason));
        format!("{} of {} bytes could not be read{at}", health.bytes.damaged, health.bytes.size)
    });
    let other = losses().find(|loss| loss.code != Code::Damaged).or(Some(first).filter(|_| bytes.is_none()));
    let other = other.map(|loss| match loss.place.is_empty() {
        true => loss.text.clone(),
        false => format!("{}: {}", loss.place, loss.text),
    });
    Some(bytes.into_iter().chain(other).collect::<Vec<_>>().join("; "))
}

fn is_without_hole(binding: &Binding) -> bool {
    let whole = |channel: &ChannelHealth| {
        let steps = channel.stamps.as_ref().and_then(|stamps| stamps.steps_s);
        steps.is_some_and(|steps| steps.max <= BRIDGED_S.max(HOLE * steps.median))
    };
    binding.channels.iter().all(whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const WHOLE: u64 = 1_000_000;

    /// Notices after weighing the losses of a log with the topics `gps`, bound to a channel, and `camera`.
    fn weighed(losses: &[(Code, &str)], damaged: u64, longest_step_s: f64) -> Notices {
        let topic = |name: &str| {
            json!({ "name": name, "type_name": "", "encoding": "csv", "messages": 100, "payload_bytes": 0, "stamps": [],
                    "decoded": true, "reason": "" })
        };
        let health = LogHealth {
            bytes: ByteLedger { size: WHOLE, damaged, ..ByteLedger::default() },
            messages: 10_000,
            topics: vec![
                serde_json::from_value(topic("gps")).unwrap(),
                serde_json::from_value(topic("camera")).unwrap(),
            ],
            ..LogHealth::default()
        };
        let steps = json!({ "min": 0.2, "p01": 0.2, "median": 0.2, "p99": 0.2, "max": longest_step_s });
        let channel = json!({
            "name": "position.gps", "quantity": "position-geodetic", "absent": [], "rows": 100, "used": 100, "rejected": [],
            "source": { "topic": "gps", "type_name": "", "fields": [] },
            "offsets": [], "held": null,
            "stamps": { "kind": "logged", "clock": "boot", "source": "t", "first_ns": 0, "last_ns": 1, "count": 100, "rate_hz": 5.0,
                        "steps_s": steps, "gap_count": 0, "gaps": [], "duplicates": 0, "back_jumps": 0 }
        });
        let binding = json!({ "map": "m", "why": "", "others": [], "channels": [channel] });
        let mut notices = Notices::new();
        losses.iter().for_each(|(code, place)| notices.push(code.at(Severity::Loss), *place, 1, "lost"));
        weigh(&mut notices, &health, &serde_json::from_value(binding).unwrap());
        notices
    }

    fn is_minor(losses: &[(Code, &str)], damaged: u64, longest_step_s: f64) -> bool {
        let notices = weighed(losses, damaged, longest_step_s);
        let says_so = notices.iter().any(|notice| notice.code == Code::MinorLoss);
        assert_eq!(says_so, !notices.any_loss(), "{notices:?}");
        assert_eq!(notices.len(), losses.len() + usize::from(says_so), "nothing is dropped in silence");
        says_so
    }

    #[test]
    fn a_few_lost_bytes_are_minor_if_no_bound_channel_has_a_hole() {
        let bytes = [(Code::Damaged, "a.bin, bytes 10 to 20")];
        assert!(is_minor(&bytes, 999, 0.5), "two rows are missing, which every comparison bridges");
        assert!(!is_minor(&bytes, 999, 0.51), "more rows are missing");
        assert!(!is_minor(&bytes, 1000, 0.2), "a thousandth of the log");
    }

    #[test]
    fn a_loss_in_an_unused_topic_is_minor_and_named() {
        let (camera, gps) = ((Code::Undecodable, "topic camera"), (Code::Undecodable, "topic gps"));
        assert!(is_minor(&[camera], 0, 9.0));
        assert!(is_minor(
            &[(Code::RejectedCell, "camera.csv, line 4"), (Code::Damaged, "camera.csv, bytes 0 to 9")],
            9,
            9.0
        ));
        assert!(!is_minor(&[gps], 0, 0.2) && !is_minor(&[camera, gps], 0, 0.2));
        assert!(!is_minor(&[camera], WHOLE / 2, 0.2), "half of the log");
        assert!(!is_minor(&[(Code::IndexDiffers, "a.bag")], 0, 0.2), "of which topic they were is not known");
        let weighed = weighed(&[camera], 0, 0.2);
        assert!(weighed.iter().any(|n| n.code == "minor-loss" && n.severity == Severity::Warning), "{weighed:?}");
        let texts: Vec<String> = weighed.iter().map(|n| n.text.clone()).collect();
        assert!(texts.iter().any(|text| text.ends_with("no result is affected: no result uses camera")), "{texts:?}");
    }

    #[test]
    fn a_major_loss_is_a_red_alarm_with_its_place() {
        let mut notices = Notices::new();
        assert_eq!(alarm(&notices, &LogHealth::default()), None);
        notices.push(Code::Undecodable, "topic gps", 3, "messages that cannot be decoded");
        let found = alarm(&notices, &LogHealth::default()).unwrap();
        assert_eq!((found.gravity, found.code.as_str()), (record::Gravity::Red, "log-damaged"));
        assert_eq!(found.text, "topic gps: messages that cannot be decoded");
    }
}
