//! Reads the options of a call by their kinds; the core checks ranges.

use cgroup::grouping::{BoxedMethod, methods};
use cgroup::options::{Kind, OptionInfo, OptionType, Value};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString, PyTuple};

use crate::convert::{choose, refused, values};
use crate::error::InputError;

/// The method with that public name and all its options.
pub fn method_with(name: &str, given: &Bound<'_, PyDict>) -> PyResult<BoxedMethod> {
    let found = methods().into_iter().find(|(known, _)| *known == name);
    let Some((_, mut method)) = found else {
        return Err(InputError::new_err(format!("method: got {name:?}, which the core does not have")));
    };
    for option in method.options() {
        let missing = || InputError::new_err(format!("option: {name} needs {:?}", option.name));
        let value = given.get_item(option.name)?.ok_or_else(missing)?;
        method.set(option.name, read(option, &value)?);
    }
    for key in given.keys() {
        let key: String = key.extract()?;
        if method.get(&key).is_none() {
            let known: Vec<&str> = method.options().iter().map(|option| option.name).collect();
            let message = format!("option: {name} has no {key:?}; it takes {}", known.join(", "));
            return Err(InputError::new_err(message));
        }
    }
    Ok(method)
}

/// Description of a method: required fields, optional fields, and options.
type Description<'py> = (Vec<&'static str>, Vec<&'static str>, Bound<'py, PyDict>);

/// Description of each method, by its public name.
///
/// An option has a kind, whether it may be None, its default, its least and greatest value or its choices,
/// and its text.
#[pyfunction]
pub fn describe_methods(py: Python<'_>) -> PyResult<Vec<(&'static str, Description<'_>)>> {
    let describe = |(name, method): (&'static str, BoxedMethod)| {
        let options = PyDict::new(py);
        for option in method.options() {
            let default = to_python(py, method.get(option.name).unwrap_or(Value::None))?;
            let (kind, range) = range_of(py, option.kind)?;
            options.set_item(option.name, (kind, option.optional, default, range, option.text.trim()))?;
        }
        Ok((name, (method.fields().to_vec(), method.optional_fields().to_vec(), options)))
    };
    methods().into_iter().map(describe).collect()
}

/// The name of a kind, and its least and greatest value or its choices.
fn range_of(py: Python<'_>, kind: Kind) -> PyResult<(&'static str, Bound<'_, PyTuple>)> {
    let range = |values: &[Value]| PyTuple::new(py, values.iter().map(|&value| Shown(value)));
    Ok(match kind {
        Kind::Flag => ("flag", range(&[])?),
        Kind::Seed => ("seed", range(&[Value::Whole(0), Value::Whole(u64::MAX)])?),
        Kind::Count { least, most } => ("count", range(&[Value::Whole(least), Value::Whole(most)])?),
        Kind::Rounds { least } => ("rounds", range(&[Value::Whole(least), Value::Whole(u64::MAX)])?),
        Kind::Length => ("length", range(&[])?),
        Kind::Number { least, most, .. } => ("number", range(&[Value::Number(least), Value::Number(most)])?),
        Kind::Choice(choices) => ("choice", range(choices)?),
        Kind::Cut => ("cut", range(&[])?),
        Kind::Scale => ("scale", range(&[])?),
    })
}

/// A value to be converted to Python.
struct Shown(Value);

impl<'py> IntoPyObject<'py> for Shown {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, self.0)
    }
}

fn to_python(py: Python<'_>, value: Value) -> PyResult<Bound<'_, PyAny>> {
    Ok(match value {
        Value::None => py.None().into_bound(py),
        Value::Flag(flag) => PyBool::new(py, flag).to_owned().into_any(),
        Value::Whole(number) => number.into_pyobject(py)?.into_any(),
        Value::Number(number) => PyFloat::new(py, number).into_any(),
        Value::Word(word) => PyString::new(py, word).into_any(),
        Value::Range(low, high) => PyTuple::new(py, [low, high])?.into_any(),
    })
}

/// The value of an option, with the type of its kind.
fn read(option: &OptionInfo, given: &Bound<'_, PyAny>) -> PyResult<Value> {
    let name = option.name;
    if option.optional && given.is_none() {
        return Ok(Value::None);
    }
    let or_none = if option.optional { ", or None" } else { "" };
    match option.kind {
        Kind::Flag => flag(name, given),
        Kind::Seed => whole(name, given, 0, ""),
        Kind::Count { least, .. } | Kind::Rounds { least } => whole(name, given, least, or_none),
        Kind::Length | Kind::Number { .. } => real(name, given, &format!("give a number{or_none}")),
        Kind::Choice(choices) => chosen(name, given, choices),
        Kind::Cut if given.cast::<PyString>().is_ok_and(|word| word == "otsu") => Ok(Value::Word("otsu")),
        Kind::Cut => real(name, given, "give \"otsu\" or a number"),
        Kind::Scale => scale(name, given),
    }
}

/// Bounds or none, validated as in `cgroup._checks.values`.
fn scale(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Value> {
    let bounds: Option<(f64, f64)> =
        values(given.py())?.call_method1("as_scale", (name, given))?.extract()?;
    Ok(bounds.map_or(Value::Flag(false), |(low, high)| Value::Range(low, high)))
}

fn flag(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Value> {
    let flag = match given.cast_exact::<PyBool>() {
        Ok(flag) => flag.is_true(),
        Err(_) => values(given.py())?.call_method1("as_flag", (name, given))?.extract()?,
    };
    Ok(Value::Flag(flag))
}

/// A count; anything but a valid `int` is passed to `cgroup._checks.values`.
fn whole(name: &str, given: &Bound<'_, PyAny>, least: u64, or_none: &str) -> PyResult<Value> {
    let number: Option<u64> = given.cast_exact::<PyInt>().ok().and_then(|number| number.extract().ok());
    let remedy = format!("give a whole number of at least {least}{or_none}");
    Ok(Value::Whole(match number {
        Some(number) if number >= least => number,
        _ => values(given.py())?.call_method1("as_count", (name, given, least, remedy))?.extract()?,
    }))
}

/// A number; anything but a `float` is passed to `cgroup._checks.values`.
fn real(name: &str, given: &Bound<'_, PyAny>, remedy: &str) -> PyResult<Value> {
    Ok(Value::Number(match given.cast_exact::<PyFloat>() {
        Ok(number) => number.value(),
        Err(_) => values(given.py())?.call_method1("as_number", (name, given, remedy))?.extract()?,
    }))
}

/// One of a few words or numbers.
fn chosen(name: &str, given: &Bound<'_, PyAny>, choices: &[Value]) -> PyResult<Value> {
    let named = |&choice: &Value| if let Value::Word(word) = choice { Some((word, choice)) } else { None };
    let words: Vec<(&str, Value)> = choices.iter().filter_map(named).collect();
    if !words.is_empty() {
        return choose(name, given, &words);
    }
    let mut numbers: Vec<u64> = choices.iter().filter_map(|&choice| OptionType::read(choice)).collect();
    numbers.sort_unstable();
    let (last, others) = numbers.split_last().unwrap_or((&0, &[]));
    let others: Vec<String> = others.iter().map(u64::to_string).collect();
    let remedy = format!("choose {} or {last}", others.join(", "));
    let number = values(given.py())?.call_method1("as_count", (name, given, 0, &remedy))?.extract()?;
    if numbers.contains(&number) { Ok(Value::Whole(number)) } else { Err(refused(name, given, &remedy)) }
}
