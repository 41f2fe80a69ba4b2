//! Angular rates: infers the unit and the axes from the rotation of an attitude.

use super::body_attitude::Rotation;
use super::{Body, CONFIRMS, TimedTriple, unit};
use crate::windows::Trace;
use flight::Unit;

/// Rotations are compared over windows of this length, s.
const WINDOW_S: f64 = 0.3;
/// The integral is unknown across longer holes, s.
const HOLE_S: f64 = 2.5;
/// Fewer windows are not evaluated.
const FEWEST: usize = 20;
/// An attitude that rotates more slowly is not evaluated, rad/s.
const SLOWEST: f64 = 0.02;
/// Delays of the attitude that are tried, s.
const DELAYS_S: [f64; 9] = [-0.2, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8];
/// A unit is right if the scale is this near, as a logarithm: gyroscopes are noisy.
const NEAR: f64 = 0.3;
/// No gyroscope measures more, rad/s.
const FASTEST: f64 = 100.0;

/// The unit and the frame of three rates.
pub(super) fn decide(of: &TimedTriple<'_>, rotation: Option<&Rotation>) -> Result<Body, String> {
    let stated = of.stated()?;
    let (deg, rad) = (unit("deg/s")?, unit("rad/s")?);
    let body = |unit, frame, why| {
        let group = of.group.clone();
        Ok(Body { group, quantity: "angular-rate", roles: ["x", "y", "z"], unit, frame, why })
    };
    let Some((compared, rotation)) = rotation.and_then(|rotation| Some((compare(&of.trace(rad), rotation)?, rotation)))
    else {
        let (unit, why) = match stated {
            Some(stated) => (stated, format!("the table states {stated}")),
            None if of.largest() > FASTEST => (deg, "their range is that of deg/s".to_owned()),
            None => return Err("they may be in deg/s or rad/s; nothing shows which".to_owned()),
        };
        return body(unit, "frd", vec![why, UNCONFIRMED.to_owned()]);
    };
    if compared.agreement < CONFIRMS {
        let agreement = compared.agreement;
        return Err(format!(
            "they do not fit the changes of {} and its neighbours (agreement {agreement:.2})",
            rotation.path
        ));
    }
    let unit = unit_by_scale(compared.scale, stated, [deg, rad])?;
    let why = format!(
        "{} windows of {WINDOW_S} s: they agree with the turns of {} to {:.3}, and are {:.3} times as fast in rad/s ({unit} would be \
         {:.3})",
        compared.windows,
        rotation.path,
        compared.agreement,
        compared.scale,
        1.0 / unit.to_si(1.0)
    );
    body(unit, compared.frame, vec![why])
}

/// The stated unit, or the first of the usual ones, in which the rates match the rotation of the attitude.
fn unit_by_scale(scale: f64, stated: Option<Unit>, usual: [Unit; 2]) -> Result<Unit, String> {
    let tried = stated.map_or(usual.to_vec(), |stated| vec![stated]);
    tried.into_iter().find(|unit| (scale * unit.to_si(1.0)).ln().abs() <= NEAR).ok_or_else(|| {
        let stated = stated.map_or(String::new(), |stated| format!(", which is not {stated} as stated"));
        format!("they are {scale:.3} times as fast as the attitude turns in rad/s{stated}")
    })
}

const UNCONFIRMED: &str =
    "there is no turning attitude to compare them with: forward, right and down are assumed from their names";

struct Compared {
    agreement: f64,
    /// Rates over rotations.
    scale: f64,
    frame: &'static str,
    windows: usize,
}

/// Compares rates with rotations, for the delay and the frame that fit best.
fn compare(rates: &Trace<3>, rotation: &Rotation) -> Option<Compared> {
    let all = DELAYS_S.iter().flat_map(|late_s| {
        let pairs = windows(rates, rotation, *late_s);
        [("frd", [1.0, 1.0, 1.0]), ("flu", [1.0, -1.0, -1.0])].map(|(frame, signs)| of_frame(&pairs, frame, signs))
    });
    all.flatten().max_by(|a, b| a.agreement.total_cmp(&b.agreement))
}

fn of_frame(pairs: &[([f64; 3], [f64; 3])], frame: &'static str, signs: [f64; 3]) -> Option<Compared> {
    let [mut cross, mut measured, mut turned] = [0.0; 3];
    for (rate, turn) in pairs {
        for ((rate, turn), sign) in rate.iter().zip(turn).zip(signs) {
            cross += sign * rate * turn;
            measured += rate * rate;
            turned += turn * turn;
        }
    }
    let enough = pairs.len() >= FEWEST && (turned / pairs.len() as f64).sqrt() >= SLOWEST && measured > 0.0;
    enough.then(|| Compared {
        agreement: cross / (measured * turned).sqrt(),
        scale: (measured / turned).sqrt(),
        frame,
        windows: pairs.len(),
    })
}

/// Mean rates of windows and how fast a late attitude rotated in them, about forward, right and down.
fn windows(rates: &Trace<3>, rotation: &Rotation, late_s: f64) -> Vec<([f64; 3], [f64; 3])> {
    let integral = rates.clone().integral(HOLE_S);
    let attitude = &rotation.quaternions;
    let mut pairs = vec![];
    let mut begin = 0;
    for (end, t) in attitude.times_s.iter().enumerate() {
        let Some(from) = attitude.times_s.get(begin).copied().filter(|from| t - from >= WINDOW_S - 1e-9) else {
            continue;
        };
        let turn =
            attitude.values.get(begin).zip(attitude.values.get(end)).map(|(a, b)| flight::rotation_vector(*a, *b));
        let measured = integral.of(from - late_s).zip(integral.of(t - late_s)).filter(|((_, a), (_, b))| a == b);
        if let (Some(turn), Some(((a, _), (b, _))), true) = (turn, measured, t - from <= HOLE_S) {
            let length_s = t - from;
            let [ax, ay, az] = a;
            let [bx, by, bz] = b;
            let rate = [bx - ax, by - ay, bz - az].map(|angle| angle / length_s);
            pairs.push((rate, turn.map(|angle| angle / length_s)));
        }
        begin = end;
    }
    pairs
}
