//! Reads bytes while measuring time and memory.

use ingest::{
    Column, ColumnData, FlightUnit, Limits, Log, LogError, LogKind, ReadContext, Select, Selection, Table, TopicInfo,
};
use peak_alloc::PeakAlloc;
use simulate::{Container, Seed};
use std::fs::File;
use std::io::{Seek, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Memory is counted for the whole process, so that one lab is open at a time.
static DOOR: Mutex<()> = Mutex::new(());

/// As the catalogue of faults has it (T4).
const MEMORY_BYTES: usize = 64 << 20;

/// Reads one log after the other.
pub struct Lab {
    folder: tempfile::TempDir,
    /// The slowest reading so far.
    pub slowest: Duration,
    /// Readings so far.
    pub cases: u64,
    /// For all reads.
    pub limits: Limits,
    /// Memory that reading may take in addition to four times the file, bytes.
    pub memory: usize,
    _alone: MutexGuard<'static, ()>,
}

impl Lab {
    pub fn new() -> Lab {
        let alone = DOOR.lock().unwrap_or_else(PoisonError::into_inner);
        let shared = Path::new("/dev/shm");
        let folder = if shared.is_dir() { tempfile::tempdir_in(shared) } else { tempfile::tempdir() };
        let limits = Limits::default();
        Lab { folder: folder.unwrap(), slowest: Duration::ZERO, cases: 0, limits, memory: MEMORY_BYTES, _alone: alone }
    }

    /// A log of one file.
    pub fn single(&self, kind: LogKind, name: &str) -> Subject {
        self.subject(kind, &[(name, &[])], 0)
    }

    /// The files of a log, and the number of the one that will be damaged.
    pub fn subject(&self, kind: LogKind, files: &[(&str, &[u8])], damaged: usize) -> Subject {
        let mut paths = vec![];
        for (name, bytes) in files {
            let path = self.folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, bytes).unwrap();
            paths.push(path);
        }
        let file = File::options().write(true).open(&paths[damaged]).unwrap();
        let others = files.iter().enumerate().filter(|(i, _)| *i != damaged).map(|(_, f)| f.1.len() as u64).sum();
        Subject { unit: FlightUnit { id: "lab".into(), files: paths, kind }, file, others }
    }

    /// A seed, whose file of this number will be damaged.
    pub fn seed(&self, seed: &Seed, damaged: usize) -> Subject {
        let files: Vec<(&str, &[u8])> = seed.files.iter().map(|f| (f.path.to_str().unwrap(), &f.bytes[..])).collect();
        self.subject(kind_of(seed.container), &files, damaged)
    }

    /// As [`Lab::seed`], with its content before damage.
    pub fn intact(&mut self, seed: &Seed, damaged: usize) -> (Subject, Log) {
        let subject = self.seed(seed, damaged);
        let log = self.read(&subject, &seed.files[damaged].bytes, seed.name).unwrap();
        (subject, log)
    }

    /// Reads the whole log with `bytes` in the damaged file.
    ///
    /// # Panics
    /// If reading panics, loses count of the bytes, lists damage without end or takes too much memory.
    pub fn read(&mut self, subject: &Subject, bytes: &[u8], case: &str) -> Result<Log, LogError> {
        self.read_some(subject, bytes, case, &|_: &TopicInfo| Selection::All)
    }

    /// As [`Lab::read`], for the wanted topics only.
    pub fn read_some(
        &mut self,
        subject: &Subject,
        bytes: &[u8],
        case: &str,
        want: &dyn Select,
    ) -> Result<Log, LogError> {
        self.stretched(subject, bytes, bytes.len() as u64, case, want)
    }

    /// As [`Lab::read_some`], for a sparse file: zeros follow the bytes up to `size`.
    pub fn stretched(
        &mut self,
        subject: &Subject,
        bytes: &[u8],
        size: u64,
        case: &str,
        want: &dyn Select,
    ) -> Result<Log, LogError> {
        subject.file.set_len(0).unwrap();
        let mut file = &subject.file;
        file.rewind().unwrap();
        file.write_all(bytes).unwrap();
        subject.file.set_len(size).unwrap();
        let cancel = AtomicBool::new(false);
        let context = ReadContext { limits: self.limits, cancel: &cancel, on_bytes: &|_| () };
        MEMORY.reset_peak_usage();
        let before = MEMORY.current_usage();
        let start = Instant::now();
        let read = catch_unwind(AssertUnwindSafe(|| ingest::read(&subject.unit, want, &context)));
        self.slowest = self.slowest.max(start.elapsed());
        self.cases += 1;
        let Ok(read) = read else { panic!("{case}: reading panics") };
        let peak = MEMORY.peak_usage().saturating_sub(before);
        // The output does not count, nor does the spare capacity of growing columns.
        let columns = read.as_ref().map_or(0, |log| log.tables.iter().map(bytes_of).sum());
        let most = self.memory + 4 * bytes.len() + 2 * columns;
        assert!(peak <= most, "{case}: {peak} bytes of memory for {} of log", bytes.len());
        if let Ok(log) = &read {
            let b = &log.health.bytes;
            assert_eq!(b.sum(), b.size, "{case}: {b:?}");
            let packed = log.health.format.contains(", in ");
            assert!(packed || b.size == size + subject.others, "{case}: {b:?}");
            assert!(log.health.damage.len() <= self.limits.listed_damage, "{case}: the damage list is unbounded");
        }
        read
    }
}

/// A log on disk with one file that is rewritten for each case.
pub struct Subject {
    unit: FlightUnit,
    file: File,
    /// Bytes of the other files.
    others: u64,
}

/// Seeds with this name prefix.
pub fn seeds(family: &str) -> Vec<Seed> {
    let seeds: Vec<Seed> = simulate::seeds().unwrap().into_iter().filter(|s| s.name.starts_with(family)).collect();
    assert!(!seeds.is_empty(), "{family}");
    seeds
}

/// Every file of the seeds of a family, by its seed and its number.
pub fn each_file(family: &str, check: impl Fn(&Seed, usize)) {
    for seed in seeds(family) {
        (0..seed.files.len()).for_each(|damaged| check(&seed, damaged));
    }
}

/// Two tests of each format: one that tries every n-th offset of its seeds, in the normal suite, and one of all
/// places, which are so far apart. The called function gets the family and the step.
macro_rules! of_each_format {
    ($check:expr, $all_step:literal, $why:literal: $($name:ident $family:literal $step:literal $all:ident,)*) => {$(
        #[test]
        fn $name() {
            $check($family, $step);
        }

        #[test]
        #[ignore = $why]
        fn $all() {
            $check($family, $all_step);
        }
    )*};
}

pub(crate) use of_each_format;

/// The reader of a container.
pub fn kind_of(container: Container) -> LogKind {
    match container {
        Container::CsvWide | Container::CsvFolder => LogKind::Csv,
        Container::Mcap(_) => LogKind::Mcap,
        Container::Bag(_) => LogKind::Bag,
        Container::Ulog => LogKind::Ulog,
        Container::DataFlash | Container::DataFlashText => LogKind::DataFlash,
        Container::Db3(_) => LogKind::Db3,
        Container::Nmea => LogKind::Nmea,
        Container::Ubx => LogKind::Ubx,
        Container::Tlog => LogKind::Tlog,
    }
}

/// Memory of the process that is resident, C libraries and all, above what it was, bytes.
pub fn resident<T>(work: impl FnOnce() -> T) -> (T, u64) {
    let status = |key: &str| -> u64 {
        let text = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = text.lines().find(|line| line.starts_with(key)).unwrap();
        line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() << 10
    };
    // 5 makes the high-water mark the present size (proc(5)).
    std::fs::write("/proc/self/clear_refs", "5").unwrap();
    let before = status("VmRSS");
    let result = work();
    (result, status("VmHWM").saturating_sub(before))
}

/// Memory of the columns of a table without what texts hold.
fn bytes_of(table: &Table) -> usize {
    let cell = |column: &Column| match column.data {
        ColumnData::Text(_) => size_of::<u64>() + 2,
        ColumnData::F64(_) | ColumnData::I64(_) | ColumnData::U64(_) => size_of::<f64>() + 1,
    };
    table.columns.iter().map(|column| cell(column) * table.rows).sum()
}
