//! The counting direction of the encoder.

use super::clue::Clue;
use super::force::ForceFit;
use crate::rig::Rig;
use flight::{Code, Notices, Quantity, with_minus};
use record::ENCODER_SIGN;

/// A coefficient must be this many standard uncertainties away from zero to have a sign.
const CLEAR: f64 = 5.0;
/// Largest plausible accelerometer bias, m/s².
const MOST_BIAS: f64 = 3.0;
/// Factor by which the wrong sign must increase the residual.
const CLEAR_RATIO: f64 = 1.5;

/// +1 or −1, and its source. The rig file takes precedence; a channel that contradicts it is reported.
pub(super) fn sign(clues: &[Clue], rig: &Rig, notices: &mut Notices) -> (f64, String) {
    let seen = of_quantity(clues, Quantity::AngularRate, of_rate)
        .or_else(|| of_quantity(clues, Quantity::SpecificForce, of_force))
        .or_else(|| of_quantity(clues, Quantity::Attitude, of_attitude));
    if let Some(stated) = rig.encoder.sign {
        if let Some((found, how)) = seen.filter(|(s, _)| *s != stated) {
            let [said, shown] = [stated, found].map(|sign| with_minus(&sign.to_string()));
            let text = format!(
                "the rig file says encoder.sign = {said}, but the record shows {shown}: {how}. The rig file is used"
            );
            notices.push(Code::RigContradicted, ENCODER_SIGN, 1, text);
        }
        return (stated, "rig file".to_owned());
    }
    seen.map(|(sign, how)| (sign, format!("fitted: {how}"))).unwrap_or_else(|| {
        let text = "no gyro, accelerometer or attitude shows which way the encoder counts: +1 is assumed";
        notices.push(Code::Assumption, "", 1, text);
        (1.0, "assumed: no gyro, accelerometer or attitude shows it".to_owned())
    })
}

type Found = Option<(f64, String)>;

fn of_quantity(clues: &[Clue], quantity: Quantity, by: impl Fn(&Clue) -> Found) -> Found {
    clues.iter().filter(|c| c.quantity == quantity).find_map(by)
}

fn of_rate(clue: &Clue) -> Found {
    slope(clue, 1).map(|(sign, z)| (sign, moves(&format!("{} y turns", clue.name), sign, z)))
}

fn of_attitude(clue: &Clue) -> Found {
    slope(clue, 0).map(|(sign, z)| (sign, moves(&format!("{} swings", clue.name), sign, z)))
}

/// The direction of a movement relative to the counts of the encoder.
fn moves(what: &str, sign: f64, z: f64) -> String {
    let way = if sign < 0.0 { "against" } else { "with" };
    format!("{what} {way} the encoder ({z:.0} standard uncertainties)")
}

/// Sign of the coefficient on the angle or rate, and its significance.
fn slope(clue: &Clue, component: usize) -> Option<(f64, f64)> {
    let fit = clue.regression(component)?;
    let z = fit.coefficients.get(1)?.abs() / fit.standard_uncertainty(1);
    (z > CLEAR).then(|| (fit.coefficients[1].signum(), z))
}

fn of_force(clue: &Clue) -> Found {
    let [plus, minus] = clue.force.as_ref()?;
    let sign_of = |is_plus: bool| if is_plus { 1.0 } else { -1.0 };
    let bias = |fit: &ForceFit| fit.coefficients[4].abs().max(fit.coefficients[5].abs());
    let possible = (bias(plus) < MOST_BIAS, bias(minus) < MOST_BIAS);
    if possible.0 != possible.1 {
        let other = bias(if possible.0 { minus } else { plus });
        let how = format!("{} fits with this sign (the other would need a bias of {other:.0} m/s²)", clue.name);
        return Some((sign_of(possible.0), how));
    }
    let ratio = (minus.rest / plus.rest).max(plus.rest / minus.rest);
    let how = format!("{} fits with this sign ({ratio:.3} times the residual with the other)", clue.name);
    (ratio > CLEAR_RATIO).then(|| (sign_of(plus.rest <= minus.rest), how))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_negative_sign_turns_against_the_encoder() {
        assert_eq!(
            moves("angular-rate.imu y turns", 1.0, 80.4),
            "angular-rate.imu y turns with the encoder (80 standard uncertainties)"
        );
        assert_eq!(
            moves("attitude.ins swings", -1.0, 9.0),
            "attitude.ins swings against the encoder (9 standard uncertainties)"
        );
    }
}
