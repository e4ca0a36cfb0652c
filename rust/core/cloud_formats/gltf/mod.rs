//! glTF 2.0 and GLB: triangles and points of the nodes of a scene, in its frame.
//!
//! A file is a document in JSON, which refers to buffers: the binary chunk of GLB, base64 in the document, or
//! other files. An accessor is a table of numbers in a buffer. A node has a matrix, children and a mesh; a
//! mesh consists of primitives, which name the accessors of their points, normals, colours and corners.
//! Primitives of a node that name the same accessors share their points in the cloud.

mod buffers;
mod json;
mod scene;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix4, Vector3};

use super::cloud_content::CloudContent;
use super::e57::fill_with;
use super::fans::row_of;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use buffers::{Accessors, COLORS, SINGLES, TRIPLES};
use scene::{Document, Growth, Kind, Mode, Part};

/// Points between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 12;

/// Parses a file with all its buffers inside.
///
/// # Errors
/// As [`parse_with`].
pub fn parse(content: &[u8], execution: &Execution) -> Result<CloudContent> {
    parse_with(content, &BTreeMap::new(), execution)
}

/// Addresses of the files, as the document has them, that hold buffers of the scene.
///
/// # Errors
/// As [`parse_with`].
pub fn files_of(content: &[u8], execution: &Execution) -> Result<Vec<String>> {
    let root = json::parse(buffers::split_chunks(content)?.0, execution)?;
    let document = Document::new(&root)?;
    let parts = document.parts(&mut Growth { packed: content.len(), grown: 0 }, execution)?;
    let entries = document.list(Kind::Buffers)?;
    let mut files = Vec::new();
    for row in buffers::needed_buffers(document, &parts)? {
        if let Some(file) = buffers::file_of(&entries[row])? {
            memory::push(&mut files, json::copied(file)?)?;
        }
    }
    Ok(files)
}

/// Parses a file with the contents of other files by their addresses.
///
/// # Errors
/// [`Error::InvalidInput`] if the file is damaged or compressed, lacks a buffer, or would grow to a much
/// larger cloud; [`Error::OutOfMemory`], [`Error::Interrupted`].
pub fn parse_with(
    content: &[u8],
    files: &BTreeMap<&str, &[u8]>,
    execution: &Execution,
) -> Result<CloudContent> {
    let (text, binary) = buffers::split_chunks(content)?;
    let root = json::parse(text, execution)?;
    let document = Document::new(&root)?;
    let packed = files.values().fold(content.len(), |sum, file| sum.saturating_add(file.len()));
    let mut growth = Growth { packed, grown: 0 };
    let parts = document.parts(&mut growth, execution)?;
    let needed = buffers::needed_buffers(document, &parts)?;
    let mut accessors = Accessors::new(document, &needed, binary, files, growth, execution)?;
    let all = |has: fn(&Part) -> bool| !parts.is_empty() && parts.iter().all(has);
    let mut cloud = CloudContent {
        normals: all(|part| part.normal.is_some()).then(Vec::new),
        colors: all(|part| part.color.is_some()).then(Vec::new),
        ..CloudContent::default()
    };
    for part in &parts {
        add_part(part, &mut accessors, &mut cloud, execution)?;
    }
    Ok(cloud)
}

/// Adds the points and triangles of a part.
fn add_part(
    part: &Part,
    accessors: &mut Accessors,
    cloud: &mut CloudContent,
    execution: &Execution,
) -> Result<()> {
    let (turn, start) = (part.matrix.fixed_view::<3, 3>(0, 0).into_owned(), cloud.points.len());
    let side = turn.determinant();
    let mut points = accessors.read(part.position, TRIPLES)?;
    let count = points.len();
    for faces in &part.faces {
        let corners = faces.indices.map(|row| accessors.read(row, SINGLES)).transpose()?;
        accessors.grow(corners.as_ref().map_or(count, Vec::len).saturating_mul(size_of::<[i64; 3]>()))?;
        let found = triangles(faces.mode, corners.as_deref(), start..start + count, side < 0.0, execution)?;
        append(cloud.faces.get_or_insert_default(), found)?;
    }
    if part.matrix != Matrix4::identity() {
        let shift = part.matrix.fixed_view::<3, 1>(0, 3).into_owned();
        in_pieces(&mut points, execution, |point| *point = (turn * Vector3::from(*point) + shift).into())?;
    }
    append(&mut cloud.points, points)?;
    if let Some(row) = part.normal {
        let mut found = accessors.read(row, TRIPLES)?;
        check_count("normals", found.len(), count)?;
        let turn = turn_of_normals(&turn, side);
        in_pieces(&mut found, execution, |normal| {
            let turned = turn * Vector3::from(*normal);
            *normal = (turned / turned.norm()).into();
        })?;
        cloud.normals.as_mut().map_or(Ok(()), |normals| append(normals, found))?;
    }
    if let Some(row) = part.color {
        let found = accessors.read::<3>(row, COLORS)?;
        check_count("colours", found.len(), count)?;
        // NaN becomes 0.
        let byte = |share: f64| (255.0 * share.clamp(0.0, 1.0)).round_ties_even() as u8;
        let found = fill_with(count, execution, |i| found[i].map(byte))?;
        cloud.colors.as_mut().map_or(Ok(()), |colors| append(colors, found))?;
    }
    Ok(())
}

/// The matrix of normals. The cofactors are the inverse's transpose, up to a factor that normalization
/// removes.
fn turn_of_normals(turn: &Matrix3<f64>, side: f64) -> Matrix3<f64> {
    let [x, y, z] = [0, 1, 2].map(|axis| turn.column(axis));
    Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)]) * 1.0_f64.copysign(side)
}

fn check_count(what: &str, found: usize, points: usize) -> Result<()> {
    if found == points {
        return Ok(());
    }
    Err(Error::invalid(what, format!("{found} for {points} points"), "each point has one"))
}

/// Triangles as rows of the cloud, which has the points of the part in `rows`. A mirrored part has the
/// corners in reverse order.
fn triangles(
    mode: Mode,
    corners: Option<&[[f64; 1]]>,
    rows: std::ops::Range<usize>,
    is_mirrored: bool,
    execution: &Execution,
) -> Result<Vec<[i64; 3]>> {
    let is_there = |corner: f64| usize::try_from(row_of(corner)).is_ok_and(|row| row < rows.len());
    if let Some([corner]) = corners.and_then(|corners| corners.iter().find(|[corner]| !is_there(*corner))) {
        let remedy = format!("there are {}, the first is point 0", rows.len());
        return Err(Error::invalid("faces", format!("a triangle that names point {corner}"), remedy));
    }
    let len = corners.map_or(rows.len(), <[_]>::len);
    let count = if mode == Mode::Triangles { len / 3 } else { len.saturating_sub(2) };
    let row = |i: usize| (rows.start + corners.map_or(i, |corners| row_of(corners[i][0]) as usize)) as i64;
    fill_with(count, execution, |i| {
        let [a, b, c] = match mode {
            Mode::Triangles => [3 * i, 3 * i + 1, 3 * i + 2],
            Mode::Strip => [i, i + 1 + i % 2, i + 2 - i % 2],
            Mode::Fan => [i + 1, i + 2, 0],
        };
        (if is_mirrored { [c, b, a] } else { [a, b, c] }).map(row)
    })
}

/// Changes each item.
fn in_pieces<T>(items: &mut [T], execution: &Execution, change: impl Fn(&mut T)) -> Result<()> {
    for piece in items.chunks_mut(CHECK_EVERY) {
        execution.check()?;
        piece.iter_mut().for_each(&change);
    }
    Ok(())
}

/// Appends items; takes them without a copy if they are the first.
fn append<T: Clone>(items: &mut Vec<T>, more: Vec<T>) -> Result<()> {
    if items.is_empty() {
        *items = more;
        return Ok(());
    }
    memory::extend(items, &more)
}
