//! The rows of a replay in compact form, see [`ExplorerRows`].

use crate::estimate::{EXACT_ASYNC, PAPER, Positions};
use crate::input::Input;
use crate::rows::RowState;
use crate::rows::Rows;
use crate::score::Reference;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use delay_from_flight::AXES;
use flate2::Compression;
use flate2::write::DeflateEncoder;
use record::{ExplorerColumn, ExplorerRows};
use std::io::Write;

/// Maximum size of the packed rows. An hour at 100 Hz needs about half of it.
const MOST_BYTES: usize = 1_000_000;

/// Longer records are thinned right away: from this many bytes only constant values would fit into [`MOST_BYTES`].
const MOST_UNPACKED: usize = 64 << 20;

/// A column before it is packed.
struct Column<'a> {
    name: String,
    differences: u8,
    /// The value of a row, computed on demand: a copy of a long record would double its memory.
    value: Box<dyn Fn(usize) -> Option<i64> + 'a>,
}

/// Least bucket size: smaller buckets would keep about as many rows.
const FEWEST: usize = 16;

/// Time, raw, the paper's compensator, the exact form and the reference, if there is one.
pub(crate) fn explorer_rows(input: &Input, rows: &Rows, estimates: &[Positions]) -> ExplorerRows {
    let columns = columns(input, rows, estimates);
    let of = rows.t.len();
    let mut extremes_of = if 4 * columns.len() * of > MOST_UNPACKED { FEWEST } else { 1 };
    loop {
        let kept = extremes(&columns, of, extremes_of);
        let data = packed(&columns, &kept);
        if data.len() <= MOST_BYTES || extremes_of >= of {
            let columns = columns.into_iter().map(|c| ExplorerColumn { name: c.name, differences: c.differences });
            return ExplorerRows {
                rows: kept.len() as u64,
                of: of as u64,
                extremes_of: extremes_of as u64,
                gap_s: rows.gap_s,
                columns: columns.collect(),
                data,
            };
        }
        extremes_of = (2 * extremes_of).max(FEWEST);
    }
}

fn columns<'a>(input: &Input, rows: &'a Rows, estimates: &'a [Positions]) -> Vec<Column<'a>> {
    let whole = |value: f64| value.is_finite().then(|| value.round() as i64);
    let t = move |row: usize| whole(1e3 * rows.t[row]);
    let mut columns = vec![Column { name: "t".to_owned(), differences: 2, value: Box::new(t) }];
    let axes = || AXES.into_iter().zip(["north", "east"]);
    for estimate in estimates.iter().filter(|e| e.is_raw() || [PAPER, EXACT_ASYNC].contains(&e.name.as_str())) {
        let name = estimate.name.replace('-', "_");
        // Held fixes are steps, the others are smooth.
        let differences = if estimate.is_raw() { 1 } else { 2 };
        for (axis, axis_name) in axes() {
            let place =
                move |row: usize| whole(1e2 * estimate.axes[axis][row]).filter(|_| is_counted(estimate, rows, row));
            columns.push(Column { name: format!("{name}_{axis_name}"), differences, value: Box::new(place) });
        }
    }
    if let Some(reference) = &input.reference {
        let truth = Reference::at(reference, rows, 0..rows.t.len());
        for (axis, axis_name) in axes() {
            let mut values = vec![None; rows.t.len()];
            truth.row.iter().zip(&truth.axes[axis]).for_each(|(&row, v)| values[row] = whole(1e2 * v));
            let value = move |row: usize| values[row];
            columns.push(Column { name: format!("truth_{axis_name}"), differences: 2, value: Box::new(value) });
        }
    }
    columns
}

/// Rows as counted by the page: warm-up rows of a compensated position are excluded.
fn is_counted(estimate: &Positions, rows: &Rows, row: usize) -> bool {
    estimate.shown(rows, row) && (estimate.is_raw() || rows.state[row] == RowState::Valid)
}

/// From every `bucket` rows the ends, the rows with the least or greatest value of a column, and one without a value,
/// so that gaps remain.
fn extremes(columns: &[Column<'_>], rows: usize, bucket: usize) -> Vec<usize> {
    if bucket <= 1 {
        return (0..rows).collect();
    }
    let mut kept = vec![];
    for start in (0..rows).step_by(bucket) {
        let within = start..(start + bucket).min(rows);
        let mut here = vec![start, within.end - 1];
        for column in columns {
            let value = |row: &usize| (column.value)(*row);
            here.extend(within.clone().filter(|row| value(row).is_some()).min_by_key(value));
            here.extend(within.clone().filter(|row| value(row).is_some()).max_by_key(value));
            here.extend(within.clone().find(|row| value(row).is_none()));
        }
        here.sort_unstable();
        here.dedup();
        kept.extend(here);
    }
    kept
}

/// Zigzag differences as four-byte little-endian integers, all lowest bytes of a column first. The higher bytes of
/// small negative numbers are then zero too, and an hour at 100 Hz packs into less than half.
fn packed(columns: &[Column<'_>], kept: &[usize]) -> String {
    let mut bytes = Vec::with_capacity(4 * columns.len() * kept.len());
    for column in columns {
        let steps = differences(kept.iter().map(|&row| (column.value)(row)), column.differences);
        for byte in 0..4 {
            bytes.extend(steps.iter().map(|&step| zigzag(step).to_le_bytes()[byte]));
        }
    }
    let mut encoder = DeflateEncoder::new(vec![], Compression::new(3));
    // Writing to a vector cannot fail.
    let deflated = encoder.write_all(&bytes).and_then(|()| encoder.finish());
    STANDARD.encode(deflated.unwrap_or_default())
}

/// 0, −1, 1, −2, … as 0, 1, 2, 3, …
fn zigzag(step: i32) -> i32 {
    (step << 1) ^ (step >> 31)
}

/// Difference from the value predicted by the previous ones: the last one, or with `order` 2 the line through the last
/// two. A value too far off is stored as missing.
fn differences(values: impl Iterator<Item = Option<i64>>, order: u8) -> Vec<i32> {
    let (mut last, mut slope) = (0_i64, 0_i64);
    let difference = |value: Option<i64>| {
        let foreseen = last.checked_add(if order == 2 { slope } else { 0 })?;
        let step = i32::try_from(value?.checked_sub(foreseen)?).ok().filter(|step| *step != ExplorerRows::MISSING)?;
        (last, slope) = (value?, value? - last);
        Some(step)
    };
    values.map(difference).map(|step| step.unwrap_or(ExplorerRows::MISSING)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Settings, Track, TrackColumn, TrackRows, replay};
    use flate2::read::DeflateDecoder;
    use flight::Delay;
    use simulate::{FlightSettings, simulate};
    use std::io::Read;

    fn unpacked(rows: &ExplorerRows) -> Vec<Vec<Option<i64>>> {
        let mut bytes = vec![];
        DeflateDecoder::new(&*STANDARD.decode(&rows.data).unwrap()).read_to_end(&mut bytes).unwrap();
        let count = rows.rows as usize;
        let column = |(bytes, column): (&[u8], &ExplorerColumn)| {
            let (mut last, mut slope) = (0_i64, 0_i64);
            let at = |row: usize| {
                let packed = u32::from_le_bytes([0, 1, 2, 3].map(|plane| bytes[plane * count + row]));
                let step = (packed >> 1) as i32 ^ -((packed & 1) as i32);
                (step != ExplorerRows::MISSING).then(|| {
                    let value = i64::from(step) + last + if column.differences == 2 { slope } else { 0 };
                    (slope, last) = (value - last, value);
                    value
                })
            };
            (0..count).map(at).collect()
        };
        bytes.chunks_exact(4 * count).zip(&rows.columns).map(column).collect()
    }

    fn of_track<'t>(track: &'t Track, name: &str) -> &'t [Option<f64>] {
        match track.columns.iter().find(|(column, _)| column == name) {
            Some((_, TrackColumn::F64(values))) => values,
            _ => panic!("no column {name}"),
        }
    }

    #[test]
    fn every_row_is_restored_to_half_a_centimetre() {
        let flight = simulate(&FlightSettings { duration_s: 60.0, ..FlightSettings::default() }).unwrap();
        let settings = Settings::with_delay(Delay::from_seconds(0.4).unwrap(), "test");
        let played = replay(&flight.to_flight().unwrap(), &settings).unwrap();
        let (rows, track) = (played.explorer, played.track.whole());
        let Some((_, TrackColumn::Text(state))) = track.columns.iter().find(|(name, _)| name == "state") else {
            panic!("no states")
        };
        assert!(state.contains(&"warm-up") && played.record.coverage.valid_rows < rows.of);
        assert_eq!((rows.extremes_of, rows.rows), (1, rows.of));
        let (found, mut compared) = (unpacked(&rows), 0);
        for (column, values) in rows.columns.iter().zip(&found) {
            let (name, scale) = match column.name.as_str() {
                "t" => ("t_s".to_owned(), 1e3),
                truth if truth.starts_with("truth_") => continue,
                other => (format!("{other}_m"), 1e2),
            };
            let is_raw = name.starts_with("raw_") || name == "t_s";
            for ((want, got), state) in of_track(&track, &name).iter().zip(values).zip(state) {
                let want = want.filter(|_| is_raw || *state == "valid");
                assert_eq!(want.is_some(), got.is_some(), "{name}");
                assert!(want.zip(*got).is_none_or(|(want, got)| (scale * want - got as f64).abs() <= 0.5 + 1e-6));
                compared += 1;
            }
            // The page's table shows the same count.
            let counted = values.iter().flatten().count() as u64;
            assert_eq!(counted, if is_raw { rows.rows } else { played.record.coverage.valid_rows }, "{name}");
        }
        assert_eq!((compared, found.len()), (7 * rows.rows as usize, 9));
    }

    #[test]
    fn small_numbers_of_either_sign_have_zero_higher_bytes() {
        assert_eq!([0, -1, 1, -2, 127, -128].map(zigzag), [0, 1, 2, 3, 254, 255]);
        assert_eq!([i32::MAX, i32::MIN].map(|step| zigzag(step) as u32), [u32::MAX - 1, u32::MAX]);
    }

    #[test]
    fn a_missing_value_and_a_jump_leave_the_others_unchanged() {
        let values = [Some(3), None, Some(5), Some(i64::MAX), Some(-2)];
        assert_eq!(differences(values.into_iter(), 1), [3, i32::MIN, 2, i32::MIN, -7]);
        assert_eq!(differences([Some(1), Some(2), Some(3), Some(5)].into_iter(), 2), [1, 0, 0, 1]);
    }

    #[test]
    fn one_row_spikes_and_gaps_survive_thinning() {
        let mut values: Vec<Option<i64>> = (0..1000).map(|n| Some(n / 10)).collect();
        (values[517], values[803]) = (Some(9999), None);
        let column = Column { name: "raw_north".to_owned(), differences: 1, value: Box::new(move |row| values[row]) };
        let kept = extremes(&[column], 1000, 64);
        assert!(kept.contains(&517) && kept.contains(&803) && kept.len() < 100, "{}", kept.len());
        assert!(kept.is_sorted() && kept[0] == 0 && kept.last() == Some(&999));
    }
}
