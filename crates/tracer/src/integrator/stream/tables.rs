//! What lanes want to know about surfaces, materials and lights, ready to be read.

use crate::accel::Geometry;
use crate::accel::node::PrimRef;
use crate::bsdf::Bsdf;
use crate::geometry::Surface;
use crate::geometry::interaction::{ROUNDING_OF_CORNERS, largest};
use crate::lanes::Row;
use crate::light::{AreaShape, Light, Lights};
use crate::material::Materials;
use crate::math::{self, Rgb};
use crate::ray::NONE;
use glam::Vec3;
use scene::model::ColorTex;

/// Of a prepared scene.
#[derive(Default)]
pub(crate) struct Tables {
    /// By primitive of the world: how its hits are found.
    kinds: Vec<Kind>,
    /// By surface: its albedo where that is plain.
    plain: Vec<Option<Rgb>>,
    /// By primitive of a small world: see [`Flat`].
    flat: Vec<Flat>,
    /// By light: flat ones that shine evenly.
    lights: Vec<Option<FlatLight>>,
    /// If no choice of light is to be made: which.
    only: Option<u32>,
}

/// How a hit on a primitive is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// One by one.
    Other,
    /// In lanes, and it scatters in lanes: triangles that do not deform or shine, of a diffuse material
    /// that is the same everywhere.
    Plain,
    /// The same, from its record in [`Flat`].
    Flat,
}

/// A plain triangle without normals at its corners, ready to be read: its corners; then the normal, what
/// its size adds to the error of its points, the albedo.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flat(pub [Row; 2]);

/// Primitives of a world that gets records, which take 16 MiB then.
const RECORDS_MAX: usize = 1 << 18;

/// A triangle or parallelogram of constant radiance.
#[derive(Clone, Copy, Debug)]
pub(super) struct FlatLight {
    /// A corner, the edges from it, the normal, the density per area of its points, the radiance; then 1
    /// or 0 each: it is a triangle, both sides shine, no ray meets it.
    pub rows: [Row; 3],
}

impl Tables {
    /// For a scene.
    pub(crate) fn new(geometry: &Geometry, materials: &Materials, lights: &Lights) -> Tables {
        let albedo = |surface: &Surface| {
            let at_rest =
                surface.mesh != NONE && geometry.meshes[surface.mesh as usize].keys.is_empty();
            match materials.list[surface.material as usize].plain_bsdf() {
                Some(Bsdf::Diffuse(bsdf)) if at_rest && !surface.shines() => Some(bsdf.albedo()),
                _ => None,
            }
        };
        let plain: Vec<_> = geometry.surfaces.iter().map(albedo).collect();
        let prims = &geometry.world.prims;
        let has_records = prims.len() <= RECORDS_MAX;
        let flat = |prim: &PrimRef| {
            let surface = &geometry.surfaces[prim.surface as usize];
            let albedo = plain[prim.surface as usize]?;
            let mesh = &geometry.meshes[surface.mesh as usize];
            mesh.normals
                .is_empty()
                .then(|| Flat::new(mesh.corners(prim.index), surface.flip, albedo))
        };
        let kind = |prim: &PrimRef| match plain[prim.surface as usize] {
            None => Kind::Other,
            Some(_) if has_records && flat(prim).is_some() => Kind::Flat,
            Some(_) => Kind::Plain,
        };
        let kinds: Vec<_> = prims.iter().map(kind).collect();
        let flat = if kinds.contains(&Kind::Flat) {
            prims
                .iter()
                .map(|p| flat(p).unwrap_or(Flat::NONE))
                .collect()
        } else {
            vec![]
        };
        let light = |l| flat_light(l, lights);
        Tables {
            kinds,
            plain,
            flat,
            lights: lights.lights.iter().map(light).collect(),
            only: lights.only(),
        }
    }

    /// How hits on a primitive of the world are found.
    #[inline(always)]
    pub(super) fn kind(&self, prim: u32) -> Kind {
        self.kinds[prim as usize]
    }

    /// The albedo of a plain surface.
    #[inline(always)]
    pub(super) fn albedo(&self, surface: u32) -> Rgb {
        self.plain[surface as usize].unwrap_or(Rgb::ZERO)
    }

    /// The record of a primitive of kind [`Kind::Flat`].
    #[inline(always)]
    pub(super) fn record(&self, prim: u32) -> &Flat {
        &self.flat[prim as usize]
    }

    /// Memory held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.kinds.len() * size_of::<Kind>()
            + self.flat.len() * size_of::<Flat>()
            + self.lights.len() * size_of::<Option<FlatLight>>()
    }

    /// A light that is flat and shines evenly.
    #[inline(always)]
    pub(super) fn flat_light(&self, light: u32) -> Option<&FlatLight> {
        self.lights[light as usize].as_ref()
    }

    /// The light that is always chosen.
    #[inline(always)]
    pub(super) fn only(&self) -> Option<u32> {
        self.only
    }
}

impl Flat {
    /// No record.
    const NONE: Flat = Flat([Row([0.0; 8]); 2]);

    /// As [`Interaction::find`](crate::geometry::Interaction::find) works it out.
    fn new([a, b, c]: [Vec3; 3], flip: bool, albedo: Rgb) -> Flat {
        let (e1, e2) = (b - a, c - a);
        let size = largest(e1) + largest(e2);
        let n = math::normalize(e1.cross(e2));
        let n = if flip { -n } else { n };
        let error = size * ROUNDING_OF_CORNERS;
        Flat([
            Row([a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y]),
            Row([c.z, n.x, n.y, n.z, error, albedo.x, albedo.y, albedo.z]),
        ])
    }
}

fn flat_light(light: &Light, lights: &Lights) -> Option<FlatLight> {
    let Light::Area(area) = light else {
        return None;
    };
    let (p, e1, e2, n, is_triangle) = match &area.shape {
        AreaShape::Triangle { p, e1, e2, n, .. } => (p, e1, e2, n, true),
        AreaShape::Parallelogram { p, e1, e2, n, .. } => (p, e1, e2, n, false),
        _ => return None,
    };
    let emission = &lights.emissions[area.emission as usize];
    let ColorTex::Const(radiance) = emission.radiance else {
        return None;
    };
    let li = Rgb::from_array(radiance) * emission.scale;
    let bit = |yes: bool| if yes { 1.0 } else { 0.0 };
    let [p, e1, e2, n, li] = [p, e1, e2, n, &li].map(|v: &Vec3| v.to_array());
    Some(FlatLight {
        rows: [
            Row([p[0], p[1], p[2], e1[0], e1[1], e1[2], e2[0], e2[1]]),
            Row([
                e2[2],
                n[0],
                n[1],
                n[2],
                1.0 / area.area(),
                li[0],
                li[1],
                li[2],
            ]),
            Row([
                bit(is_triangle),
                bit(emission.two_sided),
                bit(area.unseen),
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
            ]),
        ],
    })
}
