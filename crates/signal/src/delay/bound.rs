//! The lower bound on the uncertainty of a delay.

use super::block::Block;
use super::block::Lateness;
use super::descent::Alignment;
use super::uncertainty::information_of_delay;
use super::{Gain, Measurement, Sign};
use crate::reference::Reference;
use crate::whiten::NoiseModel;

/// Cramér–Rao bound of the delay, s, for samples at the timestamps `t` (s, rising) of a signal `gain · reference` that
/// is `delay_s` late, where gain and offset (and drift) are also estimated; `[(JᵀC⁻¹J)⁻¹]₁₁^½` (design note 3.1).
/// `None` if the reference does not move or too few timestamps lie within it.
#[must_use]
pub fn delay_crlb(
    t: &[f64],
    reference: &dyn Reference,
    delay_s: f64,
    gain: f64,
    noise: &NoiseModel,
    drift: bool,
) -> Option<f64> {
    let (first, last) = reference.span();
    let rows: Vec<usize> = (0..t.len()).filter(|&k| t[k] - delay_s >= first && t[k] - delay_s <= last).collect();
    let y = vec![0.0; t.len()];
    let measurements = [Measurement { t, y: &y, reference, gain: Gain::Free { sign: Sign::Any }, drift }];
    let block = Block::new(&measurements[0], rows, noise, None, 1);
    let middle_s = super::block::middle(&block.t);
    let alignment = Alignment { measurements: &measurements, blocks: vec![block], middle_s };
    information_of_delay(&alignment, &Lateness { delay_s, skew: 0.0 }, gain)
}
