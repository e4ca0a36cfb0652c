//! FPFH-33, fast point feature histograms (Rusu, Blodow, Beetz, ICRA 2009), as PCL's `FPFHEstimation` and
//! `Open3D`'s `compute_fpfh_feature`.
//!
//! The features are three angles between the normals of two points and their connecting line, 11 bins each. A
//! point's simple histogram (SPFH) counts the pairs with its neighbours; its descriptor is the sum of its
//! neighbours' simple histograms, weighted by their inverse squared distance. Cost O(N k).

use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::error::{Error, Result, at_least_one};
use crate::execution::Execution;
use crate::features::keypoints::locations;
use crate::features::pair_angles::{self, BINS, Counts};
use crate::geometry::ball_search::{Ball, BallSearch};
use crate::memory;
use crate::points::Points;
use crate::simd;

/// Numbers of a descriptor.
pub const LENGTH: usize = 3 * BINS;
/// Turns a descriptor into that of the mirror image: of the three angles, the second one changes its sign.
pub fn mirror<T>(descriptor: &mut [T]) {
    if let Some(histogram) = descriptor.get_mut(BINS..2 * BINS) {
        histogram.reverse();
    }
}

/// Sum of each of the three histograms.
const TOTAL: f32 = 100.0;
/// Upper bound of a neighbour's weight, in units of 1 over the squared radius: keeps sums finite.
const MAX_WEIGHT: f64 = 1e20;
/// Points per task.
const POINTS_PER_TASK: usize = 64;
/// Most bytes of neighbourhoods that are kept from one search for both of their uses.
const MOST_KEPT: usize = 64 << 20;

/// A descriptor.
pub type Row = [f32; LENGTH];

/// A point's simple histogram, and its neighbours if they are kept.
#[derive(Debug, Clone)]
struct Simple {
    histogram: Row,
    shares: Vec<Share>,
}

impl Simple {
    const NONE: Self = Self { histogram: [0.0; LENGTH], shares: Vec::new() };
}

/// A neighbour's weight in the sum of histograms.
#[derive(Debug, Clone, Copy)]
struct Share {
    position: u32,
    weight: f32,
}

/// Library whose convention is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Convention {
    /// The weighted sum of the neighbours' histograms alone; pairs without angles are skipped.
    Pcl,
    /// The point's own simple histogram is added; pairs without angles count as angles of zero.
    Open3d,
}

/// Parameters of the descriptor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fpfh {
    /// Radius of a neighbourhood, a length.
    pub radius: f64,
    /// Number of nearest points used in the neighbourhood, the point itself included; all if not given.
    pub max_neighbors: Option<usize>,
    /// Convention of the descriptor.
    pub convention: Convention,
}

impl Fpfh {
    /// Computes the descriptors of the keypoints, or of all points if none are given; NaN if a point has no
    /// normal, zero if it has no neighbour. Neighbours without a normal are skipped.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a radius that is not positive, `max_neighbors` of 0, an index out of
    /// range, or a number of normals other than that of the points; [`Error::Interrupted`].
    pub fn describe(
        &self,
        cloud: &Cloud,
        normals: &[Vector3<f64>],
        keypoints: Option<&[usize]>,
        execution: &Execution,
    ) -> Result<Vec<Row>> {
        let points = cloud.points();
        if normals.len() != points.len() {
            let remedy = format!("give one per point, {}", points.len());
            return Err(Error::invalid("normals", format!("{} rows", normals.len()), remedy));
        }
        locations(points, keypoints.unwrap_or_default())?;
        let most = at_least_one("max_neighbors", self.max_neighbors.unwrap_or(usize::MAX))?;
        let search = cloud.balls(self.radius)?.of_nearest(most);
        let surface = Surface { points, normals: search.reorder(normals)?, search, fpfh: *self };
        let Some(keypoints) = keypoints else { return surface.describe_all(execution) };
        surface.describe(keypoints, execution)
    }
}

/// A cloud with normals, and the neighbourhoods of its points.
struct Surface<'a> {
    points: &'a Points,
    /// In the order of the search.
    normals: Vec<Vector3<f64>>,
    search: BallSearch,
    fpfh: Fpfh,
}

impl Surface<'_> {
    fn describe_all(&self, execution: &Execution) -> Result<Vec<Row>> {
        let most = self.fpfh.max_neighbors.unwrap_or(usize::MAX).min(self.points.len());
        let keeps = most.saturating_mul(self.points.len()) <= MOST_KEPT / size_of::<Share>();
        let simple = self.simple_histograms(|_| true, keeps, execution)?;
        // In the order of the search, so that the points of a task share the cache.
        let weigh = |ball: &mut Ball, position| self.weigh(&simple, position, ball);
        let rows = map(self.points.len(), [0.0; LENGTH], execution, weigh)?;
        let mut sorted = memory::filled([0.0; LENGTH], rows.len())?;
        self.search.order().iter().zip(rows).for_each(|(&i, row)| sorted[i as usize] = row);
        Ok(sorted)
    }

    fn describe(&self, keypoints: &[usize], execution: &Execution) -> Result<Vec<Row>> {
        let mut position_of = memory::filled(0, self.points.len())?;
        self.search.order().iter().zip(0..).for_each(|(&i, position)| position_of[i as usize] = position);
        let is_near = memory::collect(self.normals.iter().map(|_| AtomicBool::new(false)))?;
        map(keypoints.len(), (), execution, |ball, row| {
            let own = position_of[keypoints[row]];
            self.neighbors(own, ball)?;
            // Coincident points may exclude the point from its own ball, which holds the nearest only.
            is_near[own].store(true, Ordering::Relaxed);
            ball.positions().iter().for_each(|&near| is_near[near as usize].store(true, Ordering::Relaxed));
            Ok(())
        })?;
        let simple =
            self.simple_histograms(|position| is_near[position].load(Ordering::Relaxed), false, execution)?;
        map(keypoints.len(), [0.0; LENGTH], execution, |ball, row| {
            self.weigh(&simple, position_of[keypoints[row]], ball)
        })
    }

    /// Simple histograms of the needed points, zero for others, in the order of the search; with their
    /// neighbours if `keeps` is set.
    fn simple_histograms(
        &self,
        is_needed: impl Fn(usize) -> bool + Sync,
        keeps: bool,
        execution: &Execution,
    ) -> Result<Vec<Simple>> {
        map(self.points.len(), Simple::NONE, execution, |ball, position| {
            if !is_needed(position) || is_missing(&self.normals[position]) {
                return Ok(Simple::NONE);
            }
            self.neighbors(position, ball)?;
            let shares = if keeps { self.shares(ball)? } else { Vec::new() };
            Ok(Simple { histogram: self.simple_histogram(position, ball), shares })
        })
    }

    /// Simple histogram of a point's pairs with its neighbours.
    fn simple_histogram(&self, position: usize, ball: &Ball) -> Row {
        let mut counts = Counts::default();
        pair_angles::count(position as u32, ball, &self.normals, &mut counts);
        if self.fpfh.convention == Convention::Open3d {
            counts.add_flat_pairs();
        }
        let share = if counts.pairs == 0 { 0.0 } else { TOTAL / counts.pairs as f32 };
        let mut row = [0.0; LENGTH];
        row.iter_mut()
            .zip(counts.bins.as_flattened())
            .for_each(|(value, &count)| *value = count as f32 * share);
        row
    }

    /// Weights of the points of a ball, without those at its centre: the inverse of their squared distance.
    fn shares(&self, ball: &Ball) -> Result<Vec<Share>> {
        let unit = self.search.radius() * self.search.radius();
        let near = ball.squared_distances().iter().zip(ball.positions());
        let mut shares = memory::with_capacity(ball.len())?;
        shares.extend(
            near.filter(|&(&square, _)| square > 0.0).map(|(&square, &position)| Share {
                position,
                weight: (unit / square).min(MAX_WEIGHT) as f32,
            }),
        );
        Ok(shares)
    }

    /// Sums the neighbours' histograms, weighted by their inverse squared distance.
    fn weigh(&self, simple: &[Simple], position: usize, ball: &mut Ball) -> Result<Row> {
        if is_missing(&self.normals[position]) {
            return Ok([f32::NAN; LENGTH]);
        }
        let (kept, mut found) = (&simple[position].shares, Vec::new());
        if kept.is_empty() {
            self.neighbors(position, ball)?;
            found = self.shares(ball)?;
        }
        let shares = if kept.is_empty() { &found } else { kept };
        let mut row = [0.0; LENGTH];
        simd::run(
            #[inline(always)]
            || {
                for share in shares {
                    let values = &simple[share.position as usize].histogram;
                    for (sum, value) in row.iter_mut().zip(values) {
                        *sum += share.weight * value;
                    }
                }
            },
        );
        self.scale(&mut row, &simple[position].histogram);
        Ok(row)
    }

    /// Scales each histogram to a sum of 100, and adds the point's own in the `Open3d` convention.
    fn scale(&self, row: &mut Row, own: &Row) {
        let added = if self.fpfh.convention == Convention::Open3d { 1.0 } else { 0.0 };
        for (part, own) in row.chunks_exact_mut(BINS).zip(own.chunks_exact(BINS)) {
            let sum: f32 = part.iter().sum();
            let scale = if sum > 0.0 { TOTAL / sum } else { 0.0 };
            part.iter_mut().zip(own).for_each(|(value, own)| *value = *value * scale + added * own);
        }
    }

    fn neighbors(&self, position: usize, ball: &mut Ball) -> Result<()> {
        self.search.within(&self.points.get(self.search.index(position as u32) as usize), ball)
    }
}

fn is_missing(normal: &Vector3<f64>) -> bool {
    normal.x.is_nan()
}

/// Computes `count` results in parallel, with `value` as the placeholder.
fn map<T: Send + Clone>(
    count: usize,
    value: T,
    execution: &Execution,
    result: impl Fn(&mut Ball, usize) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let compute = |ball: &mut Ball, i: usize| {
        execution.check()?;
        result(ball, i)
    };
    let tasks = (0..count).into_par_iter().with_min_len(POINTS_PER_TASK).map_init(Ball::default, compute);
    memory::par_try_fill(value, tasks)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONVENTIONS: [Convention; 2] = [Convention::Pcl, Convention::Open3d];

    fn fpfh(convention: Convention) -> Fpfh {
        Fpfh { radius: 1.5, max_neighbors: Some(100), convention }
    }

    fn wavy() -> Result<(Cloud, Vec<Vector3<f64>>)> {
        let place = |i: u32| (f64::from(i % 20) * 0.5, f64::from(i / 20) * 0.5);
        let rows: Vec<[f64; 3]> = (0..400).map(place).map(|(x, y)| [x, y, x.sin() * y.cos()]).collect();
        let slope = |(x, y): (f64, f64)| Vector3::new(-x.cos() * y.cos(), x.sin() * y.sin(), 1.0).normalize();
        Ok((Cloud::from_rows("points", &rows)?, (0..400).map(place).map(slope).collect()))
    }

    #[test]
    fn three_histograms_of_one_hundred() -> Result<()> {
        let (cloud, normals) = wavy()?;
        for (convention, total) in CONVENTIONS.into_iter().zip([100.0, 200.0]) {
            for row in fpfh(convention).describe(&cloud, &normals, None, &Execution::default())? {
                for part in row.chunks_exact(BINS) {
                    assert!((part.iter().sum::<f32>() - total).abs() < 1e-3, "{part:?}");
                }
            }
        }
        Ok(())
    }

    #[test]
    fn keypoints_have_the_same_rows_as_among_all_points() -> Result<()> {
        let (cloud, normals) = wavy()?;
        let execution = Execution::default();
        let keypoints = [7, 399, 7, 0];
        for convention in CONVENTIONS {
            let all = fpfh(convention).describe(&cloud, &normals, None, &execution)?;
            let some = fpfh(convention).describe(&cloud, &normals, Some(&keypoints), &execution)?;
            assert_eq!(some, keypoints.map(|i| all[i]));
        }
        assert!(fpfh(Convention::Pcl).describe(&cloud, &normals, Some(&[]), &execution)?.is_empty());
        Ok(())
    }

    #[test]
    fn descriptors_of_the_mirror_image_are_mirrored() -> Result<()> {
        let (cloud, normals) = wavy()?;
        let rows = cloud.points().rows();
        let other = |[x, y, z]: [f64; 3]| [-x, y, z];
        let (mirrored, turned) = (
            Cloud::from_rows("points", &rows.map(other).collect::<Vec<_>>())?,
            normals.iter().map(|&normal| Vector3::from(other(normal.into()))).collect::<Vec<_>>(),
        );
        for convention in CONVENTIONS {
            let described = fpfh(convention).describe(&cloud, &normals, None, &Execution::default())?;
            let expected = fpfh(convention).describe(&mirrored, &turned, None, &Execution::default())?;
            let differs = described.into_iter().zip(expected).map(|(mut row, expected)| {
                mirror(&mut row);
                row.iter().zip(expected).map(|(one, other)| (one - other).abs()).sum::<f32>()
            });
            // A value on the border of two bins may change sides.
            assert!(differs.sum::<f32>() / 400.0 < 1.0);
        }
        Ok(())
    }

    #[test]
    fn a_plane_fills_the_middle_bins() -> Result<()> {
        let rows: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), 0.0]).collect();
        let (cloud, normals) = (Cloud::from_rows("points", &rows)?, vec![Vector3::z(); 100]);
        let described = fpfh(Convention::Pcl).describe(&cloud, &normals, None, &Execution::default())?;
        for row in described {
            for (bin, value) in row.into_iter().enumerate() {
                let expected = if bin % BINS == BINS / 2 { 100.0 } else { 0.0 };
                assert!((value - expected).abs() < 1e-4, "bin {bin}: {value}");
            }
        }
        Ok(())
    }

    #[test]
    fn missing_normals_and_lone_points() -> Result<()> {
        let rows = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [50.0, 0.0, 0.0], [0.0; 3]];
        let cloud = Cloud::from_rows("points", &rows)?;
        let mut normals = vec![Vector3::z(); 5];
        normals[2] = Vector3::repeat(f64::NAN);
        for convention in CONVENTIONS {
            let described = fpfh(convention).describe(&cloud, &normals, None, &Execution::default())?;
            assert!(described[2].iter().all(|value| value.is_nan()));
            assert!(described[3].iter().all(|&value| value == 0.0));
            assert!(described[0][BINS / 2] > 99.0 && described[0].iter().all(|value| value.is_finite()));
        }
        Ok(())
    }

    #[test]
    fn bad_input_is_refused() -> Result<()> {
        let (cloud, normals) = wavy()?;
        let run = |fpfh: Fpfh, normals: &[Vector3<f64>], keypoints: Option<&[usize]>| {
            fpfh.describe(&cloud, normals, keypoints, &Execution::default()).is_err()
        };
        let good = fpfh(Convention::Pcl);
        assert!(run(Fpfh { radius: 0.0, ..good }, &normals, None));
        assert!(run(Fpfh { max_neighbors: Some(0), ..good }, &normals, None));
        assert!(run(good, &normals[1..], None));
        assert!(run(good, &normals, Some(&[400])));
        Ok(())
    }
}
