//! Intrinsic shape signatures (Zhong, ICCV workshops 2009): keypoints whose neighbourhood extends in all
//! three directions, by different amounts.
//!
//! Defaults follow PCL's `ISSKeypoint3D`: the scatter is about the point itself, unweighted; the smallest
//! eigenvalue is the saliency. Cost O(N k).

use nalgebra::{Matrix3, Vector3};

use crate::cloud::Cloud;
use crate::error::{Result, at_least_one, positive};
use crate::execution::Execution;
use crate::features::maxima::{Suppression, local_maxima, maxima_of_about};
use crate::features::normals::{add_products, symmetric};
use crate::geometry::ball_search::{Ball, BallSearch};
use crate::geometry::symmetric::eigen;

/// The smallest eigenvalue below this share of the largest is a rounding error: coplanar points.
const FLAT: f64 = 1e-13;

/// Centre of a neighbourhood's scatter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Covariance {
    /// The point itself; a sum, not divided by the count (PCL).
    #[default]
    AboutPoint,
    /// The neighbourhood's mean; divided by the count (as in `Open3D`).
    AboutMean,
}

/// The detector and its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iss {
    /// Radius of the scatter, in the unit of the data; 2.7 pr in the paper authors' pipeline.
    pub salient_radius: f64,
    /// Radius of the non-maximum suppression; 1.8 pr there.
    pub nms_radius: f64,
    /// Bound on the ratio of the second to the first eigenvalue.
    pub gamma_21: f64,
    /// Bound on the ratio of the third to the second eigenvalue.
    pub gamma_32: f64,
    /// Least number of points in either radius, the point itself included.
    pub min_neighbors: usize,
    /// Weight neighbours by their inverse number of neighbours, as in the original paper; the scatter is then
    /// divided by the sum of weights.
    pub density_weight: bool,
    /// Centre of the scatter.
    pub covariance: Covariance,
    /// Adapt `nms_radius` until about this many keypoints remain.
    pub count: Option<usize>,
}

impl Iss {
    /// PCL's defaults for the two radii.
    pub fn new(salient_radius: f64, nms_radius: f64) -> Self {
        Self {
            salient_radius,
            nms_radius,
            gamma_21: 0.975,
            gamma_32: 0.975,
            min_neighbors: 5,
            density_weight: false,
            covariance: Covariance::default(),
            count: None,
        }
    }

    /// Ascending indices of the keypoints.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] for lengths or bounds that are not positive;
    /// [`crate::Error::Interrupted`].
    pub fn detect(&self, cloud: &Cloud, execution: &Execution) -> Result<Vec<usize>> {
        positive("nms_radius", self.nms_radius)?;
        let saliencies = self.saliencies(cloud, execution)?;
        let rule =
            Suppression { radius: self.nms_radius, min_neighbors: self.min_neighbors, break_ties: false };
        let is_salient = |saliency| saliency > 0.0;
        match self.count {
            None => local_maxima(cloud, &saliencies, is_salient, &rule, execution),
            Some(count) => maxima_of_about(count, cloud, &saliencies, is_salient, &rule, execution),
        }
    }

    /// The smallest eigenvalue at every point; 0 if a test fails.
    ///
    /// # Errors
    /// As [`Self::detect`].
    pub fn saliencies(&self, cloud: &Cloud, execution: &Execution) -> Result<Vec<f64>> {
        positive("salient_radius", self.salient_radius)?;
        positive("gamma_21", self.gamma_21)?;
        positive("gamma_32", self.gamma_32)?;
        at_least_one("min_neighbors", self.min_neighbors)?;
        let search = cloud.balls(self.salient_radius)?;
        let weights = self.weights(&search, execution)?;
        search.map_points(execution, |_, ball| {
            if ball.len() < self.min_neighbors { 0.0 } else { self.saliency(ball, weights.as_deref()) }
        })
    }

    /// Inverse density at every point, in grid order.
    fn weights(&self, search: &BallSearch, execution: &Execution) -> Result<Option<Vec<f64>>> {
        if !self.density_weight {
            return Ok(None);
        }
        let weights = search.map_points(execution, |_, ball| 1.0 / ball.len() as f64)?;
        search.reorder(&weights).map(Some)
    }

    fn saliency(&self, ball: &Ball, weights: Option<&[f64]>) -> f64 {
        let values = eigen(&self.scatter(ball, weights)).values;
        let [third, second, first] = values;
        let passes = second / first < self.gamma_21 && third / second < self.gamma_32;
        if passes && third > FLAT * first { third } else { 0.0 }
    }

    fn scatter(&self, ball: &Ball, weights: Option<&[f64]>) -> Matrix3<f64> {
        let mut products = [0.0; 6];
        let mut sum = Vector3::zeros();
        let mut total = 0.0;
        for (offset, &position) in ball.offsets().iter().zip(ball.positions()) {
            let weight = weights.map_or(1.0, |weights| weights[position as usize]);
            let offset = Vector3::from(*offset);
            let weighted = offset * weight;
            total += weight;
            sum += weighted;
            add_products(&mut products, &weighted, &offset);
        }
        let scatter = symmetric(&products);
        match self.covariance {
            Covariance::AboutMean => scatter / total - sum * sum.transpose() / (total * total),
            Covariance::AboutPoint if weights.is_some() => scatter / total,
            Covariance::AboutPoint => scatter,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corner region of a box: three faces of different extent.
    fn corner() -> Vec<[f64; 3]> {
        let mut rows = Vec::new();
        for i in 0..12 {
            for j in 0..12 {
                let (u, v) = (f64::from(i), f64::from(j) * 0.9);
                rows.push([u, v, 0.0]);
                if i > 0 {
                    rows.push([0.0, v, u * 0.8]);
                }
                if i > 0 && j > 0 {
                    rows.push([u, 0.0, v * 0.7]);
                }
            }
        }
        rows
    }

    #[test]
    fn a_corner_is_more_salient_than_a_face() -> Result<()> {
        let cloud = Cloud::from_rows("points", &corner())?;
        for (density_weight, covariance) in [
            (false, Covariance::AboutPoint),
            (true, Covariance::AboutPoint),
            (false, Covariance::AboutMean),
            (true, Covariance::AboutMean),
        ] {
            let detector = Iss { density_weight, covariance, ..Iss::new(3.0, 40.0) };
            let found = detector.detect(&cloud, &Execution::default())?;
            assert_eq!(found.len(), 1, "{detector:?}");
            let p = cloud.points().get(found[0]).coords + cloud.points().center();
            assert!(p.norm() < 5.0, "{p}");
        }
        Ok(())
    }

    #[test]
    fn saliency_of_a_known_scatter() -> Result<()> {
        let rows =
            [[0.0; 3], [3.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
        let cloud = Cloud::from_rows("points", &rows)?;
        let detector = Iss::new(3.1, 3.1);
        let saliency = |detector: Iss| detector.saliencies(&cloud, &Execution::default()).map(|s| s[0]);
        // Scatter about the point: diag(18, 4, 2).
        assert!((saliency(detector)? - 2.0).abs() < 1e-12);
        assert!((saliency(Iss { covariance: Covariance::AboutMean, ..detector })? - 2.0 / 6.0).abs() < 1e-12);
        assert!(saliency(Iss { gamma_21: 0.2, ..detector })?.abs() < 1e-12);
        assert!(saliency(Iss { gamma_32: 0.4, ..detector })?.abs() < 1e-12);
        assert!(saliency(Iss { min_neighbors: 7, ..detector })?.abs() < 1e-12);
        Ok(())
    }

    #[test]
    fn degenerate_input_has_no_keypoints() -> Result<()> {
        let plane: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), 0.0]).collect();
        for rows in [plane, vec![[1.0; 3]; 30], vec![[0.0; 3]], vec![]] {
            let cloud = Cloud::from_rows("points", &rows)?;
            assert!(Iss::new(2.5, 2.0).detect(&cloud, &Execution::default())?.is_empty());
            assert!(Iss::new(0.0, 2.0).detect(&cloud, &Execution::default()).is_err());
        }
        Ok(())
    }
}
