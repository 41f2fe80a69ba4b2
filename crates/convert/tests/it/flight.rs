//! A short flight in any container, and a way to read it.

use ingest::{FlightUnit, Limits, Loaded, MapLibrary, ReadContext, discover, load};
use simulate::{Container, FlightSettings, SensorSettings, simulate};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::AtomicBool;

/// Writes a flight of 20 s below `folder`; returns the path of its file.
pub fn write(container: Container, folder: &Path) -> PathBuf {
    let settings = FlightSettings {
        duration_s: 20.0,
        seed: 3,
        position: SensorSettings { delay_s: 0.4, white_std: 0.1, ..SensorSettings::clean(5.0) },
        ..FlightSettings::default()
    };
    for file in container.files(&simulate(&settings).unwrap(), "flight").unwrap() {
        let path = folder.join(&file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &file.bytes).unwrap();
    }
    folder.join(container.path("flight"))
}

pub fn unit(path: &Path) -> FlightUnit {
    let mut found = discover(path, library()).unwrap();
    assert_eq!(found.units.len(), 1, "{found:?}");
    found.units.remove(0)
}

pub fn library() -> &'static MapLibrary {
    static SHIPPED: LazyLock<MapLibrary> = LazyLock::new(|| MapLibrary::shipped().unwrap());
    &SHIPPED
}

pub fn read(path: &Path) -> Loaded {
    in_context(|context| load(&unit(path), library(), None, context)).unwrap()
}

pub fn in_context<T>(body: impl FnOnce(&ReadContext<'_>) -> T) -> T {
    let cancel = AtomicBool::new(false);
    body(&ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () })
}
