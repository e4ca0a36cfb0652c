//! Clouds before they are downsampled: distinct points, outliers, rings, the voxel of several.

use std::sync::Arc;

use cgroup::Cloud as CoreCloud;
use cgroup::geometry::distinct::find_distinct;
use cgroup::registration as core;
use nalgebra::Vector3;
use numpy::ndarray::Ix2;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::cloud::Cloud;
use crate::convert::{Reals, array, checked};
use crate::features::{indices, table};
use crate::run::{RunOptions, run};

/// First row of each distinct point, and the distinct point of each row.
type PyDistinct<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>);

/// Distinct points of finite rows; None if no two coincide.
#[pyfunction]
pub fn distinct_points<'py>(py: Python<'py>, points: Reals<'py, Ix2>) -> PyResult<Option<PyDistinct<'py>>> {
    let found = checked(match &points {
        Reals::Single(array) => find_distinct(array.as_slice()?.as_chunks::<3>().0),
        Reals::Double(array) => find_distinct(array.as_slice()?.as_chunks::<3>().0),
    })?;
    let rows = |rows: Vec<u32>| array(py, rows.into_iter().map(i64::from));
    found.map(|found| Ok((rows(found.first)?, rows(found.places)?))).transpose()
}

/// Rows of outliers.
#[pyfunction]
pub fn find_outliers<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let cloud = cloud.core();
    indices(py, run(py, &run_options, move |_| core::find_outliers(&cloud))?)
}

/// Points, and the position of the scanner.
type FilledRings<'py> = (Bound<'py, PyArray2<f64>>, [f64; 3]);

/// Points of a scan and those between its rings, and the position of the scanner; None for a scan without rings.
#[pyfunction]
pub fn fill_between_rings<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    points: Reals<'py, Ix2>,
    run_options: RunOptions,
) -> PyResult<Option<FilledRings<'py>>> {
    let cloud = cloud.core();
    if cloud.points().len() > core::MOST_OF_RINGS {
        return Ok(None);
    }
    let rows = points.rows()?;
    let filled = run(py, &run_options, move |execution| core::fill_between_rings(&cloud, &rows, execution))?;
    filled.map(|filled| Ok((table(py, filled.points)?, filled.scanner))).transpose()
}

/// Whether points lie behind each other from a viewpoint.
#[pyfunction]
pub fn shows_layers(
    py: Python<'_>,
    cloud: &Cloud,
    run_options: RunOptions,
    viewpoint: [f64; 3],
    voxel: f64,
) -> PyResult<bool> {
    let cloud = cloud.core();
    run(py, &run_options, move |execution| {
        let diagonal = cloud.own()?.1.diagonal();
        core::shows_layers(cloud.points(), &Vector3::from(viewpoint), diagonal, voxel, execution)
    })
}

/// The voxel; or the rows of two clouds that no voxel suits.
type PySuited = (Option<f64>, Option<(usize, usize)>);

/// A voxel that suits all clouds; or the rows of the smallest and the largest, if none suits both.
#[pyfunction]
pub fn suit_voxel(
    py: Python<'_>,
    clouds: Vec<Bound<'_, Cloud>>,
    run_options: RunOptions,
) -> PyResult<PySuited> {
    let clouds: Vec<Arc<CoreCloud>> = clouds.iter().map(|cloud| cloud.get().core()).collect();
    let suited = run(py, &run_options, move |execution| {
        core::suit_voxel(&clouds.iter().map(AsRef::as_ref).collect::<Vec<_>>(), execution)
    })?;
    Ok(match suited {
        core::Suited::Voxel(size) => (Some(size), None),
        core::Suited::Unlike(small, large) => (None, Some((small, large))),
    })
}
