//! Tiny scenes with some of everything: soft shadows, a mirror, glass, a depth of field.

use client::{Upload, UploadBody, digest};
use protocol::{JobRequest, Stop};
use scene::Look;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A scene on disk, gone with this value.
pub struct TestScene {
    folder: TempDir,
}

/// What a test changes about a job.
#[derive(Clone, Debug, Default)]
pub struct Tuning {
    pub seed: u64,
    pub size: Option<[u32; 2]>,
    pub priority: Option<u8>,
    pub stop: Stop,
    pub frames: Option<[u32; 2]>,
}

impl Tuning {
    /// So many samples per pixel.
    pub fn spp(spp: u32) -> Self {
        Tuning {
            stop: Stop {
                spp: Some(spp),
                ..Stop::default()
            },
            ..Tuning::default()
        }
    }
    /// Until so little error is left, or so many samples.
    pub fn noise(noise: f64, spp: u32) -> Self {
        Tuning {
            stop: Stop {
                noise: Some(noise),
                spp: Some(spp),
                ..Stop::default()
            },
            ..Tuning::default()
        }
    }
}

const FLOOR: &str = "ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
-4 0 -4
4 0 -4
4 0 4
-4 0 4
3 0 2 1
3 0 3 2
";

impl TestScene {
    /// A room with a lamp, `width` by `height` pixels, 8 spp unless asked otherwise.
    pub fn room(width: u32, height: u32) -> Self {
        let scene = TestScene {
            folder: tempfile::tempdir().expect("a folder for a test scene"),
        };
        scene.write("floor.ply", FLOOR.as_bytes());
        scene.write("scene.pbrt", room(width, height).as_bytes());
        scene
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Its main file.
    pub fn main(&self) -> PathBuf {
        self.folder.path().join("scene.pbrt")
    }

    /// Adds or replaces a file.
    pub fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.folder.path().join(name), bytes).expect("a file of a test scene");
    }

    /// Changes the main file.
    pub fn replace(&self, from: &str, to: &str) {
        let text = std::fs::read_to_string(self.main()).expect("the main file");
        assert!(text.contains(from), "the scene has no {from:?}");
        self.write("scene.pbrt", text.replace(from, to).as_bytes());
    }

    /// Its files for upload.
    pub fn uploads(&self) -> BTreeMap<String, Upload> {
        std::fs::read_dir(self.folder.path())
            .expect("the scene's folder")
            .map(|entry| {
                let entry = entry.expect("an entry of the scene's folder");
                let bytes = std::fs::read(entry.path()).expect("a file of the scene");
                let upload = Upload {
                    digest: digest::of_bytes(&bytes),
                    body: UploadBody::Bytes(bytes.into()),
                };
                (entry.file_name().to_string_lossy().into_owned(), upload)
            })
            .collect()
    }

    /// The request for a job.
    pub fn request(&self, tuning: &Tuning) -> JobRequest {
        JobRequest {
            scene: "scene.pbrt".into(),
            files: self
                .uploads()
                .into_iter()
                .map(|(path, upload)| (path, upload.digest))
                .collect(),
            name: Some("test".into()),
            priority: tuning.priority,
            seed: tuning.seed,
            size: tuning.size,
            integrator: None,
            stop: tuning.stop.clone(),
            look: Look::default(),
            frames: tuning.frames,
            allow_missing: false,
            clamp_indirect: None,
        }
    }
}

fn room(width: u32, height: u32) -> String {
    format!(
        r#"LookAt 0 1.4 5  0 0.9 0  0 1 0
Camera "perspective" "float fov" [40] "float lensradius" [0.03] "float focaldistance" [5]
Film "rgb" "integer xresolution" [{width}] "integer yresolution" [{height}] "string filename" "out.exr"
Sampler "zsobol" "integer pixelsamples" [8]
Integrator "path" "integer maxdepth" [5]
WorldBegin
AttributeBegin
  AreaLightSource "diffuse" "rgb L" [12 11 9]
  Translate 0.5 3.5 0.5
  Shape "sphere" "float radius" [0.4]
AttributeEnd
Material "diffuse" "rgb reflectance" [0.6 0.5 0.4]
Shape "plymesh" "string filename" "floor.ply"
AttributeBegin
  Translate -0.8 0.6 0
  Material "conductor" "float roughness" [0.1]
  Shape "sphere" "float radius" [0.6]
AttributeEnd
AttributeBegin
  Translate 0.7 0.5 0.6
  Material "dielectric"
  Shape "sphere" "float radius" [0.5]
AttributeEnd
AttributeBegin
  Material "diffuse" "rgb reflectance" [0.2 0.3 0.7]
  Shape "trianglemesh" "integer indices" [0 1 2 0 2 3]
    "point3 P" [-4 0 -2  4 0 -2  4 4 -2  -4 4 -2]
AttributeEnd
"#
    )
}
