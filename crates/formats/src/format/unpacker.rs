//! Chunks decompressed and checksummed by idle threads, some before the walk reaches them.
//!
//! Chunks prepared ahead do not change what is read: the walk examines every record itself, and uses a prepared chunk
//! only if it was made from the very bytes that it would decompress.

use crate::format::inflate::{Codec, Inflater};
use crate::format::workers::{Job, Outcome, Workers};
use logscan::{LogFile, ScanError, Source};
use std::collections::VecDeque;
use std::iter::Peekable;
use std::ops::Range;
use std::sync::Arc;

/// Chunks prepared ahead are no longer than this, packed and unpacked together, bytes.
const MOST_HELD: u64 = 8 << 20;
/// Chunks closer together than this take less time than handing them over, bytes.
const LEAST_APART: u64 = 1 << 10;
/// Most positions that are remembered.
pub(crate) const MOST_PLACES: usize = 1 << 20;

/// A chunk to be decompressed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Packed {
    /// The record, and the bytes that are examined together with it.
    pub(crate) fetched: Range<u64>,
    /// The compressed bytes, within it.
    pub(crate) data: Range<u64>,
    pub(crate) codec: Codec,
    /// Declared uncompressed size, bytes.
    pub(crate) declared: u64,
    /// Whether the content has a CRC-32.
    pub(crate) summed: bool,
}

/// Finds the chunk of a record at a position in the file, if there is one.
pub(crate) type Look = fn(&mut LogFile, u64) -> Result<Option<Packed>, ScanError>;

/// Content of a chunk, and what went wrong if it is not complete.
#[derive(Debug)]
pub(crate) struct Unpacked<'u> {
    pub(crate) bytes: &'u [u8],
    /// CRC-32 of these bytes, if requested.
    pub(crate) crc: u32,
    pub(crate) fault: Option<String>,
}

/// Decompresses the chunks of one file.
pub(crate) struct Unpacker {
    /// Most bytes that a chunk may decompress to.
    limit: u64,
    own: Bench,
    /// What was prepared of the chunk that the walk reached last. The walk's buffer is lent to it.
    ready: Option<Bench>,
    ahead: Option<Ahead>,
}

impl Unpacker {
    pub(crate) fn new(file: &LogFile, limit: u64) -> Unpacker {
        Unpacker { limit, own: Bench::new(file), ready: None, ahead: None }
    }

    /// From now on chunks expected at these positions may be decompressed ahead.
    pub(crate) fn expect(&mut self, mut places: Vec<u64>, look: Look) {
        places.sort_unstable();
        places.dedup_by(|next, place| *next - *place < LEAST_APART);
        let workers = if places.len() > 1 { Workers::available() } else { None };
        self.ahead = workers.map(|workers| Ahead {
            file: self.own.file.again(),
            places: places.into_iter().peekable(),
            look,
            limit: self.limit,
            workers,
            begun: VecDeque::new(),
            spare: vec![],
        });
    }

    /// Takes what was prepared for the record at `at`: `file` then holds its bytes.
    pub(crate) fn come_to(&mut self, at: u64, file: &mut LogFile) {
        let Some(ahead) = &mut self.ahead else { return };
        // The walk gets its own buffer back, which may be as long as its longest chunk.
        if let Some(mut last) = self.ready.take() {
            file.swap_buffer(&mut last.file);
            ahead.keep(last);
        }
        self.ready = ahead.take(at);
        if let Some(ready) = &mut self.ready {
            file.swap_buffer(&mut ready.file);
        }
        ahead.begin();
    }

    /// The content of a chunk; `None` if the file ends before the chunk does.
    pub(crate) fn unpack<'u>(
        &'u mut self,
        packed: &Packed,
        file: &'u mut LogFile,
    ) -> Result<Option<Unpacked<'u>>, ScanError> {
        let Some(data) = file.bytes(packed.data.start, (packed.data.end - packed.data.start) as usize)? else {
            return Ok(None);
        };
        let Bench { inflater, done, .. } = match &mut self.ready {
            Some(ready) if ready.has(packed) => ready,
            _ => &mut self.own,
        };
        let done = match done {
            Some(done) if done.packed == *packed => done,
            other => other.insert(Done::of(packed, data, inflater, self.limit)),
        };
        let bytes = inflater.inflated(packed.codec, data, done.length);
        Ok(Some(Unpacked { bytes, crc: done.crc, fault: done.fault.clone() }))
    }
}

/// Decompresses one chunk at a time and holds the last one.
struct Bench {
    inflater: Inflater,
    /// Reader of a thread: its buffer holds the bytes of the chunk.
    file: LogFile,
    done: Option<Done>,
}

/// A chunk that was decompressed: its content is in the [`Inflater`].
struct Done {
    packed: Packed,
    length: usize,
    crc: u32,
    fault: Option<String>,
}

impl Done {
    fn of(packed: &Packed, data: &[u8], inflater: &mut Inflater, limit: u64) -> Done {
        let inflated = inflater.inflate(packed.codec, data, packed.declared, limit);
        let crc = if packed.summed { crc32fast::hash(inflated.bytes) } else { 0 };
        Done { packed: packed.clone(), length: inflated.bytes.len(), crc, fault: inflated.fault }
    }
}

impl Bench {
    fn new(file: &LogFile) -> Bench {
        Bench { inflater: Inflater::default(), file: file.again(), done: None }
    }

    fn has(&self, packed: &Packed) -> bool {
        self.done.as_ref().is_some_and(|done| done.packed == *packed)
    }

    /// Size of its buffers, bytes.
    fn held(&self) -> u64 {
        (self.inflater.held() + self.file.held()) as u64
    }

    /// Decompresses the chunk at `at`, if there is one and it is not long. The walk handles what cannot be read.
    fn prepare(&mut self, at: u64, look: Look, limit: u64) {
        self.done = None;
        let Ok(Some(packed)) = look(&mut self.file, at) else { return };
        let Range { start, end } = packed.fetched;
        if (end - start).saturating_add(packed.declared) > MOST_HELD {
            return;
        }
        let Ok(Some(bytes)) = self.file.bytes(start, (end - start) as usize) else { return };
        let data = (packed.data.start - start) as usize..(packed.data.end - start) as usize;
        if let Some(data) = bytes.get(data) {
            self.done = Some(Done::of(&packed, data, &mut self.inflater, limit));
        }
    }
}

/// The chunks in progress.
struct Ahead {
    workers: Workers,
    file: LogFile,
    /// Chunks that no thread has begun.
    places: Peekable<std::vec::IntoIter<u64>>,
    look: Look,
    limit: u64,
    begun: VecDeque<(u64, Arc<Job<Bench>>)>,
    spare: Vec<Bench>,
}

impl Ahead {
    /// The result for the chunk at `at`. Earlier chunks will not be requested any more.
    fn take(&mut self, at: u64) -> Option<Bench> {
        while self.places.next_if(|&place| place <= at).is_some() {}
        while let Some((place, order)) = self.begun.pop_front_if(|(place, _)| *place <= at) {
            let bench = if place == at { order.wait() } else { order.withdraw() };
            match bench {
                Some(Outcome::Done(bench)) if bench.done.is_some() && place == at => return Some(bench),
                Some(Outcome::Open(bench) | Outcome::Done(bench)) => self.keep(bench),
                Some(Outcome::Failed(_)) | None => {}
            }
        }
        None
    }

    /// Prepares it for another chunk. Buffers that a long chunk has enlarged are released.
    fn keep(&mut self, mut bench: Bench) {
        if bench.held() <= MOST_HELD {
            bench.done = None;
            self.spare.push(bench);
        }
    }

    /// Gives the next chunks to idle threads.
    fn begin(&mut self) {
        while self.workers.has_capacity(self.begun.len())
            && let Some(place) = self.places.next()
        {
            let bench = self.spare.pop().unwrap_or_else(|| Bench::new(&self.file));
            let (look, limit) = (self.look, self.limit);
            let order = self.workers.begin(bench, move |bench| bench.prepare(place, look, limit));
            self.begun.push_back((place, order));
        }
    }
}

impl Drop for Ahead {
    fn drop(&mut self) {
        self.begun.drain(..).for_each(|(_, order)| drop(order.withdraw()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn file_of(content: &[u8]) -> (tempfile::NamedTempFile, LogFile) {
        let mut on_disk = tempfile::NamedTempFile::new().unwrap();
        on_disk.write_all(content).unwrap();
        let file = LogFile::open(on_disk.path()).unwrap();
        (on_disk, file)
    }

    const LENGTH: usize = 2000;

    /// Chunks with this many uncompressed bytes each, one after the other.
    fn look(_: &mut LogFile, at: u64) -> Result<Option<Packed>, ScanError> {
        let (place, declared) = (at..at + LENGTH as u64, LENGTH as u64);
        Ok(Some(Packed { fetched: place.clone(), data: place, codec: Codec::None, declared, summed: true }))
    }

    #[test]
    fn chunks_are_those_of_the_file_in_any_order_of_requests() {
        let content: Vec<u8> = (0..10 * LENGTH as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        for asked in [&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9][..], &[9, 0, 1], &[0, 0, 5, 5, 4, 9], &[3, 9]] {
            let (_on_disk, mut file) = file_of(&content);
            pool.install(|| {
                let mut unpacker = Unpacker::new(&file, u64::MAX);
                unpacker.expect((0..10).rev().map(|i| LENGTH as u64 * i).collect(), look);
                assert!(unpacker.ahead.is_some());
                for &number in asked {
                    let at = LENGTH * number;
                    unpacker.come_to(at as u64, &mut file);
                    let packed = look(&mut file, at as u64).unwrap().unwrap();
                    let unpacked = unpacker.unpack(&packed, &mut file).unwrap().unwrap();
                    let expected = &content[at..][..LENGTH];
                    assert_eq!((unpacked.bytes, unpacked.crc), (expected, crc32fast::hash(expected)));
                    // A different chunk at the same position is not accepted in its place.
                    let shorter = Packed { data: at as u64..at as u64 + 50, declared: 50, ..packed };
                    assert_eq!(unpacker.unpack(&shorter, &mut file).unwrap().unwrap().bytes, &expected[..50]);
                }
            });
        }
    }

    #[test]
    fn buffers_enlarged_by_a_long_chunk_are_released() {
        let long = MOST_HELD as usize;
        let (_on_disk, mut file) = file_of(&vec![7; 2 * LENGTH + long]);
        rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap().install(|| {
            let mut unpacker = Unpacker::new(&file, u64::MAX);
            unpacker.expect(vec![0, LENGTH as u64, 2 * LENGTH as u64], look);
            assert_eq!(file.bytes(2 * LENGTH as u64, long).unwrap().map(<[u8]>::len), Some(long));
            // The walk keeps its own long buffer, even when it takes prepared chunks.
            for at in [0, LENGTH as u64, 2 * LENGTH as u64] {
                unpacker.come_to(at, &mut file);
                let lent = unpacker.ready.iter().map(Bench::held).sum::<u64>();
                assert!(lent.max(file.held() as u64) >= MOST_HELD);
                let spare = unpacker.ahead.iter().flat_map(|ahead| &ahead.spare);
                assert!(spare.map(Bench::held).all(|held| held <= MOST_HELD));
            }
        });
    }

    #[test]
    fn long_chunks_are_left_to_the_walk_and_one_thread_prepares_nothing() {
        let (_on_disk, file) = file_of(&[7; 3 * LENGTH / 2]);
        let mut bench = Bench::new(&file);
        let long: Look =
            |file, at| Ok(look(file, at)?.map(|packed| Packed { declared: MOST_HELD, codec: Codec::Zstd, ..packed }));
        bench.prepare(0, long, u64::MAX);
        assert!(bench.done.is_none());
        bench.prepare(0, look, u64::MAX);
        assert!(bench.done.as_ref().is_some_and(|done| done.length == LENGTH));
        bench.prepare(LENGTH as u64, look, u64::MAX);
        assert!(bench.done.is_none());
        rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| {
            let mut unpacker = Unpacker::new(&file, 1000);
            unpacker.expect(vec![0, LENGTH as u64], look);
            assert!(unpacker.ahead.is_none());
        });
    }
}
