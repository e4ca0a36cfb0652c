//! PLY, the polygon file format (Turk 1994): a header that declares elements, then their rows in text or
//! binary.
//!
//! Points are the element `vertex` with the properties x y z; nx ny nz, red green blue and intensity are
//! read if present. Of 3D Gaussian splats (Kerbl et al. 2023; `opacity`, `scale_0`, `rot_0`), whose normals are
//! placeholders, the visible ones are points. Triangles are the lists `vertex_indices` or `vertex_index` of
//! the element `face`. All other elements are skipped, and data after the last element used are not read.

mod header;
mod rows;

use self::header::{Body, Element, Header};
use self::rows::{BinaryRows, RowSource, TextRows};
use super::cloud_content::{
    COLOR, CloudContent, ColorScale, INTENSITY, INTENSITY_NAMES, NORMAL, POSITION, Points, Row,
};
use super::columns::{Column, read_columns};
use super::fans::{Fans, row_of};
use super::lines::check_room;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Rows between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 12;

/// Parses the points, normals, colours, intensities and triangles of a file.
///
/// # Errors
/// [`Error::InvalidInput`] if the file is truncated or not a PLY file, [`Error::OutOfMemory`],
/// [`Error::Interrupted`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    let (header, lines) = header::read(content, execution)?;
    match header.body {
        Body::Text => read_body(&header, TextRows::new(lines), execution),
        Body::Binary(order) => {
            let start = content.len() - lines.rest().len();
            read_body(&header, BinaryRows::new(lines.rest(), start, order, execution), execution)
        }
    }
}

fn read_body(header: &Header, mut source: impl RowSource, execution: &Execution) -> Result<CloudContent> {
    let mut points = None;
    let mut fans = None;
    let has_faces = header.elements.iter().any(|element| element.name == b"face");
    for element in &header.elements {
        let least = source.least_bytes(element);
        check_room(&format!("element {}", element.title()), element.count, least, source.room())?;
        if element.name == b"vertex" && points.is_none() {
            points = Some(read_points(element, &mut source, execution)?);
        } else if element.name == b"face" && fans.is_none() {
            fans = Some(read_faces(element, &mut source, execution)?);
        } else {
            skip_rows(element, &mut source, execution)?;
        }
        if points.is_some() && fans.is_some() == has_faces {
            break;
        }
    }
    let Some(points) = points else {
        return Err(Error::invalid("header", "no element vertex", "without it there are no points"));
    };
    let faces = fans.unwrap_or_default().finish(points.len())?;
    points.finish(faces)
}

fn read_points(element: &Element, source: &mut impl RowSource, execution: &Execution) -> Result<Points> {
    let places = |names: [&str; 3]| {
        let [a, b, c] = names.map(|name| element.scalar_place(name));
        Some([a?, b?, c?])
    };
    let Some(position) = places(["x", "y", "z"]) else {
        return Err(Error::invalid(
            "element vertex",
            "not all of the properties x, y, z",
            "a point has three",
        ));
    };
    let splat = places(["opacity", "scale_0", "rot_0"]);
    // The opacity of splats replaces their normals, which are ignored.
    let normal = splat.map(|[opacity, ..]| [opacity; 3]).or_else(|| places(["nx", "ny", "nz"]));
    let color = places(["red", "green", "blue"]);
    let is_real = |place: usize| element.properties.get(place).is_some_and(|each| each.scalar.is_real());
    let scale = color
        .map(|places| if places.into_iter().any(is_real) { ColorScale::Reals } else { ColorScale::Bytes });
    // Column of each property in the row of numbers.
    let mut columns = memory::filled(None, element.properties.len())?;
    let wanted = [(Some(position), POSITION), (normal, NORMAL), (color, COLOR)];
    for (from, to) in wanted.into_iter().filter_map(|(from, to)| Some(from?.into_iter().zip(to))).flatten() {
        columns[from] = Some(to);
    }
    let intensity = element.place_ignoring_case(&INTENSITY_NAMES);
    if let Some(from) = intensity {
        columns[from] = Some(INTENSITY);
    }
    let mut points = Points::with_capacity(element.count, normal.is_some(), scale)?
        .with_intensities(intensity.is_some())?;
    if let Some((bytes, order)) = source.take_fixed(element)? {
        let columns = fixed_columns(element, &columns)?;
        read_columns(&mut points, element.count, &columns, (bytes, order), execution)?;
        return Ok(if splat.is_some() { points.opaque() } else { points });
    }
    for done in 0..element.count {
        if done.is_multiple_of(CHECK_EVERY) {
            execution.check()?;
        }
        source.begin()?;
        let mut row: Row = [0.0; 10];
        for (property, column) in element.properties.iter().zip(&columns) {
            match column {
                Some(column) => row[*column] = source.number(property.scalar)?,
                None => source.skip(property)?,
            }
        }
        points.push(&row)?;
    }
    Ok(if splat.is_some() { points.opaque() } else { points })
}

/// The columns used, for rows without lists.
fn fixed_columns(element: &Element, wanted: &[Option<usize>]) -> Result<Vec<Column>> {
    let mut columns = Vec::new();
    let mut start = 0;
    for (property, to) in element.properties.iter().zip(wanted) {
        if to.is_some() {
            memory::push(
                &mut columns,
                Column { to: *to, scalar: property.scalar, start, step: element.row_bytes() },
            )?;
        }
        start += property.scalar.size();
    }
    Ok(columns)
}

fn read_faces(element: &Element, source: &mut impl RowSource, execution: &Execution) -> Result<Fans> {
    let mut fans = Fans::default();
    let Some(corners) = element.list_of_corners() else {
        skip_rows(element, source, execution)?;
        return Ok(fans);
    };
    for _ in 0..element.count {
        execution.check()?;
        source.begin()?;
        for (place, property) in element.properties.iter().enumerate() {
            let Some(length) = property.length.filter(|_| place == corners) else {
                source.skip(property)?;
                continue;
            };
            fans.begin();
            let length = source.length(length)?;
            source.numbers(property.scalar, length, |number| fans.corner(row_of(number)))?;
        }
    }
    Ok(fans)
}

fn skip_rows(element: &Element, source: &mut impl RowSource, execution: &Execution) -> Result<()> {
    if element.properties.is_empty() || source.take_fixed(element)?.is_some() {
        return Ok(());
    }
    for _ in 0..element.count {
        execution.check()?;
        source.begin()?;
        element.properties.iter().try_for_each(|property| source.skip(property))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
