//! VTK's legacy format, ASCII or binary: points of `POLYDATA`, `UNSTRUCTURED_GRID` and `STRUCTURED_GRID`, and
//! polygons of the first; other cells, and data of points and cells, are ignored. Binary numbers are
//! big-endian.

use super::cloud_content::{CloudContent, Points, Row};
use super::fans::{Fans, row_of};
use super::lines::{BLANKS, Line, Lines, check_room, shown};
use super::scalar::{ByteOrder, Scalar};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Numbers between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 16;

/// Parses the points and triangles of a file.
///
/// # Errors
/// [`Error::InvalidInput`] if the file is truncated or in another format, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let mut file = File::open(content, execution)?;
    let (mut points, mut fans) = (None, Fans::default());
    while let Some(mut line) = file.lines.next_with_words(&[])? {
        match line.next_word()?.unwrap_or_default().to_ascii_uppercase().as_slice() {
            b"DATASET" => check_dataset(&mut line)?,
            b"FIELD" => file.skip_fields(&mut line)?,
            b"METADATA" => while file.lines.next_line()?.is_some_and(|line| !line.is_blank()) {},
            b"DIMENSIONS" => {}
            b"POINTS" if points.is_none() => points = Some(file.points(&mut line)?),
            b"POLYGONS" => file.cells(&mut line, Some(&mut fans))?,
            b"VERTICES" | b"LINES" | b"TRIANGLE_STRIPS" => file.cells(&mut line, None)?,
            // Cells of a grid, and data, come last.
            _ if points.is_some() => break,
            word => return Err(line.refuse(shown(word), "POINTS belong there")),
        }
    }
    let points = points.ok_or_else(|| cut_off("POINTS"))?;
    let faces = fans.finish(points.len())?;
    points.finish(faces)
}

fn check_dataset(line: &mut Line) -> Result<()> {
    let kind = line.next_word()?.unwrap_or_default();
    match kind.to_ascii_uppercase().as_slice() {
        b"POLYDATA" | b"UNSTRUCTURED_GRID" | b"STRUCTURED_GRID" => Ok(()),
        _ => Err(line.refuse(shown(kind), "POLYDATA, UNSTRUCTURED_GRID and STRUCTURED_GRID are read")),
    }
}

fn cut_off(what: &str) -> Error {
    Error::invalid(what, "the end of the file", "the file is cut off, or no legacy VTK file")
}

struct File<'a> {
    lines: Lines<'a>,
    is_binary: bool,
    execution: &'a Execution,
}

impl<'a> File<'a> {
    /// Opens a file after its first three lines: version, title, and encoding.
    fn open(content: &'a [u8], execution: &'a Execution) -> Result<Self> {
        let mut lines = Lines::new(content, BLANKS, execution);
        let first = lines.next_line()?.ok_or_else(|| cut_off("header"))?;
        if !first.text().starts_with(b"# vtk DataFile") {
            return Err(first.refuse(shown(first.text()), "a legacy VTK file begins with # vtk DataFile"));
        }
        lines.next_line()?;
        let mut line = lines.next_line()?.ok_or_else(|| cut_off("header"))?;
        let word = line.next_word()?.unwrap_or_default();
        let is_binary = match word.to_ascii_uppercase().as_slice() {
            b"ASCII" => false,
            b"BINARY" => true,
            _ => return Err(line.refuse(shown(word), "ASCII or BINARY belongs there")),
        };
        Ok(Self { lines, is_binary, execution })
    }

    fn points(&mut self, line: &mut Line) -> Result<Points> {
        let count = line.next_count()?;
        let scalar = scalar_of(line)?;
        let numbers = self.numbers("POINTS", count.saturating_mul(3), scalar)?;
        let mut points = Points::with_capacity(count, false, None)?;
        for point in numbers.as_chunks::<3>().0 {
            let mut row: Row = [0.0; 10];
            row[..3].copy_from_slice(point);
            points.push(&row)?;
        }
        Ok(points)
    }

    /// Reads cells: each a count and that many points; or, since version 5.1, the start of each, and all
    /// points.
    fn cells(&mut self, line: &mut Line, mut fans: Option<&mut Fans>) -> Result<()> {
        let (first, second) = (line.next_count()?, line.next_count()?);
        let mut behind = self.lines.clone();
        let offsets = behind.next_line()?.filter(|line| line.text().starts_with(b"OFFSETS"));
        let Some(mut offsets) = offsets else {
            let numbers = self.numbers("cells", second, Scalar::I32)?;
            let mut rest = numbers.as_slice();
            for _ in 0..first {
                let (corners, others) = rest
                    .split_first()
                    .and_then(|(count, rest)| rest.split_at_checked(usize::try_from(row_of(*count)).ok()?))
                    .ok_or_else(|| line.refuse(second, "its cells have more numbers"))?;
                add(&mut fans, corners)?;
                rest = others;
            }
            return Ok(());
        };
        self.lines = behind;
        offsets.next_word()?;
        let starts = self.numbers("OFFSETS", first, scalar_of(&mut offsets)?)?;
        let mut name = self.lines.next_with_words(&[])?.ok_or_else(|| cut_off("CONNECTIVITY"))?;
        name.next_word()?;
        let corners = self.numbers("CONNECTIVITY", second, scalar_of(&mut name)?)?;
        for pair in starts.windows(2) {
            let place = |at: usize| usize::try_from(row_of(pair[at])).unwrap_or(usize::MAX);
            let cell = corners.get(place(0)..place(1));
            add(&mut fans, cell.ok_or_else(|| offsets.refuse(pair[1], "cells are parts of CONNECTIVITY"))?)?;
        }
        Ok(())
    }

    fn skip_fields(&mut self, line: &mut Line) -> Result<()> {
        line.next_word()?;
        for _ in 0..line.next_count()? {
            let mut field = self.lines.next_with_words(&[])?.ok_or_else(|| cut_off("FIELD"))?;
            field.next_word()?;
            let count = field.next_count()?.saturating_mul(field.next_count()?);
            self.numbers("FIELD", count, scalar_of(&mut field)?)?;
        }
        Ok(())
    }

    fn numbers(&mut self, what: &str, count: usize, scalar: Scalar) -> Result<Vec<f64>> {
        // Counts a separator after the last number.
        let least = if self.is_binary { scalar.size() } else { 2 };
        check_room(what, count, least, self.lines.rest().len() + 1)?;
        let mut numbers = memory::with_capacity(count)?;
        if self.is_binary {
            let bytes = self.lines.take(count * scalar.size()).ok_or_else(|| cut_off(what))?;
            for (i, number) in bytes.chunks_exact(scalar.size()).enumerate() {
                if i.is_multiple_of(CHECK_EVERY) {
                    self.execution.check()?;
                }
                numbers.push(scalar.read(number, ByteOrder::Big).unwrap_or(f64::NAN));
            }
        }
        while numbers.len() < count {
            let mut line = self.lines.next_with_words(&[])?.ok_or_else(|| cut_off(what))?;
            while let Some(word) = line.next_word()? {
                if numbers.len() == count {
                    return Err(line.refuse(shown(word), format!("{what} has {count} numbers")));
                }
                numbers.push(line.number_of(word)?);
            }
        }
        Ok(numbers)
    }
}

fn add(fans: &mut Option<&mut Fans>, corners: &[f64]) -> Result<()> {
    let Some(fans) = fans else { return Ok(()) };
    fans.begin();
    corners.iter().try_for_each(|corner| fans.corner(row_of(*corner)))
}

fn scalar_of(line: &mut Line) -> Result<Scalar> {
    let word = line.next_word()?.unwrap_or_default();
    Ok(match word.to_ascii_lowercase().as_slice() {
        b"char" => Scalar::I8,
        b"unsigned_char" => Scalar::U8,
        b"short" => Scalar::I16,
        b"unsigned_short" => Scalar::U16,
        b"int" => Scalar::I32,
        b"unsigned_int" => Scalar::U32,
        b"long" | b"vtkidtype" | b"vtktypeint64" => Scalar::I64,
        b"unsigned_long" | b"vtktypeuint64" => Scalar::U64,
        b"float" => Scalar::F32,
        b"double" => Scalar::F64,
        _ => return Err(line.refuse(shown(word), "a type of numbers belongs there, such as float")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "# vtk DataFile Version 3.0\nby hand\nASCII\nDATASET POLYDATA\n";

    fn read(content: &[u8]) -> Result<CloudContent> {
        parse(content, &Execution::default())
    }

    #[test]
    fn polygons_of_both_layouts_are_read() -> Result<()> {
        let points = "FIELD FieldData 1\nTIME 1 1 double\n0.5\nPOINTS 4 float\n0 0 0 1 0 0\n1 1 0\n0 1 0\nMETADATA\nINFORMATION 0\n\n";
        let old = "VERTICES 1 2\n1 0\nPOLYGONS 2 9\n4 0 1 2 3\n3 3 2 0\nPOINT_DATA 4\nSCALARS a float\n";
        let new = "POLYGONS 3 7\nOFFSETS vtktypeint64\n0 4 7\nCONNECTIVITY vtktypeint64\n0 1 2 3 3 2 0\n";
        for cells in [old, new] {
            let cloud = read(format!("{HEADER}{points}{cells}").as_bytes())?;
            assert_eq!(cloud.points, [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
            assert_eq!(cloud.faces, Some(vec![[0, 1, 2], [0, 2, 3], [3, 2, 0]]));
        }
        Ok(())
    }

    #[test]
    fn binary_numbers_are_big_endian() -> Result<()> {
        for (kind, bytes) in [
            ("double", [1.5_f64, -2.0, 3.0].map(f64::to_be_bytes).concat()),
            ("float", [1.5_f32, -2.0, 3.0].map(f32::to_be_bytes).concat()),
        ] {
            let header = HEADER.replace("ASCII", "BINARY").replace("POLYDATA", "UNSTRUCTURED_GRID");
            let mut content = format!("{header}POINTS 1 {kind}\n").into_bytes();
            content.extend(bytes);
            content.extend(b"\nCELLS 1 2\n\0\0\0\x01\0\0\0\0\n");
            assert_eq!(read(&content)?.points, [[1.5, -2.0, 3.0]]);
            let cut = content.len() - 24;
            assert!(read(&content[..cut]).is_err());
        }
        Ok(())
    }

    #[test]
    fn errors_name_the_fault() {
        for (content, says) in [
            (String::new(), "the end of the file"),
            ("<VTKFile>".into(), "line 1: got \"<VTKFile>\""),
            (HEADER.replace("POLYDATA", "RECTILINEAR_GRID"), "line 4: got \"RECTILINEAR_GRID\""),
            (HEADER.replace("ASCII", "HEX"), "line 3: got \"HEX\""),
            (HEADER.into(), "POINTS: got the end of the file"),
            (format!("{HEADER}POINTS 9 float\n0 0 0\n"), "POINTS: got 27 of at least 2 bytes"),
            (format!("{HEADER}POINTS 1 bit\n0 0 0\n"), "line 5: got \"bit\""),
            (format!("{HEADER}POINTS 1 float\n0 0 0 0\n"), "POINTS has 3 numbers"),
            (format!("{HEADER}POINTS 1 float\n0 0 0\nPOLYGONS 1 2\n3 0\n"), "its cells have more numbers"),
            (format!("{HEADER}POINTS 1 float\n0 0 0\nPOLYGONS 1 4\n3 0 0 1\n"), "names point 1"),
            (
                format!(
                    "{HEADER}POINTS 1 float\n0 0 0\nPOLYGONS 2 1\nOFFSETS int\n0 9\nCONNECTIVITY int\n0\n"
                ),
                "parts of",
            ),
            (format!("{HEADER}POINTS 18446744073709551615 float\n0 0 0\n"), "POINTS: got"),
        ] {
            let error =
                read(content.as_bytes()).map_or_else(|error| error.to_string(), |_| "nothing".to_string());
            assert!(error.contains(says), "{error}");
        }
    }
}
