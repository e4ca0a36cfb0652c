//! The options of a call, each read once by the rule of its kind; the core checks ranges.

use cgroup::selection::otsu::{DEFAULT_BINS, OtsuMode, Threshold};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};

use crate::convert::{choose, values};
use crate::error::InputError;

/// Options by name, as Python gave them.
pub struct Options<'py> {
    method: &'py str,
    given: &'py Bound<'py, PyDict>,
    read: Vec<&'static str>,
}

impl<'py> Options<'py> {
    /// The options given for a method.
    pub fn new(method: &'py str, given: &'py Bound<'py, PyDict>) -> Self {
        Self { method, given, read: Vec::new() }
    }

    /// Refuses options that were not read: the method does not have them.
    pub fn finish(&self) -> PyResult<()> {
        let Self { method, given, read } = self;
        for name in given.keys() {
            let name: String = name.extract()?;
            if !read.contains(&name.as_str()) {
                let message = format!("option: {method} has no {name:?}; it takes {}", read.join(", "));
                return Err(InputError::new_err(message));
            }
        }
        Ok(())
    }

    /// A whole number of at least `least`.
    pub fn count(&mut self, name: &'static str, least: u64) -> PyResult<usize> {
        let value = self.take(name)?;
        whole(name, &value, least, None)
    }

    /// A whole number of at least `least`, or None.
    pub fn optional_count(&mut self, name: &'static str, least: u64) -> PyResult<Option<usize>> {
        let value = self.take(name)?;
        if value.is_none() {
            return Ok(None);
        }
        let remedy = format!("give a whole number of at least {least}, or None");
        whole(name, &value, least, Some(&remedy)).map(Some)
    }

    /// A key of random numbers.
    pub fn seed(&mut self, name: &'static str) -> PyResult<u64> {
        self.count(name, 0).map(|number| number as u64)
    }

    /// A number.
    pub fn number(&mut self, name: &'static str) -> PyResult<f64> {
        let value = self.take(name)?;
        real(name, &value, "give a number")
    }

    /// A number, or None.
    pub fn optional(&mut self, name: &'static str) -> PyResult<Option<f64>> {
        let value = self.take(name)?;
        if value.is_none() { Ok(None) } else { real(name, &value, "give a number, or None").map(Some) }
    }

    /// True or False.
    pub fn flag(&mut self, name: &'static str) -> PyResult<bool> {
        let value = self.take(name)?;
        match value.cast_exact::<PyBool>() {
            Ok(flag) => Ok(flag.is_true()),
            Err(_) => values(value.py())?.call_method1("as_flag", (name, &value))?.extract(),
        }
    }

    /// One of a few words.
    pub fn choice<T: Copy>(&mut self, name: &'static str, choices: &[(&str, T)]) -> PyResult<T> {
        let value = self.take(name)?;
        choose(name, &value, choices)
    }

    /// The cut on scores, from the options `threshold` and `otsu`.
    pub fn threshold(&mut self) -> PyResult<Threshold> {
        self.threshold_in_bins(DEFAULT_BINS)
    }

    /// The same, where the number of Otsu's bins is an option too.
    pub fn threshold_in_bins(&mut self, bins: usize) -> PyResult<Threshold> {
        let modes = [
            ("minmax", OtsuMode::MinMax { bins }),
            ("exact", OtsuMode::Exact),
            ("covis", OtsuMode::Covis),
            ("legacy", OtsuMode::Legacy { bins }),
        ];
        let mode = self.choice("otsu", &modes)?;
        let value = self.take("threshold")?;
        if value.cast::<PyString>().is_ok_and(|word| word == "otsu") {
            return Ok(Threshold::Otsu(mode));
        }
        real("threshold", &value, "give \"otsu\" or a number").map(Threshold::Fixed)
    }

    fn take(&mut self, name: &'static str) -> PyResult<Bound<'py, PyAny>> {
        self.read.push(name);
        let missing = || InputError::new_err(format!("option: {} needs {name:?}", self.method));
        self.given.get_item(name)?.ok_or_else(missing)
    }
}

/// A count by the rule of `cgroup._checks.values`, which is asked about anything but an `int` that will do.
fn whole(name: &str, value: &Bound<'_, PyAny>, least: u64, remedy: Option<&str>) -> PyResult<usize> {
    let number: Option<u64> = value.cast_exact::<PyInt>().ok().and_then(|number| number.extract().ok());
    match number {
        Some(number) if number >= least => Ok(number as usize),
        _ => values(value.py())?.call_method1("as_count", (name, value, least, remedy))?.extract(),
    }
}

/// A number by the rule of `cgroup._checks.values`, which is asked about anything but a `float`.
fn real(name: &str, value: &Bound<'_, PyAny>, remedy: &str) -> PyResult<f64> {
    match value.cast_exact::<PyFloat>() {
        Ok(number) => Ok(number.value()),
        Err(_) => values(value.py())?.call_method1("as_number", (name, value, remedy))?.extract(),
    }
}
