//! LAS, the format of airborne laser scans (ASPRS, LAS specification 1.0 to 1.5), and LAZ, its compressed form.
//!
//! Coordinates are integers with a scale and an offset. Colours of 16 bits become bytes; some writers put bytes there,
//! which are kept. Intensities, classes and times are left out, and so is all that stands behind the points.

mod header;
mod laz;

use self::header::Header;
use super::cloud_content::CloudContent;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// Points between two looks for an interruption.
const CHECK_EVERY: usize = 1 << 12;

/// Points of a file, and their colours where its point format has them.
///
/// # Errors
/// [`Error::InvalidInput`](crate::Error::InvalidInput) where it is cut off, damaged, of an unknown kind, or where so few bytes would grow to so
/// many points that they were made to hurt; [`Error::OutOfMemory`](crate::Error::OutOfMemory), [`Error::Interrupted`](crate::Error::Interrupted).
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let header = Header::read(content)?;
    if header.is_compressed {
        return laz::read(&header, content, execution)?.finish();
    }
    let mut points = Points::new(&header)?;
    for (i, record) in content[header.start..].chunks_exact(header.point).take(header.count).enumerate() {
        if i.is_multiple_of(CHECK_EVERY) {
            execution.check()?;
        }
        points.push(&Point {
            position: [0, 4, 8].map(|at| bytes_at(record, at).map_or(0, i32::from_le_bytes)),
            color: header.color.map_or([0; 3], |at| color_at(record, at)),
        })?;
    }
    points.finish()
}

/// Bytes from a place on; None where there are too few.
fn bytes_at<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}

fn color_at(record: &[u8], at: usize) -> [u16; 3] {
    [0, 2, 4].map(|more| bytes_at(record, at + more).map_or(0, u16::from_le_bytes))
}

/// What is taken of a point, as it is stored.
#[derive(Clone, Copy, Default)]
struct Point {
    position: [i32; 3],
    color: [u16; 3],
}

/// Points so far.
struct Points {
    points: Vec<[f64; 3]>,
    colors: Option<Vec<[u16; 3]>>,
    scale: [f64; 3],
    offset: [f64; 3],
}

impl Points {
    /// Room for those that a header declares; the caller has checked how many these are.
    fn new(header: &Header) -> Result<Self> {
        Ok(Self {
            points: memory::with_capacity(header.count)?,
            colors: header.color.map(|_| memory::with_capacity(header.count)).transpose()?,
            scale: header.scale,
            offset: header.offset,
        })
    }

    #[inline]
    fn push(&mut self, point: &Point) -> Result<()> {
        let place = |i| f64::from(point.position[i]) * self.scale[i] + self.offset[i];
        memory::push(&mut self.points, [place(0), place(1), place(2)])?;
        self.colors.as_mut().map_or(Ok(()), |colors| memory::push(colors, point.color))
    }

    fn finish(self) -> Result<CloudContent> {
        let in_bytes = |colors: Vec<[u16; 3]>| {
            let shift = if colors.as_flattened().iter().any(|&value| value > 255) { 8 } else { 0 };
            memory::collect(colors.iter().map(|color| color.map(|value| (value >> shift) as u8)))
        };
        let colors = self.colors.map(in_bytes).transpose()?;
        Ok(CloudContent { points: self.points, colors, ..CloudContent::default() })
    }
}

