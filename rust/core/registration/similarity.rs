//! Fits a similarity to two scans, and compares the scale that fits best with 1.

use nalgebra::{SMatrix, SVector, Vector3, Vector6};

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::ball_search::{BallSearch, Nearest};
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::points::Points;

use super::level::{Level, Pair};
use super::motions::{median, motion_about};
use super::posterior::is_accepted;
use super::settings::OPEN;

/// Edge of the cells whose mean residuals show bends, in voxels.
const BEND: f64 = 6.0;
/// Standard deviation of the scale of right poses: fragments of one room fit best at scales slightly off 1.
const DRIFT: f64 = 0.01;
/// Deviations of the scale from 1 at which half of a probability is left, and the share of these from which it is noted.
const CLEARLY: f64 = 3.0;
const NOTED: f64 = 0.8;
/// Voxels of either scan that are paired for the comparison, about.
const ENOUGH: usize = 1000;
/// Largest distance of pairs in the first and in the last step, in voxels, and the step from which it stays.
const REACH: f64 = 3.0;
const LAST_REACH: f64 = 1.5;
const REACHED: usize = 5;
/// Largest distance in the source's own scale, relative to that in the target's: for scales from 0.8.
const WIDER: f64 = 1.25;
/// Largest number of steps; a smaller motion, in voxels, ends them.
const STEPS: usize = 30;
const STILL: f64 = 5e-3;
/// Pairs below which nothing is fitted.
const LEAST_PAIRS: usize = 50;
/// Tukey's constant, standard deviations per median of a normal distribution, least deviation in voxels, damping.
const CUT: f64 = 4.685;
const PER_MEDIAN: f64 = 1.4826;
const LEAST_DEVIATION: f64 = 1e-3;
const DAMPING: f64 = 1e-6;

/// A search for points relative to a centre, with the centre.
type Search = (BallSearch, Vector3<f64>);
type Vector7 = SVector<f64, 7>;
type Matrix7 = SMatrix<f64, 7, 7>;

/// A rigid pose of the source times a scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Scale of the source as it was given: near 1.
    pub scale: f64,
    /// Pose of the scaled source.
    pub pose: Rigid,
    /// Resistance of the surfaces to scaling while all motions are free, as a share of that of all pairs.
    pub resistance: f64,
    /// Relative standard deviation of the scale.
    pub deviation: f64,
}

/// Returns the factor of the probability of a pose, and the scale that fits clearly better than 1, or 1.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn compare_scales(
    pair: Pair<'_>,
    pose: &Rigid,
    probability: f64,
    execution: &Execution,
) -> Result<(f64, f64)> {
    if !is_accepted(probability) {
        return Ok((1.0, 1.0));
    }
    let every = pair.source.len().min(pair.target.len()).div_ceil(ENOUGH).max(1);
    let Some(fitted) = fit_similarity(pair, pose, every, execution)? else { return Ok((1.0, 1.0)) };
    if fitted.resistance <= OPEN {
        return Ok((1.0, 1.0));
    }
    let away = fitted.scale.ln().abs() / fitted.deviation.hypot(DRIFT) / CLEARLY;
    Ok((0.5_f64.powf(away.powi(4)), if away >= NOTED { fitted.scale } else { 1.0 }))
}

/// A moved point, the vector to the nearest point of the other scan, and the normal there.
#[derive(Clone, Copy)]
struct Offset {
    place: Vector3<f64>,
    away: Vector3<f64>,
    normal: Vector3<f64>,
}

/// Fits scale and pose to the voxels of both scans; none if too few are near each other.
///
/// Point-to-plane steps in both directions, with the weights of [`crate::verification::align`]; the seventh unknown is the
/// logarithm of the scale, about the middle of the pairs. The deviation of the scale assumes that the mean residuals in cells of
/// 6 voxels all pull the scale one way, as for bent surfaces. One of `every` voxels of either scan is paired.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn fit_similarity(
    pair: Pair<'_>,
    pose: &Rigid,
    every: usize,
    execution: &Execution,
) -> Result<Option<Similarity>> {
    let voxel = pair.voxel();
    // Relative to the middle of the target: far coordinates lose no digits.
    let origin = pair.target.scan().centroid();
    let fixed = memory::collect(pair.target.points().iter().map(|point| point - origin))?;
    let mut scale = 1.0;
    let mut pose = Rigid { translation: pose.translation - origin, ..*pose };
    let to_fixed = search(&fixed, REACH * voxel)?;
    let to_source = search(pair.source.points(), WIDER * REACH * voxel)?;
    let count = |level: &Level| memory::filled(Nearest::default(), level.len().div_ceil(every));
    let mut known = (count(pair.source)?, count(pair.target)?);
    let mut step = 0;
    loop {
        execution.check()?;
        let share = (step as f64 / REACHED as f64).min(1.0);
        let reach = voxel * (REACH + (LAST_REACH - REACH) * share);
        let place = |point: &Vector3<f64>| pose.rotation * point * scale + pose.translation;
        let moved = memory::collect(pair.source.points().iter().map(place))?;
        let searches = (&to_source, &to_fixed);
        let pairs = pairs(pair, (&pose, scale), (&moved, &fixed), searches, &mut known, reach, every)?;
        if pairs.len() < LEAST_PAIRS {
            return Ok(None);
        }
        let middle = middle_of(&pairs)?;
        let arm = |one: &Offset| one.place - middle;
        let radius = median(&mut memory::collect(pairs.iter().map(|one| arm(one).norm()))?);
        let residual = |one: &Offset| one.normal.dot(&one.away);
        let mut sizes = memory::collect(pairs.iter().map(|one| residual(one).abs()))?;
        // Most of a prism fits wherever it slides: the residuals of its ends count until the reach stays.
        let least = (LEAST_DEVIATION * voxel).max((1.0 - share) * reach);
        let deviation = (PER_MEDIAN * median(&mut sizes)).max(least);
        let (mut matrix, mut right, mut total) = (Matrix7::zeros(), Vector7::zeros(), 0.0);
        for one in &pairs {
            let near = (1.0 - one.away.norm_squared() / (reach * reach)).max(0.0);
            let weight = near * (1.0 - (residual(one) / (CUT * deviation)).powi(2)).max(0.0).powi(2);
            let turn = arm(one).cross(&one.normal) / radius;
            let grow = one.normal.dot(&arm(one)) / radius;
            let n = one.normal;
            let row = Vector7::from([turn.x, turn.y, turn.z, n.x, n.y, n.z, grow]);
            matrix.ger(weight, &row, &row, 1.0);
            right.axpy(-weight * residual(one), &row, 1.0);
            total += weight;
        }
        let damped = matrix + Matrix7::identity() * (DAMPING * matrix.diagonal().max());
        let Some(factor) = damped.cholesky() else { return Ok(None) };
        let change: Vector7 = factor.solve(&right);
        if change.iter().any(|entry| !entry.is_finite()) {
            return Ok(None);
        }
        let turn = change.fixed_rows::<3>(0) / radius;
        let motion = Vector6::new(turn.x, turn.y, turn.z, change[3], change[4], change[5]);
        let turned = motion_about(&motion, &middle);
        let grown = (change[6] / radius).exp();
        // The scaling about the middle comes first, then the motion.
        let translation = middle + (pose.translation - middle) * grown;
        pose = Rigid {
            rotation: turned.rotation * pose.rotation,
            translation: turned.rotation * translation + turned.translation,
        };
        scale *= grown;
        step += 1;
        if step == STEPS || (step > REACHED && change.amax() < STILL * voxel) {
            let covariance = damped.try_inverse().map_or(f64::INFINITY, |inverse| inverse[(6, 6)]);
            let resistance = 1.0 / (covariance * f64::max(total, 1e-300));
            let bend = bend_of(&pairs, voxel)?;
            let deviation = (bend / resistance).sqrt() / radius;
            let pose = Rigid { translation: pose.translation + origin, ..pose };
            return Ok(Some(Similarity { scale, pose, resistance, deviation }));
        }
    }
}

fn search(points: &[Vector3<f64>], reach: f64) -> Result<Search> {
    let rows = memory::collect(points.iter().map(|&point| point.into()))?;
    let points = Points::from_rows("voxels", &rows)?;
    let center = points.center();
    Ok((BallSearch::new(&points, reach)?, center))
}

/// Pairs the voxels of both scans with the nearest of the other, within reach; those of the last call are often still known.
fn pairs(
    pair: Pair<'_>,
    (pose, scale): (&Rigid, f64),
    (moved, fixed): (&[Vector3<f64>], &[Vector3<f64>]),
    (to_source, to_fixed): (&Search, &Search),
    (of_moved, of_fixed): &mut (Vec<Nearest>, Vec<Nearest>),
    reach: f64,
    every: usize,
) -> Result<Vec<Offset>> {
    let nearest = |place: &Vector3<f64>, (search, center): &Search, known: &mut Nearest, reach: f64| {
        let place = (place - center).into();
        let seen = known.seen_from(&place, reach);
        let found = seen.unwrap_or_else(|| {
            *known = search.nearest(&place);
            *known
        });
        found.offset()
    };
    let is_near = |offset: &Vector3<f64>| offset.norm_squared() < reach * reach;
    let mut pairs = Vec::new();
    for ((place, normal), known) in moved.iter().zip(pair.source.normals()).step_by(every).zip(of_moved) {
        if normal.x.is_finite()
            && let Some(offset) = nearest(place, to_fixed, known, reach).filter(is_near)
        {
            let normal = pose.rotation * normal;
            memory::push(&mut pairs, Offset { place: *place, away: -offset, normal })?;
        }
    }
    for ((place, &normal), known) in fixed.iter().zip(pair.target.normals()).step_by(every).zip(of_fixed) {
        let back = pose.rotation.transpose() * (place - pose.translation) / scale;
        let moved = |offset: Vector3<f64>| pose.rotation * offset * scale;
        if normal.x.is_finite()
            && let Some(offset) = nearest(&back, to_source, known, WIDER * reach).map(moved).filter(is_near)
        {
            memory::push(&mut pairs, Offset { place: place + offset, away: offset, normal })?;
        }
    }
    Ok(pairs)
}

fn middle_of(pairs: &[Offset]) -> Result<Vector3<f64>> {
    let mut middle = Vector3::zeros();
    for axis in 0..3 {
        middle[axis] = median(&mut memory::collect(pairs.iter().map(|one| one.place[axis]))?);
    }
    Ok(middle)
}

/// Returns the mean square of the residuals' means in cells, each weighted by its number of pairs.
fn bend_of(pairs: &[Offset], voxel: f64) -> Result<f64> {
    let cell = |one: &Offset| <[i64; 3]>::from((one.place / (BEND * voxel)).map(|part| part.floor() as i64));
    let mut keyed = memory::collect(pairs.iter().map(|one| (cell(one), one.normal.dot(&one.away))))?;
    keyed.sort_by_key(|one| one.0);
    let mut bend = 0.0;
    for cells in keyed.chunk_by(|one, other| one.0 == other.0) {
        let sum: f64 = cells.iter().map(|(_, residual)| residual).sum();
        bend += sum * sum / cells.len() as f64;
    }
    Ok(bend / pairs.len() as f64)
}
