//! Builds one bench record from two flights: the encoder's and the sensor's.

use crate::alignment::{Alignment, align};
use crate::card::MagneticEvidence;
use crate::channel::{SILENT, dynamics, estimate};
use crate::clock::{EncoderRate, Tied, moved, tie};
use crate::curves::{curve, liveliest};
use crate::dead_encoder::without_dead_parts;
use crate::encoder::{EncoderError, EncoderSeries, encoder_channel};
use crate::flexibility::{GainAt, flexibility, weighted_mean};
use crate::gap::Hidden;
use crate::gate::{Gate, gap_check, gate, spectra};
use crate::magnetometer::magnetic_swings;
use crate::motion::Motion;
use crate::mount::mount_finding;
use crate::reference_error::{ReferenceErrors, sensitivity};
use crate::references::{ChannelReference, ComponentReference, References};
use crate::rig::Rig;
use crate::sensed::{Circumstances, SensedChannel, SensedComponent};
use crate::surroundings::{Surroundings, place_of};
use flight::with_minus;
use flight::{Channel, Clock, Code, Flight, Notices, Quantity, Stamp};
use jiff::civil::Date;
use rayon::prelude::*;
use record::{
    BenchFindings, ChannelDynamics, ClockFinding, ComponentDynamics, Estimate, Finding, GateCheck, ReferenceFinding,
    RigGeometry, RigPart, TimeBasis,
};
use signal::{DelayFit, DelaySettings, Gain, Measurement, Sign, fit_delay};

/// A bar slower than this many counts per second is at rest.
const STILL_COUNTS_PER_S: f64 = 1.0;
/// A skew larger than this many standard uncertainties is reported as a warning.
const CLEAR_SKEW: f64 = 3.0;

/// Input of a measurement.
#[derive(Debug, Clone, Copy)]
pub struct BenchInput<'a> {
    /// The flight with the encoder.
    pub encoder: &'a Flight,
    /// The flight with the sensor; may be the same.
    pub sensor: &'a Flight,
    /// Whether one logger timestamped both.
    pub one_log: bool,
}

/// Result of a measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Bench {
    /// Findings.
    pub findings: BenchFindings,
    /// Evidence about its magnetometer, for a card of several records.
    pub magnetic: MagneticEvidence,
    /// UTC day of the record, `yyyy-mm-dd`, if timestamps or rig file give it.
    pub date: Option<String>,
    /// Notices for the reader.
    pub notices: Notices,
}

/// Why a record cannot be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BenchRefusal {
    /// The encoder.
    #[error(transparent)]
    Encoder(#[from] EncoderError),
    /// Its angle cannot be smoothed.
    #[error("encoder {channel}: {source}")]
    Smooth {
        /// The channel.
        channel: String,
        /// Reason.
        source: signal::SmoothError,
    },
    /// The clocks of encoder and sensor cannot be aligned.
    #[error("{0}")]
    Clock(String),
    /// No channel of the sensor moves with the bar.
    #[error("no channel of the sensor responds to the motion of a bar; its channels: {0}")]
    NoChannel(String),
}

/// Measures every channel of the sensor against the encoder.
///
/// # Errors
/// A [`BenchRefusal`] with the reason if no channel can be measured.
pub fn bench(input: &BenchInput<'_>, rig: &Rig) -> Result<Bench, BenchRefusal> {
    let (encoder_name, encoder) = encoder_channel(input.encoder, rig)?;
    let series = EncoderSeries::of(encoder_name, encoder, rig)?;
    let clock = encoder.series.timeline().clock();
    let is_shared = rig.clock.shared.unwrap_or(input.one_log);
    let (series, dead) = if is_shared { without_dead_parts(series, input.sensor, clock) } else { (series, None) };
    let mut notices = series.notices.clone();
    let raw = smoothed(encoder_name, series)?;
    let tied = tied(input, &raw, clock, rig)?;
    notices.extend(tied.notices.clone());
    report_other_stamps(encoder, &tied, &mut notices);
    let day = day_of(input, rig);
    let (around, surroundings_notices) = Surroundings::of(rig, place_of(input.sensor), day);
    notices.extend(surroundings_notices);

    let Placed { timing, corrected, alignment, motion } = Placed::of(raw, &tied, rig, &around, &mut notices);
    let sensor = corrected.as_ref().unwrap_or(&tied.flight);
    let references = References::of(sensor, &motion, rig, &around, &alignment);
    notices.extend(references.notices.clone());
    if references.channels.is_empty() {
        return Err(no_channel(input.sensor));
    }
    let arm = accelerometer_arm(sensor, rig);
    let Gate { mut quality, closed } = gate(&motion, sensor, &references, arm, around.gravity_mps2);
    let channels = channels(sensor, &references, &tied, &timing, &motion, rig, closed);
    quality.checks.extend(gaps_checked(&motion, &channels, &mut notices));
    quality.checks.extend(dead);
    report_outliers(&channels, &mut notices);
    timing.warn(&tied, &mut notices);
    report_odd_gyros(&channels, &mut notices);
    let (swings, turn_notices) = magnetic_swings(sensor, &motion, rig, &around, &alignment);
    notices.extend(turn_notices);
    let flexibility = bending(&channels, &references, rig);
    let (mount, mount_notices) = mount_finding(rig, &around, &alignment, &swings, &channels, &flexibility);
    notices.extend(mount_notices);
    let findings = BenchFindings {
        origin_ns: motion.origin().0,
        clock,
        reference: reference_finding(&motion, &alignment, &around, arm),
        mount,
        flexibility,
        gate: quality,
        clocks: timing.finding(&tied),
        geometry: Some(geometry(rig, &channels)),
        channels,
    };
    let magnetic = MagneticEvidence { swings, around };
    Ok(Bench { findings, magnetic, date: day.map(|d| d.to_string()), notices })
}

fn no_channel(sensor: &Flight) -> BenchRefusal {
    let held: Vec<&str> = sensor.channels.keys().map(String::as_str).collect();
    BenchRefusal::NoChannel(held.join(", "))
}

/// The gate's check of the encoder's gaps, which are also reported as a notice.
fn gaps_checked(motion: &Motion, channels: &[ChannelDynamics], notices: &mut Notices) -> Option<GateCheck> {
    let check = gap_check(motion, hidden_samples(channels))?;
    let (code, gaps) = (Code::SamplesLeftOut.at(flight::Severity::Info), motion.gaps().len() as u64);
    notices.push(code, &motion.encoder().channel, gaps, check.text.clone());
    Some(check)
}

fn smoothed(channel: &str, series: EncoderSeries) -> Result<Motion, BenchRefusal> {
    Motion::of(series).map_err(|source| BenchRefusal::Smooth { channel: channel.to_owned(), source })
}

/// The sensor, aligned in time and placed on the bar.
struct Placed {
    timing: Timing,
    /// With corrected timestamps, where needed.
    corrected: Option<Flight>,
    alignment: Alignment,
    /// Motion of the bar, oriented by the alignment.
    motion: Motion,
}

impl Placed {
    fn of(raw: Motion, tied: &Tied, rig: &Rig, around: &Surroundings, notices: &mut Notices) -> Placed {
        let rough = align(&raw, &tied.flight, rig, around);
        let turned = raw.clone().oriented(rough.sign, rough.zero_rad.value);
        let references = References::of(&tied.flight, &turned, rig, around, &rough);
        let timing = Timing::of(&references, tied, rig, &turned);
        let corrected = timing.correct(tied, &turned);
        let alignment = corrected.as_ref().map_or(rough, |sensor| align(&raw, sensor, rig, around));
        if let Some(flight) = &corrected {
            notices.extend(flight.notices.clone());
        }
        notices.extend(alignment.notices.clone());
        let motion = raw.oriented(alignment.sign, alignment.zero_rad.value);
        Placed { timing, corrected, alignment, motion }
    }
}

fn tied(input: &BenchInput<'_>, raw: &Motion, clock: Clock, rig: &Rig) -> Result<Tied, BenchRefusal> {
    let (t_s, rate): (Vec<f64>, Vec<f64>) = raw.states().map(|(t, state)| (t, state.rate)).unzip();
    let encoder = EncoderRate { clock, origin: raw.origin(), t_s: &t_s, rate: &rate };
    tie(input.sensor, encoder, rig, input.one_log).map_err(BenchRefusal::Clock)
}

/// Reports channels whose timestamps are of another kind than the encoder's: the difference is part of their delays.
fn report_other_stamps(encoder: &Channel, tied: &Tied, notices: &mut Notices) {
    let kind = encoder.series.timeline().kind();
    let others: Vec<&str> =
        tied.times.iter().filter(|(_, time)| time.kind != kind).map(|(name, _)| name.as_str()).collect();
    if tied.basis == TimeBasis::OneClock && !others.is_empty() {
        let text = format!(
            "the encoder has {kind} timestamps, and {} have another kind: their delays include the difference",
            others.join(", ")
        );
        notices.push(Code::Assumption, "timestamps", others.len() as u64, text);
    }
}

/// UTC day of the first UTC timestamp; the day of the rig file as fallback.
fn day_of(input: &BenchInput<'_>, rig: &Rig) -> Option<Date> {
    let of = |flight: &Flight| {
        let channels = flight.channels.values();
        let timelines = channels.map(|c| c.series.timeline()).filter(|t| t.clock() == Clock::Unix);
        timelines.filter_map(|t| t.first()).min()
    };
    let first: Option<Stamp> = [input.encoder, input.sensor].into_iter().filter_map(of).min();
    let utc = |stamp: Stamp| {
        let instant = jiff::Timestamp::from_nanosecond(i128::from(stamp.0)).ok()?;
        Some(instant.to_zoned(jiff::tz::TimeZone::UTC).date())
    };
    // A simulation that counts from zero appears to be in 1970.
    first.and_then(utc).filter(|day| day.year() > 1980).or(rig.site.date)
}

fn accelerometer_arm(sensor: &Flight, rig: &Rig) -> [f64; 3] {
    let found = sensor.channels.iter().find(|(_, c)| c.quantity == Quantity::SpecificForce);
    rig.mount_of(found.map_or("specific-force.imu", |(name, _)| name)).lever_arm_m
}

/// Skew and anchor of the sensor's clock, estimated jointly from the channels.
struct Timing {
    /// Joint over all channels with a delay (design note 6): the seconds added to a second of the sensor's clock to get
    /// one of the encoder's.
    skew: Finding<Estimate>,
    /// Lag of the anchor in the uncorrected logs, s.
    anchor_lag_s: Option<Estimate>,
    middle_s: f64,
}

impl Timing {
    fn of(references: &References, tied: &Tied, rig: &Rig, motion: &Motion) -> Timing {
        let settings = DelaySettings { search_s: rig.analysis.search_s, skew: true, ..DelaySettings::default() };
        let (first, last) = motion.span();
        let middle_s = 0.5 * (first + last);
        let mut skews = vec![];
        let mut anchor_lag_s = None;
        for channel in &references.channels {
            let hidden = Hidden::of(motion.gaps(), channel.coarse_delay_s, rig.analysis.search_s);
            let Some(fit) = fit_of(channel, hidden, tied, &settings) else { continue };
            let Some(skew) = fit.skew else { continue };
            skews.push(estimate(skew));
            if matches!(&tied.basis, TimeBasis::Anchor { channel: anchor } if *anchor == channel.name) {
                // The fit refers its delay to the middle of its own rows.
                let at_middle = fit.delay_s - skew.value * (middle_s - fit.middle_s);
                anchor_lag_s =
                    Some(Estimate { value: at_middle, standard_uncertainty: Some(fit.standard_uncertainty_s) });
            }
        }
        // One clock has one skew, common to all its channels.
        let skew = weighted_mean(&skews)
            .map_or_else(|| Finding::CannotTell("no channel could be fitted with a skew".to_owned()), Finding::Found);
        Timing { skew, anchor_lag_s, middle_s }
    }

    /// If there are two clocks, corrects the sensor's timestamps by the joint skew and by the anchor's lag.
    fn correct(&self, tied: &Tied, motion: &Motion) -> Option<Flight> {
        if !matches!(tied.basis, TimeBasis::Anchor { .. }) {
            return None;
        }
        let skew = self.skew.found().map_or(0.0, |e| e.value);
        let lag_s = self.anchor_lag_s.map_or(0.0, |e| e.value);
        Some(moved(&tied.flight, motion.origin(), -lag_s, skew, self.middle_s))
    }

    /// Seconds that the sensor's clock gains per second: the timestamps are shortened by this much.
    fn gained(&self) -> Finding<Estimate> {
        match &self.skew {
            Finding::Found(skew) => Finding::Found(Estimate { value: -skew.value, ..*skew }),
            Finding::CannotTell(why) => Finding::CannotTell(why.clone()),
        }
    }

    fn warn(&self, tied: &Tied, notices: &mut Notices) {
        let Finding::Found(Estimate { value, standard_uncertainty: Some(u) }) = self.gained() else { return };
        let one_clock = !matches!(tied.basis, TimeBasis::Anchor { .. });
        if one_clock && value.abs() > CLEAR_SKEW * u && value.abs() > 5e-6 {
            let text = format!(
                "all channels drift against the encoder by {} ppm (k = 2), though both should use the same clock: the \
                 delays are valid for the middle of the record",
                with_minus(&format!("{:.1} ± {:.1}", value * 1e6, 2e6 * u))
            );
            notices.push(Code::ClockTie, "", 1, text);
        }
    }

    fn finding(&self, tied: &Tied) -> ClockFinding {
        ClockFinding {
            basis: tied.basis.clone(),
            statement: tied.statement.clone(),
            skew: self.gained(),
            anchor_lag_s: self.anchor_lag_s,
            hull: tied.hull.clone(),
            pps: tied.pps.clone(),
        }
    }
}

/// The delay of one channel, from all its excited components together, if the fit converges.
fn fit_of(channel: &ChannelReference, hidden: Hidden<'_>, tied: &Tied, settings: &DelaySettings) -> Option<DelayFit> {
    let mut rows = tied.flight.channels.get(&channel.name)?.update_rows();
    rows.retain(|&row| channel.t_s.get(row).is_some_and(|t| !hidden.hides(*t)));
    let of_rows = |column: &[f64]| -> Vec<f64> { rows.iter().filter_map(|&row| column.get(row).copied()).collect() };
    let t = of_rows(&channel.t_s);
    let excited = channel.components.iter().filter(|c| c.excited.is_ok());
    let columns: Vec<(&ComponentReference, Vec<f64>)> = excited.map(|c| (c, of_rows(&c.measured))).collect();
    let measurements: Vec<Measurement<'_>> = columns
        .iter()
        .map(|(c, y)| Measurement {
            t: &t,
            y,
            reference: &c.reference,
            gain: Gain::Free { sign: Sign::Positive },
            drift: c.drift,
        })
        .collect();
    fit_delay(&measurements, settings).ok().filter(|fit| fit.converged)
}

fn channels(
    sensor: &Flight,
    references: &References,
    tied: &Tied,
    timing: &Timing,
    motion: &Motion,
    rig: &Rig,
    closed: Option<String>,
) -> Vec<ChannelDynamics> {
    let (t, rate): (Vec<f64>, Vec<f64>) = motion.states().map(|(t, state)| (t, state.rate)).unzip();
    let lsb = std::f64::consts::TAU / motion.encoder().counts_per_rev;
    let circumstances = Circumstances {
        basis: &tied.basis,
        anchor_s: timing.anchor_lag_s.and_then(|e| e.standard_uncertainty).unwrap_or(0.0),
        search_s: rig.analysis.search_s,
        margin_s: rig.analysis.margin_s,
        inject_s: &rig.analysis.inject_s,
        inject_gain: rig.analysis.inject_gain,
        t: &t,
        rate: &rate,
        zoom: liveliest(&t, &rate, motion.gaps()),
        period_s: spectra(motion).angle.rms_frequency_hz().filter(|hz| *hz > 0.0).map_or(0.0, |hz| 1.0 / hz),
        still_rate: STILL_COUNTS_PER_S * lsb,
        errors: &ReferenceErrors::of(motion),
        closed,
    };
    let of = |found: &ChannelReference| {
        let channel = sensor.channels.get(&found.name)?;
        let time = tied.times.get(&found.name)?;
        let components = found.components.iter().map(sensed).collect();
        let hidden = Hidden::of(motion.gaps(), found.coarse_delay_s, rig.analysis.search_s);
        let sensed = SensedChannel { name: &found.name, channel, t: found.t_s.clone(), time, hidden, components };
        Some(dynamics(&sensed, &circumstances))
    };
    // In the pool of the caller, so that a single record also uses its threads.
    references.channels.par_iter().filter_map(of).collect()
}

/// Samples of the channels whose true instant is within a gap of the encoder.
fn hidden_samples(channels: &[ChannelDynamics]) -> u64 {
    channels.iter().flat_map(|c| &c.rejected).filter(|r| r.reason == SILENT).map(|r| r.count).sum()
}

/// Share of samples that may be downweighted as outliers in a channel before it is reported.
const MANY_OUTLIERS: f64 = 0.05;

fn report_outliers(channels: &[ChannelDynamics], notices: &mut Notices) {
    for channel in channels {
        let Some(share) = channel.checks.as_ref().map(|c| c.outlier_share).filter(|s| *s > MANY_OUTLIERS) else {
            continue;
        };
        let text = format!(
            "{:.0} % of the samples are outliers of more than four standard deviations and were downweighted in the \
             fit: check its residuals for a disturbance, or for values from another source",
            100.0 * share
        );
        notices.push(Code::SamplesLeftOut, &channel.name, (share * channel.samples as f64).round() as u64, text);
    }
}

/// A gyro is rarely later than this, s.
const LATE_GYRO_S: f64 = 0.05;
/// No gyro is earlier than this, s.
const EARLY_GYRO_S: f64 = 0.01;

/// Reports gyros whose delay on the encoder's own clock is not that of a gyro: the clocks are probably two. Every other
/// delay is then wrong by the same time.
fn report_odd_gyros(channels: &[ChannelDynamics], notices: &mut Notices) {
    let is_gyro = |c: &&ChannelDynamics| c.quantity == Quantity::AngularRate && c.basis == TimeBasis::OneClock;
    for channel in channels.iter().filter(is_gyro) {
        let Some(found) = &channel.delay else { continue };
        let (delay_s, expanded_s) = (found.delay.seconds(), 2.0 * found.standard_uncertainty_s);
        let (word, most_s) = if delay_s > 0.0 { ("late", LATE_GYRO_S) } else { ("early", EARLY_GYRO_S) };
        if delay_s.abs() - expanded_s > most_s {
            let text = format!(
                "{} is {:.1} ± {:.1} ms {word} (k = 2), which is rare for a gyro: if encoder and sensor do not have one \
                 clock, every delay of this record is wrong by this much. Set [clock] shared = false in the rig file to \
                 measure against the gyro",
                channel.name,
                delay_s.abs() * 1e3,
                expanded_s * 1e3
            );
            notices.push(Code::ClockTie, &channel.name, 1, text);
        }
    }
}

fn sensed(component: &ComponentReference) -> SensedComponent<'_> {
    SensedComponent {
        name: &component.name,
        unit: &component.unit,
        values: &component.measured,
        reference: &component.reference,
        reference_std: component.uncertainty,
        sensitivity: sensitivity(&component.reference, &component.slope),
        excited: component.excited.as_ref().copied().map_err(String::as_str),
        drift: component.drift,
    }
}

/// Whether the bar bends, by the gains of channels that translate with its tip and of those that rotate with it. A
/// channel with a lag, or whose reference was fitted to it, does not count.
fn bending(channels: &[ChannelDynamics], references: &References, rig: &Rig) -> Finding<record::Flexibility> {
    use Quantity::{AngularRate, Attitude, Height, PositionGeodetic, PositionNed, VelocityNed};
    let by_construction =
        |name: &str| references.channels.iter().any(|c| c.name == name && c.components.iter().any(|c| c.unit_gain));
    let gains = |wanted: &[Quantity]| -> Vec<GainAt> {
        let counts =
            |c: &&ChannelDynamics| wanted.contains(&c.quantity) && c.lags().is_none() && !by_construction(&c.name);
        let of_component = |c: &ComponentDynamics| Some(GainAt { gain: c.gain?, frequency_hz: c.gain_frequency_hz? });
        channels.iter().filter(counts).flat_map(|c| c.components.iter().filter_map(of_component)).collect()
    };
    let translation = gains(&[VelocityNed, PositionGeodetic, PositionNed, Height]);
    flexibility(&translation, &gains(&[AngularRate, Attitude]), rig.bar.first_mode_hz)
}

/// Places on the bar where the channels of the record are measured.
fn geometry(rig: &Rig, channels: &[ChannelDynamics]) -> RigGeometry {
    let mut parts: Vec<RigPart> = vec![];
    for channel in channels {
        let mount = rig.mount_of(&channel.name);
        match parts.iter_mut().find(|p| p.lever_arm_m == mount.lever_arm_m && p.is_stated == mount.arm_is_stated) {
            Some(part) => part.channels.push(channel.name.clone()),
            None => parts.push(RigPart {
                channels: vec![channel.name.clone()],
                lever_arm_m: mount.lever_arm_m,
                is_stated: mount.arm_is_stated,
            }),
        }
    }
    RigGeometry { bar_length_m: rig.bar.length_m, mount: rig.bar.mount.to_string(), parts }
}

fn reference_finding(motion: &Motion, alignment: &Alignment, around: &Surroundings, arm: [f64; 3]) -> ReferenceFinding {
    let encoder = motion.encoder();
    let (first, last) = motion.span();
    let length_m = arm.iter().map(|x| x * x).sum::<f64>().sqrt();
    let (t, encoder_angle) = motion.encoder_angle();
    let (smooth_t, states): (Vec<f64>, Vec<_>) = motion.states().unzip();
    let angle: Vec<f64> = states.iter().map(|s| s.angle).collect();
    let tangential: Vec<f64> = states.iter().map(|s| length_m * s.acceleration).collect();
    let (raw_t, raw) = motion.second_central_difference();
    let raw: Vec<f64> = raw.iter().map(|a| length_m * a).collect();
    ReferenceFinding {
        channel: encoder.channel.clone(),
        samples: t.len() as u64,
        rate_hz: motion.rate_hz(),
        duration_s: last - first,
        counts_per_rev: encoder.counts_per_rev,
        counts_source: encoder.counts_source.clone(),
        sign: alignment.sign,
        sign_source: alignment.sign_source.clone(),
        zero_rad: alignment.zero_rad,
        zero_source: alignment.zero_source.clone(),
        azimuth_rad: alignment.azimuth_rad,
        azimuth_source: alignment.azimuth_source.clone(),
        log10_q: motion.log10_q(),
        residual_rms_counts: motion.residual_rms_counts(),
        uncertainty: motion.typical_uncertainty(),
        angle_range_rad: motion.angle_range(),
        gravity_mps2: around.gravity_mps2,
        gravity_source: around.gravity_source.clone(),
        field_t: around.field_t,
        field_source: around.field_source.clone(),
        angle: vec![curve("encoder", t, &encoder_angle), curve("smoothed", &smooth_t, &angle)],
        acceleration: vec![
            curve("smoothed", &smooth_t, &tangential),
            curve("second central difference of the encoder", &raw_t, &raw),
        ],
    }
}
