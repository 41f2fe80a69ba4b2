//! The points of figures, stored separately from their record.
//!
//! Most of a record would be lists of numbers that only figures need. They are moved out of its JSON, which keeps empty
//! lists in their place, into a compact file. Times are rounded to 0.1 ms, lengths to 1 mm, delays to 1 µs: no figure
//! shows more.
//!
//! The file starts with [`MAGIC`]. A raw deflate stream (RFC 1951) follows. Inflated, it holds the lists in sequence.
//! Each has the length of its JSON pointer, the pointer, the number of values, the order of differencing, and the
//! values as zigzag-coded differences. All numbers are variable-length: seven bits per byte, lowest first, and the
//! eighth bit is set if more bytes follow.

use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use serde_json::Value;
use std::io::{Read, Write};

const MAGIC: &[u8; 8] = b"flpts\x02\r\n";

/// Steps per unit of a list: times are rounded to 0.1 ms, lengths to 1 mm, delays to 1 µs.
fn steps_of_one(pointer: &str) -> i64 {
    if pointer.ends_with("/t_s") { 10_000 } else { 1_000 }
}

/// Shorter lists stay in the record.
const LEAST: usize = 16;

/// Maximum inflated size of a file of points.
const MOST_BYTES: u64 = 1 << 30;

/// The parts of a record that hold points.
const PLACES: [&str; 6] = ["/replay/axes", "/replay/zoom", "/replay/lead", "/trial/axes", "/trial/zoom", "/trial/lead"];

/// Moves the points out of a record; `None` if it has none.
pub(crate) fn take(record: &mut Value) -> Option<Vec<u8>> {
    let mut lists = vec![];
    for place in PLACES {
        if let Some(part) = record.pointer_mut(place) {
            collect(part, place, &mut lists);
        }
    }
    (!lists.is_empty()).then(|| packed(&lists))
}

fn collect(part: &mut Value, pointer: &str, lists: &mut Vec<(String, Vec<i64>)>) {
    match part {
        Value::Object(fields) => {
            fields.iter_mut().for_each(|(name, value)| collect(value, &format!("{pointer}/{name}"), lists));
        }
        Value::Array(values) => match steps(values, steps_of_one(pointer)) {
            Some(steps) => {
                values.clear();
                lists.push((pointer.to_owned(), steps));
            }
            None => values.iter_mut().enumerate().for_each(|(i, v)| collect(v, &format!("{pointer}/{i}"), lists)),
        },
        _ => {}
    }
}

/// A list of numbers in steps; `None` if it is short or contains anything else.
fn steps(values: &[Value], of_one: i64) -> Option<Vec<i64>> {
    // About 2^53 steps, which a double represents exactly.
    const LARGEST: f64 = 9.0e15;
    let step = |value: &Value| value.as_f64().map(|x| (x * of_one as f64).round()).filter(|x| x.abs() < LARGEST);
    (values.len() >= LEAST).then(|| values.iter().map(|v| step(v).map(|x| x as i64)).collect())?
}

fn packed(lists: &[(String, Vec<i64>)]) -> Vec<u8> {
    let mut plain = vec![];
    for (pointer, steps) in lists {
        push(&mut plain, pointer.len() as u64);
        plain.extend_from_slice(pointer.as_bytes());
        push(&mut plain, steps.len() as u64);
        let (order, differences) = shortest(steps);
        push(&mut plain, order);
        differences.iter().for_each(|&d| push(&mut plain, zigzag(d)));
    }
    // The next level makes a file a few percent smaller and a campaign a tenth slower.
    let mut encoder = DeflateEncoder::new(MAGIC.to_vec(), Compression::new(3));
    // Writing to memory cannot fail.
    let _ = encoder.write_all(&plain);
    encoder.finish().unwrap_or_default()
}

/// First or second differences, whichever are smaller.
fn shortest(steps: &[i64]) -> (u64, Vec<i64>) {
    let first = differences(steps);
    let second = differences(&first);
    let size = |of: &[i64]| of.iter().map(|&d| u64::from(64 - zigzag(d).leading_zeros())).sum::<u64>();
    if size(&first) <= size(&second) { (1, first) } else { (2, second) }
}

fn differences(steps: &[i64]) -> Vec<i64> {
    let mut before = 0;
    let difference = |&x: &i64| {
        let d = x - before;
        before = x;
        d
    };
    steps.iter().map(difference).collect()
}

fn sums(differences: &[i64]) -> Option<Vec<i64>> {
    let mut sum = 0_i64;
    let add = |&d: &i64| {
        sum = sum.checked_add(d)?;
        Some(sum)
    };
    differences.iter().map(add).collect()
}

fn zigzag(x: i64) -> u64 {
    ((x << 1) ^ (x >> 63)).cast_unsigned()
}

fn push(bytes: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Restores the points; `None` if the file has another format or does not match the record.
pub(crate) fn put_back(record: &mut Value, points: &[u8]) -> Option<()> {
    let mut plain = vec![];
    let deflated = points.strip_prefix(MAGIC)?;
    DeflateDecoder::new(deflated).take(MOST_BYTES).read_to_end(&mut plain).ok()?;
    let mut rest = plain.as_slice();
    while !rest.is_empty() {
        let length = usize::try_from(number(&mut rest)?).ok()?;
        let (pointer, after) = rest.split_at_checked(length)?;
        rest = after;
        let pointer = std::str::from_utf8(pointer).ok()?;
        let values = list(&mut rest, steps_of_one(pointer))?;
        let place = record.pointer_mut(pointer)?;
        *place = Value::Array(values);
    }
    Some(())
}

fn list(rest: &mut &[u8], of_one: i64) -> Option<Vec<Value>> {
    let count = usize::try_from(number(rest)?).ok()?;
    let order = number(rest)?;
    let mut steps = Vec::with_capacity(count.min(rest.len()));
    for _ in 0..count {
        let z = number(rest)?;
        steps.push((z >> 1).cast_signed() ^ -(z & 1).cast_signed());
    }
    for _ in 0..order.min(2) {
        steps = sums(&steps)?;
    }
    Some(steps.into_iter().map(|step| value(step, of_one)).collect())
}

/// The value of a step. Whole numbers stay integers: lists of rows hold nothing else.
fn value(step: i64, of_one: i64) -> Value {
    match step % of_one {
        0 => (step / of_one).into(),
        // The quotient is the double nearest to the decimal.
        _ => (step as f64 / of_one as f64).into(),
    }
}

fn number(rest: &mut &[u8]) -> Option<u64> {
    let mut number = 0;
    for shift in (0..64).step_by(7) {
        let (byte, after) = rest.split_first()?;
        *rest = after;
        number |= u64::from(byte & 0x7f).checked_shl(shift)?;
        if byte & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn record(values: &[f64]) -> Value {
        let rows: Vec<u32> = (0..20).map(|i| i * 7).collect();
        json!({
            "key": "k", "delays": { "t_s": values },
            "replay": {
                "axes": [{ "axis": "north", "position_m": [{ "name": "raw", "t_s": values, "breaks": rows }] }],
                "lead": { "track": { "east_m": values, "breaks": [1, 2] } }, "zoom": null,
            },
        })
    }

    #[test]
    fn points_are_restored_to_half_a_millimetre_and_all_else_exactly() {
        let values: Vec<f64> = (0..500).map(|i| 1e4 * f64::from(i).sin() + 1e-5).collect();
        let whole = record(&values);
        let mut lean = whole.clone();
        let points = take(&mut lean).unwrap();
        assert_eq!(lean["replay"]["axes"][0]["position_m"][0]["t_s"], json!([]));
        assert_eq!((&lean["delays"], &lean["replay"]["lead"]["track"]["breaks"]), (&whole["delays"], &json!([1, 2])));
        let mut back = lean.clone();
        put_back(&mut back, &points).unwrap();
        for (list, most) in [("/replay/lead/track/east_m", 5.1e-4), ("/replay/axes/0/position_m/0/t_s", 5.1e-5)] {
            for (is, was) in back.pointer(list).unwrap().as_array().unwrap().iter().zip(&values) {
                assert!((is.as_f64().unwrap() - was).abs() <= most, "{list}: {is} {was}");
            }
        }
        assert_eq!(
            back["replay"]["axes"][0]["position_m"][0]["breaks"],
            whole["replay"]["axes"][0]["position_m"][0]["breaks"]
        );
        // Restored points are moved out again as the same bytes.
        assert_eq!(take(&mut back).unwrap(), points);
        assert_eq!(back, lean);
    }

    #[test]
    fn a_smooth_curve_needs_few_bytes() {
        let values: Vec<f64> = (0..10_000).map(|i| 0.01 * f64::from(i)).collect();
        let mut record = record(&values);
        assert!(take(&mut record).unwrap().len() < 1_000);
    }

    #[test]
    fn a_record_without_points_and_non_numeric_values_are_unchanged() {
        let mut record = json!({ "replay": { "axes": [{ "t_s": [1, null, 3] }] }, "outcome": "failed" });
        let before = record.clone();
        assert!(take(&mut record).is_none() && record == before);
    }

    #[test]
    fn bytes_that_are_not_points_are_rejected() {
        let mut lean = record(&[1.5; 40]);
        let points = take(&mut lean).unwrap();
        assert!(put_back(&mut lean.clone(), b"flpts").is_none());
        assert!(put_back(&mut json!({}), &points).is_none());
        for cut in [9, points.len() / 2, points.len() - 1] {
            assert!(put_back(&mut lean.clone(), &points[..cut]).is_none(), "{cut}");
        }
    }
}
