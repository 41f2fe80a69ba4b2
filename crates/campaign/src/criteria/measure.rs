//! Extracts the numbers for criteria from a record.

use super::judge::Reading;
use super::metric::Metric;
use crate::answer::change_against_imu;
use crate::rate::rate_of;
use flight::{Alarm, ChannelHealth, LogHealth, Severity};
use record::{
    ChannelLateness, CompensatorResult, CompensatorScore, DelayKind, DelayPairKind, DelaySource, DelaySweep, Estimate,
    Finding, FlightLateness, FlightRecord, MeasuredDelay, Outcome, PairDelay, PairUse, ReferenceScore, ReplayRecord,
    SweepScore,
};

/// A record, and the part of it that a criterion selects.
pub(super) struct Subject<'a> {
    pub(super) record: &'a FlightRecord,
    pub(super) compensator: Option<&'a str>,
    pub(super) channel: Option<&'a str>,
    pub(super) against: Option<&'a str>,
}

/// The number of a metric, or why there is none.
pub(super) fn measure(metric: Metric, of: &Subject<'_>) -> Result<Reading, String> {
    if is_against_reference(metric)
        && let Some(alarm) = of.contradicted_reference()
    {
        return Err(alarm.to_owned());
    }
    let reading = match metric {
        Metric::Lateness => of.lateness(),
        Metric::LatenessExpandedUncertainty => of.lateness_estimate().and_then(expanded_uncertainty),
        Metric::DelayVaries => of.delay_varies(),
        Metric::Delay => of.position_delay(),
        Metric::VelocityDelay => of.delay(DelayPairKind::VelocityAgainstAcceleration),
        Metric::DelayAgainstReference => of.delay(DelayPairKind::PositionAgainstReference),
        Metric::VelocityDelayAgainstReference => of.delay(DelayPairKind::VelocityAgainstReference),
        Metric::DelayDifference => of.difference(),
        Metric::DelayNormalisedDifference => of.normalised_difference(),
        Metric::DelayChange => of.delay_change(),
        Metric::DelayExpandedUncertainty => of.own_delay().and_then(|found| expanded_uncertainty(found.delay_s)),
        Metric::SmallestDetectableDelayChange => of.own_delay().map(smallest_detectable),
        Metric::InjectionError => of.own_delay().and_then(worst_injection),
        Metric::MovingShare => of.moving_share(),
        Metric::ErrorRms => of.error_of(of.compensator.unwrap_or_default(), |c| c.error_rms_m).map(Reading::rms),
        Metric::ErrorP95 => of.error(|c| c.error_p95_m),
        Metric::ErrorRatio => of.error_ratio(),
        Metric::CorrectionRms => of.compensator().map(correction),
        Metric::StepAtFixRms => of.step_at_fix(),
        Metric::ErrorMax => of.against_reference().map(|r| Reading::plain(r.max_m)),
        Metric::AlongTrackRms => of.against_reference().map(|r| rms(r.along_m)),
        Metric::AcrossTrackRms => of.against_reference().map(|r| rms(r.across_m)),
        Metric::ResidualDelay => of.residual_delay(),
        Metric::ResidualDelayAgainstReference => of.residual_delay_against_reference(),
        Metric::LeadError => of.score().and_then(lead_error),
        Metric::StepCorrelation => of.scored(|s| &s.step_correlation, |e| *e),
        Metric::Hysteresis => of.scored(|s| &s.hysteresis, |h| h.along_m),
        Metric::StraightAcrossRms => of.scored(|s| &s.straight, |s| s.across_rms_m),
        Metric::StraightNoiseRatio => of.scored(|s| &s.straight, |s| s.noise_ratio),
        Metric::MotionHelpedShare => of.motion_share(|[helped, ..]| helped),
        Metric::MotionHarmedShare => of.motion_share(|[.., harmed]| harmed),
        Metric::OnboardDifferenceRms => of.onboard(),
        Metric::ErrorAtBenchValue => of.at_bench_value(true),
        Metric::StepAtBenchValue => of.at_bench_value(false),
        Metric::DelayOfLeastError => of.sweep().and_then(optimum),
        Metric::ValidShare => of.replay().and_then(valid_share),
        Metric::Duration => of.flown(|r| r.coverage.duration_s),
        Metric::SpeedMedian => of.flown(|r| r.speed_mps.median),
        Metric::LongestPositionGap => of.flown(|r| r.coverage.longest_position_gap_s),
        Metric::PositionResets => of.flown(|r| r.coverage.position_resets as f64),
        Metric::BridgedGaps => of.flown(|r| r.coverage.bridged_gaps as f64),
        Metric::Restarts => of.flown(|r| r.coverage.restarts as f64),
        Metric::PositionRate => of.rate_of_pair(|pair| &pair.position, |l| l.position.as_ref()),
        Metric::VelocityRate => of.rate_of_pair(|pair| &pair.velocity, |l| l.velocity.as_ref()),
        Metric::ChannelRate => of.channel().and_then(|c| of.rate(&c.name)),
        Metric::ChannelLongestStep => of.channel().and_then(longest_step),
        Metric::ChannelUsedShare => of.channel().and_then(used_share),
        Metric::BytesDamaged => of.logged(|log| log.bytes.damaged as f64),
        Metric::DamagedShare => of.log().and_then(damaged_share),
        Metric::MessagesUndecodable => of.logged(|log| log.undecodable as f64),
        Metric::Losses => of.notices(Severity::Loss),
        Metric::Warnings => of.notices(Severity::Warning),
    };
    reading?.finite()
}

/// Whether the number is only as right as the clock of the reference.
fn is_against_reference(metric: Metric) -> bool {
    matches!(
        metric,
        Metric::DelayAgainstReference
            | Metric::VelocityDelayAgainstReference
            | Metric::ErrorRms
            | Metric::ErrorP95
            | Metric::ErrorRatio
            | Metric::ErrorMax
            | Metric::AlongTrackRms
            | Metric::AcrossTrackRms
            | Metric::ResidualDelayAgainstReference
            | Metric::ErrorAtBenchValue
    )
}

impl Subject<'_> {
    /// What contradicts the clock of the reference.
    fn contradicted_reference(&self) -> Option<&str> {
        let alarms = &self.record.lateness.as_ref()?.alarms;
        alarms.iter().find(|alarm| alarm.code == Alarm::ReferenceContradicted).map(|alarm| alarm.text.as_str())
    }

    fn lateness(&self) -> Result<Reading, String> {
        self.lateness_of_position().map(|found| Reading::within(found.lateness_s, found.interval_95_s))
    }

    fn lateness_estimate(&self) -> Result<Estimate, String> {
        self.lateness_of_position().map(|found| found.lateness_s)
    }

    /// The lateness of the position in true time.
    fn lateness_of_position(&self) -> Result<&ChannelLateness, String> {
        let lateness = self.record.lateness.as_ref().ok_or_else(|| no_replay(self.record))?;
        let found = lateness.lateness.as_ref().ok_or_else(|| lateness.words.clone())?;
        match &found.relative_to {
            None => Ok(found),
            Some(than) => Err(format!(
                "the flight shows only how much later {} is than {than}, and not how late {than} is",
                found.channel
            )),
        }
    }

    fn delay_varies(&self) -> Result<Reading, String> {
        let lateness = self.record.lateness.as_ref().ok_or_else(|| no_replay(self.record))?;
        match lateness.kind {
            kind if kind.varies() => Ok(Reading::plain(1.0)),
            DelayKind::OnTime | DelayKind::Constant | DelayKind::Early => Ok(Reading::plain(0.0)),
            _ => Err("the flight does not show whether its delay stays the same".to_owned()),
        }
    }
}

/// Why there is no replay.
fn no_replay(record: &FlightRecord) -> String {
    match &record.outcome {
        Outcome::Compensated => "the record has no replay".to_owned(),
        Outcome::Uncompensated { reason } => format!("nothing was removed: {reason}"),
        Outcome::NotMeasurable { reason } => format!("the flight was not compensated: {reason}"),
        Outcome::Pending { reason } => format!("pending: {reason}"),
        Outcome::Failed { reason } => format!("the log could not be used: {reason}"),
    }
}

impl<'a> Subject<'a> {
    pub(super) fn replay(&self) -> Result<&'a ReplayRecord, String> {
        self.record.replay.as_ref().ok_or_else(|| no_replay(self.record))
    }

    fn log(&self) -> Result<&'a LogHealth, String> {
        self.record.log.as_ref().ok_or_else(|| no_replay(self.record))
    }

    /// The replay, or the trial of a flight from which nothing was removed.
    pub(super) fn replayed(&self) -> Result<&'a ReplayRecord, String> {
        self.record.drawable().ok_or_else(|| no_replay(self.record))
    }

    /// Whether the flight has a reference; `None` if its channels are unknown. One whose clock is contradicted is none to
    /// score against, but the flight must not pass over the criterion because of that.
    pub(super) fn has_reference(&self) -> Option<bool> {
        if self.contradicted_reference().is_some() {
            return Some(true);
        }
        use DelayPairKind::{PositionAgainstReference, VelocityAgainstReference};
        let of_pairs = |pairs: &[PairDelay]| {
            pairs.iter().any(|p| [PositionAgainstReference, VelocityAgainstReference].contains(&p.kind))
        };
        let of_replay = self.record.drawable().map(|replay| replay.pair.reference.is_some());
        of_replay.or_else(|| self.record.delays.as_ref().map(|delays| of_pairs(&delays.pairs)))
    }

    /// A fact of the flight that does not depend on the removed delay.
    fn flown(&self, of: impl FnOnce(&ReplayRecord) -> f64) -> Result<Reading, String> {
        self.replayed().map(|replay| Reading::plain(of(replay)))
    }

    fn logged(&self, of: impl FnOnce(&LogHealth) -> f64) -> Result<Reading, String> {
        self.log().map(|log| Reading::plain(of(log)))
    }

    /// Number of notices of a severity. A log that could not be opened has no notices about its content.
    fn notices(&self, severity: Severity) -> Result<Reading, String> {
        self.log()?;
        Ok(Reading::plain(self.record.notices.iter().filter(|n| n.severity == severity).count() as f64))
    }

    fn channel(&self) -> Result<&'a ChannelHealth, String> {
        let name = self.channel.unwrap_or_default();
        let binding = self.record.binding.as_ref().ok_or_else(|| no_replay(self.record))?;
        let found = binding.channels.iter().find(|c| c.name == name);
        found.ok_or_else(|| format!("this flight has no channel {name}; it has {}", names(&binding.channels)))
    }

    fn rate(&self, channel: &str) -> Result<Reading, String> {
        let channels = self.record.binding.as_ref().map(|b| b.channels.as_slice()).unwrap_or_default();
        let rate = rate_of(channels, channel).ok_or_else(|| format!("{channel} has too few timestamps for a rate"))?;
        Ok(Reading::plain(rate))
    }

    /// Rate of the replayed channel; of the measured one where nothing was replayed.
    fn rate_of_pair(
        &self,
        of_replay: impl Fn(&'a PairUse) -> &'a String,
        measured: impl Fn(&'a FlightLateness) -> Option<&'a String>,
    ) -> Result<Reading, String> {
        let replay = self.record.replay.as_ref().map(|replay| of_replay(&replay.pair));
        let channel = replay.or_else(|| measured(self.record.lateness.as_ref()?));
        self.rate(channel.ok_or_else(|| no_replay(self.record))?)
    }

    fn compensator_called(&self, name: &str) -> Result<&'a CompensatorResult, String> {
        let all = &self.replay()?.compensators;
        all.iter().find(|c| c.name == name).ok_or_else(|| {
            let ran: Vec<&str> = all.iter().map(|c| c.name.as_str()).collect();
            format!("{name} did not run on this flight; these did: {}", ran.join(", "))
        })
    }

    fn compensator(&self) -> Result<&'a CompensatorResult, String> {
        self.compensator_called(self.compensator.unwrap_or_default())
    }

    fn error_of(&self, name: &str, of: impl Fn(&CompensatorResult) -> Option<Estimate>) -> Result<Estimate, String> {
        let no_error = match self.replay()?.pair.reference {
            None => "the log has no reference to score against",
            Some(_) => "the record has no such error",
        };
        of(self.compensator_called(name)?).ok_or_else(|| no_error.to_owned())
    }

    fn error(&self, of: impl Fn(&CompensatorResult) -> Option<Estimate>) -> Result<Reading, String> {
        self.error_of(self.compensator.unwrap_or_default(), of).map(Reading::uncertain)
    }

    /// Relative uncertainties add, because both errors are of the same flight: the worst case over all correlations.
    fn error_ratio(&self) -> Result<Reading, String> {
        let after = self.error_of(self.compensator.unwrap_or_default(), |c| c.error_rms_m)?;
        let raw = self.error_of("raw", |c| c.error_rms_m)?;
        if raw.value <= 0.0 {
            return Err("the raw error is zero".to_owned());
        }
        let ratio = after.value / raw.value;
        let both = after.standard_uncertainty.zip(raw.standard_uncertainty);
        let standard_uncertainty = both.map(|(u, u_raw)| (u + ratio * u_raw) / raw.value);
        Ok(Reading::uncertain(Estimate { value: ratio, standard_uncertainty }))
    }

    fn step_at_fix(&self) -> Result<Reading, String> {
        let step = self.compensator()?.step_at_fix_rms_m;
        step.map(Reading::uncertain).ok_or_else(|| "the record has no step at a fix".to_owned())
    }

    /// The selected pair of this kind: as named, else the replayed one, else the only one.
    fn pair(&self, kind: DelayPairKind) -> Result<&'a PairDelay, String> {
        let record = self.record;
        let all = record.delays.as_ref().map(|d| d.pairs.as_slice()).unwrap_or_default();
        let named = |name: Option<&str>, is: &str| name.is_none_or(|n| n == is);
        let fits = |p: &&PairDelay| p.kind == kind && named(self.channel, &p.first) && named(self.against, &p.second);
        let fitting: Vec<&PairDelay> = all.iter().filter(fits).collect();
        let replayed = |p: &&&PairDelay| record.drawable().is_some_and(|r| is_of_replay(p, r));
        let mut of_replay = fitting.iter().filter(replayed);
        match (fitting.as_slice(), of_replay.next(), of_replay.next()) {
            ([], ..) if record.binding.is_none() => Err(no_replay(record)),
            ([], ..) => Err(self.no_pair(kind, all)),
            ([only], ..) | (_, Some(only), None) => Ok(only),
            (several, ..) => {
                let names: Vec<String> = several.iter().map(|p| format!("{} against {}", p.first, p.second)).collect();
                Err(format!("several pairs fit; name one with channel and against: {}", names.join("; ")))
            }
        }
    }

    /// Which pairs of this kind there are instead.
    fn no_pair(&self, kind: DelayPairKind, all: &[PairDelay]) -> String {
        let asked: Vec<&str> = [self.channel, self.against].into_iter().flatten().collect();
        let of_kind = all.iter().filter(|p| p.kind == kind);
        let pairs: Vec<String> = of_kind.map(|p| format!("{} against {}", p.first, p.second)).collect();
        match (asked.is_empty(), pairs.is_empty()) {
            (true, _) | (_, true) => "this flight has no such pair of channels".to_owned(),
            _ => format!("this flight has no pair of {}; it has {}", asked.join(" against "), pairs.join("; ")),
        }
    }

    fn delay(&self, kind: DelayPairKind) -> Result<Reading, String> {
        known(&self.pair(kind)?.delay).map(|found| Reading::within(found.delay_s, found.interval_95_s))
    }

    /// The flight's own delay of position against velocity.
    fn own_delay(&self) -> Result<&'a MeasuredDelay, String> {
        known(&self.pair(DelayPairKind::PositionAgainstVelocity)?.delay)
    }

    /// How much the delay changes: the difference found by the test of constancy if it does, otherwise the largest step
    /// between two windows. A velocity that changes against the IMU may take the position with it. A flight that was not
    /// tested has no number.
    fn delay_change(&self) -> Result<Reading, String> {
        let pair = self.pair(DelayPairKind::PositionAgainstVelocity)?;
        let size = |difference: Estimate| Reading::uncertain(Estimate { value: difference.value.abs(), ..difference });
        let over_time = pair.varies.as_ref();
        if let Some(varies) = over_time.filter(|o| o.kind.varies()) {
            let unknown = || "the delay changes, and the record does not say by how much".to_owned();
            return varies.constancy.difference_s.map(size).ok_or_else(unknown);
        }
        if let Some((_, change_s)) = self.record.delays.as_ref().and_then(|all| change_against_imu(&pair.second, all)) {
            return Ok(size(change_s));
        }
        match over_time {
            Some(over_time) if !over_time.constancy.tested => Err(format!(
                "whether the delay changes was not tested: it is known in {} windows of the flight, which are too few",
                over_time.constancy.windows
            )),
            _ => known(&pair.delay).and_then(change),
        }
    }

    /// The delay of position against velocity. For the pair that the answer is based on, U and interval are at least as
    /// large as the answer's, which include effects outside the channel models.
    fn position_delay(&self) -> Result<Reading, String> {
        let pair = self.pair(DelayPairKind::PositionAgainstVelocity)?;
        let found = known(&pair.delay)?;
        let of_answer = self.record.lateness.as_ref().filter(|l| {
            l.position.as_deref() == Some(pair.first.as_str()) && l.velocity.as_deref() == Some(pair.second.as_str())
        });
        let u = of_answer.and_then(|l| l.position_minus_velocity_s?.standard_uncertainty).unwrap_or(0.0);
        let [low, high] = found.interval_95_s;
        let Estimate { value, standard_uncertainty } = found.delay_s;
        let delay_s = Estimate { value, standard_uncertainty: standard_uncertainty.map(|own| own.max(u)) };
        Ok(Reading::within(delay_s, [low.min(value - 2.0 * u), high.max(value + 2.0 * u)]))
    }

    fn score(&self) -> Result<&'a CompensatorScore, String> {
        // If this one did not run, the error names those that did.
        let name = &self.compensator()?.name;
        let scores = self.replay()?.scores.as_ref().ok_or("the record has no scores")?;
        scores.compensators.iter().find(|c| c.name == *name).ok_or_else(|| format!("{name} was not scored"))
    }

    fn scored<T: 'a>(
        &self,
        finding: impl Fn(&'a CompensatorScore) -> &'a Finding<T>,
        of: impl Fn(&T) -> Estimate,
    ) -> Result<Reading, String> {
        known(finding(self.score()?)).map(|found| Reading::uncertain(of(found)))
    }

    /// If the errors are correlated over the whole flight, the residual has no uncertainty of its own: then it is the
    /// delay against the reference, which models the correlation, less the removed delay.
    fn residual_delay_against_reference(&self) -> Result<Reading, String> {
        let found = known(&self.against_reference()?.residual_delay_s)?;
        let delay = self.pair(DelayPairKind::PositionAgainstReference).ok().and_then(|pair| pair.delay.found());
        let removed_s = self.record.decision.as_ref().and_then(|decision| decision.delay_s);
        Ok(match (found.standard_uncertainty, delay.zip(removed_s)) {
            (None, Some((delay, removed_s))) => {
                let less = |value_s: f64| value_s - removed_s;
                let residual_s = Estimate { value: less(delay.delay_s.value), ..delay.delay_s };
                Reading::within(residual_s, delay.interval_95_s.map(less))
            }
            _ => Reading::uncertain(*found),
        })
    }

    fn against_reference(&self) -> Result<&'a ReferenceScore, String> {
        known(&self.score()?.reference)
    }

    fn residual_delay(&self) -> Result<Reading, String> {
        if self.replay()?.choice.as_ref().is_some_and(|choice| choice.circular) {
            let why = "the removed delay was measured in this same flight, so the residual is zero by construction";
            return Err(why.to_owned());
        }
        known(&self.score()?.residual_delay).map(|found| Reading::within(found.delay_s, found.interval_95_s))
    }

    fn motion_share(&self, of: impl Fn([f64; 3]) -> f64) -> Result<Reading, String> {
        let shares = known(&self.score()?.band)?.motion_share;
        let shares = shares.ok_or("the spectrum of the motion is unknown")?;
        Ok(Reading::plain(of(shares)))
    }

    fn onboard(&self) -> Result<Reading, String> {
        let name = &self.compensator()?.name;
        let onboard = self.replay()?.onboard.as_ref();
        let onboard = known(onboard.ok_or("the log has no position that was compensated in flight")?)?;
        let against = onboard.against.iter().find(|a| a.name == *name);
        Ok(Reading::plain(against.ok_or_else(|| format!("{name} was not compared with it"))?.rms_m))
    }

    fn sweep(&self) -> Result<&'a DelaySweep, String> {
        self.replay()?.sweep.as_ref().ok_or_else(|| "no other delays were tried on this flight".to_owned())
    }

    fn at_bench_value(&self, as_error: bool) -> Result<Reading, String> {
        let sweep = self.sweep()?;
        if as_error != matches!(sweep.score, SweepScore::ErrorAgainst(_)) {
            let why = if as_error {
                "the log has no reference to score against"
            } else {
                "the log has a reference: use error-at-bench-value"
            };
            return Err(why.to_owned());
        }
        let point = sweep.score_at(DelaySource::Card).ok_or("no sensor card gives a delay for this flight")?;
        Ok(Reading::uncertain(point.rms_m))
    }

    fn moving_share(&self) -> Result<Reading, String> {
        let pair = self.pair(DelayPairKind::PositionAgainstVelocity)?;
        let excitation = pair.excitation.as_ref().ok_or("the pair has no samples to compare")?;
        Ok(Reading::plain(excitation.moving_share))
    }

    /// The lateness of the replayed position from the flight, and the stated delay.
    fn found_and_stated(&self) -> Result<(Estimate, Estimate), String> {
        let (replay, found) = (self.replay()?, self.lateness_of_position()?);
        if found.channel != replay.pair.position {
            return Err(format!(
                "the lateness is that of {}, and {} was replayed",
                found.channel, replay.pair.position
            ));
        }
        Ok((found.lateness_s, stated_delay(replay)?))
    }

    fn difference(&self) -> Result<Reading, String> {
        let (found, stated) = self.found_and_stated()?;
        let both = found.standard_uncertainty.zip(stated.standard_uncertainty);
        let standard_uncertainty = both.map(|(u, v)| u.hypot(v));
        Ok(Reading::uncertain(Estimate { value: found.value - stated.value, standard_uncertainty }))
    }

    fn normalised_difference(&self) -> Result<Reading, String> {
        let (found, stated) = self.found_and_stated()?;
        let unknown = |what| format!("the uncertainty of the {what} is unknown, so E_n is not defined");
        let u = found.standard_uncertainty.ok_or_else(|| unknown("lateness"))?;
        let v = stated.standard_uncertainty.ok_or_else(|| unknown("stated delay"))?;
        Ok(Reading::plain((found.value - stated.value).abs() / (2.0 * u.hypot(v))))
    }
}

fn names(channels: &[ChannelHealth]) -> String {
    channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ")
}

/// Whether a pair is the replayed one, or compares one of its channels with another.
fn is_of_replay(pair: &PairDelay, replay: &ReplayRecord) -> bool {
    let PairUse { position, velocity, reference } = &replay.pair;
    let scored = |channel: &str| pair.first == channel && reference.as_ref() == Some(&pair.second);
    match pair.kind {
        DelayPairKind::PositionAgainstVelocity => pair.first == *position && pair.second == *velocity,
        DelayPairKind::VelocityAgainstAcceleration => pair.first == *velocity,
        DelayPairKind::PositionAgainstReference => scored(position),
        DelayPairKind::VelocityAgainstReference => scored(velocity),
        DelayPairKind::BetweenReceivers => false,
    }
}

/// The value of a finding, or why it is unknown.
fn known<T>(finding: &Finding<T>) -> Result<&T, String> {
    match finding {
        Finding::Found(found) => Ok(found),
        Finding::CannotTell(why) => Err(why.clone()),
    }
}

/// The delay from outside this flight: the card's, else the pipeline's.
fn stated_delay(replay: &ReplayRecord) -> Result<Estimate, String> {
    let Some(choice) = &replay.choice else {
        let settings = &replay.settings;
        return Ok(Estimate { value: settings.delay.seconds(), standard_uncertainty: settings.delay_uncertainty_s });
    };
    let of = |source| choice.candidates.iter().find(|c| c.source == source).and_then(|c| c.delay_s.found().copied());
    let stated = of(DelaySource::Card).or_else(|| of(DelaySource::Fixed));
    stated.ok_or_else(|| "neither a sensor card nor the pipeline states a delay".to_owned())
}

fn lead_error(score: &CompensatorScore) -> Result<Reading, String> {
    let lead = known(&score.lead_s)?;
    let value = lead.value - score.expected_lead_s;
    Ok(Reading::uncertain(Estimate { value, ..*lead }))
}

/// The rms of a pair of mean and rms.
fn rms([_, rms]: [Estimate; 2]) -> Reading {
    Reading::uncertain(rms)
}

fn correction(result: &CompensatorResult) -> Reading {
    Reading::uncertain(result.raw_minus_this_rms_m)
}

fn optimum(sweep: &DelaySweep) -> Result<Reading, String> {
    known(&sweep.optimum).map(|found| Reading::within(found.delay_s, found.interval_95_s))
}

fn smallest_detectable(found: &MeasuredDelay) -> Reading {
    Reading::plain(found.smallest_detectable_s)
}

fn expanded_uncertainty(delay_s: Estimate) -> Result<Reading, String> {
    let u = delay_s.standard_uncertainty.ok_or("the record gives no uncertainty of the delay")?;
    Ok(Reading::plain(2.0 * u))
}

/// The largest step between two parts of the flight. It was searched for at every border between windows, so its
/// 95 % interval is corrected for all of them (Bonferroni).
fn change(found: &MeasuredDelay) -> Result<Reading, String> {
    let windows = found.over_time.len();
    let test = found.homogeneity.filter(|_| windows > 1);
    let test = test.ok_or("this flight has fewer than two time windows with a measured delay")?;
    let step = test.largest_step;
    let value = (step.after_s.value - step.before_s.value).abs();
    let both = step.before_s.standard_uncertainty.zip(step.after_s.standard_uncertainty);
    let Some(u) = both.map(|(before, after)| before.hypot(after)) else {
        return Ok(Reading::uncertain(Estimate { value, standard_uncertainty: None }));
    };
    let wide = u * signal::normal_quantile(1.0 - 0.025 / (windows - 1) as f64).max(2.0);
    let estimate = Estimate { value, standard_uncertainty: Some(u) };
    Ok(Reading::within(estimate, [(value - wide).max(0.0), value + wide]))
}

fn worst_injection(found: &MeasuredDelay) -> Result<Reading, String> {
    let worst = found.injections.iter().max_by(|a, b| a.error_s.value.abs().total_cmp(&b.error_s.value.abs()));
    let worst = worst.ok_or("a known delay could not be injected into this flight and recovered")?;
    Ok(Reading::within(worst.error_s, worst.interval_95_s))
}

fn valid_share(replay: &ReplayRecord) -> Result<Reading, String> {
    share(replay.coverage.valid_s, replay.coverage.duration_s, "the replay covers no time")
}

fn damaged_share(log: &LogHealth) -> Result<Reading, String> {
    share(log.bytes.damaged as f64, log.bytes.size as f64, "the log is empty")
}

fn used_share(channel: &ChannelHealth) -> Result<Reading, String> {
    share(channel.used as f64, channel.rows as f64, "the channel has no rows")
}

fn share(part: f64, whole: f64, without: &str) -> Result<Reading, String> {
    if whole > 0.0 { Ok(Reading::plain(part / whole)) } else { Err(without.to_owned()) }
}

fn longest_step(channel: &ChannelHealth) -> Result<Reading, String> {
    let steps = channel.stamps.as_ref().and_then(|s| s.steps_s);
    Ok(Reading::plain(steps.ok_or("the channel has fewer than two timestamps")?.max))
}
