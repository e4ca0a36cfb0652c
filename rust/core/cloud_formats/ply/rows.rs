//! The rows after a PLY header, in text and in binary.

use super::header::{Element, Property};
use crate::cloud_formats::fans::row_of;
use crate::cloud_formats::lines::{Line, Lines};
use crate::cloud_formats::scalar::{ByteOrder, Scalar};
use crate::error::{Error, Result};
use crate::execution::Execution;

/// Corners of a polygon between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 16;

/// Source of the numbers of rows.
pub(super) trait RowSource {
    /// Number of bytes left.
    fn room(&self) -> usize;

    /// Least number of bytes per row.
    fn least_bytes(&self, element: &Element) -> usize;

    /// Takes all rows of an element at once, if they are bytes with a fixed layout.
    fn take_fixed(&mut self, element: &Element) -> Result<Option<(&[u8], ByteOrder)>>;

    /// Begins the next row.
    fn begin(&mut self) -> Result<()>;

    /// The next number of the row.
    fn number(&mut self, scalar: Scalar) -> Result<f64>;

    /// The next numbers of the row.
    fn numbers(&mut self, scalar: Scalar, count: usize, take: impl FnMut(f64) -> Result<()>) -> Result<()>;

    /// The next number of the row, as the length of a list.
    fn length(&mut self, scalar: Scalar) -> Result<usize>;

    /// Skips a property.
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
        // Counts a separator after the last number.
        self.lines.rest().len() + 1
    }

    fn least_bytes(&self, element: &Element) -> usize {
        2 * element.properties.len()
    }

    fn take_fixed(&mut self, _: &Element) -> Result<Option<(&[u8], ByteOrder)>> {
        Ok(None)
    }

    fn begin(&mut self) -> Result<()> {
        self.line = self.lines.next_with_words(&[])?;
        if self.line.is_none() { Err(end_of_file()) } else { Ok(()) }
    }

    fn number(&mut self, scalar: Scalar) -> Result<f64> {
        self.line()?.next_number().map(|number| scalar.hold(number))
    }

    fn numbers(
        &mut self,
        scalar: Scalar,
        count: usize,
        mut take: impl FnMut(f64) -> Result<()>,
    ) -> Result<()> {
        (0..count).try_for_each(|_| take(self.number(scalar)?))
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

/// Rows without separators.
pub(super) struct BinaryRows<'a> {
    rest: &'a [u8],
    /// End of the file, in bytes.
    end: usize,
    order: ByteOrder,
    execution: &'a Execution,
}

impl<'a> BinaryRows<'a> {
    /// Rows from byte `start` of the file on.
    pub fn new(rest: &'a [u8], start: usize, order: ByteOrder, execution: &'a Execution) -> Self {
        Self { rest, end: start + rest.len(), order, execution }
    }

    /// The next `count` bytes, if `count` is valid.
    fn take(&mut self, count: Option<usize>) -> Result<&'a [u8]> {
        let split = count.and_then(|count| self.rest.split_at_checked(count));
        let (taken, rest) = split.ok_or_else(end_of_file)?;
        self.rest = rest;
        Ok(taken)
    }

    fn refuse(&self, got: impl ToString, remedy: &str) -> Error {
        Error::invalid(format!("byte {}", self.end - self.rest.len()), got, remedy)
    }
}

impl RowSource for BinaryRows<'_> {
    fn room(&self) -> usize {
        self.rest.len()
    }

    fn least_bytes(&self, element: &Element) -> usize {
        element.row_bytes()
    }

    fn take_fixed(&mut self, element: &Element) -> Result<Option<(&[u8], ByteOrder)>> {
        if element.properties.iter().any(|property| property.length.is_some()) {
            return Ok(None);
        }
        Ok(Some((self.take(element.count.checked_mul(element.row_bytes()))?, self.order)))
    }

    fn begin(&mut self) -> Result<()> {
        Ok(())
    }

    fn number(&mut self, scalar: Scalar) -> Result<f64> {
        let bytes = self.take(Some(scalar.size()))?;
        scalar.read(bytes, self.order).ok_or_else(end_of_file)
    }

    fn numbers(
        &mut self,
        scalar: Scalar,
        count: usize,
        mut take: impl FnMut(f64) -> Result<()>,
    ) -> Result<()> {
        let bytes = self.take(count.checked_mul(scalar.size()))?;
        for done in 0..count {
            if done % CHECK_EVERY == CHECK_EVERY - 1 {
                self.execution.check()?;
            }
            let number = bytes.get(done * scalar.size()..).and_then(|rest| scalar.read(rest, self.order));
            take(number.ok_or_else(end_of_file)?)?;
        }
        Ok(())
    }

    fn length(&mut self, scalar: Scalar) -> Result<usize> {
        let number = self.number(scalar)?;
        usize::try_from(row_of(number))
            .map_err(|_| self.refuse(number, "the length of a list belongs before it"))
    }

    fn skip(&mut self, property: &Property) -> Result<()> {
        let numbers = property.length.map_or(Ok(1), |scalar| self.length(scalar))?;
        self.take(numbers.checked_mul(property.scalar.size()))?;
        Ok(())
    }
}

fn end_of_file() -> Error {
    Error::invalid("rows", "the end of the file", "the header declares more")
}
