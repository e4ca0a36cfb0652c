//! OBJ, the format of Wavefront: `v` lines are points, `f` lines are polygons of all groups, objects and
//! materials. Texture coordinates and normals, which belong to corners and not to points, are ignored.

use super::cloud_content::{COLOR, CloudContent, ColorScale, POSITION, Points, Row};
use super::fans::Fans;
use super::lines::{JOINED, Line, Lines, shown};
use super::repeats::without_repeats;
use crate::error::{Error, Result};
use crate::execution::Execution;

const COMMENT: &[&[u8]] = &[b"#"];

/// Parses the points, colours and triangles of a file; points with equal coordinates are merged.
///
/// # Errors
/// [`Error::InvalidInput`] if a point or a polygon is invalid, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let mut lines = Lines::new(content, JOINED, execution);
    let mut points = Points::with_capacity(0, false, Some(ColorScale::Reals))?;
    let mut fans = Fans::default();
    let mut all_have_colors = true;
    while let Some(mut line) = lines.next_with_words(COMMENT)? {
        match line.next_word()? {
            Some(b"v") => {
                let (row, has_color) = read_point(&mut line)?;
                all_have_colors &= has_color;
                points.push(&row)?;
            }
            Some(b"f") => {
                fans.begin();
                while let Some(word) = line.next_word()? {
                    fans.corner(corner(word, points.len()).ok_or_else(|| wrong_corner(&line, word))?)?;
                }
            }
            _ => {}
        }
    }
    let faces = fans.finish(points.len())?;
    let mut cloud = points.finish(faces)?;
    if !all_have_colors {
        cloud.colors = None;
    }
    without_repeats(cloud, execution)
}

/// A point, and whether it has a colour: x y z, x y z w, x y z r g b, or x y z w r g b.
fn read_point(line: &mut Line) -> Result<(Row, bool)> {
    let mut row: Row = [0.0; 10];
    for place in POSITION {
        row[place] = line.next_number()?;
    }
    let mut more = [0.0; 4];
    let mut count = 0;
    while let Some(word) = line.next_word()? {
        if let Some(value) = more.get_mut(count) {
            *value = line.number_of(word)?;
        }
        count += 1;
    }
    let color = if count == 3 { &more[..3] } else { &more[1..] };
    COLOR.into_iter().zip(color).for_each(|(place, value)| row[place] = *value);
    Ok((row, count == 3 || count == 4))
}

/// The point of a corner, given the number of points before it: from 1 on, or back from the last by negative
/// numbers.
fn corner(word: &[u8], points: usize) -> Option<i64> {
    let number = word.split(|byte| *byte == b'/').next()?;
    let number: i64 = std::str::from_utf8(number).ok()?.parse().ok()?;
    match number {
        0 => None,
        1.. => Some(number - 1),
        _ => Some(number.saturating_add(points as i64)),
    }
}

fn wrong_corner(line: &Line, word: &[u8]) -> Error {
    line.refuse(shown(word), "a corner is the number of a point, from 1 on, or -1 for the last and so on")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &[u8]) -> Result<CloudContent> {
        parse(content, &Execution::default())
    }

    #[test]
    fn polygons_of_all_groups_are_read() -> Result<()> {
        let text = b"# \xe9\nmtllib \xfc.mtl\no first\nv 0 0 0\nv 1 0 0\r\nv 1 1 \\\n 0\nvt 0 0\nvn 0 0 1\nusemtl \xe4\n\
            f 1/1/1 2/1 3//1\ng second\nv 0 1 0 1.0\nv 1 0 0\nv 2 2 2\nf -6 -5 -4 -3\ns off\nf 4 5 \\\n3 # a comment\nl 1 2\n";
        let cloud = read(text)?;
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [2.0; 3]];
        assert_eq!(cloud.points, points);
        assert_eq!(cloud.faces, Some(vec![[0, 1, 2], [0, 1, 2], [0, 2, 3], [3, 1, 2]]));
        assert_eq!(cloud.colors, None);
        Ok(())
    }

    #[test]
    fn colors_follow_points() -> Result<()> {
        let cloud = read(b"v 0 0 0 1 0.5 0\nv 1 0 0 1 0 0 1\n")?;
        assert_eq!((cloud.colors, cloud.faces), (Some(vec![[255, 128, 0], [0, 0, 255]]), None));
        assert_eq!(read(b"v 0 0 0 1 0.5 0\nv 1 0 0\n")?.colors, None);
        Ok(())
    }

    #[test]
    fn errors_name_the_fault() {
        for (content, says) in [
            ("v 0 0\n", "line 1: got the end of the line"),
            ("v 0 0 x\n", "line 1: got \"x\""),
            ("v 0 0 0\nf 1 1 0\n", "line 2: got \"0\""),
            ("v 0 0 0\nf 1 1 /1\n", "line 2: got \"/1\""),
            ("v 0 0 0\nf 1 1 2\n", "names point 1"),
            ("v 0 0 0\nf 1 1 -2\n", "names point -1"),
            ("v 0 0 0\nf 1 1 -9223372036854775808\n", "names point"),
            ("v 0 0 0\nf 1 1 9223372036854775808\n", "line 2"),
        ] {
            let error =
                read(content.as_bytes()).map_or_else(|error| error.to_string(), |_| "nothing".to_string());
            assert!(error.contains(says), "{error}");
        }
    }
}
