use super::*;
use proptest::prelude::*;
use std::io::Write;

const SQUARE: &str = "ply\nformat ascii 1.0\ncomment a square\nelement vertex 4\nproperty float x\nproperty float y\n\
    property float z\nproperty float s\nproperty uchar red\nproperty float t\nelement face 1\nproperty list uchar int \
    vertex_index\nproperty int face_indices\nend_header\n0 0 0 0 9 0\n1 0 0 1 9 0\n1 1 0 1 9 1\n0 1 0 0 9 1\n4 0 1 2 3 7\n";

fn square() -> PlyMesh {
    PlyMesh {
        positions: vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
        ],
        uvs: vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
        indices: vec![[0, 1, 2], [0, 2, 3]],
        ..PlyMesh::default()
    }
}

fn big_endian() -> Vec<u8> {
    let mut out = b"ply\r\nformat binary_big_endian 1.0\r\nelement vertex 4\r\nproperty double x\r\nproperty float y\r\n\
        property short z\r\nproperty float texture_u\r\nproperty float texture_v\r\nelement face 2\r\nproperty list \
        int16 ushort vertex_indices\r\nend_header\r\n"
        .to_vec();
    let mesh = square();
    for (p, uv) in mesh.positions.iter().zip(&mesh.uvs) {
        out.extend(f64::from(p[0]).to_be_bytes());
        out.extend(p[1].to_be_bytes());
        out.extend((p[2] as i16).to_be_bytes());
        out.extend(uv.iter().flat_map(|x| x.to_be_bytes()));
    }
    for t in &mesh.indices {
        out.extend(3i16.to_be_bytes());
        out.extend(t.iter().flat_map(|&i| (i as u16).to_be_bytes()));
    }
    out
}

#[test]
fn all_spellings_give_the_same_mesh() {
    assert_eq!(read(SQUARE.as_bytes()).unwrap(), (square(), vec![]));
    assert_eq!(read(&big_endian()).unwrap(), (square(), vec![]));
    assert_eq!(read(&write(&square())).unwrap(), (square(), vec![]));
    let with_normals = PlyMesh {
        normals: vec![[0.0, 0.0, 1.0]; 4],
        ..square()
    };
    assert_eq!(read(&write(&with_normals)).unwrap(), (with_normals, vec![]));
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(SQUARE.as_bytes()).unwrap();
    assert_eq!(read(&packed.finish().unwrap()).unwrap().0, square());
}

/// Triangles are taken as they lie until a face is something else.
#[test]
fn triangles_and_polygons_mix() {
    let faces: [&[u32]; 4] = [&[0, 1, 2], &[2, 3, 0], &[0, 1, 2, 3], &[1, 2, 3]];
    let mesh = square();
    let bytes = |faces: &[&[u32]]| {
        let mut out = write(&PlyMesh {
            indices: vec![],
            ..mesh.clone()
        });
        for face in faces {
            out.push(face.len() as u8);
            out.extend(face.iter().flat_map(|i| i.to_le_bytes()));
        }
        let header = String::from_utf8_lossy(&out[..out.len().min(400)]).into_owned();
        let at = header.find("face 0").unwrap() + 5;
        out[at] = b'0' + faces.len() as u8;
        out
    };
    let expect = vec![[0, 1, 2], [2, 3, 0], [0, 1, 2], [0, 2, 3], [1, 2, 3]];
    assert_eq!(read(&bytes(&faces)).unwrap().0.indices, expect);
    assert_eq!(read(&bytes(&faces[..2])).unwrap().0.indices, expect[..2]);
    let mut short = bytes(&faces[..2]);
    short.pop();
    let error = read(&short).unwrap_err();
    assert!(error.reason.contains("ends too early"), "{error}");
}

#[test]
fn broken_files_are_refused() {
    let check = |from: &str, to: &str, expect: &str| {
        assert!(SQUARE.contains(from), "{from}");
        let error = read(SQUARE.replace(from, to).as_bytes()).unwrap_err();
        let shown = format!("{}: {error}", error.line.unwrap_or(0));
        assert!(shown.contains(expect), "{from:?} -> {to:?}: {shown}");
    };
    check("ply\n", "", "1: not a PLY");
    check("ascii", "utf8", "2: unknown format");
    check("vertex 4", "vertex 4000000000", "promises 4000000000");
    check("vertex 4", "vertex -4", "not a count");
    check("vertex 4", "vertex 5", "promises 1 of element");
    check("float x", "float w", "without x, y and z");
    check("float x", "list uchar float x", "is a list");
    check("float x", "half x", "5: unknown type");
    check("float y", "float x", "there twice");
    check("vertex_index", "corners", "without a list vertex_indices");
    check("end_header", "", "unknown header line");
    check("4 0 1 2 3 7", "4 0 1 2 4 7", "uses vertex 4");
    check("4 0 1 2 3 7", "4 0 1 2 -1 7", "uses vertex -1");
    check("4 0 1 2 3 7", "2 0 1 7", "2 corners");
    check("4 0 1 2 3 7", "400000 0 1 7", "limit is 65536");
    check("4 0 1 2 3 7", "4 0 1 2.5 3 7", "expected an integer");
    check("4 0 1 2 3 7", "4 0 1", "ends too early");
    check("4 0 1 2 3 7", "", "promises 1 of element");
    check("1 1 0 1 9 1", "1 nan 0 1 9 1", "not a finite");
    check(
        "1 1 0 1 9 1",
        "1 x 0 1 9 1",
        "17: expected a number, found \"x\"",
    );
    check("1 1 0 1 9 1", "1 1e99 0 1 9 1", "not a finite");
    check("face 1", "face 0", "without faces");
    let binary = write(&square());
    let error = read(&binary[..binary.len() - 1]).unwrap_err();
    assert!(error.reason.contains("at byte"), "{error}");
    assert!(
        read(&[0x1f, 0x8b, 8, 0, 1, 2])
            .unwrap_err()
            .reason
            .contains("gzip")
    );
}

#[test]
fn bad_normals_are_left_out_with_a_note() {
    let mesh = PlyMesh {
        normals: vec![[f32::NAN; 3]; 4],
        ..square()
    };
    let (got, notes) = read(&write(&mesh)).unwrap();
    assert_eq!(got, square());
    assert_eq!(notes.len(), 1);
}

#[test]
fn colours_are_fractions_of_their_type() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty ushort green\nproperty float blue\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n\
        0 0 0 255 65535 0.5\n1 0 0 51 0 1\n0 1 0 0 0 0\n3 0 1 2\n";
    let (mesh, notes) = read(text.as_bytes()).unwrap();
    assert_eq!(mesh.colors, [[1.0, 1.0, 0.5], [0.2, 0.0, 1.0], [0.0; 3]]);
    assert!(notes.is_empty(), "{notes:?}");
    let (mesh, notes) = read(text.replace("0.5", "nan").as_bytes()).unwrap();
    assert_eq!((mesh.colors.len(), notes.len()), (0, 1));
}

proptest! {
    #[test]
    fn damage_never_panics(at in 0usize..600, byte: u8, cut in 0usize..600, which in 0..3) {
        let mut bytes = match which {
            0 => SQUARE.as_bytes().to_vec(),
            1 => big_endian(),
            _ => write(&square()),
        };
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = read(&bytes);
        bytes.truncate(cut);
        let _ = read(&bytes);
    }
}
