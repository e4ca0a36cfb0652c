//! Projected gradient ascent with a penalty that grows (CLIPPER, Algorithm 1).

use super::affinity::{Affinity, Terms};
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

/// A greater penalty leaves no digits of the objective: what it does not part, none does.
const MOST_PENALTY: f64 = 1e9;

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
    let mut place = Place::from(Trial::new(affinity, start, execution)?, affinity, execution)?;
    let mut penalty = place.penalty().unwrap_or(0.0);
    let (mut objective, mut rounds) = (0.0, 0);
    while rounds < MOST_ROUNDS && penalty < MOST_PENALTY {
        objective = place.climb(affinity, penalty, execution)?;
        rounds += 1;
        let Some(more) = place.penalty() else {
            return Ok(Ascent { u: place.u, objective, rounds, complete: true });
        };
        penalty += more;
    }
    Ok(Ascent { u: place.u, objective, rounds, complete: false })
}

/// A vector of length 1, and the terms of the rows in which it is not 0.
struct Trial {
    u: Vec<f64>,
    support: Vec<usize>,
    terms: Vec<Terms>,
}

impl Trial {
    fn new(affinity: &Affinity, mut u: Vec<f64>, execution: &Execution) -> Result<Self> {
        let length = u.iter().map(|entry| entry * entry).sum::<f64>().sqrt();
        if length > 0.0 {
            u.iter_mut().for_each(|entry| *entry /= length);
        }
        let support: Vec<usize> = (0..u.len()).filter(|&i| u[i] > 0.0).collect();
        let terms = affinity.terms(&u, &support, execution)?;
        Ok(Self { u, support, terms })
    }

    /// `u' (M - d Z) u`, to which the other rows add nothing.
    fn objective(&self, penalty: f64) -> f64 {
        let rows = self.support.iter().zip(&self.terms);
        rows.map(|(&i, [affinity, conflict])| self.u[i] * (affinity - penalty * conflict)).sum()
    }
}

/// A vector of length 1, and the terms of all rows.
struct Place {
    u: Vec<f64>,
    terms: Vec<Terms>,
}

impl Place {
    fn from(trial: Trial, affinity: &Affinity, execution: &Execution) -> Result<Self> {
        let rest: Vec<usize> = (0..trial.u.len()).filter(|&i| trial.u[i] <= 0.0).collect();
        let mut terms = vec![[0.0; 2]; trial.u.len()];
        let others = affinity.terms(&trial.u, &rest, execution)?;
        for (i, row) in trial.support.into_iter().zip(trial.terms).chain(rest.into_iter().zip(others)) {
            terms[i] = row;
        }
        Ok(Self { u: trial.u, terms })
    }

    /// The mean of `(M u)_i / (Z u)_i` where both `u_i` and `(Z u)_i` are above 0; nothing where that is nowhere.
    fn penalty(&self) -> Option<f64> {
        let rows = self.u.iter().zip(&self.terms);
        let active = rows.filter(|&(&u, &[_, conflict])| u > ZERO && conflict > ZERO);
        let (sum, count) = active
            .fold((0.0, 0), |(sum, count), (_, [affinity, conflict])| (sum + affinity / conflict, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// `max(0, u + size g)`, `g = (M - d Z) u`.
    fn moved(&self, size: f64, penalty: f64) -> Vec<f64> {
        let rows = self.u.iter().zip(&self.terms);
        rows.map(|(u, [affinity, conflict])| (u + size * (affinity - penalty * conflict)).max(0.0)).collect()
    }

    /// Steps uphill at one penalty; returns the objective.
    fn climb(&mut self, affinity: &Affinity, penalty: f64, execution: &Execution) -> Result<f64> {
        let rows = self.u.iter().zip(&self.terms);
        let mut objective: f64 =
            rows.map(|(u, [affinity, conflict])| u * (affinity - penalty * conflict)).sum();
        for _ in 0..MOST_STEPS {
            let mut size = 1.0;
            let mut trial = Trial::new(affinity, self.moved(size, penalty), execution)?;
            for _ in 1..MOST_TRIALS {
                if trial.objective(penalty) - objective >= -ZERO {
                    break;
                }
                size *= BACKTRACK;
                trial = Trial::new(affinity, self.moved(size, penalty), execution)?;
            }
            let before = objective;
            objective = trial.objective(penalty);
            let change: f64 = trial.u.iter().zip(&self.u).map(|(new, old)| (new - old).powi(2)).sum();
            *self = Self::from(trial, affinity, execution)?;
            if change.sqrt() < SETTLED_U || (objective - before).abs() < SETTLED_OBJECTIVE * objective.abs() {
                break;
            }
        }
        Ok(objective)
    }
}
