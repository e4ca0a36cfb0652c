//! TEASER++: truncated least squares for scale, rotation and translation in sequence, among the
//! correspondences kept by a graph of pairwise agreement.
//!
//! Yang, Shi, Carlone, *TEASER: Fast and certifiable point cloud registration*, T-RO 2021. With noise of at
//! most the tolerance beta on each point:
//!
//! 1. Unknown scale: s is the truncated mean of the ratios `dt / ds` of pairs, each within `2 beta / ds`
//!    (section V-A); the source is scaled.
//! 2. Pairs are connected if `|ds - dt| < 2 beta` (section IV). The maximum clique is kept, or the vertices
//!    of the greatest core number (Shi, Yang, Carlone, *ROBIN*, ICRA 2021; Lim et al., *KISS-Matcher*, ICRA
//!    2025).
//! 3. Rotation, from the differences of each kept point to the next, and of the last to the first: graduated
//!    non-convexity on truncated least squares, bound `2 beta` (section VII).
//! 4. Translation: the truncated mean of `p' - R p` by axis, bound beta (section V-B).
//! 5. The group: the kept ones with `p' - R p` within beta of the translation along each axis.
//!
//! Cost O(n^2) tests of pairs; the clique's search is exponential at worst, and bounded. Memory `n^2 / 8`
//! bytes.

mod rotation;
mod scale;
mod truncated_mean;

use nalgebra::{Matrix4, Point3, Vector3};

use super::GroupingMethod;
use crate::compatibility::graph::AgreementGraph;
use crate::compatibility::long_agreement::EdgeLengths;
use crate::consensus::cores::Cores;
use crate::consensus::maximum_clique::{Found, maximum_clique};
use crate::error::positive;
use crate::geometry::rigid::{Rigid, fixes_rotation};
use crate::grouping_result::mask_of;
use crate::options::{self, Value, method, words};
use crate::rule::{Agreement, Kind, Rule};
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};
use rotation::truncated_rotation;
use scale::{leaves_out, truncated_scale};
use truncated_mean::truncated_mean;

pub use rotation::Freedom;

/// A correspondence is not connected to itself or its duplicate, but to others of the same point.
const JOINED: EdgeLengths = EdgeLengths::SumAbove(0.0);

words! {
    /// The part of the graph that is kept.
    pub enum Prune {
        /// A maximum clique.
        Clique = Value::Word("clique"),
        /// The vertices of the greatest core number.
        Core = Value::Word("core"),
    }
}

words! {
    /// Prior knowledge of the scale.
    pub enum Scale {
        /// The scale is 1.
        Known = Value::Word("known"),
        /// The scale is unknown.
        Estimate = Value::Word("estimate"),
    }
}

/// Lower bound of the tolerance: its inverse square must be finite, and rounding hides smaller ones.
const LEAST_TOLERANCE: f64 = 1e-140;

/// Upper bound of the tolerance, whose square must be finite.
const MOST_TOLERANCE: f64 = 1e150;

/// Share of the extent up to which points beside a vertical line are on it.
const VERTICAL: f64 = 1e-9;

method! {
    /// Parameters of TEASER++.
    pub struct Teaser = "teaser", ["source", "target"], optional ["resolution"], {
        /// Bound on the error of a correct correspondence (beta), a length; default `2.5 * resolution`.
        pub tolerance: Option<f64> = None;
        /// Bound on `|ds - dt|` of connected correspondences, a length; default `2 * tolerance`.
        pub max_distance_difference: Option<f64> = None;
        /// Keep a maximum clique (TEASER++), or all in the core of the greatest core number (KISS-Matcher),
        /// which is faster if the noise is large, and keeps more wrong ones.
        pub prune: Prune = Prune::default();
        /// Degrees of freedom: 4 for a rotation about the z axis (Quatro, ICRA 2022); the z axes of both
        /// clouds must then be vertical.
        pub dof: Freedom = Freedom::default();
        /// Estimate a common factor of all lengths first, from `dt / ds` of all pairs. Above about 1,400
        /// correspondences a million pairs are used.
        pub scale: Scale = Scale::default();
        /// Most vertices coloured in the search for a maximum clique.
        pub max_steps: usize = 1_000_000, options::Kind::Rounds { least: 0 };
    }
}

impl GroupingMethod for Teaser {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("teaser")?;
        let bound =
            correspondences.length("tolerance", self.tolerance, 2.5)?.clamp(LEAST_TOLERANCE, MOST_TOLERANCE);
        let difference = self.max_distance_difference.unwrap_or(2.0 * bound);
        positive("max_distance_difference", difference)?;
        let scale = match self.scale {
            Scale::Known => Some(1.0),
            Scale::Estimate => truncated_scale(source, target, 2.0 * bound, execution)?,
        };
        let Some(scale) = scale else {
            // All source points coincide.
            return Ok(Grouping::empty(source.len())?.by(self.rule(bound, difference, 1.0)));
        };
        let scaled = source.scaled(scale)?;
        let graph = AgreementGraph::with_edges(&scaled, target, difference, JOINED, execution)?;
        let kept = self.keep(&graph, execution)?;
        let grouping = match fit(&kept.clique, &scaled, target, bound, self.dof)? {
            None => Grouping::empty(source.len())?,
            Some(Fit { pose, members }) => Grouping {
                mask: mask_of(source.len(), members)?,
                model: Some(model_of(&pose, scale, source, target)),
                ..Grouping::default()
            },
        };
        let grouping = grouping.by(self.rule(bound, difference, scale));
        let mut grouping = grouping.with("kept", kept.clique.len() as f64).with("steps", kept.steps as f64);
        let mut complete = kept.complete;
        if self.scale == Scale::Estimate {
            grouping = grouping.with("scale", scale);
            complete &= !leaves_out(source.len());
        }
        Ok(if complete { grouping } else { grouping.with("truncated", 1.0) })
    }
}

impl Teaser {
    fn rule(&self, bound: f64, difference: f64, scale: f64) -> Rule {
        let kind = match self.prune {
            Prune::Clique => Kind::AxesInClique,
            Prune::Core => Kind::AxesInCore,
        };
        let agreement = Agreement { least_sum: Some(0.0), scale, ..Agreement::difference(difference) };
        Rule::bounded(kind, bound).or_equal().agreeing(agreement)
    }

    /// Section IV: the kept part of the graph.
    fn keep(&self, graph: &AgreementGraph, execution: &Execution) -> Result<Found> {
        let cores = Cores::of(graph, execution)?;
        if self.prune == Prune::Clique {
            return maximum_clique(graph, &cores, self.max_steps, execution);
        }
        let greatest = cores.greatest();
        let core = (0..graph.len() as u32).filter(|&i| cores.numbers[i as usize] == greatest);
        Ok(Found { clique: memory::collect(core)?, complete: true, steps: 0 })
    }
}

/// A pose of the scaled source between the centred points, and the kept ones that are inliers of its
/// translation.
struct Fit {
    pose: Rigid,
    members: Vec<usize>,
}

/// Rotation and translation of the kept ones; `None` if they do not determine one.
fn fit(kept: &[u32], source: &Points, target: &Points, bound: f64, freedom: Freedom) -> Result<Option<Fit>> {
    let of = |points: &Points| memory::collect(kept.iter().map(|&i| points.get(i as usize)));
    let (p, q) = (of(source)?, of(target)?);
    let is_fixed = match freedom {
        Freedom::Six => fixes_rotation(&p, &q),
        Freedom::Four => !is_vertical(&p) && !is_vertical(&q),
    };
    if kept.len() < 3 || !is_fixed {
        return Ok(None);
    }
    let Some(rotation) = truncated_rotation(&steps(&p)?, &steps(&q)?, 2.0 * bound, freedom)? else {
        return Ok(None);
    };
    let shifts = memory::collect(p.iter().zip(&q).map(|(p, q)| q.coords - rotation * p.coords))?;
    let Some(translation) = truncated_translation(&shifts, bound)? else {
        return Ok(None);
    };
    let holds = |shift: &Vector3<f64>| (shift - translation).amax() <= bound;
    let members = kept.iter().zip(&shifts).filter(|(_, shift)| holds(shift)).map(|(&i, _)| i as usize);
    Ok(Some(Fit { pose: Rigid { rotation, translation }, members: memory::collect(members)? }))
}

/// Whether points are on a vertical line.
fn is_vertical(points: &[Point3<f64>]) -> bool {
    let mean = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let sizes =
        points.iter().map(|point| point.coords - mean).map(|offset| (offset.xy().amax(), offset.amax()));
    let (flat, extent) =
        sizes.fold((0.0_f64, 0.0_f64), |most, size| (most.0.max(size.0), most.1.max(size.1)));
    flat <= VERTICAL * extent
}

/// The truncated mean of each axis.
fn truncated_translation(shifts: &[Vector3<f64>], bound: f64) -> Result<Option<Vector3<f64>>> {
    let bounds = memory::filled(bound, shifts.len())?;
    let along =
        |axis: usize| truncated_mean(&memory::collect(shifts.iter().map(|shift| shift[axis]))?, &bounds);
    let (x, y, z) = (along(0)?, along(1)?, along(2)?);
    Ok(x.zip(y).zip(z).map(|((x, y), z)| Vector3::new(x, y, z)))
}

/// Differences of each point to the next, and of the last to the first: invariant to translation.
fn steps(points: &[Point3<f64>]) -> Result<Vec<Vector3<f64>>> {
    let next = points.iter().cycle().skip(1);
    memory::collect(points.iter().zip(next).map(|(point, next)| next - point))
}

/// The pose of the scaled source as a matrix for the source.
fn model_of(pose: &Rigid, scale: f64, source: &Points, target: &Points) -> Matrix4<f64> {
    let linear = pose.rotation * scale;
    let shift = pose.translation + target.center() - linear * source.center();
    let mut model = Matrix4::identity();
    model.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear);
    model.fixed_view_mut::<3, 1>(0, 3).copy_from(&shift);
    model
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `right` points rotated about z, scaled and shifted, then others moved randomly.
    fn problem(n: usize, right: usize, scale: f64) -> Result<Correspondences> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 100.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..n).map(|i| place(i, 1.0)).collect();
        let moved = |i: usize, p: &[f64; 3]| {
            if i < right { [7.0 - scale * p[1], scale * p[0], scale * p[2] - 5.0] } else { place(i, 0.7) }
        };
        let target: Vec<_> = source.iter().enumerate().map(|(i, p)| moved(i, p)).collect();
        Correspondences::new(&source, &target)?.with_resolution(1.0)
    }

    #[test]
    fn finds_the_moved_points_in_every_variant() -> Result<()> {
        for prune in [Prune::Core, Prune::Clique] {
            for (freedom, scale, factor) in [
                (Freedom::Six, Scale::Known, 1.0),
                (Freedom::Four, Scale::Known, 1.0),
                (Freedom::Six, Scale::Estimate, 3.0),
            ] {
                let method = Teaser { prune, dof: freedom, scale, ..Teaser::default() };
                let group = method.group(&problem(300, 60, factor)?, &Execution::default())?;
                assert!(group.mask[..60].iter().all(|&selected| selected) && group.size() < 63, "{method:?}");
                let model = group.model.unwrap_or_default();
                assert!(
                    (model[(0, 1)] + factor).abs() < 1e-3 && (model[(0, 3)] - 7.0).abs() < 0.1,
                    "{model}"
                );
                assert!(!group.diagnostics.contains_key("truncated"));
            }
        }
        Ok(())
    }

    #[test]
    fn a_search_cut_short_is_reported() -> Result<()> {
        let wide = Teaser {
            prune: Prune::Clique,
            max_distance_difference: Some(40.0),
            max_steps: 0,
            ..Teaser::default()
        };
        let group = wide.group(&problem(200, 40, 1.0)?, &Execution::default())?;
        assert_eq!(group.diagnostics.get("truncated"), Some(&1.0));
        Ok(())
    }

    #[test]
    fn too_few_or_coincident_points_give_no_group() -> Result<()> {
        for scale in [Scale::Known, Scale::Estimate] {
            let method = Teaser { scale, ..Teaser::default() };
            for n in 0..3 {
                let group = method.group(&problem(n, n, 1.0)?, &Execution::default())?;
                assert_eq!((group.size(), group.model), (0, None));
            }
            let rows = [[1.0; 3]; 50];
            let input = Correspondences::new(&rows, &rows)?.with_resolution(1.0)?;
            assert_eq!(method.group(&input, &Execution::default())?.model, None);
        }
        Ok(())
    }
}
