//! PTX, the text format of Leica's terrestrial scanners: for each scan its numbers of columns and rows, the
//! scanner's position and axes, a matrix, and a line for each point of the grid: x y z, an intensity, and a
//! colour or none.
//!
//! Points are in the scanner's own frame, and the matrix moves them to the file's frame; row vectors, p' = p
//! M. It moves the origin to the scanner's position; the lines of the position may be in another frame and
//! are ignored. A point 0 0 0 is a direction without a return.

use super::cloud_content::CloudContent;
use super::lines::{COLUMNS, Line, Lines, check_room, shown};
use super::table::{COMMENTS, check_columns};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Lines of the scanner's position and axes.
const AXES: usize = 4;

/// Parses the points, intensities and colours of all scans in one frame, NaN without a return; the scanner's position if
/// there is one scan.
///
/// # Errors
/// [`Error::InvalidInput`] if the file is truncated or in another format, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let mut lines = Lines::new(content, COLUMNS, execution);
    let (colors, intensities) = (Some(Vec::new()), Some(Vec::new()));
    let mut cloud = CloudContent { colors, intensities, ..CloudContent::default() };
    let mut places = Vec::new();
    while let Some(line) = lines.next_row(COMMENTS)? {
        memory::push(&mut places, read_scan(line, &mut lines, &mut cloud)?)?;
    }
    let is_first = |place: &[f64; 3]| {
        Some(place.map(f64::to_bits)) == places.first().map(|place| place.map(f64::to_bits))
    };
    cloud.viewpoint = places.first().copied().filter(|_| places.iter().all(is_first));
    Ok(cloud)
}

/// Adds the points of a scan that begins with a line, and returns the scanner's position.
fn read_scan(first: Line, lines: &mut Lines, cloud: &mut CloudContent) -> Result<[f64; 3]> {
    let count = only_count(first)?.saturating_mul(only_count(next(lines)?)?);
    for _ in 0..AXES {
        numbers::<3>(next(lines)?)?;
    }
    let mut matrix = [[0.0; 3]; 4];
    for (row, weight) in matrix.iter_mut().zip([0.0, 0.0, 0.0, 1.0]) {
        let line = next(lines)?;
        let [x, y, z, last] = numbers(line.clone())?;
        if last - weight != 0.0 {
            return Err(
                line.refuse(last, format!("the matrix has {weight} there, and its translation below"))
            );
        }
        *row = [x, y, z];
    }
    check_room("points", count, 4 * 2, lines.rest().len() + 1)?;
    memory::reserve(&mut cloud.points, count)?;
    let mut columns = None;
    for _ in 0..count {
        let line = next(lines)?;
        check_columns(&line, line.count_words()?, &mut columns)?;
        let (point, intensity, color) = match columns {
            Some(7) => {
                let [x, y, z, intensity, red, green, blue] = numbers(line)?;
                ([x, y, z], intensity, Some([red, green, blue]))
            }
            Some(4) => {
                let [x, y, z, intensity] = numbers(line)?;
                ([x, y, z], intensity, None)
            }
            _ => {
                let got = format!("{} columns", line.count_words()?);
                return Err(line.refuse(got, "points have 4 or 7: x y z i [r g b]"));
            }
        };
        memory::push(
            &mut cloud.points,
            if point.iter().all(|x| *x == 0.0) { [f64::NAN; 3] } else { moved(point, &matrix) },
        )?;
        memory::push(cloud.intensities.get_or_insert_default(), intensity as f32)?;
        match (&mut cloud.colors, color) {
            // A cast of a number out of range gives the nearest byte.
            (Some(colors), Some(color)) => memory::push(colors, color.map(|value| value as u8))?,
            (colors, _) => *colors = None,
        }
    }
    Ok(matrix[3])
}

fn next<'a>(lines: &mut Lines<'a>) -> Result<Line<'a>> {
    let line = lines.next_row(COMMENTS)?;
    line.ok_or_else(|| {
        Error::invalid("rows", "the end of the file", "the file is cut off, or its count is wrong")
    })
}

/// Parses a line of a single count.
fn only_count(mut line: Line) -> Result<usize> {
    let count = line.next_count()?;
    if line.is_blank() {
        return Ok(count);
    }
    Err(line.refuse(shown(line.text()), "a scan begins with its number of columns, then that of rows"))
}

/// Parses a line of `N` numbers.
fn numbers<const N: usize>(mut line: Line) -> Result<[f64; N]> {
    check_columns(&line, line.count_words()?, &mut Some(N))?;
    let mut found = [0.0; N];
    for number in &mut found {
        *number = line.next_number()?;
    }
    Ok(found)
}

/// A row vector times rotation and translation.
fn moved([x, y, z]: [f64; 3], matrix: &[[f64; 3]; 4]) -> [f64; 3] {
    [0, 1, 2].map(|i| x * matrix[0][i] + y * matrix[1][i] + z * matrix[2][i] + matrix[3][i])
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n";

    fn read(content: &str) -> Result<CloudContent> {
        parse(content.as_bytes(), &Execution::default())
    }

    #[test]
    fn scans_are_moved_to_one_frame() -> Result<()> {
        let scan = format!("1\n2\n{HEAD}1 2 3 .5 0 1 300\n0 0 0 0 0 0 0\n");
        let cloud = read(&scan)?;
        assert_eq!(cloud.points.first(), Some(&[8.0, 21.0, 33.0]));
        assert!(cloud.points[1].iter().all(|x| x.is_nan()));
        assert_eq!(cloud.viewpoint, Some([10.0, 20.0, 30.0]));
        assert_eq!(cloud.colors, Some(vec![[0, 1, 255], [0, 0, 0]]));
        assert_eq!(cloud.intensities, Some(vec![0.5, 0.0]));
        assert_eq!(read(&scan.repeat(2))?.viewpoint, cloud.viewpoint);
        let both = read(&format!("{scan}1\r\n1\r\n{}1 0 0 .5", HEAD.replace("10 20 30", "0 0 0")))?;
        assert_eq!(both.points.get(2), Some(&[0.0, 1.0, 0.0]));
        assert_eq!((both.viewpoint, both.colors), (None, None));
        Ok(())
    }

    #[test]
    fn errors_name_the_fault() {
        for (content, says) in [
            (format!("2\n1\n{HEAD}1 2 3 4\n"), "points: got 2 of at least 8 bytes"),
            (format!("2\n1\n{HEAD}1 2 3 4.000000000\n"), "the end of the file"),
            (format!("18446744073709551615\n9\n{HEAD}1 2 3 4\n"), "the file is cut off, or its count"),
            (format!("1\n1\n{HEAD}1 2 3 4\n5 6 7 8\n"), "line 12: got"),
            (format!("1\n1\n{HEAD}1 2 3 4 5\n"), "line 11: got 5 columns"),
            (format!("1\n2\n{HEAD}1 2 3 4\n1 2 3 4 5 6 7"), "line 12: got 7 columns; the first row has 4"),
            (format!("1\n1\n{}1 2 3 4\n", HEAD.replace("0 1 0 0\n", "0 1 0 5\n")), "line 7: got 5"),
            ("1 2 3\n".to_string(), "a scan begins with"),
        ] {
            let found = read(&content);
            assert!(
                found.as_ref().is_err_and(|error| error.to_string().contains(says)),
                "{content} {found:?}"
            );
        }
        assert!(read("").is_ok_and(|cloud| cloud.points.is_empty()));
    }
}
