//! Clouds as columns of numbers: XYZ, TXT, CSV.
//!
//! Columns are separated by white space, commas or semicolons; # and // start comments. Commas between digits
//! are decimal marks if white space or semicolons separate the columns. The number of points may come first.
//! A line of names defines the columns x y z, nx ny nz, r g b and intensity; other columns may have any content. Without
//! names the first three columns are x y z, and the others are numbers that are ignored.

use super::cloud_content::{
    COLOR, CloudContent, ColorScale, INTENSITY, INTENSITY_NAMES, NORMAL, POSITION, Points, Row,
};
use super::lines::{COLUMNS, Line, Lines, number, shown};
use super::table::{COMMENTS, check_columns, check_count, take_count};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// Names of columns, ignoring case.
const POSITION_NAMES: &[[&str; 3]] = &[["x", "y", "z"]];
const NORMAL_NAMES: &[[&str; 3]] = &[["nx", "ny", "nz"], ["normal_x", "normal_y", "normal_z"]];
const COLOR_NAMES: &[[&str; 3]] = &[["r", "g", "b"], ["red", "green", "blue"]];

/// Parses the points of a text, with normals, colours and intensities if columns have these names.
///
/// # Errors
/// [`crate::Error::InvalidInput`] for other content, [`crate::Error::OutOfMemory`],
/// [`crate::Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    read(content, &POSITION, execution)
}

/// As [`parse`]; columns without names are x y z and a normal.
///
/// # Errors
/// As [`parse`].
pub fn parse_with_normals(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    read(content, &[POSITION, NORMAL].concat(), execution)
}

/// As [`parse`]; columns without names are x y z and a colour.
///
/// # Errors
/// As [`parse`].
pub fn parse_with_colors(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    read(content, &[POSITION, COLOR].concat(), execution)
}

/// Reads a text with the given columns, unless a line names them. A count may come first.
fn read(content: &[u8], columns: &[usize], execution: &Execution) -> Result<CloudContent> {
    let mut lines = Lines::new(content, COLUMNS, execution);
    let declared = take_count(&mut lines)?;
    let mut behind_names = lines.clone();
    let points = match behind_names.next_with_words(COMMENTS)? {
        Some(line) if !starts_with_number(line.clone())? => read_named(&line, &mut behind_names)?,
        _ => read_plain(&mut lines, columns)?,
    };
    check_count(declared, points.len())?;
    points.finish(None)
}

fn starts_with_number(mut line: Line) -> Result<bool> {
    Ok(line.next_word()?.is_some_and(|word| number(word).is_some()))
}

fn read_plain(lines: &mut Lines, places: &[usize]) -> Result<Points> {
    let colors = places.contains(&COLOR[0]).then_some(ColorScale::Reals);
    let mut points = Points::with_capacity(0, places.contains(&NORMAL[0]), colors)?;
    let mut columns = None;
    while let Some(mut line) = lines.next_row(COMMENTS)? {
        let (mut row, mut found): (Row, _) = ([0.0; 10], 0);
        while let Some(word) = line.next_word()? {
            let number = line.number_of(word)?;
            if let Some(place) = places.get(found) {
                row[*place] = number;
            }
            found += 1;
        }
        check_columns(&line, found, &mut columns)?;
        if found < places.len() {
            let remedy = format!("a point of such a file has {}: x y z first", places.len());
            return Err(line.refuse(format!("{found} columns"), remedy));
        }
        points.push(&row)?;
    }
    Ok(points)
}

fn read_named(names: &Line, lines: &mut Lines) -> Result<Points> {
    let fields = Fields::of(names);
    let header = memory::collect(fields.split(names.text()))?;
    let place = |name: &str| header.iter().position(|field| field.eq_ignore_ascii_case(name.as_bytes()));
    let places = |alternatives: &[[&str; 3]]| {
        alternatives.iter().find_map(|names| {
            let [a, b, c] = names.map(place);
            Some([a?, b?, c?])
        })
    };
    let Some(position) = places(POSITION_NAMES) else {
        let remedy = "numbers belong there, or names of columns, x, y and z among them";
        return Err(names.refuse(shown(names.text().trim_ascii()), remedy));
    };
    let (normal, color) = (places(NORMAL_NAMES), places(COLOR_NAMES));
    // Column of each field in the row.
    let mut columns = memory::filled(None, header.len())?;
    let wanted = [(Some(position), POSITION), (normal, NORMAL), (color, COLOR)];
    for (from, to) in wanted.into_iter().filter_map(|(from, to)| Some(from?.into_iter().zip(to))).flatten() {
        columns[from] = Some(to);
    }
    let intensity = INTENSITY_NAMES.into_iter().find_map(place);
    if let Some(from) = intensity {
        columns[from] = Some(INTENSITY);
    }
    let mut points = Points::with_capacity(0, normal.is_some(), color.map(|_| ColorScale::Reals))?
        .with_intensities(intensity.is_some())?;
    while let Some(line) = lines.next_with_words(COMMENTS)? {
        let (mut row, mut found): (Row, _) = ([0.0; 10], 0);
        for field in fields.split(line.text()) {
            if let Some(Some(to)) = columns.get(found) {
                row[*to] = lines.number_of(&line, field)?;
            }
            found += 1;
        }
        check_columns(&line, found, &mut Some(header.len()))?;
        points.push(&row)?;
    }
    Ok(points)
}

/// Separator of the fields of a line: a comma or semicolon, which may enclose an empty field, or white space.
struct Fields {
    separator: Option<u8>,
}

impl Fields {
    /// The separator of the line of names.
    fn of(names: &Line) -> Self {
        Self { separator: [b',', b';', b'\t'].into_iter().find(|byte| names.text().contains(byte)) }
    }

    /// The fields of a line, without quotes.
    fn split<'a>(&self, text: &'a [u8]) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let separator = self.separator;
        let is_end =
            move |byte: &u8| separator.map_or(byte.is_ascii_whitespace(), |separator| *byte == separator);
        let bare = |field: &'a [u8]| {
            let field = field.trim_ascii();
            field.strip_prefix(b"\"").and_then(|field| field.strip_suffix(b"\"")).unwrap_or(field)
        };
        text.split(is_end).map(bare).filter(move |field| separator.is_some() || !field.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &[u8]) -> Result<CloudContent> {
        parse(content, &Execution::default())
    }

    #[test]
    fn columns_without_names() -> Result<()> {
        for text in
            ["1 2 3 9\n4 5 6 9\n", "\u{feff}1,2,3,9\r\n4, 5, 6, 9", "// X Y Z\n1;2;3;9\n\n4;5\t6 9#8\n"]
        {
            let cloud = read(text.as_bytes())?;
            assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
            assert_eq!((cloud.normals, cloud.colors), (None, None));
        }
        assert!(read(b"# nothing")?.points.is_empty());
        Ok(())
    }

    #[test]
    fn decimal_commas() -> Result<()> {
        for text in [
            "38,25;-53,5;37\n1;2;3,125\n",
            "38,25\t-53,5\t37\n1\t2\t3,125",
            "2\n38,25 -53,5 37,0\n1,0 2,0 3,125\n",
            "x;y;z;note\n38,25;-53,5;37;a, b.\n1;2;3,125;c\n",
            "x y z\n38,25 -53,5 37\n1 2 3,125\n",
        ] {
            assert_eq!(read(text.as_bytes())?.points, [[38.25, -53.5, 37.0], [1.0, 2.0, 3.125]], "{text}");
        }
        Ok(())
    }

    #[test]
    fn columns_of_normals_and_colors() -> Result<()> {
        let execution = Execution::default();
        let cloud = parse_with_normals(b"1 2 3 0 0 1 9\n", &execution)?;
        assert_eq!((cloud.points, cloud.normals), (vec![[1.0, 2.0, 3.0]], Some(vec![[0.0, 0.0, 1.0]])));
        let cloud = parse_with_colors(b"1 2 3 1 0.5 0\n", &execution)?;
        assert_eq!((cloud.normals, cloud.colors), (None, Some(vec![[255, 128, 0]])));
        assert_eq!(parse_with_colors(b"x,y,z\n1,2,3\n", &execution)?.points, [[1.0, 2.0, 3.0]]);
        assert!(parse_with_colors(b"1 2 3\n", &execution).is_err());
        Ok(())
    }

    #[test]
    fn columns_with_names() -> Result<()> {
        let text = "\u{feff}\"label\",Z,Y,X,R,G,B,nx,ny,nz,Intensity,note\ntree,3,2,1,255,0,7,0,0,1,-2.5,\n,6,5,4,1,2,3,1,0,0,7,x\n";
        let cloud = read(text.as_bytes())?;
        assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(cloud.normals, Some(vec![[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]));
        assert_eq!(cloud.colors, Some(vec![[255, 0, 7], [1, 2, 3]]));
        assert_eq!(cloud.intensities, Some(vec![-2.5, 7.0]));
        assert_eq!(read(b"x y  z\n1 2 3\n")?.points, [[1.0, 2.0, 3.0]]);
        assert_eq!(read(b"x\ty\tz\t\xe9\n1\t2\t3\t\n")?.points, [[1.0, 2.0, 3.0]]);
        Ok(())
    }

    #[test]
    fn errors_name_the_fault() {
        for (content, says) in [
            ("hello, world\n", "line 1: got \"hello, world\""),
            ("1 2\n", "line 1: got 2 columns; a point of such a file has 3"),
            ("2\n1 2 3\n", "in 7 bytes"),
            ("2\n1 2 3.000000\n", "1 of 2 points"),
            ("1,5 2.5 3\n", "line 1: got \"1,5 2.5 3\"; its commas may be"),
            ("1,2,3\n\n1,5 2,5 3,5\n", "line 3: got \"1,5 2,5 3,5\"; decimal commas, where line 1 has"),
            ("1,5;2;3\n1.5;2;3\n", "line 2: got \"1.5;2;3\"; other numbers, where line 1 has"),
            ("x;y;z\n1.5;2;3\n1,5;2;3\n", "line 3: got \"1,5;2;3\"; decimal commas, where line 2"),
            ("1 2 3\n4 5 6 7\n", "line 2: got 4 columns; the first row has 3"),
            ("1 2 3 a\n", "line 1: got \"a\""),
            ("x,y,z\n1,2\n", "line 2: got 2 columns"),
            ("x,y,z\n1,,2\n", "line 2: got \"\""),
            ("x;y;z\n1,2,3;2;3\n", "line 2: got \"1,2,3\""),
            ("x;y;z\n1.234,5;2;3\n", "line 2: got \"1.234,5\""),
        ] {
            let found = read(content.as_bytes());
            assert!(found.is_err_and(|error| error.to_string().contains(says)), "{content}");
        }
    }
}
