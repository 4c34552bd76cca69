//! Cameras and punctual lights.

use super::Gltf;
use super::properties as known;
use super::tree::At;
use crate::context::Issue;
use crate::model::{Camera, FovAxis, Light, Motion, Projection, ShutterCurve, SpotFalloff};
use glam::{DAffine3, DMat3, DVec3};

/// Height of the picture where only the aspect ratio is known.
const HEIGHT: u32 = 720;

/// A camera and the picture that it asks for.
pub(super) struct Shot {
    pub camera: Camera,
    /// Pixels.
    pub size: Option<[u32; 2]>,
}

/// A camera that nothing places, for [`Camera`]'s other fields.
pub(crate) fn plain_camera(transform: Motion, projection: Projection) -> Camera {
    Camera {
        transform,
        projection,
        shutter: (0.0, 0.0),
        shutter_curve: ShutterCurve::Box,
        medium: None,
    }
}

/// A picture of that aspect ratio.
fn size(aspect: f64) -> [u32; 2] {
    let aspect = aspect.clamp(0.05, 20.0);
    [((f64::from(HEIGHT) * aspect).round() as u32).max(1), HEIGHT]
}

impl<'j> Gltf<'_, '_, 'j> {
    /// The camera of that name, or the first one; none where the scene shows none.
    pub(super) fn shot(
        &mut self,
        order: &[usize],
        wanted: Option<&str>,
    ) -> Result<Option<Shot>, Issue> {
        let mut names: Vec<String> = Vec::new();
        let mut chosen = None;
        for &node in order {
            let Some(at) = self.nodes[node].as_ref().map(|n| n.at.clone()) else {
                continue;
            };
            let Some(index) = at.index("camera", &self.root, "cameras")? else {
                continue;
            };
            let camera = self.list_item("cameras", index)?;
            let own = [camera.name()?, at.name()?];
            let hit = match wanted {
                None => chosen.is_none(),
                Some(name) => chosen.is_none() && own.contains(&Some(name)),
            };
            names.extend(own.into_iter().flatten().map(str::to_owned));
            if hit {
                chosen = Some((node, camera));
            }
        }
        let Some((node, at)) = chosen else {
            return match wanted {
                None => Ok(None),
                Some(name) => Err(Issue::new(
                    &crate::apply::settings_place(),
                    format!(
                        "the file has no camera {name:?}{}; {}",
                        crate::suggest::did_you_mean(name, names.iter().map(String::as_str)),
                        listed(&names)
                    ),
                )),
            };
        };
        at.only(known::CAMERA, self.cx)?;
        let (projection, size) = self.projection(&at)?;
        // A camera does not grow with what it is mounted on.
        let mut transform = self.motion(node, DAffine3::IDENTITY)?;
        for key in &mut transform.keys {
            key.transform = upright(&key.transform).ok_or_else(|| {
                at.fail("the camera's node flattens space: it has no viewing direction")
            })?;
        }
        Ok(Some(Shot {
            camera: plain_camera(transform, projection),
            size,
        }))
    }

    fn projection(&mut self, at: &At<'j>) -> Result<(Projection, Option<[u32; 2]>), Issue> {
        let positive = |at: &At<'_>, name: &str| -> Result<f64, Issue> {
            let value = at.need(name)?;
            match value.number()? {
                x if x > 0.0 => Ok(x),
                x => Err(value.fail(format!("{name} is {x}; it must be above 0"))),
            }
        };
        let kind = at.need("type")?;
        match kind.text()? {
            "perspective" => {
                let p = at.need("perspective")?;
                p.only(known::PERSPECTIVE, self.cx)?;
                let fov = positive(&p, "yfov")?.to_degrees();
                if fov >= 180.0 {
                    return Err(p.fail(format!("a field of view of {fov} degrees")));
                }
                let aspect = match p.get("aspectRatio") {
                    None => None,
                    Some(_) => Some(positive(&p, "aspectRatio")?),
                };
                let projection = Projection::Perspective {
                    fov,
                    fov_axis: FovAxis::Vertical,
                    window: None,
                    lens: None,
                };
                Ok((projection, aspect.map(size)))
            }
            "orthographic" => {
                let o = at.need("orthographic")?;
                o.only(known::ORTHOGRAPHIC, self.cx)?;
                let (x, y) = (positive(&o, "xmag")?, positive(&o, "ymag")?);
                let projection = Projection::Orthographic {
                    half_height: y,
                    window: None,
                    lens: None,
                };
                Ok((projection, Some(size(x / y))))
            }
            other => Err(kind.fail(format!(
                "unknown camera type {other:?}; there are perspective and orthographic"
            ))),
        }
    }

    /// The punctual light of a node, if it has one.
    pub(super) fn light(&mut self, node: usize) -> Result<Option<Light>, Issue> {
        let Some(at) = self.nodes[node].as_ref().map(|n| n.at.clone()) else {
            return Ok(None);
        };
        let Some(here) = at.extension("KHR_lights_punctual") else {
            return Ok(None);
        };
        let Some(all) = self.root.extension("KHR_lights_punctual") else {
            return Err(here.fail("the file has no lights"));
        };
        let index = here.need("light")?.as_index(&all, "lights")?;
        let light = all
            .get("lights")
            .and_then(|list| list.item(index))
            .ok_or_else(|| here.fail("no light"))?;
        light.only(known::LIGHT, self.cx)?;
        if !self
            .animations
            .key_times(&self.chain(node), None, false)
            .is_empty()
        {
            self.cx.warn(
                &at.place(),
                "lights do not move; this one stays where it is at the start",
            );
        }
        let transform = self.world(node, 0.0);
        let color = light.color("color", [1.0; 3], f64::INFINITY, self.cx)?;
        let power = light.ranged("intensity", 1.0, (0.0, f64::INFINITY), self.cx)?;
        let intensity = color.map(|c| (f64::from(c) * power) as f32);
        let axis = transform.transform_vector3(DVec3::NEG_Z).try_normalize();
        let axis = axis.ok_or_else(|| at.fail("the light's node flattens space"));
        let kind = light.need("type")?;
        Ok(Some(match kind.text()? {
            "directional" => Light::Distant {
                direction: axis?,
                irradiance: intensity,
            },
            "point" => Light::Point {
                transform: DAffine3::from_translation(transform.translation),
                intensity,
            },
            "spot" => {
                let (inner, outer) = self.cone(&light)?;
                Light::Spot {
                    transform: DAffine3 {
                        matrix3: about(axis?),
                        translation: transform.translation,
                    },
                    intensity,
                    cone_angle: outer.to_degrees(),
                    full_angle: inner.to_degrees(),
                    falloff: SpotFalloff::Squared,
                }
            }
            other => {
                return Err(kind.fail(format!(
                    "unknown light type {other:?}; there are directional, point and spot"
                )));
            }
        }))
    }

    fn cone(&mut self, light: &At<'j>) -> Result<(f64, f64), Issue> {
        let quarter = std::f64::consts::FRAC_PI_4;
        let Some(spot) = light.get("spot") else {
            return Ok((0.0, quarter));
        };
        spot.only(known::SPOT, self.cx)?;
        let bound = (0.0, std::f64::consts::FRAC_PI_2);
        let inner = spot.ranged("innerConeAngle", 0.0, bound, self.cx)?;
        let outer = spot.ranged("outerConeAngle", quarter, bound, self.cx)?;
        if outer <= 0.0 || inner > outer {
            return Err(spot.fail(format!(
                "a cone from {inner} to {outer} radians; the outer angle is the larger one"
            )));
        }
        // The fall-off needs room between the two.
        Ok((inner.min(outer * 0.9999), outer))
    }
}

/// What names there are, for messages.
pub(super) fn listed(names: &[String]) -> String {
    match names {
        [] => "it has none".into(),
        _ => format!("it has {}", names.join(", ")),
    }
}

/// The same place and direction without scale or shear; none where there is no direction left.
fn upright(m: &DAffine3) -> Option<DAffine3> {
    let back = m.matrix3.z_axis.try_normalize()?;
    let right = m.matrix3.y_axis.cross(back).try_normalize()?;
    Some(DAffine3 {
        matrix3: DMat3::from_cols(right, back.cross(right), back),
        translation: m.translation,
    })
}

/// Any rotation that takes +Z to an axis.
fn about(axis: DVec3) -> DMat3 {
    let side = if libm::fabs(axis.y) < 0.9 {
        DVec3::Y
    } else {
        DVec3::X
    };
    let x = side.cross(axis).normalize();
    DMat3::from_cols(x, axis.cross(x), axis)
}
