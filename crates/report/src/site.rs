//! What a report is: files that nobody has written yet.

use crate::draw;
use crate::figure::{self, Figure};
use std::collections::BTreeMap;

/// The files of one report, by path below the report's folder. Paths use `/` and never
/// leave the folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Site {
    /// Content by path.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl Site {
    /// Adds a text file.
    pub(crate) fn add(&mut self, path: &str, text: String) {
        self.files.insert(path.to_owned(), text.into_bytes());
    }

    /// Adds a figure beside the page that shows it: as drawn, and as a table.
    pub(crate) fn add_figure(&mut self, figure: &Figure) {
        self.add(&format!("figures/{}.svg", figure.id), draw::svg_file(figure));
        self.add(&format!("figures/{}.csv", figure.id), figure::csv(figure));
    }
}
