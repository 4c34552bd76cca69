//! Texture "imagemap", and the mappings that all textures share.

use super::params::{Kind, Param, Params};
use super::textures::Value;
use super::{Importer, matrix};
use crate::context::Issue;
use crate::model::{
    Channel, ColorTex, Encoding, FloatTex, ImageId, MipFilter, Texture, TextureId, UvMap, Wrap,
};
use glam::{DAffine3, DMat3, DVec3};

impl Importer<'_, '_> {
    pub(super) fn imagemap(&mut self, params: &Params, float: bool) -> Result<Value, Issue> {
        let Some(name) = params.text_opt("filename")? else {
            return params.fail("an imagemap needs a \"filename\"");
        };
        let map = self.map_2d(params)?;
        let (nearest, mip) = match params.text("filter", "bilinear")? {
            "point" => (true, None),
            "bilinear" => (false, None),
            "trilinear" => (false, Some(MipFilter::Trilinear)),
            "ewa" | "EWA" => {
                let max_anisotropy = params.float("maxanisotropy", 8.0)?;
                if !(1.0..=1000.0).contains(&max_anisotropy) {
                    return params.fail(format!(
                        "an anisotropy of {max_anisotropy}; 1 to 1000 are possible"
                    ));
                }
                let max_anisotropy = max_anisotropy as f32;
                (false, Some(MipFilter::Ewa { max_anisotropy }))
            }
            other => {
                return params.fail(format!(
                    "unknown filter {other:?}; there are point, bilinear, trilinear, ewa"
                ));
            }
        };
        if mip.is_none() {
            params.ignore(&["maxanisotropy"]);
        }
        let wrap = match params.text("wrap", "repeat")? {
            "repeat" => Wrap::Repeat,
            "clamp" => Wrap::Clamp,
            "black" => Wrap::Black,
            "octahedralsphere" => Wrap::Octahedral,
            other => {
                return params.fail(format!(
                    "unknown wrap {other:?}; there are repeat, clamp, black, octahedralsphere"
                ));
            }
        };
        let scale = params.float("scale", 1.0)? as f32;
        let invert = params.bool("invert", false)?;
        let encoding = self.encoding(params, name)?;
        let image = self.cx.image(&params.place, name, encoding)?;
        let channel = self.float_channel(image);
        if float && invert {
            // 1 - s v, whichever channel v is: the model's own inversion leaves alpha alone.
            let id = self.add_texture(Texture::Image {
                image,
                map,
                wrap: (wrap, wrap),
                nearest,
                mip,
                invert: false,
                scale: [scale; 4],
            });
            let mix = Texture::Mix {
                a: ColorTex::Const([1.0; 3]),
                b: ColorTex::Const([0.0; 3]),
                amount: FloatTex::Texture(id, channel),
            };
            return Ok(self.value(mix, float, Channel::R));
        }
        // pbrt scales first and inverts then, we the other way round: 1 - s v = (1 - s) 1 + s (1 - v).
        let split = invert && scale != 1.0;
        let factor = if split { 1.0 } else { scale };
        let texture = Texture::Image {
            image,
            map,
            wrap: (wrap, wrap),
            nearest,
            mip,
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

    /// What a float texture takes from a picture: alpha where there is one that says something, else
    /// the mean.
    fn float_channel(&self, image: ImageId) -> Channel {
        match self.cx.info(image).map(|info| info.channels) {
            Some(1) => Channel::R,
            Some(2 | 4) => Channel::AlphaOrMean,
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
            let fixed = match ending.as_str() {
                "tga" | "jpg" | "jpeg" => "sRGB",
                _ => "linear",
            };
            if text != fixed {
                self.cx.warn(
                    &params.place,
                    format!(
                        "\"encoding\" has no effect on {ending} pictures, as in pbrt: they are {fixed}"
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
    pub(super) fn texture_space(&self, params: &Params) -> Result<DAffine3, Issue> {
        let placed =
            matrix::affine(&self.graphics.ctm[0]).map_err(|e| Issue::new(&params.place, e))?;
        Ok(placed.inverse())
    }

    pub(super) fn map_2d(&mut self, params: &Params) -> Result<UvMap, Issue> {
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
            "spherical" => Ok(UvMap::Spherical {
                matrix: self.texture_space(params)?,
            }),
            "cylindrical" => Ok(UvMap::Cylindrical {
                matrix: self.texture_space(params)?,
            }),
            "uv" => {
                let (su, sv) = (params.float("uscale", 1.0)?, params.float("vscale", 1.0)?);
                Ok(UvMap::Uv {
                    set: 0,
                    matrix: [su, 0.0, du, 0.0, sv, dv],
                })
            }
            other => params.fail(format!(
                "unknown mapping {other:?}; there are uv, planar, spherical, cylindrical"
            )),
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
            mip: None,
            invert: false,
            scale: [1.0; 4],
        }))
    }
}
