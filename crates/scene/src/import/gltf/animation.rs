//! Animations: channels that move nodes and weigh morph targets, sampled at any time.
//!
//! A file may hold several animations that a player chooses from. All are played that do not fight
//! over the same property of a node; the first one wins, and the others are named.

use super::Gltf;
use super::properties as known;
use super::tree::At;
use crate::context::Issue;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use std::collections::BTreeMap;

/// Frames per second where nothing says how many; glTF has no word for it.
pub(super) const FPS: f64 = 24.0;
/// Most keys of a motion: longer animations get a coarser step.
const MAX_KEYS: f64 = 4000.0;

/// What a channel drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Path {
    Translation,
    Rotation,
    Scale,
    Weights,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interpolation {
    Step,
    Linear,
    CubicSpline,
}

/// One animated property.
#[derive(Clone, Debug)]
pub(super) struct Channel {
    interpolation: Interpolation,
    times: Vec<f32>,
    /// `width` numbers a key; in-tangent, value, out-tangent for cubic splines.
    values: Vec<f32>,
    width: usize,
}

/// A channel and what it drives: a property of a node.
type Driven = ((usize, Path), Channel);

/// All channels by what they drive.
#[derive(Clone, Debug, Default)]
pub(super) struct Animations {
    pub channels: BTreeMap<(usize, Path), Channel>,
    /// Time of the last key.
    pub end: f64,
}

impl Channel {
    fn key(&self, index: usize, part: usize) -> &[f32] {
        let parts = if self.interpolation == Interpolation::CubicSpline {
            3
        } else {
            1
        };
        let part = if parts == 1 { 0 } else { part };
        let start = (index * parts + part) * self.width;
        self.values
            .get(start..start + self.width)
            .unwrap_or_default()
    }

    /// The numbers at a time; the first and last keys hold outside.
    pub fn at(&self, time: f64) -> Vec<f64> {
        let wide = |x: &[f32]| x.iter().map(|x| f64::from(*x)).collect::<Vec<_>>();
        let after = self.times.partition_point(|t| f64::from(*t) <= time);
        if after == 0 {
            return wide(self.key(0, 1));
        }
        if after == self.times.len() || self.interpolation == Interpolation::Step {
            return wide(self.key(after - 1, 1));
        }
        let (t0, t1) = (
            f64::from(self.times[after - 1]),
            f64::from(self.times[after]),
        );
        let f = (time - t0) / (t1 - t0);
        let (a, b) = (wide(self.key(after - 1, 1)), wide(self.key(after, 1)));
        if self.interpolation == Interpolation::Linear {
            return a.iter().zip(&b).map(|(a, b)| a + (b - a) * f).collect();
        }
        // Hermite, tangents scaled by the length of the interval.
        let (out, into) = (wide(self.key(after - 1, 2)), wide(self.key(after, 0)));
        let (f2, f3, dt) = (f * f, f * f * f, t1 - t0);
        (0..self.width)
            .map(|i| {
                (2.0 * f3 - 3.0 * f2 + 1.0) * a[i]
                    + dt * (f3 - 2.0 * f2 + f) * out[i]
                    + (3.0 * f2 - 2.0 * f3) * b[i]
                    + dt * (f3 - f2) * into[i]
            })
            .collect()
    }

    /// The rotation at a time: linear keys are turned into one another on the sphere.
    fn rotation(&self, time: f64) -> DQuat {
        let quat = |x: &[f64]| match x {
            [x, y, z, w] => unit(DQuat::from_xyzw(*x, *y, *z, *w)),
            _ => DQuat::IDENTITY,
        };
        let after = self.times.partition_point(|t| f64::from(*t) <= time);
        if self.interpolation != Interpolation::Linear || after == 0 || after == self.times.len() {
            return quat(&self.at(time));
        }
        let (t0, t1) = (
            f64::from(self.times[after - 1]),
            f64::from(self.times[after]),
        );
        let (a, b) = (quat(&self.at(t0)), quat(&self.at(t1)));
        unit(a.slerp(b, (time - t0) / (t1 - t0)))
    }
}

/// A quaternion of unit length; one of no length is no rotation.
pub(super) fn unit(q: DQuat) -> DQuat {
    let length = q.length();
    if length > 1e-30 && length.is_finite() {
        q / length
    } else {
        DQuat::IDENTITY
    }
}

/// A node's own placement.
#[derive(Clone, Copy, Debug)]
pub(super) enum Local {
    Matrix(DAffine3),
    Parts {
        translation: DVec3,
        rotation: DQuat,
        scale: DVec3,
    },
}

impl Local {
    fn matrix(self) -> DAffine3 {
        match self {
            Local::Matrix(m) => m,
            Local::Parts {
                translation,
                rotation,
                scale,
            } => {
                let turn = DMat3::from_quat(rotation);
                DAffine3 {
                    matrix3: DMat3::from_cols(
                        turn.x_axis * scale.x,
                        turn.y_axis * scale.y,
                        turn.z_axis * scale.z,
                    ),
                    translation,
                }
            }
        }
    }
}

impl Animations {
    pub fn drives(&self, node: usize) -> bool {
        [Path::Translation, Path::Rotation, Path::Scale]
            .iter()
            .any(|path| self.channels.contains_key(&(node, *path)))
    }

    /// Placement of a node in its parent at a time.
    pub fn local(&self, node: usize, rest: Local, time: f64) -> DAffine3 {
        if !self.drives(node) {
            return rest.matrix();
        }
        let (mut translation, mut rotation, mut scale) = match rest {
            Local::Parts {
                translation,
                rotation,
                scale,
            } => (translation, rotation, scale),
            Local::Matrix(_) => (DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE),
        };
        let vector = |x: Vec<f64>| match x[..] {
            [x, y, z] => DVec3::new(x, y, z),
            _ => DVec3::ZERO,
        };
        if let Some(c) = self.channels.get(&(node, Path::Translation)) {
            translation = vector(c.at(time));
        }
        if let Some(c) = self.channels.get(&(node, Path::Rotation)) {
            rotation = c.rotation(time);
        }
        if let Some(c) = self.channels.get(&(node, Path::Scale)) {
            scale = vector(c.at(time));
        }
        Local::Parts {
            translation,
            rotation,
            scale,
        }
        .matrix()
    }

    /// When something that follows these nodes needs keys: at their own keys, just before steps, and
    /// between keys in steps fine enough for what a plain interpolation of transforms does not follow.
    pub fn key_times(&self, nodes: &[usize], weights: Option<usize>, bends: bool) -> Vec<f64> {
        let mut own: Vec<&Channel> = Vec::new();
        let mut moving = 0;
        for &node in nodes {
            moving += usize::from(self.drives(node));
            for path in [Path::Translation, Path::Rotation, Path::Scale] {
                own.extend(self.channels.get(&(node, path)));
            }
        }
        own.extend(weights.and_then(|node| self.channels.get(&(node, Path::Weights))));
        let mut times: Vec<f64> = Vec::new();
        for channel in &own {
            for &t in &channel.times {
                times.push(f64::from(t));
                if channel.interpolation == Interpolation::Step && t > channel.times[0] {
                    times.push(f64::from(t.next_down()));
                }
            }
        }
        times.sort_by(f64::total_cmp);
        times.dedup();
        let plain = own
            .iter()
            .all(|c| c.interpolation != Interpolation::CubicSpline);
        if plain && moving <= 1 && !bends {
            return times;
        }
        let (Some(first), Some(last)) = (times.first().copied(), times.last().copied()) else {
            return times;
        };
        let step = (0.5 / FPS).max((last - first) / MAX_KEYS);
        let mut fine = Vec::with_capacity(times.len());
        for pair in times.windows(2) {
            // Singles: the tracer knows times as such, and keys must differ there.
            let parts = ((pair[1] - pair[0]) / step).ceil().clamp(1.0, MAX_KEYS);
            for i in 0..parts as usize {
                let t = pair[0] + (pair[1] - pair[0]) * i as f64 / parts;
                fine.push(f64::from(t as f32));
            }
        }
        fine.push(last);
        fine.sort_by(f64::total_cmp);
        fine.dedup();
        fine
    }
}

impl<'j> Gltf<'_, '_, 'j> {
    /// All animations of the file that can be played together.
    pub(super) fn read_animations(&mut self) -> Result<Animations, Issue> {
        let mut all = Animations::default();
        for (index, at) in self.root.items("animations")?.into_iter().enumerate() {
            at.only(known::ANIMATION, self.cx)?;
            let name = at.name()?.map_or(format!("{index}"), |n| format!("{n:?}"));
            let mut own = BTreeMap::new();
            for channel in at.items("channels")? {
                if let Some((what, read)) = self.channel(&at, &channel)?
                    && own.insert(what, read).is_some()
                {
                    return Err(channel.fail("a second channel for the same property of a node"));
                }
            }
            if own.keys().any(|what| all.channels.contains_key(what)) {
                self.cx.warn(
                    &at.place(),
                    format!("animation {name} moves what an earlier one moves; it is not played"),
                );
                continue;
            }
            all.channels.append(&mut own);
        }
        let ends = all.channels.values().filter_map(|c| c.times.last());
        all.end = ends.fold(0.0, |end, t| end.max(f64::from(*t)));
        Ok(all)
    }

    fn channel(&mut self, animation: &At<'j>, at: &At<'j>) -> Result<Option<Driven>, Issue> {
        let target = at.need("target")?;
        let path = target.need("path")?;
        let what = match path.text()? {
            "translation" => Path::Translation,
            "rotation" => Path::Rotation,
            "scale" => Path::Scale,
            "weights" => Path::Weights,
            other => {
                self.cx.warn(
                    &path.place(),
                    format!("animating {other:?} is not supported; it stays as it is"),
                );
                return Ok(None);
            }
        };
        let Some(node) = target.index("node", &self.root, "nodes")? else {
            self.cx
                .warn(&target.place(), "a channel without a node is ignored");
            return Ok(None);
        };
        let sampler = at.need("sampler")?.as_index(animation, "samplers")?;
        let sampler = animation
            .get("samplers")
            .and_then(|list| list.item(sampler))
            .ok_or_else(|| at.fail("no sampler"))?;
        let interpolation = match sampler.get("interpolation") {
            None => Interpolation::Linear,
            Some(kind) => match kind.text()? {
                "LINEAR" => Interpolation::Linear,
                "STEP" => Interpolation::Step,
                "CUBICSPLINE" => Interpolation::CubicSpline,
                other => return Err(kind.fail(format!("unknown interpolation {other:?}"))),
            },
        };
        let input = sampler.need("input")?.as_index(&self.root, "accessors")?;
        let output = sampler.need("output")?.as_index(&self.root, "accessors")?;
        let input = self.accessor(input)?;
        let times: Vec<f32> = input.rows::<1>()?.into_iter().flatten().collect();
        if times.windows(2).any(|pair| pair[0] >= pair[1]) || times[0] < 0.0 {
            return Err(input.at.fail("the times of keys must rise from zero on"));
        }
        let output = self.accessor(output)?;
        let width = match what {
            Path::Translation | Path::Scale => 3,
            Path::Rotation => 4,
            Path::Weights => {
                // So many weights a key as the mesh has targets.
                let parts = if interpolation == Interpolation::CubicSpline {
                    3
                } else {
                    1
                };
                let each = output.count / (times.len() * parts);
                if each == 0 {
                    return Err(output.at.fail("fewer weights than keys"));
                }
                each
            }
        };
        output.expect_width(if what == Path::Weights { 1 } else { width })?;
        let values = output.numbers()?;
        let parts = if interpolation == Interpolation::CubicSpline {
            3
        } else {
            1
        };
        if values.len() != times.len() * parts * width {
            return Err(output.at.fail(format!(
                "{} numbers for {} keys of {} each",
                values.len(),
                times.len(),
                parts * width
            )));
        }
        self.cx
            .charge(&at.place(), (times.len() + values.len()) as u64 * 4)?;
        Ok(Some((
            (node, what),
            Channel {
                interpolation,
                times,
                values,
                width,
            },
        )))
    }
}

/// A matrix of sixteen numbers, column by column.
pub(super) fn affine(m: &[f64; 16]) -> Option<DAffine3> {
    let m = DMat4::from_cols_array(m);
    let last = m.row(3);
    let plain = last.x == 0.0 && last.y == 0.0 && last.z == 0.0 && last.w == 1.0;
    plain.then(|| DAffine3::from_mat4(m))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(
        interpolation: Interpolation,
        times: &[f32],
        values: &[f32],
        width: usize,
    ) -> Channel {
        Channel {
            interpolation,
            times: times.to_vec(),
            values: values.to_vec(),
            width,
        }
    }

    #[test]
    fn keys_are_interpolated_as_specified() {
        let linear = channel(Interpolation::Linear, &[1.0, 3.0], &[2.0, 6.0], 1);
        let step = channel(Interpolation::Step, &[1.0, 3.0], &[2.0, 6.0], 1);
        for (time, l, s) in [
            (0.0, 2.0, 2.0),
            (1.5, 3.0, 2.0),
            (3.0, 6.0, 6.0),
            (9.0, 6.0, 6.0),
        ] {
            assert_eq!(
                (linear.at(time), step.at(time)),
                (vec![l], vec![s]),
                "{time}"
            );
        }
        // Value 0 with slope 1 to value 1 with slope 0 over 2 seconds: t - t^3 / 4 + t^2 / 4 ... by
        // the Hermite basis at the middle: 0.5 + 2 * 0.125.
        let cubic = channel(
            Interpolation::CubicSpline,
            &[0.0, 2.0],
            &[9.0, 0.0, 1.0, 0.0, 1.0, 9.0],
            1,
        );
        assert_eq!(cubic.at(1.0), [0.75]);
        assert_eq!((cubic.at(0.0), cubic.at(2.0)), (vec![0.0], vec![1.0]));
    }

    #[test]
    fn rotations_go_along_the_sphere() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let turn = channel(
            Interpolation::Linear,
            &[0.0, 1.0],
            &[0.0, 0.0, 0.0, 1.0, 0.0, half, 0.0, half],
            4,
        );
        let third = turn.rotation(1.0 / 3.0);
        let expect = DQuat::from_rotation_y(30f64.to_radians());
        assert!(third.dot(expect).abs() > 1.0 - 1e-12, "{third}");
    }

    #[test]
    fn steps_keep_their_edges_and_bends_get_more_keys() {
        let mut all = Animations::default();
        let step = channel(
            Interpolation::Step,
            &[0.0, 1.0],
            &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            3,
        );
        all.channels.insert((0, Path::Translation), step);
        let before = f64::from(1.0f32.next_down());
        assert_eq!(all.key_times(&[0], None, false), [0.0, before, 1.0]);
        assert_eq!(all.key_times(&[1], None, false), [0.0; 0]);
        let fine = all.key_times(&[0], None, true);
        assert!(fine.len() >= 49 && fine.contains(&before), "{fine:?}");
        assert!(fine.windows(2).all(|p| (p[0] as f32) < p[1] as f32));
    }
}
