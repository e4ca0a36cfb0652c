//! ST: the main cluster of the pairwise affinity matrix, by its principal eigenvector.
//!
//! The paper, section 3.2, Eq. (12) (after Leordeanu, Hebert, ICCV 2005). Correspondences are accepted in the
//! order of their entries in the eigenvector; each accepted one excludes those in conflict with it. Cost
//! O(n^2) per power step and O(n selected) for the acceptance.

use super::GroupingMethod;
use crate::compatibility::matrix::{PairMatrix, PairPositions, PairScore};
use crate::error::shown;
use crate::options::{SHARE, Value, method, words};
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::eigenvector::{Eigenpair, Eigensolver, principal_eigenvector};
use crate::selection::top_k::largest;
use crate::{Correspondences, Error, Execution, Grouping, Points, Result, memory};

/// Entries up to this share of the largest one have no support.
const NO_SUPPORT: f64 = 1e-12;

/// Entries are compared in units of this share of the largest one: an iterated eigenvector has no more
/// digits.
const TIE: f64 = 1e-9;

/// Upper bound of affinities; sums of greater ones may be infinite.
const MOST_AFFINITY: f64 = 1e300;

words! {
    /// Pairwise affinity.
    pub enum Affinity {
        /// The distance ratio.
        Raw = Value::Word("raw"),
        /// The distance ratio if it is at least `min_distance_ratio`, else 0.
        Threshold = Value::Word("threshold"),
        /// 1 if the distance ratio is at least `min_distance_ratio`, else 0.
        Binary = Value::Word("binary"),
    }
}

words! {
    /// A correspondence's affinity with itself.
    pub enum Diagonal {
        /// 0.
        Zero = Value::Word("zero"),
        /// 1.
        One = Value::Word("one"),
        /// Its descriptor similarity, if positive.
        Score = Value::Word("score"),
    }
}

words! {
    /// Condition under which an accepted correspondence excludes another one.
    pub enum Conflict {
        /// Their distance ratio is below `min_distance_ratio`.
        Rigidity = Value::Word("rigidity"),
        /// They share a source or a target point.
        OneToOne = Value::Word("one_to_one"),
        /// Either of the two.
        Both = Value::Word("both"),
    }
}

method! {
    /// Parameters of the spectral technique.
    pub struct Spectral = "st", ["source", "target"], optional ["similarity"], {
        /// Correspondences with a lower `min(ds/dt, dt/ds)` conflict with each other.
        pub min_distance_ratio: f64 = 0.6, SHARE;
        /// That ratio; the ratio if it is at least `min_distance_ratio`, else 0; or 1 instead of the ratio.
        pub affinity: Affinity = Affinity::default();
        /// Affinity of a correspondence with itself; "score" is `similarity`.
        pub diagonal: Diagonal = Diagonal::default();
        /// An accepted correspondence excludes those below `min_distance_ratio`, those that share a point
        /// with it, or both.
        pub conflict: Conflict = Conflict::default();
        /// Power iteration; or, as a reference, Lanczos's method on a matrix of float64 (at most `16 n^2`
        /// bytes), accurate to full precision.
        pub eigensolver: Eigensolver = Eigensolver::default();
        /// Recompute the eigenvector of the remaining correspondences after each acceptance.
        pub recompute: bool = false;
    }
}

impl GroupingMethod for Spectral {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("st")?;
        let diagonal = self.diagonal(correspondences)?;
        let affinity = PairMatrix::new(source, target, self.pair_score(), diagonal, execution)?; // M, of Eq. (12)
        let eigenpair = principal_eigenvector(&affinity, self.eigensolver, execution)?; // M v = lambda v
        let mut accepted = Accepted::none(source.len())?;
        if eigenpair.value > 0.0 && source.len() >= 2 {
            let conflicts = Conflicts::new(self, source, target)?;
            if self.recompute {
                self.accept_recomputing(&affinity, &conflicts, &mut accepted, execution)?;
            } else {
                accept_greedily(&eigenpair.vector, &conflicts, &mut accepted, execution)?;
            }
        } // else M is 0: no pair is compatible
        Ok(self.report(eigenpair, accepted))
    }
}

impl Spectral {
    fn pair_score(&self) -> PairScore {
        match self.affinity {
            Affinity::Raw => PairScore::DistanceRatio,
            Affinity::Threshold => PairScore::DistanceRatioFrom(self.min_distance_ratio),
            Affinity::Binary => PairScore::DistanceRatioIndicator(self.min_distance_ratio),
        }
    }

    fn diagonal(&self, correspondences: &Correspondences) -> Result<Option<Vec<f64>>> {
        Ok(match self.diagonal {
            Diagonal::Zero => None,
            Diagonal::One => Some(memory::filled(1.0, correspondences.len())?),
            Diagonal::Score => {
                let similarity = correspondences.similarity("st with diagonal=\"score\"")?;
                if let Some(i) = similarity.iter().position(|&s| s > MOST_AFFINITY) {
                    let remedy = "affinities beyond 1e300 can't be summed; scale the similarities down";
                    let got = format!("{} in row {i}", shown(similarity[i]));
                    return Err(Error::invalid("similarity", got, remedy));
                }
                Some(memory::collect(similarity.iter().map(|s| s.max(0.0)))?)
            }
        })
    }

    /// Accepts one correspondence per eigenvector of the remaining ones.
    fn accept_recomputing(
        &self,
        affinity: &PairMatrix,
        conflicts: &Conflicts,
        accepted: &mut Accepted,
        execution: &Execution,
    ) -> Result<()> {
        let total = affinity.len();
        let mut alive = memory::collect(0..total)?;
        while !alive.is_empty() {
            let remaining = affinity.subset(&alive, execution)?;
            let eigenpair = principal_eigenvector(&remaining, self.eigensolver, execution)?;
            // Without any affinity the vector is uniform, and the lowest index is next.
            let chosen = alive[by_support(&eigenpair.vector, 1)?[0]];
            accepted.accept(chosen, conflicts.with(chosen)?);
            alive.retain(|&i| accepted.leaves_open(i));
            execution.report(total - alive.len(), total)?;
        }
        Ok(())
    }

    fn report(&self, eigenpair: Eigenpair, accepted: Accepted) -> Grouping {
        let kind = if self.recompute { Kind::RecomputedConflict } else { Kind::Conflict };
        let rule = Rule {
            decided_by: Some(accepted.excluded_by),
            conflicts: Some(accepted.conflicts),
            ..Rule::bounded(kind, self.min_distance_ratio)
                .agreeing(Agreement::ratio(self.min_distance_ratio).or_equal())
        };
        Grouping { scores: Some(eigenpair.vector), ..Grouping::from_mask(accepted.mask) }
            .with("eigenvalue", eigenpair.value)
            .with("power_steps", eigenpair.steps as f64)
            .by(rule)
    }
}

fn greatest(v: &[f64]) -> f64 {
    v.iter().copied().fold(0.0, f64::max)
}

/// The `k` strongest entries of `v`, strongest first; of equal ones the lowest index first.
fn by_support(v: &[f64], k: usize) -> Result<Vec<usize>> {
    let unit = TIE * greatest(v);
    let rounded = memory::collect(v.iter().map(|entry| (entry / unit).round()))?;
    largest(&rounded, k)
}

/// Accepts the strongest remaining entry of `v` until none is left.
fn accept_greedily(
    v: &[f64],
    conflicts: &Conflicts,
    accepted: &mut Accepted,
    execution: &Execution,
) -> Result<()> {
    let order = by_support(v, v.len())?;
    let least = NO_SUPPORT * greatest(v);
    for (rank, &i) in order.iter().enumerate() {
        if v[i] <= least {
            break;
        }
        if !accepted.leaves_open(i) {
            continue;
        }
        accepted.accept(i, conflicts.with(i)?);
        execution.report(rank + 1, order.len())?;
    }
    Ok(())
}

/// The accepted correspondences, and those that they exclude.
struct Accepted {
    mask: Vec<bool>,
    /// The first accepted correspondence in conflict with each.
    excluded_by: Vec<Option<usize>>,
    /// Number of accepted correspondences in conflict with each.
    conflicts: Vec<usize>,
}

impl Accepted {
    fn none(n: usize) -> Result<Self> {
        Ok(Self {
            mask: memory::filled(false, n)?,
            excluded_by: memory::filled(None, n)?,
            conflicts: memory::filled(0, n)?,
        })
    }

    fn accept(&mut self, chosen: usize, mut conflicting: Vec<bool>) {
        self.mask[chosen] = true;
        conflicting[chosen] = false;
        let others = self.excluded_by.iter_mut().zip(&mut self.conflicts);
        for ((excluded_by, conflicts), conflict) in others.zip(conflicting) {
            *excluded_by = excluded_by.or(conflict.then_some(chosen));
            *conflicts += usize::from(conflict);
        }
    }

    /// Whether a correspondence is neither accepted nor excluded.
    fn leaves_open(&self, i: usize) -> bool {
        !self.mask[i] && self.excluded_by[i].is_none()
    }
}

/// Test of the correspondences that exclude a given one.
struct Conflicts {
    positions: PairPositions<f64>,
    rule: Conflict,
    min_distance_ratio: f64,
}

impl Conflicts {
    fn new(options: &Spectral, source: &Points, target: &Points) -> Result<Self> {
        let positions = PairPositions::new(source, target)?;
        Ok(Self { positions, rule: options.conflict, min_distance_ratio: options.min_distance_ratio })
    }

    fn with(&self, i: usize) -> Result<Vec<bool>> {
        let mut ratios = memory::filled(0.0, self.positions.len())?;
        self.positions.fill_row(PairScore::DistanceRatio, i, &mut ratios);
        let not_rigid = |rho: f64| rho < self.min_distance_ratio;
        let share_a_point = |rho: f64| rho <= 0.0; // a zero-length edge
        let conflict = |&rho: &f64| match self.rule {
            Conflict::Rigidity => not_rigid(rho),
            Conflict::OneToOne => share_a_point(rho),
            Conflict::Both => not_rigid(rho) || share_a_point(rho),
        };
        memory::collect(ratios.iter().map(conflict))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem() -> Result<Correspondences> {
        let source = [[0., 0., 0.], [4., 0., 0.], [0., 3., 0.], [0., 0., 5.], [1., 1., 1.], [4., 0., 0.]];
        let mut target = source.map(|p| [p[0] + 10.0, p[1], p[2]]);
        target[4] = [90.0, 9.0, 2.0];
        target[5] = [10.0, 0.1, 0.1];
        Correspondences::new(&source, &target)?.with_similarity(vec![0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    }

    #[test]
    fn accepts_rigidly_moved_points() -> Result<()> {
        for (eigensolver, recompute) in
            [(Eigensolver::Power, false), (Eigensolver::Dense, false), (Eigensolver::Power, true)]
        {
            let method = Spectral { eigensolver, recompute, ..Spectral::default() };
            let group = method.group(&problem()?, &Execution::default())?;
            assert_eq!(group.mask, [true, true, true, true, false, false], "{method:?}");
        }
        Ok(())
    }

    #[test]
    fn one_to_one_conflicts_alone_accept_nearly_all() -> Result<()> {
        let method = Spectral { conflict: Conflict::OneToOne, ..Spectral::default() };
        let group = method.group(&problem()?, &Execution::default())?;
        // 1 and 5 share a source point: only one of them stays.
        assert_eq!(group.mask, [true, true, true, true, true, false]);
        Ok(())
    }

    #[test]
    fn no_affinity_no_group() -> Result<()> {
        for n in 0..3 {
            let rows = vec![[1.0, 2.0, 3.0]; n];
            let group =
                Spectral::default().group(&Correspondences::new(&rows, &rows)?, &Execution::default())?;
            assert_eq!(group.size(), 0);
        }
        let (source, target) = ([[0.; 3], [1., 0., 0.]], [[0.; 3], [2., 0., 0.]]);
        let group =
            Spectral::default().group(&Correspondences::new(&source, &target)?, &Execution::default())?;
        assert_eq!(group.mask, [true, false], "two in conflict: the lower index stays");
        Ok(())
    }
}
