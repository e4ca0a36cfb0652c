//! The front end on a bumpy closed surface of 40,000 points, unit = resolution.
//!
//! `neighbors/*` set the crate's own searches beside kiddo. Radii are those that PCL is timed with.

use std::f64::consts::PI;
use std::hint::black_box;
use std::num::NonZero;

use cgroup::features::harris3d::Harris3d;
use cgroup::features::iss::Iss;
use cgroup::features::lfsh::Lfsh;
use cgroup::features::matching::{Descriptors, Matching};
use cgroup::features::normals::{Neighborhood, surfaces};
use cgroup::features::rcs::Rcs;
use cgroup::features::shot::Shot;
use cgroup::features::shot_lrf::shot_frames;
use cgroup::features::toldi_lrf::toldi_frames;
use cgroup::geometry::ball_search::BallSearch;
use cgroup::geometry::neighbors::NearestNeighbors;
use cgroup::geometry::resolution::resolution;
use cgroup::{Execution, Points, Result};
use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, criterion_group, criterion_main};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

const POINTS: u32 = 40_000;
const KEYPOINTS: usize = 5_000;
const NORMAL_RADIUS: f64 = 5.0;
const SUPPORT_RADIUS: f64 = 15.0;

struct Scene {
    points: Points,
    normals: Vec<Vector3<f64>>,
    keypoints: Vec<usize>,
}

/// A golden-angle lattice on a star-shaped surface with bumps of three sizes.
fn bumpy_surface() -> Vec<[f64; 3]> {
    let size = (f64::from(POINTS) / (4.0 * PI)).sqrt();
    let place = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(POINTS);
        let angle = f64::from(i) * PI * (1.0 + 5.0_f64.sqrt());
        let flat = (1.0 - z * z).sqrt();
        let d = Vector3::new(flat * angle.cos(), flat * angle.sin(), z);
        let bumps = 0.2 * (3.0 * d.x + d.y).sin() + 0.06 * (9.0 * d.y - 4.0 * d.z).sin();
        let radius = size * (1.1 + bumps + 0.02 * (23.0 * d.z).sin() * (19.0 * d.x).cos());
        [radius * d.x, 0.85 * radius * d.y, 0.7 * radius * d.z]
    };
    (0..POINTS).map(place).collect()
}

fn scene() -> Result<Scene> {
    let points = Points::from_rows("points", &bumpy_surface())?;
    let neighborhood = Neighborhood::Radius(NORMAL_RADIUS);
    let fits = surfaces(&points, neighborhood, Point3::origin(), &Execution::default())?;
    let keypoints = (0..KEYPOINTS).map(|i| i * points.len() / KEYPOINTS).collect();
    Ok(Scene { points, normals: fits.into_iter().map(|fit| fit.normal).collect(), keypoints })
}

fn neighbors(criterion: &mut Criterion) {
    let Ok(Scene { points, .. }) = scene() else { return };
    let rows = points.rows();
    let Ok(kiddo) = ImmutableKdTree::<f64, 3>::new_from_slice(&rows) else { return };
    let execution = Execution::default();
    let mut group = criterion.benchmark_group("neighbors");
    group.sample_size(10);
    let twenty = NonZero::new(20).unwrap_or(NonZero::<usize>::MIN);
    group.bench_function("nearest_20/tree", |b| {
        let tree = NearestNeighbors::new(&points);
        b.iter(|| tree.map_points(19, &execution, |_, found| found.len()));
    });
    group.bench_function("nearest_20/kiddo", |b| {
        let count =
            |row: &[f64; 3]| kiddo.query(row).nearest_n::<SquaredEuclidean<f64>>(twenty).execute().len();
        b.iter(|| rows.par_iter().map(count).sum::<usize>());
    });
    for radius in [NORMAL_RADIUS, SUPPORT_RADIUS] {
        group.bench_function(format!("within_{radius}/grid"), |b| {
            b.iter(|| {
                let search = BallSearch::new(&points, radius)?;
                search.map_points(&execution, |_, ball| ball.len())
            });
        });
        group.bench_function(format!("within_{radius}/kiddo"), |b| {
            let count = |row: &[f64; 3]| {
                kiddo.query(row).within::<SquaredEuclidean<f64>>(radius * radius).unsorted().execute().len()
            };
            b.iter(|| rows.par_iter().map(count).sum::<usize>());
        });
    }
}

fn clouds(criterion: &mut Criterion) {
    let Ok(Scene { points, normals, keypoints }) = scene() else { return };
    let execution = Execution::default();
    let mut group = criterion.benchmark_group("cloud_40000");
    group.sample_size(10);
    group.bench_function("resolution", |b| b.iter(|| resolution(&points, false, &execution)));
    for (name, neighborhood) in
        [("radius_5", Neighborhood::Radius(NORMAL_RADIUS)), ("nearest_20", Neighborhood::Nearest(20))]
    {
        group.bench_function(format!("normals/{name}"), |b| {
            b.iter(|| surfaces(&points, neighborhood, Point3::origin(), &execution));
        });
    }
    group.bench_function("harris3d", |b| {
        b.iter(|| Harris3d::new(NORMAL_RADIUS).detect(&points, None, &execution));
    });
    group.bench_function("iss", |b| b.iter(|| Iss::new(6.0, 4.0).detect(&points, &execution)));
    group.bench_function("shot_lrf/5000", |b| {
        b.iter(|| shot_frames(&points, &keypoints, SUPPORT_RADIUS, &execution));
    });
    group.bench_function("toldi_lrf/5000", |b| {
        b.iter(|| toldi_frames(&points, &keypoints, SUPPORT_RADIUS, &execution));
    });
    group.bench_function("shot/5000", |b| {
        b.iter(|| Shot::new(SUPPORT_RADIUS).describe(&points, &normals, &keypoints, None, &execution));
    });
    group.bench_function("lfsh/5000", |b| {
        b.iter(|| Lfsh { radius: SUPPORT_RADIUS }.describe(&points, &normals, &keypoints, &execution));
    });
    group.bench_function("rcs/5000", |b| {
        b.iter(|| Rcs { radius: SUPPORT_RADIUS }.describe(&points, &keypoints, &execution));
    });
}

/// Descriptors of neighbouring keypoints, as two scans of one surface have them: the crate's blocked
/// products beside a kd-tree, for the lengths of LFSH, RCS and SHOT.
fn matching(criterion: &mut Criterion) {
    let Ok(scene) = scene() else { return };
    let execution = Execution::default();
    let beside: Vec<usize> = scene.keypoints.iter().map(|i| i + 1).collect();
    let Scene { points, normals, keypoints } = &scene;
    let lfsh = |rows: &[usize]| Lfsh { radius: SUPPORT_RADIUS }.describe(points, normals, rows, &execution);
    let rcs = |rows: &[usize]| Rcs { radius: SUPPORT_RADIUS }.describe(points, rows, &execution);
    let shot = |rows: &[usize]| Shot::new(SUPPORT_RADIUS).describe(points, normals, rows, None, &execution);
    let mut group = criterion.benchmark_group("match_5000x5000");
    group.sample_size(10);
    match_both::<30>(&mut group, lfsh(keypoints), lfsh(&beside), &execution);
    match_both::<72>(&mut group, rcs(keypoints), rcs(&beside), &execution);
    match_both::<352>(&mut group, shot(keypoints), shot(&beside), &execution);
}

fn match_both<const LENGTH: usize>(
    group: &mut BenchmarkGroup<'_, WallTime>,
    source: Result<Vec<[f32; LENGTH]>>,
    target: Result<Vec<[f32; LENGTH]>>,
    execution: &Execution,
) {
    let (Ok(source), Ok(target)) = (source, target) else { return };
    let widened = |rows: Vec<[f32; LENGTH]>| rows.iter().map(|row| row.map(f64::from)).collect::<Vec<_>>();
    let (source, target) = (widened(source), widened(target));
    let tables = [&source, &target].map(|rows| Descriptors::new("descriptors", rows.as_flattened(), LENGTH));
    let [Ok(source_table), Ok(target_table)] = tables else { return };
    group.bench_function(format!("products/{LENGTH}"), |b| {
        b.iter(|| black_box(Matching::default().run(&source_table, &target_table, execution)));
    });
    let Ok(tree) = ImmutableKdTree::<f64, LENGTH>::new_from_slice(&target) else { return };
    let two = NonZero::new(2).unwrap_or(NonZero::<usize>::MIN);
    group.bench_function(format!("kiddo/{LENGTH}"), |b| {
        let count =
            |row: &[f64; LENGTH]| tree.query(row).nearest_n::<SquaredEuclidean<f64>>(two).execute().len();
        b.iter(|| source.par_iter().map(count).sum::<usize>());
    });
}

criterion_group!(features, neighbors, clouds, matching);
criterion_main!(features);
