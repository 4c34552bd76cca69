//! Values that have several spellings: colours, numbers, transforms, and maps that keep their order.

use crate::color;
use crate::model::{Channel, Rgb};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::ser::{SerializeMap, Serializer};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;

/// An object whose order counts and whose keys are all different.
#[derive(Clone, Debug, PartialEq)]
pub struct Named<T>(pub Vec<(String, T)>);

impl<T> Default for Named<T> {
    fn default() -> Self {
        Named(Vec::new())
    }
}

impl<T> Named<T> {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl<T: Serialize> Serialize for Named<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, value) in &self.0 {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Named<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entries<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Entries<T> {
            type Value = Named<T>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of named things")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut names = std::collections::BTreeSet::new();
                let mut entries = Vec::new();
                while let Some(name) = map.next_key::<String>()? {
                    if !names.insert(name.clone()) {
                        return Err(de::Error::custom(format_args!(
                            "the name {name:?} is there twice"
                        )));
                    }
                    entries.push((name, map.next_value()?));
                }
                Ok(Named(entries))
            }
        }
        deserializer.deserialize_map(Entries(PhantomData))
    }
}

impl<T: JsonSchema> JsonSchema for Named<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("NamedOf{}", T::schema_name()).into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let item = generator.subschema_for::<T>();
        json_schema!({ "type": "object", "additionalProperties": item })
    }
}

/// `[r, g, b]`, one number for grey, `"srgb(#rrggbb)"` or `"blackbody(6500)"`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color(pub Rgb);

impl Serialize for Color {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match ColorValue::deserialize(deserializer)? {
            ColorValue::Const(rgb) => Ok(Color(rgb)),
            // A name is no colour: the parser says what is.
            ColorValue::Texture(name) => color::parse(&name).map(Color).map_err(de::Error::custom),
        }
    }
}

impl JsonSchema for Color {
    fn schema_name() -> Cow<'static, str> {
        "Color".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "Linear Rec. 709 [r, g, b], one number for grey, \"srgb(#rrggbb)\" or \"blackbody(6500)\".",
            "anyOf": [
                { "type": "array", "items": { "type": "number", "minimum": 0 }, "minItems": 3, "maxItems": 3 },
                { "type": "number", "minimum": 0 },
                { "type": "string", "pattern": "^(srgb|blackbody)\\s*\\(.*\\)$" }
            ]
        })
    }
}

/// A colour, or the name of a texture.
#[derive(Clone, Debug, PartialEq)]
pub enum ColorValue {
    Const(Rgb),
    Texture(String),
}

impl Serialize for ColorValue {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            ColorValue::Const(rgb) => rgb.serialize(serializer),
            ColorValue::Texture(name) => serializer.serialize_str(name),
        }
    }
}

impl<'de> Deserialize<'de> for ColorValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = ColorValue;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a colour: [r, g, b], a number, \"srgb(#rrggbb)\", \"blackbody(6500)\" or a texture's name")
            }
            fn visit_f64<E: de::Error>(self, v: f64) -> Result<Self::Value, E> {
                Ok(ColorValue::Const([v as f32; 3]))
            }
            fn visit_u64<E: de::Error>(self, v: u64) -> Result<Self::Value, E> {
                self.visit_f64(v as f64)
            }
            fn visit_i64<E: de::Error>(self, v: i64) -> Result<Self::Value, E> {
                self.visit_f64(v as f64)
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<Self::Value, E> {
                if text.contains('(') {
                    return color::parse(text).map(ColorValue::Const).map_err(E::custom);
                }
                Ok(ColorValue::Texture(text.to_owned()))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
                let mut rgb = [0.0f32; 3];
                for (i, c) in rgb.iter_mut().enumerate() {
                    *c = seq
                        .next_element()?
                        .ok_or_else(|| de::Error::invalid_length(i, &"three numbers"))?;
                }
                match seq.next_element::<de::IgnoredAny>()? {
                    None => Ok(ColorValue::Const(rgb)),
                    Some(_) => Err(de::Error::invalid_length(4, &"three numbers")),
                }
            }
        }
        deserializer.deserialize_any(Any)
    }
}

impl JsonSchema for ColorValue {
    fn schema_name() -> Cow<'static, str> {
        "ColorOrTexture".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let color = generator.subschema_for::<Color>();
        json_schema!({ "anyOf": [color, { "type": "string", "description": "The name of a texture." }] })
    }
}

/// A number, the name of a texture (its red), or `{"texture": name, "channel": "a"}`.
#[derive(Clone, Debug, PartialEq)]
pub enum FloatValue {
    Const(f32),
    Texture(String, Channel),
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct TextureChannel {
    /// The texture's name.
    texture: String,
    /// Which of its numbers.
    channel: Channel,
}

impl Serialize for FloatValue {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            FloatValue::Const(v) => v.serialize(serializer),
            FloatValue::Texture(texture, channel) => TextureChannel {
                texture: texture.clone(),
                channel: *channel,
            }
            .serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for FloatValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = FloatValue;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "a number, a texture's name, or {\"texture\": name, \"channel\": \"r\"}",
                )
            }
            fn visit_f64<E: de::Error>(self, v: f64) -> Result<Self::Value, E> {
                Ok(FloatValue::Const(v as f32))
            }
            fn visit_u64<E: de::Error>(self, v: u64) -> Result<Self::Value, E> {
                self.visit_f64(v as f64)
            }
            fn visit_i64<E: de::Error>(self, v: i64) -> Result<Self::Value, E> {
                self.visit_f64(v as f64)
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<Self::Value, E> {
                Ok(FloatValue::Texture(text.to_owned(), Channel::R))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                let both = TextureChannel::deserialize(de::value::MapAccessDeserializer::new(map))?;
                Ok(FloatValue::Texture(both.texture, both.channel))
            }
        }
        deserializer.deserialize_any(Any)
    }
}

impl JsonSchema for FloatValue {
    fn schema_name() -> Cow<'static, str> {
        "NumberOrTexture".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let channel = generator.subschema_for::<TextureChannel>();
        json_schema!({ "anyOf": [
            { "type": "number" },
            { "type": "string", "description": "The name of a texture, of which red is taken." },
            channel
        ] })
    }
}

/// One step of a transform. The steps of a list are done one after the other to what they place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Step {
    /// Moves.
    Translate([f64; 3]),
    /// Turns counterclockwise about an axis through the origin.
    Rotate {
        /// Direction of the axis.
        axis: [f64; 3],
        /// How far.
        degrees: f64,
    },
    /// Scales by axis; the same number three times scales evenly.
    Scale([f64; 3]),
    /// Three rows of four numbers, the last column being the translation.
    Matrix([f64; 12]),
    /// Turns and moves what looks along -Z (a camera) so that it looks from one point at another.
    LookAt {
        /// Where it is.
        from: [f64; 3],
        /// What it looks at.
        at: [f64; 3],
        /// Which way is up.
        #[serde(default = "up")]
        up: [f64; 3],
    },
}

pub fn up() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

/// One key of something that moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Key {
    /// Seconds.
    pub time: f64,
    /// Where it is at that time.
    pub transform: Vec<Step>,
}

/// A list of steps, or `{"keys": [...]}` for what moves.
#[derive(Clone, Debug, PartialEq)]
pub enum Placement {
    Fixed(Vec<Step>),
    Keys(Vec<Key>),
}

impl Default for Placement {
    fn default() -> Self {
        Placement::Fixed(Vec::new())
    }
}

impl Placement {
    pub fn is_identity(&self) -> bool {
        matches!(self, Placement::Fixed(steps) if steps.is_empty())
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Keys {
    /// In the order of their times.
    keys: Vec<Key>,
}

impl Serialize for Placement {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Placement::Fixed(steps) => steps.serialize(serializer),
            Placement::Keys(keys) => Keys { keys: keys.clone() }.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Placement {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = Placement;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list of transform steps, or {\"keys\": [...]}")
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Self::Value, A::Error> {
                Vec::deserialize(de::value::SeqAccessDeserializer::new(seq)).map(Placement::Fixed)
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                Keys::deserialize(de::value::MapAccessDeserializer::new(map))
                    .map(|k| Placement::Keys(k.keys))
            }
        }
        deserializer.deserialize_any(Any)
    }
}

impl JsonSchema for Placement {
    fn schema_name() -> Cow<'static, str> {
        "Placement".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let steps = generator.subschema_for::<Vec<Step>>();
        let keys = generator.subschema_for::<Keys>();
        json_schema!({ "anyOf": [steps, keys] })
    }
}
