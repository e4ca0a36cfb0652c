//! Exact descriptor matching: the nearest targets of every source descriptor in L2, with a test for mutual
//! nearest neighbours.
//!
//! A single-precision matrix product first bounds the squared distances. Candidates for the nearest are then
//! computed in double precision, so the result is that of a plain double loop, ties to the lowest index. One
//! pass over the product serves both directions. In hundreds of dimensions trees are no faster. Cost O(n n'
//! d).

mod candidates;
mod columns;
mod descriptors;
mod product;

pub use descriptors::Descriptors;

use crate::error::{Error, Result, at_least_one, positive};
use crate::execution::Execution;
use crate::memory;
use crate::points::unit_scale;
use product::{Found, Product};

/// A squared distance at or below this counts as zero in the ratio.
const ZERO_SQUARED_DISTANCE: f64 = 1e-7;

/// Selection of matches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matching {
    /// Number of nearest targets per source row; fewer if there are fewer targets.
    pub k: usize,
    /// Keep a match only if the source descriptor is also nearest to the target descriptor.
    pub mutual: bool,
    /// Keep a match only if its distance is at most this.
    pub max_distance: Option<f64>,
}

impl Default for Matching {
    fn default() -> Self {
        Self { k: 1, mutual: false, max_distance: None }
    }
}

/// A match. Indices refer to all input rows, including skipped ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Row of the source descriptor.
    pub source: usize,
    /// Row of the target descriptor.
    pub target: usize,
    /// 1 for the source's nearest target, 2 for the next.
    pub rank: usize,
    /// Distance between the two.
    pub distance: f64,
    /// Distance of the source to its second-nearest target; infinite without one.
    pub second_distance: f64,
    /// `1 - |f/|f| - f'/|f'||`; negative infinity if a descriptor is zero (paper, section 3.1).
    pub similarity: f64,
    /// Whether no source descriptor is nearer to the target; ties to the lowest row.
    pub is_mutual: bool,
}

impl Match {
    /// Distance over second-nearest distance, in 0..=1, lower is better (paper, section 3.2); 1 if the second
    /// is missing or its square is at most 1e-7, and for any rank but the first.
    pub fn ratio(&self) -> f64 {
        let second = self.second_distance;
        if second.is_infinite() || second * second <= ZERO_SQUARED_DISTANCE {
            return 1.0;
        }
        (self.distance / second).min(1.0)
    }
}

impl Matching {
    /// Matches in ascending order of the source row, then of the rank.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for descriptors of different lengths or of too different magnitudes for the
    /// precision of squared distances, a `k` of 0 or beyond the memory bound, or a `max_distance` that is not
    /// positive; [`Error::Interrupted`], [`Error::OutOfMemory`].
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
        let k = at_least_one("k", self.k)?.min(target.len());
        if k.saturating_mul(source.len()) > execution.max_memory / size_of::<Match>() {
            let remedy = format!("matches of {} rows would exceed max_memory; give less", source.len());
            return Err(Error::invalid("k", self.k, remedy));
        }
        let product = Product::new(source, target)?;
        // The second is needed for the ratio.
        let found = product.nearest(k.max(2), execution)?;
        let owners = owners(&product, &found, k, execution)?;
        let pair = Pair { source, target, unit: product.unit };
        let mut matches = Vec::new();
        for i in 0..source.len() {
            execution.check()?;
            let own = (0..k).map(|place| pair.at(i, place, &found, &owners));
            for found in own.filter(|m| m.distance <= limit && (m.is_mutual || !self.mutual)) {
                memory::push(&mut matches, found)?;
            }
        }
        Ok(matches)
    }
}

/// The nearest source row of every target that is among the `k` nearest of a source row.
fn owners(product: &Product<'_>, found: &Found, k: usize, execution: &Execution) -> Result<Vec<u32>> {
    let mut is_wanted = memory::filled(false, product.targets())?;
    found.rows().for_each(|row| row.iter().take(k).for_each(|near| is_wanted[near.index as usize] = true));
    let mut owners = memory::copied(found.columns.lowest())?;
    let open = (0..is_wanted.len()).filter(|&j| is_wanted[j] && product.is_open(&found.columns, j));
    let open = memory::collect(open)?;
    if !open.is_empty() {
        let back = product.reversed(&open)?;
        let exact = Product::with_unit(&back.0, back.1, product.unit)?.nearest(1, execution)?;
        open.iter().zip(exact.rows()).for_each(|(&j, row)| owners[j] = row[0].index);
    }
    Ok(owners)
}

/// Both sides, and the power of two that scales their distances.
struct Pair<'a> {
    source: &'a Descriptors,
    target: &'a Descriptors,
    unit: f64,
}

impl Pair<'_> {
    fn at(&self, i: usize, place: usize, found: &Found, owners: &[u32]) -> Match {
        let row = found.row(i);
        let near = row[place];
        let target = near.index as usize;
        Match {
            source: self.source.rows[i],
            target: self.target.rows[target],
            rank: place + 1,
            distance: near.distance / self.unit,
            second_distance: row.get(1).map_or(f64::INFINITY, |second| second.distance / self.unit),
            similarity: similarity(self.source.row(i), self.target.row(target)),
            is_mutual: owners[target] as usize == i,
        }
    }
}

fn similarity(f: &[f64], g: &[f64]) -> f64 {
    // Scaled by powers of two: no square underflows and no bit changes.
    let unit = |row: &[f64]| unit_scale(row.iter().fold(0.0, |most: f64, value| most.max(value.abs())));
    let (f_unit, g_unit) = (unit(f), unit(g));
    let norm = |row: &[f64], unit: f64| row.iter().map(|v| (v * unit) * (v * unit)).sum::<f64>().sqrt();
    let (f_norm, g_norm) = (norm(f, f_unit), norm(g, g_unit));
    if f_norm == 0.0 || g_norm == 0.0 {
        return f64::NEG_INFINITY;
    }
    let terms = f.iter().zip(g).map(|(a, b)| (a * f_unit / f_norm - b * g_unit / g_norm).powi(2));
    1.0 - terms.sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(rows: usize, length: usize, seed: f64) -> Vec<f64> {
        (0..rows * length).map(|i| (i as f64 * 0.7 + seed).sin() + (i as f64 * seed).cos()).collect()
    }

    /// All matches by row and rank, without similarity: (target, distance, second distance, is mutual).
    fn brute_force(source: &Descriptors, target: &Descriptors, k: usize) -> Vec<(usize, f64, f64, bool)> {
        let distance = |i: usize, j: usize| {
            let pairs = source.row(i).iter().zip(target.row(j));
            pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
        };
        let nearest_source = |j: usize| {
            let all = (0..source.len()).map(|i| distance(i, j));
            all.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
        };
        let owners: Vec<_> = (0..target.len()).map(nearest_source).collect();
        let mut matches = Vec::new();
        for i in 0..source.len() {
            let mut row: Vec<_> = (0..target.len()).map(|j| (distance(i, j), j)).collect();
            row.sort_by(|a, b| a.0.total_cmp(&b.0));
            let second = row.get(1).map_or(f64::INFINITY, |near| near.0);
            let near = row.iter().take(k);
            matches.extend(near.map(|&(d, j)| (target.rows[j], d, second, owners[j] == Some(i))));
        }
        matches
    }

    fn check(source: &[f64], target: &[f64], length: usize) -> Result<()> {
        let (s, t) = (Descriptors::new("s", source, length)?, Descriptors::new("t", target, length)?);
        for k in [1, 2, 3, 40] {
            let matches = Matching { k, ..Matching::default() }.run(&s, &t, &Execution::default())?;
            let got = matches.iter().map(|m| (m.target, m.distance, m.second_distance, m.is_mutual));
            let (got, expected) = (got.collect::<Vec<_>>(), brute_force(&s, &t, k));
            assert_eq!(got, expected, "k {k}, length {length}");
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
    fn near_ties_beyond_single_precision_are_resolved() -> Result<()> {
        let target: Vec<f64> = (0..2000).flat_map(|i| [1.0 + f64::from(2000 - i) * 1e-12, 1.0]).collect();
        check(&[1.0, 1.0], &target, 2)
    }

    #[test]
    fn squares_neither_underflow_nor_overflow() -> Result<()> {
        let (source, target) = (waves(40, 5, 0.1), waves(90, 5, 0.3));
        let run = |exponent: i32| {
            let scaled =
                |values: &[f64]| values.iter().map(|v| v * 2.0_f64.powi(exponent)).collect::<Vec<_>>();
            let tables = [&source, &target].map(|values| Descriptors::new("t", &scaled(values), 5));
            let [s, t] = tables;
            Matching { k: 3, ..Matching::default() }.run(&s?, &t?, &Execution::default())
        };
        let usual = run(0)?;
        for exponent in [-550, 700] {
            for (got, want) in run(exponent)?.iter().zip(&usual) {
                assert_eq!(
                    (got.source, got.target, got.is_mutual),
                    (want.source, want.target, want.is_mutual)
                );
                assert_eq!(got.distance.to_bits(), (want.distance * 2.0_f64.powi(exponent)).to_bits());
                assert_eq!(got.similarity.to_bits(), want.similarity.to_bits());
            }
        }
        Ok(())
    }

    #[test]
    fn indistinguishable_descriptors_are_refused() -> Result<()> {
        let t = Descriptors::new("t", &[1.0, 1e-170, 3e-170], 1)?;
        let s = Descriptors::new("s", &[2e-170], 1)?;
        assert!(Matching::default().run(&s, &t, &Execution::default()).is_err());
        assert!(Matching::default().run(&t, &t, &Execution::default()).is_err());
        Ok(())
    }

    #[test]
    fn too_many_matches_are_refused() -> Result<()> {
        let t = Descriptors::new("t", &waves(100, 1, 0.1), 1)?;
        let matching = Matching { k: 100, ..Matching::default() };
        assert!(matching.run(&t, &t, &Execution::new(1000)).is_err());
        assert_eq!(matching.run(&t, &t, &Execution::default())?.len(), 10_000);
        assert!(Matching { k: 0, ..matching }.run(&t, &t, &Execution::default()).is_err());
        Ok(())
    }

    #[test]
    fn incomplete_rows_are_skipped() -> Result<()> {
        let s = Descriptors::new("s", &[f64::NAN, 0.0, 1.0, 0.0], 2)?;
        let t = Descriptors::new("t", &[9.0, 9.0, f64::NAN, 0.0, 2.0, 0.0], 2)?;
        let matches = Matching::default().run(&s, &t, &Execution::default())?;
        assert_eq!(matches.len(), 1);
        assert_eq!((matches[0].source, matches[0].target), (1, 2));
        assert!((matches[0].distance - 1.0).abs() < 1e-15 && (matches[0].similarity - 1.0).abs() < 1e-15);
        Ok(())
    }

    #[test]
    fn options_reduce_the_matches() -> Result<()> {
        let s = Descriptors::new("s", &[0.0, 0.9, 5.0], 1)?;
        let t = Descriptors::new("t", &[1.0, 3.0], 1)?;
        let base = Matching::default();
        let run = |matching: Matching| matching.run(&s, &t, &Execution::default());
        assert_eq!(run(Matching::default())?.len(), 3);
        let mutual = run(Matching { mutual: true, ..base })?;
        assert_eq!(mutual.iter().map(|m| (m.source, m.target)).collect::<Vec<_>>(), [(1, 0), (2, 1)]);
        let close = run(Matching { max_distance: Some(1.0), ..base })?;
        assert_eq!(close.iter().map(|m| m.source).collect::<Vec<_>>(), [0, 1]);
        assert!(run(Matching { max_distance: Some(-1.0), ..base }).is_err());
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
