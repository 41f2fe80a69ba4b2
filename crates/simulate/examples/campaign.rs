//! Writes many small flights for benchmarks: `campaign DIR [FLIGHTS] [SECONDS]`; the default is 200 of one minute.

use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("usage: campaign DIR [FLIGHTS] [SECONDS]")?);
    let flights = arguments.next().map_or(Ok(200), |n| n.parse())?;
    let seconds = arguments.next().map_or(Ok(60.0), |s| s.parse())?;
    simulate::write_campaign(&folder, flights, seconds, 1)?;
    Ok(())
}
