//! The settings files that come with flightlag and their JSON schemas, embedded: what a user copies and changes is what
//! the command uses.

/// Settings of a campaign when a user names none.
pub const DEFAULT_PIPELINE: &str = include_str!("default.toml");
/// Settings of the demo's campaign.
pub const DEMO_PIPELINE: &str = include_str!("demo.toml");
/// The commented example of criteria: it uses every key.
pub const EXAMPLE_CRITERIA: &str = include_str!("criteria.toml");
/// Criteria of the demo's campaign.
pub const DEMO_CRITERIA: &str = include_str!("demo.criteria.toml");
/// The rig of a bench when a user names none.
pub const DEFAULT_RIG: &str = include_str!("bench.rig.toml");
/// The commented example of a channel map: it uses every key.
pub const EXAMPLE_MAP: &str = include_str!("channel-map.example.toml");

/// The commented example of a night: it uses every key.
pub const EXAMPLE_NIGHTLY: &str = include_str!("nightly/nightly.toml");
/// The commented example of a fleet: it uses every key.
pub const EXAMPLE_FLEET: &str = include_str!("nightly/fleet.toml");

/// JSON schema of a pipeline.
pub const PIPELINE_SCHEMA: &str = include_str!("pipeline.schema.json");
/// JSON schema of criteria.
pub const CRITERIA_SCHEMA: &str = include_str!("criteria.schema.json");
/// JSON schema of test cards.
pub const TEST_CARD_SCHEMA: &str = include_str!("test-card.schema.json");
/// JSON schema of a rig.
pub const RIG_SCHEMA: &str = include_str!("rig.schema.json");
/// JSON schema of a sensor card.
pub const CARD_SCHEMA: &str = include_str!("card.schema.json");
/// JSON schema of a channel map.
pub const CHANNEL_MAP_SCHEMA: &str = include_str!("channel-maps/channel-map.schema.json");
/// JSON schema of a night.
pub const NIGHTLY_SCHEMA: &str = include_str!("nightly/nightly.schema.json");
/// JSON schema of a fleet.
pub const FLEET_SCHEMA: &str = include_str!("nightly/fleet.schema.json");

/// The channel maps, by file name.
pub const CHANNEL_MAPS: &[(&str, &str)] = &[
    ("ardupilot.toml", include_str!("channel-maps/ardupilot.toml")),
    ("bench-wide-csv.toml", include_str!("channel-maps/bench-wide-csv.toml")),
    ("encoder-csv.toml", include_str!("channel-maps/encoder-csv.toml")),
    ("encoder-ros.toml", include_str!("channel-maps/encoder-ros.toml")),
    ("flightlag-bench.toml", include_str!("channel-maps/flightlag-bench.toml")),
    ("flightlag-bench-clocks.toml", include_str!("channel-maps/flightlag-bench-clocks.toml")),
    ("flightlag-demo.toml", include_str!("channel-maps/flightlag-demo.toml")),
    ("flightlag-demo-wide.toml", include_str!("channel-maps/flightlag-demo-wide.toml")),
    ("flysight-1.toml", include_str!("channel-maps/flysight-1.toml")),
    ("flysight-2.toml", include_str!("channel-maps/flysight-2.toml")),
    ("garmin-g1000.toml", include_str!("channel-maps/garmin-g1000.toml")),
    ("gps-fix.toml", include_str!("channel-maps/gps-fix.toml")),
    ("inertial-nav.toml", include_str!("channel-maps/inertial-nav.toml")),
    ("inertial-nav-gps.toml", include_str!("channel-maps/inertial-nav-gps.toml")),
    ("mavlink-tlog.toml", include_str!("channel-maps/mavlink-tlog.toml")),
    ("mavros.toml", include_str!("channel-maps/mavros.toml")),
    ("navsatfix-twist.toml", include_str!("channel-maps/navsatfix-twist.toml")),
    ("nmea.toml", include_str!("channel-maps/nmea.toml")),
    ("rtklib-pos.toml", include_str!("channel-maps/rtklib-pos.toml")),
    ("novatel-ascii.toml", include_str!("channel-maps/novatel-ascii.toml")),
    ("novatel-ros.toml", include_str!("channel-maps/novatel-ros.toml")),
    ("oxts-csv.toml", include_str!("channel-maps/oxts-csv.toml")),
    ("px4-ecl-replay.toml", include_str!("channel-maps/px4-ecl-replay.toml")),
    ("px4-ros2.toml", include_str!("channel-maps/px4-ros2.toml")),
    ("px4-sdlog2.toml", include_str!("channel-maps/px4-sdlog2.toml")),
    ("px4-ulog.toml", include_str!("channel-maps/px4-ulog.toml")),
    ("septentrio-ros.toml", include_str!("channel-maps/septentrio-ros.toml")),
    ("ublox-ros.toml", include_str!("channel-maps/ublox-ros.toml")),
    ("ubx.toml", include_str!("channel-maps/ubx.toml")),
    ("vectornav-csv.toml", include_str!("channel-maps/vectornav-csv.toml")),
    ("wide-csv.toml", include_str!("channel-maps/wide-csv.toml")),
    ("xsens-mt-manager.toml", include_str!("channel-maps/xsens-mt-manager.toml")),
    ("xsens-mti.toml", include_str!("channel-maps/xsens-mti.toml")),
    ("xsens-mtig.toml", include_str!("channel-maps/xsens-mtig.toml")),
];
