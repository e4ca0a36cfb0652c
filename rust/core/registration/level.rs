//! A scan downsampled to voxels of one size, with everything that registration computes from them.

use std::ops::RangeInclusive;
use std::sync::{Arc, OnceLock};

use nalgebra::{Point3, Vector3};

use crate::cloud::Cloud;
use crate::error::Result;
use crate::execution::Execution;
use crate::features::fpfh::{self, Convention, Fpfh};
use crate::features::matching::Descriptors;
use crate::features::normals::{Neighborhood, surfaces};
use crate::features::shot_lrf::shot_frames;
use crate::features::voxels::thin_own;
use crate::frames::Frame;
use crate::memory;
use crate::points::Points;
use crate::verification::{FineSurface, Side, Surface};

use super::lazy::lazily;
use super::parts::{Part, find_parts};
use super::planes::Planes;
use super::scan::Scan;
use super::settings::{
    FEATURE_NEIGHBORS, FEATURE_RADIUS, FINE, FRAME_RADIUS, LEAST_PLANAR_VOXELS, LEAST_PLANES,
    NORMAL_NEIGHBORS, NORMAL_RADIUS, UNIT,
};

/// Radii of normals, frames and descriptors, in voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radii {
    /// Of the planes of normals.
    pub normal: f64,
    /// Of a descriptor's support.
    pub support: f64,
    /// Of the support of SHOT's frames.
    pub frame: f64,
}

impl Default for Radii {
    fn default() -> Self {
        Self { normal: NORMAL_RADIUS, support: FEATURE_RADIUS, frame: FRAME_RADIUS }
    }
}

/// Side of the surface to which normals point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outside {
    /// Towards the scanner.
    Viewpoint([f64; 3]),
    /// As the normals of the file.
    Given,
    /// To the side of SHOT's z axis; the scanner, if it is known, still observes free space.
    Frames(Option<[f64; 3]>),
}

/// Voxels that have a descriptor.
#[derive(Debug)]
pub struct Described {
    /// Rows of the voxels.
    pub rows: Vec<u32>,
    /// Positions of these voxels, in the data's own coordinates.
    pub points: Vec<[f64; 3]>,
    /// Their frames.
    pub frames: Vec<Frame>,
    /// Their descriptors.
    pub descriptors: Descriptors,
}

impl Described {
    /// Returns the descriptors of the mirror image.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn mirrored(&self) -> Result<Descriptors> {
        let mut values = memory::copied(self.descriptors.values())?;
        values.chunks_exact_mut(fpfh::LENGTH).for_each(fpfh::mirror);
        Descriptors::new("descriptors", &values, fpfh::LENGTH)
    }
}

/// Reason why a scan has no level of a voxel size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// So few voxels are no surface.
    Few(usize),
    /// So many voxels would take too long.
    Many(usize),
    /// Number of voxels with a normal, and of all: the points lie too far apart.
    NotPlanar(usize, usize),
}

/// A scan at one voxel size.
#[derive(Debug)]
pub struct Level {
    scan: Arc<Scan>,
    voxel: f64,
    radii: Radii,
    outside: Outside,
    cloud: Cloud,
    points: Vec<Vector3<f64>>,
    normals: Vec<Vector3<f64>>,
    surface: Arc<Surface>,
    frames: OnceLock<Vec<Frame>>,
    described: OnceLock<Described>,
    planes: OnceLock<Planes>,
    parts: OnceLock<Vec<Part>>,
    fine: [OnceLock<Option<Arc<FineSurface>>>; FINE.len()],
    cells: [OnceLock<(Vec<u32>, usize)>; FINE.len()],
}

impl Level {
    /// Downsamples a scan, and estimates the normals of its voxels; a refusal if they do not form a surface,
    /// or if their number is not `allowed`.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] for voxels that are too small for the box around the scan; [`crate::Error::Interrupted`],
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        scan: Arc<Scan>,
        voxel: f64,
        radii: Radii,
        outside: Outside,
        allowed: RangeInclusive<usize>,
        execution: &Execution,
    ) -> Result<std::result::Result<Self, Refusal>> {
        let given = if outside == Outside::Given { scan.normals() } else { None };
        let voxels = thin_own(scan.own(), given, voxel, execution)?;
        match voxels.points.len() {
            count if count < *allowed.start() => return Ok(Err(Refusal::Few(count))),
            count if count > *allowed.end() => return Ok(Err(Refusal::Many(count))),
            _ => {}
        }
        let cloud = Cloud::new(Points::from_rows("voxels", &voxels.points)?);
        let frames = OnceLock::new();
        let eye = match outside {
            Outside::Viewpoint(eye) => eye,
            _ => scan.centroid().into(),
        };
        let around = Neighborhood::NearestWithin(NORMAL_NEIGHBORS, radii.normal * voxel);
        let planes = surfaces(&cloud, around, Point3::from(eye), execution)?;
        let mut normals = memory::collect(planes.iter().map(|plane| plane.normal))?;
        let planar = normals.iter().filter(|normal| normal.x.is_finite()).count();
        if planar < LEAST_PLANAR_VOXELS || (planar as f64) < LEAST_PLANES * normals.len() as f64 {
            return Ok(Err(Refusal::NotPlanar(planar, normals.len())));
        }
        match outside {
            Outside::Viewpoint(_) => {}
            Outside::Given => orient(&mut normals, voxels.normals.iter().copied()),
            Outside::Frames(_) => {
                let found = lazily(&frames, || frames_of(&cloud, radii.frame * voxel, execution))?;
                let axis =
                    |frame: &Frame| frame.map_or(Vector3::repeat(f64::NAN), |axes| axes.row(2).transpose());
                orient(&mut normals, found.iter().map(axis));
            }
        }
        let surface = surface_of(&cloud, &normals, UNIT * voxel, outside, execution)?;
        let points = memory::collect(voxels.points.iter().map(|&point| Vector3::from(point)))?;
        Ok(Ok(Self {
            scan,
            voxel,
            radii,
            outside,
            cloud,
            points,
            normals,
            surface: Arc::new(surface),
            frames,
            described: OnceLock::new(),
            planes: OnceLock::new(),
            parts: OnceLock::new(),
            fine: Default::default(),
            cells: Default::default(),
        }))
    }

    /// Returns the level of a part of a scan whose voxels, normals and descriptors are known.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] for points that are no surface; [`crate::Error::Interrupted`],
    /// [`crate::Error::OutOfMemory`].
    pub fn of_parts(
        scan: Arc<Scan>,
        voxel: f64,
        outside: Outside,
        (points, normals): (Vec<Vector3<f64>>, Vec<Vector3<f64>>),
        described: Described,
        execution: &Execution,
    ) -> Result<Self> {
        let rows = memory::collect(points.iter().map(|&point| point.into()))?;
        let cloud = Cloud::from_rows("voxels", &rows)?;
        let surface = Arc::new(surface_of(&cloud, &normals, UNIT * voxel, outside, execution)?);
        Ok(Self {
            scan,
            voxel,
            radii: Radii::default(),
            outside,
            cloud,
            points,
            normals,
            surface,
            frames: OnceLock::new(),
            described: OnceLock::from(described),
            planes: OnceLock::new(),
            parts: OnceLock::new(),
            fine: Default::default(),
            cells: Default::default(),
        })
    }

    /// Returns the whole scan.
    pub fn scan(&self) -> &Arc<Scan> {
        &self.scan
    }

    /// Returns the edge length of the voxels.
    pub fn voxel(&self) -> f64 {
        self.voxel
    }

    /// Returns the side to which normals point.
    pub fn outside(&self) -> Outside {
        self.outside
    }

    /// Returns the position of the scanner, if it is known.
    pub fn viewpoint(&self) -> Option<[f64; 3]> {
        match self.outside {
            Outside::Viewpoint(eye) => Some(eye),
            Outside::Frames(eye) => eye,
            Outside::Given => None,
        }
    }

    /// Returns the number of voxels.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Returns whether there is no voxel.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Returns the mean point of each voxel, in the data's own coordinates.
    pub fn points(&self) -> &[Vector3<f64>] {
        &self.points
    }

    /// Returns the normal of each voxel; NaN for none.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// Returns the surface for verification.
    pub fn surface(&self) -> &Arc<Surface> {
        &self.surface
    }

    /// Returns SHOT's frame of each voxel.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn frames(&self, execution: &Execution) -> Result<&[Frame]> {
        let found = lazily(&self.frames, || frames_of(&self.cloud, self.radii.frame * self.voxel, execution));
        found.map(Vec::as_slice)
    }

    /// Returns frames and FPFH of the voxels that have them.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn described(&self, execution: &Execution) -> Result<&Described> {
        lazily(&self.described, || self.describe(execution))
    }

    fn describe(&self, execution: &Execution) -> Result<Described> {
        let fpfh = Fpfh {
            radius: self.radii.support * self.voxel,
            max_neighbors: Some(FEATURE_NEIGHBORS),
            convention: Convention::Open3d,
        };
        let values = fpfh.describe(&self.cloud, &self.normals, None, execution)?;
        let is_described = |row: &&u32| {
            let values = &values[**row as usize];
            values.iter().all(|value| value.is_finite()) && values.iter().any(|&value| value != 0.0)
        };
        let all = memory::collect(0..values.len() as u32)?;
        let rows = memory::collect(all.iter().filter(is_described).copied())?;
        let frames = self.frames(execution)?;
        // Descriptors are stored and matched in single precision, as those of the Python package.
        let kept = memory::collect(rows.iter().flat_map(|&row| values[row as usize]))?;
        Ok(Described {
            points: memory::collect(rows.iter().map(|&row| self.points[row as usize].into()))?,
            frames: memory::collect(rows.iter().map(|&row| frames[row as usize]))?,
            descriptors: Descriptors::new("descriptors", &kept, fpfh::LENGTH)?,
            rows,
        })
    }

    /// Computes what a search needs of the level; descriptors only if matches take part.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn complete(&self, is_matched: bool, execution: &Execution) -> Result<()> {
        if is_matched {
            self.described(execution)?;
        }
        self.fine_surface(0, execution)?;
        self.planes(execution).map(drop)
    }

    /// Returns the planes of the voxels.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn planes(&self, execution: &Execution) -> Result<&Planes> {
        lazily(&self.planes, || Planes::find(&self.points, self.voxel, execution))
    }

    /// Returns the small separate parts of the voxels.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn parts(&self) -> Result<&[Part]> {
        lazily(&self.parts, || find_parts(&self.points, self.scan.axes(), self.voxel)).map(Vec::as_slice)
    }

    /// Returns the fine surface of a spacing of `FINE`; none if the cloud is too sparse for it.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn fine_surface(&self, level: usize, execution: &Execution) -> Result<Option<&Arc<FineSurface>>> {
        let spacing = FINE[level] * self.voxel;
        lazily(&self.fine[level], || self.scan.fine_surface(spacing, execution)).map(Option::as_ref)
    }

    /// Returns the cell of 4 voxels of each sample of a fine surface, and the number of cells.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn cells(
        &self,
        level: usize,
        surface: &FineSurface,
        execution: &Execution,
    ) -> Result<&(Vec<u32>, usize)> {
        lazily(&self.cells[level], || {
            let places = memory::collect(surface.sample_points())?;
            let planes = self.planes(execution)?;
            planes.number_cells(&places, &self.points, self.voxel, self.scan.axes(), execution)
        })
    }
}

fn frames_of(cloud: &Cloud, radius: f64, execution: &Execution) -> Result<Vec<Frame>> {
    let rows = memory::collect(0..cloud.points().len())?;
    shot_frames(cloud, &rows, radius, execution)
}

/// Turns normals to the side of some directions; those beside a direction that is not finite keep their side.
fn orient(normals: &mut [Vector3<f64>], towards: impl Iterator<Item = Vector3<f64>>) {
    for (normal, towards) in normals.iter_mut().zip(towards) {
        if normal.dot(&towards) < 0.0 {
            *normal = -*normal;
        }
    }
}

fn surface_of(
    cloud: &Cloud,
    normals: &[Vector3<f64>],
    unit: f64,
    outside: Outside,
    execution: &Execution,
) -> Result<Surface> {
    let side = match outside {
        Outside::Viewpoint(eye) | Outside::Frames(Some(eye)) => Side::Viewpoint(eye),
        Outside::Given => Side::Known,
        Outside::Frames(None) => Side::Unknown,
    };
    Surface::new(cloud.points(), normals, unit, side, execution)
}

/// Two scans at the same voxel size.
#[derive(Debug, Clone, Copy)]
pub struct Pair<'a> {
    /// The scan that a pose moves.
    pub source: &'a Level,
    /// The scan that stays.
    pub target: &'a Level,
}

/// Fine surfaces of two scans with the same spacing.
#[derive(Debug, Clone, Copy)]
pub struct FinePair<'a> {
    /// Index of the spacing in [`FINE`].
    pub level: usize,
    /// Fine surface of the source.
    pub source: &'a FineSurface,
    /// Fine surface of the target.
    pub target: &'a FineSurface,
}

impl<'a> Pair<'a> {
    /// Returns the voxel size.
    pub fn voxel(&self) -> f64 {
        self.source.voxel()
    }

    /// Returns the pair with the roles swapped.
    #[must_use]
    pub fn turned(&self) -> Self {
        Self { source: self.target, target: self.source }
    }

    /// Returns the fine surfaces of both scans, at the first spacing that the sparser one allows; none if neither has planes.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn fine(&self, execution: &Execution) -> Result<Option<FinePair<'a>>> {
        for level in 0..FINE.len() {
            let source = self.source.fine_surface(level, execution)?;
            let target = self.target.fine_surface(level, execution)?;
            if let (Some(source), Some(target)) = (source, target) {
                return Ok(Some(FinePair { level, source, target }));
            }
        }
        Ok(None)
    }
}
