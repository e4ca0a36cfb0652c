//! Colours: changed bytes, and their differences.

use super::arithmetic::{Decoder, Model};
use super::integers::Integers;
use crate::error::Result;

/// Bit of the set of changed bytes that marks a colour that is not grey.
const NOT_GREY: usize = 1 << 6;

/// Models of colours, since version 2: green and blue are predicted from the change of red.
pub(super) struct Colors {
    changed: Model,
    /// Lower and upper byte of red, green, blue.
    bytes: [Model; 6],
}

impl Default for Colors {
    fn default() -> Self {
        Self { changed: Model::new(128), bytes: Model::several(256) }
    }
}

impl Colors {
    /// Decodes the colour after the last one.
    pub fn next(&mut self, decoder: &mut Decoder, last: [u16; 3]) -> Result<[u16; 3]> {
        let changed = decoder.symbol(&mut self.changed)?;
        let halves = last.map(u16::to_le_bytes);
        let mut next = halves;
        for half in 0..2 {
            if changed & 1 << half != 0 {
                next[0][half] = halves[0][half].wrapping_add(decoder.symbol(&mut self.bytes[half])? as u8);
            }
        }
        if changed & NOT_GREY == 0 {
            return Ok([u16::from_le_bytes(next[0]); 3]);
        }
        for half in 0..2 {
            let mut drift = i32::from(next[0][half]) - i32::from(halves[0][half]);
            for channel in 1..3 {
                if channel == 2 {
                    drift = (drift + i32::from(next[1][half]) - i32::from(halves[1][half])) / 2;
                }
                let place = 2 * channel + half;
                if changed & 1 << place != 0 {
                    let predicted = (drift + i32::from(halves[channel][half])).clamp(0, 255) as u8;
                    next[channel][half] =
                        predicted.wrapping_add(decoder.symbol(&mut self.bytes[place])? as u8);
                }
            }
        }
        Ok(next.map(u16::from_le_bytes))
    }
}

/// Models of colours in version 1: each byte separately.
pub(super) struct ColorsOfVersion1 {
    changed: Model,
    bytes: Integers,
}

impl Default for ColorsOfVersion1 {
    fn default() -> Self {
        Self { changed: Model::new(64), bytes: Integers::new(8, 6) }
    }
}

impl ColorsOfVersion1 {
    /// Decodes the colour after the last one.
    pub fn next(&mut self, decoder: &mut Decoder, last: [u16; 3]) -> Result<[u16; 3]> {
        let changed = decoder.symbol(&mut self.changed)?;
        let mut halves = last.map(u16::to_le_bytes);
        for (place, byte) in halves.as_flattened_mut().iter_mut().enumerate() {
            if changed & 1 << place != 0 {
                *byte = self.bytes.next(decoder, i32::from(*byte), place)? as u8;
            }
        }
        Ok(halves.map(u16::from_le_bytes))
    }
}
