//! The scene as plain data: flat lists, typed indices, no pointers. Readers fill it, `validate`
//! checks it, the tracer prepares it. Lengths in scene units, angles in degrees, time in seconds,
//! colours linear Rec. 709, right-handed coordinates, everything here in double precision where it
//! is placed and in single precision where it is bulk data.

use glam::{DAffine3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Linear Rec. 709 red, green, blue.
pub type Rgb = [f32; 3];

macro_rules! index {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);
        impl $name {
            /// As an index into the list that it names.
            pub fn index(self) -> usize { self.0 as usize }
        }
    )*};
}
index! {
    /// Index into [`SceneDesc::meshes`].
    MeshId,
    /// Index into [`SceneDesc::images`].
    ImageId,
    /// Index into [`SceneDesc::textures`].
    TextureId,
    /// Index into [`SceneDesc::materials`].
    MaterialId,
    /// Index into [`SceneDesc::groups`].
    GroupId,
    /// Index into [`SceneDesc::media`].
    MediumId,
    /// Index into [`SceneDesc::curves`].
    CurvesId,
}

/// A whole scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneDesc {
    /// The view that is rendered.
    pub camera: Camera,
    /// Picture size, filter, exposure.
    pub film: FilmDesc,
    /// How light is gathered.
    pub integrator: Integrator,
    /// Which points a pixel is sampled at.
    pub sampler: SamplerKind,
    /// Samples per pixel that the file asks for.
    pub spp: Option<u32>,
    /// Animation, if the scene has more than one frame.
    pub animation: Option<Animation>,
    /// Triangle meshes.
    pub meshes: Vec<Mesh>,
    /// Pictures, by path.
    pub images: Vec<ImageDesc>,
    /// Textures; a texture refers only to textures before it.
    pub textures: Vec<Texture>,
    /// Materials; a material refers only to materials before it.
    pub materials: Vec<Material>,
    /// Participating media.
    pub media: Vec<Medium>,
    /// Bundles of hair, fur, grass.
    pub curves: Vec<Curves>,
    /// Shapes placed in the world directly.
    pub primitives: Vec<Primitive>,
    /// Sets of shapes that are placed by instances.
    pub groups: Vec<Group>,
    /// Placed groups.
    pub instances: Vec<Instance>,
    /// Lights that are not shapes.
    pub lights: Vec<Light>,
}

/// Frames of an animation. Frame `n` opens the shutter at `start + n / fps + shutter.0`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Animation {
    /// Frames per second.
    pub fps: f64,
    /// Time of frame 0, seconds.
    pub start: f64,
    /// First and last frame number that the file suggests, inclusive.
    pub frames: (u32, u32),
}

/// A transform over time: one key is a fixed transform. Between keys translation and scale (with
/// shear) are interpolated linearly and rotation spherically; before the first and after the last
/// key the nearest one holds. Times rise strictly, in seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// At least one.
    pub keys: Vec<MotionKey>,
}

/// One key of a [`Motion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionKey {
    /// Seconds.
    pub time: f64,
    /// Local to parent.
    pub transform: DAffine3,
}

impl Motion {
    /// No motion.
    pub fn fixed(transform: DAffine3) -> Self {
        Motion {
            keys: vec![MotionKey {
                time: 0.0,
                transform,
            }],
        }
    }
    /// No motion, no placement.
    pub fn identity() -> Self {
        Self::fixed(DAffine3::IDENTITY)
    }
    /// Whether it has more than one key.
    pub fn is_moving(&self) -> bool {
        self.keys.len() > 1
    }
}

/// The camera. In its own space it sits at the origin, looks along -Z, +X is right and +Y is up.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Camera to world; may mirror (pbrt files with `Scale -1 1 1`).
    pub transform: Motion,
    /// How points of the picture become rays.
    pub projection: Projection,
    /// Shutter opening and closing, seconds (relative to the frame's time in an animation).
    pub shutter: (f64, f64),
    /// How much the shutter lets through over its interval.
    pub shutter_curve: ShutterCurve,
    /// What fills the space around the camera; `None` is vacuum.
    pub medium: Option<MediumId>,
}

/// Transmission over the normalised shutter interval [0, 1].
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ShutterCurve {
    /// Open at once, closed at once.
    #[default]
    Box,
    /// Opens linearly over the first part, closes linearly over the last; fractions of the interval.
    Trapezoid {
        /// Fraction spent opening.
        open: f64,
        /// Fraction spent closing.
        close: f64,
    },
}

/// The part of the image plane that the picture shows, in the units of the projection, before
/// the frame is flipped to picture coordinates: x right, y up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScreenWindow {
    /// Left, right.
    pub x: (f64, f64),
    /// Bottom, top.
    pub y: (f64, f64),
}

/// How points of the picture become rays.
#[derive(Clone, Debug, PartialEq)]
pub enum Projection {
    /// Pinhole or thin lens.
    Perspective {
        /// Full field of view in degrees over `fov_axis`; the plane at distance 1 spans
        /// [-tan(fov/2), tan(fov/2)] there.
        fov: f64,
        /// Which side of the picture `fov` covers.
        fov_axis: FovAxis,
        /// Replaces the frame derived from the picture's aspect: in units of tan(fov/2).
        window: Option<ScreenWindow>,
        /// Thin lens, if any.
        lens: Option<Lens>,
    },
    /// Parallel rays.
    Orthographic {
        /// Half the height of the view in scene units where `window` is absent.
        half_height: f64,
        /// Replaces the frame, in scene units.
        window: Option<ScreenWindow>,
        /// Thin lens, if any: rays meet at `focus_distance`.
        lens: Option<Lens>,
    },
    /// The whole sphere of directions.
    Spherical {
        /// How the sphere is laid out on the picture.
        mapping: SphereMapping,
    },
}

/// Which side of the picture an angle covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FovAxis {
    /// Left to right.
    Horizontal,
    /// Bottom to top.
    Vertical,
    /// The shorter side (pbrt).
    Shorter,
}

/// A thin lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the aperture, scene units.
    pub radius: f64,
    /// Distance of the plane in focus along the viewing direction.
    pub focus_distance: f64,
    /// Shape of the aperture.
    pub aperture: Aperture,
    /// Horizontal squeeze of the aperture: its width is `radius / anamorphic`; 1 is round.
    pub anamorphic: f64,
}

/// Shape of an aperture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Aperture {
    /// A disk.
    Disk,
    /// A regular polygon inscribed in the disk.
    Blades {
        /// At least 3.
        count: u32,
        /// Degrees.
        rotation: f64,
    },
}

/// How directions are laid out on a picture of the sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SphereMapping {
    /// Latitude and longitude: `u = 0.5 + atan2(z, x) / 2 pi`, `v = acos(y) / pi` from the top row.
    LatLong,
    /// Equal-area octahedral, +Z up in its own space [Clarberg08], as pbrt-v4 does it.
    OctahedralEqualArea,
}

/// Picture and pixel filter.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmDesc {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// The part that is rendered: x0, y0, x1, y1 in pixels, upper bounds exclusive. The picture has
    /// the size of this part.
    pub crop: Option<[u32; 4]>,
    /// Reconstruction filter; it is importance sampled.
    pub filter: Filter,
    /// Factor on all radiance (sensor iso, exposure time, imaging ratio), by channel.
    pub exposure: Rgb,
    /// Samples brighter than this are scaled down to it (pbrt's maxcomponentvalue); biased.
    pub max_component: Option<f32>,
}

/// Reconstruction filters; radii in pixels, separable unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Filter {
    /// Constant.
    Box {
        /// Half width by axis.
        radius: (f64, f64),
    },
    /// Linear fall-off.
    Tent {
        /// Half width by axis.
        radius: (f64, f64),
    },
    /// Truncated Gaussian, lowered so that it ends at zero.
    Gaussian {
        /// Half width by axis.
        radius: (f64, f64),
        /// Standard deviation.
        sigma: f64,
    },
    /// Mitchell-Netravali; has negative lobes.
    Mitchell {
        /// Half width by axis.
        radius: (f64, f64),
        /// Parameter B.
        b: f64,
        /// Parameter C.
        c: f64,
    },
    /// Four-term Blackman-Harris window.
    BlackmanHarris {
        /// Half width by axis.
        radius: (f64, f64),
    },
    /// Windowed sinc (pbrt's LanczosSincFilter).
    LanczosSinc {
        /// Half width by axis.
        radius: (f64, f64),
        /// Lobes before the window ends.
        tau: f64,
    },
}

/// How light is gathered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Integrator {
    /// The lecture's basic ray tracer [Whitted80]: pixel centre, lens centre, shutter opening, one
    /// shadow ray to every light, mirror and glass followed to `max_depth`.
    Whitted {
        /// Bounces.
        max_depth: u32,
    },
    /// Direct light only, with MIS; perfect mirrors and glass are followed to `max_depth`.
    Direct {
        /// Bounces through mirrors and glass.
        max_depth: u32,
    },
    /// Path tracer with next-event estimation and MIS.
    Path {
        /// Scattering events of a path: 0 sees only emission.
        max_depth: u32,
    },
    /// World-space shading normal, mapped from [-1, 1] to [0, 1].
    Normals,
    /// Directional albedo of the first surface.
    Albedo,
    /// Distance along the ray.
    Depth,
    /// Texture coordinates as red and green.
    Uv,
}

/// Which points a pixel is sampled at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SamplerKind {
    /// An embedded lattice sequence, shifted at random.
    #[default]
    Lattice,
    /// Owen-scrambled Sobol points.
    OwenSobol,
    /// Jittered strata over blocks of 16 samples.
    Stratified,
    /// Independent uniform numbers.
    Independent,
}

/// A triangle mesh. Vertex attributes are either empty or one for every vertex.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Mesh {
    /// For messages.
    pub name: String,
    /// Vertex positions; with deformation, those of the first key.
    pub positions: Arc<Vec<[f32; 3]>>,
    /// Shading normals.
    pub normals: Arc<Vec<[f32; 3]>>,
    /// Tangents; w is the sign of the bitangent.
    pub tangents: Arc<Vec<[f32; 4]>>,
    /// Texture coordinates, by set; (0, 0) is the bottom left of a picture.
    pub uvs: Vec<Arc<Vec<[f32; 2]>>>,
    /// Colours, linear RGBA.
    pub colors: Arc<Vec<[f32; 4]>>,
    /// Corners of the triangles.
    pub indices: Arc<Vec<[u32; 3]>>,
    /// Further keys of a deforming mesh, times rising strictly after `first_time`.
    pub deformation: Option<Arc<Deformation>>,
}

/// Vertices of a deforming mesh over time; linear between keys.
#[derive(Clone, Debug, PartialEq)]
pub struct Deformation {
    /// Time of [`Mesh::positions`], seconds.
    pub first_time: f64,
    /// The other keys.
    pub keys: Vec<DeformationKey>,
}

/// One further key of a deforming mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct DeformationKey {
    /// Seconds.
    pub time: f64,
    /// One for every vertex.
    pub positions: Vec<[f32; 3]>,
    /// One for every vertex, or empty.
    pub normals: Vec<[f32; 3]>,
}

/// A shape with its surface, placed.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// Geometry in local space.
    pub shape: Shape,
    /// Local to parent (world, or the group).
    pub transform: Motion,
    /// Surface.
    pub material: MaterialId,
    /// Light given off, beside what the material reflects.
    pub emission: Option<Emission>,
    /// Coverage: a ray passes where a uniform number exceeds it.
    pub alpha: Option<FloatTex>,
    /// The outside becomes the inside (swaps the geometric normal).
    pub reverse_orientation: bool,
    /// Where the surface is the border of media; `None` where a ray that crosses it stays in what
    /// it is in.
    pub media: Option<MediumInterface>,
}

/// What lies on the two sides of a surface; `None` is vacuum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MediumInterface {
    /// Against the geometric normal.
    pub inside: Option<MediumId>,
    /// Where the geometric normal points.
    pub outside: Option<MediumId>,
}

/// A participating medium. Coefficients are per scene unit of world space.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// For messages and sharing.
    pub name: String,
    /// Absorption coefficient.
    pub sigma_a: Rgb,
    /// Scattering coefficient.
    pub sigma_s: Rgb,
    /// Radiance given off per absorption: the medium adds `sigma_a * emission` per unit of length.
    pub emission: Rgb,
    /// Asymmetry of the phase function [HenyeyGreenstein41], in (-1, 1); positive is forward.
    pub g: f32,
    /// Variation in space; `None` is the same everywhere.
    pub grid: Option<MediumGrid>,
}

/// How a medium varies: factors on its coefficients, trilinear between the centres of cells, zero
/// outside the bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct MediumGrid {
    /// Medium space to world.
    pub transform: DAffine3,
    /// Two corners of the box in medium space that the grids fill.
    pub bounds: [[f32; 3]; 2],
    /// Factor on `sigma_a`.
    pub absorption: Arc<Grid>,
    /// Factor on `sigma_s`; the same `Arc` as `absorption` where one density drives both.
    pub scattering: Arc<Grid>,
    /// Factor on `emission`.
    pub emission: Option<Arc<Grid>>,
}

/// Values on a regular grid, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Cells by axis.
    pub size: [u32; 3],
    /// As many as cells.
    pub values: GridValues,
}

impl Grid {
    /// Memory of the values.
    pub fn memory_bytes(&self) -> u64 {
        match &self.values {
            GridValues::Scalar(v) => v.len() as u64 * 4,
            GridValues::Rgb(v) => v.len() as u64 * 12,
        }
    }
}

/// What a [`Grid`] holds.
#[derive(Clone, Debug, PartialEq)]
pub enum GridValues {
    /// One number a cell.
    Scalar(Vec<f32>),
    /// One colour a cell.
    Rgb(Vec<Rgb>),
}

/// Cubic Bezier strands that share a cross-section.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// For messages.
    pub name: String,
    /// Cross-section.
    pub kind: CurveKind,
    /// Pieces of strands.
    pub segments: Arc<Vec<CurveSegment>>,
}

/// Cross-section of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CurveKind {
    /// Turned towards the ray, shaded as flat.
    Flat,
    /// Turned towards the ray, shaded as round.
    Cylinder,
    /// Fixed across: the normals say how it lies.
    Ribbon,
}

/// One cubic Bezier piece of a strand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CurveSegment {
    /// Control points, local space.
    pub points: [[f32; 3]; 4],
    /// Full width at the start and the end, scene units; linear between.
    pub width: [f32; 2],
    /// Texture coordinate u (along the strand) at the start and the end; v runs across from 0 to 1.
    #[serde(default = "whole")]
    pub u: [f32; 2],
    /// Normals of a ribbon at the start and the end; zero for the other kinds.
    #[serde(default)]
    pub normals: [[f32; 3]; 2],
}

fn whole() -> [f32; 2] {
    [0.0, 1.0]
}

/// Geometry in local space.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A triangle mesh. The geometric normal is (p1 - p0) x (p2 - p0), turned to the side of the
    /// shading normals where the mesh has them.
    Mesh(MeshId),
    /// A full sphere about the origin; normal outward. uv: pbrt's (phi / 360, from the south pole
    /// (-Z) at v = 0 to the north pole at v = 1).
    Sphere {
        /// Scene units.
        radius: f64,
    },
    /// Points with x^2 + y^2 between the radii squared, at z = `height`; normal +Z.
    Disk {
        /// Scene units.
        radius: f64,
        /// Radius of the hole, or 0.
        inner_radius: f64,
        /// Along z.
        height: f64,
    },
    /// The square [-1, 1]^2 at z = 0; normal +Z; uv from (0, 0) at (-1, -1) to (1, 1).
    Rectangle,
    /// A bundle of curves.
    Curves(CurvesId),
}

/// Light given off by a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Emission {
    /// Radiance; a texture is multiplied by `scale`.
    pub radiance: ColorTex,
    /// Factor.
    pub scale: f32,
    /// Both sides shine, otherwise the side of the geometric normal.
    pub two_sided: bool,
}

/// Shapes that are placed together.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Group {
    /// For messages.
    pub name: String,
    /// Their transforms are relative to the group.
    pub primitives: Vec<Primitive>,
    /// Nested instances (no cycles; checked).
    pub instances: Vec<Instance>,
}

/// A placed group.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// What is placed.
    pub group: GroupId,
    /// Group to parent.
    pub transform: Motion,
}

/// A light that is not a shape.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// Equal radiant intensity in all directions, from the origin of `transform`.
    Point {
        /// Light to world.
        transform: DAffine3,
        /// Power per solid angle.
        intensity: Rgb,
    },
    /// A cone about +Z of light space.
    Spot {
        /// Light to world.
        transform: DAffine3,
        /// Power per solid angle on the axis.
        intensity: Rgb,
        /// Half angle where it is dark, degrees.
        cone_angle: f64,
        /// Half angle up to which it has full strength, degrees.
        full_angle: f64,
        /// Shape between the two angles.
        falloff: SpotFalloff,
    },
    /// Parallel light from infinitely far away.
    Distant {
        /// Direction the light travels in, world space.
        direction: DVec3,
        /// Irradiance on a surface facing it.
        irradiance: Rgb,
    },
    /// Light from all directions.
    Environment {
        /// Light space to world; only its linear part matters.
        transform: DAffine3,
        /// Radiance, or factor on the picture.
        radiance: Rgb,
        /// Picture, if any, and its layout.
        image: Option<(ImageId, SphereMapping)>,
        /// Alpha 0 where it is seen directly.
        hidden: bool,
        /// Scales the picture, before `radiance`, until a surface facing +Z of light space receives this
        /// luminance from it: by pbrt-v4's sum, which counts half of the solid angle of each pixel (so
        /// that a white picture comes out at twice the radiance of a constant sky of the same
        /// illuminance).
        illuminance: Option<f32>,
        /// Corners of a planar rectangle in the world, in order around it. Light is only seen and only
        /// arrives through it, from the side that (p3 - p0) x (p1 - p0) points to. `None` is everywhere.
        portal: Option<[DVec3; 4]>,
    },
    /// From a point with an intensity that depends on the direction (goniometric).
    Goniometric {
        /// Light to world; the middle of the picture is +Y, as pbrt-v4 has it.
        transform: DAffine3,
        /// Power per solid angle where the picture is 1.
        intensity: Rgb,
        /// Square picture in the equal-area octahedral layout; the mean of its channels counts.
        image: ImageId,
        /// Scales the picture, before `intensity`, until it sums to this over the sphere.
        power: Option<f32>,
    },
    /// A picture thrown from a point along +Z of light space, +Y up, +X to its right.
    Projection {
        /// Light to world.
        transform: DAffine3,
        /// Power per solid angle where the picture is 1.
        intensity: Rgb,
        /// What is thrown.
        image: ImageId,
        /// Full angle over the shorter side of the picture, degrees.
        fov: f64,
        /// Scales the picture, before `intensity`, until its luminance sums to this over the solid
        /// angle that it fills.
        power: Option<f32>,
    },
}

/// Shape of a spot light's edge. With c the cosine of the angle to the axis, c0 of `cone_angle`, c1
/// of `full_angle`, x = (c - c0) / (c1 - c0) clamped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SpotFalloff {
    /// x^2 (3 - 2x), pbrt.
    SmoothStep,
    /// x^2, glTF.
    Squared,
}

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

/// A surface: how it scatters and what perturbs its normal.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// For messages and sharing.
    pub name: String,
    /// Scattering.
    pub bsdf: BsdfDesc,
    /// Tangent-space normal map: texture and strength on x and y.
    pub normal_map: Option<(TextureId, f32)>,
    /// Bump map: displacement along the normal, scene units.
    pub bump_map: Option<FloatTex>,
}

/// Width of a microfacet lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Along the tangent.
    pub u: FloatTex,
    /// Along the bitangent.
    pub v: FloatTex,
    /// Whether the numbers are widths or an artist's roughness.
    pub scale: RoughnessScale,
}

/// What a roughness number means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum RoughnessScale {
    /// GGX alpha itself.
    Alpha,
    /// alpha = sqrt(roughness): pbrt-v4 with `remaproughness`.
    Sqrt,
    /// alpha = roughness^2: glTF, Disney.
    Square,
}

/// How a surface scatters.
#[derive(Clone, Debug, PartialEq)]
pub enum BsdfDesc {
    /// Lambert; black below.
    Diffuse {
        /// Albedo.
        reflectance: ColorTex,
    },
    /// Rough diffuse [OrenNayar94].
    OrenNayar {
        /// Albedo.
        reflectance: ColorTex,
        /// Standard deviation of the facet angle, degrees.
        sigma: FloatTex,
    },
    /// Modified Phong [LafortuneWillems94]: diffuse kd plus ks (n + 2) / 2 pi cos^n about the mirror
    /// direction.
    Phong {
        /// Diffuse albedo.
        diffuse: ColorTex,
        /// Specular albedo at normal incidence.
        specular: ColorTex,
        /// Exponent n.
        exponent: FloatTex,
    },
    /// Generalised cosine lobes [Lafortune97].
    Lafortune {
        /// Diffuse albedo.
        diffuse: ColorTex,
        /// The lobes.
        lobes: Vec<LafortuneLobe>,
    },
    /// Perfect mirror.
    Mirror {
        /// Fraction reflected.
        reflectance: ColorTex,
    },
    /// Glass; smooth where the roughness is 0.
    Dielectric {
        /// Index of refraction inside over outside.
        ior: f32,
        /// Microfacet width.
        roughness: Roughness,
        /// Factor on what is reflected (1 is physical).
        reflect_tint: ColorTex,
        /// Factor on what is transmitted (1 is physical).
        transmit_tint: ColorTex,
    },
    /// A pane so thin that rays are not bent.
    ThinDielectric {
        /// Index of refraction.
        ior: f32,
    },
    /// Metal: GGX with complex index of refraction; smooth where the roughness is 0.
    Conductor {
        /// Optical constants.
        fresnel: ConductorFresnel,
        /// Microfacet width.
        roughness: Roughness,
    },
    /// A diffuse base under a dielectric layer.
    CoatedDiffuse {
        /// Albedo of the base.
        reflectance: ColorTex,
        /// The layer.
        coat: Coat,
    },
    /// A metal under a dielectric layer.
    CoatedConductor {
        /// The metal.
        fresnel: ConductorFresnel,
        /// Microfacet width of the metal.
        roughness: Roughness,
        /// The layer.
        coat: Coat,
    },
    /// Lambert on both sides, reflecting and transmitting.
    DiffuseTransmission {
        /// Fraction sent back.
        reflectance: ColorTex,
        /// Fraction sent through.
        transmittance: ColorTex,
    },
    /// Picks one of two by a weight.
    Mix {
        /// Where amount is 0.
        a: MaterialId,
        /// Where amount is 1.
        b: MaterialId,
        /// Weight of `b`.
        amount: FloatTex,
    },
    /// The same reflection on both sides of the surface (diffuse and metals are so already; this is
    /// for lobes that are black below, as pbrt has them one-sided nowhere).
    TwoSided {
        /// Seen from either side.
        inner: MaterialId,
    },
    /// No surface at all: rays pass.
    Interface,
    /// Everyday surfaces in one: see [`Principled`].
    Principled(Box<Principled>),
    /// A hair or fur fibre [Chiang16]; on curves, or anything with the strand along u.
    Hair {
        /// What the fibre is coloured by.
        color: HairColor,
        /// Index of refraction, 1.55 for hair.
        ior: f32,
        /// Longitudinal roughness, [0, 1].
        beta_m: FloatTex,
        /// Azimuthal roughness, [0, 1].
        beta_n: FloatTex,
        /// Tilt of the scales, degrees.
        alpha: f32,
    },
}

/// What colours a hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HairColor {
    /// Absorption coefficient inside, per radius of the fibre.
    Absorption(ColorTex),
    /// The colour that a mass of it shows; absorption follows by the fit of [Chiang16].
    Reflectance(ColorTex),
    /// Concentrations of the two pigments.
    Melanin {
        /// Brown and black.
        eumelanin: FloatTex,
        /// Red and blond.
        pheomelanin: FloatTex,
    },
}

/// A superset of glTF's metallic-roughness surface with all of its extensions, in the manner of
/// OpenPBR: from the outside in a sheen layer, a clear coat, and a base that mixes metal, glass,
/// translucent and opaque dielectric by weight. Every layer conserves energy (multiple scattering
/// between facets is made up for).
///
/// Roughness r means a GGX width of r^2 (glTF, Disney).
#[derive(Clone, Debug, PartialEq)]
pub struct Principled {
    /// Albedo of the diffuse base, reflectance of the metal at normal incidence, tint of what is
    /// transmitted.
    pub base_color: ColorTex,
    /// Weight of the metal, [0, 1].
    pub metallic: FloatTex,
    /// Of metal, dielectric reflection and transmission, [0, 1].
    pub roughness: FloatTex,
    /// Stretch of the highlight along the tangent turned by `anisotropy_rotation`, [0, 1], as
    /// KHR_materials_anisotropy has it: width along is mix(r^2, 1, anisotropy^2), across r^2.
    pub anisotropy: FloatTex,
    /// Degrees, counter-clockwise from the tangent.
    pub anisotropy_rotation: FloatTex,
    /// Tangent-space direction of the stretch in red and green (as in a normal map, [-1, 1] on
    /// [0, 1]), turned further by the rotation.
    pub anisotropy_direction: Option<TextureId>,
    /// Index of refraction of the dielectric; 0 stands for infinity (glTF).
    pub ior: f32,
    /// Weight of the dielectric reflection at normal incidence.
    pub specular: FloatTex,
    /// Colour of the dielectric reflection at normal incidence (may exceed 1; F0 is clamped).
    pub specular_color: ColorTex,
    /// For metals: reflectance at 82 degrees relative to Schlick's curve [Kutz21]; white is Schlick.
    pub metal_edge: ColorTex,
    /// Weight of transmission against the diffuse base, [0, 1].
    pub transmission: FloatTex,
    /// The surface is a sheet: what is transmitted is not bent (but spread by roughness).
    pub thin: bool,
    /// Weight of diffuse transmission in the diffuse base, [0, 1].
    pub diffuse_transmission: FloatTex,
    /// Its colour.
    pub diffuse_transmission_color: ColorTex,
    /// Weight of the clear coat, [0, 1].
    pub coat: FloatTex,
    /// Of the coat, [0, 1].
    pub coat_roughness: FloatTex,
    /// Of the coat; 1.5 in glTF.
    pub coat_ior: f32,
    /// Normal map of the coat alone: texture and strength on x and y. Without it the coat has the
    /// geometric shading normal, not the base's mapped one.
    pub coat_normal_map: Option<(TextureId, f32)>,
    /// Colour and strength of the sheen; black is none.
    pub sheen_color: ColorTex,
    /// Of the sheen, [0, 1].
    pub sheen_roughness: FloatTex,
    /// Weight of a thin film on the base, [0, 1].
    pub iridescence: FloatTex,
    /// Index of refraction of the film.
    pub iridescence_ior: f32,
    /// Thickness of the film, nanometres.
    pub iridescence_thickness: FloatTex,
}

impl Default for Principled {
    fn default() -> Self {
        let zero = FloatTex::Const(0.0);
        let white = ColorTex::Const([1.0; 3]);
        Principled {
            base_color: white,
            metallic: zero,
            roughness: FloatTex::Const(0.5),
            anisotropy: zero,
            anisotropy_rotation: zero,
            anisotropy_direction: None,
            ior: 1.5,
            specular: FloatTex::Const(1.0),
            specular_color: white,
            metal_edge: white,
            transmission: zero,
            thin: false,
            diffuse_transmission: zero,
            diffuse_transmission_color: white,
            coat: zero,
            coat_roughness: zero,
            coat_ior: 1.5,
            coat_normal_map: None,
            sheen_color: ColorTex::Const([0.0; 3]),
            sheen_roughness: zero,
            iridescence: zero,
            iridescence_ior: 1.3,
            iridescence_thickness: FloatTex::Const(400.0),
        }
    }
}

/// A generalised cosine lobe: (cx wi.x wo.x + cy wi.y wo.y + cz wi.z wo.z)^n, times a colour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LafortuneLobe {
    /// Colour.
    pub albedo: Rgb,
    /// cx = cy = -1, cz = 1 is Phong about the mirror direction.
    pub c: [f32; 3],
    /// n.
    pub exponent: f32,
}

/// Optical constants of a metal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConductorFresnel {
    /// Complex index of refraction by channel.
    EtaK {
        /// Real part.
        eta: ColorTex,
        /// Imaginary part.
        k: ColorTex,
    },
    /// Reflectance at normal incidence; k is derived with eta = 1.
    Reflectance(ColorTex),
}

/// A dielectric layer over something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Index of refraction.
    pub ior: f32,
    /// Microfacet width of its surface.
    pub roughness: Roughness,
    /// Thickness in scene units (the medium inside absorbs nothing unless `albedo` says so).
    pub thickness: f32,
    /// Scattering albedo of the medium in the layer; 0 is clear.
    pub albedo: Rgb,
    /// Henyey-Greenstein asymmetry of that medium.
    pub g: f32,
    /// Bounces inside that are followed.
    pub max_depth: u32,
    /// Walks averaged for a value.
    pub samples: u32,
}
