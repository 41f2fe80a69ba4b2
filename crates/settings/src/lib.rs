//! Reads every settings file. Every complaint gives the line, what is wrong, and what would be right.
//!
//! Knows TOML, but not what a setting means: the crates that use pipelines, criteria, rigs, cards and channel maps
//! interpret them.
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
//! let error = file.finish(file.read::<Delay>()).unwrap_err();
//! assert_eq!(error.line, Some(2));
//! assert_eq!(error.what, "unknown key `positon_s`: did you mean `position_s`?");
//! ```

mod file;
mod nearest;
mod number;

pub use file::{Refused, SettingsError, SettingsFile, read_text};
pub use nearest::{likely, nearest, nearest_few};
pub use number::{plain_zero, seconds, within};
