//! User tables that no map fits: bound by names, units and motion, or rejected with a reason. The truth is a
//! circling flight whose position is 0.3 s late.

use crate::support::*;
use flight::{Channel, Quantity};
use ingest::{ChannelMap, Loaded, MapLibrary};
use std::path::Path;

const LATE_S: f64 = 0.3;
const RADIUS_M: f64 = 6_378_137.0;
/// At the equator angles convert to metres easily.
const SCALE: f64 = RADIUS_M;

/// The truth at a time: north, east, up, m, and the velocities, m/s.
fn truth(t: f64) -> ([f64; 3], [f64; 3]) {
    let (w, r) = (0.25, 60.0);
    let place = [r * (w * t).sin() + 3.0 * t, -r * (w * t).cos(), 100.0 + 1.5 * t + 8.0 * (0.3 * t).sin()];
    (place, [r * w * (w * t).cos() + 3.0, r * w * (w * t).sin(), 1.5 + 2.4 * (0.3 * t).cos()])
}

/// A table of 90 s at 10 Hz. Each row is built from the time, the angles of a late position near the equator,
/// its height, and the velocity.
fn table(header: &str, row: impl Fn(f64, [f64; 3], [f64; 3]) -> String) -> String {
    let rows = (0..900).map(|i| {
        let t = 0.1 * f64::from(i);
        let ([north, east, up], _) = truth(t - LATE_S);
        // Radii of curvature at the equator.
        let (latitude, longitude) = (0.01 + north / 6_335_439.3, 0.2 + east / (SCALE * 0.01_f64.cos()));
        row(t, [latitude, longitude, up], truth(t).1)
    });
    format!("{header}\n{}", rows.map(|row| row + "\n").collect::<String>())
}

fn load_text(text: &str) -> Loaded {
    let (_folder, path) = file("own.csv", text.as_bytes());
    let loaded = load(&tables(&[path])).unwrap();
    assert_ledger(&loaded);
    loaded
}

fn of(loaded: &Loaded, quantity: Quantity) -> &Channel {
    let binding = loaded.binding.as_ref().unwrap();
    let found = loaded.flight.channels.values().find(|c| c.quantity == quantity);
    found.unwrap_or_else(|| panic!("no {quantity:?}: {binding:?}"))
}

/// Position and velocity are the truth in SI units, north, east, down.
fn assert_is_truth(loaded: &Loaded) {
    assert!(loaded.binding.as_ref().unwrap().why.contains("guess"), "{:?}", loaded.binding);
    assert!(count_of(loaded, "bound-by-guess") >= 2);
    let velocity = of(loaded, Quantity::VelocityNed);
    let times = velocity.series.timeline().seconds_since(velocity.series.timeline().stamps()[0]);
    for (i, t) in times.iter().enumerate().step_by(97) {
        let [north, east, up] = truth(*t).1;
        let found: Vec<f64> = velocity.series.components().iter().map(|axis| axis[i]).collect();
        for (found, expected) in found.iter().zip([north, east, -up]) {
            assert!((found - expected).abs() < 2e-3 * (1.0 + expected.abs()), "{t} s: {found} for {expected}");
        }
    }
    let position = of(loaded, Quantity::PositionGeodetic);
    let first: Vec<f64> = position.series.components().iter().map(|axis| axis[0]).collect();
    let ([north, _, up], _) = truth(-LATE_S);
    assert!((first[0] - (0.01 + north / 6_335_439.3)).abs() < 1e-7, "{first:?}");
    assert!((first[2] - up).abs() < 0.1, "{first:?} for {up}");
}

fn deg(rad: f64) -> f64 {
    rad.to_degrees()
}

#[test]
fn tables_under_any_usual_names_and_units_are_the_same_flight() {
    let kt = 1.0 / (1852.0 / 3600.0);
    let tables: [(&str, String); 9] = [
        (
            "plain",
            table("time,lat,lon,alt,vn,ve,vd", |t, [a, b, h], [n, e, u]| {
                format!("{t:.1},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4}", deg(a), deg(b), -u)
            }),
        ),
        (
            "units in names",
            table("t_ms,lat_deg,lon_deg,alt_m,vel_north_mps,vel_east_mps,vel_up_mps", |t, [a, b, h], [n, e, u]| {
                format!("{:.0},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{u:.4}", 1e3 * t, deg(a), deg(b))
            }),
        ),
        (
            "short, radians, down that counts up",
            table("time,lat_rad,lon_rad,alt,VN,VE,VD", |t, [a, b, h], [n, e, u]| {
                format!("{t:.1},{a:.11},{b:.11},{h:.3},{n:.4},{e:.4},{u:.4}")
            }),
        ),
        (
            "knots and feet",
            table("time,lat_deg,lon_deg,alt_ft,vn,ve,vd", move |t, [a, b, h], [n, e, u]| {
                format!(
                    "{t:.1},{:.9},{:.9},{:.3},{:.4},{:.4},{:.4}",
                    deg(a),
                    deg(b),
                    h / 0.3048,
                    n * kt,
                    e * kt,
                    -u * kt
                )
            }),
        ),
        (
            "integers of 1e-7 deg, ms, cm/s",
            table("timestamp_us,lat,lon,alt_mm,vel_n_cmps,vel_e_cmps,vel_d_cmps", |t, [a, b, h], [n, e, u]| {
                format!(
                    "{:.0},{:.0},{:.0},{:.0},{:.2},{:.2},{:.2}",
                    1e6 * t,
                    1e7 * deg(a),
                    1e7 * deg(b),
                    1e3 * h,
                    1e2 * n,
                    1e2 * e,
                    -1e2 * u
                )
            }),
        ),
        (
            "x, y, z of east, north, up",
            table("time,latitude,longitude,height,vx,vy,vz", |t, [a, b, h], [n, e, u]| {
                format!("{t:.1},{:.9},{:.9},{h:.3},{e:.4},{n:.4},{u:.4}", deg(a), deg(b))
            }),
        ),
        (
            "speed and track",
            table("time,lat,lon,alt,speed,course,climb", |t, [a, b, h], [n, e, u]| {
                format!(
                    "{t:.1},{:.9},{:.9},{h:.3},{:.4},{:.5},{u:.4}",
                    deg(a),
                    deg(b),
                    n.hypot(e),
                    deg(e.atan2(n)).rem_euclid(360.0)
                )
            }),
        ),
        (
            "a line of units",
            table("time,lat,lon,alt,velN,velE,velU\ns,deg,deg,m,km/h,km/h,km/h", |t, [a, b, h], [n, e, u]| {
                format!("{t:.1},{:.9},{:.9},{h:.3},{:.4},{:.4},{:.4}", deg(a), deg(b), 3.6 * n, 3.6 * e, 3.6 * u)
            }),
        ),
        (
            "UTC",
            table(
                "UTC Time;GPS Lat;GPS Lon;GPS Alt;Vel North [ft/s];Vel East [ft/s];Vel Down [ft/s]",
                |t, [a, b, h], [n, e, u]| {
                    let ft = 0.3048;
                    format!(
                        "2026-05-10T10:{:02}:{:04.1}Z;{:.9};{:.9};{h:.3};{:.4};{:.4};{:.4}",
                        (t / 60.0 + 1e-6) as i32,
                        t - 60.0 * (t / 60.0 + 1e-6).floor(),
                        deg(a),
                        deg(b),
                        n / ft,
                        e / ft,
                        -u / ft
                    )
                },
            ),
        ),
    ];
    for (name, text) in tables {
        eprintln!("{name}");
        assert_is_truth(&load_text(&text));
    }
}

#[test]
fn the_suggested_map_reads_the_same_channels_and_says_why() {
    let text = table("time,lat,lon,alt,vn,ve,vd,truth_lat,truth_lon", |t, [a, b, h], [n, e, u]| {
        let (a, b) = (deg(a), deg(b));
        format!("{t:.1},{a:.9},{b:.9},{h:.3},{n:.4},{e:.4},{:.4},{a:.9},{b:.9}", -u)
    });
    let (_folder, path) = file("own.csv", text.as_bytes());
    let unit = tables(&[path]);
    let guessed = load(&unit).unwrap();
    let map = suggest(&unit);
    assert!(map.contains("north = { field = \"vn\", unit = \"m/s\" }") && map.contains("# "), "{map}");
    assert!(map.contains("name = \"own\"\n"), "{map}");
    let shipped = unit.files[0].with_file_name("mavros.csv");
    std::fs::copy(&unit.files[0], &shipped).unwrap();
    assert!(suggest(&tables(&[shipped])).contains("name = \"mavros-own\"\n"));
    assert!(map.contains("name = \"position.truth\""), "{map}");
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("own.toml"), &map).unwrap());
    let mapped = load_mapped(&unit, &library, None).unwrap();
    assert_eq!(mapped.binding.as_ref().unwrap().map, "own");
    assert_eq!(count_of(&mapped, "bound-by-guess"), 0);
    assert_eq!(format!("{:?}", mapped.flight.channels), format!("{:?}", guessed.flight.channels));
}

#[test]
fn bindings_that_motion_contradicts_or_leaves_open_are_rejected() {
    let refused = |text: &str| load_text(text).binding.unwrap_err();
    let swapped = table("time,lat,lon,alt,vn,ve,vd", |t, [a, b, h], [n, e, u]| {
        format!("{t:.1},{:.9},{:.9},{h:.3},{e:.4},{n:.4},{:.4}", deg(a), deg(b), -u)
    });
    let error = refused(&swapped);
    assert!(error.contains("by name, vn belongs to lat") && error.contains("exchanged axes"), "{error}");
    let odd = table("time,lat,lon,vn,ve", |t, [a, b, _], [n, e, _]| {
        format!("{t:.1},{:.9},{:.9},{:.4},{:.4}", deg(a), deg(b), 7.3 * n, 7.3 * e)
    });
    let error = refused(&odd);
    assert!(error.contains("vn is 7.2") && error.contains("not a known unit"), "{error}");
    let stated = table("time,lat,lon,vn_mps,ve_mps", |t, [a, b, _], [n, e, _]| {
        format!("{t:.1},{:.9},{:.9},{:.4},{:.4}", deg(a), deg(b), 3.6 * n, 3.6 * e)
    });
    assert!(refused(&stated).contains("if it is in m/s as stated"));
    let unknown = table("time,lat,lon,vn [furlongs],ve [furlongs]", |t, [a, b, _], [n, e, _]| {
        format!("{t:.1},{:.9},{:.9},{n:.4},{e:.4}", deg(a), deg(b))
    });
    let error = refused(&unknown);
    assert!(error.contains("furlongs") && error.contains("which flightlag does not know"), "{error}");
    let still = table("time,lat,lon,vn,ve", |t, _, _| format!("{t:.1},0.5,0.5,0,0"));
    let error = refused(&still);
    assert!(error.contains("cannot be bound by guess"), "{error}");
    let straight = table("time,lat,lon,vx,vy", |t, _, _| {
        format!(
            "{t:.1},{:.9},{:.9},7,7",
            4.0 + deg(7.0 * t / 6_335_439.3),
            20.0 + deg(7.0 * t / (SCALE * 4_f64.to_radians().cos()))
        )
    });
    assert!(refused(&straight).contains("too straight to decide which of vx and vy goes north"));
    let no_time =
        table("lat,lon,vn,ve", |_, [a, b, _], [n, e, _]| format!("{:.9},{:.9},{n:.4},{e:.4}", deg(a), deg(b)));
    assert!(load_text(&no_time).binding.is_err());
}

#[test]
fn a_heading_along_the_motion_is_a_course_and_foreign_names_need_a_map() {
    let text = table("UTC,latitude,longitude,speed,heading_motion", |t, [a, b, _], [n, e, _]| {
        let course = deg(e.atan2(n).rem_euclid(std::f64::consts::TAU));
        let (speed, minute, second) = (n.hypot(e), (t / 60.0 + 1e-6) as i32, t - 60.0 * (t / 60.0 + 1e-6).floor());
        format!("2026-05-10T10:{minute:02}:{second:04.1}Z,{:.9},{:.9},{speed:.4},{course:.4}", deg(a), deg(b))
    });
    let velocity = of(&load_text(&text), Quantity::VelocityNed).series.components().to_vec();
    let (north, east) = (truth(10.0).1[0], truth(10.0).1[1]);
    assert!((velocity[0][100] - north).abs() < 0.01 && (velocity[1][100] - east).abs() < 0.01);
    let german =
        table("Zeit,Breite,Laenge,v_Nord", |t, [a, b, _], [n, ..]| format!("{t:.1},{},{},{n}", deg(a), deg(b)));
    let refused = load_text(&german).binding.unwrap_err();
    let advice = "no columns are named like a time and a position or a velocity; `flightlag maps --suggest LOG`";
    assert!(refused.contains(advice), "{refused}");
}

/// The notice about guessed bindings.
fn summary(loaded: &Loaded) -> String {
    loaded.flight.notices.iter().find(|n| n.code == "bound-by-guess").unwrap().text.clone()
}

#[test]
fn the_time_column_unit_and_clock_are_stated_and_unknown_units_rejected() {
    let with_units = |unit: &str| {
        table(&format!("time,lat,lon,alt,vn,ve,vd\n{unit},deg,deg,m,m/s,m/s,m/s"), |t, [a, b, h], [n, e, u]| {
            format!("{t:.1},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4}", deg(a), deg(b), -u)
        })
    };
    let known = load_text(&with_units("(s)"));
    assert_is_truth(&known);
    assert!(summary(&known).contains("; time = time [s], clock elapsed, logged;"), "{}", summary(&known));
    assert_is_truth(&load_text(&with_units("(GPS)")));
    let error = load_text(&with_units("(fortnight)")).binding.unwrap_err();
    assert!(error.contains("the table states the unit \"(fortnight)\" for the time time"), "{error}");
}

/// 13:59:00 to 14:00:30 as numbers: each minute ends with a jump of 41.
#[test]
fn hours_minutes_and_seconds_in_one_number_are_a_time_of_day() {
    let text = table("utc,lat,lon,alt,vn,ve,vu", |t, [latitude, longitude, up], [n, e, u]| {
        let of_day = 13.0 * 3600.0 + 59.0 * 60.0 + t;
        let clock = 1e4 * (of_day / 3600.0).floor() + 1e2 * (of_day % 3600.0 / 60.0).floor() + of_day % 60.0;
        format!("{clock:.1},{},{},{up},{n},{e},{u}", deg(latitude), deg(longitude))
    });
    let loaded = load_text(&text);
    assert_is_truth(&loaded);
    assert!(summary(&loaded).contains("utc as time-of-day"), "{}", summary(&loaded));
}

#[test]
fn columns_called_true_or_gps_are_named_accordingly() {
    let text =
        table("time,lat,lon,gps_lat,gps_lon,true_lat,true_lon,vn,ve", |t, [latitude, longitude, _], [n, e, _]| {
            let [lat, lon] = [deg(latitude), deg(longitude)];
            format!("{t},{lat},{lon},{lat},{lon},{lat},{lon},{n},{e}")
        });
    let summary = summary(&load_text(&text));
    for named in
        ["position.gps: latitude = gps_lat", "position.plain: latitude = lat", "position.truth: latitude = true_lat"]
    {
        assert!(summary.contains(named), "{summary}");
    }
}

#[test]
fn columns_of_a_second_receiver_are_separate_channels() {
    let text = table("time,lat,lon,lat2,lon2,gps_vn,gps_ve,vn,ve", |t, [latitude, longitude, _], [n, e, _]| {
        let [lat, lon] = [deg(latitude), deg(longitude)];
        format!("{t},{lat},{lon},{lat},{lon},{n},{e},{n},{e}")
    });
    let summary = summary(&load_text(&text));
    for named in [
        "position.gps: latitude = lat [deg]",
        "position.gps-2: latitude = lat2",
        "velocity.gps: north = gps_vn",
        "velocity.plain: north = vn",
    ] {
        assert!(summary.contains(named), "{summary}");
    }
}

#[test]
fn a_height_of_unknown_unit_is_reported_as_assumed() {
    let text = table("time,lat,lon,alt,vn,ve", |t, [a, b, h], [n, e, _]| {
        format!("{t},{},{},{},{n},{e}", deg(a), deg(b), h / 0.3048)
    });
    let summary = summary(&load_text(&text));
    assert!(summary.contains("alt is assumed to be in metres, which nothing confirms"), "{summary}");
}

/// No ECEF axis points north, although x and y move consistently with their velocities.
#[test]
fn earth_centred_coordinates_need_a_map() {
    let text = table("time,x,y,z,vx,vy,vz", |t, [a, b, h], [n, e, u]| {
        let place = flight::Geodetic { latitude: a, longitude: b, height: h }.to_ecef();
        let ((sa, ca), (sb, cb)) = (a.sin_cos(), b.sin_cos());
        let level = ca * u - sa * n;
        let [vx, vy, vz] = [cb * level - sb * e, sb * level + cb * e, ca * n + sa * u];
        format!("{t},{},{},{},{vx},{vy},{vz}", place.x, place.y, place.z)
    });
    let error = load_text(&text).binding.unwrap_err();
    assert!(
        error.contains("x, y and z are earth-centred coordinates") && error.contains("frame = \"ecef\""),
        "{error}"
    );
}

#[test]
fn exchanged_columns_and_degrees_with_minutes_are_named_once() {
    let swapped =
        table("time,lat,lon,vn,ve", |t, [a, b, _], [n, e, _]| format!("{t},{},{},{n},{e}", deg(b) + 100.0, deg(a)));
    let error = load_text(&swapped).binding.unwrap_err();
    assert_eq!(error.matches("which no latitude can: lat and lon may be exchanged").count(), 1, "{error}");
    let minutes = |degrees: f64| 100.0 * degrees.trunc() + 60.0 * degrees.fract();
    let text = table("time,lat,lon,vn,ve", |t, [a, b, _], [n, e, _]| {
        format!("{t},{},{},{n},{e}", minutes(deg(a) + 37.0), minutes(deg(b)))
    });
    let error = load_text(&text).binding.unwrap_err();
    assert_eq!(error.matches("look like degrees and minutes (").count(), 1, "{error}");
}

#[test]
fn a_utm_grid_is_metres_north_and_east() {
    let text = table("time,UTM_E,UTM_N,vn,ve", |t, _, [n, e, _]| {
        let ([north, east, _], _) = truth(t - LATE_S);
        format!("{t},{},{},{n},{e}", 691_000.0 + east, 5_337_000.0 + north)
    });
    let summary = summary(&load_text(&text));
    assert!(summary.contains("north = UTM_N [m], east = UTM_E [m]"), "{summary}");
}

/// x east and y north, as shown by latitude and longitude.
#[test]
fn local_position_axes_are_inferred_from_latitude_and_longitude() {
    let text = table("time,x,y,vx,vy,gps_lat,gps_lon", |t, [a, b, _], [n, e, _]| {
        let ([north, east, _], _) = truth(t - LATE_S);
        format!("{t},{east},{north},{e},{n},{},{}", deg(a), deg(b))
    });
    let summary = summary(&load_text(&text));
    assert!(
        summary.contains("north = vy [m/s], east = vx [m/s]") && summary.contains("north = y [m], east = x [m]"),
        "{summary}"
    );
}

/// X-Plane's axes: x east, y up, z south.
#[test]
fn axes_that_contradict_latitude_and_longitude_are_not_called_north_and_east() {
    // A track consistent with x and y.
    let text = table("time,lat,lon,x,y,speed,track", |t, [a, b, _], [n, e, _]| {
        let ([north, east, _], _) = truth(t - LATE_S);
        let track = deg(n.atan2(e)).rem_euclid(360.0);
        format!("{t},{},{},{east},{north},{},{track}", deg(a), deg(b), n.hypot(e))
    });
    let error = load_text(&text).binding.unwrap_err();
    assert!(error.contains("speed belongs to lat") && error.contains("exchanged axes"), "{error}");
    let text = table("time,lat,lon,x,y,z,vx,vy,vz", |t, [a, b, _], [n, e, u]| {
        let ([north, east, up], _) = truth(t - LATE_S);
        format!("{t},{},{},{east},{up},{},{e},{u},{}", deg(a), deg(b), -north, -n)
    });
    let error = load_text(&text).binding.unwrap_err();
    assert!(error.contains("vx and vy do not fit the motion of lat"), "{error}");
}

#[test]
fn a_receiver_without_a_fix_contradicts_nothing() {
    let text = table("time,lat,lon,x,y,vx,vy", |t, _, [n, e, _]| {
        let ([north, east, _], _) = truth(t - LATE_S);
        format!("{t},0,0,{north},{east},{n},{e}")
    });
    let summary = summary(&load_text(&text));
    assert!(
        summary.contains("north = x [m], east = y [m]") && summary.contains("north = vx [m/s], east = vy [m/s]"),
        "{summary}"
    );
}

#[test]
fn a_time_in_whole_seconds_yields_to_a_finer_one() {
    let of = |first: &str| {
        table(&format!("{first},boot_time_ms,lat,lon,alt,vn,ve,vd"), |t, [a, b, h], [n, e, u]| {
            let second = (t + 1e-6).floor();
            let clock = format!("10:{:02}:{:02}", second as u32 / 60, second as u32 % 60);
            format!("{clock},{:.0},{},{},{h},{n},{e},{}", 1e3 * t, deg(a), deg(b), -u)
        })
    };
    let loaded = load_text(&of("utc_time"));
    assert_is_truth(&loaded);
    assert!(summary(&loaded).contains("time = boot_time_ms [ms]"), "{}", summary(&loaded));
}

/// An INS and a GPS side by side: the columns of each belong to the time on their left.
#[test]
fn two_times_in_one_table_belong_to_the_columns_on_their_right() {
    let of = |header: &str, second: &dyn Fn(f64) -> (f64, String)| {
        let rows = (0..900).map(|i| {
            let t = 0.1 * f64::from(i);
            let (at, time) = second(t);
            let ([north, east, up], [n, e, u]) = (truth(at - LATE_S).0, truth(t).1);
            let (latitude, longitude) = (0.01 + north / 6_335_439.3, 0.2 + east / (SCALE * 0.01_f64.cos()));
            format!("{t:.1},{n},{e},{},{time},{},{},{up}\n", -u, deg(latitude), deg(longitude))
        });
        load_text(&format!("{header}\n{}", rows.collect::<String>()))
    };
    let later = |t: f64| (t + 0.4, format!("{:.1}", t + 0.4));
    for header in ["INS time [s],Vn,Ve,Vd,GPS time [s],lat,lon,alt", "t,Vn,Ve,Vd,t,lat,lon,alt"] {
        let loaded = of(header, &later);
        let first = |quantity| super::guess::of(&loaded, quantity).series.timeline().stamps()[0].0;
        let firsts = (first(Quantity::VelocityNed), first(Quantity::PositionGeodetic));
        assert_eq!(firsts, (0, 400_000_000), "{}", summary(&loaded));
        assert!(summary(&loaded).contains("0.400 s after") && summary(&loaded).contains("taken as one clock"));
    }
    let mirrored = table("Vn,Ve,INS time [s],lat,lon,alt,GPS time [s]", |t, [a, b, h], _| {
        let [n, e, _] = truth(t - 0.4).1;
        format!("{n:.4},{e:.4},{:.1},{:.9},{:.9},{h:.3},{t:.1}", t - 0.4, deg(a), deg(b))
    });
    let mirrored = load_text(&mirrored);
    let first = |quantity| super::guess::of(&mirrored, quantity).series.timeline().stamps()[0].0;
    assert_eq!((first(Quantity::VelocityNed), first(Quantity::PositionGeodetic)), (-400_000_000, 0));
    // The same instants, by another kind of clock.
    let utc = |t: f64| format!("2026-05-10T10:{:02}:{:04.1}Z", (t / 60.0 + 1e-6) as i32, (t + 1e-6) % 60.0);
    let same = of("time [s],Vn,Ve,Vd,UTC,lat,lon,alt", &|t| (t, utc(t)));
    assert!(summary(&same).contains("time = time [s], clock elapsed, logged;"), "{}", summary(&same));
    let other_rate = of("time [s],Vn,Ve,Vd,UTC,lat,lon,alt", &|t| (0.5 * t, utc(0.5 * t)));
    let why = other_rate.binding.unwrap_err();
    assert!(why.contains("time [s]") && why.contains("UTC as iso-8601 of one table count differently"), "{why}");
    // One kind of clock with another zero, such as seconds of a week: nothing contradicts that these are the same instants.
    let of_week = of("time [s],Vn,Ve,Vd,TOW [s],lat,lon,alt", &|t| (t, format!("{:.1}", 207_000.0 + t)));
    assert!(summary(&of_week).contains("time = time [s], clock elapsed, logged;"), "{}", summary(&of_week));
}

/// GPS time is ahead of UTC by the leap seconds, 18 in 2026.
#[test]
fn gps_time_by_its_name_is_not_utc() {
    let clock_of = |header: &str, time: &dyn Fn(f64) -> String| {
        let text = table(&format!("{header},lat,lon,alt,vn,ve,vd"), |t, [a, b, h], [n, e, u]| {
            format!("{},{},{},{h},{n},{e},{}", time(t), deg(a), deg(b), -u)
        });
        let loaded = load_text(&text);
        assert_is_truth(&loaded);
        let timeline = of(&loaded, Quantity::VelocityNed).series.timeline().clone();
        timeline.clock().unix(timeline.stamps()[0]).map(|unix| unix.0 / flight::NANOS_PER_SECOND)
    };
    let date = |t: f64| format!("2026-05-10 10:{:02}:{:04.1}", (t / 60.0 + 1e-6) as i32, (t + 1e-6) % 60.0);
    let utc = clock_of("UTC time", &date);
    assert!(utc.is_some());
    assert_eq!(clock_of("GPS Time", &date), utc.map(|utc| utc - 18));
    assert_eq!(clock_of("GPS Time", &|t| date(t) + "Z"), utc);
    assert_eq!(clock_of("GPS UTC time", &date), utc);
    let parts = |t: f64| date(t).replace(' ', ",");
    assert_eq!((clock_of("Date,Time", &parts), clock_of("Date,GPS Time", &parts)), (utc, utc.map(|utc| utc - 18)));
    for header in ["Week,TOW", "GPS week,GPS seconds", "GPS week [-],GPS seconds [s]", "Week,SOW"].into_iter().chain([
        "GPS Week,GPS Seconds of Week",
        "Week,Time of Week [s]",
        "GPS_WEEK,GPS_TOW_S",
    ]) {
        // 2026-05-10 is the first day of week 2418.
        let time = |t: f64| format!("2418,{:.1}", 36_000.0 + t);
        assert_eq!(clock_of(header, &time), utc.map(|utc| utc - 18), "{header}");
    }
}

#[test]
fn a_time_that_goes_back_is_named_with_its_line() {
    let row = |t: f64, [a, b, h]: [f64; 3], [n, e, u]: [f64; 3]| {
        format!("{t:.2},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4}", deg(a), deg(b), -u)
    };
    let header = "time,lat,lon,alt,vn,ve,vd";
    let restarted = table(header, |t, place, velocity| row(if t < 44.95 { t } else { t - 44.95 }, place, velocity));
    let why = load_text(&restarted).binding.unwrap_err();
    assert!(why.contains("(time [s], clock elapsed) goes back by 44.850 s at line 452:"), "{why}");
    // A flight, and after it the beginning of another: its rows are counted and not sorted in front.
    let longer = table(header, row);
    let other = table(header, |t, _, _| row(t, [0.5, 0.5, 0.0], [9.0, 9.0, 0.0]));
    let lines = longer.lines().take(1).chain(longer.lines().skip(21)).chain(other.lines().skip(1).take(200));
    let loaded = load_text(&lines.map(|line| line.to_owned() + "\n").collect::<String>());
    assert_eq!(count_saying(&loaded, "rejected-row", "the clock went back"), 400);
    assert_eq!(of(&loaded, Quantity::VelocityNed).series.len(), 880);
}

/// Two tables, each counting from its first row: delays would include the time between the starts. Equal lengths make
/// equal starts likely, and the text says that this is assumed.
#[test]
fn an_imu_that_may_have_started_at_another_time_is_not_bound() {
    let summary_of = |imu_begins_s: f64, imu_counts_from_s: f64| {
        let gps = table("time,lat,lon,vn,ve,vd", |t, [latitude, longitude, _], [n, e, u]| {
            format!("{t},{},{},{n},{e},{}", deg(latitude), deg(longitude), -u)
        });
        let from = (10.0 * imu_begins_s) as u32;
        let rows = (from..900).map(|i| {
            let t = 0.1 * f64::from(i);
            let [roll, pitch, yaw] = attitude(t);
            let (rate, force) = imu(t);
            let values = [roll, pitch, yaw, rate[0], rate[1], rate[2], force[0], force[1], force[2]];
            let values: Vec<String> = values.iter().map(f64::to_string).collect();
            format!("{:.1},{}\n", t - imu_counts_from_s, values.join(","))
        });
        let header = "time,roll_rad,pitch_rad,yaw_rad,p,q,r,ax,ay,az";
        let imu = format!("{header}\n{}", rows.collect::<String>());
        let folder = tempfile::tempdir().unwrap();
        let paths = [("gps.csv", gps), ("imu.csv", imu)].map(|(name, text)| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        });
        summary(&load(&tables(&paths)).unwrap())
    };
    let shared = summary_of(7.3, 0.0);
    assert!(shared.contains("specific-force") && !shared.contains("first row of their table"), "{shared}");
    let equal = summary_of(0.0, 0.0);
    assert!(equal.contains("specific-force") && equal.contains("taken to have started together"), "{equal}");
    let own = summary_of(7.3, 7.3);
    assert!(!own.contains("specific-force") && own.contains("it is unknown whether these started together"), "{own}");
}

/// A position and a velocity in two such tables of different length.
#[test]
fn a_position_and_a_velocity_that_may_have_started_at_different_times_are_not_bound() {
    let position =
        table("time,lat,lon", |t, [latitude, longitude, _], _| format!("{t},{},{}", deg(latitude), deg(longitude)));
    let bound = |velocity_begins_s: f64, counts_from_s: f64| {
        let velocity = table("time,vn,ve", |t, _, [n, e, _]| format!("{:.2},{n},{e}", t - counts_from_s));
        let rows = velocity.lines().enumerate().filter(|(i, _)| *i == 0 || *i as f64 > 10.0 * velocity_begins_s);
        let velocity: String = rows.map(|(_, line)| format!("{line}\n")).collect();
        let folder = tempfile::tempdir().unwrap();
        let paths = [("gps.csv", &position), ("ins.csv", &velocity)].map(|(name, text)| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        });
        load(&tables(&paths)).unwrap().binding.map(|_| ())
    };
    assert_eq!(bound(2.0, 0.0), Ok(()), "one clock");
    let why = bound(2.0, 2.0).unwrap_err();
    assert!(why.contains("it is unknown when each started") && why.contains("one clock"), "{why}");
}

#[test]
fn the_unit_of_a_height_is_that_of_the_vertical_velocity_or_unknown() {
    let height = |loaded: &Loaded| of(loaded, Quantity::PositionGeodetic).series.components()[2].clone();
    for (factor, unit) in [(1e3, "mm"), (1e2, "cm"), (1.0 / 0.3048, "ft"), (1.0, "m")] {
        let text = table("time,lat,lon,alt,vn,ve,vd", move |t, [a, b, h], [n, e, u]| {
            format!(
                "{t:.1},{:.9},{:.9},{:.0},{n:.4},{e:.4},{:.4}",
                deg(a),
                deg(b),
                factor * (1e3 * h).round() / 1e3,
                -u
            )
        });
        let loaded = load_text(&text);
        assert!(summary(&loaded).contains(&format!("height = alt [{unit}]")), "{}", summary(&loaded));
        assert!((height(&loaded)[0] - truth(-LATE_S).0[2]).abs() < 0.51, "{unit}");
    }
    // From u-blox: integers of 1e-7 deg and mm, without a vertical velocity.
    let ublox = table("iTOW,lat,lon,hMSL,velN,velE", |t, [a, b, h], [n, e, _]| {
        let (lat, lon) = (1e7 * deg(a), 1e7 * deg(b));
        format!("{:.0},{lat:.0},{lon:.0},{:.0},{:.0},{:.0}", 1e3 * t, 1e3 * h, 1e3 * n, 1e3 * e)
    });
    let loaded = load_text(&ublox);
    assert!((height(&loaded)[0] - truth(-LATE_S).0[2]).abs() < 0.1, "{}", summary(&loaded));
    let open = table("time,lat,lon,alt,vn,ve", |t, [a, b, h], [n, e, _]| {
        format!("{t:.1},{:.9},{:.9},{:.0},{n:.4},{e:.4}", deg(a), deg(b), 1e3 * h)
    });
    let open = load_text(&open);
    assert!(summary(&open).contains("not bound: alt: its unit is unknown"), "{}", summary(&open));
}

#[test]
fn a_height_that_is_not_bound_is_listed_with_the_reason() {
    let of_header = |header: &str, height: &dyn Fn(f64) -> String| {
        summary(&load_text(&table(header, |t, [a, b, h], [n, e, u]| {
            format!("{t:.1},{:.9},{:.9},{},{n:.4},{e:.4},{:.4}", deg(a), deg(b), height(h), -u)
        })))
    };
    let feet = |h: f64| format!("\"1,{:05.1}\"", h / 0.3048);
    let text = of_header("time,lat,lon,alt [ft],vn,ve,vd", &feet);
    assert!(text.contains("not bound: alt [ft]: no cell is a plain number"), "{text}");
    let two = |h: f64| format!("{:.1},{h:.1}", h / 0.3048);
    let text = of_header("time,lat,lon,baro_alt [ft],gps_alt [m],vn,ve,vd", &two);
    assert!(text.contains("not bound: baro_alt [ft] and gps_alt [m]: by the name not the height of lat"), "{text}");
    assert!(!of_header("time,lat,lon,alt,baro_alt,vn,ve,vd", &two).contains("not bound"));
}

#[test]
fn numbers_in_place_of_missing_values_are_counted_and_not_used() {
    let text = table("time,lat,lon,alt,vn,ve,vd", |t, [a, b, h], [n, e, u]| {
        let row = (10.0 * t).round() as u32;
        let velocity = match row % 100 {
            7 => "999999,999999,999999".to_owned(),
            8 => format!("-9999,{e:.4},{:.4}", -u),
            _ => format!("{n:.4},{e:.4},{:.4}", -u),
        };
        let height = if row % 100 == 20 { "-9999".to_owned() } else { format!("{h:.3}") };
        format!("{t:.1},{:.9},{:.9},{height},{velocity}", deg(a), deg(b))
    });
    let loaded = load_text(&text);
    assert_is_truth(&loaded);
    for reason in [
        "vn is 999999, which stands for a missing value",
        "vn is -9999, which stands for a missing value",
        "alt is -9999, which stands for a missing value",
    ] {
        assert_eq!(count_saying(&loaded, "rejected-row", reason), 9, "{reason}");
    }
    assert_eq!(of(&loaded, Quantity::VelocityNed).series.len(), 900 - 18);
    assert_eq!(of(&loaded, Quantity::PositionGeodetic).series.len(), 900 - 9);
}

#[test]
fn a_speed_without_a_course_is_reported_with_a_way_out() {
    let of_header = |header: &str| {
        let text = table(header, |t, [a, b, _], [n, e, _]| {
            format!("{t:.1},{:.9},{:.9},{:.4},{:.3}", deg(a), deg(b), n.hypot(e), deg(e.atan2(n)))
        });
        summary(&load_text(&text))
    };
    let open = of_header("time,lat,lon,speed,heading");
    assert!(open.contains("not bound: speed and heading: heading may be where the nose points"), "{open}");
    assert!(!of_header("time,lat,lon,speed,course").contains("not bound"));
    assert!(of_header("time,lat,lon,speed,odometer").contains("not bound: speed: a speed without a course"));
}

#[test]
fn times_and_positions_in_other_writing_are_refused_with_a_way_out() {
    let refusal = |header: &str, time: &dyn Fn(f64) -> String, letters: [&str; 2]| {
        let text = table(header, |t, [a, b, _], [n, e, _]| {
            format!("{},{:.9}{},{:.9}{},{n:.4},{e:.4}", time(t), deg(a), letters[0], deg(b), letters[1])
        });
        load_text(&text).binding.unwrap_err()
    };
    let parts = |t: f64| format!("10,{},{:.1}", (t / 60.0 + 1e-6) as i32, t - 60.0 * (t / 60.0 + 1e-6).floor());
    let why = refusal("hour,minute,second,lat,lon,vn,ve", &parts, ["", ""]);
    assert!(why.contains("written in several columns, minute and second among them"), "{why}");
    let excel = |t: f64| format!("{:.9}", 45_000.0 + t / 86_400.0);
    let why = refusal("time,lat,lon,vn,ve", &excel, ["", ""]);
    assert!(why.contains("reads serial days") && why.contains("flightlag maps wide-csv"), "{why}");
    let why = refusal("time,lat,lon,vn,ve", &|t| format!("{t:.1}"), ["N", "E"]);
    assert!(why.contains("lat and lon: no cell is a plain number"), "{why}");
}

#[test]
fn minutes_and_hours_are_read_if_the_table_states_them() {
    for (header, per_s) in [("Time [min]", 60.0), ("Time (h)", 3600.0), ("Time [hours]", 3600.0)] {
        let text = table(&format!("{header},lat,lon,alt,vn,ve,vd"), |t, [a, b, h], [n, e, u]| {
            format!("{:.9},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4}", t / per_s, deg(a), deg(b), -u)
        });
        assert_is_truth(&load_text(&text));
    }
}

#[test]
fn times_that_are_missing_or_shuffled_are_named() {
    let refused = |time: &dyn Fn(i64, f64) -> String| {
        let text = table("time,lat,lon,vn,ve", |t, [a, b, _], [n, e, _]| {
            format!("{},{:.9},{:.9},{n:.4},{e:.4}", time((10.0 * t).round() as i64, t), deg(a), deg(b))
        });
        load_text(&text).binding.unwrap_err()
    };
    let gaps = |row: i64, t: f64| if row % 4 == 0 { String::new() } else { format!("{t:.1}") };
    let why = refused(&gaps);
    assert!(why.contains("225 of the 900 cells of the time time of own are empty"), "{why}");
    let why = refused(&|row, _| format!("{:.1}", 0.1 * (row * 467 % 900) as f64));
    assert!(why.contains("the times time of own are not in order at line 4: sort the rows by time"), "{why}");
}

#[test]
fn names_below_a_line_of_groups_are_pointed_out() {
    let text = table("GPS,,,,INS,,\nTime,Lat,Lon,Alt,Vn,Ve,Vd", |t, [a, b, h], [n, e, u]| {
        format!("{t:.1},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4}", deg(a), deg(b), -u)
    });
    let loaded = load_text(&text);
    let why = loaded.binding.as_ref().unwrap_err();
    assert!(why.contains("line 2 of own names the columns") && why.contains("delete what is above line 2"), "{why}");
    assert_eq!(count_saying(&loaded, "column-renamed", "line 2 names the columns and is not used"), 1);
}

#[test]
fn a_steadily_rising_column_is_the_time_under_an_unknown_name() {
    let text = table("Nr;Zeit;Lat;Lon;Alt;VN;VE;VD", |t, [a, b, h], [n, e, u]| {
        let nr = (10.0 * t).round();
        format!("{nr};{t:.1};{:.9};{:.9};{h:.3};{n:.4};{e:.4};{:.4}", deg(a), deg(b), -u)
    });
    let loaded = load_text(&text);
    assert_is_truth(&loaded);
    let expected = "time = Zeit [s], clock elapsed (no column is named like a time; this one rises steadily)";
    assert!(summary(&loaded).contains(expected), "{}", summary(&loaded));
}

/// The suggested map of a table, and the channels that it yields.
fn suggested(text: &str) -> (String, Loaded) {
    let (_folder, path) = file("bare.csv", text.trim_start().as_bytes());
    let unit = tables(&[path]);
    let map = suggest(&unit);
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("own.toml"), &map).unwrap());
    let loaded = load_mapped(&unit, &library, None).unwrap();
    (map, loaded)
}

#[test]
fn a_meaningless_header_does_not_prevent_a_suggestion() {
    let text = table("A,B,C,D,E,F,G", |t, [a, b, h], [n, e, u]| {
        format!("{t:.1},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4}", deg(a), deg(b), -u)
    });
    assert!(load_text(&text).binding.unwrap_err().contains("`flightlag maps --suggest LOG`"));
    let (map, loaded) = suggested(&text);
    for line in
        ["latitude = { field = \"B\"", "height = { field = \"D\"", "north = { field = \"E\"", "down = { field = \"G\""]
    {
        assert!(map.contains(line), "{line}: {map}");
    }
    assert_eq!(loaded.flight.channels.len(), 2);
}

#[test]
fn columns_without_names_may_be_east_first_and_follow_a_counter() {
    // Far from the equator, where latitude and longitude cannot be exchanged.
    let text = table("", |t, _, [n, e, _]| {
        let [north, east, up] = truth(t - LATE_S).0;
        let latitude = 0.82 + north / 6_369_700.0;
        let longitude = 0.15 + east / (6_389_600.0 * latitude.cos());
        let (lat, lon) = (deg(latitude), deg(longitude));
        format!("{:.0},{t:.1},{:.4},{:.4},{lon:.9},{lat:.9},{up:.3},12.5", 10.0 * t, 3.6 * e, 3.6 * n)
    });
    let (map, _) = suggested(&text);
    for line in [
        "logged = [{ field = \"column_2\", unit = \"s\"",
        "latitude = { field = \"column_6\", unit = \"deg\" }",
        "north = { field = \"column_4\", unit = \"km/h\" }",
        "east = { field = \"column_3\", unit = \"km/h\" }",
    ] {
        assert!(map.contains(line), "{line}: {map}");
    }
}

#[test]
fn nothing_is_guessed_if_a_map_fits() {
    let text = table("time,lat,lon,hMSL,velN,velE,velD,gpsFix", |t, [a, b, h], [n, e, u]| {
        format!("2024-05-10T17:27:{:04.1}Z,{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4},3", t.min(59.9), deg(a), deg(b), -u)
    });
    let loaded = load_text(&text);
    assert_eq!(loaded.binding.as_ref().unwrap().map, "flysight-1");
    assert_eq!(count_of(&loaded, "bound-by-guess"), 0);
}

#[test]
fn names_of_vectornav_tables_are_understood() {
    let header = "TimeStartup [ns],GNSS1::Week,GNSS1::Tow [ns],Ins::PosLla::latitude [deg],Ins::PosLla::longitude [deg],Ins::PosLla::altitude [m],\
                  Ins::PosEcef::X [m],Ins::PosEcef::Y [m],Ins::PosEcef::Z [m],Ins::VelNed::N [m/s],Ins::VelNed::E [m/s],Ins::VelNed::D [m/s],Ins::PosU [m]";
    let text = table(header, |t, [a, b, h], [n, e, u]| {
        let ns = (1e9 * t).round() as i64;
        let (a, b) = (deg(a), deg(b));
        format!("{ns},2300,{},{a:.9},{b:.9},{h:.3},1,2,3,{n:.4},{e:.4},{:.4},0.5", ns + 100_000_000_000, -u)
    });
    let loaded = load_text(&text);
    assert_is_truth(&loaded);
    assert_eq!(loaded.flight.channels.keys().collect::<Vec<_>>(), ["position.ins", "velocity.ins"]);
    assert_eq!(loaded.flight.channels["velocity.ins"].series.timeline().clock(), flight::Clock::Gps);
}

#[test]
fn a_table_without_a_header_gets_a_suggested_map_from_motion_alone() {
    let text = table("", |t, [a, b, h], [n, e, u]| {
        format!("{t:.1},{:.2},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4},7", 0.1 * (3.0 * t).sin(), deg(a), deg(b), -u)
    });
    let (_folder, path) = file("bare.csv", text.trim_start().as_bytes());
    let unit = tables(&[path]);
    // The message starts with what to do.
    let refused = load_text(text.trim_start()).binding.unwrap_err();
    let what_to_do = "no channel map fits, and its columns cannot be bound by guess: the table has no header; `flightlag maps --suggest LOG`";
    assert!(refused.starts_with(what_to_do), "{refused}");
    let map = suggest(&unit);
    for line in [
        "topic = [\"bare\"]",
        "latitude = { field = \"column_3\", unit = \"deg\" }",
        "height = { field = \"column_5\", unit = \"m\" }",
        "north = { field = \"column_6\", unit = \"m/s\" }",
        "down = { field = \"column_8\", unit = \"m/s\" }",
    ] {
        assert!(map.contains(line), "{line}: {map}");
    }
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("own.toml"), &map).unwrap());
    let loaded = load_mapped(&unit, &library, None).unwrap();
    assert_eq!(loaded.flight.channels.len(), 2);
    assert_eq!(loaded.flight.channels["velocity.gps"].series.components()[0][0], 18.0);
}

const G: f64 = 9.806_65;

/// The true attitude, in coordinated flight: roll, pitch and yaw, rad.
fn attitude(t: f64) -> [f64; 3] {
    let course = |t: f64| truth(t).1[1].atan2(truth(t).1[0]);
    let [north, east, up] = truth(t).1;
    let turn = (course(t + 1e-4) - course(t - 1e-4) + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
        - std::f64::consts::PI;
    let speed = north.hypot(east);
    [(speed * turn / 2e-4 / G).atan(), up.atan2(speed), course(t)]
}

/// From forward, right, down to north, east, down.
fn turned([roll, pitch, yaw]: [f64; 3]) -> [[f64; 3]; 3] {
    let ([(sr, cr), (sp, cp), (sy, cy)], row) = ([roll, pitch, yaw].map(f64::sin_cos), |a, b, c| [a, b, c]);
    [
        row(cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy),
        row(cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy),
        row(-sp, sr * cp, cr * cp),
    ]
}

/// What a gyroscope and an accelerometer measure about and along forward, right, down, rad/s and m/s^2.
fn imu(t: f64) -> ([f64; 3], [f64; 3]) {
    let ([roll, pitch, _], d) = (attitude(t), 1e-3);
    let wrap = |a: f64| (a + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
    let rate = |i: usize| wrap(attitude(t + d)[i] - attitude(t - d)[i]) / (2.0 * d);
    let (droll, dpitch, dyaw) = (rate(0), rate(1), rate(2));
    let rates = [
        droll - dyaw * pitch.sin(),
        dpitch * roll.cos() + dyaw * pitch.cos() * roll.sin(),
        dyaw * pitch.cos() * roll.cos() - dpitch * roll.sin(),
    ];
    let (a, b) = (truth(t + d).1, truth(t - d).1);
    let [north, east, up] = [0, 1, 2].map(|i| (a[i] - b[i]) / (2.0 * d));
    // Against gravity, which an accelerometer does not feel.
    let (force, axes) = ([north, east, -up - G], turned(attitude(t)));
    (rates, [0, 1, 2].map(|i| (0..3).map(|j| axes[j][i] * force[j]).sum()))
}

/// A position and a velocity, plus the columns that `row` computes from a time.
fn with_body(header: &str, row: impl Fn(f64) -> Vec<f64>) -> Loaded {
    let text = table(&format!("time,lat,lon,alt,vn,ve,vd,{header}"), |t, [a, b, h], [n, e, u]| {
        let more: Vec<String> = row(t).iter().map(|value| format!("{value:.6}")).collect();
        format!("{t:.1},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4},{}", deg(a), deg(b), -u, more.join(","))
    });
    load_text(&text)
}

/// Attitude, rates and forces are the truth about and along forward, right, down.
fn assert_body_is_truth(loaded: &Loaded) {
    assert_is_truth(loaded);
    let of = |quantity| {
        let series = &of(loaded, quantity).series;
        (series.timeline().seconds_since(series.timeline().stamps()[0]), series.components().to_vec())
    };
    let (times, q) = of(Quantity::Attitude);
    let ((_, rates), (_, forces)) = (of(Quantity::AngularRate), of(Quantity::SpecificForce));
    for (i, t) in times.iter().enumerate().step_by(61) {
        let axes = turned(attitude(*t));
        let [w, x, y, z] = [0, 1, 2, 3].map(|axis: usize| q[axis][i]);
        let nose = [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)];
        let right = [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)];
        for axis in 0..3 {
            assert!((nose[axis] - axes[axis][0]).abs() < 1e-5, "{t} s: nose {nose:?}");
            assert!((right[axis] - axes[axis][1]).abs() < 1e-5, "{t} s: right {right:?}");
            assert!((rates[axis][i] - imu(*t).0[axis]).abs() < 1e-4, "{t} s: rate {axis}");
            assert!((forces[axis][i] - imu(*t).1[axis]).abs() < 1e-3, "{t} s: force {axis}");
        }
    }
}

#[test]
fn attitude_rates_and_forces_under_usual_names_are_the_same_flight() {
    let flu = |[x, y, z]: [f64; 3]| [x, -y, -z];
    assert_body_is_truth(&with_body("roll,pitch,yaw,p,q,r,ax,ay,az", |t| {
        [attitude(t).map(deg), imu(t).0.map(deg), imu(t).1].concat()
    }));
    assert_body_is_truth(&with_body("roll_rad,pitch_rad,heading_rad,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", |t| {
        [attitude(t), flu(imu(t).0), flu(imu(t).1.map(|f| f / G))].concat()
    }));
    // Unlabelled radians, yaw anticlockwise from east and pitch nose-down, as in ROS.
    assert_body_is_truth(&with_body(
        "roll,pitch,yaw,gyro_x_dps,gyro_y_dps,gyro_z_dps,AccelX [g],AccelY [g],AccelZ [g]",
        |t| {
            let [roll, pitch, yaw] = attitude(t);
            let enu = [roll, -pitch, std::f64::consts::FRAC_PI_2 - yaw];
            [enu, imu(t).0.map(deg), imu(t).1.map(|f| f / G)].concat()
        },
    ));
    let headed = with_body("roll,pitch,heading,rollrate,pitchrate,yawrate,accx,accy,accz", |t| {
        let [roll, pitch, yaw] = attitude(t).map(deg);
        [[roll, pitch, yaw.rem_euclid(360.0)], imu(t).0, imu(t).1].concat()
    });
    assert_body_is_truth(&headed);
    assert_eq!(count_of(&headed, "bound-by-guess"), 5);
}

#[test]
fn a_suggested_map_has_attitude_rates_and_forces_with_reasons() {
    let header = "time,lat,lon,alt,vn,ve,vd,roll,pitch,yaw,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z";
    let text = table(header, |t, [a, b, h], [n, e, u]| {
        let more: Vec<String> =
            [attitude(t).map(deg), imu(t).0, imu(t).1].concat().iter().map(|value| format!("{value:.6}")).collect();
        format!("{t:.1},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4},{}", deg(a), deg(b), -u, more.join(","))
    });
    let (_folder, path) = file("own.csv", text.as_bytes());
    let unit = tables(&[path]);
    let map = suggest(&unit);
    for line in [
        "name = \"attitude.ins\"",
        "frame = \"frd-ned\"",
        "yaw = { field = \"yaw\", unit = \"deg\" }",
        "yaw agrees with the course of the velocity to 1.000 if it counts clockwise from north",
        "name = \"angular-rate.imu\"",
        "z = { field = \"gyro_z\", unit = \"rad/s\" }",
        "they agree with the turns of yaw",
        "name = \"specific-force.imu\"",
        "x = { field = \"acc_x\", unit = \"m/s^2\" }",
        "x forward and z down follow gravity in the attitude of yaw",
    ] {
        assert!(map.contains(line), "{line}: {map}");
    }
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("own.toml"), &map).unwrap());
    let mapped = load_mapped(&unit, &library, None).unwrap();
    assert_eq!((mapped.binding.as_ref().unwrap().map.as_str(), mapped.flight.channels.len()), ("own", 5));
    assert_eq!(count_of(&mapped, "bound-by-guess"), 0);
}

#[test]
fn attitude_rates_or_forces_that_motion_contradicts_are_rejected() {
    let body = |turn: fn([f64; 3]) -> [f64; 3], rate: fn([f64; 3]) -> [f64; 3], force: fn([f64; 3]) -> [f64; 3]| {
        let loaded = with_body("roll,pitch,yaw,p,q,r,ax,ay,az", |t| {
            let (rates, forces) = imu(t);
            [turn(attitude(t)).map(deg), rate(rates).map(deg), force(forces)].concat()
        });
        let summary = loaded.flight.notices.iter().find(|n| n.code == "bound-by-guess").unwrap().text.clone();
        (loaded.flight.channels.keys().cloned().collect::<Vec<_>>().join(" "), summary)
    };
    let same = |v| v;
    let (channels, summary) = body(|[roll, pitch, yaw]| [roll, pitch, yaw + std::f64::consts::PI], same, same);
    assert!(!channels.contains("attitude") && summary.contains("yaw stays"), "{channels}: {summary}");
    assert!(summary.contains("180 degrees off the course"), "{summary}");
    let (channels, summary) = body(|[roll, pitch, yaw]| [roll, pitch, -yaw], same, same);
    assert!(!channels.contains("attitude") && summary.contains("anticlockwise from north"), "{channels}: {summary}");
    let (channels, summary) = body(|[roll, pitch, yaw]| [roll, -pitch, yaw], same, same);
    assert!(!channels.contains("attitude") && summary.contains("pitch has the opposite sign"), "{channels}: {summary}");
    let (channels, summary) = body(same, |rates| rates.map(|rate| 7.0 * rate), same);
    assert!(
        !channels.contains("rate") && summary.contains("times as fast as the attitude turns"),
        "{channels}: {summary}"
    );
    let (channels, summary) = body(same, |[p, q, r]| [p, q, -r], same);
    assert!(
        !channels.contains("rate") && summary.contains("p, q and r: they do not fit the changes of yaw"),
        "{channels}: {summary}"
    );
    let (channels, summary) = body(same, same, |[x, y, z]| [x, y, z + G]);
    assert!(!channels.contains("force") && summary.contains("gravity may have been removed"), "{channels}: {summary}");
    let (channels, summary) = body(same, same, |forces| forces.map(|f| -f));
    assert!(!channels.contains("force") && summary.contains("along gravity"), "{channels}: {summary}");
}

/// Repeatable noise of this amplitude.
fn noise(t: f64, seed: f64, amplitude: f64) -> f64 {
    let x = ((t * 1e3).round() * 12.9898 + seed * 78.233).sin() * 43_758.545_3;
    amplitude * 2.0 * (x - x.floor() - 0.5)
}

#[test]
fn noise_and_a_late_attitude_do_not_change_what_is_bound() {
    let loaded = with_body("roll,pitch,yaw,p,q,r,ax,ay,az", |t| {
        let (rates, forces) = imu(t);
        let noisy =
            |values: [f64; 3], amplitude: f64| [0, 1, 2].map(|i| values[i] + noise(t, i as f64 + amplitude, amplitude));
        [noisy(attitude(t - 0.25).map(deg), 0.5), noisy(rates, 0.1), noisy(forces, 2.0)].concat()
    });
    let fields = |quantity| {
        let binding = loaded.binding.as_ref().unwrap();
        let name = loaded.flight.channels.iter().find(|(_, c)| c.quantity == quantity).unwrap().0;
        binding.channels.iter().find(|c| c.name == *name).unwrap().source.fields.join(" ")
    };
    assert_eq!(fields(Quantity::Attitude), "roll [deg] pitch [deg] yaw [deg]");
    assert_eq!(fields(Quantity::AngularRate), "p [rad/s] q [rad/s] r [rad/s]");
    assert_eq!(fields(Quantity::SpecificForce), "ax [m/s^2] ay [m/s^2] az [m/s^2]");
}

#[test]
fn an_imu_in_a_separate_table_is_bound_by_the_attitude_of_another() {
    let nav = table("time,lat,lon,alt,vn,ve,vd,roll,pitch,yaw", |t, [a, b, h], [n, e, u]| {
        let [roll, pitch, yaw] = attitude(t).map(deg);
        format!("{t:.1},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4},{roll:.5},{pitch:.5},{yaw:.5}", deg(a), deg(b), -u)
    });
    let rows = (0..4500).map(|i| 0.02 * f64::from(i)).map(|t| {
        let values: Vec<String> = [imu(t).0, imu(t).1].concat().iter().map(|value| format!("{value:.6}")).collect();
        format!("{t:.2},{}\n", values.join(","))
    });
    let imu = format!("time,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z\n{}", rows.collect::<String>());
    let folder = tempfile::tempdir().unwrap();
    let paths = [("nav.csv", nav), ("imu.csv", imu)].map(|(name, text)| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    });
    let loaded = load(&tables(&paths)).unwrap();
    let of = |quantity| &of(&loaded, quantity).source.topic;
    assert!(of(Quantity::AngularRate).contains("imu") && of(Quantity::Attitude).contains("nav"));
    assert!(of(Quantity::SpecificForce).contains("imu"));
}

#[test]
fn a_path_too_straight_to_identify_yaw_is_reported() {
    let text = table("time,lat,lon,vn,ve,roll,pitch,yaw", |t, _, _| {
        format!(
            "{t:.1},{:.9},{:.9},7,7,1,2,45.0",
            4.0 + deg(7.0 * t / 6_335_439.3),
            20.0 + deg(7.0 * t / (SCALE * 4_f64.to_radians().cos()))
        )
    });
    let loaded = load_text(&text);
    let summary = &loaded.flight.notices.iter().find(|n| n.code == "bound-by-guess").unwrap().text;
    assert!(summary.contains("roll, pitch and yaw: the path is too straight to decide"), "{summary}");
    assert!(loaded.flight.channels.values().all(|channel| channel.quantity != Quantity::Attitude));
}

/// Names that are those of a bench's table except for position and velocity.
#[test]
fn a_flight_whose_attitude_is_named_as_on_the_bench_is_bound_by_guess() {
    let header = "time_s,lat_deg,lon_deg,alt_m,vel_north_mps,vel_east_mps,vel_down_mps,roll_deg,pitch_deg,yaw_deg";
    let text = table(header, |t, [a, b, h], [n, e, u]| {
        format!("{t:.2},{:.9},{:.9},{h:.3},{n:.4},{e:.4},{:.4},0.5,1.0,{:.3}", deg(a), deg(b), -u, t % 360.0)
    });
    let loaded = load_text(&text);
    assert_eq!(loaded.binding.as_ref().unwrap().map, "guess");
    assert!(loaded.flight.channels.contains_key("position.gps") && loaded.flight.channels.contains_key("velocity.gps"));
}
