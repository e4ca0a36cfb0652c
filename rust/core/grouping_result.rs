//! The result of a grouping method: the group, its scores, model and rule.

use nalgebra::Matrix4;

use crate::error::Result;
use crate::memory;
use crate::rule::Rule;

use std::collections::BTreeMap;

/// The correspondences that a method holds to be right.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grouping {
    /// Row `i` is true where correspondence `i` is selected; in the input's order.
    pub mask: Vec<bool>,
    /// The method's score of every correspondence, higher is better.
    pub scores: Option<Vec<f64>>,
    /// The cut on the scores that was really used.
    pub threshold: Option<f64>,
    /// The rigid model behind the selection, for methods that fit one: maps source into target.
    pub model: Option<Matrix4<f64>>,
    /// Poses that the correspondences speak for, the model first, for methods that find several.
    pub alternatives: Option<Vec<Alternative>>,
    /// Whether fewer than one wrong group in a hundred inputs is expected, for methods that can tell.
    pub ok: Option<bool>,
    /// Groups as good as this one to be expected in an input in which no correspondence is right.
    pub false_alarms: Option<f64>,
    /// Standard deviation of right correspondences, a length, for methods that estimate it.
    pub noise: Option<f64>,
    /// A mask for each rigid motion that is `ok`, the group's first, where several were asked for.
    pub instances: Option<Vec<Vec<bool>>>,
    /// The rule that decided.
    pub rule: Rule,
    /// Facts about the run: iterations, cluster seed, eigenvalue, ...
    pub diagnostics: BTreeMap<&'static str, f64>,
}

/// A rigid model that a method holds to be possible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alternative {
    /// Maps source into target.
    pub model: Matrix4<f64>,
    /// The method's score of it, higher is better.
    pub score: f64,
}

impl Grouping {
    /// A selection without scores.
    pub fn from_mask(mask: Vec<bool>) -> Self {
        Self { mask, ..Self::default() }
    }

    /// Nothing selected among `n`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn empty(n: usize) -> Result<Self> {
        memory::filled(false, n).map(Self::from_mask)
    }

    /// The same with one more fact about the run.
    #[must_use]
    pub fn with(mut self, name: &'static str, value: f64) -> Self {
        self.diagnostics.insert(name, value);
        self
    }

    /// The same with the rule that decided.
    #[must_use]
    pub fn by(self, rule: Rule) -> Self {
        Self { rule, ..self }
    }

    /// Number of selected correspondences.
    pub fn size(&self) -> usize {
        self.mask.iter().filter(|&&selected| selected).count()
    }
}

/// Mask of length `n` that is true at `indices`.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn mask_of(n: usize, indices: impl IntoIterator<Item = usize>) -> Result<Vec<bool>> {
    let mut mask = memory::filled(false, n)?;
    for i in indices {
        mask[i] = true;
    }
    Ok(mask)
}
