//! Registration: scans, their levels, and the search for a pose.

use std::sync::Arc;

use cgroup::features::matching::Descriptors;
use cgroup::geometry::rigid::Rigid;
use cgroup::memory;
use cgroup::registration::{
    self as core, Case, Described, Effort, Evidence, Level as CoreLevel, Nearby, Options, Outcome, Outside,
    Pair, Prepared as CorePrepared, Proposer, Radii, Refusal, Region, STAGES, Scan as CoreScan, VoxelMatches,
};
use nalgebra::Vector3;
use numpy::ndarray::{Ix2, Ix3};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::cloud::Cloud;
use crate::convert::{Reals, array, checked, matrices, matrix};
use crate::features::{directions, frames};
use crate::run::{RunOptions, run};
use crate::verification::{Surface, transforms};

/// A cloud before it is downsampled.
#[pyclass(frozen, module = "cgroup._core")]
pub struct Scan {
    core: Arc<CoreScan>,
}

#[pymethods]
impl Scan {
    #[new]
    fn new(cloud: &Cloud, normals: Option<Reals<'_, Ix2>>) -> PyResult<Self> {
        let normals = normals.map(|normals| directions(&normals)).transpose()?;
        Ok(Self { core: Arc::new(checked(CoreScan::new(cloud.core(), normals))?) })
    }

    fn __len__(&self) -> usize {
        self.core.points().len()
    }
}

/// Returns the side of the normals; the normals of the file are used where neither frames nor a viewpoint decide.
fn outside(viewpoint: Option<[f64; 3]>, by_frames: bool) -> Outside {
    match viewpoint {
        _ if by_frames => Outside::Frames(viewpoint),
        Some(eye) => Outside::Viewpoint(eye),
        None => Outside::Given,
    }
}

/// A scan with its levels, each made when it is first needed.
#[pyclass(frozen, module = "cgroup._core")]
pub struct Prepared {
    /// The core's.
    pub core: Arc<CorePrepared>,
}

/// Reason why there is no level: its kind, and two numbers.
pub type PyRefusal = (&'static str, usize, usize);

/// Converts a refusal.
pub fn refusal(why: Refusal) -> PyRefusal {
    match why {
        Refusal::Few(count) => ("few", count, 0),
        Refusal::Many(count) => ("many", count, 0),
        Refusal::NotPlanar(planar, count) => ("not planar", planar, count),
    }
}

#[pymethods]
impl Prepared {
    #[new]
    fn new(
        scan: &Scan,
        voxel: f64,
        radii: (f64, f64, f64),
        viewpoint: Option<[f64; 3]>,
        by_frames: bool,
        most: usize,
    ) -> Self {
        let (normal, support, frame) = radii;
        let (scan, radii) = (Arc::clone(&scan.core), Radii { normal, support, frame });
        Self { core: Arc::new(CorePrepared::new(scan, voxel, radii, outside(viewpoint, by_frames), most)) }
    }

    /// A part of a map: its points, voxels with normals, and the rows, frames and descriptors of described voxels.
    #[staticmethod]
    fn of_parts(
        py: Python<'_>,
        scan: &Scan,
        voxel: f64,
        voxels: (Reals<'_, Ix2>, Reals<'_, Ix2>),
        described: (Vec<u32>, Reals<'_, Ix3>, Reals<'_, Ix2>),
        run_options: RunOptions,
    ) -> PyResult<Self> {
        let scan = Arc::clone(&scan.core);
        let (points, normals) = (directions(&voxels.0)?, directions(&voxels.1)?);
        let (rows, frames, values) = (described.0, frames(&described.1)?, described.2.numbers()?);
        let built = run(py, &run_options, move |execution| {
            let length = values.len() / rows.len().max(1);
            let described = Described {
                points: memory::collect(rows.iter().map(|&row| points[row as usize].into()))?,
                frames,
                descriptors: Descriptors::new("descriptors", &values, length.max(1))?,
                rows,
            };
            CoreLevel::of_parts(scan, voxel, Outside::Frames(None), (points, normals), described, execution)
        })?;
        Ok(Self { core: Arc::new(CorePrepared::single(built)) })
    }

    /// The level of a row of the voxel factors, or the reason why there is none.
    fn level(
        &self,
        py: Python<'_>,
        row: usize,
        run_options: RunOptions,
    ) -> PyResult<(Option<Level>, Option<PyRefusal>)> {
        let core = Arc::clone(&self.core);
        let found = run(py, &run_options, move |execution| {
            Ok(core.level(row, execution)?.map(|level| Level { core: Arc::clone(level) }))
        })?;
        Ok(match found {
            Ok(level) => (Some(level), None),
            Err(why) => (None, Some(refusal(why))),
        })
    }

    /// Makes the level that a search begins with; returns the reason if there is none.
    fn begin(&self, py: Python<'_>, run_options: RunOptions) -> PyResult<Option<PyRefusal>> {
        let core = Arc::clone(&self.core);
        Ok(run(py, &run_options, move |execution| core.begin(execution))?.map(refusal))
    }
}

/// A scan at one voxel size.
#[pyclass(frozen, module = "cgroup._core")]
pub struct Level {
    core: Arc<CoreLevel>,
}

/// Scale, pose, resistance and deviation of a similarity.
type PySimilarity<'py> = (f64, Bound<'py, PyArray2<f64>>, f64, f64);

/// Rows, frames and descriptors of the described voxels.
type PyDescribed<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<f32>>);

#[pymethods]
impl Level {
    fn __len__(&self) -> usize {
        self.core.len()
    }

    #[getter]
    fn voxel(&self) -> f64 {
        self.core.voxel()
    }

    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        triples(py, self.core.points())
    }

    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        triples(py, self.core.normals())
    }

    #[getter]
    fn surface(&self) -> Surface {
        Surface::of(Arc::clone(self.core.surface()))
    }

    fn described<'py>(&self, py: Python<'py>, run_options: RunOptions) -> PyResult<PyDescribed<'py>> {
        let level = Arc::clone(&self.core);
        let (rows, frames, values) = run(py, &run_options, move |execution| {
            let found = level.described(execution)?;
            let frame = |frame: &cgroup::frames::Frame| {
                frame.map_or([f64::NAN; 9], |axes| {
                    axes.transpose().as_slice().try_into().unwrap_or([f64::NAN; 9])
                })
            };
            let frames = memory::collect(found.frames.iter().flat_map(frame))?;
            let values = memory::collect(found.descriptors.values().iter().map(|&value| value as f32))?;
            Ok((memory::copied(&found.rows)?, frames, values))
        })?;
        let (count, length) = (rows.len(), values.len() / rows.len().max(1));
        Ok((
            array(py, rows.into_iter().map(i64::from))?,
            PyArray1::from_vec(py, frames).reshape([count, 3, 3])?,
            PyArray1::from_vec(py, values).reshape([count, length])?,
        ))
    }

    /// Fits scale and pose to the voxels of both levels: scale, pose, resistance, deviation.
    fn fit_similarity<'py>(
        &self,
        py: Python<'py>,
        target: &Self,
        pose: PyReadonlyArray3<'py, f64>,
        run_options: RunOptions,
    ) -> PyResult<Option<PySimilarity<'py>>> {
        let (source, target, poses) = (Arc::clone(&self.core), Arc::clone(&target.core), transforms(&pose)?);
        let fitted = run(py, &run_options, move |execution| {
            let Some(pose) = poses.first() else { return Ok(None) };
            core::fit_similarity(Pair { source: &source, target: &target }, pose, 1, execution)
        })?;
        fitted
            .map(|one| Ok((one.scale, matrix(py, &one.pose.to_matrix())?, one.resistance, one.deviation)))
            .transpose()
    }

    /// Refines a pose on the fine surfaces, and estimates its probability alone.
    fn confirm<'py>(
        &self,
        py: Python<'py>,
        target: &Self,
        pose: PyReadonlyArray3<'py, f64>,
        run_options: RunOptions,
    ) -> PyResult<Option<Registered>> {
        let (source, target, poses) = (Arc::clone(&self.core), Arc::clone(&target.core), transforms(&pose)?);
        run(py, &run_options, move |execution| {
            let Some(pose) = poses.first() else { return Ok(None) };
            let pair = Pair { source: &source, target: &target };
            let Some(found) = core::confirm(pair, pose, execution)? else { return Ok(None) };
            Ok(Some(Registered { core: core::Registered::alone(found, [source, target]) }))
        })
    }

    /// The overlap of both scans under each pose, and the root mean square of the distances there.
    fn overlap<'py>(
        &self,
        py: Python<'py>,
        target: &Self,
        poses: PyReadonlyArray3<'py, f64>,
        run_options: RunOptions,
    ) -> PyResult<Vec<(f64, f64, f64)>> {
        let (source, target, poses) = (Arc::clone(&self.core), Arc::clone(&target.core), transforms(&poses)?);
        run(py, &run_options, move |execution| {
            let pair = Pair { source: &source, target: &target };
            poses.iter().map(|pose| core::overlap_at(pair, pose, execution)).collect()
        })
    }
}

fn triples<'py>(py: Python<'py>, rows: &[Vector3<f64>]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    array(py, rows.iter().flat_map(|row| [row.x, row.y, row.z]))?.reshape([rows.len(), 3])
}

/// Evidence for a pose: score, support, misfit, cells, planes, violations of free space (NaN without viewpoints), nats that chance
/// reaches (NaN if unknown).
pub type PyCase = (f64, usize, f64, f64, usize, f64, f64);

fn py_case(case: &Case) -> PyCase {
    let Evidence { cells, planes, crossed } = case.evidence;
    let [crossed, chance] = [crossed, case.chance].map(|number| number.unwrap_or(f64::NAN));
    (case.score, case.support, case.misfit, cells, planes, crossed, chance)
}

/// Reads the evidence for a pose.
pub fn case((score, support, misfit, cells, planes, crossed, chance): PyCase) -> Case {
    let [crossed, chance] = [crossed, chance].map(|number| Some(number).filter(|number| !number.is_nan()));
    Case { score, support, misfit, evidence: Evidence { cells, planes, crossed }, chance }
}

/// Returns the evidence for a pose in nats, to be compared with that for other poses of the same scans.
#[pyfunction]
pub fn weigh(evidence: PyCase) -> f64 {
    case(evidence).weight()
}

/// Returns the probability that the first pose is right, and that of each other as a multiple of it.
#[pyfunction]
pub fn share_probability(cases: Vec<PyCase>, scales: usize) -> (f64, Vec<f64>) {
    let cases: Vec<Case> = cases.into_iter().map(case).collect();
    let mut shares = Vec::new();
    let probability = core::share_probability(&cases, scales, &mut shares);
    (probability, shares)
}

/// Returns the rows of the poses that differ from all chosen before them.
#[pyfunction]
pub fn choose_apart(poses: PyReadonlyArray3<'_, f64>, center: [f64; 3], voxel: f64) -> PyResult<Vec<usize>> {
    Ok(core::choose_apart(&transforms(&poses)?, &Vector3::from(center), voxel))
}

/// Options of a search; read from a `cgroup.registration.search.Options`.
#[derive(FromPyObject)]
pub struct SearchOptions<'py> {
    axis: Option<[f64; 3]>,
    effort: String,
    proposed: PyReadonlyArray3<'py, f64>,
    own: bool,
    nearby: Option<(PyReadonlyArray3<'py, f64>, f64, f64)>,
    region: Option<([f64; 3], f64)>,
}

impl SearchOptions<'_> {
    fn to_core(&self) -> PyResult<Options> {
        let effort = match self.effort.as_str() {
            "first" => Effort::First,
            "low" => Effort::Low,
            "high" => Effort::High,
            _ => Effort::Normal,
        };
        let proposer = match &self.nearby {
            Some((pose, angle, radius)) => {
                let pose = transforms(pose)?.first().copied().unwrap_or_else(Rigid::identity);
                Proposer::Nearby(Nearby { pose, angle: *angle, radius: *radius })
            }
            None if self.own => Proposer::Given,
            None => Proposer::Voxels,
        };
        let region = self.region.map(|(center, radius)| Region { center, radius });
        let (axis, proposed) = (self.axis, transforms(&self.proposed)?);
        Ok(Options { axis, effort, proposer, proposed, region, ..Options::default() })
    }
}

/// The pose; or the scan that cannot be searched, with the reason.
type PyOutcome = (Option<Registered>, Option<(usize, PyRefusal)>);

/// Registers two prepared scans; returns the pose, or the scan (0 or 1) that cannot be searched with the reason.
#[pyfunction]
pub fn register(
    py: Python<'_>,
    source: &Prepared,
    target: &Prepared,
    options: SearchOptions<'_>,
    run_options: RunOptions,
) -> PyResult<PyOutcome> {
    let (source, target, options) = (Arc::clone(&source.core), Arc::clone(&target.core), options.to_core()?);
    run(py, &run_options, move |execution| {
        Ok(match core::register(&source, &target, &options, execution)? {
            Outcome::Found(core) => (Some(Registered { core: *core }), None),
            Outcome::Nothing => (None, None),
            Outcome::Refused(side, why) => (None, Some((side, refusal(why)))),
        })
    })
}

/// The pose that a search found, with the evidence for it.
#[pyclass(frozen, module = "cgroup._core")]
pub struct Registered {
    core: core::Registered,
}

/// Positions, similarities, ratios and frames of matches.
type PyMatches<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray3<f64>>,
);

fn matches<'py>(py: Python<'py>, found: &VoxelMatches) -> PyResult<PyMatches<'py>> {
    let count = found.matches.len();
    let side = |points: &[[f64; 3]]| array(py, points.iter().flatten().copied())?.reshape([count, 3]);
    let numbers = |frame: cgroup::frames::Frame| -> [f64; 9] {
        frame.map_or([f64::NAN; 9], |axes| axes.transpose().as_slice().try_into().unwrap_or([f64::NAN; 9]))
    };
    Ok((
        side(&found.source)?,
        side(&found.target)?,
        array(py, found.matches.iter().map(|one| one.similarity))?,
        array(py, found.matches.iter().map(cgroup::features::matching::Match::ratio))?,
        array(py, found.frames.iter().flat_map(|both| numbers(both.0)))?.reshape([count, 3, 3])?,
        array(py, found.frames.iter().flat_map(|both| numbers(both.1)))?.reshape([count, 3, 3])?,
    ))
}

#[pymethods]
impl Registered {
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.core.found.refined.pose.to_matrix())
    }

    #[getter]
    fn probability(&self) -> f64 {
        self.core.found.probability
    }

    #[getter]
    fn decoy(&self) -> Option<f64> {
        self.core.found.decoy
    }

    #[getter]
    fn fitness(&self) -> (f64, f64) {
        (self.core.found.fitness, self.core.found.target_fitness)
    }

    /// Root mean square of the residuals; NaN without pairs.
    #[getter]
    fn rmse(&self) -> f64 {
        let residuals = &self.core.found.refined.residuals;
        (residuals.iter().map(|one| one * one).sum::<f64>() / residuals.len() as f64).sqrt()
    }

    #[getter]
    fn open_motion<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let open = self.core.found.refined.resistance.open_motion;
        open.map(|motion| array(py, motion.iter().copied())).transpose()
    }

    #[getter]
    fn motions(&self) -> usize {
        self.core.found.motions
    }

    #[getter]
    fn better_scale(&self) -> f64 {
        self.core.found.better_scale
    }

    #[getter]
    fn scale_factor(&self) -> f64 {
        self.core.found.scale_factor
    }

    #[getter]
    fn cases(&self) -> Vec<PyCase> {
        self.core.found.cases.iter().map(py_case).collect()
    }

    #[getter]
    fn shares<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        array(py, self.core.found.shares.iter().copied())
    }

    #[getter]
    fn places<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        matrices(py, self.core.found.poses.iter().map(Rigid::to_matrix))
    }

    #[getter]
    fn alternatives<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        matrices(py, self.core.found.alternatives.iter().map(Rigid::to_matrix))
    }

    #[getter]
    fn levels(&self) -> (Level, Level) {
        let [source, target] = &self.core.levels;
        (Level { core: Arc::clone(source) }, Level { core: Arc::clone(target) })
    }

    #[getter]
    fn seconds(&self) -> Vec<(&'static str, f64)> {
        STAGES.into_iter().zip(self.core.seconds).filter(|&(_, seconds)| seconds > 0.0).collect()
    }

    #[getter]
    fn matches<'py>(&self, py: Python<'py>) -> PyResult<PyMatches<'py>> {
        matches(py, &self.core.matches)
    }
}

/// The covariance of the pose of a result.
#[pyfunction]
pub fn covariance(
    py: Python<'_>,
    found: Py<Registered>,
    run_options: RunOptions,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let matrix = run(py, &run_options, move |execution| {
        let done = &found.get().core;
        let [source, target] = &done.levels;
        done.found.covariance(Pair { source, target }, execution)
    })?;
    checked(memory::collect(matrix.iter().copied()))
        .and_then(|numbers| PyArray1::from_vec(py, numbers).reshape([6, 6]))
}
