//! The only place where an error of the core becomes a Python exception.

use cgroup::Error;
use pyo3::PyErr;
use pyo3::exceptions::PyKeyboardInterrupt;

mod exceptions {
    pyo3::import_exception!(cgroup.errors, CgroupError);
    pyo3::import_exception!(cgroup.errors, InputError);
    pyo3::import_exception!(cgroup.errors, NoConsensusError);
    pyo3::import_exception!(cgroup.errors, OutOfMemoryError);
}
pub use exceptions::{CgroupError, InputError, NoConsensusError, OutOfMemoryError};

/// The exception for an error.
pub fn to_python(error: &Error) -> PyErr {
    match error {
        Error::InvalidInput { what, got, remedy } => {
            InputError::new_err((what.clone(), got.clone(), remedy.clone()))
        }
        Error::MissingField { .. } => InputError::new_err(error.to_string()),
        Error::NoConsensus { .. } => NoConsensusError::new_err(error.to_string()),
        Error::OutOfMemory { .. } => OutOfMemoryError::new_err(error.to_string()),
        Error::Interrupted => PyKeyboardInterrupt::new_err(()),
        _ => CgroupError::new_err(error.to_string()),
    }
}
