//! The content read from a log, as one line of text.

use flight::{ByteLedger, Severity, Stamp};
use ingest::{
    Column, ColumnData, FlightUnit, Limits, Loaded, Log, LogError, MapLibrary, ReadContext, Selection, Table, TopicInfo,
};
use std::sync::atomic::AtomicBool;

/// Runs `body` with the default limits.
pub fn in_context<T>(body: impl FnOnce(&ReadContext<'_>) -> T) -> T {
    let cancel = AtomicBool::new(false);
    body(&ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () })
}

/// The whole content of the log.
pub fn read(unit: &FlightUnit) -> Result<Log, LogError> {
    in_context(|context| ingest::read(unit, &|_: &TopicInfo| Selection::All, context))
}

/// Of an intact log a hash of all columns and one of all channels; of a damaged one how many rows and channels there are;
/// `refused` for what cannot be read.
pub fn fingerprint(unit: &FlightUnit) -> String {
    let Ok(log) = read(unit) else { return "refused".to_owned() };
    let library = MapLibrary::shipped().unwrap();
    let loaded = in_context(|context| ingest::load(unit, &library, None, context)).unwrap();
    for bytes in [&log.health.bytes, &loaded.health.bytes] {
        assert_eq!(bytes.sum(), bytes.size, "{}: {bytes:?}", unit.id);
    }
    if is_damaged(&log.health.bytes, log.health.damage_count) {
        assert!(log.notices.iter().any(|n| n.severity == Severity::Loss), "{}: damage but no loss reported", unit.id);
        let rows: usize = log.tables.iter().map(|table| table.rows).sum();
        return format!("damaged {rows} {}", loaded.flight.channels.len());
    }
    format!("{} {}", hash_of_log(&log), hash_of_flight(&loaded))
}

fn is_damaged(bytes: &ByteLedger, ranges: u64) -> bool {
    bytes.damaged > 0 || ranges > 0
}

/// Whether a fingerprint keeps what is frozen: all of an intact log, 99 % of the rows of a damaged one.
pub fn keeps(frozen: &str, found: &str) -> bool {
    let counts = |text: &str| -> Option<[u64; 2]> {
        let mut numbers = text.strip_prefix("damaged ")?.split(' ').map(|number| number.parse().unwrap());
        Some([numbers.next()?, numbers.next()?])
    };
    match (counts(frozen), counts(found)) {
        (Some([rows, channels]), Some([rows_now, channels_now])) => {
            100 * rows_now >= 99 * rows && channels_now >= channels
        }
        _ => frozen == found,
    }
}

struct Hash(blake3::Hasher);

impl Hash {
    fn text(&mut self, text: &str) {
        self.0.update(&(text.len() as u64).to_le_bytes());
        self.0.update(text.as_bytes());
    }

    fn words(&mut self, words: impl IntoIterator<Item = u64>) {
        let bytes: Vec<u8> = words.into_iter().flat_map(u64::to_le_bytes).collect();
        self.0.update(&(bytes.len() as u64).to_le_bytes());
        self.0.update(&bytes);
    }

    fn stamps(&mut self, stamps: &[Stamp]) {
        self.words(stamps.iter().map(|stamp| stamp.0 as u64));
    }

    fn end(&self) -> String {
        self.0.finalize().to_hex()[..16].to_owned()
    }
}

fn hash_of_log(log: &Log) -> String {
    let mut hash = Hash(blake3::Hasher::new());
    // Sentences may be rewritten: what was read stays the same.
    let mut health = log.health.clone();
    health.topics.iter_mut().for_each(|topic| topic.reason.clear());
    health.about.configured_delays.iter_mut().for_each(|delay| delay.meaning.clear());
    hash.text(&serde_json::to_string(&(&health.format, &health.bytes, health.messages, health.undecodable)).unwrap());
    hash.text(&serde_json::to_string(&(&health.topics, &health.extras, &health.about)).unwrap());
    hash.text(&serde_json::to_string(&(&log.units, &log.restarts)).unwrap());
    log.tables.iter().for_each(|table| hash_table(&mut hash, table));
    for (topic, column) in &log.written {
        hash.text(&topic.name);
        hash_column(&mut hash, column);
    }
    hash.end()
}

fn hash_table(hash: &mut Hash, table: &Table) {
    [&table.topic.name, &table.topic.type_name, &table.topic.encoding].into_iter().for_each(|text| hash.text(text));
    for times in [&table.logged_ns, &table.published_ns] {
        hash.words(times.iter().flatten().map(|ns| *ns as u64));
    }
    hash.words((0..table.rows).map(|row| table.origin_of(row)));
    table.columns.iter().for_each(|column| hash_column(hash, column));
}

fn hash_column(hash: &mut Hash, column: &Column) {
    hash.text(&column.path);
    match &column.data {
        ColumnData::F64(values) => hash.words(values.iter().map(|value| value.to_bits())),
        ColumnData::I64(values) => hash.words(values.iter().map(|value| *value as u64)),
        ColumnData::U64(values) => hash.words(values.iter().copied()),
        ColumnData::Text(values) => values.iter().for_each(|value| hash.text(value)),
    }
    hash.words(column.valid.iter().flatten().map(|valid| u64::from(*valid)));
}

fn hash_of_flight(loaded: &Loaded) -> String {
    let mut hash = Hash(blake3::Hasher::new());
    match &loaded.binding {
        Ok(binding) => {
            let mut channels = binding.channels.clone();
            for rejected in channels.iter_mut().map(|channel| &mut channel.rejected) {
                rejected.iter_mut().for_each(|reject| reject.reason.clear());
                rejected.sort_by(|a, b| (a.count, &a.first).cmp(&(b.count, &b.first)));
            }
            hash.text(&serde_json::to_string(&(&binding.map, &channels)).unwrap());
        }
        Err(_) => hash.text("not bound"),
    }
    hash.text(&serde_json::to_string(&loaded.flight.utc).unwrap());
    for (name, channel) in &loaded.flight.channels {
        hash.text(name);
        hash.stamps(channel.series.timeline().stamps());
        for values in channel.series.components() {
            hash.words(values.iter().map(|value| value.to_bits()));
        }
        hash.words(channel.present.iter().chain(&channel.held).map(|is| u64::from(*is)));
        channel.other_stamps.iter().for_each(|(.., stamps)| hash.stamps(stamps));
    }
    hash.end()
}
