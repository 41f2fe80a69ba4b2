//! Fields without a column although every field is wanted: variable-length and long arrays.

use super::rows::Rows;
use super::{json, protobuf};
use crate::reader::LeftOut;
use crate::table::TopicInfo;
use std::collections::BTreeSet;

/// The most fields named in a notice.
const NAMED: usize = 5;

/// What is missing in the rows of a topic; `skipped` are the paths that its decoders skip.
pub(super) fn of<'d>(info: &TopicInfo, skipped: impl Iterator<Item = &'d String>, rows: &Rows) -> Option<LeftOut> {
    let mut names: BTreeSet<String> = skipped.map(|path| of_any_element(path)).collect();
    names.extend(beyond(info, rows));
    let first: Vec<&str> = names.iter().take(NAMED).map(String::as_str).collect();
    let more = if names.len() > NAMED { ", ..." } else { "" };
    (!names.is_empty()).then(|| LeftOut {
        topic: info.name.clone(),
        fields: names.len() as u64,
        names: format!("{}{more}", first.join(", ")),
    })
}

/// The path with `*` for each element of an array: `b[3].data[]` is `b[*].data[]`.
fn of_any_element(path: &str) -> String {
    let mut parts = path.split('[');
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |all, part| match part.split_once(']') {
        Some((index, rest)) if index.parse::<u64>().is_ok() => all + "[*]" + rest,
        _ => all + "[" + part,
    })
}

/// Arrays without a bound in a definition that fill every column available for their elements.
fn beyond(info: &TopicInfo, rows: &Rows) -> Vec<String> {
    let most = match info.encoding.as_str() {
        "json" => json::MOST_ELEMENTS,
        "protobuf" => protobuf::MOST_ELEMENTS,
        _ => return vec![],
    };
    let last = format!("[{}]", most - 1);
    let long = |path: &str| Some(format!("{}[{most}..] if present", path.split_once(&last)?.0));
    rows.paths().filter_map(long).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info(encoding: &str) -> TopicInfo {
        TopicInfo { name: "/t".to_owned(), type_name: "p/A".to_owned(), encoding: encoding.to_owned() }
    }

    #[test]
    fn skipped_paths_are_named_once_for_all_elements() {
        let skipped = ["ranges[]", "b[0].data[]", "b[1].data[]", "long[64..100]"].map(str::to_owned);
        let left_out = of(&info("ros1"), skipped.iter(), &Rows::default()).unwrap();
        assert_eq!((left_out.fields, left_out.names.as_str()), (3, "b[*].data[], long[64..100], ranges[]"));
        assert_eq!(of(&info("ros1"), std::iter::empty(), &Rows::default()), None);
    }

    #[test]
    fn a_json_array_that_fills_all_columns_may_be_longer() {
        let mut rows = Rows::default();
        let numbers = |count: usize| vec!["1"; count].join(",");
        let text = format!(r#"{{"short":[{}],"full":[{}]}}"#, numbers(63), numbers(64));
        json::decode(text.as_bytes(), &crate::decode::Wanted::All, &mut rows).unwrap();
        let left_out = of(&info("json"), std::iter::empty(), &rows).unwrap();
        assert_eq!((left_out.fields, left_out.names.as_str()), (1, "full[64..] if present"));
    }
}
