//! Sums over a fixed number of lanes, in an order that depends on neither the machine nor the number of
//! threads.

/// Numbers summed in parallel: enough for two AVX-512 registers.
const LANES: usize = 16;

/// Sum of the values.
pub fn sum(values: &[f64]) -> f64 {
    let mut sums = [0.0_f64; LANES];
    for chunk in values.chunks(LANES) {
        for (lane, value) in chunk.iter().enumerate() {
            sums[lane] += value;
        }
    }
    sum_lanes(sums)
}

/// `sum_i a_i b_i`.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a_groups, a_rest), (b_groups, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0_f64; LANES];
    for (a, b) in a_groups.iter().zip(b_groups) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    for (lane, (a, b)) in a_rest.iter().zip(b_rest).enumerate() {
        sums[lane] += a * b;
    }
    sum_lanes(sums)
}

/// Adds the halves until one number is left.
fn sum_lanes(mut sums: [f64; LANES]) -> f64 {
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            sums[lane] += sums[lane + width];
        }
        width /= 2;
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_over_lanes_equal_plain_ones() {
        for n in [0, 1, 15, 16, 17, 100] {
            let a: Vec<f64> = (0..n).map(f64::from).collect();
            let b: Vec<f64> = (0..n).map(|i| 1.0 / f64::from(i + 1)).collect();
            let plain: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
            assert!((dot(&a, &b) - plain).abs() < 1e-10);
            assert!((sum(&b) - b.iter().sum::<f64>()).abs() < 1e-10);
        }
    }
}
