//! Which logs form a record: by content, folder and name.

use super::bench_logs::{ReadLog, Role};
use std::collections::BTreeMap;
use std::path::Path;

/// A record, with its logs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Swing {
    /// Display name.
    pub(super) name: String,
    /// Name without extensions, for the rig file next to it.
    pub(super) stem: String,
    pub(super) made_of: MadeOf,
}

/// Index of a log.
type Log = usize;

#[derive(Debug, Clone, PartialEq)]
pub(super) enum MadeOf {
    /// One log holds both.
    One(Log),
    Two {
        encoder: Log,
        sensor: Log,
    },
    /// These cannot form a record.
    Nothing {
        logs: Vec<Log>,
        reason: String,
    },
}

impl Swing {
    /// Its logs.
    pub(super) fn logs(&self) -> Vec<Log> {
        match &self.made_of {
            MadeOf::One(log) => vec![*log],
            MadeOf::Two { encoder, sensor } => vec![*encoder, *sensor],
            MadeOf::Nothing { logs, .. } => logs.clone(),
        }
    }
}

/// Forms records from logs. Every log becomes part of exactly one.
pub(super) fn pair(logs: &[ReadLog], encoder_is_stated: bool) -> Vec<Swing> {
    let mut swings = if encoder_is_stated { vec![stated(logs)] } else { by_folder(logs) };
    swings.sort_by_key(|s| s.logs().into_iter().min());
    make_unique(&mut swings);
    swings
}

/// One log of a sensor, and one that the user gave as its encoder's.
fn stated(logs: &[ReadLog]) -> Swing {
    let index = |is_encoder: bool| logs.iter().position(|l| l.source.is_stated_encoder == is_encoder);
    let (Some(encoder), Some(sensor)) = (index(true), index(false)) else {
        let reason = "one log of a sensor and one log of an encoder are needed".to_owned();
        return Namer { logs }.swing(MadeOf::Nothing { logs: (0..logs.len()).collect(), reason });
    };
    let role = |log: usize| logs.get(log).map_or(Err("no log".to_owned()), ReadLog::role);
    let made_of = match (role(encoder), role(sensor)) {
        (Ok(Role::Both | Role::Encoder), Ok(Role::Both | Role::Sensor)) => MadeOf::Two { encoder, sensor },
        (Ok(Role::Sensor), _) => nothing(vec![encoder, sensor], "the --encoder log has no encoder channel"),
        (_, Ok(Role::Encoder)) => nothing(
            vec![encoder, sensor],
            "the record has an encoder channel, but no sensor \
            channel",
        ),
        (Err(reason), _) | (_, Err(reason)) => nothing(vec![encoder, sensor], reason),
    };
    Namer { logs }.swing(made_of)
}

fn nothing(logs: Vec<Log>, reason: impl Into<String>) -> MadeOf {
    MadeOf::Nothing { logs, reason: reason.into() }
}

fn by_folder(logs: &[ReadLog]) -> Vec<Swing> {
    let mut folders: BTreeMap<&Path, Vec<Log>> = BTreeMap::new();
    for (i, log) in logs.iter().enumerate() {
        folders.entry(&log.source.neighbourhood).or_default().push(i);
    }
    folders.into_values().flat_map(|members| in_folder(logs, &members)).collect()
}

/// The logs of one folder by content.
#[derive(Default)]
struct Sorted {
    both: Vec<Log>,
    encoders: Vec<Log>,
    sensors: Vec<Log>,
    broken: Vec<(Log, String)>,
}

impl Sorted {
    fn of(logs: &[ReadLog], members: &[Log]) -> Sorted {
        let mut sorted = Sorted::default();
        for &i in members {
            match logs.get(i).map(ReadLog::role) {
                Some(Ok(Role::Both)) => sorted.both.push(i),
                Some(Ok(Role::Encoder)) => sorted.encoders.push(i),
                Some(Ok(Role::Sensor)) => sorted.sensors.push(i),
                Some(Err(reason)) => sorted.broken.push((i, reason)),
                None => {}
            }
        }
        sorted
    }
}

fn in_folder(logs: &[ReadLog], members: &[Log]) -> Vec<Swing> {
    let Sorted { both, encoders, sensors, broken } = Sorted::of(logs, members);
    let namer = Namer { logs };
    let mut made: Vec<MadeOf> = both.into_iter().map(MadeOf::One).collect();
    // An encoder's log with only an unreadable companion is part of the same failure.
    if let ([], [(log, reason)], [one]) =
        (made.as_slice(), broken.as_slice(), [&encoders[..], &sensors[..]].concat().as_slice())
    {
        return vec![namer.swing(nothing(vec![*one, *log], reason.clone()))];
    }
    made.extend(broken.into_iter().map(|(log, reason)| nothing(vec![log], reason)));
    made.extend(two_logs(logs, encoders, sensors));
    made.into_iter().map(|made_of| namer.swing(made_of)).collect()
}

/// A single encoder and a single sensor belong together; of more, those with the same start of the name.
fn two_logs(logs: &[ReadLog], encoders: Vec<Log>, sensors: Vec<Log>) -> Vec<MadeOf> {
    if let ([encoder], [sensor]) = (encoders.as_slice(), sensors.as_slice()) {
        return vec![MadeOf::Two { encoder: *encoder, sensor: *sensor }];
    }
    let begins = |i: Log| logs.get(i).map(|l| beginning(&l.source.stem())).unwrap_or_default();
    let like = |list: &[Log], name: &str| list.iter().copied().filter(|&i| begins(i) == name).collect::<Vec<Log>>();
    let mut made = vec![];
    let mut paired = vec![];
    for &sensor in &sensors {
        let name = begins(sensor);
        if let ([encoder], [_]) = (like(&encoders, &name).as_slice(), like(&sensors, &name).as_slice()) {
            paired.extend([*encoder, sensor]);
            made.push(MadeOf::Two { encoder: *encoder, sensor });
        }
    }
    let (e, s) = (encoders.len(), sensors.len());
    for log in encoders.iter().chain(&sensors).filter(|log| !paired.contains(log)) {
        let reason = match (encoders.contains(log), e, s) {
            (true, _, 0) => "it has an encoder channel, but no log of a sensor was given".to_owned(),
            (false, 0, _) => {
                "it has no encoder channel that its map binds, and no log of an encoder was given; give --encoder"
                    .to_owned()
            }
            _ => format!(
                "{e} logs of encoders and {s} of sensors are in one folder: put each pair into its own folder, or \
                 give the two logs of a pair the same first part of the name, such as swing-1-encoder and \
                 swing-1-sensor"
            ),
        };
        made.push(nothing(vec![*log], reason));
    }
    made
}

/// The name before its last word: `swing-1` of `swing-1-encoder`.
fn beginning(stem: &str) -> String {
    stem.rsplit_once(['-', '_', ' ', '.']).map_or(stem, |(start, _)| start).to_owned()
}

struct Namer<'a> {
    logs: &'a [ReadLog],
}

impl Namer<'_> {
    fn swing(&self, made_of: MadeOf) -> Swing {
        let mut swing = Swing { name: String::new(), stem: String::new(), made_of };
        let logs: Vec<&ReadLog> = swing.logs().iter().filter_map(|&i| self.logs.get(i)).collect();
        match logs.as_slice() {
            [one] => {
                swing.name = one.source.unit.id.clone();
                swing.stem = beginning(&one.source.stem());
            }
            [a, b] => {
                let (a_id, b_id) = (&a.source.unit.id, &b.source.unit.id);
                let folder = a_id.rsplit_once('/').map(|(folder, _)| folder.to_owned());
                let (a_begins, b_begins) = (beginning(&a.source.stem()), beginning(&b.source.stem()));
                let alike = a_begins == b_begins && a_begins != a.source.stem();
                swing.name = match (&folder, alike) {
                    (Some(folder), true) => format!("{folder}/{a_begins}"),
                    (None, true) => a_begins.clone(),
                    (Some(folder), false) => folder.clone(),
                    (None, false) => format!("{a_id} + {b_id}"),
                };
                swing.stem = if alike { a_begins } else { b.source.stem() };
            }
            _ => swing.name = "record".to_owned(),
        }
        swing
    }
}

/// Records of different folders may have the same name.
fn make_unique(swings: &mut [Swing]) {
    let mut taken = std::collections::BTreeSet::new();
    for swing in swings {
        let plain = swing.name.clone();
        let mut count = 1;
        while !taken.insert(swing.name.clone()) {
            count += 1;
            swing.name = format!("{plain}~{count}");
        }
    }
}
