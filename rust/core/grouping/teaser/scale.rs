//! Scale between matched points from the ratios of their distances (TEASER, section V-A).

use super::truncated_mean::truncated_mean;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;

/// Most ratios used: more add little evidence.
const MOST_RATIOS: usize = 1_000_000;

/// Bytes per ratio: itself, its range, and two ends of an interval.
const BYTES: usize = 48;

/// The truncated mean of `dt / ds`, with range `bound / ds`, over all pairs; `None` if all source points
/// coincide.
///
/// Of more than [`MOST_RATIOS`] pairs, those `(i, i + k mod n)` are used whose k are spread evenly over half
/// the rows.
///
/// # Errors
/// [`Error::InvalidInput`] if the ratios do not fit `execution.max_memory`; [`Error::Interrupted`],
/// [`Error::OutOfMemory`].
pub fn truncated_scale(
    source: &Points,
    target: &Points,
    bound: f64,
    execution: &Execution,
) -> Result<Option<f64>> {
    let offsets = offsets(source.len())?;
    let bytes = BYTES * offsets.len() * source.len();
    if bytes > execution.max_memory {
        let remedy =
            format!("the ratios of distances take {bytes} bytes; allow that many, or give the scale");
        return Err(Error::invalid("max_memory", execution.max_memory, remedy));
    }
    let (n, zero) = (source.len(), source.zero_length());
    let most = offsets.len() * n;
    let (mut ratios, mut ranges) = (memory::with_capacity(most)?, memory::with_capacity(most)?);
    for offset in offsets {
        execution.check()?;
        // For an offset of half the rows, the second half repeats the first.
        let rows = if 2 * offset == n { offset } else { n };
        for i in 0..rows {
            let j = (i + offset) % n;
            let length = source.distance(i, j);
            if length > zero {
                ratios.push(target.distance(i, j) / length);
                ranges.push(bound / length);
            }
        }
    }
    execution.check()?;
    Ok(truncated_mean(&ratios, &ranges)?.filter(|&scale| scale > 0.0))
}

/// Whether some pairs are not used.
pub fn leaves_out(n: usize) -> bool {
    n / 2 > most_offsets(n)
}

/// The k of the pairs `(i, i + k)`: each of 1 to n / 2, or an even selection of them.
fn offsets(n: usize) -> Result<Vec<usize>> {
    let half = n / 2;
    let most = most_offsets(n);
    memory::collect((0..half.min(most)).map(|m| 1 + m * half / half.min(most)))
}

fn most_offsets(n: usize) -> usize {
    (MOST_RATIOS / n.max(1)).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_reach_each_pair_once() -> Result<()> {
        for n in 0..9 {
            let mut pairs = Vec::new();
            for k in offsets(n)? {
                let rows = if 2 * k == n { k } else { n };
                pairs.extend((0..rows).map(|i| (i.min((i + k) % n), i.max((i + k) % n))));
            }
            pairs.sort_unstable();
            let all: Vec<_> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
            assert_eq!(pairs, all, "{n}");
            assert!(!leaves_out(n));
        }
        let some = offsets(10_000)?;
        assert_eq!((some.len(), some[0], some[99]), (100, 1, 4_951));
        assert!(leaves_out(10_000) && some.is_sorted());
        Ok(())
    }
}
