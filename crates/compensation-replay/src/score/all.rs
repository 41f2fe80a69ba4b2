//! All scores of a replay.

use super::against_reference::Judge;
use super::budget::{Ground, StandIn};
use super::jackknife::{Blocks, root_mean};
use super::motion::{self, Motion};
use super::truthless::{self, Legs, Passes};
use super::updates::Updates;
use super::{Innovations, Reference};
use crate::estimate::{EXACT_ASYNC, Positions};
use crate::input::Input;
use crate::rows::{Rows, median_step};
use crate::settings::Settings;
use crate::validity::{DelayModel, Delays, ValidityBand};
use delay_from_flight::{AXES, TrackFit, TrackFitter};
use record::{CompensatorScore, Estimate, Finding, HelpfulBand, ReferenceScore, ReplayScores, ResidualDelay};
use std::ops::Range;

/// Share of the raw error that still counts as helpful.
const HELP: f64 = 0.1;

/// Inputs of the scoring.
pub(crate) struct Played<'a> {
    pub(crate) input: &'a Input,
    pub(crate) settings: &'a Settings,
    pub(crate) segments: &'a [Range<usize>],
    pub(crate) rows: &'a Rows,
    /// Raw first.
    pub(crate) tracks: &'a [Positions],
    /// Predicted displacement, 2-D rms, m.
    pub(crate) travelled_m: f64,
}

type Fit = Result<TrackFit, String>;

const NO_REFERENCE: &str = "the log holds no independent position";

/// Expected lateness of a track against the velocity, s: Tp − Td − Tv if correct (delay network, section 1).
fn apart_s(track: &Positions, settings: &Settings) -> f64 {
    let td = settings.delay.seconds();
    let raw_s = settings.position_minus_velocity_s.map_or(td, |e| e.value);
    if track.is_raw() { raw_s } else { raw_s - td }
}

/// The same, including the error of the compensator itself.
fn expected(track: &Positions, settings: &Settings, ground: &Ground<'_>, updates: &Updates) -> Estimate {
    let apart = settings.position_minus_velocity_s;
    if track.is_raw() {
        let set = Estimate { value: settings.delay.seconds(), standard_uncertainty: settings.delay_uncertainty_s };
        return apart.unwrap_or(set);
    }
    let u = apart.and_then(|e| e.standard_uncertainty).unwrap_or(0.0);
    let truncation = ground.truncation_delay_s(track);
    let value = apart_s(track, settings) + truncation + updates.unknown_age_s(track);
    Estimate { value, standard_uncertainty: Some(u.hypot(0.5 * truncation)) }
}

/// Results of the tests of all tracks.
struct Tests<'a> {
    played: &'a Played<'a>,
    updates: Updates<'a>,
    fits: Vec<Fit>,
    legs: Legs,
    passes: Passes,
    motion: Result<Motion, String>,
    against_reference: Vec<Finding<ReferenceScore>>,
}

/// Everything of [`ReplayScores`].
pub(crate) fn scores(played: &Played, innovations: Innovations) -> ReplayScores {
    let Played { input, settings, rows, tracks, .. } = *played;
    let step_correlations: Vec<_> = tracks.iter().map(|t| truthless::step_correlation(&innovations, t)).collect();
    drop(innovations);
    let at_rows = input.reference.as_ref().map(|r| Reference::at(r, rows, rows.valid()));
    let judge = at_rows.as_ref().map(|r| Judge::of(r, rows, &input.velocity));
    let tests = Tests::of(played, judge.as_ref());
    let velocity_delay_s = tests.velocity_delay();
    let late = late(residual(&tests.fits[0]), &velocity_delay_s, settings);
    let ground = tests.ground(&late);
    let scored = step_correlations.into_iter().enumerate();
    ReplayScores {
        compensators: scored.map(|(k, correlation)| tests.score(k, &ground, correlation)).collect(),
        predicted_axes_rms_m: AXES.map(|k| {
            let displacement = rows.predicted(input, settings, k);
            mean_over(rows, |r| displacement[r].powi(2)).sqrt()
        }),
        straight_legs: tests.legs.finding(),
        opposite_passes: tests.passes.finding(),
        motion: motion::finding(&tests.motion),
        bands_hz: judge.as_ref().map(|j| j.bands_hz.clone()).unwrap_or_default(),
        speeds_mps: judge.as_ref().map(|j| j.speeds_mps.clone()).unwrap_or_default(),
        velocity_delay_s,
    }
}

/// Mean over the valid rows.
fn mean_over(rows: &Rows, of: impl Fn(usize) -> f64) -> f64 {
    rows.valid().map(of).sum::<f64>() / rows.valid().count().max(1) as f64
}

impl<'a> Tests<'a> {
    fn of(played: &'a Played<'a>, judge: Option<&Judge<'_>>) -> Tests<'a> {
        let Played { input, settings, segments, rows, tracks, .. } = *played;
        let td = settings.delay.seconds();
        let updates = Updates::of(input, rows, segments);
        let against = |track: &Positions| match judge {
            Some(judge) => judge.score(track, if track.is_raw() { td + rows.mean_age_s(input) } else { 0.0 }),
            None => Finding::CannotTell(NO_REFERENCE.to_owned()),
        };
        Tests {
            played,
            fits: fits(input, settings, tracks, &updates),
            legs: Legs::of(&updates, td),
            passes: Passes::of(&updates, &tracks[0]),
            motion: Motion::of(&input.velocity, segments, td),
            against_reference: tracks.iter().map(against).collect(),
            updates,
        }
    }

    fn velocity_delay(&self) -> Finding<Estimate> {
        match self.played.tracks.iter().position(|t| t.name == EXACT_ASYNC) {
            Some(k) => velocity_delay(&self.fits[k], &self.against_reference[k]),
            None => Finding::CannotTell(NO_REFERENCE.to_owned()),
        }
    }

    fn ground<'b>(&'b self, late: &'b Late) -> Ground<'b> {
        let Played { input, settings, rows, travelled_m, .. } = *self.played;
        let td = settings.delay.seconds();
        Ground {
            speed_mps: mean_over(rows, |r| AXES.map(|k| rows.velocity[k][r].powi(2)).iter().sum()).sqrt(),
            delay_s: td,
            delay_u_s: settings.delay_uncertainty_s,
            age_s: (rows.mean_age_s(input), mean_over(rows, |r| rows.age_s(input, r).powi(2))),
            travelled_m,
            raw_fit: self.fits[0].as_ref().map_err(String::as_str),
            motion: self.motion.as_ref().map_err(String::as_str),
            left_s: late.position_s.map(|e| Estimate { value: e.value - td, ..e }),
            velocity_delay_s: &late.velocity_s,
            row_step_s: median_step(&rows.t),
        }
    }

    /// Score of the `k`-th track.
    fn score(&self, k: usize, ground: &Ground<'_>, step_correlation: Finding<Estimate>) -> CompensatorScore {
        let Played { settings, rows, tracks, .. } = *self.played;
        let (raw, track, updates) = (&tracks[0], &tracks[k], &self.updates);
        let reference = self.against_reference[k].clone();
        CompensatorScore {
            name: track.name.clone(),
            residual_delay: residual_finding(&self.fits[k], expected(track, settings, ground, updates)),
            lead_s: truthless::lead(updates, raw, track),
            expected_lead_s: track.delay.seconds(),
            step_correlation,
            hysteresis: self.passes.hysteresis(updates, track, apart_s(track, settings)),
            raw_minus_this_axes_rms_m: differences(raw, track, rows),
            straight: self.legs.score(updates, raw, track),
            budget: ground.budget(track, reference.found().map(|score| score.rms_m)),
            reference,
            band: band(track, band_delays(ground.left_s, ground.velocity_delay_s), &self.motion),
        }
    }
}

/// Delays of the tracks against the integral of velocity. The paper's filter with the mean age added is deliberately
/// early at a fresh fix, so it is excluded.
fn fits(input: &Input, settings: &Settings, tracks: &[Positions], updates: &Updates) -> Vec<Fit> {
    let mut fitter = TrackFitter::new(&input.velocity);
    let fit = |track: &Positions| {
        if track.further.is_none() && track.delay.seconds() > settings.delay.seconds() {
            return Err("tuned for the average between two fixes, and this test uses fresh fixes only".to_owned());
        }
        let expected_s = if track.is_raw() { settings.delay.seconds() } else { 0.0 };
        fitter.fit(updates.horizontal(track), expected_s)
    };
    tracks.iter().map(fit).collect()
}

fn residual(fit: &Fit) -> Option<Estimate> {
    fit.as_ref().ok().map(|f| Estimate { value: f.delay_s, standard_uncertainty: Some(f.standard_uncertainty_s) })
}

fn residual_finding(fit: &Fit, expected_s: Estimate) -> Finding<ResidualDelay> {
    match fit {
        Ok(f) => Finding::Found(ResidualDelay {
            delay_s: Estimate { value: f.delay_s, standard_uncertainty: Some(f.standard_uncertainty_s) },
            interval_95_s: f.interval_95_s,
            samples: f.samples,
            expected_s,
        }),
        Err(why) => Finding::CannotTell(why.clone()),
    }
}

/// Lateness of the exact form against the reference in excess of its lateness against the velocity.
fn velocity_delay(fit: &Fit, score: &Finding<ReferenceScore>) -> Finding<Estimate> {
    let against_reference = match score {
        Finding::Found(score) => &score.residual_delay_s,
        Finding::CannotTell(why) => return Finding::CannotTell(why.clone()),
    };
    match (residual(fit), against_reference) {
        (Some(a), Finding::Found(b)) => Finding::Found(Estimate {
            value: b.value - a.value,
            standard_uncertainty: a.standard_uncertainty.zip(b.standard_uncertainty).map(|(a, b)| a.hypot(b)),
        }),
        (_, Finding::CannotTell(why)) => Finding::CannotTell(why.clone()),
        (None, _) => Finding::CannotTell(fit.as_ref().err().cloned().unwrap_or_default()),
    }
}

/// How late position and velocity are, s.
struct Late {
    position_s: Option<Estimate>,
    velocity_s: Finding<Estimate>,
}

/// Largest share of a wrongly set delay that turns may add to the velocity's delay against the reference.
const TURNED: f64 = 0.1;

/// From the lateness of the flight and its group against one datum. Otherwise from the reference, if it shows that the
/// velocity is late. Otherwise from the position against the velocity, whose own lateness is then unknown.
fn late(raw_s: Option<Estimate>, by_reference_s: &Finding<Estimate>, settings: &Settings) -> Late {
    if let (Some(position_s), Some(velocity_s)) = (settings.position_lateness_s, settings.velocity_lateness_s) {
        return Late { position_s: Some(position_s), velocity_s: Finding::Found(velocity_s) };
    }
    let set_wrongly_s = raw_s.map_or(0.0, |raw| raw.value - settings.delay.seconds());
    let seen = |tv: &&Estimate| {
        let u = tv.standard_uncertainty.unwrap_or(f64::INFINITY);
        tv.value.abs() > (2.0 * u).max(TURNED * set_wrongly_s.abs())
    };
    let position_s = match (raw_s, by_reference_s.found().filter(seen)) {
        (Some(raw), Some(tv)) => Some(Estimate {
            value: raw.value + tv.value,
            standard_uncertainty: raw.standard_uncertainty.zip(tv.standard_uncertainty).map(|(raw, tv)| raw.hypot(tv)),
        }),
        _ => settings.position_lateness_s.or(raw_s),
    };
    Late { position_s, velocity_s: by_reference_s.clone() }
}

/// The residual delay and the velocity's own delay, as far as they differ significantly from zero, s.
fn band_delays(residual: Option<Estimate>, velocity: &Finding<Estimate>) -> (f64, f64) {
    let seen =
        |e: &Estimate| if e.standard_uncertainty.is_some_and(|u| e.value.abs() > 2.0 * u) { e.value } else { 0.0 };
    (residual.as_ref().map_or(0.0, seen), velocity.found().map_or(0.0, seen))
}

/// Position late by `left_s` more than what is removed, velocity late by `velocity_s`.
fn band(track: &Positions, (left_s, velocity_s): (f64, f64), motion: &Result<Motion, String>) -> Finding<HelpfulBand> {
    let stand_in = StandIn::of(track);
    let model = match &stand_in {
        StandIn::Pade(form) => DelayModel::Pade(form),
        StandIn::Exact => DelayModel::Exact,
        StandIn::Nothing => return Finding::CannotTell("raw is what the others are compared with".to_owned()),
        StandIn::Adaptive => {
            return Finding::CannotTell("it weights position and velocity by their noise: no fixed band".to_owned());
        }
    };
    let compensator_s = track.delay.seconds();
    let delays = Delays { position_s: compensator_s + left_s, velocity_s, compensator_s };
    let Some(band) = ValidityBand::of(model, delays, HELP) else {
        return Finding::CannotTell("the position is not late".to_owned());
    };
    let share = motion.as_ref().ok().and_then(|m| band.share_of_spectra(&m.spectra));
    Finding::Found(HelpfulBand {
        factor: band.factor,
        helps_below_hz: band.helps_below_hz,
        halves_below_hz: band.halves_below_hz,
        worse_above_hz: band.worse_above_hz,
        delays_s: [delays.position_s, delays.velocity_s, delays.compensator_s],
        motion_share: share.map(|s| [s.helped, s.between, s.worse]),
    })
}

/// Raw less a track at the valid rows, rms north and east.
fn differences(raw: &Positions, track: &Positions, rows: &Rows) -> [Estimate; 2] {
    let shown = rows.valid().filter(|&row| track.has_own_output(row));
    let square = |r: usize, axis: usize| (raw.axes[axis][r] - track.axes[axis][r]).powi(2);
    let blocks = Blocks::of(shown.clone().count(), shown.map(|r| [square(r, 0), square(r, 1), 1.0]));
    let nothing = Estimate { value: 0.0, standard_uncertainty: None };
    AXES.map(|axis| blocks.size(|sums| root_mean([sums[axis], sums[2]])).unwrap_or(nothing))
}
