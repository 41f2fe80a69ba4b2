//! The page of a campaign with few flights and with many.

use crate::campaign_fixture::{REMOVED_S, row, varied};
use crate::fixture;
use crate::html::{points, read};
use crate::page_text::{text, words_outside_figures};
use record::{CampaignRecord, CriterionVerdict, EffectVerdict, Estimate, GroupLateness, GroupPart, OtherReceiver};
use report::{Site, TrackExcerpt, campaign_site, excerpt_flights};

pub fn site(record: &CampaignRecord) -> Site {
    let zoom = fixture::replay().zoom.unwrap();
    let of = |row: &record::FlightRow| TrackExcerpt { flight: row.flight.clone(), zoom: zoom.clone() };
    let excerpts: Vec<TrackExcerpt> = excerpt_flights(record).into_iter().map(of).collect();
    campaign_site(record, &excerpts)
}

/// Names shown on hover in a figure.
fn pointed_at(site: &Site, figure: &str) -> Vec<String> {
    let tags = read(&text(site, figure));
    let titles = tags.windows(2).filter(|w| w[0].name == "circle" && w[1].name == "title");
    titles.map(|w| w[1].text.clone()).collect()
}

#[test]
fn the_newest_flights_and_all_outliers_are_drawn_by_name() {
    let record = varied(400);
    let site = site(&record);
    let names = pointed_at(&site, "figures/lateness.svg");
    let is_drawn = |flight: &str| names.iter().any(|name| name.contains(flight));
    let mut dated: Vec<_> = record.flights.iter().filter(|r| r.delay_s.is_some()).collect();
    dated.sort_by(|a, b| b.flown_at.cmp(&a.flown_at));
    for row in &dated[..60] {
        assert!(is_drawn(&row.flight), "{}", row.flight);
    }
    let outliers: Vec<&String> = record.groups.iter().flat_map(|g| &g.outliers).collect();
    assert!(outliers.len() > 8 && outliers.iter().all(|flight| is_drawn(flight)), "{outliers:?}");
    assert!(!is_drawn(&dated[dated.len() - 1].flight));
    let left_out = dated.len() - names.iter().filter(|n| n.contains("flight-")).count();
    assert!(
        words_outside_figures(&text(&site, "index.html"))
            .contains(&format!("Not drawn, but in the table: {left_out} flights"))
    );
}

#[test]
fn the_trend_shows_every_flight_and_the_limits_of_its_group() {
    let record = varied(1000);
    let site = site(&record);
    let svg = text(&site, "figures/trend.svg");
    let drawn = svg.lines().filter(|l| l.contains("<title>flight, ±") || l.contains("<title>outside its limits"));
    let dots: usize =
        drawn.map(|l| points(l.split(" d=\"").nth(1).unwrap().split('"').next().unwrap()).len() / 2).sum();
    let timed = record.groups.iter().map(|g| g.consistency.as_ref().unwrap().control.len()).sum::<usize>();
    // Dots that a screen cannot distinguish are merged; a hollow dot is drawn twice.
    assert!(dots > timed / 2 && timed > 900, "{dots} of {timed}");
    assert_eq!(svg.matches("VN-200").count(), 1, "one panel for each group: {svg:.0}");
    let newest = record.flights.iter().rev().find(|r| r.delay_s.is_some()).unwrap();
    assert!(pointed_at(&site, "figures/trend.svg").iter().any(|name| name.contains(&newest.flight)));
}

#[test]
fn the_index_of_many_flights_stays_small_and_says_which_are_not_drawn() {
    let size = |flights| {
        let site = site(&varied(flights));
        (text(&site, "index.html").len(), words_outside_figures(&text(&site, "index.html")))
    };
    let ((some, _), (many, said)) = (size(6_000), size(12_000));
    assert!(many < some + some / 20, "{some} bytes, then {many}");
    assert!(said.contains("older flights are not drawn; those outside their limits are drawn first"), "{said:.3000}");
}

#[test]
fn no_mean_is_taken_over_different_receivers() {
    let record = varied(200);
    let text = words_outside_figures(&text(&site(&record), "index.html"));
    for group in &record.groups {
        let mean = 1e3 * group.lateness_s.unwrap().value;
        assert!(text.contains(&format!("{mean:.1} ± 1.0 ms late, against the IMU")), "{mean}");
    }
    // A mean over all flights would lie between the means of the groups.
    let all: Vec<f64> = record.flights.iter().filter_map(|r| Some(r.lateness.as_ref()?.lateness_s()?.value)).collect();
    let mean = 1e3 * all.iter().sum::<f64>() / all.len() as f64;
    assert!(!text.contains(&format!("{mean:.1} ±")), "{mean}");
}

#[test]
fn flights_that_do_not_form_one_group_have_a_range_and_no_mean() {
    let mut record = varied(40);
    let group: &mut GroupLateness = &mut record.groups[0];
    group.split = Some("two clusters, 45 ms apart".into());
    group.advice.set.clear();
    let mean = group.lateness_s.unwrap().value;
    let html = text(&site(&record), "index.html");
    let card = words_outside_figures(html.split("<ul class=\"cards\">").nth(1).unwrap().split("</li>").next().unwrap());
    assert!(card.contains("No common delay: ") && card.contains("Do not use one delay."), "{card}");
    assert!(card.contains("two clusters, 45 ms apart") && !card.contains(&format!("{:.1} ±", 1e3 * mean)), "{card}");
}

/// The delay of a group is wrong for a second receiver on board. If no delay was removed, no error after it is shown.
#[test]
fn another_receiver_is_named_on_the_card_of_the_group() {
    let mut record = varied(8);
    let (with, name) = (&record.groups[0].members[0].clone(), "position.gps-2");
    let row = record.flights.iter_mut().find(|row| row.flight == *with).unwrap();
    let lateness_s = Estimate { value: 0.45, standard_uncertainty: Some(0.005) };
    let other = OtherReceiver { channel: name.to_owned(), lateness_s };
    row.lateness.as_mut().unwrap().other_receivers = vec![other];
    let html = words_outside_figures(&text(&site(&record), "index.html")).replace('\u{a0}', " ");
    let said = format!("! Another receiver {name} is 450 ± 10 ms late in {with}.");
    assert_eq!(html.matches(&said).count(), 1, "{html}");
}

#[test]
fn a_group_that_differs_only_in_the_log_says_so() {
    let mut record = varied(40);
    let part = |what: &str, value: &str| GroupPart { what: what.into(), value: value.into(), from: "test".into() };
    let of = [("MCAP", "5 Hz"), ("CSV", "5 Hz"), ("CSV", "10 Hz")];
    for (group, (log, rate)) in record.groups.iter_mut().zip(of) {
        group.group.parts = vec![part("log", log), part("rate", rate), part("channel map", "mavros")];
    }
    let html = text(&site(&record), "index.html");
    let cards: Vec<String> =
        html.split("<ul class=\"cards\">").nth(1).unwrap().split("</li>").map(words_outside_figures).collect();
    assert!(cards[0].contains("Everything except the log is as in the group of CSV."), "{}", cards[0]);
    assert!(cards[1].contains("Everything except the log is as in the group of MCAP."), "{}", cards[1]);
    assert!(cards[2..].iter().all(|card| !card.contains("Everything except the log")), "{cards:?}");
}

#[test]
fn flights_with_only_a_known_difference_get_advice_on_logging() {
    let mut record = varied(40);
    for group in &mut record.groups {
        group.against = "relative to velocity.ekf".into();
        group.advice.set.clear();
    }
    assert!(
        !words_outside_figures(&text(&site(&record), "index.html")).contains("Log the IMU"),
        "something was removed"
    );
    let members = record.groups[0].members.clone();
    let mut measured = 0;
    for row in record.flights.iter_mut().filter(|row| members.contains(&row.flight)) {
        row.delay_s = None;
        measured += usize::from(row.lateness.as_ref().is_some_and(|l| l.lateness.is_some()));
    }
    assert!(measured > 1);
    let text = words_outside_figures(&text(&site(&record), "index.html"));
    assert!(
        text.contains("Log the IMU")
            && text.contains(&format!("{measured} flights show how far position and velocity are apart")),
        "{text}"
    );
}

#[test]
fn the_first_todo_is_the_setting_that_saves_the_most_metres() {
    let record = varied(200);
    let html = text(&site(&record), "index.html");
    let todo: Vec<String> = html
        .split("<ol class=\"todo\">")
        .nth(1)
        .unwrap()
        .split("</ol>")
        .next()
        .unwrap()
        .split("<li>")
        .skip(1)
        .map(words_outside_figures)
        .collect();
    assert!((2..=5).contains(&todo.len()), "{todo:?}");
    // M8: 118 ms late, but 200 ms were removed, from 30 % of the flights. VN-200: 154 ms too much, from 15 %.
    let place = |words: &str| todo.iter().position(|line| line.contains(words)).unwrap();
    assert!(todo[0].contains("instead of what was removed"), "{todo:?}");
    assert!(place("M8") < place("F9P"), "{todo:?}");
}

#[test]
fn effects_are_sorted_by_harm_and_every_harmed_flight_is_drawn() {
    let record = varied(400);
    let site = site(&record);
    let svg = text(&site, "figures/effect.svg");
    // Labels run from bottom to top.
    let drawn: Vec<usize> = svg.split("flight-").skip(1).filter_map(|part| part.get(..4)?.parse().ok()).collect();
    let worse = |i: &usize| {
        let effect = row(*i).effect.unwrap();
        effect.error_compensated_m.unwrap().value / effect.error_raw_m.unwrap().value
    };
    let order: Vec<f64> = drawn.iter().map(worse).collect();
    assert!(order.is_sorted() || order.iter().rev().is_sorted(), "{order:?}");
    let harmed: Vec<usize> =
        (0..400).filter(|i| row(*i).effect.is_some_and(|e| e.verdict == EffectVerdict::Harmed)).collect();
    assert!(harmed.len() > 20 && harmed.iter().all(|i| drawn.contains(i)), "{harmed:?} {drawn:?}");
}

#[test]
fn criteria_form_a_matrix_of_flights_or_a_table_of_groups_if_many() {
    let record = varied(40);
    let html = text(&site(&record), "index.html");
    let tags = read(&html);
    let cells: Vec<&str> =
        tags.iter().filter(|t| t.name == "td").filter_map(|t| t.get("title")).filter(|t| t.contains(": ")).collect();
    let failed = record.flights.iter().flat_map(|r| &r.criteria.as_ref().unwrap().each);
    let failed = failed.filter(|v| v.verdict == CriterionVerdict::Fail).count();
    assert_eq!(cells.len(), 40 * 6);
    assert_eq!(cells.iter().filter(|t| t.ends_with(": FAIL")).count(), failed);
    let record = varied(200);
    let html = text(&site(&record), "index.html");
    assert!(!html.contains("class=\"matrix\""));
    let members = &record.groups[2].members;
    let of_group = record.flights.iter().filter(|r| members.contains(&r.flight));
    let verdicts: Vec<_> = of_group.map(|r| r.criteria.as_ref().unwrap().each[3].verdict).collect();
    let count = |wanted: &[CriterionVerdict]| verdicts.iter().filter(|v| wanted.contains(v)).count();
    let judged = count(&[CriterionVerdict::Pass, CriterionVerdict::Fail, CriterionVerdict::Inconclusive]);
    let said = format!("{} of {judged}", count(&[CriterionVerdict::Pass]));
    assert!(words_outside_figures(&html).contains(&said), "{said}");
}

#[test]
fn each_reason_is_one_line_that_links_to_its_flights() {
    let record = varied(200);
    let html = text(&site(&record), "index.html");
    let tags = read(&html);
    let lines: Vec<(&str, &str)> = tags
        .iter()
        .filter(|t| t.name == "a" && t.get("class") == Some("show"))
        .map(|t| (t.get("data-q").unwrap(), t.text.as_str()))
        .collect();
    assert!((4..=8).contains(&lines.len()), "{lines:?}");
    for (query, said) in lines {
        let slug = query.strip_prefix("reason:").unwrap();
        let rows = tags
            .iter()
            .filter(|t| t.name == "tr" && t.get("data-reason").is_some_and(|r| r.split(' ').any(|r| r == slug)));
        assert_eq!(said, format!("Show these {} in the table", rows.count()), "{query}");
    }
}

#[test]
fn a_very_large_campaign_is_split_into_pages_of_a_thousand_flights() {
    let record = varied(2500);
    let site = site(&record);
    let index = text(&site, "index.html");
    assert!(
        words_outside_figures(&index).contains("2 500 flights are too many for one page"),
        "{}",
        words_outside_figures(&index)
    );
    assert!(!index.contains("class=\"sortable\""));
    let mut names = vec![];
    for (page, flights) in [(1, 1000), (2, 1000), (3, 500)] {
        let html = text(&site, &format!("table/{page}.html"));
        assert!(index.contains(&format!("href=\"table/{page}.html\"")));
        let effects = index.split(&format!("table/{page}.html\">")).nth(1).and_then(|rest| rest.split("</li>").next());
        let effects = effects.unwrap().split(": ").nth(1).unwrap().split(", ");
        let counted: usize = effects.map(|part| part.split(' ').next().unwrap().parse::<usize>().unwrap()).sum();
        assert_eq!(counted, flights, "the results of page {page}");
        let links: Vec<String> =
            read(&html).iter().filter(|t| t.name == "a").filter_map(|t| t.get("href").map(str::to_owned)).collect();
        let of_flights: Vec<String> = links.into_iter().filter(|href| href.starts_with("../flights/")).collect();
        assert_eq!(of_flights.len(), flights);
        names.extend(of_flights);
    }
    names.sort();
    names.dedup();
    assert_eq!(names.len(), 2500);
    assert!(!site.files.contains_key("table/4.html"));
    assert!(campaign_site(&varied(2000), &[]).files.keys().all(|path| !path.starts_with("table/")));
}

#[test]
fn a_full_page_stays_within_its_size_limit() {
    for (flights, most) in [(12, 300_000), (200, 500_000), (1000, 1_500_000)] {
        let record = varied(flights);
        let page = text(&site(&record), "index.html");
        assert!(page.len() < most, "{flights} flights: {} bytes", page.len());
        // Including the track of every flight that has one.
        let drawn = record.flights.iter().filter(|row| row.track_sketch_m.is_some()).count();
        assert_eq!(page.matches(" data-track=").count(), drawn);
    }
}

#[test]
fn the_tracks_of_the_newest_flights_are_available_on_demand() {
    let record = varied(100);
    let html = text(&site(&record), "index.html");
    let section = html.split("id=\"excerpts\"").nth(1).unwrap().split("<h2").next().unwrap();
    assert!(section.contains("<details>") && section.matches("<svg").count() == 12);
    let newest = record.flights.iter().rev().find(|r| r.delay_s.is_some()).unwrap();
    assert!(
        section.contains(&format!("<bdi>{}</bdi>", newest.flight))
            || section.replace("<wbr>", "").contains(&newest.flight)
    );
    assert!(
        words_outside_figures(section).contains("Raw and compensated where the aircraft turned hardest, 12 flights")
    );
    assert!(!text(&campaign_site(&record, &[]), "index.html").contains("id=\"excerpts\""));
}

#[test]
fn the_removed_delay_is_stated_for_each_group() {
    let text = words_outside_figures(&text(&site(&varied(200)), "index.html"));
    assert_eq!(text.matches(&format!("Removed: {:.1} ms (stated in the pipeline)", 1e3 * REMOVED_S)).count(), 4);
}
