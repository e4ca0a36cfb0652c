//! The front end on a bumpy closed surface of 40,000 points, unit = resolution.
//!
//! `neighbors/*` compare the crate's own searches with kiddo. Radii are those of the PCL timings.

use std::f64::consts::PI;
use std::hint::black_box;
use std::num::NonZero;

use cgroup::features::fpfh::{Convention, Fpfh};
use cgroup::features::harris3d::Harris3d;
use cgroup::features::iss::Iss;
use cgroup::features::keypoints::drop_isolated;
use cgroup::features::lfsh::Lfsh;
use cgroup::features::matching::{Descriptors, Matching};
use cgroup::features::normals::{Neighborhood, surfaces};
use cgroup::features::rcs::Rcs;
use cgroup::features::shot::Shot;
use cgroup::features::shot_lrf::shot_frames;
use cgroup::features::toldi_lrf::toldi_frames;
use cgroup::features::voxels::{choose_voxel, voxel_downsample};
use cgroup::geometry::ball_search::BallSearch;
use cgroup::geometry::nearest_sets::NearestSets;
use cgroup::geometry::neighbors::{NearestNeighbors, Neighbor};
use cgroup::{Cloud, Execution, Points, Result};
use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, criterion_group, criterion_main};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

const POINTS: u32 = 40_000;
const KEYPOINTS: usize = 5_000;
const DETECTOR_RADIUS: f64 = 2.7;
const NORMAL_RADIUS: f64 = 5.0;
const SUPPORT_RADIUS: f64 = 15.0;

type Tree = ImmutableKdTree<f64, 3>;

struct Scene {
    cloud: Cloud,
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
    let cloud = Cloud::from_rows("points", &bumpy_surface())?;
    let neighborhood = Neighborhood::Radius(NORMAL_RADIUS);
    let fits = surfaces(&cloud, neighborhood, Point3::origin(), &Execution::default())?;
    let keypoints = (0..KEYPOINTS).map(|i| i * cloud.points().len() / KEYPOINTS).collect();
    Ok(Scene { cloud, normals: fits.into_iter().map(|fit| fit.normal).collect(), keypoints })
}

/// kiddo's tree over the points, and the rows in its order, so that its queries also share the cache.
fn kiddo_tree(points: &Points) -> Option<(Tree, Vec<[f64; 3]>)> {
    let rows: Vec<_> = points.rows().collect();
    let tree = Tree::new_from_slice(&rows).ok()?;
    let order: Vec<u32> = tree.iter().map(|(index, _)| index).collect();
    Some((tree, order.iter().map(|&index| rows[index as usize]).collect()))
}

/// Every search of the crate compared with kiddo: construction, and the queries of the front end and of SI.
fn neighbors(criterion: &mut Criterion) {
    let Ok(Scene { cloud, .. }) = scene() else { return };
    let mut group = criterion.benchmark_group("neighbors");
    group.sample_size(10);
    build(&mut group, cloud.points());
    nearest(&mut group, cloud.points());
    within(&mut group, cloud.points());
    nearest_sets(&mut group);
}

fn build(group: &mut BenchmarkGroup<'_, WallTime>, points: &Points) {
    let execution = Execution::default();
    group.bench_function("build/kiddo", |b| {
        b.iter(|| Tree::new_from_slice(&points.rows().collect::<Vec<_>>()));
    });
    group.bench_function("build/tree", |b| b.iter(|| NearestNeighbors::new(points, &execution)));
    for radius in [DETECTOR_RADIUS, SUPPORT_RADIUS] {
        group.bench_function(format!("build/grid_{radius}"), |b| b.iter(|| BallSearch::new(points, radius)));
    }
    group.bench_function("build/sets", |b| b.iter(|| NearestSets::new(points, &execution)));
}

/// One nearest other point, as for the resolution, and 19 of them, as for normals. kiddo also finds the point
/// itself.
fn nearest(group: &mut BenchmarkGroup<'_, WallTime>, points: &Points) {
    let execution = Execution::default();
    let Ok(tree) = NearestNeighbors::new(points, &execution) else { return };
    let Some((kiddo, rows)) = kiddo_tree(points) else { return };
    for others in [1, 19] {
        group.bench_function(format!("nearest_{others}/tree"), |b| {
            let sum =
                |found: &[Neighbor]| found.iter().map(|neighbor| neighbor.squared_distance).sum::<f64>();
            b.iter(|| tree.map_points(others, &execution, |_, found| sum(found)));
        });
        let Some(count) = NonZero::new(others + 1) else { return };
        group.bench_function(format!("nearest_{others}/kiddo"), |b| {
            b.iter(|| {
                let query = |row: &[f64; 3]| {
                    let found = kiddo.query(row).nearest_n::<SquaredEuclidean<f64>>(count).execute();
                    found.iter().map(|neighbor| neighbor.distance).sum::<f64>()
                };
                rows.par_chunks(256).flat_map_iter(|rows| rows.iter().map(query)).collect::<Vec<_>>()
            });
        });
    }
}

/// All points of a ball with their offsets and distances.
fn within(group: &mut BenchmarkGroup<'_, WallTime>, points: &Points) {
    let execution = Execution::default();
    let Some((kiddo, rows)) = kiddo_tree(points) else { return };
    let coordinates: Vec<_> = points.rows().collect();
    for radius in [DETECTOR_RADIUS, NORMAL_RADIUS, SUPPORT_RADIUS] {
        let Ok(search) = BallSearch::new(points, radius) else { return };
        group.bench_function(format!("within_{radius}/grid"), |b| {
            b.iter(|| search.map_points(&execution, |_, ball| ball.len()));
        });
        group.bench_function(format!("within_{radius}/kiddo"), |b| {
            let query = |ball: &mut Vec<([f64; 3], f64, u32)>, row: &[f64; 3]| {
                ball.clear();
                let all = kiddo.query(row).within::<SquaredEuclidean<f64>>(radius * radius).unsorted();
                all.exclusive_boundaries().visit(|found| {
                    let other = coordinates[found.item as usize];
                    let offset = [0, 1, 2].map(|k| other[k] - row[k]);
                    ball.push((offset, found.distance, found.item));
                });
                ball.len()
            };
            b.iter(|| rows.par_iter().with_min_len(128).map_init(Vec::new, query).collect::<Vec<_>>());
        });
    }
}

/// The 250 nearest of each of 5,000 scattered points, as for SI.
fn nearest_sets(group: &mut BenchmarkGroup<'_, WallTime>) {
    let scattered = |i: u32| [1.1, 2.3, 3.7].map(|f| (f64::from(i) * f).sin());
    let rows: Vec<[f64; 3]> = (0..5_000).map(scattered).collect();
    let Ok(points) = Points::from_rows("points", &rows) else { return };
    let (keep, execution) = (vec![true; rows.len()], Execution::default());
    group.bench_function("nearest_250_of_5000/sets", |b| {
        b.iter(|| {
            NearestSets::new(&points, &execution)?.map(250, &keep, &execution, |_, members| members.len())
        });
    });
    let count = NonZero::new(251).unwrap_or(NonZero::<usize>::MIN);
    group.bench_function("nearest_250_of_5000/kiddo", |b| {
        b.iter(|| {
            let Some((kiddo, rows)) = kiddo_tree(&points) else { return Vec::new() };
            let query =
                |row: &[f64; 3]| kiddo.query(row).nearest_n::<SquaredEuclidean<f64>>(count).execute().len();
            rows.par_iter().with_min_len(64).map(query).collect::<Vec<_>>()
        });
    });
}

/// Each step alone, on a new cloud; and a whole front end on one cloud.
fn clouds(criterion: &mut Criterion) {
    let Ok(Scene { cloud, normals, keypoints }) = scene() else { return };
    let fresh = || Cloud::new(cloud.points().clone());
    let execution = Execution::default();
    let mut group = criterion.benchmark_group("cloud_40000");
    group.sample_size(10);
    group.bench_function("resolution", |b| b.iter(|| fresh().resolution(false, &execution)));
    for (name, neighborhood) in [
        ("radius_5", Neighborhood::Radius(NORMAL_RADIUS)),
        ("nearest_20", Neighborhood::Nearest(20)),
        ("hybrid_2_30", Neighborhood::NearestWithin(30, 2.0)),
    ] {
        group.bench_function(format!("normals/{name}"), |b| {
            b.iter(|| surfaces(&fresh(), neighborhood, Point3::origin(), &execution));
        });
    }
    group.bench_function("harris3d", |b| {
        b.iter(|| Harris3d::new(NORMAL_RADIUS).detect(&fresh(), None, &execution));
    });
    group.bench_function("harris3d/about_500", |b| {
        let detector = Harris3d { count: Some(500), ..Harris3d::new(NORMAL_RADIUS) };
        b.iter(|| detector.detect(&fresh(), None, &execution));
    });
    group.bench_function("iss", |b| b.iter(|| Iss::new(6.0, 4.0).detect(&fresh(), &execution)));
    group.bench_function("shot_lrf/5000", |b| {
        b.iter(|| shot_frames(&fresh(), &keypoints, SUPPORT_RADIUS, &execution));
    });
    group.bench_function("toldi_lrf/5000", |b| {
        b.iter(|| toldi_frames(&fresh(), &keypoints, SUPPORT_RADIUS, &execution));
    });
    group.bench_function("shot/5000", |b| {
        b.iter(|| Shot::new(SUPPORT_RADIUS).describe(&fresh(), &normals, &keypoints, None, &execution));
    });
    group.bench_function("lfsh/5000", |b| {
        b.iter(|| Lfsh { radius: SUPPORT_RADIUS }.describe(&fresh(), &normals, &keypoints, &execution));
    });
    group.bench_function("rcs/5000", |b| {
        b.iter(|| Rcs { radius: SUPPORT_RADIUS }.describe(&fresh(), &keypoints, &execution));
    });
    let fpfh = Fpfh { radius: NORMAL_RADIUS, max_neighbors: Some(100), convention: Convention::Open3d };
    group.bench_function("fpfh/40000", |b| b.iter(|| fpfh.describe(&fresh(), &normals, None, &execution)));
    group.bench_function("voxels/2", |b| b.iter(|| voxel_downsample(cloud.points(), None, 2.0, &execution)));
    group.bench_function("voxels/choose_5000", |b| {
        b.iter(|| choose_voxel(&[cloud.points()], 5000, &execution));
    });
    group.bench_function("front_end", |b| b.iter(|| front_end(&fresh(), &execution)));
}

/// Resolution, normals, Harris 3D keypoints and their SHOT descriptors, all of one cloud.
fn front_end(cloud: &Cloud, execution: &Execution) -> Result<usize> {
    let pr = cloud.resolution(false, execution)?;
    let fits = surfaces(cloud, Neighborhood::Nearest(20), Point3::origin(), execution)?;
    let normals: Vec<_> = fits.into_iter().map(|fit| fit.normal).collect();
    let found = Harris3d::new(DETECTOR_RADIUS * pr).detect(cloud, None, execution)?;
    let kept = drop_isolated(cloud, &found, SUPPORT_RADIUS * pr, 10, execution)?;
    let frames = shot_frames(cloud, &kept, SUPPORT_RADIUS * pr, execution)?;
    let shot = Shot::new(SUPPORT_RADIUS * pr);
    Ok(shot.describe(cloud, &normals, &kept, Some(&frames), execution)?.len())
}

/// Descriptors of neighbouring keypoints, as in two scans of one surface: the crate's blocked products
/// compared with a kd-tree, for the lengths of LFSH, RCS and SHOT.
fn matching(criterion: &mut Criterion) {
    let Ok(scene) = scene() else { return };
    let execution = Execution::default();
    let beside: Vec<usize> = scene.keypoints.iter().map(|i| i + 1).collect();
    let Scene { cloud, normals, keypoints } = &scene;
    let lfsh = |rows: &[usize]| Lfsh { radius: SUPPORT_RADIUS }.describe(cloud, normals, rows, &execution);
    let rcs = |rows: &[usize]| Rcs { radius: SUPPORT_RADIUS }.describe(cloud, rows, &execution);
    let shot = |rows: &[usize]| Shot::new(SUPPORT_RADIUS).describe(cloud, normals, rows, None, &execution);
    let mut group = criterion.benchmark_group("match_5000x5000");
    group.sample_size(10);
    let fpfh = |rows: &[usize]| {
        let whole = Fpfh { radius: NORMAL_RADIUS, max_neighbors: Some(100), convention: Convention::Open3d };
        whole.describe(cloud, normals, Some(rows), &execution)
    };
    match_both::<33>(&mut group, fpfh(keypoints), fpfh(&beside), &execution);
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
