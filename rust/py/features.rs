//! One function per step of the front end.

use cgroup::Points;
use cgroup::correspondences::Frame;
use cgroup::features::harris3d::{Harris3d, Response};
use cgroup::features::iss::{Covariance, Iss};
use cgroup::features::lfsh::Lfsh;
use cgroup::features::matching::{Descriptors, Match, Matching};
use cgroup::features::mesh_normals::mesh_normals as mesh_normals_of;
use cgroup::features::normals::{self as plane_fits, Neighborhood};
use cgroup::features::rcs::Rcs;
use cgroup::features::shot::Shot;
use cgroup::features::{keypoints as support, shot_lrf as shot_frames, toldi_lrf as toldi_frames};
use cgroup::geometry::resolution::resolution as mean_nearest_distance;
use nalgebra::{Point3, Vector3};
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3,
};
use pyo3::prelude::*;

use crate::convert::{self, choose};
use crate::error::to_python;
use crate::run::{RunOptions, run};

/// Mean nearest-neighbour distance.
#[pyfunction]
pub fn resolution(
    py: Python<'_>,
    points: PyReadonlyArray2<'_, f64>,
    run_options: RunOptions,
    ignore_zero: bool,
) -> PyResult<f64> {
    let points = cloud(&points)?;
    run(py, &run_options, move |execution| mean_nearest_distance(&points, ignore_zero, execution))
}

/// Plane-fit normals.
#[pyfunction]
pub fn normals<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    run_options: RunOptions,
    neighbors: usize,
    radius: Option<f64>,
    viewpoint: [f64; 3],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let points = cloud(&points)?;
    let neighborhood = radius.map_or(Neighborhood::Nearest(neighbors), Neighborhood::Radius);
    let fits = run(py, &run_options, move |execution| {
        plane_fits::surfaces(&points, neighborhood, Point3::from(viewpoint), execution)
    })?;
    vectors(py, fits.into_iter().map(|fit| fit.normal))
}

/// Area-weighted normals of a mesh's vertices.
#[pyfunction]
pub fn mesh_normals<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    faces: PyReadonlyArray2<'py, i64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let points = cloud(&points)?;
    let rows = faces.as_array();
    let faces: Vec<[usize; 3]> =
        rows.rows().into_iter().map(|row| [row[0], row[1], row[2]].map(index)).collect();
    let normals = py.detach(|| mesh_normals_of(&points, &faces)).map_err(|error| to_python(&error))?;
    vectors(py, normals)
}

/// Harris 3D keypoints.
#[pyfunction]
#[pyo3(signature = (points, normals, run_options, *, radius, response, threshold, nms_radius, break_ties, count))]
#[expect(clippy::too_many_arguments, reason = "one per option of the detector")]
pub fn harris3d<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    normals: Option<PyReadonlyArray2<'py, f64>>,
    run_options: RunOptions,
    radius: f64,
    response: &str,
    threshold: f64,
    nms_radius: f64,
    break_ties: bool,
    count: Option<usize>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let responses = [
        ("harris", Response::Harris),
        ("noble", Response::Noble),
        ("lowe", Response::Lowe),
        ("tomasi", Response::Tomasi),
        ("curvature", Response::Curvature),
    ];
    let response = choose("response", response, &responses)?;
    let detector = Harris3d { radius, nms_radius, response, threshold, break_ties, count };
    let points = cloud(&points)?;
    let normals = normals.as_ref().map(directions);
    let found =
        run(py, &run_options, move |execution| detector.detect(&points, normals.as_deref(), execution))?;
    Ok(indices(py, found))
}

/// ISS keypoints.
#[pyfunction]
#[pyo3(signature = (points, run_options, *, salient_radius, nms_radius, gamma_21, gamma_32, min_neighbors, density_weight, covariance, count))]
#[expect(clippy::too_many_arguments, reason = "one per option of the detector")]
pub fn iss<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    run_options: RunOptions,
    salient_radius: f64,
    nms_radius: f64,
    gamma_21: f64,
    gamma_32: f64,
    min_neighbors: usize,
    density_weight: bool,
    covariance: &str,
    count: Option<usize>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let kinds = [("point", Covariance::AboutPoint), ("mean", Covariance::AboutMean)];
    let covariance = choose("covariance", covariance, &kinds)?;
    let detector = Iss {
        salient_radius,
        nms_radius,
        gamma_21,
        gamma_32,
        min_neighbors,
        density_weight,
        covariance,
        count,
    };
    let points = cloud(&points)?;
    Ok(indices(py, run(py, &run_options, move |execution| detector.detect(&points, execution))?))
}

/// Keypoints with enough points around them.
#[pyfunction]
pub fn drop_isolated<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
    min_points: usize,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let (points, keypoints) = (cloud(&points)?, rows_of(&keypoints));
    let kept = run(py, &run_options, move |execution| {
        support::drop_isolated(&points, &keypoints, radius, min_points, execution)
    })?;
    Ok(indices(py, kept))
}

/// SHOT's local reference frames.
#[pyfunction]
pub fn shot_lrf<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (points, keypoints) = (cloud(&points)?, rows_of(&keypoints));
    let frames = run(py, &run_options, move |execution| {
        shot_frames::shot_frames(&points, &keypoints, radius, execution)
    })?;
    frame_blocks(py, &frames)
}

/// TOLDI's local reference frames.
#[pyfunction]
pub fn toldi_lrf<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (points, keypoints) = (cloud(&points)?, rows_of(&keypoints));
    let frames = run(py, &run_options, move |execution| {
        toldi_frames::toldi_frames(&points, &keypoints, radius, execution)
    })?;
    frame_blocks(py, &frames)
}

/// SHOT-352.
#[pyfunction]
#[pyo3(signature = (points, normals, keypoints, run_options, *, radius, lrf, pcl_compat))]
#[expect(clippy::too_many_arguments, reason = "one per option of the descriptor")]
pub fn shot<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    normals: PyReadonlyArray2<'py, f64>,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
    lrf: Option<PyReadonlyArray3<'py, f64>>,
    pcl_compat: bool,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (points, normals, keypoints) = (cloud(&points)?, directions(&normals), rows_of(&keypoints));
    let frames = lrf.as_ref().map(convert::frames);
    let descriptor = Shot { radius, pcl_compat };
    let rows = run(py, &run_options, move |execution| {
        descriptor.describe(&points, &normals, &keypoints, frames.as_deref(), execution)
    })?;
    table(py, rows)
}

/// LFSH-30.
#[pyfunction]
pub fn lfsh<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    normals: PyReadonlyArray2<'py, f64>,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (points, normals, keypoints) = (cloud(&points)?, directions(&normals), rows_of(&keypoints));
    let rows = run(py, &run_options, move |execution| {
        Lfsh { radius }.describe(&points, &normals, &keypoints, execution)
    })?;
    table(py, rows)
}

/// RCS-72.
#[pyfunction]
pub fn rcs<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (points, keypoints) = (cloud(&points)?, rows_of(&keypoints));
    let rows =
        run(py, &run_options, move |execution| Rcs { radius }.describe(&points, &keypoints, execution))?;
    table(py, rows)
}

/// What Python gets of matches: source and target rows, nearest and second distance, similarity, ratio.
type PyMatches<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// Exact nearest descriptors.
#[pyfunction]
pub fn match_descriptors<'py>(
    py: Python<'py>,
    source: PyReadonlyArray2<'py, f64>,
    target: PyReadonlyArray2<'py, f64>,
    run_options: RunOptions,
    mutual: bool,
    max_distance: Option<f64>,
) -> PyResult<PyMatches<'py>> {
    let (source, target) = (descriptors("source", &source)?, descriptors("target", &target)?);
    let matching = Matching { mutual, max_distance };
    let matches = run(py, &run_options, move |execution| matching.run(&source, &target, execution))?;
    let column = |value: fn(&Match) -> f64| matches.iter().map(value).collect::<Vec<_>>().into_pyarray(py);
    Ok((
        indices(py, matches.iter().map(|m| m.source)),
        indices(py, matches.iter().map(|m| m.target)),
        column(|m| m.distance),
        column(|m| m.second_distance),
        column(|m| m.similarity),
        column(Match::ratio),
    ))
}

fn cloud(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Points> {
    Points::from_rows("points", &convert::points(array)).map_err(|error| to_python(&error))
}

fn directions(array: &PyReadonlyArray2<'_, f64>) -> Vec<Vector3<f64>> {
    convert::points(array).into_iter().map(Vector3::from).collect()
}

fn descriptors(name: &str, array: &PyReadonlyArray2<'_, f64>) -> PyResult<Descriptors> {
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    Descriptors::new(name, &values, array.as_array().ncols()).map_err(|error| to_python(&error))
}

/// Negative numbers become an index that no cloud has; the Python side has refused them already.
fn index(value: i64) -> usize {
    usize::try_from(value).unwrap_or(usize::MAX)
}

fn rows_of(array: &PyReadonlyArray1<'_, i64>) -> Vec<usize> {
    array.as_array().iter().copied().map(index).collect()
}

fn indices(py: Python<'_>, found: impl IntoIterator<Item = usize>) -> Bound<'_, PyArray1<i64>> {
    found.into_iter().map(|i| i as i64).collect::<Vec<_>>().into_pyarray(py)
}

fn vectors(
    py: Python<'_>,
    vectors: impl IntoIterator<Item = Vector3<f64>>,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    table(py, vectors.into_iter().map(<[f64; 3]>::from).collect())
}

fn table<T: Element, const N: usize>(py: Python<'_>, rows: Vec<[T; N]>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let shape = [rows.len(), N];
    rows.into_flattened().into_pyarray(py).reshape(shape)
}

fn frame_blocks<'py>(py: Python<'py>, frames: &[Frame]) -> PyResult<Bound<'py, PyArray3<f64>>> {
    // Transposed, because nalgebra stores columns and numpy rows.
    let block = |frame: &Frame| frame.map_or([[f64::NAN; 3]; 3], |axes| axes.transpose().into());
    let values = frames.iter().flat_map(|frame| block(frame).concat()).collect::<Vec<_>>();
    values.into_pyarray(py).reshape([frames.len(), 3, 3])
}
