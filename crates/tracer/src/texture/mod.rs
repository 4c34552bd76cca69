//! Textures: functions from a point on a surface to four numbers.

mod decode;
pub mod image;
mod mapping;
mod mip;
mod pattern;
mod pool;

use crate::geometry::TriMesh;
use crate::math::Rgb;
use crate::{PrepareError, StopFlag};
use glam::{DVec3, Vec2, Vec3};
use image::Image;
use mapping::locate;
pub(crate) use pool::{PictureFacts, Pool, Wanted};
use scene::AssetSource;
use scene::model::{Channel, ColorTex, FloatOrColor, FloatTex, ImageDesc, Texture, TextureId};
use std::sync::{Arc, OnceLock};

/// What textures may depend on.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Texture coordinates of the first two sets.
    pub uv: [Vec2; 2],
    /// World position.
    pub p: Vec3,
    /// Geometric normal in the world, unit length.
    pub n: Vec3,
    /// Vertex colour.
    pub color: [f32; 4],
    /// What the pixel covers here.
    pub footprint: Footprint,
}

/// Where the point would be if the ray had gone through a place nearby in the picture: two offsets
/// that span an ellipse. Zero where nobody needs them; then pictures are read as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Footprint {
    /// Offsets of the position, world space.
    pub dp: [Vec3; 2],
    /// Offsets of the texture coordinates of the first set.
    pub duv: [Vec2; 2],
}

impl Default for Point {
    fn default() -> Self {
        Point::NONE
    }
}

impl Point {
    /// Nowhere.
    pub const NONE: Point = Point {
        uv: [Vec2::ZERO; 2],
        p: Vec3::ZERO,
        n: Vec3::Z,
        color: [1.0; 4],
        footprint: Footprint {
            dp: [Vec3::ZERO; 2],
            duv: [Vec2::ZERO; 2],
        },
    };

    /// Interpolates the coordinates and colours of a triangle. Without coordinates the corners have
    /// (0, 0), (1, 0), (1, 1), as in pbrt.
    #[inline]
    pub fn fill(&mut self, mesh: &TriMesh, triangle: u32, u: f32, v: f32) {
        let w = 1.0 - u - v;
        self.uv[0] = match mesh.uvs_of(0, triangle) {
            Some([a, b, c]) => a * w + b * u + c * v,
            None => Vec2::new(u + v, v),
        };
        self.uv[1] = self.uv[0];
        if let Some([a, b, c]) = mesh.uvs_of(1, triangle) {
            self.uv[1] = a * w + b * u + c * v;
        }
        if !mesh.colors.is_empty() {
            let [a, b, c] = mesh.indices[triangle as usize].map(|i| mesh.colors[i as usize]);
            self.color = std::array::from_fn(|i| a[i] * w + b[i] * u + c[i] * v);
        }
    }

    /// The point moved by one of the two offsets of the footprint.
    fn moved(&self, axis: usize) -> Point {
        let mut moved = *self;
        moved.p += self.footprint.dp[axis];
        moved.uv = self.uv.map(|uv| uv + self.footprint.duv[axis]);
        moved
    }
}

/// All textures of a scene, and hands on those of its pictures that were looked up through them: what
/// is held here stays in memory until it is refreshed. A unit of work has its own.
#[derive(Default)]
pub struct Textures {
    /// Each refers only to textures before it.
    nodes: Arc<[Texture]>,
    /// The pictures of lights, which stay in memory; for the others only something in their place.
    pub images: Arc<[Image]>,
    /// What is known of each node beforehand.
    facts: Arc<[Facts]>,
    /// Some node asks for the normal.
    pub(crate) directional: bool,
    pool: Arc<Pool>,
    /// By image: what was looked up.
    held: Arc<[OnceLock<Image>]>,
    /// How many pictures the pool had dropped when nothing was held.
    dropped: u64,
}

/// What is known of a node of [`Textures`] beforehand.
#[derive(Clone, Copy, Debug)]
struct Facts {
    /// A picture without a transparent pixel.
    opaque: bool,
    /// The node asks for footprints.
    footprint: bool,
    /// Factor of [`Texture::UnitMean`].
    factor: f32,
}

impl Textures {
    /// Of pictures that are in memory. `nodes` refer to `images` that are there, and to nodes before
    /// them.
    pub fn new(nodes: Vec<Texture>, images: Vec<Image>) -> Textures {
        let known: Vec<_> = images.iter().map(|i| PictureFacts::of(i, true)).collect();
        let stays = vec![true; images.len()];
        Textures::with(nodes, Pool::of_images(images), &known, &stays)
    }

    /// Reads and decodes the pictures, of which as many stay in memory as `budget_bytes` allow, and
    /// those of lights and of `coverage` in any case. `nodes` refer to images that are there, and to
    /// nodes before them.
    pub(crate) fn load(
        nodes: Vec<Texture>,
        images: &[ImageDesc],
        of_lights: &[bool],
        coverage: &[FloatTex],
        budget_bytes: u64,
        assets: &dyn AssetSource,
        stop: &StopFlag,
    ) -> Result<Textures, PrepareError> {
        let mut wanted = vec![Wanted::default(); images.len()];
        let mut in_coverage = vec![false; nodes.len()];
        for value in coverage {
            if let FloatTex::Texture(id, _) = value {
                in_coverage[id.index()] = true;
            }
        }
        // Each refers only to textures before it.
        for (i, node) in nodes.iter().enumerate().rev() {
            if in_coverage[i] {
                refer(node, &mut |id| in_coverage[id.index()] = true);
            }
        }
        for (i, node) in nodes.iter().enumerate() {
            match node {
                // A pyramid is only built for pictures that some texture looks up over an area.
                Texture::Image { image, mip, .. } => {
                    wanted[image.index()].filtered |= mip.is_some();
                    wanted[image.index()].stays |= in_coverage[i];
                }
                Texture::UnitMean { texture } => {
                    if let Texture::Image { image, .. } = &nodes[texture.index()] {
                        wanted[image.index()].mean = true;
                    }
                }
                _ => {}
            }
        }
        for (wanted, of_light) in wanted.iter_mut().zip(of_lights) {
            wanted.stays |= of_light;
        }
        let (pool, known) = Pool::load(images, &wanted, budget_bytes, assets, stop)?;
        Ok(Textures::with(nodes, pool, &known, of_lights))
    }

    /// Works out what is needed beforehand.
    fn with(
        nodes: Vec<Texture>,
        pool: Pool,
        known: &[PictureFacts],
        of_lights: &[bool],
    ) -> Textures {
        let mut facts: Vec<Facts> = Vec::with_capacity(nodes.len());
        for node in &nodes {
            let footprint = matches!(node, Texture::Image { mip: Some(_), .. });
            let opaque = match node {
                Texture::Image { image, .. } => known[image.index()].opaque,
                _ => false,
            };
            let factor = match node {
                Texture::UnitMean { texture } => match &nodes[texture.index()] {
                    Texture::Image { image, .. } => {
                        let mean = known[image.index()].mean;
                        if mean > 0.0 { (1.0 / mean) as f32 } else { 0.0 }
                    }
                    _ => 1.0,
                },
                _ => 1.0,
            };
            facts.push(Facts {
                opaque,
                footprint,
                factor,
            });
        }
        let directional = nodes
            .iter()
            .any(|node| matches!(node, Texture::DirectionMix { .. }));
        let nothing = Image::stand_in();
        let image = |(i, of_light): (usize, &bool)| {
            if *of_light {
                pool.get(i)
            } else {
                nothing.clone()
            }
        };
        Textures {
            nodes: nodes.into(),
            images: of_lights.iter().enumerate().map(image).collect(),
            facts: facts.into(),
            directional,
            held: none_held(known.len()),
            dropped: pool.dropped(),
            pool: Arc::new(pool),
        }
    }

    /// The same textures, holding nothing yet.
    pub(crate) fn view(&self) -> Textures {
        let complete = self.pool.is_complete();
        Textures {
            nodes: self.nodes.clone(),
            images: self.images.clone(),
            facts: self.facts.clone(),
            directional: self.directional,
            pool: self.pool.clone(),
            // What is there to stay may be held in common.
            held: if complete {
                self.held.clone()
            } else {
                none_held(self.held.len())
            },
            dropped: self.pool.dropped(),
        }
    }

    /// Lets go of all pictures if others had to be dropped meanwhile, so that their memory is free.
    #[inline]
    pub(crate) fn refresh(&mut self) {
        let dropped = self.pool.dropped();
        if dropped != self.dropped {
            self.dropped = dropped;
            self.held = none_held(self.held.len());
        }
    }

    /// A picture; decoded first if it is not in memory.
    #[inline]
    fn picture(&self, image: usize) -> &Image {
        self.held[image].get_or_init(|| self.pool.get(image))
    }

    /// Whether some texture makes use of footprints.
    pub fn any_footprint(&self) -> bool {
        self.facts.iter().any(|f| f.footprint)
    }

    /// Four numbers at a point.
    pub fn eval(&self, index: usize, at: &Point) -> [f32; 4] {
        match &self.nodes[index] {
            Texture::Constant { value } => *value,
            Texture::Image {
                image,
                map,
                wrap,
                nearest,
                mip,
                invert,
                scale,
            } => {
                let st = locate(map, at);
                let image = self.picture(image.index());
                let mut texel = match mip {
                    Some(filter) if at.footprint != Footprint::default() => {
                        let axes = [0, 1].map(|i| mapping::offset(map, st, &at.moved(i)));
                        image.filtered(st, axes, *wrap, *filter)
                    }
                    _ => image.lookup(st, *wrap, *nearest),
                };
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
                self.mixed(a, b, t, at)
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
                [if self.float(value, at) >= *bound {
                    1.0
                } else {
                    0.0
                }; 4]
            }
            Texture::Checkerboard3d { matrix, even, odd } => {
                let p = matrix.transform_point3(wide(at.p));
                let cell = (p.x.floor() as i64)
                    .wrapping_add(p.y.floor() as i64)
                    .wrapping_add(p.z.floor() as i64);
                self.rgba(if cell & 1 == 0 { even } else { odd }, at)
            }
            Texture::Dots {
                map,
                inside,
                outside,
            } => {
                let on = pattern::on_dot(locate(map, at));
                self.rgba(if on { inside } else { outside }, at)
            }
            Texture::Noise { matrix, pattern } => {
                pattern::noise(pattern, matrix.transform_point3(wide(at.p)))
            }
            Texture::DirectionMix { a, b, direction } => {
                let facing = wide(at.n).dot(*direction).abs().min(1.0) as f32;
                self.mixed(b, a, facing, at)
            }
            Texture::Grey { value } => {
                let v = self.float(value, at);
                [v, v, v, 1.0]
            }
            Texture::UnitMean { texture } => {
                let factor = self.facts[index].factor;
                let [r, g, b, a] = self.eval(texture.index(), at);
                [r * factor, g * factor, b * factor, a]
            }
        }
    }

    fn mixed(&self, a: &ColorTex, b: &ColorTex, t: f32, at: &Point) -> [f32; 4] {
        let (a, b) = (self.rgba(a, at), self.rgba(b, at));
        std::array::from_fn(|i| a[i] * (1.0 - t) + b[i] * t)
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
                    Channel::AlphaOrMean if !self.facts[id.index()].opaque => a,
                    Channel::Mean | Channel::AlphaOrMean => (r + g + b) * (1.0 / 3.0),
                }
            }
        }
    }

    /// Memory held by the pictures, those that share their pixels counted once.
    pub fn memory_bytes(&self) -> usize {
        self.pool.memory_bytes()
    }
}

fn none_held(count: usize) -> Arc<[OnceLock<Image>]> {
    (0..count).map(|_| OnceLock::new()).collect()
}

/// Tells which textures a texture refers to.
fn refer(node: &Texture, tell: &mut impl FnMut(TextureId)) {
    let mut float = |t: &FloatTex| {
        if let FloatTex::Texture(id, _) = t {
            tell(*id);
        }
    };
    match node {
        Texture::Constant { .. }
        | Texture::Image { .. }
        | Texture::Bilerp { .. }
        | Texture::VertexColor
        | Texture::Noise { .. } => return,
        Texture::Threshold { value, .. } | Texture::Grey { value } => return float(value),
        Texture::Mix { amount, .. } => float(amount),
        Texture::Scale {
            b: FloatOrColor::Float(b),
            ..
        } => float(b),
        Texture::UnitMean { texture } => return tell(*texture),
        _ => {}
    }
    let mut color = |t: &ColorTex| {
        if let ColorTex::Texture(id) = t {
            tell(*id);
        }
    };
    match node {
        Texture::Checkerboard {
            even: a, odd: b, ..
        }
        | Texture::Checkerboard3d {
            even: a, odd: b, ..
        }
        | Texture::Dots {
            inside: a,
            outside: b,
            ..
        }
        | Texture::Mix { a, b, .. }
        | Texture::DirectionMix { a, b, .. } => {
            color(a);
            color(b);
        }
        Texture::Scale { a, b } => {
            color(a);
            if let FloatOrColor::Color(b) = b {
                color(b);
            }
        }
        _ => {}
    }
}

/// In double precision.
fn wide(p: Vec3) -> DVec3 {
    DVec3::new(p.x as f64, p.y as f64, p.z as f64)
}

#[cfg(test)]
mod tests;
