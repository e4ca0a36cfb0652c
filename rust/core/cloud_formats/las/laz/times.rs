//! GPS times. They are not used, but stored between the coordinates; only the state that determines their
//! length is kept.

use super::arithmetic::{Decoder, Model};
use super::integers::Integers;
use crate::error::Result;

/// Separately predicted sequences of times.
const SEQUENCES: usize = 4;
/// The largest multiple of the last difference, and the most negative one.
const MOST: usize = 500;
const LEAST: usize = 10;
/// Codes of the first negative multiple and the last.
const NEGATIVE: usize = MOST + 1;
const LEAST_CODE: usize = MOST + LEAST;
/// Codes after those of multiples: the same time again, a full time, and the other sequences.
const UNCHANGED: usize = LEAST_CODE + 1;
const FULL: usize = UNCHANGED + 1;
const CODES: u16 = (FULL + SEQUENCES) as u16;
/// Number of consecutive extreme differences after which they become the regular ones.
const MOST_EXTREME: u32 = 3;

/// Models of times, since version 2.
pub(super) struct Times {
    differences: [i32; SEQUENCES],
    extremes: [u32; SEQUENCES],
    last: usize,
    /// The most recently begun sequence.
    newest: usize,
    codes_after_none: Model,
    codes: Model,
    integers: Integers,
}

impl Default for Times {
    fn default() -> Self {
        Self {
            differences: [0; SEQUENCES],
            extremes: [0; SEQUENCES],
            last: 0,
            newest: 0,
            codes_after_none: Model::new(2 + SEQUENCES as u16),
            codes: Model::new(CODES),
            integers: Integers::new(32, 9),
        }
    }
}

impl Times {
    pub fn next(&mut self, decoder: &mut Decoder) -> Result<()> {
        // A time is at most one step away from its sequence; damaged bytes could continue for ever.
        for _ in 0..SEQUENCES {
            let other = if self.differences[self.last] == 0 {
                self.after_none(decoder)?
            } else {
                self.after_some(decoder)?
            };
            let Some(steps) = other else { break };
            self.last = (self.last + steps) % SEQUENCES;
        }
        Ok(())
    }

    /// Decodes a time after two equal ones; returns the steps to the time's sequence unless it is this one.
    fn after_none(&mut self, decoder: &mut Decoder) -> Result<Option<usize>> {
        match decoder.symbol(&mut self.codes_after_none)? {
            0 => {}
            1 => {
                self.differences[self.last] = self.integers.next(decoder, 0, 0)?;
                self.extremes[self.last] = 0;
            }
            2 => self.begin(decoder)?,
            code => return Ok(Some(code - 2)),
        }
        Ok(None)
    }

    /// Decodes a time after two different ones.
    fn after_some(&mut self, decoder: &mut Decoder) -> Result<Option<usize>> {
        let difference = self.differences[self.last];
        let code = decoder.symbol(&mut self.codes)?;
        // The expected multiple, the context, and whether the difference is extreme.
        let (multiple, context, is_extreme) = match code {
            0 => (0, 7, true),
            1 => (1, 1, false),
            2..10 => (code as i32, 2, false),
            10..MOST => (code as i32, 3, false),
            MOST => (MOST as i32, 4, true),
            NEGATIVE..LEAST_CODE => (MOST as i32 - code as i32, 5, false),
            LEAST_CODE => (-(LEAST as i32), 6, true),
            UNCHANGED => return Ok(None),
            FULL => {
                self.begin(decoder)?;
                return Ok(None);
            }
            _ => return Ok(Some(code - FULL)),
        };
        let found = self.integers.next(decoder, difference.wrapping_mul(multiple), context)?;
        let extremes = &mut self.extremes[self.last];
        if code == 1 {
            *extremes = 0;
        } else if is_extreme {
            *extremes += 1;
            if *extremes > MOST_EXTREME {
                *extremes = 0;
                self.differences[self.last] = found;
            }
        }
        Ok(None)
    }

    /// Begins a sequence with a full time.
    fn begin(&mut self, decoder: &mut Decoder) -> Result<()> {
        self.newest = (self.newest + 1) % SEQUENCES;
        self.integers.next(decoder, 0, 8)?;
        decoder.bits(32);
        self.last = self.newest;
        self.differences[self.last] = 0;
        self.extremes[self.last] = 0;
        Ok(())
    }
}

/// Codes of version 1 after those of multiples: a full time, the same time again.
const FULL_OF_VERSION1: usize = 510;
const CODES_OF_VERSION1: u16 = 512;

/// Models of times in version 1: one sequence.
pub(super) struct TimesOfVersion1 {
    difference: i32,
    extremes: u32,
    codes_after_none: Model,
    codes: Model,
    integers: Integers,
}

impl Default for TimesOfVersion1 {
    fn default() -> Self {
        Self {
            difference: 0,
            extremes: 0,
            codes_after_none: Model::new(3),
            codes: Model::new(CODES_OF_VERSION1),
            integers: Integers::new(32, 6),
        }
    }
}

impl TimesOfVersion1 {
    pub fn next(&mut self, decoder: &mut Decoder) -> Result<()> {
        if self.difference == 0 {
            match decoder.symbol(&mut self.codes_after_none)? {
                0 => {}
                1 => self.difference = self.integers.next(decoder, 0, 0)?,
                _ => skip_full(decoder),
            }
            return Ok(());
        }
        let code = decoder.symbol(&mut self.codes)?;
        let (expected, context) = match code {
            0 => (self.difference / 4, 2),
            1 => (self.difference, 1),
            2..FULL_OF_VERSION1 => {
                let context = if code < 10 {
                    3
                } else if code < 50 {
                    4
                } else {
                    5
                };
                (self.difference.wrapping_mul(code as i32), context)
            }
            FULL_OF_VERSION1 => {
                skip_full(decoder);
                return Ok(());
            }
            _ => return Ok(()),
        };
        let found = self.integers.next(decoder, expected, context)?;
        if code == 1 {
            self.difference = found;
            self.extremes = 0;
        } else if code == 0 || code == FULL_OF_VERSION1 - 1 {
            self.extremes += 1;
            if self.extremes > MOST_EXTREME {
                self.difference = found;
                self.extremes = 0;
            }
        }
        Ok(())
    }
}

fn skip_full(decoder: &mut Decoder) {
    decoder.bits(32);
    decoder.bits(32);
}
