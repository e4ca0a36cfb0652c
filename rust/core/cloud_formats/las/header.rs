//! The header of a LAS file; every number is checked against the file's length.

use super::super::lines::check_room;
use super::bytes_at;
use crate::error::{Error, Result};

/// Bytes per record of each point format, without extra bytes.
const RECORDS: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
/// Offset of the colour in a record of each point format.
const COLORS: [Option<usize>; 11] =
    [None, None, Some(20), Some(28), None, Some(28), None, Some(30), Some(30), None, Some(30)];
/// Bytes of a header of version 1.0 and later, of 1.3, and of 1.4 and later.
const HEADERS: [usize; 3] = [227, 235, 375];
/// Bits of the point format's number that mark compressed points.
const COMPRESSION: u8 = 0b1100_0000;
const COMPRESSED: u8 = 0b1000_0000;

/// The header fields used.
pub(super) struct Header {
    /// Bytes before the first variable-length record, and declared number of such records.
    pub size: usize,
    pub records: usize,
    /// Bytes before the points.
    pub start: usize,
    pub is_compressed: bool,
    /// Bytes per point.
    pub point: usize,
    pub count: usize,
    /// Offset of the colour in a point.
    pub color: Option<usize>,
    pub scale: [f64; 3],
    pub offset: [f64; 3],
}

impl Header {
    pub fn read(content: &[u8]) -> Result<Self> {
        if !content.starts_with(b"LASF") {
            return Err(Error::invalid("header", "no LASF at the start", "this is another format"));
        }
        Self::fields(content).ok_or_else(|| {
            let got = format!("{} bytes", content.len());
            Error::invalid("header", got, format!("the shortest has {}: the file is cut off", HEADERS[0]))
        })?
    }

    /// The header; `None` if the file is shorter.
    fn fields(content: &[u8]) -> Option<Result<Self>> {
        let byte = |at: usize| bytes_at::<1>(content, at).map(|[byte]| byte);
        let short = |at| bytes_at(content, at).map(u16::from_le_bytes).map(usize::from);
        let long = |at| bytes_at(content, at).map(u32::from_le_bytes).map(|number| number as usize);
        let triple = |at: usize| {
            let [x, y, z] = [0, 8, 16].map(|more| bytes_at(content, at + more).map(f64::from_le_bytes));
            Some([x?, y?, z?])
        };
        let (major, minor) = (byte(24)?, byte(25)?);
        let least = HEADERS[usize::from(minor.saturating_sub(2).min(2))];
        let format = byte(104)?;
        let color = COLORS.get(usize::from(format & !COMPRESSION)).copied();
        let count = match minor {
            ..4 => long(107)?,
            4.. => usize::try_from(u64::from_le_bytes(bytes_at(content, 247)?)).unwrap_or(usize::MAX),
        };
        let header = Self {
            size: short(94)?,
            records: long(100)?,
            start: long(96)?,
            is_compressed: format & COMPRESSION == COMPRESSED,
            point: short(105)?,
            count,
            color: color.flatten(),
            scale: triple(131)?,
            offset: triple(155)?,
        };
        let known = color.is_some() && (format & COMPRESSION == 0 || header.is_compressed);
        Some(if major != 1 || minor > 5 {
            Err(Error::invalid("version", format!("{major}.{minor}"), "1.0 to 1.5 are known"))
        } else if header.size < least || header.start < header.size || header.start > content.len() {
            let got = format!(
                "a header of {} bytes and points behind {} of {}",
                header.size,
                header.start,
                content.len()
            );
            Err(Error::invalid("header", got, format!("version 1.{minor} has at least {least} before them")))
        } else if !known {
            Err(Error::invalid("point format", format, "0 to 10 are known"))
        } else {
            let least = RECORDS[usize::from(format & !COMPRESSION)];
            header.check_points(least, content.len()).map(|()| header)
        })
    }

    fn check_points(&self, least: usize, bytes: usize) -> Result<()> {
        if self.point < least {
            let got = format!("{} bytes", self.point);
            return Err(Error::invalid("point", got, format!("its format takes at least {least}")));
        }
        if self.is_compressed {
            Ok(())
        } else {
            check_room("points", self.count, self.point, bytes - self.start)
        }
    }
}
