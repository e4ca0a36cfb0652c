//! Poses from correspondences whose frames propose similar poses.
//!
//! A star is a centre correspondence with the members whose targets match the pose of the centre's frames.
//! The motion fitted to their points and frames is a hypothesis.

use nalgebra::{Matrix3, Point3};
use rayon::prelude::*;

use crate::compatibility::graph::AgreementGraph;
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::{Rigid, fit_posed};
use crate::memory;
use crate::points::Points;
use crate::selection::top_k::largest;

/// Greatest angle between the rotations proposed by two frames.
pub const FRAME_ANGLE: f64 = std::f64::consts::PI / 6.0;

/// Heaviest stars that propose hypotheses, and members of each that propose one with the centre alone.
const MOST_STARS: usize = 300;
const MOST_PAIRS: usize = 3;

/// Standard deviation of a correct frame's angle: 10 degrees.
pub const FRAME_DEVIATION: f64 = std::f64::consts::PI / 18.0;

/// Input of the star search, between centred points.
#[derive(Debug, Clone, Copy)]
pub struct Stars<'a> {
    /// Matched points.
    pub source: &'a Points,
    /// Their matches.
    pub target: &'a Points,
    /// The rotation proposed by the frames of each correspondence.
    pub rotations: &'a [Option<Matrix3<f64>>],
    /// Correspondences that agree in distance; its indices are those of `vertices`.
    pub graph: &'a AgreementGraph,
    /// The rows of the graph's vertices.
    pub vertices: &'a [usize],
    /// Greatest distance difference of two agreeing correspondences.
    pub tolerance: f64,
    /// Standard deviation of a correct match.
    pub deviation: f64,
}

impl Stars<'_> {
    /// The motions of the largest stars, each followed by those of its centre with some members.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn poses(&self, execution: &Execution) -> Result<Vec<Rigid>> {
        let size = |center: usize| execution.check().map(|()| self.members(center).count() as f64);
        let sizes = memory::par_try_collect((0..self.vertices.len()).into_par_iter().map(size))?;
        let largest = largest(&sizes, MOST_STARS)?;
        let poses = |&center: &usize| execution.check().and_then(|()| self.poses_of(center));
        memory::concat(&memory::par_try_collect(largest.par_iter().map(poses))?)
    }

    /// The rows in the star of a vertex: the pose of either one's frames maps the other to its target, up to
    /// the angular error of frames.
    fn members(&self, center: usize) -> impl Iterator<Item = usize> {
        let i = self.vertices[center];
        let (p, q) = (self.source.get(i), self.target.get(i));
        let (least_trace, slack) = (1.0 + 2.0 * FRAME_ANGLE.cos(), 2.0 * (0.5 * FRAME_ANGLE).sin());
        let neighbors = self.rotations[i].map(|rotation| (rotation, self.graph.neighbors(center)));
        neighbors.into_iter().flat_map(move |(rotation, neighbors)| {
            neighbors.map(|k| self.vertices[k]).filter(move |&j| {
                let (a, b) = (self.source.get(j) - p, self.target.get(j) - q);
                let reach = self.tolerance + slack * a.norm();
                self.rotations[j].is_some_and(|other| {
                    rotation.dot(&other) > least_trace
                        && (rotation * a - b).norm() < reach
                        && (other * a - b).norm() < reach
                })
            })
        })
    }

    fn poses_of(&self, center: usize) -> Result<Vec<Rigid>> {
        let members = memory::collect(self.members(center))?;
        if members.is_empty() {
            return Ok(Vec::new());
        }
        let center = self.vertices[center];
        let all = self.fit(std::iter::once(center).chain(members.iter().copied()));
        let pairs = members.iter().take(MOST_PAIRS).map(|&j| self.fit([center, j].into_iter()));
        memory::try_collect(std::iter::once(all).chain(pairs))
    }

    fn fit(&self, members: impl Iterator<Item = usize>) -> Result<Rigid> {
        let (mut p, mut q, mut weights) = (Vec::<Point3<f64>>::new(), Vec::new(), Vec::new());
        let mut turns = Matrix3::zeros();
        for i in members {
            memory::push(&mut p, self.source.get(i))?;
            memory::push(&mut q, self.target.get(i))?;
            memory::push(&mut weights, 1.0)?;
            turns += self.rotations[i].unwrap_or_else(Matrix3::zeros);
        }
        Ok(fit_posed(&p, &q, &weights, &(turns * (self.deviation / FRAME_DEVIATION).powi(2))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn the_largest_star_gives_the_motion_of_its_matches() -> Result<()> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 50.0 * (i as f64 * f * k + k).sin());
        let rows: Vec<[f64; 3]> = (0..60).map(|i| place(i, 1.0)).collect();
        let moved = |(i, p): (usize, &[f64; 3])| if i < 5 { [-p[1], p[0], p[2]] } else { place(i, 0.7) };
        let target: Vec<_> = rows.iter().enumerate().map(moved).collect();
        let (source, target) = (Points::from_rows("source", &rows)?, Points::from_rows("target", &target)?);
        let quarter = Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
        let turn = |i: usize| match i {
            0..5 => Some(quarter.into_inner()),
            5 => None,
            _ => Some(Rotation3::new(nalgebra::Vector3::new(i as f64, 0.7 * i as f64, 1.0)).into_inner()),
        };
        let rotations: Vec<_> = (0..60).map(turn).collect();
        let (source, target, rotations) = (&source, &target, &rotations[..]);
        let graph = AgreementGraph::new(source, target, 1.0, 2.0, &Execution::default())?;
        let vertices: Vec<usize> = (0..60).collect();
        let stars = Stars {
            source,
            target,
            rotations,
            graph: &graph,
            vertices: &vertices,
            tolerance: 1.0,
            deviation: 0.9,
        };
        let poses = stars.poses(&Execution::default())?;
        let best = poses.first().map_or_else(Matrix3::zeros, |pose| pose.rotation);
        assert!((best - quarter.into_inner()).norm() < 1e-9, "{best}");
        Ok(())
    }
}
