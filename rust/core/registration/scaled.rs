//! The scale of two scans in different units: propose scales, search at each, select the best.
//!
//! Descriptors of voxels of two sizes are similar if the ratio of the sizes is the scale. Matches that agree on one scale, as in
//! TEASER++ (Yang, Shi, Carlone, T-RO 2021), refine it, and the surfaces finally fix it.

use std::sync::Arc;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::Result;
use crate::execution::Execution;
use crate::features::matching::Matching;
use crate::features::voxels::choose_voxel;
use crate::geometry::rigid::Rigid;
use crate::memory;

use super::level::{Level, Pair, Refusal};
use super::options::{Effort, Options};
use super::posterior::{Case, bound_by_motions, is_alternative, share_probability};
use super::prepared::Prepared;
use super::register::{Outcome, register};
use super::settings::{MOST_OPEN_MOTIONS, OPEN, PREPARED};
use super::similarity::{Similarity, fit_similarity};
use super::voxel_size::{Suited, suit_voxel};

/// Factor around the ratio of the scans' sizes within which the scale is searched.
const WITHIN: f64 = 3.0;
/// Voxels at the finest size of description, number of sizes, and their ratio.
const VOXELS: usize = 2500;
const SIZES: i32 = 4;
const STEP: f64 = std::f64::consts::SQRT_2;
/// Best matches of two sizes; largest disagreement and least distance of two of them, in voxels.
const MATCHES: usize = 400;
const AGREE: f64 = 1.0;
const APART: f64 = 4.0;
/// Ratio of the tried scales, 2^(1/16), and their number to either side of a ratio of sizes.
const GRID: f64 = 1.044_273_782_427_413_8;
const AROUND: i32 = 4;
/// Number of scales with a search, and their least consensus as a share of the greatest.
const CANDIDATES: usize = 2;
const AS_LIKELY: f64 = 0.7;
/// Steps that estimate an eigenvalue.
const POWER_STEPS: usize = 8;

/// A pose of the source at a scale, with its evidence.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    scale: f64,
    pose: Rigid,
    case: Case,
}

/// The scale of a source in a target's unit.
#[derive(Debug)]
pub struct Scaled {
    /// Length in the target of the source's unit.
    pub scale: f64,
    /// Relative standard deviation of the scale.
    pub deviation: f64,
    /// Whether the surfaces leave the scale free.
    pub is_open: bool,
    /// The source in the target's unit, and the target, to be registered.
    pub scans: [Arc<Prepared>; 2],
    /// Pose of that source, to be proposed; none if no scale has a pose.
    pub pose: Option<Rigid>,
    candidates: Vec<Candidate>,
    tried: usize,
}

/// Result of [`find_scale`].
#[derive(Debug)]
pub enum ScaleOutcome {
    /// The best scale.
    Found(Box<Scaled>),
    /// The scan, source (0) or target (1), that has no level of a voxel in its own unit.
    Refused(usize, f64, Refusal),
    /// The bounds exclude all scales near the ratio of the scans' sizes: that ratio, and the factor around it.
    OutOfBounds(f64, f64),
}

impl Scaled {
    /// Returns the probability of a pose at the scale against all tried scales, and the poses at other scales that share it: each
    /// with the scale of the source as given, and the pose of the scaled source. `cases` and `motions` are those of a search at
    /// the scale.
    pub fn weigh(&self, cases: &[Case], motions: usize) -> (f64, Vec<(f64, Rigid)>) {
        let Some((best, others)) = self.candidates.split_first() else { return (0.0, Vec::new()) };
        let is_apart = |one: &&Candidate| (one.scale / best.scale).ln().abs() > 2.0 * GRID.ln();
        let rivals: Vec<&Candidate> = others.iter().filter(is_apart).collect();
        let each: Vec<Case> = std::iter::once(best.case).chain(rivals.iter().map(|one| one.case)).collect();
        let (mut shares, mut own) = (Vec::new(), Vec::new());
        share_probability(&each, 1, &mut shares);
        let alone = share_probability(cases, self.tried, &mut own);
        let motions = if self.is_open { MOST_OPEN_MOTIONS + 1 } else { motions };
        let probability = bound_by_motions(1.0 / (1.0 / alone + shares.iter().sum::<f64>()), motions);
        let shared =
            rivals.iter().zip(&shares).filter(|(_, share)| is_alternative(probability, **share, &shares));
        (probability, shared.map(|(one, _)| (one.scale, one.pose)).collect())
    }
}

/// Finds the scale between two bounds at which the source fits the target best.
///
/// Of both scans, cloud, radii and outside count; the voxel in the target's unit is chosen if none is given. Register the
/// returned scans with the pose proposed, then [`Scaled::weigh`] the result.
///
/// # Errors
/// As [`register`].
pub fn find_scale(
    source: &Prepared,
    target: &Prepared,
    bounds: (f64, f64),
    voxel: Option<f64>,
    axis: Option<[f64; 3]>,
    execution: &Execution,
) -> Result<ScaleOutcome> {
    let both = rayon::join(|| describe_sizes(source, execution), || describe_sizes(target, execution));
    let (sources, targets) = match (both.0?, both.1?) {
        (Ok(sources), Ok(targets)) => (sources, targets),
        (Err((voxel, why)), _) => return Ok(ScaleOutcome::Refused(0, voxel, why)),
        (_, Err((voxel, why))) => return Ok(ScaleOutcome::Refused(1, voxel, why)),
    };
    let size = targets[0].0.voxel();
    let ratio = size / sources[0].0.voxel();
    let (low, high) = (bounds.0.max(ratio / WITHIN), bounds.1.min(ratio * WITHIN));
    if low > high {
        return Ok(ScaleOutcome::OutOfBounds(ratio, WITHIN));
    }
    let scales = propose_scales(&sources, &targets, (low, high), execution)?;
    let options = Options { axis, effort: Effort::Low, ..Options::default() };
    let mut target = Arc::clone(&targets[0].0);
    let mut candidates = Vec::new();
    let mut moved = Arc::clone(&target);
    for &scale in &scales {
        moved = Arc::new(source.scaled(scale, size)?);
        let rough = match register(&moved, &target, &options, execution)? {
            Outcome::Found(found) => found,
            Outcome::Nothing => continue,
            Outcome::Refused(side, why) => {
                return Ok(ScaleOutcome::Refused(side, [size / scale, size][side], why));
            }
        };
        if let Ok(Some(fitted)) = fit([&moved, &target], &rough.found.refined.pose, execution)? {
            let scale = (scale * fitted.scale).clamp(low, high);
            memory::push(
                &mut candidates,
                Candidate { scale, pose: fitted.pose, case: rough.found.cases[0] },
            )?;
        }
    }
    candidates.sort_by(|one, other| other.case.weight().total_cmp(&one.case.weight()));
    let tried = scales.len();
    let Some(&best) = candidates.first() else {
        let (scans, pose, deviation) = ([moved, target], None, f64::INFINITY);
        let found =
            Scaled { scale: scales[tried - 1], deviation, is_open: false, scans, pose, candidates, tried };
        return Ok(ScaleOutcome::Found(Box::new(found)));
    };
    let mut moved = source.scaled(best.scale, size)?;
    let size = match voxel {
        Some(voxel) => voxel,
        None => match suit_voxel(&[moved.scan().cloud(), target.scan().cloud()], execution)? {
            Suited::Voxel(voxel) => voxel,
            Suited::Unlike(..) => size,
        },
    };
    moved = moved.scaled(1.0, size)?;
    target = Arc::new(target.scaled(1.0, size)?);
    let fitted = match fit([&moved, &target], &best.pose, execution)? {
        Ok(fitted) => fitted.unwrap_or(Similarity {
            scale: 1.0,
            pose: best.pose,
            resistance: 0.0,
            deviation: f64::INFINITY,
        }),
        Err((side, why)) => {
            return Ok(ScaleOutcome::Refused(side, [size / best.scale, size][side], why));
        }
    };
    let scale = (best.scale * fitted.scale).clamp(low, high);
    Ok(ScaleOutcome::Found(Box::new(Scaled {
        scale,
        deviation: fitted.deviation.min((high / low).ln()),
        is_open: fitted.resistance <= OPEN,
        scans: [Arc::new(source.scaled(scale, size)?), target],
        pose: Some(fitted.pose),
        candidates,
        tried,
    })))
}

/// Fits a similarity to the prepared voxels; the scan without such voxels, if there is one.
fn fit(
    [source, target]: [&Prepared; 2],
    pose: &Rigid,
    execution: &Execution,
) -> Result<std::result::Result<Option<Similarity>, (usize, Refusal)>> {
    let source = match source.level(PREPARED, execution)? {
        Ok(level) => level,
        Err(why) => return Ok(Err((0, why))),
    };
    let target = match target.level(PREPARED, execution)? {
        Ok(level) => level,
        Err(why) => return Ok(Err((1, why))),
    };
    fit_similarity(Pair { source, target }, pose, 1, execution).map(Ok)
}

/// A scan prepared with a voxel, and its level of that voxel with descriptors.
type Sized = (Arc<Prepared>, Arc<Level>);

/// Describes a scan at voxels of several sizes, as long as it remains a surface; the first size and the reason if it never is.
fn describe_sizes(
    scan: &Prepared,
    execution: &Execution,
) -> Result<std::result::Result<Vec<Sized>, (f64, Refusal)>> {
    let finest = choose_voxel(&[&scan.scan().own().1], VOXELS, execution)?;
    let mut found = Vec::new();
    for step in 0..SIZES {
        let size = finest * STEP.powi(step);
        let made = scan.scaled(1.0, size)?;
        let level = match made.level(PREPARED, execution)? {
            Ok(level) => Arc::clone(level),
            Err(why) if found.is_empty() => return Ok(Err((size, why))),
            Err(_) => break,
        };
        level.described(execution)?;
        memory::push(&mut found, (Arc::new(made), level))?;
    }
    Ok(Ok(found))
}

/// Returns the scales on which most matches of voxels of two sizes agree, the likeliest first.
fn propose_scales(
    sources: &[Sized],
    targets: &[Sized],
    (low, high): (f64, f64),
    execution: &Execution,
) -> Result<Vec<f64>> {
    let mut votes: Vec<(f64, f64)> = Vec::new();
    for (i, (_, source)) in sources.iter().enumerate() {
        for (j, (_, target)) in targets.iter().enumerate() {
            if i > 0 && j > 0 {
                continue;
            }
            let ratio = target.voxel() / source.voxel();
            let factors = (-AROUND..=AROUND).map(|step| GRID.powi(step));
            let factors = memory::collect(factors.filter(|factor| (low..=high).contains(&(ratio * factor))))?;
            if !factors.is_empty() {
                let consensus = measure_consensus(source, target, &factors, execution)?;
                votes.extend(factors.iter().map(|factor| ratio * factor).zip(consensus));
            }
        }
    }
    votes.sort_by(|one, other| other.1.total_cmp(&one.1));
    let mut chosen: Vec<f64> = Vec::new();
    for &(scale, consensus) in &votes {
        if chosen.len() == CANDIDATES || consensus < AS_LIKELY * votes[0].1 {
            break;
        }
        if chosen.iter().all(|other| (scale / other).ln().abs() > 1.99 * GRID.ln()) {
            chosen.push(scale);
        }
    }
    if chosen.is_empty() {
        chosen.push((low * high).sqrt());
    }
    Ok(chosen)
}

/// Returns the greatest eigenvalue of the graph of matches that agree in pairs, for each scale.
///
/// Two agree where their distances do: `|dt - f ds| < 1`, in voxels of the source and of the target. The eigenvalue is about the
/// size of the largest clique (M. Leordeanu and M. Hebert, *A spectral technique for correspondence problems using pairwise
/// constraints*, ICCV 2005).
fn measure_consensus(
    source: &Level,
    target: &Level,
    factors: &[f64],
    execution: &Execution,
) -> Result<Vec<f64>> {
    let (one, other) = (source.described(execution)?, target.described(execution)?);
    let matching = Matching { mutual: true, ..Matching::default() };
    let mut matches = matching.run(&one.descriptors, &other.descriptors, execution)?;
    matches.sort_by(|one, other| one.ratio().total_cmp(&other.ratio()));
    matches.truncate(MATCHES);
    let ds = distances(matches.iter().map(|found| one.points[found.source]), source.voxel())?;
    let dt = distances(matches.iter().map(|found| other.points[found.target]), target.voxel())?;
    let count = matches.len();
    let measure = |factor: &f64| -> Result<f64> {
        execution.check()?;
        let agrees =
            |(ds, dt): (&f64, &f64)| *ds >= APART && *dt >= APART && (dt - factor * ds).abs() < AGREE;
        let agree = memory::collect(ds.iter().zip(&dt).map(|both| f64::from(u8::from(agrees(both)))))?;
        let (mut vector, mut value) = (memory::filled(1.0, count)?, 0.0);
        for _ in 0..POWER_STEPS {
            let row = |row: &[f64]| row.iter().zip(&vector).map(|(one, other)| one * other).sum::<f64>();
            vector = memory::collect(agree.chunks_exact(count.max(1)).map(row))?;
            value = vector.iter().map(|part| part * part).sum::<f64>().sqrt();
            vector.iter_mut().for_each(|part| *part /= f64::max(value, 1.0));
        }
        Ok(value)
    };
    factors.par_iter().map(measure).collect()
}

/// Returns the distances of all pairs of points, in voxels.
fn distances(points: impl Iterator<Item = [f64; 3]>, voxel: f64) -> Result<Vec<f64>> {
    let places = memory::collect(points.map(|point| Vector3::from(point) / voxel))?;
    let mut found = memory::with_capacity(places.len() * places.len())?;
    for one in &places {
        found.extend(places.iter().map(|other| (one - other).norm()));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::super::level::{Outside, Radii};
    use super::super::scan::Scan;
    use super::super::settings::MOST_VOXELS;
    use super::*;
    use crate::cloud::Cloud;

    /// A bent sheet of a size, without symmetry, with a given phase of its samples.
    fn sheet(size: f64, phase: f64) -> Result<Prepared> {
        let point = |i: u32| {
            let [x, y] =
                [0.618_033_988_749, 0.754_877_666_247].map(|step| (phase + f64::from(i) * step).fract());
            let height = (7.0 * x + 2.0 * y * y).sin() * (0.3 + y) + 0.5 * (11.0 * x * y + 5.0 * y).cos();
            [x, 0.8 * y, 0.2 * height].map(|part| size * part)
        };
        let cloud = Cloud::from_rows("points", &(0..20_000).map(point).collect::<Vec<_>>())?;
        let scan = Arc::new(Scan::new(Arc::new(cloud), None)?);
        Ok(Prepared::new(scan, 1.0, Radii::default(), Outside::Frames(None), MOST_VOXELS))
    }

    #[test]
    fn the_scale_of_a_sheet_is_found() -> Result<()> {
        let (execution, any) = (Execution::default(), (0.0, f64::INFINITY));
        let (source, target) = (sheet(1.0, 0.0)?, sheet(2.5, 0.3)?);
        let ScaleOutcome::Found(found) = find_scale(&source, &target, any, None, None, &execution)? else {
            return Err(crate::Error::invalid("scale", "none", "one was expected"));
        };
        assert!((found.scale / 2.5 - 1.0).abs() < 0.01 && !found.is_open);
        let pose = found.pose.unwrap_or_else(Rigid::identity);
        let options = Options { proposed: vec![pose], ..Options::default() };
        let [one, other] = &found.scans;
        let Outcome::Found(placed) = register(one, other, &options, &execution)? else {
            return Err(crate::Error::invalid("pose", "none", "one was expected"));
        };
        assert!(found.weigh(&placed.found.cases, placed.found.motions).0 > 0.5);
        let outside = find_scale(&source, &target, (10.0, 20.0), None, None, &execution)?;
        assert!(matches!(outside, ScaleOutcome::OutOfBounds(ratio, _) if (ratio - 2.5).abs() < 0.3));
        Ok(())
    }
}
