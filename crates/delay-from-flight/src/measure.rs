//! Measures one pair of channels, from the flight to the finding.

use super::coarse::{self, Coarse};
use super::fit::{Record, View, estimate, fit_shared, walk_of};
use super::gate::{self, Motion, SEARCH_STEP_S};
use super::local::{BodyAxes, Most, Prepared, prepare};
use super::pairs::{Pair, Second};
use super::pieces::{self, Names, Piece, Stretch};
use super::{FlightDelaySettings, doubt, foreign, injection, over_time, skew, split, varies};
use crate::horizontal::Horizontal;
use flight::{Flight, Notices};
use record::{
    Constancy, DelayExcitation, DelayNoise, DelayOverTime, DelayPiece, Estimate, Finding, MeasuredDelay, PairDelay,
};
use signal::{ComponentFit, DelayFit, DelaySettings, DelayStart, Measurement, NoiseRule, OtherMinimum};
use std::borrow::Cow;

/// Standard uncertainties at which a change is detected at 5 % with 80 % probability: 1.96 + 0.84.
const DETECTABLE: f64 = 2.8;
/// Standard deviations on each side that hold 95 % of a normal distribution.
const NORMAL_95: f64 = 1.96;

/// Result of the pair; notices list everything that was skipped on the way.
pub(crate) fn measure(
    flight: &Flight,
    pair: &Pair,
    settings: &FlightDelaySettings,
    notices: &mut Notices,
) -> PairDelay {
    let (first, second) = pair.names();
    let mut finding = PairDelay {
        kind: pair.kind,
        first,
        second,
        meaning: pair.meaning(),
        origin: None,
        excitation: None,
        delay: Finding::CannotTell(String::new()),
        varies: None,
        not_for_network: None,
        is_attitude_untested: matches!(&pair.second, Second::Acceleration(of) if of.attitude_late_s.is_none()),
        lever_arm_s_per_decimetre: None,
    };
    let first_look = Look {
        most_samples: settings.first_look_samples,
        most_hz: settings.first_look_hz,
        enough_s: settings.enough_s,
    };
    let second_look = Look { most_samples: settings.most_samples, most_hz: f64::INFINITY, enough_s: f64::INFINITY };
    let mut found = Err(NoDelay::MoreSamples);
    for look in [first_look, second_look] {
        let mut own = Notices::new();
        found = delay_of(flight, pair, look, settings, &mut own, &mut finding);
        if !matches!(found, Err(NoDelay::MoreSamples)) {
            notices.extend_unsaid(own);
            break;
        }
    }
    finding.delay = match found {
        Ok(delay) => Finding::Found(delay),
        Err(NoDelay::Because(reason)) => Finding::CannotTell(reason),
        Err(NoDelay::MoreSamples) => Finding::CannotTell("the delay is not known well enough".to_owned()),
    };
    finding
}

/// How thoroughly a pair is measured.
#[derive(Clone, Copy)]
struct Look {
    most_samples: usize,
    most_hz: f64,
    /// A delay that is more uncertain is measured again with more samples, if there are more, s.
    enough_s: f64,
}

impl Look {
    fn is_enough(self, fit: &Result<DelayFit, String>) -> bool {
        let knows = |fit: &DelayFit| fit.standard_uncertainty_s <= self.enough_s;
        !self.enough_s.is_finite() || fit.as_ref().is_ok_and(knows)
    }
}

/// Why a look found no delay.
enum NoDelay {
    /// A closer look may find one.
    MoreSamples,
    Because(String),
}

impl From<String> for NoDelay {
    fn from(reason: String) -> NoDelay {
        NoDelay::Because(reason)
    }
}

fn delay_of(
    flight: &Flight,
    pair: &Pair,
    look: Look,
    settings: &FlightDelaySettings,
    notices: &mut Notices,
    finding: &mut PairDelay,
) -> Result<MeasuredDelay, NoDelay> {
    let most = Most { of_first: (look.most_samples, look.most_hz), of_second: settings.most_compared };
    let mut prepared = prepare(flight, pair, most, notices)?;
    finding.origin = Some(prepared.origin);
    if let Some(reason) = gate::refuse_stamps(prepared.stamps_s, settings) {
        return Err(reason.into());
    }
    if prepared.body.is_some() {
        finding.not_for_network = gate::too_slow_for_datum(&prepared.second);
    }
    let second = pair.second.name();
    let names = Names { first: &pair.first, second: &second };
    let mut body = prepared.body.take();
    let compared = Compared::of(pair, &prepared, &mut body, &names, notices);
    let moving = compared.moving();
    let ranges = pieces::stretches(&moving.t, pieces::longest_gap(compared.step_s, settings));
    let stretches = pieces::references(moving, &ranges, prepared.integrate, body.as_ref());
    let coarse = coarse_delay(&prepared.first, &stretches, settings, &names)?;
    let known =
        Known { flight, pair, names, prepared: &prepared, compared: &compared, stretches: &stretches, settings };
    let measured = known.measured(coarse, look, notices, finding)?;
    Ok(if pair.reversed { reversed(measured) } else { measured })
}

/// The second channel, prepared for the comparison with the first.
struct Compared<'a> {
    /// Without spikes.
    second: Cow<'a, Horizontal>,
    /// A fast velocity, a noisy track or a noisy acceleration, with its white noise averaged before it is integrated or
    /// interpolated.
    smoothed: Option<Horizontal>,
    /// Usual interval, s.
    step_s: Option<f64>,
    is_velocity: bool,
}

impl<'a> Compared<'a> {
    fn of(
        pair: &Pair,
        prepared: &'a Prepared,
        body: &mut Option<BodyAxes>,
        names: &Names<'_>,
        notices: &mut Notices,
    ) -> Compared<'a> {
        let despiked = match prepared.integrate {
            true => pieces::without_spikes(&prepared.second, body, names.second, notices),
            false => None,
        };
        let second = despiked.map_or(Cow::Borrowed(&prepared.second), Cow::Owned);
        let step_s = pieces::usual_step_s(&second.t);
        let is_velocity = matches!(pair.second, Second::Velocity(_));
        let smoothed = match (is_velocity, prepared.integrate) {
            (true, _) => pieces::smoothed_velocity(&second, step_s),
            (false, false) => pieces::smoothed_track(&second, step_s),
            (false, true) => pieces::smoothed_acceleration(&second, step_s),
        };
        Compared { second, smoothed, step_s, is_velocity }
    }

    /// The channel that is integrated or interpolated.
    fn moving(&self) -> &Horizontal {
        self.smoothed.as_ref().unwrap_or(&self.second)
    }

    /// White noise of a rate, which may look like motion.
    fn noise(&self, prepared: &Prepared) -> f64 {
        if prepared.integrate { gate::noise_of_motion(&self.second, self.step_s) } else { 0.0 }
    }

    /// Random walk from integrating the white noise of a velocity.
    fn walk(&self) -> f64 {
        if self.is_velocity { walk_of(&self.second, self.step_s) } else { 0.0 }
    }
}

/// Inputs of the fits.
struct Known<'a> {
    flight: &'a Flight,
    pair: &'a Pair,
    names: Names<'a>,
    prepared: &'a Prepared,
    compared: &'a Compared<'a>,
    stretches: &'a [Stretch<'a>],
    settings: &'a FlightDelaySettings,
}

impl<'a> Known<'a> {
    /// The delay near `coarse`, in the direction of the fit.
    fn measured(
        &self,
        mut coarse: Coarse,
        look: Look,
        notices: &mut Notices,
        finding: &mut PairDelay,
    ) -> Result<MeasuredDelay, NoDelay> {
        let Known { flight, prepared, stretches, settings, .. } = *self;
        let first = &prepared.first;
        let mut cut = pieces::pieces(prepared, stretches, coarse.delay_s, &self.names, notices);
        let offer =
            finding.excitation.insert(gate::excitation(first, &cut, stretches, coarse.delay_s, &prepared.speed.1));
        let motion = self.motion(&cut, coarse.delay_s, offer)?;
        let (record, fit) = self.fit(&mut cut, &mut coarse, &mut finding.varies);
        if prepared.one_in > 1 && !look.is_enough(&fit) {
            return Err(NoDelay::MoreSamples);
        }
        let fit = fit.map_err(|reason| refusal(reason, finding.varies.as_ref()))?;
        let delay_settings = settings_about(coarse.delay_s);
        let (fit, skew) = mean_of_skewed(&record.measurements(), &delay_settings, fit);
        offer.predicted_s = Some(fit.crlb_s);
        let compared = foreign::Compared { first, pieces: &cut, stretches, delay_s: fit.delay_s };
        self.check_fit(&fit, &compared, offer, &motion, &mut finding.varies)?;
        let view = View { flight, prepared, pieces: &cut, record: &record, fit: &fit, settings };
        let wanted = |(p, v): &(String, String)| finding.first == *p && finding.second == *v;
        let mut measured = view.finding(&delay_settings, settings.detailed.as_ref().is_none_or(wanted));
        doubt::doubt(&mut measured, &view, finding.varies.as_ref(), (self.pair.kind, skew.as_ref()));
        if matches!(self.pair.second, Second::Acceleration(_)) {
            measured.remarks.extend(compared.turned_words(&self.names));
        }
        Ok(measured)
    }

    /// Fails with the reason if the channels do not move alike or the fit does not pass the gate. Sets the unexplained
    /// share of `offer`.
    fn check_fit(
        &self,
        fit: &DelayFit,
        compared: &foreign::Compared<'_>,
        offer: &mut DelayExcitation,
        motion: &Motion,
        varies: &mut Option<DelayOverTime>,
    ) -> Result<(), String> {
        offer.unexplained_share = compared.unexplained_share();
        let unlike = compared.refusal(offer.unexplained_share, &self.names);
        if unlike.is_some() {
            // If channels do not move alike, no scatter or drift is reported, unless a change is detected.
            varies.take_if(|varies| !varies.kind.varies());
        }
        let reason = unlike.or_else(|| {
            gate::refuse_fit(fit, offer, motion, self.settings, &self.names, || compared.turned_words(&self.names))
        });
        reason.map_or(Ok(()), |reason| Err(refusal(reason, varies.as_ref())))
    }

    /// The motion, if it can show a delay at all.
    fn motion(&self, cut: &[Piece], delay_s: f64, offer: &DelayExcitation) -> Result<Motion, String> {
        let acceleration = matches!(self.pair.second, Second::Acceleration(_) | Second::Rate(_));
        let motion = gate::motion(&self.prepared.first, cut, self.stretches, delay_s, acceleration);
        let noise = self.compared.noise(self.prepared);
        gate::refuse_motion(offer, &motion, noise, &self.prepared.speed.1).map_or(Ok(motion), Err)
    }

    /// The varying delay, unless `varies` has it from an earlier look, and the constant one. Fixes of bursts are
    /// removed from `cut`. If the varying delay is elsewhere, `coarse` follows it. In both cases the constant fit is
    /// repeated.
    fn fit(
        &self,
        cut: &mut [Piece],
        coarse: &mut Coarse,
        varies: &mut Option<DelayOverTime>,
    ) -> (Record<'a>, Result<DelayFit, String>) {
        let over_time = || match varies {
            None => varies::over_time(self.pair, self.prepared, self.compared.moving(), cut, self.settings),
            Some(_) => None,
        };
        let walk = self.compared.walk();
        // In parallel, because the varying delay seldom requires another constant fit.
        let (over_time, constant) = rayon::join(over_time, || self.constant(cut, coarse, walk));
        *varies = over_time.or(varies.take());
        let Some(over_time) = varies else { return constant };
        let fewer = varies::skip_bursts(cut, &self.prepared.first.t, over_time);
        let elsewhere = varies::start(coarse, over_time);
        if !fewer && elsewhere.is_none() {
            return constant;
        }
        *coarse = elsewhere.unwrap_or(*coarse);
        self.constant(cut, coarse, walk)
    }

    fn constant(&self, cut: &[Piece], coarse: &Coarse, walk: f64) -> (Record<'a>, Result<DelayFit, String>) {
        let record = Record::of(self.prepared, cut, self.stretches);
        let fit = fit_of_rivals(&record.measurements(), (&settings_about(coarse.delay_s), walk), coarse);
        (record, fit)
    }
}

/// A delay that changes, or differs between parts of the flight, is the better reason. If it changes, no further flight
/// makes it one number.
fn refusal(reason: String, varies: Option<&DelayOverTime>) -> String {
    match varies {
        Some(varies) if varies.kind.varies() => varies.words.clone(),
        Some(DelayOverTime { constancy: Constancy { note: Some(note), .. }, .. }) => format!("{note} ({reason})"),
        _ => reason,
    }
}

/// Half the search range of a fit, s.
const HALF_SEARCH_S: f64 = 0.6;

pub(super) fn about(delay_s: f64) -> (f64, f64) {
    (delay_s - HALF_SEARCH_S, delay_s + HALF_SEARCH_S)
}

/// Settings of a fit around this delay.
pub(super) fn settings_about(delay_s: f64) -> DelaySettings {
    DelaySettings {
        search_s: about(delay_s),
        search_step_s: SEARCH_STEP_S,
        noise: NoiseRule::WanderAndWhite,
        skew: false,
        robust: true,
    }
}

/// The coarse delay in the range of the settings, or in the wide range if it is at the edge of the first.
fn coarse_delay(
    first: &Horizontal,
    stretches: &[Stretch],
    settings: &FlightDelaySettings,
    names: &Names,
) -> Result<Coarse, String> {
    let none = || {
        let span_s = first.t.last().zip(first.t.first()).map_or(0.0, |(last, start)| last - start);
        format!(
            "{} ({} fixes over {span_s:.1} s) and {} have too little in common at any delay searched: both are needed \
             over the whole flight",
            names.first,
            first.t.len(),
            names.second
        )
    };
    let found = coarse::coarse_delay(first, stretches, settings.search_s).ok_or_else(none)?;
    if !found.at_edge {
        return Ok(found);
    }
    let wide = coarse::coarse_delay(first, stretches, settings.wide_search_s).ok_or_else(none)?;
    if wide.at_edge {
        let (from, to) = settings.wide_search_s;
        return Err(format!(
            "{} follows {} best at the edge of all delays searched ({from} to {to} s): check the clocks of both",
            names.first, names.second
        ));
    }
    Ok(wide)
}

/// Least decrease of −2 ln L at a rival to be preferred over the delay nearer to zero,
const WORTH_A_RIVAL: f64 = 12.0;
/// and least decrease of the residual, m or m/s (rms): less is rounding and interpolation.
const WORTH_A_RIVAL_RMS: f64 = 1e-3;

/// Two fits closer than this many standard uncertainties have found one minimum.
const ONE_MINIMUM_U: f64 = 3.0;

/// Residual of a fit, unit of the first channel.
fn residual_rms(fit: &DelayFit) -> f64 {
    let all = || fit.components.iter().flat_map(|c| &c.residuals);
    (all().map(|e| e * e).sum::<f64>() / all().count().max(1) as f64).sqrt()
}

/// The fit around the coarse delay, or around its rival if that explains the samples clearly better. The other one
/// becomes the second minimum.
fn fit_of_rivals(
    measurements: &[Measurement],
    (settings, walk): (&DelaySettings, f64),
    coarse: &Coarse,
) -> Result<DelayFit, String> {
    let fit = fit_shared(measurements, settings, walk).map_err(|e| e.to_string());
    let Some(rival_s) = coarse.rival_s else { return fit };
    let rival = fit_shared(measurements, &DelaySettings { search_s: about(rival_s), ..*settings }, walk);
    let (mut fit, mut rival) = match (fit, rival) {
        (Ok(fit), Ok(rival)) => (fit, rival),
        (Ok(fit), Err(_)) | (Err(_), Ok(fit)) => return Ok(fit),
        (Err(error), Err(_)) => return Err(error),
    };
    if (rival.delay_s - fit.delay_s).abs() < ONE_MINIMUM_U * fit.hessian_s {
        return Ok(fit);
    }
    let [here, there] = signal::delay_objective(measurements, &fit, &[fit.delay_s, rival.delay_s])[..] else {
        return Ok(fit);
    };
    let mut excess = there - here;
    if excess < -WORTH_A_RIVAL && residual_rms(&rival) < residual_rms(&fit) - WORTH_A_RIVAL_RMS {
        std::mem::swap(&mut fit, &mut rival);
        excess = -excess;
    }
    let other = OtherMinimum { delay_s: rival.delay_s, excess };
    if fit.second_minimum.is_none_or(|m| m.excess > excess) {
        fit.second_minimum = Some(other);
    }
    Ok(fit)
}

/// The unweighted fit if lateness is lopsided, to obtain its mean.
fn mean_of_skewed(
    measurements: &[Measurement],
    settings: &DelaySettings,
    fit: DelayFit,
) -> (DelayFit, Option<skew::Skew>) {
    if !skew::is_skewed(&fit) {
        return (fit, None);
    }
    let start =
        DelayStart { delay_s: fit.delay_s, noise: fit.components.iter().map(|c| c.noise).collect(), keep_noise: false };
    match signal::fit_delay_near(measurements, &DelaySettings { robust: false, ..*settings }, &start) {
        // If the two are this close, it does not matter which is reported.
        Ok(mean) if mean.converged && (mean.delay_s - fit.delay_s).abs() > 2.0 * mean.standard_uncertainty_s => {
            let found = skew::Skew { typical_s: fit.delay_s };
            (DelayFit { second_minimum: fit.second_minimum, ..mean }, Some(found))
        }
        _ => (fit, None),
    }
}

impl View<'_> {
    fn finding(&self, delay_settings: &DelaySettings, in_detail: bool) -> MeasuredDelay {
        let fit = self.fit;
        let over = over_time::over_time(self);
        // Timestamp errors are constant throughout a flight, so comparisons of parts or fits ignore them.
        let stamps_s = self.prepared.stamps_s;
        let uncertainty_s = fit.standard_uncertainty_s.hypot(stamps_s);
        let [from, to] = fit.interval(0.95);
        let half_s = (0.5 * (to - from)).hypot(NORMAL_95 * stamps_s);
        let (injections, (objective, splits)) = if in_detail {
            let objective = || crate::objective::objective(&self.record.measurements(), fit, delay_settings.search_s);
            rayon::join(|| injection::injections(self, delay_settings), || (Some(objective()), split::splits(self)))
        } else {
            Default::default()
        };
        MeasuredDelay {
            delay_s: estimate(fit.delay_s, uncertainty_s),
            interval_95_s: [fit.delay_s - half_s, fit.delay_s + half_s],
            hessian_s: fit.hessian_s,
            hac_s: fit.hac_s,
            widened_s: 0.0,
            crlb_s: fit.crlb_s,
            smallest_detectable_s: DETECTABLE * uncertainty_s,
            samples: fit.components.iter().map(|c| c.t_used.len() as u64).sum(),
            downweighted_share: fit.downweighted_share,
            rival_s: self.rival(),
            objective,
            pieces: self.pieces.iter().zip(fit.components.chunks_exact(2)).map(piece).collect(),
            over_time: over.windows,
            homogeneity: over.homogeneity,
            alarm: over.alarm,
            splits,
            injections,
            remarks: vec![],
            alarms: vec![],
        }
    }

    /// Another minimum within three units of chi-squared, scaled by the larger uncertainty.
    fn rival(&self) -> Option<f64> {
        let noise = (self.fit.standard_uncertainty_s / self.fit.hessian_s).powi(2);
        self.fit.second_minimum.filter(|m| m.excess < 3.0 * noise).map(|m| m.delay_s)
    }
}

fn piece((piece, fits): (&Piece, &[ComponentFit])) -> DelayPiece {
    let of = |fit: &ComponentFit| {
        let m = fit.noise;
        let wanders = m.wander_std > 0.0;
        DelayNoise {
            wander_std: wanders.then_some(m.wander_std),
            time_constant_s: wanders.then_some(m.time_constant_s),
            white_std: m.white_std,
        }
    };
    let drift = |fit: &ComponentFit| match fit.drift {
        Some(d) => estimate(d.value, d.standard_uncertainty),
        None => estimate(0.0, 0.0),
    };
    let t = &fits[0].t_used;
    DelayPiece {
        start_s: t.first().copied().unwrap_or(0.0),
        end_s: t.last().copied().unwrap_or(0.0),
        begun_by: piece.begun_by.clone(),
        drift: [drift(&fits[0]), drift(&fits[1])],
        noise: [of(&fits[0]), of(&fits[1])],
    }
}

/// The finding of the reversed fit: all delays change sign.
fn reversed(mut m: MeasuredDelay) -> MeasuredDelay {
    let turn = |e: &mut Estimate| e.value = -e.value;
    let turn_interval = |i: &mut [f64; 2]| *i = [-i[1], -i[0]];
    turn(&mut m.delay_s);
    turn_interval(&mut m.interval_95_s);
    m.rival_s = m.rival_s.map(|r| -r);
    m.over_time.iter_mut().for_each(|w| turn(&mut w.delay_s));
    m.objective.iter_mut().flat_map(|o| o.delay_s.iter_mut().chain(&mut o.near_delay_s)).for_each(|d| *d = -*d);
    if let Some(h) = &mut m.homogeneity {
        turn(&mut h.largest_step.before_s);
        turn(&mut h.largest_step.after_s);
    }
    m.splits.iter_mut().flat_map(|s| &mut s.groups).for_each(|g| turn(&mut g.delay_s));
    for injection in &mut m.injections {
        turn(&mut injection.error_s);
        turn_interval(&mut injection.interval_95_s);
        injection.injected_s = -injection.injected_s;
    }
    m
}
