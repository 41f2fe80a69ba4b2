//! `flightlag bench`: reads records of a swing bench, writes a sensor card and pages.

use crate::arguments::{BenchArguments, RunArguments};
use crate::campaign_command::{name_for_shell, quoted, run_context, say};
use crate::failure::{End, Failure};
use crate::listen::listener;
use crate::show::{Table, count, visible};
use crate::stop::Stop;
use campaign::{BenchOrder, BenchVerdict, bench_run};
use flight::{Notice, Severity, fixed};
use record::{BenchOutcome, CardChannel, CardMagnetometer, Estimate, Finding, MOVING_AVERAGE, TimeBasis, Verdict};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Half-width of a displayed 95 % interval in standard uncertainties.
const COVERAGE: f64 = 2.0;

pub(crate) fn run(arguments: &BenchArguments, stop: &Stop) -> Result<End, Failure> {
    let order = BenchOrder {
        records: arguments.records.clone(),
        encoder: arguments.encoder.clone(),
        rig: arguments.rig.clone(),
        out: out_of(arguments),
        forced_map: arguments.map.clone(),
        maps_folder: arguments.maps.clone(),
        replace: arguments.replace,
        card: arguments.card.clone(),
        command: command_of(arguments),
    };
    let verdict = run_order(&order, &arguments.common, stop)?;
    Ok(verdict.exit().into())
}

/// Runs a bench and reports the result.
pub(crate) fn run_order(order: &BenchOrder, arguments: &RunArguments, stop: &Stop) -> Result<BenchVerdict, Failure> {
    let events = listener(arguments);
    let verdict = bench_run(order, &run_context(arguments, stop, events.as_ref()))?;
    if !arguments.json && !arguments.quiet {
        write_all(&summary(&verdict))?;
    }
    let measured = verdict.rows.iter().filter(|r| r.outcome == BenchOutcome::Measured).count();
    let mut parts = vec![format!("{measured} measured")];
    let failed = verdict.rows.len() - measured;
    let lossy = verdict.rows.iter().filter(|r| r.lossy).count();
    let others = [(failed, "without a number"), (lossy, "with damaged logs")];
    parts.extend(others.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")));
    say(arguments, &format!("{}: {}", count(verdict.rows.len() as u64, "record"), parts.join(", ")))?;
    match &verdict.card_file {
        Some(card) => say(arguments, &format!("sensor card {}", card.display()))?,
        None => say(arguments, "no sensor card: nothing was measured")?,
    }
    say(arguments, &format!("open {}", verdict.page.display()))?;
    Ok(verdict)
}

/// Prints text whose control characters are already escaped.
fn write_all(text: &str) -> Result<(), Failure> {
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}

/// The card as a table, the references of its delays, and remarks about the records. What puts the card in doubt comes
/// first.
fn summary(verdict: &BenchVerdict) -> String {
    let mut text = String::new();
    for row in &verdict.rows {
        let reason = match &row.outcome {
            BenchOutcome::Measured => continue,
            BenchOutcome::NotMeasurable { reason } => format!("not measurable: {reason}"),
            BenchOutcome::Failed { reason } => format!("failed: {reason}"),
        };
        text += &format!("{}: {}\n", visible(&row.name), visible(&reason));
    }
    let is_in_doubt = verdict.channels().iter().any(CardChannel::is_in_doubt);
    if is_in_doubt {
        text += &remarks(verdict);
    }
    let mut table =
        Table::new(&["channel", "verdict", "delay ms|", "± U (k = 2)|", "as seen ms|", "gain|", "± U|", "records|"]);
    verdict.channels().iter().for_each(|channel| table.row(cells(channel)));
    if !table.is_empty() {
        text += &table.text();
    }
    for line in anchors(verdict.channels()).into_iter().chain(verdict.channels().iter().filter_map(lag)) {
        text += &format!("  {}\n", visible(&line));
    }
    if let Some(magnetometer) = verdict.card.as_ref().and_then(|card| card.magnetometer.as_ref()) {
        text += &format!("  {}\n", visible(&iron(magnetometer)));
    }
    if !is_in_doubt {
        text += &remarks(verdict);
    }
    text
}

fn remarks(verdict: &BenchVerdict) -> String {
    let line = |notice: &Notice| {
        let place = if notice.place.is_empty() { String::new() } else { format!("{}: ", notice.place) };
        format!("  {}{}\n", visible(&place), visible(&notice.text))
    };
    verdict.notices.iter().filter(|n| n.severity != Severity::Info).map(line).collect()
}

fn cells(channel: &CardChannel) -> Vec<String> {
    let (u_ms, u_gain) =
        (COVERAGE * channel.delay_standard_uncertainty_s * 1e3, COVERAGE * channel.gain_standard_uncertainty);
    let digits_of_gain = digits(u_gain);
    let of_gain = |value: f64| match channel.has_lag() {
        true => "-".to_owned(),
        false => fixed(value, digits_of_gain),
    };
    let digits = digits(u_ms);
    vec![
        channel.name.clone(),
        verdict_word(channel.verdict).to_owned() + if channel.is_in_doubt() { ", in doubt" } else { "" },
        fixed(channel.delay_s * 1e3, digits),
        format!("{u_ms:.digits$}"),
        channel.as_seen_delay_s.map_or_else(|| "-".to_owned(), |s| fixed(s * 1e3, digits)),
        of_gain(channel.gain),
        of_gain(u_gain),
        channel.records.to_string(),
    ]
}

/// Decimals that show two significant digits of an uncertainty, at most four.
fn digits(uncertainty: f64) -> usize {
    let limits = [10.0, 1.0, 0.1, 0.01];
    limits.iter().position(|limit| uncertainty >= *limit).unwrap_or(limits.len())
}

/// Hard and soft iron in one line; the soft iron values are on the page.
fn iron(magnetometer: &CardMagnetometer) -> String {
    let name = &magnetometer.channel;
    let found = match &magnetometer.iron {
        Finding::Found(found) => found,
        Finding::CannotTell(why) => return format!("hard and soft iron of {name} are unknown: {why}"),
    };
    let (factor, unit) = if magnetometer.unit == "T" { (1e6, " µT") } else { (1.0, "") };
    let axis = |(value, u): (&f64, &f64)| {
        let u = COVERAGE * u * factor;
        let digits = digits(u);
        format!("{} ± {u:.digits$}", fixed(value * factor, digits))
    };
    let axes = found.hard_iron.iter().zip(&found.hard_iron_standard_uncertainty);
    let axes: Vec<String> = axes.map(axis).collect();
    let swings = count(magnetometer.azimuths_rad.len() as u64, "swing");
    format!("{name}: hard iron {}{unit} (k = 2) from {swings}; soft iron is on the card", axes.join(", "))
}

fn verdict_word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Delayed => "delayed",
        Verdict::Early => "early",
        Verdict::EquivalentToZero => "equivalent to zero",
        Verdict::Inconclusive => "inconclusive",
        Verdict::NotMeasurable => "not measurable",
    }
}

/// The parameters of a filter lag, unless the channel is in doubt: the delay in the table is only the best fit for the
/// bench's swing.
fn lag(channel: &CardChannel) -> Option<String> {
    let number = |value_s: f64, u_s: Option<f64>| {
        let u_ms = u_s.map(|u| COVERAGE * u * 1e3);
        let digits = digits(u_ms.unwrap_or(1.0));
        let value = fixed(value_s * 1e3, digits);
        u_ms.map_or_else(|| format!("{value} ms"), |u| format!("{value} ± {u:.digits$} ms"))
    };
    let of = |lag: Estimate| number(lag.value, lag.standard_uncertainty);
    let lags: Vec<String> = channel.lags_as_named().into_iter().map(of).collect();
    let averages = channel.model.starts_with(MOVING_AVERAGE);
    let motion = if averages { "motion at any speed" } else { "slow motion" };
    let slow = channel
        .slow_motion_delay_s
        .map(|slow_s| format!(", so {motion} is {} late", number(slow_s, channel.slow_motion_standard_uncertainty_s)));
    let only = match averages {
        true => String::new(),
        false => format!("; {:.1} ms is only the pure delay that fits this swing best", channel.delay_s * 1e3),
    };
    (channel.has_lag() && !channel.is_in_doubt()).then(|| {
        format!(
            "{}: {} of {}{}{only}; the gain depends on the frequency",
            channel.name,
            channel.model,
            lags.join(" and "),
            slow.unwrap_or_default()
        )
    })
}

/// Which delays are relative, and to what.
fn anchors(channels: &[CardChannel]) -> Vec<String> {
    let line = |c: &CardChannel| match &c.basis {
        TimeBasis::OneClock | TimeBasis::Pps => None,
        TimeBasis::FastestArrivals => Some(
            "delays include the least transport latency from the device to the logger, which is not logged: the \
             clocks are tied by the fastest arrivals"
                .to_owned(),
        ),
        TimeBasis::Anchor { channel } => {
            Some(format!("delays are relative to {channel}, which is assumed to be on time: the clocks differ"))
        }
    };
    let lines: std::collections::BTreeSet<String> = channels.iter().filter_map(line).collect();
    lines.into_iter().collect()
}

/// The report folder; by default `reports/bench-NAME` in the working folder.
fn out_of(arguments: &BenchArguments) -> PathBuf {
    let usual = || {
        let first = arguments.records.first().cloned().unwrap_or_default();
        let first = first.canonicalize().unwrap_or(first);
        let name = first.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Path::new("reports").join(format!("bench-{name}"))
    };
    arguments.out.clone().unwrap_or_else(usual)
}

/// The command that reproduces the report, with names instead of paths: the same on every machine.
fn command_of(arguments: &BenchArguments) -> String {
    let mut command = "flightlag bench".to_owned();
    for record in &arguments.records {
        command += &format!(" {}", name_for_shell(record));
    }
    let options = [("--rig", &arguments.rig), ("--encoder", &arguments.encoder), ("--maps", &arguments.maps)];
    for (option, path) in options {
        if let Some(path) = path {
            command += &format!(" {option} {}", name_for_shell(path));
        }
    }
    if let Some(map) = &arguments.map {
        command += &format!(" --map {}", quoted(map));
    }
    command + " --out REPORT"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_uncertainty_has_two_digits_and_its_value_matches() {
        assert_eq!([34.2, 3.42, 0.342, 0.0342, 0.00342, 0.0].map(digits), [0, 1, 2, 3, 4, 4]);
    }
}
