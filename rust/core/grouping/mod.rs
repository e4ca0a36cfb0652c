//! The grouping methods, one file each, independent of each other.

pub mod bound;
pub mod clipper;
pub mod consistency_voting;
pub mod game_theory;
pub mod geometric_consistency;
pub mod hough_voting;
pub mod likelihood_consensus;
pub mod mac;
pub mod match_posterior;
pub mod motions;
pub mod nearest_neighbor_ratio;
pub mod ransac;
pub mod sc2pcr;
pub mod search_of_inliers;
pub mod similarity_score;
pub mod spectral;
pub mod teaser;
#[cfg(test)]
mod test_problem;
pub mod turboreg;

use clipper::Clipper;
use consistency_voting::ConsistencyVoting;
use game_theory::GameTheory;
use geometric_consistency::GeometricConsistency;
use hough_voting::HoughVoting;
use likelihood_consensus::LikelihoodConsensus;
use mac::MaximalCliques;
use nearest_neighbor_ratio::NearestNeighborRatio;
use ransac::Ransac;
use sc2pcr::Sc2Pcr;
use search_of_inliers::SearchOfInliers;
use similarity_score::SimilarityScore;
use spectral::Spectral;
use teaser::Teaser;
use turboreg::TurboReg;

use crate::options::Described;
use crate::{Correspondences, Execution, Grouping, Result};

/// A method with its options.
pub type BoxedMethod = Box<dyn GroupingMethod + Send + Sync>;

/// Every method by its public name, with default options.
pub fn methods() -> Vec<(&'static str, BoxedMethod)> {
    let methods: [BoxedMethod; _] = [
        Box::new(SimilarityScore::default()),
        Box::new(NearestNeighborRatio::default()),
        Box::new(SearchOfInliers::default()),
        Box::new(ConsistencyVoting::default()),
        Box::new(Ransac::default()),
        Box::new(Spectral::default()),
        Box::new(GeometricConsistency::default()),
        Box::new(HoughVoting::default()),
        Box::new(GameTheory::default()),
        Box::new(LikelihoodConsensus::default()),
        Box::new(MaximalCliques::default()),
        Box::new(Sc2Pcr::default()),
        Box::new(TurboReg::default()),
        Box::new(Teaser::default()),
        Box::new(Clipper::default()),
    ];
    methods.into_iter().map(|method| (method.name(), method)).collect()
}

/// A method that separates correct correspondences from wrong ones.
pub trait GroupingMethod: Described {
    /// Selects the correct correspondences, with options that are already checked.
    ///
    /// # Errors
    /// A missing field that the method requires, or an interruption.
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping>;

    /// Checks the options, and selects the correct correspondences.
    ///
    /// # Errors
    /// Those of [`GroupingMethod::run`], and options out of range.
    fn group(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        self.check_options()?;
        self.run(correspondences, execution)
    }

    /// Whether the group is found within a millisecond, so that handing it to another thread costs more than
    /// it saves.
    fn is_instant(&self, _correspondences: &Correspondences) -> bool {
        false
    }
}
