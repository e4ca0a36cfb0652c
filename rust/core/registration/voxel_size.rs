//! The voxel that suits several scans.

use nalgebra::{Point3, Vector3};

use crate::cloud::Cloud;
use crate::error::Result;
use crate::execution::Execution;
use crate::features::normals::{Neighborhood, surfaces};
use crate::features::voxels::{choose_voxel, count_voxels, thin_own};
use crate::points::Points;

use super::settings::{NORMAL_NEIGHBORS, NORMAL_RADIUS, UNIT};

/// Voxels of a scan on average, about.
const VOXELS: usize = 5000;
/// Voxels of a scan that is so much smaller than another.
const LEAST_OF_EACH: usize = 1000;
const SIZES_DIFFER: f64 = 2.0;
/// Voxels below which unrelated scans fit each other too well by chance, and beyond which matching takes too long.
const LEAST_VOXELS: usize = 100;
const MOST_VOXELS: usize = 100_000;
/// Points below which voxels begin finer, and by how much: else too few are left.
const FEW_POINTS: usize = 300;
const FINER_OF_FEW: f64 = 0.5;
/// Points below which a voxel chosen by number may be too small. It grows in such steps until a share of the voxels has a normal;
/// a diagonal has more voxels than the last.
const SPARSE: usize = 2000;
const USUAL_PLANES: f64 = 0.9;
const COARSER: f64 = 1.189_207_115_002_721; // 2^(1/4)
const LEAST_ACROSS: f64 = 5.0;
/// Most blocks of a surface's box, and along its edge: half of those allowed; and the edge of one, in voxels.
const MOST_BLOCKS: f64 = (1_u64 << 29) as f64;
const MOST_ALONG: f64 = (1_u64 << 16) as f64;
const BLOCK: f64 = 8.0 * UNIT;

/// A voxel, or why there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Suited {
    /// Edge length of the voxels.
    Voxel(f64),
    /// No voxel suits both the smallest and the largest scan, whose rows these are.
    Unlike(usize, usize),
}

/// Returns a voxel that suits all scans, including the sparsest and the widest.
///
/// About 5000 voxels are left of a scan on average, more if the scans differ in size. The voxel is large enough for a plane in
/// most voxels, and for the surface's table of the bounding box.
///
/// # Errors
/// [`crate::Error::InvalidInput`] for points that all coincide; [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn suit_voxel(clouds: &[&Cloud], execution: &Execution) -> Result<Suited> {
    let owns = clouds.iter().map(|cloud| cloud.own()).collect::<Result<Vec<_>>>()?;
    let turned: Vec<&Points> = owns.iter().map(|own| &own.1).collect();
    let mut size = match by_number(&turned, execution)? {
        Suited::Voxel(size) => size,
        unlike @ Suited::Unlike(..) => return Ok(unlike),
    };
    if turned.iter().any(|points| points.len() < FEW_POINTS) {
        size *= FINER_OF_FEW;
    }
    size = clouds.iter().map(|cloud| least_voxel(cloud.points())).fold(size, f64::max);
    let mut sparse: Vec<_> = owns.iter().filter(|own| own.1.len() < SPARSE).collect();
    sparse.sort_by_key(|own| own.1.len());
    for own in sparse {
        let (mut coarser, most) = (size, own.1.diagonal() / LEAST_ACROSS);
        while coarser < most && !is_surface(own, coarser, execution)? {
            coarser *= COARSER;
        }
        if coarser < most {
            size = coarser;
        }
    }
    Ok(Suited::Voxel(size))
}

/// Returns the usual voxel of all scans, or a smaller one for the smallest scan.
fn by_number(scans: &[&Points], execution: &Execution) -> Result<Suited> {
    let usual = choose_voxel(scans, VOXELS, execution)?;
    let size_of = |row: &usize| scans[*row].diagonal();
    let by_size = |one: &usize, other: &usize| size_of(one).total_cmp(&size_of(other));
    let small = (0..scans.len()).min_by(by_size).unwrap_or_default();
    let large = (0..scans.len()).rev().max_by(by_size).unwrap_or_default();
    if size_of(&large) < SIZES_DIFFER * size_of(&small) {
        return Ok(Suited::Voxel(usual));
    }
    let needed = choose_voxel(&[scans[small]], LEAST_OF_EACH, execution)?;
    let mut size = usual;
    for most in [MOST_VOXELS / 2, MOST_VOXELS] {
        size = usual.min(needed.max(choose_voxel(&[scans[large]], most, execution)?));
        if count_voxels(scans[small], size)? >= LEAST_VOXELS {
            return Ok(Suited::Voxel(size));
        }
    }
    let suits_none = count_voxels(scans[small], needed)? < LEAST_VOXELS; // whatever the partner
    Ok(if suits_none { Suited::Voxel(size) } else { Suited::Unlike(small, large) })
}

/// Returns the voxel at which the bounding box of a scan has the largest number of blocks of a surface.
fn least_voxel(points: &Points) -> f64 {
    let sides = Vector3::from(points.bounding_box().1);
    let mut voxel = sides.amax() / BLOCK / MOST_ALONG;
    while sides.map(|side| (side / (BLOCK * voxel)).floor() + 3.0).product() > MOST_BLOCKS {
        voxel *= COARSER;
    }
    voxel
}

/// Returns whether most voxels of a scan have enough neighbours for a plane.
fn is_surface(own: &crate::cloud::Own, voxel: f64, execution: &Execution) -> Result<bool> {
    let rows = thin_own(own, None, voxel, execution)?.points;
    let around = Neighborhood::NearestWithin(NORMAL_NEIGHBORS, NORMAL_RADIUS * voxel);
    let fits = surfaces(&Cloud::from_rows("voxels", &rows)?, around, Point3::origin(), execution)?;
    let planes = fits.iter().filter(|fit| !fit.normal.x.is_nan()).count();
    Ok(planes as f64 >= USUAL_PLANES * fits.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on a bent sheet of a size.
    fn sheet(count: u32, size: f64) -> Result<Cloud> {
        let point = |i: u32| {
            let [x, y] = [0.618_033_988_749, 0.754_877_666_247].map(|step| (f64::from(i) * step).fract());
            [x, y, 0.2 * (5.0 * x).sin() * y].map(|part| size * part)
        };
        Cloud::from_rows("points", &(0..count).map(point).collect::<Vec<_>>())
    }

    fn suit(clouds: &[&Cloud]) -> Result<f64> {
        Ok(match suit_voxel(clouds, &Execution::default())? {
            Suited::Voxel(size) => size,
            Suited::Unlike(..) => f64::NAN,
        })
    }

    fn count(cloud: &Cloud, size: f64) -> Result<usize> {
        count_voxels(&cloud.own()?.1, size)
    }

    #[test]
    fn scans_of_like_size_get_the_usual_number() -> Result<()> {
        let (one, other) = (sheet(40_000, 1.0)?, sheet(30_000, 1.5)?);
        let size = suit(&[&one, &other])?;
        assert!((9000..=10_000).contains(&(count(&one, size)? + count(&other, size)?)));
        Ok(())
    }

    #[test]
    fn a_small_scan_gets_enough_voxels_beside_a_large_one() -> Result<()> {
        let (small, large) = (sheet(20_000, 1.0)?, sheet(200_000, 8.0)?);
        let size = suit(&[&large, &small])?;
        assert!(count(&small, size)? > 500 && count(&large, size)? <= MOST_VOXELS);
        let speck = sheet(20_000, 1e-3)?;
        let found = suit_voxel(&[&large, &speck], &Execution::default())?;
        assert_eq!(found, Suited::Unlike(1, 0));
        Ok(())
    }

    #[test]
    fn sparse_scans_get_voxels_with_planes() -> Result<()> {
        let (sparse, dense) = (sheet(600, 1.0)?, sheet(40_000, 1.0)?);
        let size = suit(&[&sparse, &dense])?;
        assert!(size > suit(&[&dense, &dense])?);
        let own = sparse.own()?;
        assert!(is_surface(&own, size, &Execution::default())?);
        assert!(suit(&[&sheet(100, 1.0)?])?.is_finite());
        Ok(())
    }

    #[test]
    fn a_wide_box_has_few_blocks() -> Result<()> {
        let parts = (0..40_000_u32).map(|i| {
            let corner = [i / 5000 % 2, i / 10_000 % 2, i / 20_000].map(|side| 1e6 * f64::from(side));
            [0, 1, 2].map(|k| corner[k] + (f64::from(i) * [0.618, 0.754, 0.569][k]).fract())
        });
        let wide = Cloud::from_rows("points", &parts.collect::<Vec<_>>())?;
        let blocks = (1e6 / (BLOCK * suit(&[&wide])?)).powi(3);
        assert!(blocks <= MOST_BLOCKS);
        Ok(())
    }
}
