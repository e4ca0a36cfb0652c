//! The pose that a search found.

use nalgebra::Matrix6;

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::pose_graph::motion::{adjoint, inverse};
use crate::verification::{Alignment, overlap};

use super::covariance::covariance_of;
use super::level::Pair;
use super::posterior::Case;
use super::settings::{ACCEPTED, ACCEPTED_WITH_RIVALS};

/// Returns the share of the source's surface that overlaps the target's under a pose, that of the target's, and the root mean
/// square of the distances.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn overlap_at(pair: Pair<'_>, pose: &Rigid, execution: &Execution) -> Result<(f64, f64, f64)> {
    let (source, target) = (pair.source.surface(), pair.target.surface());
    let (one, other) =
        (overlap(source, target, pose, execution)?, overlap(target, source, &inverse(pose), execution)?);
    Ok((one.fitness, other.fitness, one.inlier_rmse))
}

/// The best pose of a search at one voxel size, with the evidence for it.
#[derive(Debug)]
pub struct Found {
    /// The best pose, refined on the fine surfaces.
    pub refined: Alignment,
    /// Other poses that share the probability.
    pub alternatives: Vec<Rigid>,
    /// Probability that the pose is right.
    pub probability: f64,
    /// Share of the source's surface that overlaps the target's.
    pub fitness: f64,
    /// Share of the target's surface that overlaps the source's.
    pub target_fitness: f64,
    /// Number of open motions.
    pub motions: usize,
    /// Evidence for the pose, and for its rivals.
    pub cases: Vec<Case>,
    /// Poses of these; the first was refined further.
    pub poses: Vec<Rigid>,
    /// Probability of each rival as a multiple of that of the pose.
    pub shares: Vec<f64>,
    /// Scale of the source that fits clearly better than 1, or 1.
    pub better_scale: f64,
    /// Factor of the probability by that scale.
    pub scale_factor: f64,
    /// Probability of the best pose of the mirrored source, which is wrong, if the scans were searched for it; 0 if that is a
    /// symmetry.
    pub decoy: Option<f64>,
}

impl Found {
    /// Returns whether the pose is accepted; more is needed if other poses share the probability.
    #[must_use]
    pub fn is_accepted(&self) -> bool {
        self.probability >= if self.alternatives.is_empty() { ACCEPTED } else { ACCEPTED_WITH_RIVALS }
    }

    /// Returns the inverse pose, with source and target swapped.
    #[must_use]
    pub fn turned(mut self) -> Self {
        let pose = self.refined.pose;
        // T^-1 = Exp(-Ad(T^-1) x) T_found^-1
        let (back, change) = (inverse(&pose), adjoint(&pose));
        let resistance = &mut self.refined.resistance;
        resistance.information = change.transpose() * resistance.information * change;
        resistance.open_motion = resistance.open_motion.map(|motion| -(adjoint(&back) * motion));
        self.refined.pose = back;
        for pose in self.alternatives.iter_mut().chain(&mut self.poses) {
            *pose = inverse(pose);
        }
        (self.fitness, self.target_fitness) = (self.target_fitness, self.fitness);
        self.better_scale = 1.0 / self.better_scale;
        self
    }

    /// Returns the covariance of the pose ([`covariance_of`]); the pair has the roles of the pose.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn covariance(&self, pair: Pair<'_>, execution: &Execution) -> Result<Matrix6<f64>> {
        match pair.fine(execution)? {
            Some(fine) => covariance_of(pair, fine, &self.refined, execution),
            None => Ok(Matrix6::repeat(f64::NAN)),
        }
    }
}
