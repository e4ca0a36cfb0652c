//! Matching of arbitrary descriptors, compared with a plain double loop.

use arbitrary::{Result, Unstructured};
use cgroup::Execution;
use cgroup::features::matching::{Descriptors, Match, Matching};

use super::{check, draw};

pub fn run(input: &mut Unstructured) -> Result<()> {
    let length = input.int_in_range(1..=12)?;
    let matching = Matching {
        k: draw::count(input, 6)?,
        mutual: input.arbitrary()?,
        max_distance: draw::maybe(input, draw::number)?,
    };
    let source = table(input, length)?;
    let target = if input.ratio(1, 8)? { source.clone() } else { table(input, length)? };
    let (Ok(a), Ok(b)) =
        (Descriptors::new("source", &source, length), Descriptors::new("target", &target, length))
    else {
        return Ok(());
    };
    let matches = || matching.run(&a, &b, &Execution::default());
    let Some(found) = check::on_threads("match", matches) else { return Ok(()) };
    let (source, target) = (rows(&source, length), rows(&target, length));
    for one in &found {
        check_match(one, &source, &target, &matching);
    }
    Ok(())
}

fn check_match(one: &Match, source: &[&[f64]], target: &[&[f64]], matching: &Matching) {
    assert!(one.source < source.len() && one.target < target.len(), "match: {one:?}");
    assert!((1..=matching.k).contains(&one.rank) && (one.is_mutual || !matching.mutual), "match: {one:?}");
    assert!(matching.max_distance.is_none_or(|most| one.distance <= most), "match: {one:?}");
    assert!((0.0..=1.0).contains(&one.ratio()), "match: {one:?}");
    assert!(
        one.similarity <= 1.0 + 1e-12 && one.distance >= 0.0 && one.second_distance >= 0.0,
        "match: {one:?}"
    );
    let nearer = target.iter().filter(|row| distance(source[one.source], row) < one.distance * (1.0 - 1e-9));
    assert!(nearer.count() < one.rank, "match: {one:?} is not of that rank");
}

/// Distance that handles squares which over- or underflow.
fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a - b).fold(0.0, f64::hypot)
}

fn rows(values: &[f64], length: usize) -> Vec<&[f64]> {
    values.chunks_exact(length).collect()
}

/// Rows of arbitrary numbers, or of moderate ones with some repeats.
fn table(input: &mut Unstructured, length: usize) -> Result<Vec<f64>> {
    let len = input.int_in_range(0..=40)? * length;
    let (odd, scale) = (input.ratio(1, 4)?, *input.choose(&[1.0, 1.0, 1e-165, 1e-40, 1e30, 1e150])?);
    let draw = |_| if odd { draw::number(input) } else { Ok(f64::from(input.arbitrary::<u8>()?) * scale) };
    (0..len).map(draw).collect()
}
