//! Writes clouds as binary PLY and PCD.

use std::fmt::Write as _;

use super::CloudContent;
use crate::error::{Error, Result};
use crate::memory;

/// Rounding of coordinates that is accepted, as a share of the extent.
pub const MOST_LOST: f64 = 1e-6;

/// Precision of written coordinates and normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// float32
    Single,
    /// float64
    Double,
}

impl Precision {
    fn put(self, number: f64, out: &mut Vec<u8>) {
        match self {
            Self::Single => out.extend((number as f32).to_le_bytes()),
            Self::Double => out.extend(number.to_le_bytes()),
        }
    }

    /// Bytes of a number.
    fn size(self) -> usize {
        match self {
            Self::Single => size_of::<f32>(),
            Self::Double => size_of::<f64>(),
        }
    }
}

/// PLY: points, and normals, colours, intensities and faces if there are any.
///
/// # Errors
/// [`Error::InvalidInput`] for lists of several lengths; [`Error::OutOfMemory`].
pub fn ply(cloud: &CloudContent, precision: Precision) -> Result<Vec<u8>> {
    check(cloud, precision)?;
    let word = if precision == Precision::Single { "float" } else { "double" };
    let mut head = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", cloud.points.len());
    let mut list = |word: &str, names: [&str; 3]| {
        for name in names {
            let _ = writeln!(head, "property {word} {name}");
        }
    };
    list(word, ["x", "y", "z"]);
    if cloud.normals.is_some() {
        list(word, ["nx", "ny", "nz"]);
    }
    if cloud.colors.is_some() {
        list("uchar", ["red", "green", "blue"]);
    }
    if cloud.intensities.is_some() {
        head += "property float intensity\n";
    }
    if let Some(faces) = &cloud.faces {
        let _ = writeln!(head, "element face {}\nproperty list uchar int vertex_indices", faces.len());
    }
    head += "end_header\n";
    let mut out = rows(cloud, &head, precision, |[red, green, blue], out| out.extend([red, green, blue]))?;
    for face in cloud.faces.iter().flatten() {
        memory::push(&mut out, 3)?;
        for &corner in face {
            let is_known = usize::try_from(corner).is_ok_and(|row| row < cloud.points.len());
            let corner = i32::try_from(corner).ok().filter(|_| is_known).ok_or_else(|| {
                let remedy = format!("there are {}, the first is point 0", cloud.points.len());
                Error::invalid("faces", format!("a face of point {corner}"), remedy)
            })?;
            memory::extend(&mut out, &corner.to_le_bytes())?;
        }
    }
    Ok(out)
}

/// PCD: points and viewpoint, and normals, colours and intensities if there are any.
///
/// # Errors
/// [`Error::InvalidInput`] for lists of several lengths; [`Error::OutOfMemory`].
pub fn pcd(cloud: &CloudContent, precision: Precision) -> Result<Vec<u8>> {
    check(cloud, precision)?;
    let mut names = String::from("x y z");
    let mut count = 3;
    if cloud.normals.is_some() {
        names += " normal_x normal_y normal_z";
        count += 3;
    }
    let mut sizes = vec![precision.size().to_string(); count];
    for (name, is_there) in [(" rgb", cloud.colors.is_some()), (" intensity", cloud.intensities.is_some())] {
        if is_there {
            names += name;
            sizes.push(size_of::<f32>().to_string());
            count += 1;
        }
    }
    let [x, y, z] = cloud.viewpoint.unwrap_or_default();
    let (len, sizes) = (cloud.points.len(), sizes.join(" "));
    let (kinds, ones) = (vec!["F"; count].join(" "), vec!["1"; count].join(" "));
    let head = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {names}\nSIZE {sizes}\nTYPE {kinds}\n\
         COUNT {ones}\nWIDTH {len}\nHEIGHT 1\nVIEWPOINT {x:?} {y:?} {z:?} 1 0 0 0\nPOINTS {len}\nDATA binary\n"
    );
    // PCL packs colours into the bits of a float.
    rows(cloud, &head, precision, |[red, green, blue], out| out.extend([blue, green, red, 0]))
}

fn check(cloud: &CloudContent, precision: Precision) -> Result<()> {
    let count = cloud.points.len();
    let normals = ("normals", cloud.normals.as_ref().map(Vec::len));
    let colors = ("colors", cloud.colors.as_ref().map(Vec::len));
    let intensities = ("intensities", cloud.intensities.as_ref().map(Vec::len));
    for (name, len) in [normals, colors, intensities] {
        if let Some(len) = len.filter(|&len| len != count) {
            let got = format!("{len} values of {name} for {count} points");
            return Err(Error::invalid("cloud", got, "give one per point"));
        }
    }
    if precision == Precision::Single { check_digits(&cloud.points) } else { Ok(()) }
}

/// Refuses points that float32 moves by more than [`MOST_LOST`] of their extent.
fn check_digits(points: &[[f64; 3]]) -> Result<()> {
    let (mut low, mut high, mut lost) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], 0.0_f64);
    for point in points.iter().filter(|point| point.iter().all(|x| x.is_finite())) {
        for ((low, high), &x) in low.iter_mut().zip(&mut high).zip(point) {
            *low = low.min(x);
            *high = high.max(x);
            lost = lost.max((x - f64::from(x as f32)).abs());
        }
    }
    let across = low.iter().zip(high).map(|(low, high)| (high - low).powi(2)).sum::<f64>().sqrt();
    if lost == 0.0 || lost <= MOST_LOST * across && lost.is_finite() {
        return Ok(());
    }
    let show = |x: f64| if (0.01..1e6).contains(&x) { format!("{x:.3}") } else { format!("{x:.3e}") };
    let (lost, across) = (show(lost), show(across));
    let got = format!("float32, which moves points by up to {lost} in a cloud that is {across} across");
    Err(Error::invalid("dtype", got, "write float64, or move the cloud to the origin first"))
}

/// The header and the rows of all points.
fn rows(
    cloud: &CloudContent,
    head: &str,
    precision: Precision,
    put_color: impl Fn([u8; 3], &mut Vec<u8>),
) -> Result<Vec<u8>> {
    let most = 6 * precision.size() + 2 * size_of::<f32>();
    let mut out = memory::with_capacity(head.len() + most * cloud.points.len())?;
    out.extend(head.as_bytes());
    for (row, point) in cloud.points.iter().enumerate() {
        point.iter().for_each(|&number| precision.put(number, &mut out));
        if let Some(normals) = &cloud.normals {
            normals[row].iter().for_each(|&number| precision.put(number, &mut out));
        }
        if let Some(colors) = &cloud.colors {
            put_color(colors[row], &mut out);
        }
        if let Some(intensities) = &cloud.intensities {
            out.extend(intensities[row].to_le_bytes());
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Execution;
    use crate::cloud_formats::{pcd as read_pcd, ply as read_ply};

    fn cloud() -> CloudContent {
        CloudContent {
            points: vec![[1.0, -0.1, 1e300], [f64::NAN, 0.0, 5e-324], [0.5, 0.25, 2.0]],
            normals: Some(vec![[0.0, 0.6, 0.8]; 3]),
            faces: Some(vec![[0, 1, 2]]),
            colors: Some(vec![[1, 2, 3], [255, 0, 128], [9, 8, 7]]),
            intensities: Some(vec![0.1, -7.0, 65_535.0]),
            viewpoint: Some([1e-9, -3.0, 1e22]),
        }
    }

    /// Bits of all numbers, so that NaN equals itself.
    fn bits(cloud: &CloudContent) -> Vec<u64> {
        let normals = cloud.normals.iter().flatten();
        cloud.points.iter().chain(normals).flatten().map(|number| number.to_bits()).collect()
    }

    #[test]
    fn written_clouds_are_read_again() -> Result<()> {
        let wanted = cloud();
        let found = read_ply::parse(&ply(&wanted, Precision::Double)?, &Execution::default())?;
        assert_eq!(
            (bits(&found), &found.faces, &found.colors, &found.intensities),
            (bits(&wanted), &wanted.faces, &wanted.colors, &wanted.intensities)
        );
        let found = read_pcd::parse(&pcd(&wanted, Precision::Double)?, &Execution::default())?;
        assert_eq!((bits(&found), found.viewpoint), (bits(&wanted), wanted.viewpoint));
        assert_eq!((found.colors, found.intensities), (wanted.colors, wanted.intensities));
        let bare = CloudContent { points: vec![[0.5, -2.0, 3.0]], ..CloudContent::default() };
        for bytes in [ply(&bare, Precision::Single)?, ply(&bare, Precision::Double)?] {
            assert_eq!(read_ply::parse(&bytes, &Execution::default())?, bare);
        }
        Ok(())
    }

    #[test]
    fn single_precision_that_moves_points_is_refused() {
        let far =
            CloudContent { points: vec![[1e7, 0.0, 0.0], [1e7 + 0.3, 0.0, 0.0]], ..CloudContent::default() };
        assert!(
            matches!(ply(&far, Precision::Single), Err(Error::InvalidInput { what, .. }) if what == "dtype")
        );
        let huge = CloudContent { points: vec![[1e300, 0.0, 0.0], [0.0; 3]], ..CloudContent::default() };
        assert!(pcd(&huge, Precision::Single).is_err());
        let near = CloudContent { points: vec![[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]], ..CloudContent::default() };
        assert!(ply(&near, Precision::Single).is_ok());
    }

    #[test]
    fn lists_of_several_lengths_are_refused() {
        let wrong = CloudContent { colors: Some(Vec::new()), ..cloud() };
        assert!(ply(&wrong, Precision::Double).is_err() && pcd(&wrong, Precision::Double).is_err());
        for corner in [-1, 3] {
            let wrong = CloudContent { faces: Some(vec![[0, 1, corner]]), ..cloud() };
            assert!(ply(&wrong, Precision::Double).is_err());
        }
    }
}
