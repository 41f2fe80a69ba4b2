//! The least that reading a log with chunks costs: every chunk of an MCAP or ROS 1 bag read and decompressed, the CRC of
//! an MCAP's checked, nothing more; of any other file, that it is read.
//!
//! `cargo run --release -p ingest --example decompress_only FILE` is the yardstick that `just perf` holds the reader against.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::fs::File;
use std::io::Read;
use std::os::unix::fs::FileExt;

/// Chunks, and bytes in them.
type Sum = (u64, u64);

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: decompress_only FILE")?;
    let mut file = File::open(&path)?;
    let mut magic = [0_u8; 13];
    file.read_exact_at(&mut magic, 0)?;
    let (chunks, bytes) = match &magic {
        m if m.starts_with(b"\x89MCAP0") => mcap(&file)?,
        m if m.starts_with(b"#ROSBAG V2.0\n") => bag(&file)?,
        _ => read(&mut file)?,
    };
    println!("{chunks} chunks, {bytes} bytes");
    Ok(())
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
        file.read_exact_at(&mut head, offset)?;
        let length = u64::from_le_bytes(head[1..9].try_into()?);
        if head[0] == 0x06 {
            packed.resize(length as usize, 0);
            file.read_exact_at(&mut packed, offset + 9)?;
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
                b"lz4" => drop(lz4::Decoder::new(body)?.read_to_end(&mut plain)?),
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

fn bag(file: &File) -> Result<Sum, Box<dyn Error>> {
    let (mut packed, mut plain) = (vec![], vec![]);
    let (mut offset, end) = (13_u64, file.metadata()?.len());
    let (mut chunks, mut bytes) = (0, 0);
    while offset + 8 <= end {
        let mut length = [0_u8; 4];
        file.read_exact_at(&mut length, offset)?;
        let mut header = vec![0; u32::from_le_bytes(length) as usize];
        file.read_exact_at(&mut header, offset + 4)?;
        let data = offset + 4 + header.len() as u64;
        file.read_exact_at(&mut length, data)?;
        let size = u32::from_le_bytes(length) as usize;
        let says = |field: &[u8]| header.windows(field.len()).any(|w| w == field);
        if says(b"op=\x05") {
            packed.resize(size, 0);
            file.read_exact_at(&mut packed, data + 4)?;
            plain.clear();
            if says(b"compression=lz4") {
                lz4::Decoder::new(packed.as_slice())?.read_to_end(&mut plain)?;
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
