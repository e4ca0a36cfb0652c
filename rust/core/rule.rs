//! The rule that a method selects correspondences by, with its bounds.

/// Criterion that selects a correspondence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kind {
    /// Its score lies above [`crate::Grouping::threshold`].
    #[default]
    Score,
    /// The ratio of its nearest to its second-nearest descriptor distance is below the bound.
    Ratio,
    /// Its residual under the model is below the bound.
    Residual,
    /// It belongs to the maximum clique of agreeing correspondences, and no coordinate of its residual
    /// exceeds the bound.
    AxesInClique,
    /// As `AxesInClique`, for the densest core of agreeing correspondences.
    AxesInCore,
    /// In the order of the scores, it conflicts with no correspondence accepted before it.
    Conflict,
    /// As `Conflict`, with new scores after each acceptance.
    RecomputedConflict,
    /// Its distance to the seed of the largest star changes by less than the bound.
    Star,
    /// It belongs to the largest set of agreeing correspondences, with more members than the bound, and
    /// RANSAC keeps it.
    GrownSet,
    /// Its score is among the greatest; their number is that of the set's members.
    Greatest,
    /// It votes in the fullest bin or in its neighbours, of which the bound is the number.
    FullestBin,
    /// It votes for the winning maximum, and RANSAC keeps it; the bound is the width of the bins.
    Maximum,
}

impl Kind {
    /// Its public name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Score => "score",
            Self::Ratio => "ratio",
            Self::Residual => "residual",
            Self::AxesInClique => "axes in clique",
            Self::AxesInCore => "axes in core",
            Self::Conflict => "conflict",
            Self::RecomputedConflict => "recomputed conflict",
            Self::Star => "star",
            Self::GrownSet => "grown set",
            Self::Greatest => "greatest",
            Self::FullestBin => "fullest bin",
            Self::Maximum => "maximum",
        }
    }
}

/// Condition for two correspondences to agree in distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Bound on `|ds - dt|`, or on `min(ds/dt, dt/ds)`.
    pub bound: f64,
    /// Whether the bound is one on the ratio.
    pub is_ratio: bool,
    /// Whether equality with the bound is accepted.
    pub accepts_equality: bool,
    /// Lower bound of `ds + dt`, exclusive.
    pub least_sum: Option<f64>,
    /// Lower bound of `ds` and of `dt`, exclusive.
    pub least_each: Option<f64>,
    /// Scale factor of the source's lengths.
    pub scale: f64,
}

impl Agreement {
    /// `|ds - dt|` is less than a length.
    pub fn difference(bound: f64) -> Self {
        Self {
            bound,
            is_ratio: false,
            accepts_equality: false,
            least_sum: None,
            least_each: None,
            scale: 1.0,
        }
    }

    /// `min(ds/dt, dt/ds)` is greater than a number.
    pub fn ratio(bound: f64) -> Self {
        Self { is_ratio: true, ..Self::difference(bound) }
    }

    /// Accepts equality with the bound.
    #[must_use]
    pub fn or_equal(self) -> Self {
        Self { accepts_equality: true, ..self }
    }
}

/// The rule of a selection, with the evidence for each correspondence.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rule {
    /// The criterion.
    pub kind: Kind,
    /// The bound of the criterion.
    pub bound: Option<f64>,
    /// Whether equality with the bound is accepted.
    pub accepts_equality: bool,
    /// The condition of pairwise agreement, for methods that use one.
    pub agreement: Option<Agreement>,
    /// The correspondence that decided on each: the nearest seed of a star, or the first accepted one in
    /// conflict with it.
    pub decided_by: Option<Vec<Option<usize>>>,
    /// Number of accepted correspondences in conflict with each.
    pub conflicts: Option<Vec<usize>>,
    /// Vote of each: in bins from the fullest one, or as a point.
    pub votes: Option<Vec<Option<[f64; 3]>>>,
}

impl Rule {
    /// A rule without a bound.
    pub fn new(kind: Kind) -> Self {
        Self { kind, ..Self::default() }
    }

    /// A rule with a bound.
    pub fn bounded(kind: Kind, bound: f64) -> Self {
        Self { bound: Some(bound), ..Self::new(kind) }
    }

    /// Accepts equality with the bound.
    #[must_use]
    pub fn or_equal(self) -> Self {
        Self { accepts_equality: true, ..self }
    }

    /// Sets the condition of pairwise agreement.
    #[must_use]
    pub fn agreeing(self, agreement: Agreement) -> Self {
        Self { agreement: Some(agreement), ..self }
    }
}
