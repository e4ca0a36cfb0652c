//! Options of a search for a pose.

use nalgebra::Vector3;

use crate::geometry::rigid::Rigid;
use crate::pose_graph::motion::inverse;

use super::level::Pair;
use super::nearby::Nearby;
use super::settings::MAX_TILT;

/// Length of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Effort {
    /// The first level only.
    First,
    /// Mutual matches only.
    Low,
    /// All matches too, if the mutual ones do not give a sure pose.
    #[default]
    Normal,
    /// Finer voxels too, with the three nearest matches of each.
    High,
}

/// Source of the proposed poses.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Proposer {
    /// Matches of voxels, grouped by LC; frames of matches; centres of parts.
    #[default]
    Voxels,
    /// The poses of [`Options::proposed`] alone.
    Given,
    /// A rough pose; nothing is matched.
    Nearby(Nearby),
}

/// A ball in which the moved origin of the source has to lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Its centre.
    pub center: [f64; 3],
    /// Its radius.
    pub radius: f64,
}

/// Options of a search.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Direction that both clouds share, such as gravity.
    pub axis: Option<[f64; 3]>,
    /// Length of the search.
    pub effort: Effort,
    /// Source of the proposed poses.
    pub proposer: Proposer,
    /// Poses from elsewhere that take part.
    pub proposed: Vec<Rigid>,
    /// Where the origin of the source has to lie.
    pub region: Option<Region>,
    /// Whether source and target of the search are those of the caller in turned roles.
    pub is_turned: bool,
    /// Whether the voxels are coarser than the prepared ones.
    pub is_coarse: bool,
}

impl Options {
    /// Returns the options of the search for the inverse pose. A search near a rough pose is never turned.
    #[must_use]
    pub fn turned(&self) -> Self {
        let proposed = self.proposed.iter().map(inverse).collect();
        Self { proposed, is_turned: !self.is_turned, ..self.clone() }
    }

    /// Returns whether matches of voxels take part.
    pub fn uses_matches(&self) -> bool {
        !matches!(self.proposer, Proposer::Nearby(_))
    }

    /// Returns whether a pose keeps the axis, and stays in the region and near the rough pose, if any.
    pub fn allows(&self, pose: &Rigid, pair: Pair<'_>) -> bool {
        let is_upright = self.axis.is_none_or(|axis| {
            let axis = Vector3::from(axis);
            axis.dot(&(pose.rotation * axis)) >= MAX_TILT.to_radians().cos() * axis.norm_squared()
        });
        let is_inside = self.region.is_none_or(|region| {
            let moved = if self.is_turned { inverse(pose).translation } else { pose.translation };
            (moved - Vector3::from(region.center)).norm() <= region.radius
        });
        let is_near = match &self.proposer {
            Proposer::Nearby(nearby) => nearby.holds(pose, pair.source),
            Proposer::Voxels | Proposer::Given => true,
        };
        is_upright && is_inside && is_near
    }
}
