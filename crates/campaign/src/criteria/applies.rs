//! Which flights a criterion applies to.

use super::measure::Subject;
use crate::pattern::{any_matches, matches};
use serde::Serialize;

/// All given conditions must hold; `*` in a name matches anything.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(super) struct AppliesTo {
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) flights: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) maps: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) channels: Vec<String>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(super) reference: bool,
    #[serde(rename = "duration_at_least", skip_serializing_if = "Option::is_none", serialize_with = "in_seconds")]
    pub(super) duration_at_least_s: Option<f64>,
}

fn in_seconds<S: serde::Serializer>(seconds: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{} s", seconds.unwrap_or_default()))
}

/// Whether a criterion applies to a flight.
pub(super) enum Applying {
    Yes,
    /// No, with the reason.
    No(String),
    /// Unknown, with the reason.
    CannotTell(String),
}

impl AppliesTo {
    pub(super) fn is_everything(&self) -> bool {
        *self == AppliesTo::default()
    }

    /// The first condition that does not hold decides; unknown conditions have lower priority.
    pub(super) fn applies(&self, flight: &str, subject: &Subject<'_>) -> Applying {
        let all = [self.flight(flight), self.map(subject), self.channels(subject), self.replay(subject)];
        let mut unsure = None;
        for one in all {
            match one {
                Applying::Yes => {}
                Applying::No(why) => return Applying::No(why),
                Applying::CannotTell(why) => unsure = unsure.or(Some(why)),
            }
        }
        unsure.map_or(Applying::Yes, Applying::CannotTell)
    }

    fn flight(&self, flight: &str) -> Applying {
        match self.flights.is_empty() || any_matches(&self.flights, flight) {
            true => Applying::Yes,
            false => Applying::No(format!("applies to flights called {}", self.flights.join(", "))),
        }
    }

    fn map(&self, subject: &Subject<'_>) -> Applying {
        match &subject.record.binding {
            _ if self.maps.is_empty() => Applying::Yes,
            None => Applying::CannotTell("no channel map was found for this log".to_owned()),
            Some(binding) if any_matches(&self.maps, &binding.map) => Applying::Yes,
            Some(binding) => {
                let maps = self.maps.join(", ");
                Applying::No(format!("applies to logs read with the map {maps}; this one is read with {}", binding.map))
            }
        }
    }

    fn channels(&self, subject: &Subject<'_>) -> Applying {
        let Some(binding) = &subject.record.binding else {
            let unknown = || Applying::CannotTell("no channel of this log is known".to_owned());
            return if self.channels.is_empty() { Applying::Yes } else { unknown() };
        };
        let holds = |wanted: &&String| binding.channels.iter().any(|c| matches(wanted, &c.name));
        match self.channels.iter().find(|wanted| !holds(wanted)) {
            None => Applying::Yes,
            Some(missing) => Applying::No(format!("applies to flights with {missing}")),
        }
    }

    /// The conditions that need the replay.
    fn replay(&self, subject: &Subject<'_>) -> Applying {
        if !self.reference && self.duration_at_least_s.is_none() {
            return Applying::Yes;
        }
        if self.reference && subject.has_reference() == Some(false) {
            return Applying::No("applies to flights with a reference to score against".to_owned());
        }
        let replay = match subject.replayed() {
            Ok(replay) => replay,
            Err(why) => return Applying::CannotTell(why),
        };
        match self.duration_at_least_s {
            Some(least) if replay.coverage.duration_s < least => {
                Applying::No(format!("applies to flights of at least {least} s"))
            }
            _ => Applying::Yes,
        }
    }
}
