//! Shrinks the frame of a figure to a third: plotters writes one element per grid line, tick and label.

use super::PALETTE;
use std::fmt::Write;

/// Grid, axes and text as plotters wrote them, without attributes repeated from the outermost element. Lines with
/// the same stroke become one path; labels with the same anchor share a group. Quotes inside text are escaped, so only
/// attributes change.
pub(super) fn lighter(svg: &str) -> String {
    let svg = svg.replace(" opacity=\"1\"", "").replace(" font-family=\"sans-serif\"", "");
    let svg = PALETTE.iter().fold(svg, |svg, (colour, _)| svg.replace(&colour.to_uppercase(), colour));
    let size =
        svg.split_once(" font-size=\"").and_then(|(_, rest)| rest.split_once('"')).map_or("24", |(size, _)| size);
    let usual = [format!(" font-size=\"{size}\""), " fill=\"#1b1f24\"".to_owned()];
    let mut frame = Frame { size: size.parse().unwrap_or(24.0), ..Frame::default() };
    usual.iter().fold(svg.clone(), |svg, attribute| svg.replace(attribute, "")).split_inclusive("/>").for_each(
        |part| {
            // Text elements, which are not self-closing, may precede a self-closing element.
            let mut rest = part;
            while let Some((text, behind)) = rest.split_once("</text>") {
                frame.text(text);
                rest = behind;
            }
            frame.element(rest.trim());
        },
    );
    frame.flush();
    format!("<g font-size=\"{:.1}\"{}>{}</g>\n", frame.size, usual[1], frame.out)
}

#[derive(Default)]
struct Frame {
    /// Font size, drawing units.
    size: f64,
    out: String,
    /// Strokes with the `d` of their lines, in order of first use.
    strokes: Vec<(String, String)>,
    /// Anchors with their text elements.
    texts: Vec<(String, String)>,
}

impl Frame {
    /// Adds a line to those with its stroke. Any other element flushes them, to keep the drawing order.
    fn element(&mut self, element: &str) {
        match drawn_line(element) {
            Some(d) => {
                let of = |name: &str| format!(" {name}=\"{}\"", attribute(element, name).unwrap_or_default());
                joined(&mut self.strokes, of("stroke") + &of("stroke-width")).push_str(&d);
            }
            None if element.is_empty() => {}
            None => {
                self.flush();
                self.out += element;
                self.out.push('\n');
            }
        }
    }

    /// `<text …>` and its content. An empty tick label is dropped.
    fn text(&mut self, text: &str) {
        let Some((tag, said)) = text.trim_start().split_once('>') else { return };
        let said = said.trim();
        if said.is_empty() {
            return;
        }
        let number = |name: &str| attribute(tag, name).and_then(|text| text.parse::<f64>().ok()).unwrap_or(0.0);
        let anchor = attribute(tag, "text-anchor").unwrap_or("start");
        let mut element = format!("<text x=\"{}\"", number("x"));
        match attribute(tag, "transform") {
            // The shift applies before the rotation.
            Some(turn) => {
                let (y, dy) = (number("y"), attribute(tag, "dy").unwrap_or("0"));
                let _ = write!(element, " y=\"{y}\" dy=\"{dy}\" transform=\"{turn}\"");
            }
            None => {
                let y = number("y") + shift(attribute(tag, "dy").unwrap_or_default(), self.size);
                let _ = write!(element, " y=\"{y:.0}\"");
            }
        }
        if let Some(fill) = attribute(tag, "fill") {
            let _ = write!(element, " fill=\"{fill}\"");
        }
        let _ = write!(element, ">{said}</text>");
        joined(&mut self.texts, anchor.to_owned()).push_str(&element);
    }

    fn flush(&mut self) {
        for (stroke, d) in self.strokes.drain(..) {
            let _ = writeln!(self.out, "<path fill=\"none\"{stroke} d=\"{d}\"/>");
        }
        for (anchor, texts) in self.texts.drain(..) {
            let _ = writeln!(self.out, "<g text-anchor=\"{anchor}\">{texts}</g>");
        }
    }
}

/// The entry for `key`, created if it is missing.
fn joined(all: &mut Vec<(String, String)>, key: String) -> &mut String {
    let place = all.iter().position(|(known, _)| *known == key).unwrap_or_else(|| {
        all.push((key, String::new()));
        all.len() - 1
    });
    &mut all[place].1
}

/// A line or polyline as part of the `d` of a path; `None` for any other element, or one with its own style.
fn drawn_line(element: &str) -> Option<String> {
    let of = |name| attribute(element, name);
    let points: Vec<(&str, &str)> = if element.starts_with("<line ") {
        vec![(of("x1")?, of("y1")?), (of("x2")?, of("y2")?)]
    } else if element.starts_with("<polyline ") {
        of("points")?.split_whitespace().map(|point| point.split_once(',')).collect::<Option<_>>()?
    } else {
        return None;
    };
    if element.contains("opacity") || element.contains("dash") {
        return None;
    }
    let mut d = String::new();
    let mut before: Option<(&str, &str)> = None;
    for (x, y) in points {
        let _ = match before {
            None => write!(d, "M{x} {y}"),
            Some((from, _)) if from == x => write!(d, "V{y}"),
            Some((_, from)) if from == y => write!(d, "H{x}"),
            Some(_) => write!(d, "L{x} {y}"),
        };
        before = Some((x, y));
    }
    Some(d)
}

/// `dy` in drawing units. In typical browser `sans-serif` fonts the x-height is about half an em.
fn shift(dy: &str, size: f64) -> f64 {
    let of = |unit: &str| dy.strip_suffix(unit).and_then(|number| number.parse::<f64>().ok());
    of("ex").map(|ex| ex / 2.0).or(of("em")).unwrap_or(0.0) * size
}

fn attribute<'e>(element: &'e str, name: &str) -> Option<&'e str> {
    let (_, behind) = element.split_once(&format!(" {name}=\""))?;
    behind.split_once('"').map(|(value, _)| value)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Plotters output: a grid, an axis, a rectangle over both, a label to the left, one rotated by 270°, one empty.
    const WRITTEN: &str = r##"<line opacity="1" stroke="#E4E7EB" stroke-width="2" x1="154" y1="508" x2="154" y2="80"/>
<polyline fill="none" opacity="1" stroke="#57606A" stroke-width="2" points="153,80 153,508 "/>
<text x="140" y="506" dy="0.5ex" text-anchor="end" font-family="sans-serif" font-size="24" opacity="1" fill="#1B1F24">
−100
</text>
<line opacity="1" stroke="#E4E7EB" stroke-width="2" x1="154" y1="300" x2="900" y2="300"/>
<text x="14" y="294" dy="0.76em" text-anchor="middle" font-family="sans-serif" font-size="24" opacity="1" fill="#1B1F24" transform="rotate(270, 14, 294)">
north (m)
</text>
<text x="1" y="2" dy="0.76em" text-anchor="middle" font-family="sans-serif" font-size="24" opacity="1" fill="#1B1F24">

</text>
<rect x="1" y="2" width="3" height="4" opacity="0.22" fill="#E69F00" stroke="none"/>
<line opacity="1" stroke="#E4E7EB" stroke-width="2" x1="1" y1="2" x2="3" y2="4"/>
"##;

    #[test]
    fn lines_with_one_stroke_become_a_path_and_labels_keep_their_positions() {
        let frame = r##"<g font-size="24.0" fill="#1b1f24"><path fill="none" stroke="#e4e7eb" stroke-width="2" d="M154 508V80M154 300H900"/>
<path fill="none" stroke="#57606a" stroke-width="2" d="M153 80V508"/>
<g text-anchor="end"><text x="140" y="512">−100</text></g>
<g text-anchor="middle"><text x="14" y="294" dy="0.76em" transform="rotate(270, 14, 294)">north (m)</text></g>
<rect x="1" y="2" width="3" height="4" opacity="0.22" fill="#e69f00" stroke="none"/>
<path fill="none" stroke="#e4e7eb" stroke-width="2" d="M1 2L3 4"/>
</g>
"##;
        assert_eq!(lighter(WRITTEN), frame);
    }
}
