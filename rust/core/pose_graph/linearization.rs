//! The cost of all links linearized about the poses: a linear system for the twists of the free nodes.

use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;

use super::components::Sets;
use super::system::{Place, System};
use super::{Link, motion};
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;

/// Links linearized in parallel before their blocks are added in order.
const CHUNK: usize = 1024;

/// Links between poses, each with its weight; the first node of each component is fixed.
pub struct Linearization<'a> {
    links: Vec<(Link<'a>, f64)>,
    places: Vec<Option<Place>>,
    unknown: Vec<Option<usize>>,
    pub system: System,
    /// Gradient of the cost with respect to the twists.
    pub gradient: Vec<f64>,
}

struct Blocks {
    diagonals: [Matrix6<f64>; 2],
    below: Matrix6<f64>,
    gradients: [Vector6<f64>; 2],
}

impl<'a> Linearization<'a> {
    pub fn new(nodes: usize, links: impl Iterator<Item = (Link<'a>, f64)>, sides: usize) -> Result<Self> {
        let links = memory::collect(links.filter(|(link, weight)| link.from != link.to && *weight > 0.0))?;
        let mut sets = Sets::new(nodes)?;
        links.iter().for_each(|(link, _)| _ = sets.join(link.from, link.to));
        let mut unknowns = 0;
        let unknown = memory::collect((0..nodes).map(|node| {
            let moves = sets.find(node) != node;
            unknowns += usize::from(moves);
            moves.then(|| unknowns - 1)
        }))?;
        let free = |link: &Link| Some((unknown[link.from]?, unknown[link.to]?));
        let system = System::new(unknowns, 6, links.iter().filter_map(|(link, _)| free(link)), sides)?;
        let places = memory::collect(links.iter().map(|(link, _)| {
            let (from, to) = free(link)?;
            system.place(from.max(to), from.min(to))
        }))?;
        let gradient = memory::filled(0.0, system.len())?;
        Ok(Self { links, places, unknown, system, gradient })
    }

    /// Index of the unknown of a node; `None` if it is fixed.
    pub fn unknown(&self, node: usize) -> Option<usize> {
        self.unknown[node]
    }

    pub fn cost(&self, poses: &[Rigid]) -> Result<f64> {
        let costs = memory::par_collect(self.links.par_iter().with_min_len(64).map(|(link, weight)| {
            0.5 * weight * link.edge.squared_error(&poses[link.from], &poses[link.to])
        }))?;
        Ok(costs.iter().sum()) // in order: the same bits on any number of threads
    }

    /// Computes the system and the gradient.
    pub fn linearize(&mut self, poses: &[Rigid], execution: &Execution) -> Result<()> {
        self.system.clear();
        self.gradient.fill(0.0);
        for (links, places) in self.links.chunks(CHUNK).zip(self.places.chunks(CHUNK)) {
            execution.check()?;
            let blocks =
                memory::par_collect(links.par_iter().with_min_len(64).map(|one| linearize(one, poses)))?;
            for (((link, _), place), blocks) in links.iter().zip(places).zip(&blocks) {
                let ends = [self.unknown[link.from], self.unknown[link.to]];
                for (k, node) in ends.into_iter().enumerate() {
                    if let Some(node) = node {
                        self.system.add_diagonal(node, blocks.diagonals[k].as_slice());
                        let slots = self.gradient[6 * node..6 * node + 6].iter_mut();
                        slots.zip(&blocks.gradients[k]).for_each(|(sum, term)| *sum += term);
                    }
                }
                if let Some(place) = *place {
                    if link.from < link.to {
                        self.system.add_below(place, blocks.below.as_slice());
                    } else {
                        self.system.add_below(place, blocks.below.transpose().as_slice());
                    }
                }
            }
        }
        Ok(())
    }

    /// Poses moved by the twists of a step.
    pub fn moved(&self, poses: &[Rigid], step: &[f64]) -> Result<Vec<Rigid>> {
        memory::collect(poses.iter().zip(&self.unknown).map(|(pose, unknown)| match unknown {
            Some(k) => {
                let twist = Vector6::from_column_slice(&step[6 * k..6 * k + 6]);
                motion::compose(pose, &motion::exponential(&twist))
            }
            None => *pose,
        }))
    }
}

/// Linearizes the error: `e(d_i, d_j) = e - J Ad(T_ij^-1) d_i + J d_j`.
fn linearize(&(ref link, weight): &(Link, f64), poses: &[Rigid]) -> Blocks {
    let (from, to) = (&poses[link.from], &poses[link.to]);
    let error = link.edge.error(from, to);
    let jacobian = motion::inverse_right_jacobian(&error);
    let back = motion::adjoint(&motion::between(to, from));
    let weighted = jacobian.transpose() * link.edge.information * weight;
    let second = weighted * jacobian;
    let below = -(second * back);
    let slope = weighted * error;
    let back = back.transpose();
    Blocks { diagonals: [-(back * below), second], below, gradients: [-(back * slope), slope] }
}
