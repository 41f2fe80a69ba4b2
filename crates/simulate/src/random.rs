//! Random numbers, drawn separately for each purpose.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// A separate generator for each purpose: random numbers of one sensor do not affect another. PCG XSL RR 128/64, whose
/// numbers are the same in every version and on every machine.
pub(crate) fn generator(seed: u64, purpose: &str) -> Pcg64 {
    // FNV-1a of the purpose; seed_from_u64 spreads the sum over the whole state.
    let hash = purpose.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    Pcg64::seed_from_u64(hash ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

/// A number of the standard normal distribution.
pub(crate) fn normal(random: &mut Pcg64) -> f64 {
    StandardNormal.sample(random)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn the_first_numbers_of_the_generator_never_change() {
        // PCG XSL RR 128/64 and its seeding by PCG XSH RR 64/32, reimplemented in Python.
        let mut random = generator(7, "circuit");
        let first = [0x021a_718f_d40a_9846, 0x11db_1abf_8972_ecd1, 0x88f1_22cb_58fd_bd48];
        assert_eq!([0, 1, 2].map(|_| random.next_u64()), first);
    }

    #[test]
    fn another_seed_or_another_purpose_draws_other_numbers() {
        let [a, b, c] = [(7, "circuit"), (8, "circuit"), (7, "position")].map(|(s, p)| generator(s, p).next_u64());
        assert!(a != b && b != c && a != c);
    }
}
