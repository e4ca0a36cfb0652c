//! Point cloud registration and 3D correspondence grouping: finds the correct ones among putative matches
//! between the points of two 3D shapes, most of them wrong, and the pose that aligns the shapes.
//!
//! The core of the Python package of the same name, in pure Rust. It reads no files and no clock, prints
//! nothing, and returns the same bits on any number of threads. Vectors and matrices are nalgebra's:
//!
//! ```sh
//! cargo add cgroup --git https://github.com/cgroup-project/cgroup
//! cargo add nalgebra@0.35
//! ```
//!
//! | module | contents |
//! |---|---|
//! | [`grouping`] | fifteen methods that select the correct matches; each is a struct of its options and a [`GroupingMethod`] |
//! | [`features`] | voxels, normals, keypoints, frames, descriptors, matching |
//! | [`verification`] | scores and refines poses on the surfaces of both clouds |
//! | [`cloud_formats`] | reads clouds from the bytes of files: PLY, PCD, OBJ, OFF, STL, glTF, VTK, LAS, PTX, text and others |
//! | [`compatibility`], [`consensus`], [`selection`], [`geometry`] | components of the methods |
//!
//! Every long computation takes an [`Execution`], by which the caller can interrupt it, read its progress,
//! and bound its memory. Failures are an [`Error`]; the crate does not panic. Computations use rayon's
//! threads. Lengths are in the unit of the data; angles are in degrees if the name contains it.
//!
//! # Group matches
//!
//! `cargo run --release --example 01_group_matches`
//!
//! ```
#![doc = include_str!("../examples/01_group_matches.rs")]
//! ```
//!
//! # Register two scans
//!
//! The core of the Python package's `register`, without its search for rivals and its probability.
//! `cargo run --release --example 02_register_two_scans`
//!
//! ```
#![doc = include_str!("../examples/02_register_two_scans.rs")]
//! ```
//!
//! # Score a pose
//!
//! `cargo run --release --example 03_judge_a_pose`
//!
//! ```
#![doc = include_str!("../examples/03_judge_a_pose.rs")]
//! ```
//!
//! # The paper
//!
//! J. Yang, K. Xian, P. Wang, Y. Zhang, *A Performance Evaluation of Correspondence Grouping Methods for 3D
//! Rigid Data Matching* (TPAMI 2019): its nine methods and its front end, by section and equation.
//!
//! | the paper | section | equation | here |
//! |---|---|---|---|
//! | correspondences C, `c_i = (p_i, p'_i)` | 3 | | [`Correspondences`] |
//! | grouped inliers | 3 | | [`Grouping`] |
//! | SS, `1 - \|f - f'\| >= t_ss` | 3.1 | 1 | [`grouping::similarity_score`] |
//! | NNSR, `1 - d1/d2 >= t_nnsr` | 3.1 | 2 | [`grouping::nearest_neighbor_ratio`] |
//! | SI, votes and scores | 3.1 | 3, 5, 6; 12 | [`grouping::search_of_inliers`] |
//! | SI, `T(c)` | 3.1 | 4 | [`compatibility::pose::pose_of`] |
//! | SI, `v_G(c_i, c_j)` of one pair | 3.1 | 4 | [`compatibility::pose::residual`] |
//! | CV, `r`, `L`, `D` and scores | 3.1 | 7 to 11 | [`grouping::consistency_voting`] |
//! | threshold by Otsu's method (SS, SI, CV, GTM) | 3.1, Table 1 | | [`selection::otsu`] |
//! | RANSAC | 3.2 | | [`grouping::ransac`], [`consensus`] |
//! | ST | 3.2 | | [`grouping::spectral`] |
//! | principal eigenvector v (ST) | 3.2 | | [`selection::eigenvector`] |
//! | `r(c_i, c_j) = min(ds/dt, dt/ds)`, of all pairs (ST, GTM) | 3.2 | 12 | [`compatibility::matrix::PairScore::DistanceRatio`] |
//! | `r(c_i, c_j)` of one pair (RANSAC's option `edge_ratio`) | 3.2 | 12 | [`compatibility::distance::distance_ratio`] |
//! | `d(c_i, c_j) = \|ds - dt\| < t_gc`, of all pairs (GC) | 3.2 | 13 | [`compatibility::agreement`] |
//! | `d(c_i, c_j)` of one pair (GC) | 3.2 | 13 | [`compatibility::distance::distance_difference`] |
//! | GC, the largest cluster | 3.2 | | [`grouping::geometric_consistency`] |
//! | 3DHV | 3.2 | 14 to 16 | [`grouping::hough_voting`] |
//! | GTM, replicator dynamics | 3.2 | 17 | [`grouping::game_theory`] |
//! | payoff matrix (GTM) | 3.2 | 18 | [`compatibility::matrix::PairMatrix`] |

#![forbid(unsafe_code)]

pub mod cloud;
pub mod cloud_formats;
pub mod compatibility;
pub mod consensus;
pub mod correspondences;
pub mod error;
pub mod execution;
pub mod features;
pub mod frames;
pub mod geometry;
pub mod grouping;
pub mod grouping_result;
pub mod memory;
pub mod options;
pub mod points;
pub mod pose_graph;
pub mod registration;
pub mod rule;
pub mod selection;
mod simd;
pub mod targets;
pub mod verification;

pub use cloud::Cloud;
pub use correspondences::Correspondences;
pub use error::{Error, Result};
pub use execution::Execution;
pub use grouping::GroupingMethod;
pub use grouping_result::{Alternative, Grouping};
pub use points::Points;
