//! PTS, the format of laser scanners: the number of points, then a line for each. After x y z a line may have
//! an intensity, and a colour of three bytes.

use super::cloud_content::{COLOR, CloudContent, ColorScale, INTENSITY, POSITION, Points, Row};
use super::lines::{COLUMNS, Line, Lines};
use super::table::{COMMENTS, check_columns, check_count, take_count};
use crate::error::Result;
use crate::execution::Execution;

/// Parses the points, intensities and colours of a file; the count may be missing.
///
/// # Errors
/// [`crate::Error::InvalidInput`] if the file is truncated or in another format,
/// [`crate::Error::OutOfMemory`],
/// [`crate::Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let mut lines = Lines::new(content, COLUMNS, execution);
    let declared = take_count(&mut lines)?;
    let Some(first) = lines.clone().next_row(COMMENTS)? else {
        return Points::with_capacity(0, false, None)?.finish(None);
    };
    let columns = first.count_words()?;
    let places: &[usize] = match columns {
        3 => &POSITION,
        4 => &[0, 1, 2, INTENSITY],
        6 => &[0, 1, 2, 6, 7, 8],
        7 => &[0, 1, 2, INTENSITY, 6, 7, 8],
        _ => {
            return Err(
                first.refuse(format!("{columns} columns"), "points have 3, 4, 6 or 7: x y z [i] [r g b]")
            );
        }
    };
    let colors = places.contains(&COLOR[0]).then_some(ColorScale::Bytes);
    let mut points = Points::with_capacity(declared.unwrap_or(0), false, colors)?
        .with_intensities(places.contains(&INTENSITY))?;
    while let Some(line) = lines.next_row(COMMENTS)? {
        points.push(&read_row(line, places)?)?;
    }
    check_count(declared, points.len())?;
    points.finish(None)
}

fn read_row(mut line: Line, places: &[usize]) -> Result<Row> {
    check_columns(&line, line.count_words()?, &mut Some(places.len()))?;
    let mut row: Row = [0.0; 10];
    for &place in places {
        row[place] = line.next_number()?;
    }
    Ok(row)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &str) -> Result<CloudContent> {
        parse(content.as_bytes(), &Execution::default())
    }

    #[test]
    fn the_number_of_columns_decides_about_attributes() -> Result<()> {
        for (text, intensity, color) in [
            ("2\n1 2 3\n4 5 6\n", None, None),
            ("1 2 3 -100\n4 5 6 7\n", Some([-100.0, 7.0]), None),
            ("2\r\n1 2 3 0 1 255\r\n4 5 6 0 0 1", None, Some([0, 1, 255])),
            ("2\n1 2 3 -7 0 1 255\n4 5 6 9 0 0 1\n\n", Some([-7.0, 9.0]), Some([0, 1, 255])),
        ] {
            let cloud = read(text)?;
            assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
            assert_eq!(cloud.intensities, intensity.map(Vec::from));
            assert_eq!(cloud.colors.map(|colors| colors[0]), color);
        }
        Ok(())
    }

    #[test]
    fn errors_name_the_fault() {
        for (content, says) in [
            ("3\n1 2 3\n4 5 6\n", "points: got 3 of at least 6 bytes"),
            ("2\n1 2 3.00000\n", "1 of 2 points"),
            ("2\n1 2 3\n4 5 6\n7 8 9\n", "3 of 2 points"),
            ("1\n1 2 3 4 5\n", "line 2: got 5 columns"),
            ("2\n1 2 3\n4 5 6 7\n", "line 3: got 4 columns"),
            ("1 2 x\n", "line 1: got \"x\""),
        ] {
            let found = read(content);
            assert!(found.is_err_and(|error| error.to_string().contains(says)), "{content}");
        }
        assert!(read("0\n").is_ok_and(|cloud| cloud.points.is_empty()));
    }
}
