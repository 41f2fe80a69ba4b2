//! Pages in a real browser: they respond, can be explored, and load nothing else.

use crate::browser::Browser;
use crate::program::{flightlag, run, tree};
use crate::{reference, shared};
use record::{CampaignRecord, FlightRecord};
use serde_json::Value;
use simulate::{FlightSettings, SensorSettings, simulate};
use std::fs;
use std::path::{Path, PathBuf};

/// Metres by which one fix of `spike_POS.csv` is too far north.
const SPIKE_M: f64 = 500.0;

/// A report of two simulated flights with truth, one with a wrong fix, and of a file that is not a log.
struct Report {
    folder: PathBuf,
}

impl Report {
    fn whole() -> Report {
        let make = |folder: &Path| {
            let flights = folder.join("flights");
            simulate::write_campaign(&flights, 2, 60.0, 7).unwrap();
            write_spike(&flights.join("spike_POS.csv"));
            fs::write(flights.join("<b>none<b>.csv"), "a,b\n1,2\n3,4\n").unwrap();
            let pipeline = folder.join("p.toml");
            fs::write(&pipeline, "schema = 1\n[delay]\nposition_s = 0.3\nsource = \"simulated\"\n").unwrap();
            let path = |path: PathBuf| path.to_str().unwrap().to_owned();
            let out = path(folder.join("report"));
            run(["campaign", &path(flights), "--out", &out, "--pipeline", &path(pipeline)], 3);
        };
        Report { folder: shared::folder("pages", make) }
    }

    /// A report of one flight with two seconds of rows missing.
    fn with_gap() -> Report {
        Report { folder: shared::folder("page-with-gap", Report::write_with_gap) }
    }

    fn write_with_gap(folder: &Path) {
        let flights = folder.join("flights");
        fs::create_dir(&flights).unwrap();
        let table = flights.join("gap_POS.csv");
        write_spike(&table);
        let text = fs::read_to_string(&table).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        let lost = lines.len() / 3;
        let kept = lines.iter().enumerate().filter(|(n, _)| !(lost..lost + 100).contains(n)).map(|(_, line)| *line);
        fs::write(&table, kept.collect::<Vec<_>>().join("\n") + "\n").unwrap();
        let path = |path: PathBuf| path.to_str().unwrap().to_owned();
        let pipeline = folder.join("p.toml");
        fs::write(&pipeline, "schema = 1\n[delay]\nposition_s = 0.3\nsource = \"simulated\"\n").unwrap();
        let out = path(folder.join("report"));
        let ran =
            flightlag(["campaign", &path(flights), "--out", &out, "--pipeline", &path(pipeline)]).output().unwrap();
        // 3: the effect of the gap on the delay may count as a change.
        assert!(matches!(ran.status.code(), Some(0 | 3)), "{}", String::from_utf8_lossy(&ran.stderr));
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join("report").join(name)
    }

    fn campaign(&self) -> CampaignRecord {
        campaign::read_report(&self.folder.join("report")).unwrap().unwrap()
    }

    /// Page and record of the flight whose name contains these words.
    fn flight(&self, words: &str) -> (PathBuf, FlightRecord) {
        let campaign = self.campaign();
        let row = campaign.flights.iter().find(|row| row.flight.contains(words)).unwrap();
        let page = self.path(&row.page);
        let record = campaign::record_of_page(&page).unwrap().unwrap();
        (page, serde_json::from_slice(&record).unwrap())
    }

    fn pages(&self) -> Vec<PathBuf> {
        let root = self.folder.join("report");
        tree(&root).into_keys().filter(|p| p.extension().is_some_and(|e| e == "html")).map(|p| root.join(p)).collect()
    }
}

fn write_spike(path: &Path) {
    let settings = FlightSettings {
        duration_s: 120.0,
        position: SensorSettings { delay_s: 0.3, white_std: 0.02, ..SensorSettings::clean(5.0) },
        velocity: SensorSettings { white_std: 0.02, ..SensorSettings::clean(50.0) },
        ..FlightSettings::default()
    };
    let flight = simulate(&settings).unwrap().to_flight().unwrap();
    reference::write_table(&flight, path, 0.0);
    let text = fs::read_to_string(path).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let middle = lines.len() / 2;
    let mut cells: Vec<String> = lines[middle].split(',').map(str::to_owned).collect();
    cells[1] = format!("{:.10}", cells[1].parse::<f64>().unwrap() + SPIKE_M / 111_195.0);
    lines[middle] = cells.join(",");
    fs::write(path, lines.join("\n") + "\n").unwrap();
}

/// Opens the page of a flight and waits for its explorer.
fn explore(browser: &mut Browser, page: &Path) {
    browser.size(1440, 900, "light");
    browser.open(page, "");
    browser.until("document.getElementById('explorer')?.dataset.ready === 'yes'");
}

fn window(browser: &mut Browser) -> [f64; 2] {
    ["0", "1"].map(|k| browser.number(&format!("document.getElementById('explorer').explorer.window()[{k}]")))
}

/// A position on the first panel: fractions of its width and height.
fn on_panel(browser: &mut Browser, panel: usize, share: f64) -> [f64; 2] {
    let over = format!("document.querySelectorAll('#explorer .u-over')[{panel}]");
    browser.eval(&format!("{over}.scrollIntoView({{ block: 'center' }})"));
    let of = |browser: &mut Browser, side: &str| browser.number(&format!("{over}.getBoundingClientRect().{side}"));
    let (left, top) = (of(browser, "left"), of(browser, "top"));
    [left + share * of(browser, "width"), top + 0.5 * of(browser, "height")]
}

#[test]
fn track_and_numbers_follow_zooming_panning_and_pointing() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    let (page, record) = report.flight("flight-0001");
    let replay = record.replay.unwrap();
    explore(&mut browser, &page);
    let [from, to] = window(&mut browser);
    assert!((to - from - replay.coverage.duration_s).abs() < 1.0, "{from} to {to}");

    // The whole flight: the numbers next to the track are those of the record.
    let error = |browser: &mut Browser, words: &str| {
        let rows = "[...document.querySelectorAll('#explorer .window tr')]";
        let text = browser.text(&format!("{rows}.find((r) => r.textContent.includes('{words}')).cells[1].textContent"));
        text.split(',').next().unwrap().parse::<f64>().unwrap()
    };
    for (words, name) in [("raw, newest", "raw"), ("exact, p", "exact-async"), ("Padé", "pade-1-1")] {
        let compensator = replay.compensators.iter().find(|c| c.name == name).unwrap();
        let of_record = compensator.error_rms_m.unwrap().value;
        let shown = error(&mut browser, &format!("Error, {words}"));
        // Positions are packed to 1 cm, and the record scores the rows that all compensators have.
        assert!((shown - of_record).abs() < 0.01 + 0.02 * of_record, "{name}: {shown} on the page, {of_record}");
    }

    // Drag over a quarter of a panel: every panel shows that quarter.
    let (a, b) = (on_panel(&mut browser, 0, 0.5), on_panel(&mut browser, 0, 0.75));
    browser.drag(a, b);
    let [a, b] = window(&mut browser);
    let span = to - from;
    assert!((a - (from + 0.5 * span)).abs() < 0.02 * span && (b - (from + 0.75 * span)).abs() < 0.02 * span, "{a} {b}");
    let plots = "document.getElementById('explorer').explorer.plots";
    let ends = browser.eval(&format!("{plots}.map((p) => [p.u.scales.x.min, p.u.scales.x.max])"));
    assert!(ends.as_array().unwrap().iter().all(|e| e == &serde_json::json!([a, b])), "{ends}");

    // One cursor: pointing at one panel moves it in all, and the values are shown.
    let place = on_panel(&mut browser, 3, 0.5);
    browser.mouse("mouseMoved", place, false);
    browser.until(&format!("{plots}.every((p) => Math.abs(p.u.cursor.left - {plots}[3].u.cursor.left) < 1)"));
    browser.until("document.querySelector('#explorer .readout').textContent.includes('lead')");
    let row_t = browser.number(&format!("{plots}[0].u.posToVal({plots}[0].u.cursor.left, 'x')"));
    assert!((row_t - (a + b) / 2.0).abs() < 0.02 * (b - a), "{row_t}");

    // Keys: zooming out twice is wider, 0 shows all.
    browser.eval("document.querySelector('#explorer .panels').focus()");
    browser.key("+");
    let [c, d] = window(&mut browser);
    assert!(((d - c) / (b - a) - 0.5).abs() < 0.01);
    browser.key("ArrowRight");
    assert!((window(&mut browser)[0] - c - (d - c) / 4.0).abs() < 1e-6);
    browser.key("0");
    assert_eq!(window(&mut browser), [from, to]);

    // Shift-drag by a quarter of the width to the left: the window moves by as much to the right.
    browser.eval("document.getElementById('explorer').explorer.show(10, 30)");
    let (a, b) = (on_panel(&mut browser, 1, 0.5), on_panel(&mut browser, 1, 0.25));
    browser.shift_drag(a, b);
    let [a, b] = window(&mut browser);
    assert!((a - 15.0).abs() < 0.2 && (b - 35.0).abs() < 0.2, "{a} to {b}");

    // Keys of the page: the list of keys, and a preset. The keys listed work.
    browser.key("?");
    browser.until("document.querySelector('dialog').open");
    browser.key("?");
    browser.until("!document.querySelector('dialog').open");
    browser.key("0");
    browser.key("t");
    let [a, b] = window(&mut browser);
    assert!(b - a <= 20.0 && b - a >= 10.0, "{a} to {b}");
    // Figures with the same content are collapsed.
    assert_eq!(browser.eval("document.querySelector('details.twins').open"), false);

    // A preset.
    browser.eval("{ const s = document.querySelector('#explorer select'); s.value = '1'; s.dispatchEvent(new Event('change')); }");
    let [e, f] = window(&mut browser);
    assert!(f - e <= 20.0 && f - e >= 10.0 && e >= from && f <= to, "{e} {f}");
    assert!(
        browser.text("document.querySelector('#explorer select').options[1].textContent").starts_with("Hardest turn")
    );
    assert_eq!(browser.faults(), Vec::<String>::new());
}

#[test]
fn fingers_and_buttons_pan_and_zoom_the_window() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    let (page, _) = report.flight("flight-0001");
    explore(&mut browser, &page);
    let whole = window(&mut browser);
    browser.eval("document.getElementById('explorer').explorer.show(10, 30)");
    // A quarter of the width to the left: the window moves by as much to the right.
    let (a, b) = (on_panel(&mut browser, 0, 0.5), on_panel(&mut browser, 0, 0.25));
    browser.touch(&[a], &[b]);
    let [from, to] = window(&mut browser);
    assert!((from - 15.0).abs() < 0.2 && (to - 35.0).abs() < 0.2, "{from} to {to}");
    // Fingers from 3/8 and 5/8 to 1/4 and 3/4: half the window about its middle.
    let places = [0.375, 0.625, 0.25, 0.75].map(|share| on_panel(&mut browser, 0, share));
    browser.touch(&places[..2], &places[2..]);
    let [from, to] = window(&mut browser);
    assert!((from - 20.0).abs() < 0.3 && (to - 30.0).abs() < 0.3, "{from} to {to}");
    let mut press = |name: &str| {
        browser.eval(&format!("document.querySelector('#explorer button[title=\"{name}\"]').click()"));
        window(&mut browser)
    };
    let [a, b] = press("key +");
    assert!((a - from - 2.5).abs() < 0.2 && (to - b - 2.5).abs() < 0.2, "{a} to {b}");
    let [a, b] = press("key −");
    assert!((b - a - (to - from)).abs() < 0.1, "{a} to {b}");
    assert_eq!(press("key 0"), whole);
    // It stops at the end of the flight, with its width unchanged.
    browser.eval("document.getElementById('explorer').explorer.show(2, 12)");
    let (a, b) = (on_panel(&mut browser, 0, 0.2), on_panel(&mut browser, 0, 0.9));
    browser.touch(&[a], &[b]);
    let [from, to] = window(&mut browser);
    assert!((from - whole[0]).abs() < 1e-6 && (to - from - 10.0).abs() < 1e-6, "{from} to {to}");
    assert_eq!(browser.faults(), Vec::<String>::new());
}

#[test]
fn figure_text_is_large_enough_at_every_width() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    for page in report.pages() {
        for width in [1440, 1100, 940, 800, 400] {
            browser.size(width, 900, "light");
            browser.open(&page, "");
            browser.eval("document.querySelectorAll('details').forEach((d) => { d.open = true; })");
            let (pixels, text) = browser.smallest_figure_text();
            assert!(pixels >= 11.0, "{} at {width} px: {pixels:.1} px, {text}", page.display());
        }
    }
}

#[test]
fn a_single_wrong_fix_is_visible_at_every_zoom() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    let (page, _) = report.flight("spike");
    explore(&mut browser, &page);
    let plots = "document.getElementById('explorer').explorer.plots";
    let most = |browser: &mut Browser| browser.number(&format!("Math.max(...{plots}[0].u.data[1])"));
    // Held raw positions: the fix is off by half a kilometre from those before and after it.
    let raw = format!("{plots}[0].series[0]");
    let jump = browser.number(&format!("{raw}.reduce((m, v, i) => Math.max(m, v - ({raw}[i - 1] ?? v)), 0)"));
    assert!((jump - SPIKE_M).abs() < 20.0, "{jump}");
    let top = browser.number(&format!("Math.max(...{raw})"));
    let at = browser
        .number(&format!("{plots}[0].u.data[0][{plots}[0].u.data[1].indexOf(Math.max(...{plots}[0].u.data[1]))]"));
    assert_eq!(most(&mut browser), top);
    for half_s in [40.0, 10.0, 2.0, 0.5] {
        browser.eval(&format!("document.getElementById('explorer').explorer.show({at} - {half_s}, {at} + {half_s})"));
        assert_eq!(most(&mut browser), top, "± {half_s} s");
        assert!(browser.number(&format!("{plots}[0].u.scales.y.max")) >= top);
    }
    assert_eq!(browser.faults(), Vec::<String>::new());
}

#[test]
fn an_anomaly_time_opens_it_in_the_explorer() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::with_gap();
    let (page, record) = report.flight("gap");
    explore(&mut browser, &page);
    let link = "document.querySelector('#anomalies ~ * a[data-t]')";
    let at = browser.number(&format!("Number({link}.dataset.t)"));
    browser.eval(&format!("{link}.click()"));
    let [a, b] = window(&mut browser);
    let whole = record.replay.unwrap().coverage.duration_s;
    assert!(a <= at && at <= b && b - a < 0.5 * whole, "{at} is not in {a} to {b}");
    assert_eq!(browser.faults(), Vec::<String>::new());
}

#[test]
fn axe_finds_no_fault_on_any_page_at_any_width_or_scheme() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    for page in report.pages() {
        for (width, scheme) in [(1440, "light"), (1440, "dark"), (400, "light"), (400, "dark")] {
            browser.size(width, 900, scheme);
            browser.open(&page, "");
            browser.until("!document.getElementById('explorer-data') || document.getElementById('explorer').dataset.ready === 'yes'");
            let Some(faults) = browser.accessibility_faults() else { return };
            assert_eq!(faults, Vec::<String>::new(), "{} at {width} px, {scheme}", page.display());
        }
    }
}

#[test]
fn the_flight_table_filters_sorts_and_keeps_its_state_in_the_address() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    browser.size(1440, 900, "light");
    let index = report.path("index.html");
    browser.open(&index, "");
    let shown = "[...document.querySelectorAll('#flights tbody tr')].filter((r) => r.offsetParent).map((r) => r.cells[0].innerText)";
    assert_eq!(browser.eval(shown).as_array().unwrap().len(), report.campaign().flights.len());
    browser.key("/");
    browser.until("document.activeElement.type === 'search'");
    "t-0002".chars().for_each(|key| browser.key(&key.to_string()));
    browser.until("location.hash.includes('q=t-0002')");
    let names = browser.eval(shown);
    assert!(names.as_array().unwrap().len() == 1 && names[0].as_str().unwrap().contains("flight-0002"), "{names}");
    browser.open(&index, "#?q=flight-");
    assert_eq!(browser.eval(shown).as_array().unwrap().len(), 2);
    let sort = |n: usize| format!("document.querySelectorAll('#flights thead th button')[{n}].click()");
    browser.eval(&sort(0));
    let up = browser.eval(shown);
    browser.eval(&sort(0));
    let down = browser.eval(shown);
    let reversed: Vec<&Value> = down.as_array().unwrap().iter().rev().collect();
    assert_eq!(up.as_array().unwrap().iter().collect::<Vec<_>>(), reversed);
    assert!(browser.text("location.hash").contains("sort="));
    assert_eq!(browser.faults(), Vec::<String>::new());
}

#[test]
fn a_table_is_saved_at_full_precision_with_uncertainty_columns() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    let (page, record) = report.flight("flight-0001");
    browser.open(&page, "");
    // Intercepts the file before the browser saves it.
    browser.eval("URL.createObjectURL = (blob) => { window.saved = blob.text(); return '#'; }");
    browser.eval("HTMLAnchorElement.prototype.click = function () { window.name = this.download; }");
    let table = "[...document.querySelectorAll('.scroll > table')].find((t) => t.caption.textContent.startsWith('Compensators'))";
    let csv =
        browser.text(&format!("{{ const t = {table}; t.caption.querySelector('button.csv').click(); }} window.saved"));
    let exact = csv.lines().find(|line| line.contains("exact-async")).unwrap_or_else(|| panic!("{csv}"));
    let of_record = record.replay.unwrap().compensators.into_iter().find(|c| c.name == "exact-async").unwrap();
    let correction = of_record.raw_minus_this_rms_m;
    assert!(exact.contains(&format!(",{},", correction.value)), "{csv}");
    assert!(
        csv.lines().next().unwrap().contains("\"Step at a fix, 2‑D rms (m)\",\"Step at a fix, 2‑D rms (m), ±\""),
        "{csv}"
    );
    assert!(browser.text("window.name").ends_with(".csv"));
}

#[test]
fn pages_load_nothing_else_do_not_overflow_and_have_no_dead_links() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    for page in report.pages() {
        for (width, scheme) in [(1440, "light"), (400, "dark")] {
            browser.size(width, 900, scheme);
            browser.open(&page, "");
            let too_wide = browser.number("document.documentElement.scrollWidth - innerWidth");
            assert!(too_wide <= 0.0, "{} at {width} px: {too_wide} px too wide", page.display());
            assert_eq!(browser.faults(), Vec::<String>::new(), "{}", page.display());
        }
        let links = browser.eval("[...document.querySelectorAll('a')].map((a) => a.getAttribute('href'))");
        for link in links.as_array().unwrap().iter().map(|link| link.as_str().unwrap()) {
            let found = match link.strip_prefix('#') {
                Some(id) => browser.eval(&format!("!!document.getElementById('{id}')")) == true,
                None => page.parent().unwrap().join(percent_decoded(link)).exists(),
            };
            assert!(found, "{}: {link}", page.display());
        }
    }
}

fn percent_decoded(link: &str) -> String {
    let mut bytes = vec![];
    let mut rest = link.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let digits = after.get(..2).filter(|_| byte == b'%').and_then(|d| std::str::from_utf8(d).ok());
        let (byte, after) = match digits.and_then(|d| u8::from_str_radix(d, 16).ok()) {
            Some(escaped) => (escaped, &after[2..]),
            None => (byte, after),
        };
        bytes.push(byte);
        rest = after;
    }
    String::from_utf8(bytes).unwrap()
}

#[test]
fn a_flight_prints_on_few_pages_without_screen_only_parts() {
    let Some(mut browser) = Browser::start() else { return };
    let report = Report::whole();
    let (page, _) = report.flight("flight-0001");
    explore(&mut browser, &page);
    let pages = browser.printed_pages();
    assert!((1..=8).contains(&pages), "{pages} pages");
}
