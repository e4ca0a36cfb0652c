//! Placements of an outline on a top-view map.

use cgroup::geometry::placements::{self as core, MapGrid, Outline, Window};
use cgroup::memory;
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::convert::{array, checked};
use crate::run::{RunOptions, run};

/// The best placements (turn, row, column) in windows (turn, first row, end of rows, first column, end of
/// columns).
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arrays of one computation")]
pub fn best_placements<'py>(
    py: Python<'py>,
    grid: PyReadonlyArray2<'py, u8>,
    walls: PyReadonlyArray2<'py, f64>,
    floor: PyReadonlyArray2<'py, f64>,
    turns: PyReadonlyArray2<'py, f64>,
    windows: PyReadonlyArray2<'py, i64>,
    run_options: RunOptions,
    floor_weight: f32,
    most: usize,
) -> PyResult<Bound<'py, PyArray2<i64>>> {
    let width = grid.shape()[1];
    let cells = checked(memory::copied(grid.as_slice()?))?;
    let pairs =
        |points: &PyReadonlyArray2<'py, f64>| checked(memory::copied(points.as_slice()?.as_chunks::<2>().0));
    let (walls, floor, turns) = (pairs(&walls)?, pairs(&floor)?, pairs(&turns)?);
    let windows = windows.as_slice()?.as_chunks::<5>().0.iter().map(|window| {
        let [turn, top, bottom, left, right] = window.map(|number| number.max(0) as usize);
        Window { turn, rows: top..bottom, columns: left..right }
    });
    let windows = checked(memory::collect(windows))?;
    let found = run(py, &run_options, move |execution| {
        let outline = Outline { walls: &walls, floor: &floor, floor_weight };
        core::best_placements(MapGrid { cells: &cells, width }, outline, &turns, &windows, most, execution)
    })?;
    let places = found.iter().flat_map(|at| [at.turn, at.row, at.column].map(|number| number as i64));
    array(py, places)?.reshape([found.len(), 3])
}
