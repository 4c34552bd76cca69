//! Materials: from a description and a point on a surface to a [`Bsdf`].

mod mixes;

use crate::bsdf::{
    self, Bsdf, BsdfSample, CoatTable, CoatedConductor, CoatedDiffuse, Conductor, Curve,
    Dielectric, Diffuse, DiffuseTransmission, Facets, Hair, Lafortune, LobeParam, MIXED_MAX,
    Mirror, Mixed, OrenNayar, Phong, Principled, PrincipledParams, PrincipledTables, Reach,
    ThinDielectric,
};
use crate::geometry::Interaction;
use crate::geometry::interaction::shading_frame;
use crate::light::Aim;
use crate::math::{self, Frame, Rgb};
use crate::texture::Textures;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use scene::model::{
    self, BsdfDesc, Coat, ConductorFresnel, FloatTex, HairColor, Roughness, RoughnessScale,
};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A material ready for use.
pub struct Material {
    desc: BsdfDesc,
    /// The scattering function, where it is the same at every point.
    constant: Option<Bsdf<'static>>,
    normal_map: Option<(usize, f32)>,
    bump_map: Option<FloatTex>,
    /// Tables over the coat's width: one if that is constant, else one for each of [`COAT_WIDTHS`].
    coats: Vec<CoatTable>,
    lobes: Vec<LobeParam>,
    /// Of a principled surface.
    tables: Option<PrincipledTables>,
    /// The surface's texture coordinates or colours matter.
    pub needs_coordinates: bool,
    /// Light may go through and is bent there.
    refracts: bool,
    /// The surface's tangents matter.
    pub needs_tangents: bool,
    /// Some texture makes use of what a pixel covers.
    pub needs_footprint: bool,
    /// A mix whose parts are all seen at once ([`Mixed`]).
    is_sum: bool,
}

/// GGX widths that coats of varying roughness are tabulated at; the nearest is taken.
const COAT_WIDTHS: [f32; 8] = [0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0];

impl Material {
    /// Compiles a description, all but the tables that materials share.
    fn new(desc: &model::Material, textures: &Textures) -> Material {
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
            BsdfDesc::Hair { .. } => anisotropic = true,
            BsdfDesc::Principled(p) => {
                anisotropic = p.anisotropy != FloatTex::Const(0.0) || p.coat_normal_map.is_some();
            }
            _ => {}
        }
        let refracts = match &desc.bsdf {
            BsdfDesc::Dielectric { .. } => true,
            BsdfDesc::Principled(p) => p.transmission != FloatTex::Const(0.0) && !p.thin,
            _ => false,
        };
        let mapped = desc.normal_map.is_some() || desc.bump_map.is_some();
        let constant = constant(&desc.bsdf);
        let varies = constant.is_none() || anisotropic || mapped;
        Material {
            desc: desc.bsdf.clone(),
            needs_coordinates: varies,
            constant,
            normal_map: desc.normal_map.map(|(t, s)| (t.index(), s)),
            bump_map: desc.bump_map,
            coats,
            lobes,
            tables: None,
            refracts,
            needs_tangents: anisotropic || mapped,
            // Which of them the material refers to is not worth finding out.
            needs_footprint: varies && textures.any_footprint(),
            is_sum: false,
        }
    }
}

/// The scattering function of a description that refers to no texture and to no table.
fn constant(desc: &BsdfDesc) -> Option<Bsdf<'static>> {
    let color = |t: &model::ColorTex| match t {
        model::ColorTex::Const(c) => Some(Rgb::from_array(*c).max(Rgb::ZERO)),
        _ => None,
    };
    let albedo = |t: &model::ColorTex| color(t).map(|c| c.min(Rgb::ONE));
    let float = |t: &FloatTex| match t {
        FloatTex::Const(x) => Some(*x),
        _ => None,
    };
    let alpha = |r: &Roughness| {
        let (u, v) = (float(&r.u)?, float(&r.v)?);
        Some((width(u, r.scale), width(v, r.scale)))
    };
    Some(match desc {
        BsdfDesc::Diffuse { reflectance } => Bsdf::Diffuse(Diffuse::new(albedo(reflectance)?)),
        BsdfDesc::OrenNayar { reflectance, sigma } => {
            Bsdf::OrenNayar(OrenNayar::new(albedo(reflectance)?, float(sigma)?))
        }
        BsdfDesc::Mirror { reflectance } => Bsdf::Mirror(Mirror::new(albedo(reflectance)?)),
        BsdfDesc::Dielectric {
            ior,
            roughness,
            reflect_tint,
            transmit_tint,
        } => {
            let (ax, ay) = alpha(roughness)?;
            let tints = (color(reflect_tint)?, color(transmit_tint)?);
            Bsdf::Dielectric(Dielectric::new(*ior, ax, ay, tints.0, tints.1))
        }
        BsdfDesc::Conductor { fresnel, roughness } => {
            let (ax, ay) = alpha(roughness)?;
            let (eta, k) = match fresnel {
                ConductorFresnel::EtaK { eta, k } => (color(eta)?, color(k)?),
                ConductorFresnel::Reflectance(r) => bsdf::conductor_k_from_reflectance(albedo(r)?),
            };
            Bsdf::Conductor(Conductor::new(eta, k, ax, ay))
        }
        _ => return None,
    })
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

/// Where a scattering function lives that is made for one point: the caller has room for it, so that
/// nothing large is moved about.
#[derive(Default)]
pub struct Slots<'s> {
    bsdf: Slot<Bsdf<'s>>,
    mixed: Slot<Mixed<'s>>,
    principled: [Slot<Principled<'s>>; MIXED_MAX],
}

/// Room that is filled at most once.
type Slot<T> = std::cell::OnceCell<T>;

/// A scattering function in its shading frame.
#[derive(Clone, Copy)]
pub struct Shading<'s> {
    /// Scattering, in the frame.
    pub bsdf: &'s Bsdf<'s>,
    /// World to local and back.
    pub frame: Frame,
    /// Where a normal or bump map has turned the frame: the unmapped shading normal, in the frame.
    unmapped: Option<Vec3>,
    /// Of glass whose shading normal is not the geometric one: that one, in the frame.
    real: Option<Vec3>,
    /// See [`Shading::is_plain`].
    plain: bool,
}

impl<'s> Shading<'s> {
    /// Another scattering function in the same frame.
    #[inline]
    pub fn with(self, bsdf: &'s Bsdf<'s>) -> Shading<'s> {
        Shading {
            bsdf,
            real: None,
            ..self
        }
    }
}

impl Shading<'_> {
    /// Whether the frame is any frame about the surface's own normal, and nothing is corrected.
    #[inline]
    pub(crate) fn is_plain(&self) -> bool {
        self.plain
    }

    /// What lights are chosen for, with `wo` in the frame.
    #[inline]
    pub fn aim(&self, wo: Vec3) -> Aim {
        match self.bsdf.reach() {
            Reach::Cosine => Aim::cosine(self.frame.n),
            Reach::Mirrored(narrow) => Aim {
                axis: self.frame.to_world(Vec3::new(-wo.x, -wo.y, wo.z)),
                narrow,
            },
            Reach::Anywhere => Aim::ANYWHERE,
        }
    }

    /// [`Bsdf::eval_pdf`] in the frame, with the terminator of mapped normals softened.
    #[inline]
    pub fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let (f, pdf) = self.bsdf.eval_pdf(wo, wi);
        match self.unmapped {
            Some(n) => (f * terminator(n, wo, wi), pdf),
            None => (f, pdf),
        }
    }

    /// [`Bsdf::sample`] in the frame, with the terminator of mapped normals softened.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let mut s = self.bsdf.sample(wo, u_lobe, u)?;
        if let (Some(n), false) = (self.unmapped, s.delta) {
            s.weight *= terminator(n, wo, s.wi);
        }
        if let (Some(n), true, true) = (self.real, s.delta, s.transmitted) {
            s.wi = across(n, wo, s.wi);
        }
        Some(s)
    }
}

/// The direction of refracted light turned so far that it leaves on the other side of the surface with
/// normal `n` than `wo`: interpolated normals may bend it back at grazing angles, and light that counts
/// as gone through but is still inside would carry the wrong radiance ever after.
fn across(n: Vec3, wo: Vec3, wi: Vec3) -> Vec3 {
    let side = if math::dot(n, wo) < 0.0 { -1.0 } else { 1.0 };
    let height = math::dot(n, wi) * side;
    if height < 0.0 {
        return wi;
    }
    math::normalize(wi - n * ((height + LEAST) * side))
}

/// Least height above a surface that directions and normals are lifted to.
const LEAST: f32 = 0.01;

/// A normal turned so far that `wo` sees it and that its mirror direction lies on the same side of the
/// surface with normal `base` as `wo`: what is turned away, or mirrors light into the surface, makes
/// black rims.
fn visible(normal: Vec3, base: Vec3, wo: Vec3) -> Vec3 {
    let up = math::faceforward(base, wo);
    let side = if up == base { 1.0 } else { -1.0 };
    let mut seen = normal * side;
    let cos = seen.dot(wo);
    if cos < LEAST {
        seen = math::normalize(seen + wo * (LEAST - cos));
    }
    bsdf::lifted(wo, seen, up) * side
}

/// Factor in [0, 1] on reflected light where a map has turned the normal away from `n`: light that grazes
/// the real surface lights a facet turned towards it fully up to the moment it sets, which shows as a
/// hard, jagged edge. The facet is darkened as if bumps of its slope shaded each other: with g = (n.i)
/// / ((n'.i) (n.n')), g + g^2 - g^3 up to g = 1 [Chiang19, eq. 3]. Darkens only; light from behind the
/// real surface is cut.
#[inline]
fn terminator(n: Vec3, wo: Vec3, wi: Vec3) -> f32 {
    if wo.z * wi.z <= 0.0 {
        return 1.0;
    }
    let side = if wo.z < 0.0 { -1.0 } else { 1.0 };
    let real = math::dot(n, wi) * side;
    if real <= 0.0 {
        return 0.0;
    }
    let g = real / (wi.z.abs() * n.z);
    if g < 1.0 && g > 0.0 {
        g + g * g - g * g * g
    } else {
        1.0
    }
}

impl Materials {
    /// Compiles descriptions, and the tables that they share.
    pub fn new(described: &[model::Material], textures: &Textures) -> Materials {
        let mut list: Vec<Material> = described
            .par_iter()
            .map(|material| Material::new(material, textures))
            .collect();
        // Curves by (bits of the index, sheet, solid), so that each is made once.
        let mut curves: BTreeMap<(u32, bool, bool), Option<Arc<Curve>>> = BTreeMap::new();
        let mut sheen = false;
        for material in &list {
            if let BsdfDesc::Principled(p) = &material.desc {
                sheen |= p.sheen_color != model::ColorTex::Const([0.0; 3]);
                curves.insert(base_curve(p), None);
                curves.insert(coat_curve(p), None);
            }
        }
        if !curves.is_empty() {
            let facets = Arc::new(Facets::new(sheen));
            curves
                .par_iter_mut()
                .for_each(|((ior, pane, solid), curve)| {
                    *curve = Some(Arc::new(Curve::new(f32::from_bits(*ior), *pane, *solid)));
                });
            for material in &mut list {
                if let BsdfDesc::Principled(p) = &material.desc
                    && let Some(Some(base)) = curves.get(&base_curve(p))
                    && let Some(Some(coat)) = curves.get(&coat_curve(p))
                {
                    material.tables = Some(PrincipledTables {
                        facets: facets.clone(),
                        base: base.clone(),
                        coat: coat.clone(),
                    });
                }
            }
        }
        let mut materials = Materials { list };
        materials.propagate_needs();
        materials
    }

    /// The scattering function at a point seen from `wo`, or `None` where rays pass as if there were no
    /// surface. `u` picks one of mixed materials that are no sum; `slots` are fresh ones.
    #[inline]
    pub fn shade<'s>(
        &'s self,
        textures: &Textures,
        it: &Interaction,
        wo: Vec3,
        u: f32,
        slots: &'s Slots<'s>,
    ) -> Option<Shading<'s>> {
        let mut material = &self.list[it.material as usize];
        let bends = material.refracts && it.ns != it.ng;
        if let (Some(bsdf), false, false) = (&material.constant, material.needs_tangents, bends) {
            return Some(Shading {
                bsdf,
                frame: Frame::from_normal(it.ns),
                unmapped: None,
                real: None,
                plain: true,
            });
        }
        if material.is_sum {
            return self.sum(textures, it, wo, slots);
        }
        material = self.resolve(textures, it, u);
        let (mut ns, mut base) = (it.ns, it.ns);
        if material.needs_tangents {
            (ns, base) = material.perturbed(textures, it);
        }
        let mapped = ns != it.ns;
        // Seen edge on, a surface has no side to turn normals to.
        if mapped && it.ns.dot(wo).abs() > LEAST {
            ns = visible(ns, it.ns, wo);
        }
        // Glass must agree with its geometry about which side is which: what leaks out as if reflected
        // would keep the radiance that it has inside.
        let glass = material.refracts && ns != it.ng;
        if glass {
            ns = visible(ns, it.ng, wo);
        }
        let frame = if material.needs_tangents {
            material.turned(textures, it, shading_frame(ns, it.map_axes().0))
        } else {
            Frame::from_normal(ns)
        };
        let bsdf = match &material.constant {
            Some(bsdf) => bsdf,
            None => {
                let bsdf = material.bsdf(textures, it, base, &frame, &slots.principled[0])?;
                slots.bsdf.get_or_init(|| bsdf)
            }
        };
        Some(Shading {
            bsdf,
            frame,
            unmapped: mapped.then(|| frame.to_local(it.ns)),
            real: glass.then(|| frame.to_local(it.ng)),
            plain: !(material.needs_tangents || glass),
        })
    }

    /// Whether rays always pass a surface of this material as if it were not there.
    pub fn is_interface(&self, material: u32) -> bool {
        matches!(self.list[material as usize].desc, BsdfDesc::Interface)
    }

    /// Asks for texture coordinates everywhere: somebody wants to look at them.
    pub fn show_coordinates(&mut self) {
        for material in &mut self.list {
            material.needs_coordinates = true;
        }
    }
}

impl Material {
    /// The scattering function, where it takes nothing but the shading normal (which for glass must be the
    /// geometric one).
    pub(crate) fn plain_bsdf(&self) -> Option<&Bsdf<'static>> {
        let asks = self.needs_tangents || self.needs_coordinates || self.needs_footprint;
        self.constant.as_ref().filter(|_| !asks)
    }

    /// The scattering function of a material that is no mix. `base` is the normal that maps give, before
    /// the frame was turned for the view.
    fn bsdf<'s>(
        &'s self,
        textures: &Textures,
        it: &Interaction,
        base: Vec3,
        frame: &Frame,
        slot: &'s Slot<Principled<'s>>,
    ) -> Option<Bsdf<'s>> {
        let at = &it.point;
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
            BsdfDesc::Principled(p) => self.principled(p, textures, it, base, frame, slot)?,
            BsdfDesc::Hair {
                color: pigment,
                ior,
                beta_m,
                beta_n,
                alpha: tilt,
            } => {
                let beta_n = textures.float(beta_n, at);
                let absorption = match pigment {
                    HairColor::Absorption(c) => color(c),
                    HairColor::Reflectance(c) => Hair::absorption_of(albedo(c), beta_n),
                    HairColor::Melanin {
                        eumelanin,
                        pheomelanin,
                    } => Hair::absorption_of_melanin(
                        textures.float(eumelanin, at),
                        textures.float(pheomelanin, at),
                    ),
                };
                // v runs across the strand.
                let h = 2.0 * at.uv[0].y - 1.0;
                let beta_m = textures.float(beta_m, at);
                Bsdf::Hair(Hair::new(h, *ior, absorption, beta_m, beta_n, *tilt))
            }
            // Resolved before.
            BsdfDesc::Mix { .. } | BsdfDesc::TwoSided { .. } => return None,
        })
    }

    #[inline(never)]
    fn principled<'s>(
        &'s self,
        p: &model::Principled,
        textures: &Textures,
        it: &Interaction,
        base: Vec3,
        frame: &Frame,
        slot: &'s Slot<Principled<'s>>,
    ) -> Option<Bsdf<'s>> {
        let at = &it.point;
        let float = |t: &FloatTex| textures.float(t, at);
        let color = |t: &model::ColorTex| textures.color(t, at);
        let coat = float(&p.coat);
        let coat_normal = if coat > 0.0 {
            let n = match p.coat_normal_map {
                Some((texture, strength)) => mapped(textures, it, texture.index(), strength).0,
                None => it.ns,
            };
            frame.to_local(n)
        } else {
            Vec3::Z
        };
        let iridescence = float(&p.iridescence);
        let params = PrincipledParams {
            base_color: color(&p.base_color),
            metallic: float(&p.metallic),
            roughness: float(&p.roughness),
            anisotropy: float(&p.anisotropy),
            specular: float(&p.specular),
            specular_color: color(&p.specular_color),
            metal_edge: color(&p.metal_edge),
            transmission: float(&p.transmission),
            thin: p.thin,
            diffuse_transmission: float(&p.diffuse_transmission),
            diffuse_transmission_color: color(&p.diffuse_transmission_color),
            base_normal: if base == frame.n {
                Vec3::Z
            } else {
                frame.to_local(base)
            },
            coat,
            coat_roughness: float(&p.coat_roughness),
            coat_normal,
            sheen_color: color(&p.sheen_color),
            sheen_roughness: float(&p.sheen_roughness),
            iridescence,
            iridescence_ior: p.iridescence_ior,
            iridescence_thickness: if iridescence > 0.0 {
                float(&p.iridescence_thickness)
            } else {
                0.0
            },
        };
        let tables = self.tables.as_ref()?;
        Some(Bsdf::Principled(
            slot.get_or_init(|| Principled::new(tables, &params)),
        ))
    }

    /// The frame with its first axis along the stretch of the highlight.
    fn turned(&self, textures: &Textures, it: &Interaction, frame: Frame) -> Frame {
        let BsdfDesc::Principled(p) = &self.desc else {
            return frame;
        };
        if p.anisotropy == FloatTex::Const(0.0) {
            return frame;
        }
        let mut along = Vec2::X;
        if let Some(texture) = p.anisotropy_direction {
            let [x, y, ..] = textures.eval(texture.index(), &it.point);
            along = Vec2::new(2.0 * x - 1.0, 2.0 * y - 1.0);
        }
        let turn = textures.float(&p.anisotropy_rotation, &it.point) * (1.0 / 360.0);
        let (sin, cos) = math::sin_cos_2pi(turn - turn.floor());
        let along = Vec2::new(along.x * cos - along.y * sin, along.x * sin + along.y * cos);
        // The second axis follows v, also where the texture is mirrored.
        let t = if frame.t.dot(it.map_axes().1) < 0.0 {
            -frame.t
        } else {
            frame.t
        };
        shading_frame(frame.n, frame.s * along.x + t * along.y)
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

    /// The shading normal after normal and bump maps: one that points out of the surface, and the map's own.
    fn perturbed(&self, textures: &Textures, it: &Interaction) -> (Vec3, Vec3) {
        if self.normal_map.is_none() && self.bump_map.is_none() {
            return (it.ns, it.ns);
        }
        let (mut ns, mut base) = (it.ns, it.ns);
        if let Some((texture, strength)) = self.normal_map {
            (ns, base) = mapped(textures, it, texture, strength);
        }
        if let Some(bump) = &self.bump_map {
            ns = bumped(textures, it, ns, bump);
            base = ns;
        }
        // Nor may it turn away from the geometric normal.
        if ns.dot(it.ng) * it.ns.dot(it.ng) <= 0.0 {
            return (it.ns, it.ns);
        }
        (ns, base)
    }
}

/// Which curves of reflectance a material needs: bits of the index, sheet, solid.
fn base_curve(p: &model::Principled) -> (u32, bool, bool) {
    let transmits = p.transmission != FloatTex::Const(0.0);
    (p.ior.to_bits(), p.thin, transmits && !p.thin && p.ior > 0.0)
}

fn coat_curve(p: &model::Principled) -> (u32, bool, bool) {
    (p.coat_ior.to_bits(), false, false)
}

/// Least height of the normals of a normal map, before it is scaled to unit length.
const STEEPEST: f32 = 0.05;

/// The shading normal after a tangent-space normal map: one that points out of the surface, and the map's
/// own.
fn mapped(textures: &Textures, it: &Interaction, texture: usize, strength: f32) -> (Vec3, Vec3) {
    let [r, g, b, _] = textures.eval(texture, &it.point);
    let local = Vec3::new(
        (2.0 * r - 1.0) * strength,
        (2.0 * g - 1.0) * strength,
        2.0 * b - 1.0,
    );
    if local.dot(local) <= 0.0 {
        return (it.ns, it.ns);
    }
    let (along, up) = it.map_axes();
    let mut frame = shading_frame(it.ns, along);
    // The second axis follows v, also where the texture is mirrored.
    if frame.t.dot(up) < 0.0 {
        frame.t = -frame.t;
    }
    let outward = |local: Vec3| math::normalize(frame.to_world(math::normalize(local)));
    let own = outward(local);
    if local.z >= STEEPEST {
        return (own, own);
    }
    // Maps that point into the surface go to its horizon: the normal must not leap back where a slope
    // grows too steep.
    (outward(local.with_z(STEEPEST)), own)
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
