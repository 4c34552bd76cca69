//! Placing shapes and building trees over them.

use crate::accel::Placed;
use crate::accel::build::{self, Bounds, Item};
use crate::accel::node::{EMPTY, LeafKind, PrimRef, Tree};
use crate::geometry::curves::{CurvePart, CurveSet};
use crate::geometry::quadric::{Quadric, QuadricKind};
use crate::geometry::transform::{Affine, Placement};
use crate::geometry::{Surface, TriMesh};
use crate::light::Emission;
use crate::ray::NONE;
use crate::{PrepareError, StopFlag};
use ::scene::model::{self, Instance, Mesh, Motion, Primitive, SceneDesc, Shape};
use glam::{DAffine3, Vec3};
use rayon::prelude::*;

/// Everything that lies somewhere.
pub struct Placing {
    pub world: Tree,
    pub groups: Vec<Tree>,
    pub instances: Vec<Placed>,
    pub surfaces: Vec<Surface>,
    pub meshes: Vec<TriMesh>,
    pub curves: Vec<CurveSet>,
    pub emissions: Vec<Emission>,
}

/// Instances that a scene may have after nested groups are spread out.
const INSTANCES_MAX: usize = 1 << 26;
/// Triangles that one thread takes in one go.
const RUN: usize = 1 << 14;

/// A primitive on its way into a tree: its surface, and its shape if it has no mesh.
struct Draft<'a> {
    primitive: &'a Primitive,
    /// Local to the space of the tree.
    transform: DAffine3,
}

/// What a tree is to hold.
#[derive(Default)]
struct Plan<'a> {
    drafts: Vec<Draft<'a>>,
}

/// Builds all trees. `shutter` bounds the time over which moving things are enclosed.
pub fn build(
    desc: &SceneDesc,
    shutter: (f32, f32),
    stop: &StopFlag,
) -> Result<Placing, PrepareError> {
    let mut plans: Vec<Plan> = vec![];
    let mut instances: Vec<Placed> = vec![];
    // Plan of a group, made when it is first placed.
    let mut plan_of: Vec<Option<u32>> = vec![None; desc.groups.len()];

    let mut world = Plan::default();
    // What has no surface, borders on no medium and does not shine is nothing: left in, it would stop
    // shadow rays.
    let is_nothing = |p: &&Primitive| {
        p.emission.is_none()
            && sides(desc, p).is_none()
            && matches!(
                desc.materials[p.material.index()].bsdf,
                model::BsdfDesc::Interface
            )
    };
    for primitive in desc.primitives.iter().filter(|p| !is_nothing(p)) {
        add(primitive, &mut world, &mut plans, &mut instances);
    }
    let mut todo: Vec<(&Instance, Vec<&Motion>)> =
        desc.instances.iter().map(|i| (i, vec![])).rev().collect();
    // Moving primitives of a group are small groups of their own, one for each group.
    let mut moving_of: Vec<Vec<(u32, &Motion)>> = vec![vec![]; desc.groups.len()];
    while let Some((instance, outer)) = todo.pop() {
        if instances.len() > INSTANCES_MAX {
            return Err(PrepareError::Scene(format!(
                "more than {INSTANCES_MAX} instances after nested groups are spread out"
            )));
        }
        let group = instance.group.index();
        let mut chain = outer;
        chain.push(&instance.transform);
        let plan = match plan_of[group] {
            Some(plan) => plan,
            None => {
                let mut plan = Plan::default();
                for primitive in desc.groups[group]
                    .primitives
                    .iter()
                    .filter(|p| !is_nothing(p))
                {
                    if primitive.transform.is_moving() {
                        let own = Plan {
                            drafts: vec![Draft {
                                primitive,
                                transform: DAffine3::IDENTITY,
                            }],
                        };
                        plans.push(own);
                        moving_of[group].push((plans.len() as u32 - 1, &primitive.transform));
                    } else {
                        let transform = primitive.transform.keys[0].transform;
                        plan.drafts.push(Draft {
                            primitive,
                            transform,
                        });
                    }
                }
                plans.push(plan);
                plan_of[group] = Some(plans.len() as u32 - 1);
                plans.len() as u32 - 1
            }
        };
        if !plans[plan as usize].drafts.is_empty() {
            instances.push(Placed {
                group: plan,
                placement: Placement::new(&chain),
            });
        }
        for (own, motion) in &moving_of[group] {
            let mut inner = chain.clone();
            inner.push(motion);
            instances.push(Placed {
                group: *own,
                placement: Placement::new(&inner),
            });
        }
        for nested in desc.groups[group].instances.iter().rev() {
            todo.push((nested, chain.clone()));
        }
    }

    let mut out = Placing {
        world: Tree::default(),
        groups: vec![],
        instances,
        surfaces: vec![],
        meshes: vec![],
        curves: vec![],
        emissions: vec![],
    };
    // Surfaces are numbered plan by plan, so that their numbers do not depend on threads.
    let rectangle = rectangle();
    let mut first_surface = vec![];
    let mut curve_jobs: Vec<(&model::Curves, DAffine3)> = vec![];
    let mut mesh_jobs: Vec<(&Mesh, DAffine3, bool)> = vec![];
    for plan in plans.iter().chain([&world]) {
        first_surface.push(out.surfaces.len() as u32);
        for draft in &plan.drafts {
            let p = draft.primitive;
            let mirrored = draft.transform.matrix3.determinant() < 0.0;
            let mesh = match p.shape {
                Shape::Mesh(id) => {
                    mesh_jobs.push((
                        &desc.meshes[id.index()],
                        draft.transform,
                        p.reverse_orientation,
                    ));
                    mesh_jobs.len() as u32 - 1
                }
                Shape::Rectangle => {
                    mesh_jobs.push((&rectangle, draft.transform, p.reverse_orientation));
                    mesh_jobs.len() as u32 - 1
                }
                Shape::Sphere { .. } | Shape::Disk { .. } | Shape::Curves(_) => NONE,
            };
            let curves = match p.shape {
                Shape::Curves(id) => {
                    let described = &desc.curves[id.index()];
                    if p.emission.is_some() {
                        return Err(PrepareError::Scene(format!(
                            "curves {:?}: curves cannot give off light",
                            described.name
                        )));
                    }
                    curve_jobs.push((described, draft.transform));
                    curve_jobs.len() as u32 - 1
                }
                _ => NONE,
            };
            let emission = match &p.emission {
                None => NONE,
                Some(e) => {
                    out.emissions.push(Emission {
                        radiance: e.radiance,
                        scale: e.scale,
                        two_sided: e.two_sided,
                    });
                    out.emissions.len() as u32 - 1
                }
            };
            out.surfaces.push(Surface {
                mesh,
                curves,
                material: p.material.0,
                alpha: p.alpha.filter(|a| *a != model::FloatTex::Const(1.0)),
                // A quadric's normal goes through its transform, a triangle's comes from its corners,
                // which a mirroring transform turns round.
                flip: p.reverse_orientation != (mesh != NONE && mirrored),
                media: sides(desc, p),
                first_light: NONE,
                emission,
            });
        }
    }
    out.meshes = mesh_jobs
        .par_iter()
        .map(|(mesh, transform, reverse)| {
            if stop.is_stopped() {
                Err(PrepareError::Stopped)
            } else {
                Ok(TriMesh::new(mesh, transform, *reverse))
            }
        })
        .collect::<Result<_, _>>()?;

    out.curves = curve_jobs
        .par_iter()
        .map(|(curves, transform)| CurveSet::new(curves, transform))
        .collect();

    let parts = Parts {
        surfaces: &out.surfaces,
        meshes: &out.meshes,
        curves: &out.curves,
    };
    out.groups = plans
        .par_iter()
        .zip(&first_surface)
        .map(|(plan, first)| {
            if stop.is_stopped() {
                Err(PrepareError::Stopped)
            } else {
                Ok(tree(plan, *first, &parts, &[]))
            }
        })
        .collect::<Result<_, _>>()?;
    let placed: Vec<Item> = out
        .instances
        .par_iter()
        .enumerate()
        .map(|(i, placed)| Item {
            bounds: swept(
                &out.groups[placed.group as usize].bounds,
                &placed.placement,
                shutter,
            ),
            kind: LeafKind::Instance,
            id: i as u32,
        })
        .collect();
    let first = first_surface[plans.len()];
    out.world = tree(&world, first, &parts, &placed);
    Ok(out)
}

/// Indices of the media inside and outside of a primitive that is a border. Vacuum on both sides counts
/// too, as the inside of a surface may be cut out of a medium, but not where there are no media.
fn sides(desc: &SceneDesc, p: &Primitive) -> Option<[u32; 2]> {
    let interface = p.media.filter(|_| !desc.media.is_empty())?;
    let side = |m: Option<model::MediumId>| m.map_or(NONE, |m| m.0);
    Some([side(interface.inside), side(interface.outside)])
}

/// Puts a primitive of the world into its plan, or makes it an instance if it moves.
fn add<'a>(
    primitive: &'a Primitive,
    world: &mut Plan<'a>,
    plans: &mut Vec<Plan<'a>>,
    instances: &mut Vec<Placed>,
) {
    if primitive.transform.is_moving() {
        plans.push(Plan {
            drafts: vec![Draft {
                primitive,
                transform: DAffine3::IDENTITY,
            }],
        });
        let placement = Placement::new(&[&primitive.transform]);
        instances.push(Placed {
            group: plans.len() as u32 - 1,
            placement,
        });
    } else {
        world.drafts.push(Draft {
            primitive,
            transform: primitive.transform.keys[0].transform,
        });
    }
}

/// Box of a placed box over the shutter interval. Between two samples of a turning map a point leaves
/// the boxes around it by at most the sagitta of its arc, which shrinks with the square of the step:
/// half the distance between neighbouring samples of a corner, divided by the steps, covers it.
fn swept(bounds: &Bounds, placement: &Placement, shutter: (f32, f32)) -> Bounds {
    if bounds.is_empty() {
        return Bounds::default();
    }
    let times = placement.sample_times(shutter.0, shutter.1);
    let mut all = Bounds::default();
    let mut step: f32 = 0.0;
    let mut last: Option<[Vec3; 8]> = None;
    for time in &times {
        let (to, _) = placement.at(*time);
        let corners = bounds.corners().map(|p| to.point(p));
        if let Some(last) = last {
            for (a, b) in corners.iter().zip(last) {
                step = step.max(crate::math::length(*a - b));
            }
        }
        all = all.union(Bounds::of(corners));
        last = Some(corners);
    }
    let fixed = times.len() == 1;
    all.padded(if fixed { 0.0 } else { step * 0.125 })
}

/// What surfaces are made of.
struct Parts<'a> {
    surfaces: &'a [Surface],
    meshes: &'a [TriMesh],
    curves: &'a [CurveSet],
}

fn tree(plan: &Plan, first_surface: u32, parts: &Parts, placed: &[Item]) -> Tree {
    let (surfaces, meshes) = (parts.surfaces, parts.meshes);
    let mut tree = Tree {
        root: EMPTY,
        ..Tree::default()
    };
    let mut items: Vec<Item> = vec![];
    for (i, draft) in plan.drafts.iter().enumerate() {
        let index = first_surface + i as u32;
        let surface = &surfaces[index as usize];
        if surface.curves != NONE {
            add_curves(index, surface.curves, parts, &mut tree, &mut items);
            continue;
        }
        if surface.mesh == NONE {
            let (kind, transform) = quadric(&draft.primitive.shape, draft.transform);
            let shape = Quadric::new(
                Affine::new(&transform),
                Affine::new(&transform.inverse()),
                kind,
            );
            let prim = tree.prims.len() as u32;
            tree.prims.push(PrimRef {
                surface: index,
                index: tree.quadrics.len() as u32,
            });
            items.push(Item {
                bounds: shape.bounds(),
                kind: match shape.sphere() {
                    Some(_) => LeafKind::Balls,
                    None => LeafKind::Quadric,
                },
                id: tree.quadrics.len() as u32,
            });
            tree.quadrics.push((shape, prim));
            continue;
        }
        let mesh = &meshes[surface.mesh as usize];
        let count = mesh.indices.len() as u32;
        let first = tree.prims.len() as u32;
        tree.prims.extend((0..count).map(|triangle| PrimRef {
            surface: index,
            index: triangle,
        }));
        let triangles = (0..count).into_par_iter().with_min_len(RUN);
        if mesh.keys.is_empty() {
            items.par_extend(triangles.map(|triangle| Item {
                bounds: Bounds::of(mesh.corners(triangle)),
                kind: LeafKind::Triangles,
                id: first + triangle,
            }));
        } else {
            let deforming = tree.deforming.len() as u32;
            items.par_extend(triangles.map(|triangle| {
                let at_rest = Bounds::of(mesh.corners(triangle));
                let bounds = mesh.keys.iter().fold(at_rest, |bounds, key| {
                    let point = |i: u32| Vec3::from_array(key.positions[i as usize]);
                    bounds.union(Bounds::of(mesh.indices[triangle as usize].map(point)))
                });
                Item {
                    bounds: bounds.padded(0.0),
                    kind: LeafKind::Deforming,
                    id: deforming + triangle,
                }
            }));
            tree.deforming.extend(first..first + count);
        }
    }
    for item in placed {
        if !item.bounds.is_empty() {
            items.push(Item {
                id: tree.instances.len() as u32,
                ..*item
            });
            tree.instances.push(item.id);
        }
    }
    tree.bounds = items
        .iter()
        .fold(Bounds::default(), |b, i| b.union(i.bounds));
    let prims = &tree.prims;
    let corners = |prim: u32| {
        let at = prims[prim as usize];
        meshes[surfaces[at.surface as usize].mesh as usize].corners(at.index)
    };
    let quadrics = &tree.quadrics;
    let sphere = |index: u32| {
        let (shape, prim) = &quadrics[index as usize];
        // Nobody asks for others.
        let (center, radius) = shape.sphere().unwrap_or_default();
        (center, radius, *prim)
    };
    let shapes = build::Shapes {
        corners: &corners,
        sphere: &sphere,
    };
    let built = build::build(items, shapes);
    tree.nodes = built.nodes;
    tree.root = built.root;
    tree.blocks = built.blocks;
    tree.balls = built.balls;
    tree
}

/// Puts the pieces of a set of curves into a tree, each in parts.
fn add_curves(surface: u32, set: u32, parts: &Parts, tree: &mut Tree, items: &mut Vec<Item>) {
    for (i, piece) in parts.curves[set as usize].pieces.iter().enumerate() {
        let prim = tree.prims.len() as u32;
        tree.prims.push(PrimRef {
            surface,
            index: i as u32,
        });
        let count = piece.parts();
        for part in 0..count {
            let range = [part, part + 1].map(|k| k as f32 / count as f32);
            items.push(Item {
                bounds: piece.bounds(range),
                kind: LeafKind::Curve,
                id: tree.curves.len() as u32,
            });
            tree.curves.push(CurvePart {
                set,
                piece: i as u32,
                prim,
                range,
            });
        }
    }
}

/// Local shape of what is not a mesh, and its transform.
fn quadric(shape: &Shape, transform: DAffine3) -> (QuadricKind, DAffine3) {
    match shape {
        Shape::Sphere { radius } => (
            QuadricKind::Sphere {
                radius: *radius as f32,
            },
            transform,
        ),
        Shape::Disk {
            radius,
            inner_radius,
            height,
        } => (
            QuadricKind::Disk {
                radius: *radius as f32,
                inner: *inner_radius as f32,
                height: *height as f32,
            },
            transform,
        ),
        // These have meshes and do not come here.
        Shape::Mesh(_) | Shape::Rectangle | Shape::Curves(_) => {
            (QuadricKind::Sphere { radius: 0.0 }, transform)
        }
    }
}

/// The square [-1, 1]^2 as two triangles.
fn rectangle() -> Mesh {
    Mesh {
        name: "rectangle".into(),
        positions: vec![
            [-1.0, -1.0, 0.0],
            [1.0, -1.0, 0.0],
            [1.0, 1.0, 0.0],
            [-1.0, 1.0, 0.0],
        ]
        .into(),
        uvs: vec![vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].into()],
        indices: vec![[0, 1, 2], [0, 2, 3]].into(),
        ..Mesh::default()
    }
}
