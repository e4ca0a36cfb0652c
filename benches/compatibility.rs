//! Components of the grouping methods on seeded problems with one inlier in ten: tests of pairs, pairwise
//! matrices, residuals, eigenvectors, thresholds. The id contains the size.

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use cgroup::compatibility::agreement::DistanceAgreement;
use cgroup::compatibility::matrix::{PairMatrix, PairScore};
use cgroup::consensus::SampleConsensus;
use cgroup::geometry::rigid::fit_triangle;
use cgroup::selection::eigenvector::{Eigensolver, principal_eigenvector};
use cgroup::selection::otsu::{DEFAULT_BINS, OtsuMode, otsu};
use cgroup::selection::top_k::largest;
use cgroup::{Execution, Points, Result};
use common::{Uniform, problem};
use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

/// A length, in units of the problems' resolution.
const TOLERANCE: f64 = 5.0;

/// Hypotheses from which the best is selected.
const HYPOTHESES: usize = 100;

fn sides(n: usize) -> Result<(Points, Points)> {
    let problem = problem(1, n, 0.1, 0.5);
    let rows = |points: &[nalgebra::Vector3<f64>]| points.iter().map(|&p| p.into()).collect::<Vec<_>>();
    let source = Points::from_rows("source", &rows(&problem.source))?;
    Ok((source, Points::from_rows("target", &rows(&problem.target))?))
}

/// GC's test of pairs; the throughput counts each pair once.
fn agreement(group: &mut BenchmarkGroup<'_, WallTime>, source: &Points, target: &Points) {
    group.bench_function(BenchmarkId::new("distance_agreement", source.len()), |b| {
        let agreement = DistanceAgreement::new(source, target, TOLERANCE);
        b.iter(|| agreement.as_ref().map(|agreement| agreement.counts(&Execution::default())));
    });
}

/// A product with the matrix, and its construction; the throughput counts each pair once.
fn matrix(group: &mut BenchmarkGroup<'_, WallTime>, source: &Points, target: &Points) {
    let n = source.len();
    let x = vec![1.0 / n as f64; n];
    let ratio = PairScore::DistanceRatio;
    for (name, max_memory) in [("stored", usize::MAX), ("recomputed", 0)] {
        let execution = Execution::new(max_memory);
        let make = || PairMatrix::new(source, target, ratio, None, &execution);
        let Ok(matrix) = make() else { continue };
        group.bench_function(BenchmarkId::new(format!("matrix/multiply_rounded/{name}"), n), |b| {
            b.iter(|| matrix.multiply_rounded(black_box(&x), &execution));
        });
        if max_memory > 0 {
            group.bench_function(BenchmarkId::new("matrix/make", n), |b| b.iter(make));
            group.bench_function(BenchmarkId::new("matrix/multiply", n), |b| {
                b.iter(|| matrix.multiply(black_box(&x), &execution));
            });
        }
    }
}

fn pairs(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("pairs");
    group.sample_size(10);
    for n in [1_000, 5_000, 20_000] {
        let Ok((source, target)) = sides(n) else { continue };
        group.throughput(Throughput::Elements((n * (n - 1) / 2) as u64));
        agreement(&mut group, &source, &target);
        matrix(&mut group, &source, &target);
    }
}

fn eigenvector(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("eigenvector");
    group.sample_size(10);
    let execution = Execution::default();
    for (solver, n) in [(Eigensolver::Power, 1_000), (Eigensolver::Power, 5_000), (Eigensolver::Dense, 1_000)]
    {
        let Ok((source, target)) = sides(n) else { continue };
        let ratio = PairScore::DistanceRatio;
        let Ok(matrix) = PairMatrix::new(&source, &target, ratio, None, &execution) else {
            continue;
        };
        group.bench_function(BenchmarkId::new(format!("{solver:?}").to_lowercase(), n), |b| {
            b.iter(|| principal_eigenvector(&matrix, solver, &execution));
        });
    }
}

/// RANSAC's steps: a transform from three correspondences, and the best of many by its inliers.
fn hypotheses(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("hypotheses");
    for n in [1_000, 5_000, 100_000] {
        let Ok((source, target)) = sides(n) else { continue };
        let triangle = |points: &Points| [0, n / 3, n / 2].map(|i| points.get(i));
        let (from, to) = (triangle(&source), triangle(&target));
        group.bench_function(BenchmarkId::new("fit_triangle", n), |b| {
            b.iter(|| fit_triangle(black_box(&from), &to));
        });
        let engine = SampleConsensus {
            iterations: HYPOTHESES,
            tolerance: TOLERANCE,
            seed: 1,
            edge_ratio: None,
            confidence: None,
        };
        group.bench_function(BenchmarkId::new(format!("best_of_{HYPOTHESES}"), n), |b| {
            b.iter(|| engine.run(&source, &target, &Execution::default()));
        });
    }
}

fn thresholds(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("selection");
    for n in [1_000, 100_000] {
        let mut random = Uniform::new(1);
        let scores: Vec<f64> = (0..n).map(|_| random.next()).collect();
        for (name, mode) in [("otsu/minmax", OtsuMode::default()), ("otsu/exact", OtsuMode::Exact)] {
            let cut = || otsu(black_box(&scores), mode, DEFAULT_BINS);
            group.bench_function(BenchmarkId::new(name, n), |b| b.iter(cut));
        }
        group.bench_function(BenchmarkId::new("top_200", n), |b| b.iter(|| largest(black_box(&scores), 200)));
    }
}

criterion_group!(compatibility, pairs, eigenvector, hypotheses, thresholds);
criterion_main!(compatibility);
