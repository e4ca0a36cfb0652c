//! Test problem of the unit tests of several methods.

use crate::{Correspondences, Result};

/// `right` points moved rigidly, by (7, 0, 0) and a quarter turn about z, then others moved randomly.
pub fn problem(n: usize, right: usize) -> Result<Correspondences> {
    let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 100.0 * (i as f64 * f * k + k).sin());
    let source: Vec<[f64; 3]> = (0..n).map(|i| place(i, 1.0)).collect();
    let moved = |i: usize, p: &[f64; 3]| if i < right { [7.0 - p[1], p[0], p[2]] } else { place(i, 0.7) };
    let target: Vec<_> = source.iter().enumerate().map(|(i, p)| moved(i, p)).collect();
    Correspondences::new(&source, &target)?.with_resolution(1.0)
}
