//! LAZ, the format of `LASzip` (M. Isenburg, 2013), versions 1 to 4 of its items.
//!
//! Points are coded in chunks, each of which begins with a whole point; a table after them lists their
//! lengths. A record of the header describes the items of a point. Point formats 0 to 5 are coded point by
//! point, so all items are decoded; 6 to 10 are coded in layers, and only those of coordinates and colours
//! are decoded.

mod arithmetic;
mod colors;
mod integers;
mod items;
mod layered;
mod pointwise;
mod times;

use self::arithmetic::Decoder;
use self::integers::Integers;
use self::items::Layout;
use super::super::lines::check_room;
use super::header::Header;
use super::{Points, bytes_at};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Total size of points up to which any compression ratio is accepted.
const TRUSTED: usize = 64 << 20;
/// Greatest compression ratio beyond that; real scans have five to twenty.
const MOST_GROWTH: usize = 100;
/// Least memory of a decoded point, in bytes.
const LEAST: usize = 32;

/// Reads the points of a file.
pub(super) fn read(header: &Header, content: &[u8], execution: &Execution) -> Result<Points> {
    let layout = items::read(header, content)?;
    let chunks = chunks(header, &layout, content)?;
    let packed = chunks.iter().map(|chunk| chunk.bytes.len()).sum::<usize>();
    let plain = header.count.saturating_mul(header.point.max(LEAST));
    if plain > TRUSTED.max(packed.saturating_mul(MOST_GROWTH)) {
        let got = format!("{packed} bytes that would grow to {plain}");
        return Err(Error::invalid("points", got, "write so many without compression, as LAS"));
    }
    let mut points = Points::new(header)?;
    for chunk in chunks {
        execution.check()?;
        let (first, rest) = chunk.bytes.split_at_checked(header.point).ok_or_else(cut_off)?;
        let more = chunk.points - 1;
        if layout.are_layered {
            layered::read(&layout, first, rest, more, &mut points, execution)?;
        } else {
            pointwise::read(&layout, first, rest, more, &mut points, execution)?;
        }
    }
    Ok(points)
}

/// Points coded together, at least one.
struct Chunk<'a> {
    points: usize,
    bytes: &'a [u8],
}

/// All chunks, according to their table.
fn chunks<'a>(header: &Header, layout: &Layout, content: &'a [u8]) -> Result<Vec<Chunk<'a>>> {
    let mut chunks = Vec::new();
    if header.count == 0 {
        return Ok(chunks);
    }
    if layout.is_one_chunk {
        memory::push(&mut chunks, Chunk { points: header.count, bytes: &content[header.start..] })?;
        return Ok(chunks);
    }
    let (mut data, table) = parted(header.start, content)?;
    let number = bytes_at(table, 4).map_or(0, u32::from_le_bytes) as usize;
    check_room("chunks", number, header.point, data.len())?;
    let mut decoder = Decoder::new(table.get(8..).unwrap_or_default());
    let mut sizes = Integers::new(32, 2);
    let (mut points, mut bytes, mut left) = (0, 0, header.count);
    for _ in 0..number {
        points = match layout.chunk {
            Some(points) => points.min(left),
            None => sizes.next(&mut decoder, points as u32 as i32, 0)? as u32 as usize,
        };
        bytes = sizes.next(&mut decoder, bytes, 1)?;
        let (chunk, rest) = data.split_at_checked(bytes as u32 as usize).ok_or_else(cut_off)?;
        data = rest;
        left = left.checked_sub(points).ok_or_else(|| miscounted(header.count))?;
        if points > 0 {
            memory::push(&mut chunks, Chunk { points, bytes: chunk })?;
        }
    }
    if decoder.is_cut_off() {
        return Err(cut_off());
    }
    if left > 0 { Err(miscounted(header.count)) } else { Ok(chunks) }
}

/// Splits the chunks from their table. The table's position is stored before the chunks, or at the end of a
/// file written as a stream.
fn parted(start: usize, content: &[u8]) -> Result<(&[u8], &[u8])> {
    let place = |at: usize| {
        let data = start.checked_add(8)?;
        let table = usize::try_from(i64::from_le_bytes(bytes_at(content, at)?)).ok()?;
        (table >= data && table.checked_add(8)? <= content.len()).then_some((data, table))
    };
    let (data, table) = place(start).or_else(|| place(content.len().checked_sub(8)?)).ok_or_else(|| {
        let got = "none at its declared place";
        Error::invalid("chunk table", got, "the file is cut off, or wasn't written to its end")
    })?;
    Ok((&content[data..table], &content[table..]))
}

fn cut_off() -> Error {
    Error::invalid("chunk", "too few bytes", "the file is cut off or damaged")
}

fn miscounted(count: usize) -> Error {
    Error::invalid("chunks", format!("other than {count} points"), "the file is cut off or damaged")
}
