//! Tools that several grouping methods share.

pub mod counter_rng;
pub mod eigenvector;
pub mod otsu;
pub mod sample_consensus;
pub mod top_k;
