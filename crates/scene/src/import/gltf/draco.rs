//! Meshes packed by KHR_draco_mesh_compression.

use super::Gltf;
use super::accessor::width;
use super::tree::At;
use crate::context::Issue;
use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder};
use std::collections::BTreeMap;

/// Most points, and most triangles, of one packed mesh.
const MAX_ELEMENTS: u64 = 1 << 26;

/// A packed mesh, unpacked.
pub(super) struct Unpacked {
    /// Numbers by attribute, and how many an element has.
    pub attributes: BTreeMap<String, (Vec<f32>, usize)>,
    /// Corners of triangles.
    pub indices: Vec<u32>,
}

/// Unpacks the mesh of a primitive whose attributes are `declared`.
pub(super) fn decode<'j>(
    gltf: &mut Gltf<'_, '_, 'j>,
    at: &At<'j>,
    declared: &At<'j>,
) -> Result<Unpacked, Issue> {
    let view = at.need("bufferView")?.as_index(&gltf.root, "bufferViews")?;
    let view = gltf.buffers.view(&gltf.root, view, gltf.cx)?;
    let limits = DecodeLimits::default()
        .with_max_points(MAX_ELEMENTS)
        .with_max_faces(MAX_ELEMENTS)
        .with_max_decoded_bytes(crate::limits::MAX_IMPORT_BYTES / 4);
    let mut buffer = DecoderBuffer::new(view.data.bytes()).with_limits(limits);
    let mut mesh = Mesh::new();
    MeshDecoder::new()
        .decode(&mut buffer, &mut mesh)
        .map_err(|e| at.fail(format!("damaged Draco data: {e}")))?;
    let points = mesh.num_points();
    gltf.work(at, points as u64)?;
    let faces = mesh.faces();
    let indices: Vec<u32> = faces.iter().flatten().map(|point| point.0).collect();
    let mut attributes = BTreeMap::new();
    for (name, id) in at.need("attributes")?.members()? {
        let unique = u32::try_from(id.integer()?).unwrap_or(u32::MAX);
        let Some(attribute) = mesh.attribute_by_unique_id(unique) else {
            return Err(id.fail(format!("the packed mesh has no attribute {unique}")));
        };
        let Some(accessor) = declared.index(name, &gltf.root, "accessors")? else {
            gltf.cx.warn(
                &id.place(),
                format!("{name} is packed, but no attribute of the primitive; it is not used"),
            );
            continue;
        };
        let accessor = gltf.list_item("accessors", accessor)?;
        let kind = accessor.need("type")?;
        let components = match width(kind.text()?) {
            Some(n) if n == usize::from(attribute.num_components()) => n,
            _ => {
                return Err(kind.fail(format!(
                    "the packed attribute has {} numbers an element",
                    attribute.num_components()
                )));
            }
        };
        let mut numbers = attribute.read_f32s(points, components);
        // The accessor says whether integers are fractions.
        let whole = attribute.data_type() != draco_core::DataType::Float32;
        if accessor.flag_or("normalized", false)? && whole {
            let most = match accessor.need("componentType")?.integer()? {
                5120 => 127.0,
                5121 => 255.0,
                5122 => 32_767.0,
                5123 => 65_535.0,
                _ => 1.0,
            };
            for x in &mut numbers {
                *x = (*x / most).max(-1.0);
            }
        }
        if numbers.len() != points * components || numbers.iter().any(|x| !x.is_finite()) {
            return Err(id.fail(format!("{name} in the packed mesh is damaged")));
        }
        attributes.insert(name.to_owned(), (numbers, components));
    }
    Ok(Unpacked {
        attributes,
        indices,
    })
}
