//! Textures. Float and spectrum textures have separate names; constants stay constants.

use super::params::{Kind, Param, Params};
use super::spectra::{Role, SPECTRUM};
use super::{Importer, matrix, nearest};
use crate::context::Issue;
use crate::model::{
    Channel, ColorTex, Encoding, FloatOrColor, FloatTex, ImageId, Rgb, Texture, TextureId, UvMap,
    Wrap,
};
use glam::{DAffine3, DMat3, DVec3};

const CLASSES: [&str; 14] = [
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
    "uv",
];

/// Both kinds of texture at once: a float texture is a colour texture of which one channel is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Value {
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
    fn add_texture(&mut self, texture: Texture) -> TextureId {
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
    fn value(&mut self, texture: Texture, float: bool, channel: Channel) -> Value {
        let id = self.add_texture(texture);
        if float {
            Value::Float(FloatTex::Texture(id, channel))
        } else {
            Value::Color(ColorTex::Texture(id))
        }
    }

    /// The channel that stands for the result of combining float textures.
    fn common_channel(&mut self, params: &Params, inputs: &[Value]) -> Channel {
        let mut channels = inputs.iter().filter_map(|v| v.channel());
        let first = channels.next();
        if let Some(first) = first
            && channels.any(|c| c != first)
        {
            self.cx.warn(&params.place, "float textures of pictures with and without alpha are combined: all use the same channel");
        }
        first.unwrap_or(Channel::R)
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
                let channel = a.channel().unwrap_or(Channel::R);
                Ok(self.value(
                    Texture::Scale {
                        a: a.color(),
                        b: FloatOrColor::Float(scale),
                    },
                    float,
                    channel,
                ))
            }
            "mix" | "directionmix" => {
                let a = self.input(params, "tex1", 0.0, float)?;
                let b = self.input(params, "tex2", 1.0, float)?;
                let amount = if class == "mix" {
                    self.float_tex(params, "amount")?
                        .unwrap_or(FloatTex::Const(0.5))
                } else {
                    params.ignore(&["dir"]);
                    self.cx.warn(
                        &params.place,
                        "texture \"directionmix\" becomes an even mix",
                    );
                    FloatTex::Const(0.5)
                };
                if a == b {
                    return Ok(a);
                }
                let channel = self.common_channel(params, &[a, b]);
                Ok(self.value(
                    Texture::Mix {
                        a: a.color(),
                        b: b.color(),
                        amount,
                    },
                    float,
                    channel,
                ))
            }
            "checkerboard" => {
                let a = self.input(params, "tex1", 1.0, float)?;
                let b = self.input(params, "tex2", 0.0, float)?;
                let map = match params.count("dimension", 2, 2..=3)? {
                    2 => self.map_2d(params)?,
                    _ => UvMap::Planar {
                        matrix: self.texture_space(params)?,
                    },
                };
                let channel = self.common_channel(params, &[a, b]);
                Ok(self.value(
                    Texture::Checkerboard {
                        map,
                        even: a.color(),
                        odd: b.color(),
                    },
                    float,
                    channel,
                ))
            }
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
            other if CLASSES.contains(&other) => {
                let (value, instead): (Rgb, _) = match other {
                    "dots" => {
                        let outside = self.input(params, "outside", 0.0, float)?;
                        let inside = self.input(params, "inside", 1.0, float)?;
                        params.ignore(&[
                            "mapping", "uscale", "vscale", "udelta", "vdelta", "v1", "v2",
                        ]);
                        self.cx.warn(
                            &params.place,
                            "texture \"dots\" is not supported: its two parts are mixed evenly",
                        );
                        let channel = self.common_channel(params, &[inside, outside]);
                        let (a, b) = (outside.color(), inside.color());
                        return Ok(self.value(
                            Texture::Mix {
                                a,
                                b,
                                amount: FloatTex::Const(0.5),
                            },
                            float,
                            channel,
                        ));
                    }
                    "marble" => ([0.5, 0.45, 0.4], "grey"),
                    "ptex" => ([0.5; 3], "grey"),
                    _ => ([0.5; 3], "its mean, 0.5"),
                };
                params.ignore(&[
                    "octaves",
                    "roughness",
                    "scale",
                    "variation",
                    "filename",
                    "encoding",
                    "mapping",
                    "uscale",
                    "vscale",
                    "udelta",
                    "vdelta",
                    "v1",
                    "v2",
                ]);
                self.cx.warn(
                    &params.place,
                    format!("texture {other:?} is not supported: {instead} stands in"),
                );
                Ok(if float {
                    Value::Float(FloatTex::Const(value[0]))
                } else {
                    Value::Color(ColorTex::Const(value))
                })
            }
            other => {
                let near = crate::suggest::did_you_mean(other, CLASSES);
                params.fail(format!("unknown texture {other:?}{near}"))
            }
        }
    }

    fn imagemap(&mut self, params: &Params, float: bool) -> Result<Value, Issue> {
        let Some(name) = params.text_opt("filename")? else {
            return params.fail("an imagemap needs a \"filename\"");
        };
        let map = self.map_2d(params)?;
        let nearest = match params.text("filter", "bilinear")? {
            "point" => true,
            "bilinear" | "trilinear" | "ewa" | "EWA" => false,
            other => {
                return params.fail(format!(
                    "unknown filter {other:?}; there are point, bilinear, trilinear, ewa"
                ));
            }
        };
        params.ignore(&["maxanisotropy"]);
        let wrap = match params.text("wrap", "repeat")? {
            "repeat" => Wrap::Repeat,
            "clamp" => Wrap::Clamp,
            "black" => Wrap::Black,
            "octahedralsphere" => {
                self.cx.warn(
                    &params.place,
                    "wrap \"octahedralsphere\" is not supported: \"clamp\" is used",
                );
                Wrap::Clamp
            }
            other => {
                return params.fail(format!(
                    "unknown wrap {other:?}; there are repeat, clamp, black"
                ));
            }
        };
        let scale = params.float("scale", 1.0)? as f32;
        let invert = params.bool("invert", false)?;
        let encoding = self.encoding(params, name)?;
        let image = self.cx.image(&params.place, name, encoding)?;
        let channel = self.float_channel(image);
        // pbrt scales first and inverts then, we the other way round: 1 - s v = (1 - s) 1 + s (1 - v).
        let split = invert && scale != 1.0;
        let factor = if split { 1.0 } else { scale };
        let texture = Texture::Image {
            image,
            map,
            wrap: (wrap, wrap),
            nearest,
            invert,
            scale: [factor; 4],
        };
        if !split {
            return Ok(self.value(texture, float, channel));
        }
        let inverted = self.add_texture(texture);
        let mix = Texture::Mix {
            a: ColorTex::Const([1.0; 3]),
            b: ColorTex::Texture(inverted),
            amount: FloatTex::Const(scale),
        };
        Ok(self.value(mix, float, channel))
    }

    /// What a float texture takes from a picture: alpha where there is one, else the mean.
    fn float_channel(&self, image: ImageId) -> Channel {
        match self.cx.info(image).map(|info| info.channels) {
            Some(1) => Channel::R,
            Some(2 | 4) => Channel::A,
            _ => Channel::Mean,
        }
    }

    fn encoding(&mut self, params: &Params, name: &str) -> Result<Encoding, Issue> {
        let Some(text) = params.text_opt("encoding")? else {
            return Ok(Encoding::Auto);
        };
        let ending = name
            .rsplit_once('.')
            .map(|(_, e)| e.to_ascii_lowercase())
            .unwrap_or_default();
        if ending != "png" {
            if text != "sRGB" && matches!(ending.as_str(), "tga" | "jpg" | "jpeg") {
                self.cx.warn(
                    &params.place,
                    format!(
                        "\"encoding\" has no effect on {ending} pictures, as in pbrt: they are sRGB"
                    ),
                );
            }
            return Ok(Encoding::Auto);
        }
        if let Some(gamma) = text.strip_prefix("gamma ") {
            return match gamma.trim().parse::<f64>() {
                Ok(gamma) if (0.01..=100.0).contains(&gamma) => {
                    Ok(Encoding::GammaMicros(libm::round(gamma * 1e6) as u32))
                }
                _ => params.fail(format!("{text:?} is no encoding")),
            };
        }
        match text {
            "sRGB" => Ok(Encoding::Srgb),
            "linear" => Ok(Encoding::Linear),
            other => params.fail(format!(
                "unknown encoding {other:?}; there are sRGB, linear and \"gamma 2.2\""
            )),
        }
    }

    /// World to texture: the inverse of the matrix at the definition.
    fn texture_space(&self, params: &Params) -> Result<DAffine3, Issue> {
        let placed =
            matrix::affine(&self.graphics.ctm[0]).map_err(|e| Issue::new(&params.place, e))?;
        Ok(placed.inverse())
    }

    fn map_2d(&mut self, params: &Params) -> Result<UvMap, Issue> {
        let (du, dv) = (params.float("udelta", 0.0)?, params.float("vdelta", 0.0)?);
        match params.text("mapping", "uv")? {
            "planar" => {
                let v1 = DVec3::from_array(params.vector("v1", Kind::Vector3, [1.0, 0.0, 0.0])?);
                let v2 = DVec3::from_array(params.vector("v2", Kind::Vector3, [0.0, 1.0, 0.0])?);
                // The third row is zero, so that a checkerboard does not become solid.
                let rows = DMat3::from_cols(v1, v2, DVec3::ZERO).transpose();
                let plane = DAffine3::from_mat3_translation(rows, DVec3::new(du, dv, 0.0));
                Ok(UvMap::Planar {
                    matrix: plane * self.texture_space(params)?,
                })
            }
            mapping => {
                let (su, sv) = (params.float("uscale", 1.0)?, params.float("vscale", 1.0)?);
                match mapping {
                    "uv" => {}
                    "spherical" | "cylindrical" => {
                        self.cx.warn(&params.place, format!("mapping {mapping:?} is not supported: the surface's own uv are used"));
                    }
                    other => {
                        return params.fail(format!(
                            "unknown mapping {other:?}; there are uv and planar"
                        ));
                    }
                }
                Ok(UvMap::Uv {
                    set: 0,
                    matrix: [su, 0.0, du, 0.0, sv, dv],
                })
            }
        }
    }

    /// The picture of a normal map, which is linear whatever the file says.
    pub(super) fn normal_map(&mut self, param: &Param) -> Result<TextureId, Issue> {
        let image = self
            .cx
            .image(&param.place, param.text()?, Encoding::Linear)?;
        Ok(self.add_texture(Texture::Image {
            image,
            map: UvMap::default(),
            wrap: (Wrap::Repeat, Wrap::Repeat),
            nearest: false,
            invert: false,
            scale: [1.0; 4],
        }))
    }
}
