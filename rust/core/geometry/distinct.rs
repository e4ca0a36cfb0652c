//! Points that coincide, found by a table of their bits.

use crate::error::Result;
use crate::memory;

/// Points of which a part shows whether any coincide.
const MANY: usize = 50_000;
/// Odd factor of the hash (2^64 over the golden ratio), and the shift that mixes high bits into low ones.
const FACTOR: u64 = 0x9E37_79B9_7F4A_7C15;
const SHIFT: u32 = 32;

/// The distinct points of a cloud.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Distinct {
    /// First row of each distinct point, ascending.
    pub first: Vec<u32>,
    /// Distinct point of each row.
    pub places: Vec<u32>,
}

/// Returns the distinct points of finite rows; `None` if no two coincide. -0 is 0.
///
/// Of many rows some 25,000 to 50,000, chosen by coordinates, show whether any coincide: a few repetitions may be missed. Cost O(N).
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn find_distinct<T: Copy + Into<f64>>(rows: &[[T; 3]]) -> Result<Option<Distinct>> {
    let bits = |row: usize| rows[row].map(|value| (value.into() + 0.0).to_bits());
    if rows.len() > MANY {
        let part_of = (rows.len() / MANY).next_power_of_two() as u64 - 1;
        let part = memory::collect((0..rows.len()).filter(|&row| hash(bits(row)) & part_of == 0))?;
        if group(part.len(), |row| bits(part[row]))?.first.len() == part.len() {
            return Ok(None);
        }
    }
    let found = group(rows.len(), bits)?;
    Ok((found.first.len() < rows.len()).then_some(found))
}

fn group(count: usize, bits: impl Fn(usize) -> [u64; 3]) -> Result<Distinct> {
    let (mut first, mut places) = (memory::with_capacity(count)?, memory::with_capacity(count)?);
    let slots = (2 * count + 2).next_power_of_two();
    let mut table = memory::filled(0_u32, slots)?; // one more than a place; 0 is free
    for row in 0..count {
        let own = bits(row);
        let mut slot = (hash(own) >> (u64::BITS - slots.ilog2())) as usize;
        while table[slot] > 0 && bits(first[table[slot] as usize - 1] as usize) != own {
            slot = (slot + 1) % slots;
        }
        if table[slot] == 0 {
            first.push(row as u32);
            table[slot] = first.len() as u32;
        }
        places.push(table[slot] - 1);
    }
    Ok(Distinct { first, places })
}

fn hash(bits: [u64; 3]) -> u64 {
    let mix = |key: u64| {
        let key = key.wrapping_mul(FACTOR);
        key ^ (key >> SHIFT)
    };
    mix(bits.into_iter().fold(0, |key: u64, bits| mix(key.wrapping_add(bits))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coincident_points_have_one_place() -> Result<()> {
        let rows = [[1.0, 0.0, 2.0], [1.0, 0.0, 3.0], [1.0, -0.0, 2.0], [0.0; 3], [1.0, 0.0, 3.0]];
        let expected = Distinct { first: vec![0, 1, 3], places: vec![0, 1, 0, 2, 1] };
        assert_eq!(find_distinct(&rows)?.as_ref(), Some(&expected));
        let single = rows.map(|row| row.map(|value: f64| value as f32));
        assert_eq!(find_distinct(&single)?, Some(expected));
        assert_eq!(find_distinct(&rows[..2])?, None);
        assert_eq!(find_distinct::<f64>(&[])?, None);
        Ok(())
    }

    #[test]
    fn a_part_of_many_shows_whether_points_repeat() -> Result<()> {
        let raster = |i: u32| [f64::from(i % 500), f64::from(i / 500), 0.5];
        let mut rows: Vec<[f64; 3]> = (0..250_000).map(raster).collect();
        assert_eq!(find_distinct(&rows)?, None);
        rows.extend((0..1000).map(raster));
        let found = find_distinct(&rows)?;
        assert_eq!(found.map(|found| (found.first.len(), found.places[250_999])), Some((250_000, 999)));
        Ok(())
    }
}
