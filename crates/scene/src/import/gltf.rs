//! glTF 2.0: .gltf with files beside it, and .glb.
//!
//! The file is read as a tree of JSON with places (see `tree`), not through the crate `gltf`: that
//! one reads accessors with arithmetic that can underflow on hostile counts, knows neither JSON
//! pointers nor half of the extensions, and would leave most of the work undone. Geometry becomes
//! meshes in our convention (v up), each material one principled surface, and animations become keys.
//!
//! Colours, units and alpha follow the specification; where a path tracer does better than the
//! specification's approximations, it does: occlusion textures are not used, and volumes absorb over
//! the real path of light. `docs/formats.md` has the whole table.

mod accessor;
mod animation;
mod buffers;
mod container;
mod deform;
mod draco;
mod extensions;
mod instancing;
mod materials;
mod mesh;
mod meshopt;
mod nodes;
mod properties;
pub(crate) mod tangents;
#[cfg(test)]
pub(super) mod tests;
mod textures;
mod tree;
mod uri;
mod views;

pub use properties::{EXTENSIONS, Extension, Support};
pub(crate) use views::plain_camera;

use super::Imported;
use super::stage;
use crate::assets::AssetBytes;
use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::limits::MAX_JSON_BYTES;
use crate::model::{
    Animation, Group, Instance, Light, Material, Medium, Primitive, Texture, TextureId,
};
use crate::overrides::Look;
use animation::{Animations, FPS};
use buffers::Buffers;
use materials::Surface;
use nodes::Node;
use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use tree::At;

/// Elements that may be read or moved in all: files refer to the same numbers as often as they like,
/// so that a small one can ask for endless work. Tests and
/// fuzzers are content with less.
const MAX_WORK: u64 = if cfg!(any(test, fuzzing)) {
    1 << 24
} else {
    1 << 30
};

/// A file while it is read.
struct Gltf<'c, 'a, 'j> {
    cx: &'c mut Context<'a>,
    file: &'j str,
    root: At<'j>,
    buffers: Buffers,
    work_left: u64,
    /// Extensions that the file says it uses.
    declared: BTreeSet<&'j str>,
    /// Index of the chosen material variant.
    variant: Option<usize>,
    nodes: Vec<Option<Node<'j>>>,
    animations: Animations,
    surfaces: BTreeMap<(Option<usize>, bool), Surface>,
    pieces: BTreeMap<usize, Rc<Vec<instancing::Placed>>>,
    textures: Vec<Texture>,
    texture_ids: BTreeMap<String, TextureId>,
    materials: Vec<Material>,
    material_names: BTreeSet<String>,
    media: Vec<Medium>,
    primitives: Vec<Primitive>,
    groups: Vec<Group>,
    instances: Vec<Instance>,
    lights: Vec<Light>,
}

/// Reads a scene.
pub(crate) fn import(main: &str, cx: &mut Context<'_>, look: &Look) -> Result<Imported, Issue> {
    let place = Place {
        file: main.to_owned(),
        ..Place::default()
    };
    let bytes: AssetBytes = cx.read(&place, main)?;
    let parts = container::open(&place, bytes, cx)?;
    let mut raw = parts.json.bytes();
    if raw.len() as u64 > MAX_JSON_BYTES {
        let reason = format!("{} bytes of JSON; the limit is {MAX_JSON_BYTES}", raw.len());
        return Err(Issue::new(&place, reason));
    }
    // The text may lie in data URIs for the most part, of which the tree holds a copy.
    let tree_bytes = raw.len() as u64 * 2;
    cx.charge(&place, tree_bytes)?;
    if let Some(rest) = raw.strip_prefix(b"\xef\xbb\xbf") {
        cx.warn(
            &place,
            "the file begins with a byte-order mark; it is skipped",
        );
        raw = rest;
    }
    let text = std::str::from_utf8(raw).map_err(|e| {
        Issue::new(
            &place,
            format!("not UTF-8 text, at byte {}", e.valid_up_to()),
        )
    })?;
    // GLB pads its JSON with spaces, and some writers with zeros.
    let json = tree::parse(main, text.trim_end_matches('\0'))?;
    let root = At::root(main, &json);
    // Before anything else: another version has other types in the same places.
    check_version(&root)?;
    let mut gltf = Gltf {
        file: main,
        buffers: Buffers::new(&root, parts.bin)?,
        root,
        cx,
        work_left: MAX_WORK,
        declared: BTreeSet::new(),
        variant: None,
        nodes: Vec::new(),
        animations: Animations::default(),
        surfaces: BTreeMap::new(),
        pieces: BTreeMap::new(),
        textures: Vec::new(),
        texture_ids: BTreeMap::new(),
        materials: Vec::new(),
        material_names: BTreeSet::new(),
        media: Vec::new(),
        primitives: Vec::new(),
        groups: Vec::new(),
        instances: Vec::new(),
        lights: Vec::new(),
    };
    let imported = gltf.scene(look);
    cx.release(tree_bytes);
    imported
}

impl<'j> Gltf<'_, '_, 'j> {
    fn scene(&mut self, look: &Look) -> Result<Imported, Issue> {
        self.head()?;
        self.variant = self.chosen_variant(look)?;
        self.animations = self.read_animations()?;
        let order = self.read_nodes()?;
        let uses = self.uses(&order)?;
        for &node in &order {
            // What concerns one node only does not hide what is wrong with the next.
            let placed = self.place(node, &uses);
            self.cx.keep(placed);
            let light = self.light(node);
            if let Some(Some(light)) = self.cx.keep(light) {
                self.lights.push(light);
            }
            if self.cx.hopeless() {
                break;
            }
        }
        let shot = self.shot(&order, look.camera.as_deref())?;
        let has_camera = shot.is_some();
        let mut desc = stage::empty();
        if let Some(shot) = shot {
            desc.camera = shot.camera;
            if let Some([width, height]) = shot.size {
                (desc.film.width, desc.film.height) = (width, height);
            }
        }
        desc.animation = (self.animations.end > 0.0).then(|| Animation {
            fps: FPS,
            start: 0.0,
            frames: (0, (self.animations.end * FPS).ceil().min(1e9) as u32),
        });
        desc.textures = std::mem::take(&mut self.textures);
        desc.materials = std::mem::take(&mut self.materials);
        desc.media = std::mem::take(&mut self.media);
        desc.primitives = std::mem::take(&mut self.primitives);
        desc.groups = std::mem::take(&mut self.groups);
        desc.instances = std::mem::take(&mut self.instances);
        desc.lights = std::mem::take(&mut self.lights);
        Ok(Imported { desc, has_camera })
    }

    /// Extensions.
    fn head(&mut self) -> Result<(), Issue> {
        self.root.only(properties::ROOT, self.cx)?;
        for used in self.root.items("extensionsUsed")? {
            self.declared.insert(used.text()?);
        }
        self.check_extensions()?;
        let root = self.root.clone();
        self.known_extensions(&root, &["KHR_lights_punctual", "KHR_materials_variants"])
    }

    /// The material variant that is asked for.
    fn chosen_variant(&mut self, look: &Look) -> Result<Option<usize>, Issue> {
        let Some(wanted) = &look.variant else {
            return Ok(None);
        };
        let mut names = Vec::new();
        if let Some(all) = self.root.extension("KHR_materials_variants") {
            for variant in all.items("variants")? {
                names.push(variant.need("name")?.text()?.to_owned());
            }
        }
        match names.iter().position(|name| name == wanted) {
            Some(index) => Ok(Some(index)),
            None => Err(Issue::new(
                &crate::apply::settings_place(),
                format!(
                    "the file has no variant {wanted:?}{}; {}",
                    crate::suggest::did_you_mean(wanted, names.iter().map(String::as_str)),
                    views::listed(&names)
                ),
            )),
        }
    }

    /// An item of a list of the whole file.
    fn list_item(&self, list: &str, index: usize) -> Result<At<'j>, Issue> {
        self.root
            .get(list)
            .and_then(|all| all.item(index))
            .ok_or_else(|| self.root.fail(format!("there is no {index} in {list:?}")))
    }

    /// Counts work; refuses what goes beyond all measure.
    fn work(&mut self, at: &At<'j>, elements: u64) -> Result<(), Issue> {
        match self.work_left.checked_sub(elements) {
            Some(left) => {
                self.work_left = left;
                Ok(())
            }
            None => Err(at.fail(format!(
                "the file asks for more work than the limit of {MAX_WORK} elements"
            ))),
        }
    }
}

/// Refuses what is not glTF 2.0.
fn check_version(root: &At<'_>) -> Result<(), Issue> {
    let asset = root.need("asset")?;
    let version = asset.need("version")?;
    let least = asset.get("minVersion");
    for at in [Some(&version), least.as_ref()].into_iter().flatten() {
        let text = at.text()?;
        let major = text.split('.').next().unwrap_or_default();
        if major != "2" {
            return Err(at.fail(format!("glTF of version {text:?}; 2.0 is read here")));
        }
    }
    if let Some(least) = least
        && least.text()? != "2.0"
    {
        return Err(least.fail(format!(
            "the file needs glTF {}; 2.0 is read here",
            least.text()?
        )));
    }
    Ok(())
}
