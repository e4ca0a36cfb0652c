//! PCD, the format of the Point Cloud Library, versions 0.5 to 0.7.
//!
//! Points are the fields x y z; `normal_x` and so on, intensity, and the colour packed in rgb or rgba, are read
//! if present. The viewpoint's position is read, in the frame of the points, as PCL's normals use it; its
//! rotation, which PCL applies when it displays a cloud, is ignored. All other fields are skipped.

mod header;

use self::header::{Body, Header};
use super::cloud_content::{
    COLOR, CloudContent, ColorScale, INTENSITY, INTENSITY_NAMES, NORMAL, POSITION, Points, Row,
};
use super::columns::{Column, read_columns, unpacked};
use super::lines::{Lines, check_room, shown};
use super::lzf;
use super::scalar::{ByteOrder, Scalar};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Parses the points, normals, colours and intensities of a file.
///
/// # Errors
/// [`Error::InvalidInput`] if the file is truncated or not a PCD file, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let (header, lines) = header::read(content, execution)?;
    let wanted = Wanted::of(&header)?;
    let points = match header.body {
        Body::Text => read_text(&header, &wanted, lines)?,
        Body::Binary => {
            check_room("POINTS", header.points, header.row_bytes, lines.rest().len())?;
            let at = |field: &Field| (field.offset, header.row_bytes);
            read_binary(&header, &wanted, lines.rest(), at, execution)?
        }
        Body::Compressed => {
            let plain = decompress(&header, lines.rest(), execution)?;
            let at = |field: &Field| (field.offset.saturating_mul(header.points), field.scalar.size());
            read_binary(&header, &wanted, &plain, at, execution)?
        }
    };
    Ok(CloudContent { viewpoint: header.viewpoint, ..points.finish(None)? })
}

/// A field that is read.
struct Field {
    /// Column of the row; `None` for a packed colour.
    to: Option<usize>,
    scalar: Scalar,
    /// Words before it on a line.
    words: usize,
    /// Bytes before it in a point.
    offset: usize,
}

/// The fields that are read, in the file's order.
struct Wanted {
    fields: Vec<Field>,
    normals: bool,
    colors: bool,
    intensities: bool,
}

impl Wanted {
    fn of(header: &Header) -> Result<Self> {
        let names = |names: [&'static str; 3], to: [usize; 3]| names.into_iter().zip(to.map(Some));
        let is_there =
            |name: &str| header.fields.iter().any(|field| field.count == 1 && field.is_called(name));
        let mut wanted: Vec<_> = names(["x", "y", "z"], POSITION).collect();
        if !wanted.iter().all(|(name, _)| is_there(name)) {
            return Err(Error::invalid("FIELDS", "not all of x, y, z", "a point has three coordinates"));
        }
        let normals = ["normal_x", "normal_y", "normal_z"];
        let has_normals = normals.iter().all(|name| is_there(name));
        if has_normals {
            wanted.extend(names(normals, NORMAL));
        }
        let packed = ["rgb", "rgba"].into_iter().find(|name| is_there(name));
        wanted.extend(packed.map(|name| (name, None)));
        let intensity = INTENSITY_NAMES.into_iter().find(|name| is_there(name));
        wanted.extend(intensity.map(|name| (name, Some(INTENSITY))));
        let mut fields = Vec::new();
        let (mut words, mut offset) = (0, 0);
        for field in &header.fields {
            let place = wanted.iter().position(|(name, _)| field.count == 1 && field.is_called(name));
            if let Some((_, to)) = place.map(|place| wanted.swap_remove(place)) {
                fields.push(Field { to, scalar: field.scalar, words, offset });
            }
            // The header is rejected unless the sums over all fields are representable.
            words += field.count;
            offset += field.count * field.scalar.size();
        }
        let intensities = intensity.is_some();
        Ok(Self { fields, normals: has_normals, colors: packed.is_some(), intensities })
    }

    fn points(&self, count: usize) -> Result<Points> {
        Points::with_capacity(count, self.normals, self.colors.then_some(ColorScale::Bytes))?
            .with_intensities(self.intensities)
    }
}

fn read_text(header: &Header, wanted: &Wanted, mut lines: Lines) -> Result<Points> {
    check_room("POINTS", header.points, header.row_words.saturating_mul(2), lines.rest().len() + 1)?;
    let mut points = wanted.points(header.points)?;
    while let Some(mut line) = lines.next_with_words(&[b"#"])? {
        if points.len() == header.points {
            return Err(line.refuse("a further point", format!("the header declares {}", header.points)));
        }
        let mut row: Row = [0.0; 10];
        let mut fields = wanted.fields.iter().peekable();
        for place in 0..header.row_words {
            let Some(field) = fields.next_if(|field| field.words == place) else {
                line.next_number()?;
                continue;
            };
            let number = line.next_number()?;
            if let Some(to) = field.to {
                row[to] = field.scalar.hold(number);
            } else {
                let is_float = field.scalar == Scalar::F32;
                let bits = if is_float { (number as f32).to_bits() } else { number as u32 };
                COLOR.into_iter().zip(unpacked(bits)).for_each(|(to, value)| row[to] = value);
            }
        }
        if let Some(word) = line.next_word()? {
            return Err(line.refuse(shown(word), format!("a point has {} numbers", header.row_words)));
        }
        points.push(&row)?;
    }
    if points.len() < header.points {
        let got = format!("{} of {} points", points.len(), header.points);
        return Err(Error::invalid("rows", got, "the file is cut off, or its header has the wrong number"));
    }
    Ok(points)
}

/// Reads points whose fields begin at an offset and repeat with a stride.
fn read_binary(
    header: &Header,
    wanted: &Wanted,
    bytes: &[u8],
    at: impl Fn(&Field) -> (usize, usize),
    execution: &Execution,
) -> Result<Points> {
    let mut points = wanted.points(header.points)?;
    let column = |field: &Field| {
        let (start, step) = at(field);
        Column { to: field.to, scalar: field.scalar, start, step }
    };
    let columns = memory::collect(wanted.fields.iter().map(column))?;
    read_columns(&mut points, header.points, &columns, (bytes, ByteOrder::Little), execution)?;
    Ok(points)
}

/// Decompresses the columns: two lengths, then the data.
fn decompress(header: &Header, body: &[u8], execution: &Execution) -> Result<Vec<u8>> {
    let cut_off = || Error::invalid("compressed data", "the end of the file", "the file is cut off");
    let (lengths, packed) = body.split_at_checked(8).ok_or_else(cut_off)?;
    let length =
        |bytes: &[u8]| Scalar::U32.read(bytes, ByteOrder::Little).map_or(0, |number| number as usize);
    let (packed_size, plain_size) = (length(lengths), length(&lengths[4..]));
    let packed = packed.get(..packed_size).ok_or_else(cut_off)?;
    check_room("POINTS", header.points, header.row_bytes, plain_size)?;
    lzf::decompress(packed, plain_size, execution)
}

#[cfg(test)]
mod tests;
