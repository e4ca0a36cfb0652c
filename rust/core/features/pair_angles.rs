//! The angles between two oriented points that FPFH counts, vectorized over the neighbours of one point.

#![expect(clippy::inline_always, reason = "must inherit the vector features of the surrounding loop")]

use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::geometry::angle::atan2;
use crate::geometry::ball_search::Ball;
use crate::simd;

/// Bins of each angle.
pub(super) const BINS: usize = 11;
/// Relative tolerance for numbers that are equal up to rounding, which must not decide: points with the same
/// neighbours have the same normal.
const TIE: f64 = 1e-6;
/// Pairs computed at once.
const LANES: usize = 16;

/// Concatenated histograms of theta, alpha and phi.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Counts {
    pub bins: [[u32; BINS]; 3],
    /// Number of pairs of two points with normals.
    pub pairs: u32,
    /// Number of pairs that have angles.
    counted: u32,
}

impl Counts {
    /// Counts pairs without angles as angles of zero.
    pub fn add_flat_pairs(&mut self) {
        let flat = self.pairs - self.counted;
        self.bins.iter_mut().for_each(|part| part[BINS / 2] += flat);
        self.counted = self.pairs;
    }
}

/// Lines to up to [`LANES`] neighbours, and the neighbours' normals, by coordinate.
struct Pairs {
    line: [[f64; LANES]; 3],
    normal: [[f64; LANES]; 3],
}

/// Counts the pairs of the point at `own` with the other points of its ball that have a normal.
pub(super) fn count(own: u32, ball: &Ball, normals: &[Vector3<f64>], counts: &mut Counts) {
    let normal = normals[own as usize];
    simd::run(
        #[inline(always)]
        || {
            let mut pairs = Pairs { line: [[0.0; LANES]; 3], normal: [[0.0; LANES]; 3] };
            let mut near = ball.offsets().iter().zip(ball.positions());
            // One call for all: the compiler does not vectorize a second one for the rest.
            while near.len() > 0 {
                let mut filled = 0;
                for (offset, &position) in near.by_ref() {
                    let other = &normals[position as usize];
                    for k in 0..3 {
                        pairs.line[k][filled] = offset[k];
                        pairs.normal[k][filled] = other[k];
                    }
                    filled += usize::from(position != own && !other.x.is_nan());
                    if filled == LANES {
                        break;
                    }
                }
                add(&pairs, filled, &normal, counts);
            }
        },
    );
}

/// Adds the first `filled` pairs: alpha = v.n', phi = u.d, theta = atan2(w.n', u.n') in the Darboux frame u =
/// n, v = d x u, w = u x v at the point whose normal is closer to the line d, at the own point on a tie.
/// Pairs of coincident points, and pairs whose line is parallel to that normal, have no angles.
#[inline(always)]
fn add(pairs: &Pairs, filled: usize, normal: &Vector3<f64>, counts: &mut Counts) {
    let mut bins = [[0.0; LANES]; 3];
    let mut squares = [0.0; LANES];
    for lane in 0..LANES {
        let d = [0, 1, 2].map(|k| pairs.line[k][lane]);
        let other = [0, 1, 2].map(|k| pairs.normal[k][lane]);
        let own = [normal.x, normal.y, normal.z];
        let (near, far) = (dot(own, d), dot(other, d));
        let is_other = near.abs() < far.abs() * (1.0 - TIE);
        // The sign of the line depends on the end it starts from.
        let u = [0, 1, 2].map(|k| if is_other { other[k] } else { own[k] });
        let n = [0, 1, 2].map(|k| if is_other { own[k] } else { other[k] });
        let sign = if is_other { -1.0 } else { 1.0 };
        let v = cross(d, u);
        let square = dot(v, v);
        let length = square.sqrt();
        let phi = sign * (if is_other { far } else { near }) / dot(d, d).sqrt();
        let alpha = sign * dot(v, n) / length;
        let (across, along) = (sign * dot(cross(u, v), n), dot(u, n) * length);
        // Opposite normals give pi, never -pi.
        let theta = atan2(if across.abs() <= TIE * along.abs() { 0.0 } else { across }, along);
        bins[0][lane] = (theta + PI) / (2.0 * PI);
        bins[1][lane] = 0.5 * (alpha + 1.0);
        bins[2][lane] = 0.5 * (phi + 1.0);
        squares[lane] = square;
    }
    for lane in 0..filled {
        // The weight avoids a branch that would be mispredicted; NaN is bin 0.
        let weight = u32::from(squares[lane] > 0.0);
        for (part, shares) in counts.bins.iter_mut().zip(&bins) {
            part[((shares[lane] * BINS as f64) as usize).min(BINS - 1)] += weight;
        }
        counts.counted += weight;
    }
    counts.pairs += filled as u32;
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
