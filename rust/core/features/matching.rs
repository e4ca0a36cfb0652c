//! Exact descriptor matching: nearest and second-nearest target of every source descriptor in L2.
//!
//! Squared distances are first bounded by a single-precision matrix product; whatever may still be
//! nearest or second-nearest is then computed in double precision, so the result is that of a plain
//! double loop, ties going to the lowest index. In hundreds of dimensions no tree does better. Cost
//! O(n n' d).

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use crate::error::{Error, Result, positive};
use crate::execution::Execution;

/// Source rows and target rows of one matrix product: the product stays in the second-level cache.
const SOURCE_BLOCK: usize = 96;
const TARGET_BLOCK: usize = 1024;
/// Values that are tested at once against the bound.
const CHUNK: usize = 32;
/// Candidates kept before the list is thinned out.
const MAX_CANDIDATES: usize = 256;
/// Half a unit in the last place of 1 in single precision.
const UNIT_ROUNDOFF: f64 = 1.0 / (1 << 24) as f64;
/// A squared distance at or below this counts as zero in the ratio.
const ZERO_SQUARED_DISTANCE: f64 = 1e-7;

/// Descriptors of one side; rows that are not finite stand for keypoints without a descriptor and are
/// left out.
#[derive(Debug, Clone, Default)]
pub struct Descriptors {
    values: Vec<f64>,
    length: usize,
    rows: Vec<usize>,
}

impl Descriptors {
    /// Takes descriptors of `length` numbers each, row after row.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a length of 0 or an incomplete last row; `name` is used in it.
    pub fn new<T: Copy + Into<f64>>(name: &str, values: &[T], length: usize) -> Result<Self> {
        if length == 0 || !values.len().is_multiple_of(length) {
            let got = format!("{} values for rows of {length}", values.len());
            return Err(Error::invalid(name, got, "give one row of equal length per keypoint"));
        }
        let is_complete = |row: &&[T]| row.iter().all(|&value| value.into().is_finite());
        let complete = values.chunks_exact(length).enumerate().filter(|(_, row)| is_complete(row));
        let rows = complete.map(|(i, _)| i).collect::<Vec<_>>();
        let kept = rows.iter().flat_map(|&i| &values[i * length..(i + 1) * length]);
        let values = kept.map(|&value| value.into()).collect();
        Ok(Self { values, length, rows })
    }

    /// Number of descriptors that take part.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether none takes part.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.length..(i + 1) * self.length]
    }

    fn largest(&self) -> f64 {
        self.values.iter().fold(0.0, |largest, value| value.abs().max(largest))
    }
}

/// Which matches are kept.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Matching {
    /// Keep a match only if the source descriptor is also nearest to the target descriptor.
    pub mutual: bool,
    /// Keep a match only if its distance is at most this.
    pub max_distance: Option<f64>,
}

/// One match. Indices count all rows that were given, those left out included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Row of the source descriptor.
    pub source: usize,
    /// Row of the nearest target descriptor.
    pub target: usize,
    /// Distance to it.
    pub distance: f64,
    /// Distance to the second nearest; infinite where there is none.
    pub second_distance: f64,
    /// `1 - |f/|f| - f'/|f'||`; negative infinity where a descriptor is zero (paper, section 3.1).
    pub similarity: f64,
}

impl Match {
    /// Nearest over second-nearest distance, in 0..=1, lower is better (paper, section 3.2); 1 where the
    /// second is missing or its square is at most 1e-7.
    pub fn ratio(&self) -> f64 {
        let second = self.second_distance;
        if second.is_infinite() || second * second <= ZERO_SQUARED_DISTANCE {
            return 1.0;
        }
        (self.distance / second).min(1.0)
    }
}

impl Matching {
    /// Matches in ascending order of the source row.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for descriptors of different lengths or a `max_distance` that is not
    /// positive; [`Error::Interrupted`].
    pub fn run(
        &self,
        source: &Descriptors,
        target: &Descriptors,
        execution: &Execution,
    ) -> Result<Vec<Match>> {
        if source.length != target.length {
            let got = format!("rows of {} against {}", target.length, source.length);
            return Err(Error::invalid("target", got, "both sides need the same descriptor"));
        }
        let limit = self.max_distance.map_or(Ok(f64::INFINITY), |d| positive("max_distance", d))?;
        let forth = nearest_two(source, target, execution)?;
        let back = if self.mutual { nearest_two(target, source, execution)? } else { Vec::new() };
        let is_kept = |i: usize, pair: &NearestTwo| {
            pair.distance <= limit && (!self.mutual || back[pair.nearest].nearest == i)
        };
        let kept = forth.iter().enumerate().filter(|&(i, pair)| is_kept(i, pair));
        Ok(kept
            .map(|(i, pair)| Match {
                source: source.rows[i],
                target: target.rows[pair.nearest],
                distance: pair.distance,
                second_distance: pair.second_distance,
                similarity: similarity(source.row(i), target.row(pair.nearest)),
            })
            .collect())
    }
}

#[derive(Debug, Clone, Copy)]
struct NearestTwo {
    nearest: usize,
    distance: f64,
    second_distance: f64,
}

/// Single-precision copy of one side, scaled so that nothing over- or underflows.
struct Scaled {
    values: Vec<f32>,
    squared_norms: Vec<f32>,
    norms: Vec<f64>,
}

impl Scaled {
    fn new(side: &Descriptors, scale: f64) -> Self {
        let values = side.values.iter().map(|value| (value / scale) as f32).collect();
        let norm = |row: &[f64]| row.iter().map(|value| (value / scale).powi(2)).sum::<f64>().sqrt();
        let norms: Vec<f64> = side.values.chunks_exact(side.length).map(norm).collect();
        let squared_norms = norms.iter().map(|norm| (norm * norm) as f32).collect();
        Self { values, squared_norms, norms }
    }
}

/// Nearest and second-nearest target of every source row; empty where there are no targets.
fn nearest_two(source: &Descriptors, target: &Descriptors, execution: &Execution) -> Result<Vec<NearestTwo>> {
    if source.is_empty() || target.is_empty() {
        return Ok(Vec::new());
    }
    let scale = source.largest().max(target.largest()).max(f64::MIN_POSITIVE);
    let (a, b) = (Scaled::new(source, scale), Scaled::new(target, scale));
    let farthest = b.norms.iter().copied().fold(0.0, f64::max);
    let blocks: Vec<usize> = (0..source.len()).step_by(SOURCE_BLOCK).collect();
    let results = blocks.into_par_iter().map(|start| {
        let end = (start + SOURCE_BLOCK).min(source.len());
        let slack = |i: usize| error_bound(source.length, a.norms[i], farthest);
        let mut candidates: Vec<_> = (start..end).map(|i| Candidates::new(slack(i))).collect();
        let rows = &a.values[start * source.length..end * source.length];
        scan_targets(rows, &b, source.length, &mut candidates, execution)?;
        let exact = (start..end).zip(&candidates);
        Ok(exact.map(|(i, found)| best_two(source.row(i), target, &found.indices())).collect())
    });
    Ok(results.collect::<Result<Vec<Vec<NearestTwo>>>>()?.concat())
}

/// Bound on the error of `|b|^2 - 2 a.b` as it is computed, whatever the order of summation.
fn error_bound(length: usize, norm: f64, farthest: f64) -> f32 {
    (2.0 * UNIT_ROUNDOFF * (length + 8) as f64 * (norm + farthest) * farthest + 1e-30) as f32
}

/// Offers every target to every source row of a block.
fn scan_targets(
    rows: &[f32],
    target: &Scaled,
    length: usize,
    candidates: &mut [Candidates],
    execution: &Execution,
) -> Result<()> {
    let lhs = MatRef::from_row_major_slice(rows, candidates.len(), length);
    let mut product = vec![0.0_f32; candidates.len() * TARGET_BLOCK];
    for (block, values) in target.values.chunks(TARGET_BLOCK * length).enumerate() {
        execution.check()?;
        let count = values.len() / length;
        let rhs = MatRef::from_row_major_slice(values, count, length).transpose();
        let used = &mut product[..candidates.len() * count];
        let dst = MatMut::from_row_major_slice_mut(used, candidates.len(), count);
        matmul(dst, Accum::Replace, lhs, rhs, -2.0, Par::Seq);
        let first = block * TARGET_BLOCK;
        let squared_norms = &target.squared_norms[first..first + count];
        for (found, products) in candidates.iter_mut().zip(product.chunks_exact(count)) {
            found.scan(products, squared_norms, first as u32);
        }
    }
    Ok(())
}

/// Targets of one source row that may be nearest or second-nearest, by the bounded value.
struct Candidates {
    slack: f32,
    /// Smallest and second-smallest value so far.
    lowest: [f32; 2],
    found: Vec<(f32, u32)>,
}

impl Candidates {
    fn new(slack: f32) -> Self {
        Self { slack: 2.0 * slack, lowest: [f32::INFINITY; 2], found: Vec::new() }
    }

    /// A value above this can't belong to the nearest two.
    fn limit(&self) -> f32 {
        self.lowest[1] + self.slack
    }

    fn scan(&mut self, products: &[f32], squared_norms: &[f32], first: u32) {
        let chunks = products.chunks(CHUNK).zip(squared_norms.chunks(CHUNK));
        for ((products, norms), start) in chunks.zip((first..).step_by(CHUNK)) {
            let limit = self.limit();
            let hits: u32 = products.iter().zip(norms).map(|(p, n)| u32::from(p + n <= limit)).sum();
            if hits == 0 {
                continue;
            }
            for ((product, norm), index) in products.iter().zip(norms).zip(start..) {
                self.offer(product + norm, index);
            }
        }
    }

    fn offer(&mut self, value: f32, index: u32) {
        if value > self.limit() {
            return;
        }
        if value < self.lowest[0] {
            self.lowest = [value, self.lowest[0]];
        } else if value < self.lowest[1] {
            self.lowest[1] = value;
        }
        self.found.push((value, index));
        if self.found.len().is_multiple_of(MAX_CANDIDATES) {
            let limit = self.limit();
            self.found.retain(|&(value, _)| value <= limit);
        }
    }

    fn indices(&self) -> Vec<usize> {
        let limit = self.limit();
        self.found.iter().filter(|&&(value, _)| value <= limit).map(|&(_, i)| i as usize).collect()
    }
}

/// The nearest two of the candidates, which are in ascending order, in double precision.
fn best_two(source: &[f64], target: &Descriptors, candidates: &[usize]) -> NearestTwo {
    let mut best = NearestTwo { nearest: 0, distance: f64::INFINITY, second_distance: f64::INFINITY };
    for &index in candidates {
        let square: f64 = source.iter().zip(target.row(index)).map(|(a, b)| (a - b) * (a - b)).sum();
        let distance = square.sqrt();
        if distance < best.distance {
            best = NearestTwo { nearest: index, distance, second_distance: best.distance };
        } else if distance < best.second_distance {
            best.second_distance = distance;
        }
    }
    best
}

fn similarity(f: &[f64], g: &[f64]) -> f64 {
    let norm = |row: &[f64]| row.iter().map(|value| value * value).sum::<f64>().sqrt();
    let (f_norm, g_norm) = (norm(f), norm(g));
    if f_norm == 0.0 || g_norm == 0.0 {
        return f64::NEG_INFINITY;
    }
    let square: f64 = f.iter().zip(g).map(|(a, b)| (a / f_norm - b / g_norm).powi(2)).sum();
    1.0 - square.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(rows: usize, length: usize, seed: f64) -> Vec<f64> {
        (0..rows * length).map(|i| (i as f64 * 0.7 + seed).sin() + (i as f64 * seed).cos()).collect()
    }

    fn brute_force(source: &Descriptors, target: &Descriptors) -> Vec<NearestTwo> {
        let all: Vec<usize> = (0..target.len()).collect();
        (0..source.len()).map(|i| best_two(source.row(i), target, &all)).collect()
    }

    fn check(source: &[f64], target: &[f64], length: usize) -> Result<()> {
        let (s, t) = (Descriptors::new("s", source, length)?, Descriptors::new("t", target, length)?);
        let matches = Matching::default().run(&s, &t, &Execution::default())?;
        let expected = brute_force(&s, &t);
        assert_eq!(matches.len(), expected.len());
        for (got, want) in matches.iter().zip(expected) {
            assert_eq!(got.target, t.rows[want.nearest]);
            assert_eq!(got.distance.to_bits(), want.distance.to_bits());
            assert_eq!(got.second_distance.to_bits(), want.second_distance.to_bits());
        }
        Ok(())
    }

    #[test]
    fn agrees_with_brute_force() -> Result<()> {
        for (length, scale) in [(1, 1.0), (3, 1e100), (30, 1e-100), (352, 1.0)] {
            let scaled = |values: Vec<f64>| values.iter().map(|v| v * scale).collect::<Vec<_>>();
            check(&scaled(waves(130, length, 0.1)), &scaled(waves(1500, length, 0.3)), length)?;
        }
        Ok(())
    }

    #[test]
    fn ties_take_the_lowest_index() -> Result<()> {
        let target = [waves(700, 8, 0.2), waves(700, 8, 0.2)].concat();
        check(&waves(50, 8, 0.2), &target, 8)?;
        check(&vec![0.0; 8 * 40], &vec![0.0; 8 * 3000], 8)
    }

    #[test]
    fn near_ties_beyond_single_precision_are_told_apart() -> Result<()> {
        let target: Vec<f64> = (0..2000).flat_map(|i| [1.0 + f64::from(2000 - i) * 1e-12, 1.0]).collect();
        check(&[1.0, 1.0], &target, 2)
    }

    #[test]
    fn incomplete_rows_are_left_out() -> Result<()> {
        let s = Descriptors::new("s", &[f64::NAN, 0.0, 1.0, 0.0], 2)?;
        let t = Descriptors::new("t", &[9.0, 9.0, f64::NAN, 0.0, 2.0, 0.0], 2)?;
        let matches = Matching::default().run(&s, &t, &Execution::default())?;
        assert_eq!(matches.len(), 1);
        assert_eq!((matches[0].source, matches[0].target), (1, 2));
        assert!((matches[0].distance - 1.0).abs() < 1e-15 && (matches[0].similarity - 1.0).abs() < 1e-15);
        Ok(())
    }

    #[test]
    fn options_thin_out() -> Result<()> {
        let s = Descriptors::new("s", &[0.0, 0.9, 5.0], 1)?;
        let t = Descriptors::new("t", &[1.0, 3.0], 1)?;
        let run = |matching: Matching| matching.run(&s, &t, &Execution::default());
        assert_eq!(run(Matching::default())?.len(), 3);
        let mutual = run(Matching { mutual: true, max_distance: None })?;
        assert_eq!(mutual.iter().map(|m| (m.source, m.target)).collect::<Vec<_>>(), [(1, 0), (2, 1)]);
        let close = run(Matching { mutual: false, max_distance: Some(1.0) })?;
        assert_eq!(close.iter().map(|m| m.source).collect::<Vec<_>>(), [0, 1]);
        assert!(run(Matching { mutual: false, max_distance: Some(-1.0) }).is_err());
        Ok(())
    }

    #[test]
    fn ratio_and_similarity_at_the_edges() -> Result<()> {
        let one = Descriptors::new("t", &[1.0, 0.0], 2)?;
        let zero = Descriptors::new("s", &[0.0, 0.0], 2)?;
        let single = Matching::default().run(&zero, &one, &Execution::default())?;
        assert!(single[0].second_distance.is_infinite() && single[0].ratio() >= 1.0);
        assert!(single[0].similarity.is_infinite() && single[0].similarity < 0.0);
        let twins = Descriptors::new("t", &[1.0, 0.0, 1.0, 0.0], 2)?;
        let exact = Matching::default().run(&one, &twins, &Execution::default())?;
        assert!(exact[0].distance == 0.0 && exact[0].ratio() >= 1.0);
        let none = Descriptors::new::<f64>("t", &[], 2)?;
        assert!(Matching::default().run(&one, &none, &Execution::default())?.is_empty());
        assert!(Matching::default().run(&none, &one, &Execution::default())?.is_empty());
        assert!(Descriptors::new("t", &[1.0; 3], 2).is_err());
        Ok(())
    }
}
