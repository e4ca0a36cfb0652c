//! All grouping methods through one function.

use cgroup::geometry::rigid::fit_group;
use cgroup::grouping::{bound, match_posterior, motions};
use cgroup::{Alternative, Grouping, memory};
use nalgebra::Matrix4;
use numpy::ndarray::{Ix1, Ix2, Ix3};
use numpy::{PyArray1, PyArray2, PyReadonlyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{self, Fields, PyParts, Reals, checked};
use crate::options::method_with;
use crate::run::{RunOptions, run, run_inline};

/// Groups by the method with that public name and all its options.
#[pyfunction]
pub fn group<'py>(
    py: Python<'py>,
    method: &str,
    fields: Fields<'py>,
    run_options: RunOptions,
    options: &Bound<'py, PyDict>,
) -> PyResult<PyParts<'py>> {
    let method = method_with(method, options)?;
    let correspondences = fields.to_core()?;
    let result = if method.is_instant(&correspondences) {
        run_inline(py, |execution| method.group(&correspondences, execution))
    } else {
        run(py, &run_options, move |execution| method.group(&correspondences, execution))
    };
    convert::grouping(py, result?)
}

/// Least-squares rigid transform (4,4) of all pairs of points.
#[pyfunction]
pub fn rigid_fit<'py>(
    py: Python<'py>,
    source: Reals<'py, Ix2>,
    target: Reals<'py, Ix2>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (source, target) = (source.points("source")?, target.points("target")?);
    let fit = run_inline(py, |_| {
        let all = memory::collect(0..source.len())?;
        fit_group(&source, &target, &all)
    });
    convert::matrix(py, &fit?.to_matrix())
}

/// A Python `Grouping`; only what the functions below read.
#[derive(FromPyObject)]
pub struct Given<'py> {
    mask: PyReadonlyArray<'py, bool, Ix1>,
    model: Option<Reals<'py, Ix2>>,
    alternatives: Option<Reals<'py, Ix3>>,
    false_alarms: Option<f64>,
}

impl Given<'_> {
    fn to_core(&self) -> PyResult<Grouping> {
        let model = self.model.as_ref().map(Reals::numbers).transpose()?;
        let alternatives = self.alternatives.as_ref().map(Reals::blocks::<16>).transpose()?;
        let alternative =
            |block: [f64; 16]| Alternative { model: Matrix4::from_row_slice(&block), score: 0.0 };
        Ok(Grouping {
            mask: checked(memory::copied(self.mask.as_slice()?))?,
            model: model.as_deref().filter(|model| model.len() == 16).map(Matrix4::from_row_slice),
            alternatives: alternatives.map(|blocks| blocks.into_iter().map(alternative).collect()),
            false_alarms: self.false_alarms,
            ..Grouping::default()
        })
    }
}

/// The probability that each match is correct.
#[pyfunction]
pub fn match_probabilities<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    grouping: Given<'py>,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (correspondences, grouping) = (fields.to_core()?, grouping.to_core()?);
    let work =
        move |execution: &_| match_posterior::match_probabilities(&correspondences, &grouping, execution);
    Ok(PyArray1::from_vec(py, run(py, &run_options, work)?))
}

/// The groups of several motions.
#[pyfunction]
pub fn group_motions<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    tolerance: Option<f64>,
    most: usize,
    run_options: RunOptions,
) -> PyResult<Vec<PyParts<'py>>> {
    let correspondences = fields.to_core()?;
    let work = move |execution: &_| motions::group_motions(&correspondences, tolerance, most, execution);
    run(py, &run_options, work)?.into_iter().map(|found| convert::grouping(py, found)).collect()
}

/// Numbers of inliers: of the pose, and at most of any rival.
#[pyfunction]
pub fn bound_rivals<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    model: Reals<'py, Ix2>,
    tolerance: f64,
    run_options: RunOptions,
) -> PyResult<(usize, usize)> {
    let (correspondences, model) = (fields.to_core()?, Matrix4::from_row_slice(&model.numbers()?));
    let work = move |execution: &_| bound::bound_rivals(&correspondences, &model, tolerance, execution);
    let found = run(py, &run_options, work)?;
    Ok((found.inliers, found.rivals))
}
