//! The search from coarse to fine voxels.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;

use super::clock::{Clock, STAGES, Stage};
use super::evidence::crossed;
use super::found::Found;
use super::level::{Level, Pair, Refusal};
use super::options::{Effort, Options, Proposer};
use super::posterior::confirmed;
use super::prepared::Prepared;
use super::proposals::VoxelMatches;
use super::search::{finish, search};
use super::settings::{ACCEPTED, FEW_POINTS, FINE, MOST_CROSSED, PREPARED, SAME_PLACE, SURE};

/// Rows of the voxel factors and numbers of matches per voxel: usual, of few points, of more effort.
const USUAL: [(usize, usize); 2] = [(0, 1), (PREPARED, 1)];
const OF_FEW: [(usize, usize); 3] = [(PREPARED, 1), (3, 1), (4, 1)];
const FINER: (usize, usize) = (2, 3);

/// The pose of two scans at the level that decided.
#[derive(Debug)]
pub struct Registered {
    /// The pose, with the evidence for it.
    pub found: Found,
    /// The matches of that level.
    pub matches: VoxelMatches,
    /// Source and target at the voxel size of the search.
    pub levels: [Arc<Level>; 2],
    /// Row of that size in the voxel factors.
    row: usize,
    /// Wall time of each stage ([`STAGES`]).
    pub seconds: [f64; STAGES.len()],
}

impl Registered {
    /// Returns the result for a pose that was judged alone.
    pub fn alone(found: Found, levels: [Arc<Level>; 2]) -> Self {
        let matches = VoxelMatches::none(Pair { source: &levels[0], target: &levels[1] });
        Self { found, matches, levels, row: PREPARED, seconds: [0.0; STAGES.len()] }
    }
}

/// Result of [`register`].
#[derive(Debug)]
pub enum Outcome {
    /// The best pose.
    Found(Box<Registered>),
    /// No pose can be proposed.
    Nothing,
    /// One of the scans, source (0) or target (1), has no level that can be searched.
    Refused(usize, Refusal),
}

impl Outcome {
    fn is_accepted(&self) -> bool {
        matches!(self, Self::Found(done) if done.found.is_accepted())
    }

    fn probability(&self) -> f64 {
        if let Self::Found(done) = self { done.found.probability } else { 0.0 }
    }
}

/// Registers two prepared scans: searches from coarse to fine voxels until a pose is sure. The result does not depend on the roles
/// of the scans.
///
/// A finer level also compares the best poses of the coarser one. The most probable pose of all levels is returned.
///
/// If a viewpoint is known and no pose is accepted, the scans are registered without viewpoints too: speckle of a sensor in free
/// space and unobserved directions count against right poses of a small overlap. A pose that is accepted or more probable then is
/// returned unless a larger share of the scans lies in free space.
///
/// # Errors
/// [`crate::Error::InvalidInput`] for voxels that are too small for the box around a scan; [`crate::Error::Interrupted`],
/// [`crate::Error::OutOfMemory`].
pub fn register(
    source: &Prepared,
    target: &Prepared,
    options: &Options,
    execution: &Execution,
) -> Result<Outcome> {
    let clock = Clock::default();
    let found = search_levels(source, target, options, &clock, execution)?;
    let is_seen = source.sees() || target.sees();
    if !is_seen
        || found.is_accepted()
        || options.proposer != Proposer::Voxels
        || options.effort == Effort::First
    {
        return Ok(found);
    }
    let (one, two) = (source.without_viewpoint(), target.without_viewpoint());
    let other = search_levels(one, two, options, &clock, execution)?;
    if let Outcome::Found(done) = &other
        && (other.is_accepted() || other.probability() > found.probability())
    {
        let levels = [source.level(done.row, execution)?, target.level(done.row, execution)?];
        if let [Ok(source), Ok(target)] = levels
            && crossed(Pair { source, target }, &done.found.refined.pose, execution)? <= MOST_CROSSED
        {
            return Ok(other);
        }
    }
    Ok(found)
}

/// Registers two scans at one level after the other, until a pose is sure.
fn search_levels(
    source: &Prepared,
    target: &Prepared,
    options: &Options,
    clock: &Clock,
    execution: &Execution,
) -> Result<Outcome> {
    let mut best: Option<Registered> = None;
    for (row, k) in plan(source, target, options) {
        let enough = if row == PREPARED { SURE } else { ACCEPTED };
        if best.as_ref().is_some_and(|best| best.found.probability >= enough) {
            break;
        }
        let (one, other) =
            rayon::join(|| ready(source, row, options, execution), || ready(target, row, options, execution));
        clock.end(Stage::Levels);
        let levels = match (one?, other?) {
            (Ok(one), Ok(other)) => [one, other],
            (one, other) => {
                if row == PREPARED && best.is_none() {
                    let refused = one.err().map(|why| (0, why)).or(other.err().map(|why| (1, why)));
                    return Ok(refused.map_or(Outcome::Nothing, |(side, why)| Outcome::Refused(side, why)));
                }
                continue;
            }
        };
        let finer = (row < PREPARED).then(|| FINE[0] * source.voxel());
        let found = search_level((levels, row), best.as_ref(), (options, k, finer), clock, execution)?;
        best = match (best, found) {
            (Some(coarse), Some(fine)) => Some(choose(coarse, fine)),
            (coarse, fine) => fine.or(coarse),
        };
    }
    Ok(best.map_or(Outcome::Nothing, |best| {
        Outcome::Found(Box::new(Registered { seconds: clock.seconds(), ..best }))
    }))
}

/// Returns the more probable of the poses of two levels.
///
/// At one place each level confirms the other, and a scale that fits better at the finer level counts against both.
fn choose(mut coarse: Registered, mut fine: Registered) -> Registered {
    let (one, other) = (&mut coarse.found, &mut fine.found);
    let decoy = one.decoy.into_iter().chain(other.decoy).reduce(f64::max);
    (one.decoy, other.decoy) = (decoy, decoy);
    let [source, _] = &fine.levels;
    if displacement(source.points(), &one.refined.pose, &other.refined.pose) <= SAME_PLACE * source.voxel() {
        if other.scale_factor < one.scale_factor {
            one.probability *= other.scale_factor / one.scale_factor;
            (one.scale_factor, one.better_scale) = (other.scale_factor, other.better_scale);
        }
        let (best, second) = if one.probability >= other.probability { (one, other) } else { (other, one) };
        best.probability = confirmed(best.probability, &best.shares, second.probability);
    }
    if coarse.found.probability >= fine.found.probability { coarse } else { fine }
}

/// Returns the mean displacement of points between two poses.
fn displacement(points: &[Vector3<f64>], one: &Rigid, other: &Rigid) -> f64 {
    let (turn, shift) = (one.rotation - other.rotation, one.translation - other.translation);
    points.iter().map(|point| (turn * point + shift).norm()).sum::<f64>() / points.len().max(1) as f64
}

/// Returns the rows of the voxel factors that are searched one after the other, each with its matches per voxel.
fn plan(source: &Prepared, target: &Prepared, options: &Options) -> Vec<(usize, usize)> {
    if source.is_single() || target.is_single() {
        return vec![(PREPARED, 1)];
    }
    let few = source.scan().points().len().min(target.scan().points().len()) < FEW_POINTS;
    let mut rows = if few { OF_FEW.to_vec() } else { USUAL.to_vec() };
    if options.effort == Effort::First || few && options.effort == Effort::Low {
        rows.truncate(1);
    }
    if options.effort == Effort::High && options.proposer == Proposer::Voxels {
        rows.push(FINER);
    }
    rows
}

/// Returns a level of a scan with all that a search needs of it.
fn ready(
    scan: &Prepared,
    row: usize,
    options: &Options,
    execution: &Execution,
) -> Result<std::result::Result<Arc<Level>, Refusal>> {
    let level = match scan.level(row, execution)? {
        Ok(level) => level,
        Err(why) => return Ok(Err(why)),
    };
    level.complete(options.uses_matches(), execution)?;
    Ok(Ok(Arc::clone(level)))
}

/// Searches at one level, in the order of the scans that does not depend on their roles.
fn search_level(
    (levels, row): ([Arc<Level>; 2], usize),
    coarser: Option<&Registered>,
    (options, k, finer): (&Options, usize, Option<f64>),
    clock: &Clock,
    execution: &Execution,
) -> Result<Option<Registered>> {
    let mut options = Options { is_coarse: finer.is_some(), ..options.clone() };
    if let Some(coarser) = coarser {
        memory::push(&mut options.proposed, coarser.found.refined.pose)?;
        memory::extend(&mut options.proposed, coarser.found.poses.get(1..).unwrap_or_default())?;
    }
    let [source, target] = [&*levels[0], &*levels[1]];
    let is_near = matches!(options.proposer, Proposer::Nearby(_));
    let pair = Pair { source, target };
    let is_turned = !is_near && order(target) < order(source);
    let (ordered, asked) = if is_turned { (pair.turned(), options.turned()) } else { (pair, options) };
    let Some((mut found, matches)) = search(ordered, &asked, k, clock, execution)? else { return Ok(None) };
    finish(ordered, &mut found, finer, &asked, execution)?;
    clock.end(Stage::Evidence);
    let (found, matches) = if is_turned { (found.turned(), matches.turned()) } else { (found, matches) };
    Ok(Some(Registered { matches, row, ..Registered::alone(found, levels) }))
}

/// Returns a sort key of a scan that does not depend on its frame: its size, then the distance of a voxel from the mean.
fn order(level: &Level) -> (usize, f64) {
    let first = level.points().first().map_or(0.0, |point| (point - level.scan().centroid()).norm());
    (level.len(), first)
}
