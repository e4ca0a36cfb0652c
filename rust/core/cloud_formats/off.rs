//! OFF, the format of Geomview: counts, points, then polygons. Letters before its keyword declare further
//! data of a point: N a normal, C a colour, ST texture coordinates, which are ignored.

use super::cloud_content::{COLOR, CloudContent, ColorScale, NORMAL, POSITION, Points, Row};
use super::fans::Fans;
use super::lines::{BLANKS, Line, Lines, check_room, count, shown};
use crate::error::{Error, Result};
use crate::execution::Execution;

const COMMENT: &[&[u8]] = &[b"#"];

/// Content of the first words.
struct Header {
    normals: bool,
    colors: bool,
    points: usize,
    faces: usize,
}

/// Parses the points, normals, colours and triangles of a file.
///
/// # Errors
/// [`Error::InvalidInput`] if the file is truncated or not an OFF file, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let mut lines = Lines::new(content, BLANKS, execution);
    let header = read_header(&mut lines)?;
    // Counts a separator after the last number.
    let room = lines.rest().len() + 1;
    check_room("points", header.points, 3 * 2, room)?;
    check_room("faces", header.faces, 2, room)?;
    let mut points =
        Points::with_capacity(header.points, header.normals, header.colors.then_some(ColorScale::Reals))?;
    for _ in 0..header.points {
        let mut line = next_line(&mut lines)?;
        let mut row: Row = [0.0; 10];
        let wanted = [(true, POSITION), (header.normals, NORMAL), (header.colors, COLOR)];
        for place in wanted.into_iter().filter(|(is_there, _)| *is_there).flat_map(|(_, places)| places) {
            row[place] = line.next_number()?;
        }
        points.push(&row)?;
    }
    let mut fans = Fans::default();
    for _ in 0..header.faces {
        let mut line = next_line(&mut lines)?;
        fans.begin();
        for _ in 0..line.next_count()? {
            fans.corner(i64::try_from(line.next_count()?).unwrap_or(-1))?;
        }
    }
    let faces = fans.finish(points.len())?;
    points.finish(faces)
}

fn next_line<'a>(lines: &mut Lines<'a>) -> Result<Line<'a>> {
    let end = || Error::invalid("rows", "the end of the file", "the counts at its start declare more");
    lines.next_with_words(COMMENT)?.ok_or_else(end)
}

fn read_header(lines: &mut Lines) -> Result<Header> {
    let mut line = next_line(lines)?;
    let word = line.next_word()?.unwrap_or_default();
    let place = word.windows(3).position(|part| part == b"OFF");
    let Some((name, tail)) = place.and_then(|place| Some((word.get(..place)?, word.get(place + 3..)?)))
    else {
        return Err(line.refuse(shown(word), "an OFF file begins with the word OFF"));
    };
    if name.iter().any(|letter| !b"STCN".contains(letter)) {
        return Err(
            line.refuse(shown(word), "OFF, COFF, NOFF and CNOFF are read: points in three dimensions")
        );
    }
    // Some files lack the end of the first line: OFF8 6 12.
    let glued = count(tail);
    if glued.is_none() && line.is_blank() {
        line = next_line(lines)?;
    }
    let points = match glued {
        Some(points) => points,
        None => line.next_count()?,
    };
    let faces = line.next_count()?;
    Ok(Header { normals: name.contains(&b'N'), colors: name.contains(&b'C'), points, faces })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &str) -> Result<CloudContent> {
        parse(content.as_bytes(), &Execution::default())
    }

    #[test]
    fn counts_are_found_in_several_places() -> Result<()> {
        let body = "# a comment\n0 0 0\n1 0 0 # another\n\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n3 3 2 0\n";
        for counts in ["OFF\n4 2 5\n", "# before\nOFF 4 2 5\r\n", "OFF4 2 0\n", "OFF\n4 2\n"] {
            let cloud = read(&format!("{counts}{body}"))?;
            assert_eq!(cloud.points, [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
            assert_eq!(cloud.faces, Some(vec![[0, 1, 2], [0, 2, 3], [3, 2, 0]]));
        }
        Ok(())
    }

    #[test]
    fn letters_declare_normals_and_colors() -> Result<()> {
        let cloud = read("NOFF\n1 0 0\n1 2 3 0 0 1\n")?;
        assert_eq!((cloud.normals, cloud.colors), (Some(vec![[0.0, 0.0, 1.0]]), None));
        let cloud = read("COFF\n1 0 0\n1 2 3 1 0.5 0 1\n")?;
        assert_eq!((cloud.normals, cloud.colors), (None, Some(vec![[255, 128, 0]])));
        let cloud = read("CNOFF\n1 0 0\n1 2 3 0 0 1 255 7 0 255\n")?;
        assert_eq!((cloud.normals, cloud.colors), (Some(vec![[0.0, 0.0, 1.0]]), Some(vec![[255, 7, 0]])));
        Ok(())
    }

    #[test]
    fn errors_name_the_fault() {
        for (content, says) in [
            ("", "the end of the file"),
            ("ply\n", "begins with the word OFF"),
            ("4OFF\n1 0 0\n0 0 0 0\n", "three dimensions"),
            ("OFF BINARY\n", "got \"BINARY\""),
            ("OFF\n2 0 0\n0 0 0\n1 0000\n", "line 4: got the end of the line"),
            ("OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "names point 1"),
            ("OFF\n1 1 0\n0 0 0\n3 0 0 -1\n", "line 4: got \"-1\""),
            ("OFF\n1 1 0\n0 0 0\n999999999999 0 0\n", "line 4: got the end of the line"),
            ("OFF\n18446744073709551615 1 0\n0 0 0\n", "in 7 bytes"),
            ("OFF\n1 18446744073709551615 0\n0 0 0\n", "in 7 bytes"),
        ] {
            let error = read(content).map_or_else(|error| error.to_string(), |_| "nothing".to_string());
            assert!(error.contains(says), "{error}");
        }
    }
}
