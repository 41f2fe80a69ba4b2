//! Event listeners: a progress bar on a terminal, lines elsewhere, JSON for machines.

use crate::arguments::RunArguments;
use crate::show::{bytes, count, visible};
use campaign::{Event, EventSink, Stage, Why};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use record::EffectVerdict;
use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Interval at which sums of bytes are reported to machines.
const OFTEN: Duration = Duration::from_millis(500);

/// The listener that the user wants.
pub(crate) fn listener(arguments: &RunArguments) -> Box<dyn EventSink> {
    match (arguments.json, arguments.quiet, std::io::stderr().is_terminal()) {
        (true, _, _) => Box::new(JsonLines::default()),
        (_, true, _) => Box::new(|_: &Event| {}),
        (_, _, true) => Box::new(Bar::default()),
        _ => Box::new(Lines::default()),
    }
}

/// The text of an event for a person, except progress.
fn sentence(event: &Event) -> Option<String> {
    let count = |n: &usize, what| count(*n as u64, what);
    let text = match event {
        Event::Found { flights, ignored, bytes: size } => {
            let others = match ignored {
                0 => String::new(),
                n => format!(", {}", count(n, "other file")),
            };
            format!("{}, {}{others}", count(flights, "flight"), bytes(*size))
        }
        Event::Hashing { files, bytes: size } => format!("hashing {}, {}", count(files, "file"), bytes(*size)),
        Event::Planned { stage: Some(Stage::Measure), to_run, .. } => format!("{} to measure", count(to_run, "flight")),
        Event::Planned { reused, to_run, .. } => {
            let (to_run, reused) = (count(to_run, "flight"), count(reused, "flight"));
            format!("{to_run} to replay, {reused} with a result already")
        }
        Event::DelayMeasured { flight, words, .. } => format!("{flight}: {words}"),
        Event::Finished { flight, outcome, reason, lossy, effect, .. } => {
            finished(flight, result_word(outcome, *effect), reason.as_deref(), *lossy)
        }
        Event::Troubled { flight, reason } => format!("{flight}: no result: {reason}"),
        Event::Remark { text } => text.clone(),
        Event::Reduced { pages, kept } => format!("{} made, {kept} kept", count(pages, "page")),
        Event::Logs { logs, bytes: size } => format!("{}, {}", count(logs, "log"), bytes(*size)),
        Event::Measuring { records } => format!("measuring {}", count(records, "record")),
        // The summary gives the reason.
        Event::Measured { outcome, .. } if *outcome != "measured" => return None,
        Event::Measured { record, outcome, reason, lossy } => finished(record, outcome, reason.as_deref(), *lossy),
        Event::NothingChanged => "nothing changed".to_owned(),
        Event::Campaign { name, flights } => format!("campaign {name}: {}", flights.display()),
        _ => return None,
    };
    Some(text)
}

/// As on the page badges: a flight that cannot be measured is not a flight without change.
fn result_word(outcome: &str, effect: Option<EffectVerdict>) -> &str {
    match (outcome, effect) {
        ("not-measurable", _) => "not measurable",
        ("failed", _) => outcome,
        (_, Some(effect)) => effect_word(effect),
        (_, None) => outcome,
    }
}

fn effect_word(effect: EffectVerdict) -> &'static str {
    match effect {
        EffectVerdict::Helped => "helped",
        EffectVerdict::NoChange => "no change",
        EffectVerdict::Harmed => "HARMED",
        EffectVerdict::CannotTell => "effect unknown",
    }
}

fn finished(flight: &str, outcome: &str, reason: Option<&str>, lossy: bool) -> String {
    let reason = reason.map(|r| format!(": {r}")).unwrap_or_default();
    let lossy = if lossy { " (log damaged)" } else { "" };
    format!("{flight}: {outcome}{lossy}{reason}")
}

fn reasons(why: &[Why]) -> String {
    why.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Lines on standard error, each with the overall progress.
#[derive(Default)]
struct Lines {
    progress: Mutex<(usize, usize)>,
}

impl EventSink for Lines {
    fn event(&self, event: &Event) {
        let mut progress = self.progress.lock().unwrap_or_else(|e| e.into_inner());
        let text = match event {
            Event::Planned { to_run, .. } => {
                *progress = (0, *to_run);
                sentence(event)
            }
            Event::Started { flight, stage, why, bytes: size } => {
                Some(format!("{flight}: {stage}: reading {}: {}", bytes(*size), reasons(why)))
            }
            Event::Finished { .. } | Event::DelayMeasured { .. } | Event::Troubled { .. } => {
                progress.0 += 1;
                sentence(event).map(|s| format!("[{}/{}] {s}", progress.0, progress.1))
            }
            _ => sentence(event),
        };
        if let Some(text) = text {
            let _ = writeln!(std::io::stderr(), "{}", visible(&text));
        }
    }
}

/// A bar with flights done, bytes per second and the time left; problems are printed above it.
struct Bar {
    bar: ProgressBar,
    flights: Mutex<(usize, usize)>,
}

impl Default for Bar {
    fn default() -> Bar {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
        let template =
            "{prefix} [{wide_bar}] {decimal_bytes}/{decimal_total_bytes} {decimal_bytes_per_sec}, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        Bar { bar, flights: Mutex::default() }
    }
}

impl Bar {
    fn begin(&self, prefix: String, total: u64) {
        self.bar.set_length(total);
        self.bar.reset();
        self.bar.set_prefix(prefix);
    }

    fn advance(&self, n: u64) {
        // A file that is read twice must not take the bar past its end.
        let room = self.bar.length().unwrap_or(0).saturating_sub(self.bar.position());
        self.bar.inc(n.min(room));
    }

    fn flight_done(&self) {
        let mut flights = self.flights.lock().unwrap_or_else(|e| e.into_inner());
        flights.0 += 1;
        self.bar.set_prefix(format!("{} of {} flights", flights.0, flights.1));
    }

    fn say(&self, event: &Event) {
        if let Some(text) = sentence(event) {
            self.bar.suspend(|| drop(writeln!(std::io::stderr(), "{}", visible(&text))));
        }
    }
}

impl EventSink for Bar {
    fn event(&self, event: &Event) {
        match event {
            Event::Hashing { bytes, .. } => self.begin("hashing".to_owned(), *bytes),
            Event::Planned { to_run, bytes, .. } => {
                if *to_run > 1 {
                    self.say(event);
                }
                *self.flights.lock().unwrap_or_else(|e| e.into_inner()) = (0, *to_run);
                self.begin(format!("0 of {to_run} flights"), *bytes);
            }
            Event::Hashed { bytes } | Event::Read { bytes } => self.advance(*bytes),
            Event::DelayMeasured { .. } => self.flight_done(),
            Event::Finished { outcome, lossy, effect, .. } => {
                self.flight_done();
                let fine = matches!(*outcome, "compensated" | "uncompensated");
                if !fine || *lossy || *effect == Some(EffectVerdict::Harmed) {
                    self.say(event);
                }
            }
            Event::Troubled { .. } => {
                self.flight_done();
                self.say(event);
            }
            Event::Logs { logs, bytes } => self.begin(format!("reading {}", count(*logs as u64, "log")), *bytes),
            Event::Measuring { records } => {
                self.bar.set_prefix(format!("measuring {}", count(*records as u64, "record")));
            }
            Event::Measured { lossy, .. } => {
                if *lossy {
                    self.say(event);
                }
            }
            Event::Done { .. } | Event::Carded { .. } => self.bar.finish_and_clear(),
            _ => self.say(event),
        }
    }
}

/// Every event as one line of JSON on standard output; bytes are summed and reported periodically.
struct JsonLines {
    sums: Mutex<Sums>,
}

struct Sums {
    hashed: u64,
    read: u64,
    last_report: Instant,
}

impl Default for JsonLines {
    fn default() -> JsonLines {
        JsonLines { sums: Mutex::new(Sums { hashed: 0, read: 0, last_report: Instant::now() }) }
    }
}

impl Sums {
    /// Takes the sums if they are due, or if another event is about to be reported.
    fn due(&mut self, now: bool) -> Vec<Event> {
        if !now && self.last_report.elapsed() < OFTEN {
            return vec![];
        }
        self.last_report = Instant::now();
        let (hashed, read) = (std::mem::take(&mut self.hashed), std::mem::take(&mut self.read));
        let mut events = vec![];
        if hashed > 0 {
            events.push(Event::Hashed { bytes: hashed });
        }
        if read > 0 {
            events.push(Event::Read { bytes: read });
        }
        events
    }
}

impl EventSink for JsonLines {
    fn event(&self, event: &Event) {
        let mut sums = self.sums.lock().unwrap_or_else(|e| e.into_inner());
        let lines = match event {
            Event::Hashed { bytes } => {
                sums.hashed += bytes;
                sums.due(false)
            }
            Event::Read { bytes } => {
                sums.read += bytes;
                sums.due(false)
            }
            other => {
                let mut lines = sums.due(true);
                lines.push(other.clone());
                lines
            }
        };
        for text in lines.iter().filter_map(|e| serde_json::to_string(e).ok()) {
            // A closed pipe does not stop the campaign.
            let _ = writeln!(std::io::stdout(), "{text}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unmeasurable_flight_is_shown_as_not_measurable() {
        assert_eq!(result_word("not-measurable", Some(EffectVerdict::NoChange)), "not measurable");
        assert_eq!(result_word("compensated", Some(EffectVerdict::Harmed)), "HARMED");
        assert_eq!(result_word("uncompensated", Some(EffectVerdict::NoChange)), "no change");
        assert_eq!(result_word("failed", None), "failed");
    }
}
