//! Packed ground track for a table row: a page has up to two thousand of them.

use super::pieces;

/// Width and height in steps.
const SIZE: (usize, usize) = (LETTERS.len() - 1, 33);
/// The letter of each step: none needs escaping in an attribute. `table.js` uses the same letters.
const LETTERS: &[u8; 88] = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_`{|}~";

/// A sketch (`east,north east,north;…`, m) as two letters per point: steps from the left and from the top. North is up,
/// scales are equal, and a space starts a new stroke. `None` if there is nothing to draw.
pub(crate) fn packed_sketch(sketch: &str) -> Option<String> {
    let point = |text: &str| {
        let (east, north) = text.split_once(',')?;
        Some((east.parse::<f64>().ok()?, north.parse::<f64>().ok()?))
    };
    let all = sketch.split(';').flat_map(|piece| {
        let (east, north): (Vec<f64>, Vec<f64>) = piece.split(' ').filter_map(point).unzip();
        pieces(&east, &north, &[]).0
    });
    let all: Vec<Vec<(f64, f64)>> = all.collect();
    let range = |of: fn(&(f64, f64)) -> f64| {
        let values = || all.iter().flatten().map(of);
        Some((values().reduce(f64::min)?, values().reduce(f64::max)?))
    };
    let (east, north) = (range(|p| p.0)?, range(|p| p.1)?);
    let (width, height) = (SIZE.0 as f64, SIZE.1 as f64);
    let scale = (width / (east.1 - east.0)).min(height / (north.1 - north.0));
    if !scale.is_finite() {
        return None;
    }
    let place = |&(e, n): &(f64, f64)| {
        let x = width / 2.0 + scale * (e - (east.0 + east.1) / 2.0);
        let y = height / 2.0 - scale * (n - (north.0 + north.1) / 2.0);
        [x, y].map(|step| char::from(LETTERS[(step.round() as usize).min(SIZE.0)]))
    };
    let packed = |piece: &Vec<(f64, f64)>| {
        let mut letters: Vec<[char; 2]> = piece.iter().map(place).collect();
        letters.dedup();
        letters.into_iter().flatten().collect::<String>()
    };
    Some(all.iter().map(packed).collect::<Vec<_>>().join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(packed: &str) -> Vec<Vec<(usize, usize)>> {
        let step = |letter: u8| LETTERS.iter().position(|l| *l == letter).unwrap();
        let pairs = |piece: &str| piece.as_bytes().chunks(2).map(|pair| (step(pair[0]), step(pair[1]))).collect();
        packed.split(' ').map(pairs).collect()
    }

    #[test]
    fn north_is_up_scales_are_equal_and_a_gap_starts_a_new_stroke() {
        // 100 m east and 50 m north: limited by the height. 50 m are 33 steps; 100 m are 66 steps, centred at 43.5.
        let found = steps(&packed_sketch("0,0 100,0 100,50;0,50 0,40").unwrap());
        assert_eq!(found, [vec![(11, 33), (77, 33), (77, 0)], vec![(11, 0), (11, 7)]]);
    }

    #[test]
    fn letters_are_distinct_and_need_no_escaping() {
        let different: std::collections::BTreeSet<&u8> = LETTERS.iter().collect();
        assert_eq!(different.len(), LETTERS.len());
        assert!(!LETTERS.iter().any(|letter| b" \"'&<>\\".contains(letter)));
        assert!(
            crate::page::TABLE_SCRIPT.contains(std::str::from_utf8(LETTERS).unwrap()),
            "table.js has other letters"
        );
    }

    #[test]
    fn nothing_is_drawn_for_a_single_point_or_an_invalid_sketch() {
        for text in ["", "3,4", "x", "1,2 1,2", "nan,1 2,inf"] {
            assert_eq!(packed_sketch(text), None, "{text}");
        }
    }
}
