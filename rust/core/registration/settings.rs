//! Numbers of the registration, each with its unit and source.
//!
//! "Fitted" numbers come from generated worlds and half of the pairs of real scans, with whole kinds of data left out in turn
//! (`docs/registration-internals.md`). The others follow from the geometry that is stated beside them.

use std::f64::consts::FRAC_1_SQRT_2;

use crate::verification::alignment::{Course, FIRST_STEPS, LAST};

/// Unit of the surfaces and of the matches, in voxels: about the distance between neighbouring voxels' noise.
pub const UNIT: f64 = 0.4;
/// Radius of the planes of normals, in voxels, and the most neighbours of one.
pub const NORMAL_RADIUS: f64 = 2.0;
/// Most neighbours of a voxel's plane.
pub const NORMAL_NEIGHBORS: usize = 30;
/// Radius of a descriptor's support, in voxels.
pub const FEATURE_RADIUS: f64 = 5.0;
/// Most neighbours of a descriptor's support.
pub const FEATURE_NEIGHBORS: usize = 100;
/// Radius of the support of SHOT's frames, in voxels.
pub const FRAME_RADIUS: f64 = 8.0;
/// Spacings of the fine surfaces, in voxels: the first one at which both clouds have planes is used.
pub const FINE: [f64; 5] = [1.0 / 3.0, 2.0 / 3.0, 4.0 / 3.0, 8.0 / 3.0, 16.0 / 3.0];

/// Voxels of a search, as multiples of the prepared one: coarse, fine, finer; then those for clouds of few points, which leave it
/// to chance at which voxel the pose is found.
pub const FACTORS: [f64; 5] = [2.0, 1.0, FRAC_1_SQRT_2, 1.25, 0.8];
/// Row of the prepared voxel in [`FACTORS`].
pub const PREPARED: usize = 1;
/// Points of a cloud below which coarser voxels leave too few of them.
pub const FEW_POINTS: usize = 300;
/// Coarse voxels of either scan below which the search begins with finer ones.
pub const LEAST_COARSE: usize = 200;

/// Voxels below which a cloud is no surface.
pub const FEW_VOXELS: usize = 20;
/// Voxels beyond which matching each with all others takes more than some 20 seconds.
pub const MOST_VOXELS: usize = 100_000;
/// Share and number of the voxels with a normal, below which they are too far apart.
pub const LEAST_PLANES: f64 = 0.1;
/// See [`LEAST_PLANES`].
pub const LEAST_PLANAR_VOXELS: usize = 10;
/// Voxels below which unrelated clouds fit by chance.
pub const LEAST_VOXELS: usize = 100;

/// Largest residual of a match that agrees with a pose, in units.
pub const AGREEING: f64 = 2.5;
/// Poses kept after each stage of the race: of the proposals, and of the rivals.
pub const KEPT: ([usize; 3], [usize; 3]) = ([150, 40, 8], [30, 12, 6]);
/// Verified poses that are refined on the fine surfaces.
pub const FINALISTS: usize = 8;
/// The same near a rough pose.
pub const NEARBY_FINALISTS: usize = 3;
/// Rivals of the best pose that are compared with it, and that are searched for.
pub const RIVALS: usize = 6;
/// Finalists whose evidence is gathered before others are refined.
pub const FIRST_FINALISTS: usize = 2;
/// Poses of the mirrored source that are refined.
pub const DECOYS: usize = 4;
/// Refinement of a finalist that shows whether it may count.
pub const ROUGHLY: Course = Course { first_step: 0, last_step: FIRST_STEPS, samples: 150, still: 0.1 };
/// Refinement of the finalists that may count.
pub const CLOSELY: Course = Course { samples: 500, still: 0.02, ..LAST };
/// Last refinements of the best pose.
pub const FINALLY: [Course; 2] =
    [Course { samples: 1000, still: 0.01, ..LAST }, Course { last_step: FIRST_STEPS + 2, ..LAST }];
/// Largest share by which the misfit falls after the rough refinement.
pub const LESS_MISFIT: f64 = 0.3;
/// Nats by which a pose leads those that do not count: with the same evidence their shares are below 0.02.
pub const HOPELESS: f64 = 5.0;
/// Degrees by which a pose may tilt an axis that both clouds share.
pub const MAX_TILT: f64 = 10.0;

/// Probability from which a pose is accepted.
pub const ACCEPTED: f64 = 0.5;
/// The same for a pose with alternatives, of which the evidence can prefer a wrong one.
pub const ACCEPTED_WITH_RIVALS: f64 = 0.7;
/// Probability from which the search ends: at 0.7 a wrong coarse pose was accepted that the fine level refuses.
pub const SURE: f64 = 0.75;
/// Mean displacement of the source between two poses of one place, in prepared voxels.
pub const SAME_PLACE: f64 = 2.0;
/// Largest number of open motions of an accepted pose: along a corridor a pose is still useful.
pub const MOST_OPEN_MOTIONS: usize = 1;
/// Matches beyond which more of them add no evidence.
pub const MOST_MATCHES: usize = 20;
/// Least standard deviation of a surface's points from its planes, in voxels.
pub const LEAST_NOISE: f64 = 0.02;
/// Share in free space that noise and coarse rings explain. Fitted.
pub const CROSSED_BY_CHANCE: f64 = 0.02;
/// Largest share in free space of a pose that is found without viewpoints only: speckle of right poses explains 5.5 %.
pub const MOST_CROSSED: f64 = 0.07;
/// Planes that wrong poses align too: three fix a pose, and among boxes a fourth is found by chance.
pub const PLANES_BY_CHANCE: usize = 4;
/// Share of the evidence of the mirrored source's best surfaces that counts against a pose. Fitted.
pub const CHANCE_SHARE: f64 = 0.6;
/// Bounds of that evidence, in nats: that of no pose, and of the right pose of large scans.
pub const LEAST_CHANCE: f64 = -6.0;
/// See [`LEAST_CHANCE`].
pub const MOST_CHANCE: f64 = 14.0;
/// Nats that chance reaches at most if the scan is its own mirror image; with more, this is tested.
pub const CHANCE_OF_SYMMETRY: f64 = 1.8;
/// Misfit of a scan on its mirror image below which it is its own: it fits itself to its noise.
pub const MISFIT_OF_SYMMETRY: f64 = 2.0;
/// Nats by which e times as many matches raise the evidence, for a pose or for chance. Fitted.
pub const MATCHED: f64 = 1.35;
/// Misfit beyond which it counts twice: 9 of 10 right poses have less, similar shapes more. Fitted.
pub const MISFIT_OF_POSES: f64 = 4.5;
/// Nats of the best pose of a search if it is wrong, beyond those of the mirrored source's. Fitted.
pub const FOUND_BY_CHANCE: f64 = 0.6;
/// Largest number of further planes that count.
pub const MOST_FURTHER_PLANES: usize = 3;
/// Nats by which the best of equal poses leads. Fitted.
pub const LEAD_BY_CHANCE: f64 = 1.0;
/// Share of the best pose's probability from which another pose is an alternative.
pub const AS_GOOD: f64 = 0.3;
/// Least score of a pose: scores below it are equal.
pub const LEAST_SCORE: f64 = 1e-3;
/// Bound of exponents, in nats.
pub const MOST_NATS: f64 = 30.0;

/// Share of the resistance of all pairs up to which a motion may be open: planes whose normals are known to 5 degrees have
/// 0.008.
pub const OPEN: f64 = 0.01;
/// Remaining share of a displacement from which a motion is open.
pub const NOT_PULLED_BACK: f64 = 0.5;
/// Displacement along a motion, in voxels.
pub const DISPLACED: f64 = 1.0;
/// Samples of either surface that pull a displaced pose back: for the covariance, and for open motions.
pub const PULLING_SAMPLES: (usize, usize) = (300, 1000);
/// Refinements of a displaced pose: for the covariance, and for open motions.
pub const PULLING_ROUNDS: (usize, usize) = (1, 3);
/// Largest number of independent residuals. This and the next ones are chosen on generated worlds and on disjoint halves of scans,
/// whose poses are exact.
pub const INDEPENDENT: f64 = 5000.0;
/// Neighbouring residuals with equal errors, if there are few residuals.
pub const ALIKE: f64 = 0.75;
/// Least standard deviation of the residuals, in voxels.
pub const LEAST_DEVIATION: f64 = 0.01;
/// Weight of the remainders of displacements in the covariance.
pub const LEFT: f64 = 0.03;
/// Weight of the scatter of the blocks in the covariance.
pub const SCATTER: f64 = 3.0;
/// Least resistance of a motion in the covariance.
pub const LEAST_RESISTANCE: f64 = 1e-6;
