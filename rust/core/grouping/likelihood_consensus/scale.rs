//! LC of unknown scale: `q = s R p + t`.
//!
//! For each tolerance, scales are tried in steps that change lengths as large as the target by the tolerance.
//! At each scale the best pose of few cliques, with the scaled source, is refined together with the scale:
//! weighted least squares (Umeyama, PAMI 1991). At the scales with the greatest scores all of LC is run. The
//! best score among significant answers wins, else the fewest false alarms. Each scale tried is one more
//! chance of a false alarm: their number is a factor of the false alarms. All lengths are the target's.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::confidence::MOST_FALSE_ALARMS;
use super::{CHANCE, DEVIATION, LikelihoodConsensus, Problem, REACH, frames, noise};
use crate::consensus::false_alarms::is_fewer;
use crate::consensus::likelihood::Likelihood;
use crate::consensus::likelihood::levels::levels;
use crate::error::Error;
use crate::geometry::rigid::{Rigid, fit_weighted, fixes_rotation};
use crate::options::{Kind, OptionType, Value};
use crate::selection::top_k::largest;
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

/// Factor around the ratio of both sides' sizes within which the scale is searched.
const WITHIN: f64 = 3.0;

/// Least and greatest relative step of scales.
const STEP: (f64, f64) = (0.02, 0.08);

/// Most correspondences in the search for cliques at each scale, and pairs that cliques grow from.
const VERTICES: usize = 1_000;
const SEEDS: usize = 20;

/// Iterations of refinement, and largest residual in it, in deviations.
const ROUNDS: usize = 8;
const REFINED: f64 = 3.0;

/// Iterations in which the noise is estimated and refines the scale.
const NOISE_ROUNDS: usize = 2;

/// Scales at which all of LC is run, and their least distance in steps.
const CANDIDATES: usize = 3;
const APART: f64 = 2.0;

/// Prior knowledge of the scale.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Scale {
    /// The scale is 1.
    #[default]
    Known,
    /// The scale lies between two bounds.
    Between(f64, f64),
}

impl OptionType for Scale {
    const KIND: Kind = Kind::Scale;

    fn read(value: Value) -> Option<Self> {
        match value {
            Value::Flag(false) => Some(Self::Known),
            Value::Flag(true) => Some(Self::Between(0.0, f64::INFINITY)),
            Value::Range(low, high) => Some(Self::Between(low, high)),
            _ => None,
        }
    }

    fn value(self) -> Value {
        match self {
            Self::Known => Value::Flag(false),
            Self::Between(low, high) => Value::Range(low, high),
        }
    }
}

/// The scales to try.
struct Range {
    low: f64,
    high: f64,
    /// Size of the target, a length.
    size: f64,
}

impl Range {
    /// Scales within the bounds and around the ratio of the sizes; `None` for too few points, or if those of
    /// a side coincide.
    fn new(source: &Points, target: &Points, bounds: (f64, f64)) -> Result<Option<Self>> {
        let (of_source, size) = (size(source)?, size(target)?);
        if source.len() < 3 || of_source <= source.zero_length() || size <= target.zero_length() {
            return Ok(None);
        }
        let ratio = size / of_source;
        let (low, high) = (bounds.0.max(ratio / WITHIN), bounds.1.min(ratio * WITHIN));
        if low > high {
            let got = format!("({}, {})", bounds.0, bounds.1);
            let near = format!("the sizes of both sides suggest {ratio:.3}, to a factor of {WITHIN}");
            return Err(Error::invalid("scale", got, format!("{near}: give bounds around that")));
        }
        Ok(Some(Self { low, high, size }))
    }

    fn step(&self, tolerance: f64) -> f64 {
        1.0 + (tolerance / self.size).clamp(STEP.0, STEP.1)
    }

    /// The scales to try, ascending.
    fn scales(&self, tolerance: f64) -> impl ExactSizeIterator<Item = f64> {
        let count = ((self.high / self.low).ln() / self.step(tolerance).ln()).ceil().max(1.0);
        let (low, width) = (self.low, (self.high / self.low).powf(count.recip()));
        (0..count as i32).map(move |k| low * width.powf(f64::from(k) + 0.5))
    }
}

/// Median distance of the points from their median along each axis: robust to up to half of the points.
fn size(points: &Points) -> Result<f64> {
    let mut middle = Vector3::zeros();
    for (middle, axis) in middle.iter_mut().zip([&points.x, &points.y, &points.z]) {
        *middle = median(memory::copied(axis)?);
    }
    let distances = (0..points.len()).map(|i| (points.get(i).coords - middle).norm());
    Ok(median(memory::collect(distances)?))
}

/// The median; 0 of an empty list.
fn median(mut numbers: Vec<f64>) -> f64 {
    let half = numbers.len() / 2;
    if numbers.is_empty() { 0.0 } else { *numbers.select_nth_unstable_by(half, f64::total_cmp).1 }
}

/// Result of LC at a scale with a tolerance.
struct Trial {
    scale: f64,
    tolerance: f64,
    false_alarms: f64,
    score: f64,
}

impl LikelihoodConsensus {
    /// Groups with a scale between bounds.
    pub(super) fn run_scaled(
        &self,
        given: &Correspondences,
        bounds: (f64, f64),
        execution: &Execution,
    ) -> Result<Grouping> {
        let (source, target) = given.positions("lc")?;
        let Some(range) = Range::new(source, target, bounds)? else {
            return self.run_known(given, execution);
        };
        let middle = (range.low * range.high).sqrt();
        let tolerances = self.tolerances(given, &source.scaled(middle)?, execution)?;
        let tried = tolerances.iter().map(|&tolerance| range.scales(tolerance).len()).sum::<usize>() as f64;
        let is_sure = |false_alarms: f64| false_alarms * tried < MOST_FALSE_ALARMS;
        let mut best =
            Trial { scale: middle, tolerance: tolerances[0], false_alarms: f64::INFINITY, score: 0.0 };
        for (k, &tolerance) in tolerances.iter().enumerate() {
            for scale in likely_scales(given, &range, tolerance, execution)? {
                let scaled = source.scaled(scale)?;
                let found = self.attempt(given, &scaled, tolerance, None, execution)?;
                let score = found.answer.ranked.first().map_or(0.0, |first| first.score);
                let false_alarms = found.false_alarms;
                let is_better = if is_sure(false_alarms) && is_sure(best.false_alarms) {
                    score > best.score
                } else {
                    let is_open = k == 0 || given.resolution().is_none();
                    is_fewer(false_alarms, best.false_alarms) && (is_open || is_sure(false_alarms))
                };
                if is_better {
                    best = Trial { scale, tolerance, false_alarms, score };
                }
            }
            if is_sure(best.false_alarms) {
                break;
            }
        }
        let rounds = if tolerances.len() > 1 { NOISE_ROUNDS } else { 0 };
        for _ in 0..rounds {
            let scaled = source.scaled(best.scale)?;
            let found = self.attempt(given, &scaled, best.tolerance, None, execution)?;
            let Some(first) = found.answer.ranked.first() else { break };
            let (pose, noise) = noise::refined(&found.problem, &found.likelihood, &first.mode.pose)?;
            let Similarity { factor, .. } = refined(&found.likelihood, pose, noise)?;
            best.scale = (best.scale * factor).clamp(range.low, range.high);
        }
        let scaled = source.scaled(best.scale)?;
        let rotations = frames::proposed_rotations(given)?;
        let rotations = rotations.as_deref();
        let found = self.attempt(given, &scaled, best.tolerance, rotations, execution)?;
        let mut grouping = self.finish(given, found, tried)?;
        let alternatives = grouping.alternatives.iter_mut().flatten().map(|one| &mut one.model);
        for model in grouping.model.iter_mut().chain(alternatives) {
            model.fixed_view_mut::<3, 3>(0, 0).scale_mut(best.scale);
        }
        grouping.rule.agreement.iter_mut().for_each(|agreement| agreement.scale = best.scale);
        Ok(grouping.with("scale", best.scale))
    }
}

/// The likeliest scales, refined, the best first.
fn likely_scales(
    given: &Correspondences,
    range: &Range,
    tolerance: f64,
    execution: &Execution,
) -> Result<Vec<f64>> {
    let (source, target) = given.positions("lc")?;
    // The same levels at all scales make the scores comparable.
    let levels = levels(target, target, given.optional_ratio(), CHANCE * tolerance, execution)?;
    let likelihood = Likelihood::new(target, target, &levels, DEVIATION * tolerance, REACH * tolerance)?;
    let look = |&scale: &f64| {
        let scaled = source.scaled(scale)?;
        let problem = Problem { source: &scaled, target, tolerance, modes: 1, execution };
        let likelihood = likelihood.between(&scaled, target)?;
        let cliques = problem.cliques(&problem.join(VERTICES)?, target, SEEDS)?;
        let ranked = problem.rank(&likelihood, &cliques)?;
        let Some(best) = ranked.first() else { return Ok((0.0, scale)) };
        let Similarity { factor, pose } = refined(&likelihood, best.mode.pose, likelihood.deviation())?;
        let score = likelihood.support(&pose).score * best.landing.coverage;
        Ok((score, (scale * factor).clamp(range.low, range.high)))
    };
    let scales = memory::collect(range.scales(tolerance))?;
    let found = memory::par_try_collect(scales.par_iter().map(look))?;
    let scores = memory::collect(found.iter().map(|&(score, _)| score))?;
    let apart = APART * range.step(tolerance).ln();
    let mut chosen: Vec<f64> = Vec::new();
    for k in largest(&scores, scores.len())? {
        let (score, scale) = found[k];
        let is_new = chosen.iter().all(|other| (scale / other).ln().abs() > apart);
        if score > 0.0 && is_new && chosen.len() < CANDIDATES {
            memory::push(&mut chosen, scale)?;
        }
    }
    Ok(chosen)
}

/// A similarity: `factor R` in place of the rotation, and its factor.
struct Similarity {
    factor: f64,
    pose: Rigid,
}

/// Weighted least squares of the residuals within a number of deviations; each iteration weights by the
/// result of the previous one.
fn refined(likelihood: &Likelihood, pose: Rigid, deviation: f64) -> Result<Similarity> {
    let mut found = Similarity { factor: 1.0, pose };
    let limit = (REFINED * deviation).powi(2);
    for _ in 0..ROUNDS {
        let (squares, posteriors) =
            (likelihood.squared_residuals(&found.pose)?, likelihood.posteriors(&found.pose)?);
        let near = memory::collect((0..squares.len()).filter(|&i| squares[i] < limit))?;
        let p = memory::collect(near.iter().map(|&i| likelihood.points(i).0))?;
        let q = memory::collect(near.iter().map(|&i| likelihood.points(i).1))?;
        if !fixes_rotation(&p, &q) {
            break;
        }
        found = fit_similarity(&p, &q, &memory::collect(near.iter().map(|&i| posteriors[i]))?);
    }
    Ok(found)
}

/// Umeyama, *Least-squares estimation of transformation parameters between two point patterns*, PAMI 1991.
fn fit_similarity(p: &[Point3<f64>], q: &[Point3<f64>], weights: &[f64]) -> Similarity {
    let Rigid { rotation, translation } = fit_weighted(p, q, weights);
    let total: f64 = weights.iter().sum();
    let center = p.iter().zip(weights).map(|(p, &w)| p.coords * w).sum::<Vector3<f64>>() / total;
    let image = rotation * center + translation;
    let (mut along, mut spread) = (0.0, 0.0);
    for ((p, q), w) in p.iter().zip(q).zip(weights) {
        let arm = rotation * (p.coords - center);
        along += w * arm.dot(&(q.coords - image));
        spread += w * arm.norm_squared();
    }
    let factor = along / spread;
    let pose = Rigid { rotation: rotation * factor, translation: image - rotation * center * factor };
    Similarity { factor, pose }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::GroupingMethod;
    use crate::grouping::test_problem::problem;

    const UNKNOWN: Scale = Scale::Between(0.0, f64::INFINITY);

    /// The problem with its source in another unit.
    fn scaled(n: usize, right: usize, factor: f64) -> Result<Correspondences> {
        let given = problem(n, right)?;
        let (source, target) = given.positions("lc")?;
        Correspondences::between(source.scaled(factor)?, target.copied()?)
    }

    fn group(input: &Correspondences, scale: Scale) -> Result<Grouping> {
        LikelihoodConsensus { scale, ..LikelihoodConsensus::default() }.group(input, &Execution::default())
    }

    #[test]
    fn finds_the_scale_of_the_moved_points() -> Result<()> {
        for factor in [0.4, 1.0, 2.5] {
            let found = group(&scaled(400, 40, factor)?, UNKNOWN)?;
            assert!(found.ok == Some(true) && found.mask[..40].iter().all(|&selected| selected));
            let scale = found.diagnostics.get("scale").copied().unwrap_or_default();
            assert!((scale * factor - 1.0).abs() < 1e-3, "{scale}");
            let model = found.model.unwrap_or_default();
            assert!(
                (model[(0, 1)] + scale).abs() < 1e-3 * scale && (model[(0, 3)] - 7.0).abs() < 0.1,
                "{model}"
            );
            assert_eq!(found.rule.agreement.map(|agreement| agreement.scale), Some(scale));
        }
        Ok(())
    }

    #[test]
    fn chance_is_not_significant_and_no_matches_give_no_group() -> Result<()> {
        assert_eq!(group(&scaled(300, 0, 2.0)?, UNKNOWN)?.ok, Some(false));
        for n in 0..3 {
            assert_eq!(group(&scaled(n, n, 2.0)?, UNKNOWN)?.model, None);
        }
        let points = [[1.0; 3]; 50];
        assert_eq!(group(&Correspondences::new(&points, &points)?, UNKNOWN)?.size(), 0);
        Ok(())
    }

    #[test]
    fn bounds_far_from_the_sizes_are_refused() -> Result<()> {
        let input = scaled(400, 40, 2.0)?;
        assert_eq!(group(&input, Scale::Between(0.4, 0.6))?.ok, Some(true));
        for bounds in [Scale::Between(100.0, 200.0), Scale::Between(3.0, 1.0)] {
            assert!(matches!(group(&input, bounds), Err(Error::InvalidInput { .. })));
        }
        Ok(())
    }
}
