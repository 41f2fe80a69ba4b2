//! Every delay of every log below a folder, one line per pair:
//! `cargo run --release -p flightlag-compensation-replay --example measure_logs -- FOLDER [part of a name]`
#![allow(clippy::print_stdout, reason = "an example's output is its print")]

use compensation_replay::{FlightDelaySettings, measure_delays};
use ingest::{Limits, MapLibrary, ReadContext, discover, load};
use record::{Finding, PairDelay};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: measure_logs FOLDER [part of a name]")?);
    let part = arguments.next().unwrap_or_default();
    let library = MapLibrary::shipped()?;
    let settings = FlightDelaySettings::default();
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| {} };
    for unit in discover(&folder, &library)?.units.iter().filter(|u| u.id.contains(&part)) {
        let loaded = match load(unit, &library, None, &context) {
            Ok(loaded) => loaded,
            Err(error) => {
                println!("{}: {error}", unit.id);
                continue;
            }
        };
        let start = Instant::now();
        let (delays, notices) = measure_delays(&loaded.flight, &settings);
        if delays.pairs.is_empty() {
            continue;
        }
        println!("{} ({:.2} s)", unit.id, start.elapsed().as_secs_f64());
        delays.pairs.iter().for_each(print_pair);
        for notice in notices.iter() {
            println!("    notice {}: {}", notice.code, notice.text);
        }
    }
    Ok(())
}

fn print_pair(pair: &PairDelay) {
    let name = format!("{} | {}", pair.first, pair.second);
    match &pair.delay {
        Finding::Found(d) => {
            let half = 0.5e3 * (d.interval_95_s[1] - d.interval_95_s[0]);
            let offer = pair.excitation.as_ref();
            println!(
                "  {name}: {:.1} ± {half:.1} ms (curvature {:.1}, sandwich {:.1}, bound {:.1}); moving {:.2}, left over {:.2}, \
                 {} samples, {} pieces, held back {:.3}; change from {:.1} ms on",
                1e3 * d.delay_s.value,
                1e3 * d.hessian_s,
                1e3 * d.hac_s,
                1e3 * d.crlb_s,
                offer.map_or(0.0, |o| o.moving_share),
                offer.and_then(|o| o.unexplained_share).unwrap_or(0.0),
                d.samples,
                d.pieces.len(),
                d.downweighted_share,
                1e3 * d.smallest_detectable_s
            );
            if let Some(h) = &d.homogeneity {
                println!(
                    "    {} windows, p = {:.2e}{}",
                    d.over_time.len(),
                    h.p,
                    d.alarm.as_ref().map_or(String::new(), |a| format!(": {a}"))
                );
            }
            for i in &d.injections {
                let [a, b] = i.interval_95_s.map(|x| 1e3 * x);
                println!(
                    "    injected {:.0} ms: error {:.1} ({a:.1} to {b:.1}) ms",
                    1e3 * i.injected_s,
                    1e3 * i.error_s.value
                );
            }
            for s in &d.splits {
                let groups: Vec<String> = s
                    .groups
                    .iter()
                    .map(|g| {
                        let u = 1.96e3 * g.delay_s.standard_uncertainty.unwrap_or(0.0);
                        format!("{:.1} to {:.1}: {:.1} ± {u:.1} ms", g.range[0], g.range[1], 1e3 * g.delay_s.value)
                    })
                    .collect();
                println!("    by {}: {} (p = {:.2e})", s.by, groups.join("; "), s.p.unwrap_or(1.0));
            }
            d.alarms.iter().for_each(|a| println!("    alarm: {a}"));
            if let Some(rival) = d.rival_s {
                println!("    almost as good: {:.1} ms", 1e3 * rival);
            }
        }
        Finding::CannotTell(reason) => println!("  {name}: not measurable: {reason}"),
    }
}
