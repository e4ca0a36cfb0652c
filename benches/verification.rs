//! Poses scored on two halves of a bumpy closed surface, unit = 0.4 of the distance between points.
//!
//! The cells of a surface's grids are filled at their first lookup: `fresh` uses new surfaces in every round,
//! `again` those of earlier rounds.

use std::f64::consts::PI;
use std::hint::black_box;

use cgroup::consensus::counter_rng::random_words;
use cgroup::geometry::rigid::Rigid;
use cgroup::verification::{FineSurface, Side, Surface, align, overlap, places, score_poses, verify};
use cgroup::{Execution, Points, Result};
use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Rotation3, Vector3};

const UNIT: f64 = 0.4;
/// Spacing of the fine surfaces: the distance between points.
const SPACING: f64 = 1.0;
const POSES: u64 = 1_000;

/// Points of a golden-angle lattice on a bumpy sphere, between two fractions of the way from one pole to the
/// other.
fn part(count: u32, first: f64, last: f64) -> Result<(Points, Vec<Vector3<f64>>)> {
    let size = (f64::from(count) / (4.0 * PI) / (last - first)).sqrt();
    let place = |i: u32| {
        let z = 1.0 - 2.0 * (first + (last - first) * (f64::from(i) + 0.5) / f64::from(count));
        let angle = f64::from(i) * PI * (1.0 + 5.0_f64.sqrt());
        let flat = (1.0 - z * z).sqrt();
        let d = Vector3::new(flat * angle.cos(), flat * angle.sin(), z);
        (d * size * (1.0 + 0.1 * (5.0 * d.x + d.y).sin() + 0.05 * (11.0 * d.z).sin()), d)
    };
    let (points, normals): (Vec<_>, Vec<_>) = (0..count).map(place).unzip();
    let rows: Vec<[f64; 3]> = points.into_iter().map(Into::into).collect();
    Ok((Points::from_rows("points", &rows)?, normals))
}

/// Poses from near the correct one, the identity, to arbitrary ones.
fn poses(size: f64) -> Vec<Rigid> {
    let number = |i: u64, k: usize| random_words(k as u64, i)[0] as f64 / u64::MAX as f64 - 0.5;
    let pose = |i: u64| {
        let spread = i as f64 / POSES as f64;
        let vector = |k: usize| Vector3::from_fn(|axis, _| number(i, k + axis)) * spread;
        Rigid { rotation: Rotation3::new(vector(0) * 2.0 * PI).into_inner(), translation: vector(3) * size }
    };
    (0..POSES).map(pose).collect()
}

fn benches(criterion: &mut Criterion) {
    for count in [5_000, 40_000] {
        if let Err(error) = surfaces_of(criterion, count).and_then(|()| fine_surfaces_of(criterion, count)) {
            criterion.bench_function(&format!("skipped: {error}"), |bencher| bencher.iter(|| ()));
        }
    }
}

fn surfaces_of(criterion: &mut Criterion, count: u32) -> Result<()> {
    let execution = Execution::default();
    let parts = [part(count, 0.0, 0.6)?, part(count, 0.3, 0.9)?];
    let make = || {
        parts.each_ref().map(|(points, normals)| Surface::new(points, normals, UNIT, Side::Known, &execution))
    };
    let [source, target] = make();
    let (source, target) = (source?, target?);
    let all = poses(parts[0].0.diagonal());
    let mut group = criterion.benchmark_group("verification");
    group.sample_size(10);
    let id = |name: &str| BenchmarkId::new(name, count);
    group.bench_function(id("surfaces"), |bencher| bencher.iter(|| black_box(make())));
    for (name, poses) in [("1000_poses", &all[..]), ("3_poses", &all[..3])] {
        group.bench_function(id(&format!("fresh/{name}")), |bencher| {
            bencher.iter_batched(
                make,
                |surfaces| {
                    let [Ok(source), Ok(target)] = &surfaces else { return None };
                    verify(source, target, black_box(poses), None, &execution).ok()
                },
                BatchSize::PerIteration,
            );
        });
        group.bench_function(id(&format!("again/{name}")), |bencher| {
            bencher.iter(|| verify(&source, &target, black_box(poses), None, &execution));
        });
    }
    group.bench_function(id("score_poses"), |bencher| {
        bencher.iter(|| score_poses(&source, &target, black_box(&all), &execution));
    });
    group.bench_function(id("overlap"), |bencher| {
        bencher.iter(|| overlap(&source, &target, black_box(&all[0]), &execution));
    });
    group.bench_function(id("places"), |bencher| {
        bencher.iter(|| places(&source, &target, black_box(&all[0]), &execution));
    });
    group.finish();
    Ok(())
}

fn fine_surfaces_of(criterion: &mut Criterion, count: u32) -> Result<()> {
    let execution = Execution::default();
    let parts = [part(count, 0.0, 0.6)?.0, part(count, 0.3, 0.9)?.0];
    let make = || parts.each_ref().map(|points| FineSurface::new(points, SPACING, &execution));
    let [source, target] = make();
    let (source, target) = (source?, target?);
    let near = &poses(parts[0].diagonal())[1];
    let mut group = criterion.benchmark_group("refinement");
    group.sample_size(10);
    let id = |name: &str| BenchmarkId::new(name, count);
    group.bench_function(id("fine_surfaces"), |bencher| bencher.iter(|| black_box(make())));
    group.bench_function(id("align"), |bencher| {
        bencher.iter(|| align(&source, &target, black_box(near), usize::MAX, &execution));
    });
    group.finish();
    Ok(())
}

criterion_group!(verification, benches);
criterion_main!(verification);
