//! Placements of an outline on a top-view map: walls on walls, open floor away from the map's walls.
//!
//! After E. B. Olson, *Real-time correlative scan matching*, ICRA 2009.

use std::cmp::Ordering;
use std::ops::Range;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Cells of a row that are summed at a time.
const TILE: usize = 64;
/// Most cells of an outline whose sum fits a byte.
const SUMMED: usize = u8::MAX as usize / WALL as usize;
/// Greatest value of a map cell.
pub const WALL: u8 = 2;

/// A top-view map by rows: the value of each cell is at most [`WALL`].
#[derive(Clone, Copy, Debug)]
pub struct MapGrid<'a> {
    /// Row-major cells.
    pub cells: &'a [u8],
    /// Cells in a row.
    pub width: usize,
}

/// Top-view outline of a scan about its middle, in cells.
#[derive(Clone, Copy, Debug)]
pub struct Outline<'a> {
    /// Points of walls.
    pub walls: &'a [[f64; 2]],
    /// Points of open floor.
    pub floor: &'a [[f64; 2]],
    /// Weight of open floor relative to walls.
    pub floor_weight: f32,
}

/// Cells of the map in which the middle of an outline may lie at one rotation.
#[derive(Clone, Debug)]
pub struct Window {
    /// Index of the rotation.
    pub turn: usize,
    /// Rows of the map.
    pub rows: Range<usize>,
    /// Columns of the map.
    pub columns: Range<usize>,
}

/// Placement of an outline: its score, the index of its rotation, row and column of its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Mean of the map at walls, minus the weight of open floor times the mean of the map there; 1 at most.
    pub score: f32,
    /// Index of the rotation.
    pub turn: usize,
    /// Row of the map.
    pub row: usize,
    /// Column of the map.
    pub column: usize,
}

/// Scores an outline in windows at given rotations, (cosine, sine); returns the `most` best placements, the
/// best first. Cells beyond the map count zero.
///
/// Cost O(P S) for P placements and an outline of S cells.
///
/// # Errors
/// [`Error::InvalidInput`] if a window exceeds the map or its rotation does not exist;
/// [`Error::Interrupted`], [`Error::OutOfMemory`].
pub fn best_placements(
    map: MapGrid<'_>,
    outline: Outline<'_>,
    turns: &[[f64; 2]],
    windows: &[Window],
    most: usize,
    execution: &Execution,
) -> Result<Vec<Placement>> {
    let height = map.cells.len() / map.width.max(1);
    let is_within = |window: &Window| {
        window.turn < turns.len() && window.rows.end <= height && window.columns.end <= map.width
    };
    if let Some(window) = windows.iter().find(|window| !is_within(window)) {
        return Err(Error::invalid("windows", format!("{window:?}"), "give cells of the map"));
    }
    let padded = Padded::new(map, height, reach(outline).min(height.max(map.width)))?;
    let stamps = memory::par_try_collect(turns.par_iter().map(|turn| {
        execution.check()?;
        Stamp::new(outline, *turn, &padded)
    }))?;
    let scored = memory::par_try_collect(
        windows.par_iter().map(|window| padded.best_in(window, &stamps[window.turn], most, execution)),
    )?;
    let mut all = memory::concat(&scored)?;
    keep_best(&mut all, most);
    all.sort_unstable_by(by_score);
    Ok(all)
}

/// Largest distance of an outline's cells from its middle.
fn reach(outline: Outline<'_>) -> usize {
    let farthest = outline.walls.iter().chain(outline.floor).map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
    farthest.min(f64::from(i32::MAX)) as usize + 2
}

/// Order with the best first; ties by rotation, row and column.
fn by_score(one: &Placement, other: &Placement) -> Ordering {
    let place = |at: &Placement| (at.turn, at.row, at.column);
    other.score.total_cmp(&one.score).then_with(|| place(one).cmp(&place(other)))
}

/// Removes all but the `most` best.
fn keep_best(placements: &mut Vec<Placement>, most: usize) {
    if placements.len() > most {
        if most > 0 {
            placements.select_nth_unstable_by(most - 1, by_score);
        }
        placements.truncate(most);
    }
}

/// A map with a border of zero cells.
struct Padded {
    cells: Vec<u8>,
    width: usize,
    border: usize,
}

impl Padded {
    fn new(map: MapGrid<'_>, height: usize, border: usize) -> Result<Self> {
        let width = map.width + 2 * border + TILE;
        let mut cells = memory::filled(0, width * (height + 2 * border + 1))?;
        for (row, values) in map.cells.chunks_exact(map.width.max(1)).enumerate() {
            let start = (row + border) * width + border;
            cells[start..start + map.width].copy_from_slice(values);
        }
        Ok(Self { cells, width, border })
    }

    /// The distinct cells of rotated points, without those that never lie on the map; and the weight of each
    /// in the mean over all.
    fn offsets(&self, points: &[[f64; 2]], [cosine, sine]: [f64; 2]) -> Result<(Vec<isize>, f32)> {
        let mut cells = memory::collect(points.iter().map(|[x, y]| {
            let row = (cosine * x - sine * y + 0.5).floor() as i32;
            let column = (sine * x + cosine * y + 0.5).floor() as i32;
            [row, column]
        }))?;
        cells.sort_unstable();
        cells.dedup();
        let weight = 1.0 / (f32::from(WALL) * cells.len().max(1) as f32);
        let border = self.border as u32;
        cells.retain(|cell| cell.iter().all(|place| place.unsigned_abs() <= border));
        let offset = |[row, column]: [i32; 2]| row as isize * self.width as isize + column as isize;
        Ok((memory::collect(cells.into_iter().map(offset))?, weight))
    }

    /// The best placements in a window.
    fn best_in(
        &self,
        window: &Window,
        stamp: &Stamp,
        most: usize,
        execution: &Execution,
    ) -> Result<Vec<Placement>> {
        let mut found = Vec::new();
        for row in window.rows.clone() {
            execution.check()?;
            for first in window.columns.clone().step_by(TILE) {
                let place = (row + self.border) * self.width + self.border + first;
                let walls = self.sum(place, &stamp.walls);
                let floor = self.sum(place, &stamp.floor);
                memory::reserve(&mut found, TILE)?;
                let width = TILE.min(window.columns.end - first);
                let both = walls.iter().zip(&floor).take(width).enumerate();
                found.extend(both.map(|(step, (&walls, &floor))| Placement {
                    score: stamp.wall_weight * f32::from(walls) - stamp.floor_weight * f32::from(floor),
                    turn: window.turn,
                    row,
                    column: first + step,
                }));
            }
            if found.len() > 2 * most {
                keep_best(&mut found, most);
            }
        }
        keep_best(&mut found, most);
        Ok(found)
    }

    /// Sums of the map under a stamp, with its middle at each cell of a tile.
    fn sum(&self, place: usize, offsets: &[isize]) -> [u16; TILE] {
        let mut sums = [0_u16; TILE];
        for some in offsets.chunks(SUMMED) {
            let mut bytes = [0_u8; TILE];
            for &offset in some {
                let start = place.wrapping_add_signed(offset);
                if let Some(values) = self.cells[start..].first_chunk::<TILE>() {
                    bytes.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
                }
            }
            sums.iter_mut().zip(bytes).for_each(|(sum, more)| *sum = sum.saturating_add(u16::from(more)));
        }
        sums
    }
}

/// A rotated outline: its cells as offsets in a padded map, and their weights.
#[derive(Clone, Default)]
struct Stamp {
    walls: Vec<isize>,
    floor: Vec<isize>,
    wall_weight: f32,
    floor_weight: f32,
}

impl Stamp {
    fn new(outline: Outline<'_>, turn: [f64; 2], padded: &Padded) -> Result<Self> {
        let (walls, wall_weight) = padded.offsets(outline.walls, turn)?;
        let (floor, floor_weight) = padded.offsets(outline.floor, turn)?;
        Ok(Self { walls, floor, wall_weight, floor_weight: outline.floor_weight * floor_weight })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNER: [[f64; 2]; 5] = [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [0.0, 3.0], [1.0, 0.0]];

    fn place(windows: &[Window], most: usize) -> Result<Vec<Placement>> {
        let mut cells = vec![0; 20 * 90];
        for [x, y] in CORNER {
            cells[(8 + x as usize) * 90 + 70 + y as usize] = WALL;
        }
        let outline = Outline { walls: &CORNER, floor: &[[3.0, 3.0]], floor_weight: 0.7 };
        let turns = [[1.0, 0.0], [-1.0, 0.0]];
        best_placements(
            MapGrid { cells: &cells, width: 90 },
            outline,
            &turns,
            windows,
            most,
            &Execution::default(),
        )
    }

    #[test]
    fn an_outline_is_placed_best_on_itself() {
        let all = |turn| Window { turn, rows: 0..20, columns: 0..90 };
        let found = place(&[all(1), all(0)], 3).unwrap_or_default();
        assert_eq!(found.len(), 3);
        assert_eq!(found.first(), Some(&Placement { score: 1.0, turn: 0, row: 8, column: 70 }));
        let window = Window { turn: 0, rows: 2..4, columns: 1..88 };
        assert_eq!(place(std::slice::from_ref(&window), 1000).map(|all| all.len()), Ok(2 * 87));
        assert_eq!(place(&[window], 0), Ok(vec![]));
    }

    #[test]
    fn a_window_beyond_the_map_is_refused() {
        assert!(place(&[Window { turn: 0, rows: 0..21, columns: 0..2 }], 1).is_err());
        assert!(place(&[Window { turn: 2, rows: 0..1, columns: 0..2 }], 1).is_err());
    }
}
