//! The bytes of a file: chunks of GLB, buffers, and the numbers of accessors.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::super::e57::fill_with;
use super::super::scalar::{ByteOrder, Scalar};
use super::json::Json;
use super::scene::{Document, Growth, Kind, Part, refuse_extension};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

const JSON: u32 = 0x4e4f_534a;
const BINARY: u32 = 0x004e_4942;

/// Types of elements, and their numbers.
pub(super) const SINGLES: &[(&str, usize)] = &[("SCALAR", 1)];
pub(super) const TRIPLES: &[(&str, usize)] = &[("VEC3", 3)];
pub(super) const COLORS: &[(&str, usize)] = &[("VEC3", 3), ("VEC4", 4)];

pub(super) fn damaged(what: impl Into<String>, got: impl ToString) -> Error {
    Error::invalid(what, got, "the file is damaged")
}

/// The JSON of a file, and the binary chunk of GLB.
pub(super) fn split_chunks(content: &[u8]) -> Result<(&[u8], &[u8])> {
    if !content.starts_with(b"glTF") {
        return Ok((content.strip_prefix(b"\xef\xbb\xbf").unwrap_or(content), &[]));
    }
    let cut_off =
        |place: usize| damaged("GLB", format!("{} bytes, which end at byte {place}", content.len()));
    let word = |place: usize| {
        let bytes = content.get(place..).and_then(|rest| rest.first_chunk());
        bytes.map(|bytes| u32::from_le_bytes(*bytes)).ok_or_else(|| cut_off(place))
    };
    let (version, length) = (word(4)?, word(8)? as usize);
    if version != 2 || length > content.len() {
        let got = format!("version {version}, {} of {length} bytes", content.len());
        return Err(Error::invalid("GLB", got, "whole files of version 2 are read"));
    }
    let (mut text, mut binary): (&[u8], &[u8]) = (&[], &[]);
    let mut place = 12;
    while place < length {
        let (size, kind) = (word(place)? as usize, word(place + 4)?);
        let chunk = content
            .get(place + 8..length)
            .and_then(|rest| rest.get(..size))
            .ok_or_else(|| damaged("GLB", format!("a chunk of {size} bytes at byte {place} of {length}")))?;
        match kind {
            JSON if text.is_empty() => text = chunk,
            BINARY if binary.is_empty() => binary = chunk,
            _ => {}
        }
        place += 8 + size;
    }
    Ok((text, binary))
}

/// Rows of the buffers that parts need, which must not be compressed.
pub(super) fn needed_buffers(document: Document, parts: &[Part]) -> Result<Vec<usize>> {
    let accessors = document.list(Kind::Accessors)?;
    let mut is_needed = memory::filled(false, document.list(Kind::Buffers)?.len())?;
    for row in parts.iter().flat_map(Part::accessors) {
        let entry = &accessors[row];
        let sparse = entry.get("sparse")?;
        let places = [Some(entry), sparse.map(|sparse| sparse.need("indices")).transpose()?];
        let values = sparse.map(|sparse| sparse.need("values")).transpose()?;
        for place in places.into_iter().chain([values]).flatten() {
            if let Some(view) = place.get("bufferView")? {
                let view = document.entry(Kind::BufferViews, view)?.1;
                refuse_extension(view, "EXT_meshopt_compression", "meshopt")?;
                is_needed[document.entry(Kind::Buffers, view.need("buffer")?)?.0] = true;
            }
        }
    }
    memory::collect(is_needed.iter().enumerate().filter_map(|(row, is_needed)| is_needed.then_some(row)))
}

/// The address of a buffer that is neither in the file nor in its text.
pub(super) fn file_of<'a>(buffer: &'a Json) -> Result<Option<&'a str>> {
    match buffer.get("uri")? {
        Some(Json::Text(uri)) => Ok((!uri.starts_with("data:")).then_some(uri)),
        Some(other) => Err(Error::invalid("uri", other, "a string belongs there")),
        None => Ok(None),
    }
}

/// Numbers of accessors.
pub(super) struct Accessors<'a> {
    document: Document<'a>,
    buffers: Vec<Cow<'a, [u8]>>,
    growth: Growth,
    execution: &'a Execution,
}

/// Where an element of an accessor begins, and what it consists of.
struct Rows<'a> {
    bytes: &'a [u8],
    step: usize,
    scalar: Scalar,
    /// What the numbers are divided by, if they are shares.
    whole: Option<f64>,
}

impl Rows<'_> {
    /// The first numbers of an element.
    fn get<const N: usize>(&self, row: usize) -> [f64; N] {
        let size = self.scalar.size();
        let bytes = self.bytes.get(row * self.step..).unwrap_or_default();
        let read = |i: usize| self.scalar.read(bytes.get(i * size..)?, ByteOrder::Little);
        let numbers = std::array::from_fn(|i| read(i).unwrap_or_default());
        self.whole.map_or(numbers, |whole| numbers.map(|number: f64| (number / whole).max(-1.0)))
    }
}

impl<'a> Accessors<'a> {
    /// Takes the buffers that are needed: from the binary chunk, from the text, or from files.
    pub fn new(
        document: Document<'a>,
        needed: &[usize],
        binary: &'a [u8],
        files: &BTreeMap<&str, &'a [u8]>,
        growth: Growth,
        execution: &'a Execution,
    ) -> Result<Self> {
        let entries = document.list(Kind::Buffers)?;
        let mut buffers = memory::filled(Cow::Borrowed(&[][..]), entries.len())?;
        for &row in needed {
            execution.check()?;
            let (entry, name) = (&entries[row], format!("buffer {row}"));
            let content = match (file_of(entry)?, entry.get("uri")?) {
                (Some(file), _) => Cow::Borrowed(*files.get(file).ok_or_else(|| {
                    let remedy = "the content has no .bin file beside it; write GLB, with its buffer inside";
                    Error::invalid(&name, Json::Text(file.into()), remedy)
                })?),
                (None, Some(Json::Text(uri))) => {
                    let text = uri.split_once(";base64,").map_or("", |(_, text)| text);
                    Cow::Owned(decode_base64(&name, text.as_bytes(), execution)?)
                }
                _ => Cow::Borrowed(binary),
            };
            let length = entry.needed_count("byteLength")?;
            if content.len() < length {
                return Err(damaged(name, format!("{} of {length} bytes", content.len())));
            }
            buffers[row] = content;
        }
        Ok(Self { document, buffers, growth, execution })
    }

    /// Counts bytes of the result.
    pub fn grow(&mut self, more: usize) -> Result<()> {
        self.growth.add(more)
    }

    /// The elements of an accessor of one of some types: the first numbers of each.
    pub fn read<const N: usize>(&mut self, row: usize, types: &[(&str, usize)]) -> Result<Vec<[f64; N]>> {
        let entry = &self.document.list(Kind::Accessors)?[row];
        let (count, kind) = (entry.needed_count("count")?, entry.need("type")?);
        let name = format!("accessor {row}");
        let is_kind = |known: &str| matches!(kind, Json::Text(text) if text == known);
        let (_, width) = *types.iter().find(|(known, _)| is_kind(known)).ok_or_else(|| {
            let known: Vec<&str> = types.iter().map(|(known, _)| *known).collect();
            Error::invalid(&name, kind, format!("{} belongs there", known.join(" or ")))
        })?;
        self.grow(count.saturating_mul(width * size_of::<f64>()))?;
        let is_share = entry.get("normalized")? == Some(&Json::Flag(true));
        let mut values = if entry.get("bufferView")?.is_none() {
            memory::filled([0.0; N], count)?
        } else {
            let rows = self.rows(&name, entry, component_of(entry)?, [count, width], is_share)?;
            fill_with(count, self.execution, |i| rows.get(i))?
        };
        if let Some(sparse) = entry.get("sparse")? {
            let (some, places) = (sparse.needed_count("count")?, sparse.need("indices")?);
            self.grow(some.saturating_mul(width))?;
            let kind = component_of(places)?;
            if !matches!(kind, Scalar::U8 | Scalar::U16 | Scalar::U32) {
                return Err(Error::invalid(name, "indices with signs", "unsigned ones belong there"));
            }
            let places = self.rows(&name, places, kind, [some, 1], false)?;
            let from =
                self.rows(&name, sparse.need("values")?, component_of(entry)?, [some, width], is_share)?;
            for i in 0..some {
                let [place] = places.get(i);
                let slot = values.get_mut(place as usize);
                *slot.ok_or_else(|| damaged(&name, format!("row {place} of {count}")))? = from.get(i);
            }
        }
        Ok(values)
    }

    /// The rows of a part of a buffer: `count` elements of `width` numbers.
    fn rows(
        &self,
        name: &str,
        entry: &Json,
        scalar: Scalar,
        [count, width]: [usize; 2],
        is_share: bool,
    ) -> Result<Rows<'_>> {
        let view = self.document.entry(Kind::BufferViews, entry.need("bufferView")?)?.1;
        let buffer = self.document.entry(Kind::Buffers, view.need("buffer")?)?.0;
        let (start, length) = (view.count("byteOffset")?.unwrap_or(0), view.needed_count("byteLength")?);
        let content = self.buffers[buffer].get(start..).unwrap_or_default();
        let content = content.get(..length).unwrap_or(content);
        let size = width * scalar.size();
        let offset = entry.count("byteOffset")?.unwrap_or(0);
        let step = view.count("byteStride")?.filter(|step| *step > 0).unwrap_or(size);
        let needed = match count.checked_sub(1) {
            None => Some(0),
            Some(steps) => step.checked_mul(steps).and_then(|end| end.checked_add(offset)?.checked_add(size)),
        };
        if content.len() < length || needed.is_none_or(|needed| needed > length) {
            let got = format!("{count} rows from byte {offset} on in {} of {length} bytes", content.len());
            return Err(damaged(name, got));
        }
        let whole = if is_share { most(scalar) } else { None };
        Ok(Rows { bytes: content.get(offset..).unwrap_or_default(), step, scalar, whole })
    }
}

fn component_of(entry: &Json) -> Result<Scalar> {
    Ok(match entry.need("componentType")? {
        Json::Whole(5120) => Scalar::I8,
        Json::Whole(5121) => Scalar::U8,
        Json::Whole(5122) => Scalar::I16,
        Json::Whole(5123) => Scalar::U16,
        Json::Whole(5125) => Scalar::U32,
        Json::Whole(5126) => Scalar::F32,
        other => {
            return Err(Error::invalid("component type", other, "5120 to 5123, 5125 and 5126 are read"));
        }
    })
}

/// The greatest number of a type of integers.
fn most(scalar: Scalar) -> Option<f64> {
    match scalar {
        Scalar::I8 => Some(i8::MAX.into()),
        Scalar::U8 => Some(u8::MAX.into()),
        Scalar::I16 => Some(i16::MAX.into()),
        Scalar::U16 => Some(u16::MAX.into()),
        Scalar::U32 => Some(u32::MAX.into()),
        _ => None,
    }
}

/// Decodes base64, with or without the signs that fill the last group.
pub(super) fn decode_base64(name: &str, text: &[u8], execution: &Execution) -> Result<Vec<u8>> {
    let mut bytes = memory::with_capacity(text.len() / 4 * 3 + 3)?;
    let text = text.trim_ascii_end();
    let text = text.strip_suffix(b"==").or_else(|| text.strip_suffix(b"=")).unwrap_or(text);
    for part in text.chunks(1 << 14) {
        execution.check()?;
        for group in part.chunks(4) {
            let mut word = 0;
            for sign in group {
                let value = match sign {
                    b'A'..=b'Z' => sign - b'A',
                    b'a'..=b'z' => sign - b'a' + 26,
                    b'0'..=b'9' => sign - b'0' + 52,
                    b'+' => 62,
                    b'/' => 63,
                    _ => return Err(damaged(name, "a text that is not base64")),
                };
                word = word << 6 | u32::from(value);
            }
            let [_, decoded @ ..] = (word << (6 * (4 - group.len()))).to_be_bytes();
            bytes.extend_from_slice(&decoded[..group.len() * 6 / 8]);
        }
    }
    Ok(bytes)
}
