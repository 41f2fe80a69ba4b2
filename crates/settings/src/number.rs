//! Bounds checks of numbers in settings.

/// The unit in the suffix of a key, as `_s` of `delay.position_s`; empty without such a suffix.
pub(crate) fn unit_of_key(key: &str) -> &'static str {
    match key.rsplit('_').next().filter(|end| end.len() < key.len()) {
        Some("s") => " s",
        Some("ms") => " ms",
        Some("us") => " µs",
        Some("m") => " m",
        Some("mm") => " mm",
        Some("mps") => " m/s",
        Some("hz") => " Hz",
        Some("deg") => " deg",
        Some("nt") => " nT",
        _ => "",
    }
}

/// Minus zero is zero, and must not change the name of a result.
#[must_use]
pub fn plain_zero(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value }
}

/// A number within its bounds; minus zero becomes zero.
///
/// # Errors
/// What is wrong with it, with the unit from the suffix of the key.
pub fn within(key: &str, value: f64, low: f64, high: f64) -> Result<f64, String> {
    let unit = unit_of_key(key);
    bounded(value, low, high, unit).map_err(|what| format!("{key} = {value}{unit}: {what}"))
}

/// A number of seconds that the user typed, within its bounds.
///
/// # Errors
/// What is wrong with it.
pub fn seconds(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| "is not a number of seconds, such as 0.4".to_owned())?;
    bounded(value, low, high, " s")
}

/// Names the value in seconds where milliseconds were probably typed.
fn bounded(value: f64, low: f64, high: f64, unit: &str) -> Result<f64, String> {
    if (low..=high).contains(&value) {
        return Ok(if value == 0.0 { 0.0 } else { value });
    }
    let in_seconds = value / 1000.0;
    let as_milliseconds = if unit == " s" && value >= 1.0 && (low..=high).contains(&in_seconds) {
        format!("; {value} ms are {in_seconds} s")
    } else {
        String::new()
    };
    Err(format!("must be from {low} to {high}{unit}{as_milliseconds}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_out_of_bounds_is_reported_with_its_unit() {
        let error_of = |key, value| within(key, value, 0.0, 30.0).unwrap_err();
        assert_eq!(
            error_of("delay.position_s", 400.0),
            "delay.position_s = 400 s: must be from 0 to 30 s; 400 ms are 0.4 s"
        );
        assert_eq!(error_of("rate_hz", -5.0), "rate_hz = -5 Hz: must be from 0 to 30 Hz");
        assert_eq!(error_of("gain", 31.0), "gain = 31: must be from 0 to 30");
        assert_eq!(error_of("s", f64::NAN), "s = NaN: must be from 0 to 30");
        assert_eq!(seconds("400", -5.0, 30.0), Err("must be from -5 to 30 s; 400 ms are 0.4 s".to_owned()));
        assert_eq!(seconds("0.4", -5.0, 30.0), Ok(0.4));
        assert!(seconds("0,4", -5.0, 30.0).unwrap_err().contains("seconds"));
        assert!(within("x_s", -0.0, 0.0, 1.0).unwrap().is_sign_positive());
    }
}
