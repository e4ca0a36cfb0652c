//! Robust least squares that reject wrong edges: truncated squares, reached from squares by graduated
//! non-convexity (Yang, Antonante, Tzoumas, Carlone, *Graduated Non-Convexity for Robust Spatial Perception*,
//! RA-L 2020).

use super::minimum::{FINE, Precision, minimize_weighted};
use super::{Link, Start, chordal, growth};
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;

/// The .99 quantile of chi-squared with six degrees of freedom: upper bound of the squared errors of correct
/// edges.
const LARGEST_SQUARED_ERROR: f64 = 16.811_893_829_770_927;
const STEP: f64 = 1.4;
const MOST_STEPS: usize = 100;
const MOST_CHECKS: usize = 20;
const COARSE: Precision = Precision { steps: 10, decrease: 1e-3, reduction: 1e-3 };

/// Moves the poses of a component, and returns the mask of kept links. If trusted links reach every node,
/// loops are accepted outward from these. Otherwise the better result of two searches is taken: the first
/// keeps the links that agree with the initial poses, which suits nearly correct ones; the second begins with
/// all links.
pub fn optimize(
    poses: &mut Vec<Rigid>,
    links: &[Link],
    start: Start,
    execution: &Execution,
) -> Result<Vec<bool>> {
    let bounds = memory::collect(links.iter().map(|link| bound(link.edge.probability)))?;
    let trusted = memory::collect(links.iter().filter(|link| link.edge.probability >= 1.0).copied())?;
    let parts = super::components(poses.len(), trusted.iter().map(|link| (link.from, link.to)))?;
    let is_framed = parts.len() == 1;
    if start == Start::Chordal {
        if is_framed { chordal::place(poses, &trusted)? } else { chordal::follow_tree(poses, links)? }
    }
    if is_framed {
        let held = growth::grow(poses, links, &bounds, execution)?;
        let weights = memory::collect(held.iter().map(|&held| if held { 1.0 } else { 0.0 }))?;
        minimize_weighted(poses, weighted(links, &weights), &FINE, execution)?;
        return Ok(settle(poses, links, &bounds, execution)?.0);
    }
    let mut near = memory::copied(poses)?;
    let (kept_near, cost_near) = settle(&mut near, links, &bounds, execution)?;
    if kept_near.iter().zip(&bounds).all(|(&kept, &bound)| kept || bound <= 0.0) {
        *poses = near;
        return Ok(kept_near);
    }
    graduate(poses, links, &bounds, start, execution)?;
    let (kept, cost) = settle(poses, links, &bounds, execution)?;
    if cost <= cost_near {
        return Ok(kept);
    }
    *poses = near;
    Ok(kept_near)
}

/// Proceeds from squares to truncated squares in steps.
fn graduate(
    poses: &mut Vec<Rigid>,
    links: &[Link],
    bounds: &[f64],
    start: Start,
    execution: &Execution,
) -> Result<()> {
    let mut weights = memory::collect(bounds.iter().map(|&bound| if bound > 0.0 { 1.0 } else { 0.0 }))?;
    if start == Start::Chordal {
        minimize_weighted(poses, weighted(links, &weights), &COARSE, execution)?;
    }
    let mut squares = squared_errors(poses, links)?;
    let ratio = |(&square, &bound): (&f64, &f64)| if bound > 0.0 { square / bound } else { 0.0 };
    let worst = squares.iter().zip(bounds).map(ratio).fold(0.0, f64::max);
    let mut sharpness = 1.0 / (2.0 * worst - 1.0);
    for _ in 0..if worst > 1.0 { MOST_STEPS } else { 0 } {
        let mut is_decided = true;
        for ((weight, &square), &bound) in weights.iter_mut().zip(&squares).zip(bounds) {
            *weight = truncated(square, bound, sharpness);
            is_decided &= *weight <= 0.0 || *weight >= 1.0;
        }
        minimize_weighted(poses, weighted(links, &weights), &COARSE, execution)?;
        squares = squared_errors(poses, links)?;
        if is_decided {
            break;
        }
        sharpness *= STEP;
    }
    Ok(())
}

/// Alternates between keeping the links that agree with the poses and moving the poses; returns the links and
/// the truncated squares.
fn settle(
    poses: &mut Vec<Rigid>,
    links: &[Link],
    bounds: &[f64],
    execution: &Execution,
) -> Result<(Vec<bool>, f64)> {
    let mut squares = squared_errors(poses, links)?;
    let agree =
        |squares: &[f64]| memory::collect(squares.iter().zip(bounds).map(|(square, bound)| square <= bound));
    let mut kept = agree(&squares)?;
    for _ in 0..MOST_CHECKS {
        let weights = memory::collect(kept.iter().map(|&kept| if kept { 1.0 } else { 0.0 }))?;
        minimize_weighted(poses, weighted(links, &weights), &FINE, execution)?;
        squares = squared_errors(poses, links)?;
        let before = std::mem::replace(&mut kept, agree(&squares)?);
        if kept == before {
            break;
        }
    }
    let cost = squares.iter().zip(bounds).map(|(square, bound)| square.min(bound.max(0.0))).sum();
    Ok((kept, cost))
}

/// The squared error above which an edge with that prior is more likely wrong.
fn bound(probability: f64) -> f64 {
    LARGEST_SQUARED_ERROR + 2.0 * (probability / (1.0 - probability)).ln()
}

fn truncated(square: f64, bound: f64, sharpness: f64) -> f64 {
    if bound <= 0.0 || square >= (sharpness + 1.0) / sharpness * bound {
        0.0
    } else if bound == f64::INFINITY || square <= sharpness / (sharpness + 1.0) * bound {
        1.0
    } else {
        (bound * sharpness * (sharpness + 1.0) / square).sqrt() - sharpness
    }
}

fn weighted<'a>(links: &'a [Link<'a>], weights: &'a [f64]) -> impl Iterator<Item = (Link<'a>, f64)> {
    links.iter().copied().zip(weights.iter().copied())
}

fn squared_errors(poses: &[Rigid], links: &[Link]) -> Result<Vec<f64>> {
    memory::collect(links.iter().map(|link| link.edge.squared_error(&poses[link.from], &poses[link.to])))
}
