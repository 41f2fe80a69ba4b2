//! Exports for the aircraft: the compensator as C, and the autopilot's own delay parameters.

mod autopilot;
mod c_async;
mod c_float;
mod c_source;

pub use autopilot::{AutopilotAdvice, AutopilotParameter, MeasuredAgainst, ParameterFit, autopilot_advice};
pub use c_float::CFloat;
pub use c_source::{CExport, CSource, ExportError, export_c};
