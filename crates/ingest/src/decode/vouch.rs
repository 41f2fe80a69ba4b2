//! Counts the messages that a correct checksum of the log protects.

/// The checksum that protects the bytes of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Vouch {
    /// None.
    #[default]
    Nothing,
    /// A checksum that was correct.
    Checksum,
    /// A checksum after all messages, not verified yet.
    Later,
}

/// The number of messages of a topic that a checksum protects.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Vouched {
    sure: u64,
    later: u64,
}

impl Vouched {
    pub(crate) fn count(&mut self, by: Vouch) {
        match by {
            Vouch::Nothing => {}
            Vouch::Checksum => self.sure += 1,
            Vouch::Later => self.later += 1,
        }
    }

    /// Settles whether the checksum after all messages is correct.
    pub(crate) fn settle(&mut self, is_right: bool) {
        let later = std::mem::take(&mut self.later);
        self.sure += if is_right { later } else { 0 };
    }

    pub(crate) fn messages(self) -> u64 {
        self.sure
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checksum_after_the_messages_counts_once_it_is_verified() {
        let mut vouched = Vouched::default();
        [Vouch::Nothing, Vouch::Checksum, Vouch::Later, Vouch::Later].into_iter().for_each(|by| vouched.count(by));
        assert_eq!(vouched.messages(), 1);
        vouched.settle(true);
        assert_eq!(vouched.messages(), 3);
        vouched.count(Vouch::Later);
        vouched.settle(false);
        assert_eq!(vouched.messages(), 3);
    }
}
