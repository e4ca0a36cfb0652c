//! LAS, the format of airborne laser scans (ASPRS, LAS specification 1.0 to 1.5), and LAZ, its compressed
//! form.
//!
//! Coordinates are integers with a scale and an offset. Colours of 16 bits are converted to bytes; colours of
//! writers that store bytes are kept. Classes, times, and all data after the points are ignored.

mod header;
mod laz;

use self::header::Header;
use super::cloud_content::CloudContent;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// Points between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 12;

/// Parses the points of a file, their colours if the point format has them, and their intensities unless all are zero, which
/// the specification demands where there are none.
///
/// # Errors
/// [`Error::InvalidInput`](crate::Error::InvalidInput) if the file is truncated, damaged, of an unknown kind,
/// or expands so few bytes to so many points that it must be malicious;
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory), [`Error::Interrupted`](crate::Error::Interrupted).
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
            position: position_at(record),
            color: header.color.map_or([0; 3], |at| color_at(record, at)),
            intensity: intensity_at(record),
        })?;
    }
    points.finish()
}

/// Bytes from an offset on; `None` if there are too few.
fn bytes_at<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}

fn position_at(record: &[u8]) -> [i32; 3] {
    [0, 4, 8].map(|at| bytes_at(record, at).map_or(0, i32::from_le_bytes))
}

fn intensity_at(record: &[u8]) -> u16 {
    bytes_at(record, 12).map_or(0, u16::from_le_bytes)
}

fn color_at(record: &[u8], at: usize) -> [u16; 3] {
    [0, 2, 4].map(|more| bytes_at(record, at + more).map_or(0, u16::from_le_bytes))
}

/// The used values of a point, as stored.
#[derive(Clone, Copy, Default)]
struct Point {
    position: [i32; 3],
    color: [u16; 3],
    intensity: u16,
}

/// Points read so far.
struct Points {
    places: Vec<[f64; 3]>,
    colors: Option<Vec<[u16; 3]>>,
    intensities: Vec<f32>,
    scale: [f64; 3],
    offset: [f64; 3],
}

impl Points {
    /// Reserves room for the points declared by a header; the caller has checked their number.
    fn new(header: &Header) -> Result<Self> {
        Ok(Self {
            places: memory::with_capacity(header.count)?,
            colors: header.color.map(|_| memory::with_capacity(header.count)).transpose()?,
            intensities: memory::with_capacity(header.count)?,
            scale: header.scale,
            offset: header.offset,
        })
    }

    #[inline]
    fn push(&mut self, point: &Point) -> Result<()> {
        let place = |i| f64::from(point.position[i]) * self.scale[i] + self.offset[i];
        memory::push(&mut self.places, [place(0), place(1), place(2)])?;
        memory::push(&mut self.intensities, f32::from(point.intensity))?;
        self.colors.as_mut().map_or(Ok(()), |colors| memory::push(colors, point.color))
    }

    fn finish(self) -> Result<CloudContent> {
        let in_bytes = |colors: Vec<[u16; 3]>| {
            let shift = if colors.as_flattened().iter().any(|&value| value > 255) { 8 } else { 0 };
            memory::collect(colors.iter().map(|color| color.map(|value| (value >> shift) as u8)))
        };
        let colors = self.colors.map(in_bytes).transpose()?;
        let intensities = self.intensities.iter().any(|&value| value != 0.0).then_some(self.intensities);
        Ok(CloudContent { points: self.places, colors, intensities, ..CloudContent::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &[u8]) -> Result<CloudContent> {
        parse(content, &Execution::default())
    }

    macro_rules! corpus {
        ($name:literal) => {
            include_bytes!(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/tests/fuzz_targets/corpus/readers/las-",
                $name
            ))
        };
    }

    /// Corpus files of the fuzz targets, after a byte for the format: 60 points each, as in `expected`.
    const FILES: [(&str, &[u8]); 9] = [
        ("point format 0", corpus!("dacfc1")),
        ("point format 7 and two bytes more", corpus!("2689ce")),
        ("point format 0, items of version 1", corpus!("161818")),
        ("point format 1, items of version 1", corpus!("1c84aa")),
        ("point format 3 and two bytes more, chunks of different lengths", corpus!("5c192f")),
        ("point format 5, with waveforms", corpus!("5c81d2")),
        ("point format 6 and a byte more, three chunks", corpus!("199051")),
        ("point format 8, chunks of different lengths", corpus!("6b4ccb")),
        ("point format 7, items of version 4", corpus!("010169")),
    ];

    fn files() -> impl Iterator<Item = (&'static str, &'static [u8])> {
        FILES.into_iter().map(|(what, content)| (what, &content[1..]))
    }

    fn expected(i: usize) -> ([f64; 3], [u8; 3]) {
        let height = (i / 3) as f64 * if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        let stored = [(i * i % 101) as f64 - 50.0, (7 * i % 53) as f64, height];
        (stored.map(|value| value * 0.25), [0, 1, 2].map(|channel| (3 * i + channel) as u8))
    }

    #[test]
    fn every_version_is_read() -> Result<()> {
        for (what, content) in files() {
            let cloud = read(content)?;
            let (points, colors): (Vec<_>, Vec<_>) = (0..60).map(expected).unzip();
            assert_eq!(cloud.points, points, "{what}");
            assert!(cloud.colors.is_none_or(|found| found == colors), "{what}");
        }
        Ok(())
    }

    #[test]
    fn truncated_files_are_refused() {
        for (what, content) in files() {
            for end in 0..content.len() {
                assert!(read(&content[..end]).is_err(), "{what}: {end} of {} bytes", content.len());
            }
        }
    }

    #[test]
    fn damaged_files_are_errors_or_clouds() {
        for (what, content) in files() {
            for at in 0..content.len() {
                let mut damaged = content.to_vec();
                damaged[at] ^= 1 << (at % 8);
                let cloud = read(&damaged).unwrap_or_default();
                assert!(cloud.points.len() <= 1 << 21, "{what}: byte {at}");
            }
        }
    }

    #[test]
    fn excessive_compression_is_refused() {
        // The total number of points and that of a chunk, as in a file of many equal points.
        let mut content = FILES[2].1[1..].to_vec();
        for at in [107, 227 + 54 + 12] {
            content[at..at + 4].copy_from_slice(&20_000_000_u32.to_le_bytes());
        }
        assert!(read(&content).is_err_and(|error| error.to_string().contains("640000000")));
    }
}
