//! Settings, with the values of the specification.

/// How a delay over time is searched for and judged (`delay-over-time.md`).
#[derive(Debug, Clone, PartialEq)]
pub struct OverTimeSettings {
    /// Delays that are searched first, s.
    pub search_s: [f64; 2],
    /// Delays that are searched once the edge of the first range is hit, s.
    pub wide_search_s: [f64; 2],
    /// Least change that counts as one, s (d of Part B S5f).
    pub least_change_s: f64,
    /// Least change that counts as one, as a share of the level.
    pub least_change_share: f64,
    /// Upper limit on the least change, s: otherwise a share of a delay of seconds would hide changes of seconds.
    pub largest_limit_s: f64,
    /// Probability below which windows are inconsistent.
    pub significance: f64,
    /// Largest standard uncertainty with which a window is used, s.
    pub window_limit_s: f64,
    /// Least number of windows for a test of constancy.
    pub least_windows: usize,
    /// Detectable change above which "constant" is qualified by "as far as can be seen", s.
    pub detectable_limit_s: f64,
    /// Largest standard uncertainty with which the level counts as known, s.
    pub known_limit_s: f64,
    /// Delays below this count as zero, s.
    pub on_time_margin_s: f64,
    /// Random draws per probability.
    pub draws: usize,
    /// Maximum number of fixes in the fit; more are thinned.
    pub most_fixes: usize,
}

impl Default for OverTimeSettings {
    fn default() -> OverTimeSettings {
        OverTimeSettings {
            search_s: [-2.5, 13.0],
            wide_search_s: [-5.0, 30.0],
            least_change_s: 0.05,
            least_change_share: 0.2,
            largest_limit_s: 0.15,
            significance: 1e-3,
            window_limit_s: 0.25,
            least_windows: 8,
            detectable_limit_s: 0.15,
            known_limit_s: 0.05,
            on_time_margin_s: 0.02,
            draws: 4000,
            most_fixes: 6000,
        }
    }
}
