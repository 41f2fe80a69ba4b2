//! Arithmetic on series. Has never heard of a pendulum, a file or a page.
//!
//! Series here are slices: times in seconds that rise strictly, and one value for each.
//!
//! ```
//! let t = [0.0, 1.0, 2.0];
//! let v = [0.0, 2.0, 4.0];
//! let distance = signal::CumulativeIntegral::new(&t, &v).at(1.5);
//! assert_eq!(distance, 2.25); // ∫₀^1.5 2τ dτ
//! ```

mod decimate;
mod integral;
mod path;
mod reference;
mod statistics;
mod window;

pub use decimate::{Decimated, min_max};
pub use integral::CumulativeIntegral;
pub use path::thin_path;
pub use reference::Reference;
pub use statistics::{RmsEstimate, block_jackknife_rms, median_in_place, percentile_of_sorted, robust_sigma};
pub use window::{Window, largest_sum};
