//! The pages of a bench and a card agree with their records.

use crate::bench_fixture::{self, bench_record, card, failed_bench_record, silent_bench_record};
use crate::html::{Tag, points, read, shows};
use crate::page_text::text;
use flight::Quantity;
use record::{
    BenchRecord, CardChannel, ChannelDynamics, DELAY_CHANGES, ENCODER_SLIP, Estimate, Finding, GateCheck, SensorCard,
    Verdict,
};
use report::{BenchPage, CardPage, CardRecord, IndexedCard, Site, WithoutMean, bench_site, card_site, cards_site};
use std::sync::LazyLock;

fn site(record: &BenchRecord) -> Site {
    let command = "flightlag bench swing-07-encoder.csv swing-07-mtig.csv --rig bench.rig.toml";
    bench_site(&BenchPage { name: "swing 07", record, command, index_href: Some("../index.html") })
}

fn page(record: &BenchRecord) -> String {
    text(&site(record), "index.html")
}

/// The pages of the record with everything, made once.
fn whole_site() -> &'static Site {
    static SITE: LazyLock<Site> = LazyLock::new(|| site(&bench_record()));
    &SITE
}

fn whole_page() -> String {
    text(whole_site(), "index.html")
}

/// The pages of the card, made once.
fn the_card() -> &'static Site {
    static SITE: LazyLock<Site> = LazyLock::new(made_card);
    &SITE
}

fn made_card() -> Site {
    let (card, records) = card();
    card_of(&card, &records)
}

fn card_of(card: &SensorCard, records: &[BenchRecord]) -> Site {
    let names = ["swing-07", "swing-08", "swing-09", "swing-10"];
    let of = |(name, record)| CardRecord { name, record, href: Some("../swing/index.html") };
    let records: Vec<CardRecord> = names.into_iter().zip(records).map(of).collect();
    card_site(&CardPage {
        card,
        card_file: None,
        records: &records,
        without_mean: &[],
        remarks: &[],
        command: "flightlag bench records",
    })
}

pub fn all_sites() -> [Site; 4] {
    let others = [silent_bench_record(), failed_bench_record()];
    let [silent, failed] = others.each_ref().map(site);
    [whole_site().clone(), silent, failed, the_card().clone()]
}

/// The visible text: the page without its tags.
fn words(html: &str) -> String {
    let after_tags = html.split('<').map(|part| part.split_once('>').map_or(part, |(_, text)| text));
    after_tags.collect()
}

/// Bits and text of every number in the markup.
fn data(html: &str) -> Vec<(f64, String)> {
    let tags = read(html);
    let with_bits = tags.iter().filter(|t| t.name == "data").filter_map(|t| Some((t.get("value")?, &t.text)));
    with_bits.map(|(value, text)| (value.parse().unwrap(), text.clone())).collect()
}

/// The number shown by a text.
fn shown(text: &str) -> f64 {
    let first = text.split("\u{a0}±").next().unwrap();
    first.replace('\u{2212}', "-").replace('\u{202f}', "").parse().unwrap()
}

#[test]
fn every_number_with_its_bits_on_a_bench_page_is_rounded_from_them() {
    for html in all_sites().iter().map(|site| text(site, "index.html")) {
        for (value, text) in data(&html) {
            let first = text.split("\u{a0}±").next().unwrap();
            let decimals = first.split_once('.').map_or(0, |(_, d)| d.len()) as i32;
            let digits = first.trim_start_matches('\u{2212}');
            let hidden = if decimals > 0 { 0 } else { (digits.len() - digits.trim_end_matches('0').len()) as i32 };
            let half = 0.5 * 10f64.powi(hidden - decimals);
            assert!((shown(&text) - value).abs() <= half * 1.000_001, "{value} is shown as {text}");
        }
    }
}

#[test]
fn the_estimates_of_every_channel_are_on_the_page() {
    let record = bench_record();
    let data = data(&whole_page());
    let mut expected: Vec<f64> = Vec::new();
    let in_ms = |e: &Estimate| e.value * 1e3;
    for c in &record.findings.as_ref().unwrap().channels {
        let Some(delay) = &c.delay else { continue };
        expected
            .extend([delay.delay.seconds(), delay.minimum_detectable_s, delay.crlb_s, delay.margin_s].map(|s| s * 1e3));
        expected.extend([&delay.as_seen_s, &delay.held_fit_s].into_iter().flatten().map(in_ms));
        for component in &c.components {
            expected.extend([component.gain, component.offset, component.drift].into_iter().flatten().map(|e| e.value));
            expected.extend(component.delay_s.iter().map(in_ms));
            expected.extend(component.noise.iter().map(|n| n.white_std));
        }
        expected.extend(c.injections.iter().filter_map(|i| Some(in_ms(&i.recovered.found()?.delay_error_s))));
        expected.extend(c.model.found().map(|m| in_ms(&m.sum_s)));
        expected.extend(c.jitter_s.found().map(in_ms));
    }
    assert!(expected.len() > 100, "{}", expected.len());
    for value in expected {
        assert!(data.iter().any(|(bits, _)| *bits == value), "{value}");
    }
}

#[test]
fn the_answer_comes_first_with_its_interval_and_its_reference() {
    let html = whole_page();
    let words = words(&html);
    // u = 0.8 ms; Student with 1.97.
    let value = words.find("400.3\u{a0}±\u{a0}1.6").unwrap();
    let answer = &words[value..value + 200];
    assert!(answer.contains("398.7\u{a0}to\u{a0}401.9") && answer.contains("relative to angular-rate.imu"), "{answer}");
    assert!(html.find("class=\"answer\"") < html.find("id=\"results\""));
    // The earliness of an early channel is positive.
    assert!(words.contains("is early by 0.60\u{a0}±\u{a0}0.22"));
}

#[test]
fn every_verdict_is_a_word_in_the_strip_and_in_its_channel_row() {
    let record = bench_record();
    let html = whole_page();
    let words = [
        (Verdict::Delayed, "Late"),
        (Verdict::Early, "Early"),
        (Verdict::EquivalentToZero, "On time"),
        (Verdict::Inconclusive, "Not decided"),
        (Verdict::NotMeasurable, "Not measurable"),
    ];
    let strip = html.split("class=\"strip\"").nth(1).unwrap().split("</div>").next().unwrap();
    let table = html.split("id=\"results\"").nth(1).unwrap().split("</table>").next().unwrap();
    for (verdict, word) in words {
        assert!(strip.contains(&format!("</span>{word}</span>")), "{word}");
        for c in record.findings.as_ref().unwrap().channels.iter().filter(|c| c.verdict == verdict) {
            let row = table.split(&format!(">{}</a>", c.name)).nth(1).unwrap().split("</tr>").next().unwrap();
            assert!(row.contains(&format!("</span>{word}</span>")), "{}: {row}", c.name);
        }
    }
}

#[test]
fn unknown_results_are_shown_with_their_reason() {
    let record = bench_record();
    let html = whole_page();
    for c in &record.findings.as_ref().unwrap().channels {
        if let Finding::CannotTell(why) = &c.response {
            assert!(html.contains(&format!("— {why}")), "{why}");
        }
    }
    let silent = page(&silent_bench_record());
    assert!(silent.matches("— the bar stands still").count() >= 4);
    for absent in ["NaN", ">null<", ">None<", "not finite"] {
        assert!(!html.contains(absent) && !silent.contains(absent), "{absent}");
    }
}

#[test]
fn a_record_without_a_result_starts_with_its_reason_and_has_provenance() {
    for (record, reason) in [
        (silent_bench_record(), "The bar moves by 0.4°"),
        (failed_bench_record(), "swing-09.csv: line 3: column &quot;count&quot;"),
    ] {
        let html = page(&record);
        let places = [reason, "id=\"health\"", "id=\"notices\"", "id=\"provenance\"", &record.rig.blake3];
        let places = places.map(|text| html.find(text).unwrap());
        assert!(places.is_sorted(), "{places:?}");
    }
}

/// Coordinates of the curves of this name, over all panels.
fn curves(svg: &str, name: &str) -> Vec<Vec<(f64, f64)>> {
    let tags = read(svg);
    let is_named = |pair: &&[Tag]| pair[0].name == "path" && pair[1].name == "title" && pair[1].text == name;
    tags.windows(2).filter(is_named).map(|pair| points(pair[0].get("d").unwrap())).collect()
}

#[test]
fn fig_4_has_the_panels_of_the_paper_in_order_and_then_height() {
    let site = whole_site();
    for path in ["figures/fig-4.svg", "figures/fig-4-whole.svg"] {
        let svg = text(site, path);
        let names = [
            "position.ins",
            "velocity.ins",
            "specific-force.imu",
            "attitude.ins",
            "magnetic-field.imu",
            "angular-rate.imu",
            "height.baro",
        ];
        let places: Vec<usize> = names.iter().map(|name| svg.find(&format!(">{name}, ")).unwrap()).collect();
        assert!(places.is_sorted(), "{path}: {places:?}");
        for name in ["reference at the true time", "measured"] {
            assert_eq!(curves(&svg, name).len(), 8, "{path}: {name}");
        }
    }
}

#[test]
fn the_delay_is_drawn_to_scale() {
    let svg = text(whole_site(), "figures/fig-4.svg");
    let dimension: Vec<(f64, f64)> = read(&svg)
        .iter()
        .filter(|t| t.name == "path" && t.get("stroke") == Some("#b42318"))
        .take(1)
        .flat_map(|t| points(t.get("d").unwrap()))
        .collect();
    let (from, to) = (
        dimension.iter().map(|p| p.0).fold(f64::INFINITY, f64::min),
        dimension.iter().map(|p| p.0).fold(0.0, f64::max),
    );
    // The panel shows seven seconds in 860 pixels of two units each.
    let seconds = (to - from) / (860.0 * 2.0) * 7.0;
    assert!((seconds - 0.4003).abs() < 7.0 / 860.0, "{seconds}");
    // The late reference is shifted right of the true one by the delay: compare the positions of the peaks.
    let highest = |name: &str| curves(&svg, name)[0].iter().copied().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    let late = (highest("reference, late as found").0 - highest("reference at the true time").0) / 1720.0 * 7.0;
    assert!((late - 0.4003).abs() < 0.05, "{late}");
}

#[test]
fn every_figure_is_named_described_numbered_and_shown_on_its_page() {
    for site in all_sites() {
        let html = text(&site, "index.html");
        let tags = read(&html);
        let figures = site.files.keys().filter(|path| path.starts_with("figures/") && path.ends_with(".svg")).count();
        assert_eq!(tags.iter().filter(|t| t.name == "figure").count(), figures);
        for path in site.files.keys().filter(|path| path.ends_with(".svg")) {
            let svg = text(&site, path);
            let drawn = read(&svg);
            assert_eq!(
                (drawn[0].get("role"), drawn[1].name.as_str(), drawn[2].name.as_str()),
                (Some("img"), "title", "desc")
            );
            assert!(drawn[1].text.len() > 5 && drawn[2].text.len() > 40, "{path}");
            assert!(!svg.contains(">not drawn:") && shows(&html, &svg), "{path}");
        }
        let numbers: Vec<String> = (1..=figures).map(|n| format!("<b>Figure {n}. ")).collect();
        let places: Vec<usize> = numbers.iter().map(|n| html.find(n).unwrap_or_else(|| panic!("{n}"))).collect();
        assert!(places.is_sorted(), "figures are numbered in the order of the page");
        // Channel figures are explained once for each kind; drawings of the rig need no explanation.
        let kinds = "components hysteresis response residuals autocorrelation objective minimum stationarity latency";
        let explained_once = |path: &&String| {
            let name = path.trim_end_matches(".svg");
            name.starts_with("figures/geometry-") || kinds.split(' ').any(|kind| name.ends_with(&format!("-{kind}")))
        };
        let svgs = || site.files.keys().filter(|path| path.starts_with("figures/") && path.ends_with(".svg"));
        let others = svgs().filter(|path| !explained_once(path)).count();
        assert_eq!(html.matches("How to read it.").count(), others);
        let of_channels = figures > others + 2;
        assert_eq!(html.matches("How to read the figures of a channel").count(), usize::from(of_channels));
    }
}

#[test]
fn anchors_resolve_ids_are_unique_and_nothing_is_fetched() {
    for site in all_sites() {
        let html = text(&site, "index.html");
        let tags = read(&html);
        assert!(tags.iter().filter(|t| t.name == "th").all(|t| t.get("scope").is_some()));
        let mut ids: Vec<&str> = tags.iter().filter_map(|t| t.get("id")).collect();
        for link in tags.iter().filter_map(|t| t.get("href")?.strip_prefix('#')) {
            assert!(ids.contains(&link), "{link}");
        }
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), count);
        for (path, bytes) in &site.files {
            let text = std::str::from_utf8(bytes).unwrap().replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
            // The policy lists scripts by hash, and a browser test checks their requests.
            let text: String = text.split("<script").map(|part| part.rsplit("</script>").next().unwrap()).collect();
            for word in ["http:", "https:", "url(", "@import", " src=", "<link", "<img"] {
                assert!(!text.contains(word), "{path}: {word}");
            }
        }
        assert!(html.contains("default-src 'none'"));
    }
}

#[test]
fn channels_whose_names_differ_only_in_punctuation_get_separate_sections() {
    let mut record = bench_record();
    let channels = &mut record.findings.as_mut().unwrap().channels;
    channels[0].name = "position-ins".into();
    channels[1].name = "Position INS".into();
    let tags = read(&page(&record));
    let ids: Vec<&str> = tags.iter().filter_map(|t| t.get("id")).collect();
    for id in ["position-ins-channel", "position-ins-2-channel", "position-ins-3-channel"] {
        assert_eq!(ids.iter().filter(|i| **i == id).count(), 1, "{id}");
    }
}

#[test]
fn the_method_text_reflects_the_options_used() {
    let with = whole_page();
    for text in [
        "Ornstein–Uhlenbeck process and white noise together",
        "Huber weights",
        "is assumed to be on time",
        "lower convex hull",
        "windows of <data value=\"15\">15</data> s",
    ] {
        assert!(with.contains(text), "{text}");
    }
    let mut record = bench_record();
    let findings = record.findings.as_mut().unwrap();
    findings.clocks.basis = record::TimeBasis::OneClock;
    findings.clocks.hull = None;
    for c in &mut findings.channels {
        c.held_rows = 0;
        if let Some(checks) = &mut c.checks {
            checks.downweighted_share = 0.0;
        }
        for noise in c.components.iter_mut().filter_map(|c| c.noise.as_mut()) {
            noise.wander_std = 0.0;
        }
    }
    let without = page(&record);
    assert!(without.contains("Noise was found white in every channel") && without.contains("stamped by one clock"));
    let method = without.split("id=\"method\"").nth(1).unwrap().split("id=\"provenance\"").next().unwrap();
    for text in ["Huber weights", "lower convex hull", "Repeats of held values"] {
        assert!(!method.contains(text), "{text}");
    }
}

#[test]
fn provenance_lists_the_inputs_and_the_rig() {
    let record = bench_record();
    let html = whole_page();
    let provenance = html.split("id=\"provenance\"").nth(1).unwrap();
    for log in &record.logs {
        for input in &log.inputs {
            assert!(provenance.contains(&input.name) && provenance.contains(&input.blake3));
        }
    }
    assert!(provenance.contains("counts_per_rev = 2000") && provenance.contains("--rig bench.rig.toml"));
    assert!(provenance.contains(&record.rig.blake3));
}

#[test]
fn a_channel_is_marked_if_the_data_contradict_its_rig_values() {
    let html = text(the_card(), "index.html");
    assert_eq!(html.matches("in doubt").count(), 3, "the reason, the answer and one row");
    assert!(html.contains("swing-07: azimuth by &lt;imu&gt;") && html.contains("; slow motion "));
}

/// The number always comes with the reason for doubt, and a lag does not explain a changing delay.
#[test]
fn a_delay_in_doubt_is_marked_in_the_first_sentence_and_where_it_is_used() {
    let (mut card, records) = card();
    let changes = format!("swing-07: {DELAY_CHANGES}, from 350.0 to 450.0 ms in windows");
    for channel in card.channels.iter_mut().filter(|c| c.name.starts_with("position")) {
        channel.contradicted = vec![changes.clone()];
        channel.verdict = Verdict::Delayed;
        channel.slow_motion_delay_s = Some(0.5);
    }
    let html = words(&text(&card_of(&card, &records), "index.html")).replace('\u{a0}', " ");
    let (answer, rest) = html.split_once("Validity: ").unwrap();
    assert!(answer.contains("✗ in doubt position.gps is late by") && answer.contains(&changes), "{answer}");
    assert!(!answer.contains("slow motion is"), "{answer}");
    let of_use = rest.split_once("Use it in a pipeline").unwrap().1;
    assert!(of_use.contains("✗ in doubt Measure again before you use this delay."), "{of_use}");
}

/// By delay over margin. A delay of 20 ms is 4 times the margin of 100 Hz, one of 30 ms 0.6 times that of 10 Hz.
#[test]
fn the_channel_that_is_latest_for_its_rate_comes_first_after_the_position() {
    let (card, _) = card();
    let like = card.channels.iter().find(|c| c.quantity == Quantity::VelocityNed).unwrap();
    let channel = |name: &str, delay_s: f64, rate_hz: f64| CardChannel {
        name: name.to_owned(),
        delay_s,
        update_rate_hz: Some(rate_hz),
        ..like.clone()
    };
    let channels = vec![channel("velocity.slow", 0.030, 10.0), channel("velocity.fast", 0.020, 100.0)];
    let html = text(&card_of(&SensorCard { channels, ..card }, &[]), "index.html").to_owned();
    let place = |name: &str| html.find(name).unwrap();
    assert!(place("velocity.fast") < place("velocity.slow"));
}

#[test]
fn the_answer_reports_records_that_disagree() {
    let (card, records) = card();
    let why = "the records disagree: a 400.7 ± 2.2 ms against b 600.0 ± 1.8 ms";
    let record = CardRecord { name: "swing-07", record: &records[0], href: None };
    let page = CardPage {
        card: &SensorCard { channels: vec![], ..card },
        card_file: None,
        records: &[record],
        without_mean: &[WithoutMean { channel: "position.gps", why }],
        remarks: &["swing-07: position.ins: cannot tell: widen analysis.search_s".to_owned()],
        command: "flightlag bench records",
    };
    let html = words(&text(&card_site(&page), "index.html"));
    let answer = html.split_once("Validity: ").unwrap().0;
    assert!(answer.contains(&format!("✗ no common delay position.gps: {why}.")), "{answer}");
    assert!(html.contains("position.gps (ms), no common delay"), "{html}");
    assert!(answer.contains("! Records swing-07: position.ins: cannot tell: widen analysis.search_s."), "{answer}");
    assert!(html.contains("no position on which the records agree"), "{html}");
}

#[test]
fn a_changing_delay_or_a_slipped_encoder_is_reported_first() {
    let mut record = bench_record();
    let findings = record.findings.as_mut().unwrap();
    let has_windows = |c: &&mut ChannelDynamics| c.verdict == Verdict::Delayed && c.stationarity.found().is_some();
    let channel = findings.channels.iter_mut().find(has_windows).unwrap();
    let Finding::Found(windows) = &mut channel.stationarity else { panic!("windows") };
    windows.changes = true;
    let bound = |f: fn(f64, f64) -> f64, from: f64| 1e3 * windows.delay_s.iter().map(|d| d.value).fold(from, f);
    let (least, most) = (bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY));
    findings.gate.checks[0].passed = false;
    let check = findings.gate.checks[0].clone();
    let doubtful = channels_of(&record).iter().filter(|c| c.changing_delay_s().is_some()).count();
    let html = words(&page(&record)).replace('\u{a0}', " ");
    let answer = html.split_once("All channels;").unwrap().0;
    let changes = format!("✗ in doubt The delay changes over the record, from {least:.1} to {most:.1} ms in windows.");
    assert!(answer.replace('\u{202f}', "").contains(&changes), "{answer}");
    assert!(answer.contains(&format!("Quality gate {}: ", check.name)), "{answer}");
    assert!(html.contains(&format!("✗ in doubt {doubtful} channel")), "{html}");

    let text = "+49.8 counts (+8.96°) at 30.00 s".to_owned();
    let findings = record.findings.as_mut().unwrap();
    findings.gate.checks.push(GateCheck { name: ENCODER_SLIP.to_owned(), passed: false, text: text.clone() });
    let html = words(&page(&record)).replace('\u{a0}', " ");
    let answer = html.split_once(" is late by ").unwrap().0;
    assert!(answer.contains(&format!("✗ in doubt encoder slip: {text}. Every delay below is in doubt.")), "{answer}");
    assert!(!html.contains("✓ On time") && !html.contains("▶ Late") && !html.contains("✓ Measured"), "{html}");
}

fn channels_of(record: &BenchRecord) -> &[ChannelDynamics] {
    &record.findings.as_ref().unwrap().channels
}

#[test]
fn lags_and_the_loop_delay_of_a_held_channel_have_an_uncertainty() {
    let (mut card, records) = card();
    let position = card.channels.iter_mut().find(|c| c.name == "position.gps").unwrap();
    (position.delay_s, position.delay_standard_uncertainty_s) = (0.4, 0.0065);
    position.as_seen_delay_s = Some(0.5207);
    let baro = card.channels.iter_mut().find(|c| c.name == "height.baro").unwrap();
    (baro.lags_s, baro.lags_standard_uncertainty_s) = (vec![0.158], vec![0.011]);
    (baro.slow_motion_delay_s, baro.slow_motion_standard_uncertainty_s) = (Some(0.163), Some(0.0085));
    let html = words(&text(&card_of(&card, &records), "index.html")).replace('\u{a0}', " ");
    for wanted in ["521 ± 13", "; lag 158 ± 22 ms", "; slow motion 163 ± 17 ms"] {
        assert!(html.contains(wanted), "{wanted}");
    }
}

#[test]
fn the_index_of_cards_counts_the_records_behind_the_position() {
    let (card, _) = card();
    let used = card.channels.iter().find(|c| c.name == "position.gps").unwrap().records;
    let html = |records: u64| {
        let site = cards_site(&[IndexedCard { card: Some(&card), records, href: "a/index.html" }]);
        text(&site, "index.html")
    };
    assert!(html(used + 1).contains(&format!("{used} of {}", used + 1)));
    assert!(html(used).contains(&format!(">{used}<")));
}

#[test]
fn an_outlier_of_a_card_is_named_and_drawn_differently() {
    let site = the_card();
    let html = text(site, "index.html");
    let left_out = html.split("Left out of the mean").nth(2).unwrap().split("</table>").next().unwrap();
    let row = left_out.split("<tr>").find(|row| row.contains(">position.ins<")).unwrap();
    assert!(row.contains("3: swing-09") && row.contains("outlier"), "{row}");
    let svg = text(site, "figures/forest.svg");
    let (kept, out) = (curves(&svg, "one record, ± U"), curves(&svg, "left out"));
    let channels = card().0.channels.len();
    // Each dot is a move and a zero-length line.
    assert_eq!((kept[0].len() / 2, out[0].len() / 2), (3 * channels, channels));
    // Position comes first. The outlier is the third of its four records, shifted right: 14 u late.
    let ins = 1;
    let dots = |dots: &[(f64, f64)], from: usize, n: usize| {
        dots.iter().step_by(2).skip(from).take(n).copied().collect::<Vec<_>>()
    };
    let (kept, out) = (dots(&kept[0], 3 * ins, 3), dots(&out[0], ins, 1)[0]);
    assert!(kept[1].1 < out.1 && out.1 < kept[2].1, "{kept:?} {out:?}");
    assert!(kept.iter().all(|p| p.0 < out.0));
}

#[test]
fn card_channels_are_sorted_by_margins_of_lateness_and_name_a_reference() {
    let html = text(the_card(), "index.html");
    let words = words(&html);
    let answer = words.split("Validity: ").next().unwrap();
    let gps =
        answer.find("position.gps is late by 412.0\u{a0}±\u{a0}8.5\u{a0}ms, relative to angular-rate.imu").unwrap();
    let ins =
        answer.find("position.ins is late by 400.3\u{a0}±\u{a0}1.1\u{a0}ms, relative to angular-rate.imu").unwrap();
    assert!(gps < ins && ins < answer.find("magnetic-field.imu is early by").unwrap());
    let svg = text(the_card(), "figures/forest.svg");
    let order =
        ["position.gps", "position.ins", "height.baro", "magnetic-field.imu", "attitude.ins", "specific-force.imu"];
    let places: Vec<usize> = order
        .iter()
        .map(|name| {
            html.split("id=\"channels\"")
                .nth(1)
                .unwrap()
                .split("<table")
                .nth(1)
                .unwrap()
                .find(&format!(">{name}<"))
                .unwrap()
        })
        .collect();
    assert!(places.is_sorted() && order.iter().all(|name| svg.contains(name)), "{places:?}");
}

#[test]
fn the_wander_removed_from_a_drawn_position_is_stated_above_its_panel() {
    let svg = text(whole_site(), "figures/fig-4.svg");
    // Range within the few swings and rms over the record of the fixture, two digits.
    assert!(svg.contains(
        "position.ins, north: late by 400.3\u{a0}±\u{a0}1.6 ms; wander of 0.23 m removed here (0.43 m rms over the \
         record)"
    ));
    assert!(!svg.contains("velocity.ins, north: on time (0.12\u{a0}±\u{a0}0.18 ms); wander"));
}

#[test]
fn a_bench_page_stays_small_and_the_same_record_gives_the_same_bytes() {
    let record = bench_record();
    let size = whole_page().len();
    assert!(size < 1_500_000, "{size}");
    assert_eq!(*whole_site(), site(&record));
    assert_eq!(*the_card(), made_card());
}

#[test]
fn a_json_round_trip_gives_the_same_page() {
    let record = bench_record();
    let json = serde_json::to_string(&record).unwrap();
    assert_eq!(page(&serde_json::from_str(&json).unwrap()), whole_page());
}

#[test]
fn a_swing_of_pure_noise_at_1_khz_does_not_bloat_the_page() {
    let mut record = bench_record();
    for c in record.findings.as_mut().unwrap().channels.iter_mut().flat_map(|c| &mut c.components) {
        for curve in c.zoom.iter_mut().take(3).skip(2) {
            *curve = bench_fixture::noise_curve(7000);
        }
    }
    let size = page(&record).len();
    assert!(size < 3_000_000, "{size}");
}

#[test]
fn a_record_with_other_timestamps_is_drawn_differently_and_explained() {
    let (card, mut records) = card();
    for channel in &mut records[1].findings.as_mut().unwrap().channels {
        channel.stamp_kind = flight::StampKind::Measured;
    }
    let site = card_of(&card, &records);
    let html = text(&site, "index.html");
    let said = format!(
        "all {} channels</td><td class=\"any\">its timestamps are measured, those of the card ",
        card.channels.len()
    );
    assert_eq!(html.matches("its timestamps are measured").count(), 1, "the reason appears once");
    assert!(html.contains(&said), "{said}");
    let svg = text(&site, "figures/forest.svg");
    let dots = |name: &str| curves(&svg, name)[0].len() / 2;
    let channels = card.channels.len();
    assert_eq!((dots("one record, ± U"), dots("left out")), (2 * channels, 2 * channels));
}

#[test]
fn the_iron_of_a_card_is_a_table_in_microtesla_or_a_reason() {
    let (mut card, records) = card();
    let data = data(&text(&card_of(&card, &records), "index.html"));
    for value in [1.21e-5 * 1e6, 1.041, 1.009, 6.52] {
        assert!(data.iter().any(|(bits, _)| *bits == value), "{value}");
    }
    let why = "all swings are at one azimuth, 30°; swing at 2 more, such as 150° and 270°";
    card.magnetometer.as_mut().unwrap().iron = Finding::CannotTell(why.into());
    assert!(text(&card_of(&card, &records), "index.html").contains(why));
    card.magnetometer = None;
    assert!(text(&card_of(&card, &records), "index.html").contains("no record shows a magnetometer"));
}

#[test]
fn a_failed_injection_and_an_unlogged_latency_have_a_reason() {
    let html = whole_page();
    assert!(html.contains("the first half alone cannot be fitted: the reference rests"));
    assert!(html.contains("the log has no timestamp later than the logged one"));
}
