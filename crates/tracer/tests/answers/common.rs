//! Small scenes built in code, pictures of them, and means compared with known values.

use film::{SampleRange, Unit};
use glam::{DAffine3, DMat3, DVec3};
use scene::assets::MemorySource;
use scene::model::*;
use std::sync::Arc;
use testkit::{Moments, ttest};
use tracer::{PrepareSettings, Scene, StopFlag};

/// Chance with which a single comparison may fail although all is well. The seeds are fixed: this
/// only says how surprising a result has to be.
pub const LEVEL: f64 = 1e-4;
/// Relative difference that single precision and tabulated filters account for. The most seen is 2.3e-5, in
/// a sphere that shines on itself.
pub const ROUNDING: f64 = 4e-5;

/// An empty scene: a camera at the origin that looks along -Z and sees [-1, 1]^2 in parallel rays, a
/// box filter of one pixel, paths of any depth.
pub fn blank(width: u32, height: u32) -> SceneDesc {
    SceneDesc {
        camera: Camera {
            transform: Motion::identity(),
            projection: orthographic((-1.0, 1.0), (-1.0, 1.0)),
            shutter: (0.0, 1.0),
            shutter_curve: ShutterCurve::Box,
            medium: None,
        },
        film: FilmDesc {
            width,
            height,
            crop: None,
            filter: Filter::Box { radius: (0.5, 0.5) },
            exposure: [1.0; 3],
            max_component: None,
        },
        integrator: Integrator::Path { max_depth: 64 },
        sampler: SamplerKind::default(),
        spp: None,
        animation: None,
        meshes: vec![],
        images: vec![],
        textures: vec![],
        materials: vec![],
        media: vec![],
        curves: vec![],
        primitives: vec![],
        groups: vec![],
        instances: vec![],
        lights: vec![],
    }
}

pub fn orthographic(x: (f64, f64), y: (f64, f64)) -> Projection {
    Projection::Orthographic {
        half_height: 1.0,
        window: Some(ScreenWindow { x, y }),
        lens: None,
    }
}

pub fn perspective(fov: f64, lens: Option<Lens>) -> Projection {
    Projection::Perspective {
        fov,
        fov_axis: FovAxis::Vertical,
        window: None,
        lens,
    }
}

pub fn look(from: [f64; 3], at: [f64; 3], up: [f64; 3]) -> DAffine3 {
    scene::look_at(from.into(), at.into(), up.into()).unwrap()
}

pub fn at(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, y, z))
}

/// From the square [-1, 1]^2 with normal +Z to a rectangle with a centre and two half edges.
pub fn spanned(center: [f64; 3], a: [f64; 3], b: [f64; 3]) -> DAffine3 {
    let (a, b) = (DVec3::from(a), DVec3::from(b));
    let matrix = DMat3::from_cols(a, b, a.cross(b).normalize());
    DAffine3::from_mat3_translation(matrix, center.into())
}

/// A horizontal rectangle that faces +Y, or -Y for a negative half width.
pub fn horizontal(center: [f64; 3], half_x: f64, half_z: f64) -> DAffine3 {
    spanned(center, [half_x, 0.0, 0.0], [0.0, 0.0, -half_z])
}

pub fn grey(value: f32) -> ColorTex {
    ColorTex::Const([value; 3])
}

pub fn diffuse(reflectance: f32) -> BsdfDesc {
    BsdfDesc::Diffuse {
        reflectance: grey(reflectance),
    }
}

pub fn smooth() -> Roughness {
    Roughness {
        u: FloatTex::Const(0.0),
        v: FloatTex::Const(0.0),
        scale: RoughnessScale::Alpha,
    }
}

pub fn glass() -> BsdfDesc {
    BsdfDesc::Dielectric {
        ior: 1.5,
        roughness: smooth(),
        reflect_tint: grey(1.0),
        transmit_tint: grey(1.0),
    }
}

pub fn shining(radiance: f32) -> Option<Emission> {
    Some(Emission {
        radiance: grey(radiance),
        scale: 1.0,
        two_sided: false,
    })
}

pub fn triangles(positions: &[[f32; 3]], indices: &[[u32; 3]]) -> Mesh {
    Mesh {
        positions: Arc::new(positions.to_vec()),
        indices: Arc::new(indices.to_vec()),
        ..Mesh::default()
    }
}

pub fn sky(radiance: f32) -> Light {
    Light::Environment {
        transform: DAffine3::IDENTITY,
        radiance: [radiance; 3],
        image: None,
        hidden: false,
        illuminance: None,
        portal: None,
    }
}

/// Adds things to a scene.
pub trait Build {
    fn material(&mut self, bsdf: BsdfDesc) -> MaterialId;
    fn place(&mut self, shape: Shape, transform: DAffine3, bsdf: BsdfDesc) -> &mut Primitive;
    fn mesh(&mut self, mesh: Mesh) -> Shape;
}

impl Build for SceneDesc {
    fn material(&mut self, bsdf: BsdfDesc) -> MaterialId {
        self.materials.push(Material {
            name: String::new(),
            bsdf,
            normal_map: None,
            bump_map: None,
        });
        MaterialId(self.materials.len() as u32 - 1)
    }

    fn place(&mut self, shape: Shape, transform: DAffine3, bsdf: BsdfDesc) -> &mut Primitive {
        let material = self.material(bsdf);
        self.primitives.push(Primitive {
            shape,
            transform: Motion::fixed(transform),
            material,
            emission: None,
            alpha: None,
            reverse_orientation: false,
            media: None,
        });
        self.primitives.last_mut().unwrap()
    }

    fn mesh(&mut self, mesh: Mesh) -> Shape {
        self.meshes.push(mesh);
        Shape::Mesh(MeshId(self.meshes.len() as u32 - 1))
    }
}

/// Columns of a picture as points between `x.0` and `x.1` on a line, rows as independent repetitions:
/// the filter and the height of the view shrink to nothing.
pub fn as_points(desc: &mut SceneDesc, x: (f64, f64)) {
    desc.camera.projection = orthographic(x, (-1e-7, 1e-7));
    desc.film.filter = Filter::Box {
        radius: (1e-4, 1e-4),
    };
}

/// The same, on the line y = `floor`, z = 0, from a hand's breadth above: what shines from further up
/// is not in the way.
pub fn as_points_below(desc: &mut SceneDesc, x: (f64, f64), floor: f64) {
    as_points(desc, x);
    let (from, to) = ([0.0, floor + 0.01, 0.0], [0.0, floor, 0.0]);
    desc.camera.transform = Motion::fixed(look(from, to, [0.0, 0.0, -1.0]));
}

/// Where column `i` of `n` lies.
pub fn column(i: u32, n: u32, x: (f64, f64)) -> f64 {
    x.0 + (x.1 - x.0) * (i as f64 + 0.5) / n as f64
}

pub fn compile(desc: &SceneDesc, assets: &MemorySource, seed: u64, threads: usize) -> Scene {
    let settings = PrepareSettings {
        seed,
        frame: 0,
        clamp_indirect: None,
        threads,
        picture_bytes: u64::MAX,
    };
    tracer::prepare(desc, assets, &settings, &StopFlag::default()).unwrap()
}

/// Means of the pixels.
pub struct Picture {
    pub width: u32,
    pub height: u32,
    pub rgb: Vec<[f64; 3]>,
    pub rejected: u64,
}

impl Picture {
    pub fn of(scene: &Scene, spp: u32) -> Picture {
        let grid = scene.grid();
        let mut picture = Picture {
            width: grid.width,
            height: grid.height,
            rgb: vec![[0.0; 3]; (grid.width * grid.height) as usize],
            rejected: 0,
        };
        for tile in 0..grid.count() {
            let samples = SampleRange { begin: 0, end: spp };
            let unit = Unit {
                frame: 0,
                tile,
                samples,
            };
            let (buffer, _) = tracer::render_unit(scene, &unit, &StopFlag::default()).unwrap();
            picture.rejected += buffer.rejected_count();
            let place = buffer.tile();
            for (i, sums) in buffer.pixels().iter().enumerate() {
                let (x, y) = (
                    place.x + i as u32 % place.width,
                    place.y + i as u32 / place.width,
                );
                let mean = sums
                    .beauty
                    .map(|s| film::fixed::from_fixed(s) / f64::from(spp));
                picture.rgb[(y * grid.width + x) as usize] = mean;
            }
        }
        picture
    }

    pub fn green(&self, x: u32, y: u32) -> f64 {
        self.rgb[(y * self.width + x) as usize][1]
    }

    /// Over all pixels, each of which has random numbers of its own.
    pub fn moments(&self) -> Moments {
        self.rgb.iter().map(|p| p[1]).collect()
    }

    /// Over the rows of a column.
    pub fn column(&self, x: u32) -> Moments {
        (0..self.height).map(|y| self.green(x, y)).collect()
    }
}

/// A picture without files, on one thread.
pub fn render(desc: &SceneDesc, spp: u32) -> Picture {
    Picture::of(&compile(desc, &MemorySource::new(), 7, 1), spp)
}

/// Fails unless a mean agrees with a value within its own standard error (or within rounding). The
/// standard error must be small, lest anything agree.
#[track_caller]
pub fn check(what: &str, measured: &Moments, expected: f64) {
    let difference = (measured.mean() - expected).abs();
    if difference <= ROUNDING * expected.abs().max(1e-3) {
        return;
    }
    assert!(
        measured.error() <= 0.03 * expected.abs().max(0.1),
        "{what}: {} +- {} says nothing about {expected}",
        measured.mean(),
        measured.error()
    );
    let p = ttest::p_value(measured, expected);
    assert!(
        p >= LEVEL,
        "{what}: measured {:.6} +- {:.6}, expected {expected:.6} (p = {p:.1e})",
        measured.mean(),
        measured.error()
    );
}
