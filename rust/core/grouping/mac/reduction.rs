//! Reduction of a dense graph to the vertices whose neighbours agree with each other.

use rayon::prelude::*;

use super::graph::{SECOND_ORDER_BITS, SecondOrderGraph};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::selection::otsu::{DEFAULT_BINS, OtsuMode, otsu};

/// A graph is dense if none of the three cuts on its coefficients is lower.
const DENSE: f64 = 3.0;

/// A graph of at most this many vertices is not reduced, and no graph is reduced to fewer.
const LEAST_VERTICES: usize = 50;

/// The limit starts at ten times the greater cut, and falls in steps of a twentieth of it until enough
/// vertices reach it.
const FIRST_STEP: u32 = 10 * STEPS;
const STEPS: u32 = 20;

/// The vertices searched for cliques, ascending; all if the graph is not dense.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn dense_part(graph: &SecondOrderGraph, execution: &Execution) -> Result<Vec<u32>> {
    let all = 0..graph.len() as u32;
    if graph.len() <= LEAST_VERTICES {
        return memory::collect(all);
    }
    let Coefficients { of_vertices, pooled } = coefficients(graph, execution)?;
    let cut = otsu(&of_vertices, OtsuMode::Legacy, DEFAULT_BINS)?.threshold;
    let otsu = cut.unwrap_or(of_vertices[0]); // all are equal if there is no cut
    let mean = of_vertices.iter().sum::<f64>() / of_vertices.len() as f64;
    if otsu.min(mean).min(pooled) <= DENSE {
        return memory::collect(all);
    }
    let limit = limit(&of_vertices, otsu.max(pooled))?;
    memory::collect(all.filter(|&i| of_vertices[i as usize] >= limit))
}

/// The greatest multiple of the cut, in steps, that enough vertices reach.
fn limit(coefficients: &[f64], cut: f64) -> Result<f64> {
    let mut descending = memory::copied(coefficients)?;
    descending.sort_unstable_by(|a, b| b.total_cmp(a));
    let reached = descending[LEAST_VERTICES - 1];
    let mut limits = (0..=FIRST_STEP).rev().map(|step| f64::from(step) / f64::from(STEPS) * cut);
    Ok(limits.find(|&limit| limit <= reached).unwrap_or_default())
}

/// Agreement of the neighbours of each vertex with each other, and over all pairs of neighbours. In f32, so
/// that numbers that differ by the rounding of sums are equal.
struct Coefficients {
    of_vertices: Vec<f64>,
    pooled: f64,
}

/// `c_i = sum_(j<k) (W_ij W_ik W_jk)^(1/3) / (deg_i (deg_i - 1) / 2)`.
fn coefficients(graph: &SecondOrderGraph, execution: &Execution) -> Result<Coefficients> {
    let unit = f64::from(1_u32 << SECOND_ORDER_BITS);
    let roots = graph.weights().par_iter().map(|&weight| (f64::from(weight) / unit).cbrt() as f32);
    let roots = memory::par_collect(roots)?;
    let paths = graph.sums_over_paths(&roots, execution)?;
    let (mut rest, mut roots) = (&paths[..], &roots[..]);
    let (mut of_vertices, mut sum, mut pairs) = (memory::with_capacity(graph.len())?, 0.0, 0.0);
    for i in 0..graph.len() {
        let len = graph.row(i).0.len();
        let (own, own_roots);
        (own, rest) = rest.split_at(len);
        (own_roots, roots) = roots.split_at(len);
        // Each triangle is found from both of its edges at i.
        let triangles =
            own.iter().zip(own_roots).map(|(path, &root)| path * f64::from(root)).sum::<f64>() / 2.0;
        let degree = own_roots.iter().filter(|&&root| root > 0.0).count() as f64;
        let possible = degree * (degree - 1.0) / 2.0;
        of_vertices.push(mean(triangles, possible));
        sum += triangles;
        pairs += possible;
    }
    Ok(Coefficients { of_vertices, pooled: mean(sum, pairs) })
}

fn mean(sum: f64, count: f64) -> f64 {
    if count > 0.0 { f64::from((sum / count) as f32) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::mac::graph::Kernel;
    use crate::points::Points;

    /// `right` points follow one motion; the others move randomly.
    fn graph(n: usize, right: usize) -> Result<SecondOrderGraph> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 50.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..n).map(|i| place(i, 1.0)).collect();
        let moved = |(i, p): (usize, &[f64; 3])| if i < right { [p[1], p[2], p[0]] } else { place(i, 0.7) };
        let target: Vec<_> = source.iter().enumerate().map(moved).collect();
        let (source, target) = (Points::from_rows("source", &source)?, Points::from_rows("target", &target)?);
        SecondOrderGraph::new(
            &source,
            &target,
            Kernel { bound: 0.1, min_weight: 0.99 },
            &Execution::default(),
        )
    }

    #[test]
    fn a_dense_graph_keeps_vertices_of_one_motion() -> Result<()> {
        let kept = dense_part(&graph(1000, 100)?, &Execution::default())?;
        assert!((LEAST_VERTICES..=100).contains(&kept.len()), "{}", kept.len());
        assert!(kept.iter().all(|&i| i < 100));
        Ok(())
    }

    #[test]
    fn sparse_and_small_graphs_are_not_reduced() -> Result<()> {
        assert_eq!(dense_part(&graph(1000, 5)?, &Execution::default())?.len(), 1000);
        assert_eq!(dense_part(&graph(50, 50)?, &Execution::default())?.len(), 50);
        Ok(())
    }

    #[test]
    fn the_limit_is_the_first_that_enough_reach() -> Result<()> {
        let coefficients: Vec<f64> = (0..100).map(f64::from).collect();
        assert!((limit(&coefficients, 20.0)? - 50.0).abs() < 1e-12); // 2.5 cuts, and the fiftieth is 50
        assert!(limit(&[0.0; 60], 20.0)? <= 0.0);
        Ok(())
    }
}
