//! Contents of a cloud file: points, normals, faces, colours, intensities.

use std::ops::Range;

use crate::error::Result;
use crate::memory;

/// Contents of a file, with the points in its order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CloudContent {
    /// Coordinates as stored: some may be NaN or infinite.
    pub points: Vec<[f64; 3]>,
    /// One per point.
    pub normals: Option<Vec<[f64; 3]>>,
    /// Triangles, each three rows of `points`; polygons are split into fans.
    pub faces: Option<Vec<[i64; 3]>>,
    /// Red, green, blue of each point.
    pub colors: Option<Vec<[u8; 3]>>,
    /// Intensity of each point's return, in the unit of the file.
    pub intensities: Option<Vec<f32>>,
    /// Position of the scanner, in the frame of the points.
    pub viewpoint: Option<[f64; 3]>,
}

/// Columns of a [`Row`].
pub(super) const POSITION: [usize; 3] = [0, 1, 2];
pub(super) const NORMAL: [usize; 3] = [3, 4, 5];
pub(super) const COLOR: [usize; 3] = [6, 7, 8];
pub(super) const INTENSITY: usize = 9;

/// Numbers of one point: position, normal, colour, intensity.
pub(super) type Row = [f64; 10];

/// Names of intensities.
pub(super) const INTENSITY_NAMES: [&str; 2] = ["intensity", "scalar_intensity"];

/// Least opacity of a visible splat, as the stored logit: 0.1.
const LEAST_OPACITY: f64 = -2.197_224_577_336_219_6;

/// Scale of the colour numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColorScale {
    /// 0 to 255.
    Bytes,
    /// Real numbers: 0 to 1, unless one is greater.
    Reals,
}

/// Points being read, by rows.
pub(super) struct Points {
    content: CloudContent,
    reals: Option<Vec<[f64; 3]>>,
    intensities: Option<Vec<f64>>,
    scale: ColorScale,
}

impl Points {
    /// Reserves room for `count` points, with or without normals and colours.
    pub fn with_capacity(count: usize, normals: bool, colors: Option<ColorScale>) -> Result<Self> {
        let points = memory::with_capacity(count)?;
        let normals = normals.then(|| memory::with_capacity(count)).transpose()?;
        let reals = colors.map(|_| memory::with_capacity(count)).transpose()?;
        let content = CloudContent { points, normals, ..CloudContent::default() };
        Ok(Self { content, reals, intensities: None, scale: colors.unwrap_or(ColorScale::Bytes) })
    }

    /// Reserves room for intensities, if the points have them.
    pub fn with_intensities(mut self, has_intensities: bool) -> Result<Self> {
        let count = self.content.points.capacity();
        self.intensities = has_intensities.then(|| memory::with_capacity(count)).transpose()?;
        Ok(self)
    }

    /// Adds a point.
    pub fn push(&mut self, row: &Row) -> Result<()> {
        memory::push(&mut self.content.points, POSITION.map(|i| row[i]))?;
        if let Some(normals) = &mut self.content.normals {
            memory::push(normals, NORMAL.map(|i| row[i]))?;
        }
        if let Some(colors) = &mut self.reals {
            memory::push(colors, COLOR.map(|i| row[i]))?;
        }
        if let Some(intensities) = &mut self.intensities {
            memory::push(intensities, row[INTENSITY])?;
        }
        Ok(())
    }

    /// Adds points at the origin, and returns their rows.
    pub fn grow(&mut self, more: usize) -> Result<Range<usize>> {
        let len = self.len();
        let rows = len..len + more;
        let Self { content, reals, intensities, .. } = self;
        for triples in
            [Some(&mut content.points), content.normals.as_mut(), reals.as_mut()].into_iter().flatten()
        {
            memory::reserve(triples, more)?;
            triples.resize(rows.end, [0.0; 3]);
        }
        if let Some(intensities) = intensities {
            memory::reserve(intensities, more)?;
            intensities.resize(rows.end, 0.0);
        }
        Ok(rows)
    }

    /// A column of a [`Row`], for some rows; empty if there is no such column.
    pub fn column(&mut self, rows: Range<usize>, place: usize) -> impl Iterator<Item = &mut f64> {
        let triples = match place / 3 {
            0 => Some(&mut self.content.points),
            1 => self.content.normals.as_mut(),
            2 => self.reals.as_mut(),
            _ => None,
        };
        let triples = triples.and_then(|triples| triples.get_mut(rows.clone())).unwrap_or_default();
        let alone = self.intensities.as_mut().filter(|_| place == INTENSITY);
        let alone = alone.and_then(|numbers| numbers.get_mut(rows)).unwrap_or_default();
        triples.iter_mut().map(move |triple| &mut triple[place % 3]).chain(alone)
    }

    /// Colours of some rows.
    pub fn colors(&mut self, rows: Range<usize>) -> impl Iterator<Item = &mut [f64; 3]> {
        self.reals.as_mut().and_then(|colors| colors.get_mut(rows)).unwrap_or_default().iter_mut()
    }

    /// Makes transparent splats NaN points. The last normal column holds each splat's opacity.
    pub fn opaque(mut self) -> Self {
        let normals = self.content.normals.take().unwrap_or_default();
        for (point, [.., opacity]) in self.content.points.iter_mut().zip(normals) {
            if opacity.is_nan() || opacity < LEAST_OPACITY {
                *point = [f64::NAN; 3];
            }
        }
        self
    }

    /// Number of points read.
    pub fn len(&self) -> usize {
        self.content.points.len()
    }

    /// The cloud, with its triangles.
    pub fn finish(mut self, faces: Option<Vec<[i64; 3]>>) -> Result<CloudContent> {
        self.content.faces = faces;
        self.content.colors = self.reals.map(|reals| bytes_of(&reals, self.scale)).transpose()?;
        let single = |numbers: Vec<f64>| memory::collect(numbers.iter().map(|&number| number as f32));
        self.content.intensities = self.intensities.map(single).transpose()?;
        Ok(self.content)
    }
}

/// Converts colours to bytes; integers are kept.
pub(super) fn bytes_of(colors: &[[f64; 3]], scale: ColorScale) -> Result<Vec<[u8; 3]>> {
    let is_share = scale == ColorScale::Reals && colors.as_flattened().iter().all(|value| *value <= 1.0);
    // A cast of a number out of range gives the nearest byte.
    let byte = |value: f64| if is_share { (value * 255.0).round() as u8 } else { value as u8 };
    memory::collect(colors.iter().map(|color| color.map(byte)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_become_bytes() {
        let colors = [[0.0, 0.5, 1.0], [0.25, -1.0, f64::NEG_INFINITY]];
        assert_eq!(bytes_of(&colors, ColorScale::Reals), Ok(vec![[0, 128, 255], [64, 0, 0]]));
        assert_eq!(bytes_of(&colors, ColorScale::Bytes), Ok(vec![[0, 0, 1], [0, 0, 0]]));
        assert_eq!(bytes_of(&[[0.0, 1.0, 300.0]], ColorScale::Reals), Ok(vec![[0, 1, 255]]));
    }
}
