//! Textures: functions from a point on a surface to four numbers.

pub mod image;

use crate::geometry::TriMesh;
use crate::math::Rgb;
use glam::{DVec3, Vec2, Vec3};
use image::Image;
use scene::model::{Channel, ColorTex, FloatOrColor, FloatTex, Texture, UvMap, Wrap};

/// What textures may depend on.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Texture coordinates of the first two sets.
    pub uv: [Vec2; 2],
    /// World position.
    pub p: Vec3,
    /// Vertex colour.
    pub color: [f32; 4],
}

impl Default for Point {
    fn default() -> Self {
        Point {
            uv: [Vec2::ZERO; 2],
            p: Vec3::ZERO,
            color: [1.0; 4],
        }
    }
}

impl Point {
    /// Interpolates the coordinates and colours of a triangle. Without coordinates the corners have
    /// (0, 0), (1, 0), (1, 1), as in pbrt.
    #[inline]
    pub fn fill(&mut self, mesh: &TriMesh, triangle: u32, u: f32, v: f32) {
        let [a, b, c] = mesh.indices[triangle as usize].map(|i| i as usize);
        let w = 1.0 - u - v;
        match mesh.uvs.first() {
            Some(set) => self.uv[0] = set[a] * w + set[b] * u + set[c] * v,
            None => self.uv[0] = Vec2::new(u + v, v),
        }
        self.uv[1] = self.uv[0];
        if let Some(set) = mesh.uvs.get(1) {
            self.uv[1] = set[a] * w + set[b] * u + set[c] * v;
        }
        if !mesh.colors.is_empty() {
            let (a, b, c) = (mesh.colors[a], mesh.colors[b], mesh.colors[c]);
            self.color = std::array::from_fn(|i| a[i] * w + b[i] * u + c[i] * v);
        }
    }
}

/// All textures and pictures of a scene.
#[derive(Default)]
pub struct Textures {
    /// Each refers only to textures before it.
    pub nodes: Vec<Texture>,
    /// Decoded pictures.
    pub images: Vec<Image>,
}

impl Textures {
    /// Four numbers at a point.
    pub fn eval(&self, index: usize, at: &Point) -> [f32; 4] {
        match &self.nodes[index] {
            Texture::Constant { value } => *value,
            Texture::Image {
                image,
                map,
                wrap,
                nearest,
                invert,
                scale,
            } => {
                let st = locate(map, at);
                let mut texel = self.images[image.index()].lookup(st, *wrap, *nearest);
                for c in 0..4 {
                    if *invert && c < 3 {
                        texel[c] = (1.0 - texel[c]).max(0.0);
                    }
                    texel[c] *= scale[c];
                }
                texel
            }
            Texture::Checkerboard { map, even, odd } => {
                let st = locate(map, at);
                let cell = st.x.floor() as i64 + st.y.floor() as i64;
                self.rgba(if cell & 1 == 0 { even } else { odd }, at)
            }
            Texture::Scale { a, b } => {
                let a = self.rgba(a, at);
                let b = match b {
                    FloatOrColor::Float(f) => [self.float(f, at); 4],
                    FloatOrColor::Color(c) => self.rgba(c, at),
                };
                std::array::from_fn(|i| a[i] * b[i])
            }
            Texture::Mix { a, b, amount } => {
                let t = self.float(amount, at);
                let (a, b) = (self.rgba(a, at), self.rgba(b, at));
                std::array::from_fn(|i| a[i] * (1.0 - t) + b[i] * t)
            }
            Texture::Bilerp { map, corners } => {
                let st = locate(map, at);
                let [v00, v01, v10, v11] = corners.map(Vec3::from_array);
                let v = (v00 * (1.0 - st.y) + v01 * st.y) * (1.0 - st.x)
                    + (v10 * (1.0 - st.y) + v11 * st.y) * st.x;
                [v.x, v.y, v.z, 1.0]
            }
            Texture::VertexColor => at.color,
            Texture::Threshold { value, at: bound } => {
                [if self.float(value, at) >= *bound { 1.0 } else { 0.0 }; 4]
            }
        }
    }

    fn rgba(&self, tex: &ColorTex, at: &Point) -> [f32; 4] {
        match tex {
            ColorTex::Const([r, g, b]) => [*r, *g, *b, 1.0],
            ColorTex::Texture(id) => self.eval(id.index(), at),
        }
    }

    /// A colour at a point.
    #[inline]
    pub fn color(&self, tex: &ColorTex, at: &Point) -> Rgb {
        match tex {
            ColorTex::Const(c) => Rgb::from_array(*c),
            ColorTex::Texture(id) => {
                let [r, g, b, _] = self.eval(id.index(), at);
                Rgb::new(r, g, b)
            }
        }
    }

    /// A number at a point.
    #[inline]
    pub fn float(&self, tex: &FloatTex, at: &Point) -> f32 {
        match tex {
            FloatTex::Const(x) => *x,
            FloatTex::Texture(id, channel) => {
                let [r, g, b, a] = self.eval(id.index(), at);
                match channel {
                    Channel::R => r,
                    Channel::G => g,
                    Channel::B => b,
                    Channel::A => a,
                    Channel::Mean => (r + g + b) * (1.0 / 3.0),
                }
            }
        }
    }

    /// Memory held by the pictures.
    pub fn memory_bytes(&self) -> usize {
        self.images.iter().map(Image::memory_bytes).sum()
    }
}

/// Texture coordinates at a point.
#[inline]
fn locate(map: &UvMap, at: &Point) -> Vec2 {
    match map {
        UvMap::Uv { set, matrix: m } => {
            let uv = at.uv[(*set as usize).min(1)];
            let (u, v) = (uv.x as f64, uv.y as f64);
            Vec2::new(
                (m[0] * u + m[1] * v + m[2]) as f32,
                (m[3] * u + m[4] * v + m[5]) as f32,
            )
        }
        UvMap::Planar { matrix } => {
            let p =
                matrix.transform_point3(DVec3::new(at.p.x as f64, at.p.y as f64, at.p.z as f64));
            Vec2::new(p.x as f32, p.y as f32)
        }
    }
}

/// A pixel index with something done about indices outside.
#[inline]
pub(crate) fn wrapped(i: i64, size: i64, wrap: Wrap) -> Option<usize> {
    let j = match wrap {
        Wrap::Repeat => i.rem_euclid(size),
        Wrap::Clamp => i.clamp(0, size - 1),
        Wrap::Mirror => {
            let k = i.rem_euclid(2 * size);
            if k < size { k } else { 2 * size - 1 - k }
        }
        Wrap::Black => {
            if i < 0 || i >= size {
                return None;
            }
            i
        }
    };
    Some(j as usize)
}
