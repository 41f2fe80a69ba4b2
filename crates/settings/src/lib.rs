//! How every settings file is read, and how every complaint about one reads: line, what is wrong, and what would be right.
//!
//! Knows TOML, and not what a setting means: pipelines, criteria, rigs, cards and channel maps are read by the crates that use
//! them.
//!
//! ```
//! #[derive(Debug, serde::Deserialize)]
//! #[serde(deny_unknown_fields)]
//! struct Delay {
//!     #[expect(dead_code)]
//!     position_s: f64,
//! }
//! let text = "# late\npositon_s = 0.4\n";
//! let file = settings::SettingsFile::new(text, std::path::Path::new("late.toml"));
//! let complaint = file.finish(file.read::<Delay>()).unwrap_err();
//! assert_eq!(complaint.line, Some(2));
//! assert_eq!(complaint.what, "unknown key `positon_s`: did you mean `position_s`?");
//! ```

mod file;
mod nearest;
mod number;

pub use file::{Complaint, Refused, SettingsFile};
pub use nearest::{likely, nearest, nearest_few};
pub use number::{seconds, within};
