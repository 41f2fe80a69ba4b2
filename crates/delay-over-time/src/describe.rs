//! Describes a varying delay by steps and bends, on bins (S6).

use crate::bins::Flexible;
use nalgebra::{DMatrix, DVector};
use record::DelayTermKind;

/// Price of a term: this plus twice the logarithm of the number of bins.
const PRICE: f64 = 8.0;
/// Additional price of a bend when descriptions are compared.
const BEND_PRICE: f64 = 6.0;
/// Bends are kept if they score better by this much.
const BENDS_MUST_WIN: f64 = 20.0;
const MOST_TERMS: usize = 24;
/// Least share of the joint gain that a term must contribute. If noise is small, model errors cost many times the
/// price.
const LEAST_SHARE: f64 = 0.001;
/// Number of best single terms from which pairs are tried.
const PAIR_STARTS: usize = 6;

/// A step or a bend at an instant; size in s or s/s.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Term {
    pub(crate) kind: DelayTermKind,
    pub(crate) at_s: f64,
    pub(crate) size: f64,
}

impl Term {
    /// Contribution of a unit of this term at `t`.
    pub(crate) fn column(&self, t: f64) -> f64 {
        match self.kind {
            DelayTermKind::Step => f64::from(t >= self.at_s),
            DelayTermKind::Bend => (t - self.at_s).max(0.0),
        }
    }
}

/// Level and terms.
#[derive(Debug, Clone)]
pub(crate) struct Description {
    pub(crate) level_s: f64,
    pub(crate) terms: Vec<Term>,
}

impl Description {
    pub(crate) fn at(&self, t: f64) -> f64 {
        self.level_s + self.terms.iter().map(|x| x.size * x.column(t)).sum::<f64>()
    }
}

/// All columns with their products: constant, steps at the edges of bins, bends at their middles.
struct Dictionary {
    kinds: Vec<(DelayTermKind, f64)>,
    products: DMatrix<f64>,
    with_data: DVector<f64>,
    price: f64,
}

/// The cheapest description. If it has bends, the best one with steps alone follows. `inflation` is the inflation of
/// variances by autocorrelation.
pub(crate) fn describe(fit: &Flexible, inflation: f64) -> Vec<Description> {
    let dictionary = Dictionary::of(&fit.a, &fit.z, &fit.middle_s, inflation);
    let steps = greedy(&dictionary.steps_only());
    let both = greedy(&dictionary);
    if both.0 - steps.0 > BENDS_MUST_WIN { vec![both.1, steps.1] } else { vec![steps.1] }
}

impl Dictionary {
    fn of(a: &DMatrix<f64>, z: &DVector<f64>, m: &[f64], inflation: f64) -> Dictionary {
        let bins = m.len();
        let mut kinds = vec![(DelayTermKind::Step, f64::MIN)];
        kinds.extend(m.windows(2).map(|w| (DelayTermKind::Step, 0.5 * (w[0] + w[1]))));
        kinds.extend(m[..bins.saturating_sub(1)].iter().map(|m| (DelayTermKind::Bend, *m)));
        let mut half = DMatrix::zeros(kinds.len(), bins);
        for (column, mut out) in a.column_iter().zip(half.column_iter_mut()) {
            out.copy_from_slice(&products_with(column.iter(), m));
        }
        let mut products = DMatrix::zeros(kinds.len(), kinds.len());
        for (row, mut out) in half.row_iter().zip(products.column_iter_mut()) {
            out.copy_from_slice(&products_with(row.iter(), m));
        }
        let with_data = DVector::from_vec(products_with(z.iter(), m)) / inflation;
        Dictionary { kinds, products: products / inflation, with_data, price: PRICE + 2.0 * (bins as f64).ln() }
    }

    fn steps_only(&self) -> Dictionary {
        let n = self.kinds.iter().filter(|k| k.0 == DelayTermKind::Step).count();
        Dictionary {
            kinds: self.kinds[..n].to_vec(),
            products: self.products.view((0, 0), (n, n)).into_owned(),
            with_data: self.with_data.rows(0, n).into_owned(),
            price: self.price,
        }
    }

    /// Gain of each further column given `chosen`, the coefficients of the chosen ones, and their joint gain.
    fn gains(&self, chosen: &[usize]) -> Option<(Vec<f64>, DVector<f64>, f64)> {
        let n = chosen.len();
        let mut own = DMatrix::from_fn(n, n, |i, j| self.products[(chosen[i], chosen[j])]);
        let scale: Vec<f64> = (0..n).map(|i| own[(i, i)].max(1e-300).sqrt().recip()).collect();
        for i in 0..n {
            for j in 0..n {
                own[(i, j)] *= scale[i] * scale[j];
            }
            own[(i, i)] += 1e-10;
        }
        let factor = own.cholesky()?;
        let right = DVector::from_fn(n, |i, _| self.with_data[chosen[i]] * scale[i]);
        let solved = factor.solve(&right);
        let gained = right.dot(&solved);
        let lower = factor.l_dirty();
        // Forward substitution, all columns at once: the rows of `within` are what each chosen column adds to the span.
        let mut within: Vec<Vec<f64>> = Vec::with_capacity(n);
        let mut left: Vec<f64> = self.with_data.iter().copied().collect();
        let mut free: Vec<f64> = self.products.diagonal().iter().copied().collect();
        for (i, &c) in chosen.iter().enumerate() {
            // The products are symmetric, so a column is also a row.
            let mut row: Vec<f64> = self.products.column(c).iter().map(|p| p * scale[i]).collect();
            for (k, before) in within.iter().enumerate() {
                let share = lower[(i, k)];
                row.iter_mut().zip(before).for_each(|(r, b)| *r -= share * b);
            }
            let pivot = lower[(i, i)].recip();
            for ((r, f), (l, p)) in
                row.iter_mut().zip(&mut free).zip(left.iter_mut().zip(self.products.column(c).iter()))
            {
                *r *= pivot;
                *f -= *r * *r;
                *l -= p * scale[i] * solved[i];
            }
            within.push(row);
        }
        let gain = |j: usize| {
            let known = free[j] > 1e-3 * self.products[(j, j)] + 1e-9;
            if known { left[j] * left[j] / free[j] } else { 0.0 }
        };
        let gains = (0..self.kinds.len()).map(gain).collect();
        let values = DVector::from_fn(n, |i, _| solved[i] * scale[i]);
        Some((gains, values, gained))
    }

    fn best(&self, chosen: &[usize]) -> Option<(usize, f64)> {
        let gains = self.gains(chosen)?.0;
        gains.into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Two further columns that are worth their price together.
    fn best_pair(&self, chosen: &[usize]) -> Option<[usize; 2]> {
        let gains = self.gains(chosen)?.0;
        let mut order: Vec<usize> = (0..gains.len()).collect();
        order.sort_by(|a, b| gains[*b].total_cmp(&gains[*a]));
        let pair = |a: &usize| {
            let (b, second) = self.best(&[chosen, &[*a]].concat())?;
            Some(([*a, b], gains[*a] + second))
        };
        let best = order.iter().take(PAIR_STARTS).filter_map(pair).max_by(|a, b| a.1.total_cmp(&b.1))?;
        (best.1 > 2.0 * self.price_among(chosen)).then_some(best.0)
    }

    /// Moves every term to the place of its largest gain.
    fn move_terms(&self, chosen: &mut [usize]) {
        for i in 1..chosen.len() {
            let rest = [&chosen[..i], &chosen[i + 1..]].concat();
            let Some((gains, ..)) = self.gains(&rest) else { continue };
            let best = gains.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            if let Some((b, gain)) = best
                && !rest.contains(&b)
                && *gain > gains[chosen[i]] + 1e-6
            {
                chosen[i] = b;
            }
        }
    }

    /// Least gain of a term among these.
    fn price_among(&self, chosen: &[usize]) -> f64 {
        let gained = |columns: &[usize]| self.gains(columns).map_or(0.0, |g| g.2);
        self.price.max(LEAST_SHARE * (gained(chosen) - gained(&[0])))
    }

    /// Drops terms that are no longer worth their price.
    fn drop_terms(&self, chosen: &mut Vec<usize>) {
        let price = self.price_among(chosen);
        while chosen.len() > 2 {
            let loss = |i: usize| {
                let rest = [&chosen[..i], &chosen[i + 1..]].concat();
                self.gains(&rest).map_or(f64::MAX, |g| g.0[chosen[i]])
            };
            let least = (1..chosen.len()).map(|i| (i, loss(i))).min_by(|a, b| a.1.total_cmp(&b.1));
            match least {
                Some((i, l)) if l < price => chosen.remove(i),
                _ => return,
            };
        }
    }
}

/// Products of a row of values on the bins with all columns. For a step it is the sum from its bin on, for a bend the
/// sum of the later steps times their spacing.
fn products_with<'a>(
    values: impl DoubleEndedIterator<Item = &'a f64> + ExactSizeIterator,
    middle_s: &[f64],
) -> Vec<f64> {
    let bins = middle_s.len();
    let mut out = vec![0.0; (2 * bins).saturating_sub(1)];
    let (steps, bends) = out.split_at_mut(bins);
    let (mut step, mut bend) = (0.0, 0.0);
    for (k, value) in values.enumerate().rev() {
        step += value;
        steps[k] = step;
        if k > 0 {
            bend += step * (middle_s[k] - middle_s[k - 1]);
            bends[k - 1] = bend;
        }
    }
    out
}

/// Score and description. The constant is always the first column.
fn greedy(d: &Dictionary) -> (f64, Description) {
    let mut chosen = vec![0];
    for _ in 0..2 * MOST_TERMS {
        if chosen.len() > MOST_TERMS {
            break;
        }
        let Some((best, gain)) = d.best(&chosen) else { break };
        let before = chosen.clone();
        if gain >= d.price_among(&chosen) {
            chosen.push(best);
        } else if let Some(pair) = d.best_pair(&chosen) {
            chosen.extend(pair);
        } else {
            break;
        }
        d.move_terms(&mut chosen);
        d.drop_terms(&mut chosen);
        if chosen == before {
            break;
        }
    }
    let alone = d.gains(&[0]).map_or(0.0, |g| g.2);
    let Some((_, values, gained)) = d.gains(&chosen) else {
        return (0.0, Description { level_s: 0.0, terms: vec![] });
    };
    let bends = chosen.iter().filter(|c| d.kinds[**c].0 == DelayTermKind::Bend).count() as f64;
    let terms = chosen.len() as f64 - 1.0;
    let score = if terms > 0.0 { gained - alone - d.price * terms - BEND_PRICE * bends } else { 0.0 };
    let term = |(c, v): (&usize, &f64)| Term { kind: d.kinds[*c].0, at_s: d.kinds[*c].1, size: *v };
    let mut list: Vec<Term> = chosen.iter().zip(values.iter()).skip(1).map(term).collect();
    list.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    (score, Description { level_s: values[0], terms: list })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::Random;

    /// Products and gains against their definitions, on 6 bins of unequal spacing.
    #[test]
    fn sums_over_bins_are_the_products_of_the_columns() {
        let middle_s = vec![1.0, 3.0, 5.5, 7.0, 9.0, 12.0];
        let a = DMatrix::from_fn(6, 6, |i, j| (-(i.abs_diff(j) as f64)).exp() * (4.0 + (i + j) as f64));
        let z = DVector::from_fn(6, |i, _| (1.7 * i as f64).sin());
        let d = Dictionary::of(&a, &z, &middle_s, 2.0);
        assert_eq!(d.kinds.len(), 11);
        let column = |j: usize| {
            let term = Term { kind: d.kinds[j].0, at_s: d.kinds[j].1, size: 0.0 };
            DVector::from_fn(6, |i, _| term.column(middle_s[i]))
        };
        for i in 0..11 {
            assert!((d.with_data[i] - column(i).dot(&z) / 2.0).abs() < 1e-12);
            for j in 0..11 {
                assert!((d.products[(i, j)] - column(i).dot(&(&a * column(j))) / 2.0).abs() < 1e-9);
            }
        }
        // The gain of a column is the decrease of the squares when it joins.
        let (gains, _, gained) = d.gains(&[0, 3]).unwrap();
        for j in [1, 4, 7] {
            let more = d.gains(&[0, 3, j]).unwrap().2;
            assert!((gains[j] - (more - gained)).abs() < 1e-6 * more, "{j}: {} {}", gains[j], more - gained);
        }
        assert_eq!(d.steps_only().kinds.len(), 6);
    }

    /// Bins of 2 s with independent standard uncertainties `u`.
    fn on_bins(delay_s: &[f64], u: f64) -> Flexible {
        let n = delay_s.len();
        let middle_s: Vec<f64> = (0..n).map(|k| 1.0 + 2.0 * k as f64).collect();
        let a = DMatrix::from_diagonal(&DVector::from_element(n, 1.0 / (u * u)));
        let z = DVector::from_iterator(n, delay_s.iter().map(|d| d / (u * u)));
        Flexible::example(middle_s, a, z)
    }

    fn described(delay: impl Fn(f64) -> f64, u: f64) -> Vec<Description> {
        let mut random = Random::new(4);
        let delay_s: Vec<f64> = (0..60).map(|k| delay(1.0 + 2.0 * f64::from(k)) + 0.3 * u * random.normal()).collect();
        describe(&on_bins(&delay_s, u), 1.0)
    }

    fn after(t: f64, at: f64) -> f64 {
        f64::from(u8::from(t >= at))
    }

    /// Steps at edges of bins, with various uncertainties: each is found at its place, and no others.
    #[test]
    fn steps_are_found_at_their_edges_with_their_sizes() {
        let cases: [&[(f64, f64)]; 5] = [
            &[],
            &[(40.0, 0.3)],
            &[(40.0, 0.3), (60.0, -0.3)],
            &[(30.0, 0.2), (34.0, -0.2)],
            &[(20.0, 0.15), (50.0, 0.2), (80.0, -0.4), (110.0, 0.1)],
        ];
        for steps in cases {
            let delay = |t: f64| 0.2 + steps.iter().map(|(at, size)| size * after(t, *at)).sum::<f64>();
            let found = described(delay, 0.01).pop().unwrap();
            let edges: Vec<f64> = found.terms.iter().map(|t| t.at_s).collect();
            assert_eq!(edges, steps.iter().map(|s| s.0).collect::<Vec<f64>>(), "{found:?}");
            for (term, (_, size)) in found.terms.iter().zip(steps) {
                assert!(term.kind == DelayTermKind::Step && (term.size - size).abs() < 0.01, "{term:?}");
            }
            assert!((found.level_s - 0.2).abs() < 0.01);
            for k in 0..60 {
                let t = 1.0 + 2.0 * f64::from(k);
                assert!((found.at(t) - delay(t)).abs() < 0.015, "{t}: {found:?}");
            }
        }
    }

    /// A delay that grows, stays and falls back: bends need fewer terms than steps.
    #[test]
    fn a_growth_and_a_fall_are_bends() {
        let delay = |t: f64| 0.1 + 0.02 * (t - 31.0).max(0.0) - 0.02 * (t - 71.0).max(0.0);
        let all = described(delay, 0.01);
        assert_eq!(all.len(), 2, "with bends, and of steps alone");
        let bends = &all[0];
        assert!(bends.terms.iter().all(|t| t.kind == DelayTermKind::Bend), "{bends:?}");
        // A bend is in the middle of its bin or of the next.
        for (term, (at_s, size)) in bends.terms.iter().zip([(31.0, 0.02), (71.0, -0.02)]) {
            assert!((term.at_s - at_s).abs() <= 2.0 && (term.size - size).abs() < 2e-3, "{bends:?}");
        }
        assert_eq!(bends.terms.len(), 2);
        assert!((0..60).all(|k| (bends.at(1.0 + 2.0 * f64::from(k)) - delay(1.0 + 2.0 * f64::from(k))).abs() < 0.03));
        assert!(all[1].terms.iter().all(|t| t.kind == DelayTermKind::Step) && all[1].terms.len() > 3);
    }

    /// A step among n bins gains s² / u² · k (n − k) / n, and must gain 8 + 2 ln n.
    #[test]
    fn a_step_must_pay_its_price() {
        let (n, k, u) = (60.0, 25.0, 0.01);
        let price: f64 = 8.0 + 2.0 * f64::ln(n);
        for (share, found, inflation) in [(1.05, 1, 1.0), (0.95, 0, 1.0), (1.05, 0, 1.2), (1.25, 1, 1.2)] {
            let size = u * (share * price * n / (k * (n - k))).sqrt();
            let delay_s: Vec<f64> = (0..60).map(|b| if b < 25 { 0.2 } else { 0.2 + size }).collect();
            let all = describe(&on_bins(&delay_s, u), inflation);
            assert_eq!(all.iter().map(|d| d.terms.len()).collect::<Vec<_>>(), [found], "{share} {inflation}");
        }
    }

    /// The dictionary of a step at bin 30 of 60 and an excursion from bin 40 to bin 45.
    fn dictionary() -> Dictionary {
        let delay_s: Vec<f64> = (0..60)
            .map(|b| 0.2 + 0.3 * f64::from(u8::from(b >= 30)) + 0.2 * f64::from(u8::from((40..45).contains(&b))))
            .collect();
        let f = on_bins(&delay_s, 0.01);
        Dictionary::of(&f.a, &f.z, &f.middle_s, 1.0).steps_only()
    }

    #[test]
    fn terms_move_to_their_largest_gain_and_never_share_a_place() {
        let d = dictionary();
        let mut chosen = [0, 27, 41, 43];
        for _ in 0..6 {
            d.move_terms(&mut chosen);
        }
        chosen.sort_unstable();
        assert_eq!(chosen, [0, 30, 40, 45]);
        d.move_terms(&mut chosen);
        assert_eq!(chosen, [0, 30, 40, 45], "the best stay");
    }

    #[test]
    fn useless_terms_are_dropped_and_pairs_worth_their_price_found() {
        let d = dictionary();
        let mut chosen = vec![0, 30, 12, 40, 45, 55];
        d.drop_terms(&mut chosen);
        assert_eq!(chosen, [0, 30, 40, 45]);
        let mut pair = d.best_pair(&[0, 30]).unwrap();
        pair.sort_unstable();
        assert_eq!(pair, [40, 45]);
        assert!(d.best_pair(&[0, 30, 40, 45]).is_none());
        // The price is 8 + 2 ln 60, or a thousandth of the joint gain.
        let price = 8.0 + 2.0 * 60f64.ln();
        assert!((d.price_among(&[0]) - price).abs() < 1e-9);
        let gained = |c: &[usize]| d.gains(c).unwrap().2;
        let all = [0, 30, 40, 45];
        assert!((d.price_among(&all) - (1e-3 * (gained(&all) - gained(&[0]))).max(price)).abs() < 1e-9);
    }
}
