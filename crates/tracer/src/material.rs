//! Materials: from a description and a point on a surface to a [`Bsdf`].

use crate::bsdf::{
    self, Bsdf, CoatTable, CoatedConductor, CoatedDiffuse, Conductor, Dielectric, Diffuse,
    DiffuseTransmission, Lafortune, LobeParam, Mirror, OrenNayar, Phong, ThinDielectric,
};
use crate::geometry::Interaction;
use crate::geometry::interaction::shading_frame;
use crate::math::{self, Frame, Rgb};
use crate::texture::{Point, Textures};
use glam::{Vec2, Vec3};
use scene::model::{self, BsdfDesc, Coat, ConductorFresnel, FloatTex, Roughness, RoughnessScale};

/// A material ready for use.
pub struct Material {
    desc: BsdfDesc,
    normal_map: Option<(usize, f32)>,
    bump_map: Option<FloatTex>,
    /// Tables over the coat's width: one if that is constant, else one for each of [`COAT_WIDTHS`].
    coats: Vec<CoatTable>,
    lobes: Vec<LobeParam>,
    /// The surface's tangents matter.
    pub needs_tangents: bool,
    /// Some texture makes use of what a pixel covers.
    pub needs_footprint: bool,
}

/// GGX widths that coats of varying roughness are tabulated at; the nearest is taken.
const COAT_WIDTHS: [f32; 8] = [0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0];

impl Material {
    /// Compiles a description.
    pub fn new(desc: &model::Material, textures: &Textures) -> Material {
        let mut coats = vec![];
        let mut lobes = vec![];
        let mut anisotropic = false;
        let mut widths = |r: &Roughness| anisotropic |= r.u != r.v;
        match &desc.bsdf {
            BsdfDesc::Dielectric { roughness, .. } | BsdfDesc::Conductor { roughness, .. } => {
                widths(roughness)
            }
            BsdfDesc::CoatedConductor {
                roughness, coat, ..
            } => {
                widths(roughness);
                widths(&coat.roughness);
                coats = coat_tables(coat);
            }
            BsdfDesc::CoatedDiffuse { coat, .. } => {
                widths(&coat.roughness);
                coats = coat_tables(coat);
            }
            BsdfDesc::Lafortune {
                lobes: described, ..
            } => {
                lobes = described
                    .iter()
                    .map(|l| LobeParam {
                        albedo: Rgb::from_array(l.albedo),
                        c: Vec3::from_array(l.c),
                        n: l.exponent,
                    })
                    .collect();
                anisotropic = described.iter().any(|l| l.c[0] != l.c[1]);
            }
            _ => {}
        }
        let mapped = desc.normal_map.is_some() || desc.bump_map.is_some();
        Material {
            desc: desc.bsdf.clone(),
            normal_map: desc.normal_map.map(|(t, s)| (t.index(), s)),
            bump_map: desc.bump_map,
            coats,
            lobes,
            needs_tangents: anisotropic || mapped,
            // Which of them the material refers to is not worth finding out.
            needs_footprint: textures.any_footprint(),
        }
    }
}

fn coat_tables(coat: &Coat) -> Vec<CoatTable> {
    let table = |ax: f32, ay: f32| {
        CoatTable::new(
            coat.ior,
            ax,
            ay,
            coat.thickness,
            coat.g,
            Rgb::from_array(coat.albedo),
            coat.max_depth,
        )
    };
    match (coat.roughness.u, coat.roughness.v) {
        (FloatTex::Const(u), FloatTex::Const(v)) => {
            vec![table(
                width(u, coat.roughness.scale),
                width(v, coat.roughness.scale),
            )]
        }
        _ => COAT_WIDTHS.iter().map(|a| table(*a, *a)).collect(),
    }
}

/// From a roughness number to a GGX width.
fn width(x: f32, scale: RoughnessScale) -> f32 {
    let x = x.max(0.0);
    match scale {
        RoughnessScale::Alpha => x,
        RoughnessScale::Sqrt => x.sqrt(),
        RoughnessScale::Square => x * x,
    }
}

/// All materials of a scene.
pub struct Materials {
    /// Each refers only to materials before it.
    pub list: Vec<Material>,
}

/// A scattering function in its shading frame.
#[derive(Clone, Copy)]
pub struct Shading<'s> {
    /// Scattering, in the frame.
    pub bsdf: Bsdf<'s>,
    /// World to local and back.
    pub frame: Frame,
}

impl Materials {
    /// The scattering function at a point, or `None` where rays pass as if there were no surface.
    /// `u` picks one of mixed materials.
    #[inline]
    pub fn shade<'s>(
        &'s self,
        textures: &Textures,
        it: &Interaction,
        u: f32,
    ) -> Option<Shading<'s>> {
        let material = self.resolve(textures, it, u);
        let bsdf = material.bsdf(textures, &it.point)?;
        let frame = if material.needs_tangents {
            let ns = material.perturbed(textures, it);
            shading_frame(ns, it.dpdu)
        } else {
            Frame::from_normal(it.ns)
        };
        Some(Shading { bsdf, frame })
    }

    /// Follows mixes down to a material of its own.
    #[inline]
    fn resolve(&self, textures: &Textures, it: &Interaction, mut u: f32) -> &Material {
        let mut material = &self.list[it.material as usize];
        loop {
            match &material.desc {
                BsdfDesc::Mix { a, b, amount } => {
                    let amount = textures.float(amount, &it.point);
                    // What the choice leaves of the uniform number chooses again below.
                    if u < amount {
                        u /= amount;
                        material = &self.list[b.index()];
                    } else {
                        u = (u - amount) / (1.0 - amount);
                        material = &self.list[a.index()];
                    }
                }
                BsdfDesc::TwoSided { inner } => material = &self.list[inner.index()],
                _ => return material,
            }
        }
    }

    /// Whether a surface of this material needs tangents or footprints, whatever a mix picks.
    pub fn propagate_needs(&mut self) {
        for i in 0..self.list.len() {
            let inner = match &self.list[i].desc {
                BsdfDesc::Mix { a, b, .. } => vec![a.index(), b.index()],
                BsdfDesc::TwoSided { inner } => vec![inner.index()],
                _ => continue,
            };
            self.list[i].needs_tangents |= inner.iter().any(|j| self.list[*j].needs_tangents);
        }
    }
}

impl Material {
    #[inline]
    fn bsdf<'s>(&'s self, textures: &Textures, at: &Point) -> Option<Bsdf<'s>> {
        let color = |t: &model::ColorTex| textures.color(t, at).max(Rgb::ZERO);
        let albedo = |t: &model::ColorTex| textures.color(t, at).clamp(Rgb::ZERO, Rgb::ONE);
        let alpha = |r: &Roughness| {
            (
                width(textures.float(&r.u, at), r.scale),
                width(textures.float(&r.v, at), r.scale),
            )
        };
        let metal = |f: &ConductorFresnel| match f {
            ConductorFresnel::EtaK { eta, k } => (color(eta), color(k)),
            ConductorFresnel::Reflectance(r) => bsdf::conductor_k_from_reflectance(albedo(r)),
        };
        Some(match &self.desc {
            BsdfDesc::Diffuse { reflectance } => Bsdf::Diffuse(Diffuse::new(albedo(reflectance))),
            BsdfDesc::OrenNayar { reflectance, sigma } => Bsdf::OrenNayar(OrenNayar::new(
                albedo(reflectance),
                textures.float(sigma, at),
            )),
            BsdfDesc::Phong {
                diffuse,
                specular,
                exponent,
            } => Bsdf::Phong(Phong::new(
                albedo(diffuse),
                albedo(specular),
                textures.float(exponent, at).max(0.0),
            )),
            BsdfDesc::Lafortune { diffuse, .. } => {
                Bsdf::Lafortune(Lafortune::new(albedo(diffuse), &self.lobes))
            }
            BsdfDesc::Mirror { reflectance } => Bsdf::Mirror(Mirror::new(albedo(reflectance))),
            BsdfDesc::Dielectric {
                ior,
                roughness,
                reflect_tint,
                transmit_tint,
            } => {
                let (ax, ay) = alpha(roughness);
                Bsdf::Dielectric(Dielectric::new(
                    *ior,
                    ax,
                    ay,
                    color(reflect_tint),
                    color(transmit_tint),
                ))
            }
            BsdfDesc::ThinDielectric { ior } => Bsdf::ThinDielectric(ThinDielectric::new(*ior)),
            BsdfDesc::Conductor { fresnel, roughness } => {
                let (ax, ay) = alpha(roughness);
                let (eta, k) = metal(fresnel);
                Bsdf::Conductor(Conductor::new(eta, k, ax, ay))
            }
            BsdfDesc::CoatedDiffuse { reflectance, coat } => {
                let (ax, ay) = alpha(&coat.roughness);
                Bsdf::CoatedDiffuse(CoatedDiffuse::new(
                    albedo(reflectance),
                    self.coat(ax, ay),
                    ax,
                    ay,
                ))
            }
            BsdfDesc::CoatedConductor {
                fresnel,
                roughness,
                coat,
            } => {
                let (ax, ay) = alpha(roughness);
                let (eta, k) = metal(fresnel);
                let (cx, cy) = alpha(&coat.roughness);
                Bsdf::CoatedConductor(CoatedConductor::new(
                    eta,
                    k,
                    ax,
                    ay,
                    self.coat(cx, cy),
                    cx,
                    cy,
                ))
            }
            BsdfDesc::DiffuseTransmission {
                reflectance,
                transmittance,
            } => Bsdf::DiffuseTransmission(DiffuseTransmission::new(
                albedo(reflectance),
                albedo(transmittance),
            )),
            BsdfDesc::Interface => return None,
            BsdfDesc::Principled(_) | BsdfDesc::Hair { .. } => todo!("NEXT"),
            // Resolved before.
            BsdfDesc::Mix { .. } | BsdfDesc::TwoSided { .. } => return None,
        })
    }

    /// The table for a width: the only one, or the nearest.
    fn coat(&self, ax: f32, ay: f32) -> &CoatTable {
        if self.coats.len() == 1 {
            return &self.coats[0];
        }
        let alpha = (ax * ay).sqrt();
        let mut best = 0;
        for (i, w) in COAT_WIDTHS.iter().enumerate() {
            if (w - alpha).abs() < (COAT_WIDTHS[best] - alpha).abs() {
                best = i;
            }
        }
        &self.coats[best]
    }

    /// The shading normal after normal and bump maps.
    fn perturbed(&self, textures: &Textures, it: &Interaction) -> Vec3 {
        let mut ns = it.ns;
        if let Some((texture, strength)) = self.normal_map {
            let [r, g, b, _] = textures.eval(texture, &it.point);
            let local = Vec3::new(
                (2.0 * r - 1.0) * strength,
                (2.0 * g - 1.0) * strength,
                2.0 * b - 1.0,
            );
            if local.dot(local) > 0.0 {
                let mut frame = shading_frame(ns, it.dpdu);
                // The second axis follows v, also where the texture is mirrored.
                if frame.t.dot(it.dpdv) < 0.0 {
                    frame.t = -frame.t;
                }
                ns = math::normalize(frame.to_world(math::normalize(local)));
            }
        }
        if let Some(bump) = &self.bump_map {
            ns = bumped(textures, it, ns, bump);
        }
        // A normal that turns away from the geometric one makes black rims: keep it on its side.
        if ns.dot(it.ng) * it.ns.dot(it.ng) <= 0.0 {
            it.ns
        } else {
            ns
        }
    }
}

/// Normal of the surface displaced along its normal [Blinn78].
fn bumped(textures: &Textures, it: &Interaction, ns: Vec3, bump: &FloatTex) -> Vec3 {
    const STEP: f32 = 0.0005;
    let at = |du: f32, dv: f32| {
        let mut point = it.point;
        point.uv = point.uv.map(|uv| uv + Vec2::new(du, dv));
        point.p += it.dpdu * du + it.dpdv * dv;
        textures.float(bump, &point)
    };
    let here = at(0.0, 0.0);
    let dpdu = it.dpdu + ns * ((at(STEP, 0.0) - here) / STEP);
    let dpdv = it.dpdv + ns * ((at(0.0, STEP) - here) / STEP);
    let n = dpdu.cross(dpdv);
    if n.dot(n) > 0.0 && n.dot(n) < f32::INFINITY {
        math::faceforward(math::normalize(n), ns)
    } else {
        ns
    }
}
