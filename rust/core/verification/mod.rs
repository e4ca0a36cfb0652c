//! Scores and refines poses by the surfaces of both clouds.
//!
//! Matches alone are weak evidence for two scans that overlap by a third: wrong poses gather as many by
//! chance. The surfaces are stronger evidence. Samples of each surface are moved onto the other. A sample x
//! with a near point y of normal m has the squared residual `e^2 = ((x - y) . m)^2 + 0.15 |x - y|^2`; it adds
//! `1 - e^2 / tolerance^2` if the normals agree. A sample without a near point subtracts 1 in front of the
//! surface that the scanner observed, and 0.3 if it faces the scanner in front of background, where the
//! scanner observed nothing. The score is the sum of both surfaces' means.
//!
//! [`verify`] scores all poses coarsely, refines the best by point-to-plane steps, and scores those again,
//! twice; [`race`] does so in more stages, with fewer samples. All lengths are in units of about 0.4 of the distance
//! between points. Cost: two grid lookups per
//! pose and sample; memory of a surface: a few hundred bytes per point.

pub mod alignment;
pub mod fine_surface;
pub mod overlap;
pub mod places;
pub mod schedule;
pub mod surface;

mod group;
mod nearest_grid;
mod pairing;
mod pose;
mod range_map;
mod refine;
mod sampling;
mod score;

pub use alignment::{Alignment, align, align_by, plane_distances, plane_distances_of, scatter_of_blocks};
pub use fine_surface::FineSurface;
pub use overlap::{Overlap, Resistance, overlap};
pub use places::{Place, places};
pub use schedule::{DIFFERENT, Evidence, Verified, margin, race, score_poses, verify};
pub use surface::{Side, Surface};
