//! The header of a PCD file.

use crate::cloud_formats::lines::{BLANKS, Line, Lines, count, number, shown};
use crate::cloud_formats::scalar::Scalar;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Declarations of a file.
pub(super) struct Header<'a> {
    pub body: Body,
    pub fields: Vec<Field<'a>>,
    pub points: usize,
    /// Numbers per point.
    pub row_words: usize,
    /// Bytes per point.
    pub row_bytes: usize,
    /// Position of the scanner.
    pub viewpoint: Option<[f64; 3]>,
}

/// Encoding of the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Body {
    Text,
    Binary,
    Compressed,
}

/// A number of every point, or several with one name.
pub(super) struct Field<'a> {
    pub name: &'a [u8],
    pub scalar: Scalar,
    pub count: usize,
}

impl Field<'_> {
    /// Whether the field has this name, ignoring case.
    pub fn is_called(&self, name: &str) -> bool {
        self.name.eq_ignore_ascii_case(name.as_bytes())
    }
}

/// The lines of a header, before they are combined.
#[derive(Default)]
struct Entries<'a> {
    names: Vec<&'a [u8]>,
    sizes: Vec<&'a [u8]>,
    types: Vec<&'a [u8]>,
    counts: Vec<&'a [u8]>,
    width: Option<usize>,
    height: Option<usize>,
    points: Option<usize>,
    viewpoint: Option<[f64; 3]>,
}

/// Reads the header; returns it with the lines after it.
pub(super) fn read<'a>(content: &'a [u8], execution: &'a Execution) -> Result<(Header<'a>, Lines<'a>)> {
    let mut lines = Lines::new(content, BLANKS, execution);
    let mut entries = Entries::default();
    while let Some(mut line) = lines.next_with_words(&[b"#"])? {
        let key = line.next_word()?.unwrap_or_default();
        match key.to_ascii_uppercase().as_slice() {
            b"FIELDS" | b"COLUMNS" => entries.names = words(&mut line)?,
            b"SIZE" => entries.sizes = words(&mut line)?,
            b"TYPE" => entries.types = words(&mut line)?,
            b"COUNT" => entries.counts = words(&mut line)?,
            b"WIDTH" => entries.width = Some(line.next_count()?),
            b"HEIGHT" => entries.height = Some(line.next_count()?),
            b"POINTS" => entries.points = Some(line.next_count()?),
            b"VIEWPOINT" => entries.viewpoint = place(&words(&mut line)?),
            b"DATA" => {
                let body = read_body(&mut line)?;
                return Ok((entries.finish(body)?, lines));
            }
            _ => {}
        }
    }
    Err(Error::invalid("header", "no line DATA", "the file is cut off, or no PCD file"))
}

fn read_body(line: &mut Line) -> Result<Body> {
    let word = line.next_word()?.unwrap_or_default();
    match word.to_ascii_lowercase().as_slice() {
        b"ascii" => Ok(Body::Text),
        b"binary" => Ok(Body::Binary),
        b"binary_compressed" => Ok(Body::Compressed),
        _ => Err(line.refuse(shown(word), "data are ascii, binary or binary_compressed")),
    }
}

/// The position of a viewpoint, `tx ty tz qw qx qy qz`. Writers without a viewpoint store the origin.
fn place(words: &[&[u8]]) -> Option<[f64; 3]> {
    let mut place = [0.0; 3];
    for (coordinate, word) in place.iter_mut().zip(words.get(..3)?) {
        *coordinate = number(word).filter(|number| number.is_finite())?;
    }
    (words.len() == 7 && place.iter().any(|x| *x != 0.0)).then_some(place)
}

fn words<'a>(line: &mut Line<'a>) -> Result<Vec<&'a [u8]>> {
    let mut found = Vec::new();
    while let Some(word) = line.next_word()? {
        memory::push(&mut found, word)?;
    }
    Ok(found)
}

impl<'a> Entries<'a> {
    fn finish(self, body: Body) -> Result<Header<'a>> {
        let Some(points) = self.points.or_else(|| self.width?.checked_mul(self.height.unwrap_or(1))) else {
            return Err(Error::invalid("header", "no number of points", "POINTS or WIDTH and HEIGHT say it"));
        };
        let mut fields = memory::with_capacity(self.names.len())?;
        for (place, name) in self.names.iter().copied().enumerate() {
            memory::push(&mut fields, self.field(place, name)?)?;
        }
        let words = fields.iter().try_fold(0_usize, |sum, field| sum.checked_add(field.count));
        let bytes = fields
            .iter()
            .try_fold(0_usize, |sum, field| sum.checked_add(field.count.checked_mul(field.scalar.size())?));
        let (Some(row_words), Some(row_bytes)) = (words, bytes) else {
            return Err(Error::invalid(
                "COUNT",
                "more numbers than a point can have",
                "the header is damaged",
            ));
        };
        Ok(Header { body, fields, points, row_words, row_bytes, viewpoint: self.viewpoint })
    }

    /// Combines a field's entries. The first version has neither sizes nor types, and not all files have
    /// counts.
    fn field(&self, place: usize, name: &'a [u8]) -> Result<Field<'a>> {
        let entry = |line: &str, words: &[&'a [u8]], default: &'static [u8]| match words.get(place) {
            Some(word) => Ok(*word),
            None if words.is_empty() => Ok(default),
            None => {
                Err(Error::invalid(line, format!("{} words", words.len()), "there is one for each field"))
            }
        };
        let (size, kind) = (entry("SIZE", &self.sizes, b"4")?, entry("TYPE", &self.types, b"F")?);
        let many = entry("COUNT", &self.counts, b"1")?;
        let Some(scalar) = scalar_of(kind, size) else {
            let got = format!("{} of SIZE {}", shown(kind), shown(size));
            return Err(Error::invalid(
                "TYPE",
                got,
                "types are F of size 4 or 8, I and U of size 1, 2, 4 or 8",
            ));
        };
        let Some(count) = count(many) else {
            return Err(Error::invalid("COUNT", shown(many), "whole numbers belong there"));
        };
        Ok(Field { name, scalar, count })
    }
}

fn scalar_of(kind: &[u8], size: &[u8]) -> Option<Scalar> {
    Some(match (kind, size) {
        (b"I", b"1") => Scalar::I8,
        (b"U", b"1") => Scalar::U8,
        (b"I", b"2") => Scalar::I16,
        (b"U", b"2") => Scalar::U16,
        (b"I", b"4") => Scalar::I32,
        (b"U", b"4") => Scalar::U32,
        (b"I", b"8") => Scalar::I64,
        (b"U", b"8") => Scalar::U64,
        (b"F", b"4") => Scalar::F32,
        (b"F", b"8") => Scalar::F64,
        _ => return None,
    })
}
