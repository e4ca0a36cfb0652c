//! Samples of a surface with weights that fall with the frequency of their normals.
//!
//! Most points of a room lie on a floor or a wall, which does not constrain the motion along it. A point is
//! drawn with a weight of `f^-0.75`, f the number of points whose normals fall into the same bin.

use nalgebra::Vector3;

use crate::consensus::counter_rng::random_words;
use crate::error::Result;
use crate::memory;

const POWER: f64 = 0.75;
/// Bins along an edge of each face of the cube of directions.
const EDGE: usize = 4;

/// Indices of up to `most` points in the order drawn, without those that have no normal (a zero vector).
///
/// Weighted sampling without replacement (Efraimidis and Spirakis 2006): the smallest `-ln(random) / weight`
/// first.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub(super) fn draw(normals: &[Vector3<f32>], oriented: bool, most: usize) -> Result<Vec<u32>> {
    let bins = memory::collect(normals.iter().map(|normal| bin(normal, oriented)))?;
    let mut counts = [0_u32; 6 * EDGE * EDGE];
    bins.iter().flatten().for_each(|&bin| counts[bin] += 1);
    let per_weight = counts.map(|count| f64::from(count).powf(POWER));
    let key = |index: usize, bin: usize| -uniform(index).ln() * per_weight[bin];
    let keyed = bins.iter().enumerate().filter_map(|(i, bin)| bin.map(|bin| (key(i, bin), i as u32)));
    let mut keyed = memory::collect(keyed)?;
    let by_key = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if most < keyed.len() {
        keyed.select_nth_unstable_by(most, by_key);
        keyed.truncate(most);
    }
    keyed.sort_unstable_by(by_key);
    memory::collect(keyed.iter().map(|&(_, index)| index))
}

/// Pseudo-random number in the open interval from 0 to 1.
fn uniform(index: usize) -> f64 {
    ((random_words(0, index as u64)[0] >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
}

fn bin(normal: &Vector3<f32>, oriented: bool) -> Option<usize> {
    let axis = normal.iamax();
    let length = normal[axis];
    if length == 0.0 {
        return None;
    }
    let side = usize::from(oriented && length < 0.0);
    let part = |k: usize| ((normal[(axis + k) % 3] / length + 1.0) * (EDGE as f32 / 2.0)) as usize;
    let [row, column] = [1, 2].map(|k| part(k).min(EDGE - 1));
    Some(((axis * 2 + side) * EDGE + row) * EDGE + column)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1,000 normals point up, 100 sideways.
    fn floor_and_post() -> Vec<Vector3<f32>> {
        (0..1100).map(|i| if i % 11 == 0 { Vector3::x() } else { Vector3::z() }).collect()
    }

    #[test]
    fn rare_normals_are_drawn_more_often() -> Result<()> {
        let normals = floor_and_post();
        let drawn = draw(&normals, true, 200)?;
        let rare = drawn.iter().filter(|&&i| normals[i as usize] == Vector3::x()).count();
        // 1000^.25 : 100^.25 is 16 : 9; unweighted sampling gives 10 : 1.
        assert!((55..=90).contains(&rare), "{rare}");
        assert_eq!(drawn, draw(&normals, true, usize::MAX)?[..200]);
        Ok(())
    }

    #[test]
    fn each_point_is_drawn_once_and_none_without_a_normal() -> Result<()> {
        let mut normals = floor_and_post();
        normals[5] = Vector3::zeros();
        let mut drawn = draw(&normals, true, usize::MAX)?;
        drawn.sort_unstable();
        let expected: Vec<u32> = (0..1100).filter(|&i| i != 5).collect();
        assert_eq!(drawn, expected);
        Ok(())
    }

    #[test]
    fn signs_matter_only_where_they_are_known() {
        for (oriented, same) in [(true, false), (false, true)] {
            let n = Vector3::new(0.3, -0.2, 0.9);
            assert_eq!(bin(&n, oriented) == bin(&-n, oriented), same);
        }
    }
}
