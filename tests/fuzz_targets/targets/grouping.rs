//! Grouping of arbitrary correspondences.

use arbitrary::{Result, Unstructured};
use cgroup::grouping::BoxedMethod;
use cgroup::{Correspondences, Execution};

use super::{check, draw};

/// Memory bounds below which pair scores are recomputed, and above which they are stored.
const BOUNDS: [usize; 4] = [0, 4096, 1 << 20, usize::MAX];

pub fn run(
    input: &mut Unstructured,
    method: impl FnOnce(&mut Unstructured) -> Result<(&'static str, BoxedMethod)>,
) -> Result<()> {
    let (name, method) = method(input)?;
    let max_memory = *input.choose(&BOUNDS)?;
    let Ok(correspondences) = correspondences(input)? else { return Ok(()) };
    let group = || method.group(&correspondences, &Execution::new(max_memory));
    if let Some(group) = check::on_threads(name, group) {
        check::grouping(name, correspondences.len(), &group);
    }
    Ok(())
}

fn correspondences(input: &mut Unstructured) -> Result<cgroup::Result<Correspondences>> {
    let source = draw::points(input, 160)?;
    let target = target_of(input, &source)?;
    let n = source.len();
    let similarity = draw::maybe(input, |input| numbers(input, n))?;
    let ratio = draw::maybe(input, |input| numbers(input, n))?;
    let frames = draw::maybe(input, |input| Ok((draw::frames(input, n)?, draw::frames(input, n)?)))?;
    let resolution = draw::maybe(input, draw::length)?;
    let centroid =
        draw::maybe(input, |input| Ok([draw::number(input)?, draw::number(input)?, draw::number(input)?]))?;
    Ok(Correspondences::new(&source, &target).and_then(|made| {
        let made = similarity.map_or(Ok(made.clone()), |values| made.with_similarity(values))?;
        let made = ratio.map_or(Ok(made.clone()), |values| made.with_ratio(values))?;
        let made = frames.map_or(Ok(made.clone()), |(source, target)| made.with_frames(source, target))?;
        let made = resolution.map_or(Ok(made.clone()), |length| made.with_resolution(length))?;
        centroid.map_or(Ok(made.clone()), |point| made.with_source_centroid(point))
    }))
}

/// Source points under a rigid motion, with some replaced, or unrelated points.
fn target_of(input: &mut Unstructured, source: &[[f64; 3]]) -> Result<Vec<[f64; 3]>> {
    if input.ratio(1, 8)? {
        return draw::points(input, 160);
    }
    let pose = draw::pose(input)?;
    let right = input.int_in_range(1..=4)?;
    let away = [draw::number(input)?, draw::number(input)?];
    let moved = source.iter().enumerate().map(|(i, &point)| {
        let moved: [f64; 3] = pose.apply(&point.into()).into();
        if i % 4 < right { moved } else { [moved[2] + away[0] * i as f64, moved[0] - away[1], moved[1]] }
    });
    Ok(moved.collect())
}

/// Mostly numbers from 0 to 1.
fn numbers(input: &mut Unstructured, len: usize) -> Result<Vec<f64>> {
    let odd = input.ratio(1, 8)?;
    let draw = |_| if odd { draw::number(input) } else { Ok(f64::from(input.arbitrary::<u8>()?) / 255.0) };
    (0..len).map(draw).collect()
}
