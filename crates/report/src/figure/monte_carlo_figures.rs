//! A Monte-Carlo study at a glance: each column over the cases.

use super::axis::Tick;
use super::{Axis, Figure, Line, Panel, Pen, extent, upright};
use crate::number::COVERAGE_FACTOR;
use crate::text::{label, short_label};
use record::MonteCarloGroup;

/// Maximum number of panels in one figure.
const MOST: usize = 8;

/// Columns of a group, one panel each, over the case numbers. `None` if there are no numbers.
pub(crate) fn group_figure(group: &MonteCarloGroup, number: u32) -> Option<Figure> {
    let columns = group.columns.iter().enumerate().take(MOST);
    let panels: Vec<Panel> = columns.filter_map(|(i, name)| panel(group, i, name)).collect();
    (!panels.is_empty()).then(|| Figure {
        id: format!("group-{number}-figure"),
        number,
        title: label(&group.title),
        caption: "Each column of the table over the number of the case, with U (k = 2) of the study.".to_owned(),
        how_to_read: "Good: blue, anywhere. Red and hollow: the goal of the column is not met. The bar is the error of \
                      the study.",
        panels,
        // High enough for the longest column label, which is vertical.
        panel_size: (760, 150),
        fine: false,
    })
}

fn panel(group: &MonteCarloGroup, column: usize, name: &str) -> Option<Panel> {
    let points = |missed: bool| {
        let cases = (1u32..).zip(&group.cases);
        let wanted = cases.filter(|(_, c)| (c.met.get(column) == Some(&Some(false))) == missed);
        let point = wanted.filter_map(|(n, case)| {
            let value = case.values.get(column)?.as_ref()?;
            upright(f64::from(n), value.value, COVERAGE_FACTOR * value.standard_uncertainty.unwrap_or(0.0))
        });
        point.collect::<Vec<_>>()
    };
    let mut lines = vec![
        Line { name: "case, ± U (k = 2)".to_owned(), pen: Pen::Points, pieces: points(false) },
        Line { name: "goal not met".to_owned(), pen: Pen::HollowPoints, pieces: points(true) },
    ];
    lines.retain(|line| !line.pieces.is_empty());
    let y = Axis::linear(&short_label(name), extent(&lines, |p| p.1)?, 4);
    let last = group.cases.len();
    let step = last.div_ceil(30).max(1);
    let ticks = (1..=last).step_by(step).map(|n| Tick { at: n as f64, label: n.to_string() }).collect();
    Some(Panel::of(Axis::ticked("case", (0.4, last as f64 + 0.6), ticks), y, lines))
}
