//! Fuzz targets: each builds an input from bytes, including hostile ones, and checks the result.
//!
//! An error is a valid result. A panic, a result of the wrong length, a NaN, or a result that depends on the
//! number of threads is not: the target panics.
#![allow(dead_code, reason = "each fuzz target is a program that uses its own part")]

mod check;
mod draw;
mod features;
mod grouping;
mod matching;
mod options;
mod readers;
mod verification;

use arbitrary::Unstructured;

/// A target: the name of its folder in `tests/fuzz_targets/corpus`, and its function.
pub type Target = (&'static str, fn(&[u8]));

pub const TARGETS: [Target; 6] = [
    ("paper_methods", paper_methods),
    ("modern_methods", modern_methods),
    ("features", features),
    ("matching", matching),
    ("verification", verification),
    ("readers", readers),
];

/// The nine methods of the paper, with arbitrary options.
pub fn paper_methods(data: &[u8]) {
    run(data, |input| grouping::run(input, options::paper_method));
}

/// The modern methods, with arbitrary options.
pub fn modern_methods(data: &[u8]) {
    run(data, |input| grouping::run(input, options::modern_method));
}

/// Keypoints, frames, descriptors and voxels of arbitrary clouds.
pub fn features(data: &[u8]) {
    run(data, features::run);
}

/// Nearest descriptors of arbitrary tables.
pub fn matching(data: &[u8]) {
    run(data, matching::run);
}

/// Scores of poses on arbitrary surfaces.
pub fn verification(data: &[u8]) {
    run(data, verification::run);
}

/// Files of point clouds.
pub fn readers(data: &[u8]) {
    run(data, readers::run);
}

fn run(data: &[u8], target: impl FnOnce(&mut Unstructured) -> arbitrary::Result<()>) {
    // Too few bytes for an input are not a finding.
    let _: Result<(), arbitrary::Error> = target(&mut Unstructured::new(data));
}
