//! E57 (ASTM E2807): checksums of pages, and the points of a scan.
//!
//! A file consists of pages of 1024 bytes, of which the last four are the CRC-32C of the others. The points of
//! a scan are a section of packets without these checksums. A packet begins with its kind, a byte of flags, and
//! its length minus 1 in two bytes. A data packet has next the number of its streams, the length of each, and
//! their bytes; each field of the points is the concatenation of one stream of all packets. Other packets, of
//! the index and ignored ones, are skipped. A stream of integers has as many bits for each as its limits need,
//! from the lowest bit of the first byte on.

pub mod writer;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;

/// Bytes of a page, and of these before its checksum.
const PAGE: usize = 1024;
const USED: usize = 1020;

const DATA_PACKET: u8 = 1;

/// Bytes of a packet before the lengths of its streams.
const HEAD: usize = 6;

/// Pages or numbers between two checks for an interruption.
const CHECK_EVERY: usize = 1 << 12;

/// CRC-32C of each byte, followed by as many zeros as the table's number.
static TABLES: [[u32; 256]; 8] = tables();

/// A field of points, and how its numbers are encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Its name, for errors.
    pub name: String,
    /// What its stream consists of.
    pub encoding: Encoding,
    /// The numbers that become the bytes 0 and 255; `None` if they remain numbers.
    pub limits: Option<(f64, f64)>,
}

/// Encoding of a field's numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Encoding {
    /// float32
    Single,
    /// float64
    Double,
    /// Integers between limits, which are multiplied by a scale and added to an offset.
    Integer {
        /// The least one, whose bits are zeros.
        least: i64,
        /// The greatest one, which determines the number of bits.
        most: i64,
        /// The factor.
        scale: f64,
        /// What is added to the product.
        offset: f64,
    },
}

impl Encoding {
    /// Bits of a number.
    pub fn bits(self) -> u32 {
        match self {
            Self::Single => u32::BITS,
            Self::Double => u64::BITS,
            Self::Integer { least, most, .. } => u64::BITS - most.wrapping_sub(least).leading_zeros(),
        }
    }
}

/// The numbers of a field.
#[derive(Debug, Clone, PartialEq)]
pub enum Column {
    /// As they are.
    Numbers(Vec<f64>),
    /// Between limits.
    Bytes(Vec<u8>),
}

/// The first page with a wrong checksum.
#[must_use]
pub fn wrong_page(pages: &[u8]) -> Option<usize> {
    let is_right = |page: &[u8]| {
        page.split_at_checked(USED).is_some_and(|(content, sum)| checksum(content).to_be_bytes() == *sum)
    };
    pages.chunks(PAGE).position(|page| !is_right(page))
}

/// Content as pages with their checksums, the last padded with zeros.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn seal_pages(content: &[u8]) -> Result<Vec<u8>> {
    let mut sealed = memory::with_capacity(content.len().div_ceil(USED) * PAGE)?;
    let (whole, rest) = content.as_chunks::<USED>();
    for page in whole {
        seal(page, &mut sealed);
    }
    if !rest.is_empty() {
        let mut page = [0; USED];
        page[..rest.len()].copy_from_slice(rest);
        seal(&page, &mut sealed);
    }
    Ok(sealed)
}

/// Appends a page and its checksum, which is returned.
fn seal(page: &[u8; USED], sealed: &mut Vec<u8>) -> u32 {
    let sum = checksum(page);
    sealed.extend(page);
    sealed.extend(sum.to_be_bytes());
    sum
}

/// Unpacks `count` points from the packets of a section: a column of each field that is not `None`.
///
/// No memory is reserved for the points before all streams are known to be long enough. Fields without bits
/// have no stream, so the caller has to bound `count` for them.
///
/// # Errors
/// [`Error::InvalidInput`] for packets that do not fit the section or the fields, and for streams that are too
/// short; [`Error::OutOfMemory`], [`Error::Interrupted`].
pub fn unpack(
    section: &[u8],
    fields: &[Option<Field>],
    count: usize,
    execution: &Execution,
) -> Result<Vec<Column>> {
    let streams = collect_streams(section, fields, execution)?;
    let found = fields.iter().zip(streams).filter_map(|(field, stream)| Some((field.as_ref()?, stream)));
    let found = memory::collect(found)?;
    for (field, stream) in &found {
        let bits = field.encoding.bits();
        if count.checked_mul(bits as usize).is_none_or(|needed| needed.div_ceil(8) > stream.len()) {
            let got = format!("{} bytes for {count} points of {bits} bits", stream.len());
            return Err(Error::invalid(&field.name, got, "the file is damaged"));
        }
    }
    memory::try_collect(found.into_iter().map(|(field, stream)| read_column(field, stream, count, execution)))
}

/// The stream of each field, empty for those that are `None`.
fn collect_streams(section: &[u8], fields: &[Option<Field>], execution: &Execution) -> Result<Vec<Vec<u8>>> {
    let mut streams = memory::filled(Vec::new(), fields.len())?;
    let mut rest = section;
    while !rest.is_empty() {
        execution.check()?;
        let (packet, after) = split_packet(rest)?;
        rest = after;
        if packet[0] == DATA_PACKET {
            add_packet(&mut streams, packet, fields)?;
        }
    }
    Ok(streams)
}

/// The first packet, of at least four bytes, and the bytes after it.
fn split_packet(bytes: &[u8]) -> Result<(&[u8], &[u8])> {
    let length = number_at(bytes, 2).unwrap_or(0) + 1;
    let split = if length.is_multiple_of(4) { bytes.split_at_checked(length) } else { None };
    split
        .ok_or_else(|| Error::invalid("points", format!("a packet of {length} bytes"), "the file is damaged"))
}

/// Appends the bytes of a data packet to the streams.
fn add_packet(streams: &mut [Vec<u8>], packet: &[u8], fields: &[Option<Field>]) -> Result<()> {
    let count = number_at(packet, 4).unwrap_or(0);
    let wrong = || {
        let got =
            format!("a packet of {} bytes with {count} streams for {} fields", packet.len(), fields.len());
        Error::invalid("points", got, "the file is damaged")
    };
    let parts = packet.get(HEAD..).and_then(|body| body.split_at_checked(2 * count));
    let (lengths, mut rest) = parts.filter(|_| count == fields.len()).ok_or_else(wrong)?;
    for ((length, stream), field) in lengths.as_chunks().0.iter().zip(streams).zip(fields) {
        let length = usize::from(u16::from_le_bytes(*length));
        let (piece, after) = rest.split_at_checked(length).ok_or_else(wrong)?;
        rest = after;
        if field.is_some() {
            memory::extend(stream, piece)?;
        }
    }
    Ok(())
}

/// The number of two bytes at a place.
fn number_at(bytes: &[u8], place: usize) -> Option<usize> {
    Some(usize::from(u16::from_le_bytes(*bytes.get(place..)?.first_chunk()?)))
}

/// The numbers of a stream that is long enough.
fn read_column(field: &Field, mut stream: Vec<u8>, count: usize, execution: &Execution) -> Result<Column> {
    match field.encoding {
        Encoding::Single => {
            let singles = stream.as_chunks().0;
            fill(field, count, execution, |i| f64::from(f32::from_le_bytes(singles[i])))
        }
        Encoding::Double => {
            let doubles = stream.as_chunks().0;
            fill(field, count, execution, |i| f64::from_le_bytes(doubles[i]))
        }
        Encoding::Integer { least, scale, offset, .. } => {
            memory::extend(&mut stream, &[0; size_of::<u128>()])?;
            let bits = field.encoding.bits();
            let mask = u64::MAX.checked_shr(u64::BITS - bits).unwrap_or(0);
            fill(field, count, execution, |i| {
                let stored = bits_at(&stream, i * bits as usize) & mask;
                stored.wrapping_add(least.cast_unsigned()).cast_signed() as f64 * scale + offset
            })
        }
    }
}

/// The 64 bits from a place on, of a stream that has 16 bytes from there on.
#[inline]
fn bits_at(stream: &[u8], place: usize) -> u64 {
    let word = stream[place / 8..].first_chunk().map_or(0, |bytes| u128::from_le_bytes(*bytes));
    (word >> (place % 8)) as u64
}

/// A column of the numbers that `number` returns for each row.
fn fill(field: &Field, count: usize, execution: &Execution, number: impl Fn(usize) -> f64) -> Result<Column> {
    let Some((low, high)) = field.limits else {
        return Ok(Column::Numbers(fill_with(count, execution, number)?));
    };
    let range = if high > low { high - low } else { 1.0 };
    // NaN becomes 0.
    let byte = |i| (255.0 * ((number(i) - low) / range).clamp(0.0, 1.0)).round_ties_even() as u8;
    Ok(Column::Bytes(fill_with(count, execution, byte)?))
}

/// The items that `item` returns for each row.
pub(super) fn fill_with<T>(count: usize, execution: &Execution, item: impl Fn(usize) -> T) -> Result<Vec<T>> {
    let mut items = memory::with_capacity(count)?;
    for first in (0..count).step_by(CHECK_EVERY) {
        execution.check()?;
        items.extend((first..count.min(first + CHECK_EVERY)).map(&item));
    }
    Ok(items)
}

/// CRC-32C of a page, eight bytes at a time.
fn checksum(page: &[u8]) -> u32 {
    let (words, rest) = page.as_chunks();
    let mut sum = u32::MAX;
    for word in words {
        let [a, b, c, d, e, f, g, h] = (u64::from_le_bytes(*word) ^ u64::from(sum)).to_le_bytes();
        let tables = TABLES.iter().rev();
        sum =
            tables.zip([a, b, c, d, e, f, g, h]).fold(0, |sum, (table, byte)| sum ^ table[usize::from(byte)]);
    }
    !rest.iter().fold(sum, |sum, byte| TABLES[0][usize::from(sum as u8 ^ byte)] ^ sum >> 8)
}

const fn tables() -> [[u32; 256]; 8] {
    let mut tables = [[0; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        let mut sum = byte as u32;
        let mut table = 0;
        while table < 8 {
            let mut bit = 0;
            while bit < 8 {
                sum = sum >> 1 ^ if sum & 1 == 1 { 0x82f6_3b78 } else { 0 };
                bit += 1;
            }
            tables[table][byte] = sum;
            table += 1;
        }
        byte += 1;
    }
    tables
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    use super::*;

    fn config() -> ProptestConfig {
        let given = ProptestConfig::default();
        let rng_seed = if given.rng_seed == RngSeed::Random { RngSeed::Fixed(0) } else { given.rng_seed };
        ProptestConfig { rng_seed, failure_persistence: None, ..given }
    }

    fn field(encoding: Encoding) -> Field {
        Field { name: "a".to_owned(), encoding, limits: None }
    }

    fn integer(least: i64, most: i64) -> Encoding {
        Encoding::Integer { least, most, scale: 1.0, offset: 0.0 }
    }

    /// A data packet of streams, with `more` bytes after them.
    fn packet(streams: &[&[u8]], more: usize) -> Vec<u8> {
        let mut packet = vec![DATA_PACKET, 0, 0, 0];
        packet.extend((streams.len() as u16).to_le_bytes());
        streams.iter().for_each(|stream| packet.extend((stream.len() as u16).to_le_bytes()));
        streams.iter().for_each(|stream| packet.extend(*stream));
        packet.resize((packet.len() + more).next_multiple_of(4), 0xff);
        let last = (packet.len() - 1) as u16;
        packet[2..4].copy_from_slice(&last.to_le_bytes());
        packet
    }

    /// A packet of another kind, of `4 * words` bytes.
    fn other(kind: u8, words: usize) -> Vec<u8> {
        let mut packet = vec![kind; 4 * words];
        let last = (packet.len() - 1) as u16;
        packet[2..4].copy_from_slice(&last.to_le_bytes());
        packet
    }

    fn numbers(section: &[u8], fields: &[Option<Field>], count: usize) -> Result<Vec<Vec<f64>>> {
        let columns = unpack(section, fields, count, &Execution::default())?;
        Ok(columns
            .into_iter()
            .map(|column| match column {
                Column::Numbers(numbers) => numbers,
                Column::Bytes(bytes) => bytes.into_iter().map(f64::from).collect(),
            })
            .collect())
    }

    /// Bit by bit.
    fn plain_checksum(page: &[u8]) -> u32 {
        !page.iter().fold(u32::MAX, |sum, byte| {
            (0..8)
                .fold(sum ^ u32::from(*byte), |sum, _| sum >> 1 ^ if sum & 1 == 1 { 0x82f6_3b78 } else { 0 })
        })
    }

    #[test]
    fn checksums_are_those_of_the_standard() -> Result<()> {
        assert_eq!(checksum(b"123456789"), 0xe306_9283);
        assert_eq!(checksum(&[0; 32]), 0x8a91_36aa);
        let contents: Vec<u8> = (0..USED + 9).map(|i| (i * i) as u8).collect();
        let mut sealed = seal_pages(&contents)?;
        assert_eq!(sealed.len(), 2 * PAGE);
        for (page, content) in sealed.chunks(PAGE).zip(contents.chunks(USED)) {
            assert_eq!(page[..content.len()], *content);
            assert!(page[content.len()..USED].iter().all(|byte| *byte == 0));
            assert_eq!(page[USED..], plain_checksum(&page[..USED]).to_be_bytes());
        }
        assert_eq!(wrong_page(&sealed), None);
        sealed[PAGE + 3] ^= 1;
        assert_eq!(wrong_page(&sealed), Some(1));
        assert_eq!((seal_pages(&[])?, wrong_page(&[])), (Vec::new(), None));
        Ok(())
    }

    #[test]
    fn streams_are_joined_and_other_packets_skipped() {
        let doubles = [1.5_f64, -2.0, 1e300].map(f64::to_le_bytes).concat();
        let singles = [0.5_f32, f32::INFINITY, -0.25].map(f32::to_le_bytes).concat();
        let fields =
            [Encoding::Double, Encoding::Double, Encoding::Single].map(|encoding| Some(field(encoding)));
        let fields = [fields[0].clone(), None, fields[2].clone()];
        let section = [
            other(0, 4),
            packet(&[&doubles[..5], b"skipped", &singles], 0),
            other(2, 1),
            packet(&[&[], &[], &[]], 8),
            packet(&[&doubles[5..], &[], &[]], 0),
            other(2, 16384),
        ];
        let expected = vec![vec![1.5, -2.0, 1e300], vec![0.5, f64::INFINITY, -0.25]];
        assert_eq!(numbers(&section.concat(), &fields, 3), Ok(expected));
        assert_eq!(numbers(&[], &fields, 0), Ok(vec![vec![], vec![]]));
    }

    #[test]
    fn fields_without_bits_are_constant() {
        let encoding = Encoding::Integer { least: -7, most: -7, scale: 0.5, offset: 1.0 };
        assert_eq!(numbers(&[], &[Some(field(encoding))], 3), Ok(vec![vec![-2.5; 3]]));
        let refused = numbers(&[], &[Some(field(encoding))], usize::MAX);
        assert_eq!(refused, Err(Error::OutOfMemory { bytes: usize::MAX }));
    }

    #[test]
    fn numbers_between_limits_become_bytes() {
        let stored = [f64::NAN, f64::NEG_INFINITY, -3.0, 10.0, 12.0, 20.0, f64::INFINITY];
        let section = packet(&[&stored.map(f64::to_le_bytes).concat()], 0);
        let between = |limits| [Some(Field { limits: Some(limits), ..field(Encoding::Double) })];
        let bytes = |limits| unpack(&section, &between(limits), 7, &Execution::default());
        assert_eq!(bytes((10.0, 20.0)), Ok(vec![Column::Bytes(vec![0, 0, 0, 0, 51, 255, 255])]));
        assert_eq!(bytes((12.0, 12.0)), Ok(vec![Column::Bytes(vec![0, 0, 0, 0, 0, 255, 255])]));
        assert_eq!(bytes((f64::NAN, 1.0)), Ok(vec![Column::Bytes(vec![0; 7])]));
    }

    #[test]
    fn wrong_packets_are_refused() {
        let fields = [Some(field(Encoding::Double)), None];
        let good = packet(&[&[0; 8], &[0; 8]], 0);
        let changed = |place: usize, byte: u8| {
            let mut packet = good.clone();
            packet[place] = byte;
            packet
        };
        let cases = [
            (good[..good.len() - 1].to_vec(), "a packet of 28 bytes"),
            (vec![1, 0, 3], "a packet of 1 bytes"),
            (changed(2, 26), "a packet of 27 bytes"),
            (other(1, 1), "a packet of 4 bytes with 0 streams"),
            (changed(4, 1), "with 1 streams for 2 fields"),
            (changed(4, 200), "with 200 streams for 2 fields"),
            (changed(9, 1), "a packet of 28 bytes with 2 streams"),
            (packet(&[&[0; 7], &[]], 0), "7 bytes for 1 points of 64 bits"),
        ];
        for (section, reason) in cases {
            let error = numbers(&section, &fields, 1).err().map(|error| error.to_string());
            assert!(error.as_ref().is_some_and(|error| error.contains(reason)), "{reason}: {error:?}");
        }
        assert_eq!(numbers(&good, &fields, 1), Ok(vec![vec![0.0]]));
    }

    #[test]
    fn huge_numbers_of_points_are_refused_before_memory_is_reserved() {
        for encoding in [Encoding::Single, Encoding::Double, integer(0, 1), integer(i64::MIN, i64::MAX)] {
            for count in [1, 1 << 40, usize::MAX / 64 + 1, usize::MAX] {
                let fields = [Some(field(integer(3, 3))), Some(field(encoding))];
                let error = numbers(&[], &fields, count).err();
                assert!(matches!(error, Some(Error::InvalidInput { .. })), "{count}: {error:?}");
            }
        }
    }

    #[test]
    fn an_interruption_ends_the_work() {
        let execution = Execution::default();
        execution.interrupt();
        assert_eq!(unpack(&[], &[Some(field(integer(7, 7)))], 1, &execution), Err(Error::Interrupted));
        assert_eq!(unpack(&other(2, 1), &[None], 1, &execution), Err(Error::Interrupted));
    }

    proptest! {
        #![proptest_config(config())]

        #[test]
        fn integers_are_those_of_a_plain_reader_of_bits(
            bits in 0_u32..=64,
            least in any::<i64>(),
            stream in prop::collection::vec(any::<u8>(), 0..400),
            piece in 1_usize..90,
        ) {
            let range = u64::MAX.checked_shr(64 - bits).unwrap_or(0);
            let least = least.min(i64::MAX.wrapping_sub_unsigned(range));
            let field = field(integer(least, least.wrapping_add_unsigned(range)));
            prop_assert_eq!(field.encoding.bits(), bits);
            let section: Vec<u8> = stream.chunks(piece).flat_map(|piece| packet(&[piece], 0)).collect();
            let count = (8 * stream.len()).checked_div(bits as usize).unwrap_or(9);
            let bit = |place: usize| i128::from(stream[place / 8] >> (place % 8) & 1);
            let expected = (0..count).map(|i| {
                let stored: i128 = (0..bits as usize).map(|j| bit(i * bits as usize + j) << j).sum();
                (i128::from(least) + stored) as f64
            });
            let fields = [Some(field)];
            prop_assert_eq!(numbers(&section, &fields, count), Ok(vec![expected.collect()]));
            prop_assert_eq!(numbers(&section, &fields, count + 1).is_ok(), bits == 0);
        }

        #[test]
        fn any_bytes_are_read_or_refused(
            section in prop::collection::vec(prop_oneof![Just(0_u8), Just(1), Just(3), Just(11), any::<u8>()], 0..64),
            count in 0_usize..9,
            bits in 1_u32..=64,
        ) {
            let most = (u64::MAX >> (64 - bits)).wrapping_add_signed(i64::MIN).cast_signed();
            let fields = [Some(field(integer(i64::MIN, most))), None];
            if let Ok(columns) = numbers(&section, &fields, count) {
                prop_assert_eq!(columns[0].len(), count);
            }
        }

        #[test]
        fn checksums_are_those_of_a_plain_one(page in prop::collection::vec(any::<u8>(), 0..100)) {
            prop_assert_eq!(checksum(&page), plain_checksum(&page));
        }
    }
}
