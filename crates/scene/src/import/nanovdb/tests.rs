use super::testing::{Draft, file};
use super::*;

fn wave([x, y, z]: [i32; 3]) -> f32 {
    0.5 + 0.01 * (x + 3 * y - 2 * z) as f32
}

fn open_first(bytes: &[u8]) -> Result<Volume<'_>, String> {
    grids(bytes)?.remove(0).open()
}

#[test]
fn values_come_back_in_every_form() {
    let (low, high) = ([-10, 3, -1], [7, 9, 12]);
    for (kind, tolerance) in [(1, 0.0), (13, 0.03), (14, 2e-3), (15, 1e-5), (16, 2e-3)] {
        for codec in [0, 1] {
            let mut draft = Draft::new("density").filled(low, high, wave);
            draft.kind = kind;
            let bytes = file(&[draft], codec);
            let volume = open_first(&bytes).unwrap();
            let space = volume.active.unwrap();
            assert_eq!(space, [low, high].map(|p| p.map(i64::from)));
            let (size, values) = volume.dense(&space, 1).unwrap();
            assert_eq!(size, [18, 7, 14]);
            let mut i = 0;
            for z in low[2]..=high[2] {
                for y in low[1]..=high[1] {
                    for x in low[0]..=high[0] {
                        let error = (values[i] - wave([x, y, z])).abs();
                        assert!(error <= tolerance, "kind {kind}: {error} at {x} {y} {z}");
                        i += 1;
                    }
                }
            }
        }
    }
}

#[test]
fn blocks_and_background_are_painted() {
    let mut draft = Draft::new("density").filled([0; 3], [0; 3], |_| 9.0);
    draft.background = 0.25;
    draft.blocks = vec![
        ([8, 0, 0], 8, 2.0),
        ([128, 0, 0], 128, 3.0),
        ([-4096, 0, 0], 4096, 4.0),
    ];
    let bytes = file(&[draft], 0);
    let volume = open_first(&bytes).unwrap();
    assert_eq!(volume.active.unwrap(), [[-4096, 0, 0], [255, 4095, 4095]]);
    let (_, row) = volume.dense(&[[-2, 0, 0], [257, 0, 0]], 1).unwrap();
    let at = |x: i32| row[(x + 2) as usize];
    let found = [-2, -1, 0, 1, 7, 8, 15, 16, 127, 128, 255, 256].map(at);
    let expected = [
        4.0, 4.0, 9.0, 0.25, 0.25, 2.0, 2.0, 0.25, 0.25, 3.0, 3.0, 0.25,
    ];
    assert_eq!(found, expected);
    // Coarser, each cell is the mean of its voxels.
    let space = [[-2, 0, 0], [257, 2, 3]];
    let (fine_size, fine) = volume.dense(&space, 1).unwrap();
    let (size, coarse) = volume.dense(&space, 4).unwrap();
    assert_eq!(size, [65, 1, 1]);
    assert_eq!(cells(&space, 4), [65, 1, 1]);
    for (i, mean) in coarse.iter().enumerate() {
        let mut sum = 0.0;
        for z in 0..4 {
            for y in 0..4 {
                for x in 4 * i..4 * i + 4 {
                    // Beyond the box is background.
                    let inside = y < 3;
                    let k = (z * fine_size[1] as usize + y) * fine_size[0] as usize + x;
                    sum += if inside { fine[k] } else { 0.25 };
                }
            }
        }
        assert!(
            (mean - sum / 64.0).abs() < 1e-5,
            "{i}: {mean} {}",
            sum / 64.0
        );
    }
}

#[test]
fn grids_have_names_and_transforms() {
    let mut density = Draft::new("density").filled([0; 3], [1; 3], |_| 1.0);
    density.map = [0.0, -2.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 4.0, 5.0, 6.0, 7.0];
    let heat = Draft::new("heat").filled([4; 3], [4; 3], |_| 900.0);
    // Two segments in one file.
    let mut bytes = file(&[density.clone(), heat.clone()], 1);
    bytes.extend(file(
        &[Draft {
            name: "third",
            ..heat
        }],
        0,
    ));
    let list = grids(&bytes).unwrap();
    let names: Vec<&str> = list.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, ["density", "heat", "third"]);
    let volume = list[0].open().unwrap();
    let p = volume
        .to_medium
        .transform_point3(DVec3::new(1.0, 10.0, 100.0));
    assert_eq!(p, DVec3::new(-15.0, 9.0, 407.0));
    assert!(!volume.no_density);
    assert_eq!(list[2].open().unwrap().active, Some([[4; 3]; 2]));
    // As it lies in memory, without the facts.
    let raw = density.bytes();
    let list = grids(&raw).unwrap();
    assert_eq!((list.len(), list[0].name.as_str()), (1, "density"));
    assert!(list[0].open().unwrap().active.is_some());
    let empty = file(&[Draft::new("nothing")], 0);
    assert_eq!(open_first(&empty).unwrap().active, None);
}

#[test]
fn other_kinds_are_refused_by_name() {
    let plain = Draft::new("density").filled([0; 3], [1; 3], |_| 1.0);
    let fail = |bytes: &[u8]| open_first(bytes).unwrap_err();
    let blosc = fail(&file(std::slice::from_ref(&plain), 2));
    assert!(
        blosc.contains("Blosc") && blosc.contains("nanovdb_convert"),
        "{blosc}"
    );
    let vectors = fail(&file(
        &[Draft {
            kind: 6,
            ..plain.clone()
        }],
        0,
    ));
    assert!(vectors.contains("vec3f"), "{vectors}");
    assert!(fail(b" BDV\0\0\0\0....").contains("OpenVDB"));
    assert!(fail(b"2BDVonaN....").contains("big-endian"));
    assert!(fail(b"GIF89a......").contains("not a NanoVDB"));
    let mut old = file(&[plain], 0);
    old[8..12].copy_from_slice(&(29u32 << 21).to_le_bytes());
    assert!(fail(&old).contains("version 29.0"), "{}", fail(&old));
}

#[test]
fn damaged_files_are_refused() {
    let draft = Draft::new("density").filled([0; 3], [8; 3], wave);
    let whole = file(std::slice::from_ref(&draft), 0);
    let fail = |bytes: &[u8]| {
        let volume = open_first(bytes)?;
        let space = volume.active.unwrap_or([[0; 3]; 2]);
        volume
            .dense(&[space[0], space[0].map(|x| x + 20)], 1)
            .map(|_| ())
    };
    assert_eq!(fail(&whole), Ok(()));
    // Cut off anywhere.
    for end in [0, 7, 15, 100, 191, 199, 500, 900, 5_000, whole.len() - 1] {
        assert!(fail(&whole[..end]).is_err(), "{end}");
    }
    let body = whole.len() - draft.bytes().len();
    let root = body + 672 + 64;
    let patch = |at: usize, with: &[u8]| {
        let mut bytes = whole.clone();
        bytes[at..at + with.len()].copy_from_slice(with);
        fail(&bytes).unwrap_err()
    };
    let huge = (u64::MAX / 2).to_le_bytes();
    // Sizes and distances beyond all bytes.
    for at in [16 + 8, body + 672 + 24, root + 64 + 8] {
        patch(at, &huge);
    }
    patch(16 + 136, &u32::MAX.to_le_bytes());
    patch(root + 24, &u32::MAX.to_le_bytes());
    patch(root + 28, &f32::NAN.to_le_bytes());
    patch(body + 384, &f64::NAN.to_le_bytes());
    // A node that is its own child ends.
    let upper = root + 64 + 32;
    let mut looped = whole.clone();
    looped[upper + 32 + 4096..upper + 32 + 8192].fill(0xff);
    for entry in looped[upper + 8256..upper + 270_400].chunks_exact_mut(8) {
        entry.fill(0);
    }
    assert!(fail(&looped).is_err());
    // A block twice.
    let mut two = draft.clone();
    two.blocks = vec![([4096, 0, 0], 4096, 1.0)];
    let mut two = file(&[two], 0);
    let (first, second) = (root + 64, root + 96);
    let key: Vec<u8> = two[first..first + 8].to_vec();
    two[second..second + 8].copy_from_slice(&key);
    assert!(fail(&two).unwrap_err().contains("twice"));
    // Packed data that is larger than stated.
    let mut packed = file(&[draft], 1);
    packed[16..24].copy_from_slice(&1000u64.to_le_bytes());
    assert!(fail(&packed).is_err());
}
