//! The `k` best indices, ties to the lowest index.

use crate::error::Result;
use crate::memory;

/// Indices of the `k` smallest keys, ascending by (key, index).
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn smallest(keys: &[f64], k: usize) -> Result<Vec<usize>> {
    let mut order = memory::collect(0..keys.len())?;
    let by_key_then_index = |&a: &usize, &b: &usize| keys[a].total_cmp(&keys[b]).then(a.cmp(&b));
    if k < order.len() {
        order.select_nth_unstable_by(k, by_key_then_index);
        order.truncate(k);
    }
    order.sort_unstable_by(by_key_then_index);
    Ok(order)
}

/// Indices of the `k` largest keys, descending by key, ties by ascending index.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn largest(keys: &[f64], k: usize) -> Result<Vec<usize>> {
    let negated = memory::collect(keys.iter().map(|key| -key))?;
    smallest(&negated, k)
}

/// Indices of the `k` largest keys in their own order, ties to the lowest index.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn largest_in_order(keys: &[f64], k: usize) -> Result<Vec<usize>> {
    let mut kept = largest(keys, k)?;
    kept.sort_unstable();
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ties_go_to_the_lowest_index() -> Result<()> {
        let keys = [3.0, 1.0, 3.0, 2.0, 1.0];
        assert_eq!(smallest(&keys, 3)?, [1, 4, 3]);
        assert_eq!(largest(&keys, 3)?, [0, 2, 3]);
        assert_eq!(largest(&keys, 9)?, [0, 2, 3, 1, 4]);
        assert_eq!(largest_in_order(&keys, 4)?, [0, 1, 2, 3]);
        Ok(())
    }
}
