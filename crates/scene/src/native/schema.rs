//! The JSON of a scene as types. The JSON Schema in `api/` is generated from them.

use super::values::{Color, ColorValue, FloatValue, Named, Placement};
use crate::model::{
    Animation, Aperture, Filter, FovAxis, LafortuneLobe, MipFilter, NoisePattern, RoughnessScale,
    SamplerKind, ScreenWindow, ShutterCurve, SphereMapping, SpotFalloff, Wrap,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A Brolly scene. Lengths in scene units, angles in degrees, time in seconds, +Y up, right-handed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Version of the format: 1.
    pub brolly: u32,
    /// The view.
    pub camera: Camera,
    /// Picture size and pixel filter.
    #[serde(default)]
    pub film: Film,
    /// How light is gathered.
    #[serde(default)]
    pub integrator: Integrator,
    /// Which points a pixel is sampled at.
    #[serde(default)]
    pub sampler: SamplerKind,
    /// Samples per pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spp: Option<u32>,
    /// Frames, if there is more than one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub animation: Option<Animation>,
    /// Pictures that are given names; others are named by their path where they are used.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub images: Named<Image>,
    /// Textures; one refers only to those before it.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub textures: Named<Texture>,
    /// Materials; one refers only to those before it.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub materials: Named<Material>,
    /// Meshes.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub meshes: Named<Mesh>,
    /// Groups of shapes, for instances.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub groups: Named<Group>,
    /// Shapes in the world.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub primitives: Vec<Primitive>,
    /// Placed groups.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub instances: Vec<Instance>,
    /// Lights that are not shapes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<Light>,
}

/// The camera: `look_from`, `look_at`, `up`, or a `transform` of a camera that looks along -Z.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Camera {
    /// Eye.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_from: Option<[f64; 3]>,
    /// Target.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_at: Option<[f64; 3]>,
    /// Up direction; +Y by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Camera to world, in place of the three above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transform: Option<Placement>,
    /// Vertical field of view, degrees; 40 by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vfov: Option<f64>,
    /// Any projection, in place of `vfov`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub projection: Option<Projection>,
    /// Thin lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens: Option<Lens>,
    /// Opening and closing, seconds.
    pub shutter: (f64, f64),
    /// How much the shutter lets through over time.
    pub shutter_curve: ShutterCurve,
}

/// How points of the picture become rays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Projection {
    /// Pinhole or thin lens.
    Perspective {
        /// Degrees.
        fov: f64,
        /// The side that it covers.
        fov_axis: FovAxis,
        /// Another frame, in units of tan(fov/2).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        window: Option<ScreenWindow>,
    },
    /// Parallel rays.
    Orthographic {
        /// Half the height of the view.
        half_height: f64,
        /// Another frame, in scene units.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        window: Option<ScreenWindow>,
    },
    /// All directions.
    Spherical {
        /// Layout on the picture.
        mapping: SphereMapping,
    },
}

fn one() -> f64 {
    1.0
}
fn one_f32() -> f32 {
    1.0
}
fn is_one(x: &f32) -> bool {
    *x == 1.0
}
fn no(x: &bool) -> bool {
    !*x
}
fn white() -> ColorValue {
    ColorValue::Const([1.0; 3])
}
fn white_color() -> Color {
    Color([1.0; 3])
}
fn half() -> ColorValue {
    ColorValue::Const([0.5; 3])
}
fn zero() -> FloatValue {
    FloatValue::Const(0.0)
}
fn glass() -> f32 {
    1.5
}

/// A thin lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Radius of the aperture.
    pub radius: f64,
    /// Distance of the plane in focus.
    pub focus_distance: f64,
    /// Shape of the aperture.
    #[serde(default = "disk")]
    pub aperture: Aperture,
    /// Horizontal squeeze; 1 is round.
    #[serde(default = "one")]
    pub anamorphic: f64,
}

fn disk() -> Aperture {
    Aperture::Disk
}

/// Picture and filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Film {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The part that is rendered: x0, y0, x1, y1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop: Option<[u32; 4]>,
    /// Reconstruction filter.
    pub filter: Filter,
    /// Factor on all radiance.
    pub exposure: Color,
    /// Bound on the brightness of samples; biased.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_component: Option<f32>,
}

impl Default for Film {
    fn default() -> Self {
        let filter = Filter::BlackmanHarris { radius: (1.5, 1.5) };
        Film {
            size: [1280, 720],
            crop: None,
            filter,
            exposure: white_color(),
            max_component: None,
        }
    }
}

/// How light is gathered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Integrator {
    /// path, direct, whitted, normals, albedo, depth or uv.
    pub name: String,
    /// Bounces that are followed.
    pub max_depth: u32,
}

impl Default for Integrator {
    fn default() -> Self {
        Integrator {
            name: "path".into(),
            max_depth: crate::apply::DEFAULT_DEPTH,
        }
    }
}

/// A picture file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Image {
    /// Path beside the scene.
    pub file: String,
    /// How stored numbers become linear ones.
    #[serde(default)]
    pub encoding: Encoding,
}

/// How the stored numbers of a picture become linear ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Encoding {
    /// sRGB for integers, linear for floats.
    #[default]
    Auto,
    /// sRGB.
    Srgb,
    /// As they are.
    Linear,
    /// A power, in millionths.
    GammaMicros(u32),
}

/// From surface to texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Map {
    /// Texture coordinates of the mesh.
    Uv {
        /// Which set.
        #[serde(default)]
        set: u32,
        /// s = m0 u + m1 v + m2, t = m3 u + m4 v + m5.
        #[serde(default = "plain")]
        matrix: [f64; 6],
    },
    /// World position through a matrix of three rows of four.
    Planar {
        /// World to texture.
        matrix: [f64; 12],
    },
    /// Angles from and about the z axis of texture space.
    Spherical {
        /// World to texture.
        matrix: [f64; 12],
    },
    /// Angle about the z axis of texture space, and z.
    Cylindrical {
        /// World to texture.
        matrix: [f64; 12],
    },
}

fn plain() -> [f64; 6] {
    [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
}

impl Default for Map {
    fn default() -> Self {
        Map::Uv {
            set: 0,
            matrix: plain(),
        }
    }
}

fn repeat() -> (Wrap, Wrap) {
    (Wrap::Repeat, Wrap::Repeat)
}
fn ones() -> [f32; 4] {
    [1.0; 4]
}
/// World to texture where nothing is said.
fn unmoved() -> [f64; 12] {
    [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
}

/// A texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Texture {
    /// The same everywhere.
    Constant {
        /// RGBA.
        value: [f32; 4],
    },
    /// A picture.
    Image {
        /// The name of a picture, or a path.
        image: String,
        /// Where.
        #[serde(default)]
        map: Map,
        /// Outside [0, 1], by axis.
        #[serde(default = "repeat")]
        wrap: (Wrap, Wrap),
        /// Nearest pixel instead of bilinear.
        #[serde(default, skip_serializing_if = "no")]
        nearest: bool,
        /// A pyramid for where pixels of the render cover many of the picture.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        mip: Option<MipFilter>,
        /// 1 - value, before scale.
        #[serde(default, skip_serializing_if = "no")]
        invert: bool,
        /// Factor on RGBA.
        #[serde(default = "ones")]
        scale: [f32; 4],
    },
    /// Unit squares.
    Checkerboard {
        /// Where.
        #[serde(default)]
        map: Map,
        /// On even cells.
        even: ColorValue,
        /// On odd cells.
        odd: ColorValue,
    },
    /// Product.
    Scale {
        /// A colour.
        a: ColorValue,
        /// Times a number...
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by: Option<FloatValue>,
        /// ...or times a colour.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by_color: Option<ColorValue>,
    },
    /// (1 - amount) a + amount b.
    Mix {
        /// Where amount is 0.
        a: ColorValue,
        /// Where amount is 1.
        b: ColorValue,
        /// Weight.
        amount: FloatValue,
    },
    /// Bilinear between the corners (0,0), (0,1), (1,0), (1,1).
    Bilerp {
        /// Where.
        #[serde(default)]
        map: Map,
        /// Colours.
        corners: [Color; 4],
    },
    /// Interpolated vertex colour.
    VertexColor,
    /// Unit cubes.
    Checkerboard3d {
        /// World to texture.
        #[serde(default = "unmoved")]
        matrix: [f64; 12],
        /// On even cells.
        even: ColorValue,
        /// On odd cells.
        odd: ColorValue,
    },
    /// Dots in about three of eight unit squares.
    Dots {
        /// Where.
        #[serde(default)]
        map: Map,
        /// On the dots.
        inside: ColorValue,
        /// Between them.
        outside: ColorValue,
    },
    /// Gradient noise in space.
    Noise {
        /// World to texture.
        #[serde(default = "unmoved")]
        matrix: [f64; 12],
        /// Which.
        pattern: NoisePattern,
    },
    /// Two textures by how the surface faces a direction.
    DirectionMix {
        /// Where the surface faces the direction.
        a: ColorValue,
        /// Where it is at right angles to it.
        b: ColorValue,
        /// In the world.
        direction: [f64; 3],
    },
    /// A number as a grey.
    Grey {
        /// The number.
        value: FloatValue,
    },
    /// A picture divided by the mean luminance of its pixels.
    UnitMean {
        /// The name of an image texture.
        texture: String,
    },
}

/// Tangent-space normal map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NormalMap {
    /// The texture.
    pub texture: String,
    /// Strength on x and y.
    #[serde(default = "one_f32")]
    pub strength: f32,
}

/// A surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// How it scatters.
    pub bsdf: Bsdf,
    /// Normal map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_map: Option<NormalMap>,
    /// Displacement along the normal, for shading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bump_map: Option<FloatValue>,
}

/// Width of a microfacet lobe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Roughness {
    /// Along the tangent.
    pub u: FloatValue,
    /// Along the bitangent; as along the tangent by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub v: Option<FloatValue>,
    /// What the numbers are.
    #[serde(default = "alpha")]
    pub scale: RoughnessScale,
}

fn alpha() -> RoughnessScale {
    RoughnessScale::Alpha
}

impl Default for Roughness {
    fn default() -> Self {
        Roughness {
            u: zero(),
            v: None,
            scale: RoughnessScale::Alpha,
        }
    }
}

/// Optical constants of a metal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Fresnel {
    /// Complex index of refraction by channel.
    EtaK {
        /// Real part.
        eta: ColorValue,
        /// Imaginary part.
        k: ColorValue,
    },
    /// Reflectance at normal incidence.
    Reflectance(ColorValue),
}

/// A dielectric layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Coat {
    /// Index of refraction.
    pub ior: f32,
    /// Microfacet width.
    pub roughness: Roughness,
    /// Scene units.
    pub thickness: f32,
    /// Scattering albedo of the medium inside; 0 is clear.
    pub albedo: Color,
    /// Its asymmetry.
    pub g: f32,
    /// Bounces inside.
    pub max_depth: u32,
    /// Walks averaged for a value.
    pub samples: u32,
}

impl Default for Coat {
    fn default() -> Self {
        let roughness = Roughness::default();
        Coat {
            ior: 1.5,
            roughness,
            thickness: 0.01,
            albedo: Color([0.0; 3]),
            g: 0.0,
            max_depth: 10,
            samples: 1,
        }
    }
}

/// How a surface scatters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Bsdf {
    /// Lambert.
    Diffuse {
        /// Albedo.
        #[serde(default = "half")]
        reflectance: ColorValue,
    },
    /// Rough diffuse.
    OrenNayar {
        /// Albedo.
        reflectance: ColorValue,
        /// Spread of the facets, degrees.
        sigma: FloatValue,
    },
    /// Modified Phong.
    Phong {
        /// Diffuse albedo.
        diffuse: ColorValue,
        /// Specular albedo.
        specular: ColorValue,
        /// Exponent.
        exponent: FloatValue,
    },
    /// Generalised cosine lobes.
    Lafortune {
        /// Diffuse albedo.
        diffuse: ColorValue,
        /// Lobes.
        lobes: Vec<LafortuneLobe>,
    },
    /// Perfect mirror.
    Mirror {
        /// Fraction reflected.
        #[serde(default = "white")]
        reflectance: ColorValue,
    },
    /// Glass.
    Dielectric {
        /// Index of refraction.
        #[serde(default = "glass")]
        ior: f32,
        /// Microfacet width; smooth by default.
        #[serde(default)]
        roughness: Roughness,
        /// Factor on what is reflected.
        #[serde(default = "white")]
        reflect_tint: ColorValue,
        /// Factor on what is transmitted.
        #[serde(default = "white")]
        transmit_tint: ColorValue,
    },
    /// A thin pane.
    ThinDielectric {
        /// Index of refraction.
        #[serde(default = "glass")]
        ior: f32,
    },
    /// Metal.
    Conductor {
        /// Optical constants.
        fresnel: Fresnel,
        /// Microfacet width; smooth by default.
        #[serde(default)]
        roughness: Roughness,
    },
    /// A diffuse base under a layer.
    CoatedDiffuse {
        /// Albedo of the base.
        #[serde(default = "half")]
        reflectance: ColorValue,
        /// The layer.
        #[serde(default)]
        coat: Coat,
    },
    /// A metal under a layer.
    CoatedConductor {
        /// The metal.
        fresnel: Fresnel,
        /// Its microfacet width.
        #[serde(default)]
        roughness: Roughness,
        /// The layer.
        #[serde(default)]
        coat: Coat,
    },
    /// Lambert on both sides.
    DiffuseTransmission {
        /// Fraction sent back.
        reflectance: ColorValue,
        /// Fraction sent through.
        transmittance: ColorValue,
    },
    /// One of two materials, by a weight.
    Mix {
        /// Where amount is 0.
        a: String,
        /// Where amount is 1.
        b: String,
        /// Weight of b.
        amount: FloatValue,
    },
    /// The same on both sides.
    TwoSided {
        /// A material.
        inner: String,
    },
    /// No surface.
    Interface,
}

/// A mesh: one of `ply`, `buffer` and `positions`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mesh {
    /// A PLY file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ply: Option<String>,
    /// A binary file as `convert` writes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub buffer: Option<String>,
    /// Vertices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub positions: Option<Vec<[f32; 3]>>,
    /// Normals.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub uvs: Vec<[f32; 2]>,
    /// Linear RGBA.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub colors: Vec<[f32; 4]>,
    /// Triangles.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub indices: Vec<[u32; 3]>,
}

/// Geometry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A mesh by name.
    Mesh(String),
    /// A PLY file.
    Ply(String),
    /// A mesh written here.
    Triangles(Box<Mesh>),
    /// A sphere about the origin.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A disk with normal +Z.
    Disk {
        /// Radius.
        radius: f64,
        /// Radius of the hole.
        #[serde(default)]
        inner_radius: f64,
        /// Along z.
        #[serde(default)]
        height: f64,
    },
    /// The square [-1, 1]^2 with normal +Z.
    Rectangle,
}

/// Light given off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Emission {
    /// Radiance.
    pub radiance: ColorValue,
    /// Factor.
    #[serde(default = "one_f32", skip_serializing_if = "is_one")]
    pub scale: f32,
    /// Both sides shine.
    #[serde(default, skip_serializing_if = "no")]
    pub two_sided: bool,
}

/// A shape with its surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Primitive {
    /// Geometry.
    pub shape: Shape,
    /// The name of a material.
    pub material: String,
    /// Where.
    #[serde(default, skip_serializing_if = "Placement::is_identity")]
    pub transform: Placement,
    /// Light given off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission: Option<Emission>,
    /// Coverage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha: Option<FloatValue>,
    /// The outside becomes the inside.
    #[serde(default, skip_serializing_if = "no")]
    pub reverse_orientation: bool,
}

/// Shapes that are placed together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Group {
    /// Shapes.
    pub primitives: Vec<Primitive>,
    /// Groups inside this one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub instances: Vec<Instance>,
}

/// A placed group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// The group's name.
    pub group: String,
    /// Where.
    #[serde(default, skip_serializing_if = "Placement::is_identity")]
    pub transform: Placement,
}

/// A light that is not a shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Light {
    /// From the origin, equally in all directions.
    Point {
        /// Power per solid angle.
        intensity: Color,
        /// Where.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
    },
    /// A cone about +Z.
    Spot {
        /// Power per solid angle on the axis.
        intensity: Color,
        /// Half angle where it is dark.
        cone_angle: f64,
        /// Half angle of full strength.
        full_angle: f64,
        /// Shape of the edge.
        #[serde(default = "smooth")]
        falloff: SpotFalloff,
        /// Where.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
    },
    /// Parallel light.
    Distant {
        /// The way that it travels.
        direction: [f64; 3],
        /// On a surface facing it.
        irradiance: Color,
    },
    /// From all directions.
    Environment {
        /// Radiance, or factor on the picture.
        #[serde(default = "white_color")]
        radiance: Color,
        /// The name of a picture, or a path.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image: Option<String>,
        /// Its layout.
        #[serde(default = "lat_long")]
        mapping: SphereMapping,
        /// How it is turned.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
        /// Alpha 0 where it is seen directly.
        #[serde(default, skip_serializing_if = "no")]
        hidden: bool,
        /// Scales the picture until a surface facing +Z receives this from it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        illuminance: Option<f32>,
        /// Corners of the only rectangle in the world that it comes in through.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        portal: Option<[[f64; 3]; 4]>,
    },
    /// A point whose intensity depends on the direction.
    Goniometric {
        /// Power per solid angle where the picture is 1.
        #[serde(default = "white_color")]
        intensity: Color,
        /// The name of a square octahedral picture, or a path.
        image: String,
        /// Scales the picture until it sums to this over the sphere.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        power: Option<f32>,
        /// Where.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
    },
    /// A picture thrown along +Z.
    Projection {
        /// Power per solid angle where the picture is 1.
        #[serde(default = "white_color")]
        intensity: Color,
        /// The name of a picture, or a path.
        image: String,
        /// Full angle over the shorter side, degrees.
        fov: f64,
        /// Scales the picture until its luminance sums to this over the solid angle it fills.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        power: Option<f32>,
        /// Where.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
    },
}

fn smooth() -> SpotFalloff {
    SpotFalloff::SmoothStep
}
fn lat_long() -> SphereMapping {
    SphereMapping::LatLong
}

/// The JSON Schema of a scene, as text that ends in a line break.
pub fn schema() -> String {
    let schema = schemars::schema_for!(Scene);
    // A schema is made of maps with string keys: writing it cannot fail.
    serde_json::to_string_pretty(&schema)
        .map(|text| text + "\n")
        .unwrap_or_default()
}
