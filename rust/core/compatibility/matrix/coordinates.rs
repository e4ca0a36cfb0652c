//! Rows of pair scores from the coordinates of both sides, in f64 or in f32.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]
#![expect(clippy::needless_bitwise_bool, reason = "`||` is a branch, which stops vectorisation")]

use std::ops::{Add, Mul, Sub};

use crate::error::Result;
use crate::memory;
use crate::simd::{self, DOUBLES, Kernel, Lanes, SINGLES};

/// The number type of coordinates, and of the scores computed from them.
pub trait Coordinate:
    Copy
    + Default
    + Send
    + Sync
    + PartialOrd
    + From<bool>
    + Into<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + 'static
{
    /// Rounds to this type.
    fn from_f64(value: f64) -> Self;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// A group of scores in f64.
    fn load<L: Lanes>(lanes: L, scores: &[Self; DOUBLES]) -> L::Doubles;
    /// Writes the distance ratios of correspondence `i` with those from `first` on, to the length of `row`;
    /// in f32 whole groups of [`SINGLES`].
    fn fill_ratios(sides: &Sides<Self>, i: usize, first: usize, row: &mut [Self]);
}

impl Coordinate for f64 {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn load<L: Lanes>(lanes: L, scores: &[Self; DOUBLES]) -> L::Doubles {
        lanes.load_doubles(scores)
    }

    fn fill_ratios(sides: &Sides<Self>, i: usize, first: usize, row: &mut [Self]) {
        simd::run(
            #[inline(always)]
            || {
                fill_row(
                    sides,
                    i,
                    first,
                    row,
                    #[inline(always)]
                    |ds, dt| (ds.min(dt) / ds.max(dt)).sqrt(),
                );
            },
        );
    }
}

impl Coordinate for f32 {
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value as Self
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn load<L: Lanes>(lanes: L, scores: &[Self; DOUBLES]) -> L::Doubles {
        lanes.load_widened(scores)
    }

    fn fill_ratios(sides: &Sides<Self>, i: usize, first: usize, row: &mut [Self]) {
        let part = first..first + row.len();
        let axes = sides.axes.each_ref().map(|axis| &axis[part.clone()]);
        simd::run(FillRatios { point: sides.at(i), axes, row });
    }
}

/// Coordinates of all correspondences.
#[derive(Debug, Clone)]
pub struct Sides<T> {
    /// Source x, y, z, then target x, y, z; padded to whole groups of [`SINGLES`].
    axes: [Vec<T>; 6],
    /// Squared zero lengths of edges, in the source and in the target.
    pub zero_squared: [T; 2],
}

impl<T: Coordinate> Sides<T> {
    /// Coordinates from the axes, which need not be whole groups.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(axes: [Vec<T>; 6], zero_squared: [T; 2]) -> Result<Self> {
        let filled_up = |mut axis: Vec<T>| {
            let whole_groups = axis.len().next_multiple_of(SINGLES);
            memory::resize(&mut axis, whole_groups, T::default())?;
            Ok(axis)
        };
        Ok(Self { axes: memory::try_map(axes, filled_up)?, zero_squared })
    }

    /// The correspondences at `indices`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn subset(&self, indices: &[usize]) -> Result<Self> {
        let pick = |axis: &Vec<T>| memory::collect(indices.iter().map(|&i| axis[i]));
        Self::new(memory::try_map(self.axes.each_ref(), pick)?, self.zero_squared)
    }

    #[inline(always)]
    fn at(&self, i: usize) -> [T; 6] {
        let [x, y, z, u, v, w] = &self.axes;
        [x[i], y[i], z[i], u[i], v[i], w[i]]
    }
}

impl Sides<f64> {
    /// Converts to f32.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn to_single(&self) -> Result<Sides<f32>> {
        let convert = |axis: &Vec<f64>| memory::collect(axis.iter().map(|&value| value as f32));
        Ok(Sides {
            axes: memory::try_map(self.axes.each_ref(), convert)?,
            zero_squared: self.zero_squared.map(|value| value as f32),
        })
    }
}

/// Writes `score(ds_ij^2, dt_ij^2)` for j = first, first + 1, ... into `row`. The score is 0 if an edge has
/// zero length.
#[inline(always)]
pub fn fill_row<T: Coordinate>(
    sides: &Sides<T>,
    i: usize,
    first: usize,
    row: &mut [T],
    score: impl Fn(T, T) -> T,
) {
    let n = row.len();
    let part = first..first + n;
    let point = sides.at(i);
    // Separate slices show the compiler that all have the row's length.
    let [x, y, z, u, v, w] = &sides.axes;
    let (x, y, z) = (&x[part.clone()], &y[part.clone()], &z[part.clone()]);
    let (u, v, w) = (&u[part.clone()], &v[part.clone()], &w[part]);
    let [zero_source, zero_target] = sides.zero_squared;
    for j in 0..n {
        let ds = squared_norm([point[0] - x[j], point[1] - y[j], point[2] - z[j]]);
        let dt = squared_norm([point[3] - u[j], point[4] - v[j], point[5] - w[j]]);
        let value = score(ds, dt);
        let coincident = (ds <= zero_source) | (dt <= zero_target);
        row[j] = if coincident { T::default() } else { value };
    }
}

#[inline(always)]
fn squared_norm<T: Coordinate>([x, y, z]: [T; 3]) -> T {
    x * x + y * y + z * z
}

/// Writes `min(ds, dt) / max(ds, dt)` of a correspondence with others; 0 if either length is 0.
struct FillRatios<'a> {
    point: [f32; 6],
    axes: [&'a [f32]; 6],
    row: &'a mut [f32],
}

/// Keeps the ratio at 0 for a length of 0; far below the product of any two squared lengths in f32.
const TINY: f32 = 1e-36;

impl Kernel for FillRatios<'_> {
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
        for (scores, (((((x, y), z), u), v), w)) in
            self.row.as_chunks_mut::<SINGLES>().0.iter_mut().zip(others)
        {
            let ds = squared_length(lanes, p, [x, y, z]);
            let dt = squared_length(lanes, q, [u, v, w]);
            let product = lanes.multiply_add_singles(ds, dt, tiny);
            // sqrt(min / max) = min / sqrt(min max), of the squared lengths.
            let ratio = lanes.multiply_singles(lanes.min_singles(ds, dt), lanes.reciprocal_sqrt(product));
            lanes.store_singles(ratio, scores);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coincident_points_score_zero() -> Result<()> {
        let zeros = || vec![0.0; 3];
        let axes = [vec![0.0, 1.0, 2.0], zeros(), zeros(), vec![0.0, 0.0, 1.0], zeros(), zeros()];
        let sides = Sides::new(axes, [1e-20; 2])?;
        let mut row = vec![0.0; 3];
        f64::fill_ratios(&sides, 0, 0, &mut row);
        assert_eq!(row, [0.0, 0.0, 0.5]);
        Ok(())
    }
}
