//! Material libraries: the old illumination models and the physically based properties that many
//! programs write, as principled surfaces.

use super::{Surface, lines, number};
use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::model::{
    BsdfDesc, Channel, ColorTex, Emission, Encoding, FloatTex, Material, MaterialId, Principled,
    Rgb, Texture, TextureId, UvMap, Wrap,
};
use std::collections::BTreeMap;

/// Full height of a bump map of strength 1, as a share of the model's diagonal: the format has no
/// unit for it.
const BUMP: f32 = 0.01;

/// A picture with its options.
#[derive(Clone, Debug)]
struct Map {
    file: String,
    place: Place,
    offset: [f64; 2],
    scale: [f64; 2],
    strength: f32,
    clamp: bool,
}

/// What a library says of a material.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    place: Place,
    diagonal: f32,
    colors: BTreeMap<&'static str, Rgb>,
    numbers: BTreeMap<&'static str, f32>,
    maps: BTreeMap<&'static str, Map>,
}

/// All materials of the libraries that a file names.
pub(super) struct Library {
    entries: BTreeMap<String, Entry>,
    diagonal: f32,
}

const COLORS: [&str; 4] = ["Kd", "Ks", "Ke", "Tf"];
const NUMBERS: [&str; 12] = [
    "Ns", "Ni", "d", "Tr", "illum", "Pr", "Pm", "Ps", "Pc", "Pcr", "aniso", "anisor",
];
/// Words for pictures, and what they stand for.
const MAPS: [(&str, &str); 12] = [
    ("map_Kd", "Kd"),
    ("map_Ks", "Ks"),
    ("map_Ke", "Ke"),
    ("map_d", "d"),
    ("map_Pr", "Pr"),
    ("map_Pm", "Pm"),
    ("map_Ps", "Ps"),
    ("map_Bump", "bump"),
    ("map_bump", "bump"),
    ("bump", "bump"),
    ("norm", "norm"),
    ("map_Kn", "norm"),
];

impl Library {
    pub fn new(diagonal: f32) -> Self {
        Library {
            entries: BTreeMap::new(),
            diagonal,
        }
    }

    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    pub fn take(&mut self, name: &str) -> Option<Entry> {
        self.entries.remove(name)
    }

    /// Reads what a `mtllib` names: one file, whose name may have spaces, or several.
    pub fn read(&mut self, names: &str, place: &Place, cx: &mut Context<'_>) {
        // Often with the backslashes of the system that wrote them.
        let names = &names.replace('\\', "/");
        let whole = cx
            .path(place, names)
            .is_ok_and(|path| cx.assets.exists(&path));
        let list: Vec<&str> = if whole || !names.contains(' ') {
            vec![names.as_str()]
        } else {
            names.split_ascii_whitespace().collect()
        };
        for name in list {
            let result = self.file(name, place, cx);
            cx.keep(result);
        }
    }

    fn file(&mut self, name: &str, user: &Place, cx: &mut Context<'_>) -> Result<(), Issue> {
        let path = cx.path(user, name)?;
        if !cx.assets.exists(&path) && cx.allows_missing() {
            cx.warn(
                user,
                format!("{path}: no such file; its materials are shown in grey"),
            );
            return Ok(());
        }
        let bytes = cx.read(user, &path)?;
        let mut place = Place {
            file: path,
            ..Place::default()
        };
        let mut current: Option<String> = None;
        let mut foreign = false;
        for line in lines(&bytes) {
            place.line = Some(line.number);
            line.check(&place, cx, &mut foreign)?;
            let text = line.text;
            let (word, rest) = text
                .split_once(char::is_whitespace)
                .map_or((text.as_str(), ""), |(w, r)| (w, r.trim()));
            if word.is_empty() {
                continue;
            }
            if word == "newmtl" {
                if self.entries.contains_key(rest) {
                    return Err(Issue::new(
                        &place,
                        format!("material {rest:?} is there twice"),
                    ));
                }
                let entry = Entry {
                    place: place.clone(),
                    diagonal: self.diagonal,
                    colors: BTreeMap::new(),
                    numbers: BTreeMap::new(),
                    maps: BTreeMap::new(),
                };
                self.entries.insert(rest.to_owned(), entry);
                current = Some(rest.to_owned());
                continue;
            }
            let Some(entry) = current.as_ref().and_then(|name| self.entries.get_mut(name)) else {
                return Err(Issue::new(
                    &place,
                    format!("{word:?} before the first newmtl"),
                ));
            };
            entry.property(word, rest, &place, cx)?;
        }
        cx.release(bytes.len() as u64);
        Ok(())
    }
}

fn numbers(words: &[&str], place: &Place) -> Result<Vec<f64>, Issue> {
    words
        .iter()
        .map(|word| match number(word) {
            Some(x) if x.is_finite() => Ok(x),
            _ => Err(Issue::new(place, format!("{word:?} is no finite number"))),
        })
        .collect()
}

impl Entry {
    fn property(
        &mut self,
        word: &str,
        rest: &str,
        place: &Place,
        cx: &mut Context<'_>,
    ) -> Result<(), Issue> {
        let words: Vec<&str> = rest.split_ascii_whitespace().collect();
        if let Some(name) = COLORS.iter().find(|n| **n == word) {
            if matches!(words.first(), Some(&("spectral" | "xyz"))) {
                cx.warn(
                    place,
                    format!("{word} {}: only RGB is read; it is ignored", words[0]),
                );
                return Ok(());
            }
            let list = numbers(&words, place)?;
            let rgb = match list[..] {
                [grey] => [grey; 3],
                [r, g, b] => [r, g, b],
                _ => {
                    return Err(Issue::new(
                        place,
                        format!("{word} with {} numbers", list.len()),
                    ));
                }
            };
            self.colors.insert(name, rgb.map(|c| c.max(0.0) as f32));
        } else if let Some(name) = NUMBERS.iter().find(|n| **n == word) {
            let list = numbers(&words, place)?;
            let [x] = list[..] else {
                return Err(Issue::new(
                    place,
                    format!("{word} with {} numbers", list.len()),
                ));
            };
            self.numbers.insert(name, x as f32);
        } else if let Some((_, name)) = MAPS.iter().find(|(w, _)| *w == word) {
            self.maps.insert(name, map(&words, place, cx)?);
        } else if word != "Ka" && word != "map_Ka" {
            // Ambient light is what global illumination is about: it has no colour of its own.
            let near = crate::suggest::did_you_mean(word, COLORS.into_iter().chain(NUMBERS));
            let shown: String = word.chars().take(40).collect();
            cx.warn(place, format!("{shown:?} is not used{near}"));
        }
        Ok(())
    }

    fn weight(&self, name: &str, default: f32, cx: &mut Context<'_>) -> f32 {
        let x = self.numbers.get(name).copied().unwrap_or(default);
        let moved = x.clamp(0.0, 1.0);
        if moved != x {
            cx.warn(
                &self.place,
                format!("{name} is {x}, out of range; {moved} is used"),
            );
        }
        moved
    }

    /// The surface, with its textures and material added to the scene.
    pub fn surface(
        self,
        name: &str,
        cx: &mut Context<'_>,
        textures: &mut Vec<Texture>,
        materials: &mut Vec<Material>,
    ) -> Result<Surface, Issue> {
        let entry = &self;
        let mut node = |key: &str, encoding: Encoding, scale: [f32; 4], cx: &mut Context<'_>| {
            let Some(map) = entry.maps.get(key) else {
                return Ok(None);
            };
            let image = cx.image(&map.place, &map.file, encoding)?;
            let wrap = if map.clamp { Wrap::Clamp } else { Wrap::Repeat };
            let id = TextureId(textures.len() as u32);
            textures.push(Texture::Image {
                image,
                map: UvMap::Uv {
                    set: 0,
                    matrix: [
                        map.scale[0],
                        0.0,
                        map.offset[0],
                        0.0,
                        map.scale[1],
                        map.offset[1],
                    ],
                },
                wrap: (wrap, wrap),
                mip: None,
                nearest: false,
                invert: false,
                scale,
            });
            let channels = cx.info(image).map_or(4, |info| info.channels);
            Ok::<_, Issue>(Some((id, channels)))
        };
        let times = |c: Rgb| [c[0], c[1], c[2], 1.0];
        let illum = self.numbers.get("illum").copied().unwrap_or(2.0);
        let mut p = Principled::default();
        let kd = self.colors.get("Kd").copied();
        // A picture without a colour beside it is not darkened.
        let default = if self.maps.contains_key("Kd") {
            [1.0; 3]
        } else {
            [0.6; 3]
        };
        let kd = kd.unwrap_or(default).map(|c| c.min(1.0));
        p.base_color = match node("Kd", Encoding::Srgb, times(kd), cx)? {
            Some((id, _)) => ColorTex::Texture(id),
            None => ColorTex::Const(kd),
        };
        let metal = self.weight(
            "Pm",
            if self.maps.contains_key("Pm") {
                1.0
            } else {
                0.0
            },
            cx,
        );
        p.metallic = match node("Pm", Encoding::Linear, [metal; 4], cx)? {
            Some((id, _)) => FloatTex::Texture(id, Channel::R),
            None => FloatTex::Const(metal),
        };
        let ns = self.numbers.get("Ns").copied();
        // The width of a cosine lobe of power n, alpha^2 = 2 / (n + 2); alpha = r^2.
        let from_ns = ns.map(|n| (2.0 / (n.max(0.0) + 2.0)).sqrt().sqrt());
        let rough = if self.numbers.contains_key("Pr") {
            self.weight("Pr", 0.5, cx)
        } else if self.maps.contains_key("Pr") {
            1.0
        } else {
            from_ns.unwrap_or(0.5)
        };
        p.roughness = match node("Pr", Encoding::Linear, [rough; 4], cx)? {
            Some((id, _)) => FloatTex::Texture(id, Channel::R),
            None => FloatTex::Const(rough),
        };
        let physical = ["Pr", "Pm"]
            .iter()
            .any(|n| self.numbers.contains_key(n) || self.maps.contains_key(n));
        let ks = self.colors.get("Ks").copied().unwrap_or([1.0; 3]);
        let mean = ((ks[0] + ks[1] + ks[2]) / 3.0).min(1.0);
        let shine = if illum < 2.0 && !physical { 0.0 } else { mean };
        p.specular = match node("Ks", Encoding::Linear, [shine; 4], cx)? {
            Some((id, _)) => FloatTex::Texture(id, Channel::Mean),
            None => FloatTex::Const(if physical { 1.0 } else { shine }),
        };
        if let Some(&ior) = self.numbers.get("Ni") {
            p.ior = if (1.0..=10.0).contains(&ior) {
                ior
            } else {
                1.5
            };
            if p.ior != ior {
                cx.warn(
                    &self.place,
                    format!("Ni is {ior}, out of range; 1.5 is used"),
                );
            }
        }
        let sheen = self.weight("Ps", 0.0, cx);
        p.sheen_color = match node(
            "Ps",
            Encoding::Linear,
            [sheen.max(f32::MIN_POSITIVE); 4],
            cx,
        )? {
            Some((id, _)) => ColorTex::Texture(id),
            None => ColorTex::Const([sheen; 3]),
        };
        p.sheen_roughness = FloatTex::Const(0.5);
        p.coat = FloatTex::Const(self.weight("Pc", 0.0, cx));
        p.coat_roughness = FloatTex::Const(self.weight("Pcr", 0.0, cx));
        p.anisotropy = FloatTex::Const(self.weight("aniso", 0.0, cx));
        let turn = self.numbers.get("anisor").copied().unwrap_or(0.0);
        p.anisotropy_rotation = FloatTex::Const(turn * 360.0);
        // Models 4, 6, 7 and 9 are glass; the others are seen through where they are not solid.
        let glass = [4.0, 6.0, 7.0, 9.0].contains(&illum);
        let mut open = if self.numbers.contains_key("d") {
            self.weight("d", 1.0, cx)
        } else {
            1.0 - self.weight("Tr", 0.0, cx)
        };
        if open == 0.0 && !glass && !self.numbers.contains_key("d") {
            // Nobody models what cannot be seen; MeshLab writes this for what is solid.
            open = 1.0;
            let reason = format!("material {name:?} has Tr 1, which means invisible: shown solid");
            cx.warn(&self.place, reason);
        }
        let mut alpha = None;
        if glass {
            let tint = self.colors.get("Tf").copied();
            p.transmission = FloatTex::Const(if open < 1.0 { 1.0 - open } else { 1.0 });
            p.base_color = ColorTex::Const(tint.unwrap_or([1.0; 3]).map(|c| c.min(1.0)));
        } else if let Some((id, channels)) = node("d", Encoding::Linear, [open; 4], cx)? {
            let channel = if channels == 2 || channels == 4 {
                Channel::A
            } else {
                Channel::R
            };
            alpha = Some(FloatTex::Texture(id, channel));
        } else if open < 1.0 {
            alpha = Some(FloatTex::Const(open));
        }
        let default = if self.maps.contains_key("Ke") {
            [1.0; 3]
        } else {
            [0.0; 3]
        };
        let ke = self.colors.get("Ke").copied().unwrap_or(default);
        let emission = (ke != [0.0; 3]).then_some(ke);
        let radiance = match node("Ke", Encoding::Srgb, times(ke), cx)? {
            Some((id, _)) => ColorTex::Texture(id),
            None => ColorTex::Const(ke),
        };
        let normal = node("norm", Encoding::Linear, [1.0; 4], cx)?;
        let strength = self.maps.get("norm").map_or(1.0, |m| m.strength);
        let bump = self.maps.get("bump").map_or(1.0, |m| m.strength) * BUMP * self.diagonal;
        let bump = node("bump", Encoding::Linear, [bump; 4], cx)?;
        if bump.is_some()
            && let Some(map) = self.maps.get("bump")
        {
            cx.warn(
                &map.place,
                "heights of bump maps have no unit: white is taken as a hundredth of the model's size",
            );
        }
        let material = MaterialId(materials.len() as u32);
        materials.push(Material {
            name: name.to_owned(),
            bsdf: BsdfDesc::Principled(Box::new(p)),
            normal_map: normal.map(|(id, _)| (id, strength)),
            bump_map: bump.map(|(id, _)| FloatTex::Texture(id, Channel::Mean)),
        });
        Ok(Surface {
            material,
            emission: emission.map(|_| Emission {
                radiance,
                scale: 1.0,
                two_sided: true,
            }),
            alpha,
            tangents: normal.is_some(),
        })
    }
}

/// A picture with options before its name.
fn map(words: &[&str], place: &Place, cx: &mut Context<'_>) -> Result<Map, Issue> {
    let mut out = Map {
        file: String::new(),
        place: place.clone(),
        offset: [0.0; 2],
        scale: [1.0; 2],
        strength: 1.0,
        clamp: false,
    };
    let mut rest = words;
    while let Some((option, after)) = rest.split_first().filter(|(w, _)| w.starts_with('-')) {
        // Options with up to three numbers, and with one word.
        let count = match *option {
            "-o" | "-s" | "-t" => after
                .iter()
                .take(3)
                .take_while(|w| number(w).is_some())
                .count(),
            "-mm" => 2,
            "-bm" | "-boost" | "-clamp" | "-blendu" | "-blendv" | "-cc" | "-imfchan"
            | "-texres" | "-type" | "-colorspace" => 1,
            other => {
                return Err(Issue::new(
                    place,
                    format!("unknown option {other:?} of a picture"),
                ));
            }
        };
        let Some((values, next)) = after.split_at_checked(count) else {
            return Err(Issue::new(place, format!("{option} without its values")));
        };
        match *option {
            "-o" | "-s" => {
                let list = numbers(values, place)?;
                let to = if *option == "-o" {
                    &mut out.offset
                } else {
                    &mut out.scale
                };
                for (to, x) in to.iter_mut().zip(list) {
                    *to = x;
                }
            }
            "-bm" => out.strength = numbers(values, place)?[0] as f32,
            "-clamp" => out.clamp = values == ["on"],
            _ => cx.warn(
                place,
                format!("the option {option} of a picture is not used"),
            ),
        }
        rest = next;
    }
    if rest.is_empty() {
        return Err(Issue::new(place, "no file name"));
    }
    // Names may have spaces, and often come with the backslashes of the system that wrote them.
    out.file = rest.join(" ").replace('\\', "/");
    Ok(out)
}
