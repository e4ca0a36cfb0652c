//! The rows behind a PLY header, in text and in binary.

use super::header::Property;
use crate::cloud_formats::lines::{Line, Lines};
use crate::cloud_formats::scalar::{ByteOrder, Scalar};
use crate::error::{Error, Result};

/// Where the numbers of rows come from.
pub(super) trait RowSource {
    /// Bytes that are left.
    fn room(&self) -> usize;

    /// Bytes that a property takes at least.
    fn least_bytes(&self, property: &Property) -> usize;

    /// Begins the next row.
    fn begin(&mut self) -> Result<()>;

    /// The next number of the row.
    fn number(&mut self, scalar: Scalar) -> Result<f64>;

    /// The next number of the row, which is the length of a list.
    fn length(&mut self, scalar: Scalar) -> Result<usize>;

    /// Leaves out a property.
    fn skip(&mut self, property: &Property) -> Result<()>;
}

/// A row on each line.
pub(super) struct TextRows<'a> {
    lines: Lines<'a>,
    line: Option<Line<'a>>,
}

impl<'a> TextRows<'a> {
    pub fn new(lines: Lines<'a>) -> Self {
        Self { lines, line: None }
    }

    fn line(&mut self) -> Result<&mut Line<'a>> {
        self.line.as_mut().ok_or_else(end_of_file)
    }
}

impl RowSource for TextRows<'_> {
    fn room(&self) -> usize {
        // As though the last number had a separator behind it.
        self.lines.rest().len() + 1
    }

    fn least_bytes(&self, _: &Property) -> usize {
        2
    }

    fn begin(&mut self) -> Result<()> {
        self.line = self.lines.next_with_words(&[])?;
        if self.line.is_none() { Err(end_of_file()) } else { Ok(()) }
    }

    fn number(&mut self, scalar: Scalar) -> Result<f64> {
        self.line()?.next_number().map(|number| scalar.hold(number))
    }

    fn length(&mut self, _: Scalar) -> Result<usize> {
        self.line()?.next_count()
    }

    fn skip(&mut self, property: &Property) -> Result<()> {
        let line = self.line()?;
        let numbers = if property.length.is_some() { line.next_count()? } else { 1 };
        for _ in 0..numbers {
            line.next_number()?;
        }
        Ok(())
    }
}

/// Rows without anything between them.
pub(super) struct BinaryRows<'a> {
    rest: &'a [u8],
    /// Where the file ends, counted in bytes.
    end: usize,
    order: ByteOrder,
}

impl<'a> BinaryRows<'a> {
    /// Rows from byte `start` of the file on.
    pub fn new(rest: &'a [u8], start: usize, order: ByteOrder) -> Self {
        Self { rest, end: start + rest.len(), order }
    }

    fn refuse(&self, got: impl ToString, remedy: &str) -> Error {
        Error::invalid(format!("byte {}", self.end - self.rest.len()), got, remedy)
    }
}

impl RowSource for BinaryRows<'_> {
    fn room(&self) -> usize {
        self.rest.len()
    }

    fn least_bytes(&self, property: &Property) -> usize {
        property.length.unwrap_or(property.scalar).size()
    }

    fn begin(&mut self) -> Result<()> {
        Ok(())
    }

    fn number(&mut self, scalar: Scalar) -> Result<f64> {
        let (Some(number), Some(rest)) = (scalar.read(self.rest, self.order), self.rest.get(scalar.size()..))
        else {
            return Err(end_of_file());
        };
        self.rest = rest;
        Ok(number)
    }

    fn length(&mut self, scalar: Scalar) -> Result<usize> {
        let number = self.number(scalar)?;
        if number >= 0.0 && number.fract() == 0.0 {
            return Ok(number as usize);
        }
        Err(self.refuse(number, "the length of a list belongs before it"))
    }

    fn skip(&mut self, property: &Property) -> Result<()> {
        let numbers = property.length.map_or(Ok(1), |scalar| self.length(scalar))?;
        let bytes = numbers.checked_mul(property.scalar.size());
        self.rest = bytes.and_then(|bytes| self.rest.get(bytes..)).ok_or_else(end_of_file)?;
        Ok(())
    }
}

fn end_of_file() -> Error {
    Error::invalid("rows", "the end of the file", "the header says that there are more")
}
