//! The properties that this importer knows, by object, and the extensions with what becomes of them.
//! Whatever a file has beyond these lists is named in a warning, and `docs/formats.md` is held
//! against them by a test.

/// What becomes of an extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Support {
    /// Rendered as specified.
    Full,
    /// Rendered with the difference that the note names.
    Partly,
    /// Carries nothing that a picture shows.
    Metadata,
}

/// An extension that files may use, and even require.
#[derive(Clone, Copy, Debug)]
pub struct Extension {
    /// Its registered name.
    pub name: &'static str,
    /// What becomes of it.
    pub support: Support,
    /// How it is done, or what is different.
    pub note: &'static str,
}

const fn full(name: &'static str, note: &'static str) -> Extension {
    Extension {
        name,
        support: Support::Full,
        note,
    }
}

const fn partly(name: &'static str, note: &'static str) -> Extension {
    Extension {
        name,
        support: Support::Partly,
        note,
    }
}

/// All extensions that are understood, by name.
pub const EXTENSIONS: &[Extension] = &[
    full(
        "EXT_mesh_gpu_instancing",
        "instances; custom attributes are named in a warning",
    ),
    full(
        "EXT_meshopt_compression",
        "attributes, triangles, indices and all filters",
    ),
    full("EXT_texture_webp", ""),
    full("KHR_draco_mesh_compression", "meshes"),
    full(
        "KHR_lights_punctual",
        "1 cd and 1 lx are one unit; `range` is not a cut-off",
    ),
    full("KHR_materials_anisotropy", ""),
    full("KHR_materials_clearcoat", ""),
    full("KHR_materials_diffuse_transmission", ""),
    partly(
        "KHR_materials_dispersion",
        "one index of refraction for all colours, with a warning",
    ),
    full("KHR_materials_emissive_strength", ""),
    full("KHR_materials_ior", ""),
    full("KHR_materials_iridescence", ""),
    partly(
        "KHR_materials_pbrSpecularGlossiness",
        "as a dielectric with the specular colour at normal incidence",
    ),
    full("KHR_materials_sheen", ""),
    full("KHR_materials_specular", ""),
    full(
        "KHR_materials_transmission",
        "a thin sheet unless there is a volume",
    ),
    full(
        "KHR_materials_unlit",
        "as light that the surface gives off; it reflects nothing",
    ),
    full("KHR_materials_variants", "chosen with `--variant NAME`"),
    full(
        "KHR_materials_volume",
        "absorption over the real path; the thickness only says whether there is a volume",
    ),
    full("KHR_mesh_quantization", ""),
    full(
        "KHR_meshopt_compression",
        "as EXT_meshopt_compression, attributes of version 0",
    ),
    full(
        "KHR_texture_basisu",
        "where the texture has no other picture",
    ),
    full("KHR_texture_transform", ""),
    Extension {
        name: "KHR_xmp",
        support: Support::Metadata,
        note: "",
    },
    Extension {
        name: "KHR_xmp_json_ld",
        support: Support::Metadata,
        note: "",
    },
];

/// The entry of an extension.
pub(super) fn extension(name: &str) -> Option<&'static Extension> {
    EXTENSIONS.iter().find(|e| e.name == name)
}

/// Properties of the file itself.
pub(super) const ROOT: &[&str] = &[
    "asset",
    "scene",
    "scenes",
    "nodes",
    "meshes",
    "materials",
    "textures",
    "images",
    "samplers",
    "accessors",
    "bufferViews",
    "buffers",
    "cameras",
    "skins",
    "animations",
    "extensionsUsed",
    "extensionsRequired",
];
pub(super) const SCENE: &[&str] = &["nodes"];
pub(super) const NODE: &[&str] = &[
    "children",
    "matrix",
    "translation",
    "rotation",
    "scale",
    "mesh",
    "camera",
    "skin",
    "weights",
];
pub(super) const MESH: &[&str] = &["primitives", "weights"];
pub(super) const PRIMITIVE: &[&str] = &["attributes", "indices", "material", "mode", "targets"];
pub(super) const MATERIAL: &[&str] = &[
    "pbrMetallicRoughness",
    "normalTexture",
    // Known and not used: light finds its own occlusion.
    "occlusionTexture",
    "emissiveTexture",
    "emissiveFactor",
    "alphaMode",
    "alphaCutoff",
    "doubleSided",
];
pub(super) const METALLIC_ROUGHNESS: &[&str] = &[
    "baseColorFactor",
    "baseColorTexture",
    "metallicFactor",
    "roughnessFactor",
    "metallicRoughnessTexture",
];
pub(super) const TEXTURE_INFO: &[&str] = &["index", "texCoord"];
pub(super) const TEXTURE_TRANSFORM: &[&str] = &["offset", "rotation", "scale", "texCoord"];
pub(super) const TEXTURE: &[&str] = &["source", "sampler"];
pub(super) const SAMPLER: &[&str] = &["magFilter", "minFilter", "wrapS", "wrapT"];
pub(super) const IMAGE: &[&str] = &["uri", "bufferView", "mimeType"];
pub(super) const CAMERA: &[&str] = &["type", "perspective", "orthographic"];
pub(super) const PERSPECTIVE: &[&str] = &["yfov", "aspectRatio", "znear", "zfar"];
pub(super) const ORTHOGRAPHIC: &[&str] = &["xmag", "ymag", "znear", "zfar"];
pub(super) const SKIN: &[&str] = &["joints", "inverseBindMatrices", "skeleton"];
pub(super) const ANIMATION: &[&str] = &["channels", "samplers"];
pub(super) const LIGHT: &[&str] = &["type", "color", "intensity", "range", "spot"];
pub(super) const SPOT: &[&str] = &["innerConeAngle", "outerConeAngle"];
