//! What the command line asks of a log: `LOG [TOPIC[=FIELD,FIELD] ...]`, no topic for all. Without fields whole messages
//! are decoded; a field that begins with a quotation mark is text.

use ingest::{FieldRequest, Limits, Log, MapLibrary, ReadContext, Selection, TopicInfo, ValueKind};
use std::error::Error;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// Reads it.
pub fn read() -> Result<Log, Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = PathBuf::from(arguments.next().ok_or("usage: LOG [TOPIC[=FIELD,FIELD] ...]")?);
    let topics: Vec<(String, Selection)> = arguments.map(|argument| selection(&argument)).collect();
    let want = |topic: &TopicInfo| match topics.iter().find(|(name, _)| *name == topic.name) {
        Some((_, wanted)) => wanted.clone(),
        None if topics.is_empty() => Selection::All,
        None => Selection::Skip,
    };
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| {} };
    let found = ingest::discover(&path, &MapLibrary::default())?;
    let unit = found.units.first().ok_or_else(|| format!("no log: {:?}", found.ignored))?;
    Ok(ingest::read(unit, &want, &context)?)
}

/// A topic, and what is wanted of it.
fn selection(argument: &str) -> (String, Selection) {
    let field = |path: &str| match path.strip_prefix('"') {
        Some(path) => FieldRequest { path: path.to_owned(), kind: ValueKind::Text },
        None => FieldRequest { path: path.to_owned(), kind: ValueKind::Number },
    };
    let (topic, fields) = argument.split_once('=').unwrap_or((argument, ""));
    let wanted = match fields {
        "" => Selection::All,
        fields => Selection::Fields(fields.split(',').map(field).collect()),
    };
    (topic.to_owned(), wanted)
}
