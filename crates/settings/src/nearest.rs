//! The nearest known name to a mistyped one.

/// The name with the smallest edit distance: letters inserted, deleted or replaced. Case and separators are ignored. A
/// name that contains the other one is close. The first wins a tie.
#[must_use]
pub fn nearest<'n>(wanted: &str, names: impl IntoIterator<Item = &'n str>) -> Option<&'n str> {
    let wanted = plain(wanted);
    names.into_iter().min_by_key(|name| difference(&wanted, &plain(name)))
}

/// The few nearest names, nearest first.
#[must_use]
pub fn nearest_few<'n>(wanted: &str, names: impl IntoIterator<Item = &'n str>, most: usize) -> Vec<&'n str> {
    let wanted = plain(wanted);
    let mut names: Vec<&str> = names.into_iter().collect();
    names.sort_by_key(|name| difference(&wanted, &plain(name)));
    names.truncate(most);
    names
}

/// The nearest name if it is near enough to suggest: at most half of the letters differ, or one name contains the
/// other.
#[must_use]
pub fn likely<'n>(wanted: &str, names: impl IntoIterator<Item = &'n str>) -> Option<&'n str> {
    let letters = plain(wanted);
    nearest(wanted, names).filter(|name| difference(&letters, &plain(name)) <= letters.len())
}

fn plain(name: &str) -> Vec<char> {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// Twice the edit distance, or once if one name contains the other.
fn difference(a: &[char], b: &[char]) -> usize {
    let (short, long) = if a.len() < b.len() { (a, b) } else { (b, a) };
    let holds = short.len() > 1 && long.windows(short.len()).any(|part| part == short);
    if holds { long.len() - short.len() } else { 2 * edits(a, b) }
}

/// The Levenshtein distance.
fn edits(a: &[char], b: &[char]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = i;
        let mut left = i + 1;
        for (y, above) in b.iter().zip(row.iter_mut().skip(1)) {
            let here = (diagonal + usize::from(x != y)).min(left + 1).min(*above + 1);
            diagonal = *above;
            *above = here;
            left = here;
        }
        row.iter_mut().take(1).for_each(|first| *first = i + 1);
    }
    row.last().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_the_one_with_the_fewest_changes() {
        let chars = |text: &str| text.chars().collect::<Vec<_>>();
        assert_eq!(edits(&chars("kitten"), &chars("sitting")), 3);
        assert_eq!(edits(&chars(""), &chars("abc")), 3);
        assert_eq!(nearest("velN", ["velE", "vel_n", "lat"]), Some("vel_n"));
        assert_eq!(nearest("vnorth", ["veast_mps", "vnorth_mps", "north"]), Some("north"));
        assert_eq!(nearest("x", []), None);
        assert_eq!(
            nearest_few("velocity.efk", ["position.gps", "velocity.gps", "velocity.ekf"], 2),
            ["velocity.ekf", "velocity.gps"]
        );
    }

    #[test]
    fn a_name_with_nothing_in_common_is_not_suggested() {
        assert_eq!(likely("positon_s", ["source", "position_s"]), Some("position_s"));
        assert_eq!(likely("position", ["source", "position_s"]), Some("position_s"));
        assert_eq!(likely("colour", ["length_m", "width_m"]), None);
    }
}
