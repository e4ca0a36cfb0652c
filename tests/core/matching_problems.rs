//! The generator of matching problems has the stated distribution; `test_generated.py` asserts the same of
//! Python's.

use crate::common::{Problem, problem};
use cgroup::correspondences::Frame;

const N: usize = 20_000;

/// Mean distance of the surface's points from the origin, over 400,000 drawn in Python.
const SURFACE_RADIUS: f64 = 102.61;

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

fn mean_of(values: &[f64], problem: &Problem, of_inliers: bool) -> f64 {
    let chosen = values.iter().zip(&problem.inliers).filter(|&(_, inlier)| *inlier == of_inliers);
    mean(chosen.map(|(value, _)| *value))
}

fn assert_near(value: f64, expected: f64, tolerance: f64) {
    assert!((value - expected).abs() < tolerance, "{value} is not near {expected}");
}

#[test]
fn means_of_the_distribution() {
    let drawn = problem(1, N, 0.4, 0.5);
    assert_eq!(drawn.inliers.iter().filter(|&&inlier| inlier).count(), 8_000);
    // A beta distribution's mean is a / (a + b).
    assert_near(mean_of(&drawn.ratio, &drawn, true), 4.0 / 5.8, 0.01);
    assert_near(mean_of(&drawn.ratio, &drawn, false), 9.0 / 10.2, 0.01);
    assert_near(mean_of(&drawn.similarity, &drawn, true), 5.0 / 7.0, 0.01);
    assert_near(mean_of(&drawn.similarity, &drawn, false), 4.0 / 7.0, 0.01);
    let few = problem(1, N, 0.05, 0.5);
    assert_near(mean_of(&few.ratio, &few, true), 6.0 / 7.4, 0.02);
    assert_near(mean(drawn.source.iter().map(nalgebra::Matrix::norm)), SURFACE_RADIUS, 0.5);
}

#[test]
fn the_motion_explains_the_inliers_and_no_outlier() {
    let drawn = problem(2, N, 0.4, 0.5);
    let first = drawn.inliers.iter().position(|&inlier| inlier).unwrap_or_default();
    let frame = |frames: &[Frame]| frames[first].unwrap_or_default();
    let rotation = frame(&drawn.target_frames).transpose() * frame(&drawn.source_frames);
    let offsets: Vec<_> = drawn.source.iter().zip(&drawn.target).map(|(p, q)| q - rotation * p).collect();
    let of_inliers =
        || offsets.iter().zip(&drawn.inliers).filter(|&(_, inlier)| *inlier).map(|(offset, _)| *offset);
    let shift = of_inliers().sum::<nalgebra::Vector3<f64>>() / of_inliers().count() as f64;
    let variance = mean(of_inliers().map(|offset| (offset - shift).norm_squared() / 3.0));
    assert_near(variance.sqrt(), 0.5, 0.01);
    for (offset, &inlier) in offsets.iter().zip(&drawn.inliers) {
        assert_eq!((offset - shift).norm() <= 4.9, inlier);
    }
}
