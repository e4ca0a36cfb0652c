//! Number of correspondences that a rigid transform maps to within a tolerance of their targets.
//!
//! Correspondences are sorted into leaves of neighbours, near each other in both shapes. A leaf whose centre
//! has too large a residual holds no inlier, so most leaves are never opened. A transform is abandoned once
//! the remaining leaves cannot make it win. Residuals are decided in f32 if rounding cannot change the
//! result, else in f64: the count is exact.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use std::ops::Range;

use crate::error::Result;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::points::{Points, unit_scale};
use crate::simd::{self, Kernel, Lanes, SINGLES};

/// Bound of the error of a residual in f32. Both sides are scaled to diagonals below sqrt(2), so no point is
/// farther than that from its centre, and no translation of a fit is longer than twice that. With u = 2^-24,
/// a coordinate of `t - p'` has an error of u (2.83 + 1.41 + 4.24); the three products and sums of at most
/// 5.66 add at most 3 (5.66 + 1.41) u; the rounded rotation and p add 1.41 u each: 33 u in all, or 57 u in
/// space. The rounding of the square adds less than 2 u of 5.66. The total is 69 u = 4.1e-6, of which this is
/// twice as much.
const ROUNDING: f64 = 1e-5;

/// No scaled residual reaches this: p and p' are within 1.42 of the centres, the translation is 2.83 at most.
const BEYOND_ALL: f64 = 8.0;

/// Source x, y, z, then target x, y, z.
type Axes<T> = [T; 6];

/// Correspondences sorted for counting inliers.
#[derive(Debug)]
pub struct InlierCounter<'a> {
    source: &'a Points,
    target: &'a Points,
    tolerance: f64,
    /// Factor from the data's unit to that of the f32 coordinates.
    scale: f64,
    /// Index of each member.
    order: Vec<usize>,
    /// Members by leaf, [`SINGLES`] each; padded with NaN, which is never an inlier.
    members: Axes<Vec<f32>>,
    centers: Axes<Vec<f32>>,
    /// Squared residual of each leaf's centre beyond which the leaf holds no inlier.
    squared_reach: Vec<f32>,
    /// Squared residuals up to this are certainly inliers.
    squared_sure: f32,
    /// Squared residuals beyond this are certainly outliers.
    squared_possible: f32,
}

impl<'a> InlierCounter<'a> {
    /// Sorts the correspondences; an inlier has a residual below the tolerance, a length in the data's unit.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(source: &'a Points, target: &'a Points, tolerance: f64) -> Result<Self> {
        let scale = unit_scale(source.diagonal().max(target.diagonal()));
        let scaled_tolerance = (tolerance * scale).min(BEYOND_ALL);
        let mut order = memory::collect(0..source.len())?;
        let all = [&source.x, &source.y, &source.z, &target.x, &target.y, &target.z].map(Vec::as_slice);
        sort_into_leaves(&mut order, all);
        let sorted = |axis: &[f64]| filled_up(order.iter().map(|&i| (axis[i] * scale) as f32));
        let mut counter = Self {
            source,
            target,
            tolerance,
            scale,
            members: memory::try_map(all, sorted)?,
            centers: Axes::default(),
            squared_reach: Vec::new(),
            squared_sure: match scaled_tolerance - ROUNDING {
                sure if sure > 0.0 => square(sure) as f32 * (1.0 - f32::EPSILON),
                _ => -1.0, // no residual is
            },
            squared_possible: square(scaled_tolerance + ROUNDING) as f32 * (1.0 + f32::EPSILON),
            order,
        };
        counter.enclose_leaves(scaled_tolerance)?;
        Ok(counter)
    }

    /// Centre and reach of every leaf.
    fn enclose_leaves(&mut self, tolerance: f64) -> Result<()> {
        let leaves = self.order.len().div_ceil(SINGLES).next_multiple_of(SINGLES);
        self.squared_reach = memory::with_capacity(leaves)?;
        self.centers = memory::try_map([(); 6], |()| memory::with_capacity(leaves))?;
        for leaf in (0..self.order.len()).step_by(SINGLES) {
            let members = leaf..(leaf + SINGLES).min(self.order.len());
            let axes = self.members.each_ref().map(|axis| &axis[members.clone()]);
            let center = axes.map(|axis| {
                let (low, high) = extremes(axis);
                f32::midpoint(low, high)
            });
            let radius = |side: Range<usize>| {
                let offset = |k: usize, axis: usize| f64::from(axes[axis][k]) - f64::from(center[axis]);
                let distance =
                    |k: usize| side.clone().map(|axis| square(offset(k, axis))).sum::<f64>().sqrt();
                (0..members.len()).map(distance).fold(0.0, f64::max)
            };
            let reach = tolerance + radius(0..3) + radius(3..6) + 2.0 * ROUNDING;
            self.squared_reach.push(square(reach) as f32 * (1.0 + f32::EPSILON));
            self.centers.iter_mut().zip(center).for_each(|(axis, value)| axis.push(value));
        }
        self.centers.iter_mut().for_each(|axis| axis.resize(leaves, f32::NAN));
        self.squared_reach.resize(leaves, f32::NAN);
        Ok(())
    }

    /// Number of inliers of the transform between the centred points, if it is at least `least`; `near` is
    /// working space.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn count(&self, model: &Rigid, least: usize, near: &mut Vec<u16>) -> Result<Option<usize>> {
        near.clear();
        memory::reserve(near, self.squared_reach.len() / SINGLES)?;
        let (r, t) = (model.rotation.map(|entry| entry as f32), model.translation * self.scale);
        let rows = [0, 1, 2].map(|row| [r[(row, 0)], r[(row, 1)], r[(row, 2)], t[row] as f32]);
        Ok(simd::run(CountInliers { counter: self, model, rows, least, near }))
    }

    /// Selects the inliers among some members of a leaf, in f64.
    #[cold]
    fn settle(&self, model: &Rigid, leaf: usize, members: u16) -> u16 {
        let unsure = (0..SINGLES).filter(|member| members >> member & 1 == 1);
        let inliers = unsure.filter(|member| {
            is_inlier(model, self.source, self.target, self.order[leaf * SINGLES + member], self.tolerance)
        });
        inliers.fold(0, |bits, member| bits | 1 << member)
    }
}

/// `|R p + t - p'| < tolerance` for correspondence `i`, in f64.
#[inline]
pub fn is_inlier(model: &Rigid, source: &Points, target: &Points, i: usize, tolerance: f64) -> bool {
    (model.apply(&source.get(i)) - target.get(i)).norm_squared() < tolerance * tolerance
}

/// Sorts indices so that each run of [`SINGLES`] lies close together: splits in halves along the longest
/// axis.
fn sort_into_leaves(indices: &mut [usize], axes: Axes<&[f64]>) {
    let leaves = indices.len().div_ceil(SINGLES);
    if leaves < 2 {
        return;
    }
    let length = |axis: &[f64]| {
        let of = indices.iter().map(|&i| axis[i]);
        of.clone().fold(f64::NEG_INFINITY, f64::max) - of.fold(f64::INFINITY, f64::min)
    };
    let lengths = axes.map(length);
    let longest =
        (1..axes.len()).fold(0, |best, axis| if lengths[axis] > lengths[best] { axis } else { best });
    let middle = leaves / 2 * SINGLES;
    indices.select_nth_unstable_by(middle, |&a, &b| axes[longest][a].total_cmp(&axes[longest][b]));
    let (low, high) = indices.split_at_mut(middle);
    sort_into_leaves(low, axes);
    sort_into_leaves(high, axes);
}

fn extremes(values: &[f32]) -> (f32, f32) {
    values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)))
}

fn square(value: f64) -> f64 {
    value * value
}

/// The values, padded with NaN to whole groups.
fn filled_up(values: impl ExactSizeIterator<Item = f32>) -> Result<Vec<f32>> {
    let whole_groups = values.len().next_multiple_of(SINGLES);
    let mut filled = memory::with_capacity(whole_groups)?;
    filled.extend(values);
    filled.resize(whole_groups, f32::NAN);
    Ok(filled)
}

/// Counts the inliers of a transform, given in f64 and by rows in f32.
struct CountInliers<'a> {
    counter: &'a InlierCounter<'a>,
    model: &'a Rigid,
    rows: [[f32; 4]; 3],
    least: usize,
    /// Empty, with room for a number per group of leaves.
    near: &'a mut Vec<u16>,
}

impl Kernel for CountInliers<'_> {
    type Output = Option<usize>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Option<usize> {
        let Self { counter, model, rows, least, near } = self;
        let rows = [splat_row(lanes, rows[0]), splat_row(lanes, rows[1]), splat_row(lanes, rows[2])];
        let mut possible_inliers = 0;
        for (group, reach) in counter.squared_reach.as_chunks::<SINGLES>().0.iter().enumerate() {
            let residuals = squared_residuals(lanes, rows, &counter.centers, group);
            let leaves = lanes.at_most(residuals, lanes.load_singles(reach));
            possible_inliers += SINGLES * leaves.count_ones() as usize;
            near.push(leaves);
        }
        let (sure, possible) =
            (lanes.splat_singles(counter.squared_sure), lanes.splat_singles(counter.squared_possible));
        let mut inliers = 0;
        for (group, &leaves) in near.iter().enumerate() {
            let mut leaves = leaves;
            while leaves != 0 {
                if possible_inliers < least {
                    return None;
                }
                let leaf = group * SINGLES + leaves.trailing_zeros() as usize;
                leaves &= leaves - 1;
                let residuals = squared_residuals(lanes, rows, &counter.members, leaf);
                let mut members = lanes.at_most(residuals, sure);
                let unsure = lanes.at_most(residuals, possible) & !members;
                if unsure != 0 {
                    members |= counter.settle(model, leaf, unsure);
                }
                let found = members.count_ones() as usize;
                inliers += found;
                possible_inliers -= SINGLES - found;
            }
        }
        (inliers >= least).then_some(inliers)
    }
}

#[inline(always)]
fn splat_row<L: Lanes>(lanes: L, row: [f32; 4]) -> [L::Singles; 4] {
    [
        lanes.splat_singles(row[0]),
        lanes.splat_singles(row[1]),
        lanes.splat_singles(row[2]),
        lanes.splat_singles(row[3]),
    ]
}

/// `|R p + t - p'|^2` of a group of correspondences.
#[inline(always)]
fn squared_residuals<L: Lanes>(
    lanes: L,
    rows: [[L::Singles; 4]; 3],
    axes: &Axes<Vec<f32>>,
    group: usize,
) -> L::Singles {
    let part = group * SINGLES..(group + 1) * SINGLES;
    let x = load(lanes, &axes[0][part.clone()]);
    let y = load(lanes, &axes[1][part.clone()]);
    let z = load(lanes, &axes[2][part.clone()]);
    let dx = residual(lanes, rows[0], [x, y, z], load(lanes, &axes[3][part.clone()]));
    let dy = residual(lanes, rows[1], [x, y, z], load(lanes, &axes[4][part.clone()]));
    let dz = residual(lanes, rows[2], [x, y, z], load(lanes, &axes[5][part]));
    let squared = lanes.multiply_add_singles(dy, dy, lanes.multiply_singles(dz, dz));
    lanes.multiply_add_singles(dx, dx, squared)
}

#[inline(always)]
fn load<L: Lanes>(lanes: L, values: &[f32]) -> L::Singles {
    lanes.load_singles(&values.as_chunks::<SINGLES>().0[0])
}

/// One coordinate of `R p + t - p'`.
#[inline(always)]
fn residual<L: Lanes>(lanes: L, row: [L::Singles; 4], p: [L::Singles; 3], target: L::Singles) -> L::Singles {
    let shift = lanes.subtract_singles(row[3], target);
    let shift = lanes.multiply_add_singles(row[2], p[2], shift);
    let shift = lanes.multiply_add_singles(row[1], p[1], shift);
    lanes.multiply_add_singles(row[0], p[0], shift)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;
    use nalgebra::{Rotation3, Vector3};

    fn points(n: usize, k: f64, scale: f64) -> Result<Points> {
        let place = |i: usize| {
            let t = i as f64 * k;
            [t.sin() * scale, (1.7 * t).cos() * scale, (0.3 * t * t).sin() * scale]
        };
        Points::from_rows("points", &(0..n).map(place).collect::<Vec<_>>())
    }

    #[test]
    fn counts_are_those_of_f64() -> Result<()> {
        let mut near = Vec::new();
        for n in [3, 15, 16, 17, 33, 500, 2000] {
            for scale in [1e-20, 1.0, 1e20] {
                let (source, target) = (points(n, 0.37, scale)?, points(n, 0.41, scale)?);
                for k in 0..20 {
                    let turn = Vector3::new(f64::from(k), 0.3 * f64::from(k), -1.0);
                    let rotation = Rotation3::new(turn).into_inner();
                    let model = Rigid { rotation, translation: turn.map(f64::sin) * scale };
                    for tolerance in [1e-9, 0.05, 0.3, 1.0, 100.0].map(|t| t * scale) {
                        let counter = InlierCounter::new(&source, &target, tolerance)?;
                        let plain =
                            (0..n).filter(|&i| is_inlier(&model, &source, &target, i, tolerance)).count();
                        assert_eq!(counter.count(&model, 0, &mut near)?, Some(plain));
                        assert_eq!(counter.count(&model, plain, &mut near)?, Some(plain));
                        assert_eq!(counter.count(&model, plain + 1, &mut near)?, None);
                    }
                }
            }
        }
        Ok(())
    }

    #[test]
    fn residuals_at_the_tolerance_are_decided_in_f64() -> Result<()> {
        let rows: Vec<_> = (0..300).map(|i| [f64::from(i), f64::from(i * i % 7), 0.0]).collect();
        let moved = |(i, r): (usize, &[f64; 3])| [r[0], r[1] + 0.1 * (i % 5) as f64, 0.0];
        let moved: Vec<_> = rows.iter().enumerate().map(moved).collect();
        let (source, target) = (Points::from_rows("source", &rows)?, Points::from_rows("target", &moved)?);
        let shift =
            Rigid { rotation: nalgebra::Matrix3::identity(), translation: source.center() - target.center() };
        for tenths in 0..5 {
            let counter = InlierCounter::new(&source, &target, 0.1 * f64::from(tenths) + 1e-300)?;
            let plain =
                (0..300).filter(|&i| is_inlier(&shift, &source, &target, i, counter.tolerance)).count();
            assert_eq!(counter.count(&shift, 0, &mut Vec::new())?, Some(plain));
        }
        Ok(())
    }
}
