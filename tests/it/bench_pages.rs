//! Bench pages in a real browser: the reference is shifted by hand, and everything fits on few sheets.

use crate::browser::Browser;
use record::BenchRecord;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Page and record of the first swing of the demo's sensor with the most swings.
fn first_swing() -> (PathBuf, BenchRecord) {
    let folders = fs::read_dir(report().join("records")).unwrap();
    let first = folders.map(|entry| entry.unwrap().path()).min().unwrap();
    let record = serde_json::from_slice(&fs::read(first.join("record.json")).unwrap()).unwrap();
    (first.join("index.html"), record)
}

/// Report of this sensor.
fn report() -> PathBuf {
    crate::shared::demo().join("demo/bench-report/sim-0001")
}

fn open(browser: &mut Browser, page: &Path) {
    browser.size(1440, 900, "light");
    browser.open(page, "");
    browser.until("document.getElementById('shift')?.dataset.ready === 'yes'");
}

const BENCH: &str = "document.getElementById('shift').bench";

#[test]
fn shifting_the_reference_by_hand_is_best_at_the_found_delay() {
    let Some(mut browser) = Browser::start() else { return };
    let (page, record) = first_swing();
    open(&mut browser, &page);
    let names = browser.eval(&format!("{BENCH}.panels.map((p) => p.name)"));
    let names: Vec<&str> = names.as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    assert!(names.len() >= 6 && names[0].starts_with("position."), "{names:?}");
    let channels = &record.findings.as_ref().unwrap().channels;
    for (panel, name) in names.iter().enumerate() {
        let (channel, component) = name.split_once(", ").unwrap();
        let channel = channels.iter().find(|c| c.name == channel).unwrap();
        let component = channel.components.iter().find(|c| c.name == component).unwrap();
        let (delay, overlay) = (channel.delay.as_ref().unwrap(), component.overlay.as_ref().unwrap());
        let found_ms = delay.delay.millis();

        // The slider agrees with the record.
        let shift = |ms: f64| {
            format!(
                "{{ const s = document.querySelector('#shift input'); s.value = {ms}; s.dispatchEvent(new Event('input')); }}"
            )
        };
        let row = format!("document.querySelectorAll('#shift tbody tr')[{panel}].cells[1].textContent");
        for (step, ms) in [(0, -500.0), (137, 185.0)] {
            browser.eval(&shift(ms));
            let at = (ms * 1e-3 - overlay.shifts.from_s) / overlay.shifts.step_s;
            assert!((at - at.round()).abs() < 1e-6, "{step}");
            let scale = if component.unit == "T" { 1e6 } else { 1.0 };
            let of_record = scale * overlay.shifts.rms[at.round() as usize];
            let shown = browser.number(&format!("{BENCH}.residual({panel})"));
            assert!((shown / of_record - 1.0).abs() < 1e-6, "{name} at {ms} ms: {shown}, record {of_record}");
            let text = browser.text(&row);
            let number: f64 = text.split_whitespace().next().unwrap().parse().unwrap();
            assert!((number / of_record - 1.0).abs() < 6e-3, "{name} at {ms} ms: {text}, record {of_record}");
        }

        // By hand, millisecond by millisecond.
        let scan = format!(
            "(() => {{ let best = [Infinity, 0]; for (let ms = -500; ms <= 500; ms++) {{ {BENCH}.shift(ms); \
             const left = {BENCH}.residual({panel}); if (left < best[0]) best = [left, ms]; }} return best[1]; }})()"
        );
        let least_ms = browser.number(&scan);
        // Equal weights for all rows, unlike the fit: a few standard uncertainties apart.
        let allowed = 2.0 + 6e3 * delay.standard_uncertainty_s;
        assert!(
            (least_ms - found_ms).abs() <= allowed,
            "{name}: least at {least_ms} ms, found {found_ms} ± {allowed} ms"
        );
    }
    assert_eq!(browser.faults(), Vec::<String>::new());
}

#[test]
fn bench_panels_share_window_and_cursor_and_replace_the_screen_figure() {
    let Some(mut browser) = Browser::start() else { return };
    let (page, _) = first_swing();
    open(&mut browser, &page);
    let plots = format!("{BENCH}.plots");
    let over = "document.querySelectorAll('#shift .u-over')[1]";
    browser.eval(&format!("{over}.scrollIntoView({{ block: 'center' }})"));
    let side = |browser: &mut Browser, side: &str| browser.number(&format!("{over}.getBoundingClientRect().{side}"));
    let (left, top) = (side(&mut browser, "left"), side(&mut browser, "top") + 30.0);
    let width = side(&mut browser, "width");
    let whole = browser.eval(&format!("{BENCH}.window()"));
    browser.drag([left + 0.25 * width, top], [left + 0.5 * width, top]);
    let ends = browser.eval(&format!("{plots}.map((p) => p.u ?? p).map((u) => [u.scales.x.min, u.scales.x.max])"));
    let ends = ends.as_array().unwrap();
    let span = |window: &serde_json::Value| window[1].as_f64().unwrap() - window[0].as_f64().unwrap();
    assert!(ends.iter().all(|e| e == &ends[0]), "{ends:?}");
    assert!((span(&ends[0]) / span(&whole) - 0.25).abs() < 0.02, "{ends:?} of {whole}");
    browser.mouse("mouseMoved", [left + 0.4 * width, top], false);
    browser.until(&format!("{plots}.every((u) => Math.abs(u.cursor.left - {plots}[1].cursor.left) < 1)"));
    // The cursor readout does not move the panels away from under the cursor.
    browser.until("document.querySelector('#shift .readout').textContent.startsWith('Cursor at')");
    browser.until("document.querySelectorAll('#shift tbody tr')[1].cells[2].textContent.length > 1");
    assert!((side(&mut browser, "top") + 30.0 - top).abs() < 1.0, "the panel moved");
    browser.eval("document.querySelector('#shift .panels').focus()");
    browser.key("0");
    assert_eq!(browser.eval(&format!("{BENCH}.window()")), whole);

    // The figure is for paper, and for readers without scripts.
    assert_eq!(browser.eval("getComputedStyle(document.getElementById('fig-4')).display"), "none");
    assert_eq!(browser.faults(), Vec::<String>::new());
}

#[test]
fn bench_pages_are_small_accessible_and_print_on_few_sheets() {
    let Some(mut browser) = Browser::start() else { return };
    let (page, record) = first_swing();
    for (page, most) in [(&page, 12), (&report().join("index.html"), 4)] {
        let bytes = fs::metadata(page).unwrap().len();
        assert!(bytes <= 1_500_000, "{}: {bytes} bytes", page.display());
        for (width, scheme) in [(1440, "light"), (800, "dark"), (400, "light")] {
            browser.size(width, 900, scheme);
            browser.open(page, "");
            let too_wide = browser.number("document.documentElement.scrollWidth - innerWidth");
            assert!(too_wide <= 0.0, "{} at {width} px: {too_wide} px too wide", page.display());
            // Figures use the text colour of the page, light or dark.
            let figure = browser.text("getComputedStyle(document.querySelector('figure:not(.twin) svg text')).fill");
            assert_eq!(figure, browser.text("getComputedStyle(document.body).color"), "{scheme}");
            if let Some(faults) = browser.accessibility_faults() {
                assert_eq!(faults, Vec::<String>::new(), "{} at {width} px, {scheme}", page.display());
            }
            browser.eval("document.querySelectorAll('details').forEach((d) => { d.open = true; })");
            let (pixels, text) = browser.smallest_figure_text();
            assert!(pixels >= 11.0, "{} at {width} px: {pixels:.1} px, {text}", page.display());
        }
        // As printed by a reader who has not opened anything.
        browser.open(page, "");
        let labels = browser.eval(
            "[...document.querySelectorAll('[role=region],nav,section')].map((e) => e.getAttribute('aria-label'))",
        );
        let labels: Vec<&str> = labels.as_array().unwrap().iter().filter_map(|label| label.as_str()).collect();
        assert_eq!(labels.iter().collect::<BTreeSet<_>>().len(), labels.len(), "{labels:?}");
        let sheets = browser.printed_pages();
        assert!((1..=most).contains(&sheets), "{}: {sheets} sheets, {most} at most", page.display());
        assert_eq!(browser.faults(), Vec::<String>::new());
    }
    // Every delay of the record is on its page.
    browser.open(&page, "");
    let values = browser.eval("[...document.querySelectorAll('data')].map((e) => +e.value)");
    let values: Vec<f64> = values.as_array().unwrap().iter().filter_map(serde_json::Value::as_f64).collect();
    for channel in &record.findings.as_ref().unwrap().channels {
        let millis = channel.delay.as_ref().unwrap().delay.seconds() * 1e3;
        assert!(values.iter().any(|v| (v - millis).abs() < 1e-9), "{}: {millis} ms", channel.name);
    }
}
