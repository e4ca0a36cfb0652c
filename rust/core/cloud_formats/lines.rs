//! Lines of a text, and their words. Bytes that are not ASCII are ordinary characters.

use super::commas::{Commas, decimal};
use crate::error::{Error, Result};
use crate::execution::Execution;

/// Lines or words between two checks for an interruption.
const CHECK_EVERY: usize = 1024;

/// Longest excerpt of a file in an error.
const SHOWN: usize = 40;

/// Table of the bytes that separate words.
pub(super) type Separators = [bool; 256];

/// White space.
pub(super) const BLANKS: &Separators = &separators(b"");
/// White space, commas and semicolons.
pub(super) const COLUMNS: &Separators = &separators(b",;");
/// White space and semicolons: separators of numbers with decimal commas.
pub(super) const DECIMALS: &Separators = &separators(b";");
/// White space, and the backslash that joins two lines.
pub(super) const JOINED: &Separators = &separators(b"\\");

const fn separators(more: &[u8]) -> Separators {
    let mut table = [false; 256];
    let blanks = b" \t\r\n\x0b\x0c";
    let mut i = 0;
    while i < blanks.len() + more.len() {
        let byte = if i < blanks.len() { blanks[i] } else { more[i - blanks.len()] };
        table[byte as usize] = true;
        i += 1;
    }
    table
}

/// Lines of a text from a position on.
#[derive(Clone)]
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
    separators: &'static Separators,
    commas: Commas,
    execution: &'a Execution,
}

impl<'a> Lines<'a> {
    /// Lines of a file, without a UTF-8 byte order mark.
    pub fn new(content: &'a [u8], separators: &'static Separators, execution: &'a Execution) -> Self {
        let rest = content.strip_prefix(b"\xef\xbb\xbf").unwrap_or(content);
        Self { rest, number: 0, separators, commas: Commas::default(), execution }
    }

    /// The next line, even if it is empty.
    pub fn next_line(&mut self) -> Result<Option<Line<'a>>> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        self.number += 1;
        if self.number.is_multiple_of(CHECK_EVERY) {
            self.execution.check()?;
        }
        let (text, rest) = self.split();
        self.rest = rest;
        let Self { number, separators, execution, .. } = *self;
        Ok(Some(Line { text, number, words: 0, separators, is_decimal: false, execution }))
    }

    /// The next line with at least one word.
    pub fn next_with_words(&mut self, comments: &[&[u8]]) -> Result<Option<Line<'a>>> {
        while let Some(line) = self.next_line()? {
            let line = line.without(comments);
            if !line.is_blank() {
                return Ok(Some(line));
            }
        }
        Ok(None)
    }

    /// The next row of numbers, with separating or decimal commas.
    pub fn next_row(&mut self, comments: &[&[u8]]) -> Result<Option<Line<'a>>> {
        let Some(mut line) = self.next_with_words(comments)? else { return Ok(None) };
        if self.commas.are_decimal(&line)? {
            line.separators = DECIMALS;
            line.is_decimal = true;
        }
        Ok(Some(line))
    }

    /// The number of a field, which is separated by characters other than commas.
    pub fn number_of(&mut self, line: &Line, field: &[u8]) -> Result<f64> {
        self.commas.number_of(line, field)
    }

    fn split(&self) -> (&'a [u8], &'a [u8]) {
        let mut from = 0;
        while let Some(end) =
            self.rest.get(from..).and_then(|text| text.iter().position(|byte| *byte == b'\n'))
        {
            let end = from + end;
            let line = &self.rest[..end];
            let is_joined = self.separators[usize::from(b'\\')] && line.trim_ascii_end().ends_with(b"\\");
            if !is_joined {
                return (line, &self.rest[end + 1..]);
            }
            from = end + 1;
        }
        (self.rest, &[])
    }

    /// The next `bytes` bytes, of any value; `None` if there are fewer.
    pub fn take(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(bytes)?;
        self.rest = rest;
        Some(taken)
    }

    /// The part after the lines already read.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

/// One line, from the next word on.
#[derive(Clone)]
pub(super) struct Line<'a> {
    text: &'a [u8],
    /// Line number, from 1 on.
    pub number: usize,
    words: usize,
    separators: &'static Separators,
    /// Whether its commas are decimal marks.
    is_decimal: bool,
    execution: &'a Execution,
}

impl<'a> Line<'a> {
    /// The line up to the first comment, which begins with one of `comments`.
    pub fn without(mut self, comments: &[&[u8]]) -> Self {
        for comment in comments {
            if let Some(start) = find(self.text, comment) {
                self.text = &self.text[..start];
            }
        }
        self
    }

    /// The rest of the line.
    pub fn text(&self) -> &'a [u8] {
        self.text
    }

    pub fn is_blank(&self) -> bool {
        self.text.iter().all(|byte| self.separators[usize::from(*byte)])
    }

    /// Number of words left on the line.
    pub fn count_words(&self) -> Result<usize> {
        let (mut line, mut words) = (self.clone(), 0);
        while line.next_word()?.is_some() {
            words += 1;
        }
        Ok(words)
    }

    /// The next word.
    pub fn next_word(&mut self) -> Result<Option<&'a [u8]>> {
        let is_separator = |byte: &u8| self.separators[usize::from(*byte)];
        let Some(start) = self.text.iter().position(|byte| !is_separator(byte)) else {
            self.text = &[];
            return Ok(None);
        };
        let text = &self.text[start..];
        let end = text.iter().position(is_separator).unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.text = rest;
        self.words += 1;
        if self.words.is_multiple_of(CHECK_EVERY) {
            self.execution.check()?;
        }
        Ok(Some(word))
    }

    /// Parses the next word as a number.
    pub fn next_number(&mut self) -> Result<f64> {
        match self.next_word()? {
            Some(word) => self.number_of(word),
            None => Err(self.refuse("the end of the line", "a number belongs there")),
        }
    }

    /// Parses the next word as a count.
    pub fn next_count(&mut self) -> Result<usize> {
        match self.next_word()? {
            Some(word) => {
                count(word).ok_or_else(|| self.refuse(shown(word), "a whole number from 0 on belongs there"))
            }
            None => Err(self.refuse("the end of the line", "a whole number belongs there")),
        }
    }

    /// Parses a word of this line as a number.
    pub fn number_of(&self, word: &[u8]) -> Result<f64> {
        let found = if self.is_decimal { decimal(word) } else { number(word) };
        found.ok_or_else(|| self.refuse(shown(word), "a number belongs there"))
    }

    /// The error for a part of this line.
    pub fn refuse(&self, got: impl ToString, remedy: impl Into<String>) -> Error {
        Error::invalid(format!("line {}", self.number), got, remedy)
    }
}

/// Position of the first occurrence of a piece in a text.
fn find(text: &[u8], piece: &[u8]) -> Option<usize> {
    let first = piece.first()?;
    let mut from = 0;
    loop {
        let start = from + text.get(from..)?.iter().position(|byte| byte == first)?;
        if text[start..].starts_with(piece) {
            return Some(start);
        }
        from = start + 1;
    }
}

/// Parses a word as a number, rounded to the nearest.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    text.parse().ok().or_else(|| is_nan(text).then_some(f64::NAN))
}

/// Whether a word is NaN as written by some C libraries: nan(ind), -nan(snan).
fn is_nan(text: &str) -> bool {
    text.trim_start_matches(['+', '-']).get(..4).is_some_and(|start| start.eq_ignore_ascii_case("nan("))
}

/// Parses a word as a count.
pub(super) fn count(word: &[u8]) -> Option<usize> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// An excerpt of a file for an error: control characters are escaped, long ones truncated.
pub(super) fn shown(word: &[u8]) -> String {
    let text: String =
        String::from_utf8_lossy(word.get(..4 * SHOWN).unwrap_or(word)).chars().take(SHOWN).collect();
    format!("{text:?}")
}

/// Rejects a declared count if the file has fewer bytes than its items need at least.
pub(super) fn check_room(what: &str, count: usize, least: usize, bytes: usize) -> Result<()> {
    if count.checked_mul(least).is_some_and(|needed| needed <= bytes) {
        return Ok(());
    }
    let got = format!("{count} of at least {least} bytes each, in {bytes} bytes");
    Err(Error::invalid(what, got, "the file is cut off, or its count is wrong"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &[u8], separators: &'static Separators, comments: &[&[u8]]) -> Result<Vec<Vec<String>>> {
        let execution = Execution::default();
        let mut lines = Lines::new(text, separators, &execution);
        let mut found = Vec::new();
        while let Some(mut line) = lines.next_with_words(comments)? {
            let mut row = vec![line.number.to_string()];
            while let Some(word) = line.next_word()? {
                row.push(String::from_utf8_lossy(word).into_owned());
            }
            found.push(row);
        }
        Ok(found)
    }

    #[test]
    fn lines_are_words() -> Result<()> {
        let found = words(b"\xef\xbb\xbf a\tbc\r\n\n// no\nd,;e # f\n", COLUMNS, &[b"#", b"//"])?;
        assert_eq!(found, [vec!["1", "a", "bc"], vec!["4", "d", "e"]]);
        let found = words(b"a \\\r\n b\\\nc\nd\\", JOINED, &[])?;
        assert_eq!(found, [vec!["1", "a", "b", "c"], vec!["2", "d"]]);
        assert!(words(b"", BLANKS, &[])?.is_empty());
        Ok(())
    }

    #[test]
    fn numbers_are_rounded_to_the_nearest() {
        let cases: [(&[u8], f64); 6] = [
            (b"0.1", 0.1),
            (b"+1e-3", 1e-3),
            (b"5.", 5.0),
            (b"-.5", -0.5),
            (b"9007199254740993", 9_007_199_254_740_992.0),
            (b"-Inf", f64::NEG_INFINITY),
        ];
        for (word, value) in cases {
            assert_eq!(number(word), Some(value));
        }
        assert!(number(b"-nan(ind)").is_some_and(f64::is_nan));
        assert_eq!((number(b""), number(b"1,5"), number(b"\xff"), number(b"nano")), (None, None, None, None));
    }

    #[test]
    fn counts_must_fit_the_file() {
        assert!(check_room("points", 5, 2, 10).is_ok());
        assert!(check_room("points", 6, 2, 10).is_err());
        assert!(check_room("points", usize::MAX, 2, 10).is_err());
    }

    #[test]
    fn errors_show_little() {
        assert_eq!(shown(b"\x1b[2J\xff"), "\"\\u{1b}[2J\u{fffd}\"");
        assert!(shown(&[b'a'; 1000]).len() < 50);
    }
}
