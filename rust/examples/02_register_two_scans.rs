//! Register two scans: the pose with its probability, or none.
#![expect(clippy::print_stdout, reason = "an example shows its result")]

use std::f64::consts::PI;
use std::sync::Arc;

use cgroup::registration::{Options, Outcome, Prepared, Suited, register, suit_voxel};
use cgroup::{Cloud, Execution, Result};
use nalgebra::{Isometry3, Point3, Vector3};

fn main() -> Result<()> {
    // Two scans of a stone, each in its scanner's own frame. `cgroup::cloud_formats` reads files.
    let scanners = [scanner(0.0), scanner(50.0)];
    let truth = scanners[1].inverse() * scanners[0];
    let execution = Execution::default();
    let source = Arc::new(Cloud::from_rows("source", &scan(&scanners[0]))?);
    let target = Arc::new(Cloud::from_rows("target", &scan(&scanners[1]))?);
    let Suited::Voxel(voxel) = suit_voxel(&[&source, &target], &execution)? else {
        println!("the clouds differ too much in size");
        return Ok(());
    };

    // Prepare a scan once, and register it with any number of others.
    let source = Prepared::of(source, voxel, Some([0.0; 3]))?;
    let target = Prepared::of(target, voxel, Some([0.0; 3]))?;
    let Outcome::Found(done) = register(&source, &target, &Options::default(), &execution)? else {
        println!("no pose can be proposed");
        return Ok(());
    };
    let found = &done.found;
    println!("right with a probability of {:.2}", found.probability);
    println!("{:.0} % of the source overlap the target", 100.0 * found.fitness);
    println!("source to target:{:.2}", found.refined.pose.to_matrix());
    assert!(found.probability > 0.9);
    assert!((found.refined.pose.to_matrix() - truth.to_homogeneous()).amax() < 0.5);
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
