//! The options of a call, each read once by the rule of its kind; the core checks ranges.

use cgroup::selection::otsu::{DEFAULT_BINS, OtsuMode, Threshold};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyString};

use crate::convert::{choose, one_of};
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
        match whole(&value) {
            Some(number) if number >= least => Ok(number as usize),
            _ => Err(refused(name, &value, &format!("give a whole number of at least {least}"))),
        }
    }

    /// A whole number of at least `least`, or None.
    pub fn optional_count(&mut self, name: &'static str, least: u64) -> PyResult<Option<usize>> {
        let value = self.take(name)?;
        match whole(&value) {
            _ if value.is_none() => Ok(None),
            Some(number) if number >= least => Ok(Some(number as usize)),
            _ => Err(refused(name, &value, &format!("give a whole number of at least {least}, or None"))),
        }
    }

    /// A key of random numbers.
    pub fn seed(&mut self, name: &'static str) -> PyResult<u64> {
        self.count(name, 0).map(|number| number as u64)
    }

    /// A number.
    pub fn number(&mut self, name: &'static str) -> PyResult<f64> {
        let value = self.take(name)?;
        real(&value).ok_or_else(|| refused(name, &value, "give a number"))
    }

    /// A number, or None.
    pub fn optional(&mut self, name: &'static str) -> PyResult<Option<f64>> {
        let value = self.take(name)?;
        if value.is_none() {
            return Ok(None);
        }
        real(&value).map(Some).ok_or_else(|| refused(name, &value, "give a number, or None"))
    }

    /// True or False.
    pub fn flag(&mut self, name: &'static str) -> PyResult<bool> {
        let value = self.take(name)?;
        value.extract().map_err(|_| refused(name, &value, "give True or False"))
    }

    /// One of a few words.
    pub fn choice<T: Copy>(&mut self, name: &'static str, choices: &[(&str, T)]) -> PyResult<T> {
        let value = self.take(name)?;
        match value.cast::<PyString>() {
            Ok(word) => choose(name, word.to_str()?, choices),
            Err(_) => Err(refused(name, &value, &one_of(choices))),
        }
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
        let number = real(&value).ok_or_else(|| refused("threshold", &value, "give \"otsu\" or a number"));
        number.map(Threshold::Fixed)
    }

    fn take(&mut self, name: &'static str) -> PyResult<Bound<'py, PyAny>> {
        self.read.push(name);
        let missing = || InputError::new_err(format!("option: {} needs {name:?}", self.method));
        self.given.get_item(name)?.ok_or_else(missing)
    }
}

fn refused(name: &str, value: &Bound<'_, PyAny>, remedy: &str) -> PyErr {
    match value.repr() {
        Ok(got) => InputError::new_err(format!("{name}: got {got}; {remedy}")),
        Err(error) => error,
    }
}

/// Python takes True and False for whole numbers too; as an option they are a mistake.
fn whole(value: &Bound<'_, PyAny>) -> Option<u64> {
    if value.is_instance_of::<PyBool>() { None } else { value.extract().ok() }
}

/// Whatever Python can make a float of, but no truth value and no array, not even of one number.
fn real(value: &Bound<'_, PyAny>) -> Option<f64> {
    if let Ok(number) = value.cast_exact::<PyFloat>() {
        return Some(number.value());
    }
    if value.is_instance_of::<PyBool>() || value.len().is_ok() { None } else { value.extract().ok() }
}
