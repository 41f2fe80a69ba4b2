//! The fitted model of one component on its rows.

use super::block::{Lateness, Normal};
use super::descent::Alignment;
use crate::reference::Reference;

/// Model values of one component, not whitened.
pub(crate) struct Shape {
    /// The reference.
    pub(crate) values: Vec<f64>,
    /// The shared columns.
    pub(crate) shared: Vec<Vec<f64>>,
    /// Gain times reference, and the shared columns times their coefficients.
    pub(crate) modelled: Vec<f64>,
    /// Its time derivative.
    pub(crate) slope: Vec<f64>,
}

impl Shape {
    pub(crate) fn of(alignment: &Alignment, c: usize, at: &Lateness, normal: &Normal) -> Shape {
        Shape::with(alignment, c, at, normal.projections[c].gain, &normal.shared)
    }

    pub(crate) fn with(alignment: &Alignment, c: usize, at: &Lateness, gain: f64, coefficients: &[f64]) -> Shape {
        let (block, m) = (&alignment.blocks[c], &alignment.measurements[c]);
        let (first, last) = m.reference.span();
        let instants: Vec<f64> =
            block.t.iter().map(|t| at.true_instant(*t, alignment.middle_s).clamp(first, last)).collect();
        let filled = |reference: &dyn Reference| {
            let (mut values, mut rates) = (vec![0.0; instants.len()], vec![0.0; instants.len()]);
            reference.fill(&instants, &mut values, &mut rates);
            (values, rates)
        };
        let (values, rates) = filled(m.reference);
        let mut modelled: Vec<f64> = values.iter().map(|x| gain * x).collect();
        let mut slope: Vec<f64> = rates.iter().map(|x| gain * x).collect();
        let mut shared = vec![];
        for (column, coefficient) in m.reference.shared().iter().zip(coefficients) {
            let (values, rates) = filled(column.reference);
            modelled.iter_mut().zip(&values).for_each(|(m, x)| *m += coefficient * x);
            slope.iter_mut().zip(&rates).for_each(|(m, x)| *m += coefficient * x);
            shared.push(values);
        }
        Shape { values, shared, modelled, slope }
    }
}
