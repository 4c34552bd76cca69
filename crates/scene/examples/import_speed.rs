//! How fast scenes are read: a pbrt file full of numbers, and PLY meshes in three encodings.
//!
//! `cargo run --release -p brolly-scene --example import_speed [MEGABYTES]`

use scene::assets::MemorySource;
use scene::import::ply::{self, PlyMesh};
use scene::{Overrides, load};
use std::fmt::Write;
use std::time::Instant;

fn report(what: &str, bytes: usize, start: Instant) {
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{what}: {:.0} MB in {seconds:.2} s, {:.0} MB/s",
        bytes as f64 / 1e6,
        bytes as f64 / 1e6 / seconds
    );
}

/// A wavy sheet of about that many vertices.
fn sheet(vertices: usize) -> PlyMesh {
    let side = (vertices as f64).sqrt() as u32;
    let mut mesh = PlyMesh::default();
    for j in 0..side {
        for i in 0..side {
            let (x, y) = (
                f64::from(i) / f64::from(side),
                f64::from(j) / f64::from(side),
            );
            mesh.positions
                .push([x as f32, y as f32, libm::sin(9.0 * x * y) as f32]);
            mesh.normals.push([0.0, libm::sin(y) as f32, 1.0]);
            mesh.uvs.push([x as f32, y as f32]);
            if i + 1 < side && j + 1 < side {
                let a = j * side + i;
                mesh.indices
                    .extend([[a, a + 1, a + side + 1], [a, a + side + 1, a + side]]);
            }
        }
    }
    mesh
}

fn ascii(mesh: &PlyMesh) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.indices.len()
    );
    for [x, y, z] in &mesh.positions {
        let _ = writeln!(text, "{x} {y} {z}");
    }
    for [a, b, c] in &mesh.indices {
        let _ = writeln!(text, "3 {a} {b} {c}");
    }
    text
}

fn main() {
    let megabytes: usize = std::env::args()
        .nth(1)
        .and_then(|n| n.parse().ok())
        .unwrap_or(100);
    let mesh = sheet(megabytes * 12_000);

    let mut text = String::from(
        "WorldBegin\nLightSource \"infinite\"\nShape \"trianglemesh\" \"point3 P\" [\n",
    );
    for [x, y, z] in &mesh.positions {
        let _ = writeln!(text, "{x} {y} {z}");
    }
    text.push_str("] \"integer indices\" [\n");
    for [a, b, c] in &mesh.indices {
        let _ = writeln!(text, "{a} {b} {c}");
    }
    text.push_str("]\n");
    let size = text.len();
    let assets = MemorySource::new()
        .with("s.pbrt", text)
        .expect("a plain path");
    let start = Instant::now();
    let (desc, _) = load("s.pbrt", &assets, &Overrides::default()).expect("a sound scene");
    report("pbrt with one mesh, all checks", size, start);
    assert_eq!(desc.meshes[0].indices.len(), mesh.indices.len());

    let mut text = String::from("WorldBegin\nLightSource \"infinite\"\n");
    for i in 0..megabytes * 8_000 {
        let x = i % 1000;
        let _ = writeln!(
            text,
            "AttributeBegin\nTranslate {x} 0.5 {i}\nRotate 30 0 1 0\nMaterial \"diffuse\" \"rgb reflectance\" [0.1 0.2 0.{x}]"
        );
        text.push_str("Shape \"sphere\" \"float radius\" 0.25\nAttributeEnd\n");
    }
    let size = text.len();
    let assets = MemorySource::new()
        .with("s.pbrt", text)
        .expect("a plain path");
    let start = Instant::now();
    load("s.pbrt", &assets, &Overrides::default()).expect("a sound scene");
    report("pbrt with many spheres, all checks", size, start);

    let binary = ply::write(&mesh);
    let start = Instant::now();
    ply::read(&binary).expect("a sound mesh");
    report("binary PLY", binary.len(), start);
    let text = ascii(&mesh);
    let start = Instant::now();
    ply::read(text.as_bytes()).expect("a sound mesh");
    report("ASCII PLY", text.len(), start);
}
