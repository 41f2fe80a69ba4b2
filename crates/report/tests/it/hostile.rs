//! Records with hostile text everywhere, all options absent, or very long lists.

use crate::bench_fixture::{card, failed_bench_record, light_bench, light_bench_record, silent_bench_record};
use crate::campaign_fixture::varied;
use crate::fixture::{campaign_record, failed_record, flight_record};
use crate::html::read;
use record::{BenchRecord, CampaignRecord, FlightRecord, SensorCard};
use report::{
    BenchPage, CardPage, CardRecord, FlightPage, Site, TrackExcerpt, bench_site, campaign_site, card_site,
    changes_site, flight_site,
};
use serde_json::Value;

const PAYLOADS: [&str; 9] = [
    "<script>alert(1)</script>",
    "\"><img src=x onerror=alert(1)>",
    "' onmouseover='alert(1)",
    "javascript:alert(1)",
    "</title></svg></style></script><svg onload=alert(1)>",
    "]]><!-- --!>",
    "line\u{2028}separator\u{2029}\u{85}",
    "\u{202e}txt.exe\u{2066}\u{200b}\u{feff}",
    "\0\u{1}\u{1b}[31m\u{7f}\r\n",
];

/// Applies `change` to every value of a record, and keeps each change that still parses as a record:
/// names of enum variants stay unchanged.
fn change_everywhere<T>(record: &T, change: &dyn Fn(&Value) -> Option<Value>) -> (T, usize)
where
    T: serde::Serialize + serde::de::DeserializeOwned,
{
    let mut root = serde_json::to_value(record).unwrap();
    let mut paths = Vec::new();
    collect(&root, String::new(), &mut paths);
    let mut changed = 0;
    for path in paths {
        let Some(place) = root.pointer_mut(&path) else { continue };
        let Some(new) = change(place) else { continue };
        let old = std::mem::replace(place, new);
        if serde_json::from_value::<T>(root.clone()).is_ok() {
            changed += 1;
        } else if let Some(place) = root.pointer_mut(&path) {
            *place = old;
        }
    }
    (serde_json::from_value(root).unwrap(), changed)
}

/// The same for a campaign, including what its JSON omits: rows, and points of the control charts.
fn change_campaign(record: &CampaignRecord, change: &dyn Fn(&Value) -> Option<Value>) -> (CampaignRecord, usize) {
    let (mut changed, mut count) = change_everywhere(record, change);
    for row in &record.flights {
        let (row, more) = change_everywhere(row, change);
        changed.flights.push(row);
        count += more;
    }
    for (group, is) in record.groups.iter().zip(&mut changed.groups) {
        if let (Some(was), Some(is)) = (&group.consistency, &mut is.consistency) {
            is.control = was.control.iter().map(|point| change_everywhere(point, change).0).collect();
        }
    }
    (changed, count)
}

/// JSON pointers of all descendants; two items represent each list.
fn collect(value: &Value, path: String, out: &mut Vec<String>) {
    match value {
        Value::Object(fields) => fields.iter().for_each(|(name, v)| collect(v, format!("{path}/{name}"), out)),
        Value::Array(items) => {
            items.iter().take(3).enumerate().for_each(|(i, v)| collect(v, format!("{path}/{i}"), out))
        }
        _ => {}
    }
    out.push(path);
}

/// A record with short curves, because every change is checked on the whole record.
fn light_record() -> FlightRecord {
    let mut record = flight_record();
    let replay = record.replay.as_mut().unwrap();
    let zoom = replay.zoom.as_mut().unwrap();
    for axis in replay.axes.iter_mut().chain(&mut zoom.axes) {
        for curve in &mut axis.position_m {
            curve.t_s.truncate(50);
            curve.y.truncate(50);
        }
    }
    let track = &mut replay.lead.as_mut().unwrap().track;
    [&mut track.east_m, &mut track.north_m, &mut track.lead_m].into_iter().for_each(|list| list.truncate(50));
    record
}

fn hostile_text(payload: &'static str) -> impl Fn(&Value) -> Option<Value> {
    move |value| value.is_string().then(|| Value::from(payload))
}

fn site(record: &FlightRecord, text: &str) -> Site {
    flight_site(&FlightPage {
        name: text,
        record,
        explorer: None,
        has_details: false,
        neighbours: [None; 2],
        track_href: None,
        index_href: text,
        command: text,
    })
}

fn bench(record: &BenchRecord, text: &str) -> Site {
    bench_site(&BenchPage { name: text, record, command: text, index_href: Some(text) })
}

fn card_page(card: &SensorCard, records: &[BenchRecord], text: &str) -> Site {
    let records: Vec<CardRecord> =
        records.iter().map(|record| CardRecord { name: text, record, href: Some(text) }).collect();
    card_site(&CardPage {
        card,
        card_file: Some(text),
        records: &records,
        without_mean: &[],
        remarks: &[],
        command: text,
    })
}

fn is_harmless(site: &Site, payload: &str) {
    for (path, bytes) in &site.files {
        let text = std::str::from_utf8(bytes).unwrap();
        // Parsing fails on any tag, attribute or link that is not ours. In CSV, `<` is an ordinary character.
        let is_table = path.ends_with(".csv");
        if is_table {
            assert!(text.lines().all(|line| line.matches('"').count() % 2 == 0), "{path}: a quote is left open");
        } else {
            read(text);
        }
        if !is_table && payload.contains(['<', '"', '\u{202e}', '\u{2028}', '\0']) {
            assert!(!text.contains(payload), "{path} holds {payload:?}");
        }
        let hidden = |c: char| {
            matches!(c, '\0'..='\u{8}' | '\u{b}'..='\u{1f}' | '\u{7f}'..='\u{9f}' | '\u{200b}'..='\u{200f}'
                | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
        };
        assert_eq!(text.chars().find(|&c| hidden(c)), None, "{path}");
    }
}

#[test]
fn no_text_of_a_flight_record_becomes_markup() {
    for payload in PAYLOADS {
        let (record, changed) = change_everywhere(&light_record(), &hostile_text(payload));
        assert!(changed > 60, "only {changed} texts were reached");
        is_harmless(&site(&record, payload), payload);
        let (record, _) = change_everywhere(&failed_record(), &hostile_text(payload));
        is_harmless(&site(&record, payload), payload);
    }
}

#[test]
fn no_text_of_a_campaign_record_becomes_markup() {
    for payload in PAYLOADS {
        let (record, changed) = change_campaign(&campaign_record(3), &hostile_text(payload));
        assert!(changed > 20, "only {changed} texts were reached");
        is_harmless(&campaign_site(&record, &[]), payload);
        let (record, changed) = change_campaign(&varied(3), &hostile_text(payload));
        assert!(changed > 80, "only {changed} texts were reached");
        let excerpts =
            [TrackExcerpt { flight: payload.to_owned(), zoom: light_record().replay.unwrap().zoom.unwrap() }];
        is_harmless(&campaign_site(&record, &excerpts), payload);
        let (changes, _) = change_everywhere(&crate::changes::all_kinds(), &hostile_text(payload));
        is_harmless(&changes_site(&changes, &record.flights), payload);
    }
}

#[test]
fn no_text_of_a_bench_record_becomes_markup() {
    let light = light_bench_record();
    for payload in PAYLOADS {
        let (record, changed) = change_everywhere(&light, &hostile_text(payload));
        assert!(changed > 100, "only {changed} texts were reached");
        is_harmless(&bench(&record, payload), payload);
    }
}

#[test]
fn no_text_of_a_bench_record_without_a_result_becomes_markup() {
    let records = [light_bench(silent_bench_record()), failed_bench_record()];
    for payload in PAYLOADS {
        for record in &records {
            let (record, _) = change_everywhere(record, &hostile_text(payload));
            is_harmless(&bench(&record, payload), payload);
        }
    }
}

#[test]
fn no_text_of_a_card_becomes_markup() {
    let records = [failed_bench_record(), light_bench_record()];
    let (sensor_card, _) = card();
    for payload in PAYLOADS {
        let (hostile_card, changed) = change_everywhere(&sensor_card, &hostile_text(payload));
        assert!(changed > 20, "only {changed} texts were reached");
        is_harmless(&card_page(&hostile_card, &records, payload), payload);
    }
}

#[test]
fn a_bench_record_with_absent_or_empty_parts_has_a_page() {
    let light = light_bench_record();
    let null = |value: &Value| (!value.is_null()).then_some(Value::Null);
    let inner = |value: &Value| null(value).filter(|_| !value.is_object() && !value.is_array());
    let (record, changed) = change_everywhere(&light, &inner);
    assert!(changed > 20, "{changed}");
    is_harmless(&bench(&record, "n"), "n");
    let (record, _) = change_everywhere(&light, &null);
    assert!(record.findings.is_none());
    let html = String::from_utf8(bench(&record, "n").files["index.html"].clone()).unwrap();
    assert!(html.contains("says measured, but has no findings"));
    let empty = |value: &Value| value.as_array().filter(|a| !a.is_empty()).map(|_| Value::Array(vec![]));
    let (record, changed) = change_everywhere(&light, &empty);
    assert!(changed > 10, "{changed}");
    is_harmless(&bench(&record, "n"), "n");
    let (empty_card, _) = change_everywhere(&card().0, &empty);
    is_harmless(&card_page(&empty_card, &[], "n"), "n");
}

#[test]
fn a_bench_record_with_extreme_numbers_has_a_page() {
    let light = light_bench_record();
    let (sensor_card, _) = card();
    for extreme in [1e300, -1e300, 5e-324, 0.0] {
        let change = |value: &Value| value.is_f64().then(|| Value::from(extreme));
        let (record, changed) = change_everywhere(&light, &change);
        assert!(changed > 200, "{changed}");
        is_harmless(&bench(&record, "n"), "n");
        let (extreme_card, _) = change_everywhere(&sensor_card, &change);
        is_harmless(&card_page(&extreme_card, std::slice::from_ref(&record), "n"), "n");
    }
}

#[test]
fn a_record_without_any_optional_value_has_a_page() {
    let absent = |value: &Value| (!value.is_null()).then_some(Value::Null);
    // First the inner options, then the outer ones: an absent replay hides its contents.
    let inner = |value: &Value| absent(value).filter(|_| !value.is_object() && !value.is_array());
    let (record, changed) = change_everywhere::<FlightRecord>(&light_record(), &inner);
    assert!(changed >= 10 && record.replay.is_some());
    is_harmless(&site(&record, "n"), "n");
    let (record, _) = change_everywhere::<FlightRecord>(&light_record(), &absent);
    assert!(record.replay.is_none() && record.log.is_none() && record.binding.is_none());
    is_harmless(&site(&record, "n"), "n");
    let (record, _) = change_campaign(&campaign_record(3), &absent);
    assert!(record.flights.iter().all(|f| f.duration_s.is_none() && f.map.is_none()));
    let html = String::from_utf8(campaign_site(&record, &[]).files["index.html"].clone()).unwrap();
    assert!(!html.contains(">NaN") && !html.contains(">null") && !html.contains(">None"));
}

#[test]
fn empty_lists_and_curves_have_a_page() {
    let empty = |value: &Value| value.as_array().filter(|a| !a.is_empty()).map(|_| Value::Array(vec![]));
    let (record, changed) = change_everywhere(&light_record(), &empty);
    assert!(changed >= 10);
    is_harmless(&site(&record, "n"), "n");
    is_harmless(&campaign_site(&campaign_record(0), &[]), "n");
}

#[test]
fn a_record_with_extreme_numbers_has_a_page() {
    for extreme in [1e300, -1e300, 5e-324, f64::MAX] {
        let change = |value: &Value| value.is_f64().then(|| Value::from(extreme));
        let (record, changed) = change_everywhere(&light_record(), &change);
        assert!(changed > 50);
        is_harmless(&site(&record, "n"), "n");
        for record in [campaign_record(3), varied(3)] {
            let (record, _) = change_campaign(&record, &change);
            is_harmless(&campaign_site(&record, &[]), "n");
        }
    }
    for extreme in [u64::MAX, 0] {
        let change = |value: &Value| value.is_u64().then(|| Value::from(extreme));
        let (record, _) = change_everywhere(&light_record(), &change);
        is_harmless(&site(&record, "n"), "n");
        let (record, _) = change_campaign(&campaign_record(3), &change);
        is_harmless(&campaign_site(&record, &[]), "n");
    }
}

#[test]
fn non_finite_values_are_left_out_and_counted() {
    let mut record = flight_record();
    let replay = record.replay.as_mut().unwrap();
    let axes = &mut replay.zoom.as_mut().unwrap().axes;
    axes[0].position_m[0].y[100] = f64::NAN;
    axes[0].position_m[2].y[100] = f64::INFINITY;
    replay.predicted_rms_m.value = f64::NAN;
    let html = String::from_utf8(site(&record, "n").files["index.html"].clone()).unwrap();
    assert!(html.contains("Not drawn, because not finite or beyond 10¹²: 2."));
    let sentence = html.split("Velocity predicts a change of").nth(1).unwrap();
    assert!(sentence[..sentence.find("</p>").unwrap()].contains(">not finite<"), "a non-finite number is labelled");
}

#[test]
fn a_flood_of_topics_notices_and_long_names_does_not_bloat_the_page() {
    let mut record = flight_record();
    let log = record.log.as_mut().unwrap();
    let mut topic = log.topics[0].clone();
    topic.name = "x".repeat(10_000);
    log.topics = vec![topic; 3_000];
    for i in 0..5_000 {
        record.notices.push(flight::Code::NotDecoded, "y".repeat(2_000), i, "z".repeat(2_000));
    }
    let binding = record.binding.as_mut().unwrap();
    binding.channels = vec![binding.channels[0].clone(); 500];
    let html = String::from_utf8(site(&record, "n").files["index.html"].clone()).unwrap();
    assert!(html.len() < 1_500_000, "{}", html.len());
    // Items that are not shown are counted.
    assert!(html.contains("and 2\u{202f}700 more") && html.contains("(9700 characters more)"));
}
