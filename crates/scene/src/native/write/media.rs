//! Media, grids and curves to JSON; their arrays go into binary files.

use super::{WriteError, Writer, json, placement};
use crate::model::*;
use crate::native::arrays;
use crate::native::values::Color;
use std::sync::Arc;

type Files = Vec<(String, Vec<u8>)>;

impl Writer<'_> {
    pub(super) fn media(&self, files: &mut Files) -> Vec<(String, json::Medium)> {
        // A grid that several media share is written once.
        let mut written: Vec<(Arc<Grid>, String)> = Vec::new();
        let mut grid = |grid: &Arc<Grid>, files: &mut Files| -> json::Grid {
            let known = written.iter().find(|(other, _)| Arc::ptr_eq(other, grid));
            let file = match known {
                Some((_, file)) => file.clone(),
                None => {
                    let file = format!("grids/{:05}.bin", written.len());
                    files.push((file.clone(), arrays::write_grid(grid)));
                    written.push((grid.clone(), file.clone()));
                    file
                }
            };
            json::Grid {
                file: Some(file),
                ..json::Grid::default()
            }
        };
        let mut out = Vec::with_capacity(self.desc.media.len());
        for medium in &self.desc.media {
            let own = medium.grid.as_ref().map(|g| json::MediumGrid {
                transform: placement(&Motion::fixed(g.transform)),
                bounds: g.bounds,
                absorption: grid(&g.absorption, files),
                scattering: (!Arc::ptr_eq(&g.absorption, &g.scattering))
                    .then(|| grid(&g.scattering, files)),
                emission: g.emission.as_ref().map(|e| grid(e, files)),
            });
            out.push((
                medium.name.clone(),
                json::Medium {
                    sigma_a: Color(medium.sigma_a),
                    sigma_s: Color(medium.sigma_s),
                    emission: Color(medium.emission),
                    g: medium.g,
                    grid: own,
                    translucent: medium.translucent,
                },
            ));
        }
        out
    }

    pub(super) fn medium_name(&self, id: MediumId) -> Result<String, WriteError> {
        self.desc
            .media
            .get(id.index())
            .map(|m| m.name.clone())
            .ok_or(WriteError::Invalid("medium"))
    }

    pub(super) fn interface(
        &self,
        sides: MediumInterface,
    ) -> Result<json::MediumInterface, WriteError> {
        Ok(json::MediumInterface {
            inside: sides.inside.map(|id| self.medium_name(id)).transpose()?,
            outside: sides.outside.map(|id| self.medium_name(id)).transpose()?,
        })
    }

    pub(super) fn curves(&self, files: &mut Files) -> Vec<(String, json::Curves)> {
        let mut out = Vec::with_capacity(self.desc.curves.len());
        for (index, curves) in self.desc.curves.iter().enumerate() {
            let file = format!("curves/{index:05}.bin");
            files.push((file.clone(), arrays::write_curves(&curves.segments)));
            out.push((
                curves.name.clone(),
                json::Curves {
                    kind: curves.kind,
                    segments: Vec::new(),
                    file: Some(file),
                },
            ));
        }
        out
    }
}
