//! Predicted integers: the difference is coded, first its number of bits, then its value.

use super::arithmetic::{BitModel, Decoder, Model};
use crate::error::Result;

/// Upper bits of a difference coded by a model; the lower bits are plain.
const MODELLED_BITS: u32 = 8;

/// Models of the differences of one quantity.
pub(super) struct Integers {
    bits: u32,
    /// Models of the number of bits, one per context.
    sizes: Vec<Model>,
    /// Model of a difference of no bits, which is 0 or 1.
    smallest: BitModel,
    /// Models of the upper bits of longer differences, by number of bits.
    differences: Vec<Model>,
    size: u32,
}

impl Integers {
    /// Models for integers of 8, 16 or 32 bits.
    pub fn new(bits: u32, contexts: usize) -> Self {
        Self {
            bits,
            sizes: (0..contexts).map(|_| Model::new(bits as u16 + 1)).collect(),
            smallest: BitModel::default(),
            differences: (1..=bits).map(|size| Model::new(1 << size.min(MODELLED_BITS))).collect(),
            size: 0,
        }
    }

    /// Number of bits of the last difference.
    pub fn size(&self) -> u32 {
        self.size
    }

    /// Decodes the next integer.
    pub fn next(&mut self, decoder: &mut Decoder, predicted: i32, context: usize) -> Result<i32> {
        self.size = decoder.symbol(&mut self.sizes[context])? as u32;
        let integer = predicted.wrapping_add(self.difference(decoder)?);
        if self.bits == 32 {
            return Ok(integer);
        }
        let range = 1 << self.bits;
        Ok(match integer {
            below if below < 0 => below.wrapping_add(range),
            above if above >= range => above - range,
            _ => integer,
        })
    }

    fn difference(&mut self, decoder: &mut Decoder) -> Result<i32> {
        let size = self.size;
        if size == 0 {
            return Ok(i32::from(decoder.bit(&mut self.smallest)));
        }
        if size == 32 {
            return Ok(i32::MIN);
        }
        let mut difference = decoder.symbol(&mut self.differences[size as usize - 1])? as i32;
        if size > MODELLED_BITS {
            let plain = size - MODELLED_BITS;
            difference = difference << plain | decoder.bits(plain) as i32;
        }
        // The lower half encodes negative differences.
        Ok(if difference >= 1 << (size - 1) {
            difference.wrapping_add(1)
        } else {
            difference.wrapping_sub(((1_u32 << size) - 1) as i32)
        })
    }
}

/// Running median of the last five differences.
#[derive(Clone, Copy, Default)]
pub(super) struct Median {
    sorted: [i32; 5],
    /// Whether the next difference replaces the smallest or the largest.
    drops_smallest: bool,
}

impl Median {
    pub fn get(&self) -> i32 {
        self.sorted[2]
    }

    pub fn add(&mut self, value: i32) {
        let sorted = &mut self.sorted;
        let is_below = value < sorted[2];
        let is_above = value > sorted[2];
        if self.drops_smallest {
            let place = sorted[1..].partition_point(|&other| other < value);
            sorted.copy_within(1..=place, 0);
            sorted[place] = value;
            self.drops_smallest = is_above;
        } else {
            let place = sorted[..4].partition_point(|&other| other <= value);
            sorted.copy_within(place..4, place + 1);
            sorted[place] = value;
            self.drops_smallest = !is_below;
        }
    }
}
