//! The extensions of materials, and what is required or merely used.

use super::Gltf;
use super::materials::{Base, Draft, TangentsOf};
use super::properties::{self, Support};
use super::tangents::PLAIN;
use super::tree::At;
use crate::context::Issue;
use crate::model::{Channel, ColorTex, FloatTex, Texture};

/// Extensions that a material may carry.
pub(super) const OF_MATERIALS: &[&str] = &[
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
];

/// The least share of light that an absorbing volume lets through over its distance: 0 would need an
/// infinite coefficient.
const LEAST_TRANSMITTANCE: f64 = 1e-6;

impl<'j> Gltf<'_, '_, 'j> {
    /// Refuses files that require what is not there, and names what they use beyond that.
    pub(super) fn check_extensions(&mut self) -> Result<(), Issue> {
        let mut missing = None;
        for required in self.root.items("extensionsRequired")? {
            let name = required.text()?;
            if properties::extension(name).is_none() && missing.is_none() {
                missing = Some(required.fail(format!(
                    "the file requires the extension {name}, which is not supported"
                )));
            }
        }
        if let Some(missing) = missing {
            return Err(missing);
        }
        for used in self.root.items("extensionsUsed")? {
            let name = used.text()?;
            if properties::extension(name).is_none() {
                self.cx.warn(
                    &used.place(),
                    format!("the extension {name} is not supported; it is ignored"),
                );
            }
        }
        Ok(())
    }

    /// Warns of extensions at a place where they mean nothing to us. Those that the file declares
    /// as a whole were named at its head.
    pub(super) fn known_extensions(&mut self, at: &At<'j>, known: &[&str]) -> Result<(), Issue> {
        let Some(extensions) = at.get("extensions") else {
            return Ok(());
        };
        for (name, place) in extensions.members()? {
            let metadata =
                properties::extension(name).is_some_and(|e| e.support == Support::Metadata);
            let declared = self.declared.contains(name);
            if known.contains(&name)
                || metadata
                || (declared && properties::extension(name).is_none())
            {
                continue;
            }
            self.cx.warn(
                &place.place(),
                format!("the extension {name} is not supported here; it is ignored"),
            );
        }
        Ok(())
    }

    pub(super) fn emissive_strength(&mut self, at: &At<'j>) -> Result<f32, Issue> {
        let Some(at) = at.extension("KHR_materials_emissive_strength") else {
            return Ok(1.0);
        };
        at.only(&["emissiveStrength"], self.cx)?;
        let strength = at.ranged("emissiveStrength", 1.0, (0.0, f64::INFINITY), self.cx)?;
        Ok(strength as f32)
    }

    /// All extensions that change how a surface scatters. Returns the absorption coefficient of a
    /// volume behind it, if it has one.
    pub(super) fn material_extensions(
        &mut self,
        draft: &mut Draft<'j>,
    ) -> Result<Option<[f32; 3]>, Issue> {
        let at = draft.at.clone();
        if let Some(at) = at.extension("KHR_materials_ior") {
            at.only(&["ior"], self.cx)?;
            let ior = at.number_or("ior", 1.5)?;
            draft.p.ior = if ior == 0.0 || ior >= 1.0 {
                ior as f32
            } else {
                let place = at.get("ior").unwrap_or(at).place();
                self.cx.warn(
                    &place,
                    format!("an index of refraction of {ior}; 1 is used"),
                );
                1.0
            };
        }
        if let Some(at) = at.extension("KHR_materials_specular") {
            at.only(
                &[
                    "specularFactor",
                    "specularTexture",
                    "specularColorFactor",
                    "specularColorTexture",
                ],
                self.cx,
            )?;
            let texture = ("specularTexture", Channel::A);
            draft.p.specular = self.weight(draft, &at, ("specularFactor", 1.0), texture)?;
            let factor = at.color("specularColorFactor", [1.0; 3], f64::INFINITY, self.cx)?;
            draft.p.specular_color = self.color(draft, &at, "specularColorTexture", factor)?;
        }
        self.clearcoat(draft)?;
        if let Some(at) = at.extension("KHR_materials_sheen") {
            at.only(
                &[
                    "sheenColorFactor",
                    "sheenColorTexture",
                    "sheenRoughnessFactor",
                    "sheenRoughnessTexture",
                ],
                self.cx,
            )?;
            let factor = at.color("sheenColorFactor", [0.0; 3], 1.0, self.cx)?;
            draft.p.sheen_color = self.color(draft, &at, "sheenColorTexture", factor)?;
            let texture = ("sheenRoughnessTexture", Channel::A);
            draft.p.sheen_roughness =
                self.weight(draft, &at, ("sheenRoughnessFactor", 0.0), texture)?;
        }
        self.anisotropy(draft)?;
        self.iridescence(draft)?;
        if let Some(at) = at.extension("KHR_materials_dispersion") {
            at.only(&["dispersion"], self.cx)?;
            if at.number_or("dispersion", 0.0)? != 0.0 {
                self.cx.warn(
                    &at.place(),
                    "dispersion is approximated: all colours have the same index of refraction",
                );
            }
        }
        self.transmission(draft)
    }

    fn clearcoat(&mut self, draft: &mut Draft<'j>) -> Result<(), Issue> {
        let Some(at) = draft.at.extension("KHR_materials_clearcoat") else {
            return Ok(());
        };
        at.only(
            &[
                "clearcoatFactor",
                "clearcoatTexture",
                "clearcoatRoughnessFactor",
                "clearcoatRoughnessTexture",
                "clearcoatNormalTexture",
            ],
            self.cx,
        )?;
        draft.p.coat_normal_map = self.normal_map(draft, &at, "clearcoatNormalTexture")?;
        let texture = ("clearcoatTexture", Channel::R);
        draft.p.coat = self.weight(draft, &at, ("clearcoatFactor", 0.0), texture)?;
        let texture = ("clearcoatRoughnessTexture", Channel::G);
        draft.p.coat_roughness =
            self.weight(draft, &at, ("clearcoatRoughnessFactor", 0.0), texture)?;
        Ok(())
    }

    fn anisotropy(&mut self, draft: &mut Draft<'j>) -> Result<(), Issue> {
        let Some(at) = draft.at.extension("KHR_materials_anisotropy") else {
            return Ok(());
        };
        at.only(
            &[
                "anisotropyStrength",
                "anisotropyRotation",
                "anisotropyTexture",
            ],
            self.cx,
        )?;
        draft.tangents.get_or_insert(TangentsOf {
            set: 0,
            matrix: PLAIN,
        });
        let texture = ("anisotropyTexture", Channel::B);
        draft.p.anisotropy = self.weight(draft, &at, ("anisotropyStrength", 0.0), texture)?;
        draft.p.anisotropy_direction = self.data(draft, &at, "anisotropyTexture", [1.0; 4])?;
        let degrees = at.number_or("anisotropyRotation", 0.0)?.to_degrees();
        draft.p.anisotropy_rotation = FloatTex::Const(degrees as f32);
        Ok(())
    }

    fn iridescence(&mut self, draft: &mut Draft<'j>) -> Result<(), Issue> {
        let Some(at) = draft.at.extension("KHR_materials_iridescence") else {
            return Ok(());
        };
        at.only(
            &[
                "iridescenceFactor",
                "iridescenceTexture",
                "iridescenceIor",
                "iridescenceThicknessMinimum",
                "iridescenceThicknessMaximum",
                "iridescenceThicknessTexture",
            ],
            self.cx,
        )?;
        let texture = ("iridescenceTexture", Channel::R);
        draft.p.iridescence = self.weight(draft, &at, ("iridescenceFactor", 0.0), texture)?;
        let ior = at.ranged("iridescenceIor", 1.3, (1.0, 100.0), self.cx)?;
        draft.p.iridescence_ior = ior as f32;
        let any = (0.0, f64::INFINITY);
        let least = at.ranged("iridescenceThicknessMinimum", 100.0, any, self.cx)? as f32;
        let most = at.ranged("iridescenceThicknessMaximum", 400.0, any, self.cx)? as f32;
        let texture = self.data(draft, &at, "iridescenceThicknessTexture", [1.0; 4])?;
        draft.p.iridescence_thickness = match texture {
            None => FloatTex::Const(most),
            Some(id) => {
                let node = self.node(Texture::Mix {
                    a: ColorTex::Const([least; 3]),
                    b: ColorTex::Const([most; 3]),
                    amount: FloatTex::Texture(id, Channel::G),
                })?;
                FloatTex::Texture(node, Channel::R)
            }
        };
        Ok(())
    }

    fn transmission(&mut self, draft: &mut Draft<'j>) -> Result<Option<[f32; 3]>, Issue> {
        let at = draft.at.clone();
        if let Some(at) = at.extension("KHR_materials_transmission") {
            at.only(&["transmissionFactor", "transmissionTexture"], self.cx)?;
            let texture = ("transmissionTexture", Channel::R);
            draft.p.transmission = self.weight(draft, &at, ("transmissionFactor", 0.0), texture)?;
        }
        if let Some(at) = at.extension("KHR_materials_diffuse_transmission") {
            at.only(
                &[
                    "diffuseTransmissionFactor",
                    "diffuseTransmissionTexture",
                    "diffuseTransmissionColorFactor",
                    "diffuseTransmissionColorTexture",
                ],
                self.cx,
            )?;
            let texture = ("diffuseTransmissionTexture", Channel::A);
            let factor = ("diffuseTransmissionFactor", 0.0);
            draft.p.diffuse_transmission = self.weight(draft, &at, factor, texture)?;
            let factor = at.color("diffuseTransmissionColorFactor", [1.0; 3], 1.0, self.cx)?;
            draft.p.diffuse_transmission_color =
                self.color(draft, &at, "diffuseTransmissionColorTexture", factor)?;
        }
        let passes = [
            "KHR_materials_transmission",
            "KHR_materials_diffuse_transmission",
        ];
        draft.p.thin = passes.iter().any(|name| at.extension(name).is_some());
        let Some(at) = at.extension("KHR_materials_volume") else {
            return Ok(None);
        };
        at.only(
            &[
                "thicknessFactor",
                "thicknessTexture",
                "attenuationDistance",
                "attenuationColor",
            ],
            self.cx,
        )?;
        let thickness = at.ranged("thicknessFactor", 0.0, (0.0, f64::INFINITY), self.cx)?;
        draft.p.thin = thickness == 0.0;
        let color = at.color("attenuationColor", [1.0; 3], 1.0, self.cx)?;
        let distance = match at.get("attenuationDistance") {
            None => return Ok(None),
            Some(distance) => match distance.number()? {
                d if d > 0.0 => d,
                d => return Err(distance.fail(format!("an attenuation distance of {d}"))),
            },
        };
        if draft.p.thin || color == [1.0; 3] {
            return Ok(None);
        }
        // Over the distance white light takes on the colour: exp(-sigma d) = colour.
        Ok(Some(color.map(|c| {
            (-libm::log(f64::from(c).max(LEAST_TRANSMITTANCE)) / distance) as f32
        })))
    }

    /// The old specular-glossiness model: a diffuse colour under a reflection of a given colour at
    /// normal incidence, with 1 - glossiness as roughness.
    pub(super) fn specular_glossiness(
        &mut self,
        draft: &mut Draft<'j>,
        at: &At<'j>,
    ) -> Result<Base, Issue> {
        at.only(
            &[
                "diffuseFactor",
                "diffuseTexture",
                "specularFactor",
                "glossinessFactor",
                "specularGlossinessTexture",
            ],
            self.cx,
        )?;
        draft.p.metallic = FloatTex::Const(0.0);
        // An infinite index of refraction reflects all, so that the colour alone says how much.
        draft.p.ior = 0.0;
        let specular = at.color("specularFactor", [1.0; 3], 1.0, self.cx)?;
        draft.p.specular_color = self.color(draft, at, "specularGlossinessTexture", specular)?;
        let gloss = at.ranged("glossinessFactor", 1.0, (0.0, 1.0), self.cx)? as f32;
        let scale = [1.0, 1.0, 1.0, gloss];
        draft.p.roughness = match self.data(draft, at, "specularGlossinessTexture", scale)? {
            None => FloatTex::Const(1.0 - gloss),
            Some(id) => {
                let node = self.node(Texture::Mix {
                    a: ColorTex::Const([1.0; 3]),
                    b: ColorTex::Const([0.0; 3]),
                    amount: FloatTex::Texture(id, Channel::A),
                })?;
                FloatTex::Texture(node, Channel::R)
            }
        };
        let factor = self.rgba(at, "diffuseFactor")?;
        self.base(draft, factor, Some((at, "diffuseTexture")))
    }
}
