//! Nodes: the tree, placements over time, and what hangs on each node.

use super::Gltf;
use super::animation::{Local, affine, unit};
use super::properties as known;
use super::tree::At;
use crate::context::Issue;
use crate::model::{Motion, MotionKey};
use glam::{DAffine3, DQuat, DVec3};

/// Deepest tree of nodes.
const MAX_DEPTH: usize = 512;

/// A node of the scene that is rendered.
pub(super) struct Node<'j> {
    pub at: At<'j>,
    pub local: Local,
    /// Index of the node above.
    pub parent: Option<usize>,
}

impl<'j> Gltf<'_, '_, 'j> {
    /// Reads the nodes below the roots of the scene, each before those below it. The result is the
    /// order; the nodes are kept by their index in the file.
    pub(super) fn read_nodes(&mut self) -> Result<Vec<usize>, Issue> {
        let count = self.root.len_of("nodes")?;
        self.nodes = (0..count).map(|_| None).collect();
        let mut order = Vec::new();
        let mut stack: Vec<(At<'j>, usize, Option<usize>, usize)> = Vec::new();
        for (root, index) in self.roots()?.into_iter().rev() {
            stack.push((root, index, None, 0));
        }
        while let Some((user, index, parent, depth)) = stack.pop() {
            if self.nodes[index].is_some() {
                return Err(user.fail(format!(
                    "node {index} is there twice: nodes must form a tree, and none may contain itself"
                )));
            }
            if depth > MAX_DEPTH {
                return Err(user.fail(format!("nodes nested deeper than {MAX_DEPTH}, the limit")));
            }
            let at = self.list_item("nodes", index)?;
            at.only(known::NODE, self.cx)?;
            self.known_extensions(&at, &["KHR_lights_punctual", "EXT_mesh_gpu_instancing"])?;
            let local = self.local(&at, index)?;
            for child in at.items("children")?.into_iter().rev() {
                let inner = child.as_index(&self.root, "nodes")?;
                stack.push((child, inner, Some(index), depth + 1));
            }
            self.nodes[index] = Some(Node { at, local, parent });
            order.push(index);
        }
        Ok(order)
    }

    /// The roots of the scene that is rendered: what names each, and its index.
    fn roots(&mut self) -> Result<Vec<(At<'j>, usize)>, Issue> {
        let scenes = self.root.items("scenes")?;
        let nodes = self.root.items("nodes")?;
        if scenes.is_empty() && self.root.get("scene").is_none() && !nodes.is_empty() {
            // Allowed, and then up to the reader; modelling programs show all there is.
            self.cx.warn(
                &self.root.place(),
                "the file has no scene: all of its nodes are rendered",
            );
            let mut inner = vec![false; nodes.len()];
            for child in nodes.iter().map(|node| node.items("children")) {
                for child in child? {
                    inner[child.as_index(&self.root, "nodes")?] = true;
                }
            }
            let roots = nodes.into_iter().enumerate().filter(|(i, _)| !inner[*i]);
            let roots: Vec<_> = roots.map(|(i, node)| (node, i)).collect();
            if roots.is_empty() {
                let reason = "nodes must form a tree, and none may contain itself";
                return Err(self.root.fail(reason));
            }
            return Ok(roots);
        }
        let chosen = self.root.index("scene", &self.root, "scenes")?;
        let Some(scene) = scenes.get(chosen.unwrap_or(0)) else {
            return Err(self.root.fail("the file has no scene"));
        };
        scene.only(known::SCENE, self.cx)?;
        self.known_extensions(scene, &[])?;
        if scenes.len() > 1 {
            let name = scene.name()?.unwrap_or("without a name");
            self.cx.warn(
                &scene.place(),
                format!(
                    "this one of {} scenes is rendered ({name}), the others are not",
                    scenes.len()
                ),
            );
        }
        let roots = scene.items("nodes")?.into_iter();
        roots
            .map(|root| Ok((root.clone(), root.as_index(&self.root, "nodes")?)))
            .collect()
    }

    fn local(&mut self, at: &At<'j>, index: usize) -> Result<Local, Issue> {
        let parts = ["translation", "rotation", "scale"];
        if let Some(m) = at.numbers::<16>("matrix")? {
            let place = at.get("matrix").unwrap_or_else(|| at.clone());
            if parts.iter().any(|p| at.get(p).is_some()) {
                return Err(
                    at.fail("a node with both \"matrix\" and translation, rotation or scale")
                );
            }
            let Some(matrix) = affine(&m) else {
                return Err(place.fail("a matrix whose last row is not 0 0 0 1"));
            };
            if self.animations.drives(index) {
                self.cx.warn(
                    &place.place(),
                    "the node is animated; its matrix is not used",
                );
            }
            return Ok(Local::Matrix(matrix));
        }
        let vector = |name: &str, default: DVec3| -> Result<DVec3, Issue> {
            Ok(at.numbers::<3>(name)?.map_or(default, DVec3::from_array))
        };
        let rotation = match at.numbers::<4>("rotation")? {
            None => DQuat::IDENTITY,
            Some(q) => {
                let q = DQuat::from_array(q);
                if libm::fabs(q.length() - 1.0) > 1e-3 {
                    let place = at.get("rotation").unwrap_or_else(|| at.clone());
                    self.cx.warn(
                        &place.place(),
                        format!("a quaternion of length {}; it is made 1", q.length()),
                    );
                }
                unit(q)
            }
        };
        Ok(Local::Parts {
            translation: vector("translation", DVec3::ZERO)?,
            rotation,
            scale: vector("scale", DVec3::ONE)?,
        })
    }

    /// A node and those above it, the topmost last.
    pub(super) fn chain(&self, node: usize) -> Vec<usize> {
        let mut chain = vec![node];
        let mut at = node;
        while let Some(parent) = self.nodes[at].as_ref().and_then(|n| n.parent) {
            chain.push(parent);
            at = parent;
        }
        chain
    }

    /// Placement of a node in the world at a time. Nodes that the scene does not show stand where
    /// they are in themselves.
    pub(super) fn world(&self, node: usize, time: f64) -> DAffine3 {
        let mut sum = DAffine3::IDENTITY;
        for index in self.chain(node) {
            if let Some(n) = &self.nodes[index] {
                sum = self.animations.local(index, n.local, time) * sum;
            }
        }
        sum
    }

    /// Placement of a node over time; `inner` is applied before it.
    pub(super) fn motion(&mut self, node: usize, inner: DAffine3) -> Result<Motion, Issue> {
        let chain = self.chain(node);
        // What moves inside something that is stretched does not turn plainly.
        let bends = chain
            .iter()
            .skip(1)
            .any(|&n| !is_rigid(&self.world(n, 0.0)));
        let times = self.animations.key_times(&chain, None, bends);
        if times.is_empty() {
            return Ok(Motion::fixed(self.world(node, 0.0) * inner));
        }
        if let Some(n) = &self.nodes[node] {
            let bytes = size_of::<MotionKey>() * times.len();
            self.cx.charge(&n.at.place(), bytes as u64)?;
            let work = times.len() * chain.len();
            let at = n.at.clone();
            self.work(&at, work as u64)?;
        }
        let keys: Vec<MotionKey> = times
            .iter()
            .map(|&time| MotionKey {
                time,
                transform: self.world(node, time) * inner,
            })
            .collect();
        if keys.iter().all(|k| k.transform == keys[0].transform) {
            return Ok(Motion::fixed(keys[0].transform));
        }
        Ok(Motion { keys })
    }
}

/// Turns, moves and scales evenly, nothing else.
fn is_rigid(m: &DAffine3) -> bool {
    let m = m.matrix3;
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    let size = x.length_squared();
    let near = |a: f64| libm::fabs(a) <= 1e-9 * size;
    near(y.length_squared() - size)
        && near(z.length_squared() - size)
        && near(x.dot(y))
        && near(y.dot(z))
        && near(z.dot(x))
        && m.determinant() > 0.0
}
