//! A set of 3D points as three coordinate arrays, centred to keep the precision of distances.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::{Matrix3, Point3, Vector3};

use crate::error::{Error, Result};
use crate::memory;
use crate::simd::{self, DOUBLES};

/// Coordinates beyond this magnitude cannot be squared and summed safely.
pub const MAX_COORDINATE: f64 = 1e150;

/// Squares and products of smaller extents underflow.
const MIN_EXTENT: f64 = 1e-60;

/// Rows that are copied axis by axis while they are in the cache.
const IN_CACHE: usize = 1024;

/// Edges shorter than this share of the bounding box's diagonal count as zero length.
pub const ZERO_LENGTH: f64 = 1e-12;

/// Points as a struct of arrays, with their mean subtracted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Points {
    /// Centred x coordinates.
    pub x: Vec<f64>,
    /// Centred y coordinates.
    pub y: Vec<f64>,
    /// Centred z coordinates.
    pub z: Vec<f64>,
    center: Vector3<f64>,
    diagonal: f64,
    /// Minimum and maximum coordinate of each axis.
    extremes: [(f64, f64); 3],
}

impl Points {
    /// Reads rows of coordinates; `name` is used in the error message.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] naming the first row that is not finite, or too large to square.
    pub fn from_rows(name: &str, rows: &[[f64; 3]]) -> Result<Self> {
        Self::from_numbers(name, rows)
    }

    /// As [`Self::from_rows`] for numbers of either precision. They are read once: the validated values are
    /// the stored ones, even if another process writes to the input meanwhile.
    ///
    /// # Errors
    /// As [`Self::from_rows`]; [`Error::OutOfMemory`].
    pub fn from_numbers<T: Copy + Into<f64>>(name: &str, rows: &[[T; 3]]) -> Result<Self> {
        let [x, y, z] = copied_axes(rows)?;
        validate(name, &x, &y, &z)?;
        let (points, extent) = Self::centered(x, y, z);
        if extent > 0.0 && extent < MIN_EXTENT {
            let remedy = "distances that small can't be squared; use a smaller unit";
            return Err(Error::invalid(name, format!("points within {extent:e} of each other"), remedy));
        }
        Ok(points)
    }

    /// Centres the points; also returns the greatest magnitude of a centred coordinate.
    fn centered(x: Vec<f64>, y: Vec<f64>, z: Vec<f64>) -> (Self, f64) {
        let mut points = Self { x, y, z, ..Self::default() };
        let total = (0..points.len()).map(|i| points.get(i).coords).sum::<Vector3<f64>>();
        points.center = total / points.len().max(1) as f64;
        for (axis, center) in [&mut points.x, &mut points.y, &mut points.z].into_iter().zip(&points.center) {
            axis.iter_mut().for_each(|value| *value -= center);
        }
        let extent = points.measure();
        (points, extent)
    }

    /// Sets the diagonal; returns the greatest magnitude of a coordinate.
    fn measure(&mut self) -> f64 {
        let extremes = [&self.x, &self.y, &self.z].map(|axis| {
            simd::run(
                #[inline(always)]
                || extremes(axis),
            )
        });
        self.extremes = extremes;
        self.diagonal = Vector3::from(extremes.map(|(low, high)| (high - low).max(0.0))).norm();
        extremes.iter().fold(0.0, |most: f64, (low, high)| most.max(-low).max(*high))
    }

    /// Copies the points.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn copied(&self) -> Result<Self> {
        let [x, y, z] = [&self.x, &self.y, &self.z].map(|axis| memory::copied(axis));
        Ok(Self { x: x?, y: y?, z: z?, ..*self })
    }

    /// Rotates the points about their mean, which becomes the origin.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn turned(&self, turn: &Matrix3<f64>) -> Result<Self> {
        let axis = |k: usize| {
            let rows = self.x.iter().zip(&self.y).zip(&self.z);
            memory::collect(rows.map(|((x, y), z)| turn[(k, 0)] * x + turn[(k, 1)] * y + turn[(k, 2)] * z))
        };
        let mut turned = Self { x: axis(0)?, y: axis(1)?, z: axis(2)?, ..Self::default() };
        turned.measure();
        Ok(turned)
    }

    /// Mirrors the points at the plane x = 0 through their centre.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn mirrored(&self) -> Result<Self> {
        let mut mirrored = self.copied()?;
        mirrored.x.iter_mut().for_each(|x| *x = -*x);
        mirrored.measure();
        Ok(mirrored)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Point `i`, relative to [`Self::center`].
    #[inline]
    pub fn get(&self, i: usize) -> Point3<f64> {
        Point3::new(self.x[i], self.y[i], self.z[i])
    }

    /// The mean that was subtracted from every point.
    pub fn center(&self) -> Vector3<f64> {
        self.center
    }

    /// Diagonal of the bounding box.
    pub fn diagonal(&self) -> f64 {
        self.diagonal
    }

    /// Length below which an edge counts as zero (two coincident points).
    pub fn zero_length(&self) -> f64 {
        ZERO_LENGTH * self.diagonal
    }

    /// Distance between points `i` and `j`.
    #[inline]
    pub fn distance(&self, i: usize, j: usize) -> f64 {
        (self.get(i) - self.get(j)).norm()
    }

    /// The points at `indices`, centred again.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn subset(&self, indices: &[usize]) -> Result<Self> {
        let axis = |values: &[f64]| memory::collect(indices.iter().map(|&i| values[i]));
        Ok(Self::centered(axis(&self.x)?, axis(&self.y)?, axis(&self.z)?).0)
    }

    /// Multiplies all points and their mean by a positive factor.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn scaled(&self, factor: f64) -> Result<Self> {
        let mut scaled = self.copied()?;
        for axis in [&mut scaled.x, &mut scaled.y, &mut scaled.z] {
            axis.iter_mut().for_each(|value| *value *= factor);
        }
        scaled.center *= factor;
        scaled.measure();
        Ok(scaled)
    }

    /// Centred rows, for spatial indices.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = [f64; 3]> + '_ {
        (0..self.len()).map(|i| [self.x[i], self.y[i], self.z[i]])
    }

    /// Minimum corner, relative to [`Self::center`], and extents; zero without points.
    pub fn bounding_box(&self) -> ([f64; 3], [f64; 3]) {
        if self.is_empty() {
            return ([0.0; 3], [0.0; 3]);
        }
        (self.extremes.map(|(low, _)| low), self.extremes.map(|(low, high)| high - low))
    }
}

#[inline(always)]
fn extremes(values: &[f64]) -> (f64, f64) {
    let (mut low, mut high) = ([f64::INFINITY; DOUBLES], [f64::NEG_INFINITY; DOUBLES]);
    for chunk in values.chunks(DOUBLES) {
        for (lane, &value) in chunk.iter().enumerate() {
            low[lane] = if value < low[lane] { value } else { low[lane] };
            high[lane] = if value > high[lane] { value } else { high[lane] };
        }
    }
    (low.into_iter().fold(f64::INFINITY, f64::min), high.into_iter().fold(f64::NEG_INFINITY, f64::max))
}

/// Copies the coordinates by axis. Never inlined, so that the compiler does not read the rows a second time.
#[inline(never)]
fn copied_axes<T: Copy + Into<f64>>(rows: &[[T; 3]]) -> Result<[Vec<f64>; 3]> {
    let mut axes = memory::try_map([0; 3], |_| memory::with_capacity(rows.len()))?;
    for some in rows.chunks(IN_CACHE) {
        for (k, axis) in axes.iter_mut().enumerate() {
            axis.extend(some.iter().map(|row| row[k].into()));
        }
    }
    Ok(axes)
}

fn validate(name: &str, x: &[f64], y: &[f64], z: &[f64]) -> Result<()> {
    // Branch-free, so that the compiler vectorizes it.
    let is_right = |axis: &[f64]| axis.iter().fold(true, |all, value| all & (value.abs() <= MAX_COORDINATE));
    if [x, y, z].into_iter().all(is_right) {
        return Ok(());
    }
    let is_wrong = |value: &f64| !(-MAX_COORDINATE..=MAX_COORDINATE).contains(value);
    let first = [x, y, z].into_iter().filter_map(|axis| axis.iter().position(is_wrong)).min();
    let Some(i) = first else { return Ok(()) };
    let row = [x[i], y[i], z[i]];
    let remedy = if row.iter().all(|value| value.is_finite()) {
        "coordinates beyond 1e150 can't be squared; use a larger unit"
    } else {
        "coordinates must be finite; drop or repair such rows first"
    };
    Err(Error::invalid(name, format!("{row:?} in row {i}"), remedy))
}

/// The power of two that scales lengths up to `extent` to about 1. Powers of two scale exactly; without
/// scaling, squares in f32 would under- or overflow.
pub fn unit_scale(extent: f64) -> f64 {
    // The inverse of a number below the least normal one is infinite.
    if extent > 0.0 { (-extent.max(f64::MIN_POSITIVE).log2().round()).exp2() } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centring_keeps_distances() -> Result<()> {
        let points = Points::from_rows("source", &[[1e6, 0.0, 0.0], [1e6 + 3.0, 4.0, 0.0]])?;
        assert!((points.distance(0, 1) - 5.0).abs() < 1e-9);
        assert!((points.diagonal() - 5.0).abs() < 1e-9);
        assert!((points.center().x - (1e6 + 1.5)).abs() < 1e-9);
        Ok(())
    }

    #[test]
    fn names_the_first_bad_row() {
        let error = Points::from_rows("target", &[[0.0; 3], [0.0, f64::NAN, 0.0]]).err();
        let text = error.map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("target") && text.contains("row 1"), "{text}");
    }

    #[test]
    fn empty_has_no_extent() -> Result<()> {
        let points = Points::from_rows("source", &[])?;
        assert!(points.is_empty() && points.diagonal() == 0.0);
        Ok(())
    }
}
