//! Every method with default parameters on seeded problems with one inlier in ten; LC with few and many
//! inliers; cliques of few, many and noisy inliers.

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use cgroup::grouping::BoxedMethod;
use cgroup::grouping::clipper::{self, Clipper};
use cgroup::grouping::geometric_consistency::{self as gc, GeometricConsistency};
use cgroup::grouping::likelihood_consensus::LikelihoodConsensus;
use cgroup::grouping::mac::MaximalCliques;
use cgroup::grouping::teaser::{Prune, Teaser};
use cgroup::{Correspondences, Execution, GroupingMethod, Result};
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
        let drawn = problem(1, n, share, 2.0);
        let framed = drawn.correspondences()?;
        let (source, target) = framed.positions("lc")?;
        let by_position = Correspondences::between(source.clone(), target.clone())?
            .with_ratio(drawn.ratio.clone())?
            .with_resolution(drawn.resolution)?;
        for (name, input) in [("lc", &by_position), ("lc with frames", &framed)] {
            group.bench_with_input(
                BenchmarkId::new(format!("{name}/{share}"), n),
                input,
                |bencher, input| {
                    bencher.iter(|| {
                        LikelihoodConsensus::default().group(black_box(input), &Execution::default())
                    });
                },
            );
        }
    }
    group.finish();
    Ok(())
}

/// Pruning and the kinds of cliques, with few, many, and many noisy inliers.
fn cliques(criterion: &mut Criterion) -> Result<()> {
    let mut group = criterion.benchmark_group("cliques");
    group.sample_size(10);
    let clique = GeometricConsistency { variant: gc::Variant::Clique, ..GeometricConsistency::default() };
    let maximum = Clipper { variant: clipper::Variant::Maximum, ..Clipper::default() };
    let methods: [(&str, BoxedMethod); 6] = [
        ("gc/clique", Box::new(clique)),
        ("mac", Box::new(MaximalCliques::default())),
        ("teaser/core", Box::new(Teaser { prune: Prune::Core, ..Teaser::default() })),
        ("teaser/clique", Box::new(Teaser::default())),
        ("clipper/densest", Box::new(Clipper::default())),
        ("clipper/maximum", Box::new(maximum)),
    ];
    for (n, share, noise) in [(5_000, 0.02, 0.5), (5_000, 0.5, 0.5), (5_000, 0.1, 1.5), (20_000, 0.01, 0.5)] {
        let input = problem(1, n, share, noise).correspondences()?;
        for (name, method) in &methods {
            let id = BenchmarkId::new(format!("{name}/{share}/{noise}"), n);
            group.bench_with_input(id, &input, |bencher, input| {
                bencher.iter(|| method.group(black_box(input), &Execution::default()));
            });
        }
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
