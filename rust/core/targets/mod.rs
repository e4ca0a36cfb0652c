//! The pose of surveyed targets by least squares, and tests that name blunders.
//!
//! W. Baarda's data snooping (*A testing procedure for use in geodetic networks*, 1968), extended to sets of
//! targets: the squared residuals that a set explains, beside those of the other targets, are a ratio of
//! variances.

mod variance_ratio;

use nalgebra::{Matrix3, Matrix6, Vector3};

use crate::error::{Error, Result, positive, shown};
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::geometry::singular::Singular;
use crate::memory;
use crate::points::{MAX_COORDINATE, Points};

use variance_ratio::VarianceRatio;

/// Probability of naming a blunder where there is none.
const NAMED: f64 = 0.001;
/// Probability of doubting where there is none.
const DOUBTED: f64 = 0.01;
/// Observations that a given sigma counts as; it is then right to 22 %.
const KNOWN: usize = 10;
/// Most targets.
const MOST_TARGETS: usize = 1000;
/// Most sets of one size that are tried.
const MOST_SUBSETS: usize = 5000;
/// Rounding errors of coordinates, as a share of the largest.
const ROUNDING: f64 = 1e-15;
/// Ratio of the second to the first variance of targets on one line.
const ON_A_LINE: f64 = 1e-12;
/// Standard deviations beside a line below which targets are almost on it.
const LINE: f64 = 20.0;
/// Ratio of squared residuals by which swapped axes or another unit are noticed.
const BETTER: f64 = 100.0;

const BOTH: &str = "source, target";

/// A doubt about a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Doubt {
    /// The targets agree if x and y of one frame are swapped.
    Swapped,
    /// The targets agree if the source is multiplied by [`TargetFit::unit`].
    Units,
    /// No blunder could be named among three targets.
    NoRedundancy,
    /// The residuals are larger than the given sigma explains.
    Residuals,
    /// The targets are almost on one line.
    Line,
    /// One of the suspects is a blunder.
    Suspects,
    /// A blunder is possible, but none is significant.
    Possible,
}

/// The pose of a source in the frame of surveyed targets, and tests of each.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetFit {
    /// Least-squares pose of the used targets.
    pub pose: Rigid,
    /// Covariance of (rotation vector, translation of the origin) in the target's frame, by Student's
    /// distribution.
    pub covariance: Matrix6<f64>,
    /// Target minus posed source, of each target.
    pub residuals: Vec<Vector3<f64>>,
    /// Distance of each target from its place by the pose of the other used ones; NaN if these fix none.
    pub leave_one_out: Vec<f64>,
    /// Targets of the pose.
    pub is_used: Vec<bool>,
    /// Named blunders.
    pub is_blunder: Vec<bool>,
    /// Targets among which is a blunder that cannot be named.
    pub is_suspect: Vec<bool>,
    /// Estimated standard deviation of a coordinate of the residuals.
    pub sigma: f64,
    /// Coordinates of the used targets beyond the six of the pose.
    pub redundancy: usize,
    /// Ratio of the target's distances to the source's.
    pub unit: f64,
    /// What is doubtful.
    pub doubts: Vec<Doubt>,
}

/// Estimates the pose of a source from surveyed targets, row by row, and names blunders.
///
/// `sigma` is the expected standard deviation of a coordinate of the residuals; it counts as ten
/// observations.
///
/// # Errors
/// [`Error::InvalidInput`] for other than three to 1000 targets, targets on one line, a sigma that is not
/// positive or beyond 1e150, and lengths whose covariance is not finite; [`Error::Interrupted`],
/// [`Error::OutOfMemory`].
pub fn fit_targets(
    source: &Points,
    target: &Points,
    sigma: Option<f64>,
    execution: &Execution,
) -> Result<TargetFit> {
    let (count, others) = (source.len(), target.len());
    if count != others || !(3..=MOST_TARGETS).contains(&count) {
        let got = format!("{count} and {others} targets");
        return Err(Error::invalid(BOTH, got, format!("give three to {MOST_TARGETS}, in both frames")));
    }
    if let Some(sigma) = sigma
        && positive("sigma", sigma)? > MAX_COORDINATE
    {
        return Err(Error::invalid("sigma", shown(sigma), "give at most 1e150, which can be squared"));
    }
    let fits = Fits::new(source, target, sigma, execution)?;
    if !fits.fit(0..count).is_fixed {
        let got = "targets on one line, about which the pose may rotate";
        return Err(Error::invalid(BOTH, got, "add one beside that line"));
    }
    let found = fits.report(fits.find_blunders()?, [source, target].map(Points::center))?;
    if !found.covariance.iter().all(|entry| entry.is_finite()) {
        let got = "lengths whose covariance is beyond the largest number";
        return Err(Error::invalid("source, target, sigma", got, "give all of them in one unit"));
    }
    Ok(found)
}

/// Least-squares pose of some targets, between the centred points.
struct Fit {
    pose: Rigid,
    /// Sum of the squared residuals.
    squares: f64,
    /// Whether the targets fix the pose: they are not on one line.
    is_fixed: bool,
}

/// A set of targets whose removal is significant.
struct Explanation {
    /// The set of the least squares, as places among the used targets.
    best: Vec<usize>,
    /// Number of sets of this size that explain the residuals as well.
    alike: usize,
    /// In how many of these each used target is.
    times: Vec<usize>,
}

/// Rows of the used targets, and what the tests found.
struct Blunders {
    used: Vec<usize>,
    is_blunder: Vec<bool>,
    is_suspect: Vec<bool>,
    /// Least probability of the squares that one more target explains.
    chance: f64,
}

/// Least-squares fits of subsets of the targets.
struct Fits<'a> {
    source: Vec<Vector3<f64>>,
    target: Vec<Vector3<f64>>,
    /// Observations that the given sigma counts as.
    known: usize,
    /// Its square.
    expected: f64,
    /// Variance of the rounding of coordinates.
    floor: f64,
    execution: &'a Execution,
}

impl<'a> Fits<'a> {
    fn new(source: &Points, target: &Points, sigma: Option<f64>, execution: &'a Execution) -> Result<Self> {
        let centred = |points: &Points| memory::collect(points.rows().map(Vector3::from));
        let largest = |points: &Points| {
            points.rows().map(|row| (Vector3::from(row) + points.center()).amax()).fold(0.0, f64::max)
        };
        Ok(Self {
            source: centred(source)?,
            target: centred(target)?,
            known: sigma.map_or(0, |_| KNOWN),
            expected: sigma.unwrap_or(0.0).powi(2),
            floor: (ROUNDING * largest(source).max(largest(target))).powi(2),
            execution,
        })
    }

    /// Fits some targets.
    fn fit(&self, rows: impl Iterator<Item = usize> + Clone) -> Fit {
        self.fit_changed(&self.source, rows)
    }

    /// Fits some targets with changed source points: the rotation maximizes `tr(R^T sum b a^T)`.
    fn fit_changed(&self, source: &[Vector3<f64>], rows: impl Iterator<Item = usize> + Clone) -> Fit {
        let pairs = rows.map(|row| (source[row], self.target[row]));
        let (mut count, mut middles) = (0.0, [Vector3::zeros(); 2]);
        for (p, q) in pairs.clone() {
            count += 1.0;
            middles[0] += p;
            middles[1] += q;
        }
        let [one, other] = middles.map(|sum| sum / count);
        let mut spread = Matrix3::zeros();
        pairs.clone().for_each(|(p, q)| spread.ger(1.0, &(q - other), &(p - one), 1.0));
        let parts = Singular::of(&spread);
        let rotation = parts.rotation();
        let pose = Rigid { rotation, translation: other - rotation * one };
        let squares = pairs.map(|(p, q)| (q - rotation * p - pose.translation).norm_squared()).sum();
        Fit { pose, squares, is_fixed: parts.values[1] > ON_A_LINE * parts.values[0] }
    }

    /// Target minus posed source.
    fn residual(&self, pose: &Rigid, row: usize) -> Vector3<f64> {
        self.target[row] - pose.rotation * self.source[row] - pose.translation
    }

    /// The variance of a coordinate of residuals, with the given one as `known` observations.
    fn variance(&self, squares: f64, redundancy: usize) -> f64 {
        (squares + self.known as f64 * self.expected) / (redundancy + self.known) as f64 + self.floor
    }

    /// Removes the smallest significant sets of targets until none is left, or another set explains as much.
    fn find_blunders(&self) -> Result<Blunders> {
        let count = self.source.len();
        let mut used = memory::collect(0..count)?;
        let [mut is_blunder, mut is_suspect] =
            memory::try_map([false; 2], |none| memory::filled(none, count))?;
        loop {
            let (found, chance) = self.find_set(&used)?;
            let Some(found) = found else {
                return Ok(Blunders { used, is_blunder, is_suspect, chance });
            };
            let mut is_clear = true;
            for (&row, &times) in used.iter().zip(&found.times) {
                is_blunder[row] |= times == found.alike;
                is_suspect[row] = times > 0 && times < found.alike;
                is_clear &= !is_suspect[row];
            }
            let mut place = 0..;
            used.retain(|_| place.next().is_some_and(|place| !found.best.contains(&place)));
            if !is_clear {
                return Ok(Blunders { used, is_blunder, is_suspect, chance: 1.0 });
            }
        }
    }

    /// The smallest significant set that no other of its size equals, or else the smallest one; and the least
    /// probability of the squares that one target explains.
    fn find_set(&self, used: &[usize]) -> Result<(Option<Explanation>, f64)> {
        let (mut first, mut chance, mut subsets) = (None, 1.0_f64, 1);
        let most = used.len().saturating_sub((self.source.len() / 2 + 1).max(3));
        let everything = self.fit(used.iter().copied()).squares;
        for size in 1..=most {
            subsets = subsets * (used.len() - size + 1) / size;
            if subsets > MOST_SUBSETS {
                break;
            }
            let sets = combinations(used.len(), size, subsets)?;
            let fits = memory::try_collect(sets.chunks_exact(size).map(|set| self.fit_without(used, set)))?;
            let fixed = (0..subsets).filter(|&set| fits[set].1);
            let Some(best) = fixed.min_by(|&a, &b| fits[a].0.total_cmp(&fits[b].0)) else { continue };
            let (least, redundancy) = (fits[best].0, 3 * (used.len() - size) - 6);
            let (noise, freedom) = (self.variance(least, redundancy), redundancy + self.known);
            let tail = |squares: f64, size: usize| {
                VarianceRatio::new(3 * size, freedom).tail((squares - least) / (3 * size) as f64 / noise)
            };
            // Corrected for the number of sets, and for that of sizes.
            let corrected = ((size - 1) as f64).exp2() * subsets as f64 * tail(everything, size);
            if size == 1 {
                chance = chance.min(corrected);
            }
            if corrected >= NAMED {
                continue;
            }
            let best = memory::copied(&sets[size * best..][..size])?;
            let mut found = Explanation { best, alike: 0, times: memory::filled(0, used.len())? };
            for (set, &(squares, _)) in sets.chunks_exact(size).zip(&fits) {
                if tail(squares, 1) >= DOUBTED {
                    found.alike += 1;
                    set.iter().for_each(|&place| found.times[place] += 1);
                }
            }
            if found.alike == 1 {
                return Ok((Some(found), chance));
            }
            first = first.or(Some(found));
        }
        Ok((first, chance))
    }

    /// Squares of the used targets without those at some places, and whether they fix the pose.
    fn fit_without(&self, used: &[usize], places: &[usize]) -> Result<(f64, bool)> {
        self.execution.check()?;
        let left = used.iter().enumerate().filter(|(place, _)| !places.contains(place));
        let fit = self.fit(left.map(|(_, &row)| row));
        Ok((fit.squares, fit.is_fixed))
    }

    /// Describes the fit of the used targets, in the data's coordinates.
    fn report(&self, found: Blunders, centers: [Vector3<f64>; 2]) -> Result<TargetFit> {
        let Blunders { used, is_blunder, is_suspect, chance } = found;
        let (count, fit) = (self.source.len(), self.fit(used.iter().copied()));
        let (redundancy, [center, target_center]) = (3 * used.len() - 6, centers);
        let (variance, freedom) = (self.variance(fit.squares, redundancy), (redundancy + self.known) as f64);
        let middle = used.iter().map(|&row| self.source[row]).sum::<Vector3<f64>>() / used.len() as f64;
        let (axes, squares) = principal(used.iter().map(|&row| self.source[row] - middle));
        let mut doubts = memory::with_capacity(6)?;
        doubts.extend(self.doubt(used.len(), redundancy, fit.squares)?);
        if squares[1].sqrt() < LINE * variance.sqrt() {
            doubts.push(Doubt::Line);
        }
        if is_suspect.contains(&true) {
            doubts.push(Doubt::Suspects);
        } else if chance < DOUBTED {
            doubts.push(Doubt::Possible);
        }
        let mut is_used = memory::filled(false, count)?;
        used.iter().for_each(|&row| is_used[row] = true);
        // About the middle of the used targets, turns about the principal axes and shifts are independent.
        let axes = fit.pose.rotation * axes;
        let [x, y, z]: [f64; 3] = squares.into();
        let turns = Matrix3::from_diagonal(&Vector3::new(1.0 / (y + z), 1.0 / (x + z), 1.0 / (x + y)));
        let mut cofactors = Matrix6::from_diagonal_element(1.0 / used.len() as f64);
        cofactors.fixed_view_mut::<3, 3>(0, 0).copy_from(&(axes * turns * axes.transpose()));
        let mut change = Matrix6::identity();
        let middle = target_center + fit.pose.rotation * middle + fit.pose.translation;
        change.fixed_view_mut::<3, 3>(3, 0).copy_from(&middle.cross_matrix());
        let translation = fit.pose.translation + target_center - fit.pose.rotation * center;
        Ok(TargetFit {
            pose: Rigid { translation, ..fit.pose },
            covariance: change * cofactors * change.transpose() * (variance * freedom / (freedom - 2.0)),
            residuals: memory::collect((0..count).map(|row| self.residual(&fit.pose, row)))?,
            leave_one_out: memory::try_collect((0..count).map(|row| self.leave_out(&used, row)))?,
            is_used,
            is_blunder,
            is_suspect,
            sigma: variance.sqrt(),
            redundancy,
            unit: self.unit(),
            doubts,
        })
    }

    /// The distance of a target from its place by the other used ones; NaN if these fix none.
    fn leave_out(&self, used: &[usize], row: usize) -> Result<f64> {
        self.execution.check()?;
        let fit = self.fit(used.iter().copied().filter(|&other| other != row));
        Ok(if fit.is_fixed { self.residual(&fit.pose, row).norm() } else { f64::NAN })
    }

    /// The ratio of the target's distances to the source's.
    fn unit(&self) -> f64 {
        let [one, other] =
            [&self.source, &self.target].map(|points| points.iter().map(Vector3::norm_squared).sum());
        f64::sqrt(other) / f64::sqrt(one)
    }

    /// What is doubtful about the frames, and about the squared residuals of the used targets.
    fn doubt(&self, used: usize, redundancy: usize, squares: f64) -> Result<impl Iterator<Item = Doubt>> {
        let unit = self.unit();
        let squares_of = |change: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| -> Result<f64> {
            let changed = memory::collect(self.source.iter().map(change))?;
            Ok(self.fit_changed(&changed, 0..changed.len()).squares)
        };
        let own = self.fit(0..self.source.len()).squares;
        let frames = if used > 3 && BETTER * squares_of(&|p| Vector3::new(p.y, p.x, p.z))? < own {
            Some(Doubt::Swapped)
        } else if used > 3 && BETTER * squares_of(&|p| p * unit)? < own {
            Some(Doubt::Units)
        } else {
            None
        };
        let ratio = squares / redundancy as f64 / (self.expected + self.floor);
        let too_large = self.known > 0 && VarianceRatio::new(redundancy, KNOWN).tail(ratio) < DOUBTED;
        let few = (used == 3 && self.known == 0).then_some(Doubt::NoRedundancy);
        Ok(frames.into_iter().chain(few).chain(too_large.then_some(Doubt::Residuals)))
    }
}

/// Principal axes of centred points, as columns, and the sum of squares along each, in descending order.
fn principal(points: impl Iterator<Item = Vector3<f64>> + Clone) -> (Matrix3<f64>, Vector3<f64>) {
    let mut scatter = Matrix3::zeros();
    points.clone().for_each(|p| scatter.ger(1.0, &p, &p, 1.0));
    let axes = Singular::of(&scatter).right;
    // Summed again along the axes: beside a line, the scatter's own values are mostly rounding.
    (axes, points.map(|p| axes.tr_mul(&p).map(|along| along * along)).sum())
}

/// The subsets of `size` of the numbers below `count`, one after the other in lexicographic order.
fn combinations(count: usize, size: usize, subsets: usize) -> Result<Vec<usize>> {
    let mut sets = memory::with_capacity(size * subsets)?;
    let mut set = memory::collect(0..size)?;
    loop {
        sets.extend_from_slice(&set);
        // The last number that may grow, and those after it as small as possible.
        let Some(place) = (0..size).rev().find(|&place| set[place] < count - size + place) else {
            return Ok(sets);
        };
        let next = set[place] + 1;
        set[place..].iter_mut().zip(next..).for_each(|(number, next)| *number = next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// Targets at pseudo-random places, in a site and posed with errors of about `sigma`.
    fn survey(count: usize, sigma: f64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>, Rigid) {
        let number = |i: usize| (12.9898 * i as f64 + 1.0).sin() * 43_758.545_3 % 1.0;
        let rotation = Rotation3::from_euler_angles(0.02, -0.05, 2.0).into_inner();
        let pose = Rigid { rotation, translation: Vector3::new(5e5, 5.3e6, 300.0) };
        let source: Vec<_> = (0..count).map(|i| [0, 1, 2].map(|k| 50.0 * number(3 * i + k))).collect();
        let error = |i: usize| Vector3::from([7, 8, 9].map(|k| 1.7 * sigma * number(1000 + 3 * i + k)));
        let target = source.iter().enumerate().map(|(i, &p)| pose.apply(&p.into()).coords + error(i));
        let target = target.map(Into::into).collect();
        (source, target, pose)
    }

    fn fit(source: &[[f64; 3]], target: &[[f64; 3]], sigma: Option<f64>) -> Result<TargetFit> {
        let points = [Points::from_rows("source", source)?, Points::from_rows("target", target)?];
        fit_targets(&points[0], &points[1], sigma, &Execution::default())
    }

    fn rows(mask: &[bool]) -> Vec<usize> {
        (0..mask.len()).filter(|&row| mask[row]).collect()
    }

    #[test]
    fn exact_targets_give_the_pose() -> Result<()> {
        let (source, target, pose) = survey(6, 0.0);
        let found = fit(&source, &target, None)?;
        assert!((found.pose.rotation - pose.rotation).amax() < 1e-10);
        assert!((found.pose.translation - pose.translation).amax() < 1e-8);
        assert!(found.sigma < 1e-8 && found.doubts.is_empty() && found.redundancy == 12);
        assert!(found.residuals.iter().all(|residual| residual.norm() < 1e-8));
        Ok(())
    }

    #[test]
    fn blunders_are_named() -> Result<()> {
        for blunders in [vec![], vec![3], vec![0, 5], vec![2, 6, 7]] {
            let (source, mut target, pose) = survey(12, 0.003);
            blunders.iter().for_each(|&row| target[row][row % 3] += 0.3 + 0.1 * row as f64);
            for sigma in [None, Some(0.003)] {
                let found = fit(&source, &target, sigma)?;
                assert_eq!(rows(&found.is_blunder), blunders);
                assert_eq!((rows(&found.is_suspect), found.doubts), (vec![], vec![]));
                assert_eq!(found.redundancy, 3 * (12 - blunders.len()) - 6);
                assert!((0.001..0.006).contains(&found.sigma), "{}", found.sigma);
                assert!((found.pose.apply(&source[0].into()) - pose.apply(&source[0].into())).norm() < 0.02);
                assert!(blunders.iter().all(|&row| found.leave_one_out[row] > 0.2));
            }
        }
        Ok(())
    }

    #[test]
    fn a_blunder_that_every_triangle_explains_is_a_suspect() -> Result<()> {
        let square = [[0.0, 0.0, 0.0], [50.0, 0.0, 0.001], [50.0, 50.0, 0.0], [0.0, 50.0, 0.002]];
        let mut lifted = square;
        lifted[2][2] += 0.5;
        let found = fit(&square, &lifted, Some(0.004))?;
        assert_eq!((rows(&found.is_blunder), rows(&found.is_suspect)), (vec![], vec![0, 1, 2, 3]));
        assert!(found.doubts.contains(&Doubt::Suspects));
        Ok(())
    }

    #[test]
    fn the_covariance_is_that_of_the_normal_equations() -> Result<()> {
        let (source, mut target, _) = survey(7, 0.003);
        target.iter_mut().for_each(|row| *row = [row[0] - 5e5, row[1] - 5.3e6, row[2]]);
        let found = fit(&source, &target, None)?;
        let mut normal = Matrix6::zeros();
        for point in &source {
            let turn = -found.pose.apply(&(*point).into()).coords.cross_matrix();
            let mut motion = nalgebra::Matrix3x6::zeros();
            motion.fixed_columns_mut::<3>(0).copy_from(&turn);
            motion.fixed_columns_mut::<3>(3).copy_from(&Matrix3::identity());
            normal += motion.transpose() * motion;
        }
        let product = normal * found.covariance / (found.sigma.powi(2) * 15.0 / 13.0);
        assert!((product - Matrix6::identity()).amax() < 1e-8, "{product}");
        Ok(())
    }

    #[test]
    fn doubts_are_found() -> Result<()> {
        let (source, target, _) = survey(8, 0.003);
        let doubts =
            |source: &[[f64; 3]], sigma| Ok::<_, Error>(fit(source, &target[..source.len()], sigma)?.doubts);
        assert_eq!(doubts(&source[..3], None)?, [Doubt::NoRedundancy]);
        assert_eq!(doubts(&source[..3], Some(0.005))?, []);
        assert_eq!(doubts(&source, Some(1e-4))?[0], Doubt::Residuals);
        let swapped: Vec<_> = source.iter().map(|&[x, y, z]| [y, x, z]).collect();
        assert_eq!(doubts(&swapped, None)?[0], Doubt::Swapped);
        let feet: Vec<_> = source.iter().map(|row| row.map(|x| x / 0.3048)).collect();
        assert_eq!(doubts(&feet, None)?[0], Doubt::Units);
        assert!((fit(&feet, &target, None)?.unit - 0.3048).abs() < 1e-4);
        let line: Vec<_> = (0..6).map(|i| [10.0 * f64::from(i), 0.01 * f64::from(i % 2), 0.0]).collect();
        let moved: Vec<_> =
            line.iter().zip(&target).map(|(p, q)| [p[0] + 1e-3 * (q[0] % 1.0), p[1], p[2]]).collect();
        assert!(fit(&line, &moved, Some(0.003))?.doubts.contains(&Doubt::Line));
        Ok(())
    }

    #[test]
    fn extreme_numbers_give_finite_results_or_an_error() {
        let (source, target, _) = survey(6, 0.003);
        let scaled = |rows: &[[f64; 3]], factor: f64| {
            rows.iter().map(|row| row.map(|x| x * factor)).collect::<Vec<_>>()
        };
        for sizes in
            [[1.0, 1.0], [1e-55, 1e-55], [1e140, 1e140], [1e-50, 1e140], [1e140, 1e-50], [1e-160, 1.0]]
        {
            for sigma in [None, Some(1e-300), Some(0.003), Some(1e150), Some(1e300)] {
                match fit(&scaled(&source, sizes[0]), &scaled(&target, sizes[1]), sigma) {
                    Ok(found) => {
                        let numbers =
                            found.covariance.iter().chain(&found.leave_one_out).chain([&found.sigma]);
                        assert!(
                            numbers.chain(found.residuals.iter().flatten()).all(|number| number.is_finite())
                        );
                        assert!(found.pose.to_matrix().iter().all(|number| number.is_finite()));
                    }
                    Err(error) => assert!(matches!(error, Error::InvalidInput { .. }), "{error}"),
                }
            }
        }
        assert!(fit(&scaled(&source, 1e140), &scaled(&target, 1e140), None).is_ok());
        let largest = fit(&scaled(&source, 1e151), &target, None);
        assert!(largest.is_err_and(|error| error.to_string().contains("beyond 1e150")));
    }

    #[test]
    fn what_fixes_no_pose_is_refused() {
        let (source, target, _) = survey(6, 0.003);
        let line: Vec<_> = (0..6).map(|i| [0.0, 3.0 * f64::from(i), 1.0]).collect();
        for (source, target, sigma, words) in [
            (&source[..2], &target[..2], None, "2 and 2 targets"),
            (&source[..], &target[..5], None, "6 and 5 targets"),
            (&line[..], &target[..], None, "on one line"),
            (&[[1.0; 3]; 6][..], &target[..], None, "on one line"),
            (&source[..], &target[..], Some(f64::NAN), "sigma: got NaN"),
            (&source[..], &target[..], Some(1e300), "sigma: got 1e300"),
        ] {
            let error = fit(source, target, sigma).err().map(|error| error.to_string()).unwrap_or_default();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn an_interruption_ends_the_search() -> Result<()> {
        let (source, target, _) = survey(6, 0.003);
        let points = [Points::from_rows("source", &source)?, Points::from_rows("target", &target)?];
        let execution = Execution::default();
        execution.interrupt();
        assert_eq!(fit_targets(&points[0], &points[1], None, &execution), Err(Error::Interrupted));
        Ok(())
    }

    #[test]
    fn subsets_are_in_lexicographic_order() -> Result<()> {
        let sets = combinations(4, 2, 6)?;
        assert_eq!(sets.as_chunks::<2>().0, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
        assert_eq!((combinations(3, 3, 1)?, combinations(3, 1, 3)?), (vec![0, 1, 2], vec![0, 1, 2]));
        Ok(())
    }
}
