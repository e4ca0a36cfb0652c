//! Between numpy arrays and the core's types; nothing else touches arrays.

use cgroup::correspondences::Frame;
use cgroup::selection::otsu::{OtsuMode, Threshold};
use cgroup::{Correspondences, Error, Grouping};
use nalgebra::{Matrix3, Matrix4};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{InputError, to_python};

/// The fields of a Python `Correspondences`, whose shapes and types that class has checked.
#[derive(FromPyObject)]
pub struct Fields<'py> {
    source: PyReadonlyArray2<'py, f64>,
    target: PyReadonlyArray2<'py, f64>,
    similarity: Option<PyReadonlyArray1<'py, f64>>,
    ratio: Option<PyReadonlyArray1<'py, f64>>,
    source_lrf: Option<PyReadonlyArray3<'py, f64>>,
    target_lrf: Option<PyReadonlyArray3<'py, f64>>,
    resolution: Option<f64>,
    source_centroid: Option<PyReadonlyArray1<'py, f64>>,
}

impl Fields<'_> {
    /// The core's correspondences.
    pub fn to_core(&self) -> PyResult<Correspondences> {
        self.build().map_err(|error| to_python(&error))
    }

    fn build(&self) -> Result<Correspondences, Error> {
        let mut result = Correspondences::new(&points(&self.source), &points(&self.target))?;
        if let Some(similarity) = &self.similarity {
            result = result.with_similarity(vector(similarity))?;
        }
        if let Some(ratio) = &self.ratio {
            result = result.with_ratio(vector(ratio))?;
        }
        if let (Some(source), Some(target)) = (&self.source_lrf, &self.target_lrf) {
            result = result.with_frames(frames(source), frames(target))?;
        }
        if let Some(resolution) = self.resolution {
            result = result.with_resolution(resolution)?;
        }
        if let Some(centroid) = &self.source_centroid {
            let c = centroid.as_array();
            result = result.with_source_centroid([c[0], c[1], c[2]])?;
        }
        Ok(result)
    }
}

/// Rows of coordinates from an (n,3) array.
pub fn points(array: &PyReadonlyArray2<'_, f64>) -> Vec<[f64; 3]> {
    array.as_array().rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect()
}

/// Numbers from an (n,) array.
pub fn vector(array: &PyReadonlyArray1<'_, f64>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}

/// Frames from an (n,3,3) array; a block with NaN is no frame.
pub fn frames(array: &PyReadonlyArray3<'_, f64>) -> Vec<Frame> {
    let to_frame = |block: numpy::ndarray::ArrayView2<'_, f64>| {
        let axes = Matrix3::from_fn(|row, column| block[(row, column)]);
        (!axes.iter().any(|value| value.is_nan())).then_some(axes)
    };
    array.as_array().outer_iter().map(to_frame).collect()
}

/// A 4x4 array.
pub fn matrix<'py>(py: Python<'py>, matrix: &Matrix4<f64>) -> Bound<'py, PyArray2<f64>> {
    let row = |i: usize| vec![matrix[(i, 0)], matrix[(i, 1)], matrix[(i, 2)], matrix[(i, 3)]];
    let rows = [row(0), row(1), row(2), row(3)];
    let array = PyArray2::from_vec2(py, &rows);
    array.unwrap_or_else(|_| PyArray2::zeros(py, [4, 4], false))
}

/// What Python gets of a grouping: mask, scores, threshold, model, diagnostics.
pub type PyGrouping<'py> = (
    Bound<'py, PyArray1<bool>>,
    Option<Bound<'py, PyArray1<f64>>>,
    Option<f64>,
    Option<Bound<'py, PyArray2<f64>>>,
    Bound<'py, PyDict>,
);

/// Converts a grouping.
pub fn grouping(py: Python<'_>, result: Grouping) -> PyResult<PyGrouping<'_>> {
    let diagnostics = PyDict::new(py);
    for (name, value) in &result.diagnostics {
        diagnostics.set_item(name, value)?;
    }
    Ok((
        PyArray1::from_vec(py, result.mask),
        result.scores.map(|scores| PyArray1::from_vec(py, scores)),
        result.threshold,
        result.model.map(|model| matrix(py, &model)),
        diagnostics,
    ))
}

/// `threshold`: "otsu" or a number.
#[derive(FromPyObject)]
pub enum ThresholdOption {
    /// A number.
    Fixed(f64),
    /// A word; only "otsu" is one.
    Named(String),
}

/// A threshold from the options `threshold`, `otsu` and `bins`.
pub fn threshold(option: &ThresholdOption, mode: &str, bins: usize) -> PyResult<Threshold> {
    let modes = [
        ("minmax", OtsuMode::MinMax { bins }),
        ("exact", OtsuMode::Exact),
        ("covis", OtsuMode::Covis),
        ("legacy", OtsuMode::Legacy { bins }),
    ];
    match option {
        ThresholdOption::Fixed(value) => Ok(Threshold::Fixed(*value)),
        ThresholdOption::Named(name) if name == "otsu" => Ok(Threshold::Otsu(choose("otsu", mode, &modes)?)),
        ThresholdOption::Named(name) => {
            Err(InputError::new_err(format!("threshold: got {name:?}; give \"otsu\" or a number")))
        }
    }
}

/// The value that goes by `given` among the choices of option `name`.
pub fn choose<T: Copy>(name: &str, given: &str, choices: &[(&str, T)]) -> PyResult<T> {
    if let Some((_, value)) = choices.iter().find(|(choice, _)| *choice == given) {
        return Ok(*value);
    }
    let known: Vec<String> = choices.iter().map(|(choice, _)| format!("{choice:?}")).collect();
    Err(InputError::new_err(format!("{name}: got {given:?}; choose one of {}", known.join(", "))))
}
