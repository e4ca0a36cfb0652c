use super::buffers::decode_base64;
use super::*;

const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

/// The four corners in float32, a normal and a colour of each, and the indices 0 1 2 2 1 3.
fn buffer() -> Vec<u8> {
    let numbers = [CORNERS.as_flattened(), [[0.0, 0.0, 2.0]; 4].as_flattened()].concat();
    let mut bytes: Vec<u8> = numbers.into_iter().flat_map(f32::to_le_bytes).collect();
    bytes.extend([0, 128, 255, 9].repeat(4));
    bytes.extend([0, 1, 2, 2, 1, 3]);
    bytes
}

/// A document of nodes and of primitives of one mesh; its accessors are positions, normals, colours, indices.
fn document(nodes: &str, primitives: &str) -> String {
    let views = "{\"buffer\": 0, \"byteLength\": 48}, \
        {\"buffer\": 0, \"byteOffset\": 48, \"byteLength\": 48}, \
        {\"buffer\": 0, \"byteOffset\": 96, \"byteLength\": 22}";
    let accessors = "{\"bufferView\": 0, \"componentType\": 5126, \"count\": 4, \"type\": \"VEC3\"}, \
        {\"bufferView\": 1, \"componentType\": 5126, \"count\": 4, \"type\": \"VEC3\"}, \
        {\"bufferView\": 2, \"componentType\": 5121, \"count\": 4, \"type\": \"VEC4\", \"normalized\": true},\
        {\"bufferView\": 2, \"componentType\": 5121, \"count\": 6, \"type\": \"SCALAR\", \"byteOffset\": 16}";
    format!(
        "{{\"asset\": {{\"version\": \"2.0\"}}, \"nodes\": [{nodes}], \
         \"meshes\": [{{\"primitives\": [{primitives}]}}], \"accessors\": [{accessors}], \
         \"bufferViews\": [{views}], \"buffers\": [{{\"byteLength\": 118}}]}}"
    )
}

fn chunk(kind: [u8; 4], content: &[u8]) -> Vec<u8> {
    [&(content.len() as u32).to_le_bytes(), &kind, content].concat()
}

fn glb(document: &str, binary: &[u8]) -> Vec<u8> {
    let chunks =
        [chunk(*b"JSON", document.as_bytes()), chunk(*b"more", b""), chunk(*b"BIN\0", binary)].concat();
    let length = (12 + chunks.len() as u32).to_le_bytes();
    [b"glTF", &2_u32.to_le_bytes(), &length, &chunks[..]].concat()
}

fn read(document: &str) -> Result<CloudContent> {
    parse(&glb(document, &buffer()), &Execution::default())
}

fn refused(document: &str, says: &str) {
    let error = read(document).map_or_else(|error| error.to_string(), |_| "nothing".to_owned());
    assert!(error.contains(says), "{error}, not {says}");
}

const POINTS: &str = "{\"attributes\": {\"POSITION\": 0}}";

#[test]
fn strips_and_fans_become_triangles() -> Result<()> {
    for (mode, faces) in [
        (4, Some(vec![[0, 1, 2], [2, 1, 3]])),
        (5, Some(vec![[0, 1, 2], [1, 2, 2], [2, 2, 1], [2, 3, 1]])),
        (6, Some(vec![[1, 2, 0], [2, 2, 0], [2, 1, 0], [1, 3, 0]])),
        (0, None),
    ] {
        let primitive = format!("{{\"attributes\": {{\"POSITION\": 0}}, \"indices\": 3, \"mode\": {mode}}}");
        let cloud = read(&document("{\"mesh\": 0}", &primitive))?;
        assert_eq!(cloud.points, CORNERS.map(|corner| corner.map(f64::from)));
        assert_eq!(cloud.faces, faces);
        assert_eq!((cloud.normals, cloud.colors), (None, None));
    }
    Ok(())
}

#[test]
fn nodes_move_and_mirror_what_primitives_share() -> Result<()> {
    let primitive = "{\"attributes\": {\"POSITION\": 0, \"NORMAL\": 1, \"COLOR_0\": 2}, \"indices\": 3}";
    let nodes = "{\"children\": [1], \"translation\": [0, 0, 5], \"rotation\": [0, 0, 1, 0]}, \
        {\"mesh\": 0, \"scale\": [1, 1, -2]}, {\"mesh\": 0}";
    let cloud = read(&document(nodes, &format!("{primitive}, {primitive}")))?;
    assert_eq!(cloud.points.len(), 8);
    assert_eq!(cloud.points[2..3], [[-1.0, -1.0, 5.0]]);
    assert_eq!(
        cloud.normals.as_ref().map(|normals| (normals[0], normals[7])),
        Some(([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]))
    );
    assert_eq!(cloud.colors, Some(vec![[0, 128, 255]; 8]));
    let faces = cloud.faces.unwrap_or_default();
    assert_eq!(
        faces,
        [[2, 1, 0], [3, 1, 2], [2, 1, 0], [3, 1, 2], [4, 5, 6], [6, 5, 7], [4, 5, 6], [6, 5, 7]]
    );
    Ok(())
}

#[test]
fn sparse_rows_replace_those_of_a_buffer_or_zeros() -> Result<()> {
    let sparse = "\"sparse\": {\"count\": 2, \"indices\": {\"bufferView\": 2, \"byteOffset\": 17, \
        \"componentType\": 5121}, \"values\": {\"bufferView\": 1}}, \"type\": \"VEC3\"";
    let plain = document("{\"mesh\": 0}", POINTS);
    let mixed = plain.replacen("\"type\": \"VEC3\"", sparse, 1);
    let ends = |cloud: CloudContent| [0, 1, 2].map(|row| cloud.points[row]);
    assert_eq!(ends(read(&mixed)?), [[0.0; 3], [0.0, 0.0, 2.0], [0.0, 0.0, 2.0]]);
    let zeros = mixed.replacen("\"bufferView\": 0, ", "", 1).replacen("\"count\": 4", "\"count\": 3", 1);
    assert_eq!(ends(read(&zeros)?), [[0.0; 3], [0.0, 0.0, 2.0], [0.0, 0.0, 2.0]]);
    refused(&zeros.replacen("\"count\": 3", "\"count\": 1", 1), "accessor 0: got row 1 of 1");
    refused(&mixed.replacen("5121}", "5120}", 1), "accessor 0: got indices with signs");
    Ok(())
}

#[test]
fn buffers_are_in_the_text_or_in_files() -> Result<()> {
    let execution = Execution::default();
    let plain = document("{\"mesh\": 0}", POINTS);
    let cases = [("TWE=", "Ma"), ("TWFu\n", "Man"), ("TQ==", "M"), ("TQ", "M"), ("", "")];
    for (text, bytes) in cases {
        assert_eq!(decode_base64("a", text.as_bytes(), &execution), Ok(bytes.as_bytes().to_vec()));
    }
    let inside = plain.replace("118", "48, \"uri\": \"data:;base64,");
    let zeros = inside.replace("base64,", &format!("base64,{}\"", "A".repeat(64)));
    assert_eq!(parse(zeros.as_bytes(), &execution)?.points, [[0.0; 3]; 4]);
    assert_eq!(files_of(zeros.as_bytes(), &execution), Ok(Vec::new()));
    refused(&inside.replace("base64,", "base64,!!!\""), "buffer 0: got a text that is not base64");
    refused(&inside.replace("base64,", "base64,AAAA\""), "buffer 0: got 3 of 48 bytes");

    let beside = plain.replace("118", "118, \"uri\": \"a%20b.bin\"}, {\"uri\": \"unused.bin\"");
    assert_eq!(files_of(beside.as_bytes(), &execution), Ok(vec!["a%20b.bin".to_owned()]));
    let content = buffer();
    let files = BTreeMap::from([("a%20b.bin", &content[..])]);
    assert_eq!(parse_with(beside.as_bytes(), &files, &execution)?.points.len(), 4);
    refused(&beside, "buffer 0: got \"a%20b.bin\"; the content has no .bin file beside it");
    Ok(())
}

#[test]
fn errors_name_the_fault() {
    let plain = document("{\"mesh\": 0}", POINTS);
    for (old, new, says) in [
        ("{\"mesh\": 0}", "{}, {\"children\": [0, 0]}", "node 0: got two parents"),
        ("{\"mesh\": 0}", "{\"children\": [7]}", "nodes: got entry 7; the file has 1"),
        ("{\"mesh\": 0}", "{\"mesh\": -1}", "meshes: got entry -1; the file has 1"),
        ("{\"mesh\": 0}", "{\"mesh\": 0, \"matrix\": [1]}", "matrix: got another number of them; 16 numbers"),
        ("{\"mesh\": 0}", "7", "JSON: got 7; an object with"),
        ("\"nodes\": [", "\"scene\": 1, \"scenes\": [{}], \"nodes\": [", "scenes: got entry 1"),
        ("\"POSITION\": 0", "\"NORMAL\": 0", "POSITION: got nothing"),
        ("\"POSITION\": 0", "\"POSITION\": 3", "accessor 3: got \"SCALAR\"; VEC3 belongs there"),
        ("\"POSITION\": 0}", "\"POSITION\": 0}, \"indices\": 2", "accessor 2: got \"VEC4\"; SCALAR belongs"),
        ("\"count\": 4", "\"count\": 5", "accessor 0: got 5 rows from byte 0 on in 48 of 48 bytes"),
        ("\"count\": 4", "\"byteOffset\": 1, \"count\": 4", "4 rows from byte 1 on"),
        ("\"count\": 4", "\"count\": 4e9", "count: got 4000000000.0; a whole number"),
        (
            "\"bufferView\": 0, \"componentType\": 5126, \"count\": 4",
            "\"count\": 9000000000000",
            "would grow to",
        ),
        ("5126", "5130", "component type: got 5130"),
        ("\"byteLength\": 48", "\"byteLength\": 9223372036854775807", "in 118 of 9223372036854775807 bytes"),
        (
            "\"byteLength\": 48",
            "\"byteLength\": 48, \"byteStride\": 9223372036854775807",
            "4 rows from byte 0",
        ),
        ("\"byteLength\": 48", "\"byteOffset\": 999, \"byteLength\": 48", "in 0 of 48 bytes"),
        ("\"byteLength\": 118", "\"byteLength\": 119", "buffer 0: got 118 of 119 bytes"),
        ("\"byteLength\": 118", "\"uri\": 5", "uri: got 5; a string"),
        ("\"2.0\"", "\"1.0\"", "version: got \"1.0\"; version 2 is read"),
        (
            "\"attributes\"",
            "\"extensions\": {\"KHR_draco_mesh_compression\": {}}, \"attributes\"",
            "by Draco",
        ),
        (
            "\"byteLength\": 48",
            "\"extensions\": {\"EXT_meshopt_compression\": {}}, \"byteLength\": 48",
            "by meshopt",
        ),
    ] {
        assert!(plain.contains(old), "{old}");
        refused(&plain.replacen(old, new, 1), says);
    }
    assert_eq!(read(&plain.replace("\"2.0\"", "2.0")).map(|cloud| cloud.points.len()), Ok(4));
    assert_eq!(read(&document("{\"children\": [0]}", POINTS)), Ok(CloudContent::default()));
    refused("", "JSON: got a fault; EOF");
    let uneven =
        document("{\"mesh\": 0}", "{\"attributes\": {\"POSITION\": 0, \"NORMAL\": 1}, \"indices\": 3}");
    let short =
        uneven.replacen("\"bufferView\": 1, \"componentType\": 5126, \"count\": 4", "\"count\": 3", 1);
    refused(&short, "normals: got 3 for 4 points");
    let fewer = uneven.replace("\"count\": 4", "\"count\": 3");
    refused(&fewer, "faces: got a triangle that names point 3; there are 3");
}

#[test]
fn a_mesh_that_many_nodes_have_is_refused() {
    let nodes = vec!["{\"mesh\": 0}"; 2000].join(", ");
    refused(&document(&nodes, &vec![POINTS; 2000].join(", ")), "bytes that would grow to");
}

#[test]
fn chunks_are_checked() -> Result<()> {
    let whole = glb(&document("{\"mesh\": 0}", POINTS), &buffer());
    assert_eq!(parse(&whole, &Execution::default())?.points.len(), 4);
    let longer = |place: usize, byte| {
        let mut content = whole.clone();
        content[place] = byte;
        content
    };
    for (content, says) in [
        (whole[..whole.len() - 1].to_vec(), "version 2"),
        (whole[..10].to_vec(), "GLB: got 10 bytes, which end at byte 8"),
        (longer(4, 3), "version 3"),
        (longer(15, 255), "a chunk of 4278190"),
        (longer(8, whole[8] - 1), "a chunk of 118 bytes"),
        ([&longer(8, whole[8] + 4)[..], b"more"].concat(), "which end at byte"),
        (b"glTF\x02\0\0\0\x0c\0\0\0".to_vec(), "JSON: got a fault"),
    ] {
        let error = parse(&content, &Execution::default()).err();
        assert!(
            error.as_ref().is_some_and(|error| error.to_string().contains(says)),
            "{error:?}, not {says}"
        );
    }
    Ok(())
}
