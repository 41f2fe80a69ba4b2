//! Bytes per second from a log to a flight, for each container: two minutes with a position at 100 Hz and a velocity at
//! 200 Hz.

use divan::Bencher;
use divan::counter::BytesCount;
use ingest::{Limits, MapLibrary, ReadContext, discover, load};
use simulate::{BagCompression, BagSettings, Container, McapCompression, McapSettings};
use std::fs;
use std::sync::atomic::AtomicBool;

fn main() {
    divan::main();
}

fn mcap(compression: McapCompression) -> Container {
    Container::Mcap(McapSettings { compression, ..McapSettings::default() })
}

fn bag(compression: BagCompression) -> Container {
    Container::Bag(BagSettings { compression, ..BagSettings::default() })
}

fn container(name: &str) -> Container {
    match name {
        "mcap-zstd" => mcap(McapCompression::Zstd),
        "mcap-none" => mcap(McapCompression::None),
        "bag-lz4" => bag(BagCompression::Lz4Linked),
        "bag-none" => bag(BagCompression::None),
        "ulog" => Container::Ulog,
        "dataflash" => Container::DataFlash,
        _ => Container::CsvWide,
    }
}

#[divan::bench(args = ["mcap-zstd", "mcap-none", "bag-lz4", "bag-none", "ulog", "dataflash", "csv"])]
fn read(bencher: Bencher, name: &str) {
    let folder = tempfile::tempdir().unwrap();
    let flight = benches::circuit(120.0, 100.0, 200.0);
    let mut bytes = 0_usize;
    for file in container(name).files(&flight, name).unwrap() {
        bytes += file.bytes.len();
        let path = folder.path().join(&file.path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, &file.bytes).unwrap();
    }
    let library = MapLibrary::shipped().unwrap();
    let unit = discover(folder.path(), &library).unwrap().units.remove(0);
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| {} };
    bencher.counter(BytesCount::new(bytes)).bench_local(|| load(&unit, &library, None, &context).unwrap());
}
