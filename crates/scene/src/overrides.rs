//! What a job may change about a scene: the `[look]` flags, size, integrator.

use serde::{Deserialize, Serialize};

/// Camera, variant and environment given from outside, for files without their own.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Look {
    /// Eye position, scene units.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_from: Option<[f64; 3]>,
    /// Point looked at.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_at: Option<[f64; 3]>,
    /// Up direction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Vertical field of view, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vfov: Option<f64>,
    /// Name of a camera in the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// Name of a material variant in the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Path of a lat-long environment picture among the job's files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub env: Option<String>,
    /// Factor on the environment picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub env_strength: Option<f64>,
    /// Rotation of the environment about the up axis, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub env_rotate: Option<f64>,
    /// Alpha 0 where the sky is seen directly.
    pub transparent: bool,
}

/// Everything a job may change about a scene before it is prepared. These are settings: together
/// with the scene, the seed and the engine version they determine every sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Overrides {
    /// Picture size in pixels, width then height.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Integrator by name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub integrator: Option<String>,
    /// The `[look]` flags.
    pub look: Look,
    /// Upper bound on the radiance that one indirect path may carry; biased, off by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clamp_indirect: Option<f32>,
    /// Missing files become warnings and conspicuous stand-ins.
    pub allow_missing: bool,
}
