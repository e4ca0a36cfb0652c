//! Inner loops for products of a few rows of a symmetric matrix with a vector.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use super::coordinates::Coordinate;
use crate::simd::{self, DOUBLES, Kernel, Lanes};

/// Rows processed at a time: their entries share the loads of the vector and of the mirrored product.
pub const ROW_GROUP: usize = 4;

/// An entry of the matrix, stored or computed for one product.
pub trait Entry: Copy + Default + Send + Sync {
    /// Number type of short sums of products with such entries.
    type Number: Copy + Default + Send + Sync + Into<f64>;

    /// Converts an entry of the vector.
    fn number(value: f64) -> Self::Number;

    /// For [`ROW_GROUP`] rows right of the diagonal: returns `sum_j row_j x_j` of each, and adds the same
    /// entries' contribution below the diagonal, `sum_i weight_i row_ij`, to `mirrored_j`.
    fn add_products(
        rows: &[Self],
        x: &[Self::Number],
        weights: [Self::Number; ROW_GROUP],
        mirrored: &mut [Self::Number],
    ) -> [f64; ROW_GROUP];
}

/// Row by row, summed in f64.
impl<T: Coordinate> Entry for T {
    type Number = f64;

    fn number(value: f64) -> f64 {
        value
    }

    fn add_products(
        rows: &[Self],
        x: &[f64],
        weights: [f64; ROW_GROUP],
        mirrored: &mut [f64],
    ) -> [f64; ROW_GROUP] {
        let rows = std::array::from_fn(|row| &rows[row * x.len()..(row + 1) * x.len()]);
        simd::run(RowsTimesVector { rows, x, weights, mirrored: &mut mirrored[..x.len()] })
    }
}

struct RowsTimesVector<'a, T> {
    /// Each as long as `x`.
    rows: [&'a [T]; ROW_GROUP],
    /// The vector at the rows' columns.
    x: &'a [f64],
    /// The vector at the rows themselves.
    weights: [f64; ROW_GROUP],
    /// The product at the rows' columns.
    mirrored: &'a mut [f64],
}

impl<T: Coordinate> Kernel for RowsTimesVector<'_, T> {
    type Output = [f64; ROW_GROUP];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let rows = self.rows.map(
            #[inline(always)]
            |row| row[..self.x.len()].as_chunks::<DOUBLES>(),
        );
        let (x_groups, x_rest) = self.x.as_chunks::<DOUBLES>();
        let (below_groups, below_rest) = self.mirrored.as_chunks_mut::<DOUBLES>();
        let [w0, w1, w2, w3] = self.weights.map(
            #[inline(always)]
            |weight| lanes.splat_doubles(weight),
        );
        let [mut s0, mut s1, mut s2, mut s3] = [lanes.splat_doubles(0.0); ROW_GROUP];
        let entries = rows[0].0.iter().zip(rows[1].0).zip(rows[2].0).zip(rows[3].0);
        for ((x, below), (((e0, e1), e2), e3)) in x_groups.iter().zip(below_groups).zip(entries) {
            let (factor, mut sum) = (lanes.load_doubles(x), lanes.load_doubles(below));
            let [e0, e1, e2, e3] =
                [T::load(lanes, e0), T::load(lanes, e1), T::load(lanes, e2), T::load(lanes, e3)];
            s0 = lanes.multiply_add_doubles(e0, factor, s0);
            s1 = lanes.multiply_add_doubles(e1, factor, s1);
            s2 = lanes.multiply_add_doubles(e2, factor, s2);
            s3 = lanes.multiply_add_doubles(e3, factor, s3);
            sum = lanes.multiply_add_doubles(e0, w0, sum);
            sum = lanes.multiply_add_doubles(e1, w1, sum);
            sum = lanes.multiply_add_doubles(e2, w2, sum);
            sum = lanes.multiply_add_doubles(e3, w3, sum);
            lanes.store_doubles(sum, below);
        }
        let mut sums = [[0.0; DOUBLES]; ROW_GROUP];
        for (sum, register) in sums.iter_mut().zip([s0, s1, s2, s3]) {
            lanes.store_doubles(register, sum);
        }
        for (lane, (x, below)) in x_rest.iter().zip(below_rest).enumerate() {
            for (row, sums) in sums.iter_mut().enumerate() {
                let entry: f64 = rows[row].1[lane].into();
                sums[lane] += entry * x;
                *below += entry * self.weights[row];
            }
        }
        sums.map(
            #[inline(always)]
            |lanes| lanes.iter().sum(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_times_vector_equal_plain_sums() {
        for n in [0, 1, 7, 8, 9, 40] {
            let entry = |row: usize, j: usize| (row * 31 + j * 17) as f32 * 0.125;
            let rows: Vec<f32> = (0..ROW_GROUP).flat_map(|row| (0..n).map(move |j| entry(row, j))).collect();
            let x: Vec<f64> = (0..n).map(|j| 0.25 * j as f64 - 1.0).collect();
            let weights = [1.0, -2.0, 0.5, 4.0];
            let mut mirrored = vec![3.0; n];
            let sums = Entry::add_products(&rows, &x, weights, &mut mirrored);
            for (row, total) in sums.iter().enumerate() {
                let plain: f64 = (0..n).map(|j| f64::from(entry(row, j)) * x[j]).sum();
                assert!((total - plain).abs() < 1e-9);
            }
            for (j, below) in mirrored.iter().enumerate() {
                let plain: f64 = (0..ROW_GROUP).map(|row| f64::from(entry(row, j)) * weights[row]).sum();
                assert!((below - 3.0 - plain).abs() < 1e-9);
            }
        }
    }
}
