//! Inner loops over pairs, compiled for the widest vector instructions that the machine has.
//!
//! Every function here is plain Rust that the compiler vectorises; [`dispatch`] picks the version
//! at run time. Sums are taken over a fixed number of lanes, so results do not depend on threads.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]
#![expect(clippy::needless_bitwise_bool, reason = "`||` is a branch, which stops vectorisation")]

use crate::simd::dispatch::dispatch;
use crate::simd::lanes::{LANES as GROUP, LaneWork, Lanes, SINGLES, with_lanes};

/// Lanes of a blocked sum: enough for two AVX-512 registers of f64.
const LANES: usize = 16;

/// A storage type for pair scores.
pub trait Element: Copy + Default + Send + Sync + PartialOrd + 'static {
    /// Rounds to this type.
    fn from_f64(value: f64) -> Self;
    /// Widens to f64.
    fn to_f64(self) -> f64;
    /// A group of entries, widened.
    fn load<L: Lanes>(lanes: L, entries: &[Self; GROUP]) -> L::Group;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// `(x1 - x2)^2 + (y1 - y2)^2 + (z1 - z2)^2`.
    fn squared_distance(a: [Self; 3], b: [Self; 3]) -> Self;
    /// `|a - b|`.
    fn absolute_difference(a: Self, b: Self) -> Self;
    /// `min(a, b) / max(a, b)`.
    fn ratio(a: Self, b: Self) -> Self;
    /// The number 1.
    const ONE: Self;
    /// Writes the distance ratios of correspondence `i` with those from `first` on; whole groups of
    /// [`SINGLES`] in f32.
    fn fill_ratios(source: &Side<Self>, target: &Side<Self>, i: usize, first: usize, row: &mut [Self]);
}

macro_rules! element {
    ($float:ty, $load:ident, $fill_ratios:path) => {
        impl Element for $float {
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value as Self
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn load<L: Lanes>(lanes: L, entries: &[Self; GROUP]) -> L::Group {
                lanes.$load(entries)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            #[inline(always)]
            fn squared_distance(a: [Self; 3], b: [Self; 3]) -> Self {
                let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
                d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
            }
            #[inline(always)]
            fn absolute_difference(a: Self, b: Self) -> Self {
                (a - b).abs()
            }
            #[inline(always)]
            fn ratio(a: Self, b: Self) -> Self {
                a.min(b) / a.max(b)
            }
            const ONE: Self = 1.0;
            fn fill_ratios(
                source: &Side<Self>,
                target: &Side<Self>,
                i: usize,
                first: usize,
                row: &mut [Self],
            ) {
                $fill_ratios(source, target, i, first, row);
            }
        }
    };
}
element!(f32, load_f32, fill_ratios_single);
element!(f64, load, fill_ratios_double);

fn fill_ratios_double(source: &Side<f64>, target: &Side<f64>, i: usize, first: usize, row: &mut [f64]) {
    dispatch(
        #[inline(always)]
        || fill_row(source, target, i, first, row, |ds, dt| f64::ratio(ds, dt).sqrt()),
    );
}

fn fill_ratios_single(source: &Side<f32>, target: &Side<f32>, i: usize, first: usize, row: &mut [f32]) {
    let part = first..first + row.len();
    let all = [&source.x, &source.y, &source.z, &target.x, &target.y, &target.z];
    let (point, axes) = (all.map(|axis| axis[i]), all.map(|axis| &axis[part.clone()]));
    with_lanes(FillRatios { point, axes, row });
}

/// Coordinates of one side of the correspondences, in the storage type.
#[derive(Debug, Clone)]
pub struct Side<T> {
    /// x coordinates.
    pub x: Vec<T>,
    /// y coordinates.
    pub y: Vec<T>,
    /// z coordinates.
    pub z: Vec<T>,
    /// Square of the length below which an edge counts as zero.
    pub zero_squared: T,
}

impl<T: Element> Side<T> {
    #[inline(always)]
    fn get(&self, i: usize) -> [T; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }
}

/// Writes `score(ds_ij^2, dt_ij^2)` for j = first, first + 1, ... into `row`; `score` sees squared
/// lengths. Where an edge counts as zero the score is 0.
#[inline(always)]
pub fn fill_row<T: Element>(
    source: &Side<T>,
    target: &Side<T>,
    i: usize,
    first: usize,
    row: &mut [T],
    score: impl Fn(T, T) -> T,
) {
    let n = row.len();
    let (p, q) = (source.get(i), target.get(i));
    let part = first..first + n;
    let (sx, sy, sz) = (&source.x[part.clone()], &source.y[part.clone()], &source.z[part.clone()]);
    let (tx, ty, tz) = (&target.x[part.clone()], &target.y[part.clone()], &target.z[part]);
    let zero = T::default();
    for j in 0..n {
        let ds = T::squared_distance(p, [sx[j], sy[j], sz[j]]);
        let dt = T::squared_distance(q, [tx[j], ty[j], tz[j]]);
        let value = score(ds, dt);
        let coincident = (ds <= source.zero_squared) | (dt <= target.zero_squared);
        row[j] = if coincident { zero } else { value };
    }
}

/// `sum_j row_j x_j` in f64, over a fixed number of lanes.
#[inline(always)]
pub fn dot<T: Element>(row: &[T], x: &[f64]) -> f64 {
    let mut sums = [0.0_f64; LANES];
    let rows = row.chunks_exact(LANES);
    let values = x.chunks_exact(LANES);
    let (row_tail, value_tail) = (rows.remainder(), values.remainder());
    for (a, b) in rows.zip(values) {
        for lane in 0..LANES {
            sums[lane] += a[lane].to_f64() * b[lane];
        }
    }
    for (lane, (a, b)) in row_tail.iter().zip(value_tail).enumerate() {
        sums[lane] += a.to_f64() * b;
    }
    sum_lanes(sums)
}

/// Rows that [`RowsTimesVector`] works on at a time: their entries share the loads of `x` and `mirrored`.
pub const ROW_GROUP: usize = 4;

/// For rows of a symmetric matrix, right of its diagonal: `sum_j row_j x_j` of each, and onto
/// `mirrored_j` what the same entries add below the diagonal, `sum_i weight_i row_ij`.
pub struct RowsTimesVector<'a, T> {
    /// As long as `x`, each.
    pub rows: [&'a [T]; ROW_GROUP],
    /// The vector at the rows' columns.
    pub x: &'a [f64],
    /// The vector at the rows themselves.
    pub weights: [f64; ROW_GROUP],
    /// The product at the rows' columns.
    pub mirrored: &'a mut [f64],
}

impl<T: Element> LaneWork for RowsTimesVector<'_, T> {
    type Output = [f64; ROW_GROUP];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let rows = self.rows.map(
            #[inline(always)]
            |row| row[..self.x.len()].as_chunks::<GROUP>(),
        );
        let (x_groups, x_rest) = self.x.as_chunks::<GROUP>();
        let (below_groups, below_rest) = self.mirrored.as_chunks_mut::<GROUP>();
        let [w0, w1, w2, w3] = self.weights.map(
            #[inline(always)]
            |weight| lanes.splat(weight),
        );
        let [mut s0, mut s1, mut s2, mut s3] = [lanes.splat(0.0); ROW_GROUP];
        let entries = rows[0].0.iter().zip(rows[1].0).zip(rows[2].0).zip(rows[3].0);
        for ((x, below), (((e0, e1), e2), e3)) in x_groups.iter().zip(below_groups).zip(entries) {
            let (factor, mut sum) = (lanes.load(x), lanes.load(below));
            let [e0, e1, e2, e3] =
                [T::load(lanes, e0), T::load(lanes, e1), T::load(lanes, e2), T::load(lanes, e3)];
            s0 = lanes.multiply_add(e0, factor, s0);
            s1 = lanes.multiply_add(e1, factor, s1);
            s2 = lanes.multiply_add(e2, factor, s2);
            s3 = lanes.multiply_add(e3, factor, s3);
            sum = lanes.multiply_add(e0, w0, sum);
            sum = lanes.multiply_add(e1, w1, sum);
            sum = lanes.multiply_add(e2, w2, sum);
            sum = lanes.multiply_add(e3, w3, sum);
            lanes.store(sum, below);
        }
        let mut sums = [[0.0; GROUP]; ROW_GROUP];
        for (sum, register) in sums.iter_mut().zip([s0, s1, s2, s3]) {
            lanes.store(register, sum);
        }
        for (lane, (x, below)) in x_rest.iter().zip(below_rest).enumerate() {
            for (row, sums) in sums.iter_mut().enumerate() {
                let entry = rows[row].1[lane].to_f64();
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

/// An entry of a row whose products are summed in f32.
pub trait SingleEntry: Copy + Default + Send + Sync + 'static {
    /// A group of entries as numbers.
    fn load<L: Lanes>(lanes: L, entries: &[Self; SINGLES]) -> L::Singles;
}

impl SingleEntry for f32 {
    #[inline(always)]
    fn load<L: Lanes>(lanes: L, entries: &[Self; SINGLES]) -> L::Singles {
        lanes.load_singles(entries)
    }
}

impl SingleEntry for u16 {
    #[inline(always)]
    fn load<L: Lanes>(lanes: L, entries: &[Self; SINGLES]) -> L::Singles {
        lanes.load_u16(entries)
    }
}

/// Entries of [`ROW_GROUP`] rows in one run of memory: [`SINGLES`] columns of the first, then of the second, ...
pub const INTERLEAVED: usize = ROW_GROUP * SINGLES;

/// [`RowsTimesVector`] in f32, for whole groups of [`SINGLES`] columns. Its sums are short ones: the caller
/// adds those of tiles in f64.
pub struct RowsTimesVectorSingle<'a, T> {
    /// [`INTERLEAVED`] entries for every group of columns.
    pub entries: &'a [T],
    /// The vector at the rows' columns.
    pub x: &'a [f32],
    /// The vector at the rows themselves.
    pub weights: [f32; ROW_GROUP],
    /// The product at the rows' columns.
    pub mirrored: &'a mut [f32],
}

impl<T: SingleEntry> LaneWork for RowsTimesVectorSingle<'_, T> {
    type Output = [f64; ROW_GROUP];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let x_groups = self.x.as_chunks::<SINGLES>().0;
        let below_groups = self.mirrored.as_chunks_mut::<SINGLES>().0;
        let [w0, w1, w2, w3] = self.weights;
        let (w0, w1) = (lanes.splat_singles(w0), lanes.splat_singles(w1));
        let (w2, w3) = (lanes.splat_singles(w2), lanes.splat_singles(w3));
        let [mut s0, mut s1, mut s2, mut s3] = [lanes.splat_singles(0.0); ROW_GROUP];
        let groups = self.entries.as_chunks::<INTERLEAVED>().0;
        for ((x, below), entries) in x_groups.iter().zip(below_groups).zip(groups) {
            let [e0, e1, e2, e3] = entries.as_chunks::<SINGLES>().0 else { continue };
            let (factor, mut sum) = (lanes.load_singles(x), lanes.load_singles(below));
            let e0 = T::load(lanes, e0);
            s0 = lanes.multiply_add_singles(e0, factor, s0);
            sum = lanes.multiply_add_singles(e0, w0, sum);
            let e1 = T::load(lanes, e1);
            s1 = lanes.multiply_add_singles(e1, factor, s1);
            sum = lanes.multiply_add_singles(e1, w1, sum);
            let e2 = T::load(lanes, e2);
            s2 = lanes.multiply_add_singles(e2, factor, s2);
            sum = lanes.multiply_add_singles(e2, w2, sum);
            let e3 = T::load(lanes, e3);
            s3 = lanes.multiply_add_singles(e3, factor, s3);
            sum = lanes.multiply_add_singles(e3, w3, sum);
            lanes.store_singles(sum, below);
        }
        [
            f64::from(lanes.sum_singles(s0)),
            f64::from(lanes.sum_singles(s1)),
            f64::from(lanes.sum_singles(s2)),
            f64::from(lanes.sum_singles(s3)),
        ]
    }
}

/// Coordinates of correspondences in f32: source x, y, z, target x, y, z.
pub type SingleAxes<T> = [T; 6];

/// Writes `min(ds, dt) / max(ds, dt)` of a correspondence with those of `axes`, in whole groups of
/// [`SINGLES`]; 0 where either length is.
pub struct FillRatios<'a> {
    /// Coordinates of the correspondence.
    pub point: SingleAxes<f32>,
    /// Coordinates of the others.
    pub axes: SingleAxes<&'a [f32]>,
    /// The ratios.
    pub row: &'a mut [f32],
}

/// Keeps the ratio at 0 where a length is; far below the product of any two squared lengths in f32.
const TINY: f32 = 1e-36;

impl LaneWork for FillRatios<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let [px, py, pz, qx, qy, qz] = self.point;
        let p = [lanes.splat_singles(px), lanes.splat_singles(py), lanes.splat_singles(pz)];
        let q = [lanes.splat_singles(qx), lanes.splat_singles(qy), lanes.splat_singles(qz)];
        let [xs, ys, zs, us, vs, ws] = self.axes.map(
            #[inline(always)]
            |axis| axis[..self.row.len()].as_chunks::<SINGLES>().0,
        );
        let tiny = lanes.splat_singles(TINY);
        let others = xs.iter().zip(ys).zip(zs).zip(us).zip(vs).zip(ws);
        for (entries, (((((x, y), z), u), v), w)) in
            self.row.as_chunks_mut::<SINGLES>().0.iter_mut().zip(others)
        {
            let ds = squared_length(lanes, p, [x, y, z]);
            let dt = squared_length(lanes, q, [u, v, w]);
            let product = lanes.multiply_add_singles(ds, dt, tiny);
            let ratio = lanes.multiply_singles(lanes.min_singles(ds, dt), lanes.reciprocal_sqrt(product));
            lanes.store_singles(ratio, entries);
        }
    }
}

#[inline(always)]
fn squared_length<L: Lanes>(lanes: L, from: [L::Singles; 3], to: [&[f32; SINGLES]; 3]) -> L::Singles {
    let x = lanes.subtract_singles(lanes.load_singles(to[0]), from[0]);
    let y = lanes.subtract_singles(lanes.load_singles(to[1]), from[1]);
    let z = lanes.subtract_singles(lanes.load_singles(to[2]), from[2]);
    let sum = lanes.multiply_add_singles(y, y, lanes.multiply_singles(z, z));
    lanes.multiply_add_singles(x, x, sum)
}

#[inline(always)]
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

/// Sum over a fixed number of lanes.
pub fn sum(values: &[f64]) -> f64 {
    let mut sums = [0.0_f64; LANES];
    for chunk in values.chunks(LANES) {
        for (lane, value) in chunk.iter().enumerate() {
            sums[lane] += value;
        }
    }
    sum_lanes(sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocked_dot_equals_the_plain_one() {
        for n in [0, 1, 15, 16, 17, 100] {
            let row: Vec<f32> = (0..n).map(|i| i as f32).collect();
            let x: Vec<f64> = (0..n).map(|i| 1.0 / f64::from(i + 1)).collect();
            let plain: f64 = row.iter().zip(&x).map(|(&a, b)| f64::from(a) * b).sum();
            assert!(
                (dispatch(
                    #[inline(always)]
                    || dot(&row, &x)
                ) - plain)
                    .abs()
                    < 1e-10
            );
        }
    }

    #[test]
    fn rows_times_vector_equal_plain_sums() {
        for n in [0, 1, 7, 8, 9, 40] {
            let entry = |row: usize, j: usize| (row * 31 + j * 17) as f32 * 0.125;
            let rows: [Vec<f32>; ROW_GROUP] = [0, 1, 2, 3].map(|row| (0..n).map(|j| entry(row, j)).collect());
            let x: Vec<f64> = (0..n).map(|j| 0.25 * j as f64 - 1.0).collect();
            let weights = [1.0, -2.0, 0.5, 4.0];
            let mut mirrored = vec![3.0; n];
            let rows = [&*rows[0], &*rows[1], &*rows[2], &*rows[3]];
            let sums = with_lanes(RowsTimesVector { rows, x: &x, weights, mirrored: &mut mirrored });
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

    #[test]
    fn coincident_points_score_zero() {
        let side =
            |x: Vec<f64>| Side { y: vec![0.0; x.len()], z: vec![0.0; x.len()], x, zero_squared: 1e-20 };
        let (source, target) = (side(vec![0.0, 1.0, 2.0]), side(vec![0.0, 0.0, 1.0]));
        let mut row = vec![0.0; 3];
        dispatch(
            #[inline(always)]
            || fill_row(&source, &target, 0, 0, &mut row, |a, b| f64::ratio(a, b).sqrt()),
        );
        assert_eq!(row, [0.0, 0.0, 0.5]);
    }
}
