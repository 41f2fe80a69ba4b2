//! The least that reading a log with chunks costs: every chunk of an MCAP or ROS 1 bag read and decompressed, the
//! checksums of chunks and LZ4 frames checked, nothing more; of any other file, or with `read`, that it is read.
//!
//! `cargo run --release -p flightlag-ingest --example decompress_only FILE [read]` is the yardstick that `just perf` holds the
//! reader against.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

/// Chunks, and bytes in them.
type Sum = (u64, u64);

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: decompress_only FILE [read]")?;
    let only_read = std::env::args().nth(2).is_some();
    let mut file = File::open(&path)?;
    let mut magic = [0_u8; 13];
    read_at(&file, &mut magic, 0)?;
    file.rewind()?;
    let (chunks, bytes) = match &magic {
        _ if only_read => read(&mut file)?,
        m if m.starts_with(b"\x89MCAP0") => mcap(&file)?,
        m if m.starts_with(b"#ROSBAG V2.0\n") => bag(&file)?,
        _ => read(&mut file)?,
    };
    println!("{chunks} chunks, {bytes} bytes");
    Ok(())
}

fn read_at(mut file: &File, buffer: &mut [u8], offset: u64) -> std::io::Result<()> {
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(buffer)
}

fn read(file: &mut File) -> Result<Sum, Box<dyn Error>> {
    let mut buffer = vec![0; 256 << 10];
    let mut bytes = 0;
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok((0, bytes)),
            n => bytes += n as u64,
        }
    }
}

fn mcap(file: &File) -> Result<Sum, Box<dyn Error>> {
    let mut decoder = zstd::bulk::Decompressor::new()?;
    let (mut packed, mut plain) = (vec![], vec![]);
    let (mut offset, end) = (8_u64, file.metadata()?.len());
    let (mut chunks, mut bytes) = (0, 0);
    while offset + 9 <= end {
        let mut head = [0_u8; 9];
        read_at(file, &mut head, offset)?;
        let length = u64::from_le_bytes(head[1..9].try_into()?);
        if head[0] == 0x06 {
            packed.resize(length as usize, 0);
            read_at(file, &mut packed, offset + 9)?;
            let size = u64::from_le_bytes(packed[16..24].try_into()?) as usize;
            let crc = u32::from_le_bytes(packed[24..28].try_into()?);
            let name = u32::from_le_bytes(packed[28..32].try_into()?) as usize;
            let body = &packed[32 + name + 8..];
            plain.clear();
            match &packed[32..32 + name] {
                b"zstd" => {
                    plain.reserve(size);
                    decoder.decompress_to_buffer(body, &mut plain)?;
                }
                b"lz4" => lz4_frame(body, size, &mut plain)?,
                _ => plain.extend_from_slice(body),
            }
            if crc != 0 && crc32fast::hash(&plain) != crc {
                return Err(format!("chunk at byte {offset}: CRC").into());
            }
            chunks += 1;
            bytes += plain.len() as u64;
        }
        offset += 9 + length;
    }
    Ok((chunks, bytes))
}

/// Block by block into one buffer: the decoder of the `lz4` crate copies every byte three times.
fn lz4_frame(frame: &[u8], size: usize, plain: &mut Vec<u8>) -> Result<(), Box<dyn Error>> {
    plain.resize(size, 0);
    let has = |bit: u8| frame[4] >> bit & 1 == 1;
    let (mut at, mut filled) = (if has(3) { 15 } else { 7 }, 0);
    loop {
        let word = u32_at(frame, at)?;
        let block = &frame[at + 4..][..(word & 0x7fff_ffff) as usize];
        at += 4 + block.len() + if has(4) && word != 0 { 4 } else { 0 };
        let (before, after) = plain.split_at_mut(filled);
        filled += match word {
            0 => break,
            word if word >> 31 == 1 => {
                after[..block.len()].copy_from_slice(block);
                block.len()
            }
            _ => {
                let window = if has(5) { 0 } else { filled.min(64 << 10) };
                lz4_flex::block::decompress_into_with_dict(block, after, &before[filled - window..])?
            }
        };
    }
    if filled != size || has(2) && xxhash_rust::xxh32::xxh32(plain, 0) != u32_at(frame, at)? {
        return Err("an LZ4 frame is damaged".into());
    }
    Ok(())
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, Box<dyn Error>> {
    Ok(u32::from_le_bytes(bytes.get(at..at + 4).ok_or("cut")?.try_into()?))
}

fn bag(file: &File) -> Result<Sum, Box<dyn Error>> {
    let (mut packed, mut plain) = (vec![], vec![]);
    let (mut offset, end) = (13_u64, file.metadata()?.len());
    let (mut chunks, mut bytes) = (0, 0);
    while offset + 8 <= end {
        let mut length = [0_u8; 4];
        read_at(file, &mut length, offset)?;
        let mut header = vec![0; u32::from_le_bytes(length) as usize];
        read_at(file, &mut header, offset + 4)?;
        let data = offset + 4 + header.len() as u64;
        read_at(file, &mut length, data)?;
        let size = u32::from_le_bytes(length) as usize;
        let says = |field: &[u8]| header.windows(field.len()).any(|w| w == field);
        if says(b"op=\x05") {
            packed.resize(size, 0);
            read_at(file, &mut packed, data + 4)?;
            plain.clear();
            if says(b"compression=lz4") {
                let field = header.windows(5).position(|w| w == b"size=").ok_or("a chunk without a size")?;
                lz4_frame(&packed, u32_at(&header, field + 5)? as usize, &mut plain)?;
            } else if says(b"compression=bz2") {
                bzip2::read::BzDecoder::new(packed.as_slice()).read_to_end(&mut plain)?;
            } else {
                plain.extend_from_slice(&packed);
            }
            chunks += 1;
            bytes += plain.len() as u64;
        }
        offset = data + 4 + size as u64;
    }
    Ok((chunks, bytes))
}
