//! Textures, samplers and pictures. What a material asks for becomes a node of the scene's texture
//! list; equal nodes are made once.

use super::Gltf;
use super::tangents::PLAIN;
use super::tree::At;
use super::uri::{self, Uri};
use crate::assets::AssetBytes;
use crate::context::Issue;
use crate::model::{Encoding, ImageId, Texture, TextureId, UvMap, Wrap};

/// What a material's texture property says.
pub(super) struct Info<'j> {
    /// The property.
    pub at: At<'j>,
    texture: usize,
    /// Which TEXCOORD.
    pub set: u32,
    /// In our convention: (0, 0) is the bottom left.
    pub matrix: [f64; 6],
}

/// KHR_texture_transform on coordinates whose v points up. In glTF's own, with v down, the extension
/// says u' = c su u + s sv v + ou, v' = -s su u + c sv v + ov for the sine and cosine of the rotation.
fn matrix(offset: [f64; 2], rotation: f64, scale: [f64; 2]) -> [f64; 6] {
    let (s, c) = (libm::sin(rotation), libm::cos(rotation));
    let ([su, sv], [ou, ov]) = (scale, offset);
    // v = 1 - V before, V' = 1 - v' after.
    [
        c * su,
        -s * sv,
        s * sv + ou,
        s * su,
        c * sv,
        1.0 - c * sv - ov,
    ]
}

/// The edge behaviour and filter of a sampler.
#[derive(Clone, Copy)]
struct Sampler {
    wrap: (Wrap, Wrap),
    nearest: bool,
}

impl<'j> Gltf<'_, '_, 'j> {
    /// A texture property of a material, if it is there.
    pub(super) fn texture_info(
        &mut self,
        owner: &At<'j>,
        name: &str,
        extra: &[&str],
    ) -> Result<Option<Info<'j>>, Issue> {
        let Some(at) = owner.get(name) else {
            return Ok(None);
        };
        let mut known = super::properties::TEXTURE_INFO.to_vec();
        known.extend(extra);
        at.only(&known, self.cx)?;
        let texture = at.need("index")?.as_index(&self.root, "textures")?;
        let mut set = at.integer_or("texCoord", 0)?;
        let mut map = PLAIN;
        self.known_extensions(&at, &["KHR_texture_transform"])?;
        if let Some(transform) = at.extension("KHR_texture_transform") {
            transform.only(super::properties::TEXTURE_TRANSFORM, self.cx)?;
            let offset = transform.numbers("offset")?.unwrap_or([0.0; 2]);
            let scale = transform.numbers("scale")?.unwrap_or([1.0; 2]);
            let rotation = transform.number_or("rotation", 0.0)?;
            set = transform.integer_or("texCoord", set)?;
            if offset != [0.0; 2] || scale != [1.0; 2] || rotation != 0.0 {
                map = matrix(offset, rotation, scale);
            }
        }
        let set = u32::try_from(set).map_err(|_| at.fail("a texCoord beyond all bounds"))?;
        Ok(Some(Info {
            at,
            texture,
            set,
            matrix: map,
        }))
    }

    /// The node of a texture: `set` counts among the sets that the mesh keeps, `scale` multiplies.
    pub(super) fn image_node(
        &mut self,
        info: &Info<'j>,
        set: u32,
        encoding: Encoding,
        scale: [f32; 4],
    ) -> Result<Option<TextureId>, Issue> {
        let at = self.list_item("textures", info.texture)?;
        at.only(super::properties::TEXTURE, self.cx)?;
        let sampler = self.sampler(&at)?;
        let Some(image) = self.source(&at, &info.at, encoding)? else {
            return Ok(None);
        };
        self.node(Texture::Image {
            mip: None,
            image,
            map: UvMap::Uv {
                set,
                matrix: info.matrix,
            },
            wrap: sampler.wrap,
            nearest: sampler.nearest,
            invert: false,
            scale,
        })
        .map(Some)
    }

    /// Adds a node, or finds the same.
    pub(super) fn node(&mut self, texture: Texture) -> Result<TextureId, Issue> {
        // Debug output of floats is exact: different numbers look different.
        let key = format!("{texture:?}");
        if let Some(&id) = self.texture_ids.get(&key) {
            return Ok(id);
        }
        self.cx.charge(&self.root.place(), 512)?;
        let id = TextureId(self.textures.len() as u32);
        self.textures.push(texture);
        self.texture_ids.insert(key, id);
        Ok(id)
    }

    fn sampler(&mut self, texture: &At<'j>) -> Result<Sampler, Issue> {
        let Some(index) = texture.index("sampler", &self.root, "samplers")? else {
            return Ok(Sampler {
                wrap: (Wrap::Repeat, Wrap::Repeat),
                nearest: false,
            });
        };
        let at = self.list_item("samplers", index)?;
        at.only(super::properties::SAMPLER, self.cx)?;
        let wrap = |name: &str| match at.get(name) {
            None => Ok(Wrap::Repeat),
            Some(value) => match value.integer()? {
                10497 => Ok(Wrap::Repeat),
                33071 => Ok(Wrap::Clamp),
                33648 => Ok(Wrap::Mirror),
                other => Err(value.fail(format!("unknown wrapping mode {other}"))),
            },
        };
        let nearest = match at.get("magFilter") {
            None => false,
            Some(value) => match value.integer()? {
                9728 => true,
                9729 => false,
                other => return Err(value.fail(format!("unknown filter {other}"))),
            },
        };
        // The other filter is about pyramids of smaller pictures, for which many samples stand in.
        if let Some(value) = at.get("minFilter")
            && !matches!(value.integer()?, 9728 | 9729 | 9984..=9987)
        {
            return Err(value.fail(format!("unknown filter {}", value.integer()?)));
        }
        Ok(Sampler {
            wrap: (wrap("wrapS")?, wrap("wrapT")?),
            nearest,
        })
    }

    /// The picture that a texture shows; its extensions name other kinds of files.
    fn source(
        &mut self,
        texture: &At<'j>,
        user: &At<'j>,
        encoding: Encoding,
    ) -> Result<Option<ImageId>, Issue> {
        self.known_extensions(texture, &["EXT_texture_webp", "KHR_texture_basisu"])?;
        let webp = texture.extension("EXT_texture_webp");
        let inner = webp.as_ref().unwrap_or(texture);
        if let Some(index) = inner.index("source", &self.root, "images")? {
            return self.image(index, encoding).map(Some);
        }
        if let Some(basis) = texture.extension("KHR_texture_basisu")
            && let Some(index) = basis.index("source", &self.root, "images")?
        {
            return self.image(index, encoding).map(Some);
        }
        self.cx.warn(
            &user.place(),
            "a texture without a picture; the factors alone are used",
        );
        Ok(None)
    }

    fn image(&mut self, index: usize, encoding: Encoding) -> Result<ImageId, Issue> {
        let at = self.list_item("images", index)?;
        at.only(super::properties::IMAGE, self.cx)?;
        let label = format!("{}#{}", self.file, at.pointer);
        match (
            at.get("uri"),
            at.index("bufferView", &self.root, "bufferViews")?,
        ) {
            (Some(_), Some(_)) => Err(at.fail("a picture with both \"uri\" and \"bufferView\"")),
            (None, None) => Err(at.fail("a picture without \"uri\" and without \"bufferView\"")),
            (None, Some(view)) if self.buffers.is_missing(&self.root, view, self.cx)? => {
                Ok(self.cx.missing_image(&label, encoding))
            }
            (None, Some(view)) => {
                let view = self.buffers.view(&self.root, view, self.cx)?;
                let bytes = AssetBytes::from(view.data.bytes());
                self.cx.image_bytes(&at.place(), &label, bytes, encoding)
            }
            (Some(uri), None) => match uri::parse(uri.text()?).map_err(|e| uri.fail(e))? {
                Uri::Data(bytes) => {
                    let bytes = AssetBytes::from(bytes);
                    self.cx.image_bytes(&at.place(), &label, bytes, encoding)
                }
                Uri::File(name) => self.cx.image(&uri.place(), &name, encoding),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The extension's own formula, v down.
    fn reference(u: f64, v: f64, o: [f64; 2], r: f64, k: [f64; 2]) -> (f64, f64) {
        let (s, c) = (libm::sin(r), libm::cos(r));
        let (u, v) = (k[0] * u, k[1] * v);
        (c * u + s * v + o[0], -s * u + c * v + o[1])
    }

    #[test]
    fn transforms_are_those_of_the_extension_with_v_turned_round() {
        for (offset, rotation, scale) in [
            ([0.0, 0.0], 0.0, [1.0, 1.0]),
            ([0.25, 0.5], 0.0, [1.0, 1.0]),
            ([0.0, 0.0], 0.7, [1.0, 1.0]),
            ([0.705, 0.285], std::f64::consts::FRAC_PI_2, [0.35, 0.35]),
            ([0.1, -0.2], -2.0, [3.0, -0.5]),
        ] {
            let m = matrix(offset, rotation, scale);
            for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.3, 0.8)] {
                let (ru, rv) = reference(u, v, offset, rotation, scale);
                let up = 1.0 - v;
                let (gu, gv) = (m[0] * u + m[1] * up + m[2], m[3] * u + m[4] * up + m[5]);
                assert!((gu - ru).abs() < 1e-12 && (gv - (1.0 - rv)).abs() < 1e-12);
            }
        }
    }
}
