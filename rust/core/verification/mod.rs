//! Judges poses by the surfaces of both clouds.
//!
//! Matches alone say little about two scans that overlap by a third: a wrong pose gathers as many of them by chance. Laying one
//! surface on the other says far more. Both surfaces' samples are moved onto the other one. A sample x that finds
//! a point y with normal m near by, with `e^2 = ((x - y) . m)^2 + 0.15 |x - y|^2`, agrees by `1 - e^2 / tolerance^2` if
//! their normals do; one that finds none, but lies before what the scanner saw, disagrees by 1, and one before its
//! background, facing the scanner, by 0.3. The score is the sum of both surfaces' means.
//!
//! [`verify`] scores all poses coarsely, refines the best by point-to-plane steps, and scores those again, twice. All lengths are
//! in units of some 0.4 of the distance between points. Cost: two looks into a grid per pose and sample; memory of a surface:
//! a few hundred bytes per point.

pub mod alignment;
pub mod fine_surface;
pub mod overlap;
pub mod places;
pub mod schedule;
pub mod surface;

mod group;
mod nearest_grid;
mod pose;
mod range_map;
mod refine;
mod sampling;
mod score;

pub use alignment::{Alignment, align, plane_distances};
pub use fine_surface::FineSurface;
pub use overlap::{Overlap, Resistance, overlap};
pub use places::{Place, places};
pub use schedule::{DIFFERENT, Evidence, Verified, margin, score_poses, verify};
pub use surface::{Side, Surface};
