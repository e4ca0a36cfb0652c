//! How far a scanner saw in every direction: a z-buffer on the faces of a cube around the viewpoint.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::Vector3;

/// Width of a pixel at the median range, in units.
const PIXEL: f32 = 2.5;
/// Pixels of all faces: 64 MiB.
const MOST_PIXELS: i64 = 1 << 24;

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
    /// Nearest range over 3 x 3 pixels, infinite where nothing was seen.
    ranges: Vec<f32>,
}

struct Projection {
    face: usize,
    pixel: [i32; 2],
    range: f32,
}

/// What the map knows of a place.
pub(super) enum Sight {
    /// Nothing was seen in this direction.
    Background {
        /// Cosine between a normal at the place and the direction to the viewpoint.
        facing: f32,
    },
    /// Something was seen.
    Surface {
        /// How far the place lies in front of it; negative behind it.
        in_front: f32,
    },
}

impl RangeMap {
    /// Ranges of points from a viewpoint.
    pub fn new(points: &[Vector3<f32>], eye: Vector3<f32>) -> Self {
        let mut ranges: Vec<f32> = points.iter().map(|p| (p - eye).norm()).collect();
        let middle = ranges.len() / 2;
        let median = *ranges.select_nth_unstable_by(middle, f32::total_cmp).1;
        let mut map = Self { eye, scale: (median / PIXEL).max(1.0), faces: Default::default() };
        while map.lay_out(points) > MOST_PIXELS {
            map.scale /= 2.0;
        }
        map.enter(points);
        map
    }

    /// Fits the faces around the points' pixels and a margin of one; returns how many pixels that are.
    fn lay_out(&mut self, points: &[Vector3<f32>]) -> i64 {
        let mut boxes = [([i32::MAX; 2], [i32::MIN; 2]); 6];
        for point in points {
            let seen = self.project(point);
            let (low, high) = &mut boxes[seen.face];
            for k in 0..2 {
                low[k] = low[k].min(seen.pixel[k] - 1);
                high[k] = high[k].max(seen.pixel[k] + 1);
            }
        }
        for (face, (low, high)) in self.faces.iter_mut().zip(boxes) {
            let size = [0, 1].map(|k| if low[k] > high[k] { 0 } else { high[k] - low[k] + 1 });
            *face = Face { low, size, ranges: Vec::new() };
        }
        self.faces.iter().map(|face| i64::from(face.size[0]) * i64::from(face.size[1])).sum()
    }

    fn enter(&mut self, points: &[Vector3<f32>]) {
        for face in &mut self.faces {
            face.ranges = vec![f32::INFINITY; face.size[0] as usize * face.size[1] as usize];
        }
        for point in points {
            let seen = self.project(point);
            let face = &mut self.faces[seen.face];
            for a in -1..=1 {
                for b in -1..=1 {
                    let at =
                        (seen.pixel[0] - face.low[0] + a) * face.size[1] + seen.pixel[1] - face.low[1] + b;
                    let range = &mut face.ranges[at as usize];
                    *range = range.min(seen.range);
                }
            }
        }
    }

    #[inline(always)]
    fn project(&self, point: &Vector3<f32>) -> Projection {
        let d = point - self.eye;
        let axis = d.iamax();
        let per_length = self.scale / d[axis].abs();
        let pixel = [1, 2].map(|k| (d[(axis + k) % 3] * per_length).floor() as i32);
        Projection { face: 2 * axis + usize::from(d[axis] < 0.0), pixel, range: d.norm() }
    }

    /// What was seen in the direction of a place with a normal.
    #[inline(always)]
    pub fn look(&self, place: &Vector3<f32>, normal: &Vector3<f32>) -> Sight {
        let seen = self.project(place);
        let face = &self.faces[seen.face];
        let [row, column] = [0, 1].map(|k| i64::from(seen.pixel[k]) - i64::from(face.low[k]));
        let inside =
            (0..i64::from(face.size[0])).contains(&row) && (0..i64::from(face.size[1])).contains(&column);
        let at = row * i64::from(face.size[1]) + column;
        let range = if inside { face.ranges[at as usize] } else { f32::INFINITY };
        if range == f32::INFINITY {
            return Sight::Background { facing: normal.dot(&(self.eye - place)) / seen.range };
        }
        Sight::Surface { in_front: range - seen.range }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall() -> Vec<Vector3<f32>> {
        (0..400).map(|i| Vector3::new((i % 20) as f32 - 10.0, (i / 20) as f32 - 10.0, -50.0)).collect()
    }

    #[test]
    fn a_wall_hides_what_is_behind_it() {
        let map = RangeMap::new(&wall(), Vector3::zeros());
        let towards = Vector3::z();
        let in_front = |z: f32| match map.look(&Vector3::new(0.5, 0.5, z), &towards) {
            Sight::Surface { in_front } => in_front,
            Sight::Background { .. } => f32::NAN,
        };
        assert!((in_front(-30.0) - 20.0).abs() < 0.5);
        assert!((in_front(-70.0) + 20.0).abs() < 0.5);
        for beside in [Vector3::new(40.0, 0.0, -50.0), Vector3::new(0.0, 0.0, 50.0), Vector3::zeros()] {
            assert!(matches!(map.look(&beside, &towards), Sight::Background { .. }), "{beside:?}");
        }
    }

    #[test]
    fn background_knows_which_way_a_surface_faces() {
        let map = RangeMap::new(&wall(), Vector3::zeros());
        for sign in [1.0, -1.0] {
            let sight = map.look(&Vector3::new(60.0, 0.0, -60.0), &(Vector3::z() * sign));
            let cosine = sign * 0.5_f32.sqrt();
            assert!(matches!(sight, Sight::Background { facing } if (facing - cosine).abs() < 1e-6));
        }
    }

    #[test]
    fn a_viewpoint_on_a_point_does_no_harm() {
        let map = RangeMap::new(&wall(), wall()[7]);
        assert!(matches!(
            map.look(&wall()[7], &Vector3::z()),
            Sight::Surface { .. } | Sight::Background { .. }
        ));
    }
}
