//! The texts of a column in one buffer.

/// The texts of a column, row by row.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct Texts {
    all: String,
    /// Where the text of each row ends in the buffer.
    ends: Vec<usize>,
}

impl Texts {
    /// The number of texts.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// The text of a row.
    #[must_use]
    #[inline]
    pub fn get(&self, row: usize) -> Option<&str> {
        self.all.get(self.start(row)..*self.ends.get(row)?)
    }

    /// Iterates over all texts in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &str> {
        (0..self.len()).map(|row| self.get(row).unwrap_or_default())
    }

    /// Appends a text.
    pub fn push(&mut self, text: &str) {
        self.all.push_str(text);
        self.ends.push(self.all.len());
    }

    /// Keeps at most `rows` texts.
    pub fn truncate(&mut self, rows: usize) {
        self.all.truncate(self.start(rows.min(self.len())));
        self.ends.truncate(rows);
    }

    /// Sets the number of texts to `rows`: added ones are empty.
    pub fn resize(&mut self, rows: usize) {
        self.truncate(rows);
        self.ends.resize(rows, self.all.len());
    }

    /// Appends the texts of another column, and empties it, but keeps its capacity.
    pub(crate) fn append(&mut self, more: &mut Texts) {
        let before = self.all.len();
        self.all.push_str(&more.all);
        self.ends.extend(more.ends.iter().map(|end| before + end));
        more.clear();
    }

    /// Removes all rows but keeps the capacity.
    pub(crate) fn clear(&mut self) {
        self.all.clear();
        self.ends.clear();
    }

    fn start(&self, row: usize) -> usize {
        row.checked_sub(1).and_then(|before| self.ends.get(before)).copied().unwrap_or(0)
    }
}

impl std::fmt::Debug for Texts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<T: AsRef<str>> FromIterator<T> for Texts {
    fn from_iter<I: IntoIterator<Item = T>>(texts: I) -> Texts {
        let mut all = Texts::default();
        texts.into_iter().for_each(|text| all.push(text.as_ref()));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_can_be_truncated_padded_and_appended() {
        let mut texts: Texts = ["a1", "", "é5"].into_iter().collect();
        assert_eq!((texts.get(0), texts.get(1), texts.get(2), texts.get(3)), (Some("a1"), Some(""), Some("é5"), None));
        texts.resize(4);
        assert_eq!(texts, ["a1", "", "é5", ""].into_iter().collect());
        texts.truncate(5);
        texts.truncate(1);
        let mut more: Texts = ["x", "yz"].into_iter().collect();
        texts.append(&mut more);
        assert_eq!((more.len(), texts), (0, ["a1", "x", "yz"].into_iter().collect()));
    }
}
