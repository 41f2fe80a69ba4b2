//! Chunks decompressed into one reused buffer, never beyond their declared size.

mod lz4_frame;

pub(crate) use lz4_frame::SKIPPABLE as SKIPPABLE_LZ4;

use std::io::Read;

/// A buffer up to this size is allocated in one go; a larger one grows with the output, so that a
/// few bytes that declare a huge size do not get the memory.
const AT_ONCE: usize = 16 << 20;

/// Compression of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Codec {
    None,
    Zstd,
    /// The LZ4 frame format, blocks independent or linked.
    Lz4,
    Bz2,
}

/// The output, and what went wrong if it is not all that was declared.
#[derive(Debug)]
pub(crate) struct Inflated<'b> {
    pub(crate) bytes: &'b [u8],
    pub(crate) fault: Option<String>,
}

/// First bytes of an individually compressed message (RFC 8878, 3.1.1). No CDR message starts with these: its first
/// two bytes name a representation.
const ZSTD: &[u8] = b"\x28\xb5\x2f\xfd";

/// Whether a message of a ROS 2 bag was compressed individually.
pub(crate) fn is_packed(message: &[u8]) -> bool {
    message.starts_with(ZSTD)
}

/// Decoder contexts and the output buffer.
#[derive(Default)]
pub(crate) struct Inflater {
    zstd: Option<zstd::bulk::Decompressor<'static>>,
    out: Vec<u8>,
}

impl Inflater {
    /// Decompresses `data`, with a declared size of `declared` bytes. A size above `limit` is rejected.
    pub(crate) fn inflate<'b>(&'b mut self, codec: Codec, data: &'b [u8], declared: u64, limit: u64) -> Inflated<'b> {
        if declared > limit {
            let fault = format!("a chunk of {declared} bytes is larger than the limit of {limit}");
            return Inflated { bytes: &[], fault: Some(fault) };
        }
        let declared = declared as usize;
        let (bytes, fault) = match codec {
            Codec::None => (data, None),
            Codec::Zstd => self.zstd(data, declared),
            Codec::Lz4 => self.lz4(data, declared),
            Codec::Bz2 => self.bz2(data, declared),
        };
        let wrong_length = || format!("the chunk holds {} bytes, but declares {declared}", bytes.len());
        let fault = fault.or_else(|| (bytes.len() != declared).then(wrong_length));
        Inflated { bytes, fault }
    }

    /// Memory of the buffer, bytes.
    pub(crate) fn held(&self) -> usize {
        self.out.capacity()
    }

    /// The first `length` bytes of the last output of [`Inflater::inflate`], of the same codec and data.
    pub(crate) fn inflated<'b>(&'b self, codec: Codec, data: &'b [u8], length: usize) -> &'b [u8] {
        let from = if codec == Codec::None { data } else { self.out.as_slice() };
        from.get(..length).unwrap_or_default()
    }

    /// An individually compressed message (`compression_mode: MESSAGE`). Its frame states its length, because rosbag2
    /// writes it in one piece.
    pub(crate) fn message<'b>(&'b mut self, data: &'b [u8], limit: u64) -> Result<&'b [u8], String> {
        let declared = match zstd::zstd_safe::get_frame_content_size(data) {
            Ok(Some(bytes)) => bytes,
            Ok(None) => return Err("zstd: the frame does not state the length of its content".to_owned()),
            Err(_) => return Err("zstd: the header of the frame is damaged".to_owned()),
        };
        let inflated = self.inflate(Codec::Zstd, data, declared, limit);
        inflated.fault.map_or(Ok(inflated.bytes), Err)
    }

    /// Straight into the buffer, which is also the window: no frame can demand more memory.
    fn zstd(&mut self, data: &[u8], declared: usize) -> (&[u8], Option<String>) {
        let mut room = declared.min(AT_ONCE.max(data.len().saturating_mul(4)).max(self.out.len()));
        loop {
            if self.out.len() < room {
                self.out.resize(room, 0);
            }
            let out = self.out.get_mut(..room).unwrap_or_default();
            let result = match &mut self.zstd {
                Some(context) => context.decompress_to_buffer(data, out),
                None => zstd::bulk::Decompressor::new()
                    .and_then(|new| self.zstd.insert(new).decompress_to_buffer(data, out)),
            };
            match result {
                Ok(filled) => return (self.out.get(..filled).unwrap_or_default(), None),
                Err(_) if room < declared => room = declared.min(room.saturating_mul(4)),
                Err(e) => return (&[], Some(zstd_fault(&e.to_string(), declared))),
            }
        }
    }

    fn lz4(&mut self, data: &[u8], declared: usize) -> (&[u8], Option<String>) {
        let (filled, fault) = lz4_frame::decode(data, declared, AT_ONCE, &mut self.out);
        let fault = fault.map(|fault| format!("the LZ4 data are truncated or damaged ({fault})"));
        (self.out.get(..filled).unwrap_or_default(), fault)
    }

    fn bz2(&mut self, data: &[u8], declared: usize) -> (&[u8], Option<String>) {
        let mut from = bzip2::bufread::BzDecoder::new(data);
        let mut filled = 0;
        let mut fault = None;
        // One byte more than declared, so that the decoder reaches its end mark and checksum.
        while filled <= declared {
            let room = (declared + 1).min(AT_ONCE.max(filled.saturating_mul(2)));
            if self.out.len() < room {
                self.out.resize(room, 0);
            }
            match from.read(self.out.get_mut(filled..room).unwrap_or_default()) {
                Ok(0) => break,
                Ok(more) => filled += more,
                Err(e) => {
                    fault = Some(format!("the bzip2 data are truncated or damaged (decoder: {e})"));
                    break;
                }
            }
        }
        let behind = data.len() as u64 - from.total_in().min(data.len() as u64);
        let all_came = filled == declared && fault.is_none();
        let fault = fault.or_else(|| (all_came && behind > 0).then(|| format!("{behind} bytes follow the bzip2 data")));
        (self.out.get(..filled).unwrap_or_default(), fault)
    }
}

/// The meaning of an error, from the library's texts (`ZSTD_getErrorString` in its `error_private.c`).
fn zstd_fault(error: &str, declared: usize) -> String {
    match error {
        "Destination buffer is too small" => {
            format!("the zstd data hold more than the declared {declared} bytes, or are damaged")
        }
        "Src size is incorrect" => format!("the zstd data are truncated (decoder: {error})"),
        "Data corruption detected" | "Restored data doesn't match checksum" | "Unknown frame descriptor" => {
            format!("the zstd data are damaged (decoder: {error})")
        }
        _ => format!("the zstd data cannot be unpacked (decoder: {error})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    const LIMIT: u64 = 256 << 20;

    fn packed(codec: Codec, content: &[u8]) -> Vec<u8> {
        match codec {
            Codec::None => content.to_vec(),
            Codec::Zstd => zstd::bulk::compress(content, 1).unwrap(),
            Codec::Lz4 => {
                let mut encoder = lz4::EncoderBuilder::new().build(vec![]).unwrap();
                encoder.write_all(content).unwrap();
                encoder.finish().0
            }
            Codec::Bz2 => {
                let mut encoder = bzip2::write::BzEncoder::new(vec![], bzip2::Compression::best());
                encoder.write_all(content).unwrap();
                encoder.finish().unwrap()
            }
        }
    }

    #[test]
    fn every_codec_round_trips_through_one_inflater() {
        let contents =
            [vec![], vec![7; 3], (0..300_000_u32).flat_map(|i| i.wrapping_mul(i).to_le_bytes()).collect::<Vec<u8>>()];
        let mut inflater = Inflater::default();
        for codec in [Codec::None, Codec::Zstd, Codec::Lz4, Codec::Bz2] {
            for content in contents.iter().chain(&contents) {
                let data = packed(codec, content);
                let inflated = inflater.inflate(codec, &data, content.len() as u64, LIMIT);
                assert_eq!(inflated.fault, None, "{codec:?}");
                assert!(inflated.bytes == content, "{codec:?}");
            }
        }
    }

    #[test]
    fn a_chunk_with_a_false_size_is_a_fault_and_takes_little_memory() {
        let zeros = vec![0; 40 << 20];
        for codec in [Codec::Zstd, Codec::Lz4, Codec::Bz2] {
            let data = packed(codec, &zeros);
            for declared in [0, 100, zeros.len() as u64 - 1, zeros.len() as u64 + 1, LIMIT, LIMIT + 1, u64::MAX] {
                let mut inflater = Inflater::default();
                assert!(inflater.inflate(codec, &data, declared, LIMIT).fault.is_some(), "{codec:?} {declared}");
                if declared <= 100 || declared > LIMIT {
                    assert!(inflater.out.capacity() < 1000, "{codec:?} {declared}: {}", inflater.out.capacity());
                }
            }
            assert_eq!(Inflater::default().inflate(codec, &data, zeros.len() as u64, LIMIT).fault, None);
        }
    }

    #[test]
    fn a_truncated_stream_returns_its_intact_start_and_a_fault() {
        let content: Vec<u8> = (0..2_000_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 28) as u8).collect();
        for codec in [Codec::Lz4, Codec::Bz2] {
            let data = packed(codec, &content);
            let mut inflater = Inflater::default();
            let inflated = inflater.inflate(codec, &data[..data.len() * 3 / 4], content.len() as u64, LIMIT);
            assert!(inflated.fault.is_some());
            assert!(inflated.bytes.len() > content.len() / 4, "{codec:?} {}", inflated.bytes.len());
            assert!(content.starts_with(inflated.bytes));
        }
    }

    #[test]
    fn a_zstd_fault_says_whether_the_data_are_truncated_corrupt_or_too_long() {
        let content: Vec<u8> = (0..100_000_u32).flat_map(|i| i.wrapping_mul(i).to_le_bytes()).collect();
        let mut encoder = zstd::stream::Encoder::new(vec![], 1).unwrap();
        encoder.include_checksum(true).unwrap();
        encoder.write_all(&content).unwrap();
        let good = encoder.finish().unwrap();
        let fault = |data: &[u8], declared: usize| {
            Inflater::default().inflate(Codec::Zstd, data, declared as u64, LIMIT).fault.unwrap()
        };
        let mut wrong = good.clone();
        wrong[good.len() - 1] ^= 1;
        let damaged = fault(&wrong, content.len());
        assert!(damaged.starts_with("the zstd data are damaged (decoder: "), "{damaged}");
        let cut = fault(&good[..good.len() / 2], content.len());
        assert!(cut.starts_with("the zstd data are truncated (decoder: "), "{cut}");
        assert_eq!(fault(&good, 1000), "the zstd data hold more than the declared 1000 bytes, or are damaged");
    }

    #[test]
    fn a_wrong_lz4_checksum_is_a_fault() {
        let mut encoder =
            lz4::EncoderBuilder::new().checksum(lz4::ContentChecksum::ChecksumEnabled).build(vec![]).unwrap();
        encoder.write_all(&[1, 2, 3, 4, 5, 6, 7, 8]).unwrap();
        let mut data = encoder.finish().0;
        assert_eq!(Inflater::default().inflate(Codec::Lz4, &data, 8, LIMIT).fault, None);
        let last = data.len() - 1;
        data[last] ^= 1;
        assert!(Inflater::default().inflate(Codec::Lz4, &data, 8, LIMIT).fault.is_some());
    }
}
