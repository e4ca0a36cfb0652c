//! The pose of surveyed targets.

use cgroup::memory;
use cgroup::targets::{self as core, Doubt};
use numpy::ndarray::Ix2;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::{Reals, array, checked, matrix, rows};
use crate::features::table;
use crate::run::{RunOptions, run};

/// The first fields of a `cgroup.targets.TargetFit`.
type PyTargetFit<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    f64,
    usize,
);

/// The pose of surveyed targets, row by row, and tests of each; suspects, the ratio of the units, and doubts.
#[pyfunction]
#[expect(clippy::type_complexity, reason = "the fields of one result")]
pub fn fit_targets<'py>(
    py: Python<'py>,
    source: Reals<'py, Ix2>,
    target: Reals<'py, Ix2>,
    sigma: Option<f64>,
    run_options: RunOptions,
) -> PyResult<(PyTargetFit<'py>, Bound<'py, PyArray1<bool>>, f64, Vec<&'static str>)> {
    let (source, target) = (source.points("source")?, target.points("target")?);
    let found =
        run(py, &run_options, move |execution| core::fit_targets(&source, &target, sigma, execution))?;
    let fit = (
        matrix(py, &found.pose.to_matrix())?,
        array(py, rows(&found.covariance).into_iter().flatten())?.reshape([6, 6])?,
        table(py, checked(memory::collect(found.residuals.into_iter().map(Into::into)))?)?,
        PyArray1::from_vec(py, found.leave_one_out),
        PyArray1::from_vec(py, found.is_blunder),
        PyArray1::from_vec(py, found.is_used),
        found.sigma,
        found.redundancy,
    );
    let doubts = found.doubts.into_iter().map(code).collect();
    Ok((fit, PyArray1::from_vec(py, found.is_suspect), found.unit, doubts))
}

/// The name under which `cgroup.targets` words a doubt.
fn code(doubt: Doubt) -> &'static str {
    match doubt {
        Doubt::Swapped => "swapped",
        Doubt::Units => "units",
        Doubt::NoRedundancy => "redundancy",
        Doubt::Residuals => "residuals",
        Doubt::Line => "line",
        Doubt::Suspects => "suspects",
        Doubt::Possible => "possible",
    }
}
