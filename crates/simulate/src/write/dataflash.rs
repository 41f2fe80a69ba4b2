//! ArduPilot DataFlash: binary, and the text that ground stations convert it to.
//!
//! A position is a `GPS` record, a velocity that of the estimator (`XKF1`), the truth a `SIM`. Values have the
//! resolution of their format character: 1e-7 deg (`L`), 0.01 m (`e`), single precision (`f`), timestamps whole
//! microseconds.

use crate::samples::Samples;
use crate::simulated::SimulatedFlight;
use flight::{Stamp, WEEK_S, gps_of_unix};

/// Time since boot at the start of the flight, µs.
const BOOT_US: i64 = 60_000_000;

/// A record type, as described by `FMT` and `FMTU`.
struct Kind {
    id: u8,
    name: &'static str,
    codes: &'static str,
    columns: &'static str,
    units: &'static str,
    multipliers: &'static str,
}

const fn kind(id: u8, name: &'static str, [codes, columns, units, multipliers]: [&'static str; 4]) -> Kind {
    Kind { id, name, codes, columns, units, multipliers }
}

const FMT: Kind = kind(128, "FMT", ["BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"]);
const UNIT: Kind = kind(177, "UNIT", ["QbZ", "TimeUS,Id,Label", "s--", "F--"]);
const FMTU: Kind = kind(178, "FMTU", ["QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"]);
const MULT: Kind = kind(179, "MULT", ["Qbd", "TimeUS,Id,Mult", "s--", "F--"]);
const PARM: Kind = kind(64, "PARM", ["QNf", "TimeUS,Name,Value", "s--", "F--"]);
const MSG: Kind = kind(91, "MSG", ["QZ", "TimeUS,Message", "s-", "F-"]);
const MODE: Kind = kind(125, "MODE", ["QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"]);
const GPS: Kind =
    kind(118, "GPS", ["QBBIHBcLLe", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt", "s#---SmDUm", "F----0BGGB"]);
const XKF1: Kind = kind(76, "XKF1", ["QBfff", "TimeUS,C,VN,VE,VD", "s#nnn", "F-000"]);
const SIM: Kind = kind(104, "SIM", ["QfLL", "TimeUS,Alt,Lat,Lng", "smDU", "F0GG"]);
const KINDS: [&Kind; 10] = [&FMT, &UNIT, &FMTU, &MULT, &PARM, &MSG, &MODE, &GPS, &XKF1, &SIM];

/// Letters of units, and of multipliers, used by the types.
const UNITS: [(u8, &str); 9] = [
    (b'-', ""),
    (b's', "s"),
    (b'b', "B"),
    (b'#', "instance"),
    (b'S', "satellites"),
    (b'm', "m"),
    (b'n', "m/s"),
    (b'D', "deglatitude"),
    (b'U', "deglongitude"),
];
const MULTIPLIERS: [(u8, f64); 5] = [(b'-', 0.0), (b'0', 1.0), (b'B', 1e-2), (b'F', 1e-6), (b'G', 1e-7)];

/// A value of a record, in the unit after reading.
enum Value {
    Integer(i64),
    Number(f64),
    Text(String),
}

/// A record, and its arrival at the logger.
struct Record {
    logged: Stamp,
    kind: &'static Kind,
    values: Vec<Value>,
}

/// The flight as a binary log.
pub(super) fn binary(flight: &SimulatedFlight) -> Vec<u8> {
    let mut bytes = vec![];
    for record in records(flight) {
        bytes.extend([0xa3, 0x95, record.kind.id]);
        for (code, value) in record.kind.codes.bytes().zip(&record.values) {
            value.write(code, &mut bytes);
        }
    }
    bytes
}

/// The flight as text.
pub(super) fn text(flight: &SimulatedFlight) -> Vec<u8> {
    let line = |record: Record| {
        let cells = record.kind.codes.bytes().zip(&record.values).map(|(code, value)| value.cell(code));
        format!("{}, {}\n", record.kind.name, cells.collect::<Vec<_>>().join(", "))
    };
    records(flight).into_iter().map(line).collect::<String>().into_bytes()
}

fn records(flight: &SimulatedFlight) -> Vec<Record> {
    let mut samples = positions(flight);
    let Samples { measured, logged, ned, .. } = &flight.velocity;
    samples.extend(measured.iter().zip(logged).zip(ned).map(|((measured, logged), v)| {
        let velocity = v.iter().map(|v| Value::Number(*v));
        let values = [time(flight, *measured), Value::Integer(0)].into_iter().chain(velocity);
        Record { logged: *logged, kind: &XKF1, values: values.collect() }
    }));
    samples.extend(notes(flight));
    samples.sort_by_key(|record| record.logged);
    let mut all = definitions(flight);
    all.extend(samples);
    all
}

fn positions(flight: &SimulatedFlight) -> Vec<Record> {
    let of = |samples: &Samples, record: &dyn Fn(Stamp, [f64; 3]) -> (&'static Kind, Vec<Value>)| {
        let rows = samples.measured.iter().zip(&samples.logged).zip(&samples.geodetic_deg);
        let rows = rows.map(|((measured, logged), place)| {
            let (kind, values) = record(*measured, *place);
            Record { logged: *logged, kind, values }
        });
        rows.collect::<Vec<_>>()
    };
    let mut all = of(&flight.position, &|measured, [latitude, longitude, height]| {
        let gps_ms = gps_of_unix(measured).map_or(0, |gps| gps.0 / 1_000_000);
        let whole = |x: i64| Value::Integer(x);
        let (week_ms, week) = (gps_ms.rem_euclid(WEEK_S * 1000), gps_ms.div_euclid(WEEK_S * 1000));
        let fix = [whole(0), whole(3), whole(week_ms), whole(week), whole(14), Value::Number(0.72)];
        let place = [latitude, longitude, height].map(Value::Number);
        (&GPS, [time(flight, measured)].into_iter().chain(fix).chain(place).collect())
    });
    all.extend(of(&flight.reference, &|measured, [latitude, longitude, height]| {
        let place = [height, latitude, longitude].map(Value::Number);
        (&SIM, [time(flight, measured)].into_iter().chain(place).collect())
    }));
    all
}

/// One text per second, which is not needed.
fn notes(flight: &SimulatedFlight) -> impl Iterator<Item = Record> {
    (0..flight.settings.duration_s as u32).map(|second| {
        let logged = flight.settings.start.plus_seconds(f64::from(second) + 0.0005);
        let text = format!("second {second}: all well, nothing to see");
        Record { logged, kind: &MSG, values: vec![time(flight, logged), Value::Text(text)] }
    })
}

/// Records before all samples.
fn definitions(flight: &SimulatedFlight) -> Vec<Record> {
    let start = flight.settings.start;
    let boot = || time(flight, start);
    let record = |kind: &'static Kind, values: Vec<Value>| Record { logged: start, kind, values };
    let text = |text: &str| Value::Text(text.to_owned());
    let mut all = vec![];
    all.extend(KINDS.map(|k| {
        let numbers = [i64::from(k.id), k.length()].map(Value::Integer);
        record(&FMT, numbers.into_iter().chain([k.name, k.codes, k.columns].map(text)).collect())
    }));
    all.extend(UNITS.map(|(id, name)| record(&UNIT, vec![boot(), Value::Integer(id.into()), text(name)])));
    all.extend(
        MULTIPLIERS.map(|(id, factor)| record(&MULT, vec![boot(), Value::Integer(id.into()), Value::Number(factor)])),
    );
    all.extend(KINDS.map(|k| {
        let units = [k.units, k.multipliers].map(text);
        record(&FMTU, [boot(), Value::Integer(k.id.into())].into_iter().chain(units).collect())
    }));
    all.push(record(&MSG, vec![boot(), text("ArduPlane V4.5.7 (0a1b2c3d)")]));
    all.extend(
        [("GPS_DELAY_MS", 220.0), ("EK3_ENABLE", 1.0)]
            .map(|(name, value)| record(&PARM, vec![boot(), text(name), Value::Number(value)])),
    );
    all.push(record(&MODE, vec![boot(), Value::Integer(10), Value::Integer(10), Value::Integer(1)]));
    all
}

/// Microseconds since boot.
fn time(flight: &SimulatedFlight, stamp: Stamp) -> Value {
    let since_ns = stamp.0 - flight.settings.start.0;
    Value::Integer(BOOT_US + (since_ns as f64 / 1e3).round() as i64)
}

impl Kind {
    /// Length of a record, including the header.
    fn length(&self) -> i64 {
        let size = |code| match code {
            b'b' | b'B' | b'M' => 1,
            b'c' | b'H' => 2,
            b'e' | b'L' | b'I' | b'f' | b'n' => 4,
            b'Q' | b'd' => 8,
            b'N' => 16,
            _ => 64,
        };
        3 + self.codes.bytes().map(size).sum::<i64>()
    }
}

impl Value {
    /// The logged number, for a format character with a scale.
    fn scaled(&self, code: u8) -> i64 {
        let scale = match code {
            b'c' | b'e' => 1e2,
            b'L' => 1e7,
            _ => 1.0,
        };
        match self {
            Value::Integer(x) => *x,
            Value::Number(x) => (x * scale).round() as i64,
            Value::Text(_) => 0,
        }
    }

    fn number(&self) -> f64 {
        match self {
            Value::Integer(x) => *x as f64,
            Value::Number(x) => *x,
            Value::Text(_) => 0.0,
        }
    }

    fn write(&self, code: u8, bytes: &mut Vec<u8>) {
        let whole = self.scaled(code);
        match (code, self) {
            (b'b' | b'B' | b'M', _) => bytes.push(whole as u8),
            (b'c' | b'H', _) => bytes.extend((whole as u16).to_le_bytes()),
            (b'e' | b'L' | b'I', _) => bytes.extend((whole as u32).to_le_bytes()),
            (b'Q', _) => bytes.extend((whole as u64).to_le_bytes()),
            (b'f', _) => bytes.extend((self.number() as f32).to_le_bytes()),
            (b'd', _) => bytes.extend(self.number().to_le_bytes()),
            (code, Value::Text(text)) => {
                let size = match code {
                    b'n' => 4,
                    b'N' => 16,
                    _ => 64,
                };
                let mut field = text.clone().into_bytes();
                field.resize(size, 0);
                bytes.extend(field);
            }
            _ => {}
        }
    }

    /// Enough digits to reproduce the value in the binary log.
    fn cell(&self, code: u8) -> String {
        match (code, self) {
            (_, Value::Text(text)) => text.clone(),
            (b'c' | b'e', _) => format!("{:.2}", self.scaled(code) as f64 / 1e2),
            (b'L', _) => format!("{:.7}", self.scaled(code) as f64 / 1e7),
            (b'f', _) => f64::from(self.number() as f32).to_string(),
            (b'd', _) => self.number().to_string(),
            _ => self.scaled(code).to_string(),
        }
    }
}
