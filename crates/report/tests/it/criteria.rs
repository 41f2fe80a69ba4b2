//! What pages say about criteria: numbers and verdicts, all from the record.

use crate::fixture::{campaign_record, failed_record, flight_record};
use crate::html::read;
use crate::page_text::{page, words};
use record::{
    CampaignCriteria, CriteriaUse, CriterionFinding, CriterionSummary, CriterionUnit, CriterionVerdict, DecisionRule,
    Estimate, FlightCriteria, FlightRecord, Limit, PassRate, RowVerdict, RowVerdicts, VerdictTally,
};
use report::campaign_site;

fn used() -> CriteriaUse {
    CriteriaUse {
        title: "Autumn".into(),
        file: "autumn.toml".into(),
        blake3: "ab".repeat(32),
        toml: "schema = 1\n".into(),
    }
}

fn finding(id: &str, verdict: CriterionVerdict, value: Option<(f64, f64)>, reason: &str) -> CriterionFinding {
    CriterionFinding {
        id: id.into(),
        title: format!("asked in {id}"),
        rationale: format!("because of {id} & <b>"),
        metric: "delay".into(),
        quantity: "Td(position)".into(),
        limit: Limit::AtMost(0.15),
        unit: CriterionUnit { name: "ms".into(), si: 1e-3 },
        rule: DecisionRule::Interval,
        value: value.map(|(value, u)| Estimate { value, standard_uncertainty: Some(u) }),
        interval_95: value.map(|(value, u)| [value - 2.0 * u, value + 2.0 * u]),
        margin: value.map(|(value, _)| 0.15 - value),
        verdict,
        reason: reason.into(),
    }
}

pub fn criteria() -> FlightCriteria {
    use CriterionVerdict::{Fail, Inconclusive, NotApplicable, NotEvaluated, Pass};
    let findings = vec![
        finding("one", Pass, Some((0.118_43, 0.001_55)), ""),
        finding("two", NotApplicable, None, "applies to flights called *.bag"),
        finding("three", Fail, Some((0.209, 0.002)), ""),
        finding("four", Inconclusive, Some((0.148, 0.003)), ""),
        finding("five", NotEvaluated, None, "straight flight"),
    ];
    FlightCriteria { criteria: used(), findings }
}

#[test]
fn verdicts_are_at_the_top_of_the_flight_page_worst_first_in_words() {
    let html = page(&FlightRecord { criteria: Some(criteria()), ..flight_record() });
    read(&html);
    let top = words(html.split(">Evidence</h2>").next().unwrap().split("<main").nth(1).unwrap());
    let places = [
        "✗ 1 FAIL",
        "Criteria that are not met",
        "209.0 ms± 4.0 ms",
        "148.0 ms± 6.0 ms",
        "1 NOT EVALUATED asked in five: straight flight.",
        "✓ 1 PASS asked in one.",
        "1 NOT APPLICABLE asked in two.",
        "118.4 ms± 3.1 ms",
        "applies to flights called *.bag",
    ]
    .map(|text| top.find(text).unwrap_or_else(|| panic!("{text} is not in:\n{top}")));
    assert!(places.is_sorted(), "{places:?}");
    assert!(html.contains(r#"<data value="0.209">"#), "the page has the number at full precision");
    assert!(top.contains("would PASS with an interval of less than ± 2.0 ms"), "{top}");
    assert!(top.contains("Limit: because of four &amp; &lt;b&gt;"), "{top}");
    assert!(top.contains("Decision rule. PASS: the whole 95 % interval") && top.contains("autumn.toml"), "{top}");
}

#[test]
fn a_page_without_criteria_does_not_mention_them() {
    assert!(!page(&flight_record()).contains("riteria"));
    let campaign = campaign_site(&campaign_record(5), &[]).files["index.html"].clone();
    let campaign = String::from_utf8(campaign).unwrap();
    assert!(!campaign.split("<script>").next().unwrap().contains("riteria"));
}

#[test]
fn an_unreadable_flight_still_shows_its_verdicts() {
    let html = page(&FlightRecord { criteria: Some(criteria()), ..failed_record() });
    read(&html);
    assert!(words(&html).contains("1 NOT EVALUATED"));
}

#[test]
fn a_campaign_shows_pass_rates_with_intervals_and_flight_verdicts() {
    let mut record = campaign_record(4);
    let verdicts = [CriterionVerdict::Fail, CriterionVerdict::Pass, CriterionVerdict::Pass, CriterionVerdict::Pass];
    for (row, verdict) in record.flights.iter_mut().zip(verdicts) {
        let one = |id: &str, verdict| RowVerdict { id: id.into(), verdict, words: String::new() };
        let each = vec![one("a", verdict), one("b", CriterionVerdict::Pass)];
        row.criteria = Some(RowVerdicts { overall: verdict, each });
    }
    let tally = VerdictTally { fail: 1, pass: 3, ..VerdictTally::default() };
    let pass_rate = Some(PassRate { passed: 3, judged: 4, interval_95: [0.301, 0.954] });
    let failed = vec![record.flights[0].flight.clone()];
    let summary = |id: &str| CriterionSummary {
        id: id.into(),
        title: format!("asked in {id}"),
        metric: "delay".into(),
        limit: "≤ 150 ms".into(),
        tally,
        pass_rate,
        never_evaluated: None,
        failed: failed.clone(),
    };
    let reason = "this flight has no channel position.gsp".to_owned();
    let each = vec![summary("a"), CriterionSummary { never_evaluated: Some(reason), ..summary("b") }];
    record.criteria = Some(CampaignCriteria { criteria: used(), flights: tally, pass_rate, each });
    let html = String::from_utf8(campaign_site(&record, &[]).files["index.html"].clone()).unwrap();
    read(&html);
    let text = words(&html);
    assert!(text.contains("3 of 4 judged flights meet every criterion that applies: 75 % (30 to 95 %)."), "{text}");
    let never = "NOT EVALUATED No flight has the number of asked in b: this flight has no channel position.gsp.";
    assert!(text.contains(never) && !text.contains("the number of asked in a"), "{text}");
    assert!(text.contains("✗ FAIL 1/2") && text.contains("✓ PASS 2/2"), "{text}");
    assert!(text.contains(&format!("75 % (30 to 95 %){}", failed[0])), "{text}");
}
