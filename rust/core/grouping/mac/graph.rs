//! The second-order graph of MAC, sparse: the neighbours of each vertex, with weights of agreement.
//!
//! Weights are integer multiples of `2^-15`, and those of the second order of `2^-16`: their sums are exact
//! in any order.

use rayon::prelude::*;

use crate::compatibility::agreement::DistanceAgreement;
use crate::compatibility::distance::distance_difference;
use crate::compatibility::graph::indices;
use crate::compatibility::long_agreement::{EdgeLengths, LongAgreement};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;

/// Fixed-point representation of the weight 1.
const ONE: f64 = (1_u32 << 15) as f64;

/// Shift from products of three weights to weights of the second order.
const PRODUCT_SHIFT: u32 = 3 * 15 - SECOND_ORDER_BITS;

/// Fractional bits of a weight of the second order.
pub const SECOND_ORDER_BITS: u32 = 16;

/// Bytes of the graph for each neighbour of each vertex: its index, the weights of both orders, and the cube
/// root.
pub const BYTES_PER_NEIGHBOR: f64 = 4.0 + 2.0 + 4.0 + 4.0;

/// Agreement of pairs and its weight.
#[derive(Debug, Clone, Copy)]
pub struct Kernel {
    /// Greatest distance difference.
    pub bound: f64,
    /// Weight of pairs that differ by the bound.
    pub min_weight: f64,
}

impl Kernel {
    /// `w = 1 - (1 - w_min) (d / d_max)^2`.
    fn weight(&self, difference: f64) -> u16 {
        let share = difference / self.bound;
        ((1.0 - (1.0 - self.min_weight) * share * share) * ONE).round() as u16
    }
}

/// Vertices and their neighbours, ascending. Pairs without a common neighbour have the weight 0.
#[derive(Debug)]
pub struct SecondOrderGraph {
    /// Start of each vertex' neighbours, and the end of the last ones.
    starts: Vec<usize>,
    neighbors: Vec<u32>,
    /// `W_ij`, in units of `2^-16`.
    weights: Vec<u32>,
}

impl SecondOrderGraph {
    /// Graph of matched points.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn new(source: &Points, target: &Points, kernel: Kernel, execution: &Execution) -> Result<Self> {
        // The original keeps weights equal to the cut; `<` the next number includes them.
        let agreement = DistanceAgreement::new(source, target, kernel.bound.next_up())?;
        let mut starts = memory::with_capacity(source.len() + 1)?;
        starts.push(0);
        for count in agreement.counts(execution)? {
            starts.push(starts[starts.len() - 1] + count as usize);
        }
        let rows = LongAgreement::new(agreement, EdgeLengths::Any);
        let mut neighbors = memory::filled(0, starts[starts.len() - 1])?;
        let mut first_order = memory::filled(0, neighbors.len())?;
        let words = source.len().div_ceil(u64::BITS as usize);
        let parts = parts(&mut neighbors, &starts)?.into_par_iter().zip(parts(&mut first_order, &starts)?);
        parts.enumerate().try_for_each_init(
            || memory::try_map([(); 2], |()| memory::filled(0, words)),
            |space, (i, (neighbors, weights))| {
                let [row, unsure] = memory::ready(space)?;
                rows.fill_row(i, row, unsure);
                let others = indices(row).filter(|&j| j as usize != i);
                for ((j, neighbor), weight) in others.zip(neighbors).zip(weights) {
                    let [ds, dt] = [source, target].map(|points| points.distance(i, j as usize));
                    *neighbor = j;
                    *weight = kernel.weight(distance_difference(ds, dt)); // w_ij
                }
                execution.check()
            },
        )?;
        let mut graph = Self { starts, weights: Vec::new(), neighbors };
        let paths = graph.sums_over_paths(&first_order, execution)?;
        let products = first_order.iter().zip(paths);
        // W_ij = w_ij sum_k w_ik w_jk
        let weights = products.map(|(&w, sum)| ((u64::from(w) * sum) >> PRODUCT_SHIFT) as u32);
        graph.weights = memory::collect(weights)?;
        Ok(graph)
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The neighbours of a vertex, and their weights of the second order.
    pub fn row(&self, i: usize) -> (&[u32], &[u32]) {
        let row = self.starts[i]..self.starts[i + 1];
        (&self.neighbors[row.clone()], &self.weights[row])
    }

    /// All weights of the second order, vertex by vertex.
    pub fn weights(&self) -> &[u32] {
        &self.weights
    }

    /// The sum over the common neighbours k of each pair i-j of the products of the values of i-k and j-k.
    /// The values of i-j and j-i are the same.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn sums_over_paths<V: PathValue>(&self, values: &[V], execution: &Execution) -> Result<Vec<V::Sum>> {
        let mut sums = memory::filled(V::Sum::default(), self.neighbors.len())?;
        let rows = parts(&mut sums, &self.starts)?.into_par_iter().enumerate();
        rows.try_for_each_init(
            || memory::filled(V::default(), self.len()),
            |spread, (i, sums)| {
                let spread = memory::ready(spread)?;
                let row = self.starts[i]..self.starts[i + 1];
                let (neighbors, own) = (&self.neighbors[row.clone()], &values[row]);
                neighbors.iter().zip(own).for_each(|(&j, &value)| spread[j as usize] = value);
                for (&j, sum) in neighbors.iter().zip(sums).filter(|&(&j, _)| j as usize > i) {
                    let other = self.starts[j as usize]..self.starts[j as usize + 1];
                    let edges = self.neighbors[other.clone()].iter().zip(&values[other]);
                    *sum = edges.map(|(&k, &value)| value.times(spread[k as usize])).sum();
                }
                neighbors.iter().for_each(|&j| spread[j as usize] = V::default());
                execution.check()
            },
        )?;
        self.mirror(&mut sums)?;
        Ok(sums)
    }

    /// Copies the value of i-j, i < j, to j-i.
    fn mirror<S: Copy>(&self, values: &mut [S]) -> Result<()> {
        let mut next = memory::copied(&self.starts)?; // for each vertex, its first neighbour without a copy
        for i in 0..self.len() {
            for at in self.starts[i]..self.starts[i + 1] {
                let j = self.neighbors[at] as usize;
                if j > i {
                    values[next[j]] = values[at];
                    next[j] += 1;
                }
            }
        }
        Ok(())
    }
}

/// Value of an edge in sums over paths.
pub trait PathValue: Copy + Default + Send + Sync {
    /// Type of the sums of products.
    type Sum: Copy + Default + Send + std::iter::Sum;

    /// The product.
    fn times(self, other: Self) -> Self::Sum;
}

impl PathValue for u16 {
    type Sum = u64;

    fn times(self, other: Self) -> u64 {
        u64::from(u32::from(self) * u32::from(other))
    }
}

impl PathValue for f32 {
    type Sum = f64;

    fn times(self, other: Self) -> f64 {
        f64::from(self) * f64::from(other)
    }
}

/// The values of each vertex as separate slices.
fn parts<'a, T>(values: &'a mut [T], starts: &[usize]) -> Result<Vec<&'a mut [T]>> {
    let mut rest = values;
    let mut parts = memory::with_capacity(starts.len())?;
    for pair in starts.windows(2) {
        let (part, after) = rest.split_at_mut(pair[1] - pair[0]);
        parts.push(part);
        rest = after;
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_the_equations() -> Result<()> {
        let place = |i: usize, k: f64| [(i as f64 * k).sin(), (i as f64 * 1.7 * k).cos(), (i as f64).cos()];
        let rows = |k: f64| (0..80).map(|i| place(i, k)).collect::<Vec<_>>();
        let (p, q) = (Points::from_rows("source", &rows(0.37))?, Points::from_rows("target", &rows(0.4))?);
        let kernel = Kernel { bound: 0.3, min_weight: 0.5 };
        let graph = SecondOrderGraph::new(&p, &q, kernel, &Execution::default())?;
        let difference = |i: usize, j: usize| (p.distance(i, j) - q.distance(i, j)).abs();
        let weight = |i: usize, j: usize| match difference(i, j) {
            d if i != j && d <= 0.3 => 1.0 - 0.5 * (d / 0.3).powi(2),
            _ => 0.0,
        };
        assert_eq!(graph.len(), 80);
        for i in 0..80 {
            let (neighbors, weights) = graph.row(i);
            let expected: Vec<usize> = (0..80).filter(|&j| weight(i, j) > 0.0).collect();
            assert!(neighbors.iter().map(|&j| j as usize).eq(expected));
            for (&j, &found) in neighbors.iter().zip(weights) {
                let j = j as usize;
                let second: f64 = weight(i, j) * (0..80).map(|k| weight(i, k) * weight(j, k)).sum::<f64>();
                assert!((f64::from(found) / f64::from(1 << SECOND_ORDER_BITS) - second).abs() < 0.01);
            }
        }
        Ok(())
    }
}
