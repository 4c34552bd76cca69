//! Morph targets and skins: the vertices of a primitive in a pose.

use super::Gltf;
use super::animation::Path;
use super::mesh::{Attributes, Raw};
use super::properties as known;
use super::tree::At;
use crate::context::Issue;
use crate::model::{Deformation, DeformationKey, Mesh};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;

/// Joints of each vertex and how much it follows them.
pub(super) struct Influence {
    pub joints: Vec<[u32; 4]>,
    pub weights: Vec<[f32; 4]>,
}

/// Differences that a morph target adds; each empty or one for every vertex.
#[derive(Default)]
pub(super) struct Target {
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    pub tangents: Vec<[f32; 3]>,
}

/// Joints of a skin, each with the map from the mesh's rest pose into the joint.
pub(super) struct Skin {
    joints: Vec<(usize, DAffine3)>,
}

/// Vertices at one time.
struct Pose {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    tangents: Vec<[f32; 4]>,
}

impl<'j> Gltf<'_, '_, 'j> {
    pub(super) fn influences(
        &mut self,
        reader: &Attributes<'_, 'j>,
        raw: &mut Raw,
    ) -> Result<(), Issue> {
        let count = raw.positions.len();
        for set in 0.. {
            let (joints, weights) = (format!("JOINTS_{set}"), format!("WEIGHTS_{set}"));
            let pair = (
                reader.floats(self, &joints, 4)?,
                reader.floats(self, &weights, 4)?,
            );
            let (joints, weights) = match pair {
                (None, None) => return Ok(()),
                (Some(joints), Some(weights)) => (joints, weights),
                _ => {
                    return Err(reader
                        .at
                        .fail(format!("{joints} and {weights} come together")));
                }
            };
            if joints.len() != 4 * count || weights.len() != 4 * count {
                return Err(reader
                    .at
                    .fail(format!("joints or weights for other than {count} vertices")));
            }
            raw.influences.push(Influence {
                // Whole numbers up to 65,535, which singles hold exactly.
                joints: joints
                    .as_chunks::<4>()
                    .0
                    .iter()
                    .map(|j| j.map(|j| j as u32))
                    .collect(),
                weights: weights.as_chunks::<4>().0.to_vec(),
            });
        }
        Ok(())
    }

    pub(super) fn targets(&mut self, at: &At<'j>, count: usize) -> Result<Vec<Target>, Issue> {
        let mut out = Vec::new();
        for target in at.items("targets")? {
            let mut read = Target::default();
            for (name, place) in target.members()? {
                let to = match name {
                    "POSITION" => &mut read.positions,
                    "NORMAL" => &mut read.normals,
                    "TANGENT" => &mut read.tangents,
                    _ => {
                        self.cx.warn(
                            &place.place(),
                            format!("morphing {name} is not supported; it stays as it is"),
                        );
                        continue;
                    }
                };
                let accessor = self.accessor(place.as_index(&self.root, "accessors")?)?;
                *to = accessor.rows::<3>()?;
                if to.len() != count {
                    return Err(place.fail(format!("{} elements for {count} vertices", to.len())));
                }
            }
            out.push(read);
        }
        Ok(out)
    }

    /// The skin of a node.
    pub(super) fn skin(&mut self, node: &At<'j>) -> Result<Option<Skin>, Issue> {
        let Some(index) = node.index("skin", &self.root, "skins")? else {
            return Ok(None);
        };
        let at = self.list_item("skins", index)?;
        at.only(known::SKIN, self.cx)?;
        let mut joints = Vec::new();
        for joint in at.items("joints")? {
            let index = joint.as_index(&self.root, "nodes")?;
            if self.nodes[index].is_none() {
                return Err(
                    joint.fail(format!("joint {index} is not among the nodes of the scene"))
                );
            }
            joints.push((index, DAffine3::IDENTITY));
        }
        if joints.is_empty() {
            return Err(at.fail("a skin without joints"));
        }
        if let Some(index) = at.index("inverseBindMatrices", &self.root, "accessors")? {
            let accessor = self.accessor(index)?;
            let rows = accessor.rows::<16>()?;
            if rows.len() < joints.len() {
                return Err(accessor.at.fail(format!(
                    "{} matrices for {} joints",
                    rows.len(),
                    joints.len()
                )));
            }
            for ((_, inverse), m) in joints.iter_mut().zip(&rows) {
                // The last row is 0 0 0 1 up to rounding; nothing else makes sense here.
                *inverse = DAffine3::from_mat4(glam::DMat4::from_cols_array(&m.map(f64::from)));
            }
        }
        Ok(Some(Skin { joints }))
    }

    /// The weights of a mesh's morph targets at a node and a time.
    fn morph_weights(&self, node: usize, rest: &[f64], time: f64) -> Vec<f64> {
        match self.animations.channels.get(&(node, Path::Weights)) {
            Some(channel) => channel.at(time),
            None => rest.to_vec(),
        }
    }

    /// When the shape changes at a node; empty where it does not.
    pub(super) fn shape_times(&self, node: usize, skin: Option<&Skin>, raw: &Raw) -> Vec<f64> {
        let mut nodes = Vec::new();
        for (joint, _) in skin.iter().flat_map(|s| &s.joints) {
            nodes.extend(self.chain(*joint));
        }
        nodes.sort_unstable();
        nodes.dedup();
        let morphs = !raw.targets.is_empty();
        // Between keys vertices go straight: what turns needs them close together.
        self.animations
            .key_times(&nodes, morphs.then_some(node), !nodes.is_empty())
    }

    /// A mesh in its pose, or in all of them if it moves. With a skin its vertices are in world
    /// space, since the node's own placement does not count.
    pub(super) fn posed(
        &mut self,
        at: &At<'j>,
        mesh: &mut Mesh,
        raw: &Raw,
        node: usize,
        skin: Option<&Skin>,
        rest: &[f64],
    ) -> Result<(), Issue> {
        let times = self.shape_times(node, skin, raw);
        let each =
            (raw.positions.len() * (12 + if raw.normals.is_empty() { 0 } else { 12 })) as u64;
        self.cx
            .charge(&at.place(), each.saturating_mul(times.len() as u64))?;
        let links = raw.targets.len() + 4 * raw.influences.len() + 1;
        let work = (raw.positions.len() as u64).saturating_mul(links as u64);
        self.work(at, work.saturating_mul(times.len().max(1) as u64))?;
        if let Some(skin) = skin
            && raw.influences.is_empty()
        {
            return Err(at.fail(format!(
                "a skin of {} joints on a mesh without JOINTS_0",
                skin.joints.len()
            )));
        }
        let first = times.first().copied().unwrap_or(0.0);
        let pose = self.pose(at, raw, node, skin, rest, first)?;
        mesh.positions = Arc::new(pose.positions);
        mesh.normals = Arc::new(pose.normals);
        mesh.tangents = Arc::new(pose.tangents);
        let mut keys = Vec::with_capacity(times.len());
        for &time in times.iter().skip(1) {
            let pose = self.pose(at, raw, node, skin, rest, time)?;
            keys.push(DeformationKey {
                time,
                positions: pose.positions,
                normals: pose.normals,
            });
        }
        let moves = keys.iter().any(|k| k.positions != *mesh.positions);
        if moves {
            mesh.deformation = Some(Arc::new(Deformation {
                first_time: first,
                keys,
            }));
        }
        Ok(())
    }

    fn pose(
        &self,
        at: &At<'j>,
        raw: &Raw,
        node: usize,
        skin: Option<&Skin>,
        rest: &[f64],
        time: f64,
    ) -> Result<Pose, Issue> {
        let mut pose = Pose {
            positions: raw.positions.clone(),
            normals: raw.normals.clone(),
            tangents: raw.tangents.clone(),
        };
        let weights = self.morph_weights(node, rest, time);
        for (target, &weight) in raw.targets.iter().zip(&weights) {
            if weight == 0.0 {
                continue;
            }
            add(&mut pose.positions, &target.positions, weight);
            add(&mut pose.normals, &target.normals, weight);
            for (to, by) in pose.tangents.iter_mut().zip(&target.tangents) {
                for i in 0..3 {
                    to[i] = (f64::from(to[i]) + weight * f64::from(by[i])) as f32;
                }
            }
        }
        let Some(skin) = skin else {
            return Ok(pose);
        };
        let joints: Vec<DAffine3> = skin
            .joints
            .iter()
            .map(|(joint, inverse)| self.world(*joint, time) * *inverse)
            .collect();
        for vertex in 0..pose.positions.len() {
            let Some(m) = blend(raw, vertex, &joints) else {
                return Err(at.fail(format!(
                    "vertex {vertex} follows a joint that the skin does not have"
                )));
            };
            let wide = |p: [f32; 3]| DVec3::from_array(p.map(f64::from));
            let narrow = |p: DVec3| p.to_array().map(|x| x as f32);
            let p = &mut pose.positions[vertex];
            *p = narrow(m.transform_point3(wide(*p)));
            if let Some(n) = pose.normals.get_mut(vertex) {
                // The cofactors turn normals as the matrix turns planes, mirrors included.
                let [x, y, z] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis];
                let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
                *n = narrow((cofactors * wide(*n)).normalize_or_zero());
            }
            if let Some(t) = pose.tangents.get_mut(vertex) {
                let [x, y, z, w] = *t;
                let turned = narrow(m.transform_vector3(wide([x, y, z])).normalize_or_zero());
                *t = [turned[0], turned[1], turned[2], w];
            }
        }
        Ok(pose)
    }
}

fn add(to: &mut [[f32; 3]], by: &[[f32; 3]], weight: f64) {
    for (to, by) in to.iter_mut().zip(by) {
        for i in 0..3 {
            to[i] = (f64::from(to[i]) + weight * f64::from(by[i])) as f32;
        }
    }
}

/// The mean of the joints' maps by a vertex's weights; none where it names a joint that is not there.
fn blend(raw: &Raw, vertex: usize, joints: &[DAffine3]) -> Option<DAffine3> {
    let (mut sum, mut total) = (DMat3::ZERO, 0.0);
    let mut translation = DVec3::ZERO;
    for set in &raw.influences {
        for (joint, weight) in set.joints[vertex].iter().zip(set.weights[vertex]) {
            if weight != 0.0 {
                let m = joints.get(*joint as usize)?;
                let weight = f64::from(weight);
                sum += m.matrix3 * weight;
                translation += m.translation * weight;
                total += weight;
            }
        }
    }
    // Weights should add up to 1; quantised ones do so roughly.
    if total <= 0.0 {
        return joints.first().copied();
    }
    Some(DAffine3 {
        matrix3: sum * (1.0 / total),
        translation: translation / total,
    })
}
