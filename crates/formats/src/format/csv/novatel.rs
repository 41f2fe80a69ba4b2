//! NovAtel OEM messages in their abbreviated sister format: ASCII, one message a line, `#NAMEA,header;fields*crc`, or
//! with the short header `%NAMEA,week,seconds;fields*crc` (OEM7 Commands and Logs Reference Manual, "ASCII").

use super::fields::Fields;

/// The names of the fields of messages that maps know, in order. Others have numbered columns.
const FIELDS: &[(&str, &[&str])] = &[
    ("BESTPOS", POSITION),
    ("BESTGNSSPOS", POSITION),
    ("PSRPOS", POSITION),
    ("BESTVEL", VELOCITY),
    ("BESTGNSSVEL", VELOCITY),
    ("PSRVEL", VELOCITY),
    ("INSPVA", INSPVA),
    ("INSPVAS", INSPVA),
    ("INSPVAX", INSPVAX),
    ("INSPOS", INSPOS),
    ("INSPOSS", INSPOS),
    ("INSVEL", INSVEL),
    ("INSVELS", INSVEL),
    ("INSATT", INSATT),
    ("INSATTS", INSATT),
];
/// The names of status fields.
const STATUS: &[&str] = &["sol_status", "ins_status", "status"];
/// A derived column after those of messages with a status: 1 if the status is that of a solution, else 0.
const SOLVED: &str = "solution_ok";
/// The status of messages with a solution: their solution status, or the status of the inertial solution. Others report
/// an alignment in progress, too few satellites, or a filter that has not converged.
const SOLUTIONS: &[&str] = &[
    "SOL_COMPUTED",
    "INS_SOLUTION_GOOD",
    "INS_ALIGNMENT_COMPLETE",
    // Good, but the azimuth is uncertain, or the satellite position was rejected. The last is the former name of the
    // second.
    "INS_HIGH_VARIANCE",
    "INS_SOLUTION_FREE",
    "INS_BAD_GPS_AGREEMENT",
];

const POSITION: &[&str] = &[
    "sol_status",
    "pos_type",
    "lat",
    "lon",
    "hgt",
    "undulation",
    "datum",
    "lat_sd",
    "lon_sd",
    "hgt_sd",
    "station",
    "diff_age",
    "sol_age",
    "svs",
    "soln_svs",
];
const VELOCITY: &[&str] = &["sol_status", "vel_type", "latency", "age", "hor_spd", "trk_gnd", "vert_spd"];
const INSPVA: &[&str] =
    &["week", "seconds", "lat", "lon", "hgt", "north_vel", "east_vel", "up_vel", "roll", "pitch", "azimuth", "status"];
const INSPOS: &[&str] = &["week", "seconds", "lat", "lon", "hgt", "status"];
const INSVEL: &[&str] = &["week", "seconds", "north_vel", "east_vel", "up_vel", "status"];
const INSATT: &[&str] = &["week", "seconds", "roll", "pitch", "azimuth", "status"];
const INSPVAX: &[&str] = &[
    "ins_status",
    "pos_type",
    "lat",
    "lon",
    "hgt",
    "undulation",
    "north_vel",
    "east_vel",
    "up_vel",
    "roll",
    "pitch",
    "azimuth",
    "lat_sd",
    "lon_sd",
    "hgt_sd",
    "north_vel_sd",
    "east_vel_sd",
    "up_vel_sd",
    "roll_sd",
    "pitch_sd",
    "azimuth_sd",
    "ext_status",
    "update_age",
];

/// Whether a text begins with such a message.
pub(super) fn looks_like(head: &[u8]) -> bool {
    let line = head.split(|b| matches!(b, b'\n' | b'\r')).find(|line| !line.trim_ascii().is_empty());
    line.is_some_and(|line| parse(line).is_ok())
}

/// A message: its name without the `A`, and its header and fields with commas between.
pub(super) struct Message<'l> {
    pub(super) name: &'l str,
    /// Week, seconds of the week, then the fields, then [`SOLVED`] if they have a status.
    pub(super) row: String,
    /// The number of fields after the header.
    width: usize,
}

/// Parses a line and checks its CRC-32.
pub(super) fn parse(line: &[u8]) -> Result<Message<'_>, &'static str> {
    const NONE: &str = "not a NovAtel message";
    let line = std::str::from_utf8(line).map_err(|_| NONE)?.trim();
    let short = line.starts_with('%');
    let body = line.strip_prefix(['#', '%']).ok_or(NONE)?;
    let (body, crc) = body.rsplit_once('*').ok_or("no checksum: the line is truncated")?;
    let (header, fields) = body.split_once(';').ok_or(NONE)?;
    let header: Vec<&str> = header.split(',').collect();
    let name = header.first().and_then(|n| n.strip_suffix('A')).ok_or(NONE)?;
    let capitals = |b: u8| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_';
    if name.is_empty() || !name.bytes().all(capitals) {
        return Err(NONE);
    }
    let week_at = if short { 1 } else { 5 };
    let (week, seconds) = header.get(week_at).zip(header.get(week_at + 1)).ok_or(NONE)?;
    if u32::from_str_radix(crc, 16) != Ok(checksum(body.as_bytes())) {
        return Err("the CRC-32 is wrong");
    }
    let mut split = Fields::default();
    split.split(fields.as_bytes(), b',');
    let mut row = format!("{week},{seconds},{fields}");
    if let Some(status) = known_fields(name).iter().position(|field| STATUS.contains(field)) {
        let status = std::str::from_utf8(split.get(status)).unwrap_or_default();
        row += if SOLUTIONS.contains(&status.trim()) { ",1" } else { ",0" };
    }
    Ok(Message { name, row, width: split.len() })
}

/// The known names of the fields of a message.
fn known_fields(name: &str) -> &'static [&'static str] {
    FIELDS.iter().find(|(known, _)| *known == name).map_or(&[], |(_, fields)| fields)
}

/// CRC-32 with the usual polynomial, without the initial and final inversion.
fn checksum(body: &[u8]) -> u32 {
    let mut crc = crc32fast::Hasher::new_with_initial(u32::MAX);
    crc.update(body);
    !crc.finalize()
}

impl Message<'_> {
    /// The names of its columns.
    pub(super) fn columns(&self) -> Vec<String> {
        let known = known_fields(self.name);
        let name = |i: usize| known.get(i).map_or_else(|| format!("field_{}", i + 1), |name| (*name).to_owned());
        let header = ["header.week".to_owned(), "header.seconds".to_owned()];
        let solved = known.iter().any(|field| STATUS.contains(field)).then(|| SOLVED.to_owned());
        header.into_iter().chain((0..self.width).map(name)).chain(solved).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Examples of NovAtel's manual, with their checksums.
    const LONG: &str = "#INSPVAA,COM1,0,31.0,FINESTEERING,1264,144088.000,00040000,5615,1541;1264,144088.002284950,51.116827527,-114.037738908,401.191547167,354.846489850,108.429407241,-10.837482850,1.116219952,-3.476059035,7.372686190,INS_ALIGNMENT_COMPLETE*af719fd9";
    const SHORT: &str = "%INSPVASA,1264,144059.000;1264,144059.002135700,51.116680071,-114.037929194,515.286704183,277.896368884,84.915188605,-8.488207941,0.759619515,-2.892414901,6.179554750,INS_ALIGNMENT_COMPLETE*855d6f76";

    #[test]
    fn the_examples_of_the_manual_are_read_with_valid_checksums() {
        for (line, name, week, seconds) in
            [(LONG, "INSPVA", "1264", "144088.000"), (SHORT, "INSPVAS", "1264", "144059.000")]
        {
            let message = parse(line.as_bytes()).map_err(str::to_owned).unwrap();
            assert_eq!(message.name, name);
            assert!(message.row.starts_with(&format!("{week},{seconds},1264,")));
            let columns = message.columns();
            assert_eq!(columns.len(), message.row.split(',').count());
            assert_eq!(columns[4], "lat");
            assert!(looks_like(format!("\r\n{line}\r\n").as_bytes()));
        }
    }

    #[test]
    fn every_changed_byte_of_a_message_is_detected() {
        for at in 1..LONG.len() {
            let mut line = LONG.as_bytes().to_vec();
            line[at] ^= 1;
            assert!(parse(&line).is_err(), "{at}");
        }
        assert!(parse(&LONG.as_bytes()[..100]).is_err());
    }
}
