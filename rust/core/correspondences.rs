//! Putative matches between two shapes, validated on construction.

use nalgebra::Point3;

use crate::error::{Error, Result, positive};
use crate::frames::{Frames, IntoFrames};
use crate::points::{MAX_COORDINATE, Points};

pub use crate::frames::Frame;

/// `n` correspondences; row `i` of every field describes the same match.
///
/// Only the fields that the chosen method requires need to be set.
#[derive(Debug, Clone, Default)]
pub struct Correspondences {
    len: usize,
    positions: Option<(Points, Points)>,
    similarity: Option<Vec<f64>>,
    ratio: Option<Vec<f64>>,
    frames: Option<(Frames, Frames)>,
    resolution: Option<f64>,
    source_centroid: Option<Point3<f64>>,
    candidates: Option<Points>,
}

impl Correspondences {
    /// Correspondences without positions, for methods that use descriptors alone.
    pub fn without_positions(len: usize) -> Self {
        Self { len, ..Self::default() }
    }

    /// Correspondences between `source[i]` and `target[i]`.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for unequal lengths, or coordinates that are not finite.
    pub fn new(source: &[[f64; 3]], target: &[[f64; 3]]) -> Result<Self> {
        Self::between(Points::from_rows("source", source)?, Points::from_rows("target", target)?)
    }

    /// Correspondences between the points of two sets, in their order.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for unequal lengths.
    pub fn between(source: Points, target: Points) -> Result<Self> {
        check_len("target", target.len(), source.len())?;
        Ok(Self { len: source.len(), positions: Some((source, target)), ..Self::default() })
    }

    /// Adds descriptor similarities, higher is better. Negative infinity stands for "no descriptor".
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a wrong length or NaN.
    pub fn with_similarity(mut self, similarity: Vec<f64>) -> Result<Self> {
        check_len("similarity", similarity.len(), self.len)?;
        for (i, &value) in similarity.iter().enumerate() {
            if value.is_nan() || value == f64::INFINITY {
                let remedy = "similarities must be numbers; use -inf where there is no descriptor";
                return Err(Error::invalid("similarity", format!("{value} in row {i}"), remedy));
            }
        }
        self.similarity = Some(similarity);
        Ok(self)
    }

    /// Adds ratios of nearest to second-nearest descriptor distance, in 0..=1, lower is better.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a wrong length or a value outside 0..=1.
    pub fn with_ratio(mut self, ratio: Vec<f64>) -> Result<Self> {
        check_len("ratio", ratio.len(), self.len)?;
        for (i, value) in ratio.iter().enumerate() {
            if !(0.0..=1.0).contains(value) {
                let remedy = "a ratio of nearest to second-nearest distance lies between 0 and 1; \
                              use 1 where there is no second neighbour";
                return Err(Error::invalid("ratio", format!("{value} in row {i}"), remedy));
            }
        }
        self.ratio = Some(ratio);
        Ok(self)
    }

    /// Adds local reference frames of both sides.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a wrong length, or a frame that is not a rotation to 1e-3;
    /// [`Error::OutOfMemory`].
    pub fn with_frames(mut self, source: impl IntoFrames, target: impl IntoFrames) -> Result<Self> {
        let frames = (source.into_frames()?, target.into_frames()?);
        for (name, side) in [("source_lrf", &frames.0), ("target_lrf", &frames.1)] {
            check_len(name, side.len(), self.len)?;
            side.validate(name)?;
        }
        self.frames = Some(frames);
        Ok(self)
    }

    /// Sets the unit *pr*: the mean nearest-neighbour distance of the clouds.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] unless it is finite and greater than 0.
    pub fn with_resolution(mut self, resolution: f64) -> Result<Self> {
        self.resolution = Some(positive("resolution", resolution)?);
        Ok(self)
    }

    /// Sets the centroid of the whole source cloud, the reference point of 3D Hough voting.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] unless it is finite.
    pub fn with_source_centroid(mut self, centroid: [f64; 3]) -> Result<Self> {
        if centroid.iter().any(|value| !value.is_finite() || value.abs() > MAX_COORDINATE) {
            let remedy = "give three finite coordinates of at most 1e150";
            return Err(Error::invalid("source_centroid", format!("{centroid:?}"), remedy));
        }
        self.source_centroid = Some(Point3::from(centroid));
        Ok(self)
    }

    /// Adds candidate target points of each source point, the same number for each, the likeliest first.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if their number is not a multiple of the number of correspondences.
    pub fn with_candidates(mut self, candidates: Points) -> Result<Self> {
        if !candidates.len().is_multiple_of(self.len.max(1)) {
            let remedy = format!("give as many for each of the {} correspondences", self.len);
            return Err(Error::invalid("candidates", format!("{} points", candidates.len()), remedy));
        }
        self.candidates = (!candidates.is_empty()).then_some(candidates);
        Ok(self)
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Source and target points.
    ///
    /// # Errors
    /// [`Error::MissingField`] if they are not set.
    pub fn positions(&self, method: &'static str) -> Result<(&Points, &Points)> {
        let remedy = "give the matched points of both shapes";
        self.positions.as_ref().map(|(s, t)| (s, t)).ok_or(Error::MissingField {
            method,
            field: "source",
            remedy,
        })
    }

    /// Descriptor similarities, `1 - |f_norm - f'_norm|`.
    ///
    /// # Errors
    /// [`Error::MissingField`] if they are not set.
    pub fn similarity(&self, method: &'static str) -> Result<&[f64]> {
        let remedy = "it comes from descriptor matching: 1 - |f - f'| on unit descriptors";
        self.similarity.as_deref().ok_or(Error::MissingField { method, field: "similarity", remedy })
    }

    /// Descriptor similarities, for methods that do not require them.
    pub fn optional_similarity(&self) -> Option<&[f64]> {
        self.similarity.as_deref()
    }

    /// Ratios of nearest to second-nearest descriptor distance.
    ///
    /// # Errors
    /// [`Error::MissingField`] if they are not set.
    pub fn ratio(&self, method: &'static str) -> Result<&[f64]> {
        let remedy = "it comes from descriptor matching: nearest / second-nearest distance";
        self.ratio.as_deref().ok_or(Error::MissingField { method, field: "ratio", remedy })
    }

    /// Ratios of nearest to second-nearest descriptor distance, for methods that do not require them.
    pub fn optional_ratio(&self) -> Option<&[f64]> {
        self.ratio.as_deref()
    }

    /// Local reference frames of source and target.
    ///
    /// # Errors
    /// [`Error::MissingField`] if they are not set.
    pub fn frames(&self, method: &'static str) -> Result<(&Frames, &Frames)> {
        let remedy = "compute local reference frames at the keypoints of both clouds (SHOT's, for one)";
        let missing = Error::MissingField { method, field: "source_lrf", remedy };
        self.frames.as_ref().map(|(s, t)| (s, t)).ok_or(missing)
    }

    /// Candidate target points of each source point, sorted by correspondence.
    pub fn candidates(&self) -> Option<&Points> {
        self.candidates.as_ref()
    }

    /// Returns the length `given`, or else `factor` times the resolution.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a length that is not positive, or if neither is known.
    pub fn length(&self, name: &str, given: Option<f64>, factor: f64) -> Result<f64> {
        if let Some(value) = given {
            return positive(name, value);
        }
        let Some(resolution) = self.resolution else {
            let remedy = format!(
                "give `resolution` (mean nearest-neighbour distance of the clouds, see cgroup.features.resolution); \
                 the paper's default is {factor} times it; or give `{name}`, a length in the data's unit, or let \
                 cgroup.group(matches, method, tolerance=\"auto\") estimate it"
            );
            return Err(Error::invalid(name, "nothing", remedy));
        };
        Ok(factor * resolution)
    }

    /// The resolution, if known.
    pub fn resolution(&self) -> Option<f64> {
        self.resolution
    }

    /// Centroid of the source cloud relative to the source points' centre, if known.
    pub fn centered_source_centroid(&self) -> Option<Point3<f64>> {
        let (source, _) = self.positions.as_ref()?;
        self.source_centroid.map(|centroid| centroid - source.center())
    }
}

fn check_len(name: &str, got: usize, expected: usize) -> Result<()> {
    if got == expected {
        return Ok(());
    }
    let remedy = format!("every field needs one row per correspondence, here {expected}");
    Err(Error::invalid(name, format!("{got} rows"), remedy))
}
