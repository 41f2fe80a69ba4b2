//! A simulated flight with a delay from a sensor card.

use crate::config::Pipeline;
use crate::event::Event;
use crate::manifest::Why;
use crate::plan::Order;
use crate::run::run;
use crate::run_context::RunContext;
use bench_analysis::{card_text, parse_card};
use record::{CampaignRecord, FlightRecord, Outcome, SensorCard, Verdict};
use simulate::{Container, FlightSettings, McapSettings};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// A folder with a flight of 2026-05-04, its position 0.4 s late at 5 Hz, and a pipeline next to a card.
struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new(change: impl FnOnce(&mut SensorCard)) -> Case {
        let folder = tempfile::tempdir().unwrap();
        let flight = simulate::simulate(&FlightSettings { duration_s: 60.0, ..FlightSettings::default() }).unwrap();
        let case = Case { folder };
        std::fs::create_dir(case.path("flights")).unwrap();
        for file in Container::Mcap(McapSettings::default()).files(&flight, "f").unwrap() {
            std::fs::write(case.path("flights").join(file.path), file.bytes).unwrap();
        }
        std::fs::write(case.path("p.toml"), "schema = 1\n[delay]\ncard = \"m.card.toml\"\n").unwrap();
        case.write_card(change);
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write_card(&self, change: impl FnOnce(&mut SensorCard)) {
        let mut card = parse_card(&crate::delay::tests::example_card("1", "2026-02-03"), Path::new("c")).unwrap();
        card.channels[0].update_rate_hz = Some(5.0);
        card.channels[1].name = "velocity.gps".into();
        change(&mut card);
        std::fs::write(self.path("m.card.toml"), card_text(&card)).unwrap();
    }

    /// Runs the campaign; returns its record, that of the flight, and why it was read, if it was.
    fn run(&self) -> (CampaignRecord, FlightRecord, Vec<Why>) {
        let why = Mutex::new(vec![]);
        let listener = |event: &Event| {
            if let Event::Started { why: reasons, stage: crate::Stage::Replay, .. } = event {
                why.lock().unwrap().extend(reasons.clone());
            }
        };
        let order = Order {
            flights: self.path("flights"),
            out: self.path("out"),
            pipeline: Pipeline::read(&self.path("p.toml")).unwrap(),
            verify: false,
            replace: false,
            command: "c".into(),
            settle: None,
        };
        run(&order, &RunContext { threads: 1, cancel: &AtomicBool::new(false), events: &listener }).unwrap();
        let json = crate::record_of_page(&self.path("out").join("flights/f.mcap/index.html")).unwrap().unwrap();
        let flight = serde_json::from_slice(&json).unwrap();
        (crate::read_report(&self.path("out")).unwrap().unwrap(), flight, why.into_inner().unwrap())
    }
}

fn codes(record: &FlightRecord) -> Vec<&str> {
    record.notices.iter().map(|n| n.code.as_str()).filter(|code| code.starts_with("card")).collect()
}

#[test]
fn a_flight_is_compensated_by_its_cards_delay_and_the_record_names_it() {
    let case = Case::new(|_| {});
    let (campaign, flight, _) = case.run();
    assert_eq!(flight.outcome, Outcome::Compensated);
    let settings = flight.replay.as_ref().unwrap().settings.clone();
    assert_eq!((settings.delay.seconds(), settings.delay_uncertainty_s), (0.4, Some(0.003)));
    assert!(settings.delay_source.starts_with("sensor card m.card.toml of M 1"), "{}", settings.delay_source);
    let card = settings.card.unwrap();
    assert_eq!(card.blake3, blake3::hash(&std::fs::read(case.path("m.card.toml")).unwrap()).to_hex().to_string());
    assert_eq!((card.channel.as_str(), codes(&flight)), ("position.gps", vec![]));
    assert!(campaign.flights[0].attention.is_empty(), "{:?}", campaign.flights[0].attention);
    // The simulated truth: with the card's delay the error almost vanishes.
    let row = &campaign.flights[0];
    let (raw, exact) = (row.raw_error_rms_m.unwrap().value, row.exact_error_rms_m.unwrap().value);
    assert!(exact < 0.05 * raw, "{exact} against {raw}");
}

#[test]
fn a_card_with_new_content_remakes_the_result_and_reports_it() {
    let case = Case::new(|_| {});
    case.run();
    assert_eq!(case.run().2, [], "nothing changed");
    case.write_card(|card| card.channels[0].delay_s = 0.35);
    let (_, flight, why) = case.run();
    assert!(matches!(&why[..], [Why::SettingsChanged { settings }] if settings[0].starts_with("delay.pin")), "{why:?}");
    assert_eq!(flight.replay.unwrap().settings.delay.seconds(), 0.35);
}

#[test]
fn an_expired_card_is_used_and_its_flight_needs_attention() {
    let case = Case::new(|card| card.valid_until = Some("2026-05-03".into()));
    let (campaign, flight, _) = case.run();
    assert_eq!((flight.outcome.clone(), codes(&flight)), (Outcome::Compensated, vec!["card-mismatch"]));
    assert!(campaign.flights[0].attention[0].contains("expired on 2026-05-03"), "{:?}", campaign.flights[0].attention);
    let page = std::fs::read_to_string(case.path("out/flights/f.mcap/index.html")).unwrap();
    assert!(page.contains("EXPIRED on 2026-05-03"), "the source on the page says it");
}

#[test]
fn a_flight_whose_position_is_not_on_the_card_stays_uncompensated() {
    let case = Case::new(|card| card.channels[0].name = "position.ins".into());
    let (_, flight, _) = case.run();
    let Outcome::Uncompensated { reason } = &flight.outcome else { panic!("{:?}", flight.outcome) };
    assert!(
        reason.contains(
            "this flight replays the channel position.gps, which is not on the card; the card has position.ins"
        ),
        "{reason}"
    );
    case.write_card(|card| card.channels[0].verdict = Verdict::Inconclusive);
    let (_, flight, _) = case.run();
    let Outcome::Uncompensated { reason } = &flight.outcome else { panic!("{:?}", flight.outcome) };
    assert!(reason.contains("inconclusive"), "{reason}");
}

#[test]
fn two_cards_of_one_day_that_contradict_each_other_are_refused() {
    let case = Case::new(|_| {});
    std::fs::create_dir(case.path("cards")).unwrap();
    std::fs::write(
        case.path("p.toml"),
        "schema = 1\n[delay]\ncards = \"cards\"\n[sensor]\nmodel = \"M\"\nserial = \"1\"\n",
    )
    .unwrap();
    let keep = |name: &str| std::fs::copy(case.path("m.card.toml"), case.path("cards").join(name)).unwrap();
    keep("a.card.toml");
    case.write_card(|card| card.channels[0].delay_s = 0.401);
    keep("b.card.toml");
    assert_eq!(case.run().1.outcome, Outcome::Compensated, "they agree");
    case.write_card(|card| card.channels[0].delay_s = 0.2);
    keep("b.card.toml");
    let Outcome::Uncompensated { reason } = case.run().1.outcome else { panic!() };
    assert!(reason.contains("a.card.toml") && reason.contains("are of the same day (2026-02-03)"), "{reason}");
}

#[test]
fn shards_of_a_cluster_need_the_manifest_but_no_card() {
    let case = Case::new(|_| {});
    let quiet = |_: &Event| {};
    let context = RunContext { threads: 1, cancel: &AtomicBool::new(false), events: &quiet };
    let order = Order {
        flights: case.path("flights"),
        out: case.path("out"),
        pipeline: Pipeline::read(&case.path("p.toml")).unwrap(),
        verify: false,
        replace: false,
        command: "c".into(),
        settle: None,
    };
    std::fs::remove_file(case.path("m.card.toml")).unwrap();
    let planned = || {
        let kept = crate::plan_shards(&order, &context, 4).unwrap().keep().unwrap();
        crate::Manifest::read(&kept).unwrap()
    };
    for stage in [crate::Stage::Measure, crate::Stage::Replay] {
        let manifest = planned();
        assert_eq!(manifest.stage(), Some(stage));
        assert_eq!(crate::task(&manifest, 0, &context).unwrap().made, 1);
    }
    let manifest = planned();
    assert_eq!(crate::reduce(&manifest, &context).unwrap().totals.compensated, 1);
}
