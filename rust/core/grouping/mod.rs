//! The grouping methods, one file each; the files know nothing of each other.

pub mod clipper;
pub mod consistency_voting;
pub mod game_theory;
pub mod geometric_consistency;
pub mod hough_voting;
pub mod likelihood_consensus;
pub mod mac;
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

use crate::{Correspondences, Execution, Grouping, Result};

/// A method whose parameters are set.
pub type BoxedMethod = Box<dyn GroupingMethod + Send + Sync>;

/// Every method by its public name, with default parameters.
pub fn methods() -> Vec<(&'static str, BoxedMethod)> {
    vec![
        ("ss", Box::new(SimilarityScore::default())),
        ("nnsr", Box::new(NearestNeighborRatio::default())),
        ("si", Box::new(SearchOfInliers::default())),
        ("cv", Box::new(ConsistencyVoting::default())),
        ("ransac", Box::new(Ransac::default())),
        ("st", Box::new(Spectral::default())),
        ("gc", Box::new(GeometricConsistency::default())),
        ("3dhv", Box::new(HoughVoting::default())),
        ("gtm", Box::new(GameTheory::default())),
        ("lc", Box::new(LikelihoodConsensus::default())),
        ("mac", Box::new(MaximalCliques::default())),
        ("sc2pcr", Box::new(Sc2Pcr::default())),
        ("turboreg", Box::new(TurboReg::default())),
        ("teaser", Box::new(Teaser::default())),
        ("clipper", Box::new(Clipper::default())),
    ]
}

/// A way to tell right correspondences from wrong ones.
pub trait GroupingMethod {
    /// Selects the correspondences that this method holds to be right.
    ///
    /// # Errors
    /// Options out of range, a field the method needs that is missing, or an interruption.
    fn group(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping>;

    /// Whether the group is found within a millisecond, so that handing it to another thread costs more than it saves.
    fn is_instant(&self, _correspondences: &Correspondences) -> bool {
        false
    }
}
