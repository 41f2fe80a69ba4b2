//! The rig as it was built: Fig. 2 of Park and Lee, drawn from the rig file.

use super::super::{Axis, Figure, Line, Mark, Panel, Pen, extent, stroke};
use crate::number;
use crate::text::label;
use record::{Estimate, ReferenceFinding, RigGeometry, RigPart};

/// Width and height of a drawing, CSS pixels.
const SIZE: (u32, u32) = (420, 300);
/// Angle of the second drawing of the bar, rad.
const SHOWN_ANGLE: f64 = 0.5;

/// Letters for the parts, in the order of the record.
pub(crate) fn letter(part: usize) -> String {
    u8::try_from(part)
        .ok()
        .filter(|p| *p < 26)
        .map_or_else(|| (part + 1).to_string(), |p| char::from(b'A' + p).to_string())
}

/// Rotation about the body's y axis; down becomes up.
fn turned([x, _, z]: [f64; 3], angle: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    (x * cos + z * sin, x * sin - z * cos)
}

/// Side view: along the swing plane and up, m.
pub(super) fn side(geometry: &RigGeometry, reference: &ReferenceFinding) -> Option<Figure> {
    let [x, _, z] = tip(geometry)?;
    let bar = |angle| vec![(0.0, 0.0), turned([x, 0.0, z], angle)];
    let length = x.hypot(z);
    let arc: Vec<(f64, f64)> =
        (0..=20).map(|k| turned([0.55 * x, 0.0, 0.55 * z], SHOWN_ANGLE * f64::from(k) / 20.0)).collect();
    let gravity = vec![(-0.75 * length, 0.25 * length), (-0.75 * length, -0.15 * length)];
    let mut lines = vec![
        stroke("bar at angle zero", Pen::Raw, bar(0.0)),
        stroke("bar at a positive angle", Pen::Dashed, bar(SHOWN_ANGLE)),
        stroke("", Pen::Rule, arc.clone()),
        stroke("", Pen::Rule, arrow_head(&arc)),
        stroke("", Pen::Raw, gravity.clone()),
        stroke("", Pen::Raw, arrow_head(&gravity)),
    ];
    lines.push(Line {
        name: "place of a channel".to_owned(),
        pen: Pen::Points,
        pieces: geometry.parts.iter().map(|p| vec![turned(p.lever_arm_m, 0.0)]).collect(),
    });
    let marks = vec![Mark { at: (0.0, 0.0), label: "pivot and encoder".to_owned() }];
    let mut labels = vec![
        Mark { at: turned([0.6 * x, 0.0, 0.6 * z], 1.3 * SHOWN_ANGLE), label: sense(reference).to_owned() },
        Mark { at: gravity[0], label: format!("g {} m/s²", number::significant(reference.gravity_mps2, 4)) },
    ];
    labels.extend(named(&geometry.parts, 0.05 * length, |arm| turned(arm, 0.0)));
    let caption = format!(
        "Seen along the axis of rotation; the bar is {} m long, mounted {}. Lever arms are in the table.",
        number::exact(geometry.bar_length_m),
        label(&geometry.mount)
    );
    figure(
        "geometry-side",
        "The rig from the side",
        caption,
        ("forward in the swing's plane (m)", "up (m)"),
        lines,
        [marks, labels],
    )
}

/// Top view: east and north, m.
pub(super) fn above(geometry: &RigGeometry, reference: &ReferenceFinding) -> Option<Figure> {
    let azimuth = reference.azimuth_rad.as_ref()?.value;
    let [x, _, z] = tip(geometry)?;
    let reach = x.hypot(z) * reference.angle_range_rad.iter().fold(0.2f64, |most, a| most.max(a.abs().min(1.5).sin()));
    let (sin, cos) = azimuth.sin_cos();
    let at = |forward: f64, right: f64| (forward * sin + right * cos, forward * cos - right * sin);
    let plane = vec![at(-reach, 0.0), at(reach, 0.0)];
    let north = vec![(0.0, 0.0), (0.0, 0.8 * reach)];
    let arc: Vec<(f64, f64)> = (0..=20)
        .map(|k| (azimuth * f64::from(k) / 20.0).sin_cos())
        .map(|(sin, cos)| (0.5 * reach * sin, 0.5 * reach * cos))
        .collect();
    let mut lines = vec![
        stroke("plane of the swing", Pen::Raw, plane.clone()),
        stroke("", Pen::Raw, arrow_head(&plane)),
        stroke("north", Pen::Dashed, north.clone()),
        stroke("", Pen::Rule, arc.clone()),
        stroke("", Pen::Rule, arrow_head(&arc)),
    ];
    lines.push(Line {
        name: "place of a channel".to_owned(),
        pen: Pen::Points,
        pieces: geometry.parts.iter().map(|p| vec![at(p.lever_arm_m[0], p.lever_arm_m[1])]).collect(),
    });
    let beyond = (1.3 * azimuth).sin_cos();
    let azimuth = number::scaled(reference.azimuth_rad.as_ref()?, 1f64.to_degrees());
    let azimuth = Estimate { value: azimuth.value.rem_euclid(360.0), ..azimuth };
    let labels = vec![Mark {
        at: (0.6 * reach * beyond.0, 0.6 * reach * beyond.1),
        label: format!("azimuth {}°", number::with_uncertainty(&azimuth)),
    }];
    let caption =
        "Seen from above. The arrow is the direction in which the body's x axis points at bar angle zero.".to_owned();
    figure("geometry-above", "The rig from above", caption, ("east (m)", "north (m)"), lines, [vec![], labels])
}

/// End of the bar in body axes, m; `None` if it has no length.
fn tip(geometry: &RigGeometry) -> Option<[f64; 3]> {
    let length = geometry.bar_length_m;
    let is_drawable = length.is_finite() && length > 1e-6 && length < 1e6;
    let is_below = match geometry.mount.as_str() {
        "hanging" => true,
        "upright" => false,
        _ => geometry.parts.iter().map(|p| p.lever_arm_m[2]).sum::<f64>() > 0.0,
    };
    is_drawable.then_some([0.0, 0.0, if is_below { length } else { -length }])
}

/// Counting direction of the encoder along the arrow of the positive angle.
fn sense(reference: &ReferenceFinding) -> &'static str {
    if reference.sign < 0.0 { "angle +, counts fall" } else { "angle +, counts rise" }
}

/// The letters of the parts; parts closer together than `least` share a label.
fn named(parts: &[RigPart], least: f64, at: impl Fn([f64; 3]) -> (f64, f64)) -> Vec<Mark> {
    let mut marks: Vec<Mark> = vec![];
    for (i, part) in parts.iter().enumerate() {
        let place = at(part.lever_arm_m);
        let near = |mark: &&mut Mark| (mark.at.0 - place.0).hypot(mark.at.1 - place.1) < least;
        match marks.iter_mut().find(near) {
            Some(mark) => mark.label += &format!(", {}", letter(i)),
            None => marks.push(Mark { at: place, label: letter(i) }),
        }
    }
    marks
}

/// Two short strokes at the end of a line.
fn arrow_head(line: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let [.., (x0, y0), (x1, y1)] = *line else { return vec![] };
    let whole: f64 = line.windows(2).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).sum();
    let (dx, dy) = (x1 - x0, y1 - y0);
    let step = dx.hypot(dy);
    if step <= 0.0 {
        return vec![];
    }
    let side = |turn: f64| {
        let (sin, cos) = turn.sin_cos();
        let size = 0.12 * whole / step;
        (x1 + size * (dx * cos - dy * sin), y1 + size * (dx * sin + dy * cos))
    };
    vec![side(2.7), (x1, y1), side(-2.7)]
}

/// One drawing with equal scales.
fn figure(
    id: &str,
    title: &str,
    caption: String,
    (across, up): (&str, &str),
    lines: Vec<Line>,
    [marks, labels]: [Vec<Mark>; 2],
) -> Option<Figure> {
    let (x, y) = (extent(&lines, |p| p.0)?, extent(&lines, |p| p.1)?);
    let (width, height) = (f64::from(SIZE.0), f64::from(SIZE.1));
    let scale = ((x.1 - x.0) / width).max((y.1 - y.0) / height) * 1.15;
    let around = |(low, high): (f64, f64), pixels: f64| {
        let (middle, half) = (0.5 * (low + high), 0.5 * scale * pixels);
        (middle - half, middle + half)
    };
    let panel = Panel {
        marks,
        labels,
        ..Panel::of(Axis::exactly(across, around(x, width), 6), Axis::exactly(up, around(y, height), 6), lines)
    };
    Some(Figure {
        id: id.to_owned(),
        number: 0,
        title: title.to_owned(),
        caption,
        how_to_read: "",
        panels: vec![panel],
        panel_size: SIZE,
        fine: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_letters_and_after_z_numbers() {
        assert_eq!([0, 1, 25, 26, 300].map(letter), ["A", "B", "Z", "27", "301"]);
    }

    #[test]
    fn a_quarter_turn_about_y_takes_down_to_forward() {
        let is = |(x, z): (f64, f64), expected: (f64, f64)| (x - expected.0).abs() + (z - expected.1).abs() < 1e-12;
        let quarter = std::f64::consts::FRAC_PI_2;
        assert!(is(turned([0.0, 9.0, 2.0], quarter), (2.0, 0.0)));
        assert!(is(turned([3.0, 9.0, 0.0], quarter), (0.0, 3.0)));
        assert!(is(turned([3.0, 9.0, 2.0], 0.0), (3.0, -2.0)), "down becomes up");
    }
}
