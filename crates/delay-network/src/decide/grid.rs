//! Grids that keep the removed delay stable as flights are added.

/// Steps per second of the grids, coarse to fine: 1 s to 0.1 ms.
const STEPS_PER_SECOND: [f64; 5] = [1.0, 10.0, 100.0, 1e3, 1e4];

/// Value on the largest power-of-ten grid whose step is at most a quarter of the uncertainty, and at least 0.1 ms.
pub(crate) fn on_grid(value_s: f64, standard_uncertainty_s: f64) -> f64 {
    let per_second = STEPS_PER_SECOND
        .into_iter()
        .find(|per_second| 1.0 <= 0.25 * standard_uncertainty_s * per_second)
        .unwrap_or(STEPS_PER_SECOND[STEPS_PER_SECOND.len() - 1]);
    let rounded = (value_s * per_second).round() / per_second;
    // not −0
    rounded + 0.0
}

/// Uncertainty rounded up to two significant digits.
pub(crate) fn rounded_up(standard_uncertainty_s: f64) -> f64 {
    let u = standard_uncertainty_s;
    if !(u > 0.0 && u.is_finite()) {
        return u;
    }
    let per_second = 10.0_f64.powf(1.0 - u.log10().floor());
    (u * per_second - 1e-9).ceil() / per_second
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_step_is_well_below_the_uncertainty() {
        assert_eq!(on_grid(0.201_546, 0.007_858), 0.202);
        assert_eq!(on_grid(0.201_546, 0.003_9), 0.201_5);
        assert_eq!(on_grid(0.201_546, 0.000_001), 0.201_5);
        assert_eq!(on_grid(0.201_546, 0.061), 0.2);
        assert_eq!(on_grid(-0.000_04, 0.0), 0.0);
        assert!(on_grid(-0.000_04, 0.0).is_sign_positive());
        for i in 1..200 {
            let u = 0.000_5 * f64::from(i);
            assert!((on_grid(0.123_456_7, u) - 0.123_456_7).abs() <= 0.125 * u.max(0.000_8) + 1e-12);
        }
    }

    #[test]
    fn an_uncertainty_is_rounded_up_to_two_digits() {
        assert!((rounded_up(0.007_858) - 0.007_9).abs() < 1e-12);
        assert!((rounded_up(0.007_9) - 0.007_9).abs() < 1e-12);
        assert!((rounded_up(0.0123) - 0.013).abs() < 1e-12);
        assert_eq!(rounded_up(0.0), 0.0);
    }
}
