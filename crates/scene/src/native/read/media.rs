//! Media, grids and curves from JSON.

use super::{Reader, fixed, json, locate, lookup};
use crate::context::Issue;
use crate::model::*;
use crate::native::arrays;
use crate::native::values::Named;
use std::sync::Arc;

impl Reader<'_, '_, '_> {
    /// All media; one that failed keeps its place, so that only the first error is reported.
    pub(super) fn media(&mut self, list: &Named<json::Medium>) -> Vec<Medium> {
        let mut media = Vec::with_capacity(list.0.len());
        for (name, medium) in &list.0 {
            let pointer = format!("/media/{}", locate::escape(name));
            let grid = match &medium.grid {
                Some(grid) => self.medium_grid(grid, &format!("{pointer}/grid")),
                None => None,
            };
            self.media
                .insert(name.clone(), MediumId(media.len() as u32));
            media.push(Medium {
                name: name.clone(),
                sigma_a: medium.sigma_a.0,
                sigma_s: medium.sigma_s.0,
                emission: medium.emission.0,
                g: medium.g,
                grid,
                translucent: medium.translucent,
            });
        }
        media
    }

    fn medium_grid(&mut self, grid: &json::MediumGrid, pointer: &str) -> Option<MediumGrid> {
        let transform = self.keep(&format!("{pointer}/transform"), fixed(&grid.transform));
        let absorption = self.grid(&grid.absorption, &format!("{pointer}/absorption"));
        let scattering = match &grid.scattering {
            Some(own) => self.grid(own, &format!("{pointer}/scattering")),
            None => absorption.clone(),
        };
        let emission = match &grid.emission {
            Some(own) => Some(self.grid(own, &format!("{pointer}/emission"))?),
            None => None,
        };
        Some(MediumGrid {
            transform: transform?,
            bounds: grid.bounds,
            absorption: absorption?,
            scattering: scattering?,
            emission,
        })
    }

    fn grid(&mut self, grid: &json::Grid, pointer: &str) -> Option<Arc<Grid>> {
        let place = self.at(pointer);
        let inline = grid.size.is_some() || !grid.values.is_empty() || !grid.colors.is_empty();
        let result = match (&grid.file, grid.size) {
            (Some(file), None) if !inline => self.file(&place, file, arrays::read_grid),
            (None, Some(size)) if grid.colors.is_empty() => Ok(Grid {
                size,
                values: GridValues::Scalar(grid.values.clone()),
            }),
            (None, Some(size)) if grid.values.is_empty() => Ok(Grid {
                size,
                values: GridValues::Rgb(grid.colors.clone()),
            }),
            _ => Err(Issue::new(
                &place,
                "a grid has either \"file\", or \"size\" with one of \"values\" and \"colors\"",
            )),
        };
        let grid = self.cx.keep(result)?;
        let charged = self.cx.charge(&place, grid.memory_bytes());
        self.cx.keep(charged)?;
        Some(Arc::new(grid))
    }

    /// What a binary file holds.
    fn file<T>(
        &mut self,
        place: &crate::diagnostic::Place,
        name: &str,
        read: impl Fn(&[u8]) -> Result<T, String>,
    ) -> Result<T, Issue> {
        let path = self.cx.path(place, name)?;
        let bytes = self.cx.read(place, &path)?;
        self.cx.release(bytes.len() as u64);
        read(&bytes).map_err(|e| Issue::new(place, format!("{path}: {e}")))
    }

    /// All bundles of curves.
    pub(super) fn all_curves(&mut self, list: Named<json::Curves>) -> Vec<Curves> {
        let mut out = Vec::with_capacity(list.0.len());
        for (name, curves) in list.0 {
            let pointer = format!("/curves/{}", locate::escape(&name));
            let place = self.at(&pointer);
            let segments = match (curves.file, curves.segments) {
                (Some(file), segments) if segments.is_empty() => {
                    self.file(&place, &file, arrays::read_curves)
                }
                (None, segments) => Ok(segments),
                _ => Err(Issue::new(
                    &place,
                    "curves have either \"file\" or \"segments\"",
                )),
            };
            let segments = self.cx.keep(segments).unwrap_or_default();
            let bytes = size_of::<CurveSegment>() as u64 * segments.len() as u64;
            let charged = self.cx.charge(&place, bytes);
            self.cx.keep(charged);
            self.curves.insert(name.clone(), CurvesId(out.len() as u32));
            out.push(Curves {
                name,
                kind: curves.kind,
                segments: Arc::new(segments),
            });
        }
        out
    }

    pub(super) fn interface(
        &self,
        sides: &json::MediumInterface,
    ) -> Result<MediumInterface, String> {
        let side = |name: &Option<String>| {
            name.as_ref()
                .map(|name| lookup("medium", name, &self.media))
                .transpose()
        };
        Ok(MediumInterface {
            inside: side(&sides.inside)?,
            outside: side(&sides.outside)?,
        })
    }
}
