//! Parses files of point clouds, and tables of numbers, from bytes to arrays.

use std::collections::BTreeMap;

use cgroup::cloud_formats::{CloudContent, PARSERS, e57, gltf, lzf, table};
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

/// A field of E57: its name, bytes of a float or 0 for integers, their least and greatest, scale, offset; the
/// limits of a colour.
type PyField = (String, u8, i64, i64, f64, f64, Option<(f64, f64)>);

/// Numbers of a field of E57, (N,).
#[derive(IntoPyObject)]
pub enum PyColumn<'py> {
    Numbers(Bound<'py, PyArray1<f64>>),
    Bytes(Bound<'py, PyArray1<u8>>),
}

/// Parses a file's content; `suffix` is the usual one of its format, without the dot.
#[pyfunction]
pub fn parse_cloud<'py>(
    py: Python<'py>,
    content: PyBackedBytes,
    suffix: &Bound<'py, PyAny>,
    run_options: RunOptions,
) -> PyResult<PyCloudContent<'py>> {
    let parse = choose("suffix", suffix, &PARSERS)?;
    py_cloud(py, parse_with(py, content, &run_options, parse)?)
}

/// Addresses of the files that hold buffers of a glTF file.
#[pyfunction]
pub fn gltf_files(py: Python<'_>, content: PyBackedBytes, run_options: RunOptions) -> PyResult<Vec<String>> {
    parse_with(py, content, &run_options, gltf::files_of)
}

/// Parses a glTF file with the contents of other files by their addresses.
#[pyfunction]
pub fn parse_gltf(
    py: Python<'_>,
    content: PyBackedBytes,
    files: BTreeMap<String, PyBackedBytes>,
    run_options: RunOptions,
) -> PyResult<PyCloudContent<'_>> {
    let cloud = run(py, &run_options, move |execution| {
        let files = files.iter().map(|(address, content)| (address.as_str(), &**content)).collect();
        gltf::parse_with(&content, &files, execution)
    })?;
    py_cloud(py, cloud)
}

fn py_cloud(py: Python<'_>, cloud: CloudContent) -> PyResult<PyCloudContent<'_>> {
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

/// CRC-32C of each page of E57, whose contents of 1020 bytes are concatenated.
#[pyfunction]
pub fn page_checksums(
    py: Python<'_>,
    contents: PyBackedBytes,
    run_options: RunOptions,
) -> PyResult<Bound<'_, PyArray1<u32>>> {
    Ok(PyArray1::from_vec(py, parse_with(py, contents, &run_options, e57::checksums)?))
}

/// Unpacks points of E57 from the packets between two bytes: a column of each field that is not None.
#[pyfunction]
pub fn unpack_e57(
    py: Python<'_>,
    content: PyBackedBytes,
    section: (usize, usize),
    fields: Vec<Option<PyField>>,
    count: usize,
    run_options: RunOptions,
) -> PyResult<Vec<PyColumn<'_>>> {
    let columns = run(py, &run_options, move |execution| {
        let section = content.get(section.0..section.1).unwrap_or_default();
        let fields: Vec<_> = fields.into_iter().map(|field| field.map(e57_field)).collect();
        e57::unpack(section, &fields, count, execution)
    })?;
    Ok(columns.into_iter().map(|column| py_column(py, column)).collect())
}

fn e57_field((name, size, least, most, scale, offset, limits): PyField) -> e57::Field {
    let encoding = match size {
        0 => e57::Encoding::Integer { least, most, scale, offset },
        4 => e57::Encoding::Single,
        _ => e57::Encoding::Double,
    };
    e57::Field { name, encoding, limits }
}

fn py_column(py: Python<'_>, column: e57::Column) -> PyColumn<'_> {
    match column {
        e57::Column::Numbers(numbers) => PyColumn::Numbers(PyArray1::from_vec(py, numbers)),
        e57::Column::Bytes(bytes) => PyColumn::Bytes(PyArray1::from_vec(py, bytes)),
    }
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
