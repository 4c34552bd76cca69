//! From a description back to JSON and the files beside it.

mod materials;
mod media;

use super::buffer;
use super::schema as json;
use super::values::{Color, ColorValue, FloatValue, Key, Named, Placement, Step};
use crate::assets::{AssetError, AssetSource};
use crate::import::ply;
use crate::model::*;
use glam::DAffine3;

/// A scene as files.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// The main file.
    pub json: String,
    /// The others, by path beside it.
    pub files: Vec<(String, Vec<u8>)>,
}

/// Why a scene could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A picture could not be read.
    #[error("a picture of the scene could not be read")]
    Asset(#[from] AssetError),
    /// JSON has no word for it.
    #[error("the scene cannot be written as JSON")]
    Json(#[from] serde_json::Error),
    /// It refers to what is not there.
    #[error("the scene is not valid: it refers to a {0} that is not there")]
    Invalid(&'static str),
}

/// Writes a valid scene. Reading the result gives an equal description.
pub fn write(desc: &SceneDesc, assets: &dyn AssetSource) -> Result<Written, WriteError> {
    let writer = Writer { desc };
    let mut files = Vec::new();
    let mut meshes = Vec::new();
    for (index, mesh) in desc.meshes.iter().enumerate() {
        let (entry, path, bytes) = writer.mesh(index, mesh);
        meshes.push((mesh.name.clone(), entry));
        files.push((path, bytes));
    }
    let media = writer.media(&mut files);
    let curves = writer.curves(&mut files);
    let mut images: Vec<(String, json::Image)> = Vec::new();
    for (index, image) in desc.images.iter().enumerate() {
        // A picture that lies inside another file becomes one of its own; what it is says its content.
        let file = match &image.bytes {
            None => image.path.clone(),
            Some(bytes) => {
                let same = |other: &&ImageDesc| other.bytes.as_ref() == Some(bytes);
                let first = desc.images.iter().position(|i| same(&i)).unwrap_or(index);
                format!("images/{first:05}.{}", crate::picture::ending(bytes))
            }
        };
        if !image.missing && !files.iter().any(|(path, _)| *path == file) {
            let bytes = match &image.bytes {
                Some(bytes) => bytes.to_vec(),
                None => assets.read(&file)?.to_vec(),
            };
            files.push((file.clone(), bytes));
        }
        images.push((
            format!("i{index}"),
            json::Image {
                file,
                encoding: encoding(image.encoding),
            },
        ));
    }
    let numbered = |prefix: &str, index: usize| format!("{prefix}{index}");
    let textures = desc
        .textures
        .iter()
        .enumerate()
        .map(|(i, t)| Ok((numbered("t", i), writer.texture(t)?)));
    let materials = desc
        .materials
        .iter()
        .map(|m| Ok((m.name.clone(), writer.material(m)?)));
    let groups = desc.groups.iter().map(|g| {
        let primitives = writer.primitives(&g.primitives)?;
        Ok((
            g.name.clone(),
            json::Group {
                primitives,
                instances: writer.instances(&g.instances)?,
            },
        ))
    });
    let FilmDesc {
        width,
        height,
        crop,
        filter,
        exposure,
        max_component,
    } = desc.film.clone();
    let scene = json::Scene {
        brolly: 1,
        camera: json::Camera {
            medium: desc
                .camera
                .medium
                .map(|id| writer.medium_name(id))
                .transpose()?,
            ..camera(&desc.camera)
        },
        film: json::Film {
            size: [width, height],
            crop,
            filter,
            exposure: Color(exposure),
            max_component,
        },
        integrator: integrator(desc.integrator),
        sampler: desc.sampler,
        spp: desc.spp,
        animation: desc.animation,
        images: Named(images),
        textures: Named(textures.collect::<Result<_, WriteError>>()?),
        materials: Named(materials.collect::<Result<_, WriteError>>()?),
        media: Named(media),
        meshes: Named(meshes),
        curves: Named(curves),
        groups: Named(groups.collect::<Result<_, WriteError>>()?),
        primitives: writer.primitives(&desc.primitives)?,
        instances: writer.instances(&desc.instances)?,
        lights: desc.lights.iter().map(|l| writer.light(l)).collect(),
    };
    let json = serde_json::to_string_pretty(&scene)? + "\n";
    Ok(Written { json, files })
}

fn encoding(encoding: Encoding) -> json::Encoding {
    match encoding {
        Encoding::Auto => json::Encoding::Auto,
        Encoding::Srgb => json::Encoding::Srgb,
        Encoding::Linear => json::Encoding::Linear,
        Encoding::GammaMicros(micros) => json::Encoding::GammaMicros(micros),
    }
}

fn integrator(integrator: Integrator) -> json::Integrator {
    let plain = crate::apply::DEFAULT_DEPTH;
    let (name, max_depth) = match integrator {
        Integrator::Path { max_depth } => ("path", max_depth),
        Integrator::Guided { max_depth } => ("guided", max_depth),
        Integrator::Direct { max_depth } => ("direct", max_depth),
        Integrator::Whitted { max_depth } => ("whitted", max_depth),
        Integrator::Normals => ("normals", plain),
        Integrator::Albedo => ("albedo", plain),
        Integrator::Depth => ("depth", plain),
        Integrator::Uv => ("uv", plain),
    };
    json::Integrator {
        name: name.into(),
        max_depth,
    }
}

fn rows(m: &DAffine3) -> [f64; 12] {
    let (a, t) = (m.matrix3, m.translation);
    let row = |i: usize| [a.x_axis[i], a.y_axis[i], a.z_axis[i], t[i]];
    let (x, y, z) = (row(0), row(1), row(2));
    [
        x[0], x[1], x[2], x[3], y[0], y[1], y[2], y[3], z[0], z[1], z[2], z[3],
    ]
}

fn steps(m: &DAffine3) -> Vec<Step> {
    if *m == DAffine3::IDENTITY {
        Vec::new()
    } else {
        vec![Step::Matrix(rows(m))]
    }
}

fn placement(motion: &Motion) -> Placement {
    match motion.keys.as_slice() {
        [only] if only.time == 0.0 => Placement::Fixed(steps(&only.transform)),
        keys => Placement::Keys(
            keys.iter()
                .map(|k| Key {
                    time: k.time,
                    transform: steps(&k.transform),
                })
                .collect(),
        ),
    }
}

fn camera(camera: &Camera) -> json::Camera {
    let lens = |lens: &Option<Lens>| {
        lens.as_ref().map(|l| json::Lens {
            radius: l.radius,
            focus_distance: l.focus_distance,
            aperture: l.aperture,
            anamorphic: l.anamorphic,
        })
    };
    let (projection, lens) = match &camera.projection {
        Projection::Perspective {
            fov,
            fov_axis,
            window,
            lens: l,
        } => (
            json::Projection::Perspective {
                fov: *fov,
                fov_axis: *fov_axis,
                window: *window,
            },
            lens(l),
        ),
        Projection::Orthographic {
            half_height,
            window,
            lens: l,
        } => (
            json::Projection::Orthographic {
                half_height: *half_height,
                window: *window,
            },
            lens(l),
        ),
        Projection::Spherical { mapping } => {
            (json::Projection::Spherical { mapping: *mapping }, None)
        }
    };
    json::Camera {
        transform: Some(placement(&camera.transform)),
        projection: Some(projection),
        lens,
        shutter: camera.shutter,
        shutter_curve: camera.shutter_curve.clone(),
        ..json::Camera::default()
    }
}

fn map(map: &UvMap) -> json::Map {
    match map {
        UvMap::Uv { set, matrix } => json::Map::Uv {
            set: *set,
            matrix: *matrix,
        },
        UvMap::Planar { matrix } => json::Map::Planar {
            matrix: rows(matrix),
        },
        UvMap::Spherical { matrix } => json::Map::Spherical {
            matrix: rows(matrix),
        },
        UvMap::Cylindrical { matrix } => json::Map::Cylindrical {
            matrix: rows(matrix),
        },
    }
}

fn color(value: &ColorTex) -> ColorValue {
    match value {
        ColorTex::Const(rgb) => ColorValue::Const(*rgb),
        ColorTex::Texture(id) => ColorValue::Texture(texture_name(*id)),
    }
}

fn float(value: &FloatTex) -> FloatValue {
    match value {
        FloatTex::Const(v) => FloatValue::Const(*v),
        FloatTex::Texture(id, channel) => FloatValue::Texture(texture_name(*id), *channel),
    }
}

fn texture_name(id: TextureId) -> String {
    format!("t{}", id.0)
}

struct Writer<'d> {
    desc: &'d SceneDesc,
}

impl Writer<'_> {
    fn mesh(&self, index: usize, mesh: &Mesh) -> (json::Mesh, String, Vec<u8>) {
        let plain = mesh.tangents.is_empty()
            && mesh.colors.is_empty()
            && mesh.deformation.is_none()
            && mesh.uvs.len() <= 1;
        if plain && !mesh.indices.is_empty() && mesh.uvs.first().is_none_or(|uvs| !uvs.is_empty()) {
            let path = format!("meshes/{index:05}.ply");
            let bytes = ply::write(&ply::PlyMesh {
                positions: mesh.positions.to_vec(),
                normals: mesh.normals.to_vec(),
                uvs: mesh.uvs.first().map(|uvs| uvs.to_vec()).unwrap_or_default(),
                indices: mesh.indices.to_vec(),
                ..ply::PlyMesh::default()
            });
            return (
                json::Mesh {
                    ply: Some(path.clone()),
                    ..json::Mesh::default()
                },
                path,
                bytes,
            );
        }
        let path = format!("meshes/{index:05}.bin");
        (
            json::Mesh {
                buffer: Some(path.clone()),
                ..json::Mesh::default()
            },
            path,
            buffer::write(mesh),
        )
    }

    fn material_name(&self, id: MaterialId) -> Result<String, WriteError> {
        self.desc
            .materials
            .get(id.index())
            .map(|m| m.name.clone())
            .ok_or(WriteError::Invalid("material"))
    }

    fn primitives(&self, list: &[Primitive]) -> Result<Vec<json::Primitive>, WriteError> {
        list.iter().map(|p| self.primitive(p)).collect()
    }

    fn primitive(&self, primitive: &Primitive) -> Result<json::Primitive, WriteError> {
        let shape = match &primitive.shape {
            Shape::Mesh(id) => {
                let mesh = self
                    .desc
                    .meshes
                    .get(id.index())
                    .ok_or(WriteError::Invalid("mesh"))?;
                json::Shape::Mesh(mesh.name.clone())
            }
            Shape::Sphere { radius } => json::Shape::Sphere { radius: *radius },
            Shape::Disk {
                radius,
                inner_radius,
                height,
            } => json::Shape::Disk {
                radius: *radius,
                inner_radius: *inner_radius,
                height: *height,
            },
            Shape::Rectangle => json::Shape::Rectangle,
            Shape::Curves(id) => {
                let curves = self
                    .desc
                    .curves
                    .get(id.index())
                    .ok_or(WriteError::Invalid("bundle of curves"))?;
                json::Shape::Curves(curves.name.clone())
            }
        };
        Ok(json::Primitive {
            shape,
            material: self.material_name(primitive.material)?,
            transform: placement(&primitive.transform),
            emission: primitive.emission.as_ref().map(|e| json::Emission {
                radiance: color(&e.radiance),
                scale: e.scale,
                two_sided: e.two_sided,
            }),
            alpha: primitive.alpha.as_ref().map(float),
            reverse_orientation: primitive.reverse_orientation,
            media: primitive.media.map(|m| self.interface(m)).transpose()?,
        })
    }

    fn instances(&self, list: &[Instance]) -> Result<Vec<json::Instance>, WriteError> {
        let instance = |i: &Instance| {
            let group = self
                .desc
                .groups
                .get(i.group.index())
                .ok_or(WriteError::Invalid("group"))?;
            Ok(json::Instance {
                group: group.name.clone(),
                transform: placement(&i.transform),
            })
        };
        list.iter().map(instance).collect()
    }

    fn light(&self, light: &Light) -> json::Light {
        let fixed = |m: &DAffine3| Placement::Fixed(steps(m));
        match light {
            Light::Point {
                transform,
                intensity,
            } => json::Light::Point {
                intensity: Color(*intensity),
                transform: fixed(transform),
            },
            Light::Spot {
                transform,
                intensity,
                cone_angle,
                full_angle,
                falloff,
            } => json::Light::Spot {
                intensity: Color(*intensity),
                cone_angle: *cone_angle,
                full_angle: *full_angle,
                falloff: *falloff,
                transform: fixed(transform),
            },
            Light::Distant {
                direction,
                irradiance,
            } => json::Light::Distant {
                direction: direction.to_array(),
                irradiance: Color(*irradiance),
            },
            Light::Environment {
                transform,
                radiance,
                image,
                hidden,
                illuminance,
                portal,
            } => json::Light::Environment {
                radiance: Color(*radiance),
                image: image.map(|(id, _)| format!("i{}", id.0)),
                mapping: image.map_or(SphereMapping::LatLong, |(_, mapping)| mapping),
                transform: fixed(transform),
                hidden: *hidden,
                illuminance: *illuminance,
                portal: portal.map(|corners| corners.map(|p| p.to_array())),
            },
            Light::Goniometric {
                transform,
                intensity,
                image,
                power,
            } => json::Light::Goniometric {
                intensity: Color(*intensity),
                image: format!("i{}", image.0),
                power: *power,
                transform: fixed(transform),
            },
            Light::Projection {
                transform,
                intensity,
                image,
                fov,
                power,
            } => json::Light::Projection {
                intensity: Color(*intensity),
                image: format!("i{}", image.0),
                fov: *fov,
                power: *power,
                transform: fixed(transform),
            },
        }
    }
}
