//! Vertex normals of a triangle mesh: area-weighted means of the faces' normals, consistently oriented.
//!
//! Scans and models are stored with either winding, and sometimes with both. Faces are therefore oriented
//! consistently within every connected part: outwards if the part is closed, else like most of its area. Cost
//! O(F), plus the sorting of each vertex' edges.

use nalgebra::Vector3;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::features::mesh_edges::{Edges, STRETCH};
use crate::memory;
use crate::points::Points;

/// Unit normals, one per point; NaN at points without a face of positive area.
///
/// # Errors
/// [`Error::InvalidInput`] for a face with an index out of range, or more than 2^32 corners;
/// [`Error::Interrupted`], [`Error::OutOfMemory`].
pub fn mesh_normals(
    points: &Points,
    faces: &[[usize; 3]],
    execution: &Execution,
) -> Result<Vec<Vector3<f64>>> {
    check_faces(points, faces)?;
    let signs = orientations(points, faces, execution)?;
    let mut normals = memory::filled(Vector3::zeros(), points.len())?;
    for (faces, signs) in faces.chunks(STRETCH).zip(signs.chunks(STRETCH)) {
        execution.check()?;
        for (face, &sign) in faces.iter().zip(signs) {
            let area = area_vector(points, face) * f64::from(sign);
            for &vertex in face {
                normals[vertex] += area;
            }
        }
    }
    for normal in &mut normals {
        *normal = normal.try_normalize(0.0).unwrap_or(Vector3::repeat(f64::NAN));
    }
    Ok(normals)
}

fn check_faces(points: &Points, faces: &[[usize; 3]]) -> Result<()> {
    let beyond = |face: &[usize; 3]| face.iter().any(|&vertex| vertex >= points.len());
    let Some(row) = faces.iter().position(beyond) else { return Ok(()) };
    let remedy = format!("the cloud has {} points", points.len());
    Err(Error::invalid("faces", format!("{:?} in row {row}", faces[row]), remedy))
}

/// Normal of a face, scaled to twice its area.
fn area_vector(points: &Points, &[a, b, c]: &[usize; 3]) -> Vector3<f64> {
    (points.get(b) - points.get(a)).cross(&(points.get(c) - points.get(a)))
}

/// +1 for faces whose winding is kept, -1 for reversed ones.
fn orientations(points: &Points, faces: &[[usize; 3]], execution: &Execution) -> Result<Vec<i8>> {
    let edges = Edges::new(faces, points.len(), execution)?;
    let mut signs = memory::filled(0, faces.len())?;
    let mut part = Vec::new();
    for seed in 0..faces.len() {
        if signs[seed] != 0 {
            continue;
        }
        spread(seed, &edges, &mut signs, &mut part, execution)?;
        let is_closed = part.iter().all(|&face| !edges.is_border(face));
        let vote: f64 = if is_closed {
            part.iter().map(|&face| f64::from(signs[face]) * signed_volume(points, &faces[face])).sum()
        } else {
            part.iter().map(|&face| f64::from(signs[face]) * area_vector(points, &faces[face]).norm()).sum()
        };
        if vote < 0.0 {
            for &face in &part {
                signs[face] = -signs[face];
            }
        }
    }
    Ok(signs)
}

/// Propagates the sign of `seed` to all connected faces, and lists them in `part`.
fn spread(
    seed: usize,
    edges: &Edges<'_>,
    signs: &mut [i8],
    part: &mut Vec<usize>,
    execution: &Execution,
) -> Result<()> {
    part.clear();
    memory::push(part, seed)?;
    signs[seed] = 1;
    let mut next = 0;
    while next < part.len() {
        if next.is_multiple_of(STRETCH) {
            execution.check()?;
        }
        let face = part[next];
        next += 1;
        for (other, is_parallel) in edges.around(face) {
            if signs[other] == 0 {
                signs[other] = if is_parallel { -signs[face] } else { signs[face] };
                memory::push(part, other)?;
            }
        }
    }
    Ok(())
}

/// Six times the signed volume between a face and the cloud's centre.
fn signed_volume(points: &Points, face: &[usize; 3]) -> f64 {
    points.get(face[0]).coords.dot(&area_vector(points, face))
}

#[cfg(test)]
mod tests {
    use super::*;

    const OCTAHEDRON: [[f64; 3]; 6] = [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
    ];
    const FACES: [[usize; 3]; 8] =
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];

    fn check_outward(faces: &[[usize; 3]]) -> Result<()> {
        let points = Points::from_rows("points", &OCTAHEDRON)?;
        for (normal, vertex) in mesh_normals(&points, faces, &Execution::default())?.iter().zip(OCTAHEDRON) {
            assert!((normal - Vector3::from(vertex)).amax() < 1e-12);
        }
        Ok(())
    }

    #[test]
    fn closed_meshes_point_outwards_however_they_are_wound() -> Result<()> {
        check_outward(&FACES)?;
        check_outward(&FACES.map(|[a, b, c]| [a, c, b]))?;
        let mut mixed = FACES;
        mixed[2] = [1, 4, 3];
        mixed[5] = [1, 5, 2];
        check_outward(&mixed)
    }

    #[test]
    fn open_meshes_keep_the_winding_of_most_of_their_area() -> Result<()> {
        let rows: Vec<[f64; 3]> = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 1.0], [2.0, 0.0]]
            .map(|[x, y]| [x, y, 0.0])
            .to_vec();
        let points = Points::from_rows("points", &rows)?;
        let faces = [[0, 1, 2], [0, 2, 3], [1, 4, 2], [1, 4, 5]];
        for (faces, z) in [(faces, 1.0), (faces.map(|[a, b, c]| [a, c, b]), -1.0)] {
            for normal in mesh_normals(&points, &faces, &Execution::default())? {
                assert!((normal - Vector3::new(0.0, 0.0, z)).amax() < 1e-12);
            }
        }
        Ok(())
    }

    #[test]
    fn vertices_without_area_have_none() -> Result<()> {
        let points = Points::from_rows("points", &[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [5.0; 3]])?;
        assert!(
            mesh_normals(&points, &[[0, 1, 2]], &Execution::default())?
                .iter()
                .all(|normal| normal.x.is_nan())
        );
        assert!(mesh_normals(&points, &[], &Execution::default())?.iter().all(|normal| normal.x.is_nan()));
        assert!(mesh_normals(&points, &[[0, 1, 4]], &Execution::default()).is_err());
        Ok(())
    }

    #[test]
    fn edges_of_three_faces_connect_none_of_them() -> Result<()> {
        let rows = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]];
        let faces = [[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 1, 2]];
        let edges = Edges::new(&faces, rows.len(), &Execution::default())?;
        assert!((0..3).all(|face| edges.is_border(face)));
        assert_eq!(edges.around(1).next(), None);
        let points = Points::from_rows("points", &rows)?;
        let normals = mesh_normals(&points, &faces, &Execution::default())?;
        assert!((normals[3] + Vector3::y()).amax() < 1e-12 && (normals[4] + Vector3::z()).amax() < 1e-12);
        Ok(())
    }

    #[test]
    fn an_interruption_ends_the_computation() -> Result<()> {
        let points = Points::from_rows("points", &OCTAHEDRON)?;
        let execution = Execution::default();
        execution.interrupt();
        assert_eq!(mesh_normals(&points, &FACES, &execution), Err(Error::Interrupted));
        Ok(())
    }
}
