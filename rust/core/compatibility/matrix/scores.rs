//! Pair scores of correspondences, by rows.

use super::coordinates::{Coordinate, Sides, fill_row};
use crate::error::Result;
use crate::memory;
use crate::points::{Points, unit_scale};
use crate::simd;

/// Score of a pair of correspondences. Pairs with a zero-length edge score 0 unless stated otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PairScore {
    /// `r(c_i, c_j) = min(ds/dt, dt/ds)`, Eq. 12.
    DistanceRatio,
    /// The distance ratio if it is at least this, else 0.
    DistanceRatioFrom(f64),
    /// 1 if the distance ratio is at least this, else 0.
    DistanceRatioIndicator(f64),
    /// 1 if `|ds - dt|` is at most `tolerance`, else 0.
    DistanceDifferenceIndicator {
        /// Greatest difference, a length.
        tolerance: f64,
        /// Whether pairs that share a source or a target point score 0.
        one_to_one: bool,
    },
    /// `max(0, 1 - (ds - dt)^2 / tolerance^2)`, also for pairs that share a point.
    SquaredDistanceDifference {
        /// Least difference that scores 0, a length.
        tolerance: f64,
    },
}

impl PairScore {
    /// Whether pairs with a zero-length edge score like all others.
    pub fn lets_points_be_shared(self) -> bool {
        match self {
            Self::DistanceDifferenceIndicator { one_to_one, .. } => !one_to_one,
            Self::SquaredDistanceDifference { .. } => true,
            Self::DistanceRatio | Self::DistanceRatioFrom(_) | Self::DistanceRatioIndicator(_) => false,
        }
    }
}

/// Source and target coordinates, scaled to about 1.
#[derive(Debug, Clone)]
pub struct PairPositions<T> {
    sides: Sides<T>,
    /// Factor from the data's unit to the stored one.
    scale: f64,
    /// Number of correspondences, without the padding of the axes.
    count: usize,
}

impl PairPositions<f64> {
    /// Positions of matched points.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(source: &Points, target: &Points) -> Result<Self> {
        let scale = unit_scale(source.diagonal().max(target.diagonal()));
        let axes = [&source.x, &source.y, &source.z, &target.x, &target.y, &target.z];
        let scaled = memory::try_map(axes, |axis| memory::collect(axis.iter().map(|value| value * scale)))?;
        let zero_squared = [source, target].map(|points| {
            let zero = points.zero_length() * scale;
            zero * zero
        });
        Ok(Self { sides: Sides::new(scaled, zero_squared)?, scale, count: source.len() })
    }

    /// Converts to f32.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn to_single(&self) -> Result<PairPositions<f32>> {
        Ok(PairPositions { sides: self.sides.to_single()?, scale: self.scale, count: self.count })
    }
}

impl<T: Coordinate> PairPositions<T> {
    /// The correspondences at `indices`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn subset(&self, indices: &[usize]) -> Result<Self> {
        Ok(Self { sides: self.sides.subset(indices)?, scale: self.scale, count: indices.len() })
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Makes pairs with a zero-length edge score like all others.
    pub fn allow_shared_points(&mut self) {
        self.sides.zero_squared = [T::from_f64(-1.0); 2]; // below any square
    }

    /// Writes the scores of correspondence `i` with all others; its score with itself is 0.
    pub fn fill_row(&self, score: PairScore, i: usize, row: &mut [T]) {
        self.fill_part(score, i, 0, row);
    }

    /// Writes the scores of correspondence `i` with those from `first` on, to the length of `row`: in f32
    /// whole groups, of which the last may exceed the correspondences.
    pub fn fill_part(&self, score: PairScore, i: usize, first: usize, row: &mut [T]) {
        let zero = T::default();
        match score {
            PairScore::DistanceRatio => T::fill_ratios(&self.sides, i, first, row),
            PairScore::DistanceRatioFrom(least) => {
                T::fill_ratios(&self.sides, i, first, row);
                let least = T::from_f64(least);
                row.iter_mut().for_each(|entry| *entry = if *entry >= least { *entry } else { zero });
            }
            PairScore::DistanceRatioIndicator(least) => {
                T::fill_ratios(&self.sides, i, first, row);
                let least = T::from_f64(least);
                // A nonzero ratio has nonzero lengths.
                row.iter_mut().for_each(|entry| *entry = T::from(*entry >= least && *entry > zero));
            }
            PairScore::DistanceDifferenceIndicator { tolerance, .. } => {
                self.fill_agreements(tolerance, i, first, row);
            }
            PairScore::SquaredDistanceDifference { tolerance } => {
                self.fill_squared_differences(tolerance, i, first, row);
            }
        }
        if let Some(itself) = i.checked_sub(first).and_then(|at| row.get_mut(at)) {
            *itself = zero;
        }
    }

    /// Writes 1 if `|ds - dt|` is at most `tolerance`, else 0.
    fn fill_agreements(&self, tolerance: f64, i: usize, first: usize, row: &mut [T]) {
        let tolerance = T::from_f64(tolerance * self.scale);
        simd::run(
            #[inline(always)]
            || {
                fill_row(
                    &self.sides,
                    i,
                    first,
                    row,
                    #[inline(always)]
                    |ds, dt| {
                        let (ds, dt) = (ds.sqrt(), dt.sqrt());
                        T::from((if ds > dt { ds - dt } else { dt - ds }) <= tolerance)
                    },
                );
            },
        );
    }

    /// Writes `max(0, 1 - (ds - dt)^2 / tolerance^2)`.
    fn fill_squared_differences(&self, tolerance: f64, i: usize, first: usize, row: &mut [T]) {
        let (zero, one) = (T::default(), T::from(true));
        let inverse = T::from_f64(1.0 / (tolerance * self.scale));
        simd::run(
            #[inline(always)]
            || {
                fill_row(
                    &self.sides,
                    i,
                    first,
                    row,
                    #[inline(always)]
                    |ds, dt| {
                        let share = (ds.sqrt() - dt.sqrt()) * inverse;
                        let score = one - share * share;
                        if score > zero { score } else { zero }
                    },
                );
            },
        );
    }
}
