//! Lights. Every emission spectrum is normalised to luminance 1 and multiplied by `scale`, so a black
//! body gives its hue only; an `rgb` keeps its numbers. `power` and `illuminance` set the level.

use super::params::{Kind, Params};
use super::{Importer, Radiance, legacy, matrix};
use crate::context::Issue;
use crate::diagnostic::Place;
use crate::model::{
    ColorTex, Emission, Encoding, ImageId, Light, Mesh, Motion, Rgb, Shape, SphereMapping,
    SpotFalloff, Texture, TextureId, UvMap, Wrap,
};
use glam::{DAffine3, DMat3, DVec3};
use std::f64::consts::PI;

pub(super) const LIGHTS: [&str; 6] = [
    "distant",
    "goniometric",
    "infinite",
    "point",
    "projection",
    "spot",
];

fn times(color: Rgb, factor: f64) -> Rgb {
    color.map(|c| (f64::from(c) * factor) as f32)
}

impl Importer<'_, '_> {
    /// The matrix of the moment; lights do not move in pbrt.
    fn light_transform(&mut self, params: &Params) -> Result<DAffine3, Issue> {
        let ctm = self.graphics.ctm;
        if ctm[0] != ctm[1] {
            self.cx.warn(
                &params.place,
                "a moving light that is not a shape stands still at its start, as in pbrt",
            );
        }
        matrix::affine(&ctm[0]).map_err(|e| Issue::new(&params.place, e))
    }

    fn finite(params: &Params, color: Rgb) -> Result<Rgb, Issue> {
        if color.iter().all(|c| c.is_finite()) {
            Ok(color)
        } else {
            params.fail("the light is too bright for a number")
        }
    }

    pub(super) fn light(&mut self, kind: &str, params: &Params) -> Result<(), Issue> {
        if !LIGHTS.contains(&kind) {
            let hint = legacy::hint("light", kind, &LIGHTS);
            return params.fail(format!("unknown light {kind:?}{hint}"));
        }
        if params.has("mapname") {
            return params.fail("parameter \"mapname\" is of pbrt-v3; pbrt-v4 has \"filename\"");
        }
        let ctm = self.light_transform(params)?;
        let scale = params.float("scale", 1.0)?;
        if scale < 0.0 {
            return params.fail("\"scale\" is negative");
        }
        let light = match kind {
            "infinite" => self.infinite(params, ctm, scale)?,
            "distant" => {
                let color = self.emission(params, "L")?.unwrap_or([1.0; 3]);
                let (from, to) = self.endpoints(params)?;
                let direction = ctm.transform_vector3(to - from).normalize_or_zero();
                if direction == DVec3::ZERO {
                    return params.fail(
                        "a distant light without a direction: \"from\" and \"to\" are the same",
                    );
                }
                let level = params.float("illuminance", -1.0)?;
                let irradiance = times(color, if level > 0.0 { scale * level } else { scale });
                Light::Distant {
                    direction,
                    irradiance: Self::finite(params, irradiance)?,
                }
            }
            "point" | "goniometric" => {
                let color = self.emission(params, "I")?.unwrap_or([1.0; 3]);
                let power = params.float("power", -1.0)?;
                let mut from = DVec3::ZERO;
                if kind == "point" {
                    from = DVec3::from_array(params.vector("from", Kind::Point3, [0.0; 3])?);
                } else if params.has("filename") {
                    let light = self.goniometric(params, ctm, times(color, scale), power)?;
                    self.lights.push(light);
                    return Ok(());
                } else {
                    self.cx.warn(
                        &params.place,
                        "a goniometric light without a \"filename\" shines equally in all directions",
                    );
                }
                let level = if power > 0.0 {
                    scale * power / (4.0 * PI)
                } else {
                    scale
                };
                let transform = ctm * DAffine3::from_translation(from);
                Light::Point {
                    transform,
                    intensity: Self::finite(params, times(color, level))?,
                }
            }
            "projection" => self.projection(params, ctm, scale)?,
            _ => self.spot(params, ctm, scale)?,
        };
        self.lights.push(light);
        Ok(())
    }

    fn endpoints(&mut self, params: &Params) -> Result<(DVec3, DVec3), Issue> {
        let from = params.vector("from", Kind::Point3, [0.0; 3])?;
        let to = params.vector("to", Kind::Point3, [0.0, 0.0, 1.0])?;
        Ok((DVec3::from_array(from), DVec3::from_array(to)))
    }

    /// A level that takes the pixels of a picture, which only the tracer reads: `power` or
    /// `illuminance`.
    fn level(params: &Params, level: f64) -> Result<Option<f32>, Issue> {
        if level <= 0.0 {
            return Ok(None);
        }
        let level = level as f32;
        if level.is_finite() {
            Ok(Some(level))
        } else {
            params.fail("the light is too bright for a number")
        }
    }

    fn goniometric(
        &mut self,
        params: &Params,
        ctm: DAffine3,
        intensity: Rgb,
        power: f64,
    ) -> Result<Light, Issue> {
        let name = params.text("filename", "")?;
        let image = self.cx.image(&params.place, name, Encoding::Auto)?;
        self.square(params, name, image)?;
        Ok(Light::Goniometric {
            transform: ctm,
            intensity: Self::finite(params, intensity)?,
            image,
            power: Self::level(params, power)?,
        })
    }

    /// Refuses a picture of the sphere that cannot be an octahedral one.
    fn square(&mut self, params: &Params, name: &str, image: ImageId) -> Result<(), Issue> {
        match self.cx.info(image) {
            Some(info) if info.width != info.height => {
                let (w, h) = (info.width, info.height);
                params.fail(format!(
                    "{name}: {w} x {h} pixels; a picture of the sky is square (equal-area octahedral), not latitude and longitude"
                ))
            }
            _ => Ok(()),
        }
    }

    fn projection(
        &mut self,
        params: &Params,
        transform: DAffine3,
        scale: f64,
    ) -> Result<Light, Issue> {
        let Some(name) = params.text_opt("filename")? else {
            return params.fail("a projection light needs a \"filename\"");
        };
        let image = self.cx.image(&params.place, name, Encoding::Auto)?;
        let fov = params.float("fov", 90.0)?;
        if !(fov > 0.0 && fov < 180.0) {
            return params.fail(format!("a field of view of {fov} degrees"));
        }
        let power = params.float("power", -1.0)?;
        Ok(Light::Projection {
            transform,
            intensity: Self::finite(params, times([1.0; 3], scale))?,
            image,
            fov,
            power: Self::level(params, power)?,
        })
    }

    fn spot(&mut self, params: &Params, ctm: DAffine3, scale: f64) -> Result<Light, Issue> {
        let power = params.float("power", -1.0)?;
        let color = self.emission(params, "I")?.unwrap_or([1.0; 3]);
        let cone = params.float("coneangle", 30.0)?;
        let full = cone - params.float("conedeltaangle", 5.0)?;
        let (from, to) = self.endpoints(params)?;
        if !(cone > 0.0 && cone <= 180.0 && full <= cone) {
            return params.fail(format!(
                "a spot with a cone of {cone} degrees, full up to {full}"
            ));
        }
        let full = full.max(0.0);
        let Some(axis) = (to - from).try_normalize() else {
            return params.fail("a spot without a direction: \"from\" and \"to\" are the same");
        };
        let (c0, c1) = (libm::cos(cone.to_radians()), libm::cos(full.to_radians()));
        let level = if power > 0.0 {
            scale * power / (2.0 * PI * ((1.0 - c1) + (c1 - c0) / 2.0))
        } else {
            scale
        };
        let (x, y) = axis.any_orthonormal_pair();
        let frame = DAffine3::from_mat3_translation(DMat3::from_cols(x, y, axis), from);
        Ok(Light::Spot {
            transform: ctm * frame,
            intensity: Self::finite(params, times(color, level))?,
            cone_angle: cone,
            full_angle: full,
            falloff: SpotFalloff::SmoothStep,
        })
    }

    fn infinite(
        &mut self,
        params: &Params,
        transform: DAffine3,
        scale: f64,
    ) -> Result<Light, Issue> {
        let color = self.emission(params, "L")?;
        let filename = params.text_opt("filename")?;
        let illuminance = params.float("illuminance", -1.0)?;
        let portal = self.portal(params)?;
        let mut level_of_picture = None;
        let (radiance, image) = match (color, filename) {
            (Some(_), Some(_)) => {
                return params.fail("an infinite light has either \"L\" or \"filename\", not both");
            }
            (color, None) => {
                let level = if illuminance > 0.0 {
                    scale * illuminance / PI
                } else {
                    scale
                };
                (times(color.unwrap_or([1.0; 3]), level), None)
            }
            (None, Some(name)) => {
                let image = self.cx.image(&params.place, name, Encoding::Auto)?;
                self.square(params, name, image)?;
                level_of_picture = Self::level(params, illuminance)?;
                (
                    times([1.0; 3], scale),
                    Some((image, SphereMapping::OctahedralEqualArea)),
                )
            }
        };
        let radiance = Self::finite(params, radiance)?;
        Ok(Light::Environment {
            transform,
            radiance,
            image,
            hidden: false,
            illuminance: level_of_picture,
            portal,
        })
    }

    /// The rectangle that an infinite light comes in through; its corners are in the world.
    fn portal(&mut self, params: &Params) -> Result<Option<[DVec3; 4]>, Issue> {
        let Some(rows) = params.rows::<3>("portal", &[Kind::Point3])? else {
            return Ok(None);
        };
        let &[p0, p1, p2, p3] = rows.as_slice() else {
            return params.fail(format!("a portal with {} corners; it has 4", rows.len()));
        };
        let corners = [p0, p1, p2, p3].map(|p| DVec3::from_array(p.map(f64::from)));
        let direction = |a: usize, b: usize| (corners[b] - corners[a]).normalize_or_zero();
        let (a, b) = (direction(0, 1), direction(1, 2));
        let (c, d) = (direction(3, 2), direction(0, 3));
        let parallel = a.dot(c) > 0.999 && b.dot(d) > 0.999;
        if !parallel || libm::fabs(a.dot(b)) > 1e-3 {
            return params.fail("a portal that is not a rectangle with its corners in order");
        }
        Ok(Some(corners))
    }

    /// Reads everything that an area light may say, so that mistakes show where they are.
    pub(super) fn check_area_light(&mut self, params: &Params) -> Result<(), Issue> {
        let color = self.emission(params, "L")?;
        let filename = params.text_opt("filename")?;
        if color.is_some() && filename.is_some() {
            return params.fail("an area light has either \"L\" or \"filename\", not both");
        }
        if params.float("scale", 1.0)? < 0.0 {
            return params.fail("\"scale\" is negative");
        }
        params.float("power", -1.0)?;
        params.bool("twosided", false)?;
        Ok(())
    }

    /// The emission of one shape.
    pub(super) fn area_emission(
        &mut self,
        params: &Params,
        shape: &Shape,
        transform: &Motion,
        place: &Place,
    ) -> Result<Radiance, Issue> {
        let color = self.emission(params, "L")?;
        let mut scale = params.float("scale", 1.0)?;
        let two_sided = params.bool("twosided", false)?;
        let power = params.float("power", -1.0)?;
        if transform.is_moving() {
            self.warn_once(
                place,
                "a moving area light: pbrt refuses it, it is rendered here",
            );
        }
        if matches!(shape, Shape::Curves(_)) {
            self.warn_once(
                place,
                "curves do not shine, as in pbrt: their area light is left out",
            );
            return Ok(None);
        }
        let radiance = match params.text_opt("filename")? {
            Some(name) => {
                let image = self.cx.image(&params.place, name, Encoding::Auto)?;
                let id = TextureId(self.textures.len() as u32);
                self.textures.push(Texture::Image {
                    image,
                    map: UvMap::default(),
                    wrap: (Wrap::Clamp, Wrap::Clamp),
                    nearest: false,
                    mip: None,
                    invert: false,
                    scale: [1.0; 4],
                });
                if power > 0.0 {
                    let mean = Texture::UnitMean { texture: id };
                    ColorTex::Texture(self.add_texture(mean))
                } else {
                    ColorTex::Texture(id)
                }
            }
            None => ColorTex::Const(color.unwrap_or([1.0; 3])),
        };
        if power > 0.0 {
            let keys = &transform.keys;
            let placed = keys
                .first()
                .map(|k| k.transform)
                .unwrap_or(DAffine3::IDENTITY);
            let (area, pieces, even) = self.area(shape, &placed);
            if area <= 0.0 {
                return Err(Issue::new(
                    place,
                    "an area light with \"power\" on a shape without area",
                ));
            }
            if !even {
                self.warn_once(
                    place,
                    "\"power\" on a mesh: pbrt gives it to every triangle; here all triangles share the sum evenly by area",
                );
            }
            scale *= power * pieces as f64 / (PI * area * if two_sided { 2.0 } else { 1.0 });
        }
        if scale == 0.0 || radiance == ColorTex::Const([0.0; 3]) {
            return Ok(None);
        }
        Ok(Some(Emission {
            radiance,
            scale: scale as f32,
            two_sided,
        }))
    }

    /// Area in the world, how many lights pbrt makes of the shape, and whether these are equally large.
    fn area(&self, shape: &Shape, placed: &DAffine3) -> (f64, usize, bool) {
        let m = placed.matrix3;
        match shape {
            Shape::Mesh(id) => match self.cx.meshes.get(id.index()) {
                Some(mesh) => mesh_area(mesh, placed),
                None => (0.0, 1, true),
            },
            // pbrt takes the area before scaling for these two.
            Shape::Sphere { radius } => (4.0 * PI * radius * radius, 1, true),
            Shape::Disk {
                radius,
                inner_radius,
                ..
            } => (
                PI * (radius * radius - inner_radius * inner_radius),
                1,
                true,
            ),
            Shape::Rectangle => (4.0 * m.x_axis.cross(m.y_axis).length(), 1, true),
            // Curves do not shine: refused before.
            Shape::Curves(_) => (0.0, 1, true),
        }
    }
}

fn mesh_area(mesh: &Mesh, placed: &DAffine3) -> (f64, usize, bool) {
    let point = |i: u32| {
        let p = mesh.positions.get(i as usize).copied().unwrap_or_default();
        placed.transform_point3(DVec3::from_array(p.map(f64::from)))
    };
    let (mut sum, mut least, mut most) = (0.0, f64::INFINITY, 0.0f64);
    for &[a, b, c] in mesh.indices.iter() {
        let area = 0.5 * (point(b) - point(a)).cross(point(c) - point(a)).length();
        sum += area;
        least = least.min(area);
        most = most.max(area);
    }
    (sum, mesh.indices.len().max(1), least >= most * 0.999)
}
