//! Accepts loops outward from a trusted frame, nearest first. A loop is tested against the motion predicted
//! by the accepted links, with the covariance along their shortest path, so that drift neither rejects a
//! correct loop nor accepts a wrong one.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Cholesky, Matrix6};
use rayon::prelude::*;

use super::minimum::{Precision, minimize_weighted};
use super::{Link, motion};
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;

/// The quantile .999 of chi-squared with six degrees of freedom.
const LARGEST_INNOVATION: f64 = 22.457_744;
/// The .25 quantile: a quarter of the loops stay below it, even if half of all are wrong.
const QUARTER_INNOVATION: f64 = 3.454_599;
/// Number of loops that estimate the overstatement of the covariances, at least and at most; and a margin for
/// their noise.
const ENOUGH: usize = 30;
const SAMPLE: usize = 500;
const ROOM: f64 = 4.0;
/// The first reach in mean lengths of trusted links; it doubles in each round.
const FIRST_REACH: f64 = 4.0;
const MOST_TURNS: usize = 6;
const COARSE: Precision = Precision { steps: 5, decrease: 1e-2, reduction: 1e-8 };

/// Accepts the loops that fit, and moves the poses; returns the mask of accepted links. Links with an
/// infinite bound reach every node.
pub fn grow(
    poses: &mut Vec<Rigid>,
    links: &[Link],
    bounds: &[f64],
    execution: &Execution,
) -> Result<Vec<bool>> {
    let mut held = memory::collect(bounds.iter().map(|&bound| bound == f64::INFINITY))?;
    let mut open = memory::collect((0..links.len()).filter(|&k| !held[k] && bounds[k] > 0.0))?;
    open.sort_by_key(|&k| links[k].from);
    let lengths =
        memory::collect(links.iter().map(|link| link.edge.information.determinant().powf(-1.0 / 6.0)))?;
    let trusted = lengths.iter().zip(&held).filter(|(_, held)| **held);
    let (sum, count) = trusted.fold((0.0, 0), |(sum, count), (length, _)| (sum + length, count + 1));
    let mut reach = FIRST_REACH * sum / f64::from(count.max(1));
    let gate = LARGEST_INNOVATION * overstatement(poses, links, &lengths, &held, &open, execution)?;
    while !open.is_empty() {
        let mut sees_all = false;
        for _ in 0..MOST_TURNS {
            let found = innovations(poses, links, &lengths, &held, &open, reach, execution)?;
            sees_all = found.iter().all(Option::is_some);
            let mut fitting = memory::collect(
                open.iter()
                    .zip(&found)
                    .filter_map(|(&k, found)| Some((k, (*found)?)))
                    .filter(|one| one.1 < gate),
            )?;
            if fitting.is_empty() {
                break;
            }
            fitting.sort_by(|a, b| a.1.total_cmp(&b.1));
            fitting.truncate(fitting.len().div_ceil(2).max(8));
            fitting.iter().for_each(|&(k, _)| held[k] = true);
            let weighted = links.iter().copied().zip(held.iter().map(|&held| f64::from(u8::from(held))));
            minimize_weighted(poses, weighted, &COARSE, execution)?;
            for (k, link) in links.iter().enumerate() {
                held[k] &= link.edge.squared_error(&poses[link.from], &poses[link.to]) <= bounds[k];
            }
            open.retain(|&k| !held[k]);
        }
        if sees_all || !reach.is_finite() {
            break;
        }
        reach *= 2.0;
    }
    Ok(held)
}

/// Scale of the stated covariances, at most 1, estimated from the trusted links and the loops.
fn overstatement(
    poses: &[Rigid],
    links: &[Link],
    lengths: &[f64],
    held: &[bool],
    open: &[usize],
    execution: &Execution,
) -> Result<f64> {
    let sample = memory::collect(open.iter().step_by(open.len().div_ceil(SAMPLE).max(1)).copied())?;
    let found = innovations(poses, links, lengths, held, &sample, f64::INFINITY, execution)?;
    let mut found = memory::collect(found.into_iter().flatten())?;
    if found.len() < ENOUGH {
        return Ok(1.0);
    }
    let place = found.len() / 4;
    let (_, quarter, _) = found.select_nth_unstable_by(place, f64::total_cmp);
    Ok((ROOM * *quarter / QUARTER_INNOVATION).min(1.0))
}

/// Squared innovation of each open loop, its deviation from the motion predicted by the accepted links by the
/// covariances of both; `None` beyond the reach.
fn innovations(
    poses: &[Rigid],
    links: &[Link],
    lengths: &[f64],
    held: &[bool],
    open: &[usize],
    reach: f64,
    execution: &Execution,
) -> Result<Vec<Option<f64>>> {
    let mut ways = memory::filled(Vec::new(), poses.len())?;
    for (k, link) in links.iter().enumerate().filter(|(k, link)| held[*k] && link.from != link.to) {
        memory::push(&mut ways[link.from], (link.to, k))?;
        memory::push(&mut ways[link.to], (link.from, k))?;
    }
    let mut found = memory::with_capacity(open.len())?;
    for group in open.chunk_by(|&a, &b| links[a].from == links[b].from).collect::<Vec<_>>().chunks(256) {
        execution.check()?;
        let parts = memory::par_collect(group.par_iter().map(|loops| {
            let source = links[loops[0]].from;
            let arrived = shortest_paths(source, loops.iter().map(|&k| links[k].to), &ways, lengths, reach)?;
            memory::collect(loops.iter().map(|&k| innovation(&links[k], poses, links, &arrived)))
        }))?;
        for part in parts {
            memory::extend(&mut found, &part?)?;
        }
    }
    Ok(found)
}

/// The link and the predecessor by which each node is reached from the source.
type Arrivals = Vec<Option<(usize, usize)>>;

fn shortest_paths(
    source: usize,
    targets: impl Iterator<Item = usize>,
    ways: &[Vec<(usize, usize)>],
    lengths: &[f64],
    reach: f64,
) -> Result<Arrivals> {
    let mut arrived: Arrivals = memory::filled(None, ways.len())?;
    let mut length = memory::filled(f64::INFINITY, ways.len())?;
    let mut missing = memory::collect(targets)?;
    let mut waiting = BinaryHeap::from([Reverse((0, source))]); // bits of positive floats keep their order
    length[source] = 0.0;
    while let Some(Reverse((bits, node))) = waiting.pop() {
        let here = f64::from_bits(bits);
        if here > length[node] {
            continue;
        }
        missing.retain(|&target| target != node);
        if missing.is_empty() {
            break;
        }
        for &(next, link) in &ways[node] {
            let there = here + lengths[link];
            if there < length[next] && there <= reach {
                (length[next], arrived[next]) = (there, Some((link, node)));
                waiting.push(Reverse((there.to_bits(), next)));
            }
        }
    }
    missing.iter().for_each(|&target| arrived[target] = None);
    Ok(arrived)
}

fn innovation(one: &Link, poses: &[Rigid], links: &[Link], arrived: &Arrivals) -> Option<f64> {
    if one.from == one.to {
        return Some(one.edge.squared_error(&poses[one.from], &poses[one.to]));
    }
    let mut covariance = inverse(&one.edge.information)?;
    let mut node = one.to;
    while node != one.from {
        let (link, before) = arrived[node]?;
        let carried = motion::adjoint(&motion::between(&poses[one.to], &poses[links[link].to]));
        covariance += carried * inverse(&links[link].edge.information)? * carried.transpose();
        node = before;
    }
    let error = one.edge.error(&poses[one.from], &poses[one.to]);
    Some(error.dot(&Cholesky::new(covariance)?.solve(&error)))
}

fn inverse(information: &Matrix6<f64>) -> Option<Matrix6<f64>> {
    Some(Cholesky::new(*information)?.inverse())
}
