//! Writes the seeds of the fuzzers that are not text: pictures, archives, packed meshes, results and
//! checkpoints. Small, of every kind that is read, and the same in every run.
//!
//! `cargo run -p brolly-fuzzing --example seeds`

use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, GeometryAttributeType, Mesh, MeshEncoder,
    PointAttribute,
};
use film::{
    Counters, ENGINE_VERSION, Film, LayerSample, Receipt, SampleBuffer, SampleRange, TileGrid,
    Unit, UnitResult, encode_unit,
};
use image::{DynamicImage, ImageFormat};
use std::io::{Cursor, Write};
use std::path::Path;

fn save(target: &str, name: &str, bytes: &[u8]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../fuzz/corpus")
        .join(target);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join(format!("seed-{name}")), bytes).unwrap();
}

fn encoded(picture: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    picture.write_to(&mut out, format).unwrap();
    out.into_inner()
}

/// Three by two blocks of UASTC with alpha, each of one colour.
fn ktx2() -> Vec<u8> {
    let mut out = scene::picture::KTX2.to_vec();
    let words = [
        // Format, type size, width, height, depth, layers, faces, levels, packing.
        0u32,
        1,
        9,
        7,
        0,
        0,
        1,
        1,
        0,
        // The descriptor, key-value data, global data.
        104,
        44,
        0,
        0,
        0,
        0,
        0,
        0,
        // The level: where, how long, unpacked.
        160,
        0,
        96,
        0,
        96,
        0,
        // The descriptor and 12 bytes of nothing up to the level.
        44,
        0,
        0x0028_0002,
        0x0001_01a6,
        0x0303,
        16,
        0,
        0x037f_0000,
        0,
        0,
        u32::MAX,
    ];
    out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    out.extend([0; 12]);
    for block in 0..6u8 {
        let colour = u32::from_le_bytes([block * 40, 50, 77, 255]);
        out.extend((0x17 | (u128::from(colour) << 5)).to_le_bytes());
    }
    out
}

fn pictures() {
    let color = image::RgbaImage::from_fn(9, 7, |x, y| {
        image::Rgba([x as u8 * 28, y as u8 * 36, 90, 255 - x as u8 * 9])
    });
    let color = DynamicImage::ImageRgba8(color);
    let rgb = DynamicImage::ImageRgb8(color.to_rgb8());
    let grey = DynamicImage::ImageLuma8(color.to_luma8());
    let floats = DynamicImage::ImageRgb32F(color.to_rgb32f());
    let mut pfm = b"PF\n3 2\n-1.0\n".to_vec();
    pfm.extend((0..18).flat_map(|i| (i as f32).to_le_bytes()));
    let mut grey_pfm = b"Pf\n2 2\n1.0\n".to_vec();
    grey_pfm.extend((0..4).flat_map(|i| (i as f32).to_be_bytes()));
    let all = [
        ("rgba.png", encoded(&color, ImageFormat::Png)),
        ("grey.png", encoded(&grey, ImageFormat::Png)),
        (
            "words.png",
            encoded(
                &DynamicImage::ImageRgb16(color.to_rgb16()),
                ImageFormat::Png,
            ),
        ),
        ("rgb.jpg", encoded(&rgb, ImageFormat::Jpeg)),
        ("grey.jpg", encoded(&grey, ImageFormat::Jpeg)),
        ("rgba.tga", encoded(&color, ImageFormat::Tga)),
        ("rgba.webp", encoded(&color, ImageFormat::WebP)),
        ("rgb.hdr", encoded(&floats, ImageFormat::Hdr)),
        ("rgb.exr", encoded(&floats, ImageFormat::OpenExr)),
        ("rgb.bmp", encoded(&rgb, ImageFormat::Bmp)),
        ("uastc.ktx2", ktx2()),
        ("rgb.pfm", pfm),
        ("grey.pfm", grey_pfm),
    ];
    for (name, bytes) in &all {
        save("picture", name, bytes);
        let not_compared = [".jpg", ".tga", ".webp", ".bmp", ".ktx2"];
        if !not_compared.iter().any(|ending| name.ends_with(ending)) {
            save("compared", name, bytes);
        }
    }
}

fn archives() {
    let scene = "Film \"rgb\" \"integer xresolution\" 8 \"integer yresolution\" 8\nWorldBegin\n\
        LightSource \"infinite\"\nTexture \"t\" \"spectrum\" \"imagemap\" \"string filename\" \"a/p.png\"\n\
        Material \"diffuse\" \"texture reflectance\" \"t\"\nShape \"sphere\"\n";
    let png = encoded(&DynamicImage::new_rgb8(2, 2), ImageFormat::Png);
    for (name, method) in [
        ("deflated", zip::CompressionMethod::Deflated),
        ("stored", zip::CompressionMethod::Stored),
    ] {
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (path, bytes) in [("scene.pbrt", scene.as_bytes()), ("a/p.png", &png)] {
            writer.start_file(path, options).unwrap();
            writer.write_all(bytes).unwrap();
        }
        save("zip", name, &writer.finish().unwrap().into_inner());
    }
}

/// A wavy sheet with normals and texture coordinates.
fn draco() {
    const SIDE: u32 = 4;
    let points = SIDE * SIDE;
    let (mut positions, mut normals, mut uvs, mut indices) = (vec![], vec![], vec![], vec![]);
    for j in 0..SIDE {
        for i in 0..SIDE {
            let (x, y) = (i as f32, j as f32);
            positions.extend([x, y, (x * y) * 0.25]);
            normals.extend([0.0f32, 0.6, 0.8]);
            uvs.extend([x / 4.0, y / 4.0]);
            if i > 0 && j > 0 {
                let at = j * SIDE + i;
                indices.extend([at - SIDE - 1, at - SIDE, at, at - SIDE - 1, at, at - 1]);
            }
        }
    }
    for (name, method, speed) in [("sequential", 0, 5), ("edgebreaker", 1, 5), ("slow", 1, 0)] {
        let mut mesh = Mesh::new();
        for (id, kind, width, numbers) in [
            (0, GeometryAttributeType::Position, 3u8, &positions),
            (1, GeometryAttributeType::Normal, 3, &normals),
            (2, GeometryAttributeType::TexCoord, 2, &uvs),
        ] {
            let mut attribute = PointAttribute::new();
            attribute.init(kind, width, DataType::Float32, false, points as usize);
            let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
            attribute.buffer_mut().update(&bytes, Some(0));
            attribute.set_unique_id(id);
            mesh.add_attribute_preserve_unique_id(attribute);
        }
        mesh.set_num_points(points as usize);
        mesh.set_num_faces(indices.len() / 3);
        mesh.set_faces_from_flat_indices(&indices);
        let mut options = EncoderOptions::new();
        options.set_encoding_method(method);
        options.set_global_int("encoding_speed", speed);
        options.set_global_int("decoding_speed", speed);
        let mut encoder = MeshEncoder::new();
        encoder.set_mesh(mesh);
        let mut out = EncoderBuffer::new();
        encoder.encode(&options, &mut out).unwrap();
        save("draco", name, out.data());
    }
}

fn meshopt() {
    // Each begins with mode, filter, stride and count, as the target wants it.
    let mut triangles = vec![1, 0, 0, 9, 0xe1, 0xf0, 0x10, 0xfe, 0x00];
    triangles.extend([0; 16]);
    save("meshopt", "triangles", &triangles);
    let mut sequence = vec![2, 0, 0, 4, 0xd1, 0x04, 0xc9, 0x01, 0x04, 0x03];
    sequence.extend([0; 4]);
    save("meshopt", "sequence", &sequence);
    for (name, filter, stride) in [
        ("plain", 0, 12),
        ("octahedral", 1, 4),
        ("quaternion", 2, 8),
        ("exponential", 3, 12),
    ] {
        let mut packed = vec![0, filter, 0, 2, 0xa0];
        // A byte of the elements after the other: no change, or changes of two, four and eight bits.
        for byte in 0..stride {
            packed.push(byte % 4);
            let numbers = [0usize, 4, 8, 16][usize::from(byte % 4)];
            packed.extend((0..numbers).map(|i| (i as u8).wrapping_mul(37)));
        }
        let base: Vec<u8> = (0..stride).collect();
        packed.resize(packed.len() + 32 - base.len(), 0);
        packed.extend(base);
        save("meshopt", name, &packed);
    }
}

fn rendered(grid: TileGrid, unit: Unit) -> UnitResult {
    let tile = grid.tile(unit.tile);
    let mut buffer = SampleBuffer::new(tile, unit.samples);
    let mut counters = Counters::default();
    for (x, y) in (0..tile.height).flat_map(|y| (0..tile.width).map(move |x| (x, y))) {
        for index in unit.samples.begin..unit.samples.end {
            let value = (x * 7 + y * 3 + index) as f32 * 0.125;
            let sample = LayerSample {
                beauty: [
                    value,
                    0.5 * value,
                    if x == 3 && y == 2 { f32::NAN } else { 1.0 },
                ],
                alpha: 1.0,
                depth: value,
                ..LayerSample::EMPTY
            };
            counters.samples += 1;
            counters.rejected += u64::from(buffer.add(x, y, index, &sample).is_err());
        }
    }
    UnitResult {
        unit,
        engine: ENGINE_VERSION,
        tile,
        counters,
        buffer,
    }
}

fn films() {
    // Its second tile is small.
    let grid = TileGrid {
        width: 70,
        height: 5,
    };
    let mut film = Film::new(grid, 0);
    for (name, begin, end) in [("first", 0, 1), ("later", 4, 8)] {
        let samples = SampleRange { begin, end };
        let unit = Unit {
            frame: 0,
            tile: 1,
            samples,
        };
        let result = rendered(grid, unit);
        let bytes = encode_unit(unit, &result.buffer, &result.counters, result.engine);
        save("unit", name, &bytes);
        film.merge(&result, Receipt::of(&bytes, "a worker"))
            .unwrap();
    }
    let manifest = film
        .checkpoint(None, 17, |_, bytes| {
            save("checkpoint", "tile", &bytes);
            Ok::<(), std::convert::Infallible>(())
        })
        .unwrap();
    save("checkpoint", "manifest", &manifest.encode());
}

fn main() {
    films();
    archives();
    meshopt();
    pictures();
    draco();
}
