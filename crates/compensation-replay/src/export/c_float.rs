//! Numbers in C notation.

/// The numeric type of an exported compensator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CFloat {
    /// 24 bits, for a controller without double hardware.
    Float,
    /// 53 bits: bit-identical to the replay.
    Double,
}

impl CFloat {
    /// Its name in C.
    #[must_use]
    pub fn c_name(self) -> &'static str {
        match self {
            CFloat::Float => "float",
            CFloat::Double => "double",
        }
    }

    /// A finite number as an exact C99 hexadecimal literal; rounded to 24 bits for `float`.
    pub(crate) fn literal(self, x: f64) -> String {
        match self {
            CFloat::Float => format!("{}f", hexadecimal(f64::from(x as f32))),
            CFloat::Double => hexadecimal(x),
        }
    }
}

/// `-0x1.8p+1` for −3.
fn hexadecimal(x: f64) -> String {
    let bits = x.to_bits();
    let sign = if x.is_sign_negative() { "-" } else { "" };
    let (exponent, fraction) = ((bits >> 52) & 0x7ff, bits & ((1 << 52) - 1));
    let digits = format!("{fraction:013x}");
    let digits = digits.trim_end_matches('0');
    let point = if digits.is_empty() { "" } else { "." };
    match exponent {
        0 if fraction == 0 => format!("{sign}0x0p+0"),
        0 => format!("{sign}0x0{point}{digits}p-1022"),
        _ => format!("{sign}0x1{point}{digits}p{:+}", exponent as i64 - 1023),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As printed by `printf("%a")` of glibc.
    #[test]
    fn literals_match_printf() {
        for (x, expected) in [
            (1.0, "0x1p+0"),
            (-3.0, "-0x1.8p+1"),
            (0.1, "0x1.999999999999ap-4"),
            (0.0, "0x0p+0"),
            (std::f64::consts::PI, "0x1.921fb54442d18p+1"),
            (f64::from_bits(1), "0x0.0000000000001p-1022"),
            (f64::MAX, "0x1.fffffffffffffp+1023"),
        ] {
            assert_eq!(hexadecimal(x), expected);
        }
        assert_eq!(CFloat::Float.literal(0.1), "0x1.99999ap-4f");
    }
}
