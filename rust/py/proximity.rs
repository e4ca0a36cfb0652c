//! Proximity of the points of one cloud to those of another.

use cgroup::geometry::neighbors::NearestNeighbors;
use cgroup::geometry::proximity::{any_within, nearest_offsets};
use numpy::ndarray::Ix2;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::convert::{Reals, array};
use crate::features::rows_of;
use crate::run::{RunOptions, run};

/// Mask of the points with at least one of the others within a radius.
#[pyfunction]
pub fn within<'py>(
    py: Python<'py>,
    points: Reals<'py, Ix2>,
    others: Reals<'py, Ix2>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let (points, others) = (points.rows()?, others.rows()?);
    let found = run(py, &run_options, move |execution| any_within(&points, &others, radius, execution))?;
    Ok(PyArray1::from_vec(py, found))
}

/// Rows of the `count` nearest other points of some of the points.
#[pyfunction]
pub fn nearest_rows<'py>(
    py: Python<'py>,
    points: Reals<'py, Ix2>,
    rows: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    count: usize,
) -> PyResult<Bound<'py, PyArray2<i64>>> {
    let (points, rows) = (points.points("points")?, rows_of(&rows)?);
    let queries = rows.len();
    let found = run(py, &run_options, move |execution| {
        NearestNeighbors::new(&points, execution)?.of_rows(&rows, count, execution)
    })?;
    let width = found.len() / queries.max(1);
    array(py, found.into_iter().map(i64::from))?.reshape([queries, width])
}

/// Vectors from the points to the nearest of the others within a radius; NaN without one.
#[pyfunction]
pub fn nearest<'py>(
    py: Python<'py>,
    points: Reals<'py, Ix2>,
    others: Reals<'py, Ix2>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (points, others) = (points.rows()?, others.rows()?);
    let found = run(py, &run_options, move |execution| nearest_offsets(&points, &others, radius, execution))?;
    let count = found.len();
    array(py, found.into_iter().flatten())?.reshape([count, 3])
}
