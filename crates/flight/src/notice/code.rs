//! Codes of notices and alarms: the types of the catalogue.

use super::Severity;
use super::catalogue::{Alarm, Code, FORMER};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// How grave an alarm is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Gravity {
    /// The number must not be used as it is.
    Red,
    /// The number is doubtful, its interval is wider for it.
    Amber,
    /// Good to know.
    Grey,
}

impl Gravity {
    /// As it is serialised and shown.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Gravity::Red => "red",
            Gravity::Amber => "amber",
            Gravity::Grey => "grey",
        }
    }
}

/// What the catalogue says about a code of a notice.
#[derive(Debug, Clone, Copy)]
pub struct CodeEntry {
    /// The stable name, such as `duplicate-stamp`.
    pub name: &'static str,
    /// Section of the catalogue.
    pub section: &'static str,
    /// The severities that a notice with this code can have, usual one first.
    pub severities: &'static [Severity],
    /// What happened.
    pub happened: &'static str,
    /// What the reader can do about it.
    pub advice: &'static str,
}

/// What the catalogue says about a code of an alarm.
#[derive(Debug, Clone, Copy)]
pub struct AlarmEntry {
    /// The stable name, such as `two-delays-fit`.
    pub name: &'static str,
    /// How grave it is.
    pub gravity: Gravity,
    /// What happened.
    pub happened: &'static str,
    /// What the reader can do about it.
    pub advice: &'static str,
}

/// A code with the severity of this occurrence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Graded {
    pub(super) code: Code,
    pub(super) severity: Severity,
}

impl Graded {
    /// The code without its severity.
    #[must_use]
    pub fn code(self) -> Code {
        self.code
    }
}

impl From<Code> for Graded {
    /// Uses the usual severity of the code.
    fn from(code: Code) -> Graded {
        Graded { code, severity: code.entry().severities[0] }
    }
}

impl Code {
    /// This code with a severity other than its usual one.
    #[must_use]
    pub fn at(self, severity: Severity) -> Graded {
        debug_assert!(self.entry().severities.contains(&severity), "{self} is never {severity:?}");
        Graded { code: self, severity }
    }

    /// The stable name, such as `duplicate-stamp`.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.entry().name
    }

    /// The code with this name.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Code> {
        Code::ALL.iter().copied().find(|code| code.name() == name)
    }

    /// The code that replaced this former one: records of older releases contain such names.
    #[must_use]
    pub fn of_former(name: &str) -> Option<Code> {
        FORMER.iter().find(|(_, former)| former.split(' ').any(|former| former == name)).map(|(code, _)| *code)
    }

    /// Names in older releases that this code replaced.
    pub fn former(self) -> impl Iterator<Item = &'static str> {
        FORMER.iter().filter(move |(code, _)| *code == self).flat_map(|(_, former)| former.split(' '))
    }
}

impl Alarm {
    /// The stable name, such as `two-delays-fit`.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.entry().name
    }

    /// Severity of the alarm.
    #[must_use]
    pub fn gravity(self) -> Gravity {
        self.entry().gravity
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl PartialEq<Code> for String {
    fn eq(&self, code: &Code) -> bool {
        self == code.name()
    }
}

impl PartialEq<Alarm> for String {
    fn eq(&self, alarm: &Alarm) -> bool {
        self == alarm.name()
    }
}

/// Generates the two enums and their entries from the table in `catalogue.rs`.
macro_rules! catalogue {
    (
        notices {$($section:literal {
            $($code:ident, $name:literal, [$($severity:ident),+], $happened:literal, $advice:literal;)+
        })+}
        alarms {$(
            $alarm:ident, $alarm_name:literal, $gravity:ident, $alarm_happened:literal, $alarm_advice:literal;
        )+}
    ) => {
        /// What a notice is about.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Code {$($(
            #[doc = $happened]
            $code,
        )+)+}

        /// What an alarm of a delay is about.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Alarm {$(
            #[doc = $alarm_happened]
            $alarm,
        )+}

        impl Code {
            /// All codes, in the order of the catalogue.
            pub const ALL: &[Code] = &[$($(Code::$code),+),+];

            /// Its entry in the catalogue.
            #[must_use]
            pub fn entry(self) -> &'static $crate::notice::CodeEntry {
                match self {$($(
                    Code::$code => &$crate::notice::CodeEntry {
                        name: $name,
                        section: $section,
                        severities: &[$($crate::notice::Severity::$severity),+],
                        happened: $happened,
                        advice: $advice,
                    },
                )+)+}
            }
        }

        impl Alarm {
            /// All alarms, in the order of the catalogue.
            pub const ALL: &[Alarm] = &[$(Alarm::$alarm),+];

            /// Its entry in the catalogue.
            #[must_use]
            pub fn entry(self) -> &'static $crate::notice::AlarmEntry {
                match self {$(
                    Alarm::$alarm => &$crate::notice::AlarmEntry {
                        name: $alarm_name,
                        gravity: $crate::notice::Gravity::$gravity,
                        happened: $alarm_happened,
                        advice: $alarm_advice,
                    },
                )+}
            }
        }
    };
}

pub(super) use catalogue;
