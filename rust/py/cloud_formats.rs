//! Parses files of point clouds, and tables of numbers, from bytes to arrays.

use cgroup::cloud_formats::{PARSERS, lzf, table};
use cgroup::{Error, Execution};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyBytes;

use crate::convert::choose;
use crate::run::{RunOptions, run, run_inline};

/// Bytes parsed within a millisecond.
const SMALL: usize = 1 << 14;

/// A cloud for Python: points, normals, faces and colours, each (N,3); the viewpoint.
type PyCloudContent<'py> = (
    Bound<'py, PyArray2<f64>>,
    Option<Bound<'py, PyArray2<f64>>>,
    Option<Bound<'py, PyArray2<i64>>>,
    Option<Bound<'py, PyArray2<u8>>>,
    Option<Bound<'py, PyArray1<f64>>>,
);

/// Parses a file's content; `suffix` is the usual one of its format, without the dot.
#[pyfunction]
pub fn parse_cloud<'py>(
    py: Python<'py>,
    content: PyBackedBytes,
    suffix: &Bound<'py, PyAny>,
    run_options: RunOptions,
) -> PyResult<PyCloudContent<'py>> {
    let parse = choose("suffix", suffix, &PARSERS)?;
    let cloud = parse_with(py, content, &run_options, parse)?;
    Ok((
        triples(py, cloud.points)?,
        cloud.normals.map(|normals| triples(py, normals)).transpose()?,
        cloud.faces.map(|faces| triples(py, faces)).transpose()?,
        cloud.colors.map(|colors| triples(py, colors)).transpose()?,
        cloud.viewpoint.map(|place| PyArray1::from_slice(py, &place)),
    ))
}

/// Parses rows of numbers.
#[pyfunction]
pub fn parse_table(
    py: Python<'_>,
    content: PyBackedBytes,
    run_options: RunOptions,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let found = parse_with(py, content, &run_options, table::parse)?;
    let rows = found.numbers.len() / found.columns.max(1);
    PyArray1::from_vec(py, found.numbers).reshape([rows, found.columns])
}

/// Decompresses the LZF of PCD into `size` bytes.
#[pyfunction]
pub fn decompress_lzf(
    py: Python<'_>,
    content: PyBackedBytes,
    size: usize,
    run_options: RunOptions,
) -> PyResult<Bound<'_, PyBytes>> {
    let plain = run(py, &run_options, move |execution| lzf::decompress(&content, size, execution))?;
    Ok(PyBytes::new(py, &plain))
}

/// Parses on another thread, unless handing over takes longer than parsing.
fn parse_with<T: Send + 'static>(
    py: Python<'_>,
    content: PyBackedBytes,
    run_options: &RunOptions,
    parse: fn(&[u8], &Execution) -> Result<T, Error>,
) -> PyResult<T> {
    if content.len() <= SMALL {
        return run_inline(py, |execution| parse(&content, execution));
    }
    run(py, run_options, move |execution| parse(&content, execution))
}

/// An array (N,3), without a copy.
fn triples<T: Element>(py: Python<'_>, rows: Vec<[T; 3]>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let count = rows.len();
    PyArray1::from_vec(py, rows.into_flattened()).reshape([count, 3])
}
