//! Buffers and views of them. A buffer is read when something first needs it, so that what nothing
//! uses need not be there.

use super::container::Slice;
use super::meshopt;
use super::tree::At;
use super::uri::{self, Uri};
use crate::assets::AssetBytes;
use crate::context::{Context, Issue};
use std::collections::BTreeSet;

/// The buffers of a file.
pub(super) struct Buffers {
    bin: Option<Slice>,
    loaded: Vec<Option<Slice>>,
    /// Views that were unpacked.
    unpacked: Vec<Option<Slice>>,
    /// Buffers whose files are missing, and allowed to be.
    missing: BTreeSet<usize>,
}

/// A part of a buffer.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub data: Slice,
    /// Distance of elements, if the view says it.
    pub stride: Option<usize>,
}

impl Buffers {
    pub fn new(root: &At<'_>, bin: Option<Slice>) -> Result<Self, Issue> {
        Ok(Buffers {
            bin,
            loaded: vec![None; root.len_of("buffers")?],
            unpacked: vec![None; root.len_of("bufferViews")?],
            missing: BTreeSet::new(),
        })
    }

    /// Whether a view lies in a buffer that is missing and may be: then there is a warning, and
    /// whoever asks puts something in place of what lies there.
    pub fn is_missing(
        &mut self,
        root: &At<'_>,
        view: usize,
        cx: &mut Context<'_>,
    ) -> Result<bool, Issue> {
        let view = root.get("bufferViews").and_then(|list| list.item(view));
        let Some(view) = view.filter(|_| cx.allows_missing()) else {
            return Ok(false);
        };
        let packed = meshopt::EXTENSIONS.iter().find_map(|e| view.extension(e));
        let view = packed.unwrap_or(view);
        let Some(index) = view.index("buffer", root, "buffers")? else {
            return Ok(false);
        };
        let at = root.get("buffers").and_then(|list| list.item(index));
        let Some(uri) = at.and_then(|at| at.get("uri")) else {
            return Ok(false);
        };
        let Uri::File(name) = uri::parse(uri.text()?).map_err(|e| uri.fail(e))? else {
            return Ok(false);
        };
        let path = cx.path(&uri.place(), &name)?;
        let missing = !cx.assets.exists(&path);
        if missing && self.missing.insert(index) {
            cx.warn(
                &uri.place(),
                format!("{path}: no such file; cubes from -1 to 1 and conspicuous pictures stand in for what lies in it"),
            );
        }
        Ok(missing)
    }

    fn buffer(
        &mut self,
        root: &At<'_>,
        index: usize,
        cx: &mut Context<'_>,
    ) -> Result<Slice, Issue> {
        if let Some(Some(data)) = self.loaded.get(index) {
            return Ok(data.clone());
        }
        let at = root
            .get("buffers")
            .and_then(|list| list.item(index))
            .ok_or_else(|| root.fail("a buffer that is not there"))?;
        let length = at.need("byteLength")?.integer()?;
        let data = match at.get("uri") {
            Some(uri) => load(&uri, cx)?,
            None if index == 0 && self.bin.is_some() => match &self.bin {
                Some(bin) => bin.clone(),
                None => return Err(at.fail("no data")),
            },
            None => {
                return Err(at.fail(
                    "a buffer without a \"uri\"; only the first buffer of a .glb may lie in the file itself",
                ));
            }
        };
        let Some(cut) = data.part(0, length) else {
            return Err(at.fail(format!(
                "\"byteLength\" is {length}, but there are only {} bytes",
                data.len()
            )));
        };
        if let Some(slot) = self.loaded.get_mut(index) {
            *slot = Some(cut.clone());
        }
        Ok(cut)
    }

    /// A view, unpacked if it is packed.
    pub fn view(
        &mut self,
        root: &At<'_>,
        index: usize,
        cx: &mut Context<'_>,
    ) -> Result<View, Issue> {
        let at = root
            .get("bufferViews")
            .and_then(|list| list.item(index))
            .ok_or_else(|| root.fail("a view that is not there"))?;
        let stride = match at.get("byteStride") {
            None => None,
            Some(stride) => match stride.integer()? {
                n @ 1..=65_535 => Some(n as usize),
                n => return Err(stride.fail(format!("a stride of {n}"))),
            },
        };
        let packed = meshopt::EXTENSIONS.iter().find_map(|e| at.extension(e));
        if let Some(packed) = packed {
            return self.packed(root, index, &packed, cx);
        }
        let data = self.range(root, &at, cx)?;
        Ok(View { data, stride })
    }

    /// The bytes that a view, or the extension of a packed one, names.
    fn range(&mut self, root: &At<'_>, at: &At<'_>, cx: &mut Context<'_>) -> Result<Slice, Issue> {
        at.need("buffer")?;
        let Some(buffer) = at.index("buffer", root, "buffers")? else {
            return Err(at.fail("no buffer"));
        };
        let data = self.buffer(root, buffer, cx)?;
        let offset = at.integer_or("byteOffset", 0)?;
        let length = at.need("byteLength")?.integer()?;
        data.part(offset, length).ok_or_else(|| {
            at.fail(format!(
                "bytes {offset} to {} of a buffer of {} bytes",
                offset.saturating_add(length),
                data.len()
            ))
        })
    }

    fn packed(
        &mut self,
        root: &At<'_>,
        index: usize,
        at: &At<'_>,
        cx: &mut Context<'_>,
    ) -> Result<View, Issue> {
        let stride = at.need("byteStride")?.integer()?;
        let stride = usize::try_from(stride).unwrap_or(usize::MAX);
        if let Some(Some(data)) = self.unpacked.get(index) {
            return Ok(View {
                data: data.clone(),
                stride: Some(stride),
            });
        }
        let count = at.need("count")?.integer()?;
        let mode = at.need("mode")?.text()?;
        let filter = match at.get("filter") {
            None => "NONE",
            Some(filter) => filter.text()?,
        };
        let source = self.range(root, at, cx)?;
        // At its best a byte of the packed data stands for 64 bytes, and the last block may be cut
        // short. What claims more than that is not unpacked at all.
        let most = (source.len() as u64)
            .saturating_mul(64)
            .saturating_add(1 << 16);
        let size = count.saturating_mul(stride as u64);
        if size > most {
            return Err(at.fail(format!(
                "{count} elements of {stride} bytes cannot lie in {} bytes",
                source.len()
            )));
        }
        cx.charge(&at.place(), size)?;
        let data = meshopt::decode(source.bytes(), count as usize, stride, mode, filter)
            .map_err(|e| at.fail(e))?;
        let data = Slice::all(AssetBytes::from(data));
        if let Some(slot) = self.unpacked.get_mut(index) {
            *slot = Some(data.clone());
        }
        Ok(View {
            data,
            stride: Some(stride),
        })
    }
}

/// What a URI names.
pub(super) fn load(at: &At<'_>, cx: &mut Context<'_>) -> Result<Slice, Issue> {
    match uri::parse(at.text()?).map_err(|e| at.fail(e))? {
        Uri::Data(bytes) => {
            cx.charge(&at.place(), bytes.len() as u64)?;
            Ok(Slice::all(AssetBytes::from(bytes)))
        }
        Uri::File(name) => {
            let path = cx.path(&at.place(), &name)?;
            Ok(Slice::all(cx.read(&at.place(), &path)?))
        }
    }
}
