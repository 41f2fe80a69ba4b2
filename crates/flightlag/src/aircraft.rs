//! Outputs for the aircraft: compensators as C, and autopilot parameters, for each group of flights with a known
//! lateness.

use crate::arguments::AircraftArguments;
use crate::failure::Failure;
use crate::show::{count, visible};
use campaign::{Exit, GroupLine};
use compensation_replay::{
    CExport, CFloat, CompensatorKind, Discretisation, MeasuredAgainst, ParameterFit, autopilot_advice, export_c,
};
use flight::Delay;
use std::io::Write;
use std::path::Path;

/// Writes the requested files.
pub(crate) fn write(arguments: &AircraftArguments, groups: &[GroupLine]) -> Result<(), Failure> {
    if let Some(folder) = &arguments.c {
        compensators(folder, arguments.step_s, groups)?;
    }
    if let Some(file) = &arguments.params {
        let text = parameters(groups)?;
        let was_there = file.exists();
        put(file, &text)?;
        say(&format!("parameters {}: {}", done(was_there), file.display()));
    }
    Ok(())
}

pub(crate) fn put(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|e| failed(path, &e))
}

/// An existing file is replaced, as by every tool that takes the name of its output; the output states which happened.
fn done(was_there: bool) -> &'static str {
    if was_there { "replaced" } else { "written" }
}

/// Prints to standard error: standard output is for the answer.
pub(crate) fn say(text: &str) {
    // If standard error is closed, the message cannot be shown.
    let _ = writeln!(std::io::stderr(), "{}", visible(text));
}

pub(crate) fn make(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|e| failed(folder, &e))
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    Failure::new(Exit::Failed, format!("{}: {error}", path.display()))
}

/// Delay of a group that a compensator can remove, s. `None` if it is unknown relative to the IMU or a reference, is
/// not a single delay, or is zero: then there is nothing to set either.
fn delay_of(group: &GroupLine) -> Option<f64> {
    group.lateness_s.filter(|s| *s > 0.0 && !group.set.is_empty() && !group.datum.starts_with("relative"))
}

/// The exact and the paper's form for each group with known lateness, with delay and interval.
fn compensators(folder: &Path, step_s: f64, groups: &[GroupLine]) -> Result<(), Failure> {
    let late: Vec<(&GroupLine, f64)> = groups.iter().filter_map(|g| Some((g, delay_of(g)?))).collect();
    if late.is_empty() {
        return Err(nothing("no C was written", groups));
    }
    make(folder)?;
    for (k, (group, delay_s)) in late.iter().enumerate() {
        let prefix = if late.len() == 1 { "position_delay".to_owned() } else { format!("position_delay_{}", k + 1) };
        let forms = [(CompensatorKind::ExactAsync, prefix.clone()), (PAPERS, format!("{prefix}_pade"))];
        for (kind, prefix) in forms {
            let was_there = folder.join(format!("{prefix}.h")).exists();
            let file = compensator(folder, kind, prefix, group, *delay_s, step_s)?;
            say(&format!("C {}: {file} and .c, {kind}, {:.1} ms, {}", done(was_there), 1e3 * delay_s, group.group));
        }
    }
    Ok(())
}

/// The filter of Park and Lee (2010).
const PAPERS: CompensatorKind = CompensatorKind::Pade { m: 1, n: 1, rule: Discretisation::Tustin };

/// Writes one compensator; returns its header.
fn compensator(
    folder: &Path,
    kind: CompensatorKind,
    prefix: String,
    group: &GroupLine,
    delay_s: f64,
    step_s: f64,
) -> Result<String, Failure> {
    let interval = group.lateness_low_s.zip(group.lateness_high_s);
    let interval = interval.map_or(String::new(), |(a, b)| format!(", 95 % {:.1} to {:.1} ms", 1e3 * a, 1e3 * b));
    let flights = count(group.pooled, "flight");
    let export = CExport {
        kind,
        prefix,
        delay_s,
        delay_uncertainty_s: group.lateness_u_s,
        delay_source: format!("{flights} of {}, against the {}{interval}", group.group, group.datum),
        step_s,
        max_age_s: MAX_AGE_S,
        real: CFloat::Double,
    };
    let source = export_c(&export).map_err(|e| Failure::new(Exit::Wrong, e.to_string()))?;
    let header = folder.join(&source.header_name);
    put(&header, &source.header)?;
    put(&folder.join(&source.source_name), &source.source)?;
    Ok(header.display().to_string())
}

/// Oldest fix that the generated C accepts, s.
const MAX_AGE_S: f64 = 1.0;

/// A file that Mission Planner and MAVProxy (ArduPilot) or QGroundControl (PX4) can load.
fn parameters(groups: &[GroupLine]) -> Result<String, Failure> {
    let mut lines = vec![];
    for group in groups {
        let Some(delay_s) = delay_of(group) else { continue };
        let Some(set) = group.set.iter().find(|set| set.unit == "ms") else { continue };
        let delay = Delay::from_seconds(delay_s).unwrap_or(Delay::ZERO);
        let advice = autopilot_advice(delay, group.lateness_u_s, MeasuredAgainst::Inertial);
        let Some(known) = advice.parameters.into_iter().find(|p| p.name == set.name) else { continue };
        if matches!(known.fit, ParameterFit::OutOfRange | ParameterFit::RoundsToAutomatic) {
            let why = format!(
                "{} = {} ms cannot be set: it takes {} to {} ms",
                known.name, known.value_ms, known.range_ms[0], known.range_ms[1]
            );
            return Err(Failure::new(Exit::Failed, format!("no parameters were written: {}: {why}", group.group)));
        }
        if set.unsuitable {
            let why = format!("{} cannot remove the delay: {}", set.name, set.note);
            return Err(Failure::new(Exit::Failed, format!("no parameters were written: {}: {why}", group.group)));
        }
        let caution = if set.note.is_empty() { String::new() } else { format!("# {}\n", set.note) };
        lines.push((group, format!("{caution}{}", line(known.name, known.value_ms)), known));
    }
    match &lines[..] {
        [] if groups.iter().any(|group| delay_of(group).is_some()) => Err(no_autopilot(groups)),
        [] => Err(nothing("no parameters were written", groups)),
        [(group, line, known)] => {
            let interval = known.interval_ms.map_or(String::new(), |[a, b]| format!(", {a} to {b} ms (k = 2)"));
            Ok(format!("# {}: {} = {} ms{interval}\n{line}\n", group.group, known.name, known.value_ms))
        }
        several => {
            let names: Vec<String> =
                several.iter().map(|(g, _, p)| format!("{} ({} ms)", g.group, p.value_ms)).collect();
            let text = format!(
                "no parameters were written: these logs are of {} receivers, but a parameter file is for one: {}; \
                 give the logs of one receiver",
                names.len(),
                names.join("; ")
            );
            Err(Failure::new(Exit::Wrong, text))
        }
    }
}

/// ArduPilot: `NAME,VALUE`. PX4: vehicle, component, name, value, type, separated by tabs; 9 is a float.
fn line(name: &str, value_ms: i64) -> String {
    if name.starts_with("EKF2_") || name.starts_with("SENS_") {
        format!("1\t1\t{name}\t{value_ms}.000000000000000000\t9")
    } else {
        format!("{name},{value_ms}")
    }
}

/// A delay is known, but no autopilot parameter removes it.
fn no_autopilot(groups: &[GroupLine]) -> Failure {
    let late: Vec<&GroupLine> = groups.iter().filter(|group| delay_of(group).is_some()).collect();
    let names: Vec<String> = late.iter().map(|group| format!("{}: {}", group.group, group.words)).collect();
    let why = match late.iter().any(|group| group.datum == "imu") {
        true => "these logs are not from an autopilot (ArduPilot or PX4) with a parameter that removes the delay",
        false => "autopilot parameters are relative to the IMU, but the delay is known only relative to a reference",
    };
    Failure::new(Exit::Failed, format!("no parameters were written: {why}. {}", names.join("; ")))
}

/// No group has a delay to write.
fn nothing(what: &str, groups: &[GroupLine]) -> Failure {
    let named = groups.iter().filter(|g| !g.group.is_empty());
    let why: Vec<String> = named.map(|g| format!("{}: {}", g.group, g.words)).collect();
    let why = if why.is_empty() { "no flight was measured".to_owned() } else { why.join("; ") };
    let is_known = |g: &GroupLine| g.lateness_s.is_some() && !g.datum.starts_with("relative");
    let reason = match groups.iter().any(is_known) {
        true => "the position is early, not late beyond its uncertainty, or late by more than one number",
        false => "the lateness of the position against the IMU or a reference is unknown",
    };
    Failure::new(Exit::Failed, format!("{what}: {reason}. {why}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use campaign::LineSetting;

    fn group(name: &str, lateness_s: f64, datum: &str, parameter: &str) -> GroupLine {
        GroupLine {
            group: name.to_owned(),
            flights: 8,
            pooled: 8,
            lateness_s: Some(lateness_s),
            lateness_u_s: Some(0.004),
            lateness_low_s: Some(lateness_s - 0.008),
            lateness_high_s: Some(lateness_s + 0.008),
            datum: datum.to_owned(),
            between_s: None,
            words: format!("position {:.0} ms", 1e3 * lateness_s),
            outliers: vec![],
            set: vec![LineSetting {
                name: parameter.into(),
                value: 1e3 * lateness_s,
                unit: "ms".into(),
                in_log: None,
                note: String::new(),
                unsuitable: false,
            }],
        }
    }

    /// A group of logs without an autopilot name.
    fn group_in_seconds(name: &str, lateness_s: f64, datum: &str) -> GroupLine {
        let mut group = group(name, lateness_s, datum, "position_s");
        for set in &mut group.set {
            (set.value, set.unit) = (lateness_s, "s".into());
        }
        group
    }

    #[test]
    fn parameters_use_the_autopilots_own_format() {
        let ardupilot = parameters(&[group("u-blox", 0.201, "imu", "GPS1_DELAY_MS")]).unwrap();
        assert_eq!(ardupilot, "# u-blox: GPS1_DELAY_MS = 201 ms, 193 to 209 ms (k = 2)\nGPS1_DELAY_MS,201\n");
        let px4 = parameters(&[group("F9P", 0.11, "imu", "EKF2_GPS_DELAY")]).unwrap();
        assert!(px4.ends_with("\n1\t1\tEKF2_GPS_DELAY\t110.000000000000000000\t9\n"), "{px4}");
        let mut long = group("F9P", 0.23, "imu", "EKF2_GPS_DELAY");
        long.set[0].note = "raise EKF2_DELAY_MAX too".into();
        assert!(parameters(&[long]).unwrap().contains("\n# raise EKF2_DELAY_MAX too\n1\t1\tEKF2_GPS_DELAY\t230."));
    }

    #[test]
    fn wrong_parameters_are_rejected_with_the_reason() {
        for (groups, why) in [
            (vec![group("a", 0.4, "imu", "GPS1_DELAY_MS")], "400 ms cannot be set: it takes 0 to 250 ms"),
            (vec![group("a", 0.2, "relative to velocity.gps", "GPS1_DELAY_MS")], "of the position against the IMU"),
            (
                vec![group("a", 0.2, "imu", "GPS1_DELAY_MS"), group("b", 0.1, "imu", "GPS1_DELAY_MS")],
                "are of 2 receivers",
            ),
            // Relative to a reference no autopilot parameter is known.
            (vec![group_in_seconds("a", 0.25, "reference")], "the delay is known only relative to a reference"),
            (vec![group_in_seconds("a", 0.25, "imu")], "these logs are not from an autopilot (ArduPilot or PX4)"),
            (vec![GroupLine { set: vec![], ..group("a", 0.002, "imu", "x") }], "not late beyond its uncertainty"),
            (vec![], "no flight was measured"),
        ] {
            let refused = parameters(&groups).unwrap_err();
            assert!(format!("{refused:?}").contains(why), "{refused:?}");
        }
    }

    #[test]
    fn each_group_gets_its_own_c_files() {
        let folder = tempfile::tempdir().unwrap();
        let two = [group("a", 0.2, "imu", "x"), group("b", 0.1, "imu", "x"), group("c", 0.1, "relative to v", "x")];
        compensators(folder.path(), 0.01, &two).unwrap();
        let header = std::fs::read_to_string(folder.path().join("position_delay_2.h")).unwrap();
        assert!(header.contains("Td     0.100000 s, standard uncertainty 4.000 ms (k = 1)"), "{header}");
        assert!(header.contains("from   8 flights of b, against the imu, 95 % 92.0 to 108.0 ms"), "{header}");
        let pade = std::fs::read_to_string(folder.path().join("position_delay_2_pade.h")).unwrap();
        assert!(pade.contains("Pade [1/1], tustin") && pade.contains("95 % 92.0 to 108.0 ms"), "{pade}");
        assert!(!folder.path().join("position_delay_3.h").exists());
    }
}
