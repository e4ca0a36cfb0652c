//! Arbitrary clouds in one step of the front end.

use arbitrary::{Result, Unstructured};
use cgroup::features::fpfh::{Convention, Fpfh};
use cgroup::features::harris3d::{Harris3d, Response};
use cgroup::features::iss::{Covariance, Iss};
use cgroup::features::keypoints::drop_isolated;
use cgroup::features::lfsh::Lfsh;
use cgroup::features::normals::{Neighborhood, surfaces};
use cgroup::features::rcs::Rcs;
use cgroup::features::shot::Shot;
use cgroup::features::shot_lrf::shot_frames;
use cgroup::features::toldi_lrf::toldi_frames;
use cgroup::features::voxels::{choose_voxel, voxel_downsample};
use cgroup::{Cloud, Execution};
use nalgebra::{Point3, Vector3};

use super::check::{finite, finite_or_missing, indices, on_threads};
use super::draw::{self, count, length, maybe, number};

pub fn run(input: &mut Unstructured) -> Result<()> {
    let step = input.int_in_range(0..=11)?;
    let rows = draw::points(input, 300)?;
    let Ok(cloud) = Cloud::from_rows("points", &rows) else { return Ok(()) };
    match step {
        0 => resolution(input, &cloud),
        1 => normals(input, &cloud),
        2 => harris(input, &cloud),
        3 => iss(input, &cloud),
        4 => isolated(input, &cloud),
        5 => frames(input, &cloud),
        6 => shot(input, &cloud),
        7 => lfsh(input, &cloud),
        8 => rcs(input, &cloud),
        9 => fpfh(input, &cloud),
        10 => voxels(input, &cloud),
        _ => voxel_size(input, &cloud),
    }
}

/// Rows of the cloud, sometimes one out of range.
fn keypoints(input: &mut Unstructured, cloud: &Cloud) -> Result<Vec<usize>> {
    let beyond = usize::from(input.ratio(1, 16)?);
    let last = (cloud.points().len() + beyond).saturating_sub(1);
    (0..input.int_in_range(0..=20)?).map(|_| input.int_in_range(0..=last)).collect()
}

/// One direction per point; sometimes one more.
fn directions(input: &mut Unstructured, cloud: &Cloud) -> Result<Vec<Vector3<f64>>> {
    let more = usize::from(input.ratio(1, 32)?);
    draw::directions(input, cloud.points().len() + more)
}

fn resolution(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let ignore_zero = input.arbitrary()?;
    let found = on_threads("resolution", || cloud.resolution(ignore_zero, &Execution::default()));
    finite("resolution", found);
    Ok(())
}

fn normals(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let neighborhood = match input.int_in_range(0..=2)? {
        0 => Neighborhood::Nearest(count(input, 40)?),
        1 => Neighborhood::Radius(length(input)?),
        _ => Neighborhood::NearestWithin(count(input, 40)?, length(input)?),
    };
    let viewpoint = Point3::new(number(input)?, number(input)?, number(input)?);
    let found = on_threads("normals", || surfaces(cloud, neighborhood, viewpoint, &Execution::default()));
    let Some(found) = found else { return Ok(()) };
    assert_eq!(found.len(), cloud.points().len());
    finite_or_missing("normals", found.iter().map(|surface| surface.normal.into()));
    finite_or_missing("curvature", found.iter().map(|surface| [surface.curvature]));
    Ok(())
}

fn harris(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let responses =
        [Response::Harris, Response::Noble, Response::Lowe, Response::Tomasi, Response::Curvature];
    let detector = Harris3d {
        radius: length(input)?,
        nms_radius: length(input)?,
        response: *input.choose(&responses)?,
        threshold: number(input)?,
        break_ties: input.arbitrary()?,
        count: maybe(input, |input| count(input, 50))?,
    };
    let normals = maybe(input, |input| directions(input, cloud))?;
    let detect = || detector.detect(cloud, normals.as_deref(), &Execution::default());
    indices("harris3d", cloud.points().len(), &on_threads("harris3d", detect).unwrap_or_default());
    Ok(())
}

fn iss(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let detector = Iss {
        salient_radius: length(input)?,
        nms_radius: length(input)?,
        gamma_21: number(input)?,
        gamma_32: number(input)?,
        min_neighbors: count(input, 10)?,
        density_weight: input.arbitrary()?,
        covariance: *input.choose(&[Covariance::AboutPoint, Covariance::AboutMean])?,
        count: maybe(input, |input| count(input, 50))?,
    };
    let found = on_threads("iss", || detector.detect(cloud, &Execution::default()));
    indices("iss", cloud.points().len(), &found.unwrap_or_default());
    Ok(())
}

fn isolated(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let (rows, radius, least) = (keypoints(input, cloud)?, length(input)?, count(input, 20)?);
    let drop = || drop_isolated(cloud, &rows, radius, least, &Execution::default());
    indices("drop_isolated", cloud.points().len(), &on_threads("drop_isolated", drop).unwrap_or_default());
    Ok(())
}

fn frames(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let (rows, radius, toldi) = (keypoints(input, cloud)?, length(input)?, input.arbitrary()?);
    let compute = if toldi { toldi_frames } else { shot_frames };
    let found = on_threads("frames", || compute(cloud, &rows, radius, &Execution::default()));
    let Some(found) = found else { return Ok(()) };
    assert_eq!(found.len(), rows.len());
    for axes in found.iter().flatten() {
        let error = (axes * axes.transpose() - nalgebra::Matrix3::identity()).amax();
        assert!(error < 1e-6 && axes.determinant() > 0.0, "frames: {axes}");
    }
    Ok(())
}

fn shot(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let descriptor = Shot { radius: length(input)?, pcl_compat: input.arbitrary()? };
    let (normals, rows) = (directions(input, cloud)?, keypoints(input, cloud)?);
    let frames = maybe(input, |input| draw::frames(input, rows.len()))?;
    let describe = || descriptor.describe(cloud, &normals, &rows, frames.as_deref(), &Execution::default());
    described("shot", on_threads("shot", describe), rows.len());
    Ok(())
}

fn lfsh(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let descriptor = Lfsh { radius: length(input)? };
    let (normals, rows) = (directions(input, cloud)?, keypoints(input, cloud)?);
    let describe = || descriptor.describe(cloud, &normals, &rows, &Execution::default());
    described("lfsh", on_threads("lfsh", describe), rows.len());
    Ok(())
}

fn rcs(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let descriptor = Rcs { radius: length(input)? };
    let rows = keypoints(input, cloud)?;
    let describe = || descriptor.describe(cloud, &rows, &Execution::default());
    described("rcs", on_threads("rcs", describe), rows.len());
    Ok(())
}

fn fpfh(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let descriptor = Fpfh {
        radius: length(input)?,
        max_neighbors: maybe(input, |input| count(input, 50))?,
        convention: *input.choose(&[Convention::Pcl, Convention::Open3d])?,
    };
    let (normals, rows) = (directions(input, cloud)?, maybe(input, |input| keypoints(input, cloud))?);
    let describe = || descriptor.describe(cloud, &normals, rows.as_deref(), &Execution::default());
    described("fpfh", on_threads("fpfh", describe), rows.as_ref().map_or(cloud.points().len(), Vec::len));
    Ok(())
}

/// Checks one row per keypoint, all finite or all NaN.
fn described<const N: usize>(name: &str, found: Option<Vec<[f32; N]>>, rows: usize) {
    let Some(found) = found else { return };
    assert_eq!(found.len(), rows, "{name}");
    finite_or_missing(name, found.iter().map(|row| row.map(f64::from)));
}

fn voxels(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let (size, normals) = (length(input)?, maybe(input, |input| directions(input, cloud))?);
    let points = cloud.points();
    let thin = || voxel_downsample(points, normals.as_deref(), size, &Execution::default());
    let Some(found) = on_threads("voxels", thin) else { return Ok(()) };
    finite("voxels", found.points.iter().flatten().copied());
    finite_or_missing("voxels", found.normals.iter().map(|&normal| normal.into()));
    assert_eq!(found.indices.len(), points.len());
    assert!(found.normals.is_empty() || found.normals.len() == found.points.len());
    assert!(found.indices.iter().all(|&voxel| (voxel as usize) < found.points.len()));
    Ok(())
}

fn voxel_size(input: &mut Unstructured, cloud: &Cloud) -> Result<()> {
    let (other, most) = (draw::points(input, 100)?, count(input, 200)?);
    let Ok(other) = Cloud::from_rows("points", &other) else { return Ok(()) };
    let clouds = [cloud.points(), other.points()];
    finite("choose_voxel", on_threads("choose_voxel", || choose_voxel(&clouds, most, &Execution::default())));
    Ok(())
}
