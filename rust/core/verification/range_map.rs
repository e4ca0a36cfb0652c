//! Observed range in every direction: a z-buffer on the faces of a cube around the viewpoint.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::Vector3;

use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::verification::group::{Group, LANES};

/// Width of a pixel at the median range, in units.
const PIXEL: f32 = 2.5;
/// Pixels of all faces: 64 MiB.
const MOST_PIXELS: i64 = 1 << 24;
/// Points between two checks for an interruption.
const STRETCH: usize = 1 << 16;
/// Upper bound of the pixels per unit tangent; keeps pixel numbers in range.
const MOST_SCALE: f32 = (1 << 29) as f32;

#[derive(Debug)]
pub(super) struct RangeMap {
    eye: Vector3<f32>,
    /// Pixels per unit tangent.
    scale: f32,
    faces: [Face; 6],
}

#[derive(Debug, Default)]
struct Face {
    low: [i32; 2],
    size: [i32; 2],
    /// Nearest range over 3 x 3 pixels, infinite if nothing was observed.
    ranges: Vec<f32>,
}

struct Projection {
    face: u32,
    pixel: [i32; 2],
    range: f32,
}

/// Visibility of the places of a group.
pub(super) struct Sights {
    /// Distance of a place in front of the observed surface in its direction: negative behind it, infinite if
    /// nothing was observed.
    pub in_front: [f32; LANES],
    /// Cosine between the normal at the place and the direction to the viewpoint.
    pub facing: [f32; LANES],
}

impl RangeMap {
    /// Builds the range map of points from a viewpoint.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn new(points: &[Vector3<f32>], eye: Vector3<f32>, execution: &Execution) -> Result<Self> {
        let mut ranges = memory::collect(points.iter().map(|p| (p - eye).norm()))?;
        let middle = ranges.len() / 2;
        let median = *ranges.select_nth_unstable_by(middle, f32::total_cmp).1;
        let mut map = Self { eye, scale: (median / PIXEL).clamp(1.0, MOST_SCALE), faces: Default::default() };
        while map.lay_out(points) > MOST_PIXELS {
            execution.check()?;
            map.scale /= 2.0;
        }
        map.enter(points, execution)?;
        Ok(map)
    }

    /// The viewpoint.
    pub fn eye(&self) -> Vector3<f32> {
        self.eye
    }

    /// Fits the faces to the points' pixels with a margin of one; returns the number of pixels.
    fn lay_out(&mut self, points: &[Vector3<f32>]) -> i64 {
        let mut boxes = [([i32::MAX; 2], [i32::MIN; 2]); 6];
        for point in points {
            let seen = self.project(point.x, point.y, point.z);
            let (low, high) = &mut boxes[seen.face as usize];
            for k in 0..2 {
                low[k] = low[k].min(seen.pixel[k].saturating_sub(1));
                high[k] = high[k].max(seen.pixel[k].saturating_add(1));
            }
        }
        for (face, (low, high)) in self.faces.iter_mut().zip(boxes) {
            let size = [0, 1]
                .map(|k| if low[k] > high[k] { 0 } else { high[k].saturating_sub(low[k]).saturating_add(1) });
            *face = Face { low, size, ranges: Vec::new() };
        }
        let pixels = |face: &Face| i64::from(face.size[0]) * i64::from(face.size[1]);
        self.faces.iter().map(pixels).fold(0, i64::saturating_add)
    }

    fn enter(&mut self, points: &[Vector3<f32>], execution: &Execution) -> Result<()> {
        for face in &mut self.faces {
            face.ranges = memory::filled(f32::INFINITY, face.size[0] as usize * face.size[1] as usize)?;
        }
        for (i, point) in points.iter().enumerate() {
            if i.is_multiple_of(STRETCH) {
                execution.check()?;
            }
            let seen = self.project(point.x, point.y, point.z);
            let face = &mut self.faces[seen.face as usize];
            for a in -1..=1 {
                for b in -1..=1 {
                    let at =
                        (seen.pixel[0] - face.low[0] + a) * face.size[1] + seen.pixel[1] - face.low[1] + b;
                    let range = &mut face.ranges[at as usize];
                    *range = range.min(seen.range);
                }
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn project(&self, x: f32, y: f32, z: f32) -> Projection {
        let (x, y, z) = (x - self.eye.x, y - self.eye.y, z - self.eye.z);
        let is_x = (x.abs() >= y.abs()) & (x.abs() >= z.abs());
        let is_y = y.abs() >= z.abs();
        let pick = |if_x: f32, if_y: f32, if_z: f32| {
            let other = if is_y { if_y } else { if_z };
            if is_x { if_x } else { other }
        };
        let main = pick(x, y, z);
        let per_length = self.scale / main.abs();
        let axis = if is_x { 0 } else { 2 - u32::from(is_y) };
        Projection {
            face: 2 * axis + u32::from(main < 0.0),
            pixel: [pick(y, z, x), pick(z, x, y)].map(|length| (length * per_length).floor() as i32),
            range: (x * x + y * y + z * z).sqrt(),
        }
    }

    /// Looks up the observed ranges in the directions of places with normals.
    #[inline(always)]
    pub fn look(&self, places: &Group) -> Sights {
        let eye = self.eye;
        let (mut faces, mut pixels, mut ranges) = ([0; LANES], [[0; LANES]; 2], [0.0; LANES]);
        let mut facing = [0.0; LANES];
        for lane in 0..LANES {
            let [x, y, z] = [0, 1, 2].map(|k| places.point[k][lane]);
            let [u, v, w] = [0, 1, 2].map(|k| places.normal[k][lane]);
            let seen = self.project(x, y, z);
            (faces[lane], pixels[0][lane], pixels[1][lane]) = (seen.face, seen.pixel[0], seen.pixel[1]);
            ranges[lane] = seen.range;
            facing[lane] = (u * (eye.x - x) + v * (eye.y - y) + w * (eye.z - z)) / seen.range;
        }
        let mut in_front = [0.0; LANES];
        for lane in 0..LANES {
            in_front[lane] = self.range(faces[lane], [pixels[0][lane], pixels[1][lane]]) - ranges[lane];
        }
        Sights { in_front, facing }
    }

    /// The nearest range in a direction.
    #[inline(always)]
    fn range(&self, face: u32, pixel: [i32; 2]) -> f32 {
        let face = &self.faces[face as usize];
        // Pixels below the lowest wrap around to numbers beyond all sizes.
        let [row, column] = [0, 1].map(|k| pixel[k].wrapping_sub(face.low[k]) as u32);
        if row >= face.size[0] as u32 || column >= face.size[1] as u32 {
            return f32::INFINITY;
        }
        face.ranges[row as usize * face.size[1] as usize + column as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verification::group::Element;

    fn wall() -> Vec<Vector3<f32>> {
        (0..400).map(|i| Vector3::new((i % 20) as f32 - 10.0, (i / 20) as f32 - 10.0, -50.0)).collect()
    }

    fn look(map: &RangeMap, point: Vector3<f32>, normal: Vector3<f32>) -> (f32, f32) {
        let sights = map.look(&Group::of(&[Element { point, normal }]));
        (sights.in_front[0], sights.facing[0])
    }

    #[test]
    fn a_wall_occludes_points_behind_it() -> Result<()> {
        let map = RangeMap::new(&wall(), Vector3::zeros(), &Execution::default())?;
        let towards = Vector3::z();
        let in_front = |z: f32| look(&map, Vector3::new(0.5, 0.5, z), towards).0;
        assert!((in_front(-30.0) - 20.0).abs() < 0.5);
        assert!((in_front(-70.0) + 20.0).abs() < 0.5);
        for beside in [Vector3::new(40.0, 0.0, -50.0), Vector3::new(0.0, 0.0, 50.0), Vector3::zeros()] {
            assert!(look(&map, beside, towards).0 == f32::INFINITY, "{beside:?}");
        }
        Ok(())
    }

    #[test]
    fn background_depends_on_the_normal() -> Result<()> {
        let map = RangeMap::new(&wall(), Vector3::zeros(), &Execution::default())?;
        for sign in [1.0, -1.0] {
            let (in_front, facing) = look(&map, Vector3::new(60.0, 0.0, -60.0), Vector3::z() * sign);
            assert!(in_front == f32::INFINITY && (facing - sign * 0.5_f32.sqrt()).abs() < 1e-6);
        }
        Ok(())
    }

    #[test]
    fn a_point_too_far_for_its_pixel_does_no_harm() -> Result<()> {
        for far in [1e10, 1e20, f32::INFINITY] {
            let points = [Vector3::new(far, far, 0.0), Vector3::new(-far, 0.0, far), Vector3::x()];
            let map = RangeMap::new(&points, Vector3::zeros(), &Execution::default())?;
            assert!(!look(&map, Vector3::new(1.0, 1.0, 0.0), Vector3::z()).0.is_nan());
        }
        Ok(())
    }

    #[test]
    fn a_viewpoint_on_a_point_does_no_harm() -> Result<()> {
        let map = RangeMap::new(&wall(), wall()[7], &Execution::default())?;
        let (in_front, _) = look(&map, wall()[7], Vector3::z());
        assert!(in_front <= 0.0 || in_front == f32::INFINITY, "{in_front}");
        Ok(())
    }
}
