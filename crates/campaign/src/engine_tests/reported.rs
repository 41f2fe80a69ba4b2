//! Events during a campaign and at its end.

use super::*;

#[test]
fn the_last_events_give_the_outcome_of_each_flight_and_the_report() {
    let bench = Bench::new(&[("a.csv", "late 0.2"), ("b.csv", "bad")]);
    for nothing_changed in [false, true] {
        let events = bench.run().events;
        let json: Vec<serde_json::Value> = events.iter().map(|e| serde_json::to_value(e).unwrap()).collect();
        let flights: Vec<_> = json.iter().filter(|e| e["event"] == "flight").collect();
        assert_eq!(flights.len(), 2);
        assert_eq!(
            (flights[0]["flight"].as_str(), flights[0]["outcome"].as_str()),
            (Some("a.csv"), Some("compensated"))
        );
        assert_eq!(flights[0]["lateness_s"], 0.2);
        assert!(flights[0]["effect"].is_string() && flights[0]["words"].is_string(), "{}", flights[0]);
        for flight in &flights {
            assert!(Path::new(flight["page"].as_str().unwrap()).is_file(), "{flight}");
        }
        assert_eq!(flights[1]["reason"], "cut before the first message");
        let last = json.last().unwrap();
        assert_eq!((&last["event"], &last["flights"], &last["failed"]), (&"done".into(), &2.into(), &1.into()));
        assert_eq!(last["report"], bench.out().canonicalize().unwrap().join("index.html").to_str().unwrap());
        assert_eq!(last["nothing_changed"], nothing_changed);
    }
}

#[test]
fn unstarted_flights_are_pending_and_a_task_reports_its_number_of_flights() {
    let bench = Bench::five();
    let events = Mutex::new(vec![]);
    let sink = |event: &Event| events.lock().unwrap().push(event.clone());
    let cancel = AtomicBool::new(false);
    let context = RunContext { threads: 2, cancel: &cancel, events: &sink };
    let manifest = plan_shards(&bench.order(&bench.out(), false), &context, 1).unwrap();
    let verdict = crate::reduce::reduce(&manifest, &context).unwrap();
    assert_eq!((verdict.totals.pending, verdict.totals.failed, verdict.exit()), (5, 0, Exit::Incomplete));
    assert!(verdict.lines.iter().all(|line| line.data == "pending"), "{:?}", verdict.lines);
    events.lock().unwrap().clear();
    crate::task(&manifest, 0, &context).unwrap();
    let planned = |e: &Event| if let Event::Planned { to_run, .. } = e { Some(*to_run) } else { None };
    assert_eq!(events.lock().unwrap().iter().find_map(planned), Some(5));
    events.lock().unwrap().clear();
    crate::task(&manifest, 0, &context).unwrap();
    assert_eq!(events.lock().unwrap().iter().find_map(planned), Some(0), "all of its results are there");
}
