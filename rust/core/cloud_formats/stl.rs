//! STL: triangles by the coordinates of their corners, in text or binary.
//!
//! A binary file has 80 arbitrary bytes, a count, and 50 bytes for each triangle. Some begin with `solid`
//! like text, so a file is binary if its length matches its count.

use super::cloud_content::{CloudContent, Points, Row};
use super::fans::Fans;
use super::lines::{BLANKS, Lines};
use super::repeats::without_repeats;
use super::scalar::{ByteOrder, Scalar};
use crate::error::{Error, Result};
use crate::execution::Execution;

const HEADER: usize = 80;
const TRIANGLE: usize = 50;
/// Bytes of a normal, which precedes the corners.
const NORMAL: usize = 12;
const NUMBER: usize = Scalar::F32.size();

/// Triangles between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 12;

/// Parses the triangles of a file; corners with equal coordinates are merged.
///
/// # Errors
/// [`Error::InvalidInput`] if the file is truncated or not an STL file, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let points = match binary_triangles(content) {
        Some(triangles) => read_binary(triangles, execution)?,
        None => read_text(content, execution)?,
    };
    let mut fans = Fans::default();
    for corner in 0..points.len() {
        if corner.is_multiple_of(3) {
            fans.begin();
        }
        fans.corner(corner as i64)?;
    }
    let faces = fans.finish(points.len())?;
    without_repeats(points.finish(faces)?, execution)
}

/// The triangles of a binary file.
fn binary_triangles(content: &[u8]) -> Option<&[u8]> {
    let (count, triangles) = content.get(HEADER..)?.split_first_chunk::<NUMBER>()?;
    let length = (u32::from_le_bytes(*count) as usize).checked_mul(TRIANGLE);
    (length == Some(triangles.len())).then_some(triangles)
}

fn read_binary(triangles: &[u8], execution: &Execution) -> Result<Points> {
    let mut points = Points::with_capacity(triangles.len() / TRIANGLE * 3, false, None)?;
    for block in triangles.chunks(CHECK_EVERY * TRIANGLE) {
        execution.check()?;
        for triangle in block.chunks_exact(TRIANGLE) {
            for corner in triangle[NORMAL..].chunks_exact(3 * NUMBER) {
                let mut row: Row = [0.0; 10];
                for (value, number) in row.iter_mut().zip(corner.chunks_exact(NUMBER)) {
                    *value = Scalar::F32.read(number, ByteOrder::Little).unwrap_or(f64::NAN);
                }
                points.push(&row)?;
            }
        }
    }
    Ok(points)
}

fn read_text(content: &[u8], execution: &Execution) -> Result<Points> {
    let mut lines = Lines::new(content, BLANKS, execution);
    let mut points = Points::with_capacity(0, false, None)?;
    // Whether the last solid has ended; `None` before the first.
    let mut ended = None;
    while let Some(mut line) = lines.next_with_words(&[])? {
        let word = line.next_word()?.unwrap_or_default();
        if word.eq_ignore_ascii_case(b"solid") {
            ended = Some(false);
        } else if ended.is_none() {
            let remedy =
                "a text begins with solid; a binary file has 84 bytes, and 50 for each of its triangles";
            return Err(Error::invalid("file", format!("{} bytes of something else", content.len()), remedy));
        } else if word.eq_ignore_ascii_case(b"endsolid") {
            ended = Some(true);
        } else if word.eq_ignore_ascii_case(b"vertex") {
            let mut row: Row = [0.0; 10];
            for value in &mut row[..3] {
                *value = line.next_number()?;
            }
            points.push(&row)?;
        }
    }
    if ended == Some(true) && points.len().is_multiple_of(3) {
        return Ok(points);
    }
    Err(Error::invalid(
        "solid",
        format!("{} corners and no endsolid after them", points.len()),
        "the file is cut off",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &[u8]) -> Result<CloudContent> {
        parse(content, &Execution::default())
    }

    const TEXT: &str = "solid \u{e9}\nfacet normal 0 0 1\nouter loop\nVERTEX 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n\
        endfacet\nendsolid\nsolid b\nvertex 0 1 0\nvertex 1 0 0\nvertex 0.1 1e1 0\nendsolid b\n";

    fn binary() -> Vec<u8> {
        let mut content = b"solid though binary".to_vec();
        content.resize(HEADER, b' ');
        content.extend(2_u32.to_le_bytes());
        for corners in [
            [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.1, 10.0, 0.0],
        ] {
            content.extend([0; NORMAL]);
            content.extend(corners.iter().flat_map(|number| number.to_le_bytes()));
            content.extend([7, 7]);
        }
        content
    }

    #[test]
    fn both_kinds_are_read() -> Result<()> {
        for (content, tenth) in [(TEXT.as_bytes(), 0.1), (&binary(), f64::from(0.1_f32))] {
            let cloud = read(content)?;
            assert_eq!(cloud.points, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [tenth, 10.0, 0.0]]);
            assert_eq!(cloud.faces, Some(vec![[0, 1, 2], [2, 1, 3]]));
        }
        Ok(())
    }

    #[test]
    fn truncated_files_are_refused() {
        let content = binary();
        assert!(read(&content[..content.len() - 1]).is_err());
        assert!(read(&content[50..]).is_err());
        assert!(read(TEXT.trim_end_matches("endsolid b\n").as_bytes()).is_err());
        assert!(
            read(TEXT.replace("1 0 0\n", "1 0\n").as_bytes())
                .is_err_and(|error| error.to_string().contains("line 5"))
        );
        assert!(read(TEXT.replace("VERTEX 0 0 0\n", "").as_bytes()).is_err());
        assert!(read(b"").is_err());
    }
}
