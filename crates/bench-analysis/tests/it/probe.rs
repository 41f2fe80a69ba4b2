use bench_analysis::*;
use simulate::{BenchSettings, simulate_bench};
use std::path::Path;
use signal::*;
#[test]
fn probe() {
    let mut zz = [vec![], vec![]];
    for seed in 20..60 {
        let settings = BenchSettings { seed, ..BenchSettings::default() };
        let simulated = simulate_bench(&settings).unwrap();
        let mut flight = simulated.to_flight().unwrap();
        flight.channels.retain(|n, _| n.starts_with("magn") || n.starts_with("encoder"));
        for k in 0..2 {
            let mut text = simulated.rig_text(&simulate::RigText { model: "simulated".into(), serial: "1".into(), to_be_fitted: false });
            let b = settings.site.field_t.map(|t| t*1e9);
            if k == 1 { text = text.replace("field = \"fit\"", &format!("field = {{ north_nt = {}, east_nt = {}, down_nt = {} }}", b[0], b[1], b[2])); }
            let rig = Rig::parse(&text, Path::new("s.rig.toml")).unwrap();
            let (n, e) = encoder_channel(&flight, &rig).unwrap();
            let raw = Motion::of(EncoderSeries::of(n, e, &rig).unwrap()).unwrap();
            let (around, _) = Surroundings::of(&rig, None, None);
            let al = align(&raw, &flight, &rig, &around);
            let m = raw.oriented(al.sign, al.zero_rad.value);
            let r = References::of(&flight, &m, &rig, &around, &al);
            let c = &r.channels[0];
            let ms: Vec<Measurement> = c.components.iter().filter(|k| k.excited.is_ok()).map(|k| Measurement { t: &c.t_s, y: &k.measured, reference: &k.reference, gain: Gain::Free { sign: Sign::Positive }, drift: false }).collect();
            let f = fit_delay(&ms, &DelaySettings::default()).unwrap();
            zz[k].push(f.delay_s / f.standard_uncertainty_s);
        }
    }
    for z in zz { println!("rms {:.2} {:.1?}", (z.iter().map(|x| x*x).sum::<f64>()/z.len() as f64).sqrt(), z); }
}
