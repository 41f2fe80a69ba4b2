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

/// Decimals that show the second significant digit of an expanded uncertainty U, at most six.
#[must_use]
pub fn decimals_of(expanded: f64) -> usize {
    let text = format!("{expanded:.1e}");
    let exponent: i32 = text.rsplit_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(-2);
    usize::try_from(1 - exponent).unwrap_or(0).min(6)
}

/// A value and its expanded uncertainty with the same decimals, as `6.984 ± 0.020`.
#[must_use]
pub fn with_expanded(value: f64, expanded: f64) -> String {
    let decimals = decimals_of(expanded);
    format!("{} ± {}", fixed(value, decimals), fixed(expanded, decimals))
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

    #[test]
    fn a_value_has_the_decimals_of_its_uncertainty() {
        let texts = [(-117.0, 2.91), (59.51, 435.6), (1.94, 0.581), (0.4, 0.0996)].map(|(v, u)| with_expanded(v, u));
        assert_eq!(texts, ["\u{2212}117.0 ± 2.9", "60 ± 436", "1.94 ± 0.58", "0.40 ± 0.10"]);
    }
}
