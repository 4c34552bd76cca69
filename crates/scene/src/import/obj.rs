//! Wavefront OBJ with MTL: one mesh for each material, one principled surface for each of these.
//!
//! Read here and not through a crate: those at hand give no lines with their complaints and panic on
//! some input. Polygons may be concave; faces without normals are flat.

mod mtl;
mod polygon;
#[cfg(test)]
pub(super) mod tests;

use super::gltf::tangents;
use super::{Imported, stage};
use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::model::{
    BsdfDesc, Emission, FloatTex, Material, MaterialId, Mesh, Motion, Primitive, Principled, Shape,
    Texture,
};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Longest polygon.
const MAX_CORNERS: usize = 1 << 16;

/// A material, ready for primitives.
#[derive(Clone)]
pub(crate) struct Surface {
    pub material: MaterialId,
    pub emission: Option<Emission>,
    pub alpha: Option<FloatTex>,
    /// Whether there is a normal map.
    pub tangents: bool,
}

/// Position, texture coordinates and normal of a corner.
type Corner = (u32, Option<u32>, Option<u32>);

/// Faces of one material that have the same attributes.
#[derive(Default)]
struct Part {
    corners: BTreeMap<Corner, u32>,
    order: Vec<Corner>,
    triangles: Vec<[u32; 3]>,
}

struct Reader<'c, 'a> {
    cx: &'c mut Context<'a>,
    place: Place,
    positions: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    normals: Vec<[f32; 3]>,
    /// By material (none before the first `usemtl`), with coordinates or not, with normals or not.
    parts: BTreeMap<(Option<String>, bool, bool), Part>,
    material: Option<String>,
    libraries: Vec<(String, Place)>,
    /// Words that were already warned about.
    warned: BTreeSet<String>,
}

/// Reads a scene.
pub(crate) fn import(main: &str, cx: &mut Context<'_>) -> Result<Imported, Issue> {
    let place = Place {
        file: main.to_owned(),
        ..Place::default()
    };
    let bytes = cx.read(&place, main)?;
    let mut reader = Reader {
        cx,
        place,
        positions: Vec::new(),
        uvs: Vec::new(),
        normals: Vec::new(),
        parts: BTreeMap::new(),
        material: None,
        libraries: Vec::new(),
        warned: BTreeSet::new(),
    };
    // A number takes at least two bytes of text and four here, a corner of a face more.
    reader
        .cx
        .charge(&reader.place.clone(), bytes.len() as u64 * 8)?;
    let mut foreign = false;
    for line in lines(&bytes) {
        reader.place.line = Some(line.number);
        line.check(&reader.place, reader.cx, &mut foreign)?;
        let result = reader.statement(&line.text);
        reader.cx.keep(result);
        if reader.cx.hopeless() {
            break;
        }
    }
    reader.place.line = None;
    let scene = reader.scene();
    cx.release(bytes.len() as u64 * 9);
    scene
}

/// A statement.
struct Line {
    /// Of its first line.
    number: u32,
    text: String,
    /// The bytes were not UTF-8 and were taken for Latin-1, in which each byte is a character.
    latin: bool,
}

impl Line {
    /// Refuses what is no text of one byte a character; says so, once a file, where the encoding is old.
    fn check(&self, place: &Place, cx: &mut Context<'_>, warned: &mut bool) -> Result<(), Issue> {
        if self.text.contains('\0') {
            let reason = "a zero byte: not a text of one byte a character (UTF-8 is read here)";
            return Err(Issue::new(place, reason));
        }
        if self.latin && !std::mem::replace(warned, true) {
            cx.warn(place, "not UTF-8; read as Latin-1");
        }
        Ok(())
    }
}

/// Statements: lines joined where they end in a backslash, without comments.
fn lines(bytes: &[u8]) -> impl Iterator<Item = Line> + '_ {
    let mut rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut number = 0u32;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let first = number + 1;
        let mut text = Vec::new();
        loop {
            let end = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
            let (line, after) = rest.split_at(end);
            rest = after.get(1..).unwrap_or_default();
            number = number.saturating_add(1);
            let line = line.strip_suffix(b"\r").unwrap_or(line);
            match line.strip_suffix(b"\\") {
                Some(open) if !rest.is_empty() => {
                    text.extend_from_slice(open);
                    text.push(b' ');
                }
                _ => {
                    text.extend_from_slice(line);
                    break;
                }
            }
        }
        // Nobody cares in which encoding a comment is.
        if let Some(comment) = text.iter().position(|&b| b == b'#') {
            text.truncate(comment);
        }
        let (text, latin) = match String::from_utf8(text) {
            Ok(text) => (text, false),
            Err(e) => (e.as_bytes().iter().map(|&b| char::from(b)).collect(), true),
        };
        Some(Line {
            number: first,
            text: text.trim().to_owned(),
            latin,
        })
    })
}

impl Reader<'_, '_> {
    fn fail<T>(&self, reason: impl Into<String>) -> Result<T, Issue> {
        Err(Issue::new(&self.place, reason))
    }

    fn warn_once(&mut self, word: &str, reason: impl Into<String>) {
        if self.warned.insert(word.to_owned()) {
            self.cx.warn(&self.place, reason);
        }
    }

    fn floats<const N: usize>(&self, words: &[&str], least: usize) -> Result<[f32; N], Issue> {
        let mut out = [0.0; N];
        if words.len() < least {
            return self.fail(format!("expected {least} numbers, found {}", words.len()));
        }
        for (x, word) in out.iter_mut().zip(words) {
            *x = match number(word) {
                Some(v) if (v as f32).is_finite() => v as f32,
                _ => return self.fail(format!("{word:?} is no finite number")),
            };
        }
        Ok(out)
    }

    fn statement(&mut self, text: &str) -> Result<(), Issue> {
        let (word, rest) = text
            .split_once(char::is_whitespace)
            .map_or((text, ""), |(w, r)| (w, r.trim()));
        let words: Vec<&str> = rest.split_ascii_whitespace().collect();
        match word {
            "" | "o" | "g" => {}
            "v" => {
                let p = self.floats::<3>(&words, 3)?;
                self.positions.push(p);
                if words.len() > 4 {
                    self.warn_once("v", "colours of vertices are not used");
                }
            }
            "vt" => {
                let uv = self.floats::<2>(&words, 1)?;
                self.uvs.push(uv);
            }
            "vn" => {
                let n = self.floats::<3>(&words, 3)?;
                self.normals.push(n);
            }
            "f" => self.face(&words)?,
            "usemtl" => self.material = Some(rest.to_owned()),
            "mtllib" => self.libraries.push((rest.to_owned(), self.place.clone())),
            "s" => {
                if !matches!(rest, "off" | "0" | "") {
                    self.warned.insert("smoothing".to_owned());
                }
            }
            "l" | "p" => {
                self.warn_once(word, "lines and points have no surface; they are left out")
            }
            other => {
                let shown: String = other.chars().take(40).collect();
                self.warn_once(other, format!("unknown statement {shown:?}; it is ignored"));
            }
        }
        Ok(())
    }

    /// One index of a corner: from 1 on, or back from the last one.
    fn index(&self, word: &str, what: &str, count: usize) -> Result<Option<u32>, Issue> {
        if word.is_empty() {
            return Ok(None);
        }
        let Ok(given) = word.parse::<i64>() else {
            return self.fail(format!("{word:?} is no index"));
        };
        let from_zero = if given > 0 {
            given - 1
        } else {
            count as i64 + given
        };
        if given == 0 || from_zero < 0 || from_zero >= count as i64 {
            return self.fail(format!(
                "index {given}, but there are {count} {what} so far"
            ));
        }
        Ok(Some(from_zero as u32))
    }

    fn corner(&self, word: &str) -> Result<Corner, Issue> {
        let mut parts = word.split('/');
        let mut next = || parts.next().unwrap_or_default();
        let position = self.index(next(), "positions", self.positions.len())?;
        let uv = self.index(next(), "texture coordinates", self.uvs.len())?;
        let normal = self.index(next(), "normals", self.normals.len())?;
        match position {
            Some(position) => Ok((position, uv, normal)),
            None => self.fail(format!("{word:?} is no corner of a face")),
        }
    }

    fn face(&mut self, words: &[&str]) -> Result<(), Issue> {
        if words.len() < 3 || words.len() > MAX_CORNERS {
            return self.fail(format!(
                "a face of {} corners; 3 to {MAX_CORNERS} are possible",
                words.len()
            ));
        }
        let corners: Vec<Corner> = words
            .iter()
            .map(|w| self.corner(w))
            .collect::<Result<_, _>>()?;
        let has_uv = corners.iter().all(|c| c.1.is_some());
        let has_normal = corners.iter().all(|c| c.2.is_some());
        let outline: Vec<[f32; 3]> = corners
            .iter()
            .map(|c| self.positions[c.0 as usize])
            .collect();
        let key = (self.material.clone(), has_uv, has_normal);
        let part = self.parts.entry(key).or_default();
        let vertices: Vec<u32> = corners
            .iter()
            .map(|&(p, uv, n)| {
                let corner = (p, uv.filter(|_| has_uv), n.filter(|_| has_normal));
                let next = part.order.len() as u32;
                *part.corners.entry(corner).or_insert_with(|| {
                    part.order.push(corner);
                    next
                })
            })
            .collect();
        for triangle in polygon::triangulate(&outline) {
            part.triangles.push(triangle.map(|i| vertices[i]));
        }
        Ok(())
    }

    fn scene(&mut self) -> Result<Imported, Issue> {
        if self.parts.is_empty() {
            return self.fail("the file has no faces");
        }
        let mut desc = stage::empty();
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for p in &self.positions {
            for i in 0..3 {
                low[i] = low[i].min(p[i]);
                high[i] = high[i].max(p[i]);
            }
        }
        let diagonal = glam::Vec3::from_array(high).distance(glam::Vec3::from_array(low));
        let mut library = mtl::Library::new(diagonal);
        for (names, place) in std::mem::take(&mut self.libraries) {
            library.read(&names, &place, self.cx);
        }
        let mut surfaces: BTreeMap<Option<String>, Surface> = BTreeMap::new();
        for (key, part) in std::mem::take(&mut self.parts) {
            let (name, has_uv, has_normal) = key;
            if !surfaces.contains_key(&name) {
                let surface = self.surface(
                    name.as_deref(),
                    &mut library,
                    &mut desc.textures,
                    &mut desc.materials,
                )?;
                surfaces.insert(name.clone(), surface);
            }
            let surface = &surfaces[&name];
            if !has_normal && self.warned.remove("smoothing") {
                self.cx.warn(
                    &self.place,
                    "smoothing groups are not used: faces without normals are flat",
                );
            }
            let mut mesh = Mesh {
                name: format!(
                    "{} ({})",
                    self.place.file,
                    name.as_deref().unwrap_or("no material")
                ),
                positions: Arc::new(
                    part.order
                        .iter()
                        .map(|c| self.positions[c.0 as usize])
                        .collect(),
                ),
                indices: Arc::new(part.triangles),
                ..Mesh::default()
            };
            let uv = |c: &Corner| c.1.map(|i| self.uvs[i as usize]).unwrap_or_default();
            let normal = |c: &Corner| c.2.map(|i| self.normals[i as usize]).unwrap_or_default();
            if has_uv {
                mesh.uvs = vec![Arc::new(part.order.iter().map(uv).collect())];
            }
            if has_normal {
                mesh.normals = Arc::new(part.order.iter().map(normal).collect());
            }
            if surface.tangents && has_uv {
                tangents::generate(&mut mesh, 0, &tangents::PLAIN);
            }
            let id = self.cx.add_mesh(&self.place, mesh)?;
            desc.primitives.push(Primitive {
                shape: Shape::Mesh(id),
                transform: Motion::identity(),
                material: surface.material,
                emission: surface.emission.clone(),
                alpha: surface.alpha,
                reverse_orientation: false,
                media: None,
            });
        }
        Ok(Imported {
            desc,
            has_camera: false,
        })
    }

    fn surface(
        &mut self,
        name: Option<&str>,
        library: &mut mtl::Library,
        textures: &mut Vec<Texture>,
        materials: &mut Vec<Material>,
    ) -> Result<Surface, Issue> {
        if let Some(name) = name {
            if let Some(entry) = library.take(name) {
                return entry.surface(name, self.cx, textures, materials);
            }
            let near = crate::suggest::did_you_mean(name, library.names());
            self.cx.warn(
                &self.place,
                format!("no material {name:?} in the libraries{near}; it is shown in grey"),
            );
        }
        Ok(grey(name.unwrap_or("no material"), materials))
    }
}

/// A word that is a number and nothing else.
fn number(word: &str) -> Option<f64> {
    crate::number::number(word.as_bytes())
        .filter(|(_, length)| *length == word.len())
        .map(|(x, _)| x)
}

/// What has no material is shown as.
pub(crate) fn grey(name: &str, materials: &mut Vec<Material>) -> Surface {
    let id = MaterialId(materials.len() as u32);
    materials.push(Material {
        name: name.to_owned(),
        bsdf: BsdfDesc::Principled(Box::new(Principled {
            base_color: crate::model::ColorTex::Const([0.6; 3]),
            ..Principled::default()
        })),
        normal_map: None,
        bump_map: None,
    });
    Surface {
        material: id,
        emission: None,
        alpha: None,
        tangents: false,
    }
}
