//! Arithmetic decoding with adaptive models (A. Said, *Introduction to Arithmetic Coding*, HPL-2004-76), as
//! `LASzip` uses it.
//!
//! No sequence of bytes makes it fail: beyond the end it reads zeros and remembers that, and a symbol is
//! always one of its model's.

use crate::error::Result;
use crate::memory;

/// Interval length below which another byte is read.
const SHORTEST: u32 = 1 << 24;
/// Bits of a symbol's share in a model.
const SHARE_BITS: u32 = 15;
/// Total count of a model's symbols at which all counts are halved.
const MOST_COUNTED: u32 = 1 << SHARE_BITS;
/// Bits of a share in a model of bits.
const BIT_SHARE_BITS: u32 = 13;
const MOST_BITS_COUNTED: u32 = 1 << BIT_SHARE_BITS;
/// Most bits read at a time.
const MOST_PLAIN_BITS: u32 = 19;

/// Decodes symbols from bytes.
pub(super) struct Decoder<'a> {
    bytes: std::slice::Iter<'a, u8>,
    /// Position in the interval, below `length`.
    value: u32,
    length: u32,
    is_cut_off: bool,
}

impl<'a> Decoder<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { bytes: bytes.iter(), value: 0, length: u32::MAX, is_cut_off: false };
        for _ in 0..4 {
            decoder.value = decoder.value << 8 | decoder.next_byte();
        }
        decoder.value = decoder.value.min(decoder.length - 1);
        decoder
    }

    /// Whether more bytes were read than available.
    pub fn is_cut_off(&self) -> bool {
        self.is_cut_off
    }

    #[inline]
    fn next_byte(&mut self) -> u32 {
        self.bytes.next().map_or_else(
            || {
                self.is_cut_off = true;
                0
            },
            |&byte| u32::from(byte),
        )
    }

    /// Narrows the interval to a part.
    #[inline]
    fn narrow(&mut self, start: u32, length: u32) {
        self.value -= start;
        self.length = length;
        while self.length < SHORTEST {
            self.value = self.value << 8 | self.next_byte();
            self.length <<= 8;
        }
    }

    /// Decodes the next symbol of a model.
    #[inline]
    pub fn symbol(&mut self, model: &mut Model) -> Result<usize> {
        let counts = match &mut model.counts {
            Some(counts) => counts,
            empty @ None => empty.insert(Box::new(Counts::new(model.symbols)?)),
        };
        let unit = self.length >> SHARE_BITS;
        let symbol = counts.find(self.value / unit);
        let start = unit * u32::from(counts.starts[symbol]);
        let end = counts.starts.get(symbol + 1).map_or(self.length, |&next| unit * u32::from(next));
        self.narrow(start, end - start);
        counts.add(symbol);
        Ok(symbol)
    }

    /// Decodes the next bit of a model.
    #[inline]
    pub fn bit(&mut self, model: &mut BitModel) -> bool {
        let zeros = model.share * (self.length >> BIT_SHARE_BITS);
        let bit = self.value >= zeros;
        if bit {
            self.narrow(zeros, self.length - zeros);
        } else {
            self.narrow(0, zeros);
        }
        model.add(bit);
        bit
    }

    /// Decodes up to 32 bits without a model; damaged bytes can yield a slightly greater number.
    pub fn bits(&mut self, count: u32) -> u32 {
        if count > MOST_PLAIN_BITS {
            let low = self.bits(16);
            return self.bits(count - 16) << 16 | low;
        }
        let unit = self.length >> count;
        let bits = self.value / unit;
        self.narrow(bits * unit, unit);
        bits
    }
}

/// Counts of each symbol so far. Most models of a chunk are never used, so memory is allocated at their first
/// use.
#[derive(Default)]
pub(super) struct Model {
    symbols: u16,
    counts: Option<Box<Counts>>,
}

impl Model {
    pub fn new(symbols: u16) -> Self {
        Self { symbols, counts: None }
    }

    /// One model for each of `N` contexts.
    pub fn several<const N: usize>(symbols: u16) -> [Self; N] {
        std::array::from_fn(|_| Self::new(symbols))
    }
}

struct Counts {
    /// Count of each symbol.
    times: Vec<u16>,
    /// Start of each symbol's part, in shares of the interval.
    starts: Vec<u16>,
    total: u32,
    /// Symbols between two updates of the shares, and symbols left until the next.
    period: u32,
    left: u32,
}

impl Counts {
    fn new(symbols: u16) -> Result<Self> {
        let len = usize::from(symbols);
        let (times, starts) = (memory::filled(1, len)?, memory::filled(0, len)?);
        let mut new = Self { times, starts, total: 0, period: u32::from(symbols), left: 0 };
        new.update();
        new.period = (u32::from(symbols) + 6) >> 1;
        new.left = new.period;
        Ok(new)
    }

    /// The symbol whose part contains a share.
    #[inline]
    fn find(&self, share: u32) -> usize {
        self.starts.partition_point(|&start| u32::from(start) <= share).saturating_sub(1)
    }

    #[inline]
    fn add(&mut self, symbol: usize) {
        self.times[symbol] += 1;
        self.left -= 1;
        if self.left == 0 {
            self.update();
        }
    }

    #[cold]
    fn update(&mut self) {
        self.total += self.period;
        if self.total > MOST_COUNTED {
            self.total = 0;
            for count in &mut self.times {
                *count = count.div_ceil(2);
                self.total += u32::from(*count);
            }
        }
        let scale = (1 << 31) / self.total;
        let mut sum = 0;
        for (start, count) in self.starts.iter_mut().zip(&self.times) {
            *start = ((scale * sum) >> (31 - SHARE_BITS)) as u16;
            sum += u32::from(*count);
        }
        self.period = ((5 * self.period) >> 2).min((self.times.len() as u32 + 6) << 3);
        self.left = self.period;
    }
}

/// Number of zero bits so far.
pub(super) struct BitModel {
    zeros: u32,
    total: u32,
    share: u32,
    period: u32,
    left: u32,
}

impl Default for BitModel {
    fn default() -> Self {
        Self { zeros: 1, total: 2, share: 1 << (BIT_SHARE_BITS - 1), period: 4, left: 4 }
    }
}

impl BitModel {
    fn add(&mut self, bit: bool) {
        self.zeros += u32::from(!bit);
        self.left -= 1;
        if self.left > 0 {
            return;
        }
        self.total += self.period;
        if self.total > MOST_BITS_COUNTED {
            self.total = self.total.div_ceil(2);
            self.zeros = self.zeros.div_ceil(2);
            self.total += u32::from(self.zeros == self.total);
        }
        self.share = ((1 << 31) / self.total * self.zeros) >> (31 - BIT_SHARE_BITS);
        self.period = ((5 * self.period) >> 2).min(64);
        self.left = self.period;
    }
}
