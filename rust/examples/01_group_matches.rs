//! Group matches: select the 50 correct ones among 1,000 pairs of points, and estimate the pose.
#![expect(clippy::print_stdout, reason = "an example shows its result")]

use cgroup::grouping::likelihood_consensus::LikelihoodConsensus;
use cgroup::{Correspondences, Execution, GroupingMethod, Result};
use nalgebra::{Rotation3, Vector3};

fn main() -> Result<()> {
    // Row i of `source` matches row i of `target`, as from a matcher. Here the matches are random, and the
    // first 50 follow one motion.
    let mut state = 1_u64;
    let mut number = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let rotation = Rotation3::from_euler_angles(0.3, -0.8, 2.1);
    let translation = Vector3::new(4.0, -2.0, 7.0);
    let (mut source, mut target) = (Vec::new(), Vec::new());
    for i in 0..1000 {
        let [p, elsewhere, noise] = [50.0, 50.0, 0.5].map(|size| Vector3::from_fn(|_, _| number() * size));
        source.push(p.into());
        target.push(if i < 50 { (rotation * p + translation + noise).into() } else { elsewhere.into() });
    }

    // Noise in the unit of the points: the distance between the points of two correct matches changes by
    // less.
    let method = LikelihoodConsensus { tolerance: Some(1.5), ..LikelihoodConsensus::default() };
    let group = method.group(&Correspondences::new(&source, &target)?, &Execution::default())?;

    println!("{} of {} matches are kept", group.size(), source.len());
    println!("groups as good by chance: {:.1e}", group.false_alarms.unwrap_or(f64::NAN));
    if let (Some(true), Some(pose)) = (group.ok, group.model) {
        println!("source to target:{pose:.2}");
    }
    assert!(group.mask[..50].iter().all(|&kept| kept));
    Ok(())
}
