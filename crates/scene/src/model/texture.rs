//! Pictures and functions over surfaces.

use super::{ImageId, Rgb, TextureId};
use glam::{DAffine3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A picture file.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ImageDesc {
    /// Path inside the scene.
    pub path: String,
    /// How stored numbers become linear ones.
    pub encoding: Encoding,
    /// Missing, and allowed to be: the tracer uses a conspicuous stand-in.
    pub missing: bool,
    /// The file itself, where it lies inside another one (glTF buffers and data URIs) or was made up
    /// by the importer; `path` is then only a label for messages. `None` is a file of the scene.
    pub bytes: Option<Arc<[u8]>>,
}

/// How the stored numbers of a picture become linear ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// sRGB for 8-bit and 16-bit integers, linear for float formats.
    Auto,
    /// sRGB transfer function.
    Srgb,
    /// As they are.
    Linear,
    /// Power function; the exponent is in millionths so that it can be compared.
    GammaMicros(u32),
}

/// What happens outside [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Wrap {
    /// Start again.
    Repeat,
    /// There and back.
    Mirror,
    /// Border pixel.
    Clamp,
    /// Nothing: zero.
    Black,
    /// Across the edges of an equal-area octahedral picture [Clarberg08]; counts for both axes.
    Octahedral,
}

/// How a picture is read where a pixel of the render covers many of its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MipFilter {
    /// Between the two nearest levels of a pyramid of halved pictures [Williams83].
    Trilinear,
    /// An elliptical Gaussian over a level of the pyramid [Heckbert89].
    Ewa {
        /// The ellipse is fattened until its axes differ by no more than this, at least 1.
        max_anisotropy: f32,
    },
}

/// Procedural patterns in space, from gradient noise [Perlin02] with pbrt-v4's gradients. Octaves are
/// never cut off by distance: many samples see what few would alias.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum NoisePattern {
    /// Sum of octaves, about 0.
    Fbm {
        /// Each 1.99 times as fine as the one before.
        octaves: u32,
        /// Factor from one octave to the next.
        roughness: f32,
    },
    /// Sum of the absolute values of octaves, plus 0.2 of the one after the last.
    Wrinkled {
        /// See above.
        octaves: u32,
        /// See above.
        roughness: f32,
    },
    /// Waves whose height follows a slower noise.
    Windy,
    /// Veins: a sine along y, disturbed by noise, through a spline of colours.
    Marble {
        /// See above.
        octaves: u32,
        /// See above.
        roughness: f32,
        /// Of positions, before anything else.
        scale: f32,
        /// How much the noise disturbs.
        variation: f32,
    },
}

/// From surface to texture coordinates.
#[derive(Clone, Debug, PartialEq)]
pub enum UvMap {
    /// A set of the mesh's coordinates through a 2 x 3 matrix: s = m[0] u + m[1] v + m[2],
    /// t = m[3] u + m[4] v + m[5].
    Uv {
        /// Which set of the mesh.
        set: u32,
        /// See above.
        matrix: [f64; 6],
    },
    /// World position through a matrix: planar projection (x, y), with z for solid textures.
    Planar {
        /// World to texture.
        matrix: DAffine3,
    },
    /// Direction from the origin of texture space: s is the angle from +Z over 180 degrees, t the angle
    /// about it from +X over 360.
    Spherical {
        /// World to texture.
        matrix: DAffine3,
    },
    /// Around the z axis of texture space: s is the angle from -X over 360 degrees, t is z.
    Cylindrical {
        /// World to texture.
        matrix: DAffine3,
    },
}

impl Default for UvMap {
    fn default() -> Self {
        UvMap::Uv {
            set: 0,
            matrix: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        }
    }
}

/// A colour that may vary over a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColorTex {
    /// The same everywhere.
    Const(Rgb),
    /// Looked up.
    Texture(TextureId),
}

/// A number that may vary over a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FloatTex {
    /// The same everywhere.
    Const(f32),
    /// Looked up; which number of the texture's four is taken.
    Texture(TextureId, Channel),
}

/// Which number of a texture a float parameter takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Channel {
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
    /// Alpha.
    A,
    /// Mean of red, green, blue.
    Mean,
    /// Alpha, or the mean of red, green, blue where the texture is a picture that is opaque
    /// everywhere: what pbrt-v4 takes from a picture with an alpha channel.
    AlphaOrMean,
}

/// A texture: a function from the surface to RGBA.
#[derive(Clone, Debug, PartialEq)]
pub enum Texture {
    /// The same everywhere.
    Constant {
        /// Value.
        value: [f32; 4],
    },
    /// A picture.
    Image {
        /// Which.
        image: ImageId,
        /// Where.
        map: UvMap,
        /// By axis.
        wrap: (Wrap, Wrap),
        /// Nearest pixel instead of bilinear.
        nearest: bool,
        /// Pyramid, where pixels of the render cover many of the picture; `None` reads the picture as
        /// it is (bilinear, or nearest).
        mip: Option<MipFilter>,
        /// 1 - value for colour channels, applied before `scale`.
        invert: bool,
        /// Factor.
        scale: [f32; 4],
    },
    /// Alternating squares of unit size in texture space.
    Checkerboard {
        /// Where.
        map: UvMap,
        /// Where the sum of the cell's integer coordinates is even.
        even: ColorTex,
        /// Elsewhere.
        odd: ColorTex,
    },
    /// Product, channel by channel.
    Scale {
        /// One.
        a: ColorTex,
        /// The other.
        b: FloatOrColor,
    },
    /// (1 - amount) a + amount b.
    Mix {
        /// Where amount is 0.
        a: ColorTex,
        /// Where amount is 1.
        b: ColorTex,
        /// Weight.
        amount: FloatTex,
    },
    /// Bilinear between four corners of the unit square in texture space.
    Bilerp {
        /// Where.
        map: UvMap,
        /// At (0,0), (0,1), (1,0), (1,1).
        corners: [Rgb; 4],
    },
    /// Interpolated vertex colour; white where the mesh has none.
    VertexColor,
    /// 1 in all four channels where `value` is at least `at`, elsewhere 0 (glTF's alpha masks).
    Threshold {
        /// What is compared.
        value: FloatTex,
        /// With what.
        at: f32,
    },
    /// Alternating cubes of unit size in space.
    Checkerboard3d {
        /// World to texture.
        matrix: DAffine3,
        /// Where the sum of the cell's integer coordinates is even.
        even: ColorTex,
        /// Elsewhere.
        odd: ColorTex,
    },
    /// Dots of radius 0.35, one in about three of eight unit squares of texture space, each moved a
    /// little.
    Dots {
        /// Where.
        map: UvMap,
        /// On the dots.
        inside: ColorTex,
        /// Between them.
        outside: ColorTex,
    },
    /// Gradient noise in space.
    Noise {
        /// World to texture.
        matrix: DAffine3,
        /// Which.
        pattern: NoisePattern,
    },
    /// |n . direction| a + (1 - |n . direction|) b with the geometric normal n.
    DirectionMix {
        /// Where the surface faces the direction.
        a: ColorTex,
        /// Where it is at right angles to it.
        b: ColorTex,
        /// In the world, unit length.
        direction: DVec3,
    },
    /// A number as a grey, alpha 1.
    Grey {
        /// The number.
        value: FloatTex,
    },
    /// A picture divided by the mean luminance of all of its pixels; black stays black.
    UnitMean {
        /// A texture of the kind [`Texture::Image`].
        texture: TextureId,
    },
}

/// Either kind of parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FloatOrColor {
    /// Number.
    Float(FloatTex),
    /// Colour.
    Color(ColorTex),
}
