//! Style of the pages, and their content security policy: they load nothing.

use flate2::Compression;
use flate2::write::DeflateEncoder;
use sha2::{Digest, Sha256};
use std::io::Write;
use std::sync::LazyLock;

/// The style sheet. In both modes and on paper, text has a contrast of at least 4.5, lines of figures of at least 3.
pub(crate) const CSS: &str = include_str!("style.css");

/// Sorts, filters and saves the table of flights. Without the script it is a plain table.
pub(crate) const TABLE_SCRIPT: &str = include_str!("table.js");

/// Saves every other table as CSV.
pub(super) const CSV_SCRIPT: &str = include_str!("csv.js");

/// Decompresses data of the page and the packed script in the page.
pub(super) const UNPACK_SCRIPT: &str = include_str!("unpack.js");

/// Lets a reader zoom into the rows of a flight: uPlot (`uplot/LICENSE`), then our own code. Fallback: the figures.
pub(super) const EXPLORER_SCRIPT: &str = concat!(
    include_str!("uplot/uPlot.iife.min.js"),
    "\n",
    include_str!("fingers.js"),
    "\n",
    include_str!("explorer.js")
);

/// Lets a reader shift the reference of a bench record by hand: uPlot, then our own code. Fallback: the figures.
pub(super) const BENCH_SCRIPT: &str =
    concat!(include_str!("uplot/uPlot.iife.min.js"), "\n", include_str!("fingers.js"), "\n", include_str!("bench.js"));

/// The style sheet of uPlot.
pub(super) const EXPLORER_CSS: &str = include_str!("uplot/uPlot.min.css");

/// [`EXPLORER_SCRIPT`] packed for [`UNPACK_SCRIPT`], at half the size.
pub(super) static PACKED_EXPLORER: LazyLock<String> = LazyLock::new(|| packed(EXPLORER_SCRIPT));

/// [`BENCH_SCRIPT`] packed for [`UNPACK_SCRIPT`].
pub(super) static PACKED_BENCH: LazyLock<String> = LazyLock::new(|| packed(BENCH_SCRIPT));

/// Raw deflate (RFC 1951) in base64.
fn packed(text: &str) -> String {
    let mut encoder = DeflateEncoder::new(vec![], Compression::best());
    // Writing to memory cannot fail.
    let _ = encoder.write_all(text.as_bytes());
    base64(&encoder.finish().unwrap_or_default())
}

/// What the page may load: its own styles, inline images, and its own scripts by hash.
pub(super) fn content_security_policy(scripts: &[&str]) -> String {
    let mut policy =
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'".to_owned();
    let hash = |script: &&str| format!(" 'sha256-{}'", base64(&Sha256::digest(script.as_bytes())));
    if !scripts.is_empty() {
        policy += "; script-src";
        policy.extend(scripts.iter().map(hash));
    }
    policy
}

/// The title at the top of each printed page. Special characters are escaped (CSS Syntax 3, section 4.3.7).
pub(super) fn running_title(title: &str) -> String {
    let mut quoted = String::new();
    for c in crate::text::sentence(title).chars() {
        match c {
            c if c.is_ascii_alphanumeric() || matches!(c, ' ' | '.' | '-' | '_' | '/') => quoted.push(c),
            c => quoted += &format!("\\{:x} ", u32::from(c)),
        }
    }
    format!("@page{{@top-left{{content:\"{quoted}\";font:8pt system-ui,sans-serif;color:#333}}}}")
}

/// Base64 with padding (RFC 4648, section 4).
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let bits = (0..3).fold(0u32, |bits, i| bits << 8 | u32::from(chunk.get(i).copied().unwrap_or(0)));
        for i in 0..4 {
            let letter = char::from(ALPHABET[(bits >> (18 - 6 * i) & 63) as usize]);
            out.push(if i <= chunk.len() { letter } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_matches_the_test_vectors_of_rfc_4648() {
        let vectors = [
            "", "", "f", "Zg==", "fo", "Zm8=", "foo", "Zm9v", "foob", "Zm9vYg==", "fooba", "Zm9vYmE=", "foobar",
            "Zm9vYmFy",
        ];
        for pair in vectors.chunks(2) {
            assert_eq!(base64(pair[0].as_bytes()), pair[1]);
        }
    }

    #[test]
    fn a_title_is_escaped_inside_its_css_string() {
        let css = running_title("a\"}</style>\n\\ é");
        let inside = css.split('"').nth(1).unwrap();
        assert!(inside.starts_with("a\\22 \\7d \\3c /style\\3e ") && inside.ends_with("\\e9 "), "{css}");
        assert_eq!(css.matches('"').count(), 2);
        assert!(!css.contains('<'));
    }

    #[test]
    fn a_script_is_allowed_only_by_its_hash() {
        // SHA-256 of "abc" (FIPS 180-2) in base64.
        let policy = content_security_policy(&["", "abc"]);
        assert!(policy.contains("'sha256-ungWv48Bz+pBQUDeXa4iI7ADYaOWF3qctBD/YfIAFa0='"), "{policy}");
        assert!(!content_security_policy(&[]).contains("script-src"));
    }

    /// `--name:#rgb` pairs in one block of the style sheet.
    fn colours(block: &str) -> std::collections::BTreeMap<&str, [f64; 3]> {
        let colour = |text: &str| {
            let digits = text.strip_prefix('#')?;
            let wide =
                if digits.len() == 3 { digits.chars().flat_map(|c| [c, c]).collect() } else { digits.to_owned() };
            let channel = |i: usize| u8::from_str_radix(wide.get(i..i + 2)?, 16).ok();
            Some([channel(0)?, channel(2)?, channel(4)?].map(|c| f64::from(c) / 255.0))
        };
        block
            .split(['{', '}', ';'])
            .filter_map(|d| d.trim().strip_prefix("--")?.split_once(':'))
            .filter_map(|(name, value)| Some((name, colour(value)?)))
            .collect()
    }

    /// WCAG 2.2 contrast ratio.
    fn contrast(a: [f64; 3], b: [f64; 3]) -> f64 {
        let linear = |c: f64| if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
        let luminance = |c: [f64; 3]| 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn every_text_colour_has_enough_contrast_in_both_modes() {
        assert!((contrast([1.0; 3], [0.0; 3]) - 21.0).abs() < 1e-9);
        let (light, rest) = CSS.split_once("@media screen and (prefers-color-scheme:dark)").unwrap();
        for block in [light, rest.split_once("}}").unwrap().0] {
            let c = colours(block);
            for (text, ground) in [
                ("ink", "paper"),
                ("ink", "band"),
                ("ink", "bar"),
                ("ink", "bad-bg"),
                ("ink", "unsure-bg"),
                ("soft", "paper"),
                ("soft", "band"),
                ("link", "paper"),
                ("link", "band"),
                ("ok", "ok-bg"),
                ("ok", "paper"),
                ("ok", "band"),
                ("unsure", "unsure-bg"),
                ("unsure", "paper"),
                ("unsure", "band"),
                ("bad", "bad-bg"),
                ("bad", "paper"),
                ("bad", "band"),
            ] {
                let ratio = contrast(c[text], c[ground]);
                assert!(ratio >= 4.5, "{text} on {ground}: {ratio:.2}");
            }
            for (line, colour) in
                c.iter().filter(|(name, _)| name.starts_with("line-") || name.starts_with("lead-") || **name == "axis")
            {
                let ratio = contrast(*colour, c["paper"]);
                assert!(ratio >= 3.0, "{line}: {ratio:.2}");
            }
        }
    }
}
