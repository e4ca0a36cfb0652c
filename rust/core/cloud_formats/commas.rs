//! Commas in rows of numbers: separators, or decimal marks if white space or semicolons separate.

use super::lines::{DECIMALS, Line, shown};
use crate::error::{Error, Result};

/// Longest number with a decimal comma.
const LONGEST: usize = 64;

const AMBIGUOUS: &str = "its commas may be decimal ones, group digits or separate numbers; write decimal points, and digits without groups";

/// Number style of a text: the first line with decimal commas, and the first with decimal points or
/// separating commas.
#[derive(Clone, Copy, Default)]
pub(super) struct Commas {
    decimal: Option<usize>,
    other: Option<usize>,
}

impl Commas {
    /// Whether the commas of a row are decimal marks; an error if this is ambiguous.
    pub fn are_decimal(&mut self, line: &Line) -> Result<bool> {
        let text = line.text().trim_ascii();
        if !text.contains(&b',') {
            if (self.other.is_none() || self.decimal.is_some()) && text.contains(&b'.') {
                self.note(line, false)?;
            }
            return Ok(false);
        }
        let is_decimal = are_decimal(text).ok_or_else(|| line.refuse(shown(text), AMBIGUOUS))?;
        self.note(line, is_decimal)?;
        Ok(is_decimal)
    }

    /// The number of a field, which is separated by characters other than commas.
    pub fn number_of(&mut self, line: &Line, field: &[u8]) -> Result<f64> {
        match Part::of(field) {
            Part::Decimal => self.note(line, true)?,
            Part::Point => self.note(line, false)?,
            _ => return line.number_of(field),
        }
        decimal(field).ok_or_else(|| line.refuse(shown(field), "a number belongs there"))
    }

    fn note(&mut self, line: &Line, is_decimal: bool) -> Result<()> {
        let (own, other) =
            if is_decimal { (&mut self.decimal, self.other) } else { (&mut self.other, self.decimal) };
        own.get_or_insert(line.number);
        other.map_or(Ok(()), |first| Err(self.mixed(line, first)))
    }

    fn mixed(self, line: &Line, first: usize) -> Error {
        let (here, there) = if self.decimal == Some(first) {
            ("other numbers", "decimal commas")
        } else {
            ("decimal commas", "other numbers")
        };
        let remedy = format!("{here}, where line {first} has {there}; write decimal points throughout");
        line.refuse(shown(line.text().trim_ascii()), remedy)
    }
}

/// Whether the commas of a row are decimal marks; `None` if this is ambiguous.
fn are_decimal(row: &[u8]) -> Option<bool> {
    let mut parts =
        row.split(|byte| DECIMALS[usize::from(*byte)]).filter(|part| !part.is_empty()).map(Part::of);
    if !row.iter().any(|byte| DECIMALS[usize::from(*byte)]) {
        return (!has_fractions(row)).then_some(false);
    }
    let (mut decimals, mut others) = (false, false);
    for part in &mut parts {
        match part {
            Part::Plain => {}
            Part::Decimal => decimals = true,
            Part::Point | Part::List => others = true,
            Part::Grouped => return None,
        }
    }
    (!(decimals && others)).then_some(decimals)
}

/// Whether every second integer of a row may be the digits after a decimal comma: one begins with zeros.
fn has_fractions(row: &[u8]) -> bool {
    let fields = || row.split(|byte| *byte == b',');
    fields().count() >= 6
        && fields().count().is_multiple_of(2)
        && fields().all(|field| is_digits(unsigned(field)))
        && fields().skip(1).step_by(2).all(is_digits)
        && fields().skip(1).step_by(2).any(|field| field.len() > 1 && field.starts_with(b"0"))
}

/// A part of a row between white space and semicolons.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    /// Without a comma or point.
    Plain,
    /// With a point only.
    Point,
    /// One number, if its comma is a decimal mark: 1,5.
    Decimal,
    /// Several numbers.
    List,
    /// One number whose digits are grouped, or several: 1,234.5 or 1.234,5.
    Grouped,
}

impl Part {
    fn of(part: &[u8]) -> Self {
        let many = |mark: u8| part.split(|byte| *byte == mark).count() - 1;
        match (many(b','), many(b'.')) {
            (0, 0) => Self::Plain,
            (0, _) => Self::Point,
            (1, 0) if part.len() <= LONGEST && is_decimal(part) => Self::Decimal,
            (2.., 0) if is_grouped(part, b',') => Self::Grouped,
            (1.., 1) | (1, 1..)
                if is_grouped_before(part, b',', b'.') || is_grouped_before(part, b'.', b',') =>
            {
                Self::Grouped
            }
            _ => Self::List,
        }
    }
}

fn is_decimal(part: &[u8]) -> bool {
    let (whole, fraction) = split(unsigned(part), b',');
    let digits = fraction.split(|byte| matches!(byte, b'e' | b'E')).next().unwrap_or_default();
    is_digits(whole) && is_digits(digits)
}

/// Whether digits are grouped before a decimal mark.
fn is_grouped_before(part: &[u8], group: u8, mark: u8) -> bool {
    let (whole, fraction) = split(part, mark);
    whole.contains(&group) && is_grouped(whole, group) && is_digits(fraction)
}

/// Whether a mark separates digits into groups of three.
fn is_grouped(part: &[u8], group: u8) -> bool {
    let mut groups = unsigned(part).split(|byte| *byte == group);
    groups.next().is_some_and(|first| is_digits(first) && first.len() <= 3)
        && groups.all(|rest| is_digits(rest) && rest.len() == 3)
}

fn unsigned(part: &[u8]) -> &[u8] {
    part.strip_prefix(b"-").or_else(|| part.strip_prefix(b"+")).unwrap_or(part)
}

fn is_digits(part: &[u8]) -> bool {
    !part.is_empty() && part.iter().all(u8::is_ascii_digit)
}

/// Splits at the first mark.
fn split(part: &[u8], mark: u8) -> (&[u8], &[u8]) {
    let at = part.iter().position(|byte| *byte == mark).unwrap_or(part.len());
    (&part[..at], part.get(at + 1..).unwrap_or_default())
}

/// Parses a word with a decimal comma.
pub(super) fn decimal(word: &[u8]) -> Option<f64> {
    let mut text = [0; LONGEST];
    let text = text.get_mut(..word.len())?;
    text.copy_from_slice(word);
    text.iter_mut().filter(|byte| **byte == b',').for_each(|byte| *byte = b'.');
    super::lines::number(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_separators_make_commas_decimal() {
        for (row, is_decimal) in [
            ("1,2,3", false),
            ("1.5,2.5,-3.5e2", false),
            ("1, 2, 3", false),
            ("0.123, 0.456, 0.789", false),
            ("1 ,2.5 ,3", false),
            ("1,2,3 4,5,6", false),
            ("1,2,3;4,5,6", false),
            ("1.5,2.5 3.5,4.5", false),
            ("0.5,0,2 0,0,0,1", false),
            ("100,200,300,255,0,7", false),
            ("38,273800;53,216599;37,506200", true),
            ("-1,5\t2\t+3,25E-3", true),
            ("1,5 2,5 nan", true),
            ("1,234; 2,345;\t3,456 ;", true),
        ] {
            assert_eq!(are_decimal(row.as_bytes()), Some(is_decimal), "{row}");
        }
        for row in [
            "1,5, 2,5, 3,5",
            "1, 2,3",
            "1,5 2.5 3",
            "1,234.5;2,345.6;3,456.7",
            "1.234,5 2.345,6 3.456,7",
            "1,234,567 2,345,678 3",
            "38,0273,53,216599,37,506200",
        ] {
            assert_eq!(are_decimal(row.as_bytes()), None, "{row}");
        }
    }

    #[test]
    fn numbers_have_decimal_commas() {
        assert_eq!(
            (decimal(b"-38,25"), decimal(b"1,5e2"), decimal(b"7")),
            (Some(-38.25), Some(150.0), Some(7.0))
        );
        assert_eq!((decimal(b"1,2,3"), decimal(&[b'1'; 65])), (None, None));
    }
}
