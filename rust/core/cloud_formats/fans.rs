//! Splits polygons into triangles that share their first corner.

use crate::error::{Error, Result};
use crate::memory;

/// Triangles, built corner by corner.
#[derive(Default)]
pub(super) struct Fans {
    triangles: Vec<[i64; 3]>,
    first: i64,
    last: i64,
    corners: usize,
}

impl Fans {
    /// Begins a new polygon.
    pub fn begin(&mut self) {
        self.corners = 0;
    }

    /// Adds a corner: a row of the points. It is checked at the end, since points may still follow.
    pub fn corner(&mut self, corner: i64) -> Result<()> {
        match self.corners {
            0 => self.first = corner,
            1 => {}
            _ => memory::push(&mut self.triangles, [self.first, self.last, corner])?,
        }
        self.last = corner;
        self.corners += 1;
        Ok(())
    }

    /// All triangles, if there are any; checks that each corner is one of `points` points.
    pub fn finish(self, points: usize) -> Result<Option<Vec<[i64; 3]>>> {
        let is_there = |corner: &i64| usize::try_from(*corner).is_ok_and(|row| row < points);
        if let Some(corner) = self.triangles.as_flattened().iter().find(|corner| !is_there(corner)) {
            let remedy = format!("there are {points}, the first is point 0");
            return Err(Error::invalid("faces", format!("a face names point {corner}"), remedy));
        }
        Ok((!self.triangles.is_empty()).then_some(self.triangles))
    }
}

/// An integer stored as any number type; -1, which is no row, for other values.
#[expect(clippy::float_cmp, reason = "the cast of an integer is exact")]
pub(super) fn row_of(number: f64) -> i64 {
    // Faster than testing the fraction, for which some processors have no instruction.
    let row = number as i64;
    if row as f64 == number { row } else { -1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(polygons: &[&[i64]], points: usize) -> Result<Option<Vec<[i64; 3]>>> {
        let mut fans = Fans::default();
        for polygon in polygons {
            fans.begin();
            for corner in *polygon {
                fans.corner(*corner)?;
            }
        }
        fans.finish(points)
    }

    #[test]
    fn polygons_become_triangles_in_order() {
        let found = cut(&[&[4, 1, 2, 3], &[7], &[5, 6], &[0, 2, 1]], 8);
        assert_eq!(found, Ok(Some(vec![[4, 1, 2], [4, 2, 3], [0, 2, 1]])));
        assert_eq!(cut(&[&[5, 6]], 8), Ok(None));
    }

    #[test]
    fn corners_are_points() {
        assert!(cut(&[&[0, 1, 3]], 3).is_err_and(|error| error.to_string().contains("names point 3")));
        assert!(cut(&[&[0, 1, row_of(f64::NAN)]], 3).is_err());
        assert_eq!(row_of(1.5), -1);
    }
}
