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
