//! Machine-readable output: it matches the published schemas, and the pages contain no number that is not in it.

use crate::program::{flightlag, run, text};
use crate::shared;
use serde_json::Value;
use simulate::write_campaign;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Reports of two flights with a test card and criteria, and of a bench, with the lines of `--json`.
struct Reports {
    campaign: PathBuf,
    bench: PathBuf,
    events: Vec<Value>,
}

fn reports() -> Reports {
    let folder = shared::folder("schemas", write_reports);
    let printed = fs::read_to_string(folder.join("printed.txt")).unwrap();
    let events = printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    Reports { campaign: folder.join("report"), bench: folder.join("bench"), events }
}

fn write_reports(folder: &Path) {
    let path = |name: &str| folder.join(name);
    let words = |path: &Path| path.to_str().unwrap().to_owned();
    write_campaign(&path("flights"), 2, 60.0, 7).unwrap();
    fs::write(path("flights/broken.csv"), "a,b\n1,2\n3,4\n").unwrap();
    fs::write(path("flights/test-card.toml"), "schema = 1\n[[card]]\nnumber = \"1\"\nflights = [\"flight*\"]\n")
        .unwrap();
    fs::write(path("p.toml"), "schema = 1\n[delay]\nposition_s = 0.3\nsource = \"simulated\"\n").unwrap();
    let criteria = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pipelines/criteria.toml");
    let (flights, campaign) = (words(&path("flights")), words(&path("report")));
    let (pipeline, criteria) = (words(&path("p.toml")), words(&criteria));
    let order = ["campaign", &flights, "--out", &campaign, "--pipeline", &pipeline, "--criteria", &criteria, "--json"];
    let mut printed = text(&flightlag(order).output().unwrap().stdout);
    let (record, bench) = (words(&shared::demo().join("demo/bench/gps-1.mcap")), words(&path("bench")));
    printed += &text(&flightlag(["bench", &record, "--out", &bench, "--json"]).output().unwrap().stdout);
    fs::write(path("printed.txt"), printed).unwrap();
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))).unwrap()
}

/// The record in the folder of a flight that has one.
fn flight_record(folder: &Path) -> Option<Value> {
    let json = campaign::record_of_page(&folder.join("index.html")).unwrap()?;
    Some(serde_json::from_slice(&json).unwrap())
}

/// Folders of the pages below `flights` or `records` of a report.
fn folders(report: &Path, of: &str) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = fs::read_dir(report.join(of)).unwrap().map(|e| e.unwrap().path()).collect();
    all.sort();
    all
}

fn assert_valid(schema: &str, values: &[Value]) {
    assert!(!values.is_empty(), "{schema}");
    let validator =
        jsonschema::validator_for(&serde_json::from_str(&text(&run(["schema", schema], 0).stdout)).unwrap()).unwrap();
    for value in values {
        let wrong: Vec<String> =
            validator.iter_errors(value).take(5).map(|e| format!("{}: {e}", e.instance_path())).collect();
        assert!(wrong.is_empty(), "{schema}: {wrong:#?}");
    }
    let stray = serde_json::json!({ "event": "no such event" });
    assert!(!validator.is_valid(&stray), "{schema} takes anything");
}

/// `FLIGHTLAG_BLESS=1` rewrites them.
#[test]
fn the_published_schemas_match_the_types() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for (file, generated) in campaign::schemas().into_iter().chain(history::schemas()) {
        let path = root.join(file);
        if std::env::var_os("FLIGHTLAG_BLESS").is_some() {
            fs::write(&path, &generated).unwrap();
        }
        assert!(fs::read_to_string(&path).unwrap() == generated, "{file}: accept a change with `just bless`");
    }
    let named: BTreeSet<&str> =
        campaign::schemas().into_iter().chain(history::schemas()).map(|(file, _)| file).collect();
    let published: Vec<String> = ["docs", "pipelines", "pipelines/channel-maps", "pipelines/nightly"]
        .iter()
        .flat_map(|folder| fs::read_dir(root.join(folder)).unwrap().map(move |e| (folder, e.unwrap().file_name())))
        .map(|(folder, file)| format!("{folder}/{}", file.to_string_lossy()))
        .filter(|file| file.ends_with(".schema.json"))
        .collect();
    assert_eq!(named, published.iter().map(String::as_str).collect(), "each published schema is generated");
}

#[test]
fn the_command_prints_every_published_schema() {
    for (file, generated) in campaign::schemas().into_iter().chain(history::schemas()) {
        let name = file.rsplit('/').next().unwrap().trim_end_matches(".schema.json");
        assert!(text(&run(["schema", name], 0).stdout) == generated, "{name}");
    }
}

#[test]
fn records_and_events_match_their_schemas_and_the_index_matches_them() {
    let reports = reports();
    let campaign = json(&reports.campaign.join("campaign.json"));
    let flights = folders(&reports.campaign, "flights");
    let records: Vec<Value> = flights.iter().filter_map(|f| flight_record(f)).collect();
    let bench: Vec<Value> = folders(&reports.bench, "records").iter().map(|f| json(&f.join("record.json"))).collect();
    assert!(records.iter().any(|record| record["test"]["cards"][0]["status"].is_string()));
    assert_valid("record", &records);
    assert_valid("campaign", std::slice::from_ref(&campaign));
    assert_valid("bench-record", &bench);
    assert_valid("events", &reports.events);

    let whole = campaign::read_report(&reports.campaign).unwrap().unwrap();
    let rows: Vec<Value> = whole.flights.iter().map(|row| serde_json::to_value(row).unwrap()).collect();
    assert_numbers(&reports.campaign.join("index.html"), &Value::Array([vec![campaign], rows].concat()));
}

#[test]
fn pages_contain_no_number_that_is_not_in_their_record() {
    let reports = reports();
    for folder in folders(&reports.campaign, "flights") {
        flight_record(&folder).iter().for_each(|record| assert_numbers(&folder.join("index.html"), record));
    }
    for folder in folders(&reports.bench, "records") {
        assert_numbers(&folder.join("index.html"), &json(&folder.join("record.json")));
    }
}

/// Factors between the unit of a record and that of a page: ms, µs or µT, mm, %, degrees, ms/min, and U with k = 2.
const FACTORS: [f64; 9] = [1.0, 1e3, 1e6, 1e2, 2.0, 2e3, 180.0 / std::f64::consts::PI, 1e9, 6e4];

/// Every full-precision number in the markup of a page is in the record, possibly in another unit. Other cells
/// are sorted by ranks, which are not numbers of the record.
fn assert_numbers(page: &Path, record: &Value) {
    let mut known = vec![];
    numbers(record, &mut known);
    known.sort_by(f64::total_cmp);
    let html = fs::read_to_string(page).unwrap();
    let shown: Vec<f64> = ["<data value=\"", "class=\"n\" data-v=\""]
        .iter()
        .flat_map(|start| html.split(start).skip(1))
        .filter_map(|rest| rest.split('"').next()?.parse().ok())
        .collect();
    assert!(!shown.is_empty(), "{}", page.display());
    let is_known = |value: f64| {
        FACTORS.iter().any(|factor| {
            let (wanted, near) = (value / factor, 1e-9 * (value / factor).abs());
            let from = known.partition_point(|k| *k < wanted - near);
            known.get(from).is_some_and(|k| *k <= wanted + near)
        })
    };
    let unknown: Vec<f64> = shown.into_iter().filter(|value| !is_known(*value)).collect();
    assert!(unknown.is_empty(), "{}: {unknown:?}", page.display());
}

fn numbers(value: &Value, into: &mut Vec<f64>) {
    match value {
        Value::Number(number) => into.extend(number.as_f64()),
        Value::Array(list) => list.iter().for_each(|value| numbers(value, into)),
        Value::Object(fields) => fields.values().for_each(|value| numbers(value, into)),
        _ => {}
    }
}
