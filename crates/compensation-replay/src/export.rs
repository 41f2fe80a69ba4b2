//! Exports for the aircraft: the compensator as C, and the autopilot's own delay parameters.

mod autopilot;
mod c_async;
mod c_float;
mod c_source;

pub use autopilot::{
    AutopilotAdvice, AutopilotParameter, EKF2_DELAY_MAX_DEFAULT_MS, MeasuredAgainst, ParameterFit, autopilot_advice,
    is_gps_delay,
};
pub use c_float::CFloat;
pub use c_source::{CExport, CSource, ExportError};

use crate::compensator::CompensatorKind;

/// The compensator as C99: a struct with its state, `init_warm`, `init_cold`, `step` and `position`, and for
/// `exact-async` also `fix`. It needs no library, not even `libm`: a step is additions, multiplications and, for the
/// paper's, one division.
///
/// With `double` and without fused multiply-add it gives the same bits as the replay at the same step (test
/// `double_in_c_gives_the_bits_of_the_replay`, on x86-64 with cc -std=c99). With `float` it differs by the rounding of
/// 24 bits: for Td = 0.4 s at 100 Hz and velocities to 20 m/s by 5e-6 m for \[1/1\] and 1.2e-5 m for \[4/4\] (test
/// `float_in_c_differs_by_rounding`).
///
/// The same settings give the same text: it contains no date and no host.
///
/// # Errors
/// Compensators that are not a Padé form, rejected forms, and invalid steps and names.
pub fn export_c(export: &CExport) -> Result<CSource, ExportError> {
    if !(export.step_s > 0.0 && export.step_s.is_finite()) {
        return Err(ExportError::Step(export.step_s));
    }
    if !is_c_name(&export.prefix) {
        return Err(ExportError::Prefix(export.prefix.clone()));
    }
    match export.kind {
        CompensatorKind::Pade { .. } => c_source::export(export),
        CompensatorKind::ExactAsync => c_async::export(export),
        other => Err(ExportError::NotAFilter { name: other.to_string() }),
    }
}

/// Keywords of C99, and the names that are types of its library with `_t` appended.
const RESERVED: [&str; 52] = [
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float",
    "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed", "sizeof",
    "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "int8", "int16",
    "int32", "int64", "uint8", "uint16", "uint32", "uint64", "intmax", "uintmax", "intptr", "uintptr", "size", "ssize",
    "ptrdiff", "wchar", "time", "clock",
];

fn is_c_name(name: &str) -> bool {
    name.len() <= 31
        && !RESERVED.contains(&name)
        && name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
