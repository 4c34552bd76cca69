//! What every reader needs while it reads: the files, the findings, the memory budget, and the lists
//! of meshes and pictures that are shared.

use crate::assets::{AssetBytes, AssetError, AssetSource, folder_of, normalize};
use crate::diagnostic::{Diagnostic, Place, SceneError, Severity};
use crate::import::ply;
use crate::limits::{MAX_DIAGNOSTICS, MAX_IMPORT_BYTES};
use crate::model::{Encoding, ImageDesc, ImageId, Mesh, MeshId};
use crate::picture::{self, PictureInfo};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Something wrong, and where; the reader decides whether it goes on.
#[derive(Clone, Debug)]
pub(crate) struct Issue {
    pub place: Place,
    pub reason: String,
}

impl Issue {
    pub fn new(place: &Place, reason: impl Into<String>) -> Self {
        Issue {
            place: place.clone(),
            reason: reason.into(),
        }
    }
}

pub(crate) struct Context<'a> {
    pub assets: &'a dyn AssetSource,
    /// Folder of the main file, with a trailing `/`: names in the scene are relative to it.
    base: String,
    allow_missing: bool,
    found: Vec<Diagnostic>,
    unlisted: usize,
    errors: usize,
    bytes_used: u64,
    pub meshes: Vec<Mesh>,
    pub images: Vec<ImageDesc>,
    pub(crate) infos: Vec<Option<PictureInfo>>,
    image_ids: BTreeMap<(String, EncodingKey), ImageId>,
    ply_ids: BTreeMap<String, MeshId>,
    mesh_names: BTreeSet<String>,
}

/// `Encoding` has no order of its own.
type EncodingKey = (u8, u32);

fn encoding_key(encoding: Encoding) -> EncodingKey {
    match encoding {
        Encoding::Auto => (0, 0),
        Encoding::Srgb => (1, 0),
        Encoding::Linear => (2, 0),
        Encoding::GammaMicros(micros) => (3, micros),
    }
}

impl<'a> Context<'a> {
    pub fn new(main: &str, assets: &'a dyn AssetSource, allow_missing: bool) -> Self {
        Context {
            assets,
            base: folder_of(main).to_owned(),
            allow_missing,
            found: Vec::new(),
            unlisted: 0,
            errors: 0,
            bytes_used: 0,
            meshes: Vec::new(),
            images: Vec::new(),
            infos: Vec::new(),
            image_ids: BTreeMap::new(),
            ply_ids: BTreeMap::new(),
            mesh_names: BTreeSet::new(),
        }
    }

    fn note(&mut self, severity: Severity, place: &Place, reason: String) {
        self.errors += usize::from(severity == Severity::Error);
        if self.found.len() < MAX_DIAGNOSTICS || (severity == Severity::Error && self.errors == 1) {
            self.found.push(Diagnostic {
                severity,
                place: place.clone(),
                reason,
            });
        } else {
            self.unlisted += 1;
        }
    }
    pub fn warn(&mut self, place: &Place, reason: impl Into<String>) {
        self.note(Severity::Warning, place, reason.into());
    }
    pub fn error(&mut self, issue: Issue) {
        self.note(Severity::Error, &issue.place, issue.reason);
    }
    /// Keeps going after an error that concerns one directive only.
    pub fn keep<T>(&mut self, result: Result<T, Issue>) -> Option<T> {
        result.map_err(|issue| self.error(issue)).ok()
    }
    pub fn has_errors(&self) -> bool {
        self.errors > 0
    }
    /// Whether missing files are stood in for.
    pub fn allows_missing(&self) -> bool {
        self.allow_missing
    }
    /// Too many errors to be worth more reading.
    pub fn hopeless(&self) -> bool {
        self.errors >= 100
    }

    /// The findings, or the error that they amount to.
    pub fn finish(&mut self) -> Result<Vec<Diagnostic>, SceneError> {
        let mut found = std::mem::take(&mut self.found);
        if self.unlisted > 0 {
            let reason = format!("{} more findings are not listed", self.unlisted);
            found.push(Diagnostic {
                severity: Severity::Warning,
                place: Place::default(),
                reason,
            });
        }
        if self.errors > 0 {
            Err(SceneError { diagnostics: found })
        } else {
            Ok(found)
        }
    }

    /// Counts memory that stays; refuses what goes beyond the limit of an import.
    pub fn charge(&mut self, place: &Place, bytes: u64) -> Result<(), Issue> {
        self.bytes_used = self.bytes_used.saturating_add(bytes);
        if self.bytes_used > MAX_IMPORT_BYTES {
            return Err(Issue::new(
                place,
                format!(
                    "the scene needs more memory than the limit of an import, {} MiB",
                    MAX_IMPORT_BYTES >> 20
                ),
            ));
        }
        Ok(())
    }
    /// Memory that may still be charged.
    pub fn remaining(&self) -> u64 {
        MAX_IMPORT_BYTES.saturating_sub(self.bytes_used)
    }
    pub fn release(&mut self, bytes: u64) {
        self.bytes_used = self.bytes_used.saturating_sub(bytes);
    }

    /// A name in the scene as a path of the source.
    pub fn path(&self, place: &Place, name: &str) -> Result<String, Issue> {
        // A scene in a subfolder (a zip with one folder) must not use `..` to reach its siblings either.
        normalize(name)
            .map(|path| format!("{}{path}", self.base))
            .map_err(|e| Issue::new(place, e.to_string()))
    }

    /// A whole file; its bytes count until [`Context::release`].
    pub fn read(&mut self, place: &Place, path: &str) -> Result<AssetBytes, Issue> {
        let bytes = self
            .assets
            .read(path)
            .map_err(|e| Issue::new(place, e.to_string()))?;
        self.charge(place, bytes.len() as u64)?;
        Ok(bytes)
    }

    /// The picture of that name, probed and listed once.
    pub fn image(
        &mut self,
        place: &Place,
        name: &str,
        encoding: Encoding,
    ) -> Result<ImageId, Issue> {
        let path = self.path(place, name)?;
        self.image_at(place, &path, encoding)
    }

    /// The same, by its path in the source.
    pub fn image_at(
        &mut self,
        place: &Place,
        path: &str,
        encoding: Encoding,
    ) -> Result<ImageId, Issue> {
        let path = normalize(path).map_err(|e| Issue::new(place, e.to_string()))?;
        let key = (path, encoding_key(encoding));
        if let Some(&id) = self.image_ids.get(&key) {
            return Ok(id);
        }
        let path = key.0.clone();
        let (info, missing) = match picture::probe(self.assets, &path) {
            Ok(Ok(info)) => (Some(info), false),
            Ok(Err(reason)) => return Err(Issue::new(place, format!("{path}: {reason}"))),
            Err(AssetError::NotFound { .. }) if self.allow_missing => {
                self.warn(
                    place,
                    format!("{path}: no such file; a conspicuous picture stands in for it"),
                );
                (None, true)
            }
            Err(error) => return Err(Issue::new(place, error.to_string())),
        };
        let id = ImageId(self.images.len() as u32);
        self.images.push(ImageDesc {
            path,
            encoding,
            missing,
            bytes: None,
        });
        self.infos.push(info);
        self.image_ids.insert(key, id);
        Ok(id)
    }

    /// Lists a picture that lies inside another file. `label` names it in messages and tells it from
    /// others; a second one of the same label and encoding is the same picture.
    pub fn image_bytes(
        &mut self,
        place: &Place,
        label: &str,
        bytes: AssetBytes,
        encoding: Encoding,
    ) -> Result<ImageId, Issue> {
        let key = (label.to_owned(), encoding_key(encoding));
        if let Some(&id) = self.image_ids.get(&key) {
            return Ok(id);
        }
        let info = picture::probe_bytes(label, &bytes).map_err(|e| Issue::new(place, e))?;
        self.charge(place, bytes.len() as u64)?;
        let id = ImageId(self.images.len() as u32);
        self.images.push(ImageDesc {
            path: label.to_owned(),
            encoding,
            missing: false,
            bytes: Some(bytes),
        });
        self.infos.push(Some(info));
        self.image_ids.insert(key, id);
        Ok(id)
    }

    /// Lists a picture that lies in a missing file, which is allowed to be missing.
    pub fn missing_image(&mut self, label: &str, encoding: Encoding) -> ImageId {
        let key = (label.to_owned(), encoding_key(encoding));
        if let Some(&id) = self.image_ids.get(&key) {
            return id;
        }
        let id = ImageId(self.images.len() as u32);
        self.images.push(ImageDesc {
            path: label.to_owned(),
            encoding,
            missing: true,
            bytes: None,
        });
        self.infos.push(None);
        self.image_ids.insert(key, id);
        id
    }

    /// Header facts of a listed picture; none for a missing one.
    pub fn info(&self, id: ImageId) -> Option<PictureInfo> {
        self.infos.get(id.index()).copied().flatten()
    }

    /// Lists a mesh after counting its memory.
    pub fn add_mesh(&mut self, place: &Place, mesh: Mesh) -> Result<MeshId, Issue> {
        let id =
            u32::try_from(self.meshes.len()).map_err(|_| Issue::new(place, "too many meshes"))?;
        self.charge(place, mesh.memory_bytes())?;
        let mut mesh = mesh;
        // Names are what other files refer to: keep them different.
        while !self.mesh_names.insert(mesh.name.clone()) {
            mesh.name.push('\'');
        }
        self.meshes.push(mesh);
        Ok(MeshId(id))
    }

    /// The mesh of a PLY file, read once.
    pub fn ply(&mut self, place: &Place, name: &str) -> Result<MeshId, Issue> {
        let path = self.path(place, name)?;
        if let Some(&id) = self.ply_ids.get(&path) {
            return Ok(id);
        }
        let mesh = self.ply_mesh(place, &path, false)?;
        let id = self.add_mesh(place, mesh)?;
        self.ply_ids.insert(path, id);
        Ok(id)
    }

    /// Reads a PLY file without listing it; its name is the path. Its colours are kept if wanted.
    pub fn ply_mesh(&mut self, place: &Place, path: &str, colors: bool) -> Result<Mesh, Issue> {
        Ok(match self.assets.read(path) {
            Ok(bytes) => {
                let size = bytes.len() as u64;
                self.charge(place, size)?;
                let here = Place {
                    file: path.to_owned(),
                    ..Place::default()
                };
                let (ply, notes) = ply::read(&bytes).map_err(|e| {
                    let line = e.line;
                    Issue::new(
                        &Place {
                            line,
                            ..here.clone()
                        },
                        format!("{} (used at {place})", e.reason),
                    )
                })?;
                for note in notes {
                    self.warn(&here, note);
                }
                self.release(size);
                Mesh {
                    name: path.to_owned(),
                    positions: Arc::new(ply.positions),
                    normals: Arc::new(ply.normals),
                    uvs: if ply.uvs.is_empty() {
                        Vec::new()
                    } else {
                        vec![Arc::new(ply.uvs)]
                    },
                    colors: Arc::new(if colors {
                        linear(&ply.colors)
                    } else {
                        Vec::new()
                    }),
                    indices: Arc::new(ply.indices),
                    ..Mesh::default()
                }
            }
            Err(AssetError::NotFound { .. }) if self.allow_missing => {
                self.warn(
                    place,
                    format!("{path}: no such file; a cube from -1 to 1 stands in for it"),
                );
                stand_in(path)
            }
            Err(error) => return Err(Issue::new(place, error.to_string())),
        })
    }
}

/// Colours of vertices as a mesh has them.
fn linear(colors: &[[f32; 3]]) -> Vec<[f32; 4]> {
    let decode = |x: f32| crate::color::srgb_to_linear(f64::from(x.clamp(0.0, 1.0))) as f32;
    let row = |&[r, g, b]: &[f32; 3]| [decode(r), decode(g), decode(b), 1.0];
    colors.iter().map(row).collect()
}

/// What is shown in place of a mesh that is not there.
pub(crate) fn stand_in(path: &str) -> Mesh {
    let corner =
        |i: u32| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| if bit == 0 { -1.0 } else { 1.0 });
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    Mesh {
        name: path.to_owned(),
        positions: Arc::new((0..8).map(corner).collect()),
        indices: Arc::new(
            quads
                .iter()
                .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
                .collect(),
        ),
        ..Mesh::default()
    }
}
