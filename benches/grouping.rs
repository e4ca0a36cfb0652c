//! Every method with its default parameters on seeded problems: one inlier in ten, and LC's with as few as it is made for, and with many.

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use cgroup::grouping::geometric_consistency::{GeometricConsistency, Variant};
use cgroup::grouping::likelihood_consensus::LikelihoodConsensus;
use cgroup::grouping::mac::MaximalCliques;
use cgroup::{Execution, GroupingMethod, Result};
use common::{methods, problem};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};

fn all_methods(criterion: &mut Criterion) -> Result<()> {
    let mut group = criterion.benchmark_group("grouping");
    group.sample_size(10);
    for n in [1_000, 5_000] {
        let input = problem(1, n, 0.1, 0.5).correspondences()?;
        for (name, method) in methods() {
            group.bench_with_input(BenchmarkId::new(name, n), &input, |bencher, input| {
                bencher.iter(|| method.group(black_box(input), &Execution::default()));
            });
        }
    }
    group.finish();
    Ok(())
}

fn likelihood_consensus(criterion: &mut Criterion) -> Result<()> {
    let mut group = criterion.benchmark_group("likelihood_consensus");
    group.sample_size(10);
    for (n, share) in
        [(1_000, 0.01), (1_000, 0.5), (5_000, 0.005), (5_000, 0.5), (20_000, 0.005), (100_000, 0.005)]
    {
        let input = problem(1, n, share, 2.0).correspondences()?;
        group.bench_with_input(BenchmarkId::new(format!("lc/{share}"), n), &input, |bencher, input| {
            bencher.iter(|| LikelihoodConsensus::default().group(black_box(input), &Execution::default()));
        });
    }
    group.finish();
    Ok(())
}

/// Cliques: few among many, and many.
fn cliques(criterion: &mut Criterion) -> Result<()> {
    let mut group = criterion.benchmark_group("cliques");
    group.sample_size(10);
    let clique = GeometricConsistency { variant: Variant::Clique, ..GeometricConsistency::default() };
    for (n, share) in [(5_000, 0.01), (5_000, 0.5), (20_000, 0.01)] {
        let input = problem(1, n, share, 0.5).correspondences()?;
        group.bench_with_input(BenchmarkId::new(format!("mac/{share}"), n), &input, |bencher, input| {
            bencher.iter(|| MaximalCliques::default().group(black_box(input), &Execution::default()));
        });
        group.bench_with_input(BenchmarkId::new(format!("gc/{share}"), n), &input, |bencher, input| {
            bencher.iter(|| clique.group(black_box(input), &Execution::default()));
        });
    }
    group.finish();
    Ok(())
}

fn benches(criterion: &mut Criterion) {
    if let Err(error) = all_methods(criterion)
        .and_then(|()| likelihood_consensus(criterion))
        .and_then(|()| cliques(criterion))
    {
        criterion.bench_function(&format!("skipped: {error}"), |bencher| bencher.iter(|| ()));
    }
}

criterion_group!(grouping, benches);
criterion_main!(grouping);
