use super::*;

const HEADER: &str =
    "format ascii 1.0\nelement vertex 4\nproperty float x\nproperty double y\nproperty int z\n";

fn read(content: &[u8]) -> Result<CloudContent> {
    parse(content, &Execution::default())
}

fn refused(content: &[u8], says: &str) {
    let error = read(content).map_or_else(|error| error.to_string(), |_| "nothing".to_string());
    assert!(error.contains(says), "{error}");
}

#[test]
fn text_is_rounded_to_the_declared_types() -> Result<()> {
    let text = format!("ply\r\n{HEADER}end_header\r\n0.1 0.1 7 \r\n\r\n1 2 3\n4 5 6 9\nnan -inf 0");
    let cloud = read(text.as_bytes())?;
    assert_eq!(cloud.points[..2], [[f64::from(0.1_f32), 0.1, 7.0], [1.0, 2.0, 3.0]]);
    assert!(cloud.points[3][0].is_nan());
    assert_eq!((cloud.points.len(), cloud.normals, cloud.faces, cloud.colors), (4, None, None, None));
    Ok(())
}

#[test]
fn elements_are_read_in_any_order() -> Result<()> {
    let header = b"ply\nformat binary_big_endian 1.0\ncomment \xe9\nelement camera 1\nproperty list ushort double t\n\
        element face 2\nproperty uchar flag\nproperty list uchar short vertex_index\nproperty list int float texcoord\n\
        element vertex 5\nproperty char z\nproperty char y\nproperty char skipped\nproperty char x\n\
        element edge 99999\nproperty int a\nend_header\n";
    let mut content = header.to_vec();
    content.extend([0, 1, 0, 0, 0, 0, 0, 0, 0, 0]);
    content.extend([9, 4, 0, 0, 0, 1, 0, 2, 0, 3, 0, 0, 0, 1, 0, 0, 0, 0]);
    content.extend([9, 3, 0, 4, 0, 3, 0, 2, 0, 0, 0, 0]);
    content.extend((0..20).map(|i: u8| i));
    let cloud = read(&content)?;
    assert_eq!(cloud.points[..2], [[3.0, 1.0, 0.0], [7.0, 5.0, 4.0]]);
    assert_eq!(cloud.faces, Some(vec![[0, 1, 2], [0, 2, 3], [4, 3, 2]]));
    content.pop();
    refused(&content, "element \"vertex\": got 5 of at least 4 bytes each, in 19 bytes");
    Ok(())
}

#[test]
fn normals_and_colors_are_found_by_name() -> Result<()> {
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar blue\nproperty uchar x\n\
        property uchar y\nproperty uchar z\nproperty char nz\nproperty char ny\nproperty char nx\nproperty uchar red\n\
        property uchar green\nproperty uchar alpha\nend_header\n";
    let mut content = header.as_bytes().to_vec();
    content.extend([3, 10, 20, 30, 0, 1, 0xff, 1, 2, 255]);
    let cloud = read(&content)?;
    assert_eq!(cloud.points, [[10.0, 20.0, 30.0]]);
    assert_eq!(cloud.normals, Some(vec![[-1.0, 1.0, 0.0]]));
    assert_eq!(cloud.colors, Some(vec![[1, 2, 3]]));
    Ok(())
}

#[test]
fn errors_name_the_fault() {
    refused(b"", "line 1");
    refused(b"plyx\n", "a PLY file begins with");
    refused(b"ply\nend_header\n", "format");
    refused(b"ply\nformat ascii 1.0\nelement vertex 1\n", "end_header");
    refused(b"ply\nformat ascii 1.0\nend_header\n", "no element vertex");
    refused(b"ply\nformat ascii 1.0\nelement vertex -1\n", "line 3: got \"-1\"");
    refused(b"ply\nproperty float x\n", "a property before any element");
    refused(b"ply\nformat ascii 1.0\nelement vertex 1\nproperty real x\n", "line 4: got \"real\"");
    let broken = format!("ply\n{HEADER}end_header\n1 2 3\n1 oh 3\n4 5 6\n7 8 9\n");
    refused(broken.as_bytes(), "line 9: got \"oh\"");
    let short = format!("ply\n{HEADER}end_header\n1 2 3\n1 200\n4 5 6\n7 8 9\n");
    refused(short.as_bytes(), "line 9: got the end of the line");
    let cut = format!("ply\n{HEADER}end_header\n1 2 3\n1 2 33333333333333\n4 5 6\n");
    refused(cut.as_bytes(), "the end of the file");
    let huge = format!("ply\n{}end_header\n1 2 3\n", HEADER.replace(" 4", " 4000000000000000000"));
    refused(huge.as_bytes(), "in 7 bytes");
    let list =
        b"ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list char int i\nelement vertex 0\n\
        property char x\nproperty char y\nproperty char z\nend_header\n\xff";
    refused(list, "got -1; the length of a list");
}

#[test]
fn elements_without_properties_need_no_memory() {
    let rows = "element vertex 1\nproperty char x\nproperty char y\nproperty char z\nend_header\n123";
    for name in ["face", "other"] {
        let text = format!("ply\nformat binary_big_endian 1.0\nelement {name} 4000000000000000000\n{rows}");
        assert!(
            read(text.as_bytes())
                .is_ok_and(|cloud| cloud.points == [[49.0, 50.0, 51.0]] && cloud.faces.is_none())
        );
    }
}

#[test]
fn it_can_be_interrupted() {
    let execution = Execution::default();
    execution.interrupt();
    let text = format!("ply\n{HEADER}end_header\n{}", "1 2 3\n".repeat(4));
    assert_eq!(parse(text.as_bytes(), &execution), Err(Error::Interrupted));
}

#[test]
fn transparent_splats_are_nan() -> Result<()> {
    let names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "opacity", "scale_0", "rot_0"];
    let header = |format: &str| {
        let properties = names.map(|name| format!("property float {name}\n")).concat();
        format!("ply\nformat {format} 1.0\nelement vertex 3\n{properties}end_header\n")
    };
    // Opacities 0.11, 0.09, and NaN.
    let rows =
        [-2.09_f32, -2.31, f32::NAN].map(|opacity| [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.5, opacity, -4.0, 1.0]);
    let mut binary = header("binary_little_endian").into_bytes();
    binary.extend(rows.as_flattened().iter().flat_map(|number| number.to_le_bytes()));
    let line = |row: [f32; 10]| row.map(|number| format!("{number} ")).concat() + "\n";
    let text = rows.map(line).concat();
    for content in [binary, format!("{}{text}", header("ascii")).into_bytes()] {
        let cloud = read(&content)?;
        assert_eq!((cloud.points[0], cloud.normals), ([1.0, 2.0, 3.0], None));
        assert!(cloud.points[1..].iter().flatten().all(|number| number.is_nan()));
    }
    Ok(())
}
