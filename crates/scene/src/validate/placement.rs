//! What is placed where: primitives, groups, instances, lights.

use super::Findings;
use crate::limits::{MAX_INSTANCE_DEPTH, MAX_PLACED_PRIMITIVES};
use crate::model::{ColorTex, FloatTex, Instance, Light, Primitive, SceneDesc, Shape};
use glam::DVec3;

pub(super) fn check(desc: &SceneDesc, found: &mut Findings) {
    for (index, primitive) in desc.primitives.iter().enumerate() {
        check_primitive(&format!("primitive {index}"), primitive, desc, found);
    }
    for group in &desc.groups {
        for (index, primitive) in group.primitives.iter().enumerate() {
            check_primitive(
                &format!("group {:?}, primitive {index}", group.name),
                primitive,
                desc,
                found,
            );
        }
        for instance in &group.instances {
            check_instance(
                &format!("group {:?}, an instance", group.name),
                instance,
                desc,
                found,
            );
        }
    }
    for (index, instance) in desc.instances.iter().enumerate() {
        check_instance(&format!("instance {index}"), instance, desc, found);
    }
    for (index, light) in desc.lights.iter().enumerate() {
        check_light(&format!("light {index}"), light, desc, found);
    }
    let shines = !desc.lights.is_empty()
        || desc.media.iter().any(|m| m.emission != [0.0; 3])
        || desc
            .primitives
            .iter()
            .chain(desc.groups.iter().flat_map(|g| &g.primitives))
            .any(|p| p.emission.is_some());
    if !shines {
        found.warn("nothing shines: the picture will be black");
    }
    match count(desc) {
        Ok(0) => {
            if !desc
                .lights
                .iter()
                .any(|l| matches!(l, Light::Environment { .. }))
            {
                found.error("there is nothing to render: no shapes and no environment");
            } else {
                found.warn("there are no shapes: only the environment is rendered");
            }
        }
        Ok(n) if n > MAX_PLACED_PRIMITIVES => {
            found.error(format!("instances of instances stand for more than {MAX_PLACED_PRIMITIVES} primitives, the limit"));
        }
        Ok(_) => {}
        Err(reason) => found.error(reason),
    }
}

/// How many primitives all instances together stand for; an error where groups contain themselves.
fn count(desc: &SceneDesc) -> Result<u64, String> {
    #[derive(Clone, Copy)]
    enum State {
        Unseen,
        Open,
        /// Primitives, nesting.
        Done(u64, usize),
    }
    let mut states = vec![State::Unseen; desc.groups.len()];
    let inside = |states: &[State], instances: &[Instance], own: usize| {
        instances.iter().fold((own as u64, 0), |(sum, depth), i| {
            match states.get(i.group.index()) {
                Some(State::Done(n, d)) => (sum.saturating_add(*n), depth.max(d + 1)),
                _ => (sum, depth),
            }
        })
    };
    for start in 0..desc.groups.len() {
        // Depth first without recursion: nesting comes from the file.
        let mut stack = vec![start];
        while let Some(&at) = stack.last() {
            let group = &desc.groups[at];
            match states[at] {
                State::Done(..) => {
                    stack.pop();
                }
                State::Unseen => {
                    states[at] = State::Open;
                    for next in group.instances.iter().map(|i| i.group.index()) {
                        match states.get(next) {
                            Some(State::Open) => {
                                return Err(format!(
                                    "group {:?} contains itself",
                                    desc.groups[next].name
                                ));
                            }
                            Some(State::Unseen) => stack.push(next),
                            _ => {}
                        }
                    }
                }
                State::Open => {
                    let (n, depth) = inside(&states, &group.instances, group.primitives.len());
                    if depth > MAX_INSTANCE_DEPTH {
                        return Err(format!(
                            "group {:?}: instances nested more than {MAX_INSTANCE_DEPTH} deep, the limit",
                            group.name
                        ));
                    }
                    states[at] = State::Done(n, depth);
                    stack.pop();
                }
            }
        }
    }
    Ok(inside(&states, &desc.instances, desc.primitives.len()).0)
}

fn check_primitive(what: &str, primitive: &Primitive, desc: &SceneDesc, found: &mut Findings) {
    found.motion(what, &primitive.transform);
    match primitive.shape {
        Shape::Mesh(id) => found.check(id.index() < desc.meshes.len(), || {
            format!("{what}: refers to no mesh")
        }),
        Shape::Sphere { radius } => {
            found.check(radius > 0.0 && radius.is_finite(), || {
                format!("{what}: a sphere of radius {radius}")
            });
        }
        Shape::Disk {
            radius,
            inner_radius,
            height,
        } => {
            let fine =
                radius.is_finite() && height.is_finite() && (0.0..radius).contains(&inner_radius);
            found.check(fine, || {
                format!("{what}: a disk of radius {radius} with a hole of {inner_radius}")
            });
        }
        Shape::Curves(id) => found.check(id.index() < desc.curves.len(), || {
            format!("{what}: refers to no curves")
        }),
        Shape::Rectangle => {}
    }
    if let Some(sides) = primitive.media {
        for id in sides.inside.into_iter().chain(sides.outside) {
            found.check(id.index() < desc.media.len(), || {
                format!("{what}: refers to no medium")
            });
        }
    }
    found.check(primitive.material.index() < desc.materials.len(), || {
        format!("{what}: refers to no material")
    });
    let texture = |id: crate::model::TextureId| id.index() < desc.textures.len();
    if let Some(FloatTex::Texture(id, _)) = primitive.alpha {
        found.check(texture(id), || format!("{what}: refers to no texture"));
    }
    if let Some(emission) = &primitive.emission {
        let fine = match emission.radiance {
            ColorTex::Const(c) => c.iter().all(|c| *c >= 0.0 && c.is_finite()),
            ColorTex::Texture(id) => texture(id),
        };
        found.check(
            fine && emission.scale >= 0.0 && emission.scale.is_finite(),
            || format!("{what}: a light that is negative, not finite, or refers to no texture"),
        );
    }
}

fn check_instance(what: &str, instance: &Instance, desc: &SceneDesc, found: &mut Findings) {
    found.motion(what, &instance.transform);
    found.check(instance.group.index() < desc.groups.len(), || {
        format!("{what}: refers to no group")
    });
}

fn check_light(what: &str, light: &Light, desc: &SceneDesc, found: &mut Findings) {
    let color = match light {
        Light::Point {
            transform,
            intensity,
        } => {
            found.transform(what, transform);
            intensity
        }
        Light::Spot {
            transform,
            intensity,
            cone_angle,
            full_angle,
            ..
        } => {
            found.transform(what, transform);
            found.check(
                *cone_angle > 0.0
                    && *cone_angle <= 180.0
                    && (0.0..=*cone_angle).contains(full_angle),
                || format!("{what}: a cone of {cone_angle} degrees, full up to {full_angle}"),
            );
            intensity
        }
        Light::Distant {
            direction,
            irradiance,
        } => {
            found.check(direction.is_finite() && direction.length() > 0.0, || {
                format!("{what}: no direction")
            });
            irradiance
        }
        Light::Environment {
            transform,
            radiance,
            image,
            illuminance,
            portal,
            ..
        } => {
            found.transform(what, transform);
            level(what, "illuminance", *illuminance, found);
            if let Some(corners) = portal {
                check_portal(what, corners, found);
            }
            if let Some((id, _)) = image {
                found.check(id.index() < desc.images.len(), || {
                    format!("{what}: refers to no picture")
                });
            }
            radiance
        }
        Light::Goniometric {
            transform,
            intensity,
            image,
            power,
        } => {
            found.transform(what, transform);
            level(what, "power", *power, found);
            found.check(image.index() < desc.images.len(), || {
                format!("{what}: refers to no picture")
            });
            intensity
        }
        Light::Projection {
            transform,
            intensity,
            image,
            fov,
            power,
        } => {
            found.transform(what, transform);
            level(what, "power", *power, found);
            found.check(image.index() < desc.images.len(), || {
                format!("{what}: refers to no picture")
            });
            found.check(*fov > 0.0 && *fov < 180.0, || {
                format!("{what}: a field of view of {fov} degrees")
            });
            intensity
        }
    };
    found.check(color.iter().all(|c| *c >= 0.0 && c.is_finite()), || {
        format!("{what}: a brightness of {color:?}")
    });
}

fn level(what: &str, name: &str, value: Option<f32>, found: &mut Findings) {
    if let Some(value) = value {
        found.check(value >= 0.0 && value.is_finite(), || {
            format!("{what}: {name} of {value}")
        });
    }
}

/// A portal is a rectangle: its directions are tabulated along its two edges.
fn check_portal(what: &str, corners: &[DVec3; 4], found: &mut Findings) {
    let [p0, p1, p2, p3] = *corners;
    let (a, b) = (p1 - p0, p3 - p0);
    let size = a.length() * b.length();
    let fine = size > 0.0
        && size.is_finite()
        && a.dot(b).abs() <= 1e-3 * size
        && (p0 + a + b - p2).length() <= 1e-3 * (a.length() + b.length());
    found.check(fine, || {
        format!("{what}: a portal that is not a rectangle with its corners in order")
    });
}
