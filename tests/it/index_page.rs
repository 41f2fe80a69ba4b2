//! The page of a campaign in a real browser: sorting, filtering, saving and keyboard navigation of its table.

use crate::browser::Browser;
use record::{CampaignRecord, FlightRow};
use report::campaign_site;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

#[path = "../../crates/report/tests/it/campaign_fixture.rs"]
mod campaign_fixture;

/// The page of a number of flights on disk.
struct Index {
    folder: PathBuf,
    record: CampaignRecord,
}

impl Index {
    fn of(flights: usize) -> Index {
        let record = campaign_fixture::varied(flights);
        let write = |folder: &Path| {
            for (path, bytes) in &campaign_site(&record, &[]).files {
                let file = folder.join(path);
                fs::create_dir_all(file.parent().unwrap()).unwrap();
                fs::write(file, bytes).unwrap();
            }
        };
        Index { folder: crate::shared::folder(&format!("index-of-{flights}"), write), record }
    }

    fn page(&self) -> PathBuf {
        self.folder.join("index.html")
    }

    fn count(&self, wanted: impl Fn(&FlightRow) -> bool) -> usize {
        self.record.flights.iter().filter(|row| wanted(row)).count()
    }
}

/// Text of a column of the shown rows, from the top, including those a reader has to scroll to.
fn column(browser: &mut Browser, name: &str) -> Vec<String> {
    browser.eval("dispatchEvent(new Event('beforeprint'))");
    let rows = "[...document.querySelectorAll('#flights tbody tr')].filter((r) => r.offsetParent && !r.classList.contains('why'))";
    let place = format!(
        "[...document.querySelectorAll('#flights thead th')].findIndex((h) => h.textContent.trim().startsWith('{name}'))"
    );
    let texts = browser
        .eval(&format!("(() => {{ const i = {place}; return {rows}.map((r) => r.cells[i].textContent.trim()); }})()"));
    texts.as_array().unwrap().iter().map(|text| text.as_str().unwrap().to_owned()).collect()
}

fn click_head(browser: &mut Browser, name: &str) {
    browser.eval(&format!(
        "[...document.querySelectorAll('#flights thead th')].find((h) => h.textContent.trim().startsWith('{name}')).querySelector('button').click()"
    ));
}

fn chip(text: &str) -> String {
    format!("[...document.querySelectorAll('.controls button')].find((b) => b.textContent.startsWith('{text}'))")
}

fn failed(row: &FlightRow) -> bool {
    matches!(row.outcome, record::Outcome::Failed { .. })
}

fn harmed(row: &FlightRow) -> bool {
    row.effect.as_ref().is_some_and(|e| e.verdict == record::EffectVerdict::Harmed)
}

fn is_quiet(browser: &mut Browser) {
    assert_eq!(browser.faults(), Vec::<String>::new());
}

#[test]
fn verdicts_are_sorted_by_severity_with_absent_ones_last() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(200);
    browser.size(1440, 900, "light");
    browser.open(&index.page(), "");
    let effects = column(&mut browser, "Effect");
    assert_eq!(effects.len(), 200);
    let first = |words: &str| effects.iter().position(|e| e.contains(words)).unwrap();
    assert!(first("Failed") < first("HARMED") && first("HARMED") < first("Helped"), "{effects:?}");
    click_head(&mut browser, "Criteria");
    let ranks: Vec<usize> = column(&mut browser, "Criteria")
        .iter()
        .map(|text| {
            ["FAIL", "INCONCLUSIVE", "NOT EVALUATED", "PASS"].iter().position(|word| text.contains(word)).unwrap()
        })
        .collect();
    assert!(ranks.is_sorted() && ranks[0] == 0 && ranks[199] == 3, "{ranks:?}");
    for turn in 0..2 {
        click_head(&mut browser, "Lateness");
        let shown = column(&mut browser, "Lateness");
        let known = shown.iter().position(|text| text == "—").unwrap();
        assert!(shown[known..].iter().all(|text| text == "—"), "{shown:?}");
        let numbers: Vec<f64> =
            shown[..known].iter().map(|t| t.split('\u{a0}').next().unwrap().parse().unwrap()).collect();
        // They are sorted by full precision, and shown with the digits their uncertainty justifies, at most whole ms.
        let rise = |pair: &[f64]| if turn == 0 { pair[1] - pair[0] } else { pair[0] - pair[1] };
        assert!(numbers.windows(2).all(|pair| rise(pair) >= -1.0), "{numbers:?}");
    }
    is_quiet(&mut browser);
}

#[test]
fn facets_show_their_counts_and_combine() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(200);
    browser.open(&index.page(), "");
    let harmful = index.count(harmed);
    assert_eq!(browser.text(&format!("{}.textContent", chip("harmed"))), format!("harmed {harmful}"));
    browser.eval(&format!("{}.click()", chip("harmed")));
    assert_eq!(column(&mut browser, "Flight").len(), harmful);
    let damaged = index.count(|row| harmed(row) && row.lossy);
    assert_eq!(browser.text(&format!("{}.textContent", chip("damaged"))), format!("damaged {damaged}"));
    browser.eval(&format!("{}.click()", chip("damaged")));
    assert_eq!(column(&mut browser, "Flight").len(), damaged);
    assert_eq!(
        browser.text("document.querySelector('.controls output').textContent.trim()"),
        format!("{damaged} of 200 flights")
    );
    // The address keeps both, also for another reader.
    let address = browser.text("location.hash");
    assert!(address.contains("effect=harmed") && address.contains("data=damaged"), "{address}");
    browser.open(&index.page(), &address);
    assert_eq!(column(&mut browser, "Flight").len(), damaged);
    assert_eq!(browser.text(&format!("{}.getAttribute('aria-pressed')", chip("harmed"))), "true");
    browser.eval(&format!("{}.click()", chip("All")));
    assert_eq!(column(&mut browser, "Flight").len(), 200);
    is_quiet(&mut browser);
}

#[test]
fn words_numbers_and_reasons_filter_the_table() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(200);
    let late = |row: &FlightRow| row.lateness.as_ref().and_then(|l| l.lateness_s()).map(|e| e.value);
    let expected = [
        ("effect:failed", index.count(failed)),
        ("lateness%3E300", index.count(|row| late(row).is_some_and(|s| s > 0.3))),
        ("delay%3E300", index.count(|row| late(row).is_some_and(|s| s > 0.3))),
        ("receiver:vn-200", index.count(|row| row.lateness.as_ref().is_some_and(|l| l.group.name.contains("VN-200")))),
        ("lateness%3C100", index.count(|row| late(row).is_some_and(|s| s < 0.1))),
        ("criteria:fail", index.count(|row| row.criteria.as_ref().unwrap().overall == record::CriterionVerdict::Fail)),
        (
            "alarm:two-delays",
            index.count(|row| {
                row.lateness.as_ref().is_some_and(|l| l.alarms.iter().any(|a| a.code == "two-delays-fit"))
            }),
        ),
        (
            "vn-200+effect:harmed",
            index.count(|row| harmed(row) && row.lateness.as_ref().unwrap().group.name.contains("VN-200")),
        ),
        ("no-such-flight", 0),
    ];
    for (query, flights) in expected {
        browser.open(&index.page(), &format!("#?q={query}"));
        assert_eq!(column(&mut browser, "Flight").len(), flights, "{query}");
        assert!(flights > 0 || query == "no-such-flight", "{query} tries nothing");
    }
    // A reason in the list above shows its flights.
    browser.open(&index.page(), "");
    browser.eval("document.querySelector('li[data-reason=two-delays-fit] a.show').click()");
    browser.until("location.hash.includes('reason')");
    browser.until(&format!("document.querySelector('.controls output').textContent.includes('{} of')", expected[6].1));
    assert_eq!(column(&mut browser, "Flight").len(), expected[6].1);
    // An unknown column filters nothing, and the page says so.
    browser.open(&index.page(), "#?q=foo%3E3");
    assert_eq!(column(&mut browser, "Flight").len(), 200);
    assert!(browser.text("document.querySelector('.controls output').textContent").contains("no column is called foo"));
    is_quiet(&mut browser);
}

#[test]
fn columns_can_be_chosen_and_the_csv_has_them_at_full_precision() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(40);
    browser.open(&index.page(), "");
    let heads = "[...document.querySelectorAll('#flights thead th')].filter((h) => getComputedStyle(h).display !== 'none').map((h) => h.textContent.trim())";
    let usual = browser.eval(heads).as_array().unwrap().len();
    assert_eq!(usual, 10);
    let toggle = |name: &str| {
        format!(
            "[...document.querySelectorAll('.controls details label')].find((l) => l.textContent.trim() === '{name}').querySelector('input').click()"
        )
    };
    browser.eval(&toggle("Format"));
    browser.eval(&toggle("Data"));
    let shown: Vec<Value> = browser.eval(heads).as_array().unwrap().clone();
    assert!(shown.len() == usual && shown.contains(&"Format".into()) && !shown.contains(&"Data".into()), "{shown:?}");
    assert!(browser.text("location.hash").contains("show="));
    browser.eval("{ const input = document.querySelector('.controls input[type=search]'); input.value = 'effect:harmed'; input.dispatchEvent(new Event('input')); }");
    browser.eval(
        "{ window.saved = []; URL.createObjectURL = (blob) => { window.saved.push(blob.text()); return '#csv'; }; }",
    );
    browser.eval(&format!("{}.click()", chip("CSV of these rows")));
    let csv = browser.text("window.saved[0]");
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 1 + index.count(harmed), "{csv}");
    assert!(
        lines[0].starts_with("Flight,Flown,Effect,Lateness (s),U of Lateness (s),Removed (s)")
            && lines[0].ends_with(",Format"),
        "{}",
        lines[0]
    );
    for row in index.record.flights.iter().filter(|row| harmed(row)) {
        let line = lines.iter().find(|line| line.starts_with(&row.flight)).unwrap();
        let late = row.lateness.as_ref().unwrap().lateness_s().unwrap();
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells[3].parse::<f64>().unwrap(), late.value, "every bit");
        let expanded = 2.0 * late.standard_uncertainty.unwrap();
        assert!((cells[4].parse::<f64>().unwrap() / expanded - 1.0).abs() < 0.05, "k = 2: {line}");
        assert!(cells[2] == "harmed" && cells[5] == "0.2", "{line}");
    }
}

#[test]
fn keys_navigate_the_table_explain_a_flight_and_open_it() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(40);
    browser.size(1440, 900, "light");
    browser.open(&index.page(), "");
    let names = column(&mut browser, "Flight");
    let focused = "document.activeElement.textContent.trim()";
    browser.key("j");
    assert_eq!(browser.text(focused), names[0]);
    browser.key("j");
    assert_eq!(browser.text(focused), names[1]);
    browser.key("ArrowDown");
    browser.key("ArrowUp");
    browser.key("k");
    assert_eq!(browser.text(focused), names[0]);
    browser.key("e");
    let why = browser.text("document.querySelector('#flights tr.why').textContent");
    assert!(why.contains("no channel map fits"), "{why}");
    assert!(why.contains("No track to show"), "{why}");
    browser.key("e");
    assert_eq!(browser.number("document.querySelectorAll('#flights tr.why').length"), 0.0);
    // A compensated flight shows its track, within 160 by 60 pixels.
    browser.eval("document.querySelector('#flights tr[data-track] td').click()");
    let drawn = "document.querySelector('#flights tr.why svg.sketch')";
    let of = |browser: &mut Browser, side: &str| browser.number(&format!("{drawn}.getBoundingClientRect().{side}"));
    assert_eq!((of(&mut browser, "width"), of(&mut browser, "height")), (160.0, 60.0));
    let path = browser.eval(&format!(
        "(({{ x, y, width, height }}) => [x, y, width, height])({drawn}.querySelector('path').getBBox())"
    ));
    let side = |k: usize| path[k].as_f64().unwrap();
    assert!(side(0) >= 0.0 && side(1) >= 0.0 && side(0) + side(2) <= 87.0 && side(1) + side(3) <= 33.0, "{path}");
    assert!(side(2) > 86.0 || side(3) > 32.0, "it fills one of both sides: {path}");
    browser.key("?");
    assert_eq!(browser.eval("document.querySelector('.controls .note').hidden"), false);
    browser.key("/");
    assert_eq!(browser.text("document.activeElement.type"), "search");
    // Letters are text there.
    browser.key("j");
    browser.until("location.hash.includes('q=j')");
    browser.key("Escape");
    let is_outside = browser.eval("document.activeElement.type !== 'search'");
    assert_eq!(is_outside, true);
    is_quiet(&mut browser);
}

#[test]
fn header_and_first_column_stay_visible_and_no_width_overflows() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(200);
    for (width, scheme) in [(1440, "light"), (800, "light"), (400, "dark")] {
        browser.size(width, 900, scheme);
        browser.open(&index.page(), "");
        assert!(browser.number("document.documentElement.scrollWidth - innerWidth") <= 0.0, "{width}");
        let places = browser.eval(
            "(() => { const s = document.querySelector('.tall'); s.scrollTop = 1500; s.scrollLeft = 300; \
             const of = (e) => e.getBoundingClientRect(), box = of(s); \
             const row = [...document.querySelectorAll('#flights tbody tr')].find((r) => of(r).top > box.top + 200); \
             return [of(document.querySelector('#flights thead th')).top - box.top, of(row.cells[0]).left - box.left, s.scrollTop]; })()",
        );
        let place = |k: usize| places[k].as_f64().unwrap();
        assert!(place(0).abs() < 2.0 && place(1).abs() < 2.0 && place(2) == 1500.0, "{width} px: {places}");
        is_quiet(&mut browser);
    }
}

#[test]
fn numbers_on_the_page_match_the_record() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(60);
    browser.open(&index.page(), "");
    let cells = browser.eval(
        "[...document.querySelectorAll('#flights tbody tr')].map((r) => [r.cells[0].textContent, ...[3, 4, 5, 6].map((i) => r.cells[i].dataset.v ?? null)])",
    );
    for cell in cells.as_array().unwrap() {
        let row = index.record.flights.iter().find(|row| row.flight == cell[0].as_str().unwrap()).unwrap();
        let effect = row.effect.as_ref();
        let of_record = [
            row.lateness.as_ref().and_then(|l| l.lateness_s()).map(|e| e.value),
            row.delay_s,
            effect.and_then(|e| e.error_raw_m).map(|e| e.value),
            effect.and_then(|e| e.error_compensated_m).map(|e| e.value),
        ];
        for (k, value) in of_record.into_iter().enumerate() {
            assert_eq!(
                cell[k + 1].as_str().map(|text| text.parse::<f64>().unwrap()),
                value,
                "{}: column {k}",
                row.flight
            );
        }
    }
}

#[test]
fn large_campaigns_are_paginated_and_their_links_resolve() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(2001);
    browser.open(&index.page(), "");
    assert_eq!(browser.eval("document.querySelector('table.sortable')"), Value::Null);
    is_quiet(&mut browser);
    let folder = &index.folder;
    for page in 1..=3 {
        let path = folder.join(format!("table/{page}.html"));
        browser.open(&path, "");
        let shown = column(&mut browser, "Flight").len();
        assert_eq!(shown, if page == 3 { 1 } else { 1000 });
        let links = browser.eval(
            "[...document.querySelectorAll('nav a, #flights tbody a')].slice(0, 6).map((a) => a.getAttribute('href'))",
        );
        for link in links.as_array().unwrap().iter().map(|l| l.as_str().unwrap().split('#').next().unwrap()) {
            let known = index.record.flights.iter().any(|row| format!("../{}", row.page) == link);
            assert!(known || path.parent().unwrap().join(link).exists(), "{link}");
        }
        is_quiet(&mut browser);
    }
}

#[test]
fn a_campaign_page_is_printed_in_portrait_with_eight_columns() {
    let Some(mut browser) = Browser::start() else { return };
    let index = Index::of(40);
    browser.open(&index.page(), "");
    browser.print_media(true);
    let heads = browser.number("[...document.querySelectorAll('#flights thead th')].filter((h) => getComputedStyle(h).display !== 'none').length");
    assert_eq!(heads, 8.0);
    let [width, height] = browser.printed_size();
    assert!(width < height, "{width} × {height}");
}
