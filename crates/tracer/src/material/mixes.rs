//! Mixed materials: what a mix is of, and whether its parts are added up or chosen from.

use super::{Material, Materials, Shading, Slots};
use crate::bsdf::{Bsdf, MIXED_MAX, Mixed};
use crate::geometry::Interaction;
use crate::math::Frame;
use crate::texture::Textures;
use glam::Vec3;
use scene::model::BsdfDesc;

/// What a mix is made of: materials and their shares.
#[derive(Default)]
struct Leaves {
    of: [(usize, f32); MIXED_MAX],
    len: usize,
}

impl Materials {
    /// A mix of which all parts share the frame.
    pub(super) fn sum<'s>(
        &'s self,
        textures: &Textures,
        it: &Interaction,
        wo: Vec3,
        slots: &'s Slots<'s>,
    ) -> Option<Shading<'s>> {
        let frame = Frame::from_normal(it.ns);
        let mut leaves = Leaves::default();
        self.add_leaves(textures, it, it.material as usize, 1.0, &mut leaves);
        let bsdf = |nth: usize| {
            let leaf = &self.list[leaves.of[nth].0];
            match leaf.constant {
                Some(bsdf) => Some(bsdf),
                None => leaf.bsdf(textures, it, it.ns, &frame, &slots.principled[nth]),
            }
        };
        let bsdf = if leaves.len == 1 {
            bsdf(0)?
        } else {
            let wo = frame.to_local(wo);
            let mut parts = [(Bsdf::Black, 0.0); MIXED_MAX];
            for (nth, part) in parts[..leaves.len].iter_mut().enumerate() {
                *part = (bsdf(nth)?, leaves.of[nth].1);
            }
            let mixed = Mixed::new(&parts[..leaves.len], wo);
            Bsdf::Mixed(slots.mixed.get_or_init(|| mixed))
        };
        Some(Shading {
            bsdf: slots.bsdf.get_or_init(|| bsdf),
            frame,
            unmapped: None,
            real: None,
            plain: true,
        })
    }

    /// Adds what a material is mixed of, each with its share, where that is not zero.
    fn add_leaves(
        &self,
        textures: &Textures,
        it: &Interaction,
        mut material: usize,
        mut share: f32,
        leaves: &mut Leaves,
    ) {
        loop {
            match &self.list[material].desc {
                BsdfDesc::Mix { a, b, amount } => {
                    let of_b = textures.float(amount, &it.point).clamp(0.0, 1.0);
                    let of_a = 1.0 - of_b;
                    if of_a > 0.0 && of_b > 0.0 {
                        self.add_leaves(textures, it, b.index(), share * of_b, leaves);
                        (material, share) = (a.index(), share * of_a);
                    } else {
                        material = if of_a > 0.0 { a.index() } else { b.index() };
                    }
                }
                BsdfDesc::TwoSided { inner } => material = inner.index(),
                _ => {
                    leaves.of[leaves.len] = (material, share);
                    leaves.len += 1;
                    return;
                }
            }
        }
    }

    /// Whether rays may pass a surface of this material as if it were not there.
    pub fn may_be_nothing(&self, material: u32) -> bool {
        // Materials refer to earlier ones only.
        let mut asked = vec![material as usize];
        let mut next = 0;
        while let Some(at) = asked.get(next) {
            let inner = match &self.list[*at].desc {
                BsdfDesc::Interface => return true,
                BsdfDesc::Mix { a, b, .. } => [a.index(), b.index()],
                BsdfDesc::TwoSided { inner } => [inner.index(); 2],
                _ => [*at; 2],
            };
            for inner in inner {
                if !asked.contains(&inner) {
                    asked.push(inner);
                }
            }
            next += 1;
        }
        false
    }

    /// Follows mixes down to a material of its own.
    #[inline]
    pub(super) fn resolve(&self, textures: &Textures, it: &Interaction, mut u: f32) -> &Material {
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
    pub(super) fn propagate_needs(&mut self) {
        for i in 0..self.list.len() {
            let inner = self.list[i].parts();
            self.list[i].needs_tangents |= inner.iter().any(|j| self.list[*j].needs_tangents);
        }
    }

    /// Finds the mixes that are sums: of a few materials that take the shading normal as it is. Where it
    /// makes a difference what lights are chosen for (`by_aim`), only of those that lights are chosen for
    /// alike: a highlight is worth more than the sum.
    pub fn find_sums(&mut self, by_aim: bool) {
        const NEVER: usize = MIXED_MAX + 1;
        let mut leaves: Vec<usize> = Vec::with_capacity(self.list.len());
        for material in &mut self.list {
            let inner = material.parts();
            let count = if inner.is_empty() {
                let is_one = material.keeps_normal() && !(by_aim && material.aims());
                if is_one { 1 } else { NEVER }
            } else {
                inner.iter().map(|j| leaves[*j]).sum::<usize>().min(NEVER)
            };
            material.is_sum = !material.needs_tangents && (2..NEVER).contains(&count);
            leaves.push(count);
        }
    }
}

impl Material {
    /// What a mix refers to.
    fn parts(&self) -> Vec<usize> {
        match &self.desc {
            BsdfDesc::Mix { a, b, .. } => vec![a.index(), b.index()],
            BsdfDesc::TwoSided { inner } => vec![inner.index()],
            _ => vec![],
        }
    }

    /// Whether there is a surface, and its frame any about the surface's own normal.
    fn keeps_normal(&self) -> bool {
        !(matches!(self.desc, BsdfDesc::Interface) || self.needs_tangents || self.refracts)
    }

    /// Whether lights are chosen for other than by the cosine, see [`Bsdf::reach`].
    fn aims(&self) -> bool {
        matches!(
            self.desc,
            BsdfDesc::Conductor { .. }
                | BsdfDesc::CoatedConductor { .. }
                | BsdfDesc::Principled(_)
                | BsdfDesc::Dielectric { .. }
                | BsdfDesc::Hair { .. }
        )
    }
}
