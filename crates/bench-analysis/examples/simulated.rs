//! Measures a simulated bench and prints what was found beside the truth.

#![allow(clippy::print_stdout)]

use bench_analysis::{BenchInput, Rig, bench};
use record::{Finding, Verdict};
use simulate::{BenchSettings, simulate_bench};
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rig_text = simulate::RigText { model: "simulated".into(), serial: "1".into(), to_be_fitted: true };
    for (name, settings) in [("GPS 4 Hz held", BenchSettings::default()), ("INS 100 Hz", BenchSettings::ins())] {
        let simulated = simulate_bench(&settings)?;
        let rig = Rig::parse(&simulated.rig_text(&rig_text), Path::new("simulated.rig.toml"))?;
        let flight = simulated.to_flight()?;
        let begin = Instant::now();
        let found = bench(&BenchInput { encoder: &flight, sensor: &flight, one_log: true }, &rig)?;
        println!("\n{name}: {:.2} s", begin.elapsed().as_secs_f64());
        println!("{:#?}", found.notices);
        let f = &found.findings;
        println!("{:?} {} azimuth {:?} zero {:?} sign {}", f.clocks.statement, f.reference.log10_q, f.reference.azimuth_rad, f.reference.zero_rad, f.reference.sign);
        println!("skew {:?} residual {} counts", f.clocks.skew, f.reference.residual_rms_counts);
        for check in &f.gate.checks {
            println!("  {} {}: {}", if check.passed { "ok " } else { "BAD" }, check.name, check.text);
        }
        for c in &f.channels {
            let delay = c.delay.as_ref().map(|d| format!("{:.3} ± {:.3} ms (crlb {:.3})", d.delay.millis(), 2e3 * d.standard_uncertainty_s, 1e3 * d.crlb_s));
            let mark = if c.verdict == Verdict::NotMeasurable { "!" } else { " " };
            println!("{mark}{:<22} {:?} {} | {}", c.name, c.verdict, delay.unwrap_or_default(), c.reason);
            if let Finding::Found(model) = &c.model {
                println!("      {} sum {:?}", model.text, model.sum_s.value);
            }
            for k in &c.components {
                println!("      {:<12} gain {:?} noise {:?} alone {:?} {}", k.name, k.gain.map(|g| (g.value, g.standard_uncertainty)), k.noise, k.delay_s.map(|d| 1e3 * d.value), k.why_not);
            }
            for i in &c.injections {
                println!("      injected {:.1} ms: error {:.3} ± {:.3} ms", 1e3 * i.injected_s, 1e3 * i.delay_error_s.value, 2e3 * i.delay_error_s.standard_uncertainty.unwrap_or(0.0));
            }
        }
        println!("{:?}", f.flexibility);
    }
    Ok(())
}
