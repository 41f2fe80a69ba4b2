use super::*;
use crate::cards::CardFile;
use flight::{ChannelHealth, ChannelSource, Clock, Held, Quantity, Series, Severity, Stamp, StampKind, Timeline};
use record::{CARD_VERSION, CardChannel, CardSource, SensorCard, SensorIdentity, TimeBasis, Verdict};

const DAY_NS: i64 = 86_400 * flight::NANOS_PER_SECOND;
/// 2026-05-04 12:00 UTC.
const NOON: i64 = 20_577 * DAY_NS + DAY_NS / 2;

fn on_card(name: &str, quantity: Quantity, verdict: Verdict, delay_s: f64, u_s: f64) -> CardChannel {
    CardChannel {
        name: name.into(),
        quantity,
        verdict,
        delay_s,
        delay_standard_uncertainty_s: u_s,
        as_seen_delay_s: None,
        lags_s: vec![],
        lags_standard_uncertainty_s: vec![],
        model: "delay".into(),
        gain: 1.0,
        gain_standard_uncertainty: 0.01,
        update_rate_hz: Some(4.0),
        stamp_kind: StampKind::Measured,
        basis: TimeBasis::OneClock,
        records: 3,
        between_runs_s: Some(0.001),
        outliers: vec![],
        slow_motion_delay_s: None,
        slow_motion_standard_uncertainty_s: None,
        contradicted: vec![],
    }
}

fn card(serial: &str, measured_on: &str) -> SensorCard {
    let velocity = on_card("velocity.ins", Quantity::VelocityNed, Verdict::EquivalentToZero, 0.0002, 0.001);
    SensorCard {
        card_version: CARD_VERSION,
        sensor: SensorIdentity { model: "M".into(), serial: Some(serial.into()), ..SensorIdentity::default() },
        rig: "bench".into(),
        method: "swung".into(),
        flightlag_version: "0.1.0".into(),
        analysis_version: 1,
        measured_on: Some(measured_on.into()),
        valid_from: Some("2026-01-01".into()),
        valid_until: Some("2026-12-31".into()),
        magnetometer: None,
        channels: vec![
            on_card("position.gps", Quantity::PositionGeodetic, Verdict::Delayed, 0.4, 0.003),
            CardChannel { update_rate_hz: Some(100.0), ..velocity },
        ],
        records: vec![CardSource { files: vec![], blake3: vec![], date: None, rig_blake3: "r".into() }],
    }
}

/// The text of a card of sensor `M` with this serial number.
pub(crate) fn example_card(serial: &str, measured_on: &str) -> String {
    bench_analysis::card_text(&card(serial, measured_on))
}

fn used(file: &str, card: &SensorCard) -> UsedCard {
    let text = bench_analysis::card_text(card);
    UsedCard::parse(serde_json::from_value::<CardFile>(serde_json::json!({"file": file, "text": text})).unwrap())
        .unwrap()
}

fn channel(quantity: Quantity, kind: StampKind, clock: Clock, first: i64, rows: i64, step_s: f64) -> Channel {
    let step = (step_s * 1e9) as i64;
    let stamps: Vec<Stamp> = (0..rows).map(|i| Stamp(first + i * step)).collect();
    let columns = quantity.components().iter().map(|_| vec![0.5; stamps.len()]).collect();
    Channel {
        quantity,
        held: vec![false; stamps.len()],
        present: vec![true; 3],
        series: Series::new(Timeline::new(kind, clock, stamps).unwrap(), columns).unwrap(),
        other_stamps: vec![],
        source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
    }
}

/// A flight of ten seconds with a position updated at 4 Hz.
struct Flown {
    flight: Flight,
    binding: Binding,
}

impl Flown {
    fn at(first: i64, clock: Clock, kind: StampKind) -> Flown {
        let mut flight = Flight::default();
        let position = channel(Quantity::PositionGeodetic, kind, clock, first, 40, 0.25);
        flight.channels.insert("position.gps".into(), position);
        let velocity = channel(Quantity::VelocityNed, kind, clock, first, 1000, 0.01);
        flight.channels.insert("velocity.ins".into(), velocity);
        let channels = vec![health("position.gps", 0.25), health("velocity.ins", 0.01)];
        let binding = Binding { map: "m".into(), why: String::new(), channels, others: vec![] };
        Flown { flight, binding }
    }

    fn delay(&self, cards: &[UsedCard]) -> Result<FoundDelay, String> {
        let pick = |name: &'static str| (name, &self.flight.channels[name]);
        let (position, velocity) = (pick("position.gps"), pick("velocity.ins"));
        let case = Case { flight: &self.flight, binding: &self.binding, position, velocity };
        card::delay_of(cards, &case)
    }

    fn with(&self, card: &SensorCard) -> Result<FoundDelay, String> {
        self.delay(&[used("m.card.toml", card)])
    }
}

fn health(name: &str, interval_s: f64) -> ChannelHealth {
    ChannelHealth {
        name: name.into(),
        quantity: Quantity::Scalar,
        source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
        absent: vec![],
        rows: 0,
        used: 0,
        rejected: vec![],
        stamps: None,
        offsets: vec![],
        held: Some(Held { repeats: 1, modal_run: 2, update_interval_s: interval_s }),
    }
}

fn usual() -> Flown {
    Flown::at(NOON, Clock::Unix, StampKind::Measured)
}

fn codes(found: &FoundDelay) -> Vec<(Severity, &str)> {
    found.notices.iter().map(|n| (n.severity, n.code.as_str())).collect()
}

#[test]
fn a_valid_card_gives_its_delay_and_its_source() {
    let found = usual().with(&card("1", "2026-02-03")).unwrap();
    assert_eq!((found.delay.seconds(), found.standard_uncertainty_s), (0.4, Some(0.003)));
    assert_eq!(
        found.source,
        "sensor card m.card.toml of M 1, measured on 2026-02-03, 3 records: position.gps 400.0 ± 6.0 ms (k = 2)"
    );
    assert_eq!(codes(&found), []);
    let use_of = found.card.unwrap();
    assert_eq!((use_of.channel.as_str(), use_of.delay_s.value), ("position.gps", 0.4));
    assert_eq!(use_of.blake3, blake3::hash(example_card("1", "2026-02-03").as_bytes()).to_hex().to_string());
}

/// x(t−Tp) + x(t−Tv) − x(t−Tv−Td) has no first-order error at Td = Tp, whatever Tv is.
#[test]
fn a_late_or_early_velocity_is_reported_and_leaves_the_delay_unchanged() {
    for (verdict, late_s) in [(Verdict::Delayed, 0.05), (Verdict::Early, -0.05)] {
        let mut card = card("1", "2026-02-03");
        card.channels[1] = CardChannel { verdict, delay_s: late_s, ..card.channels[1].clone() };
        let found = usual().with(&card).unwrap();
        assert_eq!((found.delay.seconds(), found.standard_uncertainty_s), (0.4, Some(0.003)));
        assert_eq!(codes(&found), [(Severity::Info, "card-residual")]);
    }
}

/// Former bug: the delay that fits the swing was removed, and flights with slow motion were later by the rest.
#[test]
fn of_a_lag_the_lateness_of_slow_motion_is_removed_with_a_warning() {
    let mut card = card("1", "2026-02-03");
    let found = |card: &SensorCard| {
        let found = usual().with(card).unwrap();
        assert_eq!(codes(&found), [(Severity::Warning, "card-residual")]);
        (
            found.delay.seconds(),
            found.standard_uncertainty_s.unwrap(),
            found.notices.iter().next().unwrap().text.clone(),
        )
    };
    let position = card.channels[0].clone();
    let lagged = CardChannel { lags_s: vec![0.1], model: "delay and first-order lag".into(), ..position };
    let slow_motion_standard_uncertainty_s = Some(0.004);
    card.channels[0] =
        CardChannel { slow_motion_delay_s: Some(0.43), slow_motion_standard_uncertainty_s, ..lagged.clone() };
    let (delay_s, u_s, text) = found(&card);
    // Motion between slow and as fast as the swing: uniform over 30 ms.
    assert!(delay_s == 0.43 && (u_s - 0.004_f64.hypot(0.03 / 12_f64.sqrt())).abs() < 1e-12, "{delay_s} {u_s}");
    assert!(text.contains("the lateness of slow motion, 430.0 ms; motion as fast as the swing has"), "{text}");
    // A card that does not state it.
    card.channels[0] = lagged;
    let (delay_s, _, text) = found(&card);
    assert!(delay_s == 0.4 && text.ends_with("400.0 ms; the card does not state how late slow motion is"), "{text}");
}

#[test]
fn a_card_from_a_rig_contradicted_by_the_data_gives_a_warning() {
    let mut card = card("1", "2026-02-03");
    card.channels[0].contradicted = vec!["swing-1: encoder sign".into()];
    let found = usual().with(&card).unwrap();
    assert_eq!(codes(&found), [(Severity::Warning, "rig-contradicted")]);
    assert!(found.notices.iter().any(|n| n.text.contains("swing-1: encoder sign")));
}

#[test]
fn a_card_without_the_replayed_channel_is_rejected_with_its_channels() {
    let mut card = card("1", "2026-02-03");
    card.channels[0].name = "position.ins".into();
    assert_eq!(
        usual().with(&card).unwrap_err(),
        "m.card.toml: this flight replays the channel position.gps, which is not on the card; the card has position.ins, velocity.ins"
    );
}

#[test]
fn a_zero_or_unknown_delay_is_not_removed() {
    for (verdict, delay_s, says) in [
        (Verdict::EquivalentToZero, 0.0002, "equivalent to zero: nothing to remove"),
        (Verdict::Inconclusive, 0.01, "inconclusive"),
        (Verdict::NotMeasurable, 0.01, "not measurable"),
        (Verdict::Early, -0.1, "early"),
    ] {
        let mut card = card("1", "2026-02-03");
        card.channels[0].verdict = verdict;
        card.channels[0].delay_s = delay_s;
        let reason = usual().with(&card).unwrap_err();
        assert!(reason.contains(says), "{reason}");
    }
}

#[test]
fn an_expired_card_is_used_with_a_warning() {
    let mut card = card("1", "2025-02-03");
    card.valid_until = Some("2026-05-03".into());
    let found = usual().with(&card).unwrap();
    assert_eq!(found.delay.seconds(), 0.4);
    assert_eq!(codes(&found), [(Severity::Warning, "card-mismatch")]);
    assert!(found.source.ends_with("; EXPIRED on 2026-05-03"), "{}", found.source);
    card.valid_until = Some("2026-05-04".into());
    assert_eq!(codes(&usual().with(&card).unwrap()), [], "the last day counts");
    card.valid_from = Some("2026-05-05".into());
    card.valid_until = None;
    assert_eq!(codes(&usual().with(&card).unwrap()), [(Severity::Warning, "card-mismatch")]);
}

#[test]
fn the_day_comes_from_any_clock_with_a_date_and_else_is_unknown() {
    // The same noon in GPS time, which is 18 s ahead of UTC and counts from 1980-01-06.
    let gps = NOON - (315_964_800 - 18) * flight::NANOS_PER_SECOND;
    let mut card = card("1", "2026-02-03");
    card.valid_until = Some("2026-05-03".into());
    let found = Flown::at(gps, Clock::Gps, StampKind::Measured).with(&card).unwrap();
    assert_eq!(codes(&found), [(Severity::Warning, "card-mismatch")]);
    let boot = Flown::at(0, Clock::Boot, StampKind::Measured);
    assert_eq!(codes(&boot.with(&card).unwrap()), [(Severity::Warning, "card-conditions")]);
    let mut tied = Flown::at(0, Clock::Boot, StampKind::Measured);
    let spread_s = flight::Distribution { min: 0.0, p01: 0.0, median: 0.0, p99: 0.0, max: 0.0 };
    let (clock, source) = (Clock::Boot, "gps".to_owned());
    tied.flight.utc = Some(flight::UtcTie { clock, source, offset_ns: NOON, spread_s, pairs: 1, outliers: 0 });
    assert_eq!(codes(&tied.with(&card).unwrap()), [(Severity::Warning, "card-mismatch")], "the log ties the clock");
    let mut other = Flown::at(0, Clock::Boot, StampKind::Measured);
    let stamps = (0..1000).map(|i| Stamp(NOON + i)).collect();
    let velocity = other.flight.channels.get_mut("velocity.ins").unwrap();
    velocity.other_stamps = vec![(StampKind::Logged, Clock::Unix, stamps)];
    assert_eq!(
        codes(&other.with(&card).unwrap()),
        [(Severity::Warning, "card-mismatch")],
        "another channel knows the day"
    );
    (card.valid_from, card.valid_until) = (None, None);
    assert_eq!(codes(&boot.with(&card).unwrap()), [], "without end no day is needed");
}

#[test]
fn of_several_cards_each_flight_uses_the_one_valid_on_its_day() {
    let mut old = card("1", "2025-12-01");
    (old.valid_from, old.valid_until) = (Some("2025-12-01".into()), Some("2026-06-30".into()));
    let mut new = card("1", "2026-06-01");
    (new.valid_from, new.valid_until) = (Some("2026-06-01".into()), Some("2027-05-31".into()));
    let cards = [used("a-new.card.toml", &new), used("b-old.card.toml", &old)];
    let on = |noon: i64| {
        let found = Flown::at(noon, Clock::Unix, StampKind::Measured).delay(&cards).unwrap();
        (found.card.unwrap().file, found.notices.len())
    };
    assert_eq!(on(NOON), ("b-old.card.toml".to_owned(), 0), "2026-05-04");
    assert_eq!(on(NOON + 40 * DAY_NS), ("a-new.card.toml".to_owned(), 0), "both are valid: the newer one");
    assert_eq!(on(NOON + 600 * DAY_NS), ("a-new.card.toml".to_owned(), 1), "none is: the newest, with a warning");
}

#[test]
fn timestamps_and_rates_that_differ_from_the_bench_are_reported() {
    let card = card("1", "2026-02-03");
    let logged = Flown::at(NOON, Clock::Unix, StampKind::Logged).with(&card).unwrap();
    assert_eq!(codes(&logged), [(Severity::Warning, "card-mismatch")]);
    let mut fast = usual();
    fast.binding.channels[0].held.as_mut().unwrap().update_interval_s = 0.1;
    assert_eq!(codes(&fast.with(&card).unwrap()), [(Severity::Warning, "card-conditions")]);
    fast.binding.channels[0].held.as_mut().unwrap().update_interval_s = 1.0 / 4.7;
    assert_eq!(codes(&fast.with(&card).unwrap()), [], "17.5 % are within 20 %");
}

#[test]
fn a_delay_against_an_anchor_is_reported() {
    let mut card = card("1", "2026-02-03");
    card.channels[0].basis = TimeBasis::Anchor { channel: "angular-rate.imu".into() };
    let found = usual().with(&card).unwrap();
    assert_eq!(codes(&found), [(Severity::Warning, "card-relative")]);
    assert_eq!(found.delay.seconds(), 0.4);
}

#[test]
fn a_delay_that_includes_the_transport_to_the_logger_is_reported() {
    let mut card = card("1", "2026-02-03");
    card.channels[0].basis = TimeBasis::FastestArrivals;
    let found = usual().with(&card).unwrap();
    assert_eq!(codes(&found), [(Severity::Warning, "card-relative")]);
}

fn of_pair(kind: &str, first: &str, second: &str, delay_s: f64) -> record::PairDelay {
    let u_s = 0.001;
    let measured = serde_json::json!({
        "kind": kind, "first": first, "second": second, "meaning": "", "origin": null, "excitation": null,
        "delay": { "found": {
            "delay_s": {"value": delay_s, "standard_uncertainty": u_s},
            "interval_95_s": [delay_s - 1.96 * u_s, delay_s + 1.96 * u_s],
            "hessian_s": u_s, "hac_s": u_s, "crlb_s": u_s, "smallest_detectable_s": 2.8 * u_s,
            "samples": 100, "downweighted_share": 0.0, "rival_s": null, "pieces": [], "over_time": [],
            "homogeneity": null, "alarm": null, "splits": [], "injections": [],
        } },
    });
    serde_json::from_value(measured).unwrap()
}

/// A pair matches only if kind, first and second channel all match.
#[test]
fn the_replayed_pair_is_found_by_its_kind_and_both_names() {
    let kind = "position-against-velocity";
    let delays = FlightDelays {
        pairs: vec![
            of_pair(kind, "position.ekf", "velocity.ins", 0.1),
            of_pair(kind, "position.gps", "velocity.ekf", 0.2),
            of_pair("velocity-against-acceleration", "position.gps", "velocity.ins", 0.3),
            of_pair(kind, "position.gps", "velocity.ins", 0.4),
        ],
    };
    let found = measured_pair(&delays, "position.gps", "velocity.ins");
    assert_eq!(found.found().map(|m| m.delay_s.value), Some(0.4));
    assert!(measured_pair(&delays, "position.ekf", "velocity.ekf").found().is_none());
}

/// The decision for the usual flight. Its pair shows 0.4 s and may have an alarm.
fn decided_with(source: DelaySource, contradicted: Option<&str>, alarm: Option<&str>) -> Decided {
    let flown = usual();
    let pick = |name: &'static str| (name, &flown.flight.channels[name]);
    let (position, velocity) = (pick("position.gps"), pick("velocity.ins"));
    let case = Case { flight: &flown.flight, binding: &flown.binding, position, velocity };
    let measured = match of_pair("position-against-velocity", position.0, velocity.0, 0.4).delay {
        Finding::Found(measured) => Finding::Found(MeasuredDelay { alarm: alarm.map(str::to_owned), ..measured }),
        Finding::CannotTell(why) => panic!("{why}"),
    };
    let fixed = FixedDelay {
        delay: Delay::from_seconds(0.4).unwrap(),
        standard_uncertainty_s: None,
        source: "pipeline".into(),
    };
    let rule = DelayRule { from: source, fixed: Some(fixed), cards: vec![] };
    let decision = Decision {
        asked: source,
        row: 1,
        used: Some(source),
        delay_s: Some(0.4),
        standard_uncertainty_s: None,
        circular: false,
        words: String::new(),
        contradicted: contradicted.map(str::to_owned),
    };
    let lateness = crate::answer::unknown("f");
    let known = Known { decision: &decision, lateness: &lateness, measured: &measured };
    rule.chosen(&case, &known, || panic!("no sweep was asked for")).unwrap()
}

#[test]
fn a_delay_that_the_flight_contradicts_is_removed_with_a_warning() {
    assert_eq!(codes(&decided_with(DelaySource::Fixed, None, None).found), []);
    let found = decided_with(DelaySource::Fixed, Some("the flight shows 0.1 s"), None).found;
    assert_eq!(codes(&found), [(Severity::Warning, "delay-contradicted")]);
    assert_eq!(found.delay.seconds(), 0.4);
}

#[test]
fn a_measured_delay_that_changes_in_its_flight_gives_a_warning() {
    assert_eq!(codes(&decided_with(DelaySource::Flight, None, None).found), []);
    let found = decided_with(DelaySource::Flight, None, Some("the delay steps")).found;
    assert_eq!(codes(&found), [(Severity::Warning, "flight-delay-changes")]);
}
