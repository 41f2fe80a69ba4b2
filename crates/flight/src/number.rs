//! Numbers in sentences.

/// A number with this many decimals. The minus sign is U+2212, and zero is never negative.
#[must_use]
pub fn fixed(value: f64, decimals: usize) -> String {
    with_minus(&format!("{value:.decimals$}"))
}

/// A number as text, with the minus sign U+2212; negative zero becomes zero.
#[must_use]
pub fn with_minus(number: &str) -> String {
    match number.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| matches!(b, b'0' | b'.')) => rest.to_owned(),
        Some(rest) => format!("\u{2212}{rest}"),
        None => number.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_minus_sign_is_u2212_and_zero_has_none() {
        let texts =
            [(-66.6, 0), (-0.004, 2), (-0.006, 2), (12.34, 1), (f64::NEG_INFINITY, 0)].map(|(v, d)| fixed(v, d));
        assert_eq!(texts, ["\u{2212}67", "0.00", "\u{2212}0.01", "12.3", "\u{2212}inf"]);
    }
}
