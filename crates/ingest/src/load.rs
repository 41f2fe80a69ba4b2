//! From the files of a flight to the flight.

use crate::companion::companion;
use crate::platform::{FileIdentity, identity};
use binding::{ChannelMap, IngestError, MapLibrary, MapSelect, bind, is_shipped};
use flight::{Binding, Code, Flight, LogHealth, Quantity};
use formats::{FlightUnit, Log, LogError, LogKind, ReadContext, Selection, TableHead, TopicInfo, file_name, read};
use guess::Guess;
use logscan::ScanError;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A log that was read, and the flight in it.
#[derive(Debug)]
pub struct Loaded {
    /// The flight; without channels if no map fits.
    pub flight: Flight,
    /// The health of the log.
    pub health: LogHealth,
    /// Which map bound what, or why no map did.
    pub binding: Result<Binding, String>,
    /// What the log is, if it is not a flight but belongs to one.
    pub companion: Option<String>,
}

/// Reads the files of a flight once and binds their columns. `forced` names the channel map.
///
/// If no map fits, the health of the log is still returned, with the reason in the binding.
///
/// # Errors
/// As [`read`]; [`IngestError::Log`] if a file changed in the meantime;
/// [`IngestError::Map`] if there is no map of the name `forced`.
pub fn load(
    unit: &FlightUnit,
    library: &MapLibrary,
    forced: Option<&str>,
    context: &ReadContext<'_>,
) -> Result<Loaded, IngestError> {
    let select = library.select(forced)?;
    let before = states(&unit.files)?;
    let mut log = read(unit, &select, context)?;
    let unchanged = || match changed(&before, &states(&unit.files)?) {
        Some(file) => Err(IngestError::from(ScanError::Changed { file })),
        None => Ok(()),
    };
    unchanged()?;
    let bound = bind(&mut log, library, forced);
    let is_table = unit.kind == LogKind::Csv && forced.is_none();
    // For a flight, a guess replaces the binding only with both a position and a velocity.
    let may_guess = is_table && needs_guess(&bound, library) && (bound.is_err() || guess::may_hold_both(&log.heads));
    // A table in memory is enough: the map's binding is repeated if the guess is no better.
    let bound = if may_guess { bound.map(drop) } else { return finished(log, bound, None) };
    let (bound, refused) = match (bound, guessed(unit, &log.heads, context)?) {
        (bound, Ok(guess)) if bound.is_err() || guess.both => {
            let map = ChannelMap::from_toml(Path::new("guess.toml"), &guess.text)?;
            log = read(unit, &MapSelect::of(&map), &again(context))?;
            (by_guess(&mut log, &guess, map), None)
        }
        (Ok(()), _) => {
            log = read(unit, &select, &again(context))?;
            (bind(&mut log, library, forced), None)
        }
        (Err(error), guessed) => (Err(error), guessed.err()),
    };
    unchanged()?;
    finished(log, bound, refused)
}

/// What was read, with why nothing was bound. `refused` is the reason why no columns were guessed, if that was tried.
fn finished(
    mut log: Log,
    bound: Result<(Flight, Binding), IngestError>,
    refused: Option<NoGuess>,
) -> Result<Loaded, IngestError> {
    let (flight, binding) = match bound {
        Ok((flight, binding)) => {
            note_stamps(&mut log, &binding);
            log.health.utc = flight.utc.clone();
            (flight, Ok(binding))
        }
        Err(IngestError::MapLacks(reason)) => {
            let mut flight = Flight { notices: log.notices.clone(), ..Flight::default() };
            let text = "no channel is bound: your channel map does not fit this log";
            flight.notices.push(Code::MapLacks, "", 1, text);
            (flight, Err(reason))
        }
        Err(IngestError::Map(mut reason)) => {
            match refused {
                Some(NoGuess::Refused(why)) => {
                    // What the nearest shipped map lacks does not help for a table that nearly binds by itself.
                    reason = match why.contains(guess::NO_TIME) {
                        true => format!("its columns cannot be bound by guess: {why}; {reason}"),
                        false => format!("no channel map fits, and its columns cannot be bound by guess: {why}"),
                    };
                }
                // What the nearest map lacks is the better advice.
                Some(NoGuess::Nameless(advice)) if !reason.contains("nearest: ") => reason += &format!("; {advice}"),
                _ => {}
            }
            (Flight { notices: log.notices.clone(), ..Flight::default() }, Err(reason))
        }
        Err(error) => return Err(error),
    };
    let companion = companion(&log.health, &flight).map(str::to_owned);
    Ok(Loaded { flight, health: log.health, binding, companion })
}

/// Whether no user map was used, and no shipped one that gives a position and a velocity.
fn needs_guess(bound: &Result<(Flight, Binding), IngestError>, library: &MapLibrary) -> bool {
    match bound {
        Ok((flight, binding)) => {
            let has = |wanted: &[Quantity]| flight.channels.values().any(|channel| wanted.contains(&channel.quantity));
            let both = has(&[Quantity::PositionGeodetic, Quantity::PositionNed]) && has(&[Quantity::VelocityNed]);
            // A bench is not an incomplete flight.
            let is_bench = has(&[Quantity::EncoderAngle, Quantity::EncoderCount]);
            !is_bench && !both && library.get(&binding.map).is_ok_and(|map| map.shipped)
        }
        Err(IngestError::Map(_)) => true,
        Err(_) => false,
    }
}

/// A guess, or why there is none.
type Guessed = Result<Guess, NoGuess>;

/// Why the columns of a table are not bound by guess.
enum NoGuess {
    /// Their names match nothing; with advice.
    Nameless(String),
    /// They contradict the motion, are ambiguous, or are missing; with the reason.
    Refused(String),
}

fn guessed(unit: &FlightUnit, heads: &[TableHead], context: &ReadContext<'_>) -> Result<Guessed, IngestError> {
    let Some(wanted) = guess::wanted(heads) else {
        let why = guess::why_nameless(heads);
        return Ok(Err(if guess::any_headerless(heads) { NoGuess::Refused(why) } else { NoGuess::Nameless(why) }));
    };
    let log = read(unit, &wanted, &again(context))?;
    Ok(guess::guess(&log).map_err(NoGuess::Refused))
}

/// For reading bytes again that were already counted.
fn again<'c>(context: &ReadContext<'c>) -> ReadContext<'c> {
    ReadContext { on_bytes: &|_| (), ..*context }
}

fn by_guess(log: &mut Log, guess: &Guess, map: ChannelMap) -> Result<(Flight, Binding), IngestError> {
    let name = map.name.clone();
    let mut only = MapLibrary::default();
    only.add(map);
    let (mut flight, binding) = bind(log, &only, Some(&name))?;
    let text = format!(
        "columns bound by guess: {}; write this map with `flightlag maps --suggest LOG > own.toml`, check it, and \
         pass its folder with --maps",
        guess.summary
    );
    flight.notices.push(Code::BoundByGuess, "", guess.channels, text);
    Ok((flight, Binding { why: "no map fits; columns bound by guess".into(), ..binding }))
}

/// Reads a table as the second file of a flight, where [`load`] does not bind it. Returns one flight for each possible
/// direction of its axes, with the columns of each channel. Empty if the time or the units are unknown.
///
/// # Errors
/// As [`read`].
pub fn load_orientations(unit: &FlightUnit, context: &ReadContext<'_>) -> Result<Vec<(Flight, String)>, IngestError> {
    if unit.kind != LogKind::Csv {
        return Ok(vec![]);
    }
    let nothing = |_: &TopicInfo| Selection::Skip;
    let heads = read(unit, &nothing, context)?.heads;
    let Some(wanted) = guess::wanted(&heads) else { return Ok(vec![]) };
    let mut orientations = vec![];
    for guess in guess::orientations(&read(unit, &wanted, context)?) {
        let map = ChannelMap::from_toml(Path::new("guess.toml"), &guess.text)?;
        let mut log = read(unit, &MapSelect::of(&map), context)?;
        if let Ok((flight, _)) = by_guess(&mut log, &guess, map) {
            orientations.push((flight, guess.summary));
        }
    }
    Ok(orientations)
}

/// The channel map that [`load`] would use for a table that no map fits, as file text with the reasons as comments,
/// named after the log.
///
/// # Errors
/// As [`read`]; [`IngestError::Map`] with the reason if there is no such map.
pub fn suggest(unit: &FlightUnit, context: &ReadContext<'_>) -> Result<String, IngestError> {
    suggested(unit, context).map(|text| guess::renamed(&text, &name_after(unit)))
}

/// The stem of the file or of the flight; never the name of a built-in map, which it would replace.
fn name_after(unit: &FlightUnit) -> String {
    let path = match unit.files.as_slice() {
        [only] => only.as_path(),
        _ => Path::new(&unit.id),
    };
    let stem = path.file_stem().map_or("own".into(), |stem| stem.to_string_lossy());
    if is_shipped(&stem) { format!("{stem}-own") } else { stem.into_owned() }
}

fn suggested(unit: &FlightUnit, context: &ReadContext<'_>) -> Result<String, IngestError> {
    if unit.kind != LogKind::Csv {
        let text = "columns are guessed for text tables only. `flightlag export LOG --topics --to csv` shows the fields of \
                    other logs, and `flightlag maps --example` every key of a map";
        return Err(IngestError::Map(text.to_owned()));
    }
    let nothing = |_: &TopicInfo| Selection::Skip;
    let heads = read(unit, &nothing, context)?.heads;
    let by_names = match guess::wanted(&heads) {
        Some(wanted) => Some(guess::guess(&read(unit, &wanted, context)?)),
        None => None,
    };
    if let Some(Ok(found)) = by_names {
        return Ok(found.text);
    }
    let Some(wanted) = guess::wanted_by_motion(&heads) else {
        let why = by_names.and_then(Result::err).unwrap_or_else(|| guess::why_nameless(&heads));
        return Err(IngestError::Map(why));
    };
    let by_motion = guess::guess_by_motion(&read(unit, &wanted, context)?);
    match (by_motion, by_names) {
        (Ok(found), _) => Ok(found.text),
        (Err(_), Some(Err(why))) => Err(IngestError::Map(why)),
        (Err(why), _) => Err(IngestError::Map(why)),
    }
}

/// Gives the topics of formats without log timestamps those of their bound channels.
fn note_stamps(log: &mut Log, binding: &Binding) {
    for channel in &binding.channels {
        let topic = log.health.topics.iter_mut().find(|t| t.name == channel.source.topic);
        if let (Some(topic), Some(stamps)) = (topic, &channel.stamps)
            && topic.stamps.iter().all(|s| s.kind != stamps.kind)
        {
            topic.stamps.push(stamps.clone());
        }
    }
}

/// Changes if a file was written to or replaced.
type State = (PathBuf, u64, Option<SystemTime>, Option<FileIdentity>);

fn states(files: &[PathBuf]) -> Result<Vec<State>, IngestError> {
    let state = |path: &PathBuf| {
        let about = std::fs::metadata(path).map_err(|source| LogError::of_file(path, source))?;
        Ok((path.clone(), about.len(), about.modified().ok(), identity(path)))
    };
    files.iter().map(state).collect()
}

fn changed(before: &[State], after: &[State]) -> Option<String> {
    before.iter().zip(after).find(|(a, b)| a != b).map(|((path, ..), _)| file_name(path))
}
