//! A small strict parser for our own pages: every tag, attribute and link must be on a list.

use std::fmt::Write;

const TAGS: [&str; 50] = [
    "dl",
    "dt",
    "dd",
    "section",
    "html",
    "head",
    "meta",
    "title",
    "style",
    "script",
    "body",
    "nav",
    "main",
    "h1",
    "h2",
    "h3",
    "p",
    "a",
    "b",
    "div",
    "span",
    "wbr",
    "data",
    "code",
    "pre",
    "ul",
    "li",
    "table",
    "caption",
    "thead",
    "tbody",
    "tr",
    "th",
    "td",
    "figure",
    "figcaption",
    "details",
    "summary",
    "bdi",
    "ol",
    "svg",
    "desc",
    "path",
    "rect",
    "text",
    "line",
    "polyline",
    "circle",
    "polygon",
    "g",
];
const VOID: [&str; 2] = ["meta", "wbr"];
const ATTRIBUTES: [&str; 61] = [
    "data-t",
    "data-length",
    "hidden",
    "type",
    "rel",
    "open",
    "lang",
    "charset",
    "http-equiv",
    "content",
    "name",
    "class",
    "id",
    "href",
    "aria-label",
    "aria-hidden",
    "role",
    "tabindex",
    "scope",
    "colspan",
    "title",
    "value",
    "data-u",
    "data-v",
    "download",
    "data-kind",
    "data-group",
    "data-alarm",
    "data-reason",
    "data-track",
    "data-q",
    "style",
    "viewBox",
    "width",
    "height",
    "aria-labelledby",
    "x",
    "y",
    "x1",
    "y1",
    "x2",
    "y2",
    "dy",
    "text-anchor",
    "font-family",
    "font-size",
    "opacity",
    "fill",
    "stroke",
    "stroke-width",
    "stroke-linejoin",
    "stroke-linecap",
    "stroke-dasharray",
    "d",
    "points",
    "transform",
    "cx",
    "cy",
    "r",
    "paint-order",
    "xmlns",
];

/// One start tag with its attributes; values are still escaped.
#[derive(Debug, Clone, PartialEq)]
pub struct Tag {
    pub name: String,
    pub attributes: Vec<(String, String)>,
    /// Everything up to the next tag.
    pub text: String,
}

impl Tag {
    pub fn get(&self, attribute: &str) -> Option<&str> {
        self.attributes.iter().find(|(name, _)| name == attribute).map(|(_, value)| value.as_str())
    }
}

/// Parses a page or a figure. Tags must be balanced and on the list, and links must stay inside the report.
///
/// Panics with what is wrong and where.
pub fn read(text: &str) -> Vec<Tag> {
    let (mut tags, mut open) = (Vec::new(), Vec::<String>::new());
    let mut rest = text.strip_prefix("<!DOCTYPE html>").unwrap_or(text);
    while let Some(start) = rest.find('<') {
        rest = &rest[start + 1..];
        let end = end_of_tag(rest);
        let (inside, after) = (&rest[..end], &rest[end + 1..]);
        if let Some(name) = inside.strip_prefix('/') {
            assert_eq!(
                open.pop().as_deref(),
                Some(name),
                "closing tag near {:?}",
                &after.chars().take(60).collect::<String>()
            );
        } else {
            let tag = start_tag(inside, after);
            let closes = inside.ends_with('/') || VOID.contains(&tag.name.as_str());
            if matches!(tag.name.as_str(), "script" | "style") {
                // Raw text: contains no tags before its own end tag.
                rest = &after[after.find(&format!("</{}>", tag.name)).unwrap()..];
                open.push(tag.name.clone());
                tags.push(tag);
                continue;
            }
            if !closes {
                open.push(tag.name.clone());
            }
            tags.push(tag);
        }
        rest = after;
    }
    assert!(open.is_empty(), "not closed: {open:?}");
    tags.iter().for_each(check);
    tags
}

fn end_of_tag(text: &str) -> usize {
    let mut quoted = false;
    text.char_indices()
        .find(|(_, c)| {
            quoted ^= *c == '"';
            *c == '>' && !quoted
        })
        .map(|(i, _)| i)
        .expect("a tag that ends")
}

fn start_tag(inside: &str, after: &str) -> Tag {
    let inside = inside.trim_end_matches('/');
    let name = inside.split(|c: char| c.is_whitespace()).next().unwrap_or_default();
    let mut attributes = Vec::new();
    let mut rest = inside[name.len()..].trim_start();
    while !rest.is_empty() {
        let (attribute, value) =
            rest.split_once("=\"").unwrap_or_else(|| panic!("attribute without a value: {rest:?}"));
        let (value, after) = value.split_once('"').expect("a closing quote");
        attributes.push((attribute.to_owned(), value.to_owned()));
        rest = after.trim_start();
    }
    let text = after.split('<').next().unwrap_or_default().to_owned();
    Tag { name: name.to_owned(), attributes, text }
}

fn check(tag: &Tag) {
    assert!(TAGS.contains(&tag.name.as_str()), "tag {tag:?}");
    for (name, value) in &tag.attributes {
        assert!(ATTRIBUTES.contains(&name.as_str()), "attribute {name} of {}", tag.name);
        assert!(!value.contains("url("), "{tag:?}");
        if name == "href" {
            assert!(!value.contains(':') && !value.starts_with('/') && !value.starts_with('\\'), "link {value}");
        }
    }
}

/// Whether a page shows the figure of a file: the same text and curves, in the colours of the page's style sheet.
pub fn shows(html: &str, svg: &str) -> bool {
    let is_there = |tag: &Tag| match tag.name.as_str() {
        "path" => tag.get("d").is_none_or(|d| html.contains(&format!(" d=\"{d}\""))),
        "title" | "desc" | "text" => html.contains(&tag.text),
        _ => true,
    };
    read(svg).iter().all(is_there)
}

/// Absolute points of a path of `M`, `m`, `l`, `h`, `H`, `V` and `z` commands.
pub fn points(d: &str) -> Vec<(f64, f64)> {
    let is_command = |c: char| matches!(c, 'M' | 'm' | 'l' | 'h' | 'H' | 'V' | 'v' | 'z');
    let mut spaced = String::new();
    for c in d.chars() {
        match c {
            c if is_command(c) => write!(spaced, " {c} ").unwrap(),
            '-' => spaced.push_str(" -"),
            c => spaced.push(c),
        }
    }
    let mut words = spaced.split_whitespace().peekable();
    let (mut out, mut at, mut command) = (Vec::new(), (0.0, 0.0), "M");
    while let Some(word) = words.peek() {
        if word.starts_with(is_command) {
            command = words.next().unwrap();
            continue;
        }
        let first: f64 = words.next().unwrap().parse().unwrap();
        let mut second = || words.next().unwrap().parse::<f64>().unwrap();
        at = match command {
            "M" => (first, second()),
            "m" | "l" => (at.0 + first, at.1 + second()),
            "h" => (at.0 + first, at.1),
            "H" => (first, at.1),
            "v" => (at.0, at.1 + first),
            _ => (at.0, first),
        };
        out.push(at);
    }
    out
}
