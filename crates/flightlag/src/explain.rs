//! `flightlag explain`: what a code of a notice or an alarm means, from the catalogue, or a word of a table, from the
//! book.

use crate::arguments::ExplainArguments;
use crate::failure::{End, Failure};
use crate::show::visible;
use campaign::Exit;
use flight::{Alarm, Code, Severity};
use std::io::Write;

/// Heading of the alarms in the list.
const ALARMS: &str = "Alarms of a delay";

pub(crate) fn run(arguments: &ExplainArguments) -> Result<End, Failure> {
    let mut out = std::io::stdout().lock();
    match &arguments.code {
        None => write!(out, "{}", listed())?,
        Some(code) => {
            let text = explained(code).map_err(|why| Failure::new(Exit::Wrong, why))?;
            write!(out, "{text}")?;
        }
    }
    Ok(Exit::Well.into())
}

/// The entry of a code; for a code of an older release, that of its replacement.
fn explained(wanted: &str) -> Result<String, String> {
    if let Some(code) = Code::of_name(wanted) {
        return Ok(notice(code));
    }
    if let Some(alarm) = Alarm::ALL.iter().find(|alarm| alarm.name() == wanted) {
        let entry = alarm.entry();
        let head = format!("{alarm}: {} alarm\n{ALARMS}", entry.gravity.word());
        return Ok(shown(&head, entry.happened, entry.advice));
    }
    if let Some(code) = Code::of_former(wanted) {
        return Ok(format!("{wanted} is called {code} in this release.\n\n{}", notice(code)));
    }
    let meanings = meanings(wanted);
    if !meanings.is_empty() {
        return Ok(meanings);
    }
    let names = Code::ALL.iter().map(|code| code.name()).chain(Alarm::ALL.iter().map(|alarm| alarm.name()));
    let near = settings::nearest_few(wanted, names, 5).join(", ");
    let near = if near.is_empty() { String::new() } else { format!("; nearest: {near}") };
    Err(format!(
        "no notice, alarm or table has the word {}{near}. `flightlag explain` lists all codes",
        visible(wanted)
    ))
}

/// The meanings of a word such as `scatters` or `HARMED`, from the tables of the book, one on each line.
fn meanings(wanted: &str) -> String {
    let plain = |word: &str| word.trim_matches(['`', '+', ' ']).to_lowercase().replace(' ', "-");
    let rows = docs::WORDS.iter().flat_map(|page| page.lines()).filter_map(|line| {
        let (words, meaning) = line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | ")?;
        let is_wanted = words.split(", ").any(|word| plain(word) == plain(wanted));
        (is_wanted && meaning != "meaning").then(|| format!("{words}: {meaning}\n").replace('`', ""))
    });
    rows.collect()
}

fn notice(code: Code) -> String {
    let entry = code.entry();
    let exit = match entry.severities {
        [Severity::Loss] => "exit code 3; `delay`, `campaign` and `bench`: 0 if all losses are minor",
        severities if severities.contains(&Severity::Loss) => {
            "exit code 3 for a loss; `delay`, `campaign` and `bench`: 0 if all losses are minor"
        }
        _ if entry.happened.contains("exit code") => "exit code: see below",
        _ => "exit code 0",
    };
    let head = format!("{code}: {} ({exit})\n{}", severities(code), entry.section);
    shown(&head, entry.happened, entry.advice)
}

fn shown(head: &str, happened: &str, advice: &str) -> String {
    format!("{head}\n\nWhat happened: {happened}\nWhat to do: {advice}\n").replace('`', "")
}

fn severities(code: Code) -> String {
    code.entry().severities.iter().map(|severity| severity.word()).collect::<Vec<_>>().join(", ")
}

fn listed() -> String {
    let mut text = "Codes of notices and alarms. `flightlag explain CODE` explains one.\n".to_owned();
    let mut section = "";
    for code in Code::ALL {
        if code.entry().section != section {
            section = code.entry().section;
            text += &format!("\n{section}\n");
        }
        text += &format!("  {:30} {}\n", code.name(), severities(*code));
    }
    text += &format!("\n{ALARMS}\n");
    for alarm in Alarm::ALL {
        text += &format!("  {:30} {}\n", alarm.name(), alarm.gravity().word());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_explained_with_the_text_of_the_catalogue() {
        assert_eq!(
            explained("tail-cut").unwrap(),
            "tail-cut: info (exit code 0)\nBytes and damage\n\n\
             What happened: The file ends inside its last record, as after power-off. This is not a loss.\n\
             What to do: Nothing, unless the log should be longer: then copy it again.\n"
        );
        let damaged = explained("damaged").unwrap();
        assert!(
            damaged.starts_with("damaged: loss (exit code 3; delay, campaign and bench: 0 if all losses are minor)\n"),
            "{damaged}"
        );
        // For a warning that marks a card, the text says when.
        assert!(
            explained("rig-contradicted").unwrap().starts_with("rig-contradicted: warning (exit code: see below)\n")
        );
        assert!(explained("delay-steps").unwrap().starts_with("delay-steps: red alarm\nAlarms of a delay\n\n"));
    }

    #[test]
    fn words_of_the_tables_are_explained() {
        let kinds = ["cannot-tell", "not-tested", "scatters", "on-time", "constant", "early", "steps", "switches"];
        let others = ["drifts", "queues", "builds-up", "wanders", "jitters", "late-fixes", "bursts"];
        let effects = ["HELPED", "harmed", "no change", "cannot tell", "lateness", "datum", "group"];
        for word in kinds.iter().chain(&others).chain(&effects) {
            assert!(explained(word).is_ok_and(|text| text.len() > 20), "{word}");
        }
        assert_eq!(explained("HARMED").unwrap(), "HARMED: farther from the truth; red everywhere; exit code 4\n");
    }

    #[test]
    fn a_code_of_an_older_release_leads_to_its_replacement() {
        let text = explained("no-end").unwrap();
        assert!(
            text.starts_with("no-end is called incomplete-recording in this release.\n\nincomplete-recording: loss"),
            "{text}"
        );
    }

    #[test]
    fn an_unknown_code_gets_the_nearest_suggestion() {
        let why = explained("tail-cutt").unwrap_err();
        assert!(why.contains("nearest: tail-cut"), "{why}");
    }

    #[test]
    fn every_code_is_listed_once_and_can_be_explained() {
        let listed = listed();
        let names = Code::ALL.iter().map(|code| code.name()).chain(Alarm::ALL.iter().map(|alarm| alarm.name()));
        for name in names {
            assert_eq!(
                listed.lines().filter(|line| line.trim_start().split(' ').next() == Some(name)).count(),
                1,
                "{name}"
            );
            assert!(explained(name).is_ok(), "{name}");
        }
    }
}
