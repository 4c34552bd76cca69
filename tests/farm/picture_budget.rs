//! Scenes with more pictures than a worker has memory.

use crate::support::{Brolly, TestFarm, TestScene, Tuning};
use image::{ImageFormat, Rgb, RgbImage};
use std::fmt::Write as _;
use std::io::Cursor;

/// Pixels along an edge: 4 MiB decoded, with the smaller copies 5.5.
const EDGE: u32 = 1024;
const COLUMNS: u32 = 5;
const ROWS: u32 = 3;

/// A wall of pictures, no two alike, that the camera sees all of.
fn gallery() -> TestScene {
    let scene = TestScene::room(80, 48);
    let mut text = String::from(
        "LookAt 2.5 1.5 9  2.5 1.5 0  0 1 0
Camera \"perspective\" \"float fov\" [20]
Film \"rgb\" \"integer xresolution\" [80] \"integer yresolution\" [48] \"string filename\" \"out.exr\"
Integrator \"path\" \"integer maxdepth\" [1]
WorldBegin
LightSource \"infinite\" \"rgb L\" [1 1 1]
",
    );
    for i in 0..COLUMNS * ROWS {
        let picture = RgbImage::from_fn(EDGE, EDGE, |x, y| {
            Rgb([(x / 4) as u8, (y / 4) as u8, (i * 16) as u8])
        });
        let mut png = Cursor::new(Vec::new());
        picture.write_to(&mut png, ImageFormat::Png).unwrap();
        scene.write(&format!("{i}.png"), &png.into_inner());
        let (x, y) = (i % COLUMNS, i / COLUMNS);
        write!(
            text,
            "Texture \"t{i}\" \"spectrum\" \"imagemap\" \"string filename\" \"{i}.png\" \"string filter\" \"trilinear\"
Material \"diffuse\" \"texture reflectance\" \"t{i}\"
Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3] \"point2 uv\" [0 0 1 0 1 1 0 1]
  \"point3 P\" [{x} {y} 0  {x1} {y} 0  {x1} {y1} 0  {x} {y1} 0]
",
            x1 = x + 1,
            y1 = y + 1
        )
        .unwrap();
    }
    scene.write("scene.pbrt", text.as_bytes());
    scene
}

#[tokio::test(flavor = "multi_thread")]
async fn more_pictures_than_memory() {
    let scene = gallery();
    let render = async |memory: &'static str| {
        let farm = TestFarm::start().await;
        let worker = Brolly::start(&["work", &farm.url, "--threads", "1", "--memory", memory]);
        let id = farm.submit(&scene, &Tuning::spp(2)).await;
        let outcome = farm.outcome(id).await;
        (outcome, worker.peak_memory())
    };
    let (plenty, with_plenty) = render("4G").await;
    let (scarce, with_little) = render("24M").await;
    assert_eq!(scarce, plenty, "what is dropped comes back as it was");
    // 15 pictures of 5.5 MiB, of which 24 MB leave room for one.
    if let (Some(plenty), Some(little)) = (with_plenty, with_little) {
        assert!(
            little + (40 << 20) < plenty,
            "{little} bytes at most against {plenty}"
        );
    }
}
