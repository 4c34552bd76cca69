//! What formats without a view of their own are given: a camera that sees everything, and a soft sky.

use super::gltf::plain_camera;
use crate::apply::{DEFAULT_DEPTH, look_at};
use crate::assets::AssetBytes;
use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::model::{
    Encoding, FilmDesc, Filter, FovAxis, Integrator, Light, Motion, Primitive, Projection,
    SamplerKind, SceneDesc, Shape, SphereMapping,
};
use crate::overrides::Look;
use glam::{DAffine3, DVec3};

/// Vertical field of view of a camera that nobody described, degrees.
const VFOV: f64 = 40.0;

/// A scene with nothing in it and the settings that Brolly's own format has by default.
pub(crate) fn empty() -> SceneDesc {
    SceneDesc {
        camera: plain_camera(
            Motion::identity(),
            Projection::Perspective {
                fov: VFOV,
                fov_axis: FovAxis::Vertical,
                window: None,
                lens: None,
            },
        ),
        film: FilmDesc {
            width: 1280,
            height: 720,
            crop: None,
            filter: Filter::BlackmanHarris { radius: (1.5, 1.5) },
            exposure: [1.0; 3],
            max_component: None,
        },
        integrator: Integrator::Path {
            max_depth: DEFAULT_DEPTH,
        },
        sampler: SamplerKind::default(),
        spp: None,
        animation: None,
        meshes: Vec::new(),
        images: Vec::new(),
        textures: Vec::new(),
        materials: Vec::new(),
        media: Vec::new(),
        curves: Vec::new(),
        primitives: Vec::new(),
        groups: Vec::new(),
        instances: Vec::new(),
        lights: Vec::new(),
    }
}

/// Lowest and highest corner of everything that is placed, at the times of all keys; none if there
/// is nothing.
pub(crate) fn bounds(desc: &SceneDesc) -> Option<(DVec3, DVec3)> {
    let mut all = Bounds::default();
    for p in &desc.primitives {
        all.add(p, desc, &DAffine3::IDENTITY);
    }
    // Foreign formats do not nest groups; deeper ones would only make the frame a little tighter.
    for instance in &desc.instances {
        let Some(group) = desc.groups.get(instance.group.index()) else {
            continue;
        };
        let mut inner = Bounds::default();
        for p in &group.primitives {
            inner.add(p, desc, &DAffine3::IDENTITY);
        }
        for key in &instance.transform.keys {
            for corner in inner.corners() {
                all.point(key.transform.transform_point3(corner));
            }
        }
    }
    (all.low.x <= all.high.x).then_some((all.low, all.high))
}

struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Default for Bounds {
    fn default() -> Self {
        Bounds {
            low: DVec3::INFINITY,
            high: DVec3::NEG_INFINITY,
        }
    }
}

impl Bounds {
    fn point(&mut self, p: DVec3) {
        if p.is_finite() {
            self.low = self.low.min(p);
            self.high = self.high.max(p);
        }
    }

    fn corners(&self) -> Vec<DVec3> {
        if self.low.x > self.high.x {
            return Vec::new();
        }
        let pick =
            |i: u32, axis: u32, low: f64, high: f64| if i >> axis & 1 == 0 { low } else { high };
        (0..8)
            .map(|i| {
                DVec3::new(
                    pick(i, 0, self.low.x, self.high.x),
                    pick(i, 1, self.low.y, self.high.y),
                    pick(i, 2, self.low.z, self.high.z),
                )
            })
            .collect()
    }

    fn add(&mut self, p: &Primitive, desc: &SceneDesc, outer: &DAffine3) {
        let Shape::Mesh(id) = p.shape else { return };
        let Some(mesh) = desc.meshes.get(id.index()) else {
            return;
        };
        let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
        let moving = p.transform.is_moving();
        let mut local = Bounds::default();
        let deformed = mesh.deformation.iter().flat_map(|d| &d.keys);
        let later = deformed.flat_map(|k| &k.positions);
        for point in mesh.positions.iter().chain(later).map(wide) {
            // A fixed placement keeps the box tight; a moving one is boxed by its corners.
            match p.transform.keys.first() {
                Some(key) if !moving => {
                    self.point(outer.transform_point3(key.transform.transform_point3(point)))
                }
                _ => local.point(point),
            }
        }
        for key in p.transform.keys.iter().filter(|_| moving) {
            for corner in local.corners() {
                self.point(outer.transform_point3(key.transform.transform_point3(corner)));
            }
        }
    }
}

/// Points the camera at the whole scene, three-quarters from above, so that a sphere around it fits
/// the shorter side of the picture. Returns the middle, which is what settings look at by default.
pub(crate) fn frame(desc: &mut SceneDesc, look: &Look, size: Option<[u32; 2]>) -> DVec3 {
    let (low, high) = bounds(desc).unwrap_or((DVec3::splat(-1.0), DVec3::ONE));
    let middle = low + (high - low) * 0.5;
    let radius = ((high - low).length() * 0.5).max(1e-6);
    let vfov = look.vfov.filter(|v| *v > 0.0 && *v < 180.0).unwrap_or(VFOV);
    let [width, height] = size.unwrap_or([desc.film.width, desc.film.height]);
    let aspect = f64::from(width.max(1)) / f64::from(height.max(1));
    let half_height = libm::tan(vfov.to_radians() * 0.5);
    let half = libm::atan(half_height * aspect.min(1.0));
    let distance = radius / libm::sin(half) * 1.05;
    let direction = DVec3::new(0.55, 0.45, 1.0).normalize();
    if let Ok(transform) = look_at(middle + direction * distance, middle, DVec3::Y) {
        desc.camera.transform = Motion::fixed(transform);
    }
    middle
}

/// Whether anything gives light.
fn shines(desc: &SceneDesc) -> bool {
    let groups = desc.groups.iter().flat_map(|g| &g.primitives);
    !desc.lights.is_empty()
        || desc
            .primitives
            .iter()
            .chain(groups)
            .any(|p| p.emission.is_some())
}

/// Lights a scene that has no light of its own, and says so.
pub(crate) fn sky(
    desc: &mut SceneDesc,
    look: &Look,
    main: &str,
    cx: &mut Context<'_>,
) -> Result<(), Issue> {
    if look.env.is_some() || shines(desc) {
        return Ok(());
    }
    let place = Place {
        file: main.to_owned(),
        ..Place::default()
    };
    cx.warn(
        &place,
        "the file has no light: a soft sky lights it (--env gives another)",
    );
    let image = cx.image_bytes(&place, "soft sky.pfm", sky_picture(), Encoding::Linear)?;
    desc.lights.push(Light::Environment {
        illuminance: None,
        portal: None,
        transform: DAffine3::IDENTITY,
        radiance: [1.0; 3],
        image: Some((image, SphereMapping::LatLong)),
        hidden: false,
    });
    Ok(())
}

/// A lat-long picture of a bright zenith over a darker ground, with a broad soft light from the
/// upper left in front, so that shapes have a bright and a dark side. Radiance is near 1.
fn sky_picture() -> AssetBytes {
    const SIZE: (u32, u32) = (64, 32);
    let key = DVec3::new(-0.5, 0.7, 0.6).normalize();
    let mut out = format!("PF\n{} {}\n-1.0\n", SIZE.0, SIZE.1).into_bytes();
    // Rows of a PFM go from the bottom up.
    for row in (0..SIZE.1).rev() {
        let theta = (f64::from(row) + 0.5) / f64::from(SIZE.1) * std::f64::consts::PI;
        for column in 0..SIZE.0 {
            let u = (f64::from(column) + 0.5) / f64::from(SIZE.0);
            let phi = (u - 0.5) * std::f64::consts::TAU;
            let (sin, cos) = (libm::sin(theta), libm::cos(theta));
            let direction = DVec3::new(sin * libm::cos(phi), cos, sin * libm::sin(phi));
            let height = 0.5 + 0.5 * direction.y;
            let base = 0.35 + 0.55 * height * height * (3.0 - 2.0 * height);
            let toward = direction.dot(key).max(0.0);
            let square = toward * toward;
            let soft = square * square * square * square;
            // The light is a little warm, the sky a little blue.
            for (tint, glow) in [(0.97, 1.03), (1.0, 1.0), (1.05, 0.95)] {
                let value = (base * tint + 4.0 * soft * glow) as f32;
                out.extend_from_slice(&value.to_le_bytes());
            }
        }
    }
    AssetBytes::from(out)
}
