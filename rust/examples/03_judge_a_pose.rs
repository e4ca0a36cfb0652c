//! Score a given pose: overlap of two scans under the pose, and motions that they do not constrain.
#![expect(clippy::print_stdout, reason = "an example shows its result")]

use cgroup::geometry::rigid::Rigid;
use cgroup::verification::{Side, Surface, overlap, score_poses, verify};
use cgroup::{Execution, Points, Result};
use nalgebra::{Rotation3, Vector3};

/// Distance between neighbouring points, in metres.
const SPACING: f64 = 0.1;

fn main() -> Result<()> {
    let execution = Execution::default();
    // For example from odometry: off by 0.18 m and a degree. The correct pose is the identity.
    let pose = Rigid {
        rotation: Rotation3::new(Vector3::z() * 1.0_f64.to_radians()).into_inner(),
        translation: Vector3::new(0.15, 0.1, 0.0),
    };
    for has_end in [true, false] {
        let (source, target) = (corridor(0.0, has_end)?, corridor(0.03, has_end)?);
        let given = score_poses(&source, &target, &[pose], &execution)?[0];
        let refined = &verify(&source, &target, &[pose], None, &execution)?[0];
        let found = overlap(&source, &target, &refined.pose, &execution)?;
        let left = refined.pose.translation;
        println!("{}", if has_end { "A corridor with its end:" } else { "A corridor without an end:" });
        println!("  the surfaces score {given:.2} as given, {:.2} refined", refined.score);
        println!("  {:.0} % of the source lie on the target", 100.0 * found.fitness);
        println!("  {:.3} m of the error are left along it, {:.3} m across", left.x.abs(), left.y.abs());
        // A rotation vector and a translation that the surfaces hardly constrain.
        match found.resistance.open_motion {
            Some(motion) => println!("  open: {:.2}", motion.fixed_rows::<3>(3).normalize().transpose()),
            None => println!("  every motion is resisted"),
        }
        assert_eq!(found.resistance.open_motion.is_none(), has_end);
    }
    Ok(())
}

/// Floor and walls of a corridor of 10 by 2 by 2.5 m, as points with normals, and its end if it is visible.
fn corridor(shift: f64, has_end: bool) -> Result<Surface> {
    let steps =
        |length: f64| (0..).map(move |i| f64::from(i) * SPACING + shift).take_while(move |&at| at < length);
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    for x in steps(10.0) {
        points.extend(steps(2.0).map(|y| [x, y, 0.0]));
        normals.resize(points.len(), Vector3::z());
        for (y, normal) in [(0.0, Vector3::y()), (2.0, -Vector3::y())] {
            points.extend(steps(2.5).map(|z| [x, y, z]));
            normals.resize(points.len(), normal);
        }
    }
    if has_end {
        points.extend(steps(2.0).flat_map(|y| steps(2.5).map(move |z| [10.0, y, z])));
        normals.resize(points.len(), -Vector3::x());
    }
    // The unit is 0.4 of the distance between points.
    let points = Points::from_rows("corridor", &points)?;
    Surface::new(&points, &normals, 0.4 * SPACING, Side::Known, &Execution::default())
}
