//! The World Magnetic Model: the field of the Earth's core at a place and a date.
//!
//! Coefficient files are NOAA/NCEI's and BGS's, public domain, one for each epoch of five years.

use flight::Geodetic;

const DEGREE: usize = 12;
/// Reference radius of the model, m.
const REFERENCE_RADIUS_M: f64 = 6_371_200.0;
/// Validity of a model, years.
const VALID_YEARS: f64 = 5.0;

/// Name, epoch (decimal year) and coefficients of the models compiled in, oldest first.
const MODELS: [(&str, f64, &str); 4] = [
    ("WMM2010", 2010.0, include_str!("data/WMM_2010.COF")),
    ("WMM2015v2", 2015.0, include_str!("data/WMM_2015v2.COF")),
    ("WMM2020", 2020.0, include_str!("data/WMM_2020.COF")),
    ("WMM2025", 2025.0, include_str!("data/WMM_2025.COF")),
];

/// The World Magnetic Model of one epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct MagneticModel {
    name: &'static str,
    epoch: f64,
    /// Schmidt semi-normalised g, h, nT, and their change, nT/year, by degree and order.
    terms: Vec<Term>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Term {
    degree: usize,
    order: usize,
    g: f64,
    h: f64,
    g_rate: f64,
    h_rate: f64,
}

/// A field, and whether its model is valid for that date.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelField {
    /// North, east, down, T.
    pub ned_t: [f64; 3],
    /// Name of the model.
    pub model: &'static str,
    /// First and last decimal year of the model.
    pub valid_years: [f64; 2],
    /// Whether the date is within them; if not, the nearest model was extrapolated.
    pub is_valid: bool,
}

impl MagneticModel {
    /// The model for `decimal_year`, or the one with the nearest years as fallback.
    #[must_use]
    pub fn for_year(decimal_year: f64) -> MagneticModel {
        let newest_started = MODELS.iter().rev().find(|(_, epoch, _)| *epoch <= decimal_year).unwrap_or(&MODELS[0]);
        let &(name, epoch, coefficients) = newest_started;
        MagneticModel { name, epoch, terms: coefficients.lines().filter_map(term).collect() }
    }

    /// Its name, such as `WMM2020`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// First and last decimal year of its validity.
    #[must_use]
    pub fn valid_years(&self) -> [f64; 2] {
        [self.epoch, self.epoch + VALID_YEARS]
    }

    /// North, east, down at `place` and `decimal_year`, T (the WMM2020 report, equations 4 to 19). At a pole, north is
    /// that of the given longitude.
    #[must_use]
    pub fn field(&self, place: Geodetic, decimal_year: f64) -> [f64; 3] {
        let ecef = place.to_ecef();
        let radius = (ecef.x * ecef.x + ecef.y * ecef.y + ecef.z * ecef.z).sqrt();
        let geocentric = (ecef.z / radius).asin();
        let legendre = Legendre::at(geocentric);
        let years = decimal_year - self.epoch;
        let (mut north, mut east, mut down) = (0.0, 0.0, 0.0);
        for term in &self.terms {
            let (n, m) = (term.degree, term.order);
            let (sin_m, cos_m) = (m as f64 * place.longitude).sin_cos();
            let (g, h) = (term.g + years * term.g_rate, term.h + years * term.h_rate);
            let nearness = (REFERENCE_RADIUS_M / radius).powi(n as i32 + 2);
            north -= nearness * (g * cos_m + h * sin_m) * legendre.slope[n][m];
            east += nearness * m as f64 * (g * sin_m - h * cos_m) * legendre.over_cosine[n][m];
            down -= nearness * (n + 1) as f64 * (g * cos_m + h * sin_m) * legendre.value[n][m];
        }
        let (sin_d, cos_d) = (geocentric - place.latitude).sin_cos();
        [north * cos_d - down * sin_d, east, north * sin_d + down * cos_d].map(|nt| nt * 1e-9)
    }
}

/// The field at `place` (height above the ellipsoid) and `decimal_year`, from the model that fits best.
#[must_use]
pub fn model_field(place: Geodetic, decimal_year: f64) -> ModelField {
    let model = MagneticModel::for_year(decimal_year);
    let valid_years = model.valid_years();
    ModelField {
        ned_t: model.field(place, decimal_year),
        model: model.name,
        valid_years,
        is_valid: (valid_years[0]..=valid_years[1]).contains(&decimal_year),
    }
}

/// Year and fraction of a civil day, `2010-10-25` being 2010.8137.
#[must_use]
pub fn decimal_year(day: jiff::civil::Date) -> f64 {
    let days = if day.in_leap_year() { 366.0 } else { 365.0 };
    f64::from(day.year()) + f64::from(day.day_of_year() - 1) / days
}

/// A line `n m g h g' h'`; `None` for the header and the end marks.
fn term(line: &str) -> Option<Term> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [degree, order, g, h, g_rate, h_rate] = words[..] else { return None };
    let degree = degree.parse().ok().filter(|n| *n <= DEGREE)?;
    Some(Term {
        degree,
        order: order.parse().ok().filter(|m| *m <= degree)?,
        g: g.parse().ok()?,
        h: h.parse().ok()?,
        g_rate: g_rate.parse().ok()?,
        h_rate: h_rate.parse().ok()?,
    })
}

type Table = [[f64; DEGREE + 1]; DEGREE + 1];

/// Schmidt semi-normalised associated Legendre functions of sin(latitude), with what the gradient needs.
struct Legendre {
    value: Table,
    /// Derivative by latitude.
    slope: Table,
    /// Divided by the cosine of the latitude, computed without division: finite at the poles. Zero for order 0.
    over_cosine: Table,
}

impl Legendre {
    fn at(latitude: f64) -> Legendre {
        let (s, c) = latitude.sin_cos();
        let mut p = Legendre {
            value: [[0.0; DEGREE + 1]; DEGREE + 1],
            slope: [[0.0; DEGREE + 1]; DEGREE + 1],
            over_cosine: [[0.0; DEGREE + 1]; DEGREE + 1],
        };
        p.value[0][0] = 1.0;
        for n in 1..=DEGREE {
            p.diagonal(n, s, c);
            for m in 0..n {
                p.below_diagonal(n, m, s, c);
            }
        }
        p
    }

    fn diagonal(&mut self, n: usize, s: f64, c: f64) {
        let k = if n == 1 { 1.0 } else { ((2 * n - 1) as f64 / (2 * n) as f64).sqrt() };
        self.value[n][n] = k * c * self.value[n - 1][n - 1];
        self.slope[n][n] = k * (c * self.slope[n - 1][n - 1] - s * self.value[n - 1][n - 1]);
        self.over_cosine[n][n] = k * self.value[n - 1][n - 1];
    }

    fn below_diagonal(&mut self, n: usize, m: usize, s: f64, c: f64) {
        let square = ((n * n - m * m) as f64).sqrt();
        let near = (2 * n - 1) as f64 / square;
        let far = if n - 1 > m { (((n - 1) * (n - 1) - m * m) as f64).sqrt() / square } else { 0.0 };
        let two_below = |table: &Table| if n >= 2 { far * table[n - 2][m] } else { 0.0 };
        self.slope[n][m] = near * (s * self.slope[n - 1][m] + c * self.value[n - 1][m]) - two_below(&self.slope);
        self.value[n][m] = near * s * self.value[n - 1][m] - two_below(&self.value);
        self.over_cosine[n][m] = near * s * self.over_cosine[n - 1][m] - two_below(&self.over_cosine);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_has_all_its_coefficients_and_its_own_epoch() {
        for (name, epoch, text) in MODELS {
            let model = MagneticModel::for_year(epoch + 1.0);
            assert_eq!(model.name(), name);
            assert_eq!(model.terms.len(), 90, "degree 12 has 90 terms");
            let written: f64 = text.split_whitespace().next().unwrap().parse().unwrap();
            assert_eq!(written, epoch);
        }
    }

    #[test]
    fn outside_all_models_the_nearest_is_extrapolated_and_marked() {
        let place = Geodetic::from_degrees(37.6, 126.86, 20.0);
        for (year, name, valid) in [
            (1999.0, "WMM2010", false),
            (2010.8, "WMM2010", true),
            (2029.9, "WMM2025", true),
            (2031.0, "WMM2025", false),
        ] {
            let field = model_field(place, year);
            assert_eq!((field.model, field.is_valid), (name, valid));
        }
    }

    #[test]
    fn the_field_is_finite_and_continuous_at_the_poles() {
        let model = MagneticModel::for_year(2025.0);
        for latitude in [-90.0, 90.0] {
            let at = model.field(Geodetic::from_degrees(latitude, 30.0, 0.0), 2025.0);
            let near = model.field(Geodetic::from_degrees(latitude * (1.0 - 1e-9), 30.0, 0.0), 2025.0);
            for k in 0..3 {
                assert!((at[k] - near[k]).abs() < 1e-12, "{at:?} {near:?}");
            }
        }
    }

    #[test]
    fn a_day_is_a_fraction_of_its_year() {
        assert_eq!(decimal_year(jiff::civil::date(2025, 1, 1)), 2025.0);
        assert!((decimal_year(jiff::civil::date(2024, 12, 31)) - (2024.0 + 365.0 / 366.0)).abs() < 1e-12);
    }
}
