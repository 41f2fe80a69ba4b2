use crate::lab::*;
use crate::verdict::*;
#[test]
#[ignore]
fn scratch() {
    let name = std::env::var("SEED").unwrap();
    for byte in std::env::var("BYTES").unwrap().split(',') {
        let seed = &seeds(&name)[0];
        let mut lab = Lab::new();
        let subject = lab.seed(seed, 0);
        let mut bytes = seed.files[0].bytes.clone();
        let intact = lab.read(&subject, &bytes, "").unwrap();
        for bit in 0..8 {
            let at: usize = byte.parse().unwrap();
            bytes[at] ^= 1 << bit;
            let read = lab.read(&subject, &bytes, "x");
            let verdict = Verdict::of(&read, &intact);
            println!("== byte {at} bit {bit}: {verdict:?} {:?}", String::from_utf8_lossy(&bytes[at.saturating_sub(20)..(at + 10).min(bytes.len())]));
            if let Ok(log) = read { if !matches!(verdict, Verdict::Same|Verdict::OneRow) {
                println!("{:?}", intact.tables.iter().map(|t| (&t.topic.name, t.rows)).collect::<Vec<_>>());
                println!("{:?}", log.tables.iter().map(|t| (&t.topic.name, t.rows)).collect::<Vec<_>>());
                for n in log.notices.iter() { println!("   {n:?}"); }
                println!("   undecodable {} {:?}", log.health.undecodable, log.health.topics.iter().map(|t| (&t.name, t.messages, t.decoded, &t.reason)).collect::<Vec<_>>());
            }}
            bytes[at] ^= 1 << bit;
        }
    }
}
