//! Names that match a pattern with `*`.

/// Whether a name matches one of the patterns.
pub(crate) fn any_matches(patterns: &[String], name: &str) -> bool {
    patterns.iter().any(|p| matches(p, name))
}

/// Whether a name matches a pattern in which every `*` matches any text.
#[must_use]
pub fn matches(pattern: &str, name: &str) -> bool {
    let Some((first, rest)) = pattern.split_once('*') else { return pattern == name };
    let Some(mut name) = name.strip_prefix(first) else { return false };
    let mut parts: Vec<&str> = rest.split('*').collect();
    let last = parts.pop().unwrap_or_default();
    for part in parts {
        match name.find(part) {
            Some(at) => name = name.get(at + part.len()..).unwrap_or_default(),
            None => return false,
        }
    }
    name.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn only_a_star_matches_any_text() {
        for (pattern, name, fits) in [
            ("a", "a", true),
            ("a", "ab", false),
            ("*", "", true),
            ("2026-*/x*.mcap", "2026-05/x-1.mcap", true),
            ("2026-*/x*.mcap", "2026-05/y.mcap", false),
            ("ab*ba", "aba", false),
            ("*a*a", "a", false),
            ("é*é", "éaé", true),
        ] {
            assert_eq!(matches(pattern, name), fits, "{pattern} {name}");
        }
    }

    #[test]
    fn a_star_matches_any_text() {
        for (pattern, name, fits) in [
            ("a*.pos", "a.pos", true),
            ("a*.pos", "a_1.pos", true),
            ("a*.pos", "b.pos", false),
            ("*", "", true),
            ("*é*", "caffé.csv", true),
            ("a*b*c", "a-bb-c", true),
            ("a*b*c", "a-c", false),
        ] {
            assert_eq!(matches(pattern, name), fits, "{pattern} {name}");
        }
    }
}
