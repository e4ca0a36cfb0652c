//! Planes of a scan, and the number of them that a pose aligns with planes of another scan.

use nalgebra::{Matrix3, Vector3};

use crate::consensus::counter_rng::random_words;
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::proximity::any_within;
use crate::geometry::rigid::Rigid;
use crate::geometry::symmetric::eigen;
use crate::memory;

/// Largest number of planes of a scan.
const MOST_PLANES: usize = 12;
/// Triples of points that propose a plane, places tried for each, points that vote.
const HYPOTHESES: usize = 100;
const TRIED: usize = 40;
const VOTERS: usize = 1000;
/// Largest distance of the points of a triple, in voxels, and least double area, in squared voxels.
const REACH: f64 = 20.0;
const LEAST_AREA: f64 = 9.0;
/// Largest distance of a plane's points from it, in voxels.
const THICK: f64 = 0.3;
/// Least number of points of a plane, and least share of all points.
const LEAST: f64 = 40.0;
const LEAST_SHARE: f64 = 0.008;
/// Cosines from which two planes may coincide (4 degrees), and from which they are one plane (8 degrees).
const ALIKE: f64 = 0.997_564_050_259_824_2;
const SAME: f64 = 0.990_268_068_741_570_4;
/// Largest distance of a plane's points from the other plane, in voxels.
const OFFSET: f64 = 0.8;
/// Largest distance between points of both planes, in voxels, and the share of the points that need such a partner.
const BESIDE: f64 = 5.0;
const SHARED: f64 = 0.1;
/// Least distance of two parallel planes, in voxels.
const APART: f64 = 1.2;
/// Voxels above a plane, and half of those beside it, within which points belong to it: where planes meet.
const EDGE: f64 = 1.0;
/// Edge of the cells of samples whose errors are correlated, in voxels.
const CELL: f64 = 4.0;
/// Points of a plane that are compared with those of another one.
const SIDE: usize = 200;
/// Stands for no plane, or no cell.
pub const NONE: u32 = u32::MAX;

/// A plane: normal, centre, and some of its points.
#[derive(Debug, Clone)]
struct Plane {
    normal: Vector3<f64>,
    center: Vector3<f64>,
    members: Vec<Vector3<f64>>,
}

/// Planes of the voxels of a scan, the largest first.
#[derive(Debug, Clone, Default)]
pub struct Planes {
    planes: Vec<Plane>,
    /// Plane of each voxel, or [`NONE`].
    labels: Vec<u32>,
}

impl Planes {
    /// Finds planes one after the other, by random triples of points near each other.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn find(points: &[Vector3<f64>], voxel: f64, execution: &Execution) -> Result<Self> {
        let mut labels = memory::filled(NONE, points.len())?;
        let mut left = memory::collect(0..points.len() as u32)?;
        let mut planes = Vec::new();
        let least = LEAST.max(LEAST_SHARE * points.len() as f64);
        while planes.len() < MOST_PLANES && left.len() as f64 >= least {
            execution.check()?;
            let thick = THICK * voxel;
            let Some((normal, center)) = propose(points, &left, voxel, planes.len() as u64)? else { break };
            let Some((normal, center)) = fit(points, &left, &normal, &center, thick, least)? else { break };
            let rows = near(points, &left, &normal, &center, thick)?;
            if (rows.len() as f64) < least {
                break;
            }
            let (outer_normal, outer_center) = (normal, center);
            let (normal, center) = plane_of(points, &rows);
            rows.iter().for_each(|&row| labels[row as usize] = planes.len() as u32);
            let step = rows.len() / SIDE + 1;
            let members = memory::collect(rows.iter().step_by(step).map(|&row| points[row as usize]))?;
            memory::push(&mut planes, Plane { normal, center, members })?;
            left.retain(|&row| (points[row as usize] - outer_center).dot(&outer_normal).abs() >= 2.0 * thick);
        }
        Ok(Self { planes, labels })
    }

    /// Returns the cell of each place along some axes, numbered from 0; [`NONE`] for places by a plane of the voxels.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn number_cells(
        &self,
        places: &[[f64; 3]],
        voxels: &[Vector3<f64>],
        voxel: f64,
        axes: &Matrix3<f64>,
        execution: &Execution,
    ) -> Result<(Vec<u32>, usize)> {
        let mut by_a_plane = memory::filled(false, places.len())?;
        for (label, plane) in self.planes.iter().enumerate() {
            let is_near = |place: &[f64; 3]| {
                (Vector3::from(*place) - plane.center).dot(&plane.normal).abs() < EDGE * voxel
            };
            let rows = memory::collect((0..places.len()).filter(|&row| is_near(&places[row])))?;
            let asked = memory::collect(rows.iter().map(|&row| places[row]))?;
            let members = voxels.iter().zip(&self.labels).filter(|&(_, &of)| of as usize == label);
            let members = memory::collect(members.map(|(point, _)| <[f64; 3]>::from(*point)))?;
            let found = any_within(&asked, &members, 2.0 * EDGE * voxel, execution)?;
            rows.iter().zip(found).for_each(|(&row, found)| by_a_plane[row] |= found);
        }
        let along = memory::collect(places.iter().map(|place| axes * Vector3::from(*place)))?;
        let low = along.iter().fold(Vector3::repeat(f64::INFINITY), |low, place| low.inf(place));
        let corner = |place: &Vector3<f64>| ((place - low) / (CELL * voxel)).map(|part| part.floor() as i64);
        let mut corners = memory::collect(along.iter().map(|place| <[i64; 3]>::from(corner(place))))?;
        let unsorted = memory::copied(&corners)?;
        corners.sort_unstable();
        corners.dedup();
        let number = |corner: &[i64; 3]| corners.binary_search(corner).unwrap_or(0) as u32;
        let cells = unsorted.iter().zip(&by_a_plane).map(
            |(corner, &is_by_a_plane)| {
                if is_by_a_plane { NONE } else { number(corner) }
            },
        );
        Ok((memory::collect(cells)?, corners.len()))
    }

    /// Returns the number of planes that a pose aligns with planes of a target; each normal and offset counts once.
    pub fn count_agreeing(&self, target: &Self, pose: &Rigid, voxel: f64) -> usize {
        let mut counted: Vec<(Vector3<f64>, f64)> = Vec::with_capacity(MOST_PLANES);
        let centers = target.planes.iter().map(|plane| plane.center);
        let middle = centers.sum::<Vector3<f64>>() / target.planes.len().max(1) as f64;
        for plane in &self.planes {
            let normal = pose.rotation * plane.normal;
            let moved: Vec<Vector3<f64>> =
                plane.members.iter().map(|point| pose.rotation * point + pose.translation).collect();
            for other in target.planes.iter().filter(|other| other.normal.dot(&normal).abs() > ALIKE) {
                if !coincide(&moved, other, voxel) {
                    continue;
                }
                let heights = moved.iter().map(|point| (point - middle).dot(&other.normal));
                let height = heights.sum::<f64>() / moved.len() as f64;
                if !counted.iter().any(|known| is_same((other.normal, height), *known, voxel)) {
                    counted.push((other.normal, height));
                }
                break;
            }
        }
        counted.len()
    }
}

/// Returns whether most points lie on a plane, and some of them near points of it.
fn coincide(moved: &[Vector3<f64>], other: &Plane, voxel: f64) -> bool {
    let on = moved
        .iter()
        .filter(|&point| (point - other.center).dot(&other.normal).abs() <= OFFSET * voxel)
        .count();
    if 2 * on <= moved.len() {
        return false;
    }
    let square = (BESIDE * voxel).powi(2);
    let has_partner =
        |point: &&Vector3<f64>| other.members.iter().any(|member| (member - **point).norm_squared() < square);
    moved.iter().filter(has_partner).count() as f64 >= SHARED * moved.len() as f64
}

fn is_same((normal, height): (Vector3<f64>, f64), (other, level): (Vector3<f64>, f64), voxel: f64) -> bool {
    let cosine = normal.dot(&other);
    cosine.abs() > SAME && (height * cosine.signum() - level).abs() < APART * voxel
}

/// Returns the plane of the triple of points that most voters lie on; none if no triple spans a plane.
fn propose(
    points: &[Vector3<f64>],
    left: &[u32],
    voxel: f64,
    round: u64,
) -> Result<Option<(Vector3<f64>, Vector3<f64>)>> {
    let mut drawn = Draw::new(round);
    let voters =
        memory::collect((0..VOTERS.min(left.len())).map(|_| points[left[drawn.below(left.len())] as usize]))?;
    let [xs, ys, zs] = [0, 1, 2].map(|axis| memory::collect(voters.iter().map(|point| point[axis])));
    let (xs, ys, zs) = (xs?, ys?, zs?);
    let (reach, area) = ((REACH * voxel).powi(2), LEAST_AREA * voxel * voxel);
    let mut best: Option<(usize, Vector3<f64>, Vector3<f64>)> = None;
    for _ in 0..HYPOTHESES {
        let start = voters[drawn.below(voters.len())];
        let mut sides = (0..TRIED)
            .map(|_| voters[drawn.below(voters.len())] - start)
            .filter(|side| side.norm_squared() < reach);
        let (Some(one), Some(other)) = (sides.next(), sides.next()) else { continue };
        let normal = one.cross(&other);
        let size = normal.norm();
        if size <= area {
            continue;
        }
        let normal = normal / size;
        let (offset, thick) = (normal.dot(&start), THICK * voxel);
        let votes: usize = (0..xs.len())
            .map(|i| {
                let height = normal.x * xs[i] + normal.y * ys[i] + normal.z * zs[i] - offset;
                usize::from(height.abs() < thick)
            })
            .sum();
        if best.is_none_or(|(most, ..)| votes > most) {
            best = Some((votes, normal, start));
        }
    }
    Ok(best.map(|(_, normal, start)| (normal, start)))
}

/// Refits a plane to the points near it; none if they are few.
fn fit(
    points: &[Vector3<f64>],
    left: &[u32],
    normal: &Vector3<f64>,
    center: &Vector3<f64>,
    thick: f64,
    least: f64,
) -> Result<Option<(Vector3<f64>, Vector3<f64>)>> {
    let rows = near(points, left, normal, center, thick)?;
    Ok((rows.len() as f64 >= least).then(|| plane_of(points, &rows)))
}

fn near(
    points: &[Vector3<f64>],
    left: &[u32],
    normal: &Vector3<f64>,
    center: &Vector3<f64>,
    thick: f64,
) -> Result<Vec<u32>> {
    memory::collect(
        left.iter().copied().filter(|&row| (points[row as usize] - center).dot(normal).abs() < thick),
    )
}

/// Returns normal and centre of the least-squares plane of some points.
fn plane_of(points: &[Vector3<f64>], rows: &[u32]) -> (Vector3<f64>, Vector3<f64>) {
    let center = rows.iter().map(|&row| points[row as usize]).sum::<Vector3<f64>>() / rows.len() as f64;
    let mut scatter = Matrix3::zeros();
    for &row in rows {
        let offset = points[row as usize] - center;
        scatter.ger(1.0, &offset, &offset, 1.0);
    }
    (eigen(&scatter).vectors[0], center)
}

/// Random rows, the same in every run.
struct Draw {
    round: u64,
    counter: u64,
    words: [u64; 4],
}

impl Draw {
    fn new(round: u64) -> Self {
        Self { round, counter: 0, words: [0; 4] }
    }

    fn below(&mut self, bound: usize) -> usize {
        let place = (self.counter % 4) as usize;
        if place == 0 {
            self.words = random_words(self.round, self.counter / 4);
        }
        self.counter += 1;
        ((u128::from(self.words[place]) * bound as u128) >> 64) as usize
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    /// A floor and two walls of 40 x 40 points, 1 apart.
    fn corner() -> Vec<Vector3<f64>> {
        let raster = || (0..1600).map(|i| (f64::from(i % 40), f64::from(i / 40)));
        let floor = raster().map(|(x, y)| Vector3::new(x, y, 0.0));
        let left = raster().map(|(y, z)| Vector3::new(0.0, y, z));
        let back = raster().map(|(x, z)| Vector3::new(x, 40.0, z));
        floor.chain(left).chain(back).collect()
    }

    #[test]
    fn the_planes_of_a_corner_are_found() -> Result<()> {
        let points = corner();
        let planes = Planes::find(&points, 1.0, &Execution::default())?;
        assert_eq!(planes.planes.len(), 3);
        assert!(planes.labels.iter().filter(|&&label| label == NONE).count() < 100);
        let same = Rigid::identity();
        assert_eq!(planes.count_agreeing(&planes, &same, 1.0), 3);
        let lifted = Rigid { translation: Vector3::new(0.0, 0.0, 5.0), ..same };
        assert_eq!(planes.count_agreeing(&planes, &lifted, 1.0), 2);
        let turned = Rigid { rotation: Rotation3::new(Vector3::repeat(0.5)).into_inner(), ..same };
        assert_eq!(planes.count_agreeing(&planes, &turned, 1.0), 0);
        Ok(())
    }

    #[test]
    fn cells_are_off_all_planes() -> Result<()> {
        let points = corner();
        let planes = Planes::find(&points, 1.0, &Execution::default())?;
        let places = [[20.0, 20.0, 0.2], [20.0, 20.0, 9.0], [20.5, 20.0, 9.0], [30.0, 20.0, 9.0]];
        let axes = Matrix3::identity();
        let (cells, count) = planes.number_cells(&places, &points, 1.0, &axes, &Execution::default())?;
        assert_eq!((cells[0], cells[1], count), (NONE, cells[2], 3));
        assert_ne!(cells[1], cells[3]);
        Ok(())
    }

    #[test]
    fn a_blob_has_no_plane() -> Result<()> {
        let number = |i: u64, k: u64| (random_words(9, 3 * i + k)[0] >> 40) as f64 / 1e6;
        let points: Vec<_> =
            (0..2000).map(|i| Vector3::new(number(i, 0), number(i, 1), number(i, 2))).collect();
        let planes = Planes::find(&points, 0.05, &Execution::default())?;
        assert!(planes.planes.is_empty());
        let none = Planes::find(&[], 1.0, &Execution::default())?;
        assert_eq!(none.count_agreeing(&planes, &Rigid::identity(), 1.0), 0);
        Ok(())
    }
}
