use super::*;

fn read(content: &[u8]) -> Result<CloudContent> {
    parse(content, &Execution::default())
}

fn refused(content: &[u8], says: &str) {
    let error = read(content).map_or_else(|error| error.to_string(), |_| "nothing".to_string());
    assert!(error.contains(says), "{error}");
}

#[test]
fn old_versions_are_read() -> Result<()> {
    let text = b"# \xe9\nVERSION .5\nCOLUMNS x y z\nWIDTH 2\nDATA ascii\n0.1 2 3\nnan 5 6";
    let cloud = read(text)?;
    assert_eq!(cloud.points[..1], [[f64::from(0.1_f32), 2.0, 3.0]]);
    assert!(cloud.points[1][0].is_nan());
    Ok(())
}

#[test]
fn fields_are_found_by_name() -> Result<()> {
    let header = "VERSION 0.7\r\nFIELDS histogram z y x rgb normal_x normal_y normal_z\r\nSIZE 2 4 8 1 4 4 4 4\r\n\
        TYPE U F F I F F F F\r\nCOUNT 3 1 1 1 1 1 1 1\r\nWIDTH 1\r\nHEIGHT 1\r\nPOINTS 1\r\n";
    let mut binary = format!("{header}DATA binary\r\n").into_bytes();
    let mut row = vec![9; 6];
    row.extend(3.5_f32.to_le_bytes());
    row.extend(2.5_f64.to_le_bytes());
    row.push(0xff);
    // A NaN if read as a number.
    row.extend([3, 2, 0xfa, 0xff]);
    row.extend([0_f32, 0.0, 1.0].map(f32::to_le_bytes).as_flattened());
    binary.extend(&row);
    let mut compressed = format!("{header}DATA binary_compressed\r\n").into_bytes();
    compressed.extend([(row.len() + 2) as u8, 0, 0, 0, row.len() as u8, 0, 0, 0]);
    for run in row.chunks(32) {
        compressed.push(run.len() as u8 - 1);
        compressed.extend(run);
    }
    for content in [&binary, &compressed] {
        let cloud = read(content)?;
        assert_eq!(cloud.points, [[-1.0, 2.5, 3.5]]);
        assert_eq!(cloud.colors, Some(vec![[0xfa, 2, 3]]));
        assert_eq!(cloud.normals, Some(vec![[0.0, 0.0, 1.0]]));
        assert!(read(&content[..content.len() - 1]).is_err());
    }
    let text = format!("{header}DATA ascii\r\n9 9 9 3.5 2.5 -1 0 0 0 1\r\n");
    assert_eq!(read(text.as_bytes())?.points, [[-1.0, 2.5, 3.5]]);
    Ok(())
}

#[test]
fn viewpoints_are_positions() -> Result<()> {
    for (line, place) in [
        ("VIEWPOINT 1 -2.5 3e2 0 1 0 0", Some([1.0, -2.5, 300.0])),
        ("VIEWPOINT 0 0 0 0 1 0 0", None),
        ("VIEWPOINT 1 2 3", None),
        ("VIEWPOINT 1 2 nan 1 0 0 0", None),
        ("VIEWPOINT", None),
        ("# VIEWPOINT 1 2 3 1 0 0 0", None),
    ] {
        let content = format!("FIELDS x y z\nWIDTH 1\n{line}\nDATA ascii\n7 8 9\n");
        let cloud = read(content.as_bytes())?;
        assert_eq!((cloud.viewpoint, cloud.points), (place, vec![[7.0, 8.0, 9.0]]), "{line}");
    }
    Ok(())
}

#[test]
fn errors_name_the_fault() {
    let header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n";
    refused(b"", "no line DATA");
    refused(b"DATA ascii\n", "no number of points");
    refused(b"POINTS 1\nFIELDS x y\nDATA ascii\n1 2\n", "not all of x, y, z");
    refused(format!("{header}DATA latin\n").as_bytes(), "line 8: got \"latin\"");
    refused(format!("{header}DATA ascii\n1 2 3\n").as_bytes(), "POINTS: got 2 of at least 6 bytes");
    refused(format!("{header}DATA ascii\n1 2 3333333\n").as_bytes(), "1 of 2 points");
    refused(format!("{header}DATA ascii\n1 2 3 4\n1 2 3\n").as_bytes(), "line 9: got \"4\"");
    refused(format!("{header}DATA ascii\n1 2 3\n1 2 3\n1 2 3\n").as_bytes(), "a further point");
    refused(format!("{header}DATA binary\n1234").as_bytes(), "got 2 of at least 12 bytes each, in 4 bytes");
    refused(format!("{header}DATA binary_compressed\n1234").as_bytes(), "the end of the file");
    refused(format!("{header}TYPE F F Q\nDATA ascii\n").as_bytes(), "TYPE");
    refused(format!("{header}SIZE 4 4\nDATA ascii\n").as_bytes(), "2 words");
    let many = header.replace("COUNT 1 1 1", "COUNT 1000000000 1 1").replace("S 2", "S 1");
    refused(format!("{many}DATA ascii\n0 0 0\n").as_bytes(), "not all of x, y, z");
    let many = header.replace("COUNT 1 1 1", "COUNT 1 1 1 18446744073709551615").replace(" z", " z w");
    let many = many.replace("4 4 4", "4 4 4 4").replace("F F F", "F F F F");
    refused(format!("{many}DATA binary\n").as_bytes(), "COUNT");
}

#[test]
fn compressed_sizes_are_checked() {
    let header = "FIELDS x y z\nWIDTH 350000000\nDATA binary_compressed\n";
    let mut content = header.as_bytes().to_vec();
    content.extend([4, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, 0, 1, 0, 1]);
    refused(&content, "the size is too large for the data");
}
