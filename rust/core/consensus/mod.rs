//! Hypotheses of a rigid motion from samples, and their support among correspondences.

pub mod choice;
pub mod cliques;
pub mod coloring;
pub mod cores;
pub mod counter_rng;
pub mod false_alarms;
mod inlier_counter;
pub mod landing;
pub mod likelihood;
pub mod maximum_clique;
pub mod mixture;
pub mod modes;
pub mod reweighting;
pub mod sample_consensus;
pub mod stars;

pub use sample_consensus::{Consensus, SampleConsensus};
