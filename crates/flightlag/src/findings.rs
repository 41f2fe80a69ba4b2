//! What went wrong with a log, and what to do about it: the same text in all commands that read one.

use crate::show::{Table, visible};
use flight::{Code, LogHealth, Notice, Notices};
use std::path::Path;

/// The damaged ranges.
pub(crate) fn damage(health: &LogHealth) -> String {
    let mut table = Table::new(&["file", "first byte|", "bytes|", "after s|", "why"]);
    for range in &health.damage {
        let after = range.after_s().map_or("-".to_owned(), |s| format!("{s:.3}"));
        let (first, bytes) = (range.offset.to_string(), range.length.to_string());
        table.row(vec![range.file.clone(), first, bytes, after, range.reason.clone()]);
    }
    let unlisted = health.damage_count.saturating_sub(health.damage.len() as u64);
    let more = if unlisted > 0 { format!("  and {unlisted} more ranges\n") } else { String::new() };
    section("damage", &table) + &more
}

/// Notices except those about damage, losses first.
pub(crate) fn notices(notices: &Notices) -> String {
    let mut sorted: Vec<&Notice> = notices.iter().filter(|n| n.code != Code::Damaged).collect();
    sorted.sort_by_key(|n| std::cmp::Reverse(n.severity));
    let mut table = Table::new(&["notice", "where", "count|", "what"]);
    for notice in sorted {
        table.row(vec![
            notice.severity.word().to_owned(),
            notice.place.clone(),
            notice.count.to_string(),
            notice.text.clone(),
        ]);
    }
    section("notices", &table)
}

/// A titled table; empty if it has no rows.
pub(crate) fn section(title: &str, table: &Table) -> String {
    if table.is_empty() { String::new() } else { format!("{title}\n{}", table.text()) }
}

/// A path quoted for a shell.
pub(crate) fn typed(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+=:@,".contains(c);
    if text.chars().all(plain) && !text.starts_with('-') {
        return text;
    }
    visible(&format!("'{}'", text.replace('\'', r"'\''")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shown_path_can_be_pasted_into_a_shell() {
        assert_eq!(typed(Path::new("logs/a-1.ulg")), "logs/a-1.ulg");
        assert_eq!(typed(Path::new("my log's.bag")), r"'my log'\''s.bag'");
    }

    #[test]
    fn losses_come_first_and_damage_is_not_repeated() {
        let mut all = Notices::new();
        all.push(Code::HeldRows, "gps", 3, "held rows");
        all.push(Code::Damaged, "a, bytes 0 to 9", 9, "cut");
        all.push(Code::IncompleteRecording, "a", 1, "no footer");
        let text = notices(&all);
        assert!(text.find("no footer") < text.find("held rows") && !text.contains("cut"), "{text}");
    }
}
