//! HTML pages for people. Numbers are rounded only here.

mod anomalies;
mod bench;
mod campaign;
mod card;
mod cards;
mod changes;
mod criteria;
mod diff;
mod explorer;
mod flight;
mod flight_delay;
mod health;
mod lateness;
mod method;
mod night;
mod provenance;
mod reports;
mod run_changes;
mod score;
mod style;
mod sweep;
mod test_card;
mod trend;

pub use bench::{BenchPage, bench_site};
pub use campaign::{TABLE_FOLDER, TrackExcerpt, campaign_site, excerpt_flights};
pub use card::{CardPage, CardRecord, WithoutMean, card_site};
pub use cards::{IndexedCard, cards_site};
pub use changes::changes_site;
pub use diff::diff_site;
pub use flight::{FlightPage, flight_site};
pub use night::night_site;
pub use reports::{REPORTS_TITLE, ReportEntry, reports_page};
#[cfg(test)]
pub(crate) use style::{CSS, TABLE_SCRIPT};
pub use trend::trend_site;

use crate::draw;
use crate::figure::Figure;
use crate::number;
use crate::site::FIGURES_ZIP;
use crate::text::{sentence, shown, shown_block};
use crate::verdict;
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};
use record::{Estimate, Finding, SensorIdentity, TimeBasis, Verdict};

/// What a page needs besides the common style sheet. Every page is readable without its script.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Needs {
    /// No script.
    Nothing,
    /// The script for a wide table.
    Table,
    /// The script of the flight explorer.
    Explorer,
    /// The script that shifts the reference of a bench record.
    Bench,
}

/// A whole page.
fn document(title: &str, needs: Needs, body: Markup) -> String {
    let (script, packed, css): (_, Option<(&str, &str)>, _) = match needs {
        Needs::Nothing => (None, None, ""),
        Needs::Table => (Some(style::TABLE_SCRIPT), None, ""),
        Needs::Explorer => {
            let packed = (style::EXPLORER_SCRIPT, style::PACKED_EXPLORER.as_str());
            (Some(style::UNPACK_SCRIPT), Some(packed), style::EXPLORER_CSS)
        }
        Needs::Bench => {
            let packed = (style::BENCH_SCRIPT, style::PACKED_BENCH.as_str());
            (Some(style::UNPACK_SCRIPT), Some(packed), style::EXPLORER_CSS)
        }
    };
    let body = body.into_string();
    let of_tables = body.contains("<table>").then_some(style::CSV_SCRIPT);
    let scripts: Vec<&str> = script.into_iter().chain(of_tables).collect();
    let allowed: Vec<&str> = scripts.iter().copied().chain(packed.map(|(plain, _)| plain)).collect();
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(style::content_security_policy(&allowed));
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="generator" content={ "flightlag report " (crate::REPORT_VERSION) };
                title { (sentence(title)) }
                style { (PreEscaped(css)) (PreEscaped(style::CSS)) (PreEscaped(style::running_title(title))) }
            }
            body.wide[needs == Needs::Table] {
                (PreEscaped(body))
                @if let Some((_, packed)) = packed {
                    script type="text/plain" #packed-script { (PreEscaped(packed)) }
                }
                @for script in scripts { script { (PreEscaped(script)) } }
            }
        }
    }
    .into_string()
}

fn data_lost() -> Markup {
    badge("lost", "▲", "LOG DAMAGED")
}

/// A small part of the log was lost. No result is affected.
fn minor_loss() -> Markup {
    badge("unsure", "▲", "minor loss")
}

/// The log ends inside its last record. No result is affected.
fn tail_cut() -> Markup {
    badge("off", "–", "tail cut")
}

/// A verdict on a delay.
fn verdict_badge(verdict: Verdict) -> Markup {
    let (class, icon) = match verdict {
        Verdict::Delayed => ("found", "▶"),
        Verdict::Early => ("unsure", "◀"),
        Verdict::EquivalentToZero => ("ok", "✓"),
        Verdict::Inconclusive => ("unsure", "?"),
        Verdict::NotMeasurable => ("off", "○"),
    };
    badge(class, icon, verdict::word(verdict))
}

/// The channel that all delays of a record are relative to.
fn anchor_badge() -> Markup {
    badge("off", "●", "anchor")
}

/// Verdict on a delay. If the delay is in doubt, the verdict has no colour.
fn verdict_or_doubt(verdict: Verdict, is_in_doubt: bool) -> Markup {
    html! {
        @if is_in_doubt { (verdict::word(verdict)) ", " (in_doubt()) } @else { (verdict_badge(verdict)) }
    }
}

fn in_doubt() -> Markup {
    badge("bad", "✗", "in doubt")
}

/// Whether a check or a goal is met.
fn met_badge(met: bool) -> Markup {
    if met { badge("ok", "✓", "yes") } else { badge("bad", "✗", "no") }
}

/// What a delay is measured against.
fn basis(basis: &TimeBasis) -> Markup {
    html! {
        @match basis {
            TimeBasis::OneClock => { "one clock" }
            TimeBasis::Pps => { "pulse per second" }
            TimeBasis::FastestArrivals => { "fastest arrivals" }
            TimeBasis::Anchor { channel } => { "relative to " code { (shown(channel)) } }
        }
    }
}

/// Sensor identity in one line.
fn sensor_name(sensor: &SensorIdentity) -> String {
    let serial = sensor.serial.as_ref().map(|s| format!(", serial {s}"));
    let firmware = sensor.firmware.as_ref().map(|f| format!(", firmware {f}"));
    let baud = sensor.baud.map(|b| format!(", {b} baud"));
    let configuration = sensor.configuration.as_ref().map(|c| format!(", {c}"));
    let parts = [Some(sensor.model.clone()), serial, firmware, baud, configuration];
    parts.into_iter().flatten().collect()
}

fn badge(class: &str, icon: &str, word: &str) -> Markup {
    html! { span class={ "badge " (class) } { span aria-hidden="true" { (icon) " " } (word) } }
}

/// `6.984 ± 0.020` without a line break, or the value alone. The markup has the value at full precision.
fn estimate(estimate: &Estimate) -> Markup {
    let bits = Some(estimate.value).filter(|v| v.is_finite());
    html! { data value=[bits] { (number::with_uncertainty(estimate)) } }
}

/// Expanded uncertainty of a cell to two digits, for the CSV file.
fn expanded(value: &Estimate) -> Option<f64> {
    let u = value.standard_uncertainty.map(|u| number::COVERAGE_FACTOR * u).filter(|u| u.is_finite())?;
    format!("{u:.1e}").parse().ok()
}

/// An estimate, or a dash if it is absent.
fn maybe_estimate(value: Option<&Estimate>) -> Markup {
    maybe(value, estimate)
}

/// A cell whose number may be absent. An absent number is a dash, never zero.
fn maybe<T>(value: Option<T>, show: impl FnOnce(T) -> Markup) -> Markup {
    match value {
        Some(value) => show(value),
        None => html! { span.none title="the record has no such number" { "—" } },
    }
}

/// The first rows of a list and the number of further rows. This limits the size of a page for any log.
fn rows<T>(all: &[T], most: usize, columns: usize, row: impl Fn(&T) -> Markup) -> Markup {
    html! {
        @for item in all.iter().take(most) { (row(item)) }
        @if all.len() > most {
            tr { td colspan=(columns) { (more(all.len() - most)) } }
        }
    }
}

fn more(count: usize) -> String {
    format!("and {} more, in the record (JSON)", number::count(count as u64))
}

/// A column head: numbers are right-aligned, text is left-aligned.
#[derive(Clone, Copy)]
enum Head {
    Text(&'static str),
    Number(&'static str),
}

impl Render for Head {
    fn render(&self) -> Markup {
        match self {
            Head::Text(name) => html! { th scope="col" { (name) } },
            Head::Number(name) => html! { th.n scope="col" { (name) } },
        }
    }
}

/// A table that scrolls on its own if it is wider than the page, and can be focused by keyboard.
fn table(caption: &str, head: &[Head], body: impl Render) -> Markup {
    table_of(caption, html! { tr { @for column in head { (column) } } }, body)
}

/// A table with a custom header row.
fn table_of(caption: &str, head: impl Render, body: impl Render) -> Markup {
    html! {
        div.scroll tabindex="0" role="region" aria-label=(sentence(caption)) {
            table {
                caption { (shown(caption)) }
                thead { (head) }
                tbody { (body) }
            }
        }
    }
}

fn figure(figure: &Figure) -> Markup {
    html! {
        figure id=(figure.id) {
            (PreEscaped(draw::svg_inline(figure)))
            figcaption {
                b { "Figure " (figure.number) ". " (figure.title) ". " }
                (figure.caption) " "
                a.file href=(FIGURES_ZIP) download="" title={ "Holds " (figure.id) ".svg and " (figure.id) ".csv" } {
                    "SVG and CSV"
                }
                @if !figure.how_to_read.is_empty() { span.read { b { "How to read it. " } (figure.how_to_read) } }
            }
        }
    }
}

/// Links to files in the folder of the page.
fn files(names: &[&str]) -> Markup {
    html! {
        p.note {
            "Files in the folder of this page: "
            @for (i, name) in names.iter().enumerate() { @if i > 0 { ", " } a href=(name) download="" { (name) } }
            "."
        }
    }
}

fn command_block(command: &str) -> Markup {
    html! { pre.command tabindex="0" { code { (shown_block(command)) } } }
}

/// Title and hash of the pipeline.
fn pipeline_rows(pipeline: &record::PipelineUse) -> Markup {
    html! {
        tr { th scope="row" { "Pipeline" } td { (shown(&pipeline.title)) } }
        tr { th scope="row" { "Pipeline BLAKE3" } td.hash { (shown(&pipeline.blake3)) } }
    }
}

/// Versions that determine the numbers and the bytes of a page.
fn versions(record: u32, analysis: u32) -> String {
    format!("record {record}, analysis {analysis}, report {}", crate::REPORT_VERSION)
}

fn pipeline_details(pipeline: &record::PipelineUse) -> Markup {
    settings_details("Pipeline settings as they were used (TOML)", &pipeline.toml)
}

/// A settings file, collapsed.
fn settings_details(summary: &str, toml: &str) -> Markup {
    html! {
        details {
            summary { (summary) }
            pre tabindex="0" { code { (shown_block(toml)) } }
        }
    }
}

/// A dash and the reason why there is no number.
fn no_number(why: &str) -> Markup {
    html! { span.none { "— " (shown(why)) } }
}

/// A number, or a dash with the reason why there is none.
fn or_why<T>(value: Option<T>, why: &str, show: impl FnOnce(T) -> Markup) -> Markup {
    value.map_or_else(|| no_number(why), show)
}

/// A finding, or the reason why it is unknown.
fn finding<'a, T>(found: &'a Finding<T>, show: impl FnOnce(&'a T) -> Markup) -> Markup {
    match found {
        Finding::Found(found) => show(found),
        Finding::CannotTell(why) => no_number(why),
    }
}

/// A table row with a name and a value.
fn fact(name: &str, value: impl Render) -> Markup {
    html! { tr { th scope="row" { (name) } td.any { (value) } } }
}

/// A number shown with `digits` significant digits. The markup has it at full precision.
fn plain(value: f64, digits: i32) -> Markup {
    html! { data value=[Some(value).filter(|v| v.is_finite())] { (number::significant(value, digits)) } }
}

/// A number from the settings, shown exactly. The markup has it at full precision.
fn exact(value: f64) -> Markup {
    html! { data value=[Some(value).filter(|v| v.is_finite())] { (number::exact(value)) } }
}

/// Links to the sections of a page.
fn contents(parts: &[(&str, &str)]) -> Markup {
    html! { nav aria-label="On this page" { @for (id, name) in parts { a href={ "#" (id) } { (name) } } } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_policy_of_a_page_has_the_hash_of_its_script() {
        let page = document("t", Needs::Table, html! { p { "x" } });
        let script = page.split("<script>").nth(1).and_then(|rest| rest.split("</script>").next()).unwrap();
        // The attribute may escape the quotes of the policy. Compare only the hash.
        let policy = style::content_security_policy(&[script]);
        let hash = policy.split("sha256-").nth(1).unwrap().trim_end_matches('\'');
        assert!(page.contains(hash));
        assert!(!document("t", Needs::Nothing, html! {}).contains("script"));
    }
}
