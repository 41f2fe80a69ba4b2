//! T7 for formats without an index: foreign bytes before, behind and between sound records, and two logs in one file.

use crate::lab::{Lab, seeds};
use crate::layout::Ends;
use crate::verdict::{rows, told};

const FAMILIES: [&str; 6] = ["ulog", "dataflash-binary", "dataflash-text", "tlog", "ubx", "nmea"];

fn garbage() -> [(&'static str, Vec<u8>); 3] {
    let noise = (0..700_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    [("sevens", vec![7; 300]), ("zeros", vec![0; 300]), ("noise", noise)]
}

#[test]
fn foreign_bytes_between_records_cost_at_most_the_one_before_them_and_are_told() {
    let mut lab = Lab::new();
    for family in FAMILIES {
        let seed = &seeds(family)[0];
        let (subject, intact) = lab.intact(seed, 0);
        let bytes = &seed.files[0].bytes;
        let Ends::At(ends) = Ends::of(seed, 0) else { panic!("{family} has no records") };
        // Of text, the places behind line ends.
        let text = ["dataflash-text", "nmea"].contains(&family);
        let ends = ends.into_iter().filter(|&at| at > 0 && (!text || bytes[at - 1] == b'\n'));
        for at in ends.step_by(3) {
            for (what, foreign) in garbage() {
                let case = format!("{family}: {what} at {at} of {}", bytes.len());
                // Behind text without a line end the next line is hurt.
                let end: &[u8] = if text { b"\n" } else { b"" };
                let hurt = [&bytes[..at], &foreign, end, &bytes[at..]].concat();
                let read = lab.read(&subject, &hurt, &case);
                // Zeros behind the last record are what a preallocated file has.
                let filling = what == "zeros" && at == bytes.len() && family.starts_with("dataflash-b");
                assert!(filling || told(&read, &intact), "{case}");
                let found = rows(read.as_ref().unwrap());
                // A record of DataFlash counts if another begins where it ends.
                let found = found + usize::from(family == "dataflash-binary");
                assert!(found >= rows(&intact), "{case}: {found} rows of {}", rows(&intact));
            }
        }
    }
}

#[test]
fn two_logs_in_one_file_are_both_read_or_told() {
    let mut lab = Lab::new();
    for family in FAMILIES {
        let seed = &seeds(family)[0];
        let (subject, intact) = lab.intact(seed, 0);
        let bytes = &seed.files[0].bytes;
        let read = lab.read(&subject, &[bytes.as_slice(), bytes].concat(), family);
        let found = rows(read.as_ref().unwrap());
        assert!(found == 2 * rows(&intact) || told(&read, &intact), "{family}: {found} of {} rows", 2 * rows(&intact));
        assert!(found >= rows(&intact), "{family}: {found} of {} rows", 2 * rows(&intact));
    }
}
