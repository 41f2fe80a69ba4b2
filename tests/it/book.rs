//! Checks the book in `docs/` and the pages at the root: commands parse, links resolve.

use crate::program::{flightlag, run, text};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// Files below a folder of the project whose names end with `ending`.
fn files(folder: &str, ending: &str) -> Vec<PathBuf> {
    let mut open = vec![root().join(folder)];
    let mut found = vec![];
    while let Some(folder) = open.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            match path.is_dir() {
                true => open.push(path),
                false if path.to_string_lossy().ends_with(ending) => found.push(path),
                false => {}
            }
        }
    }
    found.sort();
    assert!(!found.is_empty(), "no {ending} below {folder}");
    found
}

/// The book and the pages at the root that people read.
fn pages() -> Vec<(PathBuf, String)> {
    let mut pages = files("docs/src", ".md");
    pages.extend(["README.md", "ARCHITECTURE.md"].map(|name| root().join(name)));
    pages.into_iter().map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect()
}

/// Lines of a page, each with a flag for being inside a code block.
fn lines(page: &str) -> impl Iterator<Item = (&str, bool)> {
    let mut code = false;
    page.lines().map(move |line| {
        let fence = line.trim_start().starts_with("```");
        code ^= fence;
        (line, code || fence)
    })
}

/// A line without its text in backticks.
fn prose(line: &str) -> String {
    line.split('`').step_by(2).collect::<Vec<_>>().join(" ")
}

/// The arguments of a line that runs flightlag, such as `flightlag …`, `$ flightlag …` or `cargo flightlag …`.
fn arguments(line: &str) -> Option<Vec<&str>> {
    let line = line.trim().trim_start_matches("$ ");
    let rest = line.strip_prefix("cargo ").unwrap_or(line).strip_prefix("flightlag ")?;
    Some(rest.split('#').next()?.split_whitespace().take_while(|word| !["|", ">", "&&"].contains(word)).collect())
}

#[test]
fn every_command_in_the_book_is_valid() {
    let mut helps: BTreeMap<Vec<&str>, String> = BTreeMap::new();
    let mut pages = pages();
    // Its code is help, in which a line may begin with the name of the command.
    pages.retain(|(path, _)| !path.ends_with("commands.md"));
    let mut commands = 0;
    for (path, page) in &pages {
        for arguments in lines(page).filter(|(_, code)| *code).filter_map(|(line, _)| arguments(line)) {
            let steps = ["plan", "task", "reduce", "status"];
            let words = if arguments.get(1).is_some_and(|step| steps.contains(step)) { 2 } else { 1 };
            let verb = arguments[..words].to_vec();
            let help = helps.entry(verb.clone()).or_insert_with(|| {
                let output = flightlag(verb.iter().chain(&["--help"])).output().unwrap();
                assert!(output.status.success(), "{}: no command {verb:?}", path.display());
                text(&output.stdout)
            });
            for option in arguments.iter().filter(|word| word.starts_with("--")) {
                let option = option.split('=').next().unwrap();
                let known = help.split(|c: char| !(c.is_alphanumeric() || c == '-')).any(|word| word == option);
                assert!(known, "{}: {verb:?} has no option {option}", path.display());
            }
            commands += 1;
        }
    }
    assert!(commands > 20, "{commands} commands: are the code blocks still found?");
}

/// The anchor that mdBook and code hosts generate for a heading.
fn anchor(heading: &str) -> String {
    let kept = heading.trim_start_matches('#').trim().to_lowercase();
    kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).collect::<String>().replace(' ', "-")
}

#[test]
fn every_link_in_the_book_resolves() {
    let mut links = 0;
    for (path, page) in pages() {
        for line in lines(&page).filter(|(_, code)| !code).map(|(line, _)| prose(line)) {
            for target in line.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()) {
                if target.contains("://") {
                    continue;
                }
                let (file, heading) = target.split_once('#').unwrap_or((target, ""));
                let file = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
                assert!(file.exists(), "{}: no file {target}", path.display());
                let has =
                    |page: String| lines(&page).any(|(l, code)| !code && l.starts_with('#') && anchor(l) == heading);
                let resolves = heading.is_empty() || has(fs::read_to_string(&file).unwrap());
                assert!(resolves, "{}: no heading {target}", path.display());
                links += 1;
            }
        }
    }
    assert!(links > 40, "{links} links");
}

#[test]
fn every_page_of_the_book_is_in_the_summary() {
    let summary = fs::read_to_string(root().join("docs/src/SUMMARY.md")).unwrap();
    for path in files("docs/src", ".md") {
        let name = path.strip_prefix(root().join("docs/src")).unwrap().to_str().unwrap().replace('\\', "/");
        assert!(name == "SUMMARY.md" || summary.contains(&format!("({name})")), "{name} is not in SUMMARY.md");
    }
}

/// Words and phrases of no flight-test desk, with a blank before and after.
const DIALECT: [&str; 11] = [
    " told ",
    " tells ",
    " anew ",
    " nobody ",
    " stands ",
    " beside ",
    " whatever else ",
    " leads nowhere ",
    " of which none ",
    " that is none ",
    " one behind another ",
];

/// Fails if a line of prose holds dialect. `place` is where it is from.
fn assert_plain(line: &str, place: &str) {
    let line = line.to_lowercase();
    let words: Vec<&str> = line.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
    let spaced = format!(" {} ", words.join(" "));
    let spaced =
        ["stands still", "stands for", "stands out"].iter().fold(spaced, |text, plain| text.replace(plain, ""));
    for phrase in DIALECT {
        assert!(!spaced.contains(phrase), "{place}: {phrase:?} in: {line}");
    }
}

#[test]
fn the_pages_are_in_plain_english() {
    for (path, page) in pages() {
        for line in lines(&page).filter(|(_, code)| !code).map(|(line, _)| prose(line)) {
            assert_plain(&line, &path.display().to_string());
        }
    }
}

/// String literals of a source, without tests and comments.
fn literals(source: &str) -> Vec<String> {
    let source = source.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    let mut found = vec![];
    let mut rest = source;
    while let Some(at) = rest.find(['"', '\'', '/']) {
        let (from, tail) = rest.split_at(at);
        rest = match tail.as_bytes() {
            [b'/', b'/', ..] => tail.split_once('\n').map_or("", |(_, next)| next),
            // A quote as a character, `'"'`.
            [b'\'', b'"', b'\'', ..] => &tail[3..],
            [b'"', ..] if from.ends_with('#') => tail[1..].split_once("\"#").map_or("", |(_, next)| next),
            [b'"', ..] => {
                let escapes = |end: usize| tail[1..end].bytes().rev().take_while(|b| *b == b'\\').count();
                let end = tail.match_indices('"').map(|(end, _)| end).find(|end| *end > 0 && escapes(*end) % 2 == 0);
                let end = end.unwrap_or(tail.len() - 1);
                found.push(tail[1..end.max(1)].to_owned());
                &tail[end + 1..]
            }
            _ => &tail[1..],
        };
    }
    found
}

#[test]
fn the_texts_of_the_source_are_in_plain_english() {
    let is_test = |path: &Path| path.ends_with("tests.rs") || path.components().any(|c| c.as_os_str() == "tests");
    let mut texts = 0;
    for path in files("crates", ".rs").into_iter().filter(|path| !is_test(path)) {
        for text in literals(&fs::read_to_string(&path).unwrap()).iter().filter(|text| text.contains(' ')) {
            assert_plain(text, &path.display().to_string());
            texts += 1;
        }
    }
    assert!(texts > 3000, "{texts} texts: are literals still found?");
}

/// The help of a command and of those below it, as sections of a page.
fn help_of(command: &[&str], page: &mut String) {
    let shown = flightlag(command.iter().chain(&["--help"])).env("COLUMNS", "110").output().unwrap();
    assert!(shown.status.success(), "{command:?}");
    let help = text(&shown.stdout);
    let title = std::iter::once("flightlag").chain(command.iter().copied()).collect::<Vec<_>>().join(" ");
    *page += &format!("\n{} {title}\n\n```text\n{}\n```\n", "##", help.trim_end());
    let below = help.split_once("Commands:\n").map_or("", |(_, list)| list.split("\n\n").next().unwrap());
    let names = below.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    for name in names.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help") {
        help_of(&[command, &[name]].concat(), page);
    }
}

/// `FLIGHTLAG_BLESS=1` writes it again.
#[test]
fn the_page_of_commands_is_their_help() {
    let mut page =
        "# Commands\n\n<!-- Made from `flightlag COMMAND --help`: `just bless` writes it again. -->\n".to_owned();
    help_of(&[], &mut page);
    let path = root().join("docs/src/commands.md");
    if std::env::var_os("FLIGHTLAG_BLESS").is_some() {
        fs::write(&path, &page).unwrap();
    }
    assert!(fs::read_to_string(&path).unwrap() == page, "docs/src/commands.md: accept a change with `just bless`");
    assert!(page.matches("\n## flightlag").count() > 20);
    page.lines().for_each(|line| assert_plain(line, "--help"));
}

#[test]
fn the_book_lists_every_channel_map() {
    let book = fs::read_to_string(root().join("docs/src/formats.md")).unwrap();
    for map in files("pipelines/channel-maps", ".toml") {
        let name = map.file_stem().unwrap().to_str().unwrap();
        assert!(book.contains(&format!("`{name}`")), "{name} is not in formats.md");
    }
}

/// The metric of a line such as `* error-rms  [m, mm; needs compensator]`.
fn metric_of_line(line: &str) -> Option<&str> {
    let rest = line.strip_prefix("* ").or_else(|| line.strip_prefix("  "))?;
    rest.split(' ').next().filter(|name| !name.is_empty())
}

#[test]
fn the_book_lists_every_metric_of_criteria() {
    let book = fs::read_to_string(root().join("docs/src/criteria.md")).unwrap();
    let listed = text(&run(["criteria"], 0).stdout);
    let names: Vec<&str> = listed.lines().filter(|line| line.contains(" [")).filter_map(metric_of_line).collect();
    assert!(names.len() > 20, "{listed}");
    for name in names {
        assert!(book.contains(&format!("`{name}`")), "{name} is not in criteria.md");
    }
}
