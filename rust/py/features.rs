//! One function per step of the front end.

use cgroup::correspondences::Frame;
use cgroup::features::fpfh::{Convention, Fpfh};
use cgroup::features::harris3d::{Harris3d, Response};
use cgroup::features::iss::{Covariance, Iss};
use cgroup::features::keypoints as support;
use cgroup::features::lfsh::Lfsh;
use cgroup::features::matching::{Descriptors, Match, Matching};
use cgroup::features::mesh_normals::mesh_normals as mesh_normals_of;
use cgroup::features::normals::{self as plane_fits, Neighborhood};
use cgroup::features::rcs::Rcs;
use cgroup::features::shot::Shot;
use cgroup::features::shot_lrf::shot_frames;
use cgroup::features::toldi_lrf::toldi_frames;
use cgroup::features::voxels;
use cgroup::memory;
use nalgebra::{Point3, Vector3};
use numpy::ndarray::{Ix2, Ix3};
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::cloud::Cloud;
use crate::convert::{Reals, array, checked, choose, rows};
use crate::run::{RunOptions, run};

/// Default number of neighbours that a plane is fitted to.
const NORMAL_NEIGHBORS: usize = 20;

/// Mean nearest-neighbour distance.
#[pyfunction]
pub fn resolution(
    py: Python<'_>,
    cloud: &Cloud,
    run_options: RunOptions,
    ignore_zero: bool,
) -> PyResult<f64> {
    let cloud = cloud.core();
    run(py, &run_options, move |execution| cloud.resolution(ignore_zero, execution))
}

/// Voxels for Python: points, normals if given, and the voxel of every point.
type PyVoxels<'py> =
    (Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray2<f64>>>, Bound<'py, PyArray1<i64>>);

/// Means of the points in every cell of a grid, along the cloud's own axes if requested.
#[pyfunction]
pub fn voxel_downsample<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    normals: Option<Reals<'py, Ix2>>,
    run_options: RunOptions,
    voxel: f64,
    own_axes: bool,
) -> PyResult<PyVoxels<'py>> {
    let cloud = cloud.core();
    let normals = normals.as_ref().map(directions).transpose()?;
    let has_normals = normals.is_some();
    let found = run(py, &run_options, move |execution| {
        if own_axes {
            return voxels::thin_own(&*cloud.own()?, normals.as_deref(), voxel, execution);
        }
        voxels::voxel_downsample(cloud.points(), normals.as_deref(), voxel, execution)
    })?;
    let means = has_normals.then(|| vectors(py, found.normals)).transpose()?;
    Ok((table(py, found.points)?, means, array(py, found.indices.into_iter().map(i64::from))?))
}

/// The size at which clouds have at most the given number of voxels, along their own axes if requested.
#[pyfunction]
pub fn choose_voxel(
    py: Python<'_>,
    clouds: Vec<Bound<'_, Cloud>>,
    run_options: RunOptions,
    most: usize,
    own_axes: bool,
) -> PyResult<f64> {
    let clouds: Vec<_> = clouds.iter().map(|cloud| cloud.get().core()).collect();
    run(py, &run_options, move |execution| {
        if own_axes {
            let turned = clouds.iter().map(|cloud| cloud.own()).collect::<Result<Vec<_>, _>>()?;
            return voxels::choose_voxel(
                &turned.iter().map(|own| &own.1).collect::<Vec<_>>(),
                most,
                execution,
            );
        }
        let points: Vec<_> = clouds.iter().map(|cloud| cloud.points()).collect();
        voxels::choose_voxel(&points, most, execution)
    })
}

/// Plane-fit normals.
#[pyfunction]
pub fn normals<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    run_options: RunOptions,
    neighbors: Option<usize>,
    radius: Option<f64>,
    viewpoint: [f64; 3],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let cloud = cloud.core();
    let neighborhood = match (neighbors, radius) {
        (Some(neighbors), Some(radius)) => Neighborhood::NearestWithin(neighbors, radius),
        (None, Some(radius)) => Neighborhood::Radius(radius),
        (neighbors, None) => Neighborhood::Nearest(neighbors.unwrap_or(NORMAL_NEIGHBORS)),
    };
    let fits = run(py, &run_options, move |execution| {
        plane_fits::surfaces(&cloud, neighborhood, Point3::from(viewpoint), execution)
    })?;
    vectors(py, fits.into_iter().map(|fit| fit.normal))
}

/// Area-weighted normals of a mesh's vertices.
#[pyfunction]
pub fn mesh_normals<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    faces: PyReadonlyArray2<'py, i64>,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let cloud = cloud.core();
    let faces = faces.as_slice()?.as_chunks::<3>().0.iter().map(|face| face.map(index));
    let faces = checked(memory::collect(faces))?;
    let normals = run(py, &run_options, move |execution| mesh_normals_of(cloud.points(), &faces, execution))?;
    vectors(py, normals)
}

/// Harris 3D keypoints.
#[pyfunction]
#[pyo3(signature = (cloud, normals, run_options, *, radius, response, threshold, nms_radius, break_ties, count))]
#[expect(clippy::too_many_arguments, reason = "one per option of the detector")]
pub fn harris3d<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    normals: Option<Reals<'py, Ix2>>,
    run_options: RunOptions,
    radius: f64,
    response: &Bound<'py, PyAny>,
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
    let cloud = cloud.core();
    let normals = normals.as_ref().map(directions).transpose()?;
    let found =
        run(py, &run_options, move |execution| detector.detect(&cloud, normals.as_deref(), execution))?;
    indices(py, found)
}

/// ISS keypoints.
#[pyfunction]
#[pyo3(signature = (cloud, run_options, *, salient_radius, nms_radius, gamma_21, gamma_32, min_neighbors, density_weight, covariance, count))]
#[expect(clippy::too_many_arguments, reason = "one per option of the detector")]
pub fn iss<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    run_options: RunOptions,
    salient_radius: f64,
    nms_radius: f64,
    gamma_21: f64,
    gamma_32: f64,
    min_neighbors: usize,
    density_weight: bool,
    covariance: &Bound<'py, PyAny>,
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
    let cloud = cloud.core();
    indices(py, run(py, &run_options, move |execution| detector.detect(&cloud, execution))?)
}

/// Keypoints with enough points around them.
#[pyfunction]
pub fn drop_isolated<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
    min_points: usize,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let (cloud, keypoints) = (cloud.core(), rows_of(&keypoints)?);
    let kept = run(py, &run_options, move |execution| {
        support::drop_isolated(&cloud, &keypoints, radius, min_points, execution)
    })?;
    indices(py, kept)
}

/// SHOT's local reference frames.
#[pyfunction]
pub fn shot_lrf<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (cloud, keypoints) = (cloud.core(), rows_of(&keypoints)?);
    let frames = run(py, &run_options, move |execution| shot_frames(&cloud, &keypoints, radius, execution))?;
    frame_blocks(py, &frames)
}

/// TOLDI's local reference frames.
#[pyfunction]
pub fn toldi_lrf<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (cloud, keypoints) = (cloud.core(), rows_of(&keypoints)?);
    let frames = run(py, &run_options, move |execution| toldi_frames(&cloud, &keypoints, radius, execution))?;
    frame_blocks(py, &frames)
}

/// SHOT-352.
#[pyfunction]
#[pyo3(signature = (cloud, normals, keypoints, run_options, *, radius, lrf, pcl_compat))]
#[expect(clippy::too_many_arguments, reason = "one per option of the descriptor")]
pub fn shot<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    normals: Reals<'py, Ix2>,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
    lrf: Option<Reals<'py, Ix3>>,
    pcl_compat: bool,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (cloud, normals, keypoints) = (cloud.core(), directions(&normals)?, rows_of(&keypoints)?);
    let frames = lrf.as_ref().map(frames).transpose()?;
    let descriptor = Shot { radius, pcl_compat };
    let rows = run(py, &run_options, move |execution| {
        descriptor.describe(&cloud, &normals, &keypoints, frames.as_deref(), execution)
    })?;
    table(py, rows)
}

/// LFSH-30.
#[pyfunction]
pub fn lfsh<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    normals: Reals<'py, Ix2>,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (cloud, normals, keypoints) = (cloud.core(), directions(&normals)?, rows_of(&keypoints)?);
    let rows = run(py, &run_options, move |execution| {
        Lfsh { radius }.describe(&cloud, &normals, &keypoints, execution)
    })?;
    table(py, rows)
}

/// RCS-72.
#[pyfunction]
pub fn rcs<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    keypoints: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
    radius: f64,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (cloud, keypoints) = (cloud.core(), rows_of(&keypoints)?);
    let rows =
        run(py, &run_options, move |execution| Rcs { radius }.describe(&cloud, &keypoints, execution))?;
    table(py, rows)
}

/// FPFH-33.
#[pyfunction]
#[pyo3(signature = (cloud, normals, keypoints, run_options, *, radius, max_neighbors, convention))]
#[expect(clippy::too_many_arguments, reason = "one per option of the descriptor")]
pub fn fpfh<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    normals: Reals<'py, Ix2>,
    keypoints: Option<PyReadonlyArray1<'py, i64>>,
    run_options: RunOptions,
    radius: f64,
    max_neighbors: Option<usize>,
    convention: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let conventions = [("open3d", Convention::Open3d), ("pcl", Convention::Pcl)];
    let convention = choose("convention", convention, &conventions)?;
    let (cloud, normals) = (cloud.core(), directions(&normals)?);
    let keypoints = keypoints.as_ref().map(rows_of).transpose()?;
    let descriptor = Fpfh { radius, max_neighbors, convention };
    let rows = run(py, &run_options, move |execution| {
        descriptor.describe(&cloud, &normals, keypoints.as_deref(), execution)
    })?;
    table(py, rows)
}

/// Matches for Python: source and target rows, rank, distance, second distance, similarity, ratio, whether
/// mutual.
type PyMatches<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
);

/// Exact nearest descriptors.
#[pyfunction]
pub fn match_descriptors<'py>(
    py: Python<'py>,
    source: Reals<'py, Ix2>,
    target: Reals<'py, Ix2>,
    run_options: RunOptions,
    k: usize,
    mutual: bool,
    max_distance: Option<f64>,
) -> PyResult<PyMatches<'py>> {
    let (source, target) = (descriptors("source", &source)?, descriptors("target", &target)?);
    let matching = Matching { k, mutual, max_distance };
    let matches = run(py, &run_options, move |execution| matching.run(&source, &target, execution))?;
    let column = |value: fn(&Match) -> f64| array(py, matches.iter().map(value));
    Ok((
        indices(py, matches.iter().map(|m| m.source))?,
        indices(py, matches.iter().map(|m| m.target))?,
        indices(py, matches.iter().map(|m| m.rank))?,
        column(|m| m.distance)?,
        column(|m| m.second_distance)?,
        column(|m| m.similarity)?,
        column(Match::ratio)?,
        array(py, matches.iter().map(|m| m.is_mutual))?,
    ))
}

/// Directions, one per row; they may be NaN.
pub fn directions(array: &Reals<'_, Ix2>) -> PyResult<Vec<Vector3<f64>>> {
    checked(match array {
        Reals::Single(array) => memory::collect(array.as_slice()?.as_chunks::<3>().0.iter().map(widened)),
        Reals::Double(array) => memory::collect(array.as_slice()?.as_chunks::<3>().0.iter().map(widened)),
    })
}

fn widened<T: Copy + Into<f64>>(row: &[T; 3]) -> Vector3<f64> {
    row.map(Into::into).into()
}

/// Frames, one per block; a block with NaN is a missing frame.
pub fn frames(array: &Reals<'_, Ix3>) -> PyResult<Vec<Frame>> {
    let frames = array.frames()?;
    checked(frames.validate("lrf"))?;
    checked(memory::collect((0..frames.len()).map(|i| frames.get(i))))
}

fn descriptors(name: &str, array: &Reals<'_, Ix2>) -> PyResult<Descriptors> {
    checked(match array {
        Reals::Single(array) => Descriptors::new(name, array.as_slice()?, array.as_array().ncols()),
        Reals::Double(array) => Descriptors::new(name, array.as_slice()?, array.as_array().ncols()),
    })
}

/// Converts negative numbers to an index out of range; the Python side has already rejected them.
fn index(value: i64) -> usize {
    usize::try_from(value).unwrap_or(usize::MAX)
}

pub fn rows_of(array: &PyReadonlyArray1<'_, i64>) -> PyResult<Vec<usize>> {
    checked(memory::collect(array.as_slice()?.iter().copied().map(index)))
}

pub fn indices(py: Python<'_>, found: impl IntoIterator<Item = usize>) -> PyResult<Bound<'_, PyArray1<i64>>> {
    array(py, found.into_iter().map(|i| i as i64))
}

fn vectors(
    py: Python<'_>,
    vectors: impl IntoIterator<Item = Vector3<f64>>,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    table(py, checked(memory::collect(vectors.into_iter().map(<[f64; 3]>::from)))?)
}

pub fn table<T: Element, const N: usize>(
    py: Python<'_>,
    rows: Vec<[T; N]>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let shape = [rows.len(), N];
    PyArray1::from_vec(py, rows.into_flattened()).reshape(shape)
}

fn frame_blocks<'py>(py: Python<'py>, frames: &[Frame]) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let block = |frame: &Frame| frame.map_or([[f64::NAN; 3]; 3], |axes| rows(&axes));
    let blocks = checked(memory::collect(frames.iter().map(block)))?;
    PyArray1::from_vec(py, blocks.into_flattened().into_flattened()).reshape([frames.len(), 3, 3])
}
