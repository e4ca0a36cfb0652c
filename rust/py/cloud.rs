//! The class `Cloud`: points that are converted to the core once.

use std::sync::Arc;

use cgroup::Cloud as CoreCloud;
use numpy::ndarray::Ix2;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::{Reals, array, checked};

/// A prepared point cloud; use it through `cgroup.features.Cloud`.
#[pyclass(frozen, module = "cgroup._core")]
pub struct Cloud {
    core: Arc<CoreCloud>,
}

#[pymethods]
impl Cloud {
    #[new]
    fn new(points: Reals<'_, Ix2>, name: &str) -> PyResult<Self> {
        Ok(Self { core: Arc::new(CoreCloud::new(points.points(name)?)) })
    }

    fn __len__(&self) -> usize {
        self.core.points().len()
    }

    /// Rotation to the cloud's intrinsic axes, (3,3).
    fn own_axes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let own = checked(self.core.own())?;
        array(py, own.0.axes.transpose().iter().copied())?.reshape([3, 3])
    }

    /// Diagonal of the box along the intrinsic axes.
    fn own_diagonal(&self) -> PyResult<f64> {
        Ok(checked(self.core.own())?.1.diagonal())
    }

    /// Mean of the points, (3,).
    fn center<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        array(py, self.core.points().center().iter().copied())
    }

    #[getter]
    fn diagonal(&self) -> f64 {
        self.core.points().diagonal()
    }
}

impl Cloud {
    /// The cloud, for a computation that may outlive this object.
    pub fn core(&self) -> Arc<CoreCloud> {
        Arc::clone(&self.core)
    }
}
