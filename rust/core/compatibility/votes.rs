//! Votes of many correspondences for one, vectorized over the voters; each vote equals
//! [`distance_ratio`](super::distance::distance_ratio) and [`residual`](super::pose::residual).

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]
#![expect(clippy::needless_bitwise_bool, reason = "`&&` is a branch, which stops vectorisation")]

use crate::error::Result;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::points::Points;
use crate::simd;

/// Voters evaluated together.
const VOTER_GROUP: usize = 32;

/// Both points of a correspondence: x, y, z of the source, then of the target.
pub type PointPair = [f64; 6];

/// Both points of every correspondence.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn point_pairs(source: &Points, target: &Points) -> Result<Vec<PointPair>> {
    let pair = |i| {
        let (p, q) = (source.get(i), target.get(i));
        [p.x, p.y, p.z, q.x, q.y, q.z]
    };
    memory::collect((0..source.len()).map(pair))
}

/// The test `r(c_i, c_j) > varsigma` of Eq. (3) and (5), with the ratio of Eq. (12).
#[derive(Debug, Clone, Copy)]
pub struct RigidityTest {
    /// Length up to which an edge counts as zero, in the source.
    pub zero_source: f64,
    /// Length up to which an edge counts as zero, in the target.
    pub zero_target: f64,
    /// sigma, not negative.
    pub min_ratio: f64,
}

impl RigidityTest {
    /// Whether `min(ds/dt, dt/ds) > sigma`.
    #[inline(always)]
    fn passes(&self, i: &PointPair, j: &PointPair) -> bool {
        let ds = length([i[0] - j[0], i[1] - j[1], i[2] - j[2]]);
        let dt = length([i[3] - j[3], i[4] - j[4], i[5] - j[5]]);
        let (shorter, longer) = if ds < dt { (ds, dt) } else { (dt, ds) };
        // An edge of zero length has coincident ends, which support nothing.
        (ds > self.zero_source) & (dt > self.zero_target) & (shorter / longer > self.min_ratio)
    }
}

/// Correspondences as a struct of arrays. Unused lanes have targets at infinity, which fail every test.
type Group = [[f64; VOTER_GROUP]; 6];

/// Number of `voters` with `rho_ij > sigma` for correspondence `i`.
pub fn count_rigid(pairs: &[PointPair], voters: &[u32], i: &PointPair, test: &RigidityTest) -> usize {
    simd::run(
        #[inline(always)]
        || {
            let mut count = 0;
            for voters in voters.chunks(VOTER_GROUP) {
                let group = gather(pairs, voters);
                count += count_if(
                    &group,
                    #[inline(always)]
                    |j| test.passes(i, j),
                );
            }
            count
        },
    )
}

/// Correspondences that vote for all others by their poses.
#[derive(Debug, Clone)]
pub struct Voters(Vec<Group>);

impl Voters {
    /// Voters from the correspondences with these indices.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(pairs: &[PointPair], indices: &[u32]) -> Result<Self> {
        Ok(Self(memory::collect(indices.chunks(VOTER_GROUP).map(|indices| gather(pairs, indices)))?))
    }

    /// Number of voters j with `|R p_j + t - p'_j|^2 < limit` and `rho_ij > sigma`, Eq. (5).
    pub fn count_carried(&self, i: &PointPair, test: &RigidityTest, pose: &Rigid, limit: f64) -> usize {
        let transform = by_rows(pose);
        simd::run(
            #[inline(always)]
            || {
                let mut count = 0;
                for group in &self.0 {
                    // Under a wrong pose few voters pass the first test, and the second test is slower.
                    let carried = count_if(
                        group,
                        #[inline(always)]
                        |j| squared_miss(&transform, j) < limit,
                    );
                    if carried > 0 {
                        count += count_if(
                            group,
                            #[inline(always)]
                            |j| (squared_miss(&transform, j) < limit) & test.passes(i, j),
                        );
                    }
                }
                count
            },
        )
    }
}

/// At most [`VOTER_GROUP`] correspondences.
#[inline(always)]
fn gather(pairs: &[PointPair], indices: &[u32]) -> Group {
    let mut group = [[0.0; VOTER_GROUP]; 6];
    group[3][indices.len()..].fill(f64::INFINITY);
    for (lane, &index) in indices.iter().enumerate() {
        let pair = &pairs[index as usize];
        for k in 0..6 {
            group[k][lane] = pair[k];
        }
    }
    group
}

#[inline(always)]
fn count_if(group: &Group, test: impl Fn(&PointPair) -> bool) -> usize {
    let [sx, sy, sz, tx, ty, tz] = group;
    let mut count = 0_u64;
    for l in 0..VOTER_GROUP {
        count += u64::from(test(&[sx[l], sy[l], sz[l], tx[l], ty[l], tz[l]]));
    }
    count as usize
}

#[inline(always)]
fn length(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// `|R p_j + t - p'_j|^2`.
#[inline(always)]
fn squared_miss(transform: &[f64; 12], [x, y, z, u, v, w]: &PointPair) -> f64 {
    squared_residual(transform, [*x, *y, *z], [*u, *v, *w])
}

/// R by rows, then t.
fn by_rows(pose: &Rigid) -> [f64; 12] {
    let mut transform = [0.0; 12];
    transform[..9].copy_from_slice(pose.rotation.transpose().as_slice());
    transform[9..].copy_from_slice(pose.translation.as_slice());
    transform
}

/// The least number whose square root is at least `length`: `sqrt(s) < length` if and only if `s` is below
/// it.
pub fn square_limit(length: f64) -> f64 {
    let mut square = length * length;
    while square > 0.0 && square.sqrt() >= length {
        square = square.next_down();
    }
    while square.sqrt() < length {
        square = square.next_up();
    }
    square
}

/// `|R p + t - q|^2`; `transform` is R by rows, then t.
#[inline(always)]
fn squared_residual(transform: &[f64; 12], p: [f64; 3], q: [f64; 3]) -> f64 {
    let [r0, r1, r2, r3, r4, r5, r6, r7, r8, t0, t1, t2] = *transform;
    let x = r0 * p[0] + r1 * p[1] + r2 * p[2] + t0 - q[0];
    let y = r3 * p[0] + r4 * p[1] + r5 * p[2] + t1 - q[1];
    let z = r6 * p[0] + r7 * p[1] + r8 * p[2] + t2 - q[2];
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compatibility::distance::distance_ratio;
    use crate::compatibility::pose::residual;
    use nalgebra::{Rotation3, Vector3};

    struct Problem {
        source: Points,
        target: Points,
        pairs: Vec<PointPair>,
        test: RigidityTest,
    }

    impl Problem {
        fn new(source: &[[f64; 3]], target: &[[f64; 3]], min_ratio: f64) -> Result<Self> {
            let (source, target) =
                (Points::from_rows("source", source)?, Points::from_rows("target", target)?);
            let (zero_source, zero_target) = (source.zero_length(), target.zero_length());
            let test = RigidityTest { zero_source, zero_target, min_ratio };
            Ok(Self { pairs: point_pairs(&source, &target)?, source, target, test })
        }

        fn is_rigid(&self, i: usize, j: usize) -> bool {
            let (ds, dt) = (self.source.distance(i, j), self.target.distance(i, j));
            let RigidityTest { zero_source, zero_target, min_ratio } = self.test;
            distance_ratio(ds, dt, zero_source, zero_target) > min_ratio
        }

        fn check(&self, pose: &Rigid, tolerance: f64) -> Result<()> {
            let limit = square_limit(tolerance);
            for (i, pair) in self.pairs.iter().enumerate() {
                for voters in [0..self.pairs.len(), i..i + 1, 0..i % 70] {
                    let indices: Vec<u32> = voters.clone().map(|j| j as u32).collect();
                    let rigid = voters.clone().filter(|&j| self.is_rigid(i, j)).count();
                    assert_eq!(count_rigid(&self.pairs, &indices, pair, &self.test), rigid);
                    let is_carried = |j: usize| residual(pose, j, &self.source, &self.target) < tolerance;
                    let carried = voters.filter(|&j| is_carried(j) && self.is_rigid(i, j)).count();
                    let group = Voters::new(&self.pairs, &indices)?;
                    assert_eq!(group.count_carried(pair, &self.test, pose, limit), carried);
                }
            }
            Ok(())
        }
    }

    fn rigid(angles: [f64; 3], translation: [f64; 3]) -> Rigid {
        let rotation = Rotation3::from_scaled_axis(Vector3::from(angles)).into_inner();
        Rigid { rotation, translation: Vector3::from(translation) }
    }

    #[test]
    fn votes_are_those_of_the_scalar_tests() -> Result<()> {
        for (seed, noise) in [(1.0, 0.01), (2.0, 0.3), (3.0, 2.0)] {
            let wave = |i: i32, f: f64| (f64::from(i) * f + seed).sin();
            let source: Vec<_> = (0..130).map(|i| [1.1, 2.3, 3.7].map(|f| 9.0 * wave(i, f))).collect();
            let pose = rigid([0.3, seed, 0.1], [0.0; 3]);
            let moved = source.iter().map(|&p| pose.apply(&p.into()));
            let target: Vec<_> =
                moved.zip(0..).map(|(p, i)| [p.x + noise * wave(i, 7.7), p.y, p.z + noise]).collect();
            let problem = Problem::new(&source, &target, 0.9)?;
            problem.check(&pose, 0.8)?;
            problem.check(&rigid([0.5, 0.1, seed], [0.1, 0.0, 3.0]), 4.0)?;
        }
        Ok(())
    }

    #[test]
    fn ties_and_coincident_points_vote_as_in_the_scalar_tests() -> Result<()> {
        // Lattices have many ratios of exactly 1/2, and residuals of exactly 5.
        let lattice = |i: u32| [f64::from(i % 5), f64::from(i / 5 % 5), f64::from(i / 25 % 4)];
        let source: Vec<_> = (0..150).map(lattice).collect();
        let target: Vec<_> = (0..150).map(|i| lattice(i * 7 % 150).map(|x| 2.0 * x)).collect();
        for min_ratio in [0.0, 0.5, 1.0] {
            let problem = Problem::new(&source, &target, min_ratio)?;
            problem.check(&rigid([0.0; 3], [3.0, 4.0, 0.0]), 5.0)?;
            problem.check(&rigid([0.0; 3], [0.0; 3]), 1e300)?;
        }
        Ok(())
    }

    #[test]
    fn square_limit_decides_as_the_root_does() {
        let lengths = (1..1000).map(|i| f64::from(i).sin().abs() * 10.0);
        for length in lengths.chain([1.0, 5.0, 1e-300, 3e-162, 1e-154, 1e153, 1e200, f64::MAX]) {
            let limit = square_limit(length);
            assert!(limit.sqrt() >= length && limit.next_down().sqrt() < length, "{length}");
        }
    }
}
