//! Metadata above the rows of text tables: `$VAR` lines of FlySight 2, remarks, and the first line of Garmin files.

use super::note_text;
use flight::ReceiverIdentity;

/// First word of the line with which Garmin's G1000 identifies itself.
pub(in crate::format) const GARMIN: &str = "airframe_info";

/// Names that devices use for their serial number and firmware; only letters are compared.
const SERIALS: &[&str] = &["deviceid", "serial", "serialnumber", "deviceserialnumber", "receiverserialnumber"];
const FIRMWARES: &[&str] = &["firmwarever", "firmwareversion", "firmware", "receiverfirmware"];
const MODELS: &[&str] = &["devicename", "productcode", "receivermodel", "receivertype"];

/// The receiver from remarks, each `name = value`; empty if they do not identify it.
pub(in crate::format) fn of_table_head(remarks: &[String]) -> Vec<ReceiverIdentity> {
    let mut receiver = ReceiverIdentity { number: 1, ..ReceiverIdentity::default() };
    for (name, value) in remarks.iter().filter_map(|remark| remark.split_once(" = ")) {
        if name == GARMIN {
            of_garmin(value, &mut receiver);
            continue;
        }
        let letters: String = name.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_ascii_lowercase();
        for (fact, names) in [("serial", SERIALS), ("firmware", FIRMWARES), ("model", MODELS)] {
            if names.contains(&letters.as_str()) {
                note_text(&mut receiver, fact, Some(value), &format!("{name} above the table"));
            }
        }
        if name == "FIRMWARE_VER" {
            note_text(&mut receiver, "model", Some("FlySight 2"), &format!("{name} above the table"));
        }
    }
    if receiver.is_told() { vec![receiver] } else { vec![] }
}

/// `log_version="1.03", unit_software_part_number="006-B1177-C1", unit_software_version="21.50.5",
/// system_id="25B289D04"`.
fn of_garmin(line: &str, receiver: &mut ReceiverIdentity) {
    let value = |key: &str| {
        let field = line.split(',').find_map(|field| field.trim().strip_prefix(key)?.strip_prefix('='))?;
        Some(field.trim().trim_matches('"'))
    };
    let model = value("unit_software_part_number").map(|part| format!("Garmin {part}"));
    note_text(receiver, "model", model.as_deref(), GARMIN);
    note_text(receiver, "firmware", value("unit_software_version"), GARMIN);
    note_text(receiver, "serial", value("system_id"), GARMIN);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts(remarks: &[&str]) -> Vec<[Option<String>; 3]> {
        let remarks: Vec<String> = remarks.iter().map(|remark| (*remark).to_owned()).collect();
        of_table_head(&remarks).into_iter().map(|r| [r.model, r.firmware, r.serial]).collect()
    }

    fn receiver_facts(texts: [&str; 3]) -> Vec<[Option<String>; 3]> {
        vec![texts.map(|text| (!text.is_empty()).then(|| text.to_owned()))]
    }

    #[test]
    fn the_receiver_is_read_from_the_remarks_of_each_manufacturer() {
        let flysight = ["FIRMWARE_VER = v2024.05.25", "DEVICE_ID = 003e0038484e501420353131", "SESSION_ID = 3e10"];
        assert_eq!(facts(&flysight), receiver_facts(["FlySight 2", "v2024.05.25", "003e0038484e501420353131"]));
        let garmin = "airframe_info =  log_version=\"1.03\", unit_software_part_number=\"006-B1177-C1\", \
                      unit_software_version=\"21.50.5\", system_id=\"25B289D04\", mode=NORMAL, ";
        assert_eq!(facts(&[garmin]), receiver_facts(["Garmin 006-B1177-C1", "21.50.5", "25B289D04"]));
        assert_eq!(facts(&["Device ID = 0380", "Firmware Version = 1.2.3"]), receiver_facts(["", "1.2.3", "0380"]));
        assert_eq!(facts(&["Start time = 12:00", "Pilot = A B"]), Vec::<[Option<String>; 3]>::new());
    }
}
