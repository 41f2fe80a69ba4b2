//! The rows of a campaign's record, one per flight: gzipped JSON Lines. Otherwise `campaign.json` would be mostly rows.

use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;
use record::{CampaignRecord, FlightRow};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};

/// The record of the campaign, without the rows.
pub(crate) const RECORD: &str = "campaign.json";
/// The rows.
pub(crate) const ROWS: &str = "flights.jsonl.gz";

/// Maximum length of a row.
const MOST_OF_ROW: u64 = 64 << 20;

/// The next level makes files a few percent smaller and a campaign slower.
const LEVEL: Compression = Compression::new(3);

/// The packed rows of a record. The same rows give the same bytes: the header has no timestamp.
pub(crate) fn packed(record: &CampaignRecord) -> Vec<u8> {
    let mut encoder = GzEncoder::new(vec![], LEVEL);
    // Writing to memory cannot fail.
    record.flights.iter().for_each(|row| drop(encoder.write_all(&row.to_json())));
    encoder.finish().unwrap_or_default()
}

/// A record from its JSON and its packed rows.
pub(crate) fn unpacked(text: &[u8], rows: &[u8]) -> Result<CampaignRecord, String> {
    let mut record = CampaignRecord::from_json(text).map_err(|e| e.to_string())?;
    record.flights = each_row(rows, record.totals.flights).map_err(|e| format!("{ROWS}, {e}"))?;
    match record.totals.flights == record.flights.len() as u64 {
        true => Ok(record),
        false => Err(format!("it lists {} flights, but {ROWS} has {}", record.totals.flights, record.flights.len())),
    }
}

/// Reads the rows one by one, because their text is many times larger than the packed file.
fn each_row(packed: &[u8], expected: u64) -> Result<Vec<FlightRow>, String> {
    /// Limit for preallocation: a wrong count must not use memory.
    const MOST_AHEAD: u64 = 1 << 17;
    let mut lines = BufReader::new(MultiGzDecoder::new(packed));
    let (mut rows, mut line) = (Vec::with_capacity(expected.min(MOST_AHEAD) as usize), vec![]);
    loop {
        line.clear();
        let at = |what: String| format!("line {}: {what}", rows.len() + 1);
        match lines.by_ref().take(MOST_OF_ROW).read_until(b'\n', &mut line).map_err(|e| at(e.to_string()))? {
            0 => return Ok(rows),
            _ => rows.push(FlightRow::from_json(&line).map_err(|e| at(e.to_string()))?),
        }
    }
}

/// Reads the record of a campaign's report, with its rows; `None` if the folder holds no such report.
///
/// # Errors
/// The path of the record and what is wrong: it is unreadable, damaged, or its rows are from another run.
pub fn read_report(report: &Path) -> Result<Option<CampaignRecord>, (PathBuf, String)> {
    let path = report.join(RECORD);
    let text = match std::fs::read(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err((path, format!("cannot be read: {e}"))),
    };
    let rows = std::fs::read(report.join(ROWS)).map_err(|e| match e.kind() {
        io::ErrorKind::NotFound => {
            (path.clone(), format!("has no {ROWS}, because an older release wrote it; run the campaign again"))
        }
        _ => (report.join(ROWS), format!("cannot be read: {e}")),
    })?;
    unpacked(&text, &rows).map(Some).map_err(|what| (path, format!("is damaged: {what}")))
}

/// A gzip file without name and timestamp.
pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(vec![], LEVEL);
    // Writing to memory cannot fail.
    let _ = encoder.write_all(bytes);
    encoder.finish().unwrap_or_default()
}

/// The content of a gzip file; more than `most` bytes are an error.
pub(crate) fn gunzip(bytes: &[u8], most: u64) -> io::Result<Vec<u8>> {
    let mut plain = vec![];
    let length = MultiGzDecoder::new(bytes).take(most + 1).read_to_end(&mut plain)?;
    match length as u64 <= most {
        true => Ok(plain),
        false => Err(io::Error::new(
            io::ErrorKind::InvalidData,
            "its uncompressed size is larger than flightlag \
            writes",
        )),
    }
}
