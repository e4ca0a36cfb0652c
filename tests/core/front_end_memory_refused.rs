//! No refused block of memory ends the process: every step of the front end and of verification returns an
//! error, or its undisturbed result.

use std::f64::consts::PI;

use crate::refusing_allocator::refuse_each_block;
use cgroup::features::fpfh::{Convention, Fpfh};
use cgroup::features::harris3d::{Harris3d, Response};
use cgroup::features::iss::Iss;
use cgroup::features::keypoints::drop_isolated;
use cgroup::features::lfsh::Lfsh;
use cgroup::features::matching::{Descriptors, Matching};
use cgroup::features::mesh_normals::mesh_normals;
use cgroup::features::normals::{Neighborhood, surfaces};
use cgroup::features::rcs::Rcs;
use cgroup::features::shot::Shot;
use cgroup::features::shot_lrf::shot_frames;
use cgroup::features::toldi_lrf::toldi_frames;
use cgroup::features::voxels::{choose_voxel, count_voxels, voxel_downsample};
use cgroup::frames::IntoFrames;
use cgroup::geometry::nearest_sets::NearestSets;
use cgroup::geometry::placements::{MapGrid, Outline, Window, best_placements};
use cgroup::geometry::proximity::{any_within, nearest_offsets};
use cgroup::geometry::rigid::{Rigid, fit_group, fit_rows};
use cgroup::verification::{
    Evidence, FineSurface, Side, Surface, align, overlap, places, score_poses, verify,
};
use cgroup::{Cloud, Execution, Points, Result, memory};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

const POINTS: u32 = 3_000;
const RADIUS: f64 = 4.0;

/// A golden-angle lattice on a sphere with bumps, about 1 apart, and its outward directions.
fn rows() -> (Vec<[f64; 3]>, Vec<Vector3<f64>>) {
    let size = (f64::from(POINTS) / (4.0 * PI)).sqrt();
    let place = |i: u32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(POINTS);
        let angle = f64::from(i) * PI * (1.0 + 5.0_f64.sqrt());
        let flat = (1.0 - z * z).sqrt();
        let d = Vector3::new(flat * angle.cos(), flat * angle.sin(), z);
        let radius = size * (1.0 + 0.1 * (5.0 * d.x + d.y).sin() + 0.05 * (11.0 * d.z).sin());
        (<[f64; 3]>::from(d * radius), d)
    };
    (0..POINTS).map(place).unzip()
}

struct Scene {
    rows: Vec<[f64; 3]>,
    cloud: Cloud,
    normals: Vec<Vector3<f64>>,
    keypoints: Vec<usize>,
    execution: Execution,
}

impl Scene {
    fn new() -> Result<Self> {
        let (rows, normals) = rows();
        let cloud = Cloud::from_rows("points", &rows)?;
        Ok(Self {
            rows,
            cloud,
            normals,
            keypoints: (0..400).map(|i| 7 * i).collect(),
            execution: Execution::default(),
        })
    }

    /// A cloud without cached searches.
    fn fresh(&self) -> Result<Cloud> {
        Ok(Cloud::new(self.cloud.points().copied()?))
    }
}

/// Poses from the correct one, the identity, to distant ones.
fn poses() -> Vec<Rigid> {
    let pose = |i: u32| {
        let turn = Vector3::new(0.1, -0.2, 0.05) * (0.1 * f64::from(i));
        let rotation = Rotation3::new(turn).into_inner();
        Rigid { rotation, translation: Vector3::new(0.2, 0.1, -0.1) * f64::from(i) }
    };
    (0..200).map(pose).collect()
}

/// Refuses the blocks of a step, on one thread and on two; the test fails if the step requests none.
fn refuse<T: PartialEq + Send>(name: &str, step: impl Fn() -> Result<T> + Sync) -> Result<()> {
    assert!(refuse_each_block(name, 1, &step)? > 0, "{name} asked for no block: the test is void");
    refuse_each_block(name, 2, &step).map(drop)
}

#[test]
fn points_and_clouds() -> Result<()> {
    let scene = Scene::new()?;
    let points = scene.cloud.points();
    refuse("points", || Points::from_rows("points", &scene.rows))?;
    refuse("copied points", || points.copied())?;
    refuse("mirrored points", || points.mirrored())?;
    refuse("scaled points", || points.scaled(2.0))?;
    refuse("a subset", || points.subset(&scene.keypoints))?;
    refuse("resolution", || scene.fresh()?.resolution(false, &scene.execution))?;
    let frames = vec![Some(Matrix3::identity()); 400];
    refuse("frames", || memory::copied(&frames)?.into_frames())?;
    refuse("a fit", || fit_group(points, points, &scene.keypoints))?;
    refuse("a fit of rows", || fit_rows(points, points, scene.keypoints.iter().copied()))?;
    refuse("proximity", || any_within(&scene.rows, &scene.rows[..900], RADIUS, &scene.execution))?;
    refuse("the nearest", || nearest_offsets(&scene.rows, &scene.rows[..900], RADIUS, &scene.execution))?;
    let (map, walls) = ([1; 600], [[1.5, 2.5], [3.5, -1.5]]);
    let outline = Outline { walls: &walls, floor: &walls, floor_weight: 0.7 };
    let windows = [Window { turn: 0, rows: 0..20, columns: 0..30 }];
    refuse("placements", || {
        let map = MapGrid { cells: &map, width: 30 };
        best_placements(map, outline, &[[1.0, 0.0]], &windows, 9, &scene.execution)
    })?;
    let keep = vec![true; points.len()];
    refuse("nearest sets", || {
        NearestSets::new(points, &scene.execution)?
            .map(300, &keep, &scene.execution, |_, members| members.len())
    })
}

#[test]
fn normals_and_voxels() -> Result<()> {
    let scene = Scene::new()?;
    let points = scene.cloud.points();
    for neighborhood in [
        Neighborhood::Nearest(150),
        Neighborhood::Radius(RADIUS),
        Neighborhood::NearestWithin(10, 3.0 * RADIUS),
    ] {
        refuse(&format!("normals of {neighborhood:?}"), || {
            surfaces(&scene.fresh()?, neighborhood, Point3::origin(), &scene.execution)
        })?;
    }
    let faces: Vec<[usize; 3]> = (0..3000).map(|i| [i, (i + 1) % 3000, (7 * i + 2) % 3000]).collect();
    refuse("mesh normals", || {
        mesh_normals(points, &faces, &scene.execution)
            .map(|normals| normals.iter().filter(|n| n.x > 0.0).count())
    })?;
    for size in [1e-4, 2.0] {
        refuse(&format!("voxels of {size}"), || {
            voxel_downsample(points, Some(&scene.normals), size, &scene.execution)
        })?;
        refuse_each_block("number of voxels", 1, || count_voxels(points, size))?;
    }
    refuse_each_block("choice of a voxel", 1, || choose_voxel(&[points, points], 300, &scene.execution))
        .map(drop)
}

#[test]
fn keypoints_and_frames() -> Result<()> {
    let scene = Scene::new()?;
    let iss = Iss::new(RADIUS, RADIUS);
    let harris = Harris3d::new(RADIUS);
    refuse("iss", || iss.detect(&scene.fresh()?, &scene.execution))?;
    refuse("iss, weighted", || {
        Iss { density_weight: true, count: Some(30), ..iss }.detect(&scene.fresh()?, &scene.execution)
    })?;
    refuse("harris3d", || harris.detect(&scene.fresh()?, None, &scene.execution))?;
    refuse("harris3d, normals", || {
        Harris3d { count: Some(30), ..harris }.detect(&scene.fresh()?, Some(&scene.normals), &scene.execution)
    })?;
    refuse("harris3d, curvature", || {
        Harris3d { response: Response::Curvature, ..harris }.detect(&scene.fresh()?, None, &scene.execution)
    })?;
    refuse("drop_isolated", || {
        drop_isolated(&scene.fresh()?, &scene.keypoints, RADIUS, 20, &scene.execution)
    })?;
    refuse("shot_lrf", || shot_frames(&scene.fresh()?, &scene.keypoints, 3.0 * RADIUS, &scene.execution))?;
    refuse("toldi_lrf", || toldi_frames(&scene.fresh()?, &scene.keypoints, 3.0 * RADIUS, &scene.execution))
}

#[test]
fn descriptors() -> Result<()> {
    let scene = Scene::new()?;
    let Scene { normals, keypoints, execution, .. } = &scene;
    refuse("shot", || {
        Shot::new(3.0 * RADIUS).describe(&scene.fresh()?, normals, keypoints, None, execution)
    })?;
    refuse("lfsh", || Lfsh { radius: RADIUS }.describe(&scene.fresh()?, normals, keypoints, execution))?;
    refuse("rcs", || Rcs { radius: 3.0 * RADIUS }.describe(&scene.fresh()?, keypoints, execution))?;
    for (name, some) in [("fpfh of all", None), ("fpfh of some", Some(keypoints.as_slice()))] {
        let fpfh = Fpfh { radius: RADIUS, max_neighbors: Some(30), convention: Convention::Open3d };
        refuse(name, || fpfh.describe(&scene.fresh()?, normals, some, execution))?;
    }
    Ok(())
}

#[test]
fn matches() -> Result<()> {
    let execution = Execution::default();
    let table = |rows: u32, step: f64| -> Vec<f64> {
        (0..33 * rows).map(|i| (step * f64::from(i % 1000) + f64::from(i / 3300)).sin()).collect()
    };
    // Repeated rows, for which single precision does not determine the nearest.
    let (a, b) = (table(300, 1.1), table(1200, 1.3));
    refuse("tables", || Descriptors::new("source", &a, 33).map(|table| table.len()))?;
    let (source, target) = (Descriptors::new("source", &a, 33)?, Descriptors::new("target", &b, 33)?);
    for (name, matching) in [
        ("match", Matching::default()),
        ("match, mutual", Matching { mutual: true, ..Matching::default() }),
        ("match, many", Matching { k: 300, max_distance: Some(6.0), ..Matching::default() }),
    ] {
        // On one thread: the matrix product allocates memory of its own on every thread's first use.
        refuse_each_block(name, 1, || matching.run(&source, &target, &execution))?;
    }
    Ok(())
}

#[test]
fn surfaces_of_verification() -> Result<()> {
    let scene = Scene::new()?;
    let (points, normals, execution) = (scene.cloud.points(), &scene.normals, &scene.execution);
    for side in [Side::Unknown, Side::Known, Side::Viewpoint([0.0, 0.0, 90.0])] {
        refuse(&format!("surface, {side:?}"), || {
            Surface::new(points, normals, 0.4, side, execution).map(|surface| surface.len())
        })?;
    }
    refuse("fine surface", || FineSurface::new(points, 1.0, execution).map(|surface| surface.len()))?;
    let fine = FineSurface::new(points, 1.0, execution)?;
    let away = Rigid { rotation: Matrix3::identity(), translation: Vector3::new(0.3, 0.2, -0.1) };
    refuse("align", || align(&fine, &fine, &away, usize::MAX, execution).map(|found| found.residuals))
}

#[test]
fn poses_on_surfaces() -> Result<()> {
    let scene = Scene::new()?;
    let (points, normals, execution) = (scene.cloud.points(), &scene.normals, &scene.execution);
    let side = Side::Viewpoint([0.0, 0.0, 90.0]);
    let fresh = || Surface::new(points, normals, 0.4, side, execution);
    let poses = poses();
    let evidence = Evidence { source: points.copied()?, target: points.copied()?, tolerance: 1.0 };
    refuse("score_poses", || {
        let surface = fresh()?;
        score_poses(&surface, &surface, &poses, execution)
    })?;
    refuse("verify", || {
        let surface = fresh()?;
        let found = verify(&surface, &surface, &poses, Some(&evidence), execution)?;
        memory::collect(found.iter().map(|found| (found.pose, found.score, found.evidence)))
    })?;
    refuse("places", || {
        let surface = fresh()?;
        places(&surface, &surface, &poses[3], execution)
    })?;
    refuse("overlap", || {
        let surface = fresh()?;
        overlap(&surface, &surface, &poses[3], execution)
            .map(|found| (found.fitness, found.resistance.information))
    })
}
