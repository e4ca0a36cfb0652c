//! What two correspondences score together, row by row.

use super::products::{Element, Side, fill_row};
use crate::points::{Points, unit_scale};
use crate::simd::dispatch::dispatch;
use crate::simd::lanes::SINGLES;

/// What a pair of correspondences scores. Pairs with a zero-length edge score 0 unless said otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PairScore {
    /// `rho = min(ds/dt, dt/ds)`.
    DistanceRatio,
    /// rho where it is at least this, else 0.
    DistanceRatioFrom(f64),
    /// 1 where rho is at least this, else 0.
    DistanceRatioIndicator(f64),
    /// 1 where `|ds - dt|` is at most `tolerance`, else 0.
    DistanceDifferenceIndicator {
        /// Greatest difference, a length.
        tolerance: f64,
        /// Whether pairs that share a source or a target point score 0.
        one_to_one: bool,
    },
}

/// Source and target coordinates in the storage type.
#[derive(Debug, Clone)]
pub struct PairPositions<T> {
    source: Side<T>,
    target: Side<T>,
    /// Factor from the data's unit to the stored one.
    scale: f64,
    /// Number of correspondences; the axes are filled up to whole groups with a point that nobody asks for.
    count: usize,
}

impl<T: Element> PairPositions<T> {
    /// Converts the coordinates.
    pub fn new(source: &Points, target: &Points) -> Self {
        let scale = unit_scale(source.diagonal().max(target.diagonal()));
        let side = |points: &Points| {
            let convert =
                |axis: &[f64]| filled_up(axis.iter().map(|value| T::from_f64(value * scale)).collect());
            let zero = points.zero_length() * scale;
            Side {
                x: convert(&points.x),
                y: convert(&points.y),
                z: convert(&points.z),
                zero_squared: T::from_f64(zero * zero),
            }
        };
        Self { source: side(source), target: side(target), scale, count: source.len() }
    }

    /// The rows `indices` alone.
    #[must_use]
    pub fn subset(&self, indices: &[usize]) -> Self {
        let side = |side: &Side<T>| {
            let pick = |axis: &[T]| filled_up(indices.iter().map(|&i| axis[i]).collect());
            Side { x: pick(&side.x), y: pick(&side.y), z: pick(&side.z), zero_squared: side.zero_squared }
        };
        Self {
            source: side(&self.source),
            target: side(&self.target),
            scale: self.scale,
            count: indices.len(),
        }
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Writes the scores of correspondence `i` with all others; its score with itself is 0.
    pub fn fill_row(&self, score: PairScore, i: usize, row: &mut [T]) {
        self.fill_part(score, i, 0, row);
    }

    /// Writes the scores of correspondence `i` with those from `first` on, as many as `row` takes: in f32
    /// whole groups, the last of which may go beyond the last correspondence.
    pub fn fill_part(&self, score: PairScore, i: usize, first: usize, row: &mut [T]) {
        let (source, target, zero) = (&self.source, &self.target, T::default());
        match score {
            PairScore::DistanceRatio => T::fill_ratios(source, target, i, first, row),
            PairScore::DistanceRatioFrom(least) => {
                T::fill_ratios(source, target, i, first, row);
                let least = T::from_f64(least);
                row.iter_mut().for_each(|entry| *entry = if *entry >= least { *entry } else { zero });
            }
            PairScore::DistanceRatioIndicator(least) => {
                T::fill_ratios(source, target, i, first, row);
                let least = T::from_f64(least);
                // No length is zero where the ratio is not.
                let agrees = |ratio: T| ratio >= least && ratio > zero;
                row.iter_mut().for_each(|entry| *entry = if agrees(*entry) { T::ONE } else { zero });
            }
            PairScore::DistanceDifferenceIndicator { tolerance, .. } => {
                let tolerance = T::from_f64(tolerance * self.scale);
                dispatch(
                    #[inline(always)]
                    || {
                        fill_row(source, target, i, first, row, |ds, dt| {
                            let difference = T::absolute_difference(ds.sqrt(), dt.sqrt());
                            if difference <= tolerance { T::ONE } else { zero }
                        });
                    },
                );
            }
        }
        if let Some(itself) = i.checked_sub(first).and_then(|at| row.get_mut(at)) {
            *itself = zero;
        }
    }

    /// Lets pairs with a zero-length edge score like all others.
    pub fn allow_shared_points(&mut self) {
        let below_any = T::from_f64(-1.0);
        self.source.zero_squared = below_any;
        self.target.zero_squared = below_any;
    }
}

fn filled_up<T: Element>(mut axis: Vec<T>) -> Vec<T> {
    axis.resize(axis.len().next_multiple_of(SINGLES), T::default());
    axis
}

impl PairPositions<f64> {
    /// The same in f32.
    #[must_use]
    pub fn to_single(&self) -> PairPositions<f32> {
        let side = |side: &Side<f64>| {
            let convert = |axis: &[f64]| axis.iter().map(|&value| value as f32).collect();
            Side {
                x: convert(&side.x),
                y: convert(&side.y),
                z: convert(&side.z),
                zero_squared: side.zero_squared as f32,
            }
        };
        PairPositions {
            source: side(&self.source),
            target: side(&self.target),
            scale: self.scale,
            count: self.count,
        }
    }
}
