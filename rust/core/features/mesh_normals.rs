//! Vertex normals of a triangle mesh: area-weighted means of the faces' normals, consistently oriented.
//!
//! Scans and models are stored with either winding, and now and then with both. Faces are therefore
//! turned alike within every connected part: outwards where the part is closed, else as most of its area
//! is wound. Cost O(F log F).

use nalgebra::Vector3;

use crate::error::{Error, Result};
use crate::points::Points;

/// Unit normals, one per point; NaN at points without a face of positive area.
///
/// # Errors
/// [`Error::InvalidInput`] for a face with an index beyond the cloud.
pub fn mesh_normals(points: &Points, faces: &[[usize; 3]]) -> Result<Vec<Vector3<f64>>> {
    for (row, face) in faces.iter().enumerate() {
        if face.iter().any(|&vertex| vertex >= points.len()) {
            let remedy = format!("the cloud has {} points", points.len());
            return Err(Error::invalid("faces", format!("{face:?} in row {row}"), remedy));
        }
    }
    let mut normals = vec![Vector3::zeros(); points.len()];
    for (face, sign) in faces.iter().zip(orientations(points, faces)) {
        let area = area_vector(points, face) * sign;
        for &vertex in face {
            normals[vertex] += area;
        }
    }
    let unit = |normal: Vector3<f64>| normal.try_normalize(0.0).unwrap_or(Vector3::repeat(f64::NAN));
    Ok(normals.into_iter().map(unit).collect())
}

/// Normal of a face, twice its area long.
fn area_vector(points: &Points, &[a, b, c]: &[usize; 3]) -> Vector3<f64> {
    (points.get(b) - points.get(a)).cross(&(points.get(c) - points.get(a)))
}

/// A face next to another: its number, and whether both run the shared edge the same way.
type Neighbor = (usize, bool);

/// +1 where a face's winding is kept, -1 where it is turned.
fn orientations(points: &Points, faces: &[[usize; 3]]) -> Vec<f64> {
    let (neighbors, is_border) = adjacency(faces);
    let mut signs = vec![0.0; faces.len()];
    for seed in 0..faces.len() {
        if signs[seed] != 0.0 {
            continue;
        }
        let part = spread(seed, &neighbors, &mut signs);
        let is_closed = part.iter().all(|&face| !is_border[face]);
        let vote: f64 = if is_closed {
            part.iter().map(|&face| signs[face] * signed_volume(points, &faces[face])).sum()
        } else {
            part.iter().map(|&face| signs[face] * area_vector(points, &faces[face]).norm()).sum()
        };
        if vote < 0.0 {
            for face in part {
                signs[face] = -signs[face];
            }
        }
    }
    signs
}

/// Gives all faces connected to `seed` the sign that agrees with it; returns them.
fn spread(seed: usize, neighbors: &[Vec<Neighbor>], signs: &mut [f64]) -> Vec<usize> {
    let mut part = vec![seed];
    signs[seed] = 1.0;
    let mut next = 0;
    while next < part.len() {
        let face = part[next];
        next += 1;
        for &(other, is_parallel) in &neighbors[face] {
            if signs[other] == 0.0 {
                signs[other] = if is_parallel { -signs[face] } else { signs[face] };
                part.push(other);
            }
        }
    }
    part
}

/// Faces across the edges that exactly two faces share, and which faces have other edges.
fn adjacency(faces: &[[usize; 3]]) -> (Vec<Vec<Neighbor>>, Vec<bool>) {
    let mut edges: Vec<(usize, usize, usize, bool)> = Vec::with_capacity(3 * faces.len());
    for (face, &[a, b, c]) in faces.iter().enumerate() {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            edges.push((from.min(to), from.max(to), face, from < to));
        }
    }
    edges.sort_unstable();
    let mut neighbors = vec![Vec::new(); faces.len()];
    let mut is_border = vec![false; faces.len()];
    for shared in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if let &[(_, _, one, forward), (_, _, other, also_forward)] = shared {
            neighbors[one].push((other, forward == also_forward));
            neighbors[other].push((one, forward == also_forward));
        } else {
            for edge in shared {
                is_border[edge.2] = true;
            }
        }
    }
    (neighbors, is_border)
}

/// Six times the volume between a face and the cloud's centre.
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
        for (normal, vertex) in mesh_normals(&points, faces)?.iter().zip(OCTAHEDRON) {
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
            for normal in mesh_normals(&points, &faces)? {
                assert!((normal - Vector3::new(0.0, 0.0, z)).amax() < 1e-12);
            }
        }
        Ok(())
    }

    #[test]
    fn vertices_without_area_have_none() -> Result<()> {
        let points = Points::from_rows("points", &[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [5.0; 3]])?;
        assert!(mesh_normals(&points, &[[0, 1, 2]])?.iter().all(|normal| normal.x.is_nan()));
        assert!(mesh_normals(&points, &[])?.iter().all(|normal| normal.x.is_nan()));
        assert!(mesh_normals(&points, &[[0, 1, 4]]).is_err());
        Ok(())
    }
}
