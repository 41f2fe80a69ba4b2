//! Infers role, axis, source and unit of a column from its name.

use flight::{Dimension, Unit};
use formats::TableHead;
use formats::written_unit::{Written, is_blank, of_word, read};

/// An axis as written in names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Axis {
    North,
    East,
    Down,
    Up,
    /// In a frame that the name does not give.
    X,
    Y,
    Z,
}

/// A possible role of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    Time,
    Week,
    Latitude,
    Longitude,
    Height,
    Position(Axis),
    Velocity(Axis),
    Speed,
    Track,
    Roll,
    Pitch,
    Yaw,
    /// About an axis of the body.
    Rate(Axis),
    /// What an accelerometer measures along a body axis.
    Force(Axis),
}

impl Role {
    /// The dimension of its unit.
    pub(super) fn dimension(self) -> Dimension {
        match self {
            Role::Time => Dimension::Time,
            Role::Week => Dimension::None,
            Role::Latitude | Role::Longitude | Role::Track | Role::Roll | Role::Pitch | Role::Yaw => Dimension::Angle,
            Role::Height | Role::Position(_) => Dimension::Length,
            Role::Velocity(_) | Role::Speed => Dimension::Speed,
            Role::Rate(_) => Dimension::AngularRate,
            Role::Force(_) => Dimension::Acceleration,
        }
    }
}

/// A column whose name indicates its role.
#[derive(Debug, Clone)]
pub(super) struct Named {
    pub(super) path: String,
    pub(super) role: Role,
    /// The remaining words, such as `gps` in `gps_lat`.
    pub(super) source: String,
    /// As stated in the table.
    pub(super) unit: Option<Unit>,
    /// The unit stated in the table if it is unknown or of another dimension.
    pub(super) odd_unit: Option<String>,
    pub(super) words: Vec<String>,
}

/// Words that change the meaning of a column: its quality, a setpoint, or another place.
const OTHERS: &[&str] = &[
    "std",
    "sigma",
    "err",
    "error",
    "cov",
    "var",
    "accuracy",
    "rms",
    "sd",
    "dev",
    "stdev",
    "uncertainty",
    "count",
    "valid",
    "status",
    "age",
    "home",
    "target",
    "setpoint",
    "sp",
    "cmd",
    "desired",
    "wp",
    "waypoint",
    "next",
    "dist",
    "distance",
    "air",
    "airspeed",
    "ias",
    "tas",
    "eas",
    "wind",
    "bias",
    "innov",
    "innovation",
    "hacc",
    "vacc",
    "sacc",
    "acc",
    "dop",
    "hdop",
    "pdop",
    "vdop",
    "num",
    "sats",
    "body",
    "fix",
    "mode",
    "id",
    "max",
    "min",
    "undulation",
    "separation",
    "geoid",
    "ecef",
];
/// Words that add nothing.
const FILLERS: &[&str] = &[
    "the",
    "lla",
    "g",
    "gnd",
    "local",
    "of",
    "over",
    "wgs84",
    "ned",
    "enu",
    "msl",
    "amsl",
    "hae",
    "ellipsoid",
    "ellipsoidal",
    "ground",
    "true",
    "utm",
    "geodetic",
    "motion",
    "m",
    "current",
    "axis",
    "in",
    "component",
];
const TIMES: &[&str] = &[
    "t",
    "time",
    "timestamp",
    "stamp",
    "ts",
    "utc",
    "tow",
    "itow",
    "sow",
    "epoch",
    "elapsed",
    "seconds",
    "sec",
    "secs",
    "datetime",
    "date",
    "gpstime",
    "timeus",
    "timems",
    "unixtime",
    "utctime",
    "millis",
    "boot",
    "micros",
    "clock",
];
const OF_VELOCITY: &[&str] = &["velocity", "vel", "speed", "spd", "v"];
const OF_PLACE: &[&str] = &["position", "pos", "p", "displacement"];
const SPEEDS: &[&str] = &["gspeed", "gndspd", "groundspeed", "sog", "gs", "hspeed"];
const TRACKS: &[&str] =
    &["track", "course", "cog", "trk", "crs", "gcrs", "headmot", "gtrk", "bearing", "direction", "courseoverground"];
const CLIMBS: &[&str] = &["climb", "vs", "vspd", "vspeed", "roc", "climbrate", "verticalspeed"];
const HEIGHTS: &[&str] = &["alt", "altitude", "height", "hgt", "elev", "elevation", "h", "hmsl"];

/// The words of a name in lower case: split at other characters and where lower case changes to upper case.
fn words(name: &str) -> Vec<String> {
    let chars: Vec<char> = name.chars().collect();
    let mut words = vec![String::new()];
    for (i, c) in chars.iter().enumerate() {
        let before = i.checked_sub(1).and_then(|i| chars.get(i));
        let next_small = chars.get(i + 1).is_some_and(|c| c.is_lowercase());
        let humps = c.is_uppercase()
            && before.is_some_and(|b| b.is_lowercase() || b.is_ascii_digit() || (b.is_uppercase() && next_small));
        if !c.is_alphanumeric() || humps {
            words.push(String::new());
        }
        if let (true, Some(word)) = (c.is_alphanumeric(), words.last_mut()) {
            word.extend(c.to_lowercase());
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

fn axis_of(word: &str) -> Option<Axis> {
    Some(match word {
        "n" | "north" | "northing" => Axis::North,
        "e" | "east" | "easting" => Axis::East,
        "d" | "down" => Axis::Down,
        "u" | "up" => Axis::Up,
        "x" => Axis::X,
        "y" => Axis::Y,
        "z" => Axis::Z,
        _ => return None,
    })
}

/// `veln`, `vnorth`, `px`: a prefix for the role, followed by the axis.
fn fused(word: &str, fronts: &[&str]) -> Option<Axis> {
    fronts.iter().find_map(|front| axis_of(word.strip_prefix(front)?))
}

impl Named {
    /// A column whose role is known otherwise than by its name.
    pub(super) fn with_role(path: &str, role: Role) -> Named {
        Named { path: path.to_owned(), role, source: String::new(), unit: None, odd_unit: None, words: vec![] }
    }
}

/// The role of a column by its name; `None` if it has no wanted role.
pub(super) fn named(head: &TableHead, path: &str) -> Option<Named> {
    let front = formats::written_unit::in_brackets(path)
        .map_or(path, |unit| path.get(..path.len().saturating_sub(unit.len() + 2)).unwrap_or(path));
    let mut words = words(front);
    let ending = take_unit(&mut words);
    let words: Vec<String> = words.iter().flat_map(|word| without_number(word)).collect();
    let (words, ending) = if is_seconds_of_source(&words, &ending) {
        (words.into_iter().chain(["seconds".to_owned()]).collect(), vec![])
    } else {
        (words, ending)
    };
    let all = words.clone();
    let stated = head.unit_of(path);
    let of_body: Vec<Unit> = match read(stated, Dimension::Acceleration) {
        Written::Unit(unit) => vec![unit],
        _ => ending.clone(),
    };
    let (role, source) = body_role_of(&words, &of_body).or_else(|| role_of(&words, &ending))?;
    let (unit, odd_unit) = match read(stated, role.dimension()) {
        Written::Unit(unit) => (Some(unit), None),
        Written::Blank => (ending.iter().copied().find(|unit| unit.dimension() == role.dimension()), None),
        Written::Other(_) | Written::Unknown => (None, (!is_blank(stated)).then(|| stated.to_owned())),
    };
    // `vel_n_ms` is short for m/s.
    let is_short = unit.is_none() && role.dimension() == Dimension::Speed && ending.iter().any(|u| u.symbol() == "ms");
    let unit = if is_short { "m/s".parse().ok() } else { unit };
    Some(Named { path: path.to_owned(), role, source, unit, odd_unit, words: all })
}

/// `GPS seconds` are a time, and not a GPS in seconds.
fn is_seconds_of_source(words: &[String], ending: &[Unit]) -> bool {
    let is_source = !words.is_empty() && words.iter().all(|word| SOURCES.contains(&word.as_str()));
    is_source && ending.iter().any(|unit| unit.symbol() == "s")
}

/// `lat2` is `lat` of a source named `2`.
fn without_number(word: &str) -> Vec<String> {
    let stem = word.trim_end_matches(|c: char| c.is_ascii_digit());
    let is_role = stem.len() > 1 && role_of_word(stem, &[]).is_some_and(|role| !matches!(role, Role::Position(_)));
    match word.strip_prefix(stem).filter(|number| is_role && !number.is_empty()) {
        Some(number) => vec![stem.to_owned(), number.to_owned()],
        None => vec![word.to_owned()],
    }
}

/// Takes the words of a unit from the end, such as `m`, `s` in `vel_n_m_s`, `mps` or `e7`.
fn take_unit(words: &mut Vec<String>) -> Vec<Unit> {
    for count in [2, 1] {
        let Some(at) = words.len().checked_sub(count).filter(|at| *at > 0) else { continue };
        let Some(last) = words.get(at..) else { continue };
        let text = match last {
            [a, b] if a == "m" || a == "deg" || a == "rad" || a == "km" || a == "ft" => format!("{a}/{b}"),
            [one] if one == "e7" || one == "1e7" => "1e-7 deg".to_owned(),
            [one] if axis_of(one).is_none() && !HEIGHTS.contains(&one.as_str()) => one.clone(),
            _ => continue,
        };
        let units = of_word(&text);
        // A single word of time at the end may be the role itself.
        if !units.is_empty() {
            words.truncate(at);
            return units;
        }
    }
    vec![]
}

fn has(words: &[String], word: &str) -> bool {
    words.iter().any(|w| w == word)
}

/// The role that one of the words gives by itself.
fn role_of_word(word: &str, words: &[String]) -> Option<Role> {
    Some(match word {
        "lat" | "latitude" => Role::Latitude,
        "lon" | "lng" | "long" | "longitude" => Role::Longitude,
        "week" | "gwk" | "wn" | "weekno" => Role::Week,
        "heading" if has(words, "motion") => Role::Track,
        "sink" | "sinkrate" => Role::Velocity(Axis::Down),
        _ if HEIGHTS.contains(&word) => Role::Height,
        _ if SPEEDS.contains(&word) => Role::Speed,
        _ if TRACKS.contains(&word) => Role::Track,
        _ if CLIMBS.contains(&word) => Role::Velocity(Axis::Up),
        _ => return fused(word, OF_VELOCITY).map(Role::Velocity).or_else(|| fused(word, OF_PLACE).map(Role::Position)),
    })
}

fn role_of(words: &[String], ending: &[Unit]) -> Option<(Role, String)> {
    let is_other = words.iter().any(|word| OTHERS.contains(&word.as_str()));
    if is_other && !has(words, "week") {
        return None;
    }
    let mut left: Vec<&str> = vec![];
    let (mut role, mut axis, mut of) = (None, None, None);
    let is_speed = words.iter().any(|word| {
        let of_speed = |role| matches!(role, Role::Speed | Role::Track | Role::Velocity(_));
        OF_VELOCITY.contains(&word.as_str()) || role_of_word(word, words).is_some_and(of_speed)
    });
    for word in words.iter().map(String::as_str) {
        match role_of_word(word, words) {
            Some(found) if role.is_none_or(|known| known == found || found == Role::Height) => {
                role = role.or(Some(found))
            }
            Some(_) => return None,
            None if OF_VELOCITY.contains(&word) => of = Some(Dimension::Speed),
            None if OF_PLACE.contains(&word) => of = of.or(Some(Dimension::Length)),
            None if axis_of(word).is_some() && axis.is_none() => axis = axis_of(word),
            None if word == "vertical" && (has(words, "speed") || has(words, "velocity")) => axis = Some(Axis::Up),
            // Ground speed is a kind of speed; a ground latitude is that of the ground.
            None if FILLERS.contains(&word) && (word != "ground" || is_speed) => {}
            None => left.push(word),
        }
    }
    let stated = ending.iter().map(|unit| unit.dimension()).find(|d| matches!(d, Dimension::Speed | Dimension::Length));
    let role = match (role, of.or(stated), axis) {
        // Seconds of the week.
        (Some(Role::Week), ..) if left.iter().any(|word| TIMES.contains(word)) => Role::Time,
        (Some(Role::Week), ..) => Role::Week,
        (Some(role), ..) => role,
        (None, Some(Dimension::Speed), Some(axis)) => Role::Velocity(in_frame(axis, words)),
        (None, Some(Dimension::Speed), None) if of.is_some() => Role::Speed,
        (None, _, Some(axis)) => Role::Position(in_frame(axis, words)),
        (None, ..) if left.iter().any(|word| TIMES.contains(word)) => Role::Time,
        _ => return None,
    };
    if matches!(role, Role::Time | Role::Week) {
        return Some((role, String::new()));
    }
    // Words left over where only the axis gives the role change its meaning, as in `mag_x`.
    let is_only_axis =
        matches!(role, Role::Position(_)) && of.is_none() && !words.iter().any(|w| fused(w, OF_PLACE).is_some());
    if is_only_axis && left.iter().any(|word| !SOURCES.contains(word)) {
        return None;
    }
    left.retain(|word| !TIMES.contains(word));
    // `true_lat` is of the truth; `true_track` is just not magnetic.
    let is_angle_or_speed = matches!(role, Role::Track | Role::Speed);
    if has(words, "true") && !is_angle_or_speed && left.is_empty() {
        left.push("truth");
    }
    Some((role, left.join("-")))
}

/// Words of an attitude, a rate or a force that add nothing.
const BODY_FILLERS: &[&str] = &[
    "angle",
    "angles",
    "euler",
    "attitude",
    "att",
    "orientation",
    "ypr",
    "rpy",
    "body",
    "linear",
    "specific",
    "sensor",
    "axis",
    "true",
    "ned",
    "measured",
    "calibrated",
];
const OF_RATE: &[&str] =
    &["rate", "rates", "gyro", "gyr", "gyroscope", "omega", "angular", "angularrate", "speed", "velocity"];
const OF_FORCE: &[&str] = &["a", "acc", "accel", "accelerometer", "acceleration", "force"];

fn angle_of(word: &str) -> Option<Role> {
    Some(match word {
        "roll" | "phi" | "bank" => Role::Roll,
        "pitch" | "theta" => Role::Pitch,
        "yaw" | "psi" | "heading" | "hdg" | "azimuth" => Role::Yaw,
        _ => return None,
    })
}

/// The axis of rotation of an angle.
fn axis_of_angle(role: Role) -> Axis {
    match role {
        Role::Roll => Axis::X,
        Role::Pitch => Axis::Y,
        _ => Axis::Z,
    }
}

/// `rollrate`, `yawspeed`, `gyrox`, `xgyro`, `wz`, `gx`, `ax`, and a lone `p`, `q` or `r`. In a unit of acceleration `gx`,
/// `nx` and `fx` are forces.
fn fused_body(word: &str, is_alone: bool, of_acceleration: bool) -> Option<Role> {
    let of_angle = ["rate", "speed"].iter().find_map(|ending| angle_of(word.strip_suffix(ending)?));
    let of_axis = |names: &[&str]| {
        let behind = || names.iter().filter(|name| name.len() > 1).find_map(|name| axis_of(word.strip_suffix(name)?));
        fused(word, names).or_else(behind).filter(|axis| matches!(axis, Axis::X | Axis::Y | Axis::Z))
    };
    if of_acceleration && let Some(axis) = of_axis(&["g", "n", "f"]) {
        return Some(Role::Force(axis));
    }
    let alone = match word {
        "p" if is_alone => Some(Axis::X),
        "q" if is_alone => Some(Axis::Y),
        "r" if is_alone => Some(Axis::Z),
        _ => None,
    };
    let rate = of_angle.map(axis_of_angle).or_else(|| of_axis(&["gyro", "gyr", "omega", "w", "g"])).or(alone);
    rate.map(Role::Rate).or_else(|| of_axis(&["acc", "accel", "a"]).map(Role::Force))
}

/// An attitude, an angular rate or a specific force by its name: every word of it has to be known. `ending` are the units
/// that it may end in.
fn body_role_of(words: &[String], ending: &[Unit]) -> Option<(Role, String)> {
    let (mut angle, mut axis, mut whole) = (None, None, None);
    let (mut is_rate, mut is_force) = (false, false);
    let mut left: Vec<&str> = vec![];
    let is_source = |word: &str| SOURCES.contains(&word);
    let is_alone = words.iter().filter(|word| !is_source(word)).count() == 1;
    let states = |dimension| ending.iter().any(|unit| unit.dimension() == dimension);
    let of_acceleration = states(Dimension::Acceleration);
    for word in words.iter().map(String::as_str) {
        match angle_of(word).or_else(|| fused_body(word, is_alone, of_acceleration)) {
            Some(role @ (Role::Roll | Role::Pitch | Role::Yaw)) => angle = Some(role).filter(|_| angle.is_none()),
            Some(role) => whole = Some(role),
            None if OF_FORCE.contains(&word) => is_force = true,
            None if OF_RATE.contains(&word) => is_rate = true,
            None if matches!(word, "x" | "y" | "z") && axis.is_none() => axis = axis_of(word),
            None if BODY_FILLERS.contains(&word) => {}
            None if is_source(word) => left.push(word),
            None => return None,
        }
    }
    // The heading of motion is a course, not an attitude.
    if angle == Some(Role::Yaw) && has(words, "motion") {
        return None;
    }
    let says_rate = words.iter().any(|word| OF_RATE.contains(&word.as_str()) && !OF_VELOCITY.contains(&word.as_str()));
    let role = match (angle, whole, axis) {
        (None, Some(role), None) => role,
        (Some(angle), None, None) if is_rate || states(Dimension::AngularRate) => Role::Rate(axis_of_angle(angle)),
        (Some(angle), None, None) if !is_force => angle,
        (None, None, Some(axis)) if is_force && !is_rate => Role::Force(axis),
        // A velocity along x is not a rate about it.
        (None, None, Some(axis)) if says_rate && !is_force => Role::Rate(axis),
        _ => return None,
    };
    Some((role, left.join("-")))
}

/// Words for the source of a position.
pub(super) const SOURCES: &[&str] = &[
    "gps",
    "gnss",
    "ekf",
    "ins",
    "nav",
    "truth",
    "ref",
    "reference",
    "gt",
    "imu",
    "mocap",
    "vicon",
    "optitrack",
    "est",
];

/// The axis, where a word of the name gives the frame.
fn in_frame(axis: Axis, words: &[String]) -> Axis {
    match (axis, has(words, "ned"), has(words, "enu")) {
        (Axis::X, true, false) | (Axis::Y, false, true) => Axis::North,
        (Axis::Y, true, false) | (Axis::X, false, true) => Axis::East,
        (Axis::Z, true, false) => Axis::Down,
        (Axis::Z, false, true) => Axis::Up,
        _ => axis,
    }
}

/// A column name quoted for TOML.
pub(super) fn quoted(name: &str) -> String {
    toml::Value::from(name).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str) -> Option<(Role, String, Option<&'static str>)> {
        let head = TableHead { topic: "t".into(), names: vec![name.to_owned()], units: vec![], unused_names: None };
        named(&head, name).map(|n| (n.role, n.source, n.unit.map(Unit::symbol)))
    }

    fn assert_names(names: &[(&str, Role, &str, Option<&'static str>)]) {
        for (name, role, source, unit) in names {
            assert_eq!(of(name), Some((*role, (*source).to_owned(), *unit)), "{name}");
        }
    }

    #[test]
    fn names_give_roles_axes_sources_and_units() {
        use Role::{Height, Latitude, Longitude, Position, Speed, Time, Track, Velocity, Week};
        assert_names(&[
            ("lat", Latitude, "", None),
            ("lat_deg", Latitude, "", Some("deg")),
            ("lat2", Latitude, "2", None),
            ("ground_lat", Latitude, "ground", None),
            ("px4_lat", Latitude, "px4", None),
            ("boot_ms", Time, "", Some("ms")),
            ("ground_speed", Speed, "", None),
            ("UTM_N", Position(Axis::North), "", None),
            ("gps_lon_e7", Longitude, "gps", Some("1e-7 deg")),
            ("Latitude (deg)", Latitude, "", Some("deg")),
            ("GPSLat", Latitude, "gps", None),
            ("alt", Height, "", None),
            ("hMSL", Height, "", None),
            ("altitude_ft", Height, "", Some("ft")),
            ("vn", Velocity(Axis::North), "", None),
            ("VN", Velocity(Axis::North), "", None),
            ("velN", Velocity(Axis::North), "", None),
            ("vel_north_mps", Velocity(Axis::North), "", Some("m/s")),
            ("vel_e_m_s", Velocity(Axis::East), "", Some("m/s")),
            ("ekf_vel_d", Velocity(Axis::Down), "ekf", None),
            ("Velocity East [km/h]", Velocity(Axis::East), "", Some("km/h")),
            ("vx", Velocity(Axis::X), "", None),
            ("velocity_enu_x", Velocity(Axis::East), "", None),
            ("pos_x", Position(Axis::X), "", None),
            ("x", Position(Axis::X), "", None),
            ("north_m", Position(Axis::North), "", Some("m")),
            ("north_mps", Velocity(Axis::North), "", Some("m/s")),
            ("speed", Speed, "", None),
            ("gSpeed", Speed, "", None),
            ("course_deg", Track, "", Some("deg")),
            ("time", Time, "", None),
            ("time_ms", Time, "", Some("ms")),
            ("t_s", Time, "", Some("s")),
            ("Time [s]", Time, "", Some("s")),
            ("vertical_speed", Velocity(Axis::Up), "", None),
            ("true_lat", Latitude, "truth", None),
            ("Longitude True", Longitude, "truth", None),
            ("true_track", Track, "", None),
            ("Bearing", Track, "", None),
            ("GPS seconds", Time, "", None),
            ("GPS Seconds of Week", Time, "", None),
            ("time of week [s]", Time, "", Some("s")),
            ("SOW", Time, "", None),
            ("GPS week [-]", Week, "", None),
        ]);
    }

    #[test]
    fn names_give_attitudes_rates_and_forces() {
        use Role::{Force, Pitch, Rate, Roll, Yaw};
        assert_names(&[
            ("Roll (deg)", Roll, "", Some("deg")),
            ("ekf_pitch_rad", Pitch, "ekf", Some("rad")),
            ("heading", Yaw, "", None),
            ("yawspeed", Rate(Axis::Z), "", None),
            ("roll_rate_dps", Rate(Axis::X), "", Some("deg/s")),
            ("gyro_x", Rate(Axis::X), "", None),
            ("angularRateY", Rate(Axis::Y), "", None),
            ("imu_angular_velocity_z", Rate(Axis::Z), "imu", None),
            ("q", Rate(Axis::Y), "", None),
            ("acc_y", Force(Axis::Y), "", None),
            ("AccelZ [m/s^2]", Force(Axis::Z), "", Some("m/s^2")),
            ("gx", Rate(Axis::X), "", None),
            ("Gy [rad/s]", Rate(Axis::Y), "", Some("rad/s")),
            ("gz_rps", Rate(Axis::Z), "", Some("rad/s")),
            ("xgyro", Rate(Axis::X), "", None),
            ("zacc", Force(Axis::Z), "", None),
            ("gx [g]", Force(Axis::X), "", Some("g0")),
            ("NZ [g]", Force(Axis::Z), "", Some("g0")),
            ("fx [m/s^2]", Force(Axis::X), "", Some("m/s^2")),
            ("aY [g]", Force(Axis::Y), "", Some("g0")),
            ("linear_acceleration_x", Force(Axis::X), "", None),
        ]);
    }

    #[test]
    fn names_of_other_quantities_give_no_role() {
        for other in [
            "mag_x",
            "roll_std",
            "roll_cmd",
            "LinAccelX",
            "YawU",
            "UncompGyroX",
            "hAcc",
            "lat_std",
            "airspeed",
            "temperature",
            "numSV",
            "body_vx",
            "home_lat",
        ] {
            assert_eq!(of(other), None, "{other}");
        }
    }
}
