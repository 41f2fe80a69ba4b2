//! Samples of a horizontal vector.

/// The horizontal axes: index into everything that has a north and an east.
pub const AXES: [usize; 2] = [0, 1];

/// Samples of a horizontal vector.
#[derive(Debug, Clone, Default)]
pub struct Horizontal {
    /// Instants, s.
    pub t: Vec<f64>,
    /// North, then east.
    pub axes: [Vec<f64>; 2],
}

impl Horizontal {
    /// One axis at rising instants, linear between samples and constant outside them. At least one
    /// sample is needed.
    pub fn walk(&self, axis: usize) -> impl FnMut(f64) -> f64 {
        let y = &self.axes[axis];
        let mut after = 0;
        move |t| {
            while after < self.t.len() && self.t[after] <= t {
                after += 1;
            }
            match (after.checked_sub(1), self.t.get(after)) {
                (None, _) => y[0],
                (Some(k), None) => y[k],
                (Some(k), Some(next)) => y[k] + (t - self.t[k]) / (next - self.t[k]) * (y[after] - y[k]),
            }
        }
    }
}
