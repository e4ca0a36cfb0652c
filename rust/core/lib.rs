//! 3D correspondence grouping: given putative point-to-point matches between two 3D shapes, most of
//! them wrong, find the right ones.
//!
//! The nine methods of J. Yang, K. Xian, P. Wang, Y. Zhang, *A Performance Evaluation of
//! Correspondence Grouping Methods for 3D Rigid Data Matching* (TPAMI 2019), and the front end that
//! feeds them.
//!
//! | the paper | here |
//! |---|---|
//! | correspondence set C, `c_i = (p_i, p'_i)` | [`Correspondences`] |
//! | group, inlier mask | [`Grouping`] |
//! | `r(c_i, c_j)` = min(ds/dt, dt/ds) (ST, GTM, SI) | [`compatibility::distance::distance_ratio`] |
//! | `r(c_i, c_j)` = \|ds - dt\| (GC, CV) | [`compatibility::distance::distance_difference`] |
//! | Otsu threshold | [`selection::otsu`] |
//! | SS, NNSR | [`grouping::similarity_score`], [`grouping::nearest_neighbor_ratio`] |
//! | SI, CV | [`grouping::search_of_inliers`], [`grouping::consistency_voting`] |
//! | RANSAC, ST, GC | [`grouping::ransac`], [`grouping::spectral`], [`grouping::geometric_consistency`] |
//! | 3DHV, GTM | [`grouping::hough_voting`], [`grouping::game_theory`] |
//!
//! Lengths are in the unit of the data; angles are in degrees where a name says so.

pub mod cloud;
pub mod compatibility;
pub mod correspondences;
pub mod error;
pub mod execution;
pub mod features;
pub mod frames;
pub mod geometry;
pub mod grouping;
pub mod grouping_result;
pub mod points;
pub mod selection;

pub use cloud::Cloud;
pub use correspondences::Correspondences;
pub use error::{Error, Result};
pub use execution::Execution;
pub use grouping::GroupingMethod;
pub use grouping_result::Grouping;
pub use points::Points;
