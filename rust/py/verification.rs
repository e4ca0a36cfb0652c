//! Scores poses on surfaces: the class `Surface`, and two functions.

use std::sync::Arc;

use cgroup::geometry::rigid::Rigid;
use cgroup::verification::{
    self as core, Evidence, FineSurface as CoreFineSurface, Overlap, Resistance, Side,
    Surface as CoreSurface, Verified, margin, overlap,
};
use cgroup::{Error, memory};
use nalgebra::{Matrix3, Vector3};
use numpy::ndarray::Ix2;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::convert::{Reals, array, checked, matrices, matrix};
use crate::features::directions;
use crate::run::{RunOptions, run};

/// A prepared surface; use it through `cgroup.verification.Surface`.
#[pyclass(frozen, module = "cgroup._core")]
pub struct Surface {
    core: Arc<CoreSurface>,
}

impl Surface {
    /// Takes a surface of the core.
    pub fn of(core: Arc<CoreSurface>) -> Self {
        Self { core }
    }
}

#[pymethods]
impl Surface {
    #[new]
    fn new(
        py: Python<'_>,
        points: Reals<'_, Ix2>,
        normals: Reals<'_, Ix2>,
        run_options: RunOptions,
        unit: f64,
        viewpoint: Option<[f64; 3]>,
        oriented: bool,
    ) -> PyResult<Self> {
        let side = match viewpoint {
            Some(viewpoint) => Side::Viewpoint(viewpoint),
            None if oriented => Side::Known,
            None => Side::Unknown,
        };
        let points = points.points("points")?;
        let normals = directions(&normals)?;
        let built = run(py, &run_options, move |execution| {
            CoreSurface::new(&points, &normals, unit, side, execution)
        })?;
        Ok(Self { core: Arc::new(built) })
    }

    fn __len__(&self) -> usize {
        self.core.len()
    }
}

/// Scores poses without refinement.
#[pyfunction]
pub fn score_poses<'py>(
    py: Python<'py>,
    source: &Surface,
    target: &Surface,
    poses: PyReadonlyArray3<'py, f64>,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (source, target, poses) = (Arc::clone(&source.core), Arc::clone(&target.core), transforms(&poses)?);
    let scores =
        run(py, &run_options, move |execution| core::score_poses(&source, &target, &poses, execution))?;
    array(py, scores)
}

/// Places of the points of one surface under a pose, as numbers of [`core::Place`].
#[pyfunction]
pub fn places<'py>(
    py: Python<'py>,
    source: &Surface,
    target: &Surface,
    pose: PyReadonlyArray3<'py, f64>,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let (source, target, poses) = (Arc::clone(&source.core), Arc::clone(&target.core), transforms(&pose)?);
    let found = run(py, &run_options, move |execution| {
        under_all(&poses, |pose| core::places(&source, &target, pose, execution))
    })?;
    array(py, found.into_iter().map(|place| place as u8))
}

/// Matched points, and the largest distance of a match that supports a pose.
type Matches<'py> = (Reals<'py, Ix2>, Reals<'py, Ix2>, f64);

/// Results for Python: poses, scores, evidence; margin; fitness, rmse, information, open motion.
type PyVerified<'py> = (
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    f64,
    (f64, f64, PyResistance<'py>),
);

/// Information matrix, and the open motion.
type PyResistance<'py> = (Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray1<f64>>>);

/// Refines poses, best first.
#[pyfunction]
pub fn verify<'py>(
    py: Python<'py>,
    source: &Surface,
    target: &Surface,
    poses: PyReadonlyArray3<'py, f64>,
    matches: Option<Matches<'py>>,
    run_options: RunOptions,
) -> PyResult<PyVerified<'py>> {
    let (source, target, poses) = (Arc::clone(&source.core), Arc::clone(&target.core), transforms(&poses)?);
    let evidence = matches.map(evidence).transpose()?;
    let (found, lead, shared) = run(py, &run_options, move |execution| {
        let found = core::verify(&source, &target, &poses, evidence.as_ref(), execution)?;
        let Some(best) = found.first() else {
            let remedy = "give at least one pose whose numbers are finite";
            return Err(Error::invalid("poses", format!("{} valid ones", found.len()), remedy));
        };
        let shared = overlap(&source, &target, &best.pose, execution)?;
        let lead = margin(&source, &target, &found);
        Ok((found, lead, shared))
    })?;
    verified(py, &found, lead, &shared)
}

fn verified<'py>(
    py: Python<'py>,
    found: &[Verified],
    lead: f64,
    shared: &Overlap,
) -> PyResult<PyVerified<'py>> {
    Ok((
        matrices(py, found.iter().map(|found| found.pose.to_matrix()))?,
        array(py, found.iter().map(|found| found.score))?,
        array(py, found.iter().map(|found| found.evidence as i64))?,
        lead,
        (shared.fitness, shared.inlier_rmse, resisted(py, &shared.resistance)?),
    ))
}

fn resisted<'py>(py: Python<'py>, resistance: &Resistance) -> PyResult<PyResistance<'py>> {
    // By columns, as in nalgebra: the matrix is symmetric.
    let information = array(py, resistance.information.iter().copied())?.reshape([6, 6])?;
    let open = resistance.open_motion.map(|motion| array(py, motion.iter().copied())).transpose()?;
    Ok((information, open))
}

/// A finely sampled surface; use it through `cgroup.verification.FineSurface`.
#[pyclass(frozen, module = "cgroup._core")]
pub struct FineSurface {
    core: Arc<CoreFineSurface>,
}

#[pymethods]
impl FineSurface {
    #[new]
    fn new(py: Python<'_>, cloud: &Cloud, run_options: RunOptions, spacing: f64) -> PyResult<Self> {
        let cloud = cloud.core();
        let built =
            run(py, &run_options, move |execution| CoreFineSurface::new(cloud.points(), spacing, execution))?;
        Ok(Self { core: Arc::new(built) })
    }

    fn __len__(&self) -> usize {
        self.core.len()
    }

    /// Positions of the samples.
    fn sample_points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = self.core.sample_points();
        let count = points.len();
        array(py, points.flatten())?.reshape([count, 3])
    }
}

/// Distances between the planes of one surface's samples and the points of another under one pose.
#[pyfunction]
pub fn plane_distances<'py>(
    py: Python<'py>,
    source: &FineSurface,
    target: &FineSurface,
    pose: PyReadonlyArray3<'py, f64>,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (source, target, poses) = (Arc::clone(&source.core), Arc::clone(&target.core), transforms(&pose)?);
    let found = run(py, &run_options, move |execution| {
        under_all(&poses, |pose| core::plane_distances(&source, &target, pose, execution))
    })?;
    Ok(PyArray1::from_vec(py, found))
}

/// Results for Python: pose; residuals, deviations, number of samples; information, open motion.
type PyAlignment<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    usize,
    PyResistance<'py>,
);

/// Refines poses on two fine surfaces.
#[pyfunction]
pub fn align<'py>(
    py: Python<'py>,
    source: &FineSurface,
    target: &FineSurface,
    poses: PyReadonlyArray3<'py, f64>,
    run_options: RunOptions,
    samples: usize,
) -> PyResult<Vec<PyAlignment<'py>>> {
    let (source, target, poses) = (Arc::clone(&source.core), Arc::clone(&target.core), transforms(&poses)?);
    let found = run(py, &run_options, move |execution| {
        let align = |pose| core::align(&source, &target, pose, samples, execution).map(Some);
        memory::par_try_collect(poses.par_iter().map(align))
    })?;
    let aligned = found.into_iter().flatten().map(|found| {
        Ok((
            matrix(py, &found.pose.to_matrix())?,
            PyArray1::from_vec(py, found.residuals),
            PyArray1::from_vec(py, found.deviations),
            found.samples,
            resisted(py, &found.resistance)?,
        ))
    });
    aligned.collect()
}

fn evidence((source, target, tolerance): Matches<'_>) -> PyResult<Evidence> {
    Ok(Evidence {
        source: source.points("matches.source")?,
        target: target.points("matches.target")?,
        tolerance,
    })
}

/// Concatenated results under each of the poses.
fn under_all<T>(poses: &[Rigid], find: impl Fn(&Rigid) -> Result<Vec<T>, Error>) -> Result<Vec<T>, Error> {
    let mut all = Vec::new();
    for pose in poses {
        let found = find(pose)?;
        memory::reserve(&mut all, found.len())?;
        all.extend(found);
    }
    Ok(all)
}

/// Converts poses. The caller has checked them; finiteness is checked in the copy.
pub fn transforms(poses: &PyReadonlyArray3<'_, f64>) -> PyResult<Vec<Rigid>> {
    let copy = checked(memory::copied(poses.as_slice()?.as_chunks::<16>().0))?;
    if let Some(row) = copy.iter().position(|pose| !pose.iter().all(|number| number.is_finite())) {
        let remedy = "give finite numbers, and leave the array alone while it is read";
        return checked(Err(Error::invalid("poses", format!("NaN or infinity in pose {row}"), remedy)));
    }
    let rigid = |m: &[f64; 16]| Rigid {
        rotation: Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]),
        translation: Vector3::new(m[3], m[7], m[11]),
    };
    checked(memory::collect(copy.iter().map(rigid)))
}
