//! Targets that read settings.

use std::path::Path;

const PATH: &str = "fuzz.toml";

/// Text that is not UTF-8 is rejected before any of these parsers.
fn text_of(data: &[u8]) -> &str {
    std::str::from_utf8(data).unwrap_or_default()
}

pub fn channel_map(data: &[u8]) {
    let _ = ingest::ChannelMap::from_toml(Path::new(PATH), text_of(data));
}

pub fn rig(data: &[u8]) {
    let _ = bench_analysis::Rig::parse(text_of(data), Path::new(PATH));
}

pub fn card(data: &[u8]) {
    let _ = bench_analysis::parse_card(text_of(data), Path::new(PATH));
}

#[cfg(feature = "pipeline")]
pub fn pipeline(data: &[u8]) {
    let _ = campaign::Pipeline::parse(text_of(data), Path::new(PATH));
}

#[cfg(feature = "pipeline")]
pub fn criteria(data: &[u8]) {
    let _ = campaign::Criteria::parse(text_of(data), Path::new(PATH));
}
