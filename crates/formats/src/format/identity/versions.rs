//! Version texts of receivers: UBX-MON-VER, the same lines as NMEA texts, and what drivers print.

use super::{Receivers, note_baud, note_text};
use flight::ReceiverIdentity;

/// Hardware numbers of u-blox chips.
const CHIPS: &[(&str, &str)] = &[
    ("00040005", "u-blox 5"),
    ("00040006", "u-blox 6"),
    ("00040007", "u-blox 6"),
    ("00070000", "u-blox 7"),
    ("00080000", "u-blox M8"),
    ("00190000", "u-blox 9"),
    ("000A0000", "u-blox M10"),
];

/// Name of a chip by its hardware number.
fn chip(hardware: &str) -> Option<String> {
    let hardware = hardware.trim();
    let known = CHIPS.iter().find(|(number, _)| number.eq_ignore_ascii_case(hardware));
    match known {
        Some((_, name)) => Some((*name).to_owned()),
        None => (!hardware.is_empty()).then(|| format!("u-blox HW {hardware}")),
    }
}

/// The value of `MOD=NEO-M8N-0`; older firmware writes a space instead of the equals sign.
fn value_of<'a>(line: &'a str, key: &str) -> Option<&'a str> {
    let rest = line.trim().strip_prefix(key)?;
    rest.strip_prefix(['=', ' ']).map(str::trim).filter(|value| !value.is_empty())
}

/// Parses the lines of a u-blox version message; `None` if no line belongs to one.
///
/// `software` is the first line of UBX-MON-VER; in NMEA texts it is recognized by its first word.
pub(in crate::format) fn of_version(lines: &[String], source: &str, protocol: &str) -> Option<ReceiverIdentity> {
    let first = |key: &str| lines.iter().find_map(|line| value_of(line, key));
    let hardware = lines.iter().find_map(|line| line.trim().strip_prefix("HW ")?.split_whitespace().next_back());
    let built = |line: &&String| ["ROM ", "EXT ", "SW ", "FW "].iter().any(|word| line.trim().starts_with(word));
    let software = lines.iter().find(built).map(|line| line.trim().strip_prefix("SW ").unwrap_or(line.trim()));
    let model = first("MOD").map(str::to_owned).or_else(|| hardware.and_then(chip));
    let mut receiver = ReceiverIdentity { number: 1, ..ReceiverIdentity::default() };
    note_text(&mut receiver, "model", model.as_deref(), source);
    note_text(&mut receiver, "firmware", first("FWVER").or(software), source);
    if !receiver.is_told() {
        return None;
    }
    let protocol = first("PROTVER").map_or(protocol.to_owned(), |version| format!("{protocol}, version {version}"));
    note_text(&mut receiver, "protocol", Some(&protocol), source);
    Some(receiver)
}

/// Reads what PX4's driver prints about a u-blox receiver: `INFO  [gps] u-blox firmware version: SPG 5.10`. The line
/// has no receiver number: with several versions it is unknown which receiver has which.
pub(in crate::format) fn report_px4_versions(receivers: &mut [ReceiverIdentity], lines: &[String]) {
    for (key, name, before) in [
        ("u-blox firmware version:", "firmware", ""),
        ("u-blox module:", "model", "u-blox "),
        ("u-blox protocol version:", "protocol", "UBX, version "),
    ] {
        let mut texts: Vec<&str> =
            lines.iter().filter_map(|line| line.split_once(key)).map(|(_, rest)| rest.trim()).collect();
        texts.sort_unstable();
        texts.dedup();
        let [only] = texts[..] else { continue };
        let is_ublox =
            |receiver: &&mut ReceiverIdentity| receiver.model.as_ref().is_none_or(|m| m.starts_with("u-blox"));
        for receiver in receivers.iter_mut().filter(is_ublox) {
            if name != "firmware" {
                // What the driver read takes precedence over its device number and parameters.
                receiver.sources.remove(name);
                let field = if name == "model" { &mut receiver.model } else { &mut receiver.protocol };
                *field = None;
            }
            note_text(receiver, name, Some(&format!("{before}{only}")), "text of the driver");
        }
    }
}

/// Reads a text in which ArduPilot reports what it detected. Its wording in 3.x to 4.7: `GPS 1: detected as u-blox at
/// 115200 baud`, `GPS 1: detected u-blox`, `GPS 1: probing for u-blox at 230400 baud`, `GPS 2: specified as
/// DroneCAN1-125`, `u-blox 1 HW: 00040007 SW: 7.03 (45970)`.
pub(super) fn report_ardupilot(text: &str, receivers: &mut Receivers) {
    let source = format!("text \"{text}\"");
    if let Some((before, versions)) = text.split_once(" HW: ") {
        let number = before.strip_prefix("u-blox ").map(|number| number.trim().parse().unwrap_or(1));
        let Some(number) = number.filter(|number| (1..=MOST_RECEIVERS).contains(number)) else { return };
        let (hardware, software) = versions.split_once(" SW: ").unwrap_or((versions, ""));
        let receiver = super::numbered(receivers, number);
        if receiver.model.as_deref().is_none_or(|model| model == "u-blox") {
            receiver.model = None;
            note_text(receiver, "model", chip(hardware).as_deref(), &source);
        }
        note_text(receiver, "firmware", Some(software), &source);
        note_text(receiver, "protocol", Some("UBX"), &source);
        return;
    }
    let Some((number, found)) = text.strip_prefix("GPS ").and_then(|rest| rest.split_once(": ")) else { return };
    let Some(number) = number.parse().ok().filter(|number| (1..=MOST_RECEIVERS).contains(number)) else { return };
    let words = ["detected as ", "detected ", "specified as ", "probing for "];
    let Some(named) = words.iter().find_map(|word| found.strip_prefix(word)) else { return };
    let (model, baud) = match named.split_once(" at ") {
        Some((model, speed)) => (model, speed.split(' ').next().and_then(|baud| baud.parse().ok())),
        None => (named, None),
    };
    let receiver = super::numbered(receivers, number);
    note_text(receiver, "model", Some(model), &source);
    note_baud(receiver, baud, &source);
    note_text(receiver, "protocol", protocol_of(model), &source);
}

/// Most receivers of one vehicle that are accepted.
const MOST_RECEIVERS: u32 = 20;

/// Protocol of an ArduPilot driver.
fn protocol_of(driver: &str) -> Option<&'static str> {
    [("u-blox", "UBX"), ("NMEA", "NMEA"), ("SBF", "SBF"), ("DroneCAN", "DroneCAN"), ("UAVCAN", "DroneCAN")]
        .iter()
        .find(|(name, _)| driver.starts_with(name))
        .map(|(_, protocol)| *protocol)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(texts: &[&str]) -> Vec<String> {
        texts.iter().map(|text| (*text).to_owned()).collect()
    }

    #[test]
    fn a_version_message_names_module_firmware_and_protocol() {
        let texts =
            ["SW ROM CORE 3.01 (107888)", "HW 00080000", "FWVER=SPG 3.01", "PROTVER=18.00", "MOD=NEO-M8N-0", "GPS;GLO"];
        let receiver = of_version(&lines(&texts), "MON-VER", "UBX").unwrap();
        let facts = [&receiver.model, &receiver.firmware, &receiver.protocol].map(|fact| fact.as_deref().unwrap_or(""));
        assert_eq!(facts, ["NEO-M8N-0", "SPG 3.01", "UBX, version 18.00"]);
        assert_eq!(receiver.sources["model"], "MON-VER");
        // A receiver of 2012, from its NMEA texts.
        let texts = [
            "u-blox ag - www.u-blox.com",
            "HW  UBX-G70xx   00070000",
            "ROM CORE 1.00 (59842) Jun 27 2012",
            "PROTVER 14.00",
        ];
        let receiver = of_version(&lines(&texts), "GPTXT", "NMEA").unwrap();
        let facts = [&receiver.model, &receiver.firmware, &receiver.protocol].map(|fact| fact.as_deref().unwrap_or(""));
        assert_eq!(facts, ["u-blox 7", "ROM CORE 1.00 (59842) Jun 27 2012", "NMEA, version 14.00"]);
        assert_eq!(of_version(&lines(&["ANTSTATUS=OK", "LLC FFFFFFFF"]), "GPTXT", "NMEA"), None);
    }

    #[test]
    fn ardupilot_texts_are_assigned_to_the_receiver_they_name() {
        let mut receivers = Receivers::new();
        for text in [
            "GPS 1: detected as u-blox at 115200 baud",
            "u-blox 1 HW: 00040007 SW: 7.03 (45970)",
            "GPS 2: specified as DroneCAN1-125",
            "GPS 77: detected as u-blox at 9600 baud",
            "GPS 1: 3D fix",
        ] {
            report_ardupilot(text, &mut receivers);
        }
        let found: Vec<_> = receivers
            .values()
            .map(|r| (r.number, r.model.as_deref().unwrap(), r.firmware.as_deref(), r.baud, r.protocol.as_deref()))
            .collect();
        assert_eq!(
            found,
            [
                (1, "u-blox 6", Some("7.03 (45970)"), Some(115_200), Some("UBX")),
                (2, "DroneCAN1-125", None, None, Some("DroneCAN"))
            ]
        );
    }

    #[test]
    fn versions_of_two_receivers_are_assigned_to_neither() {
        let receiver =
            |model: &str| ReceiverIdentity { number: 1, model: Some(model.to_owned()), ..Default::default() };
        let mut receivers = [receiver("u-blox 9"), receiver("Septentrio")];
        let text = "INFO  [gps] u-blox firmware version: SPG 5.10";
        report_px4_versions(&mut receivers, &lines(&[text, text]));
        assert_eq!(receivers.clone().map(|r| r.firmware), [Some("SPG 5.10".to_owned()), None]);
        let mut receivers = [receiver("u-blox 9")];
        report_px4_versions(&mut receivers, &lines(&[text, "INFO  [gps] u-blox firmware version: HPG 1.13"]));
        assert_eq!(receivers[0].firmware, None);
    }
}
