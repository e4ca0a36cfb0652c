//! Register two scans: voxels, normals, descriptors, matches, a group of them, and its poses verified on the
//! surfaces.
#![expect(clippy::print_stdout, reason = "an example shows its result")]

use std::f64::consts::PI;

use cgroup::features::fpfh::{self, Convention, Fpfh};
use cgroup::features::matching::{Descriptors, Match, Matching};
use cgroup::features::normals::{Neighborhood, surfaces};
use cgroup::features::voxels::voxel_downsample;
use cgroup::geometry::rigid::Rigid;
use cgroup::grouping::likelihood_consensus::LikelihoodConsensus;
use cgroup::verification::{Side, Surface, overlap, verify};
use cgroup::{Cloud, Correspondences, Execution, GroupingMethod, Points, Result};
use nalgebra::{Isometry3, Point3, Vector3};

const VOXEL: f64 = 2.0;
/// Unit of the surfaces that score poses, and of the matches.
const UNIT: f64 = 0.4 * VOXEL;

/// A downsampled scan with its features.
struct Prepared {
    points: Vec<[f64; 3]>,
    descriptors: Descriptors,
    surface: Surface,
}

/// Prepares a scan with the scanner at the origin.
fn prepare(scan: &[[f64; 3]], execution: &Execution) -> Result<Prepared> {
    let points = voxel_downsample(&Points::from_rows("scan", scan)?, None, VOXEL, execution)?.points;
    let cloud = Cloud::from_rows("voxels", &points)?;
    let planes = surfaces(&cloud, Neighborhood::NearestWithin(30, 2.0 * VOXEL), Point3::origin(), execution)?;
    let normals: Vec<_> = planes.iter().map(|plane| plane.normal).collect();
    let fpfh = Fpfh { radius: 5.0 * VOXEL, max_neighbors: Some(100), convention: Convention::Open3d };
    let rows = fpfh.describe(&cloud, &normals, None, execution)?;
    Ok(Prepared {
        descriptors: Descriptors::new("scan", rows.as_flattened(), fpfh::LENGTH)?,
        surface: Surface::new(cloud.points(), &normals, UNIT, Side::Viewpoint([0.0; 3]), execution)?,
        points,
    })
}

fn main() -> Result<()> {
    // Two scans of a stone, each in its scanner's own frame. `cgroup::cloud_formats` reads files.
    let scanners = [scanner(0.0), scanner(50.0)];
    let truth = scanners[1].inverse() * scanners[0];
    let execution = Execution::default();
    let source = prepare(&scan(&scanners[0]), &execution)?;
    let target = prepare(&scan(&scanners[1]), &execution)?;

    let matching = Matching { mutual: true, ..Matching::default() };
    let matches = matching.run(&source.descriptors, &target.descriptors, &execution)?;
    let points_of = |found: &Match| (source.points[found.source], target.points[found.target]);
    let (from, to): (Vec<_>, Vec<_>) = matches.iter().map(points_of).unzip();
    let correspondences = Correspondences::new(&from, &to)?
        .with_ratio(matches.iter().map(Match::ratio).collect())?
        .with_resolution(UNIT)?;
    let group = LikelihoodConsensus::default().group(&correspondences, &execution)?;
    println!("{} of {} matches are kept", group.size(), matches.len());

    // The group's pose and its rivals, refined on the surfaces; best first.
    let poses: Vec<_> = group
        .alternatives
        .unwrap_or_default()
        .iter()
        .map(|pose| Rigid {
            rotation: pose.model.fixed_view::<3, 3>(0, 0).into(),
            translation: pose.model.fixed_view::<3, 1>(0, 3).into(),
        })
        .collect();
    let verified = verify(&source.surface, &target.surface, &poses, None, &execution)?;
    let best = &verified[0];
    let found = overlap(&source.surface, &target.surface, &best.pose, &execution)?;
    println!("{:.0} % of the source lie on the target, {:.3} off", 100.0 * found.fitness, found.inlier_rmse);
    println!("source to target:{:.2}", best.pose.to_matrix());
    assert!((best.pose.to_matrix() - truth.to_homogeneous()).amax() < 0.5);
    Ok(())
}

/// A scanner at a distance of 300, facing the origin, at an angle around it.
fn scanner(degrees: f64) -> Isometry3<f64> {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let eye = Point3::new(300.0 * cos, 300.0 * sin, 60.0);
    Isometry3::face_towards(&eye, &Point3::origin(), &Vector3::z())
}

/// Scan of a bumpy stone of radius 40, in the scanner's frame.
fn scan(scanner: &Isometry3<f64>) -> Vec<[f64; 3]> {
    let count = 40_000;
    let place = |i: i32| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let around = f64::from(i) * PI * (1.0 + 5.0_f64.sqrt());
        let flat = (1.0 - z * z).sqrt();
        Vector3::new(flat * around.cos(), flat * around.sin(), z)
    };
    let stone = |d: Vector3<f64>| {
        let bumps = 0.12 * (5.0 * d.x + 1.0).sin() * (4.0 * d.y).cos() + 0.1 * (7.0 * d.z + 3.0 * d.x).sin();
        (d, Point3::from(d.component_mul(&Vector3::new(1.3, 0.9, 0.7)) * 40.0 * (1.0 + bumps)))
    };
    let eye = scanner.translation.vector;
    let faces = |(d, p): &(Vector3<f64>, Point3<f64>)| d.dot(&(eye - p.coords)) > 0.0;
    let own = |(_, p)| scanner.inverse_transform_point(&p).into();
    (0..count).map(place).map(stone).filter(faces).map(own).collect()
}
