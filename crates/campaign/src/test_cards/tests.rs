use super::cover::status;
use super::*;
use crate::criteria::tests::record;
use record::{CardStatus, Outcome};
use std::fs;

/// Criteria that the record of the tests meets or fails: it holds no restart.
fn criteria(most: u32) -> String {
    format!(
        "schema = 1\n[[criterion]]\nid = \"restarts\"\ntitle = \"t\"\nmetric = \"restarts\"\nat_most = {most}\nrationale = \"r\"\n"
    )
}

/// Cards of flights in a folder with these files.
fn found(files: &[(&str, &str)], flights: &[&str]) -> (Result<TestCardFiles, CampaignError>, Vec<IgnoredInput>) {
    let folder = tempfile::tempdir().unwrap();
    let mut ignored = vec![];
    for (name, text) in files {
        fs::create_dir_all(folder.path().join(name).parent().unwrap()).unwrap();
        fs::write(folder.path().join(name), text).unwrap();
        ignored.push(IgnoredInput { path: (*name).to_owned(), reason: "a .toml file, not a log".to_owned() });
    }
    (TestCardFiles::find(folder.path(), flights.iter().copied(), &mut ignored), ignored)
}

fn cards(files: &[(&str, &str)], flights: &[&str]) -> TestCards {
    TestCards::of_files(&found(files, flights).0.unwrap()).unwrap()
}

const CAMPAIGN: &str = "schema = 1\ntitle = \"T\"\n[report]\nnumber = \"R1\"\nauthor = \"A\"\n[aircraft]\nmass_kg = 12.5\n\
    [[instrumentation]]\nchannel = \"position.gps\"\nsensor = \"F9P\"\nserial = \"1\"\n\
    [[card]]\nnumber = \"TC-1\"\ntitle = \"turns\"\nobjective = \"find the delay\"\nflights = [\"a*\"]\n\
    [[card]]\nnumber = \"TC-2\"\ntitle = \"climb\"\n";

#[test]
fn a_card_is_not_a_log_and_one_without_a_flight_is_listed_with_the_reason() {
    let small = "schema = 1\n";
    let files =
        [("test-card.toml", small), ("a.test-card.toml", small), ("b/c.test-card.toml", small), ("notes.toml", small)];
    let (found, ignored) = found(&files, &["a.mcap", "b/d.mcap"]);
    let found = found.unwrap();
    assert_eq!(
        found.files().map(|card| card.file.as_str()).collect::<Vec<_>>(),
        ["test-card.toml", "a.test-card.toml"]
    );
    let left: Vec<(&str, &str)> = ignored.iter().map(|i| (i.path.as_str(), i.reason.as_str())).collect();
    assert_eq!(
        left,
        [
            ("b/c.test-card.toml", "a test card without a flight: no log in its folder matches its names"),
            ("notes.toml", "a .toml file, not a log")
        ]
    );
}

#[test]
fn a_card_is_named_after_the_flight_with_or_without_extension() {
    assert_eq!(names_of("x/a.b.mcap"), ["x/a.b.mcap.test-card.toml", "x/a.b.test-card.toml"]);
    assert_eq!(names_of("x.y/bag"), ["x.y/bag.test-card.toml", "x.y/bag.test-card.toml"]);
}

#[test]
fn one_run_reports_all_errors_of_all_cards_with_their_lines() {
    let files = [
        (
            "test-card.toml",
            "schema = 2\n[report]\ndate = \"31.5.2026\"\n[aircraft]\nmass_kg = -1\n[[card]]\nnumber = \"1\"\n[[card]]\nnumber = \"1\"\n",
        ),
        ("a.test-card.toml", "schema = 1\n[aircraft]\nmas_kg = 3\n[[card]]\nnumber = \"1\"\ntitel = \"x\"\n"),
        ("b.test-card.toml", "schema = 1\n[[card]]\nnumber = \"1\"\ncriteria = \"none.toml\"\n"),
    ];
    let error = found(&files, &["a.mcap", "b.mcap"]).0.unwrap_err().to_string();
    for part in [
        "test-card.toml:1: schema must be 1",
        "test-card.toml:3: date = \"31.5.2026\": must be a date such as 2026-05-31",
        "test-card.toml:5: mass_kg = -1: must be from 0.001 to 1000000",
        "test-card.toml:9: number \"1\" is already used by the card on line 7",
        "a.test-card.toml:3: unknown key `mas_kg`: did you mean `mass_kg`?",
        "a.test-card.toml:6: unknown key `titel`: did you mean `title`?",
        "none.toml",
    ] {
        assert!(error.contains(part), "{part}\n{error}");
    }
}

#[test]
fn a_flight_card_extends_and_overrides_that_of_the_campaign() {
    let own = "schema = 1\n[report]\nauthor = \"B\"\n[[instrumentation]]\nchannel = \"position.gps\"\nserial = \"2\"\n\
               [[instrumentation]]\nchannel = \"velocity.ekf\"\n[[card]]\nnumber = \"TC-2\"\npriority = \"must\"\n";
    let cards = cards(&[("test-card.toml", CAMPAIGN), ("a1.test-card.toml", own)], &["a1.mcap", "b.mcap"]);
    let test = cards.of_flight("a1.mcap", &record()).unwrap();
    assert_eq!((test.report.number.as_deref(), test.report.author.as_deref()), (Some("R1"), Some("B")));
    assert_eq!((test.title.as_deref(), test.aircraft.mass_kg), (Some("T"), Some(12.5)));
    let rows: Vec<_> =
        test.instrumentation.iter().map(|i| (i.channel.as_str(), i.sensor.as_deref(), i.serial.as_deref())).collect();
    assert_eq!(rows, [("position.gps", Some("F9P"), Some("2")), ("velocity.ekf", None, None)]);
    let flown: Vec<_> = test
        .cards
        .iter()
        .map(|c| (c.card.number.as_str(), c.card.title.as_deref(), c.card.priority.as_deref()))
        .collect();
    assert_eq!(flown, [("TC-1", Some("turns"), None), ("TC-2", Some("climb"), Some("must"))]);
    assert!(cards.of_flight("b.mcap", &record()).unwrap().cards.is_empty(), "no pattern gives it a card");
}

#[test]
fn a_card_is_done_after_a_good_flight_else_to_repeat_or_missing() {
    let three = CAMPAIGN.replace("\"TC-2\"", "\"TC-2\"\nflights = [\"b*\"]\ncriteria = \"c.toml\"")
        + "[[card]]\nnumber = \"TC-3\"\n";
    let files = [("test-card.toml", three.as_str()), ("c.toml", &criteria(0))];
    let cards = cards(&files, &["a1", "a2", "b"]);
    let mut restarted = record();
    restarted.replay.as_mut().unwrap().coverage.restarts = 1;
    let mut lost = record();
    lost.outcome = Outcome::Failed { reason: "empty file".to_owned() };
    let row = |flight: &str, record: &FlightRecord| record::FlightRow {
        flight: flight.to_owned(),
        cards: row_cards(&cards.of_flight(flight, record).unwrap()),
        ..crate::table::tests::row(flight)
    };
    let rows = [row("a1", &lost), row("a2", &record()), row("b", &restarted)];
    let campaign = cards.of_campaign(&rows).unwrap();
    let covered: Vec<_> =
        campaign.coverage.iter().map(|c| (c.card.number.as_str(), c.status, c.flights.len())).collect();
    assert_eq!(
        covered,
        [("TC-1", CardStatus::Done, 2), ("TC-2", CardStatus::Repeat, 1), ("TC-3", CardStatus::Missing, 0)]
    );
    assert_eq!(campaign.coverage[0].flights[0].why, "the log could not be used: empty file");
    assert_eq!(campaign.coverage[1].flights[0].why, "fails: restarts");
}

#[test]
fn without_criteria_a_card_is_done_with_a_result_else_to_repeat() {
    let because = |reason: &str| (CardStatus::Repeat, reason.to_owned());
    let reason = || "parked".to_owned();
    assert_eq!(status(&Outcome::Compensated, None), (CardStatus::Done, String::new()));
    assert_eq!(status(&Outcome::Uncompensated { reason: reason() }, None), (CardStatus::Done, String::new()));
    assert_eq!(status(&Outcome::NotMeasurable { reason: reason() }, None), because("parked"));
    assert_eq!(status(&Outcome::Pending { reason: reason() }, None), because("parked"));
}

#[test]
fn the_hash_of_a_flight_changes_only_with_its_own_card() {
    let with =
        |a: &str| found(&[("a.test-card.toml", a), ("b.test-card.toml", "schema = 1\n")], &["a", "b", "c"]).0.unwrap();
    let (one, two) = (with("schema = 1\n"), with("schema = 1\ntitle = \"x\"\n"));
    assert_ne!(one.hash_of("a"), two.hash_of("a"));
    assert_eq!(one.hash_of("b"), two.hash_of("b"));
    assert_eq!(one.hash_of("c"), "");
    assert_ne!(one.hash(), two.hash());
}

#[test]
fn the_example_is_valid_and_has_every_key_of_the_schema() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines");
    let path = folder.join("test-card.toml");
    let text = fs::read_to_string(&path).unwrap();
    TestCardFile::parse(&text, &path).unwrap();
    let mut keys = vec![];
    keys_of(&serde_json::from_str(pipelines::TEST_CARD_SCHEMA).unwrap(), &mut keys);
    assert!(keys.len() > 30, "{keys:?}");
    for key in keys {
        let is_there = text.lines().any(|line| {
            line.starts_with(&format!("{key} = "))
                || line.ends_with(&format!("[{key}]"))
                || line.ends_with(&format!("[[{key}]]"))
        });
        assert!(is_there, "{key}");
    }
}

/// Names of the properties of a schema, at any depth.
fn keys_of(schema: &Value, keys: &mut Vec<String>) {
    match schema {
        Value::Object(fields) => {
            if let Some(Value::Object(properties)) = fields.get("properties") {
                keys.extend(properties.keys().cloned());
            }
            fields.values().for_each(|value| keys_of(value, keys));
        }
        Value::Array(list) => list.iter().for_each(|value| keys_of(value, keys)),
        _ => {}
    }
}
