//! What lanes want to know about surfaces, materials and lights, ready to be read.

use crate::accel::Geometry;
use crate::accel::node::PrimRef;
use crate::bsdf::Bsdf;
use crate::bsdf::lanes::Params;
use crate::geometry::Surface;
use crate::geometry::interaction::{ROUNDING_OF_CORNERS, largest};
use crate::geometry::quadric::Quadric;
use crate::lanes::Row;
use crate::light::{AreaShape, Light, Lights};
use crate::material::{Material, Materials};
use crate::math::{self, Rgb};
use crate::ray::NONE;
use glam::Vec3;
use scene::model::ColorTex;

/// Of a prepared scene.
#[derive(Default)]
pub(crate) struct Tables {
    /// By primitive of the world: what is to be done with its hits.
    kinds: Vec<Kind>,
    /// By surface: see [`Kind::model`] and [`Tables::given`].
    surfaces: Vec<(Model, Rgb)>,
    /// By material: models with lanes, and their parameters.
    models: Vec<(Model, Params)>,
    /// By primitive of a small world: see [`Record`].
    records: Vec<Record>,
    /// By light: those that are sampled in lanes.
    lights: Vec<Option<Lamp>>,
    /// If no choice of light is to be made: which.
    only: Option<u32>,
    /// Radiance of a sky that is the same all around, which scattering alone finds.
    sky: Option<Rgb>,
}

/// What is done with hits on a primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kind {
    /// How the vertex is found.
    pub find: Find,
    /// How it scatters; [`Model::Other`] only if it is found one by one.
    pub model: Model,
}

impl Kind {
    /// Nothing is done in lanes.
    pub const OTHER: Kind = Kind {
        find: Find::Other,
        model: Model::Other,
    };
}

/// How the vertex of a hit is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Find {
    /// One by one.
    Other,
    /// In lanes: triangles that do not deform.
    Mesh,
    /// The same without normals at the corners, from its [`Record`].
    Flat,
    /// In lanes: round spheres, from their [`Record`].
    Sphere,
}

/// How a vertex scatters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Model {
    /// One by one.
    Other,
    /// In lanes.
    Diffuse,
    /// In lanes.
    Conductor,
    /// In lanes.
    Dielectric,
}

/// A primitive ready to be read. A triangle: its corners; then its normal, what its size adds to the error
/// of its points, what [`Tables::given`] says. A sphere: centre, radius, 1 or -1 if it is turned inside out;
/// then what [`Tables::given`] says at the same place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record(pub [Row; 2]);

/// Primitives of a world that gets records, which take 16 MiB then.
const RECORDS_MAX: usize = 1 << 18;

/// A shape of constant radiance. Of a triangle or parallelogram: a corner, the edges from it, the normal,
/// the density per area of its points, the radiance; then 1 or 0 each: it is a triangle, both sides shine, no
/// ray meets it. Of a sphere: centre, radius; the radiance at the same place; then 1 or -1 if it is turned
/// inside out, and the last two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lamp {
    pub is_sphere: bool,
    pub rows: [Row; 3],
}

impl Tables {
    /// For a scene.
    pub(crate) fn new(geometry: &Geometry, materials: &Materials, lights: &Lights) -> Tables {
        let models: Vec<_> = materials.list.iter().map(model_of).collect();
        let surface = |surface: &Surface| {
            let (model, params) = models[surface.material as usize];
            let [r, g, b, ..] = params[0].0;
            match model {
                // What shines, or leads to a medium, is looked at one by one.
                _ if surface.shines() || surface.media.is_some() => (Model::Other, Rgb::ZERO),
                Model::Diffuse => (model, Rgb::new(r, g, b)),
                _ => (model, Rgb::new(f32::from_bits(surface.material), 0.0, 0.0)),
            }
        };
        let mut tables = Tables {
            surfaces: geometry.surfaces.iter().map(surface).collect(),
            models,
            lights: lights.lights.iter().map(|l| lamp(l, lights)).collect(),
            only: lights.only(),
            sky: sky(lights),
            ..Tables::default()
        };
        let prims = &geometry.world.prims;
        let records: Vec<_> = if prims.len() <= RECORDS_MAX {
            prims
                .iter()
                .map(|p| tables.new_record(geometry, p))
                .collect()
        } else {
            vec![]
        };
        let kind = |(i, prim): (usize, &PrimRef)| {
            let find = match records.get(i) {
                Some(Some((find, _))) => *find,
                _ => tables.find_of(geometry, prim),
            };
            match find {
                Find::Other => Kind::OTHER,
                find => Kind {
                    find,
                    model: tables.surfaces[prim.surface as usize].0,
                },
            }
        };
        tables.kinds = prims.iter().enumerate().map(kind).collect();
        if records.iter().any(Option::is_some) {
            let record = |r: &Option<(Find, Record)>| r.map_or(Record::NONE, |r| r.1);
            tables.records = records.iter().map(record).collect();
        }
        tables
    }

    /// How a primitive without a record is found.
    fn find_of(&self, geometry: &Geometry, prim: &PrimRef) -> Find {
        let surface = &geometry.surfaces[prim.surface as usize];
        if self.surfaces[prim.surface as usize].0 == Model::Other || surface.mesh == NONE {
            return Find::Other;
        }
        let mesh = &geometry.meshes[surface.mesh as usize];
        // The normals of glass must agree with its geometry, which is looked at one by one.
        let is_bent = self.models[surface.material as usize].0 == Model::Dielectric
            && !mesh.normals.is_empty();
        if mesh.keys.is_empty() && !is_bent {
            Find::Mesh
        } else {
            Find::Other
        }
    }

    fn new_record(&self, geometry: &Geometry, prim: &PrimRef) -> Option<(Find, Record)> {
        let surface = &geometry.surfaces[prim.surface as usize];
        let (model, given) = self.surfaces[prim.surface as usize];
        if model == Model::Other || surface.curves != NONE {
            return None;
        }
        if surface.mesh == NONE {
            let (shape, _) = &geometry.world.quadrics[prim.index as usize];
            let record = Record::sphere(shape, surface.flip, given)?;
            return Some((Find::Sphere, record));
        }
        let mesh = &geometry.meshes[surface.mesh as usize];
        let is_flat = mesh.keys.is_empty() && mesh.normals.is_empty();
        is_flat.then(|| {
            let corners = mesh.corners(prim.index);
            (Find::Flat, Record::triangle(corners, surface.flip, given))
        })
    }

    /// What is done with hits on a primitive of the world.
    #[inline(always)]
    pub(super) fn kind(&self, prim: u32) -> Kind {
        self.kinds[prim as usize]
    }

    /// Of a surface with a model: the albedo if it is diffuse, else its material (bits).
    #[inline(always)]
    pub(super) fn given(&self, surface: u32) -> Rgb {
        self.surfaces[surface as usize].1
    }

    /// How a material scatters where it is [plain](crate::material::Shading::is_plain), if that does not
    /// depend on anything else.
    #[inline(always)]
    pub(super) fn model(&self, material: u32) -> Model {
        self.models[material as usize].0
    }

    /// Parameters of a material's model.
    #[inline(always)]
    pub(super) fn params(&self, material: u32) -> &Params {
        &self.models[material as usize].1
    }

    /// The record of a primitive.
    #[inline(always)]
    pub(super) fn record(&self, prim: u32) -> &Record {
        &self.records[prim as usize]
    }

    /// Radiance of a sky that is the same all around, if that is all there is.
    #[inline(always)]
    pub(super) fn sky(&self) -> Option<Rgb> {
        self.sky
    }

    /// Memory held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.kinds.len() * size_of::<Kind>()
            + self.records.len() * size_of::<Record>()
            + self.lights.len() * size_of::<Option<Lamp>>()
    }

    /// A light that is sampled in lanes.
    #[inline(always)]
    pub(super) fn lamp(&self, light: u32) -> Option<&Lamp> {
        self.lights[light as usize].as_ref()
    }

    /// The light that is always chosen.
    #[inline(always)]
    pub(super) fn only(&self) -> Option<u32> {
        self.only
    }
}

fn model_of(material: &Material) -> (Model, Params) {
    match material.plain_bsdf() {
        Some(Bsdf::Diffuse(bsdf)) => (Model::Diffuse, bsdf.params()),
        Some(Bsdf::Conductor(bsdf)) => (Model::Conductor, bsdf.params()),
        Some(Bsdf::Dielectric(bsdf)) => (Model::Dielectric, bsdf.params()),
        _ => (Model::Other, Params::default()),
    }
}

impl Record {
    /// No record.
    const NONE: Record = Record([Row([0.0; 8]); 2]);

    /// As [`Interaction::find`](crate::geometry::Interaction::find) works it out.
    fn triangle([a, b, c]: [Vec3; 3], flip: bool, given: Rgb) -> Record {
        let (e1, e2) = (b - a, c - a);
        let size = largest(e1) + largest(e2);
        let n = math::normalize(e1.cross(e2));
        let n = if flip { -n } else { n };
        let error = size * ROUNDING_OF_CORNERS;
        Record([
            Row([a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y]),
            Row([c.z, n.x, n.y, n.z, error, given.x, given.y, given.z]),
        ])
    }

    /// Of a sphere, if it is round.
    fn sphere(shape: &Quadric, flip: bool, given: Rgb) -> Option<Record> {
        let (c, radius) = shape.round()?;
        let side = if flip { -1.0 } else { 1.0 };
        Some(Record([
            Row([c.x, c.y, c.z, radius, side, 0.0, 0.0, 0.0]),
            Row([0.0, 0.0, 0.0, 0.0, 0.0, given.x, given.y, given.z]),
        ]))
    }
}

fn sky(lights: &Lights) -> Option<Rgb> {
    match lights.environments[..] {
        [only] => match &lights.lights[only as usize] {
            Light::Environment(e) => e.constant(),
            _ => None,
        },
        _ => None,
    }
}

fn lamp(light: &Light, lights: &Lights) -> Option<Lamp> {
    let Light::Area(area) = light else {
        return None;
    };
    let emission = &lights.emissions[area.emission as usize];
    let ColorTex::Const(radiance) = emission.radiance else {
        return None;
    };
    let li = Rgb::from_array(radiance) * emission.scale;
    let bit = |yes: bool| if yes { 1.0 } else { 0.0 };
    let (two_sided, unseen) = (bit(emission.two_sided), bit(area.unseen));
    let flat = |p: Vec3, e1: Vec3, e2: Vec3, n: Vec3, is_triangle: bool| Lamp {
        is_sphere: false,
        rows: [
            Row([p.x, p.y, p.z, e1.x, e1.y, e1.z, e2.x, e2.y]),
            Row([e2.z, n.x, n.y, n.z, 1.0 / area.area(), li.x, li.y, li.z]),
            Row([bit(is_triangle), two_sided, unseen, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ],
    };
    match &area.shape {
        AreaShape::Triangle { p, e1, e2, n, .. } => Some(flat(*p, *e1, *e2, *n, true)),
        AreaShape::Parallelogram { p, e1, e2, n, .. } => Some(flat(*p, *e1, *e2, *n, false)),
        AreaShape::Sphere {
            center: c,
            radius,
            inward,
            ..
        } => Some(Lamp {
            is_sphere: true,
            rows: [
                Row([c.x, c.y, c.z, *radius, 0.0, 0.0, 0.0, 0.0]),
                Row([0.0, 0.0, 0.0, 0.0, 0.0, li.x, li.y, li.z]),
                Row([
                    if *inward { -1.0 } else { 1.0 },
                    two_sided,
                    unseen,
                    0.0,
                    0.0,
                    0.0,
                    0.0,
                    0.0,
                ]),
            ],
        }),
        AreaShape::Disk { .. } => None,
    }
}
