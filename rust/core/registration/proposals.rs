//! Matches of voxels, and poses proposed by them.

use nalgebra::{Matrix3, Vector3};

use crate::correspondences::Correspondences;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::features::matching::{Match, Matching};
use crate::frames::Frame;
use crate::geometry::rigid::{Rigid, fit_group};
use crate::grouping::likelihood_consensus::LikelihoodConsensus;
use crate::grouping_result::Grouping;
use crate::memory;
use crate::points::Points;
use crate::verification::schedule::Evidence;

use super::level::Pair;
use super::settings::UNIT;

/// Tolerance of LC, in resolutions of the matches.
const RESOLUTIONS: f64 = 3.0;

/// Matches of the described voxels of two scans.
#[derive(Debug)]
pub struct VoxelMatches {
    /// Rows of the described voxels, ratio and rank, in ascending order of the source.
    pub matches: Vec<Match>,
    /// Rows of the mutual nearest matches.
    pub mutual: Vec<usize>,
    /// Positions of the matched source voxels.
    pub source: Vec<[f64; 3]>,
    /// Positions of the matched target voxels.
    pub target: Vec<[f64; 3]>,
    /// Frames of both.
    pub frames: Vec<(Frame, Frame)>,
    resolution: f64,
    mirror: Option<Matrix3<f64>>,
}

impl VoxelMatches {
    /// Matches every described voxel of the source, or of its mirror image, with its k nearest of the target.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn find(
        pair: Pair<'_>,
        k: usize,
        mirror: Option<Matrix3<f64>>,
        execution: &Execution,
    ) -> Result<Self> {
        let (source, target) = (pair.source.described(execution)?, pair.target.described(execution)?);
        let matching = Matching { k, ..Matching::default() };
        let matches = if mirror.is_some() {
            matching.run(&source.mirrored()?, &target.descriptors, execution)?
        } else {
            matching.run(&source.descriptors, &target.descriptors, execution)?
        };
        let is_mutual = |row: &usize| matches[*row].is_mutual && matches[*row].rank == 1;
        Ok(Self {
            mutual: memory::collect((0..matches.len()).filter(is_mutual))?,
            source: memory::collect(matches.iter().map(|found| source.points[found.source]))?,
            target: memory::collect(matches.iter().map(|found| target.points[found.target]))?,
            frames: memory::collect(
                matches.iter().map(|found| (source.frames[found.source], target.frames[found.target])),
            )?,
            matches,
            resolution: UNIT * pair.voxel(),
            mirror,
        })
    }

    /// Returns no matches.
    pub fn none(pair: Pair<'_>) -> Self {
        let resolution = UNIT * pair.voxel();
        Self {
            matches: vec![],
            mutual: vec![],
            source: vec![],
            target: vec![],
            frames: vec![],
            resolution,
            mirror: None,
        }
    }

    /// Returns the matches with source and target swapped; each keeps its distances.
    #[must_use]
    pub fn turned(mut self) -> Self {
        std::mem::swap(&mut self.source, &mut self.target);
        for (one, other) in &mut self.frames {
            std::mem::swap(one, other);
        }
        for found in &mut self.matches {
            std::mem::swap(&mut found.source, &mut found.target);
        }
        self
    }

    /// Returns the poses of LC's groups of some of the matches.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn propose_by_lc(&self, rows: Option<&[usize]>, execution: &Execution) -> Result<Vec<Rigid>> {
        let mut poses = propose_by_lc(&self.correspondences(rows)?, execution)?;
        if let Some(mirror) = self.mirror {
            poses.iter_mut().for_each(|pose| pose.rotation *= mirror);
        }
        Ok(poses)
    }

    /// Returns the positions, those of the source mirrored as they were matched, and ratios of some of the matches.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn correspondences(&self, rows: Option<&[usize]>) -> Result<Correspondences> {
        let all = memory::collect(0..self.matches.len())?;
        let rows = rows.unwrap_or(&all);
        let mirror = self.mirror.unwrap_or_else(Matrix3::identity);
        let source =
            memory::collect(rows.iter().map(|&row| (mirror * Vector3::from(self.source[row])).into()))?;
        let target = memory::collect(rows.iter().map(|&row| self.target[row]))?;
        let ratios = memory::collect(rows.iter().map(|&row| self.matches[row].ratio()))?;
        Correspondences::new(&source, &target)?.with_ratio(ratios)?.with_resolution(self.resolution)
    }

    /// Returns the mutual matches as evidence for poses.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn evidence(&self, tolerance: f64) -> Result<Evidence> {
        let side = |name, points: &[[f64; 3]]| {
            Points::from_rows(name, &memory::collect(self.mutual.iter().map(|&row| points[row]))?)
        };
        let (source, target) = (side("source", &self.source)?, side("target", &self.target)?);
        Ok(Evidence { source, target, tolerance })
    }

    /// Returns the pose of every mutual match whose frames are known, `R = L'^T L`, `t = q - R p`. The y axis of a mirrored frame
    /// is the product of the others, so it changes its sign.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn frame_poses(&self) -> Result<Vec<Rigid>> {
        let side = if self.mirror.is_some() { -1.0 } else { 1.0 };
        let sides = Matrix3::from_diagonal(&Vector3::new(1.0, side, 1.0));
        let pose = |&row: &usize| {
            let (one, other) = self.frames[row];
            let rotation: Matrix3<f64> = other?.transpose() * sides * one?;
            let translation = Vector3::from(self.target[row]) - rotation * Vector3::from(self.source[row]);
            Some(Rigid { rotation, translation })
        };
        memory::collect(self.mutual.iter().filter_map(pose))
    }
}

/// Returns the poses of LC's groups of matches.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn propose_by_lc(matches: &Correspondences, execution: &Execution) -> Result<Vec<Rigid>> {
    let tolerance = RESOLUTIONS * matches.resolution().unwrap_or_default();
    LikelihoodConsensus::default().propose(matches, tolerance, execution)
}

/// Returns the poses of a group: its alternatives or its model, or else its least-squares fit; none if the group leaves the
/// pose open.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn poses_of(grouping: &Grouping, matches: &Correspondences) -> Result<Vec<Rigid>> {
    if let Some(alternatives) = &grouping.alternatives {
        return memory::collect(alternatives.iter().map(|pose| Rigid::from_matrix(&pose.model)));
    }
    if let Some(model) = &grouping.model {
        return Ok(vec![Rigid::from_matrix(model)]);
    }
    let (source, target) = matches.positions("register")?;
    let selected = grouping.mask.iter().enumerate().filter(|(_, selected)| **selected);
    let rows = memory::collect(selected.map(|(row, _)| row))?;
    match fit_group(source, target, &rows) {
        Ok(pose) => Ok(vec![pose]),
        Err(Error::NoConsensus { .. }) => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}
