//! Votes of many correspondences on one, several at a time; every vote is that of
//! [`distance_ratio`](super::distance::distance_ratio) and [`residual`](super::consistency::residual).

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]
#![expect(clippy::needless_bitwise_bool, reason = "`&&` is a branch, which stops vectorisation")]

use super::kernels::{dispatch, squared_residual};
use crate::geometry::rigid::Rigid;
use crate::points::Points;

/// Voters that are looked at together.
const LANES: usize = 8;

/// Both points of a correspondence: x, y, z of the source, then of the target.
pub type PointPair = [f64; 6];

/// Both points of every correspondence.
pub fn point_pairs(source: &Points, target: &Points) -> Vec<PointPair> {
    let sides = source.rows().into_iter().zip(target.rows());
    sides.map(|([x, y, z], [u, v, w])| [x, y, z, u, v, w]).collect()
}

/// The test `rho_ij > sigma`.
#[derive(Debug, Clone, Copy)]
pub struct RigidityTest {
    /// Length up to which an edge counts as zero, in the source.
    pub zero_source: f64,
    /// The same in the target.
    pub zero_target: f64,
    /// sigma, not negative.
    pub min_ratio: f64,
}

impl RigidityTest {
    /// Whether `min(ds/dt, dt/ds) > sigma`, given the squares of `ds` and `dt`.
    #[inline(always)]
    fn passes(&self, squared_ds: f64, squared_dt: f64) -> bool {
        let (ds, dt) = (squared_ds.sqrt(), squared_dt.sqrt());
        let (shorter, longer) = if ds < dt { (ds, dt) } else { (dt, ds) };
        // Zero length stands for coincident points, which support nothing.
        (ds > self.zero_source) & (dt > self.zero_target) & (shorter / longer > self.min_ratio)
    }
}

/// Correspondences in groups of [`LANES`], as a struct of arrays. What is left over of the last group has an
/// infinitely distant target, which fails every test.
#[derive(Debug, Clone, Default)]
pub struct Voters {
    len: usize,
    groups: Vec<[[f64; LANES]; 6]>,
}

impl Voters {
    /// The voters with these indices.
    pub fn new(pairs: &[PointPair], indices: impl ExactSizeIterator<Item = usize>) -> Self {
        let mut voters = Self::default();
        voters.fill(pairs, indices);
        voters
    }

    /// Replaces the voters.
    #[inline(always)]
    pub fn fill(&mut self, pairs: &[PointPair], indices: impl ExactSizeIterator<Item = usize>) {
        const NOBODY: [[f64; LANES]; 6] =
            [[0.0; LANES], [0.0; LANES], [0.0; LANES], [f64::INFINITY; LANES], [0.0; LANES], [0.0; LANES]];
        self.len = indices.len();
        self.groups.clear();
        self.groups.resize(self.len.div_ceil(LANES), NOBODY);
        for (place, index) in indices.enumerate() {
            let group = &mut self.groups[place / LANES];
            for (axis, &coordinate) in group.iter_mut().zip(&pairs[index]) {
                axis[place % LANES] = coordinate;
            }
        }
    }

    /// Number of voters.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// How many voters j have `rho_ij > sigma` with the correspondence `i`.
    pub fn count_rigid(&self, i: &PointPair, test: &RigidityTest) -> usize {
        dispatch(
            #[inline(always)]
            || self.groups.iter().map(|group| rigid(group, i, test).iter().sum::<u64>()).sum::<u64>(),
        ) as usize
    }

    /// How many of them also have `|R p_j + t - p'_j|^2 < limit`.
    pub fn count_carried(&self, i: &PointPair, test: &RigidityTest, pose: &Rigid, limit: f64) -> usize {
        let transform = by_rows(pose);
        dispatch(
            #[inline(always)]
            || {
                let mut count = 0;
                for group in &self.groups {
                    let carried = carried(group, &transform, limit);
                    // A wrong pose carries nobody along, and lengths are dear.
                    if carried.iter().fold(0, |any, vote| any | vote) != 0 {
                        let rigid = rigid(group, i, test);
                        count += carried.iter().zip(rigid).map(|(a, b)| a & b).sum::<u64>();
                    }
                }
                count
            },
        ) as usize
    }
}

/// The test of every voter of a group: 0 or 1.
#[inline(always)]
fn rigid(group: &[[f64; LANES]; 6], i: &PointPair, test: &RigidityTest) -> [u64; LANES] {
    let [sx, sy, sz, tx, ty, tz] = group;
    let mut votes = [0; LANES];
    for l in 0..LANES {
        let squared_ds = squared_norm([i[0] - sx[l], i[1] - sy[l], i[2] - sz[l]]);
        let squared_dt = squared_norm([i[3] - tx[l], i[4] - ty[l], i[5] - tz[l]]);
        votes[l] = u64::from(test.passes(squared_ds, squared_dt));
    }
    votes
}

#[inline(always)]
fn carried(group: &[[f64; LANES]; 6], transform: &[f64; 12], limit: f64) -> [u64; LANES] {
    let [sx, sy, sz, tx, ty, tz] = group;
    let mut votes = [0; LANES];
    for l in 0..LANES {
        let residual = squared_residual(transform, [sx[l], sy[l], sz[l]], [tx[l], ty[l], tz[l]]);
        votes[l] = u64::from(residual < limit);
    }
    votes
}

#[inline(always)]
fn squared_norm(v: [f64; 3]) -> f64 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

/// R by rows, then t.
fn by_rows(pose: &Rigid) -> [f64; 12] {
    let mut transform = [0.0; 12];
    transform[..9].copy_from_slice(pose.rotation.transpose().as_slice());
    transform[9..].copy_from_slice(pose.translation.as_slice());
    transform
}

/// The least number whose square root is not below `length`: `sqrt(s) < length` exactly where `s` is below it.
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
