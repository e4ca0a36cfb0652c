//! Do two correspondences agree? Pairwise terms, and matrices of them.

pub mod consistency;
pub mod distance;
pub mod kernels;
pub mod lanes;
pub mod lrf_angle;
pub mod matrix;
pub mod pair_scores;
pub mod vector_math;
