//! The header of a PLY file.

use crate::cloud_formats::lines::{BLANKS, Line, Lines, shown};
use crate::cloud_formats::scalar::{ByteOrder, Scalar};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Declarations of a file.
pub(super) struct Header<'a> {
    pub body: Body,
    pub elements: Vec<Element<'a>>,
}

/// Encoding of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Body {
    Text,
    Binary(ByteOrder),
}

/// Rows of one kind.
pub(super) struct Element<'a> {
    pub name: &'a [u8],
    pub count: usize,
    pub properties: Vec<Property<'a>>,
}

/// A number of a row, or a list of numbers.
pub(super) struct Property<'a> {
    name: &'a [u8],
    pub scalar: Scalar,
    /// Type of the length, for a list.
    pub length: Option<Scalar>,
}

impl Element<'_> {
    /// Its name for an error.
    pub fn title(&self) -> String {
        shown(self.name)
    }

    /// Bytes of a row in binary; the minimum if there are lists.
    pub fn row_bytes(&self) -> usize {
        self.properties.iter().map(|property| property.length.unwrap_or(property.scalar).size()).sum()
    }

    /// Index of the property with that name, if it is a single number.
    pub fn scalar_place(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|each| each.length.is_none() && each.name == name.as_bytes())
    }

    /// Index of the first property of one number with one of some names, ignoring case.
    pub fn place_ignoring_case(&self, names: &[&str]) -> Option<usize> {
        let is_named = |name: &[u8]| names.iter().any(|known| name.eq_ignore_ascii_case(known.as_bytes()));
        self.properties.iter().position(|each| each.length.is_none() && is_named(each.name))
    }

    /// Index of the property that lists the corners of a face, which has several names.
    pub fn list_of_corners(&self) -> Option<usize> {
        if let [only] = self.properties.as_slice() {
            return only.length.map(|_| 0);
        }
        let is_named = |name: &[u8]| name == b"vertex_indices" || name == b"vertex_index";
        self.properties.iter().position(|each| each.length.is_some() && is_named(each.name))
    }
}

/// Reads the header; returns it with the lines after it.
pub(super) fn read<'a>(content: &'a [u8], execution: &'a Execution) -> Result<(Header<'a>, Lines<'a>)> {
    let mut lines = Lines::new(content, BLANKS, execution);
    let first = lines.next_line()?;
    if first.as_ref().is_none_or(|line| line.text().trim_ascii() != b"ply") {
        let got = first.map_or_else(String::new, |line| shown(line.text().trim_ascii()));
        return Err(Error::invalid("line 1", got, "a PLY file begins with the line ply"));
    }
    let mut body = None;
    let mut elements: Vec<Element<'a>> = Vec::new();
    while let Some(mut line) = lines.next_line()? {
        match line.next_word()? {
            Some(b"end_header") => {
                let Some(body) = body else {
                    return Err(Error::invalid(
                        "header",
                        "no line that begins with format",
                        "one has to be there",
                    ));
                };
                return Ok((Header { body, elements }, lines));
            }
            Some(b"format") => body = Some(read_format(&mut line)?),
            Some(b"element") => {
                let name = line.next_word()?.unwrap_or_default();
                let count = line.next_count()?;
                memory::push(&mut elements, Element { name, count, properties: Vec::new() })?;
            }
            Some(b"property") => {
                let Some(element) = elements.last_mut() else {
                    return Err(line.refuse("a property before any element", "elements have properties"));
                };
                memory::push(&mut element.properties, read_property(&mut line)?)?;
            }
            // Comments, obj_info and unknown lines.
            _ => {}
        }
    }
    Err(Error::invalid("header", "no line end_header", "the file is cut off"))
}

fn read_format(line: &mut Line) -> Result<Body> {
    match line.next_word()? {
        Some(b"ascii") => Ok(Body::Text),
        Some(b"binary_little_endian") => Ok(Body::Binary(ByteOrder::Little)),
        Some(b"binary_big_endian") => Ok(Body::Binary(ByteOrder::Big)),
        other => Err(line.refuse(
            shown(other.unwrap_or_default()),
            "formats are ascii, binary_little_endian and binary_big_endian",
        )),
    }
}

fn read_property<'a>(line: &mut Line<'a>) -> Result<Property<'a>> {
    let word = line.next_word()?.unwrap_or_default();
    let length = if word == b"list" { Some(read_scalar(line, None)?) } else { None };
    let scalar = read_scalar(line, length.is_none().then_some(word))?;
    Ok(Property { name: line.next_word()?.unwrap_or_default(), scalar, length })
}

/// The scalar type named by the given word, or else by the next.
fn read_scalar<'a>(line: &mut Line<'a>, word: Option<&'a [u8]>) -> Result<Scalar> {
    let word = match word {
        Some(word) => word,
        None => line.next_word()?.unwrap_or_default(),
    };
    Ok(match word {
        b"char" | b"int8" => Scalar::I8,
        b"uchar" | b"uint8" => Scalar::U8,
        b"short" | b"int16" => Scalar::I16,
        b"ushort" | b"uint16" => Scalar::U16,
        b"int" | b"int32" => Scalar::I32,
        b"uint" | b"uint32" => Scalar::U32,
        b"int64" => Scalar::I64,
        b"uint64" => Scalar::U64,
        b"float" | b"float32" => Scalar::F32,
        b"double" | b"float64" => Scalar::F64,
        _ => {
            return Err(
                line.refuse(shown(word), "types are char, uchar, short, ushort, int, uint, float, double")
            );
        }
    })
}
