//! The record that describes the compression of points.

use super::super::bytes_at;
use super::super::header::Header;
use crate::error::{Error, Result};

/// Bytes of the head of a variable-length record, and offset of its content's length.
const RECORD_HEAD: usize = 54;
const RECORD_LENGTH: usize = 20;
const NAME: &[u8] = b"laszip encoded";
/// Bytes before the items, and per item.
const ITEMS: usize = 34;
const ITEM: usize = 6;

/// Items of a point, and their coding.
pub(super) struct Layout {
    pub items: Vec<Item>,
    pub are_layered: bool,
    pub is_one_chunk: bool,
    /// Points per chunk; `None` if the table of chunks lists them.
    pub chunk: Option<usize>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Item {
    pub kind: Kind,
    pub size: usize,
    pub version: u16,
}

/// In the order of a point's items.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
pub(super) enum Kind {
    Position,
    Time,
    Color,
    Wave,
    Bytes,
    LayeredPosition,
    LayeredColor,
    LayeredColorAndInfrared,
    LayeredWave,
    LayeredBytes,
}

impl Kind {
    /// The kind of a type number, and its size in bytes if that is fixed.
    fn of(number: u16) -> Option<(Self, Option<usize>)> {
        Some(match number {
            0 => (Self::Bytes, None),
            6 => (Self::Position, Some(20)),
            7 => (Self::Time, Some(8)),
            8 => (Self::Color, Some(6)),
            9 => (Self::Wave, Some(29)),
            10 => (Self::LayeredPosition, Some(30)),
            11 => (Self::LayeredColor, Some(6)),
            12 => (Self::LayeredColorAndInfrared, Some(8)),
            13 => (Self::LayeredWave, Some(29)),
            14 => (Self::LayeredBytes, None),
            _ => return None,
        })
    }

    fn is_layered(self) -> bool {
        self >= Self::LayeredPosition
    }

    pub fn is_color(self) -> bool {
        matches!(self, Self::Color | Self::LayeredColor | Self::LayeredColorAndInfrared)
    }
}

impl Item {
    fn read(bytes: &[u8]) -> Option<Self> {
        let [number, size, version] = [0, 2, 4].map(|at| bytes_at(bytes, at).map_or(0, u16::from_le_bytes));
        let (kind, fixed) = Kind::of(number)?;
        let size = usize::from(size);
        let versions = if kind.is_layered() { 3..=4 } else { 1..=2 };
        (size > 0 && fixed.is_none_or(|fixed| fixed == size) && versions.contains(&version)).then_some(Self {
            kind,
            size,
            version,
        })
    }
}

/// Reads the items of a file.
pub(super) fn read(header: &Header, content: &[u8]) -> Result<Layout> {
    let record = find(header, content)
        .ok_or_else(|| Error::invalid("header", "no record of LASzip", "the file is damaged"))?;
    parsed(record, header).ok_or_else(|| {
        let got = format!("{} bytes that fit no point of {}", record.len(), header.point);
        Error::invalid("record of LASzip", got, "versions 1 to 4 are known; otherwise the file is damaged")
    })
}

/// The content of the record.
fn find<'a>(header: &Header, content: &'a [u8]) -> Option<&'a [u8]> {
    let mut rest = content.get(header.size..header.start)?;
    for _ in 0..header.records {
        let (head, behind) = rest.split_at_checked(RECORD_HEAD)?;
        let (record, behind) =
            behind.split_at_checked(usize::from(u16::from_le_bytes(bytes_at(head, RECORD_LENGTH)?)))?;
        if head[2..].starts_with(NAME) {
            return Some(record);
        }
        rest = behind;
    }
    None
}

/// Parses the items of a record; `None` if they do not match the header's points.
fn parsed(record: &[u8], header: &Header) -> Option<Layout> {
    let short = |at| bytes_at(record, at).map(u16::from_le_bytes);
    let (compressor, coder) = (short(0)?, short(2)?);
    let chunk = u32::from_le_bytes(bytes_at(record, 12)?);
    let number = usize::from(short(32)?);
    let bytes = record.get(ITEMS..)?.get(..number * ITEM)?;
    let items = bytes.chunks_exact(ITEM).map(Item::read).collect::<Option<Vec<_>>>()?;
    let are_layered = match items.first()?.kind {
        Kind::Position => false,
        Kind::LayeredPosition => true,
        _ => return None,
    };
    let has_color = items.iter().any(|item| item.kind.is_color());
    let fits = items.iter().map(|item| item.size).sum::<usize>() == header.point
        && items.iter().all(|item| item.kind.is_layered() == are_layered)
        && items.is_sorted_by(|item, next| item.kind < next.kind)
        && has_color == header.color.is_some()
        && matches!((compressor, are_layered), (1 | 2, false) | (3, true))
        && coder == 0;
    let chunk = (chunk != 0 && chunk != u32::MAX).then_some(chunk as usize);
    fits.then_some(Layout { items, are_layered, is_one_chunk: compressor == 1, chunk })
}
