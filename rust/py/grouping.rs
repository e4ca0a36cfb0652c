//! All grouping methods through one function.

use cgroup::geometry::rigid::fit_group;
use cgroup::memory;
use numpy::PyArray2;
use numpy::ndarray::Ix2;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{self, Fields, PyParts, Reals};
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
