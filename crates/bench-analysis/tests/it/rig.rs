//! The rig file: resolved values, and errors with their line.

use bench_analysis::{FieldRule, MountKind, Rig, SettingsError, StampChoice};
use std::path::Path;

fn parse(text: &str) -> Result<Rig, SettingsError> {
    Rig::parse(text, Path::new("bench/r.rig.toml"))
}

const SMALL: &str = "schema = 1\n[sensor]\nmodel = \"MTi-G\"\n[bar]\nlength_m = 1.3\nmount = \"upright\"\n";

const FULL: &str = r#"
schema = 1
title = "Swing bench"

[sensor]
model = "Xsens MTi-G"
serial = "00500123"
firmware = "2.6"
baud = 115200

[bar]
length_m = 1.3
mount = "upright"
azimuth_deg = 30.0
first_mode_hz = 4.0

[encoder]
channel = "encoder.bar"
counts_per_rev = 2000
decoding = 4
sign = -1
zero_deg = 0.0

[site]
latitude_deg = 37.6
longitude_deg = 126.86
height_m = 20.0
date = "2010-10-25"
gravity_mps2 = 9.7996
field = { north_nt = 29579, east_nt = -4122, down_nt = 41280.0 }

[[mount]]
channels = ["position.*", "velocity.*"]
lever_arm_m = [0.0, 0.0, -1.3]
[[mount]]
channels = ["*"]
lever_arm_m = [0.0, 0.0, -1.28]
rotation_deg = [0.0, 0.0, 90.0]
axes = ["-y", "x", "z"]

[clock]
shared = true
anchor = "angular-rate.imu"
stamps = "logged"

[analysis]
search_s = [-0.5, 1.5]
margin_ms = 5.0
drift = false
inject_ms = [5.0, 50.0]
inject_gain = 1.05

[card]
valid_days = 365
"#;

#[test]
fn the_default_rig_is_valid_and_leaves_most_to_be_fitted() {
    let rig = Rig::shipped_default().unwrap();
    assert_eq!((rig.bar.mount, rig.bar.length_m), (MountKind::Upright, 1.3));
    assert_eq!((rig.encoder.sign, rig.encoder.zero_rad, rig.encoder.counts_per_rev), (None, None, None));
    assert_eq!((rig.bar.azimuth_rad, rig.site.field, rig.clock.shared), (None, FieldRule::Fit, None));
    assert_eq!(rig.analysis.search_s, (-1.0, 1.5));
    assert_eq!(rig.mount_of("velocity.ins").lever_arm_m, [0.0, 0.0, -1.3]);
}

#[test]
fn a_full_file_is_converted_to_si() {
    let rig = parse(FULL).unwrap();
    assert_eq!(rig.encoder.counts_per_rev, Some(8000.0));
    assert_eq!((rig.encoder.sign, rig.encoder.zero_rad), (Some(-1.0), Some(0.0)));
    assert!((rig.bar.azimuth_rad.unwrap() - 0.523_598_775_598_298_8).abs() < 1e-15);
    let FieldRule::Stated(field) = rig.site.field else { panic!("{:?}", rig.site.field) };
    for (found, expected) in field.iter().zip([29_579e-9, -4_122e-9, 41_280e-9]) {
        assert!((found - expected).abs() < 1e-18, "{found}");
    }
    assert_eq!((rig.clock.stamps, rig.clock.shared), (StampChoice::Logged, Some(true)));
    assert_eq!((rig.analysis.margin_s, rig.analysis.drift), (Some(0.005), false));
    assert_eq!(rig.sensor.baud, Some(115_200));
}

#[test]
fn the_first_mount_that_names_a_channel_is_used() {
    let rig = parse(FULL).unwrap();
    assert_eq!(rig.mount_of("velocity.gps").lever_arm_m, [0.0, 0.0, -1.3]);
    let imu = rig.mount_of("specific-force.imu");
    assert_eq!(imu.lever_arm_m, [0.0, 0.0, -1.28]);
    // Axes first: body from sensor (1, 2, 3) is (−2, 1, 3); then a quarter about z: (−1, −2, 3).
    let turned = imu.body_from_sensor() * nalgebra::Vector3::new(1.0, 2.0, 3.0);
    for (found, expected) in turned.iter().zip([-1.0, -2.0, 3.0]) {
        assert!((found - expected).abs() < 1e-12, "{turned:?}");
    }
}

#[test]
fn a_hanging_bar_has_its_sensor_below_the_pivot() {
    let rig = parse(&SMALL.replace("upright", "hanging")).unwrap();
    assert_eq!(rig.mount_of("anything").lever_arm_m, [0.0, 0.0, 1.3]);
}

#[test]
fn an_unknown_key_is_rejected_with_file_line_and_the_known_keys() {
    let text = parse(&format!("{SMALL}azimut_deg = 30.0\n")).unwrap_err().to_string();
    assert!(text.starts_with("bench/r.rig.toml:7: unknown key `azimut_deg`"), "{text}");
    assert!(text.contains("`azimuth_deg`"), "{text}");
    let text = parse("schema = 1\n[sensor]\nmodel = \"a\"\n[bar]\nmount = \"upright\"\n").unwrap_err().to_string();
    assert!(text.contains("missing key `length_m`"), "{text}");
}

#[test]
fn an_invalid_value_is_rejected_with_its_line_and_what_is_expected() {
    for (lines, number, right) in [
        ("[encoder]\ncounts_per_rev = 3", 8, "4 to 67108864"),
        ("[encoder]\ndecoding = 3", 8, "1, 2 or 4"),
        ("[encoder]\nsign = 0", 8, "1 or -1"),
        ("[encoder]\nzero_deg = 400.0", 8, "-360 to 360"),
        ("[site]\nlatitude_deg = 91.0", 8, "-90 to 90"),
        ("[site]\ngravity_mps2 = 979.96", 8, "9.7 to 9.9"),
        ("[site]\ndate = \"25.10.2010\"", 8, "2010-10-25"),
        ("[site]\nfield = \"igrf\"", 8, "\"wmm\""),
        ("[site]\nfield = { north_nt = 0.3, east_nt = 0.0, down_nt = 0.4 }", 8, "22000 to 67000"),
        ("[site]\nfield = { north_nt = 30000, east_nt = 0.0 }", 8, "down_nt"),
        ("[[mount]]\nchannels = []", 8, "position.*"),
        ("[[mount]]\nchannels = [\"*.ins\"]", 8, "position.*"),
        ("[[mount]]\nchannels = [\"*\"]\naxes = [\"x\", \"y\", \"up\"]", 9, "-x"),
        ("[[mount]]\nchannels = [\"*\"]\naxes = [\"x\", \"y\", \"-z\"]", 9, "right-handed"),
        ("[[mount]]\nchannels = [\"*\"]\naxes = [\"x\", \"x\", \"z\"]", 9, "right-handed"),
        ("[[mount]]\nchannels = [\"*\"]\nlever_arm_m = [0.0, 0.0, nan]", 9, "-50 to 50"),
        ("[analysis]\nsearch_s = [1.0, -1.0]", 8, "from, to in seconds"),
        ("[analysis]\nsearch_s = [-1000.0, 1500.0]", 8, "from, to in seconds"),
        ("[analysis]\ninject_ms = [5.0, inf]", 8, "-1000 to 1000"),
        ("[card]\nvalid_days = 0", 8, "1 to 36500"),
        ("[clock]\nanchor = \" \"", 8, "angular-rate.imu"),
        ("[clock]\nstamps = \"arrival\"", 8, "`logged`"),
    ] {
        let error = parse(&format!("{SMALL}{lines}\n")).unwrap_err();
        assert_eq!(error.line, Some(number), "{lines}: {error}");
        assert!(error.what.contains(right), "{lines}: {error}");
    }
    assert_eq!(parse(&SMALL.replace("schema = 1", "schema = 2")).unwrap_err().line, Some(1));
    assert_eq!(parse(&SMALL.replace("MTi-G", " ")).unwrap_err().line, Some(2));
    assert_eq!(parse(&SMALL.replace("1.3", "1300.0")).unwrap_err().line, Some(5));
}

#[test]
fn a_custom_bar_without_lever_arms_is_rejected() {
    let custom = SMALL.replace("upright", "custom");
    assert!(parse(&custom).unwrap_err().what.contains("[[mount]]"));
    let without = parse(&format!("{custom}[[mount]]\nchannels = [\"*\"]\n")).unwrap_err();
    assert!(without.what.contains("lever_arm_m") && without.line == Some(8), "{without}");
    let with = format!("{custom}[[mount]]\nchannels = [\"*\"]\nlever_arm_m = [0.1, 0.0, -1.0]\n");
    assert_eq!(parse(&with).unwrap().mount_of("x").lever_arm_m, [0.1, 0.0, -1.0]);
}

#[test]
fn an_explicit_default_or_a_comment_changes_nothing() {
    let spelled = format!(
        "# a comment\n{SMALL}[encoder]\ndecoding = 1\n[site]\nfield = \"fit\"\nheight_m = -0.0\n[clock]\nstamps = \"auto\"\n\
         [analysis]\nsearch_s = [-1, 1.5]\ndrift = true\ninject_gain = 1.05\n"
    );
    assert_eq!(parse(SMALL).unwrap().as_used(), parse(&spelled).unwrap().as_used());
    let other = parse(&SMALL.replace("1.3", "1.31")).unwrap().as_used();
    assert_ne!(parse(SMALL).unwrap().as_used().blake3, other.blake3);
}

#[test]
fn the_resolved_rig_file_parses_to_the_same_rig() {
    for text in [SMALL, FULL, bench_analysis::DEFAULT_RIG] {
        let rig = parse(text).unwrap();
        let again = parse(&rig.as_used().toml).unwrap();
        assert_eq!(again, rig);
    }
}
