//! Pose graphs: estimates the poses of nodes from measured motions between them, by least squares on SE(3);
//! rejects wrong edges by graduated non-convexity; computes covariances.
//!
//! The error of an edge is the twist `e = log(Z^-1 T_i^-1 T_j)` (rotation vector, translation), and its cost
//! `e' W e / 2` with the information W: GTSAM's convention. The first node of each component keeps its pose.

mod chordal;
mod components;
mod conjugate;
mod factor;
mod growth;
mod linearization;
mod minimum;
pub mod motion;
mod robust;
mod system;

use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;

pub use components::components;

/// A measured motion between two nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// The node i.
    pub from: usize,
    /// The node j.
    pub to: usize,
    /// `T_i^-1 T_j`: maps points of j's frame into i's.
    pub measurement: Rigid,
    /// Inverse covariance of the twist that moves the measurement on its right.
    pub information: Matrix6<f64>,
    /// Prior probability that the edge is correct; 1 for a trusted edge.
    pub probability: f64,
}

impl Edge {
    /// Error of the measurement under the poses.
    pub fn error(&self, from: &Rigid, to: &Rigid) -> Vector6<f64> {
        motion::logarithm(&motion::between(&self.measurement, &motion::between(from, to)))
    }

    /// `e' W e`.
    pub fn squared_error(&self, from: &Rigid, to: &Rigid) -> f64 {
        let error = self.error(from, to);
        error.dot(&(self.information * error)).max(0.0)
    }
}

/// Initial poses of the minimization.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// From the edges alone: rotations by linear least squares, then translations (Carlone and others,
    /// *Initialization Techniques for 3D SLAM*, ICRA 2015).
    Chordal,
    /// The given poses.
    Given,
}

/// Optimized poses, and the mask of kept edges.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimized {
    /// Poses, node to world.
    pub poses: Vec<Rigid>,
    /// False for edges rejected by the robust optimization.
    pub kept: Vec<bool>,
}

/// An edge between nodes of a component, by their indices in it.
#[derive(Clone, Copy)]
struct Link<'a> {
    from: usize,
    to: usize,
    edge: &'a Edge,
}

/// Estimates the poses of least cost.
///
/// # Errors
/// [`Error::InvalidInput`] for an edge with an unknown node or a number that is not finite,
/// [`Error::OutOfMemory`], [`Error::Interrupted`].
pub fn optimize(
    poses: &[Rigid],
    edges: &[Edge],
    start: Start,
    robust: bool,
    execution: &Execution,
) -> Result<Optimized> {
    check(poses, edges)?;
    let mut optimized = Optimized { poses: memory::copied(poses)?, kept: memory::filled(true, edges.len())? };
    let mut place = memory::filled(0, poses.len())?;
    let parts = components(poses.len(), edges.iter().map(|edge| (edge.from, edge.to)))?;
    let mut edges_of = memory::filled(Vec::new(), parts.len())?;
    let mut part_of = memory::filled(0, poses.len())?;
    for (number, part) in parts.iter().enumerate() {
        for (k, &node) in part.iter().enumerate() {
            (place[node], part_of[node]) = (k, number);
        }
    }
    for (k, edge) in edges.iter().enumerate() {
        memory::push(&mut edges_of[part_of[edge.from]], k)?;
    }
    for (part, numbers) in parts.iter().zip(&edges_of) {
        execution.check()?;
        if numbers.is_empty() {
            continue;
        }
        let links = memory::collect(numbers.iter().map(|&k| {
            let edge = &edges[k];
            Link { from: place[edge.from], to: place[edge.to], edge }
        }))?;
        let mut local = memory::collect(part.iter().map(|&node| poses[node]))?;
        if robust {
            let kept = robust::optimize(&mut local, &links, start, execution)?;
            numbers.iter().zip(kept).for_each(|(&k, kept)| optimized.kept[k] = kept);
        } else {
            if start == Start::Chordal {
                chordal::place(&mut local, &links)?;
            }
            minimum::minimize(&mut local, &links, &minimum::FINE, execution)?;
        }
        part.iter().zip(local).for_each(|(&node, pose)| optimized.poses[node] = pose);
    }
    Ok(optimized)
}

/// `e' W e` of each edge.
///
/// # Errors
/// As [`optimize`].
pub fn squared_errors(poses: &[Rigid], edges: &[Edge]) -> Result<Vec<f64>> {
    check(poses, edges)?;
    memory::par_collect(edges.par_iter().map(|edge| edge.squared_error(&poses[edge.from], &poses[edge.to])))
}

/// Marginal covariances of nodes: of the twists that move their poses on the right, with the first node of
/// each component fixed.
///
/// # Errors
/// As [`optimize`]; [`Error::InvalidInput`] for an unknown node.
pub fn covariances(
    poses: &[Rigid],
    edges: &[Edge],
    nodes: &[usize],
    execution: &Execution,
) -> Result<Vec<Matrix6<f64>>> {
    check(poses, edges)?;
    if let Some(node) = nodes.iter().find(|&&node| node >= poses.len()) {
        return Err(Error::invalid("node", node, "give the number of a node"));
    }
    let links = memory::collect(edges.iter().map(|edge| Link { from: edge.from, to: edge.to, edge }))?;
    minimum::covariances(poses, &links, nodes, execution)
}

fn check(poses: &[Rigid], edges: &[Edge]) -> Result<()> {
    let is_finite = |pose: &Rigid| pose.to_matrix().iter().all(|number| number.is_finite());
    if let Some(node) = poses.iter().position(|pose| !is_finite(pose)) {
        return Err(Error::invalid("poses", format!("no number in pose {node}"), "give finite numbers"));
    }
    for (k, edge) in edges.iter().enumerate() {
        if edge.from.max(edge.to) >= poses.len() {
            let got = format!("{} and {} in row {k}", edge.from, edge.to);
            return Err(Error::invalid("edges", got, format!("there are {} poses", poses.len())));
        }
        if !is_finite(&edge.measurement) || !edge.information.iter().all(|number| number.is_finite()) {
            return Err(Error::invalid("edges", format!("no number in row {k}"), "give finite numbers"));
        }
    }
    Ok(())
}
