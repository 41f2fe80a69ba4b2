//! The long lists of a record, moved to a separate file if the record would be longer than 64 kB.
//!
//! They are the lists of topics, channels, pairs and scores. For a log with hundreds of topics or dozens of pairs, they
//! are nearly all of the record. `details.json.gz` holds an object: the JSON pointer (RFC 6901) of each list and the
//! list. In the record the list is empty, and `details` names it.

use serde_json::{Map, Value, json};

/// Bytes of JSON above which a record is shortened.
pub(crate) const MOST: usize = 64_000;

/// The lists that may be moved, in this order.
const PLACES: [&str; 5] =
    ["/log/topics", "/binding/channels", "/delays/pairs", "/network/used_pairs", "/replay/scores/compensators"];

/// Field of the record that names the lists.
const FIELD: &str = "details";

/// Moves lists out of a record until its JSON is short enough, if possible; `None` if it already is, or has no lists.
pub(crate) fn take(record: &mut Value) -> Option<Vec<u8>> {
    let mut lists = Map::new();
    for place in PLACES {
        if record.to_string().len() <= MOST {
            break;
        }
        let Some(Value::Array(list)) = record.pointer_mut(place).filter(|list| **list != json!([])) else { continue };
        lists.insert(place.to_owned(), Value::Array(std::mem::take(list)));
        record[FIELD] = lists.keys().cloned().collect();
    }
    (!lists.is_empty()).then(|| Value::Object(lists).to_string().into_bytes())
}

/// Restores the lists; `None` if they are not those that the record names.
pub(crate) fn put_back(record: &mut Value, details: &[u8]) -> Option<()> {
    let Value::Object(lists) = serde_json::from_slice(details).ok()? else { return None };
    let named = record.as_object_mut()?.remove(FIELD)?;
    if !named.as_array()?.iter().map(Value::as_str).eq(lists.keys().map(|place| Some(place.as_str()))) {
        return None;
    }
    for (place, list) in lists {
        *record.pointer_mut(&place)? = list;
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(topics: usize, pairs: usize) -> Value {
        let list = |n: usize| (0..n).map(|i| json!({ "name": format!("/topic/{i}"), "count": i })).collect::<Vec<_>>();
        json!({ "key": "k", "log": { "topics": list(topics) }, "binding": null, "delays": { "pairs": list(pairs) } })
    }

    #[test]
    fn lists_are_moved_in_order_until_the_record_is_short_and_restored() {
        for (topics, pairs, gone) in
            [(3_000, 9, vec!["/log/topics"]), (3_000, 3_000, vec!["/delays/pairs", "/log/topics"])]
        {
            let whole = record(topics, pairs);
            let mut short = whole.clone();
            let details = take(&mut short).unwrap();
            assert!(short.to_string().len() <= MOST);
            assert_eq!(short["details"], json!(gone));
            assert_eq!((&short["log"]["topics"], &short["key"]), (&json!([]), &whole["key"]));
            put_back(&mut short, &details).unwrap();
            assert_eq!(short, whole);
        }
    }

    #[test]
    fn a_short_record_and_a_long_one_without_such_lists_are_unchanged() {
        let mut without = record(0, 0);
        without["notices"] = "x".repeat(MOST).into();
        for mut whole in [record(10, 10), without] {
            let before = whole.clone();
            assert!(take(&mut whole).is_none() && whole == before);
        }
    }

    #[test]
    fn details_of_another_record_are_rejected() {
        let (mut one, mut other) = (record(3_000, 1), record(3_000, 3_000));
        let of_other = take(&mut other).unwrap();
        assert!(put_back(&mut one.clone(), &of_other).is_none(), "it names none");
        let own = take(&mut one).unwrap();
        assert!(put_back(&mut one.clone(), &of_other).is_none());
        assert!(put_back(&mut one.clone(), &own[..own.len() - 1]).is_none());
        assert!(put_back(&mut one, &own).is_some());
    }
}
