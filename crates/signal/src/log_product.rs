//! The logarithm of a product of many factors.

/// A sum of logarithms that evaluates few logarithms.
pub(crate) struct LogProduct {
    product: f64,
    factors: u32,
    sum: f64,
}

impl Default for LogProduct {
    fn default() -> LogProduct {
        LogProduct { product: 1.0, factors: 0, sum: 0.0 }
    }
}

impl LogProduct {
    /// A product outside these limits is replaced by its logarithm.
    const LARGEST: f64 = 1e100;

    #[inline]
    pub(crate) fn times(&mut self, factor: f64) {
        self.product *= factor;
        self.factors += 1;
        let beyond = !(1.0 / Self::LARGEST..Self::LARGEST).contains(&self.product);
        if self.factors == 16 || beyond {
            self.sum += self.product.ln();
            (self.product, self.factors) = (1.0, 0);
        }
    }

    pub(crate) fn sum(&self) -> f64 {
        self.sum + self.product.ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The product itself would be 0 or infinite.
    #[test]
    fn the_sum_of_many_logarithms_is_exact_where_the_product_overflows() {
        for (factor, count) in [(1e40, 50), (1e-40, 50), (1.5, 1000), (0.999, 40), (1e200, 3), (1e-300, 2)] {
            let mut product = LogProduct::default();
            (0..count).for_each(|_| product.times(factor));
            let expected = f64::from(count) * f64::ln(factor);
            assert!((product.sum() - expected).abs() < 1e-12 * expected.abs(), "{factor}: {}", product.sum());
        }
    }
}
