//! Memory blocks whose size grows with the input: a failed reservation is an error and not an abort.
//!
//! The collections of the standard library end the process if the system refuses memory. All memory that
//! grows with the number of correspondences or points is therefore reserved here first. Blocks of fixed size
//! are not.

use std::collections::HashSet;
use std::hash::Hash;

use rayon::iter::{IndexedParallelIterator, ParallelIterator};
use rayon::prelude::*;

use crate::error::{Error, Result};

/// An empty vector with room for `len` items.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn with_capacity<T>(len: usize) -> Result<Vec<T>> {
    let mut items = Vec::new();
    reserve(&mut items, len)?;
    Ok(items)
}

/// An empty set with room for `len` items.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn set<T: Eq + Hash>(len: usize) -> Result<HashSet<T>> {
    let mut items = HashSet::new();
    items.try_reserve(len).map_err(|_| refused::<T>(len))?;
    Ok(items)
}

/// Reserves room for `more` items after the existing ones.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn reserve<T>(items: &mut Vec<T>, more: usize) -> Result<()> {
    items.try_reserve(more).map_err(|_| refused::<T>(items.len().saturating_add(more)))
}

/// `len` copies of a value.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn filled<T: Clone>(value: T, len: usize) -> Result<Vec<T>> {
    let mut items = with_capacity(len)?;
    items.resize(len, value);
    Ok(items)
}

/// Copies a slice.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn copied<T: Clone>(items: &[T]) -> Result<Vec<T>> {
    let mut copy = with_capacity(items.len())?;
    copy.extend_from_slice(items);
    Ok(copy)
}

/// Truncates, or pads with a value, to `len` items.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn resize<T: Clone>(items: &mut Vec<T>, len: usize, value: T) -> Result<()> {
    reserve(items, len.saturating_sub(items.len()))?;
    items.resize(len, value);
    Ok(())
}

/// Appends copies of items.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn extend<T: Clone>(items: &mut Vec<T>, more: &[T]) -> Result<()> {
    reserve(items, more.len())?;
    items.extend_from_slice(more);
    Ok(())
}

/// Concatenates several blocks.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn concat<T: Clone>(blocks: &[Vec<T>]) -> Result<Vec<T>> {
    let mut items = with_capacity(blocks.iter().map(Vec::len).sum())?;
    blocks.iter().for_each(|block| items.extend_from_slice(block));
    Ok(items)
}

/// Appends an item; the capacity doubles when it is exhausted.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn push<T>(items: &mut Vec<T>, item: T) -> Result<()> {
    if items.len() == items.capacity() {
        reserve(items, 1)?;
    }
    items.push(item);
    Ok(())
}

/// Collects the items of an iterator.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn collect<T>(items: impl IntoIterator<Item = T>) -> Result<Vec<T>> {
    let items = items.into_iter();
    let (least, most) = items.size_hint();
    let mut collected = with_capacity(least)?;
    if most == Some(least) {
        collected.extend(items); // the room is reserved, and this is faster than one by one
        return Ok(collected);
    }
    for item in items {
        push(&mut collected, item)?;
    }
    Ok(collected)
}

/// Applies a fallible function to each item of an array.
///
/// # Errors
/// The first error of the function.
pub fn try_map<T, U: Default, const N: usize>(
    items: [T; N],
    mut make: impl FnMut(T) -> Result<U>,
) -> Result<[U; N]> {
    let mut made = std::array::from_fn(|_| U::default());
    for (slot, item) in made.iter_mut().zip(items) {
        *slot = make(item)?;
    }
    Ok(made)
}

/// The working space of a thread, whose reservation may have failed in the thread's first task.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn ready<T>(space: &mut Result<T>) -> Result<&mut T> {
    space.as_mut().map_err(|error| error.clone())
}

/// Collects the items of an iterator of results, or returns its first error.
///
/// # Errors
/// The first error of the items, or [`Error::OutOfMemory`].
pub fn try_collect<T>(items: impl IntoIterator<Item = Result<T>>) -> Result<Vec<T>> {
    let items = items.into_iter();
    // The upper bound is reserved: errors are rare.
    let mut collected = with_capacity(items.size_hint().1.unwrap_or(0))?;
    for item in items {
        push(&mut collected, item?)?;
    }
    Ok(collected)
}

/// Collects the items of a parallel iterator, in order.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn par_collect<T: Send>(items: impl IndexedParallelIterator<Item = T>) -> Result<Vec<T>> {
    let mut collected = with_capacity(items.len())?;
    items.collect_into_vec(&mut collected);
    Ok(collected)
}

/// Collects the items of a parallel iterator of results, in order, or returns one of its errors.
///
/// # Errors
/// An error of the items, or [`Error::OutOfMemory`].
pub fn par_try_collect<T: Send + Default + Clone>(
    items: impl IndexedParallelIterator<Item = Result<T>>,
) -> Result<Vec<T>> {
    par_try_fill(T::default(), items)
}

/// As [`par_try_collect`], with `value` as the placeholder of the items.
///
/// # Errors
/// An error of the items, or [`Error::OutOfMemory`].
pub fn par_try_fill<T: Send + Clone>(
    value: T,
    items: impl IndexedParallelIterator<Item = Result<T>>,
) -> Result<Vec<T>> {
    let mut collected = filled(value, items.len())?;
    collected.par_iter_mut().zip(items).try_for_each(|(slot, item)| {
        *slot = item?;
        Ok(())
    })?;
    Ok(collected)
}

/// Checks that the system would now provide `len` items of `T`: for blocks that a library allocates itself,
/// where a refusal would end the process.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn probe<T>(len: usize) -> Result<()> {
    with_capacity::<T>(len).map(drop)
}

/// The error for a refused block of `len` items.
fn refused<T>(len: usize) -> Error {
    Error::OutOfMemory { bytes: len.saturating_mul(size_of::<T>()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_sizes_are_errors() {
        let refused = Err(Error::OutOfMemory { bytes: usize::MAX });
        assert_eq!(filled(0.0_f64, usize::MAX), refused);
        assert_eq!(probe::<f64>(usize::MAX).map(|()| Vec::new()), refused);
        assert_eq!(set::<u64>(usize::MAX).map(|_| Vec::new()), refused);
        let mut items = vec![1.0];
        assert_eq!(reserve(&mut items, usize::MAX).map(|()| Vec::new()), refused);
    }

    #[test]
    fn items_are_collected_in_order() {
        assert_eq!(collect((0..5).filter(|i| i % 2 == 0)), Ok(vec![0, 2, 4]));
        assert_eq!(par_collect((0..5).into_par_iter().map(|i| i * i)), Ok(vec![0, 1, 4, 9, 16]));
        assert_eq!(par_try_collect((0..5).into_par_iter().map(Ok)), Ok(vec![0, 1, 2, 3, 4]));
        assert_eq!(copied(&[1, 2]), Ok(vec![1, 2]));
        assert_eq!(concat(&[vec![1], vec![], vec![2, 3]]), Ok(vec![1, 2, 3]));
        assert_eq!(try_map([3, 4], |i| filled(i, 1)), Ok([vec![3], vec![4]]));
        let mut items = vec![1, 2];
        assert_eq!((resize(&mut items, 4, 7), extend(&mut items, &[3])), (Ok(()), Ok(())));
        assert_eq!(items, [1, 2, 7, 7, 3]);
    }

    #[test]
    fn the_first_failure_ends_a_collection() {
        let items = || (0..5).map(|i| if i == 3 { Err(Error::Interrupted) } else { Ok(i) });
        assert_eq!(try_collect(items()), Err(Error::Interrupted));
        let found = (0..5).into_par_iter().map(|i| if i == 3 { Err(Error::Interrupted) } else { Ok(i) });
        assert_eq!(par_try_collect(found), Err(Error::Interrupted));
        assert_eq!(ready(&mut filled(0_u64, usize::MAX)).err(), filled(0_u64, usize::MAX).err());
    }
}
