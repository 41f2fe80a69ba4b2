fn main() {
    let path = std::path::PathBuf::from(std::env::args().nth(1).unwrap());
    let kind = match std::env::args().nth(2).unwrap().as_str() { "nmea" => ingest::LogKind::Nmea, "ubx" => ingest::LogKind::Ubx, _ => ingest::LogKind::Tlog };
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let context = ingest::ReadContext { limits: ingest::Limits::default(), cancel: &cancel, on_bytes: &|_| () };
    let want = |_: &ingest::TopicInfo| ingest::Selection::All;
    let begin = std::time::Instant::now();
    let log = ingest::open(&ingest::FlightUnit { id: "x".into(), files: vec![path], kind }).read(&want, &context).unwrap();
    eprintln!("{:?} {:?}", begin.elapsed(), log.health.bytes);
    for n in log.notices.iter().take(20) { eprintln!("{n:?}"); }
    eprintln!("{:?}", log.health.about);
    for t in &log.health.topics { println!("#{} {}", t.name, t.messages); }
    for t in &log.tables {
        for row in 0..t.rows {
            print!("{}", t.topic.name);
            if let Some(l) = &t.logged_ns { print!(" logged={}", l[row]); }
            for c in &t.columns {
                match (c.integer(row), c.number(row), c.text(row)) { (Some(i), ..) => print!(" {}={i}", c.path), (_, Some(x), _) => print!(" {}={x:?}", c.path), (_, _, Some(t)) => print!(" {}={t:?}", c.path), _ => {} }
            }
            println!();
        }
    }
}
