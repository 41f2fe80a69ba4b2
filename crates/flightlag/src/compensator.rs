//! `flightlag compensator`: one compensator as C, its useful band, and the equivalent autopilot parameters.

use crate::arguments::CompensatorArguments;
use crate::failure::{End, Failure};
use campaign::Exit;
use compensation_replay::{
    CExport, CFloat, CompensatorError, CompensatorKind, DelayModel, Delays, MeasuredAgainst, ValidityBand,
    autopilot_advice, export_c,
};
use flight::{Delay, fixed};
use std::io::Write;

/// Coverage factor of an expanded uncertainty.
const COVERAGE_FACTOR: f64 = 2.0;
/// Fraction of the raw error that still counts as help.
const HELP: f64 = 0.1;

/// Whether it can be written as C.
fn is_written(kind: &CompensatorKind) -> bool {
    matches!(kind, CompensatorKind::Pade { .. } | CompensatorKind::ExactAsync)
}

/// Suggests only what can be written as C.
fn for_c(error: CompensatorError) -> CompensatorError {
    let all: Vec<String> = CompensatorKind::all().iter().filter(|k| is_written(k)).map(ToString::to_string).collect();
    match error {
        CompensatorError::Unknown { name, .. } => CompensatorError::unknown(name, all.iter().map(String::as_str)),
        other => other,
    }
}

/// The valid names, and the help text that follows them.
pub(crate) fn names_and(exit_codes: &str) -> String {
    let (written, others): (Vec<CompensatorKind>, Vec<CompensatorKind>) =
        CompensatorKind::all().into_iter().partition(is_written);
    let names = |kinds: &[CompensatorKind]| kinds.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let (written, others) = (names(&written), names(&others));
    format!(
        "Compensator names, with N up to 4:\n  {written}\n\nIn a pipeline, [replay] compensators also accepts:\n  \
         {others}\n\nThe default rule is tustin for pade-1-1, and foh for the others.\n\n{exit_codes}"
    )
}

pub(crate) fn run(arguments: &CompensatorArguments) -> Result<End, Failure> {
    let asked = |e: &dyn std::fmt::Display| Failure::new(Exit::Wrong, e.to_string());
    let kind: CompensatorKind = arguments.name.parse::<CompensatorKind>().map_err(|e| asked(&for_c(e)))?;
    let delay = delay_of(arguments).map_err(|what| asked(&what))?;
    let export = CExport {
        kind,
        prefix: arguments.prefix.clone(),
        delay_s: arguments.delay_s,
        delay_uncertainty_s: arguments.uncertainty_s,
        delay_source: arguments.source.clone(),
        step_s: arguments.step_s,
        max_age_s: arguments.max_age_s,
        real: if arguments.float { CFloat::Float } else { CFloat::Double },
    };
    let source = export_c(&export).map_err(|e| asked(&e))?;
    let failed =
        |path: &std::path::Path, e: std::io::Error| Failure::new(Exit::Failed, format!("{}: {e}", path.display()));
    std::fs::create_dir_all(&arguments.out).map_err(|e| failed(&arguments.out, e))?;
    let mut out = std::io::stdout().lock();
    for (name, text) in [(&source.header_name, &source.header), (&source.source_name, &source.source)] {
        let path = arguments.out.join(name);
        let done = if path.exists() { "replaced" } else { "wrote" };
        std::fs::write(&path, text).map_err(|e| failed(&path, e))?;
        writeln!(out, "{done} {}", path.display())?;
    }
    if let Some(bands) = bands(kind, arguments.delay_s, arguments.uncertainty_s, arguments.step_s) {
        writeln!(out, "{bands}")?;
    }
    let advice = autopilot_advice(delay, arguments.uncertainty_s, MeasuredAgainst::UnknownVelocity);
    match advice.can_be_set() {
        true => writeln!(out, "\nInstead of a compensator, set the delay in the autopilot:\n{}", advice.text())?,
        false => {
            writeln!(out, "\nNo parameter of an autopilot takes {:.0} ms: run the compensator.", delay.millis())?;
        }
    }
    Ok(Exit::Well.into())
}

/// The delay to remove.
fn delay_of(arguments: &CompensatorArguments) -> Result<Delay, String> {
    let delay_s = arguments.delay_s;
    let delay = Delay::from_seconds(delay_s).filter(|delay| delay.seconds() > 0.0);
    let delay = delay.ok_or_else(|| format!("--delay-s {delay_s}: a compensator removes a positive delay"))?;
    match arguments.uncertainty_s.filter(|u| *u > delay_s) {
        Some(u) => Err(format!("--uncertainty-s {u}: larger than the delay of {delay_s} s, so the delay is unknown")),
        None => Ok(delay),
    }
}

/// Up to which motion frequency it helps in this loop, and from which on it harms: with the delay exactly right, and in
/// the worse case of a delay that is off by U (k = 2) to either side.
fn bands(kind: CompensatorKind, delay_s: f64, uncertainty_s: Option<f64>, step_s: f64) -> Option<String> {
    let filter = kind.filter(delay_s).ok()?;
    let model = DelayModel::Loop { filter: &filter, step_s };
    let of = |position_s: f64| {
        ValidityBand::of(model, Delays { position_s, ..Delays::of_position(delay_s) }, HELP).unwrap_or(HARMS)
    };
    let right = band(&of(delay_s), delay_s, step_s);
    let mut text = format!(
        "in a loop of {step_s} s: {right} (delay exactly right, velocity on time, a new position in every step; a position \
         that is held lags by its age)"
    );
    if let Some(u) = uncertainty_s.filter(|u| *u > 0.0) {
        let most_s = COVERAGE_FACTOR * u;
        let [short, long] = [delay_s - most_s, delay_s + most_s].map(of);
        let wrong = band(&worse_of(&short, &long), delay_s, step_s);
        text += &format!("\nwith a delay that is wrong by its U of {} ms (k = 2): {wrong}", fixed(1e3 * most_s, 1));
    }
    Some(text)
}

/// A position without a delay: whatever is added to it is an error.
const HARMS: ValidityBand =
    ValidityBand { factor: HELP, helps_below_hz: None, halves_below_hz: None, worse_above_hz: Some(0.0) };

fn worse_of(a: &ValidityBand, b: &ValidityBand) -> ValidityBand {
    let lower = |a: Option<f64>, b: Option<f64>| Some(a?.min(b?));
    ValidityBand {
        factor: a.factor,
        helps_below_hz: lower(a.helps_below_hz, b.helps_below_hz),
        halves_below_hz: lower(a.halves_below_hz, b.halves_below_hz),
        worse_above_hz: lower(a.worse_above_hz, b.worse_above_hz).or(a.worse_above_hz).or(b.worse_above_hz),
    }
}

fn band(band: &ValidityBand, delay_s: f64, step_s: f64) -> String {
    // A loop cannot see motion above half its rate.
    let nyquist_hz = 0.5 / step_s;
    let highest_hz = 1.0 / delay_s;
    let up_to = |hz: Option<f64>| match hz {
        None => "nowhere".to_owned(),
        Some(hz) if hz > nyquist_hz => format!("up to {nyquist_hz:.2} Hz, half the rate of the loop"),
        Some(hz) if hz >= highest_hz => format!("up to {hz:.2} Hz (1/Td, the highest frequency examined)"),
        Some(hz) => format!("up to {hz:.2} Hz"),
    };
    let worse = match band.worse_above_hz {
        None => "never worse than raw below 1/Td".to_owned(),
        Some(0.0) => "worse than raw from the slowest motion on".to_owned(),
        Some(hz) if hz > nyquist_hz => "nowhere worse than raw".to_owned(),
        Some(hz) => format!("first worse than raw at {hz:.2} Hz"),
    };
    format!(
        "removes 90 % of the error {}, half of it {}, {worse}",
        up_to(band.helps_below_hz),
        up_to(band.halves_below_hz)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_can_be_written_as_c_is_suggested() {
        let error = for_c("exact".parse::<CompensatorKind>().unwrap_err()).to_string();
        assert!(error.contains("called \"exact\"") && !error.contains("exact-fir"), "{error}");
    }

    #[test]
    fn every_name_in_the_help_is_available_as_c_or_for_pipelines_only() {
        let help = names_and("");
        let (written, others) = help.split_once("In a pipeline,").unwrap();
        let names = |text: &str| -> Vec<String> {
            let listed = text.lines().find(|line| line.starts_with("  ")).unwrap();
            listed.trim().split(", ").map(str::to_owned).collect()
        };
        let can_be_written = |name: &String| {
            let kind: CompensatorKind = name.parse().unwrap();
            let (prefix, delay_source) = ("p".to_owned(), String::new());
            let (delay_s, step_s, max_age_s, real) = (0.4, 0.01, 1.0, CFloat::Double);
            let export =
                CExport { kind, prefix, delay_s, delay_uncertainty_s: None, delay_source, step_s, max_age_s, real };
            export_c(&export).is_ok()
        };
        let (written, others) = (names(written), names(others));
        assert!(written.iter().all(can_be_written), "{written:?}");
        assert!(!others.iter().any(can_be_written), "{others:?}");
        assert!(written.contains(&"pade-1-1-tustin".to_owned()) && others.contains(&"kalman".to_owned()));
    }

    #[test]
    fn a_loop_promises_nothing_above_half_its_rate() {
        let in_hertz = |text: &str| -> Vec<f64> {
            let words: Vec<&str> = text.split([' ', ',']).collect();
            words.windows(2).filter(|pair| pair[1] == "Hz").map(|pair| pair[0].parse().unwrap()).collect()
        };
        for kind in CompensatorKind::all().into_iter().filter(|kind| is_written(kind) && kind.filter(0.2).is_ok()) {
            for step_s in [0.01, 0.7, 1.0] {
                let text = bands(kind, 0.2, None, step_s).unwrap();
                // Shown with two decimals.
                let most = 0.5 / step_s + 0.005;
                assert!(in_hertz(&text).iter().all(|hz| *hz <= most), "{kind} in {step_s} s: {text}");
                assert!(step_s > 0.01 || !text.contains("rate of the loop"), "{text}");
            }
        }
        let slow = bands("pade-1-1-foh".parse().unwrap(), 0.2, None, 1.0).unwrap();
        assert!(
            slow.contains("half of it up to 0.50 Hz, half the rate of the loop, nowhere worse than raw ("),
            "{slow}"
        );
    }

    /// Of slow motion the error left is |Td true − Td set|/Td true: 0.1/0.3 and 0.1/0.5, then 0.3/0.1.
    #[test]
    fn a_wrong_delay_leaves_its_share_of_slow_motion() {
        let of = |u: Option<f64>| bands("pade-2-2-foh".parse().unwrap(), 0.4, u, 0.01).unwrap();
        assert_eq!((of(None).lines().count(), of(Some(0.0)).lines().count()), (1, 1));
        let third = of(Some(0.05));
        let third = third.lines().nth(1).unwrap();
        assert!(third.contains("U of 100.0 ms") && third.contains("90 % of the error nowhere"), "{third}");
        assert!(third.contains("half of it up to"), "{third}");
        for harmful in [0.15, 0.3] {
            let text = of(Some(harmful));
            assert!(text.ends_with("half of it nowhere, worse than raw from the slowest motion on"), "{text}");
        }
        let well_known = of(Some(0.001));
        assert!(well_known.lines().nth(1).unwrap().contains("90 % of the error up to"), "{well_known}");
    }
}
