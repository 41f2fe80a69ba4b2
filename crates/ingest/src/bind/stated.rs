//! The units of the map against those that the log itself states.

use super::trial::Plan;
use crate::reader::StatedUnit;
use flight::{Dimension, Notices, Severity};

/// Scales that differ by less are the same: loggers round theirs to single precision.
const SAME_SCALE: f64 = 1e-5;

/// Says where the map takes a field for something else than the log does. The map is followed all the same: whoever
/// wrote it may know better. Of pure numbers nothing is said, for which loggers have no common word.
pub(super) fn compare(plan: &Plan<'_>, stated: &[StatedUnit], notices: &mut Notices) {
    for found in plan.columns.iter().flatten().filter(|f| f.unit.dimension() != Dimension::None) {
        let of_field = |s: &&StatedUnit| s.type_name == plan.table.topic.type_name && s.path == found.column.path;
        let Some(stated) = stated.iter().rfind(of_field) else { continue };
        let Some((dimension, si)) = stated.measures else { continue };
        let same = dimension == found.unit.dimension() && (si / found.unit.to_si(1.0) - 1.0).abs() < SAME_SCALE;
        if !same {
            let text = format!(
                "channel {}: the log states {} in {}, and the channel map takes it for {}; the map is followed",
                plan.rule.name, found.column.path, stated.text, found.unit
            );
            notices.push(Severity::Warning, "unit-differs", &plan.table.topic.name, plan.table.rows as u64, text);
        }
    }
}
