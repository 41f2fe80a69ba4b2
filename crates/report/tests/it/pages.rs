//! The pages agree with the records.

use crate::fixture::{self, campaign_record, failed_record, flight_record, parked_record};
use crate::html::{Tag, points, read, shows};
use crate::page_text::text;
use record::{Curve, FlightRecord, Outcome};
use report::{FlightPage, Site, campaign_site, flight_site};

fn site(record: &FlightRecord) -> Site {
    let (name, index_href) = ("north field/flight 07.mcap", "../../index.html");
    flight_site(&FlightPage {
        name,
        record,
        explorer: None,
        has_details: false,
        neighbours: [None; 2],
        track_href: None,
        index_href,
        command: "flightlag campaign flights --out reports",
    })
}

fn page(record: &FlightRecord) -> String {
    text(&site(record), "index.html")
}

/// The number shown by a text, and half of its last digit.
fn shown_number(text: &str) -> (f64, f64) {
    let plain: String = text.replace('\u{2212}', "-").chars().filter(|c| *c != '\u{202f}').collect();
    let decimals = plain.split_once('.').map_or(0, |(_, d)| d.len());
    // A whole number may be rounded to tens or hundreds, depending on its uncertainty: allow for the
    // digits that the trailing zeros hide.
    let zeros = if decimals == 0 { plain.len() - plain.trim_end_matches('0').len() } else { 0 };
    (plain.parse().unwrap(), 0.5 * 10f64.powi(zeros as i32 - decimals as i32))
}

/// Coordinates of the curve of this name, over all panels.
fn curve(svg: &str, name: &str) -> Vec<(f64, f64)> {
    let tags = read(svg);
    let is_named = |pair: &&[Tag]| pair[0].name == "path" && pair[1].name == "title" && pair[1].text == name;
    tags.windows(2).filter(is_named).flat_map(|pair| points(pair[0].get("d").unwrap())).collect()
}

/// Thinning drops points on the line between their neighbours, and north and east keep different points.
#[test]
fn the_delay_as_a_length_is_speed_times_delay_despite_thinned_curves() {
    let mut record = flight_record();
    let zoom = record.replay.as_mut().unwrap().zoom.as_mut().unwrap();
    let line = |name: &str, lag_s: f64, t_s: &[f64]| {
        let y = t_s.iter().map(|t| 10.0 * (t - lag_s)).collect();
        Curve { name: name.into(), t_s: t_s.to_vec(), y, breaks: vec![], stands_for: 3000 }
    };
    for (axis, kept) in zoom.axes.iter_mut().zip([[232.0, 240.3, 262.0], [232.0, 251.7, 262.0]]) {
        axis.position_m = vec![line(fixture::RAW, 0.4, &kept), line(fixture::EXACT, 0.0, &[232.0, 262.0])];
    }
    // 0.4 s at 10 m/s on each of two axes.
    let title = "Raw to compensated, with the age of the fix: up to 5.7\u{a0}m in the hardest turn";
    assert!(page(&record).contains(title));
}

#[test]
fn every_number_with_its_bits_on_the_page_is_rounded_from_them() {
    let record = flight_record();
    let replay = record.replay.as_ref().unwrap();
    let tags = read(&page(&record));
    let data: Vec<(f64, &str)> = tags
        .iter()
        .filter(|t| t.name == "data")
        .map(|t| (t.get("value").unwrap().parse().unwrap(), t.text.as_str()))
        .collect();
    for (value, text) in &data {
        let (shown, half) = shown_number(text.split("\u{a0}±").next().unwrap());
        assert!((shown - value).abs() <= half * 1.000_001, "{value} is shown as {text}");
    }
    for c in &replay.compensators {
        let estimates = [Some(c.raw_minus_this_rms_m), c.step_at_fix_rms_m, c.error_rms_m, c.error_p95_m];
        for estimate in estimates.into_iter().flatten() {
            assert!(data.iter().any(|(value, _)| *value == estimate.value), "{} {}", c.name, estimate.value);
        }
    }
}

#[test]
fn the_effect_is_in_the_answer_and_the_correction_in_the_table() {
    let record = flight_record();
    let html = page(&record);
    let answer = html.split("<h2").next().unwrap();
    assert!(answer.contains("7.03 → 0.04 m (against position.truth)."), "{answer}");
    assert!(!answer.contains("helped:"), "the badge says it: {answer}");
    let numbers = html.split(">Compensators</h2>").nth(1).unwrap().split("<h2").next().unwrap();
    // raw − exact of the two harmonics, u = 0.0104 m.
    assert!(numbers.contains(&format!(">{:.3}\u{a0}±", fixture::correction_rms())), "{numbers}");
}

#[test]
fn the_verdict_is_a_word_and_lost_data_has_its_own_word() {
    let words = |html: &str| {
        ["Helped", "Not measurable", "Failed", "LOG DAMAGED"].map(|w| html.contains(&format!("</span>{w}</span>")))
    };
    assert_eq!(words(&page(&flight_record())), [true, false, false, true]);
    let mut whole = flight_record();
    whole.notices = flight::Notices::new();
    assert_eq!(words(&page(&whole)), [true, false, false, false]);
    assert_eq!(words(&page(&failed_record())), [false, false, true, false]);
    assert_eq!(words(&page(&parked_record())), [false, true, false, true]);
}

#[test]
fn a_flight_without_a_result_starts_with_its_reason_and_has_provenance() {
    for record in [failed_record(), parked_record()] {
        let html = page(&record);
        let (Outcome::Failed { reason } | Outcome::NotMeasurable { reason }) = &record.outcome else { panic!() };
        let places = [reason.as_str(), ">Data health<", ">Notices<", ">Files and provenance<", &record.key]
            .map(|text| html.find(text).unwrap());
        assert!(places.is_sorted(), "{places:?}");
    }
}

#[test]
fn a_spike_of_ten_sigma_is_drawn_at_its_full_height() {
    let mut record = flight_record();
    let replay = record.replay.as_mut().unwrap();
    replay.zoom = None;
    for axis in &mut replay.axes {
        axis.position_m.truncate(1);
        let raw = &mut axis.position_m[0];
        raw.t_s = (0..20_000).map(|i| f64::from(i) * 0.01).collect();
        raw.y = (0..20_000).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        raw.y[12_345] = 10.0;
        raw.breaks = vec![];
    }
    let svg = text(&site(&record), "figures/fig-7.svg");
    let all = curve(&svg, "raw, newest fix held");
    // Upper panel only: the lower one starts where the abscissa jumps back.
    let end = all.windows(2).position(|w| w[1].0 < w[0].0 - 100.0).unwrap() + 1;
    let mut heights: Vec<f64> = all[..end].iter().map(|p| p.1).collect();
    heights.sort_by(f64::total_cmp);
    let (spike, plus, minus) = (heights[0], heights[1], heights[heights.len() - 1]);
    let ratio = (plus - spike) / (minus - plus);
    assert!((ratio - 4.5).abs() < 0.1, "the spike is {ratio} times the peak-to-peak noise above it, not 4.5");
    // It is at the right time: 123.45 s of 199.99 s.
    let (left, right) = (all[0].0, all[end - 1].0);
    let at = all.iter().find(|p| p.1 == spike).unwrap().0;
    assert!(((at - left) / (right - left) - 123.45 / 199.99).abs() < 0.002);
}

#[test]
fn raw_and_compensated_are_solid_in_two_colours_and_never_hidden() {
    let svg = text(&site(&flight_record()), "figures/fig-7.svg");
    let tags = read(&svg);
    let dashes = |name: &str| {
        let pair = tags.windows(2).find(|w| w[0].name == "path" && w[1].name == "title" && w[1].text == name).unwrap();
        (pair[0].get("stroke-dasharray").map(str::to_owned), pair[0].get("stroke").map(str::to_owned))
    };
    let (raw, exact) = (dashes("raw, newest fix held"), dashes("compensated (exact form)"));
    assert!(raw.0.is_none() && exact.0.is_none() && raw.1 != exact.1);
    assert!(!svg.contains("<title>Padé"));
}

#[test]
fn curves_are_interrupted_at_the_breaks_of_the_record() {
    let svg = text(&site(&flight_record()), "figures/lead.svg");
    let starts = svg.lines().filter(|l| l.contains("<title>compensated (exact form)")).map(|l| l.matches('M').count());
    assert_eq!(starts.collect::<Vec<_>>(), [2, 2]);
}

#[test]
fn every_figure_is_named_described_and_on_the_page() {
    let site = site(&flight_record());
    let html = text(&site, "index.html");
    for name in ["fig-7", "turn", "lead", "track", "delay-over-time", "budget", "timeline"] {
        let svg = text(&site, &format!("figures/{name}.svg"));
        let tags = read(&svg);
        assert_eq!((tags[0].get("role"), tags[1].name.as_str(), tags[2].name.as_str()), (Some("img"), "title", "desc"));
        assert!(!tags[1].text.is_empty() && tags[2].text.len() > 80, "{name}");
        assert!(shows(&html, &svg), "{name} is not in the page");
        assert!(text(&site, &format!("figures/{name}.csv")).lines().count() > 2, "{name}");
    }
}

#[test]
fn pages_make_no_external_requests() {
    let campaign = campaign_site(&campaign_record(30), &[]);
    for (path, bytes) in site(&flight_record()).files.iter().chain(&campaign.files) {
        let text = std::str::from_utf8(bytes).unwrap();
        read(text);
        let without_namespace = text.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
        for word in ["http:", "https:", "url(", "@import", " src=", "<link", "<img"] {
            assert!(!without_namespace.contains(word), "{path}: {word}");
        }
        assert!(!path.ends_with(".html") || text.contains("default-src 'none'"));
    }
}

#[test]
fn every_table_header_has_a_scope_and_every_id_is_unique() {
    for html in [page(&flight_record()), text(&campaign_site(&campaign_record(30), &[]), "index.html")] {
        let tags = read(&html);
        assert_eq!(tags[0].get("lang"), Some("en"));
        assert!(tags.iter().filter(|t| t.name == "th").all(|t| t.get("scope").is_some()));
        let mut ids: Vec<&str> = tags.iter().filter_map(|t| t.get("id")).collect();
        let links: Vec<&str> = tags.iter().filter_map(|t| t.get("href")?.strip_prefix('#')).collect();
        assert!(links.iter().all(|link| ids.contains(link)), "{links:?} {ids:?}");
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), count);
    }
}

#[test]
fn the_same_record_gives_the_same_bytes() {
    assert_eq!(site(&flight_record()), site(&flight_record()));
    assert_eq!(campaign_site(&campaign_record(50), &[]), campaign_site(&campaign_record(50), &[]));
}

#[test]
fn flights_with_problems_come_first_with_their_reason() {
    let record = campaign_record(40);
    let html = text(&campaign_site(&record, &[]), "index.html").replace("<wbr>", "");
    let (attention, all) = html.split_once(">All flights</h2>").unwrap();
    let attention = attention.split_once(">Needs attention</h2>").unwrap().1;
    let link = |flight: &str| format!("<bdi>{flight}</bdi></a>");
    for row in &record.flights {
        let of_row = all.split("<tr").find(|part| part.contains(&link(&row.flight))).unwrap();
        let of_row = of_row.split("</tr>").next().unwrap();
        let troubled = row.lossy || row.outcome != Outcome::Compensated;
        assert_eq!(of_row.contains("data-reason="), troubled, "{}", row.flight);
        assert!(troubled || !attention.contains(&link(&row.flight)), "{}", row.flight);
    }
    assert!(attention.contains("flight-0010.bag: no index and no record at byte 13"));
    // Order: failed, data lost, not moving.
    let place = |i: usize| attention.find(&link(&record.flights[i].flight)).unwrap();
    assert!(place(10) < place(6) && place(13) < place(12));
    // The table also starts with the worst.
    let row = |i: usize| all.find(&link(&record.flights[i].flight)).unwrap();
    assert!(row(10) < row(6) && row(6) < row(0));
}

#[test]
fn the_table_sorts_by_the_exact_values_of_the_record() {
    let record = campaign_record(40);
    let tags = read(&text(&campaign_site(&record, &[]), "index.html"));
    let bits: Vec<f64> = tags.iter().filter(|t| t.name == "td").filter_map(|t| t.get("data-v")?.parse().ok()).collect();
    for row in &record.flights {
        let numbers = [row.duration_s, row.speed_median_mps, row.valid_share, row.correction_rms_m.map(|e| e.value)];
        assert!(numbers.into_iter().flatten().all(|n| bits.contains(&n)), "{}", row.flight);
    }
}

#[test]
fn ignored_inputs_are_listed_by_reason() {
    let html = text(&campaign_site(&campaign_record(3), &[]), "index.html");
    assert!(html.contains("5 files: no reader knows this format") && html.contains("1 file: the file is empty"));
    assert!(html.contains("<li>notes/4.txt</li>"));
}

#[test]
fn pages_stay_small() {
    let size = |flights| campaign_site(&campaign_record(flights), &[]).files["index.html"].len();
    assert!(size(200) < 300_000 && size(1000) < 1_200_000, "{} {}", size(200), size(1000));
    let flight = page(&flight_record()).len();
    assert!(flight < 400_000, "{flight}");
}

#[test]
fn curves_of_pure_noise_do_not_bloat_the_page() {
    let mut record = flight_record();
    let replay = record.replay.as_mut().unwrap();
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state) / 1e6
    };
    let zoom = replay.zoom.as_mut().unwrap();
    for axis in replay.axes.iter_mut().chain(&mut zoom.axes) {
        for curve in &mut axis.position_m {
            curve.t_s = (0..50_000).map(|i| f64::from(i) * 0.01).collect();
            curve.y = (0..50_000).map(|_| noise()).collect();
        }
    }
    let size = page(&record).len();
    assert!(size < 1_500_000, "{size}");
}

#[test]
fn vehicle_data_from_the_log_is_shown_only_if_present() {
    let mut record = flight_record();
    assert!(!page(&record).contains("The vehicle, from the log"));
    let delay = flight::ConfiguredDelay {
        parameter: "EKF2_GPS_DELAY".to_owned(),
        value_s: 0.11,
        meaning: "delay of GPS against the IMU".to_owned(),
    };
    let mode = |at_ns, mode: &str| flight::ModeStart { at_ns, clock: flight::Clock::Boot, mode: mode.to_owned() };
    record.log.as_mut().unwrap().about = flight::About {
        system: Some("PX4".to_owned()),
        firmware: Some("1.16.0 <script>release</script>".to_owned()),
        configured_delays: vec![delay],
        parameters: 875,
        modes: vec![mode(5_000_000_000, "Hold"), mode(70_000_000_000, "Mission")],
        texts: vec!["5.000 s INFO: take-off & land".to_owned()],
        ..flight::About::default()
    };
    let page = page(&record);
    for words in
        ["PX4", "1.16.0 &lt;script&gt;", "EKF2_GPS_DELAY", "110", "875", "Mission", "1:05", "take-off &amp; land"]
    {
        assert!(page.contains(words), "{words}");
    }
}

#[test]
fn the_gaps_of_a_channel_come_with_the_longest_gap_and_the_definition() {
    let mut record = flight_record();
    let gaps_of = |record: &FlightRecord| {
        let page = page(record);
        let table = page.split_once("Channels: time stamps").unwrap().1;
        assert!(table.contains("A gap is a step from one timestamp to the next of more than 2.5 median steps."));
        table.split("<td>").nth(1).unwrap().split("</td>").next().unwrap().to_owned()
    };
    assert_eq!(gaps_of(&record), "3; longest 1.25 s at 0:06:40");
    let stamps = record.binding.as_mut().unwrap().channels[0].stamps.as_mut().unwrap();
    (stamps.gap_count, stamps.gaps) = (0, vec![]);
    assert_eq!(gaps_of(&record), "0; longest step 1250 ms");
    // Without a known step, gaps cannot be counted.
    record.binding.as_mut().unwrap().channels[0].stamps.as_mut().unwrap().steps_s = None;
    assert!(gaps_of(&record).contains("—"));
}
