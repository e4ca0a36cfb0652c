//! The result of a grouping method: the group, its scores, model and rule.

use nalgebra::Matrix4;

use crate::error::Result;
use crate::memory;
use crate::rule::Rule;

use std::collections::BTreeMap;

/// The correspondences selected by a method.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grouping {
    /// Row `i` is true if correspondence `i` is selected; in the input's order.
    pub mask: Vec<bool>,
    /// The method's score of every correspondence, higher is better.
    pub scores: Option<Vec<f64>>,
    /// The threshold applied to the scores.
    pub threshold: Option<f64>,
    /// The rigid model of the selection, for methods that fit one: maps source into target.
    pub model: Option<Matrix4<f64>>,
    /// Poses supported by the correspondences, the model first, for methods that find several.
    pub alternatives: Option<Vec<Alternative>>,
    /// Whether at most one wrong group in a hundred inputs is expected, for methods that estimate it.
    pub ok: Option<bool>,
    /// Expected number of groups this good in an input without a correct correspondence.
    pub false_alarms: Option<f64>,
    /// Standard deviation of correct correspondences, a length, for methods that estimate it.
    pub noise: Option<f64>,
    /// A mask for each rigid motion that is `ok`, the group's first, if several were requested.
    pub instances: Option<Vec<Vec<bool>>>,
    /// The rule of the selection.
    pub rule: Rule,
    /// Statistics of the run: iterations, cluster seed, eigenvalue, ...
    pub diagnostics: BTreeMap<&'static str, f64>,
}

/// A possible rigid model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alternative {
    /// Maps source into target.
    pub model: Matrix4<f64>,
    /// The method's score of the model, higher is better.
    pub score: f64,
}

impl Grouping {
    /// Result without scores.
    pub fn from_mask(mask: Vec<bool>) -> Self {
        Self { mask, ..Self::default() }
    }

    /// Empty selection among `n` correspondences.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn empty(n: usize) -> Result<Self> {
        memory::filled(false, n).map(Self::from_mask)
    }

    /// Adds a statistic of the run.
    #[must_use]
    pub fn with(mut self, name: &'static str, value: f64) -> Self {
        self.diagnostics.insert(name, value);
        self
    }

    /// Sets the rule of the selection.
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
