//! Merges points with equal coordinates.

use std::collections::HashMap;

use super::cloud_content::CloudContent;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Points between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 12;

/// The cloud without repeated points, in order of first appearance. Points with a NaN equal no other.
pub(super) fn without_repeats(mut cloud: CloudContent, execution: &Execution) -> Result<CloudContent> {
    let mut firsts: HashMap<[u64; 3], usize> = HashMap::new();
    let mut rows = memory::with_capacity(cloud.points.len())?;
    let mut kept = 0;
    for i in 0..cloud.points.len() {
        if i.is_multiple_of(CHECK_EVERY) {
            execution.check()?;
        }
        let point = cloud.points[i];
        let mut row = kept;
        if !point.iter().any(|value| value.is_nan()) {
            firsts
                .try_reserve(1)
                .map_err(|_| Error::OutOfMemory { bytes: 2 * size_of::<[u64; 4]>() * firsts.len() })?;
            // Minus zero plus zero is zero: both are the same position.
            row = *firsts.entry(point.map(|value| (value + 0.0).to_bits())).or_insert(kept);
        }
        if row == kept {
            cloud.points[kept] = point;
            if let Some(colors) = &mut cloud.colors {
                colors[kept] = colors[i];
            }
            kept += 1;
        }
        rows.push(row as i64);
    }
    cloud.points.truncate(kept);
    if let Some(colors) = &mut cloud.colors {
        colors.truncate(kept);
    }
    for corner in cloud.faces.iter_mut().flatten().flatten() {
        *corner = rows[*corner as usize];
    }
    Ok(cloud)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_equal_points_is_kept() {
        let points =
            vec![[1.0, 0.0, 0.0], [-0.0, 2.0, 0.0], [1.0, 0.0, -0.0], [f64::NAN, 0.0, 0.0], [0.0, 2.0, 0.0]];
        let colors = Some((0..5).map(|i| [i; 3]).collect());
        let cloud = CloudContent {
            points,
            faces: Some(vec![[0, 1, 2], [4, 3, 0]]),
            colors,
            ..CloudContent::default()
        };
        let cloud = without_repeats(cloud, &Execution::default()).unwrap_or_default();
        assert_eq!(cloud.points.len(), 3);
        assert_eq!(cloud.points[..2], [[1.0, 0.0, 0.0], [-0.0, 2.0, 0.0]]);
        assert_eq!(cloud.colors, Some(vec![[0; 3], [1; 3], [3; 3]]));
        assert_eq!(cloud.faces, Some(vec![[0, 1, 0], [1, 2, 0]]));
    }
}
