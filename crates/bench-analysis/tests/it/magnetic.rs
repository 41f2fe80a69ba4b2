//! The World Magnetic Model against the official test values of its authors.

use bench_analysis::MagneticModel;
use flight::Geodetic;

const TEST_2020: &str = include_str!("../data/WMM2020_TEST_VALUES.txt");
const TEST_2025: &str = include_str!("../data/WMM2025_TEST_VALUES.txt");

fn rows(text: &str) -> Vec<Vec<f64>> {
    let data = text.lines().filter(|l| !l.starts_with('#') && !l.trim().is_empty());
    data.map(|l| l.split_whitespace().map(|w| w.parse().unwrap()).collect()).collect()
}

/// Place and date of a row, and the field there: X, Y, Z, F nT, inclination, declination deg.
fn found(row: &[f64]) -> [f64; 6] {
    let place = Geodetic::from_degrees(row[2], row[3], row[1] * 1e3);
    let [x, y, z] = MagneticModel::for_year(row[0].floor().max(2020.0)).field(place, row[0]).map(|t| t * 1e9);
    let h = x.hypot(y);
    [x, y, z, h.hypot(z), z.atan2(h).to_degrees(), y.atan2(x).to_degrees()]
}

/// Worst difference of field (nT) and angle (deg).
fn worst(rows: &[Vec<f64>], columns: [usize; 6]) -> (f64, f64) {
    let mut worst = (0.0f64, 0.0f64);
    for row in rows {
        let found = found(row);
        for k in 0..4 {
            worst.0 = worst.0.max((found[k] - row[columns[k]]).abs());
        }
        for k in 4..6 {
            worst.1 = worst.1.max((found[k] - row[columns[k]]).abs());
        }
    }
    worst
}

/// The tables give fields to 0.1 nT and angles to 0.01°.
#[test]
fn every_row_of_the_official_tables_is_matched_to_its_rounding() {
    let new = rows(TEST_2025);
    let old = rows(TEST_2020);
    assert_eq!((old.len(), new.len()), (100, 12));
    let (field, angle) = worst(&new, [4, 5, 6, 8, 9, 10]);
    println!("WMM2025: {field:.4} nT, {angle:.5}°");
    assert!(field < 0.0505 && angle < 0.00505, "WMM2025: {field} nT, {angle}°");
    let (field, angle) = worst(&old, [7, 8, 9, 10, 5, 4]);
    println!("WMM2020: {field:.4} nT, {angle:.5}°");
    assert!(field < 0.0505 && angle < 0.00505, "WMM2020: {field} nT, {angle}°");
}
