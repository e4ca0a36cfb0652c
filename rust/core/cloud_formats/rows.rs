//! Numbers in the lines of a text, read and replaced; all other bytes stay.

use std::io::Write as _;
use std::ops::Range;

use crate::error::{Error, Result};
use crate::memory;

/// Bytes that begin a comment.
const COMMENTS: [&[u8]; 2] = [b"#", b"//"];

/// Separators of columns, the first of which applies that gives enough columns; the last is white space.
const SEPARATORS: [Option<u8>; 4] = [Some(b';'), Some(b','), Some(b'\t'), None];

/// Numbers that a line of points has at least.
const LEAST_NUMBERS: usize = 3;

/// Longest excerpt of a line in an error.
const SHOWN: usize = 60;

/// The lines that begin with a word, or all lines for an empty word, and the columns of their numbers after it.
pub type Layout = (String, Vec<usize>);

/// Lines of a text, with the numbers in some columns.
#[derive(Debug)]
pub struct Rows {
    text: Vec<u8>,
    /// The place of each number, in the order of the text, its layout, and its index among the layout's.
    places: Vec<(Range<usize>, usize, usize)>,
    numbers: Vec<Vec<f64>>,
}

impl Rows {
    /// Reads the numbers of whole lines; white space separates columns without a separator. Blank lines,
    /// comments, and lines of one whole number, which is a count of points, have none.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a line without one of the numbers; [`Error::OutOfMemory`].
    pub fn new(text: Vec<u8>, layouts: &[Layout], separator: Option<u8>) -> Result<Self> {
        let mut numbers = memory::filled(Vec::new(), layouts.len())?;
        let (mut places, mut cells, mut start) = (Vec::new(), Vec::new(), 0);
        for line in text.split_inclusive(|&byte| byte == b'\n') {
            let first = start;
            start += line.len();
            if is_ignored(line) {
                continue;
            }
            let word = line.split(u8::is_ascii_whitespace).find(|word| !word.is_empty()).unwrap_or_default();
            let is_of = |(key, _): &Layout| key.is_empty() || word.eq_ignore_ascii_case(key.as_bytes());
            let Some(of) = layouts.iter().position(is_of) else { continue };
            let (key, columns) = &layouts[of];
            split(line, separator, &mut cells)?;
            if key.is_empty() && cells.len() == 1 && line[cells[0].clone()].iter().all(u8::is_ascii_digit) {
                continue;
            }
            let begin = places.len();
            for column in columns {
                let cell = cells.get(column + usize::from(!key.is_empty())).cloned();
                let number = cell.as_ref().and_then(|cell| number(&line[cell.clone()]));
                let (Some(cell), Some(number)) = (cell, number) else { return Err(no_numbers(line)) };
                memory::push(&mut places, (first + cell.start..first + cell.end, of, numbers[of].len()))?;
                memory::push(&mut numbers[of], number)?;
            }
            places[begin..].sort_unstable_by_key(|(place, ..)| place.start);
        }
        Ok(Self { text, places, numbers })
    }

    /// The numbers of the lines of each layout, in the order of its columns.
    #[must_use]
    pub fn numbers(&self) -> &[Vec<f64>] {
        &self.numbers
    }

    /// The text with other numbers, in the shortest notation that is read as the same number.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for another count of numbers; [`Error::OutOfMemory`].
    pub fn replaced(&self, numbers: &[Vec<f64>]) -> Result<Vec<u8>> {
        if !self.numbers.iter().map(Vec::len).eq(numbers.iter().map(Vec::len)) {
            return Err(Error::invalid("numbers", "another count than in the text", "give one for each"));
        }
        let mut out = memory::with_capacity(self.text.len() + 8 * self.places.len())?;
        let mut done = 0;
        for (place, of, index) in &self.places {
            memory::extend(&mut out, &self.text[done..place.start])?;
            done = place.end;
            write_number(&mut out, numbers[*of][*index])?;
        }
        memory::extend(&mut out, &self.text[done..])?;
        Ok(out)
    }
}

/// The separator and the words of a line, and whether it is a comment, whose mark is left out: of the first
/// separator that gives columns x, y and z, or three numbers, also with decimal commas. Words are without quotes;
/// none if no separator does.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn columns_of(line: &[u8]) -> Result<(Option<u8>, Vec<String>, bool)> {
    let line = line.trim_ascii_start();
    let is_comment = COMMENTS.iter().any(|comment| line.starts_with(comment));
    let marks = line.iter().take_while(|byte| b"#/ ".contains(byte)).count();
    let line = if is_comment { &line[marks..] } else { line };
    let mut cells = Vec::new();
    for separator in SEPARATORS {
        split(line, separator, &mut cells)?;
        let text = |cell: &Range<usize>| String::from_utf8_lossy(&line[cell.clone()]).into_owned();
        let words = memory::collect(cells.iter().map(|cell| text(cell).trim_matches('"').to_owned()))?;
        let is_number =
            |word: &&String| word.parse::<f64>().is_ok() || word.replace(',', ".").parse::<f64>().is_ok();
        let is_named = |axis: &&str| words.iter().any(|word| word.eq_ignore_ascii_case(axis));
        if words.iter().filter(is_number).count() >= LEAST_NUMBERS || ["x", "y", "z"].iter().all(is_named) {
            split(line, None, &mut cells)?;
            // White space around tabs may differ between lines.
            let is_blank = separator == Some(b'\t') && cells.len() == words.len();
            return Ok((separator.filter(|_| !is_blank), words, is_comment));
        }
    }
    Ok((None, Vec::new(), is_comment))
}

/// Whether a line is blank or a comment.
fn is_ignored(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    line.is_empty() || COMMENTS.iter().any(|comment| line.starts_with(comment))
}

/// The places of the cells of a line, without white space around them. A cell that begins with a quote ends at
/// the next one.
fn split(line: &[u8], separator: Option<u8>, cells: &mut Vec<Range<usize>>) -> Result<()> {
    let is_end = |byte: u8| separator.map_or(byte.is_ascii_whitespace(), |separator| byte == separator);
    let end = line.trim_ascii_end().len();
    let mut at = 0;
    cells.clear();
    loop {
        let blank = |&&byte: &&u8| byte.is_ascii_whitespace() && Some(byte) != separator;
        at += line[at..end].iter().take_while(blank).count();
        if at == end && (separator.is_none() || cells.is_empty()) {
            return Ok(());
        }
        let mut stop = at;
        if line[at..end].first() == Some(&b'"') {
            let quoted = line[at + 1..end].iter().position(|&byte| byte == b'"');
            stop = quoted.map_or(at, |length| at + 1 + length);
        }
        stop += line[stop..end].iter().take_while(|&&byte| !is_end(byte)).count();
        memory::push(cells, at..at + line[at..stop].trim_ascii_end().len())?;
        if stop == end {
            return Ok(());
        }
        at = stop + usize::from(separator.is_some());
    }
}

/// Parses a word as a number.
pub(super) fn number(cell: &[u8]) -> Option<f64> {
    std::str::from_utf8(cell).ok()?.parse().ok()
}

/// Appends a number in the shortest notation that is read as the same number.
pub(super) fn write_number(out: &mut Vec<u8>, number: f64) -> Result<()> {
    memory::reserve(out, 32)?;
    let written = if number.is_nan() { write!(out, "nan") } else { write!(out, "{number:?}") };
    written.map_err(|error| Error::invalid("numbers", error, "write fewer"))
}

fn no_numbers(line: &[u8]) -> Error {
    let text = String::from_utf8_lossy(line.trim_ascii());
    let shown: String = text.chars().take(SHOWN).collect();
    Error::invalid(
        "a line",
        format!("{shown:?}"),
        "numbers with decimal points belong there, separated as in the first line",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const XYZ: [usize; 3] = [0, 1, 2];

    fn doubled(text: &str, layouts: &[(&str, &[usize])], separator: Option<u8>) -> Result<String> {
        let layouts: Vec<Layout> =
            layouts.iter().map(|&(key, columns)| (key.to_owned(), columns.to_vec())).collect();
        let rows = Rows::new(text.as_bytes().to_vec(), &layouts, separator)?;
        let twice: Vec<Vec<f64>> = rows
            .numbers()
            .iter()
            .map(|numbers| numbers.iter().map(|number| 2.0 * number).collect())
            .collect();
        Ok(String::from_utf8_lossy(&rows.replaced(&twice)?).into_owned())
    }

    #[test]
    fn other_words_and_white_space_stay() -> Result<()> {
        let text = "# 1 2 3\n\n 7\n1\t 2  3 wall,north\r\n  4e1 .5 -6 \"a b\"\n";
        let moved = "# 1 2 3\n\n 7\n2.0\t 4.0  6.0 wall,north\r\n  80.0 1.0 -12.0 \"a b\"\n";
        assert_eq!(doubled(text, &[("", &XYZ)], None)?, moved);
        assert_eq!(doubled("", &[("", &XYZ)], None)?, "");
        assert_eq!(doubled("nan inf 1", &[("", &XYZ)], None)?, "nan inf 2.0");
        Ok(())
    }

    #[test]
    fn quoted_separators_and_empty_cells_are_cells() -> Result<()> {
        let text = "\"a,1,2,3\",5, 6 ,,7\n,1,2,,3\n";
        assert_eq!(
            doubled(text, &[("", &[4, 1, 2])], Some(b','))?,
            "\"a,1,2,3\",10.0, 12.0 ,,14.0\n,2.0,4.0,,6.0\n"
        );
        assert_eq!(doubled("a b\t1\t2", &[("", &[2, 1])], Some(b'\t'))?, "a b\t2.0\t4.0");
        Ok(())
    }

    #[test]
    fn keys_choose_lines_in_any_case() -> Result<()> {
        let text = "SOLID a\n FACET normal 0 0 1\nvertex 1 2 3\nVertex 4 5 6\n";
        let moved = "SOLID a\n FACET normal 0.0 0.0 2.0\nvertex 2.0 4.0 6.0\nVertex 8.0 10.0 12.0\n";
        assert_eq!(doubled(text, &[("vertex", &XYZ), ("facet", &[1, 2, 3])], None)?, moved);
        Ok(())
    }

    #[test]
    fn lines_without_their_numbers_are_refused() {
        for (text, separator) in
            [("1 2\n", None), ("1 2 3\n4,5,6\n", None), ("1,5;2;3", Some(b';')), ("\"1", None)]
        {
            assert!(doubled(text, &[("", &XYZ)], separator).is_err(), "{text}");
        }
        let rows = Rows::new(b"1 2 3".to_vec(), &[(String::new(), XYZ.to_vec())], None);
        assert!(rows.is_ok_and(|rows| rows.replaced(&[vec![1.0]]).is_err()));
    }

    #[test]
    fn the_separator_is_the_first_that_gives_columns() -> Result<()> {
        let cases: [(&str, Option<u8>, usize); 12] = [
            ("x y z label", None, 4),
            ("# \"X\",Y,z", Some(b','), 3),
            ("1 2 3 wall,north", None, 4),
            ("1,2,3", Some(b','), 3),
            ("1.5;2;3;a,b", Some(b';'), 4),
            ("0\t0 0", None, 3),
            ("a b\t1\t2\t3", Some(b'\t'), 4),
            ("1\t 2\t3", None, 3),
            ("1,5;2,5;3,5", Some(b';'), 3),
            ("1,5 2,5 3,5 4", None, 4),
            ("wall a b", None, 0),
            ("", None, 0),
        ];
        for (line, separator, count) in cases {
            let (found, words, is_comment) = columns_of(line.as_bytes())?;
            assert_eq!(is_comment, line.starts_with('#'));
            assert_eq!((found, words.len()), (separator, count), "{line}");
        }
        assert_eq!(columns_of(b"\xe0 1 2 3")?.1.len(), 4);
        Ok(())
    }
}
