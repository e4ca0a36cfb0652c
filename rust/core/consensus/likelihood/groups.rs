//! Correspondences grouped by vector lane for SIMD.

use nalgebra::Matrix3;

use crate::error::Result;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::simd::DOUBLES;

/// Source x, y, z, then target x, y, z, then the level of correspondences; unused lanes of the last group
/// have a level of -infinity.
pub type Group = [[f64; DOUBLES]; TERMS];
const TERMS: usize = 7;

/// The weight, then the rows of the rotation proposed by the frames: zeros without frames, which are far from
/// any pose.
pub type Detail = [[f64; DOUBLES]; 10];

/// Packs terms into groups.
pub fn in_groups(terms: impl ExactSizeIterator<Item = [f64; TERMS]>) -> Result<Vec<Group>> {
    pack(terms, f64::NEG_INFINITY)
}

/// Packs weights and rotations into groups.
pub fn details_in_groups(rotations: &[Option<Matrix3<f64>>], weights: &[f64]) -> Result<Vec<Detail>> {
    let detail = |(rotation, &weight): (&Option<Matrix3<f64>>, &f64)| {
        let rotation = rotation.unwrap_or_else(Matrix3::zeros);
        std::array::from_fn(|k| if k == 0 { weight } else { rotation[((k - 1) / 3, (k - 1) % 3)] })
    };
    pack(rotations.iter().zip(weights).map(detail), 0.0)
}

/// Unused lanes of the last group have `rest` as their last term.
fn pack<const N: usize>(
    rows: impl ExactSizeIterator<Item = [f64; N]>,
    rest: f64,
) -> Result<Vec<[[f64; DOUBLES]; N]>> {
    let mut empty = [[0.0; DOUBLES]; N];
    empty[N - 1] = [rest; DOUBLES];
    let mut groups = memory::filled(empty, rows.len().div_ceil(DOUBLES))?;
    for (i, row) in rows.enumerate() {
        let group = &mut groups[i / DOUBLES];
        (0..N).for_each(|k| group[k][i % DOUBLES] = row[k]);
    }
    Ok(groups)
}

/// The rows of some correspondences, in groups.
pub fn take<const N: usize>(
    groups: &[[[f64; DOUBLES]; N]],
    kept: &[usize],
    rest: f64,
) -> Result<Vec<[[f64; DOUBLES]; N]>> {
    pack(kept.iter().map(|&i| terms(groups, i)), rest)
}

/// The row of one correspondence.
pub fn terms<const N: usize>(groups: &[[[f64; DOUBLES]; N]], i: usize) -> [f64; N] {
    let group = &groups[i / DOUBLES];
    std::array::from_fn(|k| group[k][i % DOUBLES])
}

/// R by rows, then t.
pub fn by_rows(pose: &Rigid) -> [f64; 12] {
    let mut transform = [0.0; 12];
    transform[..9].copy_from_slice(pose.rotation.transpose().as_slice());
    transform[9..].copy_from_slice(pose.translation.as_slice());
    transform
}

/// `|R p + t - q|^2`.
#[inline(always)]
pub fn squared_residuals(transform: &[f64; 12], group: &Group) -> [f64; DOUBLES] {
    let [r0, r1, r2, r3, r4, r5, r6, r7, r8, t0, t1, t2] = *transform;
    let mut squares = [0.0; DOUBLES];
    for lane in 0..DOUBLES {
        let [x, y, z] = [group[0][lane], group[1][lane], group[2][lane]];
        let dx = r0 * x + r1 * y + r2 * z + t0 - group[3][lane];
        let dy = r3 * x + r4 * y + r5 * z + t1 - group[4][lane];
        let dz = r6 * x + r7 * y + r8 * z + t2 - group[5][lane];
        squares[lane] = dx * dx + dy * dy + dz * dz;
    }
    squares
}

/// Cosine of the angle between the pose and the rotations proposed by the frames: `(tr(R^T R_i) - 1) / 2`.
#[inline(always)]
pub fn cosines(transform: &[f64; 12], detail: &Detail) -> [f64; DOUBLES] {
    let mut traces = [0.0; DOUBLES];
    for k in 0..9 {
        for lane in 0..DOUBLES {
            traces[lane] += transform[k] * detail[k + 1][lane];
        }
    }
    traces.map(
        #[inline(always)]
        |trace| 0.5 * (trace - 1.0),
    )
}
