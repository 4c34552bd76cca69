//! Textures. Float and spectrum textures have separate names; constants stay constants.

use super::params::{Kind, Params};
use super::spectra::{Role, SPECTRUM};
use super::{Importer, matrix, nearest};
use crate::context::Issue;
use crate::limits::MAX_OCTAVES;
use crate::model::{Channel, ColorTex, FloatOrColor, FloatTex, NoisePattern, Texture, TextureId};
use glam::DVec3;

pub(super) const CLASSES: [&str; 13] = [
    "bilerp",
    "checkerboard",
    "constant",
    "directionmix",
    "dots",
    "fbm",
    "imagemap",
    "marble",
    "mix",
    "ptex",
    "scale",
    "windy",
    "wrinkled",
];

/// Both kinds of texture at once: a float texture is a colour texture of which one channel is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value {
    Color(ColorTex),
    Float(FloatTex),
}

impl Value {
    /// As an input of a texture; the channel is chosen at the end.
    fn color(self) -> ColorTex {
        match self {
            Value::Color(color) => color,
            Value::Float(FloatTex::Const(v)) => ColorTex::Const([v; 3]),
            Value::Float(FloatTex::Texture(id, _)) => ColorTex::Texture(id),
        }
    }
    fn channel(self) -> Option<Channel> {
        match self {
            Value::Float(FloatTex::Texture(_, channel)) => Some(channel),
            _ => None,
        }
    }
}

impl Importer<'_, '_> {
    pub(super) fn add_texture(&mut self, texture: Texture) -> TextureId {
        self.textures.push(texture);
        TextureId(self.textures.len() as u32 - 1)
    }

    /// A parameter that is a number or the name of a float texture.
    pub(super) fn float_tex(
        &mut self,
        params: &Params,
        name: &str,
    ) -> Result<Option<FloatTex>, Issue> {
        let Some(param) = params.find(name, &[Kind::Float, Kind::Texture])? else {
            return Ok(None);
        };
        if param.kind == Kind::Float {
            return Ok(Some(FloatTex::Const(param.one()? as f32)));
        }
        let wanted = param.text()?;
        match self.float_textures.get(wanted) {
            Some(&texture) => Ok(Some(texture)),
            None => param.fail(format!(
                "names the unknown float texture {wanted:?}{}",
                nearest(wanted, self.float_textures.keys())
            )),
        }
    }

    /// A parameter that is a spectrum or the name of a spectrum texture.
    pub(super) fn color_tex(
        &mut self,
        params: &Params,
        name: &str,
        role: Role,
    ) -> Result<Option<ColorTex>, Issue> {
        let kinds = [SPECTRUM[0], SPECTRUM[1], SPECTRUM[2], Kind::Texture];
        let Some(param) = params.find(name, &kinds)? else {
            return Ok(None);
        };
        if param.kind != Kind::Texture {
            return self
                .color(params, param, role)
                .map(|c| Some(ColorTex::Const(c)));
        }
        let wanted = param.text()?;
        match self.color_textures.get(wanted) {
            Some(&texture) => Ok(Some(texture)),
            None => param.fail(format!(
                "names the unknown spectrum texture {wanted:?}{}",
                nearest(wanted, self.color_textures.keys())
            )),
        }
    }

    pub(super) fn define_texture(
        &mut self,
        name: String,
        kind: &str,
        class: &str,
        params: &Params,
    ) -> Result<(), Issue> {
        let float = match kind {
            "float" => true,
            "spectrum" => false,
            "color" => {
                return params
                    .fail("texture type \"color\" is of pbrt-v3; pbrt-v4 has \"spectrum\"");
            }
            other => {
                return params.fail(format!(
                    "unknown texture type {other:?}; it is \"float\" or \"spectrum\""
                ));
            }
        };
        let taken = if float {
            self.float_textures.contains_key(&name)
        } else {
            self.color_textures.contains_key(&name)
        };
        if taken {
            return params.fail(format!("{kind} texture {name:?} is defined twice"));
        }
        let value = self.texture(class, params, float)?;
        match value {
            Value::Float(value) => {
                self.float_textures.insert(name, value);
            }
            Value::Color(value) => {
                self.color_textures.insert(name, value);
            }
        }
        self.warn_unused(params, &format!("texture {class:?}"));
        Ok(())
    }

    /// An input of a texture, of the texture's own kind.
    fn input(
        &mut self,
        params: &Params,
        name: &str,
        default: f32,
        float: bool,
    ) -> Result<Value, Issue> {
        Ok(if float {
            Value::Float(
                self.float_tex(params, name)?
                    .unwrap_or(FloatTex::Const(default)),
            )
        } else {
            // What the colours are for is known only where the texture is used; fractions are checked there.
            Value::Color(
                self.color_tex(params, name, Role::Unbounded)?
                    .unwrap_or(ColorTex::Const([default; 3])),
            )
        })
    }

    /// A finished texture as a value of the wanted kind.
    pub(super) fn value(&mut self, texture: Texture, float: bool, channel: Channel) -> Value {
        let id = self.add_texture(texture);
        if float {
            Value::Float(FloatTex::Texture(id, channel))
        } else {
            Value::Color(ColorTex::Texture(id))
        }
    }

    /// Inputs that are combined into one texture, and the channel of the result that counts. Numbers
    /// that come from different channels, or from alpha (which constants do not have), are made grey
    /// first.
    fn combined<const N: usize>(&mut self, inputs: [Value; N]) -> ([ColorTex; N], Channel) {
        let channels = || inputs.iter().filter_map(|v| v.channel());
        let Some(first) = channels().next() else {
            return (inputs.map(Value::color), Channel::R);
        };
        let plain = |c: Channel| !matches!(c, Channel::A | Channel::AlphaOrMean);
        if channels().all(|c| c == first && plain(c)) {
            return (inputs.map(Value::color), first);
        }
        let grey = |input: Value| match input {
            Value::Float(value @ FloatTex::Texture(..)) => {
                ColorTex::Texture(self.add_texture(Texture::Grey { value }))
            }
            other => other.color(),
        };
        (inputs.map(grey), Channel::R)
    }

    fn texture(&mut self, class: &str, params: &Params, float: bool) -> Result<Value, Issue> {
        match class {
            "constant" => {
                if float {
                    return Ok(Value::Float(FloatTex::Const(
                        params.float("value", 1.0)? as f32
                    )));
                }
                let value = match params.find("value", &SPECTRUM)? {
                    Some(param) => self.color(params, param, Role::Unbounded)?,
                    None => [1.0; 3],
                };
                Ok(Value::Color(ColorTex::Const(value)))
            }
            "imagemap" => self.imagemap(params, float),
            "scale" => {
                let a = self.input(params, "tex", 1.0, float)?;
                let scale = self
                    .float_tex(params, "scale")?
                    .unwrap_or(FloatTex::Const(1.0));
                match (a, scale) {
                    (Value::Float(FloatTex::Const(a)), FloatTex::Const(b)) => {
                        return Ok(Value::Float(FloatTex::Const(a * b)));
                    }
                    (Value::Color(ColorTex::Const(a)), FloatTex::Const(b)) => {
                        return Ok(Value::Color(ColorTex::Const(a.map(|c| c * b))));
                    }
                    (a, FloatTex::Const(1.0)) => return Ok(a),
                    _ => {}
                }
                let ([a], channel) = self.combined([a]);
                Ok(self.value(
                    Texture::Scale {
                        a,
                        b: FloatOrColor::Float(scale),
                    },
                    float,
                    channel,
                ))
            }
            "mix" => {
                let a = self.input(params, "tex1", 0.0, float)?;
                let b = self.input(params, "tex2", 1.0, float)?;
                let amount = self
                    .float_tex(params, "amount")?
                    .unwrap_or(FloatTex::Const(0.5));
                if a == b {
                    return Ok(a);
                }
                let ([a, b], channel) = self.combined([a, b]);
                Ok(self.value(Texture::Mix { a, b, amount }, float, channel))
            }
            "directionmix" => {
                let a = self.input(params, "tex1", 0.0, float)?;
                let b = self.input(params, "tex2", 1.0, float)?;
                let direction = params.vector("dir", Kind::Vector3, [0.0, 1.0, 0.0])?;
                let placed = matrix::affine(&self.graphics.ctm[0])
                    .map_err(|e| Issue::new(&params.place, e))?;
                let direction = placed.transform_vector3(DVec3::from_array(direction));
                let Some(direction) = direction.try_normalize() else {
                    return params.fail("a direction \"dir\" of no length");
                };
                let ([a, b], channel) = self.combined([a, b]);
                Ok(self.value(Texture::DirectionMix { a, b, direction }, float, channel))
            }
            "checkerboard" => {
                let a = self.input(params, "tex1", 1.0, float)?;
                let b = self.input(params, "tex2", 0.0, float)?;
                let solid = params.count("dimension", 2, 2..=3)? == 3;
                let map = match solid {
                    true => None,
                    false => Some(self.map_2d(params)?),
                };
                let ([even, odd], channel) = self.combined([a, b]);
                let texture = match map {
                    Some(map) => Texture::Checkerboard { map, even, odd },
                    None => Texture::Checkerboard3d {
                        matrix: self.texture_space(params)?,
                        even,
                        odd,
                    },
                };
                Ok(self.value(texture, float, channel))
            }
            "dots" => {
                let inside = self.input(params, "inside", 1.0, float)?;
                let outside = self.input(params, "outside", 0.0, float)?;
                let map = self.map_2d(params)?;
                let ([inside, outside], channel) = self.combined([inside, outside]);
                let texture = Texture::Dots {
                    map,
                    inside,
                    outside,
                };
                Ok(self.value(texture, float, channel))
            }
            "fbm" | "wrinkled" | "windy" | "marble" => self.noise(class, params, float),
            "bilerp" => {
                let map = self.map_2d(params)?;
                let mut corners = [[0.0; 3]; 4];
                // v01 is at s = 0, t = 1: the model's order.
                for (corner, (name, default)) in
                    corners
                        .iter_mut()
                        .zip([("v00", 0.0), ("v01", 1.0), ("v10", 0.0), ("v11", 1.0)])
                {
                    *corner = if float {
                        [params.float(name, default)? as f32; 3]
                    } else {
                        match params.find(name, &SPECTRUM)? {
                            Some(param) => self.color(params, param, Role::Unbounded)?,
                            None => [default as f32; 3],
                        }
                    };
                }
                Ok(self.value(Texture::Bilerp { map, corners }, float, Channel::R))
            }
            "ptex" => {
                params.ignore(&["filename", "encoding", "scale"]);
                self.cx.warn(
                    &params.place,
                    "texture \"ptex\" is not supported: grey stands in",
                );
                Ok(match float {
                    true => Value::Float(FloatTex::Const(0.5)),
                    false => Value::Color(ColorTex::Const([0.5; 3])),
                })
            }
            "uv" => params.fail("texture \"uv\" is of pbrt-v3; pbrt-v4 has none like it"),
            other => {
                let near = crate::suggest::did_you_mean(other, CLASSES);
                params.fail(format!("unknown texture {other:?}{near}"))
            }
        }
    }

    fn noise(&mut self, class: &str, params: &Params, float: bool) -> Result<Value, Issue> {
        if float == (class == "marble") {
            let kind = if float { "spectrum" } else { "float" };
            return params.fail(format!("texture {class:?} is a {kind} texture in pbrt"));
        }
        let octaves = match class {
            "windy" => 0,
            _ => params.count("octaves", 8, 0..=MAX_OCTAVES)?,
        };
        let roughness = match class {
            "windy" => 0.0,
            _ => params.float("roughness", 0.5)? as f32,
        };
        let pattern = match class {
            "fbm" => NoisePattern::Fbm { octaves, roughness },
            "wrinkled" => NoisePattern::Wrinkled { octaves, roughness },
            "windy" => NoisePattern::Windy,
            _ => NoisePattern::Marble {
                octaves,
                roughness,
                scale: params.float("scale", 1.0)? as f32,
                variation: params.float("variation", 0.2)? as f32,
            },
        };
        let matrix = self.texture_space(params)?;
        Ok(self.value(Texture::Noise { matrix, pattern }, float, Channel::R))
    }
}
