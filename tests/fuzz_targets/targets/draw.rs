//! Inputs drawn from bytes: numbers, points, directions, poses.

use arbitrary::{Result, Unstructured};
use cgroup::consensus::counter_rng::random_words;
use cgroup::correspondences::Frame;
use cgroup::geometry::rigid::Rigid;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Special values of floating-point arithmetic.
const SPECIAL: [f64; 16] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN_POSITIVE,
    5e-324,
    1e-165,
    1e160,
    1e150,
    1e-7,
    0.5,
    1e9,
];

/// Mostly a moderate number, sometimes a special or arbitrary one.
pub fn number(input: &mut Unstructured) -> Result<f64> {
    Ok(match input.int_in_range(0..=15)? {
        0 => f64::from_bits(input.arbitrary()?),
        1 => *input.choose(&SPECIAL)?,
        2..=5 => f64::from(input.arbitrary::<i16>()?) / 256.0,
        6..=8 => f64::from(input.arbitrary::<u8>()?),
        _ => f64::from(input.arbitrary::<u8>()?) / 255.0,
    })
}

/// A length that usually suits [`points`].
pub fn length(input: &mut Unstructured) -> Result<f64> {
    if input.ratio(1, 8)? { number(input) } else { Ok(f64::from(input.int_in_range(1..=64)?) / 4.0) }
}

/// Mostly a value drawn by `draw`, sometimes `None`.
pub fn maybe<T>(
    input: &mut Unstructured,
    draw: impl FnOnce(&mut Unstructured) -> Result<T>,
) -> Result<Option<T>> {
    if input.arbitrary()? { draw(input).map(Some) } else { Ok(None) }
}

/// A count up to `most`, or an unreachable one.
pub fn count(input: &mut Unstructured, most: usize) -> Result<usize> {
    if input.ratio(1, 16)? {
        return Ok(*input.choose(&[0, usize::MAX, usize::MAX / 2, 1 << 32, 1 << 20])?);
    }
    input.int_in_range(0..=most)
}

/// Rows of arbitrary numbers, of a few repeated ones, or of a bumpy surface.
pub fn points(input: &mut Unstructured, most: usize) -> Result<Vec<[f64; 3]>> {
    let len = input.int_in_range(0..=most)?;
    Ok(match input.int_in_range(0..=7)? {
        0 => rows(len.min(most / 4), || Ok([number(input)?, number(input)?, number(input)?]))?,
        1 => rows(len.min(most / 4), || Ok(input.arbitrary::<[i8; 3]>()?.map(|x| f64::from(x / 16))))?,
        kind => {
            let (seed, scale) = (input.arbitrary()?, scale(input)?);
            let offset = if kind == 2 { 1e6 * scale } else { 0.0 };
            (0..len).map(|i| (surface(seed, i as u64) * scale).add_scalar(offset).into()).collect()
        }
    })
}

fn scale(input: &mut Unstructured) -> Result<f64> {
    Ok(if input.ratio(1, 8)? { *input.choose(&[1e-150, 1e-60, 1e-9, 1e9, 1e60, 1e148])? } else { 1.0 })
}

fn rows<T>(len: usize, mut draw: impl FnMut() -> Result<T>) -> Result<Vec<T>> {
    (0..len).map(|_| draw()).collect()
}

/// A point of a surface about 20 across, by its number.
fn surface(seed: u64, i: u64) -> Vector3<f64> {
    let direction = unit(seed, i);
    direction * (10.0 + (5.0 * direction.x).sin() + 2.0 * (3.0 * direction.y + 1.0).cos())
}

/// A direction by its number.
fn unit(seed: u64, i: u64) -> Vector3<f64> {
    let words = random_words(seed, i);
    let [a, b] = [words[0], words[1]].map(|word| (word >> 11) as f64 / (1_u64 << 53) as f64);
    let (z, turn) = (2.0 * a - 1.0, std::f64::consts::TAU * b);
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vector3::new(r * turn.cos(), r * turn.sin(), z)
}

/// `len` directions: unit vectors, sometimes one that is not.
pub fn directions(input: &mut Unstructured, len: usize) -> Result<Vec<Vector3<f64>>> {
    let (seed, odd) = (input.arbitrary()?, input.ratio(1, 4)?);
    let draw = |i| {
        if odd && i % 5 == 0 {
            return Ok(Vector3::new(number(input)?, number(input)?, number(input)?));
        }
        Ok(unit(seed, i as u64))
    };
    (0..len).map(draw).collect()
}

/// A rotation by its number.
pub fn rotation(seed: u64, i: u64) -> Matrix3<f64> {
    let words = random_words(seed ^ 0x5bd1_e995, i);
    let angle = (words[0] >> 11) as f64 / (1_u64 << 53) as f64 * std::f64::consts::PI;
    Rotation3::new(unit(seed, i) * angle).into_inner()
}

/// `len` frames, some of them missing, sometimes one that is not a rotation.
pub fn frames(input: &mut Unstructured, len: usize) -> Result<Vec<Frame>> {
    let (seed, odd) = (input.arbitrary()?, input.ratio(1, 8)?);
    let draw = |i| match i % 7 {
        3 => Ok(None),
        5 if odd => Ok(Some(Matrix3::from_element(number(input)?))),
        _ => Ok(Some(rotation(seed, i as u64))),
    };
    (0..len).map(draw).collect()
}

/// A rigid motion, mostly small.
pub fn pose(input: &mut Unstructured) -> Result<Rigid> {
    let (seed, i) = (input.arbitrary()?, input.arbitrary()?);
    let rotation = if input.arbitrary()? { Matrix3::identity() } else { rotation(seed, i) };
    let translation = Vector3::new(number(input)?, number(input)?, number(input)?);
    let finite = translation.map(|x| if x.is_finite() { x } else { 0.0 });
    Ok(Rigid { rotation, translation: finite })
}
