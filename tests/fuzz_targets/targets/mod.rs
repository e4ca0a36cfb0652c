//! What is fuzzed: each target makes an input of the bytes it gets, hostile ones included, and checks what comes back.
//!
//! An error is a fine answer. A panic, a result of the wrong length, a number that is none, or another result on
//! another number of threads is not: it panics.
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

/// The nine methods of the paper, with any options.
pub fn paper_methods(data: &[u8]) {
    run(data, |input| grouping::run(input, options::paper_method));
}

/// The modern methods, with any options.
pub fn modern_methods(data: &[u8]) {
    run(data, |input| grouping::run(input, options::modern_method));
}

/// Keypoints, frames, descriptors and voxels of any cloud.
pub fn features(data: &[u8]) {
    run(data, features::run);
}

/// Nearest descriptors of any table.
pub fn matching(data: &[u8]) {
    run(data, matching::run);
}

/// Poses judged on any surfaces.
pub fn verification(data: &[u8]) {
    run(data, verification::run);
}

/// Files of point clouds.
pub fn readers(data: &[u8]) {
    run(data, readers::run);
}

fn run(data: &[u8], target: impl FnOnce(&mut Unstructured) -> arbitrary::Result<()>) {
    // Too few bytes make no input, which is no finding.
    let _: Result<(), arbitrary::Error> = target(&mut Unstructured::new(data));
}
