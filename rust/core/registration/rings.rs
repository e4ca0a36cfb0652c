//! Fills in the surface between the rings of scans with few beams.
//!
//! A spinning beam describes a cone, and all cones of a scanner share apex and axis. Neighbouring points of a ring have the same
//! angle to the axis at the apex, which fixes both.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use crate::cloud::Cloud;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;

use super::apex::{AWAY, Apex, Chord, axis_of, chords, fit};
use super::motions::{median, some_rows};

/// Least and largest number of rings.
const LEAST_RINGS: usize = 8;
const MOST_RINGS: usize = 40;
/// Largest number of points of so few rings.
pub const MOST_POINTS: usize = 200_000;
/// Lines that are fitted first, from several places, and the largest share of them: one of so many.
const FEW: usize = 120;
const FEW_OF: usize = 4;
/// Lines of a cloud that may have rings.
const LINES: usize = 3000;
/// Steps of the first fits, and of the last.
const ROUNDS: usize = 12;
const LAST_ROUNDS: usize = 15;
/// Points that show the rings, of which one in so many shows whether there may be any.
const ENOUGH: usize = 5000;
const ONE_IN: usize = 4;
/// Gaps between rings over those within them, and over the spacing along them; and over those within, if there may be rings.
const APART: f64 = 3.0;
const MAYBE_APART: f64 = 2.0;
/// Distance of points that are filled in, in spacings along the ring, and the most of one line.
const STEP: f64 = 1.5;
const MOST_STEPS: f64 = 12.0;
/// Points that are filled in, about: more would share their voxels. Fewer points of a ring are joined then, by fewer steps.
const MOST_FILLED: usize = 150_000;
/// Sine of the angle to the ray (3 degrees) below which two rings belong to two surfaces.
const GRAZING: f64 = 0.05;

/// The surface between the rings of a scan, and the scanner that shows in them.
#[derive(Debug, Clone, PartialEq)]
pub struct Filled {
    /// The points of the scan, and those between its rings.
    pub points: Vec<[f64; 3]>,
    /// Position of the scanner.
    pub scanner: [f64; 3],
}

/// Returns the points of a scan and those that fill in the surface between its rings; `None` for a scan without rings.
///
/// Neighbouring points of adjacent rings are joined by a line of points, unless it is seen at a grazing angle: then the rings lie
/// on two surfaces.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn fill_between_rings(cloud: &Cloud, rows: &[[f64; 3]], execution: &Execution) -> Result<Option<Filled>> {
    if rows.len() > MOST_POINTS || rows.len() != cloud.points().len() {
        return Ok(None);
    }
    let Some((mut rings, scanner)) = find_rings(cloud, execution)? else { return Ok(None) };
    for ring in &mut rings {
        execution.check()?;
        ring.sort_unstable_by(|a, b| a.around.total_cmp(&b.around).then(a.row.cmp(&b.row)));
    }
    let spacing = TAU / median(&mut memory::collect(rings.iter().map(|ring| ring.len() as f64))?);
    let join = |every: usize| -> Result<(Vec<Line>, usize)> {
        let mut joined = Vec::new();
        for pair in rings.windows(2) {
            execution.check()?;
            join(rows, (&pair[0], &pair[1]), spacing, every, &mut joined)?;
        }
        let more = joined.iter().map(|line| line.steps as usize - 1).sum();
        Ok((joined, more))
    };
    let (mut joined, mut more) = join(1)?;
    if more > MOST_FILLED {
        (joined, more) = join((more as f64 / MOST_FILLED as f64).sqrt().ceil() as usize)?;
    }
    let mut filled = memory::with_capacity(rows.len() + more)?;
    filled.extend_from_slice(rows);
    for Line { low, high, steps } in joined {
        let (start, end) = (Vector3::from(rows[low as usize]), Vector3::from(rows[high as usize]));
        let step = (end - start) / f64::from(steps);
        filled.extend((1..steps).map(|k| <[f64; 3]>::from(start + step * f64::from(k))));
    }
    Ok(Some(Filled { points: filled, scanner }))
}

/// A line between points of adjacent rings, and the steps along it.
struct Line {
    low: u32,
    high: u32,
    steps: u32,
}

/// A point as seen by the scanner.
#[derive(Debug, Clone, Copy)]
struct Seen {
    row: u32,
    around: f64,
    /// Sine of the elevation.
    sine: f64,
    range: f64,
}

/// Adds the lines from one of `every` points of a ring to the nearest ones, in angle, of the next; both ascend by angle.
fn join(
    rows: &[[f64; 3]],
    (lower, upper): (&[Seen], &[Seen]),
    spacing: f64,
    every: usize,
    joined: &mut Vec<Line>,
) -> Result<()> {
    let mut after = 0;
    let step = STEP * spacing * every as f64;
    for low in lower.iter().step_by(every) {
        while upper.get(after).is_some_and(|high| high.around < low.around) {
            after += 1;
        }
        let apart = |high: &Seen| ((high.around - low.around + PI).rem_euclid(TAU) - PI).abs();
        let next = upper.get(after).or(upper.first());
        let before = upper.get(after.wrapping_sub(1)).or(upper.last());
        let (Some(next), Some(before)) = (next, before) else { break };
        let high = if apart(before) < apart(next) { before } else { next };
        if apart(high) >= 2.0 * spacing {
            continue;
        }
        let length = (Vector3::from(rows[high.row as usize]) - Vector3::from(rows[low.row as usize])).norm();
        let near = low.range.min(high.range);
        let cosine = |sine: f64| (1.0 - sine * sine).sqrt();
        let between = (high.sine * cosine(low.sine) - low.sine * cosine(high.sine)).abs();
        if near * between <= GRAZING * length {
            continue;
        }
        let steps = (length / (step * near)).ceil().min(MOST_STEPS + 1.0) as u32;
        if steps > 1 {
            memory::push(joined, Line { low: low.row, high: high.row, steps })?;
        }
    }
    Ok(())
}

/// The points of each ring from below, and the position of the scanner.
type Rings = (Vec<Vec<Seen>>, [f64; 3]);

/// Finds the rings of a spinning scanner, each on a cone: by few lines, or by many if these show that there may be any.
fn find_rings(cloud: &Cloud, execution: &Execution) -> Result<Option<Rings>> {
    let own = cloud.own()?;
    let points = &own.1;
    let squares: f64 = points.rows().map(|row| Vector3::from(row).norm_squared()).sum();
    let radius = (squares / points.len().max(1) as f64).sqrt();
    if radius.is_nan() || radius <= 0.0 {
        return Ok(None);
    }
    let local = |row: usize| points.get(row).coords / radius;
    let samples = memory::collect(some_rows(points.len(), ENOUGH).map(local))?;
    let mut found = search(&chords(points, radius)?, &samples, points.len(), execution)?;
    if found.apex.is_none() && found.apart >= MAYBE_APART {
        let rows = memory::collect(some_rows(points.len(), LINES))?;
        let nearest = cloud.nearest(execution)?.of_rows(&rows, 1, execution)?;
        let lines = rows.iter().zip(nearest).map(|(&row, other)| (local(row), local(other as usize)));
        let lines = memory::collect(lines.filter(|(one, other)| one != other))?;
        found = search(&lines, &samples, points.len(), execution)?;
    }
    let Some((apex, borders)) = found.apex else { return Ok(None) };
    let scanner = own.0.in_data(&(apex.place * radius));
    Ok(Some((divide(points, &apex, &borders, radius)?, scanner.into())))
}

/// What a search finds: the apex with the elevations between the rings, and the gaps between rings over those within them.
#[derive(Default)]
struct Sought {
    apex: Option<(Apex, Vec<f64>)>,
    apart: f64,
}

/// Searches from places along the axes for the best apex from which the elevations fall into groups.
fn search(chords: &[Chord], samples: &[Vector3<f64>], count: usize, execution: &Execution) -> Result<Sought> {
    let mut sought = Sought::default();
    if chords.len() < LEAST_RINGS {
        return Ok(sought);
    }
    let some = memory::collect(samples.iter().step_by(ONE_IN).copied())?;
    let few = memory::collect(chords.iter().step_by((chords.len() / FEW).clamp(1, FEW_OF)).copied())?;
    let axis = axis_of(chords)?;
    let mut rough = Vec::new();
    let ways = (0..3).flat_map(|k| [AWAY, -AWAY].map(|away| Vector3::ith(k, away)));
    for place in std::iter::once(Vector3::zeros()).chain(ways) {
        execution.check()?;
        memory::push(&mut rough, fit(&few, Apex { place, axis, off: f64::INFINITY }, ROUNDS)?)?;
    }
    rough.sort_by(|one, other| one.off.total_cmp(&other.off));
    // Not the best alone: seen from a place in the ground, all of that lies at one angle.
    for start in rough {
        let (apart, rings) = borders(&some, &start, count)?;
        sought.apart = sought.apart.max(apart);
        if rings.is_none() {
            continue;
        }
        let mut apex = fit(chords, start, LAST_ROUNDS)?;
        let tail: f64 = samples.iter().map(|point| point.dot(&apex.axis).powi(3)).sum();
        if tail < 0.0 {
            apex.axis = -apex.axis;
        }
        sought.apex = borders(samples, &apex, count)?.1.map(|borders| (apex, borders));
        break;
    }
    Ok(sought)
}

/// Returns the gaps between rings over those within them, and the elevations between the rings of some points; none without rings.
fn borders(samples: &[Vector3<f64>], apex: &Apex, count: usize) -> Result<(f64, Option<Vec<f64>>)> {
    let mut ordered = memory::collect(samples.iter().map(|point| apex.upwards(point)))?;
    ordered.sort_by(f64::total_cmp);
    let gap = |pair: &[f64]| pair[1] - pair[0];
    let mut largest = memory::collect(ordered.windows(2).map(gap))?;
    largest.sort_by(|one, other| other.total_cmp(one));
    largest.truncate(MOST_RINGS + 1);
    if largest.len() <= LEAST_RINGS {
        return Ok((0.0, None));
    }
    let falls = (LEAST_RINGS - 2..largest.len() - 1)
        .map(|row| (row, largest[row] / largest[row + 1].max(f64::MIN_POSITIVE)));
    let steepest = falls.fold((0, 0.0), |best: (usize, f64), fall| if fall.1 > best.1 { fall } else { best });
    let (row, fall) = steepest;
    let spacing = TAU * (row + 2) as f64 / count as f64;
    if fall < APART || largest[row] < APART * spacing {
        return Ok((fall, None));
    }
    let between = ordered.windows(2).filter(|pair| gap(pair) >= largest[row]);
    Ok((fall, Some(memory::collect(between.map(|pair| f64::midpoint(pair[0], pair[1])))?)))
}

/// Returns the points of each ring.
fn divide(points: &Points, apex: &Apex, borders: &[f64], radius: f64) -> Result<Vec<Vec<Seen>>> {
    let [one, other] = apex.aside();
    let place = apex.place * radius;
    let sines = memory::collect(borders.iter().map(|border| border.sin()))?;
    let mut rings = memory::filled(Vec::new(), borders.len() + 1)?;
    for (point, row) in points.rows().zip(0..) {
        let ray = Vector3::from(point) - place;
        let range = ray.norm();
        let sine = (ray.dot(&apex.axis) / range.max(f64::MIN_POSITIVE)).clamp(-1.0, 1.0);
        let ring = sines.partition_point(|&border| border < sine);
        let around = ray.dot(&other).atan2(ray.dot(&one));
        memory::push(&mut rings[ring], Seen { row, around, sine, range })?;
    }
    Ok(rings)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room of 20 x 16 x 3.6 seen from its middle by 16 beams between -15 and 15 degrees, with some points per beam.
    fn room_of(count: u32) -> Vec<[f64; 3]> {
        let ray = |i: u32| {
            let up = (f64::from(i / count) * 2.0 - 15.0).to_radians();
            let (sin, cos) = (f64::from(i % count) * TAU / f64::from(count)).sin_cos();
            Vector3::new(cos * up.cos(), sin * up.cos(), up.sin())
        };
        let half = Vector3::new(10.0, 8.0, 1.8);
        let hit =
            |ray: Vector3<f64>| ray * (0..3).map(|k| half[k] / ray[k].abs()).fold(f64::INFINITY, f64::min);
        (0..16 * count).map(|i| hit(ray(i)).into()).collect()
    }

    #[test]
    fn the_rings_of_a_scanner_are_found() -> Result<()> {
        let rows = room_of(900);
        let cloud = Cloud::from_rows("points", &rows)?;
        let (rings, scanner) = find_rings(&cloud, &Execution::default())?.unwrap_or_default();
        assert!(Vector3::from(scanner).norm() < 0.05, "{scanner:?}");
        assert_eq!(rings.iter().map(Vec::len).collect::<Vec<_>>(), vec![900; 16]);
        let beam = |seen: &Seen| seen.row / 900;
        assert!(rings.iter().all(|ring| ring.iter().all(|seen| beam(seen) == beam(&ring[0]))));
        let filled = fill_between_rings(&Cloud::from_rows("points", &rows)?, &rows, &Execution::default())?;
        let filled = filled.map_or_else(Vec::new, |filled| filled.points).split_off(rows.len());
        assert!(filled.len() > 10_000, "{}", filled.len());
        let on_a_wall = |place: &&[f64; 3]| {
            let [x, y, z] = place.map(f64::abs);
            (x - 10.0).abs() < 0.3 || (y - 8.0).abs() < 0.3 || (z - 1.8).abs() < 0.3
        };
        assert!(filled.iter().filter(on_a_wall).count() > 9 * filled.len() / 10);
        Ok(())
    }

    #[test]
    fn dense_rings_are_filled_more_sparsely() -> Result<()> {
        let rows = room_of(4000);
        let filled = fill_between_rings(&Cloud::from_rows("points", &rows)?, &rows, &Execution::default())?;
        let more = filled.map_or(0, |filled| filled.points.len() - rows.len());
        assert!((MOST_FILLED / 4..MOST_FILLED * 5 / 4).contains(&more), "{more}");
        Ok(())
    }

    #[test]
    fn other_clouds_have_no_rings() -> Result<()> {
        let raster: Vec<[f64; 3]> =
            (0..2500).map(|i| [f64::from(i % 50), f64::from(i / 50), f64::from(i * i % 17)]).collect();
        for rows in [raster, vec![], vec![[1.0; 3]; 30]] {
            let cloud = Cloud::from_rows("points", &rows)?;
            assert!(fill_between_rings(&cloud, &rows, &Execution::default())?.is_none());
        }
        Ok(())
    }
}
