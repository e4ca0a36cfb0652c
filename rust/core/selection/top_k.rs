//! The `k` best indices, ties to the lowest index.

/// Indices of the `k` smallest keys, ascending by (key, index).
pub fn smallest(keys: &[f64], k: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..keys.len()).collect();
    let by_key_then_index = |&a: &usize, &b: &usize| keys[a].total_cmp(&keys[b]).then(a.cmp(&b));
    if k < order.len() {
        order.select_nth_unstable_by(k, by_key_then_index);
        order.truncate(k);
    }
    order.sort_unstable_by(by_key_then_index);
    order
}

/// Indices of the `k` largest keys, descending by key, ties by ascending index.
pub fn largest(keys: &[f64], k: usize) -> Vec<usize> {
    let negated: Vec<f64> = keys.iter().map(|key| -key).collect();
    smallest(&negated, k)
}

/// Indices of the `k` largest keys in their own order, ties to the lowest index.
pub fn largest_in_order(keys: &[f64], k: usize) -> Vec<usize> {
    let mut kept = largest(keys, k);
    kept.sort_unstable();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ties_go_to_the_lowest_index() {
        let keys = [3.0, 1.0, 3.0, 2.0, 1.0];
        assert_eq!(smallest(&keys, 3), [1, 4, 3]);
        assert_eq!(largest(&keys, 3), [0, 2, 3]);
        assert_eq!(largest(&keys, 9), [0, 2, 3, 1, 4]);
        assert_eq!(largest_in_order(&keys, 4), [0, 1, 2, 3]);
    }
}
