//! Matching problems with a known answer, for the tests of the public interface.
#![allow(dead_code, reason = "each test file uses its own part")]

use cgroup::correspondences::Frame;
use cgroup::grouping::BoxedMethod;
use cgroup::grouping::ransac::Ransac;
use cgroup::selection::counter_rng::random_words;
use cgroup::{Correspondences, Result};
use nalgebra::{Matrix3, Rotation3, Vector3};

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

/// Uniform numbers in [0, 1), one stream per seed.
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

    pub fn rotation(&mut self) -> Matrix3<f64> {
        Rotation3::new(self.vector(2.0)).into_inner()
    }
}

/// `n` correspondences of which `share` follow one rigid motion, up to `noise`.
pub fn problem(seed: u64, n: usize, share: f64, noise: f64) -> Problem {
    let mut random = Uniform::new(seed);
    let (rotation, shift) = (random.rotation(), random.vector(200.0));
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
    for i in 0..n {
        let inlier = (i as f64) < share * n as f64;
        let p = random.vector(100.0);
        let frame = random.rotation();
        let moved = rotation * p + shift + random.vector(noise);
        let wrong = rotation * random.vector(100.0) + shift;
        result.source.push(p);
        result.target.push(if inlier { moved } else { wrong });
        // Frames have axes as rows; those of an inlier move with the point.
        result.source_frames.push(Some(frame));
        let turned = frame * rotation.transpose();
        result.target_frames.push(Some(if inlier { turned } else { random.rotation() }));
        let bonus = if inlier { 0.0 } else { 0.3 };
        result.ratio.push((0.4 + bonus + 0.3 * random.next()).min(1.0));
        result.similarity.push(0.8 - bonus - 0.2 * random.next());
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

    /// Both sides moved rigidly, frames along with them.
    pub fn moved(&self, source: &Motion, target: &Motion) -> Self {
        let mut result = self.clone();
        source.apply(&mut result.source, &mut result.source_frames);
        target.apply(&mut result.target, &mut result.target_frames);
        result
    }

    /// All lengths multiplied.
    pub fn scaled(&self, factor: f64) -> Self {
        let mut result = self.clone();
        result.source.iter_mut().chain(&mut result.target).for_each(|p| *p *= factor);
        result.resolution *= factor;
        result
    }

    /// Row `i` of the result is row `order[i]`.
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

/// The nine methods with the paper's parameters.
pub fn methods() -> Vec<(&'static str, BoxedMethod)> {
    let mut methods = cgroup::grouping::methods();
    for (name, method) in &mut methods {
        if *name == "ransac" {
            *method = Box::new(Ransac { iterations: 500, ..Ransac::default() });
        }
    }
    methods
}
