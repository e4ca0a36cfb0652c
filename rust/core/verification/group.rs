//! Points with normals in groups, stored by coordinate for SIMD.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::Vector3;

use crate::verification::pose::Pose;

/// A point and its unit normal (zero if it has none).
#[derive(Debug, Clone, Copy)]
pub(super) struct Element {
    pub point: Vector3<f32>,
    pub normal: Vector3<f32>,
}

/// Points of a group.
pub(super) const LANES: usize = 16;

/// x, y and z of the vectors of a group.
pub(super) type Coordinates = [[f32; LANES]; 3];

/// Points and their normals; unused lanes of the last group are zero.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Group {
    pub point: Coordinates,
    pub normal: Coordinates,
}

impl Group {
    /// Group of up to [`LANES`] elements.
    pub fn of(elements: &[Element]) -> Self {
        let mut group = Self::default();
        elements.iter().enumerate().for_each(|(lane, element)| group.set(lane, element));
        group
    }

    #[inline(always)]
    pub fn set(&mut self, lane: usize, element: &Element) {
        for k in 0..3 {
            self.point[k][lane] = element.point[k];
            self.normal[k][lane] = element.normal[k];
        }
    }

    /// The group transformed by a pose.
    #[inline(always)]
    pub fn moved(&self, pose: &Pose) -> Self {
        let (r, t) = (&pose.rotation, &pose.translation);
        let mut moved = Self::default();
        for k in 0..3 {
            let (rx, ry, rz) = (r[(k, 0)], r[(k, 1)], r[(k, 2)]);
            for lane in 0..LANES {
                let [x, y, z] = [0, 1, 2].map(|k| self.point[k][lane]);
                moved.point[k][lane] = rx * x + ry * y + rz * z + t[k];
                let [x, y, z] = [0, 1, 2].map(|k| self.normal[k][lane]);
                moved.normal[k][lane] = rx * x + ry * y + rz * z;
            }
        }
        moved
    }

    /// Cosine between the normals of two groups; its magnitude if the normals' sides are unknown.
    #[inline(always)]
    pub fn cosine(&self, other: &Self, oriented: bool, lane: usize) -> f32 {
        let cosine = dot(&self.normal, &other.normal, lane);
        if oriented { cosine } else { cosine.abs() }
    }

    /// Offset from the points of another group to those of this one.
    #[inline(always)]
    pub fn offset(&self, other: &Self, lane: usize) -> [f32; 3] {
        [0, 1, 2].map(|k| self.point[k][lane] - other.point[k][lane])
    }
}

#[inline(always)]
fn dot(a: &Coordinates, b: &Coordinates, lane: usize) -> f32 {
    a[0][lane] * b[0][lane] + a[1][lane] * b[1][lane] + a[2][lane] * b[2][lane]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn moved_groups_equal_moved_elements() {
        let vector = |i: usize, k: f32| Vector3::new(1.1, 2.3, 3.7).map(|f| (i as f32 * f * k + k).sin());
        let element = |i| Element { point: vector(i, 1.0) * 30.0, normal: vector(i, 0.7).normalize() };
        let elements: Vec<Element> = (0..11).map(element).collect();
        let rotation = Rotation3::new(Vector3::new(0.3, -1.0, 2.0)).into_inner();
        let pose = Pose { rotation, translation: Vector3::new(5.0, -7.0, 11.0) };
        let (still, moved) = (Group::of(&elements), Group::of(&elements).moved(&pose));
        for (lane, element) in elements.iter().enumerate() {
            let point = rotation * element.point + pose.translation;
            let normal = rotation * element.normal;
            for k in 0..3 {
                assert_eq!(moved.point[k][lane].to_bits(), point[k].to_bits());
                assert_eq!(moved.normal[k][lane].to_bits(), normal[k].to_bits());
            }
            let cosine = normal.dot(&element.normal);
            assert!((moved.cosine(&still, true, lane) - cosine).abs() < 1e-6);
            assert!((moved.cosine(&still, false, lane) - cosine.abs()).abs() < 1e-6);
            assert!((Vector3::from(moved.offset(&still, lane)) - (point - element.point)).amax() < 1e-6);
        }
        assert!(still.point[0][11..].iter().all(|&x| x == 0.0));
    }
}
