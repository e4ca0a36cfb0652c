//! Rows of numbers in a text, separated by white space, commas or semicolons; # and // start comments. Commas
//! between digits are decimal marks if white space or semicolons separate the numbers.

use super::lines::{COLUMNS, Line, Lines, check_room, count};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Starts of comments.
pub(super) const COMMENTS: &[&[u8]] = &[b"#", b"//"];

/// Numbers by rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Numbers per row, at least one.
    pub columns: usize,
    /// Concatenated rows.
    pub numbers: Vec<f64>,
}

/// Parses the numbers of a text whose rows have equal lengths.
///
/// # Errors
/// [`Error::InvalidInput`] if there are none, or other content, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<Table> {
    let mut lines = Lines::new(content, COLUMNS, execution);
    let mut numbers = Vec::new();
    let mut columns = None;
    while let Some(mut line) = lines.next_row(COMMENTS)? {
        let start = numbers.len();
        while let Some(word) = line.next_word()? {
            memory::push(&mut numbers, line.number_of(word)?)?;
        }
        check_columns(&line, numbers.len() - start, &mut columns)?;
    }
    match columns {
        Some(columns) => Ok(Table { columns, numbers }),
        None => Err(Error::invalid("text", "no numbers", "rows of numbers belong there")),
    }
}

/// Takes a first line that holds only the number of points.
pub(super) fn take_count(lines: &mut Lines) -> Result<Option<usize>> {
    let mut rows = lines.clone();
    let Some(mut line) = rows.next_with_words(COMMENTS)? else { return Ok(None) };
    let declared = line.next_word()?.and_then(count).filter(|_| line.is_blank());
    if declared.is_some() {
        *lines = rows;
    }
    // Counts a separator after the last number.
    check_room("points", declared.unwrap_or(0), 3 * 2, lines.rest().len() + 1)?;
    Ok(declared)
}

/// Rejects a number of points that differs from the declared one.
pub(super) fn check_count(declared: Option<usize>, found: usize) -> Result<()> {
    match declared.filter(|declared| *declared != found) {
        None => Ok(()),
        Some(declared) => {
            let got = format!("{found} of {declared} points");
            Err(Error::invalid("rows", got, "the file is cut off, or its first line is wrong"))
        }
    }
}

/// Rejects a row whose length differs from that of the first.
pub(super) fn check_columns(line: &Line, found: usize, columns: &mut Option<usize>) -> Result<()> {
    let expected = *columns.get_or_insert(found);
    if found == expected {
        return Ok(());
    }
    Err(line.refuse(format!("{found} columns"), format!("the first row has {expected}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separators_may_be_mixed() {
        let table = parse(b"// \xe9\n1, 2;\t3 # \xff\n\n 4 5 6//7\n", &Execution::default());
        assert_eq!(table, Ok(Table { columns: 3, numbers: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] }));
    }

    #[test]
    fn errors_name_the_fault() {
        for (content, says) in [
            ("# nothing\n", "no numbers"),
            ("1 2\n3\n", "line 2: got 1 columns; the first row has 2"),
            ("1 2\n3 x\n", "line 2: got \"x\""),
        ] {
            let found = parse(content.as_bytes(), &Execution::default());
            assert!(found.is_err_and(|error| error.to_string().contains(says)));
        }
    }
}
