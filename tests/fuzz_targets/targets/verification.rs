//! Scores of poses on arbitrary surfaces.

use arbitrary::{Result, Unstructured};
use cgroup::geometry::rigid::Rigid;
use cgroup::verification::{
    Evidence, FineSurface, Side, Surface, align, margin, overlap, places, score_poses, verify,
};
use cgroup::{Execution, Points};

use super::check::{finite, on_threads};
use super::draw::{self, length, maybe, number};

pub fn run(input: &mut Unstructured) -> Result<()> {
    let clouds = [draw::points(input, 300)?, draw::points(input, 300)?];
    let [Ok(source), Ok(target)] = clouds.map(|rows| Points::from_rows("points", &rows)) else {
        return Ok(());
    };
    let poses: Vec<Rigid> =
        (0..input.int_in_range(0..=5)?).map(|_| draw::pose(input)).collect::<Result<_>>()?;
    if input.ratio(1, 4)? {
        fine(input, &source, &target, &poses)
    } else {
        coarse(input, &source, &target, &poses)
    }
}

fn coarse(input: &mut Unstructured, source: &Points, target: &Points, poses: &[Rigid]) -> Result<()> {
    let unit = length(input)?;
    let (Some(a), Some(b)) = (surface(input, source, unit)?, surface(input, target, unit)?) else {
        return Ok(());
    };
    let execution = Execution::default();
    finite(
        "score_poses",
        on_threads("score_poses", || score_poses(&a, &b, poses, &execution)).unwrap_or_default(),
    );
    let evidence = maybe(input, evidence)?.flatten();
    let verified = on_threads("verify", || verify(&a, &b, poses, evidence.as_ref(), &execution));
    let found = verified.unwrap_or_default();
    assert!(found.len() <= poses.len());
    for one in &found {
        finite("verify", one.pose.to_matrix().iter().copied().chain([one.score]));
    }
    assert!(!margin(&a, &b, &found).is_nan());
    let Some(best) = found.first() else { return Ok(()) };
    let shared = on_threads("overlap", || overlap(&a, &b, &best.pose, &execution).map(|found| found.fitness));
    assert!(shared.is_none_or(|fitness| (0.0..=1.0).contains(&fitness)), "overlap: {shared:?}");
    let lies = on_threads("places", || places(&a, &b, &best.pose, &execution));
    assert!(lies.is_none_or(|places| places.len() == a.len()));
    Ok(())
}

fn surface(input: &mut Unstructured, points: &Points, unit: f64) -> Result<Option<Surface>> {
    let more = usize::from(input.ratio(1, 32)?);
    let normals = draw::directions(input, points.len() + more)?;
    let side = match input.int_in_range(0..=2)? {
        0 => Side::Unknown,
        1 => Side::Known,
        _ => Side::Viewpoint([number(input)?, number(input)?, number(input)?]),
    };
    Ok(on_threads("surface", || Surface::new(points, &normals, unit, side, &Execution::default())))
}

/// Matches that support poses; `None` if the points are rejected.
fn evidence(input: &mut Unstructured) -> Result<Option<Evidence>> {
    let clouds = [draw::points(input, 40)?, draw::points(input, 40)?];
    let tolerance = length(input)?;
    let [Ok(source), Ok(target)] = clouds.map(|rows| Points::from_rows("matches", &rows)) else {
        return Ok(None);
    };
    Ok(Some(Evidence { source, target, tolerance }))
}

fn fine(input: &mut Unstructured, source: &Points, target: &Points, poses: &[Rigid]) -> Result<()> {
    let (spacing, samples) = (length(input)?, draw::count(input, 500)?);
    let execution = Execution::default();
    let make = |points| on_threads("fine surface", || FineSurface::new(points, spacing, &execution));
    let (Some(a), Some(b)) = (make(source), make(target)) else { return Ok(()) };
    for pose in poses {
        let aligned = on_threads("align", || align(&a, &b, pose, samples, &execution));
        finite(
            "align",
            aligned.iter().flat_map(|found| found.pose.to_matrix().iter().copied().collect::<Vec<_>>()),
        );
    }
    Ok(())
}
