//! The scale of two scans in different units.

use std::sync::Arc;

use cgroup::registration::{self as core, ScaleOutcome};
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::convert::matrix;
use crate::registration::{Prepared, PyCase, PyRefusal, case, refusal};
use crate::run::{RunOptions, run};

/// The scale of a source in a target's unit.
#[pyclass(frozen, module = "cgroup._core")]
pub struct Scaled {
    core: core::Scaled,
}

/// Scale of a source, and pose of the scaled source.
type PySimilarity<'py> = (f64, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl Scaled {
    #[getter]
    fn scale(&self) -> f64 {
        self.core.scale
    }

    #[getter]
    fn deviation(&self) -> f64 {
        self.core.deviation
    }

    #[getter]
    fn is_open(&self) -> bool {
        self.core.is_open
    }

    /// The source in the target's unit, the target, and their voxel.
    #[getter]
    fn scans(&self) -> (Prepared, Prepared, f64) {
        let [source, target] = &self.core.scans;
        (Prepared { core: Arc::clone(source) }, Prepared { core: Arc::clone(target) }, target.voxel())
    }

    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        self.core.pose.map(|pose| matrix(py, &pose.to_matrix())).transpose()
    }

    /// Probability of a pose at the scale against all tried scales, and those that share it.
    fn weigh<'py>(
        &self,
        py: Python<'py>,
        cases: Vec<PyCase>,
        motions: usize,
    ) -> PyResult<(f64, Vec<PySimilarity<'py>>)> {
        let (probability, others) =
            self.core.weigh(&cases.into_iter().map(case).collect::<Vec<_>>(), motions);
        let convert = |(scale, pose): (f64, cgroup::geometry::rigid::Rigid)| {
            Ok((scale, matrix(py, &pose.to_matrix())?))
        };
        Ok((probability, others.into_iter().map(convert).collect::<PyResult<_>>()?))
    }
}

/// The scale between two bounds at which the source fits the target best; or the scan (0 or 1) that cannot be described, with the
/// voxel and the reason; or the ratio of the sizes that the bounds exclude, and the factor around it.
#[pyfunction]
#[expect(clippy::type_complexity, reason = "one of three outcomes")]
pub fn find_scale(
    py: Python<'_>,
    source: &Prepared,
    target: &Prepared,
    bounds: (f64, f64),
    voxel: Option<f64>,
    axis: Option<[f64; 3]>,
    run_options: RunOptions,
) -> PyResult<(Option<Scaled>, Option<(usize, f64, PyRefusal)>, Option<(f64, f64)>)> {
    let (source, target) = (Arc::clone(&source.core), Arc::clone(&target.core));
    run(py, &run_options, move |execution| {
        Ok(match core::find_scale(&source, &target, bounds, voxel, axis, execution)? {
            ScaleOutcome::Found(core) => (Some(Scaled { core: *core }), None, None),
            ScaleOutcome::Refused(side, voxel, why) => (None, Some((side, voxel, refusal(why))), None),
            ScaleOutcome::OutOfBounds(ratio, within) => (None, None, Some((ratio, within))),
        })
    })
}
