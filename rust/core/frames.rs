//! Local reference frames of matched keypoints, in the caller's precision.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::Matrix3;

use crate::error::{Error, Result};
use crate::memory;
use crate::simd::{self, DOUBLES};

/// A local reference frame: rows are the x, y and z axes. `None`: no frame could be computed.
pub type Frame = Option<Matrix3<f64>>;

/// A frame by rows; NaN marks a missing frame.
pub type FrameBlock<T> = [T; 9];

/// The frames of one side, in the precision given: most of the time goes into moving them.
#[derive(Debug, Clone, PartialEq)]
pub enum Frames {
    /// In single precision.
    Single(Vec<FrameBlock<f32>>),
    /// In double precision.
    Double(Vec<FrameBlock<f64>>),
}

/// Input that frames can be made from.
pub trait IntoFrames {
    /// The frames.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    fn into_frames(self) -> Result<Frames>;
}

impl IntoFrames for Frames {
    fn into_frames(self) -> Result<Frames> {
        Ok(self)
    }
}

impl IntoFrames for Vec<Frame> {
    fn into_frames(self) -> Result<Frames> {
        let block =
            |frame: Frame| frame.map_or([f64::NAN; 9], |axes| std::array::from_fn(|k| axes[(k / 3, k % 3)]));
        memory::collect(self.into_iter().map(block)).map(Frames::Double)
    }
}

impl Frames {
    /// Number of frames, including missing ones.
    pub fn len(&self) -> usize {
        match self {
            Self::Single(blocks) => blocks.len(),
            Self::Double(blocks) => blocks.len(),
        }
    }

    /// Whether there are no frames.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Frame `i`.
    pub fn get(&self, i: usize) -> Frame {
        self.block(i).map(|axes| Matrix3::from_row_slice(&axes))
    }

    /// Frame `i` by rows.
    #[inline]
    pub fn block(&self, i: usize) -> Option<FrameBlock<f64>> {
        let block = match self {
            Self::Single(blocks) => blocks[i].map(f64::from),
            Self::Double(blocks) => blocks[i],
        };
        (!is_missing(&block)).then_some(block)
    }

    /// Checks that every frame is a rotation (to 1e-3) or missing.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] naming the first row that is neither.
    pub fn validate(&self, name: &str) -> Result<()> {
        let wrong = match self {
            Self::Single(blocks) => first_wrong(blocks),
            Self::Double(blocks) => first_wrong(blocks),
        };
        let Some(row) = wrong else { return Ok(()) };
        let remedy = "rows must be orthonormal, right-handed x, y, z axes; use NaN for 'no frame'";
        Err(Error::invalid(name, format!("a frame that is no rotation in row {row}"), remedy))
    }
}

#[inline]
fn is_missing(block: &FrameBlock<f64>) -> bool {
    block.iter().fold(false, |missing, value| missing | value.is_nan())
}

/// Greatest deviation of a rotation: that of the entries of `A A^T - I`; reflections deviate more.
const TOLERANCE: f64 = 1e-3;

fn first_wrong<T: Copy + Into<f64>>(blocks: &[FrameBlock<T>]) -> Option<usize> {
    let suspects = |(group, blocks): (usize, &[FrameBlock<T>])| {
        let deviations = deviations(blocks);
        let wrong =
            |lane: &usize| deviations[*lane] > TOLERANCE && !is_missing(&blocks[*lane].map(Into::into));
        (0..blocks.len()).find(wrong).map(|lane| group * DOUBLES + lane)
    };
    blocks.chunks(DOUBLES).enumerate().find_map(suspects)
}

/// Deviation of each frame from a rotation; arbitrary for missing frames.
fn deviations<T: Copy + Into<f64>>(blocks: &[FrameBlock<T>]) -> [f64; DOUBLES] {
    let mut entries = [[0.0; DOUBLES]; 9];
    for (lane, block) in blocks.iter().enumerate() {
        (0..9).for_each(|k| entries[k][lane] = block[k].into());
    }
    simd::run(
        #[inline(always)]
        || {
            let mut deviations = [0.0; DOUBLES];
            for (lane, deviation) in deviations.iter_mut().enumerate() {
                *deviation = deviation_of(&entries, lane);
            }
            deviations
        },
    )
}

#[inline(always)]
fn deviation_of(entries: &[[f64; DOUBLES]; 9], lane: usize) -> f64 {
    let [x, y, z] = [axis(entries, 0, lane), axis(entries, 1, lane), axis(entries, 2, lane)];
    let entries = [dot(x, x) - 1.0, dot(y, y) - 1.0, dot(z, z) - 1.0, dot(x, y), dot(x, z), dot(y, z)];
    let mut greatest = if dot(cross(x, y), z) < 0.0 { f64::INFINITY } else { 0.0 };
    for entry in entries {
        greatest = if entry.abs() > greatest { entry.abs() } else { greatest };
    }
    greatest
}

#[inline(always)]
fn axis(entries: &[[f64; DOUBLES]; 9], row: usize, lane: usize) -> [f64; 3] {
    [entries[3 * row][lane], entries[3 * row + 1][lane], entries[3 * row + 2][lane]]
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};

    fn rotations(n: usize) -> Vec<Frame> {
        let turn = |i: usize| Vector3::new((i * 7) as f64, (i * 3 % 5) as f64, (i * 11 % 13) as f64);
        (0..n).map(|i| (i % 4 != 3).then(|| Rotation3::new(turn(i)).into_inner())).collect()
    }

    #[test]
    fn returns_the_given_frames() -> Result<()> {
        let frames = rotations(21);
        let kept = frames.clone().into_frames()?;
        assert_eq!((0..kept.len()).map(|i| kept.get(i)).collect::<Vec<_>>(), frames);
        kept.validate("source_lrf")
    }

    #[test]
    fn names_the_first_invalid_rotation() -> Result<()> {
        let scaled = Matrix3::identity() * 1.001;
        let mirrored = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        let sheared = Matrix3::new(1.0, 0.01, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        let infinite = Matrix3::from_diagonal(&Vector3::new(f64::INFINITY, 1.0, 1.0));
        for wrong in [scaled, mirrored, sheared, infinite, Matrix3::zeros(), -Matrix3::identity()] {
            for row in [0, 3, 8, 20] {
                let mut frames = rotations(21);
                frames[row] = Some(wrong);
                frames[20] = Some(wrong);
                let Frames::Double(blocks) = frames.into_frames()? else { unreachable!() };
                let single = Frames::Single(blocks.iter().map(|block| block.map(|v| v as f32)).collect());
                for frames in [single, Frames::Double(blocks)] {
                    let text = frames.validate("target_lrf").err().map(|e| e.to_string()).unwrap_or_default();
                    assert!(
                        text.starts_with("target_lrf") && text.contains(&format!("row {row};")),
                        "{text}"
                    );
                }
            }
        }
        Ok(())
    }

    #[test]
    fn missing_frames_are_valid() {
        let mut block = [7.0, f64::INFINITY, 3.0, -2.0, 0.0, 0.0, 0.0, 1.0, 5.0];
        block[4] = f64::NAN;
        assert_eq!(Frames::Double(vec![block; 3]).validate("source_lrf"), Ok(()));
    }
}
