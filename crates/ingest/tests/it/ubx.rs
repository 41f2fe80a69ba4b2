//! UBX: a simulated flight, frames of pyubx2, and all kinds of damage.

use crate::stream::*;
use crate::support::*;
use crate::wire::ubx_frame;
use flight::{Clock, Geodetic, LocalFrame, Stamp, StampKind, gps_of_unix, unix_of_gps};
use ingest::LogKind;
use simulate::Container;

const READER: ingest::LogKind = ingest::LogKind::Ubx;

/// NAV-TIMEGPS, NAV-PVT, HNR-PVT, NAV-HPPOSLLH and NAV-VELNED as pyubx2 1.4.0 writes them.
fn of_pyubx2() -> Vec<u8> {
    bytes_of(
        "b56201201000c85679212efbffff8d09120714000000d3cdb56201075c00c8567921ea070b150b3b2a0714000000d2c6eb0b0301\
         001144f417054c52401c532a0800bb720700dc050000c40900002efbffff2e160000a6ffffffb316000050099c002c010000f049\
         020078000000000000000000000000000000bcafb56228004800e9567921ea070b150b3b2a071251e30d040100004ef417055652\
         401c542a0800bc720700b4160000b5160000370d9c0070e09a00dd050000c50900002d010000f049020000000000be94b5620114\
         240000000000c856792145f417054d52401c532a0800bb7207000000000078050000dc05000058aab56201122400c856792185ff\
         ffff37020000f7ffffff450200004402000050099c001e000000f0490200798b",
    )
}

#[test]
fn a_simulated_flight_survives_within_the_resolution_of_its_frames() {
    let flight = flight(20.0, 50.0);
    let truth = flight.to_flight().unwrap();
    for name in ["flight.ubx", "flight.log"] {
        let loaded = load_written(Container::Ubx, &flight, name, LogKind::Ubx, "ubx");
        let channel = |name: &str| &loaded.flight.channels[name];
        let timeline = channel("position.posllh").series.timeline();
        assert_eq!((timeline.kind(), timeline.clock()), (StampKind::Measured, Clock::Gps));
        let to_utc = |ns| unix_of_gps(Stamp(ns)).unwrap().0;
        let (position, late) = worst(channel("position.posllh"), &truth.channels["position.gps"], to_utc);
        let half = 0.5001e-7_f64.to_radians();
        assert!(position[0] > 0.0 && position[0] <= half && position[1] <= half, "{position:?}");
        assert!(position[2] > 0.0 && position[2] <= 0.000_500_1 && late <= 500_000, "{position:?} {late}");
        let (velocity, late) = worst(channel("velocity.velned"), &truth.channels["velocity.gps"], to_utc);
        assert!(velocity.iter().all(|v| *v > 0.0 && *v <= 0.005_001) && late <= 500_000, "{velocity:?} {late}");
        assert_eq!(loaded.health.about.receivers, ["u-blox HW 00080000, SW SIM CORE 1.00, MOD=SIMULATED"]);
        assert!(loaded.health.topics.iter().all(|t| t.stamps.iter().all(|s| s.kind == StampKind::Measured)));
    }
}

#[test]
fn pyubx2_frames_decode_to_the_values_given_to_it() {
    let log = read_bytes(READER, &of_pyubx2()).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.decoded), (5, of_pyubx2().len() as u64));
    let all = |topic: &str, expected: &[(&str, f64)]| {
        for (field, value) in expected {
            assert_eq!(values(&log, topic, field), [Some(*value)], "{topic}.{field}");
        }
    };
    all("NAV-TIMEGPS", &[("fTOW", -1234.0), ("week", 2445.0), ("leapS", 18.0), ("valid", 7.0)]);
    all("NAV-PVT", &[("iTOW", 561_600_200.0), ("year", 2026.0), ("sec", 42.0), ("nano", 200_001_234.0)]);
    all("NAV-PVT", &[("gps_week", 2445.0), ("fix_ok", 1.0), ("fixType", 3.0), ("numSV", 17.0), ("pDOP", 120.0)]);
    all("NAV-PVT", &[("lon", 85_455_940.0), ("lat", 473_977_420.0), ("height", 535_123.0), ("hMSL", 488_123.0)]);
    all("NAV-PVT", &[("velN", -1234.0), ("velE", 5678.0), ("velD", -90.0), ("headMot", 10_226_000.0)]);
    all("NAV-PVT", &[("hAcc", 1500.0), ("vAcc", 2500.0), ("sAcc", 300.0), ("headAcc", 150_000.0)]);
    all("HNR-PVT", &[("gps_week", 2445.0), ("fix_ok", 1.0), ("gpsFix", 4.0), ("lat", 473_977_430.0)]);
    all("HNR-PVT", &[("gSpeed", 5812.0), ("speed", 5813.0), ("headVeh", 10_150_000.0), ("sAcc", 301.0)]);
    all("NAV-HPPOSLLH", &[("latitude", 47.397_742_1), ("longitude", 8.545_594_1), ("ellipsoid_height", 535.123)]);
    all("NAV-VELNED", &[("velN", -123.0), ("velE", 567.0), ("velD", -9.0), ("sAcc", 30.0), ("cAcc", 150_000.0)]);
    assert!(log.tables.iter().all(|t| t.logged_ns.is_none()));
}

#[test]
fn position_and_velocity_of_one_solution_are_bound_by_name_and_unit() {
    let pvt = |epoch: u32| {
        let mut payload = [&(561_600_000 + 200 * epoch).to_le_bytes()[..], &2026_u16.to_le_bytes()].concat();
        payload.extend([11, 21, 11, 59, 42 + (epoch / 5) as u8, 7]);
        payload.resize(92, 0);
        payload[20] = if epoch == 7 { 2 } else { 3 };
        payload[21] = u8::from(epoch != 8);
        payload[24..28].copy_from_slice(&85_455_940_i32.to_le_bytes());
        payload[28..32].copy_from_slice(&(473_977_420 + epoch as i32).to_le_bytes());
        payload[32..36].copy_from_slice(&535_123_i32.to_le_bytes());
        payload[48..52].copy_from_slice(&(-1234_i32).to_le_bytes());
        ubx_frame(1, 7, &payload)
    };
    let bytes: Vec<u8> = (0..20).flat_map(pvt).collect();
    let (_folder, path) = file("f.ubx", &bytes);
    let unit = ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::Ubx };
    let loaded = load(&unit).unwrap();
    assert_ledger(&loaded);
    let position = &loaded.flight.channels["position.gps"].series;
    // One epoch has a 2D fix, one the receiver does not trust.
    assert_eq!((position.len(), loaded.flight.channels["velocity.gps"].series.len()), (18, 18));
    assert_eq!(position.component(0)[0], 47.397_742_f64.to_radians());
    assert_eq!(
        (position.component(2)[0], loaded.flight.channels["velocity.gps"].series.component(0)[0]),
        (535.123, -1.234)
    );
    // date -u -d '2026-11-21T11:59:42Z' +%s
    assert_eq!(gps_of_unix(Stamp(1_795_262_382_000_000_000)), position.timeline().first());
}

/// NAV-POSLLH and NAV-VELNED of ten epochs, the sixth of which is the first of GPS week 2446, each followed by `extra` frames.
fn around_sunday(extra: impl Fn(u32, u32) -> Vec<u8>) -> Vec<u8> {
    let epoch = |n: u32| {
        let itow_ms = (604_799_000 + 200 * n) % 604_800_000;
        let front = itow_ms.to_le_bytes();
        let place = [85_455_940, 473_977_420 + n as i32, 535_123, 488_123, 1500, 2500].map(i32::to_le_bytes).concat();
        let velocity = [123, 4, 5, 126, 124, 300_000, 30, 1].map(i32::to_le_bytes).concat();
        let frames =
            [(2, place), (0x12, velocity)].map(|(number, rest)| ubx_frame(1, number, &[&front[..], &rest].concat()));
        [frames.concat(), extra(n, itow_ms)].concat()
    };
    (0..10).flat_map(epoch).collect()
}

#[test]
fn epochs_without_a_fix_by_another_message_are_rejected_and_counted() {
    let sol = |itow_ms: u32, fix: u8, ok: u8| {
        let front = [&itow_ms.to_le_bytes()[..], &[0; 4], &2445_u16.to_le_bytes(), &[fix, 0xc | ok]].concat();
        ubx_frame(1, 6, &[&front[..], &[0; 40]].concat())
    };
    let status = |itow_ms: u32, fix: u8, ok: u8| {
        ubx_frame(1, 3, &[&itow_ms.to_le_bytes()[..], &[fix, ok, 0, 0], &[0; 8]].concat())
    };
    // Epochs without a fix, with a bad one, with a 2D one; the last has no fix information.
    let say = |n: u32, itow_ms: u32| match n {
        0 => sol(itow_ms, 0, 0),
        1 => status(itow_ms, 3, 0),
        2 => sol(itow_ms, 2, 1),
        9 => vec![],
        _ => [sol(itow_ms, 3, 1), status(itow_ms, 3, 1)].concat(),
    };
    let loaded = load_ubx(&around_sunday(say));
    for name in ["position.posllh", "velocity.velned"] {
        assert_eq!(loaded.flight.channels[name].series.len(), 7, "{name}");
        let health = loaded.binding.as_ref().unwrap().channels.iter().find(|c| c.name == name).unwrap();
        let reasons: Vec<(&str, u64)> = health.rejected.iter().map(|r| (r.reason.as_str(), r.count)).collect();
        assert_eq!(
            reasons,
            [
                ("NAV-SOL of the same epoch: fix_ok is below 1", 1),
                ("NAV-STATUS of the same epoch: fix_ok is below 1", 1),
                ("NAV-SOL of the same epoch: gpsFix is below 3 or gpsFix is above 4", 1),
            ]
        );
    }
}

#[test]
fn an_epoch_of_another_week_does_not_affect_this_one() {
    // Three epochs at the start of a week, and the same a week later. The first two have no fix, and the last.
    let without_fix = |telling: &dyn Fn(u16, u32, u8) -> Vec<u8>| {
        let epoch = |n: u16| {
            let itow_ms = 1000 + 200 * u32::from(n % 3);
            let rest = [85_455_940, 473_977_420, 535_123, 488_123, 1500, 2500].map(i32::to_le_bytes).concat();
            let place = ubx_frame(1, 2, &[&itow_ms.to_le_bytes()[..], &rest].concat());
            [telling(2445 + n / 3, itow_ms, if matches!(n, 0 | 1 | 5) { 0 } else { 3 }), place].concat()
        };
        let loaded = load_ubx(&(0..6).flat_map(epoch).collect::<Vec<u8>>());
        let rejected = &loaded.binding.as_ref().unwrap().channels.iter().find(|c| c.name == "position.posllh").unwrap();
        let said = rejected.rejected.iter().filter(|r| r.reason.contains("of the same epoch"));
        said.map(|r| r.count).sum::<u64>()
    };
    let sol = |week: u16, itow_ms: u32, fix: u8| {
        let front = [&itow_ms.to_le_bytes()[..], &[0; 4], &week.to_le_bytes(), &[fix, 0xd]].concat();
        ubx_frame(1, 6, &[&front[..], &[0; 40]].concat())
    };
    assert_eq!(without_fix(&sol), 3);
    // If the week is unknown, a time of week counts only if all epochs with it have a fix.
    let status =
        |_, itow_ms: u32, fix: u8| ubx_frame(1, 3, &[&itow_ms.to_le_bytes()[..], &[fix, 1, 0, 0], &[0; 8]].concat());
    assert_eq!(without_fix(&|week, itow_ms, fix| status(week, itow_ms, if itow_ms == 1400 { 3 } else { fix })), 4);
}

/// ECEF position and velocity, and velocity north, east, down, cm and cm/s: from the positions half a second
/// before and after, so independent of the reader's rotation.
fn in_axes_of_the_earth(at: Geodetic, ned: [f64; 3]) -> [[i32; 3]; 2] {
    let frame = LocalFrame::new(at);
    let [a, b] = [-0.5, 0.5].map(|s| frame.to_geodetic(ned.map(|v| s * v)).to_ecef());
    let (place, velocity) = (at.to_ecef(), [b.x - a.x, b.y - a.y, b.z - a.z]);
    [[place.x, place.y, place.z], velocity].map(|v| v.map(|v| (100.0 * v).round() as i32))
}

#[test]
fn ecef_position_and_velocity_are_bound_as_geodetic_and_ned() {
    let truth = |n: u32| {
        let at = Geodetic::from_degrees(-33.9 + 1e-4 * f64::from(n), 151.2, 120.0);
        (at, [12.0, -3.5 + f64::from(n), 1.25])
    };
    let sol = |n: u32| {
        let ([place, velocity], accuracy) = (in_axes_of_the_earth(truth(n).0, truth(n).1), 300_u32.to_le_bytes());
        let bytes = |v: [i32; 3]| v.map(i32::to_le_bytes).concat();
        let itow = (1000 + 200 * n).to_le_bytes();
        // The last one has no fix, and a position at the centre of the earth.
        let (fix, place) = if n == 10 { (0, [0; 3]) } else { (3, place) };
        let front = [&itow[..], &[0; 4], &1850_u16.to_le_bytes(), &[fix, 0xd]].concat();
        let rest = [&bytes(place)[..], &accuracy, &bytes(velocity), &accuracy, &[0; 3], &[9], &[0; 4]].concat();
        let split = [
            ubx_frame(1, 1, &[&itow[..], &bytes(place), &accuracy].concat()),
            ubx_frame(1, 0x11, &[&itow[..], &bytes(velocity), &accuracy].concat()),
        ];
        (ubx_frame(1, 6, &[front, rest].concat()), split.concat())
    };
    let together = load_ubx(&(0..=10).flat_map(|n| sol(n).0).collect::<Vec<u8>>());
    let apart = load_ubx(&(0..10).flat_map(|n| sol(n).1).collect::<Vec<u8>>());
    for (loaded, name) in [(&together, "position.sol"), (&apart, "position.posecef")] {
        let series = &loaded.flight.channels[name].series;
        assert_eq!(series.len(), 10, "{name}");
        for n in 0..10 {
            let (at, _) = truth(n as u32);
            let off = [0, 1, 2].map(|i| series.component(i)[n]);
            // Half a centimetre along each axis.
            assert!((off[0] - at.latitude).abs() < 0.0087 / 6.3e6 && (off[1] - at.longitude).abs() < 0.0087 / 5.2e6);
            assert!((off[2] - at.height).abs() < 0.0087, "{off:?}");
        }
    }
    for loaded in [&together, &apart] {
        let velocity = &loaded.flight.channels["velocity.sol"].series;
        assert_eq!(velocity.len(), 10);
        for n in 0..10 {
            let off = [0, 1, 2].map(|i| velocity.component(i)[n] - truth(n as u32).1[i]);
            assert!(off.iter().all(|off| off.abs() < 0.0088), "{off:?}");
        }
        assert_eq!(loaded.flight.channels["speed-accuracy.sol"].series.component(0)[0], 3.0);
        assert_eq!(count_saying(loaded, "rejected-row", "earth-fixed axes"), 0);
    }
}

#[test]
fn an_ecef_velocity_is_rotated_at_a_nearby_position_or_dropped() {
    let at = Geodetic::from_degrees(47.4, 8.5, 500.0);
    let [_, velocity] = in_axes_of_the_earth(at, [20.0, -5.0, 1.0]);
    let accuracy = 300_u32.to_le_bytes();
    let place = |ms: u32| {
        let [lon, lat, height] = [85_000_000_i32, 474_000_000, 500_000].map(i32::to_le_bytes);
        ubx_frame(1, 2, &[&ms.to_le_bytes()[..], &lon, &lat, &height, &height, &accuracy, &accuracy].concat())
    };
    let velocity = |ms: u32| {
        let bytes = velocity.map(i32::to_le_bytes).concat();
        ubx_frame(1, 0x11, &[&ms.to_le_bytes()[..], &bytes, &accuracy].concat())
    };
    // One position, then velocities for 20 s: it serves those of the first ten. The very first came before it.
    let log: Vec<u8> =
        [velocity(0), place(1000)].into_iter().chain((1..=20).map(|s| velocity(1000 * s))).flatten().collect();
    let loaded = load_ubx(&log);
    let series = &loaded.flight.channels["velocity.sol"].series;
    assert_eq!((series.len(), count_saying(&loaded, "rejected-row", "earth-fixed axes")), (11, 10));
    let off = [20.0, -5.0, 1.0].iter().zip([0, 1, 2]).map(|(truth, i)| (series.component(i)[0] - truth).abs());
    assert!(off.into_iter().all(|off| off < 0.0088), "{series:?}");
}

#[test]
fn an_invalid_or_inaccurate_position_rotates_no_velocity() {
    let at = Geodetic::from_degrees(47.4, 8.5, 500.0);
    let [place, velocity] = in_axes_of_the_earth(at, [20.0, -5.0, 1.0]);
    let bytes = |v: [i32; 3]| v.map(i32::to_le_bytes).concat();
    let itow = 1000_u32.to_le_bytes();
    let turned = |place: Vec<u8>| {
        let velocity = |n: u32| {
            let itow = (1000 + 200 * n).to_le_bytes();
            ubx_frame(1, 0x11, &[&itow[..], &bytes(velocity), &300_u32.to_le_bytes()].concat())
        };
        let loaded = load_ubx(&[place, (0..20).flat_map(velocity).collect()].concat());
        let rows = loaded.flight.channels.get("velocity.sol").map_or(0, |channel| channel.series.len());
        assert_eq!(rows as u64 + count_saying(&loaded, "rejected-row", "earth-fixed axes"), 20);
        rows > 0
    };
    // Accuracies in cm, tenths of mm and mm: just better than 10 km, and 10 km.
    let ecef = |accuracy: u32| ubx_frame(1, 1, &[&itow[..], &bytes(place), &accuracy.to_le_bytes()].concat());
    let precise = |flags: u8, accuracy: u32| {
        let front = [&[0; 4][..], &itow, &bytes(place), &[0, 0, 0, flags]].concat();
        ubx_frame(1, 0x13, &[front, accuracy.to_le_bytes().to_vec()].concat())
    };
    let geodetic = |accuracy: u32| {
        let [lon, lat, height] = [85_000_000_i32, 474_000_000, 500_000].map(i32::to_le_bytes);
        let accuracy = accuracy.to_le_bytes();
        ubx_frame(1, 2, &[&itow[..], &lon, &lat, &height, &height, &accuracy, &accuracy].concat())
    };
    assert_eq!([999_999, 1_000_000, u32::MAX].map(|cm| turned(ecef(cm))), [true, false, false]);
    assert_eq!([99_999_999, 100_000_000].map(|tenths_mm| turned(precise(0, tenths_mm))), [true, false]);
    assert!(!turned(precise(1, 300)));
    assert_eq!([9_999_999, 10_000_000].map(|mm| turned(geodetic(mm))), [true, false]);
}

/// NAV-PVAT, ESF-INS and NAV2-PVT as pyubx2 1.4.0 writes them; it cuts off, where its floats lack a little, what is below one.
fn of_pyubx2_with_attitude() -> Vec<u8> {
    bytes_of(
        "b56201177400c85679210007ea070b150b3b2a00000014000000d2c6eb0b0439001144f417054c52401c532a0800bb720700dc05\
         0000c40900002efbffff2e160000a6ffffffb31600002c01000010b6fdffe76e030070e09a0050099c0032004b007d00fa003200\
         c611400600004c04000000000000000000000194b56210152400013f000000000000c85679212efbffff290900006db200000c00\
         0000a7feffff43000000abcbb56229075c00c8567921ea070b150b3b2a0300000000000000000301000f45f417054d52401ca02a\
         080008730700c4090000ac0d000050fbffffe0150000ceffffff5f160000cfca9b00f4010000e093040082000000000000000000\
         000000000000a585",
    )
}

#[test]
fn frames_of_inertial_receivers_decode_to_the_values_given_to_pyubx2() {
    let bytes = of_pyubx2_with_attitude();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.decoded), (3, bytes.len() as u64));
    let all = |topic: &str, expected: &[(&str, f64)]| {
        for (field, value) in expected {
            assert_eq!(values(&log, topic, field), [Some(*value)], "{topic}.{field}");
        }
    };
    all("NAV-PVAT", &[("gps_week", 2445.0), ("fix_ok", 1.0), ("iTOW", 561_600_200.0), ("sec", 42.0)]);
    all("NAV-PVAT", &[("nano", 200_001_234.0), ("fixType", 4.0), ("numSV", 17.0), ("lat", 473_977_420.0)]);
    all("NAV-PVAT", &[("velN", -1234.0), ("velD", -90.0), ("sAcc", 300.0), ("vehRoll", -150_000.0)]);
    all("NAV-PVAT", &[("vehPitch", 224_999.0), ("vehHeading", 10_150_000.0), ("motHeading", 10_226_000.0)]);
    all("NAV-PVAT", &[("accRoll", 50.0), ("accPitch", 75.0), ("accHeading", 125.0), ("magDec", 250.0)]);
    all("NAV-PVAT", &[("errEllipseOrient", 4550.0), ("errEllipseMajor", 1600.0), ("errEllipseMinor", 1100.0)]);
    all("ESF-INS", &[("gps_week", 2445.0), ("fix_ok", 1.0), ("iTOW", 561_600_200.0), ("xAngRate", -1234.0)]);
    all("ESF-INS", &[("yAngRate", 2345.0), ("zAngRate", 45_677.0), ("xAccel", 12.0), ("zAccel", 67.0)]);
    all("NAV2-PVT", &[("gps_week", 2445.0), ("fix_ok", 1.0), ("fixType", 3.0), ("lon", 85_455_941.0)]);
    all("NAV2-PVT", &[("velE", 5600.0), ("headMot", 10_209_999.0), ("sAcc", 500.0), ("pDOP", 130.0)]);
}

#[test]
fn an_angle_unknown_to_the_receiver_yields_no_attitude() {
    let whole = of_pyubx2_with_attitude();
    let (payload, length) = (&whole[6..6 + 116], 20_u32);
    let epochs = |n: u32| {
        let mut pvat = payload.to_vec();
        pvat[..4].copy_from_slice(&(561_600_000 + 200 * n).to_le_bytes());
        let mut att = [&pvat[..4], &[0; 4]].concat();
        att.extend([-150_000_i32, 225_000, 10_150_000].map(i32::to_le_bytes).concat());
        att.extend([50_000_u32, 75_000, 125_000].map(u32::to_le_bytes).concat());
        if n < 8 {
            // Without its accuracy roll is unknown, as with receivers in cars.
            pvat[88..90].fill(0);
            att[20..24].fill(0);
        }
        [ubx_frame(1, 0x17, &pvat), ubx_frame(1, 5, &att)]
    };
    let only = |which: usize| load_ubx(&(0..length).flat_map(|n| epochs(n)[which].clone()).collect::<Vec<u8>>());
    let [pvat, att] = [only(0), only(1)];
    for loaded in [&pvat, &att] {
        let attitude = &loaded.flight.channels["attitude.ins"].series;
        assert_eq!(attitude.len(), 12);
    }
    // Position and velocity of the same message are always present.
    assert_eq!(["position.gps", "velocity.gps"].map(|name| pvat.flight.channels[name].series.len()), [20; 2]);
}

#[test]
fn a_precise_ecef_position_keeps_all_its_digits() {
    let at = Geodetic::from_degrees(47.397_742_123, 8.545_594_321, 535.123_4);
    let ecef = at.to_ecef();
    let epoch = |n: u32| {
        let tenths = [ecef.x, ecef.y, ecef.z].map(|v| (v * 1e4).round() as i64);
        // Hundredths of a centimetre are between -99 and 99.
        let (whole, fine) = (tenths.map(|v| (v / 100) as i32), tenths.map(|v| (v % 100) as i8 as u8));
        let front = [&[0; 4][..], &(1000 * n).to_le_bytes(), &whole.map(i32::to_le_bytes).concat(), &fine].concat();
        ubx_frame(1, 0x13, &[&front[..], &[u8::from(n == 3)], &150_u32.to_le_bytes()].concat())
    };
    let loaded = load_ubx(&(0..10).flat_map(epoch).collect::<Vec<u8>>());
    let position = &loaded.flight.channels["position.precise-ecef"].series;
    // One is flagged invalid.
    assert_eq!(position.len(), 9);
    assert!((position.component(0)[0] - at.latitude).abs() * 6.4e6 < 1e-4);
    assert!((position.component(1)[0] - at.longitude).abs() * 4.4e6 < 1e-4);
    assert!((position.component(2)[0] - at.height).abs() < 1e-4);
}

#[test]
fn a_precise_position_without_validity_flags_is_used_only_with_a_fix() {
    let epoch = |n: u32| {
        let mut pvt = [&(561_600_000 + 200 * n).to_le_bytes()[..], &2026_u16.to_le_bytes()].concat();
        pvt.extend([11, 21, 11, 59, 42 + (n / 5) as u8, 7]);
        pvt.resize(92, 0);
        // Then with resolved carrier phases, with and without fractions.
        (pvt[20], pvt[21]) = [(0, 0), (3, 1), (3, 1 | 1 << 6), (3, 1 | 2 << 6), (3, 1 | 2 << 6)][n as usize / 4];
        let mut precise =
            [&[0; 4][..], &pvt[..4], &85_455_940_i32.to_le_bytes(), &473_977_420_i32.to_le_bytes()].concat();
        precise.resize(36, 0);
        [ubx_frame(1, 7, &pvt), ubx_frame(1, 0x14, &precise)].concat()
    };
    let loaded = load_ubx(&(0..20).flat_map(epoch).collect::<Vec<u8>>());
    assert_eq!(loaded.flight.channels["position.precise"].series.len(), 16);
    let carrier = loaded.flight.channels["carrier.gps"].series.component(0);
    assert_eq!(carrier, (0..20).map(|n: u8| [0.0, 0.0, 1.0, 2.0, 2.0][usize::from(n) / 4]).collect::<Vec<_>>());
}

#[test]
fn time_marks_before_the_first_pulse_use_its_time_system() {
    let mark = |week: u16, second: u32| {
        let front = [&[0, 0xc8][..], &(second as u16).to_le_bytes(), &week.to_le_bytes(), &[0; 2]].concat();
        ubx_frame(0x0d, 3, &[&front[..], &(561_600_000 + 1000 * second).to_le_bytes(), &[0; 16]].concat())
    };
    let pulse = |week: u16, reference: u8| {
        ubx_frame(
            0x0d,
            1,
            &[&561_605_500_u32.to_le_bytes()[..], &[0; 8], &week.to_le_bytes(), &[0, reference]].concat(),
        )
    };
    // Ten marks, five of them before the pulse: weeks of GPS, of BeiDou and of GLONASS (unknown).
    for (week, reference, first, used) in [(2445, 0, 0, 10), (1089, 2, 14, 10), (2445, 1, 0, 0)] {
        let marks = (0..10).flat_map(|second| {
            let pulse_frame = if second == 5 { pulse(week, reference) } else { vec![] };
            [pulse_frame, mark(week, second)].concat()
        });
        let loaded = load_ubx(&marks.collect::<Vec<u8>>());
        assert_eq!(count_of(&loaded, "undated"), if used == 0 { 11 } else { 0 }, "{:?}", loaded.flight.notices);
        let Some(marks) = loaded.flight.channels.get("pps.time-mark") else {
            assert_eq!(used, 0);
            continue;
        };
        let stamps: Vec<i64> = marks.series.timeline().stamps().iter().map(|stamp| stamp.0 / 1_000_000_000).collect();
        assert_eq!(stamps, (0..10).map(|n| 2445 * 604_800 + 561_600 + n + first).collect::<Vec<_>>(), "{reference}");
    }
}

#[test]
fn pulses_are_in_gps_time_and_those_without_time_are_reported() {
    // An epoch a second from 2026-11-21T11:59:42Z, 561600 s of GPS week 2445, on, and with it a pulse on its second.
    let epochs = |pulse: &dyn Fn(u32) -> Vec<u8>| -> Vec<u8> {
        let epoch = |n: u32| {
            let mut payload = [&(561_600_000 + 1000 * n).to_le_bytes()[..], &2026_u16.to_le_bytes()].concat();
            payload.extend([11, 21, 11, 59, 42 + n as u8, 7, 0, 0, 0, 0, 0, 0, 0, 0, 3, 1]);
            payload.resize(92, 0);
            [ubx_frame(1, 7, &payload), pulse(n)].concat()
        };
        (0..10).flat_map(epoch).collect()
    };
    let predicted = |week: u16, ms: i64, flags: u8, reference: u8| {
        let tow = move |n: u32| (561_600_000 + ms + 1000 * i64::from(n)) as u32;
        let payload = move |n| [&tow(n).to_le_bytes()[..], &[0; 8], &week.to_le_bytes(), &[flags, reference]].concat();
        epochs(&move |n| ubx_frame(0x0d, 1, &payload(n)))
    };
    let marked = |flags: u8| {
        let payload = move |n: u32| {
            let tow_ms = (561_600_000 + 1000 * n).to_le_bytes();
            let front = [&[0, flags][..], &(n as u16).to_le_bytes(), &2445_u16.to_le_bytes(), &[0; 2]].concat();
            [&front[..], &tow_ms, &[0; 16]].concat()
        };
        epochs(&move |n| ubx_frame(0x0d, 3, &payload(n)))
    };
    for (bytes, name, timed) in [
        (predicted(2445, 0, 0, 0), "pps.receiver", true),
        (predicted(2445, -18_000, 3, 0x30), "pps.receiver", true),
        (predicted(1089, -14_000, 0, 0x72), "pps.receiver", true),
        (predicted(1421, 0, 0, 3), "pps.receiver", true),
        (predicted(2445, 10_782_000, 0, 0x61), "pps.receiver", false),
        (predicted(2445, 0, 0, 4), "pps.receiver", false),
        (marked(0xc8), "pps.time-mark", true),
        (marked(0x88), "pps.time-mark", false),
        (marked(0xc0), "pps.time-mark", false),
    ] {
        let loaded = load_ubx(&bytes);
        assert_eq!(count_of(&loaded, "undated"), if timed { 0 } else { 10 }, "{:?}", loaded.flight.notices);
        let Some(pulses) = loaded.flight.channels.get(name) else {
            assert!(!timed, "{name}");
            continue;
        };
        // date -u -d '2026-11-21T11:59:42Z' +%s
        let first = gps_of_unix(Stamp(1_795_262_382_000_000_000));
        assert_eq!((timed, pulses.series.len(), pulses.series.timeline().first()), (true, 10, first), "{name}");
    }
}

fn load_ubx(bytes: &[u8]) -> ingest::Loaded {
    let (_folder, path) = file("f.ubx", bytes);
    load(&ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::Ubx }).unwrap()
}

#[test]
fn messages_before_the_first_week_are_dated_backwards_over_sunday_too() {
    const WEEK_MS: i64 = 604_800_000;
    let truth: Vec<i64> = (0..10).map(|n| (2445 * WEEK_MS + WEEK_MS - 1000 + 200 * n) * 1_000_000).collect();
    let time_gps = |itow_ms: u32| {
        let week = if itow_ms < 1_000_000 { 2446_u16 } else { 2445 };
        ubx_frame(1, 0x20, &[&itow_ms.to_le_bytes()[..], &[0; 4], &week.to_le_bytes(), &[18, 7, 0, 0, 0, 0]].concat())
    };
    // 2026-11-21T23:59:42 UTC is the end of the week.
    let time_utc = |itow_ms: u32| {
        let second = if itow_ms < 1_000_000 { 42 } else { 41 };
        let date = [&2026_u16.to_le_bytes()[..], &[11, 21, 23, 59, second, 7]].concat();
        ubx_frame(1, 0x21, &[&itow_ms.to_le_bytes()[..], &[0; 8], &date].concat())
    };
    for name in ["NAV-TIMEGPS", "NAV-TIMEUTC"] {
        let tell = |itow_ms| if name == "NAV-TIMEGPS" { time_gps(itow_ms) } else { time_utc(itow_ms) };
        for teller in 0..10 {
            let bytes = around_sunday(|n, itow_ms| if n == teller { tell(itow_ms) } else { vec![] });
            let loaded = load_ubx(&bytes);
            for channel in ["position.posllh", "velocity.velned"] {
                let timeline = loaded.flight.channels[channel].series.timeline();
                let stamps: Vec<i64> = timeline.stamps().iter().map(|s| s.0).collect();
                assert_eq!((timeline.clock(), stamps), (Clock::Gps, truth.clone()), "{name} at {teller}: {channel}");
            }
            assert_eq!(count_of(&loaded, "undated"), 2 * u64::from(teller + 1), "{name}");
            assert!(!lossy(&loaded));
        }
    }
}

/// NAV-PVT five times a second from noon of 2026-11-21 on, with these validity, fix type and flag bytes.
fn pvt(n: u32, itow_ms: u32, [valid, fix_type, flags]: [u8; 3]) -> Vec<u8> {
    let second = (n / 5 % 60) as u8;
    let date = [&2026_u16.to_le_bytes()[..], &[11, 21, 12, (n / 300) as u8, second, valid]].concat();
    let mut payload = [&itow_ms.to_le_bytes()[..], &date, &[0; 8], &[fix_type, flags, 0, 12]].concat();
    payload.extend([85_455_940_i32, 473_977_420 + n as i32, 500_000, 450_000].map(i32::to_le_bytes).concat());
    payload.resize(92, 0);
    ubx_frame(1, 7, &payload)
}

/// The time of week of noon, UTC, ms.
const NOON_ITOW_MS: u32 = 6 * 86_400_000 + 12 * 3_600_000 + 18_000;

#[test]
fn messages_before_the_receiver_knows_the_time_are_undated_and_no_loss() {
    for clock_ms in [0, 345_600_000, 604_790_000] {
        for valid in [0xf0, 0xf1, 0] {
            let cold = |n: u32| pvt(n, clock_ms + 200 * n, [valid, 0, 0]);
            let timed = |n: u32| pvt(n, NOON_ITOW_MS + 200 * n, if n < 100 { [0xf3, 0, 0] } else { [0xf7, 3, 1] });
            let bytes: Vec<u8> = (0..50).flat_map(cold).chain((50..300).flat_map(timed)).collect();
            let loaded = load_ubx(&bytes);
            assert!(!lossy(&loaded), "{clock_ms} {valid}: {:?}", loaded.flight.notices);
            assert_eq!(count_of(&loaded, "undated"), 50);
            let timeline = loaded.flight.channels["position.gps"].series.timeline();
            assert_eq!((timeline.clock(), timeline.stamps().len()), (Clock::Gps, 200));
            let noon_ns = (2445 * 604_800_000 + i64::from(NOON_ITOW_MS)) * 1_000_000;
            assert_eq!(timeline.first(), Some(Stamp(noon_ns + 20_000_000_000)));
        }
    }
}

#[test]
fn a_clock_that_does_not_jump_when_dated_was_right_before() {
    let itow_ms = |n: u32| NOON_ITOW_MS + 200 * n;
    let place = |n: u32| {
        ubx_frame(
            1,
            2,
            &[itow_ms(n), 85_455_940, 473_977_420 + n, 500_000, 450_000, 2000, 3000].map(u32::to_le_bytes).concat(),
        )
    };
    let time_gps = |n: u32| {
        ubx_frame(
            1,
            0x20,
            &[&itow_ms(n).to_le_bytes()[..], &[0; 4], &2445_u16.to_le_bytes(), &[18, 7, 0, 0, 0, 0]].concat(),
        )
    };
    // A fix without a valid date until another message has the week; and a log without any.
    for (time_gps_at, clock) in [(49, Clock::Gps), (1000, Clock::Elapsed)] {
        let epoch = |n: u32| {
            [place(n), pvt(n, itow_ms(n), [0, 3, 1]), if n == time_gps_at { time_gps(n) } else { vec![] }].concat()
        };
        let loaded = load_ubx(&(0..200).flat_map(epoch).collect::<Vec<u8>>());
        for channel in ["position.gps", "position.posllh"] {
            let timeline = loaded.flight.channels[channel].series.timeline();
            assert_eq!((timeline.clock(), timeline.stamps().len()), (clock, 200), "{channel}");
        }
        assert_eq!(
            (count_saying(&loaded, "undated", "did not know it yet"), lossy(&loaded)),
            (0, false),
            "{:?}",
            loaded.flight.notices
        );
        assert_eq!(count_of(&loaded, "undated"), if clock == Clock::Gps { 100 } else { 400 });
    }
    // After a cold start the position of the first timed epoch precedes the message with its time.
    let cold =
        |n: u32| [ubx_frame(1, 2, &[[0; 4], (200 * n).to_le_bytes()].concat()), pvt(n, 200 * n, [0, 0, 0])].concat();
    let warm = |n: u32| [place(n), pvt(n, itow_ms(n), [0xf7, 3, 1])].concat();
    let log = read_bytes(READER, &(0..50).flat_map(cold).chain((50..100).flat_map(warm)).collect::<Vec<u8>>()).unwrap();
    assert_eq!(values(&log, "NAV-POSLLH", "gps_week").last(), Some(&Some(2445.0)));
    let table = log.tables.iter().find(|table| table.topic.name == "NAV-PVT").unwrap();
    let weeks: Vec<Option<f64>> = (0..100).map(|row| table.column("gps_week").unwrap().number(row)).collect();
    assert_eq!(weeks, [vec![None; 50], vec![Some(2445.0); 50]].concat());
    let table = log.tables.iter().find(|table| table.topic.name == "NAV-POSLLH").unwrap();
    assert_eq!((table.rows, table.column("gps_week").unwrap().number(0)), (50, Some(2445.0)));
}

#[test]
fn a_velocity_between_frames_gets_no_time_from_a_damaged_epoch() {
    let seal = |body: &str| format!("${body}*{:02X}\r\n", body.bytes().fold(0, |sum, b| sum ^ b)).into_bytes();
    let epoch = |i: u32| {
        let rmc = format!("GNRMC,12{:02}{:02}.00,A,4807.038,N,01131.000,E,20.0,{i}.0,211126,,,A", i / 60, i % 60);
        let vtg = seal(&format!("GNVTG,{i}.0,T,,M,20.0,N,,K,A"));
        [pvt(5 * i, NOON_ITOW_MS + 1000 * i, [0xf7, 3, 1]), seal(&rmc), vtg]
    };
    for hit in [0, 1] {
        let mut pieces: Vec<Vec<u8>> = (0..60).flat_map(epoch).collect();
        pieces[90 + hit].fill(0);
        let log = read_bytes(READER, &pieces.concat()).unwrap();
        let table = log.tables.iter().find(|table| table.topic.name == "GNVTG").unwrap();
        let column = table.column("elapsed_ns").unwrap();
        let seconds = |row: usize| column.number(row).map(|_| column.integer(row).unwrap() / 1_000_000_000);
        let expected = |row: usize| Some(row as i64).filter(|_| hit == 0 || row != 30);
        assert!(
            (0..60).all(|row| seconds(row) == expected(row)),
            "{hit}: {:?}",
            (28..33).map(seconds).collect::<Vec<_>>()
        );
    }
}

#[test]
fn a_log_without_any_week_is_timed_by_time_of_week_alone() {
    // An invalid week is not used.
    let invalid =
        |itow_ms: u32| ubx_frame(1, 0x20, &[&itow_ms.to_le_bytes()[..], &[0; 4], &[0x8d, 9, 18, 1], &[0; 4]].concat());
    let bytes = around_sunday(|_, itow_ms| invalid(itow_ms));
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!(values(&log, "NAV-POSLLH", "gps_week"), [Some(0.0); 10]);
    let loaded = load_ubx(&bytes);
    let timeline = loaded.flight.channels["position.posllh"].series.timeline();
    assert_eq!((timeline.clock(), timeline.stamps().len()), (Clock::Elapsed, 10));
    assert_eq!(count_of(&loaded, "undated"), 30);
}

#[test]
fn sentences_and_corrections_between_the_frames_are_not_damage() {
    let gga = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n";
    let correction = bytes_of("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98");
    let unread = ubx_frame(0x02, 0x15, &[1; 300]);
    let poll = ubx_frame(1, 7, &[]);
    let bytes = [gga, &of_pyubx2()[..], &correction, gga, &unread, &correction, &poll].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!(log.health.bytes.damaged, 0, "{:?}", log.health.damage);
    let counts = ["GPGGA", "RTCM3", "RXM-0x15", "NAV-PVT", "NAV-VELNED"].map(|topic| messages(&log, topic));
    assert_eq!(counts, [2, 2, 1, 2, 1]);
    assert_eq!(values(&log, "GPGGA", "altitude"), [Some(545.4); 2]);
    assert_eq!(log.health.undecodable, 0);
    // A file that begins with sentences is UBX all the same.
    for name in ["mixed.nmea", "mixed.log", "mixed.ubx"] {
        let (folder, _path) = file(name, &bytes);
        let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
        assert_eq!(found.units[0].kind, LogKind::Ubx, "{name}");
    }
}

#[test]
fn a_damaged_correction_does_not_cost_the_next_one() {
    let correction = bytes_of("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98");
    let mut damaged = correction.clone();
    damaged[9] ^= 1;
    let bytes = [&of_pyubx2()[..], &damaged, &correction, &correction, &damaged, &of_pyubx2()].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((messages(&log, "RTCM3"), messages(&log, "NAV-PVT")), (2, 2));
    assert_eq!((log.health.damage_count, log.health.bytes.damaged), (2, 50), "{:?}", log.health.damage);
}

#[test]
fn corrections_after_unrecognized_bytes_are_found_again() {
    let correction = bytes_of("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98");
    let garbage = [0xd3, 0, 0x13, 0x3e, 0xd7, 0xd3, 0, 0xb5, 0x62, 7, 0xd3];
    let bytes = [&of_pyubx2()[..], &garbage, &correction, &correction, &garbage, &correction].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((messages(&log, "RTCM3"), messages(&log, "NAV-PVT")), (3, 1));
    let damaged = 2 * garbage.len() as u64;
    assert_eq!((log.health.damage_count, log.health.bytes.damaged), (2, damaged), "{:?}", log.health.damage);
}

#[test]
fn text_before_the_first_frame_is_not_damage_but_a_fragment_is() {
    let frames = of_pyubx2();
    let whole = read_bytes(READER, &frames).unwrap().health.messages;
    let damage = |front: &[u8]| {
        let log = read_bytes(READER, &[front, &frames].concat()).unwrap();
        assert_eq!(log.health.messages, whole);
        (log.health.damage.first().map(|d| d.reason.clone()), log.notices.iter().any(|n| n.code == "skipped"))
    };
    assert_eq!(damage(b"# receiver on the roof\n# begun at noon\n"), (None, true));
    let begins_inside = Some("bytes that are neither a frame nor a sentence".to_owned());
    assert_eq!(damage(&frames[20..40]), (begins_inside.clone(), false));
    assert_eq!(damage(b"038,N,01131.000,E,123520,A*47\r\n"), (begins_inside.clone(), false));
    assert_eq!(damage(b"038,N,01131.000,E,123520"), (begins_inside, false));
}

#[test]
fn an_unterminated_sentence_is_not_damage_but_text_between_frames_is() {
    let gga = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47";
    let frame = ubx_frame(1, 4, &[b'*'; 18]);
    let bytes = [&frame[..], gga, &frame, b"\r\n", gga, b"\r\n", &frame].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (5, 0), "{:?}", log.health.damage);
    for piece in [&b"9,545.4,M,46.9 m,M\r\n"[..], b"logger restarted by its watchdog\r\n"] {
        let log = read_bytes(READER, &[&frame, piece, &frame].concat()).unwrap();
        assert_eq!((log.health.messages, log.health.bytes.damaged), (2, piece.len() as u64), "{piece:?}");
    }
}

#[test]
fn damage_in_a_mixed_stream_costs_only_what_it_hits() {
    let gga = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n".to_vec();
    let correction = bytes_of("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98");
    let pieces = [gga.clone(), ubx_frame(1, 4, &[3; 18]), correction, ubx_frame(1, 3, &[4; 16]), gga];
    for hurt in 0..pieces.len() {
        let mut bytes = pieces.clone();
        let middle = bytes[hurt].len() / 2;
        bytes[hurt][middle] ^= 4;
        let log = read_bytes(READER, &bytes.concat()).unwrap();
        assert_eq!((log.health.messages, log.health.damage_count), (4, 1), "{hurt}: {:?}", log.health.damage);
        assert_eq!(log.health.bytes.damaged, pieces[hurt].len() as u64, "{hurt}");
    }
}

#[test]
fn a_log_cut_anywhere_gives_the_frames_before_the_cut_and_reports_it() {
    let bytes = seed(Container::Ubx);
    let mut ends = vec![0];
    while let Some(length) = bytes.get(ends[ends.len() - 1] + 4..).and_then(<[u8]>::first_chunk) {
        ends.push(ends[ends.len() - 1] + 8 + usize::from(u16::from_le_bytes(*length)));
    }
    check_cuts(READER, &bytes, 0..bytes.len(), &ends, |length| ends.contains(&length));
}

#[test]
fn no_flipped_bit_changes_a_value_and_each_costs_one_frame_and_is_reported() {
    check_flips(1);
}

#[test]
#[ignore = "all single bits, some seconds to a minute"]
fn no_single_bit_flip_at_all_changes_a_value_and_each_costs_one_frame() {
    check_flips(8);
}

fn check_flips(bits_of_each_byte: usize) {
    let bytes = seed(Container::Ubx);
    let whole = read_bytes(READER, &bytes).unwrap();
    // The week comes from earlier frames: only values in the frame itself are compared.
    let own = |log: &ingest::Log| {
        let strip =
            |row: &String| row.split(' ').filter(|cell| !cell.contains("gps_week=")).collect::<Vec<_>>().join(" ");
        rows(log).into_iter().map(|(topic, rows)| (topic, rows.iter().map(strip).collect())).collect()
    };
    let truth = own(&whole);
    each_flip(READER, &bytes, bits(0..bytes.len(), bits_of_each_byte), |log, place, bit| {
        let found = own(log);
        assert_eq!(missing(&found, &truth), 0, "byte {place}, bit {bit}: a value changed");
        assert_eq!(log.health.messages + 1, whole.health.messages, "byte {place}, bit {bit}");
        assert!(log.health.bytes.damaged > 0, "byte {place}, bit {bit}: silent loss");
    });
}

#[test]
fn false_lengths_do_not_slow_the_search_and_the_rest_is_reported() {
    let (lie, good) = ([0xb5, 0x62, 1, 7, 0xff, 0xff], ubx_frame(1, 4, &[3; 18]));
    let pair = [&lie[..], &good].concat();
    let log = read_bytes(READER, &pair.repeat(10)).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (10, 60));
    // The search is given up after a small multiple of the file size.
    let log = read_bytes(READER, &pair.repeat(30_000)).unwrap();
    assert!(log.health.messages > 10 && log.health.bytes.damaged > 60 && log.notices.any_loss());
}

#[test]
fn what_is_no_log_is_refused() {
    check_refusals(READER, "text");
}
