//! KITTI's scans (Geiger et al., CVPR 2012): x, y, z and reflectance of each point as float32, without a
//! header.

use super::cloud_content::{CloudContent, INTENSITY, Points};
use super::columns::{Column, read_columns};
use super::scalar::{ByteOrder, Scalar};
use crate::error::{Error, Result};
use crate::execution::Execution;

const NUMBERS: usize = 4;
const BYTES: usize = NUMBERS * Scalar::F32.size();

/// Parses the points of a scan; the reflectance is their intensity.
///
/// # Errors
/// [`Error::InvalidInput`] unless the length is a multiple of a point's, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    if !content.len().is_multiple_of(BYTES) {
        let remedy = format!("a point takes {BYTES}: x, y, z and reflectance in float32");
        return Err(Error::invalid("scan", format!("{} bytes", content.len()), remedy));
    }
    let count = content.len() / BYTES;
    let scalar = Scalar::F32;
    let columns: [Column; NUMBERS] = [(0, 0), (1, 1), (2, 2), (3, INTENSITY)].map(|(place, to)| Column {
        to: Some(to),
        scalar,
        start: place * scalar.size(),
        step: BYTES,
    });
    let mut points = Points::with_capacity(count, false, None)?.with_intensities(true)?;
    read_columns(&mut points, count, &columns, (content, ByteOrder::Little), execution)?;
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
        assert_eq!(cloud.intensities, Some(vec![0.9, 0.1]));
        assert!(parse(&content[1..], &Execution::default()).is_err());
    }
}
