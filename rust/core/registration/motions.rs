//! Small motions about a point, and the resistance of two surfaces to them.
//!
//! A motion is a rotation vector followed by the translation of a point.

use nalgebra::{Matrix6, Rotation3, SymmetricEigen, Vector3, Vector6};

use crate::error::Result;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::pose_graph::motion::{compose, logarithm};

/// Returns the transform of a motion about a point.
pub fn motion_about(motion: &Vector6<f64>, point: &Vector3<f64>) -> Rigid {
    let rotation = Rotation3::new(motion.fixed_rows::<3>(0).into_owned()).into_inner();
    Rigid { rotation, translation: point + motion.fixed_rows::<3>(3) - rotation * point }
}

/// Returns the motion about a point of a transform that turns by less than half a turn.
pub fn motion_of(transform: &Rigid, point: &Vector3<f64>) -> Vector6<f64> {
    let turn = logarithm(&Rigid { translation: Vector3::zeros(), ..*transform });
    let shift = transform.rotation * point + transform.translation - point;
    Vector6::new(turn[0], turn[1], turn[2], shift.x, shift.y, shift.z)
}

/// Returns the matrix that maps motions of the origin to motions of a point.
pub fn about(point: &Vector3<f64>) -> Matrix6<f64> {
    let mut change = Matrix6::identity();
    change.fixed_view_mut::<3, 3>(3, 0).copy_from(&-point.cross_matrix());
    change
}

/// Returns a pose followed by a motion about a point.
pub fn moved(pose: &Rigid, motion: &Vector6<f64>, point: &Vector3<f64>) -> Rigid {
    compose(&motion_about(motion, point), pose)
}

/// Resistance of two surfaces to motions about the middle of the points.
#[derive(Debug, Clone)]
pub struct Resisted {
    /// Resistance to each motion as a share of that of all pairs, ascending.
    pub values: [f64; 6],
    /// Motions about the middle that displace the points by about one unit of length.
    pub motions: [Vector6<f64>; 6],
    /// Median of the points.
    pub middle: Vector3<f64>,
    /// Median distance of the points from the middle.
    pub radius: f64,
    /// Sum of the weights of the pairs.
    pub weight: f64,
}

impl Resisted {
    /// Decomposes the information matrix of a point-to-plane step into motions about the middle of some points.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        information: &Matrix6<f64>,
        points: impl Iterator<Item = Vector3<f64>> + Clone,
    ) -> Result<Self> {
        let (middle, radius) = middle_of(points)?;
        let scale = Vector6::from_fn(|row, _| if row < 3 { 1.0 / radius } else { 1.0 });
        let change = about(&-middle) * Matrix6::from_diagonal(&scale);
        let weight = (3..6).map(|k| information[(k, k)]).sum(); // normals are of unit length
        let (values, vectors) = ascending(&(change.transpose() * information * change));
        let share = |value: f64| value / f64::max(weight, 1e-300);
        Ok(Self {
            values: values.map(share),
            motions: vectors.map(|vector| vector.component_mul(&scale)),
            middle,
            radius,
            weight,
        })
    }

    /// Returns the length of a motion: rotations count by the displacement at the median distance.
    pub fn length(&self, motion: &Vector6<f64>) -> f64 {
        let turned = motion.fixed_rows::<3>(0).norm_squared() * self.radius * self.radius;
        (turned + motion.fixed_rows::<3>(3).norm_squared()).sqrt()
    }
}

/// Returns eigenvalues in ascending order with their vectors; those of a matrix that is not finite are NaN.
fn ascending(matrix: &Matrix6<f64>) -> ([f64; 6], [Vector6<f64>; 6]) {
    if !matrix.iter().all(|entry| entry.is_finite()) {
        return ([f64::NAN; 6], [Vector6::zeros(); 6]);
    }
    let eigen = SymmetricEigen::new(*matrix);
    let mut order = [0, 1, 2, 3, 4, 5];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    (order.map(|k| eigen.eigenvalues[k]), order.map(|k| eigen.eigenvectors.column(k).into_owned()))
}

/// Returns the median of the points, coordinate by coordinate, and the median of their distances from it.
fn middle_of(points: impl Iterator<Item = Vector3<f64>> + Clone) -> Result<(Vector3<f64>, f64)> {
    let mut middle = Vector3::zeros();
    for axis in 0..3 {
        middle[axis] = median(&mut memory::collect(points.clone().map(|point| point[axis]))?);
    }
    let mut distances = memory::collect(points.map(|point| (point - middle).norm()))?;
    Ok((middle, median(&mut distances)))
}

/// Returns the median of some numbers, whose order changes; NaN for none.
pub fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

/// Returns a quantile of some numbers by linear interpolation; the order of the numbers changes. NaN for none.
pub fn quantile(values: &mut [f64], share: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
    let place = share * last as f64;
    let row = (place.floor() as usize).min(last);
    let (_, &mut low, above) = values.select_nth_unstable_by(row, f64::total_cmp);
    let next = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    low + (next - low) * (place - row as f64)
}

/// Returns a quantile of many numbers, as [`quantile`]: some of them bound it, and only those between the bounds are ordered.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn quantile_of_many(count: usize, value: impl Fn(usize) -> f64, share: f64) -> Result<f64> {
    const SOME: usize = 2000;
    const MARGIN: f64 = 0.05; // four standard deviations of a rank among them
    let mut some = memory::collect(some_rows(count, SOME).map(&value))?;
    let low = if share > MARGIN { quantile(&mut some, share - MARGIN) } else { f64::NEG_INFINITY };
    let high = if share + MARGIN < 1.0 { quantile(&mut some, share + MARGIN) } else { f64::INFINITY };
    let (mut below, mut between) = (0, memory::with_capacity(count / 4)?);
    for number in (0..count).map(&value) {
        below += usize::from(number < low);
        if number >= low && number <= high {
            memory::push(&mut between, number)?;
        }
    }
    let place = share * count.saturating_sub(1) as f64 - below as f64;
    let last = between.len().saturating_sub(1) as f64;
    if place >= 0.0 && place < last {
        return Ok(quantile(&mut between, place / last));
    }
    Ok(quantile(&mut memory::collect((0..count).map(value))?, share))
}

/// Returns about `most` of the rows of a table, one at a chance place in each of as many equal stretches; all if there are fewer.
pub fn some_rows(count: usize, most: usize) -> impl Iterator<Item = usize> {
    const FACTOR: u64 = 0x9E37_79B9_7F4A_7C15; // odd, 2^64 over the golden ratio
    let width = count.div_ceil(most).max(1);
    (0..count).step_by(width).map(move |first| {
        let chance = (first as u64 + 1).wrapping_mul(FACTOR) >> 32;
        first + ((chance * width.min(count - first) as u64) >> 32) as usize
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn quantiles_interpolate() {
        assert!((quantile(&mut [4.0, 1.0, 3.0, 2.0], 0.5) - 2.5).abs() < 1e-15);
        assert!((quantile(&mut [4.0, 1.0, 3.0, 2.0], 0.9) - 3.7).abs() < 1e-12);
        assert!((quantile(&mut [4.0], 0.9) - 4.0).abs() < 1e-15);
        assert!(median(&mut []).is_nan());
        for count in [1, 2, 7, 5000, 20_001] {
            let value = |i: usize| (i as f64 * 1.7).sin();
            let mut all: Vec<f64> = (0..count).map(value).collect();
            for share in [0.01, 0.5, 0.9] {
                let found = quantile_of_many(count, value, share).unwrap_or(f64::NAN);
                assert!((found - quantile(&mut all, share)).abs() < 1e-12, "{count} {share}");
            }
        }
    }

    #[test]
    fn some_rows_lie_everywhere() {
        for (count, most) in [(0, 5), (5, 5), (12, 5), (100_003, 1000)] {
            let rows: Vec<usize> = some_rows(count, most).collect();
            assert!(rows.len() <= most && rows.len() >= most.min(count) / 2);
            assert!(rows.windows(2).all(|pair| pair[0] < pair[1]) && rows.iter().all(|&row| row < count));
        }
        assert!((0..7).all(|k| some_rows(70_000, 10_000).filter(|row| row % 7 == k).count() > 1000));
    }

    #[test]
    fn a_motion_and_its_transform_correspond() {
        let (motion, point) = (Vector6::new(0.3, -0.2, 0.5, 1.0, 2.0, -3.0), Vector3::new(5.0, 6.0, 7.0));
        let transform = motion_about(&motion, &point);
        assert!((motion_of(&transform, &point) - motion).amax() < 1e-12);
        let of_origin = about(&-point) * motion; // first order: at small angles
        let small = motion_about(&(motion * 1e-6), &point);
        assert!((motion_of(&small, &Vector3::zeros()) - of_origin * 1e-6).amax() < 1e-11);
    }

    #[test]
    fn a_plane_resists_three_motions() -> Result<()> {
        let rows = (0..100).map(|i| Vector3::new(f64::from(i % 10), f64::from(i / 10), 4.0));
        let mut information = Matrix6::zeros();
        for point in rows.clone() {
            let turn = point.cross(&Vector3::z());
            let row = Vector6::new(turn.x, turn.y, turn.z, 0.0, 0.0, 1.0);
            information.ger(1.0, &row, &row, 1.0);
        }
        let resisted = Resisted::new(&information, rows)?;
        assert!((resisted.middle - Vector3::new(4.5, 4.5, 4.0)).amax() < 1e-12);
        assert!((resisted.weight - 100.0).abs() < 1e-9);
        assert_eq!(resisted.values.iter().filter(|&&value| value < 1e-9).count(), 3);
        let slide = Vector6::new(0.0, 0.0, 0.0, 1.0, 0.0, 0.0);
        assert!((resisted.length(&slide) - 1.0).abs() < 1e-12);
        assert!((moved(&Rigid::identity(), &slide, &resisted.middle).translation.x - 1.0).abs() < 1e-12);
        let strange = Resisted::new(&Matrix6::repeat(f64::NAN), std::iter::once(Vector3::zeros()))?;
        assert!(strange.values[0].is_nan());
        assert!((Matrix3::<f64>::identity() - Rigid::identity().rotation).amax() < 1e-15);
        Ok(())
    }
}
