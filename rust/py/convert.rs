//! Conversion between numpy arrays and the core's types; no other module accesses arrays.

use cgroup::frames::Frames;
use cgroup::rule::{Agreement, Rule};
use cgroup::{Alternative, Correspondences, Error, Grouping, Points, memory};
use nalgebra::{Matrix4, SMatrix};
use numpy::ndarray::{Dimension, Ix1, Ix2, Ix3};
use numpy::{Element, PyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyModule, PyString};

use crate::error::to_python;

/// A contiguous array of either precision.
pub enum Reals<'py, D: Dimension> {
    /// float32
    Single(PyReadonlyArray<'py, f32, D>),
    /// float64
    Double(PyReadonlyArray<'py, f64, D>),
}

impl<'py, D: Dimension> FromPyObject<'_, 'py> for Reals<'py, D> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        match object.cast::<PyArray<f32, D>>() {
            Ok(array) => Ok(Self::Single(array.try_readonly()?)),
            Err(_) => Ok(Self::Double(object.cast::<PyArray<f64, D>>()?.try_readonly()?)),
        }
    }
}

/// A Python `Fields`; that class has checked shapes and types.
#[derive(FromPyObject)]
pub struct Fields<'py> {
    source: Option<Reals<'py, Ix2>>,
    target: Option<Reals<'py, Ix2>>,
    similarity: Option<Reals<'py, Ix1>>,
    ratio: Option<Reals<'py, Ix1>>,
    source_lrf: Option<Reals<'py, Ix3>>,
    target_lrf: Option<Reals<'py, Ix3>>,
    resolution: Option<f64>,
    source_centroid: Option<Reals<'py, Ix1>>,
    candidates: Option<Reals<'py, Ix3>>,
}

impl Fields<'_> {
    /// The core's correspondences; it checks the values.
    pub fn to_core(&self) -> PyResult<Correspondences> {
        let mut result = self.positions()?;
        if let Some(similarity) = &self.similarity {
            result = checked(result.with_similarity(similarity.vector()?))?;
        }
        if let Some(ratio) = &self.ratio {
            result = checked(result.with_ratio(ratio.vector()?))?;
        }
        if let (Some(source), Some(target)) = (&self.source_lrf, &self.target_lrf) {
            result = checked(result.with_frames(source.frames()?, target.frames()?))?;
        }
        if let Some(resolution) = self.resolution {
            result = checked(result.with_resolution(resolution))?;
        }
        if let Some([x, y, z]) = self.source_centroid.as_ref().map(Reals::vector).transpose()?.as_deref() {
            result = checked(result.with_source_centroid([*x, *y, *z]))?;
        }
        if let Some(candidates) = &self.candidates {
            result = checked(result.with_candidates(candidates.points("candidates")?))?;
        }
        Ok(result)
    }

    /// Correspondences with their points, if the method uses points.
    fn positions(&self) -> PyResult<Correspondences> {
        if let (Some(source), Some(target)) = (&self.source, &self.target) {
            return checked(Correspondences::between(source.points("source")?, target.points("target")?));
        }
        let len = self.similarity.as_ref().or(self.ratio.as_ref()).map_or(Ok(0), Reals::len)?;
        Ok(Correspondences::without_positions(len))
    }
}

/// Converts a result of the core for Python.
pub fn checked<T>(result: Result<T, Error>) -> PyResult<T> {
    result.map_err(|error| to_python(&error))
}

impl Reals<'_, Ix2> {
    /// A set of points; `name` is used in the error message.
    pub fn points(&self, name: &str) -> PyResult<Points> {
        self.triples(name)
    }

    /// The numbers, row by row in any layout.
    pub fn numbers(&self) -> PyResult<Vec<f64>> {
        checked(match self {
            Self::Single(array) => memory::collect(array.as_array().iter().copied().map(f64::from)),
            Self::Double(array) => memory::collect(array.as_array().iter().copied()),
        })
    }

    /// The rows as given.
    pub fn rows(&self) -> PyResult<Vec<[f64; 3]>> {
        checked(match self {
            Self::Single(array) => {
                memory::collect(array.as_slice()?.as_chunks().0.iter().map(|row| row.map(f64::from)))
            }
            Self::Double(array) => memory::copied(array.as_slice()?.as_chunks().0),
        })
    }
}

impl<D: Dimension> Reals<'_, D> {
    /// Points from an array whose last axis has length three.
    fn triples(&self, name: &str) -> PyResult<Points> {
        checked(match self {
            Self::Single(array) => Points::from_numbers(name, array.as_slice()?.as_chunks::<3>().0),
            Self::Double(array) => Points::from_numbers(name, array.as_slice()?.as_chunks::<3>().0),
        })
    }
}

impl Reals<'_, Ix1> {
    fn len(&self) -> PyResult<usize> {
        Ok(match self {
            Self::Single(array) => array.len()?,
            Self::Double(array) => array.len()?,
        })
    }

    /// The numbers.
    pub fn vector(&self) -> PyResult<Vec<f64>> {
        checked(match self {
            Self::Single(array) => memory::collect(array.as_slice()?.iter().copied().map(f64::from)),
            Self::Double(array) => memory::copied(array.as_slice()?),
        })
    }
}

impl Reals<'_, Ix3> {
    /// Points from concatenated rows of blocks.
    fn points(&self, name: &str) -> PyResult<Points> {
        self.triples(name)
    }

    /// The numbers of each block, in any layout.
    pub fn blocks<const N: usize>(&self) -> PyResult<Vec<[f64; N]>> {
        let numbers = checked(match self {
            Self::Single(array) => memory::collect(array.as_array().iter().copied().map(f64::from)),
            Self::Double(array) => memory::collect(array.as_array().iter().copied()),
        })?;
        checked(memory::copied(numbers.as_chunks().0))
    }

    /// Frames, one per block.
    pub fn frames(&self) -> PyResult<Frames> {
        checked(match self {
            Self::Single(array) => memory::copied(array.as_slice()?.as_chunks().0).map(Frames::Single),
            Self::Double(array) => memory::copied(array.as_slice()?.as_chunks().0).map(Frames::Double),
        })
    }
}

/// A one-dimensional array of the items.
pub fn array<T: Element>(
    py: Python<'_>,
    items: impl IntoIterator<Item = T>,
) -> PyResult<Bound<'_, PyArray1<T>>> {
    Ok(PyArray1::from_vec(py, checked(memory::collect(items))?))
}

/// Rows of a matrix in numpy's order.
pub fn rows<const R: usize, const C: usize>(matrix: &SMatrix<f64, R, C>) -> [[f64; C]; R] {
    // Transposed, because nalgebra stores columns.
    matrix.transpose().into()
}

/// A 4x4 array.
pub fn matrix<'py>(py: Python<'py>, matrix: &Matrix4<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    array(py, rows(matrix).into_iter().flatten())?.reshape([4, 4])
}

/// An array (k,4,4).
pub fn matrices(
    py: Python<'_>,
    found: impl ExactSizeIterator<Item = Matrix4<f64>>,
) -> PyResult<Bound<'_, PyArray3<f64>>> {
    let shape = [found.len(), 4, 4];
    let found = checked(memory::collect(found.map(|matrix| rows(&matrix))))?;
    PyArray1::from_vec(py, found.into_flattened().into_flattened()).reshape(shape)
}

/// An array (m,n).
fn masks<'py>(py: Python<'py>, found: &[Vec<bool>], n: usize) -> PyResult<Bound<'py, PyArray2<bool>>> {
    let mut numbers = checked(memory::with_capacity(found.len() * n))?;
    found.iter().for_each(|mask| numbers.extend_from_slice(mask));
    PyArray1::from_vec(py, numbers).reshape([found.len(), n])
}

/// The fields of a `cgroup.types.Grouping` that the core sets.
#[derive(IntoPyObject)]
pub struct PyGrouping<'py> {
    mask: Bound<'py, PyArray1<bool>>,
    scores: Option<Bound<'py, PyArray1<f64>>>,
    threshold: Option<f64>,
    model: Option<Bound<'py, PyArray2<f64>>>,
    diagnostics: Bound<'py, PyDict>,
    alternatives: Option<Bound<'py, PyArray3<f64>>>,
    alternative_scores: Option<Bound<'py, PyArray1<f64>>>,
    ok: Option<bool>,
    false_alarms: Option<f64>,
    noise: Option<f64>,
    instances: Option<Bound<'py, PyArray2<bool>>>,
}

/// The fields of a `cgroup.types.Rule` that the core sets.
#[derive(IntoPyObject)]
pub struct PyRule<'py> {
    kind: &'static str,
    bound: Option<f64>,
    accepts_equality: bool,
    decided_by: Option<Bound<'py, PyArray1<i64>>>,
    conflicts: Option<Bound<'py, PyArray1<i64>>>,
    votes: Option<Bound<'py, PyArray2<f64>>>,
}

/// A `cgroup.types.Agreement`.
#[derive(IntoPyObject)]
pub struct PyAgreement {
    bound: f64,
    is_ratio: bool,
    accepts_equality: bool,
    least_sum: Option<f64>,
    least_each: Option<f64>,
    scale: f64,
}

/// A grouping for `cgroup.types`.
pub type PyParts<'py> = (PyGrouping<'py>, PyRule<'py>, Option<PyAgreement>);

/// Converts a rule.
fn rule(py: Python<'_>, result: Rule) -> PyResult<(PyRule<'_>, Option<PyAgreement>)> {
    let row = |row: Option<usize>| row.map_or(-1, |row| row as i64);
    let decided_by = result.decided_by.map(|rows| array(py, rows.into_iter().map(row))).transpose()?;
    let counts = |counts: Vec<usize>| array(py, counts.into_iter().map(|count| count as i64));
    let places = |votes: Vec<Option<[f64; 3]>>| {
        let shape = [votes.len(), 3];
        array(py, votes.into_iter().flat_map(|vote| vote.unwrap_or([f64::NAN; 3])))?.reshape(shape)
    };
    let parts = PyRule {
        kind: result.kind.name(),
        bound: result.bound,
        accepts_equality: result.accepts_equality,
        decided_by,
        conflicts: result.conflicts.map(counts).transpose()?,
        votes: result.votes.map(places).transpose()?,
    };
    let agreement = |Agreement { bound, is_ratio, accepts_equality, least_sum, least_each, scale }| {
        PyAgreement { bound, is_ratio, accepts_equality, least_sum, least_each, scale }
    };
    Ok((parts, result.agreement.map(agreement)))
}

/// Converts a grouping.
pub fn grouping(py: Python<'_>, result: Grouping) -> PyResult<PyParts<'_>> {
    let (rule, agreement) = rule(py, result.rule)?;
    let diagnostics = PyDict::new(py);
    for (name, value) in &result.diagnostics {
        diagnostics.set_item(name, value)?;
    }
    let instances = result.instances.as_ref().map(|found| masks(py, found, result.mask.len())).transpose()?;
    let alternatives = result.alternatives.as_deref();
    let models = |found: &[Alternative]| matrices(py, found.iter().map(|one| one.model));
    let scores = |found: &[Alternative]| array(py, found.iter().map(|one| one.score));
    let parts = PyGrouping {
        mask: PyArray1::from_vec(py, result.mask),
        scores: result.scores.map(|scores| PyArray1::from_vec(py, scores)),
        threshold: result.threshold,
        model: result.model.map(|model| matrix(py, &model)).transpose()?,
        diagnostics,
        alternatives: alternatives.map(models).transpose()?,
        alternative_scores: alternatives.map(scores).transpose()?,
        ok: result.ok,
        false_alarms: result.false_alarms,
        noise: result.noise,
        instances,
    };
    Ok((parts, rule, agreement))
}

/// The choice of option `name` that equals `given`.
pub fn choose<T: Copy>(name: &str, given: &Bound<'_, PyAny>, choices: &[(&str, T)]) -> PyResult<T> {
    let word = given.cast::<PyString>().ok().and_then(|word| word.to_str().ok());
    match choices.iter().find(|(choice, _)| word == Some(choice)) {
        Some((_, value)) => Ok(*value),
        None => Err(refused(name, given, &one_of(choices))),
    }
}

/// The error for an invalid option, worded as in `cgroup._checks.values`.
pub fn refused(name: &str, given: &Bound<'_, PyAny>, remedy: &str) -> PyErr {
    let error = values(given.py()).and_then(|rule| rule.call_method1("refusal", (name, given, remedy)));
    error.map_or_else(|failed| failed, PyErr::from_value)
}

/// The module that validates numbers, truth values and choices.
pub fn values(py: Python<'_>) -> PyResult<Bound<'_, PyModule>> {
    py.import("cgroup._checks.values")
}

/// The choices for an error message.
fn one_of<T>(choices: &[(&str, T)]) -> String {
    let known: Vec<String> = choices.iter().map(|(choice, _)| format!("{choice:?}")).collect();
    format!("choose one of {}", known.join(", "))
}
