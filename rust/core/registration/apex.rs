//! Apex and axis of a spinning scanner, fitted to lines along its rings.

use nalgebra::{Matrix3, Matrix5, Vector3, Vector5};

use crate::error::Result;
use crate::geometry::symmetric::eigen;
use crate::memory;
use crate::points::Points;

use super::motions::median;

/// Edge of the cells whose points are compared, in radii of the cloud; in clouds of more than `MANY` points, one in `ONE_IN`.
const CELL: f64 = 1.0 / 8.0;
const ONE_IN: u64 = 4;
const MANY: usize = 20_000;
/// Cells that are looked at, the fewest points of one, and the lines from one.
const CELLS: usize = 150;
const LEAST_IN_CELL: usize = 4;
const LINES: usize = 4;
/// Odd factor that mixes the number of a cell (2^64 over the golden ratio).
const FACTOR: u64 = 0x9E37_79B9_7F4A_7C15;
/// Longest step of the apex, in radii of the cloud.
pub const AWAY: f64 = 0.5;
/// Tukey's constant, standard deviations per median of a normal distribution, least deviation, damping.
const CUT: f64 = 4.685;
const PER_MEDIAN: f64 = 1.4826;
const LEAST_DEVIATION: f64 = 1e-9;
const DAMPING: f64 = 1e-9;
/// Rounds of the fit of the axis, and the share of the median beyond which a chord is no part of a ring.
const AXIS_ROUNDS: usize = 5;
const OFF_AXIS: f64 = 2.5;
const LEAST_OFF_AXIS: f64 = 1e-3;

/// A point and the one next to it.
pub type Chord = (Vector3<f64>, Vector3<f64>);

/// Position and axis of a scanner, and the deviation of lines from its cones.
#[derive(Debug, Clone, Copy)]
pub struct Apex {
    /// Position, in radii of the cloud from its middle.
    pub place: Vector3<f64>,
    /// Direction of the axis.
    pub axis: Vector3<f64>,
    /// Deviation, in radians.
    pub off: f64,
}

impl Apex {
    /// Returns the elevation of a point about the axis.
    pub fn upwards(&self, point: &Vector3<f64>) -> f64 {
        let ray = point - self.place;
        (ray.dot(&self.axis) / ray.norm().max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0).asin()
    }

    /// Returns two directions perpendicular to the axis and to each other.
    pub fn aside(&self) -> [Vector3<f64>; 2] {
        let one = self.axis.cross(&Vector3::ith(self.axis.iamin(), 1.0)).normalize();
        [one, self.axis.cross(&one)]
    }
}

/// Returns the direction perpendicular to the chords, without outliers.
pub fn axis_of(chords: &[Chord]) -> Result<Vector3<f64>> {
    let along = memory::collect(chords.iter().map(|(one, other)| (other - one).normalize()))?;
    let lowest = |most: f64, axis: &Vector3<f64>| {
        let mut scatter = Matrix3::zeros();
        for chord in along.iter().filter(|chord| chord.dot(axis).abs() <= most) {
            scatter.ger(1.0, chord, chord, 1.0);
        }
        eigen(&scatter).vectors[0]
    };
    let mut axis = lowest(f64::INFINITY, &Vector3::zeros());
    for _ in 0..AXIS_ROUNDS {
        let mut off = memory::collect(along.iter().map(|chord| chord.dot(&axis).abs()))?;
        axis = lowest((OFF_AXIS * median(&mut off)).max(LEAST_OFF_AXIS), &axis);
    }
    Ok(axis)
}

/// Fits apex and axis by Tukey's weights, so that both ends of each chord have the same elevation.
///
/// The residual is the angle between the chord and the cone of its ends, `(sin b - sin a) r / length`.
pub fn fit(chords: &[Chord], start: Apex, rounds: usize) -> Result<Apex> {
    let mut apex = start;
    for _ in 0..rounds {
        let ray = |end: &Vector3<f64>| {
            let ray = end - apex.place;
            let range = ray.norm().max(f64::MIN_POSITIVE);
            (ray / range, range)
        };
        let residual = |(one, other): &(Vector3<f64>, Vector3<f64>)| {
            let ((u, r), (v, q)) = (ray(one), ray(other));
            let scale = f64::midpoint(r, q) / (other - one).norm();
            (v.dot(&apex.axis) - u.dot(&apex.axis), scale)
        };
        let residuals = memory::collect(chords.iter().map(residual))?;
        let mut sizes = memory::collect(residuals.iter().map(|(off, scale)| (off * scale).abs()))?;
        let off = PER_MEDIAN * median(&mut sizes) + LEAST_DEVIATION;
        let aside = apex.aside();
        let (mut matrix, mut right) = (Matrix5::zeros(), Vector5::zeros());
        for ((one, other), (difference, scale)) in chords.iter().zip(residuals) {
            let weight = (1.0 - (difference * scale / (CUT * off)).powi(2)).max(0.0) * scale;
            let ((u, r), (v, q)) = (ray(one), ray(other));
            let (a, b) = (u.dot(&apex.axis), v.dot(&apex.axis));
            let by_place = (apex.axis - u * a) / r - (apex.axis - v * b) / q;
            let [x, y] = aside.map(|axis| (v - u).dot(&axis));
            let row = Vector5::new(by_place.x, by_place.y, by_place.z, x, y) * weight;
            matrix.ger(1.0, &row, &row, 1.0);
            right.axpy(-weight * difference, &row, 1.0);
        }
        let damping = DAMPING * matrix.trace() + f64::MIN_POSITIVE;
        let damped = matrix + Matrix5::identity() * damping;
        let Some(factor) = damped.cholesky() else { break };
        let mut change = factor.solve(&right);
        let length = change.fixed_rows::<3>(0).norm().max(f64::MIN_POSITIVE);
        change *= (AWAY / length).min(1.0);
        if change.iter().any(|entry| !entry.is_finite()) {
            break;
        }
        let axis = apex.axis + aside[0] * change[3] + aside[1] * change[4];
        apex = Apex { place: apex.place + change.fixed_rows::<3>(0), axis: axis.normalize(), off };
    }
    Ok(apex)
}

/// Returns lines between points next to each other, mostly along the rings if there are any; the unit is the radius of the cloud.
///
/// They are taken from cells all over the cloud: the nearest point of another is known if it is nearer than the faces of the cell.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn chords(points: &Points, radius: f64) -> Result<Vec<Chord>> {
    let per_length = 1.0 / (CELL * radius);
    let (low, _) = points.bounding_box();
    let along = |point: [f64; 3]| [0, 1, 2].map(|k| (point[k] - low[k]) * per_length);
    let one_in = if points.len() > MANY { ONE_IN } else { 1 };
    let chosen = points.rows().zip(0_u64..).filter_map(|(point, row)| {
        let [x, y, z] = along(point).map(|cell| cell as u64);
        let cell = (x ^ (y << 21) ^ (z << 42)).wrapping_mul(FACTOR) >> 32;
        u32::try_from(cell * one_in).is_ok().then_some(cell << 32 | row)
    });
    let mut chosen = memory::collect(chosen)?;
    chosen.sort_unstable();
    let cells = chosen.chunk_by(|one, other| one >> 32 == other >> 32);
    let mut chords = Vec::new();
    for cell in cells.filter(|cell| cell.len() >= LEAST_IN_CELL).take(CELLS) {
        let point = |entry: u64| points.get((entry & u64::from(u32::MAX)) as usize).coords;
        for &entry in cell.iter().step_by(cell.len() / LINES) {
            let own = point(entry);
            let mut nearest = (f64::INFINITY, own);
            for other in cell.iter().map(|&entry| point(entry)) {
                let square = (other - own).norm_squared();
                if square > 0.0 && square < nearest.0 {
                    nearest = (square, other);
                }
            }
            let faces = along(own.into()).map(|place| place.fract().min(1.0 - place.fract()));
            if nearest.0.sqrt() * per_length <= faces.into_iter().fold(f64::INFINITY, f64::min) {
                memory::push(&mut chords, (own / radius, nearest.1 / radius))?;
            }
        }
    }
    Ok(chords)
}
