//! Final refinement of a pose: samples of each surface, with their local planes, are paired with points of
//! the other surface (point-to-plane in both directions; Chen and Medioni 1992).

use nalgebra::{Matrix6, Rotation3, Vector3, Vector6};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::verification::fine_surface::{FineSurface, REACH};
use crate::verification::overlap::Resistance;
use crate::verification::pairing::{Known, Pair};
use crate::verification::pose::nearest_rotation;

/// Number of first steps, in which the reach shrinks; most samples per surface in them; reach of the last
/// one, in spacings.
pub(crate) const FIRST_STEPS: usize = 5;
const FIRST_SAMPLES: usize = 1_000;
const LAST_REACH: f64 = 1.5;
/// With fewer pairs the pose is not changed.
const LEAST_PAIRS: usize = 20;
/// Tukey's constant: residuals beyond this many standard deviations have no weight.
const CUT: f64 = 4.685;
/// Standard deviation of a normal distribution per median absolute residual.
const PER_MEDIAN: f64 = 1.4826;
/// Lower bound of the standard deviation in spacings, for noise-free data.
const LEAST_DEVIATION: f64 = 1e-3;
/// Added to the diagonal, relative to its largest entry: suppresses motions that the surfaces do not
/// constrain.
const DAMPING: f64 = 1e-6;
/// The further steps, with all samples.
pub(crate) const LAST: Course =
    Course { first_step: FIRST_STEPS, last_step: FIRST_STEPS + 7, samples: usize::MAX, still: 5e-3 };

/// A refined pose and its residuals.
#[derive(Debug, Clone)]
pub struct Alignment {
    /// From the source's coordinates into the target's.
    pub pose: Rigid,
    /// Distance of each paired sample from its plane.
    pub residuals: Vec<f64>,
    /// Standard deviation of the points around each paired sample from its own plane.
    pub deviations: Vec<f64>,
    /// Number of samples of both surfaces, paired or not.
    pub samples: usize,
    /// Motions that the surfaces constrain.
    pub resistance: Resistance,
}

/// Refines a pose that is accurate to one or two spacings, with at most `samples` samples of each surface.
///
/// # Errors
/// [`Error::InvalidInput`] unless both surfaces have the same spacing; [`Error::Interrupted`],
/// [`Error::OutOfMemory`].
pub fn align(
    source: &FineSurface,
    target: &FineSurface,
    pose: &Rigid,
    samples: usize,
    execution: &Execution,
) -> Result<Alignment> {
    let first =
        Course { first_step: 0, last_step: FIRST_STEPS, samples: samples.min(FIRST_SAMPLES), still: 0.0 };
    align_by(source, target, pose, &[first, Course { samples, ..LAST }], execution)
}

/// Part of a refinement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    /// First of the steps; the reach shrinks in steps 0 to 4.
    pub first_step: usize,
    /// End of the steps.
    pub last_step: usize,
    /// Most samples of each surface.
    pub samples: usize,
    /// Displacement of the surface, in spacings, that ends the steps.
    pub still: f64,
}

/// Refines a pose, as [`align`] does, by other courses.
///
/// # Errors
/// As for [`align`].
pub fn align_by(
    source: &FineSurface,
    target: &FineSurface,
    pose: &Rigid,
    courses: &[Course],
    execution: &Execution,
) -> Result<Alignment> {
    check_spacings(source, target)?;
    let samples = courses.last().map_or(0, |last| last.samples);
    let a = target.spacing();
    let radius = source.radius().max(target.radius()) / a;
    let mut pose = source.frame().pose_onto(target.frame(), pose);
    let mut known = Known::new(source, target, samples)?;
    for course in courses {
        for step in course.first_step..course.last_step {
            let share = (step as f64 / FIRST_STEPS as f64).min(1.0);
            let reach = REACH + (LAST_REACH - REACH) * share;
            let pairs = known.pair(source, target, &pose, reach, course.samples, execution)?;
            let Some(motion) = solve(&equations(&pairs, reach)?) else { break };
            let (turn, shift) =
                (motion.fixed_rows::<3>(0).into_owned(), motion.fixed_rows::<3>(3).into_owned());
            pose = followed_by(&pose, turn, shift * a);
            if turn.norm() * radius + shift.norm() < course.still {
                break;
            }
        }
    }
    pose.rotation = nearest_rotation(&pose.rotation);
    let pairs = known.pair(source, target, &pose, REACH, samples, execution)?;
    let sums = equations(&pairs, LAST_REACH)?;
    Ok(Alignment {
        pose: source.frame().pose_in_data(target.frame(), &pose),
        residuals: memory::collect(pairs.iter().map(|pair| pair.residual * a))?,
        deviations: memory::collect(pairs.iter().map(|pair| pair.deviation))?,
        samples: source.samples(samples).len() + target.samples(samples).len(),
        resistance: Resistance::new(&sums.matrix, sums.weight, radius, a, target.frame()),
    })
}

/// Returns the covariance of the motion about a point of the target's data that refines a pose, from the scatter of what the blocks of
/// a grid of cubes about that point, along the target's own axes, contribute to it.
///
/// `B / (B - 1) H^-1 (sum_b g_b g_b^T) H^-1`: H the matrix of a point-to-plane step, `g_b` the sum of the weighted residuals of
/// block b, B the number of blocks (K.-Y. Liang, S. Zeger, *Longitudinal data analysis using generalized linear models*, Biometrika
/// 1986). Residuals of one block may be correlated. Zero for fewer than 20 pairs.
///
/// # Errors
/// As for [`align`].
pub fn scatter_of_blocks(
    source: &FineSurface,
    target: &FineSurface,
    pose: &Rigid,
    (middle, block): (&Vector3<f64>, f64),
    execution: &Execution,
) -> Result<Matrix6<f64>> {
    check_spacings(source, target)?;
    let (a, frame) = (target.spacing(), target.frame());
    let own = source.frame().pose_onto(frame, pose);
    let pairs =
        Known::new(source, target, usize::MAX)?.pair(source, target, &own, REACH, usize::MAX, execution)?;
    let mut matrix = Matrix6::zeros();
    let mut parts = memory::collect(weighted(&pairs, LAST_REACH)?.map(|(pair, weight)| {
        let place = (frame.in_data(&(pair.place * a)) - middle) / block;
        let row = motion_row(&place, &frame.axes.tr_mul(&pair.normal));
        matrix.ger(weight, &row, &row, 1.0);
        ((frame.axes * place).map(|part| part.floor() as i64).into(), row * (weight * pair.residual * a))
    }))?;
    parts.sort_by_key(|&(block, _): &([i64; 3], Vector6<f64>)| block);
    let (mut scatter, mut blocks) = (Matrix6::zeros(), 0.0);
    for part in parts.chunk_by(|one, other| one.0 == other.0) {
        let sum = part.iter().map(|(_, part)| part).sum::<Vector6<f64>>();
        scatter.ger(1.0, &sum, &sum, 1.0);
        blocks += 1.0;
    }
    let damped = matrix + Matrix6::identity() * (DAMPING * matrix.diagonal().max());
    let Some(inverse) = damped.try_inverse().filter(|_| pairs.len() >= LEAST_PAIRS && blocks > 1.0) else {
        return Ok(Matrix6::zeros());
    };
    let scale = Matrix6::from_diagonal(&Vector6::from_fn(|row, _| if row < 3 { 1.0 / block } else { 1.0 }));
    Ok(scale * inverse * scatter * inverse * scale * (blocks / (blocks - 1.0)))
}

/// Returns the distance of the target's nearest point from the plane of each source sample under the pose;
/// NaN without a point within 3 spacings.
///
/// # Errors
/// As for [`align`].
pub fn plane_distances(
    source: &FineSurface,
    target: &FineSurface,
    pose: &Rigid,
    execution: &Execution,
) -> Result<Vec<f64>> {
    plane_distances_of(source, target, pose, |_| true, execution)
}

/// Returns the distances of [`plane_distances`] for some of the samples; NaN for the others.
///
/// # Errors
/// As for [`align`].
pub fn plane_distances_of(
    source: &FineSurface,
    target: &FineSurface,
    pose: &Rigid,
    is_asked: impl Fn(usize) -> bool + Sync,
    execution: &Execution,
) -> Result<Vec<f64>> {
    check_spacings(source, target)?;
    let (pose, search) = (source.frame().pose_onto(target.frame(), pose), target.search());
    let distances = source.samples(usize::MAX).par_iter().enumerate().map(|(row, sample)| {
        execution.check()?;
        if !is_asked(row) {
            return Ok(f64::NAN);
        }
        let normal = pose.rotation * sample.normal;
        let nearest = search.nearest(&pose.apply(&sample.point));
        Ok(nearest.offset().map_or(f64::NAN, |offset| offset.dot(&normal).abs()))
    });
    memory::par_try_collect(distances)
}

fn check_spacings(source: &FineSurface, target: &FineSurface) -> Result<()> {
    let (a, b) = (source.spacing(), target.spacing());
    if (a - b).abs() > 1e-9 * a.max(b) {
        let remedy = "make both surfaces with the same spacing";
        return Err(Error::invalid("source, target", format!("surfaces of spacing {a} and {b}"), remedy));
    }
    Ok(())
}

/// Composes a pose with a small motion, given as a rotation vector and a translation.
fn followed_by(pose: &Rigid, turn: Vector3<f64>, shift: Vector3<f64>) -> Rigid {
    let turn = Rotation3::new(turn).into_inner();
    Rigid { rotation: turn * pose.rotation, translation: turn * pose.translation + shift }
}

/// The normal equations of one step: `A x = b` with x a rotation vector and a translation.
struct Equations {
    matrix: Matrix6<f64>,
    right: Vector6<f64>,
    weight: f64,
    pairs: usize,
}

/// Sums the pairs within reach, weighted by their distance and by Tukey's function of their residual.
fn equations(pairs: &[Pair], reach: f64) -> Result<Equations> {
    let mut sums = Equations { matrix: Matrix6::zeros(), right: Vector6::zeros(), weight: 0.0, pairs: 0 };
    sums.pairs = pairs.iter().filter(|pair| pair.squared_distance < reach * reach).count();
    for (pair, weight) in weighted(pairs, reach)? {
        let row = motion_row(&pair.place, &pair.normal);
        sums.matrix.ger(weight, &row, &row, 1.0);
        sums.right.axpy(-weight * pair.residual, &row, 1.0);
        sums.weight += weight;
    }
    Ok(sums)
}

/// Returns the pairs within reach that have a weight.
fn weighted(pairs: &[Pair], reach: f64) -> Result<impl Iterator<Item = (&Pair, f64)>> {
    let square = reach * reach;
    let near = pairs.iter().filter(move |pair| pair.squared_distance < square);
    let cut = CUT * standard_deviation(near.clone())?;
    Ok(near.filter_map(move |pair| {
        let share = pair.residual / cut;
        let weight = (1.0 - pair.squared_distance / square) * (1.0 - share * share).powi(2);
        (share.abs() < 1.0).then_some((pair, weight))
    }))
}

/// Returns the derivative of a residual by a motion, a rotation vector and a translation.
fn motion_row(place: &Vector3<f64>, normal: &Vector3<f64>) -> Vector6<f64> {
    let turn = place.cross(normal);
    Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z)
}

/// Robust standard deviation of the residuals, from their median.
fn standard_deviation<'a>(pairs: impl Iterator<Item = &'a Pair>) -> Result<f64> {
    let mut sizes = memory::collect(pairs.map(|pair| pair.residual.abs()))?;
    let middle = sizes.len() / 2;
    if sizes.is_empty() {
        return Ok(LEAST_DEVIATION);
    }
    Ok((PER_MEDIAN * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1).max(LEAST_DEVIATION))
}

fn solve(equations: &Equations) -> Option<Vector6<f64>> {
    if equations.pairs < LEAST_PAIRS {
        return None;
    }
    let damping = DAMPING * equations.matrix.diagonal().max();
    let motion = (equations.matrix + Matrix6::identity() * damping).cholesky()?.solve(&equations.right);
    motion.iter().all(|number| number.is_finite()).then_some(motion)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3};

    use super::*;
    use crate::points::Points;

    /// A wavy height field of 40 x 40 points, 1 apart, that no motion maps onto itself.
    fn waves() -> Vec<[f64; 3]> {
        let height = |x: f64, y: f64| 2.0 * (0.31 * x).sin() * (0.23 * y).cos() + (0.11 * x * y / 10.0).sin();
        let place = |i: u32| (f64::from(i % 40), f64::from(i / 40));
        (0..1600).map(place).map(|(x, y)| [x, y, height(x, y)]).collect()
    }

    fn surface(rows: &[[f64; 3]]) -> Result<FineSurface> {
        FineSurface::new(&Points::from_rows("points", rows)?, 1.0, &Execution::default())
    }

    fn moved(rows: &[[f64; 3]], pose: &Rigid) -> Vec<[f64; 3]> {
        rows.iter().map(|&row| pose.apply(&Point3::from(row)).coords.into()).collect()
    }

    fn motion(turn: Vector3<f64>, shift: Vector3<f64>) -> Rigid {
        Rigid { rotation: Rotation3::new(turn).into_inner(), translation: shift }
    }

    #[test]
    fn a_small_motion_is_undone() -> Result<()> {
        let (rows, execution) = (waves(), Execution::default());
        let away = motion(Vector3::new(0.01, -0.02, 0.01), Vector3::new(0.4, 0.3, -0.5));
        let (source, target) = (surface(&rows)?, surface(&moved(&rows, &away))?);
        let found =
            align(&source, &target, &motion(Vector3::zeros(), Vector3::zeros()), usize::MAX, &execution)?;
        // The rotated cloud falls into other voxels: the planes agree to a fraction of the noise.
        assert!((found.pose.rotation - away.rotation).amax() < 2e-3);
        assert!((found.pose.translation - away.translation).amax() < 0.05);
        assert!(found.resistance.open_motion.is_none());
        assert!(found.residuals.len() > 9 * found.samples / 10);
        Ok(())
    }

    #[test]
    fn a_cloud_on_itself_is_not_moved() -> Result<()> {
        let surface = surface(&waves())?;
        let still = motion(Vector3::zeros(), Vector3::zeros());
        let found = align(&surface, &surface, &still, usize::MAX, &Execution::default())?;
        assert!((found.pose.rotation - Matrix3::identity()).amax() < 1e-3);
        assert_eq!(found.residuals.len(), found.samples);
        assert_eq!(found.residuals.len(), found.deviations.len());
        Ok(())
    }

    #[test]
    fn blocks_scatter_as_far_as_they_contradict_each_other() -> Result<()> {
        let (rows, execution) = (waves(), Execution::default());
        let still = motion(Vector3::zeros(), Vector3::zeros());
        let shift = |row: &[f64; 3]| if row[0] < 20.0 { 0.1 } else { -0.1 };
        let bent: Vec<[f64; 3]> = rows.iter().map(|row| [row[0], row[1], row[2] + shift(row)]).collect();
        let (one, other) = (surface(&rows)?, surface(&bent)?);
        let blocks = (&Vector3::new(19.5, 19.5, 0.0), 20.0);
        let itself = scatter_of_blocks(&one, &one, &still, blocks, &execution)?;
        assert!(itself.amax() < 1e-6);
        // Two to eight blocks have a mean of 0.1 or -0.1.
        let found = scatter_of_blocks(&one, &other, &still, blocks, &execution)?;
        assert!((1e-4..1e-2).contains(&found[(5, 5)]));
        let far = motion(Vector3::zeros(), Vector3::repeat(1e3));
        assert!(scatter_of_blocks(&one, &other, &far, blocks, &execution)?.amax().abs() < f64::EPSILON);
        Ok(())
    }

    #[test]
    fn distances_are_from_the_planes_of_the_samples() -> Result<()> {
        let surface = surface(&waves())?;
        let away = |shift: f64| {
            let pose = motion(Vector3::zeros(), Vector3::new(0.0, 0.0, shift));
            plane_distances(&surface, &surface, &pose, &Execution::default())
        };
        let mean = |distances: Vec<f64>| distances.iter().sum::<f64>() / distances.len() as f64;
        assert!(mean(away(0.0)?) < 0.15);
        assert!((0.6..1.0).contains(&mean(away(1.0)?)));
        assert!(away(20.0)?.iter().all(|distance| distance.is_nan()));
        Ok(())
    }

    #[test]
    fn a_pose_in_single_precision_becomes_a_rotation() -> Result<()> {
        let surface = surface(&waves())?;
        let turn = Rotation3::new(Vector3::new(0.3, 0.2, 0.1)).into_inner().map(|x| f64::from(x as f32));
        let away = Rigid { rotation: turn * (1.0 + 1e-7), translation: Vector3::repeat(1e3) };
        let found = align(&surface, &surface, &away, usize::MAX, &Execution::default())?;
        let product = found.pose.rotation * found.pose.rotation.transpose();
        assert!((product - Matrix3::identity()).amax() < 1e-14);
        Ok(())
    }

    #[test]
    fn residuals_are_weighted_by_tukeys_function() -> Result<()> {
        let pair = |residual: f64| Pair {
            place: Vector3::x(),
            normal: Vector3::z(),
            residual,
            squared_distance: 0.19,
            deviation: 0.0,
        };
        // The median is 0.1, the bound 4.685 * 1.4826 * 0.1 = 0.695.
        let pairs = [0.1, -0.1, 0.1, 0.5, 0.7].map(pair);
        assert!((standard_deviation(pairs.iter())? - 0.14826).abs() < 1e-12);
        let tukey = |residual: f64| (1.0 - (residual / (CUT * 0.14826)).powi(2)).powi(2);
        let sums = equations(&pairs, 1.0)?;
        assert!((sums.weight - 0.81 * (3.0 * tukey(0.1) + tukey(0.5))).abs() < 1e-12);
        assert!((sums.right[5] + 0.81 * (0.1 * tukey(0.1) + 0.5 * tukey(0.5))).abs() < 1e-12);
        assert!((sums.matrix[(1, 1)] - sums.weight).abs() < 1e-12);
        assert!((standard_deviation([].iter())? - LEAST_DEVIATION).abs() < f64::EPSILON);
        Ok(())
    }

    #[test]
    fn few_pairs_leave_the_pose_as_it_is() -> Result<()> {
        let surface = surface(&waves())?;
        let away = motion(Vector3::new(0.1, 0.2, 0.3), Vector3::repeat(1e3));
        let found = align(&surface, &surface, &away, usize::MAX, &Execution::default())?;
        assert!((found.pose.rotation - away.rotation).amax() < 1e-12);
        assert!((found.pose.translation - away.translation).amax() < 1e-9);
        assert!(found.residuals.is_empty());
        Ok(())
    }

    #[test]
    fn other_spacings_and_interrupts_end_it() -> Result<()> {
        let surface = surface(&waves())?;
        let other = FineSurface::new(&Points::from_rows("points", &waves())?, 1.1, &Execution::default())?;
        let still = motion(Vector3::zeros(), Vector3::zeros());
        assert!(align(&surface, &other, &still, usize::MAX, &Execution::default()).is_err());
        let interrupted = Execution::default();
        interrupted.interrupt();
        assert!(matches!(
            align(&surface, &surface, &still, usize::MAX, &interrupted),
            Err(Error::Interrupted)
        ));
        Ok(())
    }
}
