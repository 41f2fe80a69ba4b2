//! Writes the pages of the bench fixture to a folder: `cargo run -p flightlag-report --example bench_page -- DIR`.

#[path = "../tests/it/bench_fixture.rs"]
#[allow(dead_code)]
mod bench_fixture;

use bench_fixture as fixture;
use report::{BenchPage, CardPage, CardRecord, Site, bench_site, card_site};
use std::path::{Path, PathBuf};

fn main() -> std::io::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "reports/bench-fixture".to_owned()));
    let records = [
        ("bench", fixture::bench_record()),
        ("silent", fixture::silent_bench_record()),
        ("failed", fixture::failed_bench_record()),
    ];
    for (name, record) in &records {
        let page = BenchPage { name: "swing-07", record, command: COMMAND, index_href: None };
        write(&folder.join(name), &bench_site(&page))?;
    }
    let (card, records) = fixture::card();
    let names: Vec<String> = (7..).zip(&records).map(|(i, _)| format!("swing-{i:02}")).collect();
    let of = |(name, record)| CardRecord { name, record, href: Some("../bench/index.html") };
    let records: Vec<CardRecord> = names.iter().map(String::as_str).zip(&records).map(of).collect();
    write(
        &folder.join("card"),
        &card_site(&CardPage {
            card: &card,
            card_file: Some("mti-g.card.toml"),
            records: &records,
            without_mean: &[],
            remarks: &[],
            command: COMMAND,
        }),
    )
}

const COMMAND: &str = "flightlag bench swing-07-encoder.csv swing-07-mtig.csv --rig pipelines/bench.rig.toml";

fn write(folder: &Path, site: &Site) -> std::io::Result<()> {
    for (path, bytes) in site.to_write() {
        let path = folder.join(path);
        std::fs::create_dir_all(path.parent().unwrap_or(folder))?;
        std::fs::write(path, bytes)?;
    }
    Ok(())
}
