//! Which pages of a database belong to something.

/// What is known of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Open,
    /// Said to be unused, or to say who points where. What a tree or a row leads to is believed over it.
    Spare,
    Held,
    /// Given back by a row whose rest it turned out not to be.
    Returned,
    /// Held again, for good: so that no page is walked over and over.
    HeldAgain,
}

/// The pages of a database by their place among those that there are.
#[derive(Debug)]
pub(super) struct Claims {
    pages: Vec<State>,
    count: u64,
    contested: u64,
}

impl Claims {
    pub(super) fn new(pages: usize) -> Claims {
        Claims { pages: vec![State::Open; pages], count: 0, contested: 0 }
    }

    /// Whether the page belongs to something, be it by hearsay.
    pub(super) fn has(&self, page: usize) -> bool {
        self.pages.get(page).is_some_and(|state| !matches!(state, State::Open | State::Returned))
    }

    /// How many pages belong to something.
    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// Pages that were said to be spare and are not.
    pub(super) fn contested(&self) -> u64 {
        self.contested
    }

    /// False if the page belongs to something already.
    pub(super) fn claim(&mut self, page: usize) -> bool {
        let Some(state) = self.pages.get_mut(page) else { return false };
        match state {
            State::Open => (*state, self.count) = (State::Held, self.count + 1),
            State::Returned => (*state, self.count) = (State::HeldAgain, self.count + 1),
            State::Spare => (*state, self.contested) = (State::Held, self.contested + 1),
            State::Held | State::HeldAgain => return false,
        }
        true
    }

    /// Takes hearsay: false if the page belongs to something already.
    pub(super) fn spare(&mut self, page: usize) -> bool {
        let Some(state) = self.pages.get_mut(page).filter(|state| **state == State::Open) else { return false };
        (*state, self.count) = (State::Spare, self.count + 1);
        true
    }

    /// Gives a page back. False if that was done before: then it stays.
    pub(super) fn give_back(&mut self, page: usize) -> bool {
        let Some(state) = self.pages.get_mut(page).filter(|state| **state == State::Held) else { return false };
        (*state, self.count) = (State::Returned, self.count - 1);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_leads_to_a_page_is_believed_over_what_is_said_of_it_and_a_page_is_given_back_once() {
        let mut claims = Claims::new(3);
        assert!(claims.spare(1) && !claims.spare(1) && claims.has(1));
        assert!(claims.claim(1) && !claims.claim(1));
        assert_eq!((claims.count(), claims.contested()), (1, 1));
        assert!(claims.give_back(1) && !claims.has(1) && !claims.give_back(1));
        assert!(!claims.spare(1) && claims.claim(1) && !claims.give_back(1) && claims.has(1));
        assert_eq!((claims.count(), claims.claim(3), claims.spare(3)), (1, false, false));
    }
}
