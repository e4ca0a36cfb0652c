//! Parses files of point clouds, and tables of numbers, from bytes to arrays; and writes clouds.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use cgroup::cloud_formats::encode::{self, Precision};
use cgroup::cloud_formats::{CloudContent, PARSERS, colmap, e57, gltf, lzf, rows, table};
use cgroup::{Error, Execution, memory};
use numpy::{
    Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyBytes;

use crate::convert::{array, checked, choose};
use crate::run::{RunOptions, run, run_inline};

/// Bytes parsed within a millisecond.
const SMALL: usize = 1 << 14;

/// A cloud for Python: points, normals, faces and colours, each (N,3); the viewpoint; intensities (N,).
type PyCloudContent<'py> = (
    Bound<'py, PyArray2<f64>>,
    Option<Bound<'py, PyArray2<f64>>>,
    Option<Bound<'py, PyArray2<i64>>>,
    Option<Bound<'py, PyArray2<u8>>>,
    Option<Bound<'py, PyArray1<f64>>>,
    Option<Bound<'py, PyArray1<f32>>>,
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
        cloud.intensities.map(|numbers| PyArray1::from_vec(py, numbers)),
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

/// The first page of E57 with a wrong checksum.
#[pyfunction]
pub fn wrong_page(pages: PyReadonlyArray2<'_, u8>) -> PyResult<Option<usize>> {
    let pages = pages.as_slice()?;
    Ok(e57::wrong_page(pages))
}

/// Content as pages of E57 with their checksums.
#[pyfunction]
pub fn seal_pages<'py>(py: Python<'py>, content: &[u8]) -> PyResult<Bound<'py, PyBytes>> {
    Ok(PyBytes::new(py, &checked(e57::seal_pages(content))?))
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

/// Parses a content.
fn parse_with<T: Send + 'static>(
    py: Python<'_>,
    content: PyBackedBytes,
    run_options: &RunOptions,
    parse: fn(&[u8], &Execution) -> Result<T, Error>,
) -> PyResult<T> {
    run_sized(py, content.len(), run_options, move |execution| parse(&content, execution))
}

/// Works on some bytes on another thread, unless handing over takes longer than the work.
fn run_sized<T: Send + 'static>(
    py: Python<'_>,
    bytes: usize,
    run_options: &RunOptions,
    work: impl FnOnce(&Execution) -> Result<T, Error> + Send + 'static,
) -> PyResult<T> {
    if bytes <= SMALL { run_inline(py, work) } else { run(py, run_options, work) }
}

/// An array (N,3), without a copy.
fn triples<T: Element>(py: Python<'_>, rows: Vec<[T; 3]>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let count = rows.len();
    PyArray1::from_vec(py, rows.into_flattened()).reshape([count, 3])
}

/// Encodes a cloud as `ply` or `pcd`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the fields of a cloud")]
pub fn encode_cloud<'py>(
    py: Python<'py>,
    suffix: &str,
    points: PyReadonlyArrayDyn<'py, f64>,
    normals: Option<PyReadonlyArrayDyn<'py, f64>>,
    faces: Option<PyReadonlyArrayDyn<'py, i64>>,
    colors: Option<PyReadonlyArrayDyn<'py, u8>>,
    intensities: Option<PyReadonlyArray1<'py, f32>>,
    viewpoint: Option<[f64; 3]>,
    is_single: bool,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyBytes>> {
    let cloud = CloudContent {
        points: checked(memory::copied(rows_of("points", &points)?))?,
        normals: some_rows("normals", normals.as_ref())?.map(memory::copied).map(checked).transpose()?,
        faces: some_rows("faces", faces.as_ref())?.map(memory::copied).map(checked).transpose()?,
        colors: some_rows("colors", colors.as_ref())?.map(memory::copied).map(checked).transpose()?,
        intensities: intensities.map(|numbers| checked(memory::copied(numbers.as_slice()?))).transpose()?,
        viewpoint,
    };
    let encode = if suffix == "ply" { encode::ply } else { encode::pcd };
    let precision = if is_single { Precision::Single } else { Precision::Double };
    let content = run(py, &run_options, move |_| encode(&cloud, precision))?;
    Ok(PyBytes::new(py, &content))
}

/// The rows of an array (N,3).
fn rows_of<'a, T: Element>(name: &str, array: &'a PyReadonlyArrayDyn<'_, T>) -> PyResult<&'a [[T; 3]]> {
    match array.shape() {
        [_, 3] => Ok(array.as_slice()?.as_chunks().0),
        other => checked(Err(Error::invalid(name, format!("shape {other:?}"), "give (N,3)"))),
    }
}

fn some_rows<'a, T: Element>(
    name: &str,
    array: Option<&'a PyReadonlyArrayDyn<'_, T>>,
) -> PyResult<Option<&'a [[T; 3]]>> {
    array.map(|array| rows_of(name, array)).transpose()
}

/// Numbers in the lines of a text, read and replaced.
#[pyclass(frozen, module = "cgroup._core")]
pub struct TextRows {
    core: rows::Rows,
    widths: Vec<usize>,
}

#[pymethods]
impl TextRows {
    #[new]
    fn new(text: PyBackedBytes, layouts: Vec<(String, Vec<usize>)>, separator: &str) -> PyResult<Self> {
        let widths = layouts.iter().map(|(_, columns)| columns.len()).collect();
        let core = checked(rows::Rows::new(text.to_vec(), &layouts, separator.bytes().next()))?;
        Ok(Self { core, widths })
    }

    /// The numbers of the lines of each layout, (m,k).
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        let sizes = self.core.numbers().iter().zip(&self.widths);
        let array = |(numbers, &width): (&Vec<f64>, &usize)| {
            let shape = [numbers.len() / width.max(1), width];
            PyArray1::from_slice(py, numbers).reshape(shape)
        };
        sizes.map(array).collect()
    }

    /// The text with other numbers, (m,k) of each layout.
    fn replaced<'py>(
        &self,
        py: Python<'py>,
        numbers: Vec<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let numbers: Vec<Vec<f64>> =
            numbers.iter().map(|array| array.as_array().iter().copied().collect()).collect();
        Ok(PyBytes::new(py, &checked(self.core.replaced(&numbers))?))
    }
}

/// The separator and the words of a line of columns, and whether it is a comment.
#[pyfunction]
pub fn columns_of(line: &[u8]) -> PyResult<(String, Vec<String>, bool)> {
    let (separator, words, is_comment) = checked(rows::columns_of(line))?;
    Ok((separator.map(char::from).into_iter().collect(), words, is_comment))
}

/// A file of a COLMAP model: its content, and the rows of numbers in it.
#[pyclass(frozen, module = "cgroup._core")]
pub struct ColmapFile {
    name: String,
    core: Arc<colmap::File<PyBackedBytes>>,
}

#[pymethods]
impl ColmapFile {
    #[new]
    fn new(py: Python<'_>, name: String, content: PyBackedBytes) -> PyResult<Self> {
        let (of, bytes) = (name.clone(), content.len());
        let find = move |execution: &Execution| colmap::File::new(&of, content, execution);
        Ok(Self { core: Arc::new(run_sized(py, bytes, &RunOptions::single(), find)?), name })
    }

    /// Arguments that make an equal object, for `pickle`.
    fn __getnewargs__(&self, py: Python<'_>) -> (&str, PyBackedBytes) {
        (&self.name, self.content(py))
    }

    fn content(&self, py: Python<'_>) -> PyBackedBytes {
        self.core.content().clone_ref(py)
    }

    /// The rows of numbers, (n,7).
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.core.rows();
        array(py, rows.as_flattened().iter().copied())?.reshape([rows.len(), colmap::WIDTH])
    }

    /// The names of images; invalid UTF-8 is replaced.
    fn image_names(&self) -> PyResult<Vec<String>> {
        checked(self.core.image_names())
    }

    /// The file with other positions (n,3), or poses (n,7).
    fn replaced<'py>(&self, py: Python<'py>, numbers: PyReadonlyArray2<'py, f64>) -> PyResult<Self> {
        let numbers = checked(memory::collect(numbers.as_array().iter().copied()))?;
        let (core, bytes) = (Arc::clone(&self.core), self.core.content().len());
        let replace = move |execution: &Execution| core.replaced(&numbers, execution);
        let changed = run_sized(py, bytes, &RunOptions::single(), replace)?;
        let core = Arc::new(changed.map(|content| PyBytes::new(py, &content).into()));
        Ok(Self { name: self.name.clone(), core })
    }
}

/// Writes E57; the bytes of a file are returned as they are complete.
#[pyclass(frozen, module = "cgroup._core")]
pub struct E57Writer {
    core: Mutex<e57::writer::Writer>,
}

#[pymethods]
impl E57Writer {
    #[new]
    fn new() -> PyResult<Self> {
        Ok(Self { core: Mutex::new(checked(e57::writer::Writer::new())?) })
    }

    /// Begins a scan; `pose` is its position, and quaternion w x y z.
    fn begin(&self, name: &str, pose: ([f64; 3], [f64; 4]), count: u64) -> PyResult<()> {
        checked(self.with(|writer| writer.begin(name, pose, count)))
    }

    /// Adds points to the scan.
    fn add<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArrayDyn<'py, f64>,
        normals: Option<PyReadonlyArrayDyn<'py, f64>>,
        colors: Option<PyReadonlyArrayDyn<'py, u8>>,
        intensities: Option<PyReadonlyArray1<'py, f32>>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let block = e57::writer::Points {
            points: rows_of("points", &points)?,
            normals: some_rows("normals", normals.as_ref())?,
            colors: some_rows("colors", colors.as_ref())?,
            intensities: intensities.as_ref().map(|numbers| numbers.as_slice()).transpose()?,
        };
        let pages = checked(self.with(|writer| writer.add(block).and_then(|()| writer.take())))?;
        Ok(PyBytes::new(py, &pages))
    }

    /// Ends the file; returns the rest of it, and its first page.
    fn finish<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyBytes>)> {
        let ended = self.with(|writer| std::mem::replace(writer, e57::writer::Writer::new()?).finish());
        let (rest, first) = checked(ended)?;
        Ok((PyBytes::new(py, &rest), PyBytes::new(py, &first)))
    }
}

impl E57Writer {
    fn with<T>(&self, work: impl FnOnce(&mut e57::writer::Writer) -> Result<T, Error>) -> Result<T, Error> {
        work(&mut self.core.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
    }
}
