//! Checks that hold for every result.

use std::fmt::Debug;
use std::sync::LazyLock;

use cgroup::{Error, Grouping, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Pools of one and of two threads.
static POOLS: LazyLock<[Option<ThreadPool>; 2]> =
    LazyLock::new(|| [1, 2].map(|threads| ThreadPoolBuilder::new().num_threads(threads).build().ok()));

/// The result of `work`, which must be the same on one and on two threads; `None` if it fails.
pub fn on_threads<T: Debug + Send>(name: &str, work: impl Fn() -> Result<T> + Sync) -> Option<T> {
    let [Some(one), Some(two)] = &*POOLS else { return None };
    let [one, two] = [one, two].map(|pool| pool.install(&work));
    // Compared as text: NaN equals NaN, 0 differs from -0, and numbers are equal if their bits are.
    assert_eq!(format!("{one:?}"), format!("{two:?}"), "{name}: one thread and two");
    match one {
        Ok(result) => Some(result),
        Err(error) => {
            assert!(!matches!(error, Error::Interrupted), "{name}: nobody interrupted");
            assert!(error.to_string().len() < 1000, "{name}: {error}");
            None
        }
    }
}

/// A group of `n` correspondences.
pub fn grouping(name: &str, n: usize, group: &Grouping) {
    assert_eq!(group.mask.len(), n, "{name}: mask");
    if let Some(scores) = &group.scores {
        assert_eq!(scores.len(), n, "{name}: scores");
        assert!(scores.iter().all(|score| !score.is_nan()), "{name}: {scores:?}");
    }
    for instance in group.instances.iter().flatten() {
        assert_eq!(instance.len(), n, "{name}: instance");
    }
    assert!(group.threshold.is_none_or(|cut| !cut.is_nan()), "{name}: threshold");
    assert!(group.false_alarms.is_none_or(|number| !number.is_nan()), "{name}: false alarms");
    finite(name, group.model.iter().flatten().copied());
    for alternative in group.alternatives.iter().flatten() {
        finite(name, alternative.model.iter().copied().chain([alternative.score]));
    }
}

pub fn finite(name: &str, values: impl IntoIterator<Item = f64>) {
    for value in values {
        assert!(value.is_finite(), "{name}: {value}");
    }
}

/// Vectors that are finite, or all NaN if missing.
pub fn finite_or_missing<const N: usize>(name: &str, vectors: impl IntoIterator<Item = [f64; N]>) {
    for vector in vectors {
        let missing = vector.iter().all(|value| value.is_nan());
        assert!(missing || vector.iter().all(|value| value.is_finite()), "{name}: {vector:?}");
    }
}

/// Checks rows of a cloud.
pub fn indices(name: &str, n: usize, rows: &[usize]) {
    assert!(rows.iter().all(|&row| row < n), "{name}: {rows:?} of {n}");
}
