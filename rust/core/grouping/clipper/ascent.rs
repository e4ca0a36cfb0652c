//! Projected gradient ascent with a penalty that grows (CLIPPER, Algorithm 1).

use super::affinity::{Affinity, Product};
use crate::error::Result;
use crate::execution::Execution;

/// What counts as 0 in u and in what it excludes, and the greatest fall of the objective that a step may bring.
const ZERO: f64 = 1e-9;

/// Steps at one penalty end where u changes by less, or the objective by less of itself, or after so many.
const SETTLED_U: f64 = 1e-8;
const SETTLED_OBJECTIVE: f64 = 1e-9;
const MOST_STEPS: usize = 200;

/// Penalties, and step sizes tried per step, each of them this factor of the one before.
const MOST_ROUNDS: usize = 1000;
const MOST_TRIALS: usize = 99;
const BACKTRACK: f64 = 0.25;

/// Where an ascent ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Ascent {
    /// Of length 1, nowhere negative.
    pub u: Vec<f64>,
    /// `u' (M - d Z) u`.
    pub objective: f64,
    /// How many penalties it took.
    pub rounds: usize,
    /// Whether no two that exclude each other are left.
    pub complete: bool,
}

/// Ascends from a vector that is nowhere negative and not 0.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn ascend(affinity: &Affinity, start: Vec<f64>, execution: &Execution) -> Result<Ascent> {
    let mut place = Place::at(affinity, start, execution)?;
    let mut penalty = place.penalty().unwrap_or(0.0);
    let mut objective = 0.0;
    for round in 0..MOST_ROUNDS {
        objective = place.climb(affinity, penalty, execution)?;
        let Some(more) = place.penalty() else {
            return Ok(Ascent { u: place.u, objective, rounds: round + 1, complete: true });
        };
        penalty += more;
    }
    Ok(Ascent { u: place.u, objective, rounds: MOST_ROUNDS, complete: false })
}

/// A vector of length 1, and its products.
struct Place {
    u: Vec<f64>,
    product: Product,
}

impl Place {
    fn at(affinity: &Affinity, mut u: Vec<f64>, execution: &Execution) -> Result<Self> {
        let length = dot(&u, &u).sqrt();
        if length > 0.0 {
            u.iter_mut().for_each(|entry| *entry /= length);
        }
        let product = affinity.product(&u, execution)?;
        Ok(Self { u, product })
    }

    /// `(M - d Z) u`.
    fn gradient(&self, penalty: f64) -> Vec<f64> {
        let terms = self.product.affinity.iter().zip(&self.product.conflict);
        terms.map(|(affinity, conflict)| affinity - penalty * conflict).collect()
    }

    /// The mean of `(M u)_i / (Z u)_i` where both `u_i` and `(Z u)_i` are above 0; nothing where that is nowhere.
    fn penalty(&self) -> Option<f64> {
        let terms = self.u.iter().zip(self.product.affinity.iter().zip(&self.product.conflict));
        let active = terms.filter(|&(&u, (_, &conflict))| u > ZERO && conflict > ZERO);
        let (sum, count) = active
            .fold((0.0, 0), |(sum, count), (_, (affinity, conflict))| (sum + affinity / conflict, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// Steps uphill at one penalty; returns the objective.
    fn climb(&mut self, affinity: &Affinity, penalty: f64, execution: &Execution) -> Result<f64> {
        let mut gradient = self.gradient(penalty);
        let mut objective = dot(&self.u, &gradient);
        for _ in 0..MOST_STEPS {
            let mut size = 1.0;
            let mut next = None;
            for _ in 0..MOST_TRIALS {
                let trial: Vec<f64> =
                    self.u.iter().zip(&gradient).map(|(u, slope)| (u + size * slope).max(0.0)).collect();
                let trial = Self::at(affinity, trial, execution)?;
                let slope = trial.gradient(penalty);
                let value = dot(&trial.u, &slope);
                next = Some((trial, slope, value));
                if value - objective >= -ZERO {
                    break;
                }
                size *= BACKTRACK;
            }
            let Some((trial, slope, value)) = next else { break };
            let change: f64 = trial.u.iter().zip(&self.u).map(|(new, old)| (new - old).powi(2)).sum();
            let gain = value - objective;
            (*self, gradient, objective) = (trial, slope, value);
            if change.sqrt() < SETTLED_U || gain.abs() < SETTLED_OBJECTIVE * objective.abs() {
                break;
            }
        }
        Ok(objective)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
