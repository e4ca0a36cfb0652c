//! The distribution of the ratio of two variances (Fisher's F).

/// Most terms of the continued fraction; some dozens suffice.
const MOST_TERMS: u32 = 1000;
/// Replaces a denominator of zero.
const TINY: f64 = 1e-300;

/// The ratio of a variance of `count` observations to an independent one of `freedom` observations.
#[derive(Debug, Clone, Copy)]
pub struct VarianceRatio {
    count: f64,
    freedom: f64,
    /// Beta function of half of each.
    beta: f64,
}

impl VarianceRatio {
    /// The distribution for numbers of observations of at least one.
    pub fn new(count: usize, freedom: usize) -> Self {
        Self { count: count as f64, freedom: freedom as f64, beta: beta_of_halves(count, freedom) }
    }

    /// Probability of a larger ratio: the regularized incomplete beta function `I_x(freedom / 2, count / 2)`
    /// at `x = freedom / (freedom + count ratio)`.
    pub fn tail(&self, ratio: f64) -> f64 {
        let excess = self.count * ratio.max(0.0);
        let (x, y) = (self.freedom / (self.freedom + excess), excess / (self.freedom + excess));
        let (a, b) = (self.freedom / 2.0, self.count / 2.0);
        let factor = x.powf(a) * y.powf(b) / self.beta;
        // The fraction converges fast below the mean of the distribution.
        if x * (a + b + 2.0) < a + 1.0 {
            factor / (a * continued_fraction(a, b, x))
        } else {
            1.0 - factor / (b * continued_fraction(b, a, y))
        }
    }
}

/// `B(i / 2, j / 2)` from `B(1/2, 1/2) = pi`, `B(1/2, 1) = 2`, `B(1, 1) = 1` and
/// `B(a + 1, b) = B(a, b) a / (a + b)`.
fn beta_of_halves(i: usize, j: usize) -> f64 {
    let mut value = match (i % 2, j % 2) {
        (1, 1) => std::f64::consts::PI,
        (0, 0) => 1.0,
        _ => 2.0,
    };
    let (mut a, mut b) = (if i % 2 == 1 { 0.5 } else { 1.0 }, if j % 2 == 1 { 0.5 } else { 1.0 });
    for _ in 0..(i - 1) / 2 {
        value *= a / (a + b);
        a += 1.0;
    }
    for _ in 0..(j - 1) / 2 {
        value *= b / (a + b);
        b += 1.0;
    }
    value
}

/// `1 + d_1 / (1 + d_2 / (1 + ...))` of the incomplete beta function (M. Abramowitz, I. Stegun, 26.5.8),
/// forwards (W. Lentz's method).
fn continued_fraction(a: f64, b: f64, x: f64) -> f64 {
    let nonzero = |value: f64| if value.abs() < TINY { TINY } else { value };
    let (mut value, mut upper, mut lower) = (1.0, 1.0, 0.0);
    for term in 1..MOST_TERMS {
        let m = f64::from(term / 2);
        let d = if term % 2 == 0 {
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        };
        upper = nonzero(1.0 + d / upper);
        lower = 1.0 / nonzero(1.0 + d * lower);
        let change: f64 = upper * lower;
        value *= change;
        if (change - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_scipy() {
        // scipy.stats.f.sf(ratio, count, freedom)
        for (count, freedom, ratio, expected) in [
            (1, 1, 0.025_085_6, 9.000_000_606_53e-1),
            (1, 1, 4052.18, 1.000_000_085_8e-2),
            (1, 1, 4.052_85e17, 9.999_996_725_38e-10),
            (2, 2, 0.111_111, 9.000_000_9e-1),
            (2, 2, 99.0, 1.0e-2),
            (2, 2, 1_000_000_000.0, 9.999_999_99e-10),
            (3, 1, 0.180_56, 9.000_001_109_46e-1),
            (3, 1, 5403.35, 1.000_000_186_33e-2),
            (3, 1, 5.4038e17, 9.999_996_725_38e-10),
            (3, 6, 0.189_224, 9.000_002_486_15e-1),
            (3, 6, 9.779_54, 9.999_995_629_55e-3),
            (3, 6, 2594.0, 9.999_964_921_17e-10),
            (6, 12, 0.344_267, 9.000_001_199_39e-1),
            (6, 12, 4.820_57, 1.000_002_739_05e-2),
            (6, 12, 107.633, 1.000_007_891_23e-9),
            (9, 75, 0.454_773, 9.000_001_139_93e-1),
            (9, 75, 2.653_43, 9.999_968_679_48e-3),
            (9, 75, 9.761_57, 1.000_002_195_9e-9),
            (3, 2990, 0.194_778, 8.999_999_487_18e-1),
            (3, 2990, 3.788_17, 1.000_001_638_89e-2),
            (3, 2990, 15.0572, 1.000_003_227_18e-9),
            (84, 10, 0.596_777, 8.999_997_895_85e-1),
            (84, 10, 4.033_32, 9.999_988_313_04e-3),
            (84, 10, 125.863, 9.999_975_620_44e-10),
            (2988, 10, 0.624_666, 9.000_000_319_82e-1),
            (2988, 10, 3.912_54, 9.999_975_605_72e-3),
            (2988, 10, 120.421, 9.999_817_454_23e-10),
        ] {
            let tail = VarianceRatio::new(count, freedom).tail(ratio);
            assert!((tail / expected - 1.0).abs() < 1e-10, "{count}, {freedom}, {ratio}: {tail:e}");
        }
    }

    #[test]
    fn no_ratio_is_below_none() {
        for (count, freedom) in [(1, 1), (3, 13), (3, 2990), (84, 10)] {
            let ratio = VarianceRatio::new(count, freedom);
            assert!([-1.0, 0.0].iter().all(|&value| (ratio.tail(value) - 1.0).abs() < 1e-15));
            assert!(ratio.tail(1e300) < 1e-100);
            assert!((ratio.tail(1e-300) - 1.0).abs() < 1e-12);
        }
    }
}
