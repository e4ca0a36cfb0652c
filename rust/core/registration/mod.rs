//! Registration: the pose of two scans with its probability.
//!
//! A [`Prepared`] scan has levels from coarse to fine voxels. [`register`] searches them until a pose is sure: it proposes poses
//! from matches of voxels, verifies them on the surfaces, refines the best on fine surfaces, and compares them with their rivals and
//! with chance.

mod apex;
mod clock;
mod covariance;
mod decoy;
mod evidence;
mod found;
mod layers;
mod lazy;
mod level;
mod motions;
mod nearby;
mod options;
mod parts;
mod planes;
mod posterior;
mod prepared;
mod proposals;
mod register;
mod rings;
mod rivals;
mod scaled;
mod scan;
mod search;
mod settings;
mod similarity;
mod voxel_size;

pub use clock::STAGES;
pub use covariance::covariance_of;
pub use evidence::Evidence;
pub use found::{Found, overlap_at};
pub use layers::shows_layers;
pub use level::{Described, Level, Outside, Pair, Radii, Refusal};
pub use nearby::Nearby;
pub use options::{Effort, Options, Proposer, Region};
pub use posterior::{Case, share_probability};
pub use prepared::Prepared;
pub use proposals::VoxelMatches;
pub use register::{Outcome, Registered, register};
pub use rings::{Filled, MOST_POINTS as MOST_OF_RINGS, fill_between_rings};
pub use scaled::{ScaleOutcome, Scaled, find_scale};
pub use scan::{Scan, find_outliers};
pub use search::{choose_apart, confirm};
pub use settings::MOST_VOXELS;
pub use similarity::{Similarity, fit_similarity};
pub use voxel_size::{Suited, suit_voxel};
