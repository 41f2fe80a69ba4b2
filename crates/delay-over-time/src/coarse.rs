//! Coarse map of the delay (S1): the cost of each delay for each ten-second stretch, and the cheapest path through it.

use crate::motion::{Motion, usual_interval};

/// Step between the delays that are tried, s.
pub(crate) const STEP_S: f64 = 0.1;
const BLOCK_S: f64 = 2.0;
/// Blocks of a window on each side of its middle.
const HALF_WINDOW: usize = 2;
/// Maximum number of fixes per second, and in all.
const RATE_HZ: f64 = 4.0;
const MOST_FIXES: usize = 16_000;
/// A window next to the middle one is used if its residual is smaller by this factor.
const CLEARLY: f64 = 0.7;
/// Cost of a change of the path per step of [`STEP_S`], and its maximum.
const CHANGE_COST: f64 = 1.0;
const JUMP_COST: f64 = 12.0;
/// Cost of a block above its own minimum is clipped here, so that a single bad block decides nothing.
const MOST_COST: f64 = 60.0;
/// Delays further apart than this are separate minima, s.
const APART_S: f64 = 0.5;
/// Least variance of a window, m²: a velocity error of 0.03 m/s drifts this much in ten seconds.
const LEAST_VARIANCE_M2: f64 = 1e-2;
/// A block is informative if its costs differ by more than this.
const INFORMATIVE: f64 = 2.0;
/// The search is widened if this share of the informative blocks is at its edge.
const EDGE_SHARE: f64 = 0.2;

/// Fixes of one stretch without reset: timestamps and positions.
pub(crate) struct Track<'a> {
    pub(crate) t: &'a [f64],
    pub(crate) y: &'a [[f64; 2]],
    /// Instants at which a new offset starts, rising.
    pub(crate) breaks: &'a [f64],
}

/// Result of the coarse map.
#[derive(Debug, Clone)]
pub(crate) struct CoarseMap {
    /// Middles of the blocks, s, and the delay of the path there, s.
    pub(crate) middle_s: Vec<f64>,
    pub(crate) path_s: Vec<f64>,
    /// Best constant delay, s.
    pub(crate) constant_s: f64,
    /// Best other delay, s, and its extra cost.
    pub(crate) runner_up_s: f64,
    pub(crate) runner_up_cost: f64,
    /// Whether the best is at the edge of the search.
    pub(crate) edge: bool,
    /// Rms share of the displacement within windows that the velocity does not explain along the path.
    pub(crate) unexplained_share: f64,
}

impl CoarseMap {
    /// Delay of the path at `t`, linear between the middles of blocks.
    pub(crate) fn path_at(&self, t: f64) -> f64 {
        interpolate(&self.middle_s, &self.path_s, t)
    }

    pub(crate) fn path_span_s(&self) -> f64 {
        let (low, high) = self.path_s.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
        (high - low).max(0.0)
    }
}

/// `y` at `q`: linear between the rising `x`, constant outside.
pub(crate) fn interpolate(x: &[f64], y: &[f64], q: f64) -> f64 {
    let k = x.partition_point(|x| *x <= q);
    match (k.checked_sub(1), y.get(k)) {
        (None, Some(first)) => *first,
        (Some(b), None) => y.get(b).copied().unwrap_or(0.0),
        (Some(b), Some(after)) => y[b] + (after - y[b]) * (q - x[b]) / (x[k] - x[b]),
        (None, None) => 0.0,
    }
}

/// Sums over the fixes of a block, one value per delay.
struct Blocks {
    middle_s: Vec<f64>,
    /// Number of the piece of each block.
    piece: Vec<usize>,
    count: Vec<f64>,
    /// For each block and delay: Σ residual north, east, and Σ squares of both.
    sums: Vec<[Vec<f64>; 3]>,
    /// For each block without the velocity: Σ north, Σ east, Σ squares.
    still: Vec<[f64; 3]>,
    interval_s: f64,
}

/// The map over delays from `lo` to `hi`; `None` if fewer than eight fixes are within the velocity's record.
pub(crate) fn coarse(track: &Track, motion: &Motion, [lo, hi]: [f64; 2]) -> Option<CoarseMap> {
    let delays = ((hi - lo) / STEP_S).round() as usize + 1;
    let blocks = sum_blocks(track, motion, lo, hi, delays)?;
    let (errors, spread) = window_errors(&blocks, delays);
    let costs = costs(&blocks, &errors);
    if costs.is_empty() {
        return None;
    }
    let path = cheapest_path(&costs);
    let total = (0..delays).map(|j| costs.iter().map(|c| c[j]).sum()).collect::<Vec<f64>>();
    let best = least(&total);
    let apart = (APART_S / STEP_S).round() as usize;
    let far = (0..delays).filter(|j| j.abs_diff(best) > apart).min_by(|a, b| total[*a].total_cmp(&total[*b]));
    let informative: Vec<usize> = (0..costs.len()).filter(|b| is_informative(&costs[*b])).collect();
    let at_edge = informative.iter().filter(|b| path[**b] <= 2 || path[**b] + 3 >= delays).count();
    let delay_at = |j: f64| lo + STEP_S * j;
    let unexplained: f64 = path.iter().zip(&errors).map(|(j, e)| e.0[*j]).sum();
    Some(CoarseMap {
        path_s: path.iter().map(|j| delay_at(*j as f64)).collect(),
        constant_s: delay_at(bottom(&total, best)),
        runner_up_s: far.map_or(delay_at(best as f64), |j| delay_at(j as f64)),
        runner_up_cost: far.map_or(f64::MAX, |j| total[j] - total[best]),
        edge: !informative.is_empty() && at_edge as f64 >= EDGE_SHARE * informative.len() as f64,
        unexplained_share: if spread > 0.0 { (unexplained / spread).max(0.0).sqrt() } else { 1.0 },
        middle_s: blocks.middle_s,
    })
}

fn is_informative(cost: &[f64]) -> bool {
    let high = cost.iter().copied().fold(f64::MIN, f64::max);
    let low = cost.iter().copied().fold(f64::MAX, f64::min);
    high - low > INFORMATIVE
}

fn least(values: &[f64]) -> usize {
    values.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(j, _)| j)
}

/// Minimum of the parabola through the best and its neighbours, in steps.
fn bottom(total: &[f64], best: usize) -> f64 {
    let (Some(&a), Some(&c)) = (best.checked_sub(1).and_then(|j| total.get(j)), total.get(best + 1)) else {
        return best as f64;
    };
    let curvature = a - 2.0 * total[best] + c;
    let shift = if curvature > 0.0 { 0.5 * (a - c) / curvature } else { 0.0 };
    best as f64 + shift.clamp(-0.5, 0.5)
}

fn sum_blocks(track: &Track, motion: &Motion, lo: f64, hi: f64, delays: usize) -> Option<Blocks> {
    let usual = usual_interval(track.t);
    let every = ((1.0 / (usual * RATE_HZ)).round() as usize).max(track.t.len().div_ceil(MOST_FIXES)).max(1);
    let (first, last) = motion.span();
    let rows: Vec<usize> =
        (0..track.t.len()).step_by(every).filter(|k| track.t[*k] - hi >= first && track.t[*k] - lo <= last).collect();
    let (&k0, &k1) = (rows.first()?, rows.last()?);
    if rows.len() < 8 {
        return None;
    }
    let start = track.t[k0] - hi - 2.0 * STEP_S;
    let table = reversed_table(motion, start, ((track.t[k1] - lo - start) / STEP_S) as usize + 3);
    let centre = track.y[k0];
    let mut blocks = Blocks {
        middle_s: vec![],
        piece: vec![],
        count: vec![],
        sums: vec![],
        still: vec![],
        interval_s: usual * every as f64,
    };
    let mut current = None;
    for &k in &rows {
        let t = track.t[k];
        let piece = track.breaks.partition_point(|b| *b <= t);
        let block = (((t - track.t[k0]) / BLOCK_S) as usize, piece);
        if current != Some(block) {
            current = Some(block);
            blocks.middle_s.push(track.t[k0] + BLOCK_S * (block.0 as f64 + 0.5));
            blocks.piece.push(piece);
            blocks.count.push(0.0);
            blocks.sums.push([vec![0.0; delays], vec![0.0; delays], vec![0.0; delays]]);
            blocks.still.push([0.0; 3]);
        }
        let y = [track.y[k][0] - centre[0], track.y[k][1] - centre[1]];
        add_fix(&mut blocks, &table, (t - lo - start) / STEP_S, y);
    }
    strictly_rising(&mut blocks.middle_s);
    Some(blocks)
}

/// Blocks cut by a reset share a middle, so the later ones are shifted slightly.
fn strictly_rising(middle_s: &mut [f64]) {
    for k in 1..middle_s.len() {
        if middle_s[k] <= middle_s[k - 1] {
            middle_s[k] = middle_s[k - 1] + 1e-3;
        }
    }
}

/// Positions on a grid of [`STEP_S`], last first, so that a rising delay runs forward through memory.
fn reversed_table(motion: &Motion, start: f64, length: usize) -> [Vec<f64>; 2] {
    let (first, last) = motion.span();
    let mut hint = 0;
    let mut table = [Vec::with_capacity(length), Vec::with_capacity(length)];
    for i in (0..length).rev() {
        let state = motion.at((start + STEP_S * i as f64).clamp(first, last), &mut hint);
        table[0].push(state.place[0]);
        table[1].push(state.place[1]);
    }
    table
}

/// Adds the residuals of one fix for all delays; `x` is its grid position at the first delay.
fn add_fix(blocks: &mut Blocks, table: &[Vec<f64>; 2], x: f64, y: [f64; 2]) {
    let (Some([north, east, squares]), Some(count), Some(still)) =
        (blocks.sums.last_mut(), blocks.count.last_mut(), blocks.still.last_mut())
    else {
        return;
    };
    *count += 1.0;
    *still = [still[0] + y[0], still[1] + y[1], still[2] + y[0] * y[0] + y[1] * y[1]];
    let below = x.floor();
    let share = x - below;
    // Grid index i is stored at length − 1 − i.
    let Some(from) = (table[0].len() - 1).checked_sub(below as usize).filter(|f| *f >= 1) else { return };
    let n = squares.len();
    let (Some(a_n), Some(b_n)) = (table[0].get(from..from + n), table[0].get(from - 1..from - 1 + n)) else { return };
    let (Some(a_e), Some(b_e)) = (table[1].get(from..from + n), table[1].get(from - 1..from - 1 + n)) else { return };
    let (north, east, squares) = (&mut north[..n], &mut east[..n], &mut squares[..n]);
    for j in 0..n {
        let r_n = y[0] - a_n[j] - share * (b_n[j] - a_n[j]);
        let r_e = y[1] - a_e[j] - share * (b_e[j] - a_e[j]);
        north[j] += r_n;
        east[j] += r_e;
        squares[j] += r_n * r_n + r_e * r_e;
    }
}

/// For each block: the squares of its window about the window's own offset, one per delay, and the number of fixes.
/// Also the squares of all windows without a velocity.
fn window_errors(blocks: &Blocks, delays: usize) -> (Vec<(Vec<f64>, f64)>, f64) {
    let n = blocks.count.len();
    let mut spread = 0.0;
    let errors = (0..n)
        .map(|b| {
            let windows = [
                (b.saturating_sub(HALF_WINDOW), b + HALF_WINDOW),
                (b.saturating_sub(2 * HALF_WINDOW), b),
                (b, b + 2 * HALF_WINDOW),
            ];
            let mut best: Option<(Vec<f64>, f64, f64)> = None;
            for (from, to) in windows {
                let window = of_piece(blocks, b, from, to.min(n - 1));
                let (error, count) = window_error(blocks, &window, delays);
                if count < 4.0 {
                    continue;
                }
                let own = error.iter().copied().fold(f64::MAX, f64::min) / (2.0 * count - 3.0).max(1.0);
                let better = best.as_ref().is_none_or(|k| own < CLEARLY * k.2 && count >= CLEARLY * k.1);
                if better {
                    best = Some((error, count, own));
                }
            }
            let centred = of_piece(blocks, b, windows[0].0, windows[0].1.min(n - 1));
            spread += window_spread(blocks, &centred);
            best.map_or((vec![0.0; delays], 0.0), |k| (k.0, k.1))
        })
        .collect();
    (errors, spread)
}

/// Blocks of the window that belong to the piece of block `b`.
fn of_piece(blocks: &Blocks, b: usize, from: usize, to: usize) -> Vec<usize> {
    (from..=to).filter(|k| blocks.piece[*k] == blocks.piece[b]).collect()
}

fn window_error(blocks: &Blocks, window: &[usize], delays: usize) -> (Vec<f64>, f64) {
    let count: f64 = window.iter().map(|b| blocks.count[*b]).sum();
    let mut sums = [vec![0.0; delays], vec![0.0; delays], vec![0.0; delays]];
    for b in window {
        for (sum, part) in sums.iter_mut().zip(&blocks.sums[*b]) {
            sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
        }
    }
    let [north, east, mut squares] = sums;
    for ((q, n), e) in squares.iter_mut().zip(&north).zip(&east) {
        *q = (*q - (n * n + e * e) / count.max(1.0)).max(0.0);
    }
    (squares, count)
}

fn window_spread(blocks: &Blocks, window: &[usize]) -> f64 {
    let sum = |c: usize| window.iter().map(|b| blocks.still[*b][c]).sum::<f64>();
    let count: f64 = window.iter().map(|b| blocks.count[*b]).sum();
    if count < 4.0 { 0.0 } else { (sum(2) - (sum(0).powi(2) + sum(1).powi(2)) / count).max(0.0) }
}

/// A window is weighted by its own noise, but at most by the flight's median (B S1).
fn costs(blocks: &Blocks, errors: &[(Vec<f64>, f64)]) -> Vec<Vec<f64>> {
    let own = |e: &(Vec<f64>, f64)| {
        (e.1 > 0.0).then(|| e.0.iter().copied().fold(f64::MAX, f64::min) / (2.0 * e.1 - 3.0).max(1.0))
    };
    let mut sizes: Vec<f64> = errors.iter().filter_map(own).collect();
    let usual = signal::median_in_place(&mut sizes).unwrap_or(0.0) + LEAST_VARIANCE_M2;
    let share = (RATE_HZ * blocks.interval_s).min(1.0) * 0.5 / (2 * HALF_WINDOW + 1) as f64;
    let cost = |e: &(Vec<f64>, f64)| {
        let variance = own(e).unwrap_or(usual).max(usual);
        let mut cost: Vec<f64> = e.0.iter().map(|q| q / (2.0 * variance) * share).collect();
        let cap = cost.iter().copied().fold(f64::MAX, f64::min) + MOST_COST;
        cost.iter_mut().for_each(|c| *c = c.min(cap));
        cost
    };
    errors.iter().map(cost).collect()
}

/// Viterbi with a truncated linear cost of change, by distance transform: O(blocks × delays).
fn cheapest_path(costs: &[Vec<f64>]) -> Vec<usize> {
    let Some((first, rest)) = costs.split_first() else { return vec![] };
    let n = first.len();
    let mut cost = first.clone();
    let mut back: Vec<Vec<u32>> = Vec::with_capacity(rest.len());
    for block in rest {
        let cheapest = least(&cost);
        let jump = cost[cheapest] + JUMP_COST;
        let mut from: Vec<u32> = (0..n as u32).collect();
        for j in 1..n {
            if cost[j - 1] + CHANGE_COST < cost[j] {
                cost[j] = cost[j - 1] + CHANGE_COST;
                from[j] = from[j - 1];
            }
        }
        for j in (0..n.saturating_sub(1)).rev() {
            if cost[j + 1] + CHANGE_COST < cost[j] {
                cost[j] = cost[j + 1] + CHANGE_COST;
                from[j] = from[j + 1];
            }
        }
        for j in 0..n {
            if jump < cost[j] {
                cost[j] = jump;
                from[j] = cheapest as u32;
            }
            cost[j] += block[j];
        }
        back.push(from);
    }
    let mut path = vec![least(&cost)];
    for from in back.iter().rev() {
        let last = path.last().copied().unwrap_or(0);
        path.push(from[last] as usize);
    }
    path.reverse();
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::{Random, turning};

    #[test]
    fn the_cheapest_path_follows_a_jump_and_ignores_one_bad_block() {
        let valley = |at: usize| -> Vec<f64> { (0..50).map(|j| (3.0 * at.abs_diff(j) as f64).min(60.0)).collect() };
        let mut costs: Vec<Vec<f64>> = (0..20).map(|b| valley(if b < 10 { 5 } else { 40 })).collect();
        costs[4] = (0..50).map(|j: usize| if j == 30 { 0.0 } else { 8.0 }).collect();
        let path = cheapest_path(&costs);
        assert_eq!(path[..10], [5; 10]);
        assert_eq!(path[10..], [40; 10]);
    }

    #[test]
    fn a_delay_of_seven_seconds_is_found() {
        let tv: Vec<f64> = (0..2500).map(|k| -20.0 + 0.05 * f64::from(k)).collect();
        let heading = |t: f64| 0.9 * (0.5 * t + 2.0 * (0.11 * t).sin()).sin();
        let north: Vec<f64> = tv.iter().map(|t| 15.0 * heading(*t).cos()).collect();
        let east: Vec<f64> = tv.iter().map(|t| 15.0 * heading(*t).sin()).collect();
        let motion = Motion::new(&tv, &north, &east);
        let t: Vec<f64> = (0..300).map(|k| 0.25 * f64::from(k)).collect();
        let y: Vec<[f64; 2]> = t.iter().map(|t| motion.at(t - 7.03, &mut 0).place).collect();
        let map = coarse(&Track { t: &t, y: &y, breaks: &[] }, &motion, [-2.5, 13.0]).unwrap();
        assert!((map.constant_s - 7.03).abs() < 0.05, "{}", map.constant_s);
        assert!(!map.edge && map.unexplained_share < 0.05 && map.runner_up_cost > 12.0, "{map:?}");
    }

    /// All paths through a few blocks, by brute force.
    #[test]
    fn no_path_is_cheaper_than_the_cheapest() {
        let mut random = Random::new(1);
        for round in 0..30 {
            let (blocks, delays) = (4, if round % 2 == 0 { 5usize } else { 17 });
            let high = if round % 3 == 0 { 30.0 } else { 3.0 };
            let costs: Vec<Vec<f64>> =
                (0..blocks).map(|_| (0..delays).map(|_| random.uniform(0.0, high)).collect()).collect();
            let cost = |path: &[usize]| -> f64 {
                let changes = path.windows(2).map(|w| (CHANGE_COST * w[0].abs_diff(w[1]) as f64).min(JUMP_COST));
                path.iter().zip(&costs).map(|(j, c)| c[*j]).sum::<f64>() + changes.sum::<f64>()
            };
            let found = cheapest_path(&costs);
            let count = delays.pow(4);
            let digits = |n: usize| [n % delays, n / delays % delays, n / delays.pow(2) % delays, n / delays.pow(3)];
            let least = (0..count).map(|n| cost(&digits(n))).fold(f64::MAX, f64::min);
            assert_eq!(found.len(), 4);
            assert!((cost(&found) - least).abs() < 1e-9, "{found:?}: {} {least}", cost(&found));
        }
        assert!(cheapest_path(&[]).is_empty());
    }

    #[test]
    fn a_parabola_minimum_is_found_between_the_steps() {
        for at in [3.0, 3.3, 2.6, 3.49] {
            let total: Vec<f64> = (0..7).map(|j| 5.0 + 2.0 * (f64::from(j) - at).powi(2)).collect();
            assert!((bottom(&total, 3) - at).abs() < 1e-9, "{at}");
            assert_eq!(least(&total), 3);
        }
        // At the ends and on a plateau no parabola can be fitted.
        assert_eq!((bottom(&[1.0, 2.0, 3.0], 0), bottom(&[3.0, 2.0, 1.0], 2), bottom(&[1.0; 3], 1)), (0.0, 2.0, 1.0));
    }

    #[test]
    fn interpolation_is_linear_inside_and_constant_outside() {
        let (x, y) = ([1.0, 2.0, 4.0], [10.0, 20.0, -20.0]);
        for (q, expected) in
            [(0.0, 10.0), (1.0, 10.0), (1.5, 15.0), (2.0, 20.0), (3.0, 0.0), (4.0, -20.0), (9.0, -20.0)]
        {
            assert!((interpolate(&x, &y, q) - expected).abs() < 1e-12, "{q}");
        }
        assert_eq!(interpolate(&[], &[], 1.0), 0.0);
    }

    /// Fixes at 4 Hz in two pieces with their own offsets.
    fn track_of(late: f64, noise: f64, motion: &Motion) -> (Vec<f64>, Vec<[f64; 2]>) {
        let mut random = Random::new(2);
        let t = random.stamps(200, 3.0);
        let offset = |t: f64| if t < 40.0 { [700.0, -30.0] } else { [650.0, 20.0] };
        let y = t.iter().map(|t| {
            let place = motion.at(t - late, &mut 0).place;
            [0, 1].map(|a| place[a] + offset(*t)[a] + noise * random.normal())
        });
        (t.clone(), y.collect())
    }

    /// Sums of every block and delay against their definition. The table has steps of 0.1 s and is linear in between.
    #[test]
    fn blocks_hold_the_residuals_of_their_fixes_at_every_delay() {
        let motion = turning(90.0);
        let (t, y) = track_of(0.7, 0.3, &motion);
        let track = Track { t: &t, y: &y, breaks: &[40.0] };
        let (lo, hi, delays) = (-0.5, 2.0, 26);
        let blocks = sum_blocks(&track, &motion, lo, hi, delays).unwrap();
        let fixes = |b: usize| -> Vec<usize> {
            let piece = |t: f64| usize::from(t >= 40.0);
            let block = |k: usize| (((t[k] - t[0]) / 2.0) as usize, piece(t[k]));
            let mut all: Vec<(usize, usize)> = (0..t.len()).map(block).collect();
            all.dedup();
            (0..t.len()).filter(|k| block(*k) == all[b]).collect()
        };
        assert_eq!(blocks.count.iter().sum::<f64>(), 200.0);
        for b in 0..blocks.count.len() {
            let rows = fixes(b);
            assert_eq!((blocks.count[b], blocks.piece[b]), (rows.len() as f64, usize::from(t[rows[0]] >= 40.0)));
            assert!((blocks.middle_s[b] - t[rows[0]]).abs() < 1.0 + 1e-3 + 1e-9);
            let still = |a: usize| rows.iter().map(|k| y[*k][a] - y[0][a]).sum::<f64>();
            assert!((blocks.still[b][0] - still(0)).abs() < 1e-6 && (blocks.still[b][1] - still(1)).abs() < 1e-6);
            for j in 0..delays {
                let at = |k: usize| motion.at(t[k] - lo - 0.1 * j as f64, &mut 0).place;
                let e = |k: usize, a: usize| y[k][a] - y[0][a] - at(k)[a];
                let sum = |a: usize| rows.iter().map(|k| e(*k, a)).sum::<f64>();
                let squares: f64 = rows.iter().map(|k| e(*k, 0).powi(2) + e(*k, 1).powi(2)).sum();
                // Between entries of the table the path deviates from linear by less than 2 cm.
                let (n, room) = (rows.len() as f64, 0.02);
                assert!((blocks.sums[b][0][j] - sum(0)).abs() < room * n, "{b} {j}");
                assert!((blocks.sums[b][1][j] - sum(1)).abs() < room * n, "{b} {j}");
                let scale = (squares * n).sqrt() * 2.0 * room + room;
                assert!((blocks.sums[b][2][j] - squares).abs() < scale, "{b} {j}: {} {squares}", blocks.sums[b][2][j]);
            }
        }
    }

    /// Squares about the mean of a window, of north and east.
    #[test]
    fn the_error_of_a_window_is_relative_to_its_own_offset() {
        let mut random = Random::new(3);
        let residuals = [random.pairs(6, 2.0), random.pairs(9, 2.0)];
        let sum = |r: &[[f64; 2]], f: &dyn Fn(&[f64; 2]) -> f64| r.iter().map(f).sum::<f64>();
        let squares = |r: &[f64; 2]| r[0] * r[0] + r[1] * r[1];
        let blocks = Blocks {
            middle_s: vec![1.0, 3.0],
            piece: vec![0, 0],
            count: vec![6.0, 9.0],
            sums: residuals
                .iter()
                .map(|r| [vec![sum(r, &|r| r[0]); 2], vec![sum(r, &|r| r[1]); 2], vec![sum(r, &squares); 2]])
                .collect(),
            still: residuals.iter().map(|r| [sum(r, &|r| r[0]), sum(r, &|r| r[1]), sum(r, &squares)]).collect(),
            interval_s: 0.25,
        };
        let all = residuals.concat();
        let mean = [0, 1].map(|a| all.iter().map(|r| r[a]).sum::<f64>() / 15.0);
        let expected: f64 = all.iter().map(|r| (r[0] - mean[0]).powi(2) + (r[1] - mean[1]).powi(2)).sum();
        let (error, count) = window_error(&blocks, &[0, 1], 2);
        assert!(count == 15.0 && error.iter().all(|e| (e - expected).abs() < 1e-9));
        assert!((window_spread(&blocks, &[0, 1]) - expected).abs() < 1e-9);
    }

    #[test]
    fn the_map_follows_a_jumping_delay_and_detects_its_edge() {
        let motion = turning(120.0);
        let t = Random::new(4).stamps(300, 10.0);
        let late = |t: f64| if t < 70.0 { 0.4 } else { 2.4 };
        let y: Vec<[f64; 2]> = t.iter().map(|t| motion.at(t - late(*t), &mut 0).place).collect();
        let track = Track { t: &t, y: &y, breaks: &[] };
        let map = coarse(&track, &motion, [-2.0, 5.0]).unwrap();
        assert!((map.path_at(40.0) - 0.4).abs() < 0.11 && (map.path_at(100.0) - 2.4).abs() < 0.11, "{map:?}");
        assert!((map.path_span_s() - 2.0).abs() < 0.21 && !map.edge && map.unexplained_share < 0.2);
        // Searched up to 2 s only, the second half is at the edge.
        assert!(coarse(&track, &motion, [-2.0, 2.0]).unwrap().edge);
        // A position that does not move with the velocity: all of it is unexplained.
        let foreign: Vec<[f64; 2]> = y.iter().map(|y| [-y[1], y[0]]).collect();
        let map = coarse(&Track { y: &foreign, ..track }, &motion, [-2.0, 5.0]).unwrap();
        assert!(map.unexplained_share > 0.5, "{}", map.unexplained_share);
    }
}
