//! Files of COLMAP models, in text or binary: their rows of numbers, read and replaced; all other bytes stay.
//!
//! A row of images, frames and rigs is a pose, qw qx qy qz tx ty tz; one of points3D is x y z, red green blue
//! and an error. Files of cameras have none. See <https://colmap.github.io/format.html>.

use std::ops::Range;

use super::lines::{BLANKS, shown};
use super::rows::{number, write_number};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Numbers of a row.
pub const WIDTH: usize = 7;

/// Bytes of a number in a binary file.
const SIZE: usize = size_of::<f64>();

/// Two to the power of the most binary places of a number halfway between two of 17 digits, the most that a
/// shortest notation has: its 18 digits are a multiple of 5 to that power.
const MOST_OF_TIE: f64 = 33_554_432.0;

/// Content of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Cameras,
    Images,
    Points,
    Rigs,
    Frames,
}

/// Names of the files, without suffix.
const PARTS: [(&str, Part); 5] = [
    ("cameras", Part::Cameras),
    ("images", Part::Images),
    ("points3D", Part::Points),
    ("rigs", Part::Rigs),
    ("frames", Part::Frames),
];

impl Part {
    /// Numbers of a row that a move changes: the first ones.
    const fn moved(self) -> usize {
        match self {
            Self::Points => 3,
            _ => WIDTH,
        }
    }
}

/// Where a row of numbers is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    /// A byte: of the row in a binary file; in a text the first of its line, or the end of the row before it.
    start: usize,
    /// Words between that byte and the row.
    words: usize,
}

/// A file with its rows of numbers.
#[derive(Debug)]
pub struct File<C> {
    content: C,
    part: Part,
    is_text: bool,
    places: Vec<Place>,
    rows: Vec<[f64; WIDTH]>,
}

impl<C: AsRef<[u8]>> File<C> {
    /// Finds the numbers of a file, whose name is that of its part with the suffix `.bin` or `.txt`.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for another name or content, [`Error::OutOfMemory`], [`Error::Interrupted`].
    pub fn new(name: &str, content: C, execution: &Execution) -> Result<Self> {
        let (stem, suffix) = name.split_once('.').unwrap_or((name, ""));
        let part = PARTS.iter().find(|(known, _)| *known == stem).map(|(_, part)| *part);
        let is_text = suffix == "txt";
        let Some(part) = part.filter(|_| is_text || suffix == "bin") else {
            return Err(Error::invalid("name", shown(name.as_bytes()), "a part of a model, as .bin or .txt"));
        };
        let mut found = Found::default();
        match part {
            Part::Cameras => {}
            _ if is_text => found.read_text(part, content.as_ref(), execution)?,
            _ => found.read_binary(part, content.as_ref(), execution)?,
        }
        let Found { places, rows } = found;
        let is_color = |color: &f64| (0.0..256.0).contains(color);
        if part == Part::Points && !rows.iter().all(|row| row[3..6].iter().all(is_color)) {
            let got = "a colour that is not from 0 to 255";
            return Err(Error::invalid("points", got, "red, green and blue are bytes"));
        }
        Ok(Self { content, part, is_text, places, rows })
    }

    /// The content.
    pub fn content(&self) -> &C {
        &self.content
    }

    /// The rows of numbers, in the order of the file.
    pub fn rows(&self) -> &[[f64; WIDTH]] {
        &self.rows
    }

    /// The names of the images, none for other parts; invalid UTF-8 is replaced.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn image_names(&self) -> Result<Vec<String>> {
        let places = if self.part == Part::Images { self.places.as_slice() } else { &[] };
        memory::collect(places.iter().map(|place| {
            let name = self.image_name(place.start).unwrap_or_default();
            String::from_utf8_lossy(&self.content.as_ref()[name]).into_owned()
        }))
    }

    /// The place of the name of an image, behind its pose and camera.
    fn image_name(&self, start: usize) -> Option<Range<usize>> {
        let content = self.content.as_ref();
        if !self.is_text {
            let start = start + WIDTH * SIZE + 4;
            return Some(start..start + zero(content.get(start..)?)?);
        }
        let name = Words { text: content, at: start }.nth(1 + WIDTH + 1)?;
        let text = &content[name.start..line_end(content, name.start)];
        let blanks = text.iter().rev().take_while(|&&byte| is_blank(byte)).count();
        Some(name.start..name.start + text.len() - blanks)
    }

    /// The file with other positions of points, or other poses. In a text they are written as Python writes
    /// numbers, and one blank separates the words of a changed line up to the one after them.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for another count of numbers, [`Error::OutOfMemory`], [`Error::Interrupted`].
    pub fn replaced(&self, numbers: &[f64], execution: &Execution) -> Result<File<Vec<u8>>> {
        let moved = self.part.moved();
        if numbers.len() != self.rows.len() * moved {
            let got = format!("{} for {} rows", numbers.len(), self.rows.len());
            return Err(Error::invalid("numbers", got, format!("give {moved} for each")));
        }
        let mut rows = memory::copied(&self.rows)?;
        for (row, new) in rows.iter_mut().zip(numbers.chunks_exact(moved)) {
            row[..moved].copy_from_slice(new);
        }
        let (content, places) = if self.is_text {
            self.text_with(&rows, execution)?
        } else {
            (self.records_with(&rows, execution)?, memory::copied(&self.places)?)
        };
        Ok(File { content, part: self.part, is_text: self.is_text, places, rows })
    }

    fn records_with(&self, rows: &[[f64; WIDTH]], execution: &Execution) -> Result<Vec<u8>> {
        let mut content = memory::copied(self.content.as_ref())?;
        for (place, row) in self.places.iter().zip(rows) {
            execution.check()?;
            let bytes = content.get_mut(place.start..).ok_or_else(cut_off)?;
            for (bytes, number) in bytes.chunks_exact_mut(SIZE).zip(&row[..self.part.moved()]) {
                bytes.copy_from_slice(&number.to_le_bytes());
            }
        }
        Ok(content)
    }

    fn text_with(&self, rows: &[[f64; WIDTH]], execution: &Execution) -> Result<(Vec<u8>, Vec<Place>)> {
        let text = self.content.as_ref();
        let mut places = memory::with_capacity(rows.len())?;
        let mut out = memory::with_capacity(text.len() + 8 * rows.len())?;
        let mut done = 0;
        for (place, row) in self.places.iter().zip(rows) {
            execution.check()?;
            // A row before it on its line has taken the blanks.
            let start = place.start.max(done);
            memory::extend(&mut out, &text[done..start])?;
            memory::push(&mut places, Place { start: out.len(), words: place.words })?;
            let mut words = Words { text, at: start };
            for word in words.by_ref().take(place.words) {
                memory::extend(&mut out, &text[word])?;
                memory::push(&mut out, b' ')?;
            }
            for (column, number) in row[..self.part.moved()].iter().enumerate() {
                if column > 0 {
                    memory::push(&mut out, b' ')?;
                }
                write_as_python(&mut out, *number)?;
                words.next();
            }
            done = words.at;
            if let Some(word) = words.next() {
                memory::push(&mut out, b' ')?;
                done = word.start;
            }
        }
        memory::extend(&mut out, &text[done..])?;
        Ok((out, places))
    }
}

impl<C> File<C> {
    /// The file with its content in another form of the same bytes.
    pub fn map<D>(self, convert: impl FnOnce(C) -> D) -> File<D> {
        let Self { content, part, is_text, places, rows } = self;
        File { content: convert(content), part, is_text, places, rows }
    }
}

/// Rows of numbers that have been found.
#[derive(Default)]
struct Found {
    places: Vec<Place>,
    rows: Vec<[f64; WIDTH]>,
}

impl Found {
    fn push(&mut self, place: Place, row: [f64; WIDTH]) -> Result<()> {
        memory::push(&mut self.places, place)?;
        memory::push(&mut self.rows, row)
    }

    /// Reads a text: a line of each record that is neither blank nor a comment.
    fn read_text(&mut self, part: Part, text: &[u8], execution: &Execution) -> Result<()> {
        let mut next = 0;
        while next < text.len() {
            execution.check()?;
            let start = next;
            next = line_end(text, start) + 1;
            let first = Words { text, at: start }.next();
            if first.is_none_or(|word| text[word.start] == b'#') {
                continue;
            }
            match part {
                Part::Rigs => self.read_sensors(text, start, execution)?,
                Part::Frames => self.read_words(text, Place { start, words: 2 }).map(drop)?,
                _ => {
                    let mut words = self.read_words(text, Place { start, words: 1 })?;
                    if part == Part::Images {
                        if words.nth(1).is_none() {
                            let remedy = "its line has a number, seven of a pose, a camera and a name";
                            return Err(Error::invalid("images", "an image without a name", remedy));
                        }
                        // The line of its 2D points.
                        next = line_end(text, next) + 1;
                    }
                }
            }
        }
        Ok(())
    }

    /// Reads the line of a rig: four words of it and its first sensor; and of each other sensor its type, its
    /// number, whether it has a pose, and the pose.
    fn read_sensors(&mut self, text: &[u8], start: usize, execution: &Execution) -> Result<()> {
        let (mut words, mut place) = (Words { text, at: start }, Place { start, words: 4 });
        if words.nth(3).is_none() {
            return Ok(());
        }
        while words.next().is_some() {
            execution.check()?;
            let has_pose = words.nth(1).ok_or_else(no_word)?;
            place.words += 3;
            if &text[has_pose] == b"1" {
                words = self.read_words(text, place)?;
                place = Place { start: words.at, words: 0 };
            }
        }
        Ok(())
    }

    /// Reads the row at a place of a text; returns the words after it.
    fn read_words<'a>(&mut self, text: &'a [u8], place: Place) -> Result<Words<'a>> {
        let mut words = Words { text, at: place.start };
        words.by_ref().take(place.words).for_each(drop);
        let row = memory::try_map([(); WIDTH], |()| {
            let word = &text[words.next().ok_or_else(no_word)?];
            number(word).ok_or_else(|| Error::invalid("a word", shown(word), "a number belongs there"))
        })?;
        self.push(place, row)?;
        Ok(words)
    }

    /// Reads a binary file: the number of records, and these, the last of which ends the file.
    fn read_binary(&mut self, part: Part, content: &[u8], execution: &Execution) -> Result<()> {
        let mut bytes = Bytes { content, at: 0 };
        for _ in 0..bytes.integer(8)? {
            execution.check()?;
            self.read_record(part, &mut bytes, execution)?;
        }
        if bytes.at == content.len() {
            return Ok(());
        }
        let got = format!("{} bytes, but its records have {}", content.len(), bytes.at);
        Err(Error::invalid("file", got, "its first eight bytes are the number of records"))
    }

    fn read_record(&mut self, part: Part, bytes: &mut Bytes, execution: &Execution) -> Result<()> {
        bytes.take(if matches!(part, Part::Images | Part::Rigs) { 4 } else { 8 })?;
        let place = Place { start: bytes.at, words: 0 };
        match part {
            Part::Cameras => Ok(()),
            Part::Images => {
                self.push(place, bytes.pose()?)?;
                bytes.take(4)?;
                bytes.take(1 + zero(&bytes.content[bytes.at..]).ok_or_else(cut_off)? as u64)?;
                bytes.skip(8, 24)
            }
            Part::Points => {
                let [x, y, z] = memory::try_map([(); 3], |()| bytes.real())?;
                let [red, green, blue] =
                    memory::try_map([(); 3], |()| bytes.integer(1))?.map(|byte| byte as f64);
                self.push(place, [x, y, z, red, green, blue, bytes.real()?])?;
                bytes.skip(8, 8)
            }
            Part::Frames => {
                self.push(place, bytes.pose()?)?;
                bytes.skip(4, 16)
            }
            Part::Rigs => {
                let sensors = bytes.integer(4)?;
                bytes.take(8 * sensors.min(1))?;
                for _ in 1..sensors {
                    execution.check()?;
                    bytes.take(8)?;
                    if bytes.integer(1)? > 0 {
                        let place = Place { start: bytes.at, words: 0 };
                        self.push(place, bytes.pose()?)?;
                    }
                }
                Ok(())
            }
        }
    }
}

/// Places of words, from a byte on to the end of its line.
struct Words<'a> {
    text: &'a [u8],
    at: usize,
}

impl Iterator for Words<'_> {
    type Item = Range<usize>;

    fn next(&mut self) -> Option<Range<usize>> {
        let rest = self.text.get(self.at..)?;
        let blanks = rest.iter().take_while(|&&byte| is_blank(byte) && byte != b'\n').count();
        let length = rest[blanks..].iter().take_while(|&&byte| !is_blank(byte)).count();
        if length == 0 {
            return None;
        }
        let start = self.at + blanks;
        self.at = start + length;
        Some(start..self.at)
    }
}

/// A binary file, read from a byte on; numbers are little-endian.
struct Bytes<'a> {
    content: &'a [u8],
    at: usize,
}

impl<'a> Bytes<'a> {
    fn take(&mut self, count: u64) -> Result<&'a [u8]> {
        let end = usize::try_from(count).ok().and_then(|count| self.at.checked_add(count));
        let taken = end.and_then(|end| self.content.get(self.at..end)).ok_or_else(cut_off)?;
        self.at += taken.len();
        Ok(taken)
    }

    /// Skips items of a size, after their number.
    fn skip(&mut self, bytes_of_number: u64, size: u64) -> Result<()> {
        let count = self.integer(bytes_of_number)?;
        self.take(count.checked_mul(size).ok_or_else(cut_off)?).map(drop)
    }

    fn integer(&mut self, bytes: u64) -> Result<u64> {
        Ok(self.take(bytes)?.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte)))
    }

    fn real(&mut self) -> Result<f64> {
        self.integer(SIZE as u64).map(f64::from_bits)
    }

    fn pose(&mut self) -> Result<[f64; WIDTH]> {
        memory::try_map([(); WIDTH], |()| self.real())
    }
}

fn is_blank(byte: u8) -> bool {
    BLANKS[usize::from(byte)]
}

/// The end of the line of a byte, without the line break.
fn line_end(text: &[u8], from: usize) -> usize {
    let rest = text.get(from..).unwrap_or_default();
    rest.iter().position(|&byte| byte == b'\n').map_or(text.len(), |length| from + length)
}

/// The bytes before the first zero.
fn zero(bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&byte| byte == 0)
}

/// Appends a number as Python writes it: with a sign and two digits in the exponent, and the even one of two
/// shortest notations that are equally near.
fn write_as_python(out: &mut Vec<u8>, number: f64) -> Result<()> {
    let start = out.len();
    write_number(out, number)?;
    if let Some(even) = even_notation(&out[start..], number) {
        out.truncate(start);
        memory::extend(out, even.as_bytes())?;
    }
    if let Some(mark) = out[start..].iter().position(|&byte| byte == b'e') {
        let digits = start + mark + 1;
        if out[digits] != b'-' {
            out.insert(digits, b'+');
        }
        if out.len() == digits + 2 {
            out.insert(digits + 1, b'0');
        }
    }
    Ok(())
}

/// The nearest notation with as many decimals as the shortest one, the even one of two; `None` if the number
/// has too many binary places for a tie, or if it would be read as another number.
fn even_notation(shortest: &[u8], number: f64) -> Option<String> {
    if number.fract() == 0.0 || (number * MOST_OF_TIE).fract() != 0.0 {
        return None;
    }
    let point = shortest.iter().position(|&byte| byte == b'.')?;
    let decimals = shortest[point + 1..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let has_exponent = shortest.contains(&b'e');
    let even = if has_exponent { format!("{number:.decimals$e}") } else { format!("{number:.decimals$}") };
    (even.parse() == Ok(number)).then_some(even)
}

fn no_word() -> Error {
    Error::invalid("a line", "too few words", "numbers belong there")
}

fn cut_off() -> Error {
    Error::invalid("file", "the end of the file", "a record is longer")
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: [f64; WIDTH] = [1.0, 0.0, 0.0, 0.0, 0.5, -2.0, 1e-7];

    fn parsed<'a>(name: &str, content: &'a [u8]) -> Result<File<&'a [u8]>> {
        File::new(name, content, &Execution::default())
    }

    /// The content with twice the numbers that a move changes, and what is read of it.
    fn doubled(name: &str, content: &[u8]) -> Result<File<Vec<u8>>> {
        let (file, execution) = (parsed(name, content)?, Execution::default());
        let moved = file.part.moved();
        let twice: Vec<f64> = file.rows().iter().flat_map(|row| &row[..moved]).map(|x| 2.0 * x).collect();
        let changed = file.replaced(&twice, &execution)?;
        let read = parsed(name, changed.content())?;
        // NaN differs from itself.
        assert_eq!(format!("{:?}", read.rows()), format!("{:?}", changed.rows()));
        assert_eq!(read.image_names(), changed.image_names());
        let again = changed.replaced(&twice, &execution)?;
        assert_eq!(again.content(), changed.content());
        Ok(changed)
    }

    fn assert_doubled(name: &str, before: &str, after: &str) -> Result<()> {
        let changed = doubled(name, before.as_bytes())?;
        assert_eq!(String::from_utf8_lossy(changed.content()), after);
        Ok(())
    }

    fn binary(parts: &[&dyn AsRef<[u8]>]) -> Vec<u8> {
        parts.iter().flat_map(|part| part.as_ref().to_vec()).collect()
    }

    fn pose(factor: f64) -> Vec<u8> {
        POSE.iter().flat_map(|number| (factor * number).to_le_bytes()).collect()
    }

    #[test]
    fn lines_of_text_keep_their_other_words() -> Result<()> {
        let before = "# 1 2\r\n\n 7  0.5\t-1 1e-5  1 2 255 -1  3 4 \r\n8 5e15 nan -inf 0 0 0 0.25";
        let after = "# 1 2\r\n\n7 1.0 -2.0 2e-05 1 2 255 -1  3 4 \r\n8 1e+16 nan -inf 0 0 0 0.25";
        assert_doubled("points3D.txt", before, after)?;
        let before = "1 2 1 0 0 0 0.5 1 2 1 CAMERA 1  2\n";
        assert_doubled("frames.txt", before, "1 2 2.0 0.0 0.0 0.0 1.0 2.0 4.0 1 CAMERA 1  2\n")?;
        assert_doubled("cameras.txt", "1 PINHOLE  40 30 20 20 20 15\n", "1 PINHOLE  40 30 20 20 20 15\n")
    }

    #[test]
    fn images_have_two_lines_and_a_name() -> Result<()> {
        let before = "#\n1 1 0 0 0 0 0 4 1  a  b.png \r\n# 2D\n2 1 0 0 0 0 0 4 1 \u{b}c\n\n";
        let after = "#\n1 2.0 0.0 0.0 0.0 0.0 0.0 8.0 1  a  b.png \r\n# 2D\n2 2.0 0.0 0.0 0.0 0.0 0.0 8.0 1 \u{b}c\n\n";
        assert_doubled("images.txt", before, after)?;
        let names = parsed("images.txt", before.as_bytes())?.image_names()?;
        assert_eq!(names, ["a  b.png", "c"]);
        let unnamed = parsed("images.txt", b"1 1 0 0 0 0 0 4 1 \n\n").err().map(|error| error.to_string());
        assert!(unnamed.is_some_and(|text| text.contains("an image without a name")));
        Ok(())
    }

    #[test]
    fn a_line_of_a_rig_has_several_poses() -> Result<()> {
        let before =
            "1 4 CAMERA 1 CAMERA  2 1 1 0 0 0 1  2 3  IMU 3 0  IMU 4 1 1 0 0 0 4 5 6\r\n2 0\n3 1 IMU 1\n";
        let after = "1 4 CAMERA 1 CAMERA 2 1 2.0 0.0 0.0 0.0 2.0 4.0 6.0 IMU 3 0 IMU 4 1 \
                     2.0 0.0 0.0 0.0 8.0 10.0 12.0\r\n2 0\n3 1 IMU 1\n";
        assert_doubled("rigs.txt", before, after)?;
        assert_eq!(parsed("rigs.txt", before.as_bytes())?.rows().len(), 2);
        Ok(())
    }

    #[test]
    fn records_keep_their_other_bytes() -> Result<()> {
        let two = 2_u64.to_le_bytes();
        let images = |factor| {
            let first = binary(&[&[1; 4], &pose(factor), &[2; 4], b"a\xff\0", &two, &[3; 48]]);
            binary(&[&two, &first, &[1; 4], &pose(factor), &[2; 4], b"\0", &[0; 8]])
        };
        let changed = doubled("images.bin", &images(1.0))?;
        assert_eq!(
            (changed.content(), changed.image_names()?.join(",")),
            (&images(2.0), "a\u{fffd},".into())
        );
        let point = |factor: f64| {
            let place =
                binary(&[&factor.to_le_bytes(), &(-factor).to_le_bytes(), &(3.0 * factor).to_le_bytes()]);
            binary(&[
                &1_u64.to_le_bytes(),
                &[7; 8],
                &place,
                &[9, 0, 255],
                &0.5_f64.to_le_bytes(),
                &two,
                &[5; 16],
            ])
        };
        let changed = doubled("points3D.bin", &point(1.0))?;
        assert_eq!(
            (changed.content(), changed.rows()),
            (&point(2.0), &[[2.0, -2.0, 6.0, 9.0, 0.0, 255.0, 0.5]][..])
        );
        let frame =
            |factor| binary(&[&1_u64.to_le_bytes(), &[7; 8], &pose(factor), &2_u32.to_le_bytes(), &[5; 32]]);
        assert_eq!(doubled("frames.bin", &frame(1.0))?.content(), &frame(2.0));
        let rigs = |factor| {
            let second = binary(&[
                &[1; 4],
                &3_u32.to_le_bytes(),
                &[2; 8],
                &[3; 8],
                &[0],
                &[4; 8],
                &[1],
                &pose(factor),
            ]);
            binary(&[&two, &[1; 4], &[0; 4], &second])
        };
        assert_eq!(doubled("rigs.bin", &rigs(1.0))?.content(), &rigs(2.0));
        let files = [
            ("images.bin", images(1.0)),
            ("points3D.bin", point(1.0)),
            ("frames.bin", frame(1.0)),
            ("rigs.bin", rigs(1.0)),
        ];
        for (name, whole) in files {
            (0..whole.len()).for_each(|end| assert!(parsed(name, &whole[..end]).is_err(), "{name} {end}"));
            assert!(parsed(name, &binary(&[&whole, &[0]])).is_err());
        }
        Ok(())
    }

    #[test]
    fn counts_beyond_the_file_are_refused() {
        let many = u64::MAX.to_le_bytes();
        for name in ["images.bin", "points3D.bin", "frames.bin", "rigs.bin"] {
            assert!(parsed(name, &many).is_err() && parsed(name, b"").is_err());
            assert!(parsed(name, &[0; 9]).is_err() && parsed(name, &[0; 8]).is_ok());
        }
        for count in [u64::MAX, 1 << 61, 1 << 63, 1] {
            let record = binary(&[&1_u64.to_le_bytes(), &[0; 43], &count.to_le_bytes()]);
            assert!(parsed("points3D.bin", &record).is_err(), "{count}");
        }
    }

    #[test]
    fn other_content_is_refused() {
        let cases = [
            ("points3D.txt", "1 0 0 0 1 2 256 0"),
            ("points3D.txt", "1 0 0 0 nan 2 25 0"),
            ("points3D.txt", "1 0 0 0 1 2 3\n4 5 6 7 8"),
            ("points3D.txt", "1 0 0 x 1 2 3 4"),
            ("frames.txt", "1 2 1 0 0 0 0 0"),
            ("rigs.txt", "1 2 CAMERA 1 IMU 2"),
            ("rigs.txt", "1 2 CAMERA 1 IMU 2 1 1 0 0 0"),
            ("tracks.txt", ""),
            ("points3D.ply", ""),
            ("points3D", ""),
        ];
        for (name, text) in cases {
            assert!(parsed(name, text.as_bytes()).is_err(), "{name} {text}");
        }
        let file = parsed("points3D.txt", b"1 0 0 0 1 2 3 4");
        assert!(file.is_ok_and(|file| file.replaced(&[0.0; 7], &Execution::default()).is_err()));
        let stopped = Execution::default();
        stopped.interrupt();
        assert_eq!(File::new("rigs.txt", "1 0", &stopped).err(), Some(Error::Interrupted));
    }

    #[test]
    fn numbers_are_written_as_python_writes_them() -> Result<()> {
        let cases = [
            (1e-4, "0.0001"),
            (1.5e-5, "1.5e-05"),
            (-2e16, "-2e+16"),
            (1e15, "1000000000000000.0"),
            (1e100, "1e+100"),
            (5e-324, "5e-324"),
            (-0.0, "-0.0"),
            (0.1, "0.1"),
            (0.25, "0.25"),
            (1_719_262_359_720_241.0 + 0.25, "1719262359720241.2"),
            (-142_555_751_729_581.0 - 0.625, "-142555751729581.62"),
            (142_555_751_729_581.0 + 0.375, "142555751729581.38"),
            (8_388_609.0 + 2_f64.powi(-10), "8388609.000976562"),
            (3.0 * 2_f64.powi(-24), "1.7881393432617188e-07"),
            (2_f64.powi(-25), "2.9802322387695312e-08"),
            (2_f64.powi(-24), "5.960464477539063e-08"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "nan"),
        ];
        for (number, text) in cases {
            let mut out = b"e".to_vec();
            write_as_python(&mut out, number)?;
            assert_eq!(String::from_utf8_lossy(&out[1..]), text);
        }
        Ok(())
    }
}
