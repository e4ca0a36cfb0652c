//! Edges of a triangle mesh shared by two faces.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Items between two checks for an interruption.
pub(super) const STRETCH: usize = 1 << 16;
/// No half-edge.
const NONE: u32 = u32::MAX;

/// Edges that exactly two faces share. Half-edge `3 f + k` runs from vertex k of face f to its next one.
pub(super) struct Edges<'a> {
    faces: &'a [[usize; 3]],
    /// The other half-edge of the same edge, if there is exactly one.
    twins: Vec<u32>,
}

/// A half-edge, with the greater vertex of its edge first.
type Entry = (u32, u32);

impl<'a> Edges<'a> {
    /// Edges of faces between `vertices` vertices. Cost O(F), plus the sorting of each vertex' edges.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for more than 2^32 half-edges or vertices; [`Error::Interrupted`],
    /// [`Error::OutOfMemory`].
    pub fn new(faces: &'a [[usize; 3]], vertices: usize, execution: &Execution) -> Result<Self> {
        let count = 3 * faces.len();
        if count.max(vertices) >= NONE as usize {
            let got = format!("{} faces between {vertices} points", faces.len());
            return Err(Error::invalid("faces", got, "cut the mesh into parts of less than 10^9 faces"));
        }
        let (mut entries, ends) = by_lower_vertex(faces, vertices, execution)?;
        let mut twins = memory::filled(NONE, count)?;
        let mut start = 0;
        for (vertex, &end) in ends.iter().enumerate() {
            if vertex.is_multiple_of(STRETCH) {
                execution.check()?;
            }
            let edges = &mut entries[start..end as usize];
            edges.sort_unstable();
            for shared in edges.chunk_by(|a, b| a.0 == b.0) {
                if let &[(_, one), (_, other)] = shared {
                    (twins[one as usize], twins[other as usize]) = (other, one);
                }
            }
            start = end as usize;
        }
        Ok(Self { faces, twins })
    }

    /// Whether a face has an edge that is not shared with exactly one other face.
    pub fn is_border(&self, face: usize) -> bool {
        self.twins[3 * face..3 * face + 3].contains(&NONE)
    }

    /// The adjacent faces of a face, in the order of its edges, and whether both traverse the edge in the
    /// same direction.
    pub fn around(&self, face: usize) -> impl Iterator<Item = (usize, bool)> {
        let mut own = [0, 1, 2].map(|k| {
            let (from, to) = half_edge(&self.faces[face], k);
            (from.min(to), from.max(to), 3 * face + k)
        });
        own.sort_unstable();
        own.into_iter().filter_map(|(_, _, half)| {
            let twin = self.twins[half];
            (twin != NONE)
                .then(|| (twin as usize / 3, self.is_forward(half) == self.is_forward(twin as usize)))
        })
    }

    fn is_forward(&self, half: usize) -> bool {
        let (from, to) = half_edge(&self.faces[half / 3], half % 3);
        from < to
    }
}

fn half_edge(face: &[usize; 3], k: usize) -> (usize, usize) {
    (face[k], face[(k + 1) % 3])
}

/// All half-edges, sorted by the lower vertex of their edge, and the end of each vertex' range.
fn by_lower_vertex(
    faces: &[[usize; 3]],
    vertices: usize,
    execution: &Execution,
) -> Result<(Vec<Entry>, Vec<u32>)> {
    let mut places = memory::filled(0_u32, vertices)?;
    for faces in faces.chunks(STRETCH) {
        execution.check()?;
        for (face, k) in faces.iter().flat_map(|face| (0..3).map(move |k| (face, k))) {
            let (from, to) = half_edge(face, k);
            places[from.min(to)] += 1;
        }
    }
    let mut total = 0;
    for place in &mut places {
        total += std::mem::replace(place, total);
    }
    let mut entries = memory::filled((0, 0), total as usize)?;
    for (part, faces) in faces.chunks(STRETCH).enumerate() {
        execution.check()?;
        for (row, face) in (part * STRETCH..).zip(faces) {
            for k in 0..3 {
                let (from, to) = half_edge(face, k);
                let place = &mut places[from.min(to)];
                entries[*place as usize] = (from.max(to) as u32, (3 * row + k) as u32);
                *place += 1;
            }
        }
    }
    // Each position has advanced from the start of the vertex' range to its end.
    Ok((entries, places))
}
