//! Agreement of two correspondences: terms of a pair, votes, and matrices of all pairs.

pub mod agreement;
pub mod distance;
pub mod graph;
pub(crate) mod long_agreement;
pub(crate) mod lrf_angle;
pub mod matrix;
pub mod pose;
pub(crate) mod votes;
