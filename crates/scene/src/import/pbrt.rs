//! pbrt-v4 scene files. A file is a list of directives that change a graphics state or add
//! something under the state of the moment; names of materials, textures and objects are resolved
//! at the end, as pbrt does, so that they may be used before they are defined.
//!
//! What is not understood is warned about with file and line; what is broken is an error, and reading
//! goes on after it as long as the file still makes sense.

mod curves;
mod directives;
#[cfg(test)]
mod features;
mod frame;
mod imagemap;
mod legacy;
mod lens;
mod lexer;
mod lights;
mod materials;
mod matrix;
mod media;
mod params;
mod presets;
mod shapes;
mod spectra;
mod subdivide;
mod tessellate;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_v4;
mod textures;
mod volume;

use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::limits::{MAX_INCLUDED_BYTES, MAX_INCLUDES, MAX_NESTING};
use crate::model::{
    Camera, Curves, Emission, FloatTex, Group, GroupId, Instance, Light, Material, MaterialId,
    Medium, MediumId, MediumInterface, Motion, Primitive, SceneDesc, Shape, Texture,
};
use glam::DMat4;
use media::Sides;
use params::{Param, Params};
use spectra::ColorSpace;
use std::collections::BTreeMap;
use std::io::Read;
use std::rc::Rc;

/// The largest file, unpacked.
const MAX_TEXT_BYTES: u64 = 1 << 30;

/// Which material a shape has; resolved at the end.
#[derive(Clone, Debug, PartialEq)]
enum MaterialRef {
    /// Index into [`Importer::materials`].
    Index(usize),
    Named(String),
}

/// Everything that blocks save and restore.
#[derive(Clone)]
struct Graphics {
    ctm: [DMat4; 2],
    active: [bool; 2],
    reverse: bool,
    material: MaterialRef,
    area_light: Option<Rc<Params>>,
    sides: Sides,
    space: ColorSpace,
    /// Parameters set by `Attribute`, by target.
    attributes: [Rc<Vec<Param>>; 5],
}

/// Targets of `Attribute`.
const TARGETS: [&str; 5] = ["shape", "light", "material", "medium", "texture"];

/// An open block.
struct Block {
    is_object: bool,
    place: Place,
    saved: Graphics,
}

/// A shape whose names are not resolved yet.
struct PendingShape {
    shape: Shape,
    transform: Motion,
    material: MaterialRef,
    emission: Option<Rc<Params>>,
    alpha: Option<Alpha>,
    reverse: bool,
    sides: Sides,
    place: Place,
}

impl PendingShape {
    /// Whether it differs from another only in its geometry and where it was written.
    fn looks_like(&self, other: &PendingShape) -> bool {
        self.transform == other.transform
            && self.material == other.material
            && self.emission.is_none()
            && other.emission.is_none()
            && self.alpha == other.alpha
            && self.reverse == other.reverse
            && self.sides == other.sides
    }
}

#[derive(Clone, PartialEq)]
enum Alpha {
    Value(f32),
    Texture(String),
}

struct PendingGroup {
    name: String,
    shapes: Vec<PendingShape>,
}

struct PendingInstance {
    name: String,
    transform: Motion,
    place: Place,
}

/// A material as it was written.
struct MaterialEntry {
    name: String,
    kind: String,
    params: Params,
}

/// A directive before `WorldBegin` that has a type and parameters.
struct Setting {
    kind: String,
    params: Params,
}

#[derive(Default)]
struct Settings {
    /// With the current matrices and the medium around it.
    camera: Option<(Setting, [DMat4; 2], std::sync::Arc<str>)>,
    film: Option<Setting>,
    filter: Option<Setting>,
    sampler: Option<Setting>,
    integrator: Option<Setting>,
}

pub(crate) struct Importer<'c, 'a> {
    cx: &'c mut Context<'a>,
    graphics: Graphics,
    blocks: Vec<Block>,
    times: (f64, f64),
    in_world: bool,
    settings: Settings,
    coordinates: BTreeMap<String, [DMat4; 2]>,
    materials: Vec<MaterialEntry>,
    material_names: BTreeMap<String, usize>,
    /// What each material is filled with, by index; known once they are built.
    interiors: Vec<Option<MediumId>>,
    media: Vec<Medium>,
    media_names: BTreeMap<String, MediumId>,
    /// Procedural clouds so far.
    clouds: u32,
    /// Files read so far, and bytes of text in them.
    included: (u32, u64),
    curves: Vec<Curves>,
    float_textures: BTreeMap<String, FloatTex>,
    color_textures: BTreeMap<String, crate::model::ColorTex>,
    textures: Vec<Texture>,
    shapes: Vec<PendingShape>,
    groups: Vec<PendingGroup>,
    group_names: BTreeMap<String, GroupId>,
    open_group: bool,
    instances: Vec<PendingInstance>,
    lights: Vec<Light>,
    /// Notes that are worth making once.
    said: std::collections::BTreeSet<&'static str>,
    /// Parameters after an `Include`, which belong to the last directive of the included file.
    trailing: Option<Vec<params::Param>>,
}

/// Reads a scene. Geometry, pictures and findings end up in the context.
pub(crate) fn import(main: &str, cx: &mut Context<'_>) -> Result<SceneDesc, Issue> {
    let place = Place {
        file: main.to_owned(),
        ..Place::default()
    };
    let default_material = MaterialEntry {
        name: "default".into(),
        kind: "diffuse".into(),
        params: Params::empty(place.clone()),
    };
    let mut importer = Importer {
        cx,
        graphics: Graphics {
            ctm: [DMat4::IDENTITY; 2],
            active: [true; 2],
            reverse: false,
            material: MaterialRef::Index(0),
            area_light: None,
            sides: Sides::default(),
            space: ColorSpace::default(),
            attributes: Default::default(),
        },
        blocks: Vec::new(),
        times: (0.0, 1.0),
        in_world: false,
        settings: Settings::default(),
        coordinates: BTreeMap::new(),
        materials: vec![default_material],
        material_names: BTreeMap::new(),
        interiors: Vec::new(),
        media: Vec::new(),
        media_names: BTreeMap::new(),
        clouds: 0,
        included: (0, 0),
        curves: Vec::new(),
        float_textures: BTreeMap::new(),
        color_textures: BTreeMap::new(),
        textures: Vec::new(),
        shapes: Vec::new(),
        groups: Vec::new(),
        group_names: BTreeMap::new(),
        open_group: false,
        instances: Vec::new(),
        lights: Vec::new(),
        said: Default::default(),
        trailing: None,
    };
    importer.file(&place, main, &mut Vec::new())?;
    importer.finish(place)
}

impl Importer<'_, '_> {
    /// Reads one file: the main one or an included one.
    fn file(&mut self, place: &Place, path: &str, open: &mut Vec<String>) -> Result<(), Issue> {
        if open.iter().any(|p| p == path) {
            return Err(Issue::new(place, format!("{path} includes itself")));
        }
        if open.len() >= MAX_NESTING {
            return Err(Issue::new(
                place,
                format!("files included more than {MAX_NESTING} deep, the limit"),
            ));
        }
        self.included.0 += 1;
        if self.included.0 > MAX_INCLUDES {
            let reason = format!("more files included than the limit of {MAX_INCLUDES}");
            return Err(Issue::new(place, reason));
        }
        let raw = self.cx.read(place, path)?;
        let mut size = raw.len() as u64;
        let unpacked;
        let mut bytes: &[u8] = &raw;
        if raw.starts_with(&[0x1f, 0x8b]) {
            let mut out = Vec::new();
            flate2::read::MultiGzDecoder::new(&raw[..])
                .take(MAX_TEXT_BYTES + 1)
                .read_to_end(&mut out)
                .map_err(|e| Issue::new(place, format!("{path}: damaged gzip data: {e}")))?;
            if out.len() as u64 > MAX_TEXT_BYTES {
                return Err(Issue::new(
                    place,
                    format!("{path}: unpacks to more than the limit of {MAX_TEXT_BYTES} bytes"),
                ));
            }
            self.cx.charge(place, out.len() as u64)?;
            size += out.len() as u64;
            unpacked = out;
            bytes = &unpacked;
        }
        self.included.1 += bytes.len() as u64;
        if self.included.1 > MAX_INCLUDED_BYTES {
            let reason =
                format!("included files of more than {MAX_INCLUDED_BYTES} bytes, the limit");
            return Err(Issue::new(place, reason));
        }
        if let Some(rest) = bytes.strip_prefix(b"\xef\xbb\xbf") {
            let here = Place {
                file: path.to_owned(),
                line: Some(1),
                ..Place::default()
            };
            self.cx.warn(
                &here,
                "the file begins with a byte-order mark; it is skipped",
            );
            bytes = rest;
        }
        open.push(path.to_owned());
        let result = self.directives(bytes, path, open);
        open.pop();
        self.cx.release(size);
        result
    }

    /// A warning that is made once.
    fn warn_once(&mut self, place: &Place, reason: &'static str) {
        if self.said.insert(reason) {
            self.cx.warn(place, reason);
        }
    }

    /// Names the parameters that nobody asked for.
    fn warn_unused(&mut self, params: &Params, what: &str) {
        for param in params.unused() {
            self.cx.warn(
                &param.place,
                format!(
                    "parameter {:?} of {what} is not understood: left out",
                    param.name
                ),
            );
        }
    }

    fn finish(mut self, place: Place) -> Result<SceneDesc, Issue> {
        for block in std::mem::take(&mut self.blocks) {
            let (begin, end) = if block.is_object {
                ("ObjectBegin", "ObjectEnd")
            } else {
                ("AttributeBegin", "AttributeEnd")
            };
            self.cx
                .error(Issue::new(&block.place, format!("{begin} without {end}")));
        }
        if !self.in_world {
            return Err(Issue::new(&place, "the file ends before WorldBegin"));
        }
        let (camera, film, integrator, sampler, spp) = self.frame(&place)?;
        let (materials, material_ids) = self.build_materials();

        let mut groups = Vec::new();
        for group in std::mem::take(&mut self.groups) {
            let primitives = self.primitives(group.shapes, &material_ids, true);
            groups.push(Group {
                name: group.name,
                primitives,
                instances: Vec::new(),
            });
        }
        let shapes = std::mem::take(&mut self.shapes);
        let primitives = self.primitives(shapes, &material_ids, false);
        let mut instances = Vec::new();
        for pending in std::mem::take(&mut self.instances) {
            match self.group_names.get(&pending.name) {
                Some(&group) => instances.push(Instance {
                    group,
                    transform: pending.transform,
                }),
                None => {
                    let near = nearest(&pending.name, self.group_names.keys());
                    self.cx.error(Issue::new(
                        &pending.place,
                        format!("unknown object {:?}{near}", pending.name),
                    ));
                }
            }
        }
        Ok(SceneDesc {
            camera,
            film,
            integrator,
            sampler,
            spp: Some(spp),
            animation: None,
            meshes: Vec::new(),
            images: Vec::new(),
            textures: self.textures,
            materials,
            media: self.media,
            curves: self.curves,
            primitives,
            groups,
            instances,
            lights: self.lights,
        })
    }

    fn primitives(
        &mut self,
        shapes: Vec<PendingShape>,
        ids: &[MaterialId],
        in_group: bool,
    ) -> Vec<Primitive> {
        let mut out = Vec::with_capacity(shapes.len());
        for shape in shapes {
            if let Some(primitive) = self.primitive(shape, ids, in_group) {
                out.push(primitive);
            }
        }
        out
    }

    fn primitive(
        &mut self,
        pending: PendingShape,
        ids: &[MaterialId],
        in_group: bool,
    ) -> Option<Primitive> {
        let PendingShape {
            shape,
            transform,
            material,
            emission,
            alpha,
            reverse,
            sides,
            place,
        } = pending;
        let index = match material {
            MaterialRef::Index(index) => index,
            MaterialRef::Named(name) => match self.material_names.get(&name) {
                Some(&index) => index,
                None => {
                    let near = nearest(&name, self.material_names.keys());
                    self.cx.error(Issue::new(
                        &place,
                        format!("unknown material {name:?}{near}"),
                    ));
                    return None;
                }
            },
        };
        let material = *ids.get(index)?;
        let media = self.sides(&sides, index, &place)?;
        let alpha = match alpha {
            None => None,
            Some(Alpha::Value(value)) => (value < 1.0).then_some(FloatTex::Const(value)),
            Some(Alpha::Texture(name)) => match self.float_textures.get(&name) {
                Some(&texture) => Some(texture),
                None => {
                    let near = nearest(&name, self.float_textures.keys());
                    self.cx.error(Issue::new(
                        &place,
                        format!("unknown float texture {name:?}{near}"),
                    ));
                    return None;
                }
            },
        };
        let emission = match emission {
            Some(_) if in_group => {
                self.warn_once(
                    &place,
                    "area lights inside an object do not shine, as in pbrt",
                );
                None
            }
            Some(_) if self.materials[index].kind == "interface" => {
                self.cx.warn(
                    &place,
                    "an area light on an \"interface\" does not shine, as in pbrt",
                );
                None
            }
            Some(params) => {
                let result = self.area_emission(&params, &shape, &transform, &place);
                self.cx.keep(result)?
            }
            None => None,
        };
        Some(Primitive {
            shape,
            transform,
            material,
            emission,
            alpha,
            reverse_orientation: reverse,
            media,
        })
    }

    /// What lies on the two sides of a shape. Where both names are the same the shape is no border.
    fn sides(
        &mut self,
        sides: &Sides,
        material: usize,
        place: &Place,
    ) -> Option<Option<MediumInterface>> {
        let interior = self.interiors.get(material).copied().flatten();
        if sides.inside == sides.outside && interior.is_none() {
            return Some(None);
        }
        let inside = self.medium(&sides.inside, place);
        let mut inside = self.cx.keep(inside)?;
        let outside = self.medium(&sides.outside, place);
        let outside = self.cx.keep(outside)?;
        if interior.is_some() {
            if inside.is_some() && inside != outside {
                self.warn_once(
                    place,
                    "a subsurface material fills the shape: the medium named for its inside is left out",
                );
            }
            inside = interior;
        }
        Some(Some(MediumInterface { inside, outside }))
    }
}

/// `; did you mean "x"?`, if there is something near.
fn nearest<'n>(name: &str, known: impl Iterator<Item = &'n String>) -> String {
    crate::suggest::did_you_mean(name, known.map(String::as_str))
}

type Frame = (
    Camera,
    crate::model::FilmDesc,
    crate::model::Integrator,
    crate::model::SamplerKind,
    u32,
);
type Materials = (Vec<Material>, Vec<MaterialId>);
type Radiance = Option<Emission>;
