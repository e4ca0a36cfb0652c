//! The nine methods with the paper's parameters on seeded problems, one inlier in ten.

#[path = "../tests/common/mod.rs"]
mod common;

use std::hint::black_box;

use cgroup::{Execution, Result};
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

fn benches(criterion: &mut Criterion) {
    if let Err(error) = all_methods(criterion) {
        criterion.bench_function(&format!("skipped: {error}"), |bencher| bencher.iter(|| ()));
    }
}

criterion_group!(grouping, benches);
criterion_main!(grouping);
