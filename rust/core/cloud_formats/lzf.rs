//! LZF, PCD's compression: runs of literals, and references to earlier bytes.
//!
//! A control byte below 32 precedes that many literal bytes and one more. Any other control byte holds in its
//! upper three bits the length of a copy minus 2 (7: add the next byte), in its lower five the upper bits of
//! its distance minus 1, whose lower eight bits follow.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Longest copy, encoded by three bytes.
const LONGEST: usize = 7 + 255 + 2;

/// Steps between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 14;

/// Decompresses `packed` into `size` bytes.
///
/// # Errors
/// [`Error::InvalidInput`] for bytes that are damaged, or that do not become `size` bytes; [`Error::Interrupted`],
/// [`Error::OutOfMemory`].
pub fn decompress(packed: &[u8], size: usize, execution: &Execution) -> Result<Vec<u8>> {
    if size.div_ceil(LONGEST) > packed.len() {
        let got = format!("{} bytes that are to become {size}", packed.len());
        return Err(Error::invalid("compressed data", got, "the size is too large for the data"));
    }
    let mut plain = memory::with_capacity(size)?;
    let mut rest = packed;
    let mut steps = 0_usize;
    while !rest.is_empty() {
        steps += 1;
        if steps.is_multiple_of(CHECK_EVERY) {
            execution.check()?;
        }
        rest = step(rest, &mut plain, size).ok_or_else(broken)?;
    }
    if plain.len() == size { Ok(plain) } else { Err(broken()) }
}

/// Executes the next control byte; returns the rest after it, or `None` if it is invalid.
fn step<'a>(packed: &'a [u8], plain: &mut Vec<u8>, size: usize) -> Option<&'a [u8]> {
    let (&control, rest) = packed.split_first()?;
    let room = size - plain.len();
    if control < 32 {
        let (run, rest) = rest.split_at_checked(usize::from(control) + 1)?;
        if run.len() > room {
            return None;
        }
        plain.extend_from_slice(run);
        return Some(rest);
    }
    let (more, rest) = if control >> 5 == 7 { rest.split_first()? } else { (&0, rest) };
    let length = usize::from(control >> 5) + usize::from(*more) + 2;
    let (low, rest) = rest.split_first()?;
    let distance = (usize::from(control & 31) << 8 | usize::from(*low)) + 1;
    let start = plain.len().checked_sub(distance)?;
    if length > room {
        return None;
    }
    if distance >= length {
        plain.extend_from_within(start..start + length);
    } else {
        // The copied bytes overlap the result.
        for i in start..start + length {
            plain.push(plain[i]);
        }
    }
    Some(rest)
}

fn broken() -> Error {
    Error::invalid("compressed data", "an invalid sequence", "the file is damaged")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(packed: &[u8], size: usize) -> Result<Vec<u8>> {
        decompress(packed, size, &Execution::default())
    }

    #[test]
    fn runs_and_copies() {
        assert_eq!(plain(&[2, b'a', b'b', b'c'], 3), Ok(b"abc".to_vec()));
        assert_eq!(plain(&[1, b'a', b'b', 0x20, 1], 5), Ok(b"ababa".to_vec()));
        assert_eq!(plain(&[0, b'a', 0xe0, 0xff, 0], 265), Ok(vec![b'a'; 265]));
        assert_eq!(plain(&[3, 1, 2, 3, 4, 0x40, 3], 8), Ok(vec![1, 2, 3, 4, 1, 2, 3, 4]));
        assert_eq!(plain(&[], 0), Ok(Vec::new()));
    }

    #[test]
    fn invalid_sequences_are_refused() {
        let cases: [(&[u8], usize); 7] = [
            (&[2, b'a'], 3),
            (&[0, b'a', 0x20, 1], 4),
            (&[0, b'a', 0x20], 4),
            (&[0, b'a', 0xe0], 4),
            (&[1, b'a', b'b'], 1),
            (&[0, b'a', 0x20, 0], 3),
            (&[0, b'a'], 1_000_000_000),
        ];
        for (packed, size) in cases {
            assert!(plain(packed, size).is_err(), "{packed:?}");
        }
    }
}
