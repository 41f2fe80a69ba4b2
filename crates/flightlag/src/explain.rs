//! `flightlag explain`: what a code of a notice or an alarm means. The texts are those of the book's page of notices.

use crate::arguments::ExplainArguments;
use crate::failure::{End, Failure};
use crate::show::visible;
use campaign::Exit;
use std::io::Write;

/// A row of the page: a code, how grave it is, what it means, and the part of flightlag that raises it.
struct Code<'a> {
    part: &'a str,
    name: &'a str,
    severity: &'a str,
    meaning: &'a str,
}

pub(crate) fn run(arguments: &ExplainArguments) -> Result<End, Failure> {
    let all = codes(docs::NOTICES);
    let mut out = std::io::stdout().lock();
    match &arguments.code {
        None => write!(out, "{}", listed(&all))?,
        Some(code) => {
            let text = explained(&all, code).map_err(|why| Failure::new(Exit::Wrong, why))?;
            write!(out, "{text}")?;
        }
    }
    Ok(Exit::Well.into())
}

/// The rows of all tables whose first cell is a code.
fn codes(page: &str) -> Vec<Code<'_>> {
    let mut part = "";
    let mut all = vec![];
    for line in page.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            part = heading;
        }
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
        let code = cells.first().and_then(|cell| cell.strip_prefix('`')?.strip_suffix('`'));
        if let (true, Some(name), [_, severity, meaning]) = (line.starts_with('|'), code, cells.as_slice()) {
            all.push(Code { part, name, severity, meaning });
        }
    }
    all
}

/// Every row of this code: several parts may raise it. An unknown code is an error with the nearest ones.
fn explained(all: &[Code<'_>], wanted: &str) -> Result<String, String> {
    let rows: Vec<&Code<'_>> = all.iter().filter(|code| code.name == wanted).collect();
    if rows.is_empty() {
        let near = settings::nearest_few(wanted, all.iter().map(|code| code.name), 5).join(", ");
        let near = if near.is_empty() { String::new() } else { format!("; nearest: {near}") };
        return Err(format!(
            "no notice or alarm has the code {}{near}. `flightlag explain` lists all",
            visible(wanted)
        ));
    }
    let row = |code: &&Code<'_>| {
        format!("{} ({}), {}\n  {}\n", code.name, code.severity, code.part, code.meaning.replace('`', ""))
    };
    Ok(rows.iter().map(row).collect())
}

fn listed(all: &[Code<'_>]) -> String {
    let mut text = "Codes of notices and alarms. `flightlag explain CODE` tells what one means.\n".to_owned();
    let mut part = "";
    for code in all {
        if code.part != part {
            part = code.part;
            text += &format!("\n{part}\n");
        }
        text += &format!("  {:34} {}\n", code.name, code.severity);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_explained_in_the_words_of_the_book() {
        let all = codes(docs::NOTICES);
        assert!(all.len() > 100, "{}", all.len());
        let text = explained(&all, "tail-cut").unwrap();
        assert_eq!(
            text,
            "tail-cut (info), Bytes and damage\n  The file ends inside its last record, as after power-off. Not a loss.\n"
        );
        assert!(explained(&all, "delay-steps").unwrap().starts_with("delay-steps (red), Alarms of a delay\n"));
    }

    #[test]
    fn an_unknown_code_is_answered_with_the_nearest() {
        let why = explained(&codes(docs::NOTICES), "tail-cutt").unwrap_err();
        assert!(why.contains("nearest: tail-cut"), "{why}");
    }
}
