//! Several rigid motions in one set of matches: bodies that moved apart, or instances of one model.
//!
//! 1. LC groups the matches. If its group is significant, its members are removed, and LC groups the rest,
//!    until no group is significant. A motion that moves its members like an earlier one, within 6 u, is not
//!    another one. The unit u is that of the first group.
//! 2. All motions are refined together by ten iterations of the [mixture](crate::consensus::mixture): shares,
//!    noise and poses.
//! 3. Each match goes to the motion of the greatest probability, if it is within 5 u of its place under it.
//! 4. A motion is dropped that moves its members like an earlier one, as in step 1, or that has lost more than
//!    half of its members if its rest is not significant among the matches of no other motion. Steps 2 and 3
//!    are repeated without it.

use super::GroupingMethod;
use super::likelihood_consensus::LikelihoodConsensus;
use super::match_posterior::Matches;
use crate::consensus::mixture::{CHANCE, Mixture, Motion};
use crate::geometry::rigid::Rigid;
use crate::grouping_result::mask_of;
use crate::rule::{Agreement, Kind, Rule};
use crate::{Correspondences, Execution, Grouping, Result, memory};

/// Tolerance, and displacement of the same motion, in units.
const TOLERANCE: f64 = 3.0;
const SAME: f64 = 6.0;

/// Iterations of the mixture.
const ROUNDS: usize = 10;

/// Bound on the number of false alarms of a group.
const MOST_FALSE_ALARMS: f64 = 0.01;

/// A motion as it was found.
struct Found {
    /// Between the centred points.
    pose: Rigid,
    rows: Vec<usize>,
    false_alarms: f64,
}

/// The groups of at most `most` motions, in the order in which they were found; disjoint.
///
/// Positions, ratio and resolution of the correspondences are used. The tolerance is that of LC, which
/// estimates one if there is neither. Scores are the probabilities of the mixture. The number of false alarms
/// is that among the matches left by earlier groups.
///
/// # Errors
/// [`crate::Error::MissingField`] without points, [`crate::Error::InvalidInput`] for a tolerance that is not
/// positive; [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn group_motions(
    correspondences: &Correspondences,
    tolerance: Option<f64>,
    most: usize,
    execution: &Execution,
) -> Result<Vec<Grouping>> {
    let (source, target) = correspondences.positions("group_motions")?;
    let (found, unit) = find(correspondences, tolerance, most, execution)?;
    let matches = Matches { source, target, unit, execution };
    if found.is_empty() {
        return Ok(Vec::new());
    }
    matches.share_out(found)
}

/// Step 1: the motions, and the unit.
fn find(
    correspondences: &Correspondences,
    tolerance: Option<f64>,
    most: usize,
    execution: &Execution,
) -> Result<(Vec<Found>, f64)> {
    let (source, target) = correspondences.positions("group_motions")?;
    let lc = LikelihoodConsensus { tolerance, ..LikelihoodConsensus::default() };
    let mut left = memory::collect(0..source.len())?;
    let (mut found, mut unit): (Vec<Found>, _) = (Vec::new(), None);
    while found.len() < most {
        let part = part_of(correspondences, &left, unit)?;
        let group = lc.group(&part, execution)?;
        let (Some(model), Some(true)) = (group.model, group.ok) else { break };
        let bound = group.rule.agreement.map_or(1.0, |agreement| agreement.bound);
        let given = tolerance.map(|tolerance| tolerance / 3.0).or(correspondences.resolution());
        let unit = *unit.get_or_insert(given.unwrap_or(bound / TOLERANCE));
        let selected = |&(k, _): &(usize, &usize)| group.mask[k];
        let rows = memory::collect(left.iter().enumerate().filter(selected).map(|(_, &i)| i))?;
        if rows.is_empty() {
            break;
        }
        let mut kept = group.mask.iter();
        left.retain(|_| kept.next() == Some(&false));
        let matches = Matches { source, target, unit, execution };
        // The points of a part are those of all, centred: so are its motions.
        let pose = Rigid::from_matrix(&model);
        let is_same = |other: &Found| matches.displacement(&pose, &other.pose, &rows) < SAME * unit;
        if !found.iter().any(is_same) {
            let false_alarms = group.false_alarms.unwrap_or_default();
            memory::push(&mut found, Found { pose, rows, false_alarms })?;
        }
    }
    Ok((found, unit.unwrap_or(1.0)))
}

/// Some of the matches, with the resolution given or found.
fn part_of(correspondences: &Correspondences, rows: &[usize], unit: Option<f64>) -> Result<Correspondences> {
    let (source, target) = correspondences.positions("group_motions")?;
    let mut part = Correspondences::between(source.subset(rows)?, target.subset(rows)?)?;
    if let Some(ratio) = correspondences.optional_ratio() {
        part = part.with_ratio(memory::collect(rows.iter().map(|&i| ratio[i]))?)?;
    }
    match correspondences.resolution().or(unit) {
        Some(resolution) => part.with_resolution(resolution),
        None => Ok(part),
    }
}

impl Matches<'_> {
    /// Steps 2 to 4.
    fn share_out(&self, mut found: Vec<Found>) -> Result<Vec<Grouping>> {
        let n = self.source.len();
        let mixture = Mixture::new(self.source, self.target, self.unit, self.execution)?;
        loop {
            let motion = |one: &Found| Motion::new(one.pose, one.rows.len(), n);
            let mut motions = memory::collect(found.iter().map(motion))?;
            // The first shares of many motions may exceed 1.
            let total = motions.iter().map(|motion| motion.share).sum::<f64>();
            motions.iter_mut().for_each(|motion| motion.share /= total.max(1.0) * (1.0 + 1.0 / n as f64));
            for _ in 0..ROUNDS {
                self.execution.check()?;
                mixture.improve(&mut motions, true)?;
            }
            let owners = self.owners(&mixture, &motions)?;
            match self.weakest(&found, &motions, &owners)? {
                Some(k) => drop(found.remove(k)),
                None => return self.report(&mixture, &found, &motions, &owners),
            }
        }
    }

    /// The motion of each match.
    fn owners(&self, mixture: &Mixture<'_>, motions: &[Motion]) -> Result<Vec<Option<usize>>> {
        let mut probabilities = memory::filled(0.0, motions.len())?;
        let mut owners = memory::with_capacity(self.source.len())?;
        for i in 0..self.source.len() {
            mixture.posteriors(motions, i, &mut probabilities);
            let best = |best: usize, k: usize| if probabilities[k] > probabilities[best] { k } else { best };
            let owner = (0..motions.len()).reduce(best);
            let is_near = |&k: &usize| mixture.square(&motions[k].pose, i) <= CHANCE * CHANCE;
            owners.push(owner.filter(is_near));
        }
        Ok(owners)
    }

    /// The last motion that equals an earlier one, or has lost its members.
    fn weakest(
        &self,
        found: &[Found],
        motions: &[Motion],
        owners: &[Option<usize>],
    ) -> Result<Option<usize>> {
        for k in (0..found.len()).rev() {
            let pose = &motions[k].pose;
            let rows = memory::collect((0..owners.len()).filter(|&i| owners[i] == Some(k)))?;
            let is_same = |other: &Motion| self.displacement(pose, &other.pose, &rows) < SAME * self.unit;
            if motions[..k].iter().any(is_same) {
                return Ok(Some(k));
            }
            if 2 * rows.len() >= found[k].rows.len() {
                continue;
            }
            let taken = memory::collect(owners.iter().map(|&owner| owner.is_some_and(|owner| owner != k)))?;
            let value = self.ln_false_alarms(pose, CHANCE * self.unit, &taken)?;
            if rows.is_empty() || value >= MOST_FALSE_ALARMS.ln() {
                return Ok(Some(k));
            }
        }
        Ok(None)
    }

    fn report(
        &self,
        mixture: &Mixture<'_>,
        found: &[Found],
        motions: &[Motion],
        owners: &[Option<usize>],
    ) -> Result<Vec<Grouping>> {
        let mut groups = memory::with_capacity(found.len())?;
        for (k, (one, motion)) in found.iter().zip(motions).enumerate() {
            let members = (0..owners.len()).filter(|&i| owners[i] == Some(k));
            let rule = Rule::bounded(Kind::Residual, CHANCE * self.unit).or_equal();
            let grouping = Grouping {
                mask: mask_of(owners.len(), members)?,
                scores: Some(mixture.posteriors_of(motions, k)?),
                model: Some(motion.pose.uncentered(self.source, self.target).to_matrix()),
                ok: Some(true),
                false_alarms: Some(one.false_alarms),
                noise: Some(motion.variance.sqrt() * self.unit),
                rule: rule.agreeing(Agreement::difference(TOLERANCE * self.unit)),
                ..Grouping::default()
            };
            groups.push(grouping.with("resolution", self.unit));
        }
        Ok(groups)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::test_problem::problem;

    /// The test problem, and its wrong matches moved back, in part.
    fn two_motions() -> Result<Correspondences> {
        let given = problem(400, 60)?;
        let (source, target) = given.positions("lc")?;
        let source_rows: Vec<[f64; 3]> = (0..400).map(|i| (source.get(i) + source.center()).into()).collect();
        let target_rows: Vec<[f64; 3]> = (0..400)
            .map(|i| match i {
                60..110 => [source_rows[i][0] + 9.0, -source_rows[i][2], source_rows[i][1]],
                _ => (target.get(i) + target.center()).into(),
            })
            .map(|q: [f64; 3]| q.map(|x| x + 500.0))
            .collect();
        Correspondences::new(&source_rows, &target_rows)?.with_resolution(1.0)
    }

    #[test]
    fn both_motions_are_found_and_their_matches_are_disjoint() -> Result<()> {
        let groups = group_motions(&two_motions()?, None, 20, &Execution::default())?;
        assert_eq!(groups.len(), 2);
        assert!(
            groups[0].mask[..60].iter().all(|&one| one) && groups[1].mask[60..110].iter().all(|&one| one)
        );
        assert!(groups[0].mask.iter().zip(&groups[1].mask).all(|(&a, &b)| !(a && b)));
        assert!(groups.iter().all(|one| one.size() < 70 && one.false_alarms < Some(0.01)));
        assert_eq!(group_motions(&two_motions()?, None, 1, &Execution::default())?.len(), 1);
        Ok(())
    }

    #[test]
    fn chance_and_few_matches_give_no_group() -> Result<()> {
        for (n, right) in [(0, 0), (2, 2), (3, 3), (300, 0)] {
            assert!(group_motions(&problem(n, right)?, None, 20, &Execution::default())?.is_empty());
        }
        Ok(())
    }
}
