//! One row of the history: the result of one run for one flight.

use convert::{Cells, Sheet};

/// A value that a column can store.
pub(crate) trait Cell: Sized {
    fn gather(values: Vec<Self>) -> Cells;
    fn scatter(cells: Cells) -> Option<Vec<Self>>;
}

impl Cell for Option<String> {
    fn gather(values: Vec<Self>) -> Cells {
        Cells::Text(values.into_iter().collect())
    }

    fn scatter(cells: Cells) -> Option<Vec<Self>> {
        match cells {
            Cells::Text(values) => Some(values.iter().map(|text| text.map(|text| text.to_string())).collect()),
            _ => None,
        }
    }
}

impl Cell for Option<f64> {
    fn gather(values: Vec<Self>) -> Cells {
        Cells::F64(values.into())
    }

    fn scatter(cells: Cells) -> Option<Vec<Self>> {
        match cells {
            Cells::F64(values) => Some(values.iter().collect()),
            _ => None,
        }
    }
}

impl Cell for Option<i64> {
    fn gather(values: Vec<Self>) -> Cells {
        Cells::I64(values.into())
    }

    fn scatter(cells: Cells) -> Option<Vec<Self>> {
        match cells {
            Cells::I64(values) => Some(values.iter().collect()),
            _ => None,
        }
    }
}

impl Cell for String {
    fn gather(values: Vec<Self>) -> Cells {
        Cells::Text(values.into_iter().map(Some).collect())
    }

    fn scatter(cells: Cells) -> Option<Vec<Self>> {
        Option::<String>::scatter(cells)?.into_iter().collect()
    }
}

impl Cell for i64 {
    fn gather(values: Vec<Self>) -> Cells {
        Cells::I64(values.into())
    }

    fn scatter(cells: Cells) -> Option<Vec<Self>> {
        Option::<i64>::scatter(cells)?.into_iter().collect()
    }
}

/// Defines the row, its columns in order, and the conversions between rows and a sheet.
macro_rules! row {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:ty,)+) => {
        /// The result of one run for one flight. Seconds, metres and hertz; instants are nanoseconds UTC since 1970.
        /// Uncertainties are standard uncertainties (k = 1).
        #[derive(Debug, Clone, Default, PartialEq)]
        pub struct Row {
            $($(#[doc = $doc])+ pub $name: $kind,)+
        }

        /// Every column of the history with its description, in file order.
        pub const COLUMNS: &[(&str, &str)] = &[$((stringify!($name), concat!($($doc),+)),)+];

        /// Rows as a sheet with one column for each field.
        pub(crate) fn sheet_of(rows: &[Row]) -> Sheet {
            let mut sheet = Sheet::default();
            $(sheet.push(stringify!($name), Cell::gather(rows.iter().map(|row| row.$name.clone()).collect()));)+
            sheet
        }

        /// The rows of a sheet.
        ///
        /// Names a column that is missing or has the wrong type.
        /// Names a column that is missing or holds something else.
        pub(crate) fn rows_of(sheet: Sheet) -> Result<Vec<Row>, String> {
            let rows = sheet.rows();
            let mut sheet = sheet;
            $(let mut $name = column::<$kind>(&mut sheet, stringify!($name))?.into_iter();)+
            let short = || "columns of unequal length".to_owned();
            (0..rows).map(|_| Ok(Row { $($name: $name.next().ok_or_else(short)?,)+ })).collect()
        }
    };
}

/// Removes a column from a sheet and returns it.
pub(crate) fn column<T: Cell>(sheet: &mut Sheet, name: &str) -> Result<Vec<T>, String> {
    let at = sheet.columns.iter().position(|c| c.name == name).ok_or(format!("column {name} is missing"))?;
    T::scatter(sheet.columns.swap_remove(at).cells).ok_or(format!("column {name} holds another type, or has gaps"))
}

row! {
    /// Name of the run: its start, UTC.
    run_id: String,
    /// Start of the run.
    run_ns: i64,
    /// Name of the campaign.
    campaign: String,
    /// Path of the flight below the campaign's folder.
    flight: String,
    /// Start of the flight's record, if its clock knows the day.
    flown_ns: Option<i64>,
    /// Receiver, firmware, rate and kind of log, in words: flights of one group may share a delay.
    group: Option<String>,
    /// Aircraft: as the log says, else as the fleet file says.
    airframe: Option<String>,
    /// Make and model of the receiver.
    receiver: Option<String>,
    /// Firmware of the receiver.
    firmware: Option<String>,
    /// Serial number of the receiver.
    serial: Option<String>,
    /// Rate of the position, Hz: as configured, else the nearest usual rate to the measured one.
    rate_hz: Option<f64>,
    /// Speed of the receiver's serial line, baud.
    baud: Option<i64>,
    /// Where airframe, receiver, firmware, serial, rate and baud come from, as `receiver: log, serial: fleet file`.
    identity_from: Option<String>,
    /// Identity of the vehicle as the log says it.
    vehicle: Option<String>,
    /// Autopilot or logger.
    system: Option<String>,
    /// Firmware of the autopilot.
    system_firmware: Option<String>,
    /// Hash (BLAKE3) of the content of the log's files.
    log_hash: Option<String>,
    /// Hash (BLAKE3) of the resolved settings.
    settings_hash: String,
    /// Hash (BLAKE3) of the criteria.
    criteria_hash: Option<String>,
    /// Version of the analysis.
    analysis_version: i64,
    /// Version of flightlag.
    build: String,
    /// Name of the result.
    key: String,
    /// `compensated`, `uncompensated`, `not-measurable`, `pending` or `failed`.
    outcome: String,
    /// Why the flight is not compensated: the first error.
    reason: Option<String>,
    /// State of the data: `whole`, `tail-cut`, `minor-loss`, `damaged`, `failed`, `companion` or `pending`.
    data: String,
    /// Kind of delay, as `constant` or `steps+jitters`.
    kind: Option<String>,
    /// How late the position is, s.
    lateness_s: Option<f64>,
    /// Its standard uncertainty, s.
    lateness_u_s: Option<f64>,
    /// Part of that uncertainty that flights share and that no number of them averages away, s: model errors and datum. Empty in
    /// rows of before layout 3.
    lateness_model_u_s: Option<f64>,
    /// Lower end of its 95 % interval, s.
    lateness_low_s: Option<f64>,
    /// Upper end of its 95 % interval, s.
    lateness_high_s: Option<f64>,
    /// What the lateness is counted from: `imu`, `reference` or `relative to CHANNEL`.
    datum: Option<String>,
    /// How much later the position is than the velocity, s.
    position_minus_velocity_s: Option<f64>,
    /// Its standard uncertainty, s.
    position_minus_velocity_u_s: Option<f64>,
    /// Delay that was removed, s.
    removed_s: Option<f64>,
    /// Where the removed delay comes from.
    removed_from: Option<String>,
    /// `helped`, `no-change`, `harmed` or `cannot-tell`.
    effect: Option<String>,
    /// Error of the position before, 2-D rms, m.
    error_raw_m: Option<f64>,
    /// Its standard uncertainty, m.
    error_raw_u_m: Option<f64>,
    /// Error of the position after, 2-D rms, m.
    error_compensated_m: Option<f64>,
    /// Its standard uncertainty, m.
    error_compensated_u_m: Option<f64>,
    /// Codes of the alarms with spaces between.
    alarms: Option<String>,
    /// Gravest verdict of the criteria.
    criteria: Option<String>,
    /// Criteria that failed, with spaces between.
    criteria_failed: Option<String>,
    /// Flight with the same samples that counts in place of this one.
    duplicate_of: Option<String>,
    /// Parameter of the autopilot that sets the delay.
    parameter: Option<String>,
    /// Value of that parameter in this log, s.
    parameter_s: Option<f64>,
    /// Value that this run recommends for it, s.
    advised_s: Option<f64>,
    /// Lateness that the recommendation follows from, s.
    advised_from_s: Option<f64>,
    /// Its standard uncertainty, s.
    advised_from_u_s: Option<f64>,
    /// Time flown, s.
    duration_s: Option<f64>,
    /// Page of the flight, relative to the campaign's report.
    page: String,
}

/// A property by which a trend separates flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Dimension {
    /// Aircraft.
    Airframe,
    /// Serial number of the receiver.
    Serial,
    /// Make and model of the receiver.
    Receiver,
    /// Firmware of the receiver.
    Firmware,
    /// Rate of the position.
    Rate,
    /// Speed of the serial line.
    Baud,
}

impl Dimension {
    /// All dimensions, in listing order.
    pub const ALL: [Dimension; 6] = [
        Dimension::Airframe,
        Dimension::Serial,
        Dimension::Receiver,
        Dimension::Firmware,
        Dimension::Rate,
        Dimension::Baud,
    ];

    /// Its description.
    #[must_use]
    pub fn what(self) -> &'static str {
        match self {
            Dimension::Airframe => "Aircraft",
            Dimension::Serial => "Serial number of the receiver",
            Dimension::Receiver => "Make and model of the receiver",
            Dimension::Firmware => "Firmware of the receiver",
            Dimension::Rate => "Rate of the position",
            Dimension::Baud => "Speed of the serial line",
        }
    }

    /// Its name on the command line and in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Dimension::Airframe => "airframe",
            Dimension::Serial => "serial",
            Dimension::Receiver => "receiver",
            Dimension::Firmware => "firmware",
            Dimension::Rate => "rate",
            Dimension::Baud => "baud",
        }
    }
}

impl Row {
    /// Whether both rows have the same result for the flight, regardless of the runs.
    #[must_use]
    pub fn says_the_same(&self, other: &Row) -> bool {
        let undated = |row: &Row| Row { run_id: String::new(), run_ns: 0, ..row.clone() };
        undated(self) == undated(other)
    }

    /// Codes of the alarms.
    pub fn alarm_codes(&self) -> impl Iterator<Item = &str> {
        self.alarms.as_deref().unwrap_or_default().split_whitespace()
    }
}
