//! Harris 3D keypoints (H3D): points whose neighbourhood has normals in all directions, as PCL's
//! `HarrisKeypoint3D`.
//!
//! The structure tensor of a point is the 3x3 mean `C` of `n n^T` over the normals within a radius. A
//! response computed from its invariants is reduced to its local maxima. (Sipiran and Bustos' original uses
//! mesh rings and a fitted quadric; the paper's evaluation used PCL.) Cost O(N k).

use nalgebra::{Matrix3, Point3, Vector3};

use crate::cloud::Cloud;
use crate::error::{Error, Result, positive};
use crate::execution::Execution;
use crate::features::maxima::{Suppression, local_maxima, maxima_of_about};
use crate::features::normals::{Neighborhood, Surface, add_products, surfaces, symmetric};
use crate::geometry::symmetric::eigen;
use crate::memory;
use crate::points::Points;

/// Weight of the squared trace, and the constant added by PCL, which makes flat regions zero.
const HARRIS_WEIGHT: f64 = 0.04;

/// Resolution of PCL's single-precision response near 0.04. Responses are rounded to it, so that flat
/// neighbourhoods tie instead of ranking rounding errors.
const RESPONSE_STEP: f64 = 1.0 / (1 << 28) as f64;

/// Response as a function of the structure tensor `C`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Response {
    /// `0.04 + det C - 0.04 (trace C)^2`.
    #[default]
    Harris,
    /// `det C / trace C`.
    Noble,
    /// `det C / (trace C)^2`.
    Lowe,
    /// Smallest eigenvalue of `C`.
    Tomasi,
    /// Surface variation of the plane fit; `C` is not used.
    Curvature,
}

/// The detector and its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Harris3d {
    /// Radius of the response, and of the normals if none are given, in the unit of the data.
    pub radius: f64,
    /// Radius of the non-maximum suppression; PCL has one radius for all three.
    pub nms_radius: f64,
    /// The response to maximize.
    pub response: Response,
    /// Points with a smaller response are not keypoints.
    pub threshold: f64,
    /// Keep only the lowest index of equal responses within the radius; PCL keeps all.
    pub break_ties: bool,
    /// Adapt `nms_radius` until about this many keypoints remain.
    pub count: Option<usize>,
}

impl Harris3d {
    /// PCL's defaults, with one radius for all purposes.
    pub fn new(radius: f64) -> Self {
        let response = Response::default();
        Self { radius, nms_radius: radius, response, threshold: 0.0, break_ties: false, count: None }
    }

    /// Ascending indices of the keypoints. `normals`, one per point, may hold NaN; their sign is ignored.
    /// Without normals, planes are fitted within the radius.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for lengths that are not positive, a NaN threshold, or a wrong number of
    /// normals; [`Error::Interrupted`].
    pub fn detect(
        &self,
        cloud: &Cloud,
        normals: Option<&[Vector3<f64>]>,
        execution: &Execution,
    ) -> Result<Vec<usize>> {
        positive("nms_radius", self.nms_radius)?;
        if self.threshold.is_nan() {
            return Err(Error::invalid("threshold", self.threshold, "give a number"));
        }
        let responses = self.responses(cloud, normals, execution)?;
        let is_candidate = |response| response >= self.threshold;
        let rule = Suppression { radius: self.nms_radius, min_neighbors: 1, break_ties: self.break_ties };
        match self.count {
            None => local_maxima(cloud, &responses, is_candidate, &rule, execution),
            Some(count) => maxima_of_about(count, cloud, &responses, is_candidate, &rule, execution),
        }
    }

    /// The response at every point; 0 without a normal within the radius.
    ///
    /// # Errors
    /// As [`Self::detect`].
    pub fn responses(
        &self,
        cloud: &Cloud,
        normals: Option<&[Vector3<f64>]>,
        execution: &Execution,
    ) -> Result<Vec<f64>> {
        positive("radius", self.radius)?;
        check_normals(cloud.points(), normals)?;
        if normals.is_none() || self.response == Response::Curvature {
            let fits = surfaces(cloud, Neighborhood::Radius(self.radius), Point3::origin(), execution)?;
            if self.response == Response::Curvature {
                return memory::collect(fits.iter().map(|fit| fit.curvature));
            }
            let normals = memory::collect(fits.iter().map(|fit: &Surface| fit.normal))?;
            return self.tensor_responses(cloud, &normals, execution);
        }
        self.tensor_responses(cloud, normals.unwrap_or_default(), execution)
    }

    fn tensor_responses(
        &self,
        cloud: &Cloud,
        normals: &[Vector3<f64>],
        execution: &Execution,
    ) -> Result<Vec<f64>> {
        let search = cloud.balls(self.radius)?;
        let normals = search.reorder(normals)?;
        search.map_points(execution, |_, ball| {
            let mut count = 0;
            let mut products = [0.0; 6];
            for &position in ball.positions() {
                let normal = &normals[position as usize];
                if normal.x.is_finite() {
                    count += 1;
                    add_products(&mut products, normal, normal);
                }
            }
            if count == 0 { 0.0 } else { self.response.of(&(symmetric(&products) / f64::from(count))) }
        })
    }
}

impl Response {
    fn of(self, tensor: &Matrix3<f64>) -> f64 {
        let (trace, determinant) = (tensor.trace(), tensor.determinant());
        if trace == 0.0 {
            return 0.0;
        }
        match self {
            Self::Harris => {
                let response = HARRIS_WEIGHT + determinant - HARRIS_WEIGHT * trace * trace;
                (response / RESPONSE_STEP).round() * RESPONSE_STEP
            }
            Self::Noble => determinant / trace,
            Self::Lowe => determinant / (trace * trace),
            Self::Tomasi => eigen(tensor).values[0],
            Self::Curvature => f64::NAN,
        }
    }
}

/// Checks that there are as many normals as points.
pub(crate) fn check_normals(points: &Points, normals: Option<&[Vector3<f64>]>) -> Result<()> {
    let Some(normals) = normals else { return Ok(()) };
    if normals.len() == points.len() {
        return Ok(());
    }
    let remedy = format!("give one normal per point, here {}", points.len());
    Err(Error::invalid("normals", format!("{} rows", normals.len()), remedy))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three faces of a cube with the common corner at the origin.
    fn corner() -> Vec<[f64; 3]> {
        let mut rows = Vec::new();
        for i in 0..10 {
            for j in 0..10 {
                let (u, v) = (f64::from(i), f64::from(j));
                rows.push([u, v, 0.0]);
                if i > 0 {
                    rows.push([0.0, v, u]);
                }
                if i > 0 && j > 0 {
                    rows.push([u, 0.0, v]);
                }
            }
        }
        rows
    }

    #[test]
    fn finds_the_corner_of_a_cube() -> Result<()> {
        let cloud = Cloud::from_rows("points", &corner())?;
        for response in [Response::Harris, Response::Noble, Response::Lowe, Response::Tomasi] {
            let detector = Harris3d { response, nms_radius: 40.0, ..Harris3d::new(2.5) };
            let found = detector.detect(&cloud, None, &Execution::default())?;
            assert!(!found.is_empty());
            for index in found {
                let p = cloud.points().get(index) + cloud.points().center();
                assert!(p.coords.norm() < 4.0, "{response:?}: {p}");
            }
        }
        Ok(())
    }

    #[test]
    fn a_plane_ties_everywhere() -> Result<()> {
        let rows: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), 0.0]).collect();
        let cloud = Cloud::from_rows("points", &rows)?;
        let detector = Harris3d::new(2.0);
        assert_eq!(detector.detect(&cloud, None, &Execution::default())?.len(), 100);
        let single = Harris3d { break_ties: true, nms_radius: 40.0, ..detector };
        assert_eq!(single.detect(&cloud, None, &Execution::default())?, [0]);
        let picky = Harris3d { threshold: 1e-6, ..detector };
        assert!(picky.detect(&cloud, None, &Execution::default())?.is_empty());
        Ok(())
    }

    #[test]
    fn tensor_of_three_axes() -> Result<()> {
        let rows = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]];
        let cloud = Cloud::from_rows("points", &rows)?;
        let normals = [Vector3::x(), Vector3::y(), Vector3::z()];
        let run = |response| {
            Harris3d { response, ..Harris3d::new(1.0) }.responses(
                &cloud,
                Some(&normals),
                &Execution::default(),
            )
        };
        assert!((run(Response::Harris)?[0] - 1.0 / 27.0).abs() < 1e-8);
        assert!((run(Response::Noble)?[0] - 1.0 / 27.0).abs() < 1e-15);
        assert!((run(Response::Lowe)?[0] - 1.0 / 27.0).abs() < 1e-15);
        assert!((run(Response::Tomasi)?[0] - 1.0 / 3.0).abs() < 1e-15);
        Ok(())
    }

    #[test]
    fn degenerate_input() -> Result<()> {
        let empty = Cloud::from_rows("points", &[])?;
        assert!(Harris3d::new(1.0).detect(&empty, None, &Execution::default())?.is_empty());
        let same = Cloud::from_rows("points", &[[1.0; 3]; 30])?;
        assert_eq!(Harris3d::new(1.0).detect(&same, None, &Execution::default())?.len(), 30);
        assert!(Harris3d::new(0.0).detect(&same, None, &Execution::default()).is_err());
        assert!(Harris3d::new(1.0).detect(&same, Some(&[]), &Execution::default()).is_err());
        Ok(())
    }
}
