//! Do two correspondences agree? Pairwise terms, and matrices of them.

pub mod consistency;
pub mod distance;
pub mod distance_agreement;
pub mod inlier_counter;
pub mod kernels;
pub mod lanes;
pub mod lrf_angle;
pub mod matrix;
pub mod pair_scores;
mod tiles;
pub mod vector_math;
pub mod vote_kernels;
