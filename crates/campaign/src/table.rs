//! Result tables.

use crate::error::CampaignError;
use crate::line::DelayLine;
use crate::store::{Files, Keep, Kept, Store};
use compensation_replay::{Track, TrackColumn, TrackRows};
use convert::{Cells, ROWS_OF_A_GROUP, Sheet, SheetColumn, write_csv, write_parquet, write_track_table};
use flight::Stamp;
use record::{Estimate, FlightRecord, FlightRow, RowVerdicts};

/// Writes the compensated track of a flight.
pub(crate) fn write_track(
    store: &Store,
    name: &str,
    record: &FlightRecord,
    track: &dyn TrackRows,
) -> Result<Kept, CampaignError> {
    let about = provenance(record).to_string();
    let end = |from: usize| track.rows().min(from + ROWS_OF_A_GROUP);
    let sheet = |from: usize| track_sheet(record, track.part(from..end(from)));
    Ok(store.write_with(name, Keep::Part, |file| {
        let others = (end(0)..track.rows()).step_by(ROWS_OF_A_GROUP).map(sheet);
        write_track_table(&sheet(0), others, &about, file)
    })?)
}

/// A part of the track with UTC next to its timestamps.
fn track_sheet(record: &FlightRecord, part: Track) -> Sheet {
    let mut sheet = Sheet::default();
    for (name, values) in part.columns {
        let utc = match (name.as_str(), &values) {
            ("stamp_ns", TrackColumn::I64(stamps)) => {
                Some(Cells::I64(stamps.iter().map(|ns| utc_ns(record, Stamp(*ns))).collect()))
            }
            _ => None,
        };
        let cells = match values {
            TrackColumn::I64(v) => Cells::I64(v.into_iter().map(Some).collect()),
            TrackColumn::F64(v) => Cells::F64(v.into_iter().map(|x| x.map(|x| rounded(&name, x))).collect()),
            TrackColumn::Text(v) => Cells::Text(v.into_iter().map(Some).collect()),
        };
        sheet.push(name, cells);
        if let Some(utc) = utc {
            sheet.push("utc_ns", utc);
        }
    }
    sheet
}

/// Rounds lengths to 2^-13 m = 0.12 mm and degrees to 2^-30, which is 0.10 mm on the ground. Further digits are noise,
/// and would be more than half of the file.
fn rounded(column: &str, value: f64) -> f64 {
    let bits = match column.rsplit('_').next() {
        Some("m") => 13,
        Some("deg") => 30,
        _ => return value,
    };
    let scale = 2_f64.powi(bits);
    (value * scale).round() / scale
}

/// UTC of a timestamp of the replay, if known from the log.
fn utc_ns(record: &FlightRecord, stamp: Stamp) -> Option<i64> {
    let clock = record.replay.as_ref()?.clock;
    let tied = || record.log.as_ref()?.utc.as_ref().filter(|tie| tie.clock == clock)?.unix(stamp);
    clock.unix(stamp).or_else(tied).map(|unix| unix.0)
}

/// Provenance metadata of a track, which stays with every copy.
fn provenance(record: &FlightRecord) -> serde_json::Value {
    let replay = record.replay.as_ref();
    let settings = replay.map(|replay| &replay.settings);
    let origin = replay.and_then(|r| r.origin).map(|o| {
        serde_json::json!({
            "latitude_deg": o.latitude.to_degrees(), "longitude_deg": o.longitude.to_degrees(), "height_m": o.height,
        })
    });
    serde_json::json!({
        "made_by": format!("flightlag {}, analysis {}", env!("CARGO_PKG_VERSION"), record.analysis_version),
        "inputs": record.inputs,
        "result": record.key,
        "position": replay.map(|r| &r.pair.position),
        "velocity": replay.map(|r| &r.pair.velocity),
        "delay_removed_s": settings.map(|s| s.delay.seconds()),
        "delay_standard_uncertainty_s": settings.and_then(|s| s.delay_uncertainty_s),
        "delay_source": settings.map(|s| &s.delay_source),
        "origin_of_north_and_east": origin,
        "clock_of_stamps": replay.map(|r| r.clock.to_string()),
    })
}

/// Writes the table of flights as Parquet and as CSV.
pub(crate) fn write_flights(store: &Store, rows: &[FlightRow]) -> Result<Files, CampaignError> {
    let sheet = flight_sheet(rows);
    let parquet = store.write_with("flights.parquet", Keep::Renewable, |file| write_parquet(&sheet, file))?;
    let csv = store.write_with("flights.csv", Keep::Renewable, |file| write_csv(&sheet, file))?;
    Ok(Files::from([("flights.parquet".to_owned(), parquet), ("flights.csv".to_owned(), csv)]))
}

/// The columns of the table; names end in their unit.
fn flight_sheet(rows: &[FlightRow]) -> Sheet {
    let lines: Vec<DelayLine> = rows.iter().map(DelayLine::of_row).collect();
    let of = Columns(rows);
    let mut columns = line_columns(&lines);
    columns.extend(log_columns(&of));
    columns.extend(error_columns(&of));
    columns.extend([
        of.number("valid_share", &|r| r.valid_share),
        of.text("criteria", &|r| r.criteria.as_ref().map(|c| c.overall.word().to_owned())),
        of.text("criteria_failed", &|r| r.criteria.as_ref().map(RowVerdicts::failed)),
        of.count("warnings", &|r| r.warnings),
        of.count("losses", &|r| r.losses),
        of.text("key", &|r| Some(r.key.clone())),
        of.text("page", &|r| Some(r.page.clone())),
    ]);
    Sheet { columns }
}

/// Columns about the log, and delays from other sources.
fn log_columns(of: &Columns<'_, FlightRow>) -> Vec<SheetColumn> {
    vec![
        of.text("duplicate_of", &|r| r.duplicate_of.clone()),
        of.text("outcome", &|r| Some(r.outcome.word().to_owned())),
        of.text("reason", &|r| r.outcome.reason().map(str::to_owned)),
        of.count("lossy", &|r| u64::from(r.lossy)),
        of.text("format", &|r| Some(r.format.clone())),
        of.text("map", &|r| r.map.clone()),
        of.count("bytes", &|r| r.bytes),
        of.number("duration_s", &|r| r.duration_s),
        of.text("position", &|r| r.position.clone()),
        of.text("velocity", &|r| r.velocity.clone()),
        of.number("position_rate_hz", &|r| r.position_rate_hz),
        of.number("velocity_rate_hz", &|r| r.velocity_rate_hz),
        of.number("speed_median_mps", &|r| r.speed_median_mps),
        of.number("card_delay_s", &|r| value(&r.card_delay_s)),
        of.number("card_delay_standard_uncertainty_s", &|r| spread(&r.card_delay_s)),
        of.number("sweep_optimum_s", &|r| value(&optimum(r))),
        of.number("sweep_optimum_standard_uncertainty_s", &|r| spread(&optimum(r))),
        of.text("flown_at", &|r| r.flown_at.clone()),
    ]
}

/// Columns with the corrections by the compensators, and the errors against the reference.
fn error_columns(of: &Columns<'_, FlightRow>) -> Vec<SheetColumn> {
    vec![
        of.number("correction_rms_m", &|r| value(&r.correction_rms_m)),
        of.number("correction_rms_standard_uncertainty_m", &|r| spread(&r.correction_rms_m)),
        of.number("raw_held_error_rms_m", &|r| value(&r.raw_error_rms_m)),
        of.number("raw_held_error_rms_standard_uncertainty_m", &|r| spread(&r.raw_error_rms_m)),
        of.number("pade_error_rms_m", &|r| value(&r.pade_error_rms_m)),
        of.number("pade_error_rms_standard_uncertainty_m", &|r| spread(&r.pade_error_rms_m)),
        of.number("exact_error_rms_m", &|r| value(&r.exact_error_rms_m)),
        of.number("exact_error_rms_standard_uncertainty_m", &|r| spread(&r.exact_error_rms_m)),
    ]
}

fn value(e: &Option<Estimate>) -> Option<f64> {
    e.map(|e| e.value)
}

fn spread(e: &Option<Estimate>) -> Option<f64> {
    e.and_then(|e| e.standard_uncertainty)
}

/// Makes columns with one cell per item.
struct Columns<'a, T>(&'a [T]);

impl<T> Columns<'_, T> {
    fn text(&self, name: &str, of: &dyn Fn(&T) -> Option<String>) -> SheetColumn {
        SheetColumn { name: name.to_owned(), cells: Cells::Text(self.0.iter().map(of).collect()) }
    }

    /// A column in which empty text is an absent cell.
    fn optional_text(&self, name: &str, of: &dyn Fn(&T) -> &str) -> SheetColumn {
        self.text(name, &|item| Some(of(item).to_owned()).filter(|text| !text.is_empty()))
    }

    fn number(&self, name: &str, of: &dyn Fn(&T) -> Option<f64>) -> SheetColumn {
        SheetColumn { name: name.to_owned(), cells: Cells::F64(self.0.iter().map(of).collect()) }
    }

    fn count(&self, name: &str, of: &dyn Fn(&T) -> u64) -> SheetColumn {
        let cell = |item: &T| Some(i64::try_from(of(item)).unwrap_or(i64::MAX));
        SheetColumn { name: name.to_owned(), cells: Cells::I64(self.0.iter().map(cell).collect()) }
    }
}

/// The answer columns, shared by `flightlag delay` and the campaign's table.
fn line_columns(lines: &[DelayLine]) -> Vec<SheetColumn> {
    let of = Columns(lines);
    let codes = |line: &DelayLine, remarks: bool| {
        let wanted = line.alarms.iter().filter(|a| (a.gravity == "grey") == remarks);
        Some(wanted.map(|a| a.code.as_str()).collect::<Vec<_>>().join(" ")).filter(|codes| !codes.is_empty())
    };
    vec![
        of.optional_text("flight", &|l| &l.flight),
        of.optional_text("group", &|l| &l.group),
        of.optional_text("kind", &|l| &l.kind),
        of.number("lateness_s", &|l| l.lateness_s),
        of.number("lateness_u_s", &|l| l.lateness_u_s),
        of.number("lateness_low_s", &|l| l.lateness_low_s),
        of.number("lateness_high_s", &|l| l.lateness_high_s),
        of.optional_text("datum", &|l| &l.datum),
        of.number("position_minus_velocity_s", &|l| l.position_minus_velocity_s),
        of.number("removed_s", &|l| l.removed_s),
        of.optional_text("removed_from", &|l| &l.removed_from),
        of.optional_text("effect", &|l| &l.effect),
        of.number("error_raw_m", &|l| l.error_raw_m),
        of.number("error_compensated_m", &|l| l.error_compensated_m),
        of.text("alarms", &|l| codes(l, false)),
        of.optional_text("data", &|l| &l.data),
        of.number("position_minus_velocity_u_s", &|l| l.position_minus_velocity_u_s),
        of.number("removed_u_s", &|l| l.removed_u_s),
        of.number("error_raw_u_m", &|l| l.error_raw_u_m),
        of.number("error_compensated_u_m", &|l| l.error_compensated_u_m),
        of.optional_text("answer", &|l| &l.words),
        of.optional_text("effect_words", &|l| &l.effect_words),
        of.text("remarks", &|l| codes(l, true)),
    ]
}

/// The answers as CSV.
pub(crate) fn write_lines(lines: &[DelayLine], out: &mut dyn std::io::Write) -> std::io::Result<()> {
    let mut sheet = Sheet { columns: line_columns(lines) };
    sheet.columns.push(Columns(lines).text("duplicate_of", &|l| l.duplicate_of.clone()));
    sheet.columns.push(Columns(lines).count("warnings", &|l| l.warnings));
    let mut bytes = vec![];
    write_csv(&sheet, &mut bytes).map_err(std::io::Error::other)?;
    out.write_all(&bytes)
}

/// The best delay of the flight's sweep.
fn optimum(row: &FlightRow) -> Option<Estimate> {
    Some(row.sweep.as_ref()?.optimum.found()?.delay_s)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use convert::read_parquet;
    use record::Outcome;
    use std::fs::File;

    pub(crate) fn row(flight: &str) -> FlightRow {
        FlightRow {
            flight: flight.to_owned(),
            key: "ab12".into(),
            page: "flights/x/index.html".into(),
            outcome: Outcome::Compensated,
            lossy: false,
            minor_loss: false,
            damage: None,
            tail_cut_bytes: 0,
            format: "MCAP".into(),
            map: None,
            bytes: u64::MAX,
            duration_s: Some(0.1 + 0.2),
            position: Some("position.gps".into()),
            velocity: None,
            position_rate_hz: None,
            velocity_rate_hz: Some(f64::MIN_POSITIVE),
            speed_median_mps: Some(-1.5),
            delay_s: Some(0.4),
            measured_delay_s: None,
            delay_from: None,
            card_delay_s: None,
            flown_at: None,
            track_sketch_m: None,
            sweep: None,
            correction_rms_m: Some(Estimate { value: 6.983_999_999_999_999, standard_uncertainty: None }),
            raw_error_rms_m: None,
            pade_error_rms_m: None,
            exact_error_rms_m: None,
            valid_share: Some(1.0),
            criteria: None,
            cards: vec![],
            lateness: None,
            decision: None,
            effect: None,
            duplicate_of: None,
            attention: vec![],
            warnings: 3,
            losses: 0,
        }
    }

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        (folder, store)
    }

    fn table(folder: &tempfile::TempDir, name: &str) -> Sheet {
        read_parquet(File::open(folder.path().join(name)).unwrap()).unwrap().sheet
    }

    #[test]
    fn parquet_preserves_every_bit() {
        let (folder, store) = store();
        let rows = [row("=1+1"), row("b.bag")];
        write_flights(&store, &rows).unwrap();
        let read = table(&folder, "flights.parquet");
        let number = |name: &str| match read.cells(name) {
            Some(Cells::F64(values)) => values.iter().nth(1).unwrap(),
            other => panic!("{name}: {other:?}"),
        };
        for (name, value) in [
            ("duration_s", rows[1].duration_s),
            ("velocity_rate_hz", rows[1].velocity_rate_hz),
            ("correction_rms_m", Some(6.983_999_999_999_999)),
            ("position_rate_hz", None),
            ("correction_rms_standard_uncertainty_m", None),
        ] {
            assert_eq!(number(name).map(f64::to_bits), value.map(f64::to_bits), "{name}");
        }
        let flights = Cells::Text([Some("=1+1"), Some("b.bag")].into_iter().collect());
        assert_eq!(read.cells("flight"), Some(&flights), "only CSV is opened by spreadsheets");
    }

    #[test]
    fn a_track_is_read_back_with_its_timestamps_and_absent_values() {
        let (folder, store) = store();
        let stamps = vec![i64::MIN, 0, 1_700_000_000_123_456_789];
        let north = vec![Some(0.1 + 0.2), None, Some(-0.0)];
        let track = Track {
            columns: vec![
                ("stamp_ns".into(), TrackColumn::I64(stamps.clone())),
                ("north_m".into(), TrackColumn::F64(north.clone())),
                ("age_s".into(), TrackColumn::F64(north.clone())),
                ("state".into(), TrackColumn::Text(vec!["warm-up", "valid", "valid"])),
            ],
        };
        let record = crate::criteria::tests::record();
        assert_eq!(record.replay.as_ref().unwrap().clock, flight::Clock::Unix);
        write_track(&store, "by-key/ab/track.parquet", &record, &track).unwrap();
        let read = table(&folder, "by-key/ab/track.parquet");
        let stamps = Cells::I64(stamps.into_iter().map(Some).collect());
        assert_eq!([read.cells("stamp_ns"), read.cells("utc_ns")], [Some(&stamps); 2]);
        let bits = |name: &str| match read.cells(name) {
            Some(Cells::F64(values)) => values.iter().map(|x| x.map(f64::to_bits)).collect::<Vec<_>>(),
            other => panic!("{name}: {other:?}"),
        };
        // 0.3 m in steps of 2^-13 m.
        assert_eq!(bits("north_m"), [Some(2458.0 / 8192.0), None, Some(-0.0)].map(|x| x.map(f64::to_bits)));
        assert_eq!(bits("age_s"), north.iter().map(|x| x.map(f64::to_bits)).collect::<Vec<_>>());
        let states = Cells::Text(["warm-up", "valid", "valid"].into_iter().map(Some).collect());
        assert_eq!(read.cells("state"), Some(&states));
    }

    #[test]
    fn text_cells_of_the_csv_are_inert_and_numbers_stay_numbers() {
        let (folder, store) = store();
        let name = "=HYPERLINK(\"http://x\",\"y\"),\n2";
        write_flights(&store, &[row(name)]).unwrap();
        let text = std::fs::read_to_string(folder.path().join("flights.csv")).unwrap();
        assert!(text.contains("\"'=HYPERLINK(\"\"http://x\"\",\"\"y\"\"),\n2\",,cannot-tell,"), "{text}");
        assert!(text.contains(",-1.5,,,,,,6.983999999999999,"), "{text}");
    }

    #[test]
    fn the_same_table_gives_the_same_bytes() {
        let files = [store(), store()].map(|(folder, store)| {
            write_flights(&store, &[row("a"), row("b")]).unwrap();
            ["flights.parquet", "flights.csv"].map(|name| std::fs::read(folder.path().join(name)).unwrap())
        });
        assert_eq!(files[0], files[1]);
    }
}
