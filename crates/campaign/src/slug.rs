//! Folder names for flights: unique, and safe on every file system.

use std::collections::{BTreeMap, BTreeSet};

/// Longest name, bytes; leaves room for a suffix below the limit of 255.
const LONGEST: usize = 100;

/// Names that some systems reserve for devices.
const RESERVED: [&str; 6] = ["con", "prn", "aux", "nul", "com1", "lpt1"];

/// A folder name for every flight id. If the names of two ids would be equal, or differ only in
/// case, both get part of the id's hash as suffix.
pub(crate) fn slugs<'a>(ids: impl IntoIterator<Item = &'a str>) -> BTreeMap<String, String> {
    let ids: BTreeSet<&str> = ids.into_iter().collect();
    let mut uses: BTreeMap<String, usize> = BTreeMap::new();
    for id in &ids {
        *uses.entry(plain(id).to_lowercase()).or_default() += 1;
    }
    let unique =
        |name: &str| uses.get(&name.to_lowercase()) == Some(&1) && !RESERVED.contains(&name.to_lowercase().as_str());
    let slug = |id: &str| {
        let name = plain(id);
        if unique(&name) { name } else { suffixed(&name, id) }
    };
    ids.iter().map(|&id| (id.to_owned(), slug(id))).collect()
}

/// Letters, digits, `.`, `-`, `_`; everything else becomes `-`. No dot or dash at either end.
fn plain(id: &str) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || "._-".contains(c) { c } else { '-' };
    let name: String = id.chars().map(safe).take(LONGEST).collect();
    let name = name.trim_matches(['.', '-']);
    if name.is_empty() { "flight".to_owned() } else { name.to_owned() }
}

fn suffixed(name: &str, id: &str) -> String {
    // Sixteen digits: a plain name does not end in the hash of another id by chance.
    let hash = blake3::hash(id.as_bytes()).to_hex();
    format!("{name}-{}", hash.get(..16).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_id_gets_a_unique_name_that_stays_in_its_folder() {
        let long = "x".repeat(300);
        let other_long = format!("{long}y");
        let ids = [
            "swing-07.mcap",
            "SWING-07.mcap",
            "..",
            ".",
            "/",
            "a/b",
            "a-b",
            "a b",
            "-rf",
            "con",
            "x\0y",
            "é",
            "ü",
            "",
            "../../etc",
            "a\nb",
            "flight",
            long.as_str(),
            other_long.as_str(),
        ];
        let names = slugs(ids);
        assert_eq!(names.len(), ids.len());
        let folded: BTreeSet<String> = names.values().map(|s| s.to_lowercase()).collect();
        assert_eq!(folded.len(), ids.len(), "{names:?}");
        for name in names.values() {
            assert!(name.len() <= 120 && !name.starts_with(['.', '-']), "{name}");
            assert!(name.bytes().all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b)), "{name}");
        }
    }

    #[test]
    fn a_plain_name_is_unchanged() {
        assert_eq!(slugs(["day1/swing-07.mcap"])["day1/swing-07.mcap"], "day1-swing-07.mcap");
    }
}
