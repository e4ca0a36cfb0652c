//! Surface normals: plane fits to neighbourhoods, or averages over a mesh's faces.
//!
//! As PCL's `NormalEstimation`: the eigenvector of the smallest eigenvalue of the neighbourhood's covariance,
//! oriented towards a viewpoint. The point itself belongs to its neighbourhood.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::cloud::Cloud;
use crate::error::{Result, at_least_one};
use crate::execution::Execution;
use crate::geometry::ball_search::BallSearch;
use crate::geometry::symmetric::{Eigen, eigen};

/// The middle eigenvalue below this share of the largest counts as zero: collinear points.
const COLLINEAR: f64 = 1e-12;

/// Points that a plane is fitted to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Neighborhood {
    /// This many nearest points, the point itself included.
    Nearest(usize),
    /// All points nearer than this, the point itself included.
    Radius(f64),
    /// At most this many nearest points within the radius, the point itself included.
    NearestWithin(usize, f64),
}

/// A plane fit. NaN for fewer than three points, or collinear ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Unit normal.
    pub normal: Vector3<f64>,
    /// Surface variation: smallest eigenvalue of the covariance over their sum, in 0..=1/3.
    pub curvature: f64,
}

impl Default for Surface {
    fn default() -> Self {
        Self { normal: Vector3::repeat(f64::NAN), curvature: f64::NAN }
    }
}

/// Fits a plane to the neighbourhood of every point; normals are oriented towards `viewpoint`, which is in
/// the data's own coordinates. Cost O(N log N + N k).
///
/// # Errors
/// [`crate::Error::InvalidInput`] for a radius that is not positive or fewer than one neighbour;
/// [`crate::Error::Interrupted`].
pub fn surfaces(
    cloud: &Cloud,
    neighborhood: Neighborhood,
    viewpoint: Point3<f64>,
    execution: &Execution,
) -> Result<Vec<Surface>> {
    let points = cloud.points();
    let mut surfaces = match neighborhood {
        Neighborhood::Nearest(count) => {
            let others = at_least_one("neighbors", count)? - 1;
            cloud.nearest(execution)?.map_points(others, execution, |query, found| {
                let center = points.get(query);
                fit(found.iter().map(|neighbor| points.get(neighbor.index as usize) - center), true)
            })?
        }
        Neighborhood::Radius(radius) => fit_balls(&cloud.balls(radius)?, execution)?,
        Neighborhood::NearestWithin(count, radius) => {
            fit_balls(&cloud.balls(radius)?.of_nearest(at_least_one("neighbors", count)?), execution)?
        }
    };
    let viewpoint = viewpoint - points.center();
    for (i, surface) in surfaces.iter_mut().enumerate() {
        if surface.normal.dot(&(viewpoint - points.get(i))) < 0.0 {
            surface.normal = -surface.normal;
        }
    }
    Ok(surfaces)
}

/// Fits planes to the balls around all points.
fn fit_balls(search: &BallSearch, execution: &Execution) -> Result<Vec<Surface>> {
    search.map_points(execution, |_, ball| {
        fit(ball.offsets().iter().map(|&offset| Vector3::from(offset)), false)
    })
}

/// Mean and principal axes of points given relative to one of them.
pub(crate) struct Scatter {
    /// Mean of the points.
    pub mean: Vector3<f64>,
    /// Variances along the axes, ascending, and the axes.
    pub axes: Eigen,
}

/// Scatter of points given relative to one of them, which is included if `adds_itself` is set; `None` for
/// fewer than three points, or collinear ones.
pub(crate) fn scatter(offsets: impl Iterator<Item = Vector3<f64>>, adds_itself: bool) -> Option<Scatter> {
    let mut count = usize::from(adds_itself);
    let mut sum = Vector3::zeros();
    let mut products = [0.0; 6];
    for v in offsets {
        count += 1;
        sum += v;
        add_products(&mut products, &v, &v);
    }
    if count < 3 {
        return None;
    }
    let weight = 1.0 / count as f64;
    let mean = sum * weight;
    let axes = eigen(&(symmetric(&products) * weight - mean * mean.transpose()));
    let [_, middle, high] = axes.values;
    (middle > COLLINEAR * high && high > 0.0).then_some(Scatter { mean, axes })
}

/// Plane through points given relative to one of them, which is included if `adds_itself` is set.
pub(super) fn fit(offsets: impl Iterator<Item = Vector3<f64>>, adds_itself: bool) -> Surface {
    let Some(Scatter { axes, .. }) = scatter(offsets, adds_itself) else { return Surface::default() };
    let [low, middle, high] = axes.values;
    let low = low.max(0.0);
    Surface { normal: axes.vectors[0], curvature: low / (low + middle + high) }
}

/// Adds `u v^T`, where `u` is a multiple of `v`, as xx, xy, xz, yy, yz, zz.
#[inline]
pub(crate) fn add_products(products: &mut [f64; 6], u: &Vector3<f64>, v: &Vector3<f64>) {
    let terms = [u.x * v.x, u.x * v.y, u.x * v.z, u.y * v.y, u.y * v.z, u.z * v.z];
    for (sum, term) in products.iter_mut().zip(terms) {
        *sum += term;
    }
}

/// The symmetric matrix of xx, xy, xz, yy, yz, zz.
pub(crate) fn symmetric(&[xx, xy, xz, yy, yz, zz]: &[f64; 6]) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane() -> Vec<[f64; 3]> {
        (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), 5.0]).collect()
    }

    #[test]
    fn a_plane_has_its_normal_everywhere() -> Result<()> {
        let cloud = Cloud::from_rows("points", &plane())?;
        let neighborhoods =
            [Neighborhood::Nearest(9), Neighborhood::Radius(1.5), Neighborhood::NearestWithin(4, 1.5)];
        for neighborhood in neighborhoods {
            for (viewpoint, z) in [(Point3::origin(), -1.0), (Point3::new(0.0, 0.0, 9.0), 1.0)] {
                for surface in surfaces(&cloud, neighborhood, viewpoint, &Execution::default())? {
                    assert!((surface.normal - Vector3::new(0.0, 0.0, z)).amax() < 1e-12);
                    assert!(surface.curvature < 1e-12);
                }
            }
        }
        Ok(())
    }

    #[test]
    fn lines_duplicates_and_isolated_points_have_no_normal() -> Result<()> {
        let line: Vec<[f64; 3]> = (0..9).map(|i| [0.1 * f64::from(i), 0.2 * f64::from(i), 0.0]).collect();
        for rows in [line, vec![[1.0; 3]; 9], vec![[0.0; 3]], vec![]] {
            let cloud = Cloud::from_rows("points", &rows)?;
            let neighborhoods =
                [Neighborhood::Nearest(5), Neighborhood::Radius(1.0), Neighborhood::NearestWithin(5, 1.0)];
            for neighborhood in neighborhoods {
                let fits = surfaces(&cloud, neighborhood, Point3::origin(), &Execution::default())?;
                assert_eq!(fits.len(), rows.len());
                assert!(fits.iter().all(|surface| surface.normal.x.is_nan() && surface.curvature.is_nan()));
            }
        }
        Ok(())
    }
}
