//! Writes specimen pages to a folder, to look at: `cargo run -p flightlag-report --example specimen DIR`.

#[path = "../tests/it/campaign_fixture.rs"]
mod campaign_fixture;
#[path = "../tests/it/fixture.rs"]
mod fixture;

use report::{FlightPage, Site, TrackExcerpt, campaign_site, flight_site};
use std::path::Path;

fn write(folder: &Path, site: &Site) -> std::io::Result<()> {
    for (path, bytes) in site.to_write() {
        let file = folder.join(path);
        if let Some(parent) = file.parent() {
            std::fs::create_dir_all(parent)?;
        }
        std::fs::write(file, bytes)?;
    }
    Ok(())
}

fn main() -> std::io::Result<()> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "specimen".into());
    let folder = Path::new(&folder);
    write(folder, &campaign_site(&fixture::campaign_record(40), &[]))?;
    for flights in [12, 200, 1000, 2000, 2500] {
        let record = campaign_fixture::varied(flights);
        let zoom = fixture::replay().zoom;
        let excerpt = |row: &record::FlightRow| Some(TrackExcerpt { flight: row.flight.clone(), zoom: zoom.clone()? });
        let excerpts: Vec<TrackExcerpt> = report::excerpt_flights(&record).into_iter().filter_map(excerpt).collect();
        write(&folder.join(format!("campaign-{flights}")), &campaign_site(&record, &excerpts))?;
    }
    let records = [
        ("good", fixture::flight_record()),
        ("failed", fixture::failed_record()),
        ("parked", fixture::parked_record()),
    ];
    for (name, record) in &records {
        let page = FlightPage {
            name: "2026-11-08/flight-0007.mcap",
            record,
            explorer: None,
            has_details: false,
            neighbours: [None; 2],
            track_href: None,
            index_href: "../../index.html",
            command: "flightlag campaign flights --pipeline pipelines/replay.toml --out reports/goheung",
        };
        write(&folder.join("flights").join(name), &flight_site(&page))?;
    }
    Ok(())
}
