//! Binding.
use pyo3::prelude::*;
/// m
#[pymodule(gil_used = false)]
mod _core {}
