//! The probability of a pose, given the evidence for it, for its rivals, and for none of these.

use super::evidence::Evidence;
use super::settings::{
    ACCEPTED, AS_GOOD, CHANCE_SHARE, CROSSED_BY_CHANCE, FOUND_BY_CHANCE, HOPELESS, LEAD_BY_CHANCE,
    LEAST_CHANCE, LEAST_SCORE, LEAST_VOXELS, MATCHED, MISFIT_OF_POSES, MOST_CHANCE, MOST_FURTHER_PLANES,
    MOST_MATCHES, MOST_NATS, MOST_OPEN_MOTIONS, PLANES_BY_CHANCE,
};

/// Evidence for one pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// Score of the surfaces.
    pub score: f64,
    /// Number of matches that agree with the pose.
    pub support: usize,
    /// 9th decile of the residuals of the fine surfaces over their expected deviation.
    pub misfit: f64,
    /// Agreeing shape, agreeing planes, violations of free space.
    pub evidence: Evidence,
    /// Nats that chance reaches on these scans, from the best pose of the mirrored source; none for a pose that was not searched
    /// for.
    pub chance: Option<f64>,
}

impl Case {
    fn support_nats(&self) -> f64 {
        (self.support.min(MOST_MATCHES) as f64).ln_1p()
    }

    fn shape_nats(&self) -> f64 {
        self.evidence.cells.ln_1p()
    }

    fn misfit_nats(&self) -> f64 {
        self.misfit.max(1.0).ln()
    }

    fn crossed_nats(&self) -> f64 {
        (self.evidence.crossed.unwrap_or(0.0) / CROSSED_BY_CHANCE).ln_1p()
    }

    fn further_planes(&self, by_chance: usize) -> f64 {
        self.evidence.planes.saturating_sub(by_chance).min(MOST_FURTHER_PLANES) as f64
    }

    fn score_nats(&self) -> f64 {
        self.score.max(LEAST_SCORE).ln()
    }

    /// Returns the evidence for the pose in nats, to be compared with that for other poses of the same scans.
    pub fn weight(&self) -> f64 {
        4.0 * self.score_nats()
            + 0.5 * self.support_nats()
            + 0.8 * self.shape_nats()
            + 0.6 * self.further_planes(PLANES_BY_CHANCE)
            - 1.5 * self.misfit_nats()
            - 1.5 * self.crossed_nats()
    }

    /// Returns whether a pose of unknown evidence has no share of the probability beside this one.
    pub fn is_far_ahead(&self, score: f64, support: usize, misfit: f64) -> bool {
        self.weight() - Self { score, support, misfit, ..*self }.weight() > HOPELESS
    }

    /// Returns the lead of the pose in nats over poses of unrelated scans: over one of them, or over the best that chance reaches
    /// on these scans.
    pub fn lead_over_chance(&self) -> f64 {
        match self.chance {
            None => self.lead_over_unrelated(PLANES_BY_CHANCE),
            Some(chance) => self.found_nats() - chance - FOUND_BY_CHANCE,
        }
    }

    fn lead_over_unrelated(&self, planes_by_chance: usize) -> f64 {
        let could_be_refuted = if self.evidence.crossed.is_some() { 2.8 } else { 0.0 };
        2.0 * self.score_nats() + 2.1 * self.shape_nats() + 3.0 * self.further_planes(planes_by_chance)
            - 3.0 * self.misfit_nats()
            - 5.0 * self.crossed_nats()
            + could_be_refuted
    }

    /// Returns the lead of the best pose of a search, which aligns one more plane by chance, without what its matches add.
    pub fn lead_of_surfaces(&self) -> f64 {
        self.lead_over_unrelated(PLANES_BY_CHANCE + 1)
    }

    fn found_nats(&self) -> f64 {
        let unlike = (self.misfit / MISFIT_OF_POSES).max(1.0).ln();
        self.lead_of_surfaces() + MATCHED * (self.support as f64).ln_1p() - 3.0 * unlike
    }

    /// Returns the nats that chance reaches, if this is the best pose of the mirrored source.
    pub fn chance_nats(&self) -> f64 {
        let surfaces = self.lead_of_surfaces().clamp(LEAST_CHANCE, MOST_CHANCE);
        CHANCE_SHARE * surfaces + MATCHED * (self.support as f64).ln_1p()
    }

    /// Returns the probability of this pose of the mirrored source, with the best pose of the source as what chance reaches.
    pub fn as_decoy(&self, best: &Self) -> f64 {
        let chance = Some(best.chance_nats());
        share_probability(&[Self { chance, ..*self }], 1, &mut Vec::new())
    }

    /// Returns the value by which refined poses are ranked.
    pub fn rank(score: f64, support: usize, misfit: f64) -> f64 {
        let support = (support.min(MOST_MATCHES) as f64).ln_1p();
        score.max(LEAST_SCORE).ln() + 0.75 * support - 3.0 * (misfit + 0.1).ln()
    }
}

/// Returns the probability that the best pose is right, `1 / (1 + n e^-E + sum_r e^(1 - L_r))`, and pushes the share of each
/// rival as a multiple of it. E is the lead over chance, n the number of tried scales, `L_r` the lead over rival r.
///
/// The best of equal poses leads by chance, so a rival has a full share until the lead exceeds `LEAD_BY_CHANCE`.
pub fn share_probability(cases: &[Case], scales: usize, shares: &mut Vec<f64>) -> f64 {
    let Some((best, rivals)) = cases.split_first() else { return 0.0 };
    shares.clear();
    shares.extend(rivals.iter().map(|rival| {
        let lead = best.weight() - rival.weight();
        (LEAD_BY_CHANCE - lead).clamp(-MOST_NATS, LEAD_BY_CHANCE).exp()
    }));
    let none = scales as f64 * (-best.lead_over_chance()).clamp(-MOST_NATS, MOST_NATS).exp();
    1.0 / (1.0 + none + shares.iter().sum::<f64>())
}

/// Returns the probability of a pose that was found at two levels, from that of the level with the larger one, the shares of its
/// rivals there, and the probability at the other level: the odds against "none of these" grow by at most one nat. Those against
/// the rivals do not, since the same rival is preferred at both levels.
pub fn confirmed(best: f64, shares: &[f64], other: f64) -> f64 {
    let against = 1.0 / best.max(f64::MIN_POSITIVE) - 1.0;
    let rivals = shares.iter().sum::<f64>().min(against);
    1.0 / (1.0 + rivals + (against - rivals) * (-(2.0 * other).min(1.0)).exp())
}

/// Returns whether a pose is accepted.
pub fn is_accepted(probability: f64) -> bool {
    probability >= ACCEPTED
}

/// Returns whether a rival with such a share is an alternative: none is if the best pose would not be accepted without rivals.
pub fn is_alternative(probability: f64, share: f64, shares: &[f64]) -> bool {
    share >= AS_GOOD && is_accepted(probability / (1.0 - probability * shares.iter().sum::<f64>()))
}

/// Lowers a probability for clouds of few voxels, which unrelated ones fit by chance.
pub fn bound_by_size(probability: f64, least_voxels: usize) -> f64 {
    probability * (least_voxels as f64 / LEAST_VOXELS as f64).min(1.0)
}

/// Bounds the probability of a pose with open motions, along which other poses fit as well.
pub fn bound_by_motions(probability: f64, motions: usize) -> f64 {
    if motions <= MOST_OPEN_MOTIONS { probability } else { probability.min(1.0 / (1.0 + motions as f64)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(score: f64) -> Case {
        let evidence = Evidence { cells: 40.0, planes: 5, crossed: Some(0.0) };
        Case { score, support: 10, misfit: 1.2, evidence, chance: None }
    }

    #[test]
    fn equal_rivals_share() {
        let mut shares = Vec::new();
        let alone = share_probability(&[case(1.0)], 1, &mut shares);
        assert!(alone > 0.99 && shares.is_empty());
        let shared = share_probability(&[case(1.0), case(1.0)], 1, &mut shares);
        assert!((shares[0] - 1.0_f64.exp()).abs() < 1e-12);
        assert!((1.0 / shared - 1.0 / alone - shares[0]).abs() < 1e-12);
        assert!(is_alternative(shared, shares[0], &shares));
        let weak = share_probability(&[case(1.0), case(0.1)], 1, &mut shares);
        assert!(weak > 0.99 && !is_alternative(weak, shares[0], &shares));
    }

    #[test]
    fn violations_of_free_space_count_against_a_pose() {
        let evidence = |crossed| Evidence { crossed, ..case(1.0).evidence };
        let [unknown, clear, crossed] =
            [None, Some(0.0), Some(0.3)].map(|share| Case { evidence: evidence(share), ..case(1.0) });
        assert!(clear.lead_over_chance() > unknown.lead_over_chance());
        assert!(crossed.lead_over_chance() < unknown.lead_over_chance());
        assert!(crossed.weight() < clear.weight());
        assert!((unknown.weight() - clear.weight()).abs() < 1e-12);
    }

    #[test]
    fn few_voxels_and_open_motions_bound_a_probability() {
        assert!((bound_by_size(0.8, 50) - 0.4).abs() < 1e-12);
        assert!(
            (confirmed(0.5, &[], 0.5) - 1.0 / (1.0 + (-1.0_f64).exp())).abs() < 1e-12
                && (confirmed(0.4, &[1.0], 0.4) - 1.0 / (2.0 + 0.5 * (-0.8_f64).exp())).abs() < 1e-12
                && confirmed(0.3, &[1.0, 3.0], 0.3) <= 0.3 + 1e-12
                && confirmed(0.0, &[], 0.0).abs() < 1e-12
        );
        assert!((bound_by_size(0.8, 5000) - 0.8).abs() < 1e-12);
        assert!((bound_by_motions(0.8, 1) - 0.8).abs() < 1e-12);
        assert!((bound_by_motions(0.8, 3) - 0.25).abs() < 1e-12);
        assert!((bound_by_motions(0.1, 3) - 0.1).abs() < 1e-12);
        assert!(share_probability(&[], 1, &mut Vec::new()).abs() < 1e-12);
        assert!(Case::rank(1.0, 30, 1.0) > Case::rank(1.0, 5, 1.0));
    }
}
