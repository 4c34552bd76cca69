//! JSON as a tree that keeps its order, refuses doubled names and is bounded in size, and a cursor
//! over it that knows where it is, so that every complaint carries a JSON pointer.
//!
//! Reading through a cursor instead of through types costs little here (the bulk of a glTF file is
//! binary) and buys exact places, and a list of the properties that nobody asked for.

use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::native::locate;
use serde::de::{self, DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use std::cell::Cell;
use std::fmt;

/// Most values of a JSON text: a value takes some 32 bytes here and may take two in the file.
const MAX_VALUES: u64 = 8_000_000;

/// Any JSON value.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Json {
    Null,
    Bool(bool),
    Number(f64),
    String(String),
    Array(Vec<Json>),
    Object(Vec<(String, Json)>),
}

/// Reads a text; the error has line and column where serde gives them.
pub(super) fn parse(file: &str, text: &str) -> Result<Json, Issue> {
    let left = Cell::new(MAX_VALUES);
    let mut reader = serde_json::Deserializer::from_str(text);
    let result = Seed(&left)
        .deserialize(&mut reader)
        .and_then(|json| reader.end().map(|()| json));
    result.map_err(|error| {
        let position = |n: usize| u32::try_from(n).ok().filter(|&n| n > 0);
        let pointer = locate::pointer(text, error.line(), error.column());
        let place = Place {
            file: file.to_owned(),
            line: position(error.line()),
            column: position(error.column()),
            pointer: Some(pointer).filter(|p| !p.is_empty()),
        };
        let message = error.to_string();
        let message = message
            .rsplit_once(" at line ")
            .map_or(message.as_str(), |(message, _)| message);
        Issue::new(&place, format!("not readable as JSON: {message}"))
    })
}

struct Seed<'b>(&'b Cell<u64>);

impl<'de> DeserializeSeed<'de> for Seed<'_> {
    type Value = Json;
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Json, D::Error> {
        let left = self.0.get();
        if left == 0 {
            return Err(de::Error::custom(format_args!(
                "more than {MAX_VALUES} values, the limit"
            )));
        }
        self.0.set(left - 1);
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Seed<'_> {
    type Value = Json;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }
    fn visit_unit<E: de::Error>(self) -> Result<Json, E> {
        Ok(Json::Null)
    }
    fn visit_bool<E: de::Error>(self, v: bool) -> Result<Json, E> {
        Ok(Json::Bool(v))
    }
    fn visit_f64<E: de::Error>(self, v: f64) -> Result<Json, E> {
        Ok(Json::Number(v))
    }
    fn visit_u64<E: de::Error>(self, v: u64) -> Result<Json, E> {
        Ok(Json::Number(v as f64))
    }
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<Json, E> {
        Ok(Json::Number(v as f64))
    }
    fn visit_str<E: de::Error>(self, v: &str) -> Result<Json, E> {
        Ok(Json::String(v.to_owned()))
    }
    fn visit_string<E: de::Error>(self, v: String) -> Result<Json, E> {
        Ok(Json::String(v))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Json, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element_seed(Seed(self.0))? {
            items.push(item);
        }
        Ok(Json::Array(items))
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Json, A::Error> {
        let mut names = std::collections::BTreeSet::new();
        let mut members = Vec::new();
        while let Some(name) = map.next_key::<String>()? {
            if !names.insert(name.clone()) {
                return Err(de::Error::custom(format_args!(
                    "the property {name:?} is there twice"
                )));
            }
            members.push((name, map.next_value_seed(Seed(self.0))?));
        }
        Ok(Json::Object(members))
    }
}

/// A value and where it is.
#[derive(Clone, Debug)]
pub(super) struct At<'j> {
    pub json: &'j Json,
    file: &'j str,
    pub pointer: String,
}

impl<'j> At<'j> {
    pub fn root(file: &'j str, json: &'j Json) -> Self {
        At {
            json,
            file,
            pointer: String::new(),
        }
    }

    pub fn place(&self) -> Place {
        Place {
            file: self.file.to_owned(),
            pointer: Some(self.pointer.clone()).filter(|p| !p.is_empty()),
            ..Place::default()
        }
    }

    pub fn fail(&self, reason: impl Into<String>) -> Issue {
        Issue::new(&self.place(), reason)
    }

    fn kind(&self) -> &'static str {
        match self.json {
            Json::Null => "null",
            Json::Bool(_) => "true or false",
            Json::Number(_) => "a number",
            Json::String(_) => "a string",
            Json::Array(_) => "an array",
            Json::Object(_) => "an object",
        }
    }

    fn expected<T>(&self, what: &str) -> Result<T, Issue> {
        Err(self.fail(format!("expected {what}, found {}", self.kind())))
    }

    fn child(&self, name: &str, json: &'j Json) -> At<'j> {
        At {
            json,
            file: self.file,
            pointer: format!("{}/{}", self.pointer, locate::escape(name)),
        }
    }

    /// A member of an object; what is no object has none.
    pub fn get(&self, name: &str) -> Option<At<'j>> {
        let Json::Object(members) = self.json else {
            return None;
        };
        let (_, json) = members.iter().find(|(n, _)| n == name)?;
        Some(self.child(name, json))
    }

    pub fn need(&self, name: &str) -> Result<At<'j>, Issue> {
        match self.json {
            Json::Object(_) => self
                .get(name)
                .ok_or_else(|| self.fail(format!("the property {name:?} is missing"))),
            _ => self.expected("an object"),
        }
    }

    /// All members of an object.
    pub fn members(&self) -> Result<Vec<(&'j str, At<'j>)>, Issue> {
        match self.json {
            Json::Object(members) => Ok(members
                .iter()
                .map(|(name, json)| (name.as_str(), self.child(name, json)))
                .collect()),
            _ => self.expected("an object"),
        }
    }

    /// How many items an array has; 0 for a missing one.
    pub fn len_of(&self, name: &str) -> Result<usize, Issue> {
        match self.get(name) {
            None => Ok(0),
            Some(list) => match list.json {
                Json::Array(items) => Ok(items.len()),
                _ => list.expected("an array"),
            },
        }
    }

    /// An item of an array.
    pub fn item(&self, index: usize) -> Option<At<'j>> {
        let Json::Array(items) = self.json else {
            return None;
        };
        Some(At {
            json: items.get(index)?,
            file: self.file,
            pointer: format!("{}/{index}", self.pointer),
        })
    }

    /// The items of a member that is an array; none if it is missing.
    pub fn items(&self, name: &str) -> Result<Vec<At<'j>>, Issue> {
        let count = self.len_of(name)?;
        let Some(list) = self.get(name) else {
            return Ok(Vec::new());
        };
        Ok((0..count).filter_map(|i| list.item(i)).collect())
    }

    pub fn number(&self) -> Result<f64, Issue> {
        match self.json {
            // JSON knows neither infinity nor NaN, and serde refuses what overflows.
            Json::Number(x) => Ok(*x),
            _ => self.expected("a number"),
        }
    }

    pub fn integer(&self) -> Result<u64, Issue> {
        match self.json {
            Json::Number(x) if *x >= 0.0 && *x == x.trunc() && *x <= 9.0e15 => Ok(*x as u64),
            Json::Number(x) => Err(self.fail(format!("expected a whole number, found {x}"))),
            _ => self.expected("a whole number"),
        }
    }

    pub fn text(&self) -> Result<&'j str, Issue> {
        match self.json {
            Json::String(s) => Ok(s),
            _ => self.expected("a string"),
        }
    }

    pub fn flag(&self) -> Result<bool, Issue> {
        match self.json {
            Json::Bool(b) => Ok(*b),
            _ => self.expected("true or false"),
        }
    }

    /// A number of the object, or its default.
    pub fn number_or(&self, name: &str, default: f64) -> Result<f64, Issue> {
        self.get(name).map_or(Ok(default), |at| at.number())
    }

    pub fn integer_or(&self, name: &str, default: u64) -> Result<u64, Issue> {
        self.get(name).map_or(Ok(default), |at| at.integer())
    }

    pub fn flag_or(&self, name: &str, default: bool) -> Result<bool, Issue> {
        self.get(name).map_or(Ok(default), |at| at.flag())
    }

    /// So many numbers, no more and no less.
    pub fn numbers<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, Issue> {
        let Some(list) = self.get(name) else {
            return Ok(None);
        };
        let count = self.len_of(name)?;
        if count != N {
            return Err(list.fail(format!("expected {N} numbers, found {count}")));
        }
        let mut out = [0.0; N];
        for (i, x) in out.iter_mut().enumerate() {
            *x = match list.item(i) {
                Some(item) => item.number()?,
                None => 0.0,
            };
        }
        Ok(Some(out))
    }

    /// A number that should lie in a range; one outside is moved to its border, with a warning.
    pub fn ranged(
        &self,
        name: &str,
        default: f64,
        (low, high): (f64, f64),
        cx: &mut Context<'_>,
    ) -> Result<f64, Issue> {
        let Some(at) = self.get(name) else {
            return Ok(default);
        };
        let x = at.number()?;
        let moved = x.clamp(low, high);
        if moved != x {
            let bound = if high.is_finite() {
                format!("{low} to {high}")
            } else {
                format!("at least {low}")
            };
            cx.warn(
                &at.place(),
                format!("{x} is out of range ({bound}); {moved} is used"),
            );
        }
        Ok(moved)
    }

    /// A colour whose channels should lie in a range.
    pub fn color(
        &self,
        name: &str,
        default: [f64; 3],
        high: f64,
        cx: &mut Context<'_>,
    ) -> Result<[f32; 3], Issue> {
        let Some(rgb) = self.numbers::<3>(name)? else {
            return Ok(default.map(|c| c as f32));
        };
        let moved = rgb.map(|c| c.clamp(0.0, high));
        if moved != rgb
            && let Some(at) = self.get(name)
        {
            cx.warn(
                &at.place(),
                format!("{rgb:?} is out of range; {moved:?} is used"),
            );
        }
        Ok(moved.map(|c| c as f32))
    }

    /// An index into a list of the whole file.
    pub fn index(&self, name: &str, root: &At<'j>, list: &str) -> Result<Option<usize>, Issue> {
        let Some(at) = self.get(name) else {
            return Ok(None);
        };
        at.as_index(root, list).map(Some)
    }

    /// This value as an index into a list of the whole file.
    pub fn as_index(&self, root: &At<'j>, list: &str) -> Result<usize, Issue> {
        let index = self.integer()?;
        let count = root.len_of(list)? as u64;
        if index >= count {
            return Err(self.fail(format!(
                "{index} of {list:?}, but there are only {count} of them"
            )));
        }
        Ok(index as usize)
    }

    /// An extension of the object.
    pub fn extension(&self, name: &str) -> Option<At<'j>> {
        self.get("extensions")?.get(name)
    }

    /// The name that the object has, if it has one.
    pub fn name(&self) -> Result<Option<&'j str>, Issue> {
        match self.get("name") {
            None => Ok(None),
            Some(name) => name.text().map(Some),
        }
    }

    /// Warns of properties that nobody knows.
    pub fn only(&self, known: &[&str], cx: &mut Context<'_>) -> Result<(), Issue> {
        for (name, at) in self.members()? {
            if matches!(name, "name" | "extensions" | "extras") || known.contains(&name) {
                continue;
            }
            let near = crate::suggest::did_you_mean(name, known.iter().copied());
            cx.warn(
                &at.place(),
                format!("unknown property {name:?}{near}; it is ignored"),
            );
        }
        Ok(())
    }
}
