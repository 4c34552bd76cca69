//! Shapes. Meshes are taken as they are; what the model has no word for is tessellated.

use super::params::{Kind, Params};
use super::{Alpha, Importer, PendingShape, legacy, matrix, subdivide, tessellate};
use crate::context::Issue;
use crate::model::{Mesh, Shape};
use std::sync::Arc;

pub(super) const SHAPES: [&str; 8] = [
    "bilinearmesh",
    "curve",
    "cylinder",
    "disk",
    "loopsubdiv",
    "plymesh",
    "sphere",
    "trianglemesh",
];

impl Importer<'_, '_> {
    pub(super) fn shape(&mut self, kind: &str, params: &Params) -> Result<(), Issue> {
        let strand = match kind {
            "curve" => Some(self.strand(params)?),
            _ => None,
        };
        let shape = match &strand {
            // Replaced when the strand finds its bundle.
            Some(_) => Shape::Rectangle,
            None => self.geometry(kind, params)?,
        };
        let alpha = match params.find("alpha", &[Kind::Float, Kind::Texture])? {
            Some(param) if param.kind == Kind::Float => Some(Alpha::Value(param.one()? as f32)),
            Some(param) => Some(Alpha::Texture(param.text()?.to_owned())),
            None => None,
        };
        let transform = matrix::motion(&self.graphics.ctm, self.times)
            .map_err(|e| Issue::new(&params.place, e))?;
        let pending = PendingShape {
            shape,
            transform,
            material: self.graphics.material.clone(),
            emission: self.graphics.area_light.clone(),
            alpha,
            reverse: self.graphics.reverse,
            sides: self.graphics.sides.clone(),
            place: params.place.clone(),
        };
        if let Some(strand) = strand {
            return self.add_strand(params, strand, pending);
        }
        match self.groups.last_mut().filter(|_| self.open_group) {
            Some(group) => group.shapes.push(pending),
            None => self.shapes.push(pending),
        }
        Ok(())
    }

    fn mesh(&mut self, params: &Params, kind: &str, mesh: Mesh) -> Result<Shape, Issue> {
        let name = format!("{kind} at {}", params.place);
        Ok(Shape::Mesh(
            self.cx.add_mesh(&params.place, Mesh { name, ..mesh })?,
        ))
    }

    fn geometry(&mut self, kind: &str, params: &Params) -> Result<Shape, Issue> {
        match kind {
            "plymesh" => {
                let Some(name) = params.text_opt("filename")? else {
                    return params.fail("a plymesh needs a \"filename\"");
                };
                if params
                    .find("displacement", &[Kind::Texture, Kind::String])?
                    .is_some()
                {
                    params.ignore(&["edgelength"]);
                    self.cx.warn(&params.place, "\"displacement\" of a plymesh is not supported: its vertices stay where they are");
                }
                Ok(Shape::Mesh(self.cx.ply(&params.place, name)?))
            }
            "trianglemesh" => {
                let mesh = self.triangle_mesh(params)?;
                self.mesh(params, kind, mesh)
            }
            "loopsubdiv" => {
                let levels = params.count("levels", 3, 0..=10)?;
                params.ignore(&["scheme"]);
                let Some(indices) = params.indices("indices")? else {
                    return params.fail("a loopsubdiv needs \"indices\"");
                };
                let Some(positions) = params.rows::<3>("P", &[Kind::Point3])? else {
                    return params.fail("a loopsubdiv needs \"P\"");
                };
                let indices = triangles(params, &indices, positions.len())?;
                // Every level has four times the triangles; count before they are made.
                let bytes = (indices.len() as u64) << (2 * levels);
                self.cx.charge(&params.place, bytes.saturating_mul(64))?;
                self.cx.release(bytes.saturating_mul(64));
                let (positions, normals, indices) =
                    subdivide::loop_subdivide(&positions, &indices, levels)
                        .map_err(|e| Issue::new(&params.place, e))?;
                let mesh = Mesh {
                    positions: Arc::new(positions),
                    normals: Arc::new(normals),
                    indices: Arc::new(indices),
                    ..Mesh::default()
                };
                self.mesh(params, kind, mesh)
            }
            "bilinearmesh" => self.bilinear_mesh(params),
            "sphere" => {
                let radius = params.positive("radius", 1.0)?;
                let (z_min, z_max) = (
                    params.float("zmin", -radius)?,
                    params.float("zmax", radius)?,
                );
                let phi_max = params.float("phimax", 360.0)?;
                if z_min <= -radius && z_max >= radius && phi_max >= 360.0 {
                    return Ok(Shape::Sphere { radius });
                }
                if z_min >= z_max || phi_max <= 0.0 {
                    return params.fail("a part of a sphere that is empty");
                }
                self.warn_once(
                    &params.place,
                    "a part of a sphere becomes triangles with smooth normals",
                );
                self.mesh(
                    params,
                    kind,
                    tessellate::sphere(radius, (z_min, z_max), phi_max),
                )
            }
            "disk" => {
                let radius = params.positive("radius", 1.0)?;
                let height = params.float("height", 0.0)?;
                let inner_radius = params.float("innerradius", 0.0)?;
                let phi_max = params.float("phimax", 360.0)?;
                if !(0.0..radius).contains(&inner_radius) || phi_max <= 0.0 {
                    return params.fail("a disk that is empty");
                }
                if phi_max >= 360.0 {
                    return Ok(Shape::Disk {
                        radius,
                        inner_radius,
                        height,
                    });
                }
                self.warn_once(&params.place, "a part of a disk becomes triangles");
                self.mesh(
                    params,
                    kind,
                    tessellate::disk(radius, inner_radius, height, phi_max),
                )
            }
            "cylinder" => {
                let radius = params.positive("radius", 1.0)?;
                let (z_min, z_max) = (params.float("zmin", -1.0)?, params.float("zmax", 1.0)?);
                let phi_max = params.float("phimax", 360.0)?;
                if z_min == z_max || phi_max <= 0.0 {
                    return params.fail("a cylinder that is empty");
                }
                self.warn_once(
                    &params.place,
                    "a cylinder becomes triangles with smooth normals",
                );
                self.mesh(
                    params,
                    kind,
                    tessellate::cylinder(radius, (z_min.min(z_max), z_min.max(z_max)), phi_max),
                )
            }
            other => {
                let hint = legacy::hint("shape", other, &SHAPES);
                params.fail(format!("unknown shape {other:?}{hint}"))
            }
        }
    }

    fn triangle_mesh(&mut self, params: &Params) -> Result<Mesh, Issue> {
        let Some(positions) = params.rows::<3>("P", &[Kind::Point3])? else {
            return params.fail("a trianglemesh needs \"P\"");
        };
        let count = positions.len();
        let indices = match params.indices("indices")? {
            Some(indices) => triangles(params, &indices, count)?,
            None if count == 3 => vec![[0, 1, 2]],
            None => return params.fail("a trianglemesh needs \"indices\""),
        };
        let normals = self.per_vertex::<3>(params, &["N"], Kind::Normal, count)?;
        let uvs = self.per_vertex::<2>(params, &["uv", "st"], Kind::Point2, count)?;
        if params.find("S", &[Kind::Vector3])?.is_some() {
            self.warn_once(
                &params.place,
                "tangents \"S\" are not supported: they come from the texture coordinates",
            );
        }
        params.ignore(&["faceIndices"]);
        Ok(Mesh {
            positions: Arc::new(positions),
            normals: Arc::new(normals),
            uvs: if uvs.is_empty() {
                Vec::new()
            } else {
                vec![Arc::new(uvs)]
            },
            indices: Arc::new(indices),
            ..Mesh::default()
        })
    }

    fn per_vertex<const N: usize>(
        &mut self,
        params: &Params,
        names: &[&str],
        kind: Kind,
        count: usize,
    ) -> Result<Vec<[f32; N]>, Issue> {
        for name in names {
            if let Some(rows) = params.rows::<N>(name, &[kind])? {
                if rows.len() != count {
                    return params.fail(format!(
                        "{} of {name:?} for {count} points of \"P\"",
                        rows.len()
                    ));
                }
                return Ok(rows);
            }
        }
        Ok(Vec::new())
    }

    fn bilinear_mesh(&mut self, params: &Params) -> Result<Shape, Issue> {
        let Some(positions) = params.rows::<3>("P", &[Kind::Point3])? else {
            return params.fail("a bilinearmesh needs \"P\"");
        };
        let count = positions.len();
        let indices = match params.indices("indices")? {
            Some(indices) => indices,
            None if count == 4 => vec![0, 1, 2, 3],
            None => return params.fail("a bilinearmesh needs \"indices\""),
        };
        let (patches, rest) = indices.as_chunks::<4>();
        if !rest.is_empty() || patches.is_empty() {
            return params.fail(format!(
                "{} indices: a bilinearmesh has four for every patch",
                indices.len()
            ));
        }
        if let Some(bad) = indices.iter().find(|&&i| i as usize >= count) {
            return params.fail(format!("index {bad}, but \"P\" has only {count} points"));
        }
        let normals = self.per_vertex::<3>(params, &["N"], Kind::Normal, count)?;
        let uvs = self.per_vertex::<2>(params, &["uv"], Kind::Point2, count)?;
        // The picture only tells pbrt where to look for light; what shines is the light's own picture.
        params.ignore(&["faceIndices", "emissionfilename"]);
        self.cx.charge(&params.place, patches.len() as u64 * 1024)?;
        let (mesh, bent) = tessellate::bilinear(patches, &positions, &normals, &uvs);
        self.cx.release(patches.len() as u64 * 1024);
        if bent {
            self.warn_once(
                &params.place,
                "a bilinear patch that is not flat becomes 8 x 8 squares of triangles",
            );
        }
        self.mesh(params, "bilinearmesh", mesh)
    }
}

fn triangles(params: &Params, indices: &[u32], count: usize) -> Result<Vec<[u32; 3]>, Issue> {
    let (rows, rest) = indices.as_chunks::<3>();
    if !rest.is_empty() || rows.is_empty() {
        return params.fail(format!(
            "{} indices: triangles have three each",
            indices.len()
        ));
    }
    if let Some(bad) = indices.iter().find(|&&i| i as usize >= count) {
        return params.fail(format!("index {bad}, but \"P\" has only {count} points"));
    }
    Ok(rows.to_vec())
}
