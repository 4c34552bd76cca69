//! Primitives of meshes: attributes, indices, modes.

use super::Gltf;
use super::accessor::Accessor;
use super::deform::{Influence, Target};
use super::draco;
use super::materials::{Surface, TangentsOf};
use super::properties as known;
use super::tangents;
use super::tree::At;
use crate::context::Issue;
use crate::model::Mesh;
use std::sync::Arc;

/// A primitive as the file has it, before morphs and skins.
pub(super) struct Raw {
    pub positions: Vec<[f32; 3]>,
    /// Empty: flat.
    pub normals: Vec<[f32; 3]>,
    /// Empty where the file has none or they must be made.
    pub tangents: Vec<[f32; 4]>,
    pub uvs: Vec<Vec<[f32; 2]>>,
    pub colors: Vec<[f32; 4]>,
    pub indices: Vec<[u32; 3]>,
    /// Joints and weights of each vertex, by set.
    pub influences: Vec<Influence>,
    pub targets: Vec<Target>,
}

/// A primitive of a mesh with what its surface is.
pub(super) struct Piece {
    pub raw: Raw,
    pub surface: Surface,
}

impl<'j> Gltf<'_, '_, 'j> {
    /// A primitive; none where it has no triangles.
    pub(super) fn piece(&mut self, at: &At<'j>) -> Result<Option<Piece>, Issue> {
        at.only(known::PRIMITIVE, self.cx)?;
        self.known_extensions(
            at,
            &["KHR_draco_mesh_compression", "KHR_materials_variants"],
        )?;
        let mode = at.integer_or("mode", 4)?;
        match mode {
            4..=6 => {}
            0..=3 => {
                let what = if mode == 0 { "points" } else { "lines" };
                self.cx.warn(
                    &at.place(),
                    format!("{what} have no surface; they are left out"),
                );
                return Ok(None);
            }
            other => {
                return Err(at.fail(format!("unknown mode {other} of a primitive")));
            }
        }
        let attributes = at.need("attributes")?;
        if self.is_lost(&attributes)? {
            let cube = crate::context::stand_in("");
            let material = self.material_of(at)?;
            let mut surface = self.surface(material, false)?;
            surface.tangents = None;
            return Ok(Some(Piece {
                raw: Raw {
                    positions: cube.positions.to_vec(),
                    normals: Vec::new(),
                    tangents: Vec::new(),
                    uvs: Vec::new(),
                    colors: Vec::new(),
                    indices: cube.indices.to_vec(),
                    influences: Vec::new(),
                    targets: Vec::new(),
                },
                surface,
            }));
        }
        let unpacked = match at.extension("KHR_draco_mesh_compression") {
            Some(packed) => Some(draco::decode(self, &packed, &attributes)?),
            None => None,
        };
        let has_colors = attributes.get("COLOR_0").is_some();
        let material = self.material_of(at)?;
        let surface = self.surface(material, has_colors)?;
        let reader = Attributes {
            at: &attributes,
            unpacked: unpacked.as_ref(),
        };
        let Some(positions) = reader.floats(self, "POSITION", 3)? else {
            self.cx
                .warn(&at.place(), "a primitive without POSITION; it is left out");
            return Ok(None);
        };
        let positions = positions.as_chunks::<3>().0.to_vec();
        let count = positions.len();
        let rows = |what: &str, found: usize| -> Result<(), Issue> {
            if found == count {
                return Ok(());
            }
            let place = attributes.get(what).unwrap_or_else(|| attributes.clone());
            Err(place.fail(format!("{found} elements for {count} vertices")))
        };
        let mut raw = Raw {
            normals: Vec::new(),
            tangents: Vec::new(),
            uvs: Vec::new(),
            colors: Vec::new(),
            indices: Vec::new(),
            influences: Vec::new(),
            targets: Vec::new(),
            positions,
        };
        if let Some(n) = reader.floats(self, "NORMAL", 3)? {
            raw.normals = n.as_chunks::<3>().0.to_vec();
            rows("NORMAL", raw.normals.len())?;
        }
        if let Some(t) = reader.floats(self, "TANGENT", 4)?
            && !raw.normals.is_empty()
        {
            raw.tangents = t.as_chunks::<4>().0.to_vec();
            rows("TANGENT", raw.tangents.len())?;
        }
        raw.uvs = self.coordinates(&reader, &surface, count)?;
        if has_colors {
            raw.colors = self.colors(&reader)?;
            rows("COLOR_0", raw.colors.len())?;
        }
        self.influences(&reader, &mut raw)?;
        self.warn_of_others(&attributes)?;
        raw.targets = self.targets(at, count)?;
        let corners = match &unpacked {
            Some(unpacked) => unpacked.indices.clone(),
            None => self.corners(at, count)?,
        };
        let mode = if unpacked.is_some() { 4 } else { mode };
        raw.indices = self.assemble(at, &corners, mode, count)?;
        if raw.indices.is_empty() {
            self.cx
                .warn(&at.place(), "a primitive without triangles; it is left out");
            return Ok(None);
        }
        compact(&mut raw);
        complete(&mut raw, surface.tangents);
        Ok(Some(Piece { raw, surface }))
    }

    /// Whether the positions lie in a file that is missing and may be.
    fn is_lost(&mut self, attributes: &At<'j>) -> Result<bool, Issue> {
        let Some(index) = attributes.index("POSITION", &self.root, "accessors")? else {
            return Ok(false);
        };
        let accessor = self.list_item("accessors", index)?;
        match accessor.index("bufferView", &self.root, "bufferViews")? {
            Some(view) => self.buffers.is_missing(&self.root, view, self.cx),
            None => Ok(false),
        }
    }

    /// The material of a primitive under the chosen variant.
    fn material_of(&mut self, at: &At<'j>) -> Result<Option<usize>, Issue> {
        let own = at.index("material", &self.root, "materials")?;
        let (Some(variants), Some(chosen)) = (at.extension("KHR_materials_variants"), self.variant)
        else {
            return Ok(own);
        };
        for mapping in variants.items("mappings")? {
            for variant in mapping.items("variants")? {
                if variant.integer()? == chosen as u64 {
                    let material = mapping.need("material")?;
                    return material.as_index(&self.root, "materials").map(Some);
                }
            }
        }
        Ok(own)
    }

    /// The sets of coordinates that the surface uses, v up; the first set if it uses none, so that
    /// there is something to take tangents from.
    fn coordinates(
        &mut self,
        reader: &Attributes<'_, 'j>,
        surface: &Surface,
        count: usize,
    ) -> Result<Vec<Vec<[f32; 2]>>, Issue> {
        let sets = match surface.sets.as_slice() {
            [] if reader.at.get("TEXCOORD_0").is_some() => vec![0],
            sets => sets.to_vec(),
        };
        let mut out = Vec::with_capacity(sets.len());
        for set in sets {
            let name = format!("TEXCOORD_{set}");
            let Some(uv) = reader.floats(self, &name, 2)? else {
                return Err(reader.at.fail(format!(
                    "material {:?} asks for {name}, which the primitive does not have",
                    surface.name
                )));
            };
            let rows = uv.as_chunks::<2>().0;
            if rows.len() != count {
                let place = reader.at.get(&name).unwrap_or_else(|| reader.at.clone());
                return Err(place.fail(format!("{} elements for {count} vertices", rows.len())));
            }
            out.push(rows.iter().map(|[u, v]| [*u, 1.0 - v]).collect());
        }
        Ok(out)
    }

    fn colors(&mut self, reader: &Attributes<'_, 'j>) -> Result<Vec<[f32; 4]>, Issue> {
        let Some((numbers, width)) = reader.any(self, "COLOR_0")? else {
            return Ok(Vec::new());
        };
        match width {
            3 => Ok(numbers
                .as_chunks::<3>()
                .0
                .iter()
                .map(|[r, g, b]| [r.max(0.0), g.max(0.0), b.max(0.0), 1.0])
                .collect()),
            4 => Ok(numbers
                .as_chunks::<4>()
                .0
                .iter()
                .map(|c| c.map(|c| c.max(0.0)))
                .collect()),
            other => Err(reader
                .at
                .fail(format!("COLOR_0 of {other} numbers; 3 and 4 are possible"))),
        }
    }

    fn warn_of_others(&mut self, attributes: &At<'j>) -> Result<(), Issue> {
        for (name, at) in attributes.members()? {
            let (stem, number) = match name.rsplit_once('_') {
                Some((stem, n)) if !stem.is_empty() => (stem, n.parse::<u32>().ok()),
                _ => (name, None),
            };
            let known = match (stem, number) {
                ("POSITION" | "NORMAL" | "TANGENT", _) => true,
                ("TEXCOORD" | "JOINTS" | "WEIGHTS", Some(_)) => true,
                ("COLOR", Some(0)) => true,
                // Names with an underscore in front are an application's own business.
                _ => name.starts_with('_'),
            };
            if !known {
                self.cx
                    .warn(&at.place(), format!("the attribute {name} is not used"));
            }
        }
        Ok(())
    }

    /// The corners in order: indices, or all vertices.
    fn corners(&mut self, at: &At<'j>, count: usize) -> Result<Vec<u32>, Issue> {
        let Some(index) = at.index("indices", &self.root, "accessors")? else {
            return Ok((0..count as u32).collect());
        };
        let accessor = self.accessor(index)?;
        accessor.expect_width(1)?;
        let list = accessor.integers()?;
        if let Some(bad) = list.iter().find(|&&i| i as usize >= count) {
            return Err(accessor
                .at
                .fail(format!("index {bad}, but there are only {count} vertices")));
        }
        Ok(list)
    }

    fn assemble(
        &mut self,
        at: &At<'j>,
        corners: &[u32],
        mode: u64,
        count: usize,
    ) -> Result<Vec<[u32; 3]>, Issue> {
        if let Some(bad) = corners.iter().find(|&&i| i as usize >= count) {
            return Err(at.fail(format!("index {bad}, but there are only {count} vertices")));
        }
        Ok(match mode {
            4 => {
                let (triangles, rest) = corners.as_chunks::<3>();
                if !rest.is_empty() {
                    self.cx.warn(
                        &at.place(),
                        format!(
                            "{} corners after the last triangle are left out",
                            rest.len()
                        ),
                    );
                }
                triangles.to_vec()
            }
            // Every second triangle of a strip is wound the other way.
            5 => corners
                .windows(3)
                .enumerate()
                .map(|(i, w)| {
                    if i % 2 == 0 {
                        [w[0], w[1], w[2]]
                    } else {
                        [w[0], w[2], w[1]]
                    }
                })
                .filter(|[a, b, c]| a != b && b != c && c != a)
                .collect(),
            _ => corners
                .windows(2)
                .skip(1)
                .map(|w| [w[0], w[1], corners[0]])
                .collect(),
        })
    }
}

/// Attributes of a primitive, from accessors or from a packed mesh.
pub(super) struct Attributes<'p, 'j> {
    pub at: &'p At<'j>,
    unpacked: Option<&'p draco::Unpacked>,
}

impl<'j> Attributes<'_, 'j> {
    /// Accessor of an attribute.
    fn accessor(
        &self,
        gltf: &mut Gltf<'_, '_, 'j>,
        name: &str,
    ) -> Result<Option<Accessor<'j>>, Issue> {
        match self.at.index(name, &gltf.root, "accessors")? {
            None => Ok(None),
            Some(index) => gltf.accessor(index).map(Some),
        }
    }

    /// The numbers of an attribute and how many an element has.
    pub fn any(
        &self,
        gltf: &mut Gltf<'_, '_, 'j>,
        name: &str,
    ) -> Result<Option<(Vec<f32>, usize)>, Issue> {
        if let Some(attribute) = self.unpacked.and_then(|u| u.attributes.get(name)) {
            return Ok(Some(attribute.clone()));
        }
        let Some(accessor) = self.accessor(gltf, name)? else {
            return Ok(None);
        };
        if self.unpacked.is_some() && !accessor.has_data() {
            let reason = format!("{name} lies neither in the packed mesh nor in a buffer");
            if name == "POSITION" {
                return Err(accessor.at.fail(reason));
            }
            // Writers leave out what is zero, such as the joints of a skin with a single bone.
            gltf.cx
                .warn(&accessor.at.place(), format!("{reason}: all zero"));
        }
        Ok(Some((accessor.numbers()?, accessor.width)))
    }

    /// The same, of elements of a given width.
    pub fn floats(
        &self,
        gltf: &mut Gltf<'_, '_, 'j>,
        name: &str,
        width: usize,
    ) -> Result<Option<Vec<f32>>, Issue> {
        match self.any(gltf, name)? {
            None => Ok(None),
            Some((numbers, found)) if found == width => Ok(Some(numbers)),
            Some((_, found)) => {
                let place = self.at.get(name).unwrap_or_else(|| self.at.clone());
                Err(place.fail(format!(
                    "{name} of {found} numbers an element; {width} are needed"
                )))
            }
        }
    }
}

/// Leaves out vertices that no triangle uses: primitives often share one large set of vertices.
fn compact(raw: &mut Raw) {
    let mut place = vec![u32::MAX; raw.positions.len()];
    let mut kept: Vec<u32> = Vec::new();
    for corner in raw.indices.as_flattened_mut() {
        let slot = &mut place[*corner as usize];
        if *slot == u32::MAX {
            *slot = kept.len() as u32;
            kept.push(*corner);
        }
        *corner = *slot;
    }
    if kept.len() == raw.positions.len() {
        // All are used: the order of the file is as good.
        let mut back = vec![0u32; kept.len()];
        for (new, &old) in kept.iter().enumerate() {
            back[new] = old;
        }
        for corner in raw.indices.as_flattened_mut() {
            *corner = back[*corner as usize];
        }
        return;
    }
    pick(&mut raw.positions, &kept);
    pick(&mut raw.normals, &kept);
    pick(&mut raw.tangents, &kept);
    pick(&mut raw.colors, &kept);
    for uv in &mut raw.uvs {
        pick(uv, &kept);
    }
    for set in &mut raw.influences {
        pick(&mut set.joints, &kept);
        pick(&mut set.weights, &kept);
    }
    for target in &mut raw.targets {
        pick(&mut target.positions, &kept);
        pick(&mut target.normals, &kept);
        pick(&mut target.tangents, &kept);
    }
}

/// The chosen rows, in that order; nothing stays nothing.
pub(super) fn pick<T: Copy>(rows: &mut Vec<T>, kept: &[u32]) {
    if !rows.is_empty() {
        *rows = kept.iter().map(|&i| rows[i as usize]).collect();
    }
}

/// A mesh in the shape of the file.
pub(super) fn finish(name: String, raw: &Raw) -> Mesh {
    Mesh {
        name,
        positions: Arc::new(raw.positions.clone()),
        normals: Arc::new(raw.normals.clone()),
        tangents: Arc::new(raw.tangents.clone()),
        uvs: raw.uvs.iter().map(|uv| Arc::new(uv.clone())).collect(),
        colors: Arc::new(raw.colors.clone()),
        indices: Arc::new(raw.indices.clone()),
        deformation: None,
    }
}

/// Makes the tangents that a surface needs and the file does not have. What deforms and has no
/// normals stays flat at all times, which leaves the tangents to the texture coordinates.
fn complete(raw: &mut Raw, needed: Option<TangentsOf>) {
    let Some(of) = needed else {
        raw.tangents = Vec::new();
        return;
    };
    let deforms = !raw.targets.is_empty() || !raw.influences.is_empty();
    if !raw.tangents.is_empty() || raw.uvs.is_empty() || (deforms && raw.normals.is_empty()) {
        return;
    }
    let mut mesh = finish(String::new(), raw);
    let from = tangents::generate(&mut mesh, of.set as usize, &of.matrix);
    pick(&mut raw.colors, &from);
    for uv in &mut raw.uvs {
        pick(uv, &from);
    }
    for set in &mut raw.influences {
        pick(&mut set.joints, &from);
        pick(&mut set.weights, &from);
    }
    for target in &mut raw.targets {
        pick(&mut target.positions, &from);
        pick(&mut target.normals, &from);
        pick(&mut target.tangents, &from);
    }
    raw.positions = mesh.positions.to_vec();
    raw.normals = mesh.normals.to_vec();
    raw.tangents = mesh.tangents.to_vec();
    raw.indices = mesh.indices.to_vec();
}
