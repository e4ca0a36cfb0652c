//! Matching problems with a known answer, for the tests of the public interface and the benches.
//!
//! The same distribution as `cgroup.datasets.make_problem` in Python, with `repeated_targets`,
//! `random_frames` and `frame_error` 0; `tests/core/matching_problems.rs` and `test_generated.py` check both
//! against the same means.
#![allow(dead_code, reason = "each test file uses its own part")]

use cgroup::consensus::counter_rng::random_words;
use cgroup::correspondences::Frame;
use cgroup::grouping::BoxedMethod;
use cgroup::grouping::ransac::Ransac;
use cgroup::{Correspondences, Result};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Raw fields of a problem, so that a test can move, scale or reorder them.
#[derive(Debug, Clone)]
pub struct Problem {
    pub source: Vec<Vector3<f64>>,
    pub target: Vec<Vector3<f64>>,
    pub similarity: Vec<f64>,
    pub ratio: Vec<f64>,
    pub source_frames: Vec<Frame>,
    pub target_frames: Vec<Frame>,
    pub resolution: f64,
    pub inliers: Vec<bool>,
}

/// A match is correct if its residual under the true motion is at most this.
const CORRECT_WITHIN: f64 = 5.0;

/// Mean radius of the surface, in units of the resolution, and the axes of the bumpy ellipsoid.
const RADIUS: f64 = 100.0;
const AXES: [f64; 3] = [1.0, 0.7, 0.5];

/// Standard deviation per axis of the true translation.
const DISTANCE: f64 = 50.0;

/// Share of inliers below which their ratios are almost those of outliers.
const FEW_INLIERS: f64 = 0.1;

/// Uniform numbers in [0, 1), one stream per seed, and derived distributions.
pub struct Uniform {
    seed: u64,
    counter: u64,
}

impl Uniform {
    pub fn new(seed: u64) -> Self {
        Self { seed, counter: 0 }
    }

    pub fn next(&mut self) -> f64 {
        self.counter += 1;
        (random_words(self.seed, self.counter)[0] >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn vector(&mut self, half_width: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| (2.0 * self.next() - 1.0) * half_width)
    }

    /// Normally distributed, by Box and Muller's method.
    fn normal(&mut self) -> f64 {
        let length = (-2.0 * (1.0 - self.next()).ln()).sqrt();
        length * (std::f64::consts::TAU * self.next()).cos()
    }

    fn normals(&mut self, deviation: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal() * deviation)
    }

    /// Uniformly distributed rotation.
    pub fn rotation(&mut self) -> Matrix3<f64> {
        let quaternion = Quaternion::new(self.normal(), self.normal(), self.normal(), self.normal());
        UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix().into_inner()
    }

    /// Gamma distributed, by Marsaglia and Tsang's method, for shapes of at least 1.
    fn gamma(&mut self, shape: f64) -> f64 {
        let d = shape - 1.0 / 3.0;
        loop {
            let x = self.normal();
            let v = (1.0 + x / (9.0 * d).sqrt()).powi(3);
            if v > 0.0 && self.next().ln() < 0.5 * x * x + d - d * v + d * v.ln() {
                return d * v;
            }
        }
    }

    fn beta(&mut self, a: f64, b: f64) -> f64 {
        let (a, b) = (self.gamma(a), self.gamma(b));
        a / (a + b)
    }
}

/// The point of the bumpy ellipsoid in a direction (before its axes are stretched).
fn surface(direction: Vector3<f64>) -> Vector3<f64> {
    let d = direction.normalize();
    let bumps = 1.0 + 0.10 * (5.0 * d.x + 1.0).sin() * (4.0 * d.y).cos() + 0.08 * (7.0 * d.z).sin();
    let mean_axis = AXES.iter().sum::<f64>() / 3.0;
    d.component_mul(&Vector3::from(AXES)) * (RADIUS / mean_axis * bumps)
}

/// A point of the surface; one that would be correct by chance is replaced by the opposite.
fn away_from(p: &Vector3<f64>, direction: Vector3<f64>) -> Vector3<f64> {
    let near = (surface(direction) - p).norm() <= CORRECT_WITHIN;
    surface(if near { -direction } else { direction })
}

/// `n` correspondences of which `share` follow one rigid motion, with noise of the given deviation per axis.
pub fn problem(seed: u64, n: usize, share: f64, noise: f64) -> Problem {
    let mut random = Uniform::new(seed);
    let (rotation, shift) = (random.rotation(), random.normals(DISTANCE));
    let mut result = Problem {
        source: Vec::new(),
        target: Vec::new(),
        similarity: Vec::new(),
        ratio: Vec::new(),
        source_frames: Vec::new(),
        target_frames: Vec::new(),
        resolution: 1.0,
        inliers: Vec::new(),
    };
    let mut inliers_left = share * n as f64;
    for i in 0..n {
        let inlier = random.next() * ((n - i) as f64) < inliers_left.round();
        inliers_left -= f64::from(u8::from(inlier));
        let p = surface(random.normals(1.0));
        let frame = random.rotation();
        let moved = rotation * p + shift + random.normals(noise);
        let wrong = rotation * away_from(&p, random.normals(1.0)) + shift;
        result.source.push(p);
        result.target.push(if inlier { moved } else { wrong });
        // Frames have axes as rows; those of an inlier move with the point.
        result.source_frames.push(Some(frame));
        let turned = frame * rotation.transpose();
        result.target_frames.push(Some(if inlier { turned } else { random.rotation() }));
        let (ratio, similarity) = match (inlier, share < FEW_INLIERS) {
            (true, false) => ((4.0, 1.8), (5.0, 2.0)),
            (true, true) => ((6.0, 1.4), (5.0, 2.0)),
            (false, _) => ((9.0, 1.2), (4.0, 3.0)),
        };
        result.ratio.push(random.beta(ratio.0, ratio.1));
        result.similarity.push(random.beta(similarity.0, similarity.1));
        result.inliers.push(inlier);
    }
    result
}

impl Problem {
    pub fn correspondences(&self) -> Result<Correspondences> {
        let rows = |points: &[Vector3<f64>]| points.iter().map(|p| (*p).into()).collect::<Vec<[f64; 3]>>();
        Correspondences::new(&rows(&self.source), &rows(&self.target))?
            .with_similarity(self.similarity.clone())?
            .with_ratio(self.ratio.clone())?
            .with_frames(self.source_frames.clone(), self.target_frames.clone())?
            .with_resolution(self.resolution)
    }

    /// Moves both sides rigidly, with their frames.
    pub fn moved(&self, source: &Motion, target: &Motion) -> Self {
        let mut result = self.clone();
        source.apply(&mut result.source, &mut result.source_frames);
        target.apply(&mut result.target, &mut result.target_frames);
        result
    }

    /// Scales all lengths.
    pub fn scaled(&self, factor: f64) -> Self {
        let mut result = self.clone();
        result.source.iter_mut().chain(&mut result.target).for_each(|p| *p *= factor);
        result.resolution *= factor;
        result
    }

    /// Reorders the rows: row `i` of the result is row `order[i]`.
    pub fn reordered(&self, order: &[usize]) -> Self {
        Self {
            source: order.iter().map(|&i| self.source[i]).collect(),
            target: order.iter().map(|&i| self.target[i]).collect(),
            similarity: order.iter().map(|&i| self.similarity[i]).collect(),
            ratio: order.iter().map(|&i| self.ratio[i]).collect(),
            source_frames: order.iter().map(|&i| self.source_frames[i]).collect(),
            target_frames: order.iter().map(|&i| self.target_frames[i]).collect(),
            resolution: self.resolution,
            inliers: order.iter().map(|&i| self.inliers[i]).collect(),
        }
    }
}

/// A rotation and a translation.
pub struct Motion {
    pub rotation: Matrix3<f64>,
    pub shift: Vector3<f64>,
}

impl Motion {
    pub fn random(seed: u64) -> Self {
        let mut random = Uniform::new(seed);
        Self { rotation: random.rotation(), shift: random.vector(1000.0) }
    }

    pub fn translation(seed: u64) -> Self {
        Self { rotation: Matrix3::identity(), shift: Uniform::new(seed).vector(1000.0) }
    }

    fn apply(&self, points: &mut [Vector3<f64>], frames: &mut [Frame]) {
        points.iter_mut().for_each(|p| *p = self.rotation * *p + self.shift);
        frames.iter_mut().flatten().for_each(|axes| *axes *= self.rotation.transpose());
    }
}

/// Every method, the paper's with the paper's parameters.
pub fn methods() -> Vec<(&'static str, BoxedMethod)> {
    let mut methods = cgroup::grouping::methods();
    for (name, method) in &mut methods {
        if *name == "ransac" {
            *method = Box::new(Ransac { iterations: 500, ..Ransac::default() });
        }
    }
    methods
}
