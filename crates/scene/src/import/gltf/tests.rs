//! What glTF files mean, and what is refused. Files are built here, by patching a small one.

mod broken;
mod geometry;
mod looks;
mod materials;
mod motion;
mod packed;
mod shared;
mod table;

use crate::assets::MemorySource;
use crate::model::*;
use crate::{Overrides, SceneError, load};
use base64::Engine;
use serde_json::{Value, json};

fn floats(list: &[f32]) -> Vec<u8> {
    list.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn data_uri(bytes: &[u8]) -> String {
    let engine = base64::engine::general_purpose::STANDARD;
    format!(
        "data:application/octet-stream;base64,{}",
        engine.encode(bytes)
    )
}

/// A file that grows: every array becomes a view and an accessor of one buffer.
#[derive(Clone)]
pub(in crate::import) struct Model {
    pub json: Value,
    pub bytes: Vec<u8>,
}

impl Model {
    fn new() -> Self {
        Model {
            json: json!({
                "asset": {"version": "2.0"},
                "scene": 0,
                "scenes": [{"nodes": [0]}],
                "nodes": [{"mesh": 0}],
                "meshes": [{"primitives": [{"attributes": {}}]}],
                "accessors": [],
                "bufferViews": []
            }),
            bytes: Vec::new(),
        }
    }

    /// A triangle with normals, two sets of coordinates and colours.
    fn triangle() -> Self {
        let mut m = Model::new();
        let positions = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        m.attribute("POSITION", "VEC3", 5126, 3, &positions);
        let normals = floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        m.attribute("NORMAL", "VEC3", 5126, 3, &normals);
        let uvs = floats(&[0.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
        m.attribute("TEXCOORD_0", "VEC2", 5126, 3, &uvs);
        let second = floats(&[0.5, 0.5, 0.25, 0.5, 0.5, 0.25]);
        m.attribute("TEXCOORD_1", "VEC2", 5126, 3, &second);
        m
    }

    /// Adds a view; returns its index.
    fn view(&mut self, bytes: &[u8]) -> usize {
        while !self.bytes.len().is_multiple_of(4) {
            self.bytes.push(0);
        }
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()}));
        self.bytes.extend_from_slice(bytes);
        self.json["bufferViews"].as_array().unwrap().len() - 1
    }

    /// Adds an accessor over a view of its own; returns its index.
    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let list = self.json["accessors"].as_array_mut().unwrap();
        list.push(
            json!({"bufferView": view, "componentType": component, "count": count, "type": kind}),
        );
        list.len() - 1
    }

    fn attribute(
        &mut self,
        name: &str,
        kind: &str,
        component: u32,
        count: usize,
        bytes: &[u8],
    ) -> usize {
        let index = self.accessor(kind, component, count, bytes);
        self.json["meshes"][0]["primitives"][0]["attributes"][name] = index.into();
        index
    }

    fn indices(&mut self, list: &[u16]) -> usize {
        let bytes: Vec<u8> = list.iter().flat_map(|i| i.to_le_bytes()).collect();
        let index = self.accessor("SCALAR", 5123, list.len(), &bytes);
        self.json["meshes"][0]["primitives"][0]["indices"] = index.into();
        index
    }

    /// A picture of one white pixel as image and texture 0.
    fn picture(&mut self) {
        let view = self.view(&white());
        self.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
        self.json["textures"] = json!([{"source": 0}]);
    }

    fn material(mut self, material: Value) -> Self {
        self.json["materials"] = json!([material]);
        self.json["meshes"][0]["primitives"][0]["material"] = 0.into();
        self
    }

    fn with(mut self, pointer: &str, value: Value) -> Self {
        set(&mut self.json, pointer, value);
        self
    }

    pub fn text(&self) -> String {
        text_of(&self.json, &self.bytes)
    }
    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        glb(json.to_string().as_bytes(), Some(&self.bytes))
    }

    fn load(&self) -> Result<(SceneDesc, Vec<String>), SceneError> {
        load_text(&self.text(), &Overrides::default())
    }

    /// Loads what must be fine, with nothing said but that a sky was added.
    fn fine(&self) -> SceneDesc {
        let (desc, said) = self.load().unwrap_or_else(|e| panic!("{e}"));
        let said: Vec<_> = said.iter().filter(|s| !s.contains("soft sky")).collect();
        assert!(said.is_empty(), "{said:?}");
        desc
    }
}

/// A picture of one white pixel.
pub(in crate::import) fn white() -> Vec<u8> {
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbaImage::from_pixel(1, 1, image::Rgba([255; 4]))
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    png.into_inner()
}

/// The text of a file, with the bytes in a data URI unless it has buffers already.
pub(in crate::import) fn text_of(json: &Value, bytes: &[u8]) -> String {
    let mut json = json.clone();
    if json.get("buffers").is_none() {
        json["buffers"] = json!([{"byteLength": bytes.len(), "uri": data_uri(bytes)}]);
    }
    json.to_string()
}

/// A model with as much in it as one can have.
pub(in crate::import) fn everything() -> Model {
    let mut m = motion::skinned();
    m.picture();
    m.indices(&[0, 1, 2]);
    let raise = floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let raise = m.accessor("VEC3", 5126, 3, &raise);
    m.attribute("COLOR_0", "VEC4", 5121, 3, &[255; 12]);
    let places = m.accessor("VEC3", 5126, 2, &floats(&[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]));
    let values = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    motion::animate(
        &mut m,
        2,
        "rotation",
        "LINEAR",
        &[0.0, 0.25],
        &values,
        "VEC4",
    );
    motion::animate(
        &mut m,
        0,
        "weights",
        "STEP",
        &[0.0, 0.5],
        &[0.0, 1.0],
        "SCALAR",
    );
    let sparse = m.view(&[1, 2]);
    let replaced = m.view(&floats(&[1.0, 0.0, 0.5, 0.0, 1.0, 0.5]));
    let texture = json!({"index": 0, "extensions": {"KHR_texture_transform": {"rotation": 1, "scale": [2, 3]}}});
    let m = m
        .with("/accessors/0/sparse", json!({
            "count": 2, "indices": {"bufferView": sparse, "componentType": 5121}, "values": {"bufferView": replaced}}))
        .with("/meshes/0/primitives/0/targets", json!([{"POSITION": raise}]))
        .with("/meshes/1", json!({"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "material": 0}]}))
        .with("/nodes/3", json!({"mesh": 1, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}}))
        .with("/nodes/4", json!({"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}))
        .with("/scenes/0/nodes", json!([0, 1, 3, 4]))
        .with("/cameras", json!([{"type": "perspective", "perspective": {"yfov": 1, "aspectRatio": 1.5, "znear": 1}}]))
        .with("/extensions", json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {"outerConeAngle": 1}}]}}));
    m.material(json!({
        "name": "m", "alphaMode": "MASK", "emissiveFactor": [1, 1, 1], "normalTexture": texture,
        "pbrMetallicRoughness": {"baseColorTexture": texture, "metallicFactor": 0.5},
        "extensions": {
            "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatNormalTexture": texture},
            "KHR_materials_anisotropy": {"anisotropyStrength": 1},
            "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [1, 0, 0]},
            "KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceThicknessTexture": {"index": 0}}
        }
    }))
}

/// Sets a value by pointer; missing objects on the way are made, arrays grow by one.
fn set(json: &mut Value, pointer: &str, value: Value) {
    let mut at = json;
    for part in pointer.split('/').skip(1) {
        at = match at {
            Value::Array(list) => {
                let index: usize = part.parse().unwrap();
                if index == list.len() {
                    list.push(Value::Null);
                }
                &mut list[index]
            }
            other => &mut other[part],
        };
    }
    *at = value;
}

fn glb(json: &[u8], bin: Option<&[u8]>) -> Vec<u8> {
    let padded = |bytes: &[u8], by: u8| {
        let mut bytes = bytes.to_vec();
        while !bytes.len().is_multiple_of(4) {
            bytes.push(by);
        }
        bytes
    };
    let mut body = Vec::new();
    for (kind, chunk) in [
        (b"JSON", Some(padded(json, b' '))),
        (b"BIN\0", bin.map(|b| padded(b, 0))),
    ] {
        if let Some(chunk) = chunk {
            body.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
            body.extend_from_slice(kind);
            body.extend_from_slice(&chunk);
        }
    }
    let mut out = b"glTF\x02\0\0\0".to_vec();
    out.extend_from_slice(&(body.len() as u32 + 12).to_le_bytes());
    out.extend(body);
    out
}

fn load_text(text: &str, overrides: &Overrides) -> Result<(SceneDesc, Vec<String>), SceneError> {
    let files = MemorySource::new().with("m.gltf", text).unwrap();
    let (desc, said) = load("m.gltf", &files, overrides)?;
    Ok((desc, said.iter().map(ToString::to_string).collect()))
}

fn mesh(desc: &SceneDesc) -> &Mesh {
    match desc.primitives[0].shape {
        Shape::Mesh(id) => &desc.meshes[id.index()],
        ref other => panic!("{other:?}"),
    }
}
