//! Values that are computed when they are first needed.

use std::sync::OnceLock;

use crate::error::Result;

/// Returns the value of a cell; computes it first if need be. Two threads may compute the same value.
pub fn lazily<T>(cell: &OnceLock<T>, compute: impl FnOnce() -> Result<T>) -> Result<&T> {
    if let Some(known) = cell.get() {
        return Ok(known);
    }
    let computed = compute()?;
    Ok(cell.get_or_init(|| computed))
}
