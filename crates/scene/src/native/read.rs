//! From JSON to a description.

mod materials;
mod media;

use super::schema as json;
use super::values::{Placement, Step};
use super::{buffer, locate};
use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::limits::MAX_JSON_BYTES;
use crate::model::*;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The version of the format.
const VERSION: u32 = 1;

/// Reads a scene.
pub(crate) fn import(main: &str, cx: &mut Context<'_>) -> Result<SceneDesc, Issue> {
    let place = Place {
        file: main.to_owned(),
        ..Place::default()
    };
    let bytes = cx.read(&place, main)?;
    if bytes.len() as u64 > MAX_JSON_BYTES {
        let reason = format!(
            "{} bytes of JSON; the limit is {MAX_JSON_BYTES}: put long arrays into PLY files",
            bytes.len()
        );
        return Err(Issue::new(&place, reason));
    }
    // Numbers as text take no less room than the arrays that are made of them; two copies may exist.
    cx.charge(&place, bytes.len() as u64)?;
    let mut raw: &[u8] = &bytes;
    if let Some(rest) = raw.strip_prefix(b"\xef\xbb\xbf") {
        cx.warn(
            &place,
            "the file begins with a byte-order mark; it is skipped",
        );
        raw = rest;
    }
    let text = std::str::from_utf8(raw).map_err(|_| Issue::new(&place, "not UTF-8 text"))?;
    let scene: json::Scene = serde_json::from_str(text).map_err(|error| {
        let (line, column) = (error.line(), error.column());
        let at = Place {
            line: u32::try_from(line).ok().filter(|&l| l > 0),
            column: u32::try_from(column).ok().filter(|&c| c > 0),
            pointer: Some(locate::pointer(text, line, column)).filter(|p| !p.is_empty()),
            ..place.clone()
        };
        Issue::new(&at, explain(&error.to_string()))
    })?;
    if scene.brolly != VERSION {
        return Err(Issue::new(
            &place,
            format!(
                "version {} of the format; this program reads {VERSION}",
                scene.brolly
            ),
        ));
    }
    let mut reader = Reader {
        cx,
        text,
        place,
        images: BTreeMap::new(),
        textures: BTreeMap::new(),
        materials: BTreeMap::new(),
        meshes: BTreeMap::new(),
        media: BTreeMap::new(),
        curves: BTreeMap::new(),
        groups: BTreeMap::new(),
    };
    let desc = reader.scene(scene);
    cx.release(2 * bytes.len() as u64);
    desc
}

/// serde's words, without its own position and with a suggestion.
fn explain(error: &str) -> String {
    let message = error
        .rsplit_once(" at line ")
        .map_or(error, |(message, _)| message);
    for what in ["unknown field", "unknown variant"] {
        if let Some(rest) = message.strip_prefix(what) {
            let mut names = rest.split('`').skip(1).step_by(2);
            if let Some(name) = names.next() {
                let what = what.replace("variant", "word");
                let near = crate::suggest::did_you_mean(name, names.clone());
                let known: Vec<&str> = names.collect();
                return if near.is_empty() {
                    format!("{what} {name:?}; known here: {}", known.join(", "))
                } else {
                    format!("{what} {name:?}{near}")
                };
            }
        }
    }
    message.replace('`', "\"")
}

struct Reader<'c, 'a, 't> {
    cx: &'c mut Context<'a>,
    text: &'t str,
    place: Place,
    images: BTreeMap<String, ImageId>,
    textures: BTreeMap<String, TextureId>,
    materials: BTreeMap<String, MaterialId>,
    meshes: BTreeMap<String, MeshId>,
    media: BTreeMap<String, MediumId>,
    curves: BTreeMap<String, CurvesId>,
    groups: BTreeMap<String, GroupId>,
}

fn lookup<T: Copy>(what: &str, name: &str, known: &BTreeMap<String, T>) -> Result<T, String> {
    known.get(name).copied().ok_or_else(|| {
        let near = crate::suggest::did_you_mean(name, known.keys().map(String::as_str));
        format!("unknown {what} {name:?}{near}")
    })
}

fn rows(m: &[f64; 12]) -> DAffine3 {
    let column = |i: usize| DVec3::new(m[i], m[4 + i], m[8 + i]);
    DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3))
}

fn step(step: &Step) -> Result<DAffine3, String> {
    Ok(match step {
        Step::Translate(by) => DAffine3::from_translation(DVec3::from_array(*by)),
        Step::Scale(by) => DAffine3::from_scale(DVec3::from_array(*by)),
        Step::Rotate { axis, degrees } => {
            let axis = DVec3::from_array(*axis)
                .try_normalize()
                .ok_or("a rotation about an axis of no length")?;
            DAffine3::from_axis_angle(axis, degrees.to_radians())
        }
        Step::Matrix(m) => rows(m),
        Step::LookAt { from, at, up } => crate::apply::look_at(
            DVec3::from_array(*from),
            DVec3::from_array(*at),
            DVec3::from_array(*up),
        )?,
    })
}

fn steps(list: &[Step]) -> Result<DAffine3, String> {
    // A single matrix stays as it is, bit for bit.
    let mut all = list.iter().map(step);
    let Some(first) = all.next() else {
        return Ok(DAffine3::IDENTITY);
    };
    all.try_fold(first?, |sum, next| Ok(next? * sum))
}

fn motion(placement: &Placement) -> Result<Motion, String> {
    match placement {
        Placement::Fixed(list) => Ok(Motion::fixed(steps(list)?)),
        Placement::Keys(keys) => {
            if keys.is_empty() {
                return Err("a motion without keys".into());
            }
            let key = |key: &super::values::Key| {
                Ok(MotionKey {
                    time: key.time,
                    transform: steps(&key.transform)?,
                })
            };
            Ok(Motion {
                keys: keys.iter().map(key).collect::<Result<_, String>>()?,
            })
        }
    }
}

fn fixed(placement: &Placement) -> Result<DAffine3, String> {
    match placement {
        Placement::Fixed(list) => steps(list),
        Placement::Keys(_) => Err("lights that are not shapes do not move".into()),
    }
}

fn encoding(encoding: json::Encoding) -> Encoding {
    match encoding {
        json::Encoding::Auto => Encoding::Auto,
        json::Encoding::Srgb => Encoding::Srgb,
        json::Encoding::Linear => Encoding::Linear,
        json::Encoding::GammaMicros(micros) => Encoding::GammaMicros(micros),
    }
}

/// The same direction with length 1; what has it already keeps its bits.
fn unit(direction: DVec3) -> Result<DVec3, String> {
    if (direction.length_squared() - 1.0).abs() < 1e-12 {
        return Ok(direction);
    }
    direction
        .try_normalize()
        .ok_or_else(|| "\"direction\" has no length".into())
}

fn map(map: &json::Map) -> UvMap {
    match map {
        json::Map::Uv { set, matrix } => UvMap::Uv {
            set: *set,
            matrix: *matrix,
        },
        json::Map::Planar { matrix } => UvMap::Planar {
            matrix: rows(matrix),
        },
        json::Map::Spherical { matrix } => UvMap::Spherical {
            matrix: rows(matrix),
        },
        json::Map::Cylindrical { matrix } => UvMap::Cylindrical {
            matrix: rows(matrix),
        },
    }
}

impl Reader<'_, '_, '_> {
    /// The place of a value, by its pointer.
    fn at(&self, pointer: &str) -> Place {
        let (line, column) = locate::position(self.text, pointer).unzip();
        Place {
            line,
            column,
            pointer: Some(pointer.to_owned()),
            ..self.place.clone()
        }
    }

    /// Keeps a value or notes what is wrong with it.
    fn keep<T>(&mut self, pointer: &str, result: Result<T, String>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(reason) => {
                let place = self.at(pointer);
                self.cx.error(Issue::new(&place, reason));
                None
            }
        }
    }

    fn scene(&mut self, scene: json::Scene) -> Result<SceneDesc, Issue> {
        let media = self.media(&scene.media);
        let camera = self.camera(&scene.camera);
        let camera = self.keep("/camera", camera);
        let integrator =
            crate::apply::integrator(&scene.integrator.name, scene.integrator.max_depth);
        let integrator = self.keep("/integrator/name", integrator);
        for (name, image) in &scene.images.0 {
            let pointer = format!("/images/{}/file", locate::escape(name));
            let place = self.at(&pointer);
            let id = self.cx.image(&place, &image.file, encoding(image.encoding));
            if let Some(id) = self.cx.keep(id) {
                self.images.insert(name.clone(), id);
            }
        }
        let mut textures = Vec::new();
        for (name, texture) in &scene.textures.0 {
            let pointer = format!("/textures/{}", locate::escape(name));
            let texture = self.texture(texture, &pointer);
            // A texture that failed keeps its name, so that only the first error is reported.
            let texture = self.keep(&pointer, texture).unwrap_or(Texture::VertexColor);
            self.textures
                .insert(name.clone(), TextureId(textures.len() as u32));
            textures.push(texture);
        }
        let mut materials = Vec::new();
        for (name, material) in &scene.materials.0 {
            let pointer = format!("/materials/{}", locate::escape(name));
            let material = self.material(name, material);
            if let Some(material) = self.keep(&pointer, material) {
                self.materials
                    .insert(name.clone(), MaterialId(materials.len() as u32));
                materials.push(material);
            } else {
                self.materials.insert(name.clone(), MaterialId(0));
            }
        }
        for (name, mesh) in scene.meshes.0 {
            let pointer = format!("/meshes/{}", locate::escape(&name));
            if let Some(id) = self.mesh(name.clone(), mesh, &pointer) {
                self.meshes.insert(name, id);
            } else {
                self.meshes.insert(name, MeshId(u32::MAX));
            }
        }
        let curves = self.all_curves(scene.curves);
        for (index, (name, _)) in scene.groups.0.iter().enumerate() {
            self.groups.insert(name.clone(), GroupId(index as u32));
        }
        let mut groups = Vec::new();
        for (name, group) in scene.groups.0 {
            let pointer = format!("/groups/{}", locate::escape(&name));
            let primitives = self.primitives(group.primitives, &format!("{pointer}/primitives"));
            let instances = self.instances(&group.instances, &format!("{pointer}/instances"));
            groups.push(Group {
                name,
                primitives,
                instances,
            });
        }
        let primitives = self.primitives(scene.primitives, "/primitives");
        let instances = self.instances(&scene.instances, "/instances");
        let mut lights = Vec::new();
        for (index, light) in scene.lights.iter().enumerate() {
            let pointer = format!("/lights/{index}");
            let light = self.light(light, &pointer);
            lights.extend(self.keep(&pointer, light));
        }
        let (Some(camera), Some(integrator)) = (camera, integrator) else {
            return Err(Issue::new(&self.place, "the scene cannot be used"));
        };
        let json::Film {
            size: [width, height],
            crop,
            filter,
            exposure,
            max_component,
        } = scene.film;
        Ok(SceneDesc {
            camera,
            film: FilmDesc {
                width,
                height,
                crop,
                filter,
                exposure: exposure.0,
                max_component,
            },
            integrator,
            sampler: scene.sampler,
            spp: scene.spp,
            animation: scene.animation,
            meshes: Vec::new(),
            images: Vec::new(),
            textures,
            materials,
            media,
            curves,
            primitives,
            groups,
            instances,
            lights,
        })
    }

    fn camera(&self, camera: &json::Camera) -> Result<Camera, String> {
        let looks = camera.look_from.is_some() || camera.look_at.is_some() || camera.up.is_some();
        let transform = match &camera.transform {
            Some(_) if looks => {
                return Err(
                    "a camera has either \"transform\" or \"look_from\", \"look_at\" and \"up\""
                        .into(),
                );
            }
            Some(placement) => motion(placement)?,
            None => {
                let vector =
                    |v: Option<[f64; 3]>, default: DVec3| v.map_or(default, DVec3::from_array);
                let from = vector(camera.look_from, DVec3::new(0.0, 0.0, 5.0));
                let at = vector(camera.look_at, DVec3::ZERO);
                Motion::fixed(crate::apply::look_at(
                    from,
                    at,
                    vector(camera.up, DVec3::Y),
                )?)
            }
        };
        let lens = camera.lens.clone().map(|l| Lens {
            radius: l.radius,
            focus_distance: l.focus_distance,
            aperture: l.aperture,
            anamorphic: l.anamorphic,
        });
        let projection = match (&camera.projection, camera.vfov) {
            (Some(_), Some(_)) => {
                return Err("a camera has either \"vfov\" or \"projection\"".into());
            }
            (None, vfov) => {
                let fov = vfov.unwrap_or(40.0);
                Projection::Perspective {
                    fov,
                    fov_axis: FovAxis::Vertical,
                    window: None,
                    lens,
                }
            }
            (
                Some(json::Projection::Perspective {
                    fov,
                    fov_axis,
                    window,
                }),
                None,
            ) => Projection::Perspective {
                fov: *fov,
                fov_axis: *fov_axis,
                window: *window,
                lens,
            },
            (
                Some(json::Projection::Orthographic {
                    half_height,
                    window,
                }),
                None,
            ) => Projection::Orthographic {
                half_height: *half_height,
                window: *window,
                lens,
            },
            (Some(json::Projection::Spherical { mapping }), None) => {
                Projection::Spherical { mapping: *mapping }
            }
        };
        Ok(Camera {
            transform,
            projection,
            shutter: camera.shutter,
            shutter_curve: camera.shutter_curve.clone(),
            medium: match &camera.medium {
                Some(name) => Some(lookup("medium", name, &self.media)?),
                None => None,
            },
        })
    }

    fn mesh(&mut self, name: String, mesh: json::Mesh, pointer: &str) -> Option<MeshId> {
        let place = self.at(pointer);
        let result = self
            .mesh_data(&place, mesh)
            .and_then(|data| self.cx.add_mesh(&place, Mesh { name, ..data }));
        self.cx.keep(result)
    }

    fn mesh_data(&mut self, place: &Place, mesh: json::Mesh) -> Result<Mesh, Issue> {
        let inline = !(mesh.normals.is_empty()
            && mesh.uvs.is_empty()
            && mesh.colors.is_empty()
            && mesh.indices.is_empty());
        match (mesh.ply, mesh.buffer, mesh.positions) {
            (Some(ply), None, None) if !inline => {
                let path = self.cx.path(place, &ply)?;
                self.cx.ply_mesh(place, &path, false)
            }
            (None, Some(file), None) if !inline => {
                let path = self.cx.path(place, &file)?;
                let bytes = self.cx.read(place, &path)?;
                self.cx.release(bytes.len() as u64);
                buffer::read(&bytes).map_err(|e| Issue::new(place, format!("{path}: {e}")))
            }
            (None, None, Some(positions)) => Ok(Mesh {
                positions: Arc::new(positions),
                normals: Arc::new(mesh.normals),
                uvs: if mesh.uvs.is_empty() {
                    Vec::new()
                } else {
                    vec![Arc::new(mesh.uvs)]
                },
                colors: Arc::new(mesh.colors),
                indices: Arc::new(mesh.indices),
                ..Mesh::default()
            }),
            _ => Err(Issue::new(
                place,
                "a mesh has one of \"ply\", \"buffer\" and \"positions\" with \"indices\"",
            )),
        }
    }

    fn primitives(&mut self, list: Vec<json::Primitive>, pointer: &str) -> Vec<Primitive> {
        let mut out = Vec::with_capacity(list.len());
        for (index, primitive) in list.into_iter().enumerate() {
            let pointer = format!("{pointer}/{index}");
            out.extend(self.primitive(primitive, &pointer));
        }
        out
    }

    fn primitive(&mut self, primitive: json::Primitive, pointer: &str) -> Option<Primitive> {
        let shape = match primitive.shape {
            json::Shape::Mesh(name) => {
                let id = lookup("mesh", &name, &self.meshes);
                self.keep(&format!("{pointer}/shape/mesh"), id)
                    .map(Shape::Mesh)
            }
            json::Shape::Ply(file) => {
                let place = self.at(&format!("{pointer}/shape/ply"));
                let id = self.cx.ply(&place, &file);
                self.cx.keep(id).map(Shape::Mesh)
            }
            json::Shape::Triangles(mesh) => self
                .mesh(
                    format!("triangles at {pointer}"),
                    *mesh,
                    &format!("{pointer}/shape/triangles"),
                )
                .map(Shape::Mesh),
            json::Shape::Sphere { radius } => Some(Shape::Sphere { radius }),
            json::Shape::Disk {
                radius,
                inner_radius,
                height,
            } => Some(Shape::Disk {
                radius,
                inner_radius,
                height,
            }),
            json::Shape::Rectangle => Some(Shape::Rectangle),
            json::Shape::Curves(name) => {
                let id = lookup("bundle of curves", &name, &self.curves);
                self.keep(&format!("{pointer}/shape/curves"), id)
                    .map(Shape::Curves)
            }
        };
        let material = lookup("material", &primitive.material, &self.materials);
        let material = self.keep(&format!("{pointer}/material"), material);
        let transform = self.keep(
            &format!("{pointer}/transform"),
            motion(&primitive.transform),
        );
        let emission = match &primitive.emission {
            None => None,
            Some(emission) => {
                let radiance = self.color(&emission.radiance);
                let radiance = self.keep(&format!("{pointer}/emission/radiance"), radiance)?;
                Some(Emission {
                    radiance,
                    scale: emission.scale,
                    two_sided: emission.two_sided,
                })
            }
        };
        let alpha = primitive.alpha.as_ref().map(|a| self.float(a)).transpose();
        let alpha = self.keep(&format!("{pointer}/alpha"), alpha)?;
        let media = primitive
            .media
            .as_ref()
            .map(|m| self.interface(m))
            .transpose();
        let media = self.keep(&format!("{pointer}/media"), media)?;
        let reverse_orientation = primitive.reverse_orientation;
        Some(Primitive {
            shape: shape?,
            transform: transform?,
            material: material?,
            emission,
            alpha,
            reverse_orientation,
            media,
        })
    }

    fn instances(&mut self, list: &[json::Instance], pointer: &str) -> Vec<Instance> {
        let mut out = Vec::with_capacity(list.len());
        for (index, instance) in list.iter().enumerate() {
            let group = lookup("group", &instance.group, &self.groups);
            let group = self.keep(&format!("{pointer}/{index}/group"), group);
            let transform = self.keep(
                &format!("{pointer}/{index}/transform"),
                motion(&instance.transform),
            );
            if let (Some(group), Some(transform)) = (group, transform) {
                out.push(Instance { group, transform });
            }
        }
        out
    }

    fn light(&mut self, light: &json::Light, pointer: &str) -> Result<Light, String> {
        Ok(match light {
            json::Light::Point {
                intensity,
                transform,
            } => Light::Point {
                transform: fixed(transform)?,
                intensity: intensity.0,
            },
            json::Light::Spot {
                intensity,
                cone_angle,
                full_angle,
                falloff,
                transform,
            } => Light::Spot {
                transform: fixed(transform)?,
                intensity: intensity.0,
                cone_angle: *cone_angle,
                full_angle: *full_angle,
                falloff: *falloff,
            },
            json::Light::Distant {
                direction,
                irradiance,
            } => Light::Distant {
                direction: DVec3::from_array(*direction),
                irradiance: irradiance.0,
            },
            json::Light::Environment {
                radiance,
                image,
                mapping,
                transform,
                hidden,
                illuminance,
                portal,
            } => Light::Environment {
                transform: fixed(transform)?,
                radiance: radiance.0,
                image: match image {
                    Some(name) => Some((
                        self.image(name, &format!("{pointer}/environment/image"))?,
                        *mapping,
                    )),
                    None => None,
                },
                hidden: *hidden,
                illuminance: *illuminance,
                portal: portal.map(|corners| corners.map(DVec3::from_array)),
            },
            json::Light::Goniometric {
                intensity,
                image,
                power,
                transform,
            } => Light::Goniometric {
                transform: fixed(transform)?,
                intensity: intensity.0,
                image: self.image(image, &format!("{pointer}/goniometric/image"))?,
                power: *power,
            },
            json::Light::Projection {
                intensity,
                image,
                fov,
                power,
                transform,
            } => Light::Projection {
                transform: fixed(transform)?,
                intensity: intensity.0,
                image: self.image(image, &format!("{pointer}/projection/image"))?,
                fov: *fov,
                power: *power,
            },
        })
    }
}
