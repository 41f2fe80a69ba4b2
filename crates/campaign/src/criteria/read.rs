//! Resolves a criteria file; every complaint has its line.

use super::applies::AppliesTo;
use super::file::{AppliesTable, CriteriaFile, CriterionTable};
use super::metric::{MetricEntry, Range, Takes};
use super::unit::{Dimension, Quantity, read};
use super::{Criteria, Criterion, ResolvedCriterion};
use compensation_replay::CompensatorKind;
use record::{DecisionRule, Limit};
use settings::{Refused, SettingsError, SettingsFile};
use std::collections::BTreeMap;
use std::path::Path;
use toml::Spanned;

/// Record names of the compensators that always run, in addition to those that a pipeline can request.
const ALWAYS: [&str; 4] = ["raw", "pade-1-1", "pade-1-1-as-seen", "exact-async"];

pub(super) fn from_disk(path: &Path) -> Result<Criteria, SettingsError> {
    parse(&settings::read_text(path)?, path)
}

pub(super) fn parse(text: &str, path: &Path) -> Result<Criteria, SettingsError> {
    let file = SettingsFile::new(text, path);
    let resolved = file.read().and_then(|written| Checker { file: &file, path }.resolve(written));
    file.finish(resolved)
}

/// Checks criteria. Holds the file, so that every complaint has its line.
struct Checker<'a> {
    file: &'a SettingsFile<'a>,
    path: &'a Path,
}

impl Checker<'_> {
    fn resolve(&self, written: CriteriaFile) -> Result<Criteria, Refused> {
        self.file.known_layout(&written.schema)?;
        if written.criterion.is_empty() {
            return Err(self.file.reject_whole("no [[criterion]] found: add at least one"));
        }
        let unique = self.no_id_twice(&written.criterion);
        let criteria: Vec<_> = written.criterion.into_iter().map(|c| self.criterion(c)).collect();
        let file_name = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        unique?;
        Ok(Criteria { title: written.title, file_name, criteria: criteria.into_iter().collect::<Result<_, _>>()? })
    }

    fn no_id_twice(&self, criteria: &[Spanned<CriterionTable>]) -> Result<(), Refused> {
        let mut lines: BTreeMap<&str, usize> = BTreeMap::new();
        let mut unique = Ok(());
        for id in criteria.iter().map(|c| &c.get_ref().id) {
            if let Some(line) = lines.insert(id.get_ref(), self.file.line_of(id)) {
                let what = format!("id \"{}\" is already used by the criterion on line {line}", id.get_ref());
                unique = Err(self.fault(id, what));
            }
        }
        unique
    }

    fn criterion(&self, written: Spanned<CriterionTable>) -> Result<Criterion, Refused> {
        let whole = Spanned::new(written.span(), ());
        let table = written.into_inner();
        let texts = [
            self.id(&table.id),
            self.says_something(&table.title, "title must state the requirement"),
            self.says_something(&table.rationale, "rationale must justify the limit"),
        ];
        let applies_to = table.applies_to.as_ref().map(|a| self.applies_to(a)).transpose();
        let metric = MetricEntry::of(table.metric.get_ref()).map_err(|what| self.fault(&table.metric, what));
        // The rest of a criterion is checked against the most likely metric.
        let entry = metric.or_else(|refused| MetricEntry::nearest(table.metric.get_ref()).ok_or(refused))?;
        let compensator = self.compensator(&table, entry, &whole);
        let channels = self.channels(&table, entry, &whole);
        let limit = self.limit(&table, entry, &whole);
        let rule = self.rule(table.decision.as_ref(), entry);
        metric?;
        texts.into_iter().chain([channels]).collect::<Result<(), _>>()?;
        let (compensator, (limit, quantity), rule) = (compensator?, limit?, rule?);
        let applies_to = applies_to?.unwrap_or_default();
        let decision = (rule == DecisionRule::Value).then_some("value");
        let written =
            ResolvedCriterion { compensator, decision, applies_to: applies_to.clone(), ..resolved(table, entry) };
        Ok(Criterion { entry, limit, unit: quantity.unit, rule, applies_to, written })
    }

    fn id(&self, id: &Spanned<String>) -> Result<(), Refused> {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        match !id.get_ref().is_empty() && id.get_ref().chars().all(plain) {
            true => Ok(()),
            false => Err(self.fault(id, format!("id {:?} may hold only letters, digits, -, _ and .", id.get_ref()))),
        }
    }

    fn says_something(&self, text: &Spanned<String>, what: &str) -> Result<(), Refused> {
        if text.get_ref().trim().is_empty() { Err(self.fault(text, what)) } else { Ok(()) }
    }

    /// The record name of the compensator.
    fn compensator(
        &self,
        table: &CriterionTable,
        entry: &MetricEntry,
        whole: &Spanned<()>,
    ) -> Result<Option<String>, Refused> {
        match (&table.compensator, entry.takes) {
            (None, Takes::Compensator) => {
                let what =
                    format!("missing key `compensator` for {}: for example raw, pade-1-1 or exact-async", entry.name);
                Err(self.fault(whole, what))
            }
            (Some(given), takes) if takes != Takes::Compensator => {
                Err(self.fault(given, format!("compensator has no meaning for {}: remove it", entry.name)))
            }
            (Some(given), _) => {
                let name = recorded_name(given.get_ref()).map_err(|what| self.fault(given, what))?;
                let of_raw = ["correction-rms", "error-ratio"].contains(&entry.name);
                match of_raw && name == "raw" {
                    true => Err(self.fault(given, format!("{} compares with raw: name a compensator", entry.name))),
                    false => Ok(Some(name)),
                }
            }
            (None, _) => Ok(None),
        }
    }

    fn channels(&self, table: &CriterionTable, entry: &MetricEntry, whole: &Spanned<()>) -> Result<(), Refused> {
        let given = |name: &Option<Spanned<String>>, key: &str, allowed: bool| match name {
            Some(name) if !allowed => {
                Err(self.fault(name, format!("{key} has no meaning for {}: remove it", entry.name)))
            }
            Some(name) => self.is_channel(name, name.get_ref()),
            None => Ok(()),
        };
        if entry.takes == Takes::Channel && table.channel.is_none() {
            let what =
                format!("missing key `channel`: name the channel of the {}, such as \"position.gps\"", entry.name);
            return Err(self.fault(whole, what));
        }
        given(&table.channel, "channel", matches!(entry.takes, Takes::Channel | Takes::Pair))?;
        given(&table.against, "against", entry.takes == Takes::Pair)
    }

    fn is_channel<T>(&self, at: &Spanned<T>, name: &str) -> Result<(), Refused> {
        match name.split_once('.').is_some_and(|(quantity, source)| !quantity.is_empty() && !source.is_empty()) {
            true => Ok(()),
            false => Err(self.fault(at, format!("`{name}` is not a channel; names have the form `position.gps`"))),
        }
    }

    /// The one limit that is given.
    fn limit(
        &self,
        table: &CriterionTable,
        entry: &MetricEntry,
        whole: &Spanned<()>,
    ) -> Result<(Limit, Quantity), Refused> {
        let of = |value: &toml::Value, at: &dyn Fn(String) -> Refused| {
            read(value, entry.dimension).map_err(|what| at(format!("{}: {what}", entry.name)))
        };
        match (&table.at_most, &table.at_least, &table.between) {
            (Some(most), None, None) => {
                let quantity = of(most.get_ref(), &|what| self.fault(most, what))?;
                self.keeps_something(most, entry, Limit::AtMost(quantity.si))?;
                Ok((Limit::AtMost(quantity.si), quantity))
            }
            (None, Some(least), None) => {
                let quantity = of(least.get_ref(), &|what| self.fault(least, what))?;
                self.keeps_something(least, entry, Limit::AtLeast(quantity.si))?;
                Ok((Limit::AtLeast(quantity.si), quantity))
            }
            (None, None, Some(pair)) => {
                let [low, high] = pair.get_ref().as_slice() else {
                    return Err(self.fault(pair, "between takes two numbers, the lower first"));
                };
                let low = of(low, &|what| self.fault(pair, what))?;
                let high = of(high, &|what| self.fault(pair, what))?;
                if low.si >= high.si {
                    let what = format!("between: {} is not below {}", low.text(), high.text());
                    return Err(self.fault(pair, what));
                }
                self.keeps_something(pair, entry, Limit::Between([low.si, high.si]))?;
                Ok((Limit::Between([low.si, high.si]), high))
            }
            (None, None, None) => Err(self.fault(whole, "a criterion needs a limit: at_most, at_least or between")),
            _ => Err(self.fault(whole, "a criterion has only one limit: at_most, at_least or between")),
        }
    }

    /// Rejects a limit that all numbers meet, or none: it is a typo.
    fn keeps_something<T>(&self, at: &Spanned<T>, entry: &MetricEntry, limit: Limit) -> Result<(), Refused> {
        let (least, most) = match entry.range {
            Range::Signed => return Ok(()),
            Range::Positive => (0.0, f64::INFINITY),
            Range::Share => (0.0, 1.0),
        };
        let (never, always) = match limit {
            Limit::AtMost(x) => (x < least, x >= most),
            Limit::AtLeast(x) => (x > most, x <= least),
            Limit::Between([low, high]) => (high < least || low > most, low <= least && high >= most),
        };
        let bounds = if most.is_finite() { "from 0 to 100 %" } else { "never below zero" };
        match (never, always) {
            (true, _) => Err(self.fault(at, format!("no flight can meet this limit: {} is {bounds}", entry.name))),
            (_, true) => Err(self.fault(at, format!("every flight meets this limit: {} is {bounds}", entry.name))),
            _ => Ok(()),
        }
    }

    fn rule(&self, decision: Option<&Spanned<String>>, entry: &MetricEntry) -> Result<DecisionRule, Refused> {
        match (decision, entry.uncertain) {
            (None, true) => Ok(DecisionRule::Interval),
            (None, false) => Ok(DecisionRule::Plain),
            (Some(given), false) => {
                let what = format!("decision has no meaning for {}: this metric has no uncertainty", entry.name);
                Err(self.fault(given, what))
            }
            (Some(given), true) => match given.get_ref().as_str() {
                "interval" => Ok(DecisionRule::Interval),
                "value" => Ok(DecisionRule::Value),
                other => Err(self.fault(given, format!("decision is \"interval\" or \"value\", not {other:?}"))),
            },
        }
    }

    fn applies_to(&self, written: &Spanned<AppliesTable>) -> Result<AppliesTo, Refused> {
        let AppliesTable { flights, maps, channels, reference, duration_at_least } = written.get_ref();
        if let Some(channels) = channels {
            let exact = channels.get_ref().iter().filter(|name| !name.contains('*'));
            exact.into_iter().try_for_each(|name| self.is_channel(channels, name))?;
        }
        if let Some(reference) = reference.as_ref().filter(|r| !r.get_ref()) {
            return Err(self.fault(reference, "applies_to.reference must be true; remove it otherwise"));
        }
        let resolved = AppliesTo {
            flights: self.names(flights, "flights")?,
            maps: self.names(maps, "maps")?,
            channels: self.names(channels, "channels")?,
            reference: reference.is_some(),
            duration_at_least_s: duration_at_least.as_ref().map(|d| self.duration(d)).transpose()?,
        };
        // A key that was rejected leaves the table empty.
        match resolved.is_everything() && !self.file.has_complaints() {
            true => Err(self.fault(written, "applies_to is empty: remove it to include all flights")),
            false => Ok(resolved),
        }
    }

    fn duration(&self, written: &Spanned<toml::Value>) -> Result<f64, Refused> {
        let wrong = |what: String| self.fault(written, format!("applies_to.duration_at_least: {what}"));
        let seconds = read(written.get_ref(), Dimension::Time).map_err(wrong)?.si;
        if seconds > 0.0 { Ok(seconds) } else { Err(wrong("must be above zero".to_owned())) }
    }

    fn names(&self, written: &Option<Spanned<Vec<String>>>, key: &str) -> Result<Vec<String>, Refused> {
        let Some(list) = written else { return Ok(vec![]) };
        match list.get_ref().is_empty() || list.get_ref().iter().any(|name| name.trim().is_empty()) {
            true => Err(self.fault(
                list,
                format!(
                    "applies_to.{key} needs at least one name, and names must not be \
                empty"
                ),
            )),
            false => Ok(list.get_ref().clone()),
        }
    }

    fn fault<T>(&self, at: &Spanned<T>, what: impl Into<String>) -> Refused {
        self.file.reject(at, what)
    }
}

/// The resolved keys of a valid criterion, without compensator, decision and applies_to.
fn resolved(table: CriterionTable, entry: &MetricEntry) -> ResolvedCriterion {
    let one = |value: &toml::Value| read(value, entry.dimension).ok().map(|q| in_toml(&q, entry.dimension));
    let limit = |value: Option<Spanned<toml::Value>>| value.and_then(|value| one(value.get_ref()));
    let name = |name: Option<Spanned<String>>| name.map(Spanned::into_inner);
    ResolvedCriterion {
        metric: entry.name.to_owned(),
        at_most: limit(table.at_most),
        at_least: limit(table.at_least),
        between: table.between.and_then(|pair| {
            let [low, high] = pair.get_ref().as_slice() else { return None };
            Some([one(low)?, one(high)?])
        }),
        compensator: None,
        channel: name(table.channel),
        against: name(table.against),
        decision: None,
        id: table.id.into_inner(),
        title: table.title.into_inner(),
        rationale: table.rationale.into_inner(),
        applies_to: AppliesTo::default(),
    }
}

/// The record name of a compensator.
fn recorded_name(name: &str) -> Result<String, String> {
    if ALWAYS.contains(&name) {
        return Ok(name.to_owned());
    }
    let kind: CompensatorKind = name.parse().map_err(|e| format!("{e}. Criteria also take {}", ALWAYS.join(", ")))?;
    let name = kind.to_string();
    Ok(if name == "pade-1-1-tustin" { "pade-1-1".to_owned() } else { name })
}

/// A quantity in the form of a criteria file.
fn in_toml(quantity: &Quantity, dimension: Dimension) -> toml::Value {
    match dimension {
        Dimension::Count => toml::Value::Integer(quantity.written as i64),
        Dimension::Ratio => toml::Value::Float(quantity.written),
        _ => toml::Value::String(quantity.text()),
    }
}
