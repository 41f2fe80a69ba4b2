//! Numbers that loggers write in place of a missing value.

/// Whether a number is nothing but nines, at least three, such as -9999 and 999999.
pub fn is_all_nines(value: f64) -> bool {
    const MOST: f64 = 1e12;
    let size = value.abs();
    if !(999.0..MOST).contains(&size) || size.fract() != 0.0 {
        return false;
    }
    let mut digits = size as u64;
    while digits % 10 == 9 {
        digits /= 10;
    }
    digits == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_numbers_of_three_nines_or_more_stand_for_a_missing_value() {
        assert!([999.0, -999.0, -9999.0, 99999.0, 999_999.0].into_iter().all(is_all_nines));
        assert!(![0.0, 9.0, 99.0, 998.0, 9990.0, 9989.0, 999.9, 1e3, f64::NAN, 1e300].into_iter().any(is_all_nines));
    }
}
