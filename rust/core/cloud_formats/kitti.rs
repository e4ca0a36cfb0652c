//! KITTI's scans (Geiger et al., CVPR 2012): x, y, z and reflectance of each point, float32, nothing else.

use super::cloud_content::{CloudContent, Points};
use super::scalar::{ByteOrder, Scalar};
use crate::error::{Error, Result};
use crate::execution::Execution;

const NUMBERS: usize = 4;
const BYTES: usize = NUMBERS * Scalar::F32.size();

/// Points between two looks for an interruption.
const CHECK_EVERY: usize = 1 << 16;

/// Points of a scan; the reflectance is left out.
///
/// # Errors
/// [`Error::InvalidInput`] unless the length is that of whole points, [`Error::OutOfMemory`], [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    if !content.len().is_multiple_of(BYTES) {
        let remedy = format!("a point takes {BYTES}: x, y, z and reflectance in float32");
        return Err(Error::invalid("scan", format!("{} bytes", content.len()), remedy));
    }
    let mut points = Points::with_capacity(content.len() / BYTES, false, None)?;
    for block in content.chunks(CHECK_EVERY * BYTES) {
        execution.check()?;
        for bytes in block.chunks_exact(BYTES) {
            let mut row = [0.0; 9];
            for (value, number) in row.iter_mut().zip(bytes.chunks_exact(Scalar::F32.size()).take(3)) {
                *value = Scalar::F32.read(number, ByteOrder::Little).unwrap_or(f64::NAN);
            }
            points.push(&row)?;
        }
    }
    points.finish(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_points_are_read() {
        let numbers = [1.0_f32, 2.0, 3.5, 0.9, -1.0, f32::NAN, 0.0, 0.1];
        let content: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let cloud = parse(&content, &Execution::default()).unwrap_or_default();
        assert_eq!(cloud.points[..1], [[1.0, 2.0, 3.5]]);
        assert!(cloud.points[1][1].is_nan());
        assert!(parse(&content[1..], &Execution::default()).is_err());
    }
}
