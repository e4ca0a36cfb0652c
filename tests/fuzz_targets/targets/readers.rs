//! Arbitrary bytes, read as one of the formats.

use arbitrary::{Result, Unstructured};
use cgroup::Execution;
use cgroup::cloud_formats::{CloudContent, PARSERS, table};

use super::check;

/// Upper bound of the points per byte of a file: PCD's compression expands 3 bytes to 90, and a point needs
/// at least 2; a LAZ point equal to the last one takes a hundredth of a bit. Zeros of glTF take no bytes, up
/// to 64 MiB of points.
fn most_points(name: &str, bytes: usize) -> usize {
    match name {
        "gltf" => (64 << 20) / size_of::<[f64; 3]>() + 50 * bytes,
        "las" => bytes << 12,
        _ => 50 * bytes,
    }
}

pub fn run(input: &mut Unstructured) -> Result<()> {
    let format = input.int_in_range(0..=PARSERS.len())?;
    let content = input.bytes(input.len())?;
    match PARSERS.get(format) {
        Some((name, parse)) => {
            let found = check::on_threads(name, || parse(content, &Execution::default()));
            found.iter().for_each(|cloud| check_cloud(name, cloud, content.len()));
        }
        None => check_table(content),
    }
    Ok(())
}

fn check_cloud(name: &str, cloud: &CloudContent, bytes: usize) {
    let count = cloud.points.len();
    let most = most_points(name, bytes);
    assert!(count <= most, "{name}: {count} points of {bytes} bytes");
    assert!(cloud.normals.as_ref().is_none_or(|normals| normals.len() == count), "{name}: normals");
    assert!(cloud.colors.as_ref().is_none_or(|colors| colors.len() == count), "{name}: colours");
    let is_row = |&row: &i64| usize::try_from(row).is_ok_and(|row| row < count);
    let rows = cloud.faces.iter().flatten().flatten();
    assert!(rows.clone().all(is_row), "{name}: faces beyond {count} points");
    assert!(rows.count() <= 3 * most, "{name}: faces of {bytes} bytes");
}

fn check_table(content: &[u8]) {
    let Some(found) = check::on_threads("table", || table::parse(content, &Execution::default())) else {
        return;
    };
    assert!(found.columns > 0 && found.numbers.len().is_multiple_of(found.columns), "table");
    assert!(found.numbers.len() <= content.len(), "table: {} numbers", found.numbers.len());
}
