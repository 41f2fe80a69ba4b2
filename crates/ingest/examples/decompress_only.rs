//! The least that reading a zstd MCAP costs: every chunk read, decompressed and its CRC checked, nothing more.
//!
//! `cargo run --release -p ingest --example decompress_only FILE` is the yardstick that `just perf-mcap` holds the reader against.

#![allow(clippy::print_stdout)]

use std::os::unix::fs::FileExt;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("usage: decompress_only FILE.mcap")?;
    let file = std::fs::File::open(&path)?;
    let mut decoder = zstd::bulk::Decompressor::new()?;
    let (mut compressed, mut plain) = (vec![], vec![]);
    let (mut offset, end) = (8_u64, file.metadata()?.len());
    let (mut chunks, mut bytes) = (0_u64, 0_u64);
    while offset + 9 <= end {
        let mut head = [0_u8; 9];
        file.read_exact_at(&mut head, offset)?;
        let length = u64::from_le_bytes(head[1..9].try_into()?);
        if head[0] == 0x06 {
            compressed.resize(length as usize, 0);
            file.read_exact_at(&mut compressed, offset + 9)?;
            let number = |at: usize| u64::from_le_bytes(compressed[at..at + 8].try_into().unwrap_or_default());
            let crc = u32::from_le_bytes(compressed[24..28].try_into()?);
            let name = u32::from_le_bytes(compressed[28..32].try_into()?) as usize;
            plain.clear();
            plain.reserve(number(16) as usize);
            decoder.decompress_to_buffer(&compressed[32 + name + 8..], &mut plain)?;
            if crc != 0 && crc32fast::hash(&plain) != crc {
                return Err(format!("{path}: chunk at byte {offset}: CRC").into());
            }
            chunks += 1;
            bytes += plain.len() as u64;
        }
        offset += 9 + length;
    }
    println!("{chunks} chunks, {bytes} bytes");
    Ok(())
}
