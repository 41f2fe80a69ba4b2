//! T7 for formats without an index: foreign bytes before, after and between sound records, and two logs in one file.

use crate::lab::{Lab, seeds};
use crate::layout::Ends;
use crate::verdict::{is_reported, rows};

const FAMILIES: [&str; 6] = ["ulog", "dataflash-binary", "dataflash-text", "tlog", "ubx", "nmea"];

fn garbage() -> [(&'static str, Vec<u8>); 3] {
    let noise = (0..700_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    [("sevens", vec![7; 300]), ("zeros", vec![0; 300]), ("noise", noise)]
}

#[test]
fn foreign_bytes_cost_at_most_the_preceding_record_and_are_reported() {
    let mut lab = Lab::new();
    for family in FAMILIES {
        let seed = &seeds(family)[0];
        let (subject, intact) = lab.intact(seed, 0);
        let bytes = &seed.files[0].bytes;
        let Ends::At(ends) = Ends::of(seed, 0) else { panic!("{family} has no records") };
        // For text, the offsets after line ends.
        let text = ["dataflash-text", "nmea"].contains(&family);
        let ends = ends.into_iter().filter(|&at| at > 0 && (!text || bytes[at - 1] == b'\n'));
        for at in ends.step_by(3) {
            for (what, foreign) in garbage() {
                let case = format!("{family}: {what} at {at} of {}", bytes.len());
                // After text without a line end the next line is damaged.
                let end: &[u8] = if text { b"\n" } else { b"" };
                let hurt = [&bytes[..at], &foreign, end, &bytes[at..]].concat();
                let read = lab.read(&subject, &hurt, &case);
                // A preallocated file has zeros after the last record.
                let filling = what == "zeros" && at == bytes.len() && family.starts_with("dataflash-b");
                assert!(filling || is_reported(&read, &intact), "{case}");
                let found = rows(read.as_ref().unwrap());
                // A record without a checksum counts if another begins where it ends.
                let found = found + usize::from(["dataflash-binary", "ulog"].contains(&family));
                assert!(found >= rows(&intact), "{case}: {found} rows of {}", rows(&intact));
            }
        }
    }
}

#[test]
fn two_logs_in_one_file_are_both_read_or_reported() {
    let mut lab = Lab::new();
    for family in FAMILIES {
        let seed = &seeds(family)[0];
        let (subject, intact) = lab.intact(seed, 0);
        let bytes = &seed.files[0].bytes;
        let read = lab.read(&subject, &[bytes.as_slice(), bytes].concat(), family);
        let found = rows(read.as_ref().unwrap());
        assert!(
            found == 2 * rows(&intact) || is_reported(&read, &intact),
            "{family}: {found} of {} rows",
            2 * rows(&intact)
        );
        assert!(found >= rows(&intact), "{family}: {found} of {} rows", 2 * rows(&intact));
    }
}

#[test]
fn ulogs_of_two_boots_in_one_file_do_not_mix_at_any_cut() {
    let mut lab = Lab::new();
    let seed = &seeds("ulog")[0];
    let (subject, intact) = lab.intact(seed, 0);
    let bytes = &seed.files[0].bytes;
    for cut in (1..=bytes.len()).step_by(13).chain([bytes.len()]) {
        let case = format!("cut at {cut}");
        let log = lab.read(&subject, &[&bytes[..cut], bytes.as_slice()].concat(), &case).unwrap();
        let second = log.restarts.first().map_or(i64::MIN, |restart| restart.logged_ns);
        for table in &log.tables {
            let whole = intact.tables.iter().find(|t| t.topic == table.topic).unwrap();
            let times = table.logged_ns.as_ref().unwrap();
            let rest: Vec<i64> = times.iter().copied().filter(|&t| t >= second).collect();
            let shift = if second > i64::MIN { second } else { 0 };
            let expected: Vec<i64> = whole.logged_ns.as_ref().unwrap().iter().map(|t| t + shift).collect();
            assert_eq!(rest, expected, "{case}: {}", table.topic.name);
        }
        assert!(log.restarts.iter().all(|restart| restart.certain), "{case}");
        assert!(cut < bytes.len() || log.health.damage.is_empty(), "{:?}", log.health.damage);
    }
}
