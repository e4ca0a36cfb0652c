//! Pose graphs as arrays.

use cgroup::geometry::rigid::Rigid;
use cgroup::pose_graph::{self as core, Edge, Start};
use cgroup::{Error, memory};
use nalgebra::{Matrix3, Matrix6, Vector3};
use numpy::ndarray::{Ix1, Ix3};
use numpy::{PyArray1, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::convert::{Reals, array, checked, matrices};
use crate::features::rows_of;
use crate::run::{RunOptions, run};

/// Nodes and edges; `cgroup.scenes` has checked the shapes.
#[derive(FromPyObject)]
pub struct Arrays<'py>(
    Reals<'py, Ix3>,
    PyReadonlyArray2<'py, i64>,
    Reals<'py, Ix3>,
    Reals<'py, Ix3>,
    Reals<'py, Ix1>,
);

impl Arrays<'_> {
    fn to_core(&self) -> PyResult<(Vec<Rigid>, Vec<Edge>)> {
        let Self(poses, ends, measurements, information, probability) = self;
        let poses = checked(memory::collect(poses.blocks()?.iter().map(rigid)))?;
        let (measurements, information) = (measurements.blocks()?, information.blocks::<36>()?);
        let probability = probability.vector()?;
        let node = |number: i64| usize::try_from(number).unwrap_or(usize::MAX);
        let ends = ends.as_slice()?.as_chunks::<2>().0;
        let edges = ends.iter().zip(&measurements).zip(information.iter().zip(&probability)).map(
            |((&[from, to], measurement), (information, &probability))| Edge {
                from: node(from),
                to: node(to),
                measurement: rigid(measurement),
                information: Matrix6::from_column_slice(information), // symmetric
                probability,
            },
        );
        Ok((poses, checked(memory::collect(edges))?))
    }
}

fn rigid(matrix: &[f64; 16]) -> Rigid {
    Rigid {
        rotation: Matrix3::from_fn(|row, column| matrix[4 * row + column]),
        translation: Vector3::from_fn(|row, _| matrix[4 * row + 3]),
    }
}

/// Poses, and mask of kept edges.
type PyOptimized<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray1<bool>>);

/// Poses of least cost, and mask of kept edges.
#[pyfunction]
pub fn optimize_poses<'py>(
    py: Python<'py>,
    graph: Arrays<'py>,
    run_options: RunOptions,
    chordal: bool,
    robust: bool,
) -> PyResult<PyOptimized<'py>> {
    let (poses, edges) = graph.to_core()?;
    let start = if chordal { Start::Chordal } else { Start::Given };
    let found =
        run(py, &run_options, move |execution| core::optimize(&poses, &edges, start, robust, execution))?;
    let poses = matrices(py, found.poses.iter().map(Rigid::to_matrix))?;
    Ok((poses, PyArray1::from_vec(py, found.kept)))
}

/// `e' W e` of each edge.
#[pyfunction]
pub fn squared_errors<'py>(
    py: Python<'py>,
    graph: Arrays<'py>,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (poses, edges) = graph.to_core()?;
    let found = run(py, &run_options, move |_| core::squared_errors(&poses, &edges))?;
    Ok(PyArray1::from_vec(py, found))
}

/// Marginal covariances of nodes.
#[pyfunction]
pub fn pose_covariances<'py>(
    py: Python<'py>,
    graph: Arrays<'py>,
    nodes: PyReadonlyArray1<'py, i64>,
    run_options: RunOptions,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let ((poses, edges), nodes) = (graph.to_core()?, rows_of(&nodes)?);
    let found = run(py, &run_options, move |execution| -> Result<_, Error> {
        core::covariances(&poses, &edges, &nodes, execution)
    })?;
    let count = found.len();
    array(py, found.iter().flat_map(|matrix| matrix.iter().copied()))?.reshape([count, 6, 6])
}
