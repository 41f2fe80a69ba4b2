//! The delay of one flight from a sensor card, for the flight's channels and day.

use super::{Case, FoundDelay, milliseconds};
use crate::cards::UsedCard;
use crate::rate::rate_of;
use bench_analysis::sensor_name;
use flight::{Channel, Clock, Code, Delay, Graded, Notices, Severity, Stamp, UtcTie};
use jiff::civil::Date;
use jiff::tz::TimeZone;
use record::{CardChannel, CardUse, SensorCard, TimeBasis, Verdict};

/// The largest relative difference of the update rates of flight and bench with one configuration.
const RATE_TOLERANCE: f64 = 0.2;

/// The delay of a flight from the best of these cards, or why there is none to remove.
pub(super) fn delay_of(cards: &[UsedCard], case: &Case<'_>) -> Result<FoundDelay, String> {
    let days = case.days();
    let used = best(cards, days).ok_or("there is no sensor card")?;
    if let Some(why) = contradicting(cards, used, days, case.position.0) {
        return Err(why);
    }
    Reading { used, card: used.card(), case, days, notices: Notices::new() }.delay()
}

/// The UTC instant of a timestamp; `None` for a clock that neither has the date nor is tied to UTC by the log.
fn instant(tie: Option<&UtcTie>, clock: Clock, stamp: Stamp) -> Option<jiff::Timestamp> {
    let tied = || tie.filter(|tie| tie.clock == clock)?.unix(stamp);
    let unix = clock.unix(stamp).or_else(tied)?;
    jiff::Timestamp::from_nanosecond(i128::from(unix.0)).ok()
}

/// First and last UTC day of a flight.
type Days = (Date, Date);

impl Case<'_> {
    /// The days of the flight: from its position's timestamps, else from any channel with UTC.
    fn days(&self) -> Option<Days> {
        let others = self.flight.channels.values();
        std::iter::once(self.position.1).chain(others).find_map(|channel| days_of(self.flight.utc.as_ref(), channel))
    }
}

fn days_of(tie: Option<&UtcTie>, channel: &Channel) -> Option<Days> {
    let timeline = channel.series.timeline();
    let primary = (timeline.clock(), timeline.stamps());
    let others = channel.other_stamps.iter().map(|(_, clock, stamps)| (*clock, stamps.as_slice()));
    std::iter::once(primary).chain(others).find_map(|(clock, stamps)| {
        let least = stamps.iter().min()?;
        let day = |stamp| Some(instant(tie, clock, stamp)?.to_zoned(TimeZone::UTC).date());
        Some((day(*least)?, day(*stamps.iter().max()?)?))
    })
}

/// A date of a card, which was checked when the card was read.
fn date(text: Option<&String>) -> Option<Date> {
    text.and_then(|t| t.parse().ok())
}

/// Whether a card is valid on the days of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Validity {
    Valid,
    /// The card has no dates.
    Unlimited,
    /// The date of the flight is unknown.
    DayUnknown,
    Expired(Date),
    NotYet(Date),
}

impl Validity {
    fn of(card: &SensorCard, days: Option<Days>) -> Validity {
        let (from, until) = (date(card.valid_from.as_ref()), date(card.valid_until.as_ref()));
        match (from, until, days) {
            (None, None, _) => Validity::Unlimited,
            (_, _, None) => Validity::DayUnknown,
            (_, Some(until), Some((_, last))) if last > until => Validity::Expired(until),
            (Some(from), _, Some((first, _))) if first < from => Validity::NotYet(from),
            _ => Validity::Valid,
        }
    }

    fn is_doubtful(self) -> bool {
        matches!(self, Validity::Expired(_) | Validity::NotYet(_))
    }
}

/// The best of several cards of a sensor: one that is valid on the flight's days before others, then the newest.
fn best(cards: &[UsedCard], days: Option<Days>) -> Option<&UsedCard> {
    let rank = |used: &&UsedCard| {
        let card = used.card();
        (!Validity::of(card, days).is_doubtful(), date(card.measured_on.as_ref()), used.name().to_owned())
    };
    cards.iter().max_by_key(rank)
}

/// Why no card can be used: another one is as valid and as new as `used`, and contradicts its delay of a channel.
fn contradicting(cards: &[UsedCard], used: &UsedCard, days: Option<Days>, channel: &str) -> Option<String> {
    const LEAST_S: f64 = 1e-3;
    const CERTAIN_U: f64 = 3.0;
    let lateness_of = |used: &UsedCard| {
        let found = used.card().channels.iter().find(|c| c.name == channel)?;
        Some(found.lateness_in_flight_s())
    };
    let own = lateness_of(used)?;
    cards.iter().filter(|other| other.name() != used.name()).find_map(|other| {
        let rank = |used: &UsedCard| (Validity::of(used.card(), days).is_doubtful(), used.card().measured_on.clone());
        let theirs = lateness_of(other).filter(|_| rank(other) == rank(used))?;
        let u_s = own.standard_uncertainty.unwrap_or(0.0).hypot(theirs.standard_uncertainty.unwrap_or(0.0));
        ((own.value - theirs.value).abs() > LEAST_S.max(CERTAIN_U * u_s)).then(|| {
            let [a, b] = [&own, &theirs].map(crate::delay::in_ms);
            let [one, two] = [used.name(), other.name()];
            let when = match &used.card().measured_on {
                Some(day) => format!("are of the same day ({day})"),
                None => "have no date of measurement".to_owned(),
            };
            format!(
                "{one} and {two} {when}, and say that {channel} is {a} and {b} ms late: remove the card that is wrong"
            )
        })
    })
}

/// A card applied to a flight.
struct Reading<'a> {
    used: &'a UsedCard,
    card: &'a SensorCard,
    case: &'a Case<'a>,
    days: Option<Days>,
    notices: Notices,
}

impl<'a> Reading<'a> {
    fn delay(mut self) -> Result<FoundDelay, String> {
        let position = self.position()?;
        let nothing = || format!("{}: {} is not late: nothing to remove", self.used.name(), position.name);
        let estimate = position.lateness_in_flight_s();
        let delay = Delay::from_seconds(estimate.value).filter(|d| d.seconds() > 0.0).ok_or_else(nothing)?;
        self.warn_of_configuration(position, self.case.position);
        self.warn_of_lag(position);
        self.warn_of_rig(position);
        self.warn_of_basis(position);
        self.report_velocity();
        let validity = self.validity();
        let source = format!("{}{validity}", self.origin(position));
        let card = CardUse {
            file: self.used.name().to_owned(),
            blake3: self.used.blake3().to_owned(),
            sensor: self.card.sensor.clone(),
            channel: position.name.clone(),
            delay_s: estimate,
            velocity_delay_s: self.velocity().map(CardChannel::lateness_in_flight_s),
        };
        Ok(FoundDelay {
            delay,
            standard_uncertainty_s: estimate.standard_uncertainty,
            source,
            card: Some(card),
            notices: self.notices,
        })
    }

    fn add_notice(&mut self, what: impl Into<Graded>, text: String) {
        self.notices.push(what, self.used.name(), 1, text);
    }

    /// The card's entry for the replayed position.
    fn position(&self) -> Result<&'a CardChannel, String> {
        let name = self.case.position.0;
        let file = self.used.name();
        let position = self.card.channels.iter().find(|c| c.name == name).ok_or_else(|| {
            let held: Vec<&str> = self.card.channels.iter().map(|c| c.name.as_str()).collect();
            format!(
                "{file}: this flight replays the channel {name}, which is not on the card; the card has {}",
                held.join(", ")
            )
        })?;
        let delay = milliseconds(position.delay_s, position.delay_standard_uncertainty_s);
        let nothing = match position.verdict {
            Verdict::Delayed => return Ok(position),
            Verdict::Early => "early: only a late position can be compensated",
            Verdict::EquivalentToZero => "equivalent to zero: nothing to remove",
            Verdict::Inconclusive => "inconclusive: whether there is a delay to remove is unknown",
            Verdict::NotMeasurable => "not measurable: whether there is a delay to remove is unknown",
        };
        Err(format!("{file}: the delay of {name}, {delay} ms, is {nothing}"))
    }

    /// Reports a late velocity. It changes nothing in first order: position plus the integral of velocity over the
    /// lateness of the position is on time, and −a·Tp·Tv remains (design note 5.6, delay network 1).
    fn report_velocity(&mut self) {
        let name = self.case.velocity.0;
        let is_late = |c: &&CardChannel| matches!(c.verdict, Verdict::Delayed | Verdict::Early);
        let Some(velocity) = self.velocity().filter(is_late) else { return };
        let late_s = velocity.lateness_in_flight_s();
        let shown = milliseconds(late_s.value, late_s.standard_uncertainty.unwrap_or_default());
        let text = format!(
            "{name} is itself {shown} ms late: the lateness of the position is removed anyway, and an error of \
             acceleration times both delays remains"
        );
        self.add_notice(Code::CardResidual.at(Severity::Info), text);
    }

    /// The card's entry for the velocity that compensates, if it was measured.
    fn velocity(&self) -> Option<&'a CardChannel> {
        let name = self.case.velocity.0;
        let is_measured =
            |c: &&CardChannel| c.name == name && !matches!(c.verdict, Verdict::NotMeasurable | Verdict::Inconclusive);
        self.card.channels.iter().find(is_measured)
    }

    /// Warns of a lag that is removed as a delay: the number is right for slow motion, and fast motion has another.
    fn warn_of_lag(&mut self, on_card: &CardChannel) {
        if on_card.lags_s.iter().all(|lag| *lag <= 0.0) {
            return;
        }
        let fast = format!("the pure delay that fits the swing on the bench best, {:.1} ms", 1e3 * on_card.delay_s);
        let removed_s = on_card.lateness_in_flight_s().value;
        let what = match removed_s == on_card.delay_s {
            true => format!("{fast}; the card does not state how late slow motion is"),
            false => format!(
                "the lateness of slow motion, {:.1} ms; motion as fast as the swing has {fast}",
                1e3 * removed_s
            ),
        };
        let text = format!("{} shows {}; it is removed as {what}", on_card.name, on_card.model);
        self.add_notice(Code::CardResidual, text);
    }

    fn warn_of_rig(&mut self, on_card: &CardChannel) {
        if !on_card.contradicted.is_empty() {
            let text = format!(
                "{}: the bench marked its delay as doubtful ({}): correct the named cause and measure again",
                on_card.name,
                on_card.contradicted.join(", ")
            );
            self.add_notice(Code::RigContradicted, text);
        }
    }

    /// Warns of a weak clock tie: a delay is only as good as what tied the clocks of the bench.
    fn warn_of_basis(&mut self, position: &CardChannel) {
        let text = match &position.basis {
            TimeBasis::OneClock | TimeBasis::Pps => return,
            TimeBasis::FastestArrivals => format!(
                "{}: the clocks of the bench were tied by the fastest arrivals: the delay includes the least \
                 transport latency to the logger",
                position.name
            ),
            TimeBasis::Anchor { channel } => format!(
                "{}: the delay is relative to {channel}, which the bench assumed to be on time: the lateness of \
                 {channel} is not included",
                position.name
            ),
        };
        self.add_notice(Code::CardRelative, text);
    }

    /// Compares timestamps and update rate of the flight with those on the bench.
    fn warn_of_configuration(&mut self, on_card: &CardChannel, (name, channel): (&str, &Channel)) {
        let (kind, bench) = (channel.series.timeline().kind(), on_card.stamp_kind);
        if kind != bench {
            let text = format!(
                "{name}: this flight has {kind} timestamps, but the bench measured the delay of \
                {bench} ones"
            );
            self.add_notice(Code::CardMismatch, text);
        }
        let rates = rate_of(&self.case.binding.channels, name).zip(on_card.update_rate_hz);
        if let Some((rate, bench)) = rates.filter(|(rate, bench)| (rate / bench - 1.0).abs() > RATE_TOLERANCE) {
            let text = format!("{name}: updates at {rate:.2} Hz in this flight, at {bench:.2} Hz on the bench");
            self.add_notice(Code::CardConditions, text);
        }
    }

    /// Whether the card is valid on this day, as the end of the sentence about the source.
    fn validity(&mut self) -> String {
        let flown = |(first, last): Days| if first == last { first.to_string() } else { format!("{first} to {last}") };
        let flown = self.days.map(flown).unwrap_or_default();
        match Validity::of(self.card, self.days) {
            Validity::Valid | Validity::Unlimited => String::new(),
            Validity::DayUnknown => {
                let text = "no timestamp of this flight has a date, so it is unknown whether the card is valid";
                self.add_notice(Code::CardConditions, text.to_owned());
                "; the day of the flight is unknown".to_owned()
            }
            Validity::Expired(until) => {
                let text = format!("flown on {flown}, but the card expired on {until}: its delay is used anyway");
                self.add_notice(Code::CardMismatch, text);
                format!("; EXPIRED on {until}")
            }
            Validity::NotYet(from) => {
                let text =
                    format!("flown on {flown}, before the card becomes valid on {from}: its delay is used anyway");
                self.add_notice(Code::CardMismatch, text);
                format!("; NOT YET VALID, only from {from} on")
            }
        }
    }

    fn origin(&self, position: &CardChannel) -> String {
        let sensor = sensor_name(&self.card.sensor);
        let day = self.card.measured_on.as_ref().map(|day| format!(", measured on {day}")).unwrap_or_default();
        let records =
            if position.records == 1 { "1 record".to_owned() } else { format!("{} records", position.records) };
        let late_s = position.lateness_in_flight_s();
        let shown = milliseconds(late_s.value, late_s.standard_uncertainty.unwrap_or_default());
        format!("sensor card {} of {sensor}{day}, {records}: {} {shown} ms (k = 2)", self.used.name(), position.name)
    }
}
