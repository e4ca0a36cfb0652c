//! Projected gradient ascent with a growing penalty (CLIPPER, Algorithm 1).

use super::affinity::{Affinity, Terms};
use super::dense::Dense;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// Tolerance for zero in u and in the sums that it excludes, and the greatest decrease of the objective
/// allowed per step.
const ZERO: f64 = 1e-9;

/// Steps at one penalty end if the change of u, or the relative change of the objective, is smaller, or at
/// the maximum number.
const SETTLED_U: f64 = 1e-8;
const SETTLED_OBJECTIVE: f64 = 1e-9;
const MOST_STEPS: usize = 200;

/// Most penalties, and most step sizes tried per step, each of them this factor of the previous one.
const MOST_ROUNDS: usize = 1000;
const MOST_TRIALS: usize = 99;
const BACKTRACK: f64 = 0.25;

/// A greater penalty leaves no digits of the objective: it cannot separate what smaller ones do not.
const MOST_PENALTY: f64 = 1e9;

/// Result of an ascent.
#[derive(Debug, Clone, PartialEq)]
pub struct Ascent {
    /// Unit vector without negative entries.
    pub u: Vec<f64>,
    /// `u' (M - d Z) u`.
    pub objective: f64,
    /// Number of penalties used.
    pub rounds: usize,
    /// Whether no two remaining correspondences exclude each other.
    pub complete: bool,
}

/// Ascends from a non-negative vector other than 0.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn ascend(affinity: &Affinity, start: Vec<f64>, execution: &Execution) -> Result<Ascent> {
    let mut place = Place::new(affinity, start, execution)?;
    let mut penalty = place.penalty().unwrap_or(0.0);
    let (mut objective, mut rounds) = (0.0, 0);
    while rounds < MOST_ROUNDS && penalty < MOST_PENALTY {
        objective = place.climb(penalty)?;
        rounds += 1;
        let Some(more) = place.penalty() else {
            return Ok(Ascent { u: place.u, objective, rounds, complete: true });
        };
        penalty += more;
    }
    Ok(Ascent { u: place.u, objective, rounds, complete: false })
}

/// A unit vector, and the terms of its nonzero rows.
struct Trial {
    u: Vec<f64>,
    support: Vec<usize>,
    terms: Vec<Terms>,
}

impl Trial {
    /// `u' (M - d Z) u`; the other rows add nothing.
    fn objective(&self, penalty: f64) -> f64 {
        let rows = self.support.iter().zip(&self.terms);
        rows.map(|(&i, [affinity, conflict])| self.u[i] * (affinity - penalty * conflict)).sum()
    }
}

/// A unit vector, and the terms of all rows whose entry is or may become greater than 0.
struct Place<'a> {
    affinity: &'a Affinity<'a>,
    execution: &'a Execution,
    /// M of the active rows, once these are few.
    dense: Option<Dense>,
    u: Vec<f64>,
    /// By row, computed when `moves` was `computed_at`.
    terms: Vec<Terms>,
    computed_at: Vec<Moves>,
    moves: Moves,
}

/// Total increase of rising entries, and total decrease of falling ones, over all steps.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Moves {
    up: f64,
    down: f64,
}

impl<'a> Place<'a> {
    fn new(affinity: &'a Affinity<'a>, start: Vec<f64>, execution: &'a Execution) -> Result<Self> {
        let n = start.len();
        let (terms, computed_at) = (memory::filled([0.0; 2], n)?, memory::filled(Moves::default(), n)?);
        let (dense, moves) = (None, Moves::default());
        let mut place = Self { affinity, execution, dense, u: start, terms, computed_at, moves };
        let Trial { u, .. } = place.trial(memory::copied(&place.u)?)?;
        place.u = u;
        place.compute(&memory::collect(0..n)?)?;
        Ok(place)
    }

    /// Trial of the vector scaled to unit length.
    fn trial(&self, mut u: Vec<f64>) -> Result<Trial> {
        let length = u.iter().map(|entry| entry * entry).sum::<f64>().sqrt();
        if length > 0.0 {
            u.iter_mut().for_each(|entry| *entry /= length);
        }
        let support = memory::collect((0..u.len()).filter(|&i| u[i] > 0.0))?;
        let terms = self.products(&u, &support)?;
        Ok(Trial { u, support, terms })
    }

    /// The terms of some rows of a vector that is 0 in all rows that are 0 in `u` and cannot rise.
    fn products(&self, u: &[f64], rows: &[usize]) -> Result<Vec<Terms>> {
        match &self.dense {
            Some(dense) if rows.iter().all(|&row| dense.has(row)) => dense.terms(u, rows, self.execution),
            _ => self.affinity.terms(u, rows, self.execution),
        }
    }

    /// Computes the terms of some rows.
    fn compute(&mut self, rows: &[usize]) -> Result<()> {
        let terms = self.products(&self.u, rows)?;
        for (&row, terms) in rows.iter().zip(terms) {
            self.terms[row] = terms;
            self.computed_at[row] = self.moves;
        }
        Ok(())
    }

    /// The mean of `(M u)_i / (Z u)_i` over rows with `u_i` and `(Z u)_i` above 0; `None` if there are none.
    fn penalty(&self) -> Option<f64> {
        let rows = self.u.iter().zip(&self.terms);
        let active = rows.filter(|&(&u, &[_, conflict])| u > ZERO && conflict > ZERO);
        let (sum, count) = active
            .fold((0.0, 0), |(sum, count), (_, [affinity, conflict])| (sum + affinity / conflict, count + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// `max(0, u + size g)`, `g = (M - d Z) u`.
    fn moved(&self, size: f64, penalty: f64) -> Result<Vec<f64>> {
        let rows = self.u.iter().zip(&self.terms);
        let moved = |(u, [affinity, conflict]): (&f64, &Terms)| u + size * (affinity - penalty * conflict);
        memory::collect(rows.map(|row| moved(row).max(0.0)))
    }

    /// Ascends at one penalty; returns the objective.
    fn climb(&mut self, penalty: f64) -> Result<f64> {
        self.update(penalty)?;
        let rows = self.u.iter().zip(&self.terms);
        let mut objective: f64 =
            rows.map(|(u, [affinity, conflict])| u * (affinity - penalty * conflict)).sum();
        for _ in 0..MOST_STEPS {
            let mut size = 1.0;
            let mut trial = self.trial(self.moved(size, penalty)?)?;
            for _ in 1..MOST_TRIALS {
                if trial.objective(penalty) - objective >= -ZERO {
                    break;
                }
                size *= BACKTRACK;
                trial = self.trial(self.moved(size, penalty)?)?;
            }
            let before = objective;
            objective = trial.objective(penalty);
            let change = self.step_to(trial, penalty)?;
            if change < SETTLED_U || (objective - before).abs() < SETTLED_OBJECTIVE * objective.abs() {
                break;
            }
        }
        Ok(objective)
    }

    /// Accepts a trial; returns the change of u.
    fn step_to(&mut self, trial: Trial, penalty: f64) -> Result<f64> {
        let mut square = 0.0;
        for (new, old) in trial.u.iter().zip(&self.u) {
            let difference = new - old;
            square += difference * difference;
            self.moves.up += difference.max(0.0);
            self.moves.down += (-difference).max(0.0);
        }
        self.u = trial.u;
        for (&row, terms) in trial.support.iter().zip(trial.terms) {
            self.terms[row] = terms;
            self.computed_at[row] = self.moves;
        }
        self.update(penalty)?;
        Ok(square.sqrt())
    }

    /// Computes the terms of zero rows that may rise: the others stay 0 for any terms.
    fn update(&mut self, penalty: f64) -> Result<()> {
        let rows = memory::collect((0..self.u.len()).filter(|&i| self.may_rise(i, penalty)))?;
        self.compute(&rows)?;
        self.condense(penalty)
    }

    /// Whether a zero row with terms of an earlier u may have a positive gradient: `(M u)_i` has grown by at
    /// most the total increase of entries, and `(Z u)_i` has fallen by at most the total decrease.
    fn may_rise(&self, i: usize, penalty: f64) -> bool {
        let ([affinity, conflict], then) = (self.terms[i], self.computed_at[i]);
        let most = affinity + (self.moves.up - then.up);
        let least = (conflict - (self.moves.down - then.down)).max(0.0);
        self.u[i] <= 0.0 && then != self.moves && most + ZERO > penalty * (least - ZERO)
    }

    /// Stores M of the rows that are or may become greater than 0, once they are much fewer than before.
    fn condense(&mut self, penalty: f64) -> Result<()> {
        let rises = |i: usize| self.terms[i][0] - penalty * self.terms[i][1] > 0.0;
        let rows = memory::collect((0..self.u.len()).filter(|&i| self.u[i] > 0.0 || rises(i)))?;
        self.dense = self.dense.take().filter(|dense| rows.iter().all(|&row| dense.has(row)));
        let before = self.dense.as_ref().map_or(self.u.len(), Dense::len);
        if 4 * rows.len() <= 3 * before {
            self.dense = match &self.dense {
                Some(dense) => Some(dense.among(rows)?),
                None => Dense::new(self.affinity, self.u.len(), rows, self.execution)?,
            };
        }
        Ok(())
    }
}
