//! The error type of the crate: what was wrong, the value, the cause and the remedy.

/// Reason why a computation failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An invalid argument.
    #[error("{what}: got {got}; {remedy}")]
    InvalidInput {
        /// The argument, by its public name.
        what: String,
        /// The offending value, row or shape.
        got: String,
        /// The expected value, and how to provide it.
        remedy: String,
    },
    /// The correspondences lack a field that the method requires.
    #[error("{method} needs `{field}`, which is missing; {remedy}")]
    MissingField {
        /// The method, by its public name.
        method: &'static str,
        /// The missing field.
        field: &'static str,
        /// How to compute the field.
        remedy: &'static str,
    },
    /// The group has too few points to determine a rigid transform.
    #[error("no consensus: {reason}")]
    NoConsensus {
        /// The number of correspondences, and the number needed.
        reason: String,
    },
    /// The system refused the memory of a block.
    #[error(
        "no memory for a block of {}; give fewer points, a lower max_memory or fewer threads, or allow the process more memory",
        mebibytes(*bytes)
    )]
    OutOfMemory {
        /// Size of the block.
        bytes: usize,
    },
    /// The caller requested a stop.
    #[error("interrupted")]
    Interrupted,
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An [`Error::InvalidInput`] from anything printable.
    #[expect(clippy::needless_pass_by_value, reason = "call sites read better without references")]
    pub fn invalid(what: impl Into<String>, got: impl ToString, remedy: impl Into<String>) -> Self {
        Self::InvalidInput { what: what.into(), got: got.to_string(), remedy: remedy.into() }
    }
}

/// A size with its unit.
fn mebibytes(bytes: usize) -> String {
    let size = bytes as f64 / f64::from(1 << 20);
    if size < 10.0 { format!("{size:.1} MiB") } else { format!("{size:.0} MiB") }
}

/// A number for an error message, as a power of ten if it has many digits.
pub(crate) fn shown(value: f64) -> String {
    let plain = value == 0.0 || (1e-5..1e16).contains(&value.abs()) || !value.is_finite();
    if plain { value.to_string() } else { format!("{value:e}") }
}

/// Accepts a finite length greater than zero.
///
/// # Errors
/// [`Error::InvalidInput`] otherwise.
pub fn positive(name: &str, value: f64) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        return Ok(value);
    }
    Err(Error::invalid(name, shown(value), "give a finite number greater than 0"))
}

/// Accepts a number in the closed interval from 0 to 1.
///
/// # Errors
/// [`Error::InvalidInput`] otherwise.
pub fn fraction(name: &str, value: f64) -> Result<f64> {
    if (0.0..=1.0).contains(&value) {
        return Ok(value);
    }
    Err(Error::invalid(name, shown(value), "give a number between 0 and 1"))
}

/// Accepts a count of at least one.
///
/// # Errors
/// [`Error::InvalidInput`] otherwise.
pub fn at_least_one(name: &str, value: usize) -> Result<usize> {
    if value >= 1 {
        return Ok(value);
    }
    Err(Error::invalid(name, value, "give a whole number of at least 1"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_many_digits_are_shown_as_powers_of_ten() {
        let numbers = [0.0, -1.0, 0.25, 1e301, -5e-324, f64::NAN].map(shown);
        assert_eq!(numbers, ["0", "-1", "0.25", "1e301", "-5e-324", "NaN"]);
    }
}
