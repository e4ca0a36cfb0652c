//! The search at one voxel size: propose, verify on the surfaces, refine, compare.

use std::sync::OnceLock;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::verification::schedule::Evidence as MatchedPoints;
use crate::verification::{Alignment, DIFFERENT, Verified, align, align_by, race, score_poses};

use super::clock::{Clock, Stage};
use super::covariance::{count_open_motions, resisted};
use super::decoy::{Chance, Decoy};
use super::evidence::{Evidence, misfit};
use super::found::{Found, overlap_at};
use super::level::{FinePair, Pair};
use super::options::{Effort, Options, Proposer};
use super::parts::propose_by_parts;
use super::posterior::{
    Case, bound_by_motions, bound_by_size, is_accepted, is_alternative, share_probability,
};
use super::proposals::VoxelMatches;
use super::rivals::propose_rivals;
use super::settings::{
    AGREEING, CLOSELY, FACTORS, FINALISTS, FINALLY, FIRST_FINALISTS, KEPT, LESS_MISFIT, NEARBY_FINALISTS,
    RIVALS, ROUGHLY, SURE, UNIT,
};
use super::similarity::compare_scales;

/// Two scans with their matches and options.
pub(super) struct Run<'a> {
    pub pair: Pair<'a>,
    pub fine: FinePair<'a>,
    pub matches: VoxelMatches,
    pub decoy: OnceLock<Option<Decoy>>,
    pub options: &'a Options,
    pub clock: &'a Clock,
    pub execution: &'a Execution,
}

/// Searches for the pose of two scans at one voxel size, matching each voxel with its k nearest; returns
/// the matches too, and none if no pose can be proposed.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn search(
    pair: Pair<'_>,
    options: &Options,
    k: usize,
    clock: &Clock,
    execution: &Execution,
) -> Result<Option<(Found, VoxelMatches)>> {
    let fine = pair.fine(execution)?;
    clock.end(Stage::Levels);
    let Some(fine) = fine else { return Ok(None) };
    let matches = if options.uses_matches() {
        VoxelMatches::find(pair, k, None, execution)?
    } else {
        VoxelMatches::none(pair)
    };
    if options.uses_matches() {
        clock.end(Stage::Matching);
    }
    let run = Run::new((pair, fine), matches, options, clock, execution);
    if let Proposer::Nearby(nearby) = &options.proposer {
        let mut verified = run.verify(&nearby.propose(pair, execution)?, KEPT.0)?;
        verified.truncate(NEARBY_FINALISTS);
        let mut finalists = run.align(&verified, None)?;
        finalists.retain(|one| !one.found.residuals.is_empty());
        let best = if finalists.is_empty() { None } else { Some(run.judge(&mut finalists)?) };
        return Ok(best.map(|best| (best, run.matches)));
    }
    let mut poses = memory::copied(&options.proposed)?;
    if options.proposer == Proposer::Voxels {
        memory::extend(&mut poses, &run.propose()?)?;
    }
    let verified = run.verify(&poses, KEPT.0)?;
    let best = run.rank(&verified)?;
    let is_sure = best.as_ref().is_some_and(|best| best.probability >= SURE);
    let is_brief = matches!(options.effort, Effort::First | Effort::Low);
    let is_last = is_brief || options.is_coarse || options.proposer == Proposer::Given;
    if is_last || is_sure {
        return Ok(best.map(|best| (best, run.matches)));
    }
    let mut poses = memory::collect(verified.iter().map(|found| found.pose))?;
    memory::extend(&mut poses, &run.matches.propose_by_lc(None, execution)?)?;
    let (one, other) = (pair.source.parts()?, pair.target.parts()?);
    memory::extend(&mut poses, &propose_by_parts(one, other, pair.voxel(), execution)?)?;
    clock.end(Stage::Grouping);
    // Not the more probable of the two: the second has seen the rivals of the first.
    let best = run.rank(&run.verify(&poses, KEPT.0)?)?.or(best);
    Ok(best.map(|best| (best, run.matches)))
}

/// Refines one pose, and estimates its probability alone, without matches or rivals; none without overlap.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn confirm(pair: Pair<'_>, pose: &Rigid, execution: &Execution) -> Result<Option<Found>> {
    let Some(fine) = pair.fine(execution)? else { return Ok(None) };
    let refined = align(fine.source, fine.target, pose, usize::MAX, execution)?;
    if refined.residuals.is_empty() {
        return Ok(None);
    }
    let (options, clock) = (Options { proposer: Proposer::Given, ..Options::default() }, Clock::default());
    let run = Run::new((pair, fine), VoxelMatches::none(pair), &options, &clock, execution);
    let score = score_poses(pair.source.surface(), pair.target.surface(), &[refined.pose], execution)?[0];
    let misfit = misfit(&refined, pair.voxel())?;
    let mut finalists = [Finalist { found: refined, score, support: 0, misfit, value: 0.0, case: None }];
    let mut found = run.judge(&mut finalists)?;
    if found.motions == 0 {
        found.refined.resistance.open_motion = None;
    }
    run.measure(&mut found)?;
    Ok(Some(found))
}

/// Refines the best pose with all samples, also of surfaces at a finer spacing, compares the scales, and measures the overlap.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn finish(
    pair: Pair<'_>,
    found: &mut Found,
    finer: Option<f64>,
    options: &Options,
    execution: &Execution,
) -> Result<()> {
    let Some(fine) = pair.fine(execution)? else { return Ok(()) };
    let clock = Clock::default();
    let run = Run::new((pair, fine), VoxelMatches::none(pair), options, &clock, execution);
    let refined = align_by(fine.source, fine.target, &found.refined.pose, &FINALLY, execution)?;
    if run.is_allowed(&refined.pose) {
        found.refined = refined;
    }
    if let Some(spacing) = finer {
        let (one, other) = (pair.source.scan(), pair.target.scan());
        let both =
            rayon::join(|| one.fine_surface(spacing, execution), || other.fine_surface(spacing, execution));
        if let (Some(one), Some(other)) = (both.0?, both.1?) {
            let refined = align_by(&one, &other, &found.refined.pose, &FINALLY, execution)?;
            if run.is_allowed(&refined.pose) && !refined.residuals.is_empty() {
                found.refined.pose = refined.pose;
                found.refined.residuals = refined.residuals;
            }
        }
    }
    if found.motions == 0 {
        found.refined.resistance.open_motion = None;
    }
    run.measure(found)
}

/// A refined pose with its score.
pub(super) struct Finalist {
    pub found: Alignment,
    score: f64,
    support: usize,
    misfit: f64,
    value: f64,
    pub case: Option<Case>,
}

/// Rows of the finalists that differ, the best first, with the evidence for them.
struct Compared {
    rows: Vec<usize>,
    cases: Vec<Case>,
    shares: Vec<f64>,
    probability: f64,
}

impl Finalist {
    fn weight(&self) -> f64 {
        self.case.map_or(f64::NEG_INFINITY, |case| case.weight())
    }
}

fn best_case(finalists: &[Finalist]) -> Option<Case> {
    finalists.iter().max_by(|one, other| one.weight().total_cmp(&other.weight()))?.case
}

impl<'a> Run<'a> {
    fn new(
        (pair, fine): (Pair<'a>, FinePair<'a>),
        matches: VoxelMatches,
        options: &'a Options,
        clock: &'a Clock,
        execution: &'a Execution,
    ) -> Self {
        Self { pair, fine, matches, decoy: OnceLock::new(), options, clock, execution }
    }

    /// Verifies the allowed poses; returns the best, also allowed.
    pub(super) fn verify(&self, poses: &[Rigid], kept: [usize; 3]) -> Result<Vec<Verified>> {
        let allowed = memory::collect(poses.iter().copied().filter(|pose| self.is_allowed(pose)))?;
        if allowed.is_empty() {
            return Ok(Vec::new());
        }
        let (source, target) = (self.pair.source.surface(), self.pair.target.surface());
        let evidence: MatchedPoints = self.matches.evidence(AGREEING * UNIT * self.pair.voxel())?;
        let mut found = race(source, target, &allowed, &evidence, kept, self.execution)?;
        found.retain(|one| self.is_allowed(&one.pose));
        self.clock.end(Stage::Verification);
        Ok(found)
    }

    fn is_allowed(&self, pose: &Rigid) -> bool {
        self.options.allows(pose, self.pair)
    }

    /// Proposes poses from mutual matches.
    pub(super) fn propose(&self) -> Result<Vec<Rigid>> {
        let mut poses = self.matches.propose_by_lc(Some(&self.matches.mutual), self.execution)?;
        memory::extend(&mut poses, &self.matches.frame_poses()?)?;
        self.clock.end(Stage::Grouping);
        Ok(poses)
    }

    /// Refines the finalists on the fine surfaces, selects one, and estimates its probability.
    fn rank(&self, verified: &[Verified]) -> Result<Option<Found>> {
        let mut finalists = self.settle(verified)?;
        if finalists.is_empty() {
            return Ok(None);
        }
        let mut chance = None;
        let mut compared = self.compare(&mut finalists, None)?;
        if self.options.proposer == Proposer::Voxels {
            chance = Some(self.chance(&finalists[compared.rows[0]].found.pose)?);
            compared = self.compare(&mut finalists, chance.as_ref())?;
        }
        if is_accepted(compared.probability) {
            let best = &finalists[compared.rows[0]].found;
            let (pose, resisted) = (best.pose, resisted(self.pair, best)?);
            let slides: Matrix3<f64> = best.resistance.information.fixed_view::<3, 3>(3, 3).into_owned();
            let poses = propose_rivals(self.pair, &pose, self.prepared_voxel(), &resisted, &slides)?;
            let mut rivals = self.verify(&poses, KEPT.1)?;
            // Most slides fall back to the pose itself.
            rivals.retain(|one| self.choose_apart(&[pose, one.pose]).len() == 2);
            finalists.extend(self.align(&rivals, best_case(&finalists))?);
            compared = self.compare(&mut finalists, chance.as_ref())?;
        }
        let mut found = self.conclude(&finalists, compared)?;
        found.decoy =
            chance.map(|chance| chance.decoy.map_or(0.0, |decoy| decoy.probability(&found.cases[0])));
        Ok(Some(found))
    }

    /// Refines some verified poses, the best first, and gathers the evidence for those that may matter.
    pub(super) fn settle(&self, verified: &[Verified]) -> Result<Vec<Finalist>> {
        let verified = &verified[..verified.len().min(FINALISTS)];
        let (first, others) = verified.split_at(verified.len().min(FIRST_FINALISTS));
        let mut finalists = self.align(first, None)?;
        self.gather(&mut finalists)?;
        finalists.extend(self.align(others, best_case(&finalists))?);
        Ok(finalists)
    }

    /// Refines the verified poses that have a share of the probability beside the best finalist.
    fn align(&self, verified: &[Verified], best: Option<Case>) -> Result<Vec<Finalist>> {
        let (source, target, voxel) = (self.fine.source, self.fine.target, self.pair.voxel());
        let refined = verified.par_iter().map(|one| {
            let (score, support) = (one.score, one.evidence);
            if best.is_some_and(|best| best.is_far_ahead(score, support, best.misfit)) {
                return Ok(None);
            }
            let rough = align_by(source, target, &one.pose, &[ROUGHLY], self.execution)?;
            let least = (1.0 - LESS_MISFIT) * misfit(&rough, voxel)?;
            if best.is_some_and(|best| best.is_far_ahead(score, support, least)) {
                return Ok(None);
            }
            let found = align_by(source, target, &rough.pose, &[CLOSELY], self.execution)?;
            let misfit = misfit(&found, voxel)?;
            let pose = std::slice::from_ref(&found.pose);
            let score =
                score_poses(self.pair.source.surface(), self.pair.target.surface(), pose, self.execution)?[0];
            let value = Case::rank(score, support, misfit);
            Ok(Some(Finalist { found, score, support, misfit, value, case: None }))
        });
        let refined = refined.collect::<Result<Vec<_>>>()?;
        self.clock.end(Stage::Refinement);
        Ok(refined.into_iter().flatten().filter(|one| self.is_allowed(&one.found.pose)).collect())
    }

    fn choose_apart(&self, poses: &[Rigid]) -> Vec<usize> {
        choose_apart(poses, &self.pair.source.scan().centroid(), self.prepared_voxel())
    }

    /// Returns the prepared voxel: places of a repeating structure are as far apart at any level.
    fn prepared_voxel(&self) -> f64 {
        self.pair.voxel() / if self.options.is_coarse { FACTORS[0] } else { 1.0 }
    }

    /// Gathers the evidence for poses that differ and may come near the best; returns their rows, the best first.
    pub(super) fn gather(&self, finalists: &mut [Finalist]) -> Result<Vec<usize>> {
        finalists.sort_by(|one, other| other.value.total_cmp(&one.value));
        let poses = memory::collect(finalists.iter().map(|one| one.found.pose))?;
        let mut rows = self.choose_apart(&poses);
        rows.truncate(1 + RIVALS);
        for &row in &rows {
            let best = best_case(finalists);
            let one = &mut finalists[row];
            let (score, support, misfit) = (one.score, one.support, one.misfit);
            if one.case.is_none() && !best.is_some_and(|best| best.is_far_ahead(score, support, misfit)) {
                let evidence = Evidence::gather(self.pair, self.fine, &one.found.pose, self.execution)?;
                one.case = Some(Case { score, support, misfit, evidence, chance: None });
            }
        }
        rows.retain(|&row| finalists[row].case.is_some());
        rows.sort_by(|&one, &other| finalists[other].weight().total_cmp(&finalists[one].weight()));
        Ok(rows)
    }

    /// Compares the best of the finalists with its rivals and with the nats that chance reaches, if they are known.
    fn compare(&self, finalists: &mut [Finalist], chance: Option<&Chance>) -> Result<Compared> {
        let (rows, chance) = (self.gather(finalists)?, chance.map(|chance| chance.nats));
        let cases = rows.iter().filter_map(|&row| Some(Case { chance, ..finalists[row].case? }));
        let (cases, mut shares) = (memory::collect(cases)?, Vec::new());
        let probability = share_probability(&cases, 1, &mut shares);
        self.clock.end(Stage::Evidence);
        Ok(Compared { rows, cases, shares, probability })
    }

    /// Returns the best of the finalists, which were not searched for.
    fn judge(&self, finalists: &mut [Finalist]) -> Result<Found> {
        let compared = self.compare(finalists, None)?;
        self.conclude(finalists, compared)
    }

    /// Bounds the probability of the best finalist, and returns it with its alternatives.
    fn conclude(&self, finalists: &[Finalist], compared: Compared) -> Result<Found> {
        let Compared { rows, cases, shares, probability } = compared;
        let poses = memory::collect(rows.iter().map(|&row| finalists[row].found.pose))?;
        let best = &finalists[rows[0]].found;
        let resisted = resisted(self.pair, best)?;
        let motions = count_open_motions(self.pair, self.fine, best, &resisted, self.execution)?;
        let least = self.pair.source.len().min(self.pair.target.len());
        let probability = bound_by_size(bound_by_motions(probability, motions), least);
        let is_shared = |place: &usize| is_alternative(probability, shares[*place], &shares);
        let alternatives = (0..shares.len()).filter(is_shared).map(|place| poses[place + 1]).collect();
        self.clock.end(Stage::Evidence);
        Ok(Found {
            refined: best.clone(),
            alternatives,
            probability,
            fitness: 0.0,
            target_fitness: 0.0,
            motions,
            cases,
            poses,
            shares,
            better_scale: 1.0,
            scale_factor: 1.0,
            decoy: None,
        })
    }

    /// Compares the scales, and measures the overlap.
    fn measure(&self, found: &mut Found) -> Result<()> {
        let (pair, execution, pose) = (self.pair, self.execution, found.refined.pose);
        (found.scale_factor, found.better_scale) = compare_scales(pair, &pose, found.probability, execution)?;
        found.probability *= found.scale_factor;
        (found.fitness, found.target_fitness, _) = overlap_at(pair, &pose, execution)?;
        Ok(())
    }
}

/// Returns the rows of the poses that differ from all chosen before them, by 10 degrees or 8 voxels.
pub fn choose_apart(poses: &[Rigid], center: &Vector3<f64>, voxel: f64) -> Vec<usize> {
    let (degrees, units) = DIFFERENT;
    let (least, most) = (f64::from(degrees).to_radians().cos(), f64::from(units) * UNIT * voxel);
    let mut chosen: Vec<usize> = Vec::new();
    for (row, pose) in poses.iter().enumerate() {
        let differs = |&other: &usize| {
            let other = &poses[other];
            let cosine = ((pose.rotation.transpose() * other.rotation).trace() - 1.0) / 2.0;
            let apart = pose.apply(&(*center).into()) - other.apply(&(*center).into());
            cosine < least || apart.norm() > most
        };
        if chosen.iter().all(differs) {
            chosen.push(row);
        }
    }
    chosen
}
