//! Maps the sensor's timestamps to the encoder's clock (design note 6).
//!
//! One logger: timestamps of the encoder's own clock are used unchanged; timestamps of a device's clock are mapped by a
//! pulse per second, or by the lower hull of the arrivals as fallback. Two loggers, or no mapping: the recordings are
//! aligned by the bar's rate, and every delay is relative to the anchor channel.

use crate::rig::{Rig, StampChoice};
use crate::verdict::millis;
use flight::{
    Channel, Clock, Code, Distribution, Flight, Notices, Quantity, RejectCount, Series, Stamp, StampKind, Timeline,
};
use record::{Finding, HullFinding, LatencyHistogram, PpsFinding, TimeBasis};
use signal::{CoarseLag, HullLine, PiecewiseClock, coarse_lag, lower_hull, percentile_of_sorted};
use std::collections::BTreeMap;

/// Minimum number of timestamp pairs for a hull.
const LEAST_HULL_STAMPS: usize = 30;
/// Grid for aligning two recordings of the bar's rate, Hz.
const COARSE_RATE_HZ: f64 = 50.0;
/// Peaks closer than this to the best are the same peak, s.
const SAME_PEAK_S: f64 = 0.25;
/// Minimum correlation of an alignment.
const LEAST_CORRELATION: f64 = 0.7;
/// Another alignment whose correlation is at least this share of the best one is reported.
const RIVAL_SHARE: f64 = 0.95;
/// Number of bins of a latency histogram, up to the 99th percentile.
const HISTOGRAM_BINS: usize = 40;

/// The encoder: time and rate of the bar, rad/s.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EncoderRate<'a> {
    pub(crate) clock: Clock,
    /// Time zero of `t_s`.
    pub(crate) origin: Stamp,
    pub(crate) t_s: &'a [f64],
    pub(crate) rate: &'a [f64],
}

/// Which timestamps are used to measure a channel.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ChannelTime {
    pub(crate) kind: StampKind,
    /// The clock of these stamps as logged.
    pub(crate) clock: Clock,
    /// Arrival minus device time, if both are logged.
    pub(crate) latency: Finding<LatencyHistogram>,
}

/// The sensor's channels in the encoder's clock.
#[derive(Debug)]
pub(crate) struct Tied {
    /// Channels with mapped timestamps. Those that cannot be mapped are missing, with a notice.
    pub(crate) flight: Flight,
    pub(crate) times: BTreeMap<String, ChannelTime>,
    pub(crate) basis: TimeBasis,
    /// Which delays are absolute and which are relative.
    pub(crate) statement: String,
    pub(crate) hull: Option<HullFinding>,
    pub(crate) pps: Option<PpsFinding>,
    pub(crate) notices: Notices,
}

/// Maps every channel of `sensor` to the encoder's clock. `one_log`: one logger timestamped both.
///
/// # Errors
/// The recordings cannot be aligned; the text gives the reason.
pub(crate) fn tie(sensor: &Flight, encoder: EncoderRate<'_>, rig: &Rig, one_log: bool) -> Result<Tied, String> {
    let shared = rig.clock.shared.unwrap_or(one_log);
    let tied = if shared { tie_by_logger(sensor, encoder, rig) } else { None };
    tied.map_or_else(|| tie_by_anchor(sensor, encoder, rig), Ok)
}

/// The same channels with timestamps moved by `shift_s` plus `skew` times the distance from `middle_s`, all in the
/// encoder's clock: the correction for the anchor and the joint skew. Rows that no longer increase are dropped, with a
/// notice of the flight.
pub(crate) fn moved(flight: &Flight, origin: Stamp, shift_s: f64, skew: f64, middle_s: f64) -> Flight {
    let to = |stamp: Stamp| {
        let t = stamp.seconds_since(origin);
        stamp.plus_seconds(shift_s + skew * (t - middle_s))
    };
    let mut notices = Notices::new();
    let channels = flight.channels.iter().filter_map(|(name, channel)| {
        let stamps = primary(channel);
        Some((name.clone(), retimed(name, channel, &stamps, stamps.clock, to, &mut notices)?))
    });
    let channels = channels.collect();
    Flight { channels, notices, utc: flight.utc.clone() }
}

/// One kind of timestamps of a channel.
#[derive(Debug, Clone)]
struct Stamps<'a> {
    kind: StampKind,
    clock: Clock,
    stamps: &'a [Stamp],
}

fn primary(channel: &Channel) -> Stamps<'_> {
    let timeline = channel.series.timeline();
    Stamps { kind: timeline.kind(), clock: timeline.clock(), stamps: timeline.stamps() }
}

fn all_stamps(channel: &Channel) -> impl Iterator<Item = Stamps<'_>> {
    let others = channel.other_stamps.iter().map(|(kind, clock, stamps)| Stamps { kind: *kind, clock: *clock, stamps });
    std::iter::once(primary(channel)).chain(others)
}

/// The timestamps that the rig file selects: those of a kind, or those chosen by the channel map.
fn asked_for<'a>(channel: &'a Channel, rig: &Rig) -> Option<Stamps<'a>> {
    let kind = match rig.clock.stamps {
        StampChoice::Auto => return Some(primary(channel)),
        StampChoice::Measured => StampKind::Measured,
        StampChoice::Published => StampKind::Published,
        StampChoice::Logged => StampKind::Logged,
    };
    all_stamps(channel).find(|s| s.kind == kind)
}

/// Channels that the bar moves.
fn sensed(flight: &Flight) -> impl Iterator<Item = (&String, &Channel)> {
    flight.channels.iter().filter(|(_, channel)| is_sensed(channel.quantity))
}

/// Whether the swing of the bar affects the quantity of a channel.
pub(crate) fn is_sensed(quantity: Quantity) -> bool {
    use Quantity::{EncoderAngle, EncoderCount, Pulse, Scalar};
    !matches!(quantity, EncoderAngle | EncoderCount | Pulse | Scalar)
}

/// `None` if no channel can be mapped this way.
fn tie_by_logger(sensor: &Flight, encoder: EncoderRate<'_>, rig: &Rig) -> Option<Tied> {
    let mut notices = Notices::new();
    let mut flight = Flight::default();
    let mut times = BTreeMap::new();
    let pps = pulse_clock(sensor, encoder, &mut notices);
    let hulls = if pps.is_none() { hulls(sensor, encoder.clock, &mut notices) } else { BTreeMap::new() };
    let mut bridge = Bridge { encoder, pps, hulls, used: Ways::default() };
    for (name, channel) in sensed(sensor) {
        let Some(stamps) = asked_for(channel, rig) else {
            let text =
                format!("channel {name} has no timestamps of the kind that the rig file asks for; it is skipped");
            notices.push(Code::ClockTie, name, channel.series.len() as u64, text);
            continue;
        };
        if let Some(mapped) = bridge.mapped(name, channel, &stamps, &mut notices) {
            let latency = latency(channel, bridge.hulls.get(&clock_key(channel.series.timeline().clock())));
            times.insert(name.clone(), ChannelTime { kind: stamps.kind, clock: stamps.clock, latency });
            flight.channels.insert(name.clone(), mapped);
        }
    }
    let Bridge { pps, hulls, used, .. } = bridge;
    let basis = match used {
        Ways { pps: true, .. } => TimeBasis::Pps,
        Ways { hull: true, .. } => TimeBasis::FastestArrivals,
        Ways { .. } => TimeBasis::OneClock,
    };
    (!flight.channels.is_empty()).then(|| Tied {
        flight,
        times,
        basis,
        statement: used.statement(),
        hull: hulls.into_values().next().map(|hull| hull.finding),
        pps: pps.map(|(name, clock)| pulse_finding(name, &clock)),
        notices,
    })
}

/// Mappings from device clocks to the encoder's.
struct Bridge<'a> {
    encoder: EncoderRate<'a>,
    /// Channel of the pulse, and the resulting clock.
    pps: Option<(&'a str, PiecewiseClock)>,
    hulls: BTreeMap<u8, Hull>,
    used: Ways,
}

impl Bridge<'_> {
    /// The channel in the encoder's clock; `None`, with a notice, if there is no mapping.
    fn mapped(&mut self, name: &str, channel: &Channel, stamps: &Stamps<'_>, notices: &mut Notices) -> Option<Channel> {
        let encoder = self.encoder;
        if stamps.clock == encoder.clock {
            self.used.direct = true;
            return retimed(name, channel, stamps, encoder.clock, |s| s, notices);
        }
        if let Some((_, clock)) = &self.pps {
            self.used.pps = true;
            let map = |s: Stamp| encoder.origin.plus_seconds(clock.logger_at(s.seconds_since(Stamp(0))));
            return retimed(name, channel, stamps, encoder.clock, map, notices);
        }
        if let Some(hull) = self.hulls.get(&clock_key(stamps.clock)) {
            self.used.hull = true;
            return retimed(name, channel, stamps, encoder.clock, |s| hull.map(s), notices);
        }
        let text = format!(
            "channel {name}: the relation of its clock ({}) to the encoder's ({}) is unknown; it is not used",
            stamps.clock, encoder.clock
        );
        notices.push(Code::ClockTie, name, channel.series.len() as u64, text);
        None
    }
}

/// Which mappings were used.
#[derive(Debug, Default)]
struct Ways {
    direct: bool,
    hull: bool,
    pps: bool,
}

impl Ways {
    fn statement(&self) -> String {
        let mut parts = vec![];
        if self.direct {
            parts.push(
                "One clock timestamped encoder and sensor: delays are absolute, except for the time that the logger \
                 takes to timestamp each.",
            );
        }
        if self.pps {
            parts.push(
                "A pulse per second relates the device's clock to the encoder's: delays are absolute and exclude \
                 transport.",
            );
        }
        if self.hull {
            parts.push(
                "Device timestamps were mapped to the encoder's clock by the fastest arrivals: delays are absolute \
                 except for the least transport latency, which is not logged.",
            );
        }
        parts.join(" ")
    }
}

/// Sort key, as clocks have no order of their own.
fn clock_key(clock: Clock) -> u8 {
    match clock {
        Clock::Unix => 0,
        Clock::Gps => 1,
        Clock::Boot => 2,
        Clock::Elapsed => 3,
    }
}

/// The pulse per second timestamped by the encoder's logger, in seconds after the encoder's origin.
fn pulse_clock<'a>(
    sensor: &'a Flight,
    encoder: EncoderRate<'_>,
    notices: &mut Notices,
) -> Option<(&'a str, PiecewiseClock)> {
    let (name, channel) = sensor.channels.iter().find(|(_, c)| c.quantity == Quantity::Pulse)?;
    let stamps = all_stamps(channel).find(|s| s.clock == encoder.clock)?;
    let logger_s: Vec<f64> = stamps.stamps.iter().map(|s| s.seconds_since(encoder.origin)).collect();
    let first_second = channel.series.component(0).first().copied()?;
    match PiecewiseClock::from_pulses(&logger_s, first_second) {
        Ok(clock) => Some((name, clock)),
        Err(error) => {
            notices.push(Code::ClockTie, name, logger_s.len() as u64, error.to_string());
            None
        }
    }
}

fn pulse_finding(name: &str, clock: &PiecewiseClock) -> PpsFinding {
    let reject =
        |reason: &str, count: usize| RejectCount { reason: reason.into(), count: count as u64, first: String::new() };
    let rejected =
        [("not on a whole second", clock.off_beat), ("missing between the first and the last", clock.missing)];
    PpsFinding {
        channel: name.to_owned(),
        pulses: clock.device_s.len() as u64,
        rejected: rejected.into_iter().filter(|(_, n)| *n > 0).map(|(reason, n)| reject(reason, n)).collect(),
        skew: record::Estimate { value: clock.skew, standard_uncertainty: Some(clock.skew_uncertainty) },
        residual_rms_s: clock.residual_rms_s,
    }
}

/// The lower hull of one device's clock.
struct Hull {
    line: HullLine,
    device_origin: Stamp,
    arrival_origin: Stamp,
    finding: HullFinding,
}

impl Hull {
    /// Arrival of the fastest message sent at `stamp`.
    fn map(&self, stamp: Stamp) -> Stamp {
        let device_s = stamp.seconds_since(self.device_origin);
        let offset_s = self.line.offset_at_middle_s + self.line.skew * (device_s - self.line.middle_s);
        self.arrival_origin.plus_seconds(device_s + offset_s)
    }
}

/// A hull for each clock other than that of the arrival, over all channels that log both its time and their arrival.
fn hulls(sensor: &Flight, arrival_clock: Clock, notices: &mut Notices) -> BTreeMap<u8, Hull> {
    let mut pairs: BTreeMap<u8, Vec<(Stamp, Stamp)>> = BTreeMap::new();
    let mut names: BTreeMap<u8, (&str, Clock)> = BTreeMap::new();
    for (name, channel) in sensed(sensor) {
        let arrival = all_stamps(channel).find(|s| s.clock == arrival_clock);
        let device = all_stamps(channel).find(|s| s.clock != arrival_clock);
        if let (Some(arrival), Some(device)) = (arrival, device) {
            let key = clock_key(device.clock);
            names.entry(key).or_insert((name, device.clock));
            pairs.entry(key).or_default().extend(device.stamps.iter().copied().zip(arrival.stamps.iter().copied()));
        }
    }
    let mut hulls = BTreeMap::new();
    for (key, mut pairs) in pairs {
        let Some(&(name, device)) = names.get(&key) else { continue };
        pairs.sort_unstable();
        pairs.dedup_by_key(|pair| pair.0);
        match hull_of(&pairs, name, device, arrival_clock) {
            Some(hull) => {
                hulls.insert(key, hull);
            }
            None => {
                let text = format!("{} pairs of device time and arrival are too few for a hull", pairs.len());
                notices.push(Code::ClockTie, name, pairs.len() as u64, text);
            }
        }
    }
    hulls
}

fn hull_of(pairs: &[(Stamp, Stamp)], name: &str, device: Clock, arrival: Clock) -> Option<Hull> {
    let &(device_origin, arrival_origin) = pairs.first().filter(|_| pairs.len() >= LEAST_HULL_STAMPS)?;
    let device_s: Vec<f64> = pairs.iter().map(|(d, _)| d.seconds_since(device_origin)).collect();
    let arrival_s: Vec<f64> = pairs.iter().map(|(_, a)| a.seconds_since(arrival_origin)).collect();
    let line = lower_hull(&device_s, &arrival_s)?;
    let epochs_s = arrival_origin.seconds_since(Stamp(0)) - device_origin.seconds_since(Stamp(0));
    let finding = HullFinding {
        channel: name.to_owned(),
        device,
        arrival,
        offset_s: line.offset_at_middle_s + epochs_s,
        skew: line.skew,
        latency_s: distribution(&line.latency)?,
        remark: "the offset includes the least transport latency".to_owned(),
    };
    Some(Hull { line, device_origin, arrival_origin, finding })
}

/// Arrival minus device time on the rows of a channel: absolute if both use one clock, otherwise above the fastest.
fn latency(channel: &Channel, hull: Option<&Hull>) -> Finding<LatencyHistogram> {
    let device = primary(channel);
    let Some(arrival) = all_stamps(channel).filter(|s| s.kind > device.kind).max_by_key(|s| s.kind) else {
        return Finding::CannotTell(format!("the log has no timestamp later than the {} one", device.kind));
    };
    let untied = "the clocks of device and arrival differ and could not be synchronized";
    let found = histogram(&device, &arrival, hull).ok_or_else(|| untied.to_owned());
    found.map_or_else(Finding::CannotTell, Finding::Found)
}

/// `None` if there are two clocks without a mapping.
fn histogram(device: &Stamps<'_>, arrival: &Stamps<'_>, hull: Option<&Hull>) -> Option<LatencyHistogram> {
    let pairs = || device.stamps.iter().zip(arrival.stamps);
    let (latencies, text): (Vec<f64>, _) = if arrival.clock == device.clock {
        let text = format!("{} minus {} timestamp, one clock: absolute", arrival.kind, device.kind);
        (pairs().map(|(d, a)| a.seconds_since(*d)).collect(), text)
    } else {
        let hull = hull?;
        let text =
            format!("{} minus {} timestamp, above the fastest arrival: the clocks differ", arrival.kind, device.kind);
        (pairs().map(|(d, a)| a.seconds_since(hull.map(*d))).collect(), text)
    };
    let latency_s = distribution(&latencies)?;
    let (low, high) = (latency_s.min.min(0.0).max(latency_s.p01.min(0.0)), latency_s.p99.max(1e-6));
    let width = (high - low) / HISTOGRAM_BINS as f64;
    let mut counts = vec![0; HISTOGRAM_BINS];
    let mut beyond = 0;
    for value in &latencies {
        let bin = ((value - low) / width).floor();
        match counts.get_mut(bin.max(0.0) as usize) {
            Some(count) if bin >= 0.0 => *count += 1,
            _ => beyond += 1,
        }
    }
    let edges_s = (0..=HISTOGRAM_BINS).map(|k| low + k as f64 * width).collect();
    Some(LatencyHistogram { text, edges_s, counts, beyond, latency_s })
}

fn distribution(values: &[f64]) -> Option<Distribution> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = |share| percentile_of_sorted(&sorted, share);
    Some(Distribution { min: at(0.0)?, p01: at(0.01)?, median: at(0.5)?, p99: at(0.99)?, max: at(1.0)? })
}

/// Aligns the recordings by the size of the bar's rate as measured by encoder and anchor.
fn tie_by_anchor(sensor: &Flight, encoder: EncoderRate<'_>, rig: &Rig) -> Result<Tied, String> {
    let (name, anchor) = anchor(sensor, rig)?;
    let (stamps, device_origin) = anchor_stamps(name, anchor, rig)?;
    let coarse = coarsely_aligned((name, anchor), &stamps, device_origin, encoder)?;
    let mut notices = Notices::new();
    warn_of_rival(name, &coarse, &mut notices);
    let map = |s: Stamp| encoder.origin.plus_seconds(s.seconds_since(device_origin) + coarse.shift_s);
    // The sensor's own logger may have timestamped the arrivals with a third clock.
    let arrival_clock = all_stamps(anchor).map(|s| s.clock).find(|clock| *clock != stamps.clock);
    let hulls = arrival_clock.map(|clock| hulls(sensor, clock, &mut notices)).unwrap_or_default();
    let hull = hulls.get(&clock_key(stamps.clock));
    let mut flight = Flight::default();
    let mut times = BTreeMap::new();
    for (other, channel) in sensed(sensor) {
        let Some(own) = asked_for(channel, rig).filter(|s| s.clock == stamps.clock) else {
            let text =
                format!("channel {other} does not have timestamps from the clock of the anchor {name}; it is not used");
            notices.push(Code::ClockTie, other, channel.series.len() as u64, text);
            continue;
        };
        times.insert(other.clone(), ChannelTime { kind: own.kind, clock: own.clock, latency: latency(channel, hull) });
        if let Some(mapped) = retimed(other, channel, &own, encoder.clock, map, &mut notices) {
            flight.channels.insert(other.clone(), mapped);
        }
    }
    let statement = statement_of_anchor(name);
    let basis = TimeBasis::Anchor { channel: name.to_owned() };
    let hull = hull.map(|hull| hull.finding.clone());
    Ok(Tied { flight, times, basis, statement, hull, pps: None, notices })
}

/// Timestamps of the anchor, and the first of them.
fn anchor_stamps<'a>(name: &str, anchor: &'a Channel, rig: &Rig) -> Result<(Stamps<'a>, Stamp), String> {
    let stamps = asked_for(anchor, rig)
        .ok_or_else(|| format!("the anchor {name} has no timestamps of the kind that the rig file asks for"))?;
    let first = *stamps.stamps.first().ok_or_else(|| format!("the anchor {name} has no rows"))?;
    Ok((stamps, first))
}

fn statement_of_anchor(name: &str) -> String {
    format!(
        "Encoder and sensor were timestamped by different clocks: all delays are relative to {name}, which is assumed \
         to be on time. Any delay of {name} itself must be added to all of them."
    )
}

/// The shift at which the sizes of the bar's rate agree best.
fn coarsely_aligned(
    (name, anchor): (&str, &Channel),
    stamps: &Stamps<'_>,
    device_origin: Stamp,
    encoder: EncoderRate<'_>,
) -> Result<CoarseLag, String> {
    let t_s: Vec<f64> = stamps.stamps.iter().map(|s| s.seconds_since(device_origin)).collect();
    let size = magnitude(anchor);
    let rate: Vec<f64> = encoder.rate.iter().map(|r| r.abs()).collect();
    coarse_lag((encoder.t_s, [&rate]), (&t_s, [&size]), COARSE_RATE_HZ, SAME_PEAK_S)
        .filter(|lag| lag.correlation >= LEAST_CORRELATION)
        .ok_or_else(|| {
            format!(
                "the clocks of encoder and sensor are unrelated, and {name} does not match the encoder at any shift \
                 that overlaps half of the shorter recording: are both logs of the same swing?"
            )
        })
}

fn anchor<'a>(sensor: &'a Flight, rig: &'a Rig) -> Result<(&'a str, &'a Channel), String> {
    if let Some(name) = &rig.clock.anchor {
        let channel = sensor.channels.get(name).ok_or_else(|| {
            let held: Vec<&str> = sensor.channels.keys().map(String::as_str).collect();
            format!("the sensor has no channel {name}, which the rig file names as anchor; it has {}", held.join(", "))
        })?;
        return match channel.quantity {
            Quantity::AngularRate | Quantity::VelocityNed => Ok((name, channel)),
            other => Err(format!("the anchor {name} holds {other:?}; it must be an angular rate or a velocity")),
        };
    }
    let of = |quantity| sensor.channels.iter().find(move |(_, c)| c.quantity == quantity);
    of(Quantity::AngularRate).or_else(|| of(Quantity::VelocityNed)).map(|(name, c)| (name.as_str(), c)).ok_or_else(|| {
        "the clocks of encoder and sensor differ, and the sensor has neither an angular rate nor a velocity to relate \
         them. If one clock timestamps both, state it in the rig file: [clock] shared = true".into()
    })
}

/// Length of a vector, row by row.
fn magnitude(channel: &Channel) -> Vec<f64> {
    let components = channel.series.components();
    (0..channel.series.len()).map(|row| components.iter().map(|c| c[row] * c[row]).sum::<f64>().sqrt()).collect()
}

fn warn_of_rival(name: &str, lag: &CoarseLag, notices: &mut Notices) {
    if lag.runner_up > RIVAL_SHARE * lag.correlation {
        let text = format!(
            "matches the encoder with a correlation of {:.3}, but also with {:.3} when shifted by another {} ms: the \
             swing is too regular to be sure",
            lag.correlation,
            lag.runner_up,
            millis(lag.runner_up_s - lag.shift_s)
        );
        notices.push(Code::ClockTie, name, 1, text);
    }
}

/// The channel with new timestamps. Rows whose new timestamps do not increase are dropped and counted.
fn retimed(
    name: &str,
    channel: &Channel,
    stamps: &Stamps<'_>,
    clock: Clock,
    to: impl Fn(Stamp) -> Stamp,
    notices: &mut Notices,
) -> Option<Channel> {
    let mut rows = Vec::with_capacity(stamps.stamps.len());
    let mut mapped: Vec<Stamp> = Vec::with_capacity(stamps.stamps.len());
    for (row, stamp) in stamps.stamps.iter().enumerate() {
        let stamp = to(*stamp);
        if mapped.last().is_none_or(|last| stamp > *last) {
            rows.push(row);
            mapped.push(stamp);
        }
    }
    let dropped = stamps.stamps.len() - rows.len();
    if dropped > 0 {
        let text = format!("channel {name}: {} timestamps that do not increase; these rows are dropped", stamps.kind);
        notices.push(Code::RejectedRow, name, dropped as u64, text);
    }
    let columns = channel.series.components().iter().map(|c| rows.iter().map(|&r| c[r]).collect()).collect();
    let series = Timeline::new(stamps.kind, clock, mapped).and_then(|timeline| Series::new(timeline, columns));
    match series {
        Ok(series) => Some(Channel {
            series,
            held: rows.iter().map(|&r| channel.held[r]).collect(),
            other_stamps: vec![],
            quantity: channel.quantity,
            present: channel.present.clone(),
            source: channel.source.clone(),
        }),
        // Timestamps were made to increase and values were finite; if they ever do not fit, this reports it.
        Err(error) => {
            notices.push(Code::RejectedRow, name, rows.len() as u64, error.to_string());
            None
        }
    }
}
