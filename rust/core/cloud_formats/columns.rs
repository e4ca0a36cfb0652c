//! Columns of binary rows, read block by block.

use super::cloud_content::Points;
use super::scalar::{ByteOrder, Scalar};
use crate::error::Result;
use crate::execution::Execution;

/// Rows read column by column, so that they stay in the cache, between two checks for an interruption.
const BLOCK: usize = 1 << 12;

/// A number of every row.
pub(super) struct Column {
    /// Column in the row of a point; `None` for a colour packed into four bytes.
    pub to: Option<usize>,
    pub scalar: Scalar,
    /// First byte of the first row's number.
    pub start: usize,
    /// Bytes from one row to the next.
    pub step: usize,
}

/// Adds `count` points from columns of `bytes`, whose length the caller has checked.
pub(super) fn read_columns(
    points: &mut Points,
    count: usize,
    columns: &[Column],
    (bytes, order): (&[u8], ByteOrder),
    execution: &Execution,
) -> Result<()> {
    for first in (0..count).step_by(BLOCK) {
        execution.check()?;
        let block = points.grow(BLOCK.min(count - first))?;
        for column in columns {
            let bytes = bytes.get(column.start + first * column.step..).unwrap_or_default();
            let numbers = bytes.chunks(column.step.max(1));
            match column.to {
                Some(to) => {
                    let numbers = numbers.map(|number| column.scalar.read(number, order).unwrap_or(f64::NAN));
                    points.column(block.clone(), to).zip(numbers).for_each(|(to, number)| *to = number);
                }
                None => points.colors(block.clone()).zip(numbers).for_each(|(color, packed)| {
                    // As bits: the number may be a NaN, which a conversion would change.
                    *color = unpacked(packed.first_chunk().map_or(0, |bits| u32::from_le_bytes(*bits)));
                }),
            }
        }
    }
    Ok(())
}

/// PCL packs 0x00RRGGBB into four bytes, often called a float.
pub(super) fn unpacked(bits: u32) -> [f64; 3] {
    [16, 8, 0].map(|shift| f64::from(bits >> shift & 255))
}
