//! What hangs on nodes, put into the scene: pieces of meshes once where they are used, or as
//! instances where that saves memory.

use super::Gltf;
use super::deform::Skin;
use super::materials::Surface;
use super::mesh::{Raw, finish};
use super::properties as known;
use super::tree::At;
use crate::context::Issue;
use crate::model::{Group, GroupId, Instance, Mesh, MeshId, Motion, Primitive, Shape};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::collections::BTreeMap;
use std::rc::Rc;

/// Copies beyond this many triangles of one mesh become instances. Below, one tree over everything
/// is faster to trace than trees within trees.
const MAX_COPIED: u64 = 1 << 17;

/// Rough memory of a placed primitive or instance.
const PLACED_BYTES: u64 = 320;

/// A primitive of a mesh, ready to be placed.
pub(super) struct Placed {
    at_pointer: String,
    raw: Raw,
    surface: Surface,
    /// The mesh in its rest pose, if anything shows it so.
    mesh: std::cell::Cell<Option<MeshId>>,
}

/// How often each mesh is placed.
pub(super) struct Uses {
    count: BTreeMap<usize, u64>,
    groups: BTreeMap<usize, GroupId>,
}

impl<'j> Gltf<'_, '_, 'j> {
    /// Counts how often each mesh is placed.
    pub(super) fn uses(&mut self, order: &[usize]) -> Result<std::cell::RefCell<Uses>, Issue> {
        let mut count = BTreeMap::new();
        for &node in order {
            let Some(at) = self.nodes[node].as_ref().map(|n| n.at.clone()) else {
                continue;
            };
            if let Some(mesh) = at.index("mesh", &self.root, "meshes")? {
                *count.entry(mesh).or_insert(0) += 1;
            }
        }
        Ok(std::cell::RefCell::new(Uses {
            count,
            groups: BTreeMap::new(),
        }))
    }

    /// Puts the mesh of a node into the scene.
    pub(super) fn place(
        &mut self,
        node: usize,
        uses: &std::cell::RefCell<Uses>,
    ) -> Result<(), Issue> {
        let Some(at) = self.nodes[node].as_ref().map(|n| n.at.clone()) else {
            return Ok(());
        };
        let Some(index) = at.index("mesh", &self.root, "meshes")? else {
            if let Some(skin) = at.get("skin") {
                self.cx
                    .warn(&skin.place(), "a skin without a mesh is ignored");
            }
            return Ok(());
        };
        let pieces = self.pieces(index)?;
        let mesh_at = self.list_item("meshes", index)?;
        let weights = self.rest_weights(&at, &mesh_at)?;
        let skin = self.skin(&at)?;
        let copies = self.copies(&at)?;
        let placed = copies.as_ref().map_or(1, |c| c.len() as u64);
        self.cx
            .charge(&at.place(), PLACED_BYTES * placed * pieces.len() as u64)?;
        let own_shape = skin.is_some() || pieces.iter().any(|p| !p.raw.targets.is_empty());
        if own_shape {
            if copies.is_some() {
                self.cx.warn(
                    &at.place(),
                    "instances of a mesh that changes its shape are not supported; it is shown once",
                );
            }
            return self.place_posed(&at, node, &pieces, skin.as_ref(), &weights);
        }
        let triangles: u64 = pieces.iter().map(|p| p.raw.indices.len() as u64).sum();
        let known = uses.borrow().count.get(&index).copied().unwrap_or(1);
        let total = placed.max(known);
        let shines = pieces.iter().any(|p| p.surface.emission.is_some());
        // Lights inside groups are not sampled: what shines is copied as long as that is at all bearable.
        let bearable = if shines { 16 * MAX_COPIED } else { MAX_COPIED };
        let group = total > 1 && triangles.saturating_mul(total - 1) > bearable;
        let transforms = copies.unwrap_or_else(|| vec![DAffine3::IDENTITY]);
        if group {
            let existing = uses.borrow().groups.get(&index).copied();
            let id = match existing {
                Some(id) => id,
                None => {
                    let id = self.group(&mesh_at, index, &pieces)?;
                    uses.borrow_mut().groups.insert(index, id);
                    id
                }
            };
            for inner in transforms {
                let transform = self.motion(node, inner)?;
                self.instances.push(Instance {
                    group: id,
                    transform,
                });
            }
            return Ok(());
        }
        for inner in transforms {
            let transform = self.motion(node, inner)?;
            for piece in pieces.iter() {
                let mesh = self.rest_mesh(&mesh_at, piece)?;
                self.primitives
                    .push(primitive(mesh, transform.clone(), &piece.surface));
            }
        }
        Ok(())
    }

    /// The primitives of a mesh, read once.
    fn pieces(&mut self, index: usize) -> Result<Rc<Vec<Placed>>, Issue> {
        if let Some(pieces) = self.pieces.get(&index) {
            return Ok(pieces.clone());
        }
        // Kept even where it failed, so that the error comes once.
        self.pieces.insert(index, Rc::default());
        let at = self.list_item("meshes", index)?;
        at.only(known::MESH, self.cx)?;
        self.known_extensions(&at, &[])?;
        let mut out = Vec::new();
        for primitive in at.items("primitives")? {
            let piece = self.piece(&primitive);
            if let Some(Some(piece)) = self.cx.keep(piece) {
                let size = finish(String::new(), &piece.raw).memory_bytes();
                self.cx.charge(&primitive.place(), size)?;
                out.push(Placed {
                    at_pointer: primitive.pointer.clone(),
                    raw: piece.raw,
                    surface: piece.surface,
                    mesh: std::cell::Cell::new(None),
                });
            }
        }
        let out = Rc::new(out);
        self.pieces.insert(index, out.clone());
        Ok(out)
    }

    fn mesh_name(&self, mesh: &At<'j>, piece: &Placed) -> Result<String, Issue> {
        Ok(match mesh.name()? {
            Some(name) => format!("{name} ({}#{})", self.file, piece.at_pointer),
            None => format!("{}#{}", self.file, piece.at_pointer),
        })
    }

    fn rest_mesh(&mut self, at: &At<'j>, piece: &Placed) -> Result<MeshId, Issue> {
        if let Some(id) = piece.mesh.get() {
            return Ok(id);
        }
        let mesh = finish(self.mesh_name(at, piece)?, &piece.raw);
        let id = self.cx.add_mesh(&at.place(), mesh)?;
        piece.mesh.set(Some(id));
        Ok(id)
    }

    fn group(&mut self, at: &At<'j>, index: usize, pieces: &[Placed]) -> Result<GroupId, Issue> {
        let mut primitives = Vec::with_capacity(pieces.len());
        for piece in pieces {
            let mesh = self.rest_mesh(at, piece)?;
            primitives.push(primitive(mesh, Motion::identity(), &piece.surface));
        }
        let id = GroupId(self.groups.len() as u32);
        self.groups.push(Group {
            name: format!("mesh {index}"),
            primitives,
            instances: Vec::new(),
        });
        Ok(id)
    }

    /// A mesh that a skin or morph targets give another shape at this node.
    fn place_posed(
        &mut self,
        at: &At<'j>,
        node: usize,
        pieces: &[Placed],
        skin: Option<&Skin>,
        weights: &[f64],
    ) -> Result<(), Issue> {
        let Some(mesh_at) = self.nodes[node].as_ref().and_then(|n| n.at.get("mesh")) else {
            return Ok(());
        };
        let owner = self.list_item("meshes", mesh_at.integer()? as usize)?;
        // The node of a skinned mesh does not place it: the joints do.
        let transform = match skin {
            Some(_) => Motion::identity(),
            None => self.motion(node, DAffine3::IDENTITY)?,
        };
        for piece in pieces {
            let name = format!("{} at {}", self.mesh_name(&owner, piece)?, at.pointer);
            let mut mesh: Mesh = finish(name, &piece.raw);
            self.posed(at, &mut mesh, &piece.raw, node, skin, weights)?;
            let id = self.cx.add_mesh(&at.place(), mesh)?;
            self.primitives
                .push(primitive(id, transform.clone(), &piece.surface));
        }
        Ok(())
    }

    /// Weights of morph targets where nothing animates them: the node's, else the mesh's.
    fn rest_weights(&mut self, node: &At<'j>, mesh: &At<'j>) -> Result<Vec<f64>, Issue> {
        let own = node.items("weights")?;
        let list = if own.is_empty() {
            mesh.items("weights")?
        } else {
            own
        };
        list.iter().map(|w| w.number()).collect()
    }

    /// Placements of the copies that EXT_mesh_gpu_instancing makes.
    fn copies(&mut self, node: &At<'j>) -> Result<Option<Vec<DAffine3>>, Issue> {
        let Some(at) = node.extension("EXT_mesh_gpu_instancing") else {
            return Ok(None);
        };
        let attributes = at.need("attributes")?;
        let mut count = None;
        let mut parts: [Vec<f32>; 3] = Default::default();
        for (name, place) in attributes.members()? {
            let (slot, width) = match name {
                "TRANSLATION" => (0, 3),
                "ROTATION" => (1, 4),
                "SCALE" => (2, 3),
                _ if name.starts_with('_') => continue,
                _ => {
                    self.cx.warn(
                        &place.place(),
                        format!("the attribute {name} of instances is not used"),
                    );
                    continue;
                }
            };
            let accessor = self.accessor(place.as_index(&self.root, "accessors")?)?;
            accessor.expect_width(width)?;
            if count.is_some_and(|n| n != accessor.count) {
                return Err(place.fail(format!(
                    "{} elements where other attributes have {}",
                    accessor.count,
                    count.unwrap_or(0)
                )));
            }
            count = Some(accessor.count);
            parts[slot] = accessor.numbers()?;
        }
        let Some(count) = count else {
            return Err(attributes.fail("instances without TRANSLATION, ROTATION or SCALE"));
        };
        let bytes = PLACED_BYTES.saturating_mul(count as u64);
        self.cx.charge(&at.place(), bytes)?;
        let vector = |list: &[f32], i: usize, default: DVec3| match list.get(3 * i..3 * i + 3) {
            Some(&[x, y, z]) => DVec3::new(f64::from(x), f64::from(y), f64::from(z)),
            _ => default,
        };
        let copy = |i: usize| {
            let q = match parts[1].get(4 * i..4 * i + 4) {
                Some(&[x, y, z, w]) => DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into()),
                _ => DQuat::IDENTITY,
            };
            let turn = DMat3::from_quat(super::animation::unit(q));
            let scale = vector(&parts[2], i, DVec3::ONE);
            DAffine3 {
                matrix3: DMat3::from_cols(
                    turn.x_axis * scale.x,
                    turn.y_axis * scale.y,
                    turn.z_axis * scale.z,
                ),
                translation: vector(&parts[0], i, DVec3::ZERO),
            }
        };
        Ok(Some((0..count).map(copy).collect()))
    }
}

fn primitive(mesh: MeshId, transform: Motion, surface: &Surface) -> Primitive {
    Primitive {
        shape: Shape::Mesh(mesh),
        transform,
        material: surface.material,
        emission: surface.emission.clone(),
        alpha: surface.alpha,
        reverse_orientation: false,
        media: surface.media,
    }
}
