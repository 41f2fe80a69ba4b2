//! Clock faults, one at a time, through the reader and the channel map of every format: a sample has its
//! true time, or is rejected and counted, or the log is reported as doubtful. Other tests of clocks are in `time`.

use crate::made::{self, BagCodec, Encoding, Layout, Sent};
use crate::support::*;
use crate::wire::*;
use flight::{ChannelHealth, Clock, StampKind};
use ingest::{ChannelMap, FlightUnit, Loaded, LogKind, MapLibrary};
use std::path::Path;
use std::sync::LazyLock;

const S: i128 = 1_000_000_000;
const MS: i128 = 1_000_000;
const DAY: i128 = 86_400 * S;
const STEP: i128 = 100 * MS;
const ROWS: usize = 200;
const MIDDLE: usize = ROWS / 2;
/// Read only once, as it takes longer than a log.
static SHIPPED: LazyLock<MapLibrary> = LazyLock::new(|| MapLibrary::shipped().unwrap());
/// A timestamp with all bits set.
const ONES: i128 = i128::MAX;

/// A format that timestamps a height, which is its row number.
struct Format {
    name: &'static str,
    kind: LogKind,
    /// For the map: topic, timestamp sources, field.
    map: [&'static str; 3],
    counter: Counter,
    /// Rows also have a logger timestamp.
    logged: bool,
    write: fn(&[i128]) -> Vec<u8>,
}

/// The kind of clock of the timestamps.
struct Counter {
    clock: Clock,
    /// Time of the first row, ns.
    begin: i128,
    /// ns.
    quantum: i128,
    /// Bits of a timestamp that counts quanta.
    bits: u32,
    signed: bool,
}

const UNIX_NS: Counter = Counter { clock: Clock::Unix, begin: 1_700_000_000 * S, quantum: 1, bits: 64, signed: true };
const BOOT_US: Counter = Counter { clock: Clock::Boot, begin: 100 * S, quantum: 1000, bits: 64, signed: false };

const FORMATS: [Format; 7] = [
    Format {
        name: "mcap",
        kind: LogKind::Mcap,
        map: [made::FIX, HEADER, "latitude"],
        counter: UNIX_NS,
        logged: true,
        write: |stamps| made::mcap(&sent(stamps), Encoding::Cdr, Layout::PLAIN),
    },
    Format {
        name: "bag",
        kind: LogKind::Bag,
        map: [made::FIX, HEADER, "latitude"],
        counter: Counter { signed: false, ..UNIX_NS },
        logged: true,
        write: |stamps| made::bag(&sent(stamps), BagCodec::None, 40, true, true),
    },
    Format {
        name: "csv of UTC",
        kind: LogKind::Csv,
        map: ["", "measured = [{ field = \"t\", unit = \"ns\", clock = \"unix\" }]", "v"],
        counter: UNIX_NS,
        logged: false,
        write: |stamps| csv(stamps, 1),
    },
    Format {
        name: "csv since boot",
        kind: LogKind::Csv,
        map: ["", "measured = [{ field = \"t\", unit = \"us\", clock = \"boot\" }]", "v"],
        counter: Counter { signed: true, ..BOOT_US },
        logged: false,
        write: |stamps| csv(stamps, 1000),
    },
    Format {
        name: "ulog",
        kind: LogKind::Ulog,
        map: ["pose", "measured = [{ field = \"timestamp_sample\", unit = \"us\", clock = \"boot\" }]", "v"],
        counter: BOOT_US,
        logged: false,
        write: ulog,
    },
    Format {
        name: "dataflash",
        kind: LogKind::DataFlash,
        map: ["ABC", "measured = [{ field = \"TimeUS\", unit = \"us\", clock = \"boot\" }]", "V"],
        counter: BOOT_US,
        logged: false,
        write: dataflash,
    },
    Format {
        name: "tlog",
        kind: LogKind::Tlog,
        map: [
            "LOCAL_POSITION_NED",
            "measured = [{ field = \"time_boot_ms\", unit = \"ms\", clock = \"boot\" }]\nlogged = [{ container = \"logged\" }]",
            "z",
        ],
        counter: Counter { quantum: MS, bits: 32, ..BOOT_US },
        logged: true,
        write: tlog,
    },
];

const HEADER: &str =
    "measured = [{ field = \"header.stamp\", unit = \"ns\", clock = \"unix\" }]\nlogged = [{ container = \"logged\" }]";

/// When the logger received a row.
fn logged(row: usize) -> i64 {
    1_700_000_000_250_000_000 + 100_000_000 * row as i64
}

fn sent(stamps: &[i128]) -> Vec<Sent> {
    let fix = |(row, stamp): (usize, &i128)| Sent {
        topic: made::FIX,
        logged_ns: logged(row),
        published_ns: logged(row),
        stamp_ns: if *stamp == ONES { 0xffff_ffff * S as i64 } else { *stamp as i64 },
        latitude: row as f64,
        status: 0,
        frame: String::new(),
    };
    stamps.iter().enumerate().map(fix).collect()
}

fn csv(stamps: &[i128], quantum: i128) -> Vec<u8> {
    let row = |(row, stamp): (usize, &i128)| {
        let ticks = if *stamp == ONES { u64::MAX.into() } else { stamp.div_euclid(quantum) };
        format!("{ticks},{row}\n")
    };
    format!("t,v\n{}", stamps.iter().enumerate().map(row).collect::<String>()).into_bytes()
}

/// Ticks as stored in an unsigned field.
fn ticks(stamp: i128, quantum: i128) -> u64 {
    if stamp == ONES { u64::MAX } else { stamp.div_euclid(quantum) as u64 }
}

fn ulog(stamps: &[i128]) -> Vec<u8> {
    let row = |(row, stamp): (usize, &i128)| {
        let published = (100_005_000 + 100_000 * row as u64).to_le_bytes();
        let body = [&[0, 0], &published[..], &ticks(*stamp, 1000).to_le_bytes(), &(row as f64).to_le_bytes()];
        ulog_message(b'D', &body.concat())
    };
    let begin = ulog_begin(&[("pose:uint64_t timestamp;uint64_t timestamp_sample;double v;", 0)]);
    [begin, stamps.iter().enumerate().flat_map(row).collect()].concat()
}

fn dataflash(stamps: &[i128]) -> Vec<u8> {
    let row = |(row, stamp): (usize, &i128)| {
        dataflash_record(10, &[ticks(*stamp, 1000).to_le_bytes(), (row as f64).to_le_bytes()].concat())
    };
    let head = [dataflash_begin(), dataflash_fmt(10, "ABC", "Qd", "TimeUS,V")].concat();
    [head, stamps.iter().enumerate().flat_map(row).collect()].concat()
}

fn tlog(stamps: &[i128]) -> Vec<u8> {
    let frame = |(row, stamp): (usize, &i128)| {
        let mut payload = (ticks(*stamp, MS) as u32).to_le_bytes().to_vec();
        payload.extend([0.0, 0.0, row as f32, 1.0, 1.0, 1.0].map(f32::to_le_bytes).concat());
        tlog_frame(logged(row) as u64 / 1000, 32, 185, &payload)
    };
    stamps.iter().enumerate().flat_map(frame).collect()
}

impl Format {
    fn true_stamps(&self) -> Vec<i128> {
        (0..ROWS as i128).map(|i| self.counter.begin + STEP * i).collect()
    }

    fn load(&self, stamps: &[i128]) -> Loaded {
        let [topic, time, field] = self.map;
        let topic = if topic.is_empty() { String::new() } else { format!("topic = [\"{topic}\"]\n") };
        let map = format!(
            "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\n{time}\n[[channel]]\nname = \"height.x\"\nquantity = \"height\"\n\
             {topic}timeline = \"measured\"\n[channel.fields]\nheight = {{ field = \"{field}\", unit = \"m\" }}\n"
        );
        let mut library = SHIPPED.clone();
        library.add(ChannelMap::from_toml(Path::new("t.toml"), &map).unwrap());
        let (_folder, path) = file("log", &(self.write)(stamps));
        let unit = FlightUnit { id: "log".into(), files: vec![path], kind: self.kind };
        let loaded = load_mapped(&unit, &library, Some("t")).unwrap();
        assert_ledger(&loaded);
        loaded
    }
}

/// Expected outcome of a case.
#[derive(Debug, Clone, Copy)]
enum Outcome {
    /// Every row at its true time.
    Exact,
    /// This many rows are rejected and counted; the others are at their true time.
    LeftOut(usize),
    /// Half the rows are rejected and counted; the others are as written.
    Half,
    /// Rows are as written, in the order of the log except for one step; a notice of this code reports it.
    Reported(&'static str),
    /// The same, but only the timestamp gaps show it: the log cannot be distinguished from one with a gap.
    Gap,
}

fn health(loaded: &Loaded) -> &ChannelHealth {
    &loaded.binding.as_ref().unwrap_or_else(|e| panic!("{e}: {:?}", loaded.flight.notices)).channels[0]
}

/// Timestamps and rows of the samples.
fn samples(loaded: &Loaded) -> Vec<(i128, usize)> {
    let series = &loaded.flight.channels["height.x"].series;
    let stamps = series.timeline().stamps().iter().map(|s| i128::from(s.0));
    stamps.zip(series.component(0).iter().map(|v| *v as usize)).collect()
}

fn check(format: &Format, case: &str, written: &[i128], truth: &[i128], outcome: Outcome) {
    let what = format!("{}, {case}", format.name);
    let loaded = format.load(written);
    let (health, samples) = (health(&loaded), samples(&loaded));
    let stamps = health.stamps.as_ref().unwrap();
    // The timestamps used are reported.
    assert_eq!((stamps.kind, stamps.clock), (StampKind::Measured, format.counter.clock), "{what}");
    assert!(samples.windows(2).all(|w| w[0].0 < w[1].0), "{what}");
    let down = |stamp: i128| stamp.div_euclid(format.counter.quantum) * format.counter.quantum;
    let true_to = |of: &[i128]| samples.iter().all(|(stamp, row)| *stamp == down(of[*row]));
    let lost = ROWS - samples.len();
    // Loss of rows is counted, by reason, in notices.
    let counted: u64 = ["rejected-row", "duplicate-stamp"].iter().map(|code| count_of(&loaded, code)).sum();
    assert_eq!(counted, lost as u64, "{what}: {:?}", loaded.flight.notices);
    let orderly = samples.windows(2).filter(|w| w[1].1 < w[0].1).count() <= 1;
    match outcome {
        Outcome::Exact => assert!(true_to(truth) && lost == 0, "{what}: {lost} lost, {samples:?}"),
        Outcome::LeftOut(rows) => assert!(true_to(truth) && lost == rows, "{what}: {lost} lost, {samples:?}"),
        Outcome::Half => assert!(true_to(written) && lost == MIDDLE && orderly, "{what}: {lost} lost, {samples:?}"),
        Outcome::Reported(code) => {
            assert!(count_of(&loaded, code) > 0, "{what}: {:?}", loaded.flight.notices);
            assert!(true_to(written) && orderly && lost <= MIDDLE, "{what}: {lost} lost, {samples:?}");
        }
        Outcome::Gap => assert!(true_to(written) && lost == 0 && stamps.gap_count == 1, "{what}: {stamps:?}"),
    }
}

/// Checks all formats that `fits`, each with its timestamps changed by `spoil`.
fn each(case: &str, outcome: Outcome, fits: impl Fn(&Format) -> bool, spoil: impl Fn(usize, i128) -> i128) {
    let mut checked = 0;
    for format in FORMATS.iter().filter(|f| fits(f)) {
        let truth = format.true_stamps();
        let written: Vec<i128> = truth.iter().enumerate().map(|(row, stamp)| spoil(row, *stamp)).collect();
        check(format, case, &written, &truth, outcome);
        checked += 1;
    }
    assert!(checked > 0, "{case}");
}

fn any(_: &Format) -> bool {
    true
}

#[test]
fn good_timestamps_and_disordered_rows_are_exact() {
    each("good", Outcome::Exact, any, |_, stamp| stamp);
    let swapped = |row: usize, stamp| if row.is_multiple_of(2) { stamp + STEP } else { stamp - STEP };
    for format in &FORMATS {
        // The value moves with its timestamp: the second one written is the first one in time.
        let written: Vec<i128> = format.true_stamps().iter().enumerate().map(|(row, s)| swapped(row, *s)).collect();
        check(format, "swapped pairs", &written, &written, Outcome::Exact);
    }
}

#[test]
fn the_first_of_equal_timestamps_is_kept_and_the_others_are_counted() {
    for (every, lost) in [(100, 2), (10, 20)] {
        let case = format!("every {every}th stamp is that before it");
        each(
            &case,
            Outcome::LeftOut(lost),
            any,
            |row, stamp| if row % every == every / 2 { stamp - STEP } else { stamp },
        );
    }
    each("bursts of ten", Outcome::LeftOut(180), any, |row, stamp| stamp - STEP * (row % 10) as i128);
    each("frozen from the middle on", Outcome::LeftOut(MIDDLE - 1), any, |row, stamp| {
        stamp - STEP * row.saturating_sub(MIDDLE) as i128
    });
}

#[test]
fn a_constant_timestamp_yields_to_log_time_or_there_is_no_channel() {
    for format in &FORMATS {
        for constant in [0, format.counter.begin, ONES] {
            let loaded = format.load(&[constant; ROWS]);
            if format.logged {
                let stamps = health(&loaded).stamps.as_ref().unwrap();
                assert_eq!((stamps.kind, stamps.source.as_str()), (StampKind::Logged, "log"), "{}", format.name);
                assert_eq!(samples(&loaded)[7], (logged(7).into(), 7), "{}", format.name);
                assert_eq!(count_of(&loaded, "stamp-kind"), 2 * ROWS as u64, "{}", format.name);
            } else {
                let reason = loaded.binding.unwrap_err();
                assert!(reason.contains("no timestamps"), "{}: {reason}", format.name);
            }
        }
    }
}

#[test]
fn a_clock_set_back_is_reported_and_its_stretches_are_not_mixed() {
    for back in [1, 1000, MS, 37 * MS, STEP, S, S + 37 * MS, 5 * S + MS, 60 * S, 3600 * S, DAY - 60 * S] {
        let case = format!("{back} ns back");
        let set_back = |row: usize, stamp| if row < MIDDLE { stamp } else { stamp - STEP - back };
        let fits = |f: &Format| back < f.counter.begin && back >= f.counter.quantum;
        // Telemetry also has receive times, which have no such step.
        let found = |f: &Format| f.kind == LogKind::Tlog && back > S;
        each(&case, Outcome::Reported("unreliable-stamps"), |f| fits(f) && !found(f), set_back);
        if FORMATS.iter().any(|f| fits(f) && found(f)) {
            each(&case, Outcome::Exact, |f| fits(f) && found(f), set_back);
        }
    }
    each(
        "two days back",
        Outcome::Half,
        |f| f.counter.begin > 3 * DAY,
        |row, stamp| stamp - if row < MIDDLE { 0 } else { 2 * DAY },
    );
    // UTC repeats the second in which a leap second is inserted.
    each(
        "leap second",
        Outcome::Reported("unreliable-stamps"),
        |f| f.counter.clock == Clock::Unix,
        |row, stamp| {
            if row < MIDDLE { stamp } else { stamp - S }
        },
    );
}

#[test]
fn a_clock_set_forward_leaves_a_gap_or_half_of_the_rows() {
    for forward in [S, 3600 * S] {
        each(&format!("{forward} ns forward"), Outcome::Gap, any, |row, stamp| {
            stamp + if row < MIDDLE { 0 } else { forward }
        });
    }
    each(
        "ten years forward",
        Outcome::Half,
        |f| f.counter.bits == 64,
        |row, stamp| stamp + if row < MIDDLE { 0 } else { 3652 * DAY },
    );
}

#[test]
fn single_rows_with_a_wrong_timestamp_are_rejected_and_counted() {
    let few = |row: usize| [30, 77, 140].contains(&row);
    for leap in [-3652 * DAY, -DAY, -3600 * S, -50 * S, -S - 37 * MS, -S, S, S + 37 * MS, 3600 * S, DAY, 3652 * DAY] {
        let fits = |f: &Format| (leap.abs() < f.counter.begin || leap > 0) && (f.counter.bits == 64 || leap < DAY);
        each(&format!("leaps of {leap} ns"), Outcome::LeftOut(3), fits, |row, stamp| {
            stamp + if few(row) { leap } else { 0 }
        });
    }
    each("zero", Outcome::LeftOut(3), any, |row, stamp| if few(row) { 0 } else { stamp });
    each("zero at first", Outcome::LeftOut(5), any, |row, stamp| if row < 5 { 0 } else { stamp });
    each("before the epoch", Outcome::LeftOut(3), |f| f.counter.signed, |row, stamp| if few(row) { -S } else { stamp });
    each("all ones", Outcome::LeftOut(3), any, |row, stamp| if few(row) { ONES } else { stamp });
}

/// As [`each`], for a log that begins at `begin` and whose timestamps wrap around after this many quanta.
fn each_counter(case: &str, outcome: Outcome, names: &[&str], begin: i128, range: i128) {
    for format in FORMATS.iter().filter(|f| names.contains(&f.name)) {
        let truth: Vec<i128> = (0..ROWS as i128).map(|i| begin + STEP * i).collect();
        let written: Vec<i128> = truth.iter().map(|stamp| stamp.rem_euclid(range)).collect();
        check(format, case, &written, &truth, outcome);
    }
}

#[test]
fn counters_wrap_around_or_cost_the_rows_beyond_their_end() {
    // Tables are tested in `time`.
    let micros = 1000 << 32;
    each_counter("32 bits of microseconds", Outcome::Exact, &["ulog", "dataflash"], micros - 10 * S, micros);
    each_counter("32 bits of milliseconds", Outcome::Exact, &["tlog"], (MS << 32) - 10 * S, MS << 32);
    // Seconds of 32 bits with a sign end in 2038, without in 2106, nanoseconds of 63 bits in 2262.
    for (name, begin) in [("mcap", S << 31), ("bag", S << 32)] {
        let format = FORMATS.iter().find(|f| f.name == name).unwrap();
        let truth: Vec<i128> = (0..ROWS as i128).map(|i| begin - 10 * S + STEP * i).collect();
        // The earlier half is 136 years away from the later, which contains the median.
        let late = if name == "mcap" { begin - (S << 32) } else { 0 };
        let read: Vec<i128> = truth.iter().map(|t| if *t < begin { *t } else { *t - begin + late }).collect();
        let loaded = format.load(&truth);
        assert!(samples(&loaded).iter().all(|(stamp, row)| *stamp == read[*row]), "{name}");
        assert_eq!(count_of(&loaded, "rejected-row"), MIDDLE as u64, "{name}");
    }
    let year_2038 = (S << 31) - 10 * S;
    each_counter("2038 without a sign", Outcome::Exact, &["bag", "csv of UTC"], year_2038, S << 40);
    let last = i128::from(i64::MAX) / STEP * STEP - 10 * S;
    each_counter(
        "2262",
        Outcome::LeftOut(MIDDLE - 1),
        &["csv of UTC", "csv since boot", "ulog", "dataflash"],
        last,
        S << 40,
    );
}

#[test]
fn header_and_log_times_are_compared_and_the_header_is_used() {
    for format in FORMATS.iter().filter(|f| f.map[1] == HEADER) {
        let offset = |spoil: fn(i128) -> i128| {
            let written: Vec<i128> =
                format.true_stamps().into_iter().map(|t| t - spoil(t - format.counter.begin)).collect();
            let loaded = format.load(&written);
            assert!(samples(&loaded).iter().all(|(stamp, row)| *stamp == written[*row]), "{}", format.name);
            let health = health(&loaded);
            assert_eq!(health.stamps.as_ref().unwrap().source, "header.stamp");
            (health.offsets[0].of, health.offsets[0].offset_s)
        };
        // The logger receives every row 0.25 s late.
        let (of, late) = offset(|_| 120 * MS);
        assert_eq!((of, late.min, late.max), (StampKind::Logged, 0.37, 0.37));
        // 50 ppm in 19.9 s.
        let (_, drift) = offset(|elapsed| elapsed * 50 / 1_000_000);
        assert!((drift.min - 0.25).abs() < 1e-9 && (drift.max - 0.25 - 19.9 * 50e-6).abs() < 1e-9, "{drift:?}");
    }
}

#[test]
fn log_times_at_the_end_of_64_bits_do_not_panic() {
    let mut sent = sent(&FORMATS[0].true_stamps());
    for (row, fix) in sent.iter_mut().enumerate() {
        fix.stamp_ns = 0;
        fix.logged_ns = if row % 50 == 7 { -1 } else { fix.logged_ns };
    }
    // Unsigned, minus one is the largest: the year 2554.
    let (_folder, path) = file("log", &made::mcap(&sent, Encoding::Cdr, Layout::PLAIN));
    let want = |_: &ingest::TopicInfo| ingest::Selection::All;
    let log = in_context(|context| made::read_at(path, false, &want, context)).unwrap();
    let stamps = log.tables[0].logged_ns.as_ref().unwrap();
    assert_eq!(stamps.iter().filter(|s| **s == i64::MAX).count(), 4);
}
