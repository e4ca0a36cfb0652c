//! GTM: a game between correspondences; those that agree with many survivors survive.
//!
//! The paper, section 3.2, Eq. (17) and (18) (after Rodola, Albarelli, Bergamasco, Torsello, IJCV 2013). Each
//! correspondence is a strategy, the payoff of a pair is its distance ratio, and an initially uniform
//! population evolves by replicator dynamics. Cost O(n^2) per step. Payoffs of more than
//! [`DOUBLE_LIMIT`](crate::compatibility::matrix::DOUBLE_LIMIT) correspondences are rounded to 16 bits, with
//! errors of at most 8e-6.

use super::GroupingMethod;
use crate::compatibility::matrix::{PairMatrix, PairScore};
use crate::error::Error;
use crate::options::{POSITIVE, ROUNDS, Value, method, words};
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::otsu::{Cut, OtsuMode, Threshold};
use crate::simd::sums::sum;
use crate::{Correspondences, Execution, Grouping, Result, memory};

/// No two strategies of a population with at most this mean payoff are compatible.
const NO_PAYOFF: f64 = 1e-300;

/// Bound on the total share of strategies removed as extinct, at any later step.
const EXTINCT: f64 = 1e-12;

/// The same bound relative to the rounding of payoffs, if that is greater.
const WITHIN_ROUNDING: f64 = 0.1;

/// Extinct strategies are removed once fewer than this part of the strategies matter.
const WORTH_SHRINKING: f64 = 0.8;

/// Least share of a survivor of infection-immunisation.
const SURVIVES: f64 = 1e-9;

/// Default Nash error at which infection-immunisation stops.
const NASH_ERROR: f64 = 1e-8;

/// Relative tolerance for equal payoffs.
const PAYOFF_TIE: f64 = 1e-12;

words! {
    /// Payoff of two strategies.
    pub enum Payoff {
        /// `min(ds/dt, dt/ds)`, as in the paper.
        DistanceRatio = Value::Word("distance_ratio"),
        /// 1 if `|ds - dt|` is at most the tolerance, else 0.
        DistanceDifference = Value::Word("distance_difference"),
    }
}

words! {
    /// How the population evolves.
    pub enum Dynamics {
        /// Discrete replicator dynamics, as in the paper.
        Replicator = Value::Word("replicator"),
        /// Infection and immunisation (Rota Bulo, Bomze, *Games and Economic Behavior* 2011): O(n) per step.
        InfectionImmunisation = Value::Word("infection_immunisation"),
    }
}

method! {
    /// Parameters of game-theoretic matching.
    pub struct GameTheory = "gtm", ["source", "target"], optional ["resolution"], {
        /// Steps of the dynamics; more steps select fewer correspondences.
        pub iterations: usize = 100, ROUNDS;
        /// Population shares above this are selected.
        pub threshold: Threshold = Threshold::Otsu;
        /// Candidates of Otsu's threshold: 100 equal bins between the least and the greatest score; every gap
        /// between scores; as in the code of SI's author, for scores from 0 to 1; or as in the evaluation
        /// group's later code.
        pub otsu: OtsuMode = OtsuMode::default();
        /// Pairs that share a point have a payoff of 0; the distance ratio implies it.
        pub one_to_one: bool = false;
        /// `min(ds/dt, dt/ds)`; or 1 if `|ds - dt|` is at most `tolerance`, else 0.
        pub payoff: Payoff = Payoff::default();
        /// Greatest `|ds - dt|` of the second payoff, a length; default `3 * resolution`.
        pub tolerance: Option<f64> = None;
        /// Stop once a step changes the population by less (L1 norm); infection-immunisation stops at this
        /// Nash error, 1e-8 by default.
        pub convergence_tolerance: Option<f64> = None, POSITIVE;
        /// Replicator dynamics, Eq. (17); or infection and immunisation (Rota Bulo, Bomze, 2011) at O(n) per
        /// step, which selects the survivors (share above 1e-9). The latter needs about 10,000 iterations.
        pub dynamics: Dynamics = Dynamics::default();
    }
}

/// Shares of the strategies after the last step.
struct Population {
    shares: Vec<f64>,
    mean_payoff: f64,
    steps: usize,
}

impl Population {
    fn set(&mut self, strategies: &[usize], shares: &[f64]) {
        for (&i, &share) in strategies.iter().zip(shares) {
            self.shares[i] = share;
        }
    }
}

impl GroupingMethod for GameTheory {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        self.validate()?;
        let (source, target) = correspondences.positions("gtm")?;
        let score = self.pair_score(correspondences)?;
        let payoff = PairMatrix::new(source, target, score, None, execution)?; // Pi, Eq. (18)
        let population = match self.dynamics {
            Dynamics::Replicator => self.replicate(payoff, execution)?,
            Dynamics::InfectionImmunisation => self.infect_and_immunise(&payoff, execution)?,
        };
        let Cut { mask, threshold } = self.select(&population)?; // x_i > t_gtm
        let mut rule = Rule::new(Kind::Score);
        if let PairScore::DistanceDifferenceIndicator { tolerance, .. } = score {
            rule = rule.agreeing(Agreement::difference(tolerance).or_equal());
        }
        let scores = Some(population.shares);
        let grouping = Grouping { mask, scores, threshold, ..Grouping::default() }.by(rule);
        Ok(grouping.with("steps", population.steps as f64).with("mean_payoff", population.mean_payoff))
    }
}

impl GameTheory {
    fn validate(&self) -> Result<()> {
        if self.payoff == Payoff::DistanceRatio && self.tolerance.is_some() {
            let remedy = "the distance-ratio payoff has no tolerance; leave it out or use \
                          payoff=\"distance_difference\"";
            return Err(Error::invalid("tolerance", self.tolerance.unwrap_or_default(), remedy));
        }
        Ok(())
    }

    fn pair_score(&self, correspondences: &Correspondences) -> Result<PairScore> {
        Ok(match self.payoff {
            // Zero-length edges have a payoff of 0, which includes the one-to-one rule.
            Payoff::DistanceRatio => PairScore::DistanceRatio,
            Payoff::DistanceDifference => PairScore::DistanceDifferenceIndicator {
                tolerance: correspondences.length("tolerance", self.tolerance, 3.0)?,
                one_to_one: self.one_to_one,
            },
        })
    }

    fn replicate(&self, mut payoff: PairMatrix, execution: &Execution) -> Result<Population> {
        let mut shares = uniform(payoff.len())?;
        let mut alive = memory::collect(0..shares.len())?;
        let mut population = Population { shares: memory::copied(&shares)?, mean_payoff: 0.0, steps: 0 };
        while population.steps < self.iterations {
            let payoffs = payoff.multiply_rounded(&shares, execution)?; // y = Pi x
            let products = memory::collect(shares.iter().zip(&payoffs).map(|(x, y)| x * y))?;
            population.mean_payoff = sum(&products); // z = x' Pi x
            if population.mean_payoff <= NO_PAYOFF {
                break;
            }
            let next = memory::collect(products.iter().map(|share| share / population.mean_payoff))?; // x_i y_i / z, Eq. (17)
            let moved = sum(&memory::collect(shares.iter().zip(&next).map(|(a, b)| (a - b).abs()))?);
            shares = next;
            population.steps += 1;
            execution.report(population.steps, self.iterations)?;
            if self.convergence_tolerance.is_some_and(|least| moved < least) {
                break;
            }
            let steps_left = self.iterations - population.steps;
            let extinct = EXTINCT.max(WITHIN_ROUNDING * payoff.rounding()) / population.shares.len() as f64;
            let least = least_share(extinct, population.mean_payoff, steps_left);
            let matter = memory::collect((0..shares.len()).filter(|&i| shares[i] > least))?;
            if (matter.len() as f64) < WORTH_SHRINKING * shares.len() as f64 {
                population.set(&alive, &shares); // extinct strategies keep their current share
                payoff = payoff.into_subset(&matter, execution)?;
                shares = memory::collect(matter.iter().map(|&i| shares[i]))?;
                alive = memory::collect(matter.iter().map(|&i| alive[i]))?;
            }
        }
        population.set(&alive, &shares);
        Ok(population)
    }

    fn infect_and_immunise(&self, payoff: &PairMatrix, execution: &Execution) -> Result<Population> {
        let nash_error = self.convergence_tolerance.unwrap_or(NASH_ERROR);
        let mut shares = uniform(payoff.len())?;
        let mut payoffs = payoff.multiply(&shares, execution)?; // Pi x
        let mut mean_payoff = 0.0;
        for step in 0..self.iterations {
            mean_payoff = sum(&memory::collect(shares.iter().zip(&payoffs).map(|(x, y)| x * y))?);
            if squared_nash_error(&shares, &payoffs, mean_payoff) < nash_error * nash_error {
                return Ok(Population { shares, mean_payoff, steps: step });
            }
            let Some(Move { strategy, length: mu, extinguishes }) = best_move(&shares, &payoffs, mean_payoff)
            else {
                return Ok(Population { shares, mean_payoff, steps: step });
            };
            for (i, share) in shares.iter_mut().enumerate() {
                let vertex = if i == strategy { 1.0 } else { 0.0 };
                *share = (*share + mu * (vertex - *share)).max(0.0); // x + mu (e_k - x)
            }
            if extinguishes {
                shares[strategy] = 0.0;
            }
            for (y, entry) in payoffs.iter_mut().zip(payoff.row(strategy)?) {
                *y += mu * (entry - *y); // Pi x + mu (Pi e_k - Pi x)
            }
            execution.report(step + 1, self.iterations)?;
        }
        Ok(Population { shares, mean_payoff, steps: self.iterations })
    }

    fn select(&self, population: &Population) -> Result<Cut> {
        let shares = &population.shares;
        if population.mean_payoff <= NO_PAYOFF {
            return Ok(Cut { mask: memory::filled(false, shares.len())?, threshold: None });
        }
        match (self.dynamics, self.threshold) {
            (Dynamics::InfectionImmunisation, Threshold::Otsu) => {
                Threshold::Fixed(SURVIVES).above(shares, self.otsu)
            }
            _ => self.threshold.above(shares, self.otsu),
        }
    }
}

/// Share up to which a strategy cannot reach `extinct` in the remaining steps: payoffs are at most 1 and the
/// mean payoff never falls, so no share grows by more than `1 / z` per step.
fn least_share(extinct: f64, mean_payoff: f64, steps_left: usize) -> f64 {
    extinct * mean_payoff.powf(steps_left as f64)
}

fn uniform(n: usize) -> Result<Vec<f64>> {
    memory::filled(1.0 / n.max(1) as f64, n)
}

/// `sum_i min(x_i, mean - y_i)^2`: 0 if and only if at a Nash equilibrium.
fn squared_nash_error(shares: &[f64], payoffs: &[f64], mean: f64) -> f64 {
    shares.iter().zip(payoffs).map(|(&x, y)| x.min(mean - y).powi(2)).sum()
}

/// A move of the population along `e_k - x`: towards strategy k, or away from it.
struct Move {
    strategy: usize,
    length: f64,
    extinguishes: bool,
}

/// Moves towards the strategy with the greatest payoff above the mean, or away from the living one with the
/// lowest payoff below it, whichever differs more; ties within rounding prefer towards, then the lowest
/// index.
fn best_move(shares: &[f64], payoffs: &[f64], mean: f64) -> Option<Move> {
    let tie = PAYOFF_TIE * payoffs.iter().fold(0.0, |most: f64, y| most.max(y.abs()));
    let spreads = |i: usize| payoffs[i] - mean > tie;
    let shrinks = |i: usize| mean - payoffs[i] > tie && shares[i] > 0.0;
    let all = 0..shares.len();
    let gain = all.clone().filter(|&i| spreads(i)).map(|i| payoffs[i] - mean).fold(0.0, f64::max);
    let loss = all.clone().filter(|&i| shrinks(i)).map(|i| mean - payoffs[i]).fold(0.0, f64::max);
    let spread = || all.clone().find(|&i| spreads(i) && payoffs[i] - mean >= gain - tie);
    let shrink = || all.clone().find(|&i| shrinks(i) && mean - payoffs[i] >= loss - tie);
    let (strategy, bound) = if gain > 0.0 && gain >= loss - tie {
        (spread()?, 1.0)
    } else {
        let k = shrink()?;
        (k, shares[k] / (shares[k] - 1.0)) // to a share of 0
    };
    let advantage = payoffs[strategy] - mean; // (e_k - x)' Pi x
    let curvature = mean - 2.0 * payoffs[strategy]; // (e_k - x)' Pi (e_k - x), as Pi_kk = 0
    let newton = if curvature < 0.0 { -advantage / curvature } else { bound };
    let length = if bound > 0.0 { newton.min(bound) } else { newton.max(bound) };
    Some(Move { strategy, length, extinguishes: bound < 0.0 && length <= bound })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four points moved rigidly, two matched elsewhere.
    fn problem() -> Result<Correspondences> {
        let source = [[0., 0., 0.], [4., 0., 0.], [0., 3., 0.], [0., 0., 5.], [1., 1., 1.], [2., 5., 1.]];
        let mut target = source.map(|p| [p[0] + 10.0, p[1], p[2]]);
        target[4] = [40.0, 9.0, 2.0];
        target[5] = [-3.0, -30.0, 8.0];
        Correspondences::new(&source, &target)
    }

    #[test]
    fn rigidly_moved_points_survive() -> Result<()> {
        let expected = [true, true, true, true, false, false];
        for dynamics in [Dynamics::Replicator, Dynamics::InfectionImmunisation] {
            let method = GameTheory { dynamics, ..GameTheory::default() };
            let group = method.group(&problem()?, &Execution::default())?;
            assert_eq!(group.mask, expected, "{dynamics:?}");
            let total: f64 = group.scores.unwrap_or_default().iter().sum();
            assert!((total - 1.0).abs() < 1e-9);
        }
        Ok(())
    }

    #[test]
    fn one_step_by_hand() -> Result<()> {
        // ds = 1, 2, 3 and dt = 1, 1, 2: rho = 1, 1/2, 2/3.
        let source = [[0., 0., 0.], [1., 0., 0.], [3., 0., 0.]];
        let target = [[0., 0., 0.], [1., 0., 0.], [2., 0., 0.]];
        let input = Correspondences::new(&source, &target)?;
        let group =
            GameTheory { iterations: 1, ..GameTheory::default() }.group(&input, &Execution::default())?;
        let payoffs = [1.0 + 2.0 / 3.0, 1.0 + 0.5, 2.0 / 3.0 + 0.5];
        let total: f64 = payoffs.iter().sum();
        for (share, payoff) in group.scores.unwrap_or_default().iter().zip(payoffs) {
            assert!((share - payoff / total).abs() < 1e-14);
        }
        Ok(())
    }

    #[test]
    fn mean_payoff_never_falls() -> Result<()> {
        let mut last = 0.0;
        for iterations in 1..30 {
            let group = GameTheory { iterations, ..GameTheory::default() }
                .group(&problem()?, &Execution::default())?;
            let mean = group.diagnostics["mean_payoff"];
            assert!(mean >= last - 1e-15);
            last = mean;
        }
        Ok(())
    }

    #[test]
    fn removing_extinct_strategies_changes_shares_by_rounding_only() -> Result<()> {
        let place = |i: usize| {
            let t = i as f64;
            [(t * 1.3).sin() * 5.0, (t * 0.7).cos() * 4.0, (t * 2.1).sin() * 3.0]
        };
        let n = 600;
        let source: Vec<[f64; 3]> = (0..n).map(place).collect();
        let target: Vec<[f64; 3]> =
            (0..n).map(|i| if i % 2 == 0 { place(i) } else { place(3 * i + 1) }).collect();
        let input = Correspondences::new(&source, &target)?;
        let group = GameTheory::default().group(&input, &Execution::default())?;
        let scores = group.scores.unwrap_or_default();
        let few = scores.iter().filter(|&&score| score > EXTINCT).count();
        assert!((few as f64) < WORTH_SHRINKING * n as f64, "no strategy has become extinct");
        let execution = Execution::default();
        let positions = input.positions("gtm")?;
        let whole = PairMatrix::new(positions.0, positions.1, PairScore::DistanceRatio, None, &execution)?;
        let mut shares = uniform(n)?;
        for _ in 0..100 {
            let payoffs = whole.multiply(&shares, &execution)?;
            let mean: f64 = shares.iter().zip(&payoffs).map(|(x, y)| x * y).sum();
            shares.iter_mut().zip(payoffs).for_each(|(x, y)| *x *= y / mean);
        }
        for (score, share) in scores.iter().zip(shares) {
            assert!((score - share).abs() < 1e-11);
        }
        Ok(())
    }

    #[test]
    fn tiny_inputs_are_defined() -> Result<()> {
        for n in 0..3 {
            let rows: Vec<[f64; 3]> = (0..n).map(|i| [f64::from(i), 0.0, 0.0]).collect();
            for dynamics in [Dynamics::Replicator, Dynamics::InfectionImmunisation] {
                let method = GameTheory { dynamics, ..GameTheory::default() };
                let group = method.group(&Correspondences::new(&rows, &rows)?, &Execution::default())?;
                assert_eq!(group.mask.len(), rows.len());
            }
        }
        Ok(())
    }
}
