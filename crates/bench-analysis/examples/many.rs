//! Measures many simulated benches: error over standard uncertainty by channel.
#![allow(clippy::print_stdout)]
use bench_analysis::{BenchInput, Rig, bench};
use simulate::{BenchChannel, BenchSettings, simulate_bench};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let rig_text = simulate::RigText { model: "simulated".into(), serial: "1".into(), to_be_fitted: true };
    let n: u64 = std::env::args().nth(1).map_or(12, |a| a.parse().unwrap_or(12));
    let mut table: std::collections::BTreeMap<String, Vec<f64>> = Default::default();
    for seed in 1..=n {
        let base = if seed % 2 == 0 { BenchSettings::default() } else { BenchSettings::ins() };
        let settings = BenchSettings { seed, ..base };
        let truth = |name: &str| {
            let c = BenchChannel::ALL.into_iter().find(|c| c.name() == name).unwrap();
            settings.sensor[&c].sampling.delay_s
        };
        let simulated = simulate_bench(&settings)?;
        let rig = Rig::parse(&simulated.rig_text(&rig_text), Path::new("simulated.rig.toml"))?;
        let flight = simulated.to_flight()?;
        let found = bench(&BenchInput { encoder: &flight, sensor: &flight, one_log: true }, &rig)?;
        for c in &found.findings.channels {
            let d = c.delay.as_ref().unwrap();
            table.entry(c.name.clone()).or_default().push((d.delay.seconds() - truth(&c.name)) / d.standard_uncertainty_s);
            for i in &c.injections {
                table.entry(format!("{} injected", c.name)).or_default().push(i.delay_error_s.value / i.delay_error_s.standard_uncertainty.unwrap());
            }
            for k in &c.components {
                if let Some(g) = k.gain {
                    table.entry(format!("{} gain {}", c.name, k.name)).or_default().push((g.value - 1.0) / g.standard_uncertainty.unwrap());
                }
            }
        }
    }
    for (name, z) in table {
        let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        println!("{name:<40} mean {:+.2} rms {rms:.2}   {:?}", z.iter().sum::<f64>() / z.len() as f64, z.iter().map(|z| (z * 10.0).round() / 10.0).collect::<Vec<_>>());
    }
    Ok(())
}
