//! Optional values for each row, in little more memory than the values take.

/// The values of the rows of a table. Rows may lack one.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Values<T> {
    /// [`Default`] where there is none.
    values: Vec<T>,
    /// Which rows have one; `None` if all.
    given: Option<Vec<bool>>,
}

impl<T> Values<T> {
    /// The number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Whether every row has a value.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.given.is_none()
    }

    fn is_given(&self, row: usize) -> bool {
        self.given.as_ref().is_none_or(|given| given.get(row).copied().unwrap_or_default())
    }
}

impl<T: Copy> Values<T> {
    /// The value of a row.
    #[must_use]
    pub fn get(&self, row: usize) -> Option<T> {
        self.values.get(row).copied().filter(|_| self.is_given(row))
    }

    /// The values of all rows.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = Option<T>> + ExactSizeIterator + Clone {
        (0..self.len()).map(|row| self.get(row))
    }

    /// The values of the rows that have one.
    pub fn given(&self) -> impl Iterator<Item = T> + Clone {
        self.iter().flatten()
    }
}

impl<T: Copy + Default> Values<T> {
    /// Mutable values of the rows that have one.
    pub(crate) fn given_mut(&mut self) -> impl Iterator<Item = &mut T> {
        let given = self.given.as_deref();
        let is_given = move |row: usize| given.is_none_or(|given| given.get(row).copied().unwrap_or_default());
        self.values.iter_mut().enumerate().filter(move |(row, _)| is_given(*row)).map(|(_, value)| value)
    }

    /// Changes values, and which rows have one.
    pub fn change(&mut self, change: impl FnOnce(&mut [Option<T>])) {
        let mut all: Vec<Option<T>> = self.iter().collect();
        change(&mut all);
        *self = all.into();
    }

    /// Values, and which of them count; `None` if all do.
    #[must_use]
    pub fn into_parts(self) -> (Vec<T>, Option<Vec<bool>>) {
        (self.values, self.given)
    }
}

/// In place: the values are not held twice.
impl<T: Default> From<Vec<Option<T>>> for Values<T> {
    fn from(all: Vec<Option<T>>) -> Values<T> {
        let given = all.iter().any(Option::is_none).then(|| all.iter().map(Option::is_some).collect());
        let mut values: Vec<T> = all.into_iter().map(Option::unwrap_or_default).collect();
        // The memory of the option tags is left over.
        values.shrink_to_fit();
        Values { values, given }
    }
}

impl<T> From<Vec<T>> for Values<T> {
    fn from(values: Vec<T>) -> Values<T> {
        Values { values, given: None }
    }
}

impl<T: Default> FromIterator<Option<T>> for Values<T> {
    fn from_iter<I: IntoIterator<Item = Option<T>>>(all: I) -> Values<T> {
        let mut given: Option<Vec<bool>> = None;
        let all = all.into_iter();
        let mut values = Vec::with_capacity(all.size_hint().0);
        for value in all {
            if value.is_none() {
                given.get_or_insert_with(|| vec![true; values.len()]);
            }
            given.iter_mut().for_each(|given| given.push(value.is_some()));
            values.push(value.unwrap_or_default());
        }
        Values { values, given }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_returned_as_given_and_complete_ones_need_no_flags() {
        for all in [vec![], vec![Some(3), Some(0)], vec![None, Some(i64::MIN), None], vec![Some(1), None, Some(2)]] {
            let packed = Values::from(all.clone());
            assert_eq!(packed, all.iter().copied().collect());
            assert_eq!(packed.iter().collect::<Vec<_>>(), all);
            assert_eq!((packed.len(), packed.is_whole()), (all.len(), !all.contains(&None)));
            assert_eq!((packed.get(all.len()), packed.given().count()), (None, all.iter().flatten().count()));
        }
    }

    #[test]
    fn changed_values_stay_with_their_rows() {
        let mut changed = Values::from(vec![Some(7), None, Some(9)]);
        changed.change(|all| all.swap(0, 1));
        assert_eq!(changed.into_parts(), (vec![0, 7, 9], Some(vec![false, true, true])));
    }
}
