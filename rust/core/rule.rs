//! The rule by which a method selects correspondences, with the bounds that it used.

/// What decides whether a correspondence belongs to the group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kind {
    /// Its score lies above [`crate::Grouping::threshold`].
    #[default]
    Score,
    /// The ratio of its nearest to its second-nearest descriptor distance is below the bound.
    Ratio,
    /// Its residual under the model is below the bound.
    Residual,
    /// It belongs to the maximum clique of those that agree, and no coordinate of its residual exceeds the bound.
    AxesInClique,
    /// The same in the densest core of those that agree.
    AxesInCore,
    /// In the order of the scores: none that was accepted before it conflicts with it.
    Conflict,
    /// The same, with new scores after each acceptance.
    RecomputedConflict,
    /// Its distance to the seed of the largest star changes by less than the bound.
    Star,
    /// It belongs to the largest set of more than the bound that all agree, and RANSAC keeps it.
    GrownSet,
    /// Its score is among the greatest, as many as the set has members.
    Greatest,
    /// It votes in the fullest bin or in those around it, as many as the bound says.
    FullestBin,
    /// It votes for the winning maximum, and RANSAC keeps it; bins are as wide as the bound.
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

/// When two correspondences keep their distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Bound on `|ds - dt|`, or on `min(ds/dt, dt/ds)`.
    pub bound: f64,
    /// Which of the two.
    pub is_ratio: bool,
    /// Whether the bound itself is accepted.
    pub accepts_equality: bool,
    /// What `ds + dt` has to exceed.
    pub least_sum: Option<f64>,
    /// What `ds` and `dt` each have to exceed.
    pub least_each: Option<f64>,
    /// Factor of the source's lengths.
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

    /// The same, where the bound itself is accepted.
    #[must_use]
    pub fn or_equal(self) -> Self {
        Self { accepts_equality: true, ..self }
    }
}

/// How a method decided, with what each correspondence was judged by.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rule {
    /// What decides.
    pub kind: Kind,
    /// The bound of that kind.
    pub bound: Option<f64>,
    /// Whether the bound itself is accepted.
    pub accepts_equality: bool,
    /// When two keep their distance, for methods that ask.
    pub agreement: Option<Agreement>,
    /// The correspondence that decided on each: the nearest seed of a star, the first accepted one that it conflicts with.
    pub decided_by: Option<Vec<Option<usize>>>,
    /// How many accepted ones each conflicts with.
    pub conflicts: Option<Vec<usize>>,
    /// Where each votes: in bins from the fullest one, or as a point.
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

    /// The same, where the bound itself is accepted.
    #[must_use]
    pub fn or_equal(self) -> Self {
        Self { accepts_equality: true, ..self }
    }

    /// The same, where two keep their distance by that rule.
    #[must_use]
    pub fn agreeing(self, agreement: Agreement) -> Self {
        Self { agreement: Some(agreement), ..self }
    }
}
