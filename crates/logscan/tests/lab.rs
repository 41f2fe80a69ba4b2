//! The guarantees of the scan, shown on a made-up format: two kinds of frames, one with a checksum and one without.

use flight::{LogHealth, Notices};
use logscan::{Fate, Framing, Ledger, Limits, LogFile, Parsed, ReadContext, ScanError, Scanned, Source, Trust, scan};
use std::borrow::Cow;
use std::cell::Cell;
use std::io::Write;
use std::sync::atomic::AtomicBool;

const SYNC: u8 = 0xa5;
/// Kinds: verified by the sum of its payload, or not at all.
const SUMMED: u8 = 1;
const SHAPED: u8 = 2;
const HEAD: usize = 3;
const START: &[u8] = b"TOYLOG01";

/// Keeps the frames that are taken, with their position in the file.
#[derive(Default)]
struct Toy {
    frames: Vec<(u64, Vec<u8>)>,
    logs: usize,
    breaks: usize,
    parsed: Cell<u64>,
}

impl Framing for Toy {
    const START: &'static [u8] = START;
    const PADDED: bool = true;

    fn longest(&self) -> usize {
        HEAD + 256
    }

    fn parse(&self, bytes: &[u8]) -> Parsed {
        self.parsed.set(self.parsed.get() + 1);
        if bytes.starts_with(START) {
            return Parsed::Frame(START.len(), Trust::Proven);
        }
        match *bytes {
            [SYNC, kind @ (SUMMED | SHAPED), length, ..] => {
                let end = HEAD + usize::from(length);
                match bytes.get(HEAD..end) {
                    None => Parsed::Cut,
                    Some(_) if kind == SHAPED => Parsed::Frame(end, Trust::Shape),
                    Some([payload @ .., sum]) if sum_of(payload) == *sum => Parsed::Frame(end, Trust::Proven),
                    Some(_) => Parsed::Not(end),
                }
            }
            [SYNC] | [SYNC, SUMMED | SHAPED] => Parsed::Cut,
            _ => Parsed::Not(1),
        }
    }

    fn begins(&self, bytes: &[u8]) -> bool {
        bytes.starts_with(&[SYNC, SUMMED]) || bytes.starts_with(&[SYNC, SHAPED]) || bytes.starts_with(START)
    }

    fn candidate(&self, block: &[u8], from: usize) -> Option<usize> {
        memchr::memchr2(SYNC, START[0], block.get(from..)?).map(|at| from + at)
    }

    fn length(&self, bytes: &[u8]) -> Option<usize> {
        bytes.starts_with(&[SYNC]).then(|| HEAD + usize::from(bytes.get(2).copied().unwrap_or_default()))
    }

    fn take(&mut self, frame: &[u8], _: &[u8], at: u64) -> Result<Fate, Cow<'static, str>> {
        if frame == START {
            self.logs += 1;
            return Ok(Fate::Structure);
        }
        self.frames.push((at, frame.to_vec()));
        Ok(Fate::Decoded)
    }

    fn fault(&self, _: &[u8]) -> Cow<'static, str> {
        "not a frame".into()
    }

    fn is_preamble(&self, bytes: &[u8]) -> bool {
        logscan::is_plain(bytes)
    }

    fn breaks(&mut self) {
        self.breaks += 1;
    }
}

fn sum_of(payload: &[u8]) -> u8 {
    payload.iter().fold(7, |sum: u8, b| sum.rotate_left(1).wrapping_add(*b))
}

fn frame(kind: u8, payload: &[u8]) -> Vec<u8> {
    let mut body = payload.to_vec();
    if kind == SUMMED {
        body.push(sum_of(payload));
    }
    [&[SYNC, kind, body.len() as u8][..], &body].concat()
}

fn noise(seed: usize, count: usize) -> Vec<u8> {
    let mut state = seed as u64 + 1;
    let next = |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u8
    };
    (0..count).map(next).collect()
}

/// Frames of both kinds. No payload contains the first byte of a frame or of a log.
fn log(frames: usize) -> Vec<u8> {
    let payload = |i: usize| noise(i, 10 + i % 90).into_iter().map(|b| b & 0x1f).collect::<Vec<u8>>();
    (0..frames).flat_map(|i| frame(if i % 3 == 0 { SUMMED } else { SHAPED }, &payload(i))).collect()
}

/// The result of scanning a file of these bytes; checks that its ledger adds up.
fn scanned(bytes: &[u8]) -> (Toy, LogHealth, Scanned) {
    let mut on_disk = tempfile::NamedTempFile::new().unwrap();
    on_disk.write_all(bytes).unwrap();
    let mut file = LogFile::open(on_disk.path()).unwrap();
    scanned_file(&mut file, &AtomicBool::new(false)).unwrap()
}

fn scanned_file(file: &mut LogFile, cancel: &AtomicBool) -> Result<(Toy, LogHealth, Scanned), ScanError> {
    let context = ReadContext { limits: Limits::default(), cancel, on_bytes: &|_| () };
    let (mut toy, mut ledger) = (Toy::default(), Ledger::new(file.size(), 100));
    let found = scan(file, &mut ledger, &context, &mut toy)?;
    let mut health = LogHealth::default();
    ledger.finish(&mut health, &mut Notices::new());
    assert_eq!(health.bytes.sum(), health.bytes.size, "{:?}", health.bytes);
    Ok((toy, health, found))
}

#[test]
fn every_frame_of_an_intact_file_is_taken() {
    let bytes = log(20_000);
    let (toy, health, _) = scanned(&bytes);
    assert_eq!((toy.frames.len(), toy.breaks), (20_000, 0));
    assert_eq!((health.bytes.decoded, health.damage_count), (bytes.len() as u64, 0));
    assert!(toy.parsed.get() < 21_000, "{} examinations of 20000 frames", toy.parsed.get());
}

#[test]
fn damage_costs_the_frames_it_touches_and_at_most_one_before() {
    let bytes = log(1000);
    let truth = scanned(&bytes).0.frames;
    for (case, at) in (0..100).map(|i| (i, 100 + i * (bytes.len() - 2000) / 100)) {
        let (what, hurt, lost) = match case % 4 {
            0 => ("zeros", [&bytes[..at], &[0; 300], &bytes[at + 300..]].concat(), at..at + 300),
            1 => ("noise", [&bytes[..at], &noise(at, 700), &bytes[at + 700..]].concat(), at..at + 700),
            2 => ("a hole", [&bytes[..at], &bytes[at + 50..]].concat(), at..at + 50),
            _ => ("a byte", [&bytes[..at], &[bytes[at] ^ 0xff], &bytes[at + 1..]].concat(), at..at + 1),
        };
        let shift = bytes.len() - hurt.len();
        let (toy, health, _) = scanned(&hurt);
        let touched = |(start, frame): &(u64, Vec<u8>)| {
            (*start as usize) < lost.end && *start as usize + frame.len() > lost.start
        };
        let place = |found: &(u64, Vec<u8>)| {
            let at = found.0 as usize;
            (if at >= lost.start { at + shift } else { at }, found.1.clone())
        };
        let found: Vec<(usize, Vec<u8>)> = toy.frames.iter().map(place).collect();
        let kept = |frame: &(u64, Vec<u8>)| found.contains(&(frame.0 as usize, frame.1.clone()));
        let missing = truth.iter().filter(|frame| !touched(frame) && !kept(frame)).count();
        assert!(missing <= 1, "{what} at {at}: {missing} untouched frames are missing");
        // A wrong byte within a frame without a sum is not detectable; damage may merge two frames into one.
        let foreign = found.iter().filter(|(at, frame)| !truth.contains(&(*at as u64, frame.clone())));
        let (inside, outside): (Vec<_>, Vec<_>) =
            foreign.partition(|(at, frame)| touched(&(*at as u64, frame.clone())));
        assert_eq!(outside.len(), 0, "{what} at {at}: frames that do not exist");
        assert!(inside.len() == 1 || health.damage_count > 0, "{what} at {at}: no damage is reported");
    }
}

#[test]
fn a_truncated_last_frame_is_a_cut_tail() {
    let bytes = log(3000);
    let whole = scanned(&bytes).0.frames.len();
    let (toy, health, _) = scanned(&bytes[..bytes.len() - 5]);
    assert_eq!((toy.frames.len(), health.damage_count), (whole - 1, 0));
    assert!(health.bytes.tail_cut > 0);
}

#[test]
fn leading_text_and_trailing_padding_are_not_damage() {
    let text = b"booting\r\n";
    for filling in [0, 0xff] {
        let bytes = [&text[..], &log(50), &[filling; 5000]].concat();
        let (toy, health, found) = scanned(&bytes);
        assert_eq!((toy.frames.len(), health.damage_count), (50, 0));
        assert_eq!(found, Scanned { preamble: text.len() as u64, padding: 5000 });
    }
}

#[test]
fn a_log_after_a_truncated_one_is_found_and_no_frame_spans_both() {
    let first = [START, &log(40)].concat();
    let second = [START, &log(40)].concat();
    for cut in first.len() - 200..first.len() {
        let (toy, _, _) = scanned(&[&first[..cut], &second].concat());
        assert_eq!(toy.logs, 2, "cut at {cut}");
        assert!(toy.frames.iter().all(|(_, frame)| !frame.windows(START.len()).any(|w| w == START)));
        let of_second = toy.frames.iter().filter(|(at, _)| *at as usize >= cut).count();
        assert_eq!(of_second, 40, "cut at {cut}");
    }
}

#[test]
fn a_wrong_length_that_ends_at_a_frame_start_swallows_no_frames() {
    let frames: Vec<Vec<u8>> =
        (0..20).map(|i| frame(SHAPED, &noise(i, 20).iter().map(|b| b & 0x1f).collect::<Vec<u8>>())).collect();
    let mut lie = frames.clone();
    // Over two more.
    lie[5][2] += 2 * frames[6].len() as u8;
    let (toy, health, _) = scanned(&lie.concat());
    let found: Vec<&Vec<u8>> = toy.frames.iter().map(|(_, frame)| frame).collect();
    assert!(frames[6..].iter().all(|frame| found.contains(&frame)) && health.damage_count == 1);
    assert_eq!(found.len(), 19);
}

#[test]
fn false_starts_cost_a_small_multiple_of_the_file() {
    // Every third byte starts a frame of the longest kind with a wrong sum.
    let hostile = [SYNC, SUMMED, 255].repeat(1 << 20);
    let (toy, health, _) = scanned(&[log(5), hostile].concat());
    assert_eq!(toy.frames.len(), 5);
    assert!(health.damage_count > 0);
    assert!(toy.parsed.get() < 1 << 20, "{} positions were examined", toy.parsed.get());
}

#[test]
fn a_sparse_file_is_not_read_to_its_end() {
    let mut on_disk = tempfile::NamedTempFile::new().unwrap();
    on_disk.write_all(&log(50)).unwrap();
    on_disk.as_file().set_len(100 << 30).unwrap();
    let mut file = LogFile::open(on_disk.path()).unwrap();
    let (toy, health, _) = scanned_file(&mut file, &AtomicBool::new(false)).unwrap();
    assert!(toy.frames.len() >= 49 && health.bytes.damaged > 99 << 30);
}

#[test]
fn a_stop_request_is_honoured() {
    let mut on_disk = tempfile::NamedTempFile::new().unwrap();
    on_disk.write_all(&log(100_000)).unwrap();
    let mut file = LogFile::open(on_disk.path()).unwrap();
    assert!(matches!(scanned_file(&mut file, &AtomicBool::new(true)), Err(ScanError::Cancelled)));
}
