//! Accessors: arrays of numbers in buffers, of every component type, dense, strided or sparse.
//!
//! Nothing is allocated before the count has been held against the bytes that are there. Only
//! accessors without bytes of their own (all zero, or sparse over zeros) can claim more, so their
//! count has a limit.

use super::Gltf;
use super::buffers::View;
use super::tree::At;
use crate::context::Issue;

/// The longest accessor without bytes of its own.
const MAX_ZEROS: u64 = 1 << 24;

/// Number types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(at: &At<'_>) -> Result<Self, Issue> {
        Ok(match at.integer()? {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            other => return Err(at.fail(format!("unknown component type {other}"))),
        })
    }
    fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }
    /// The number at the start of some bytes; the caller has seen that there are enough.
    fn read(self, bytes: &[u8], normalized: bool) -> f64 {
        let two = || bytes.first_chunk::<2>().copied().unwrap_or_default();
        let four = || bytes.first_chunk::<4>().copied().unwrap_or_default();
        let one = bytes.first().copied().unwrap_or_default();
        let (value, most) = match self {
            Component::I8 => (f64::from(one as i8), 127.0),
            Component::U8 => (f64::from(one), 255.0),
            Component::I16 => (f64::from(i16::from_le_bytes(two())), 32_767.0),
            Component::U16 => (f64::from(u16::from_le_bytes(two())), 65_535.0),
            Component::U32 => (f64::from(u32::from_le_bytes(four())), 4_294_967_295.0),
            Component::F32 => return f64::from(f32::from_le_bytes(four())),
        };
        if normalized {
            (value / most).max(-1.0)
        } else {
            value
        }
    }
}

pub(super) fn width(kind: &str) -> Option<usize> {
    Some(match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => return None,
    })
}

/// An accessor, checked against the bytes that it names.
pub(super) struct Accessor<'j> {
    pub at: At<'j>,
    pub component: Component,
    pub normalized: bool,
    /// Numbers of an element.
    pub width: usize,
    /// Elements.
    pub count: usize,
    view: Option<(View, usize)>,
    sparse: Option<Sparse>,
}

struct Sparse {
    places: Vec<u32>,
    values: View,
    offset: usize,
}

impl Accessor<'_> {
    fn element(&self) -> usize {
        self.component.size() * self.width
    }

    /// Whether it has numbers of its own; without any, all are zero.
    pub fn has_data(&self) -> bool {
        self.view.is_some() || self.sparse.is_some()
    }

    /// All numbers, `width` for each element.
    pub fn numbers(&self) -> Result<Vec<f32>, Issue> {
        let width = self.width;
        let mut out = vec![0.0f32; self.count * width];
        let size = self.component.size();
        let read = |bytes: &[u8], row: &mut [f32]| {
            for (number, x) in bytes.chunks_exact(size).zip(row) {
                *x = self.component.read(number, self.normalized) as f32;
            }
        };
        if let Some((view, offset)) = &self.view {
            let stride = view.stride.unwrap_or(self.element());
            let bytes = view.data.bytes().get(*offset..).unwrap_or_default();
            for (row, at) in out.chunks_exact_mut(width).zip((0..).step_by(stride)) {
                read(bytes.get(at..at + self.element()).unwrap_or_default(), row);
            }
        }
        if let Some(sparse) = &self.sparse {
            let bytes = sparse.values.data.bytes();
            let bytes = bytes.get(sparse.offset..).unwrap_or_default();
            for (place, element) in sparse.places.iter().zip(bytes.chunks_exact(self.element())) {
                let start = *place as usize * width;
                if let Some(row) = out.get_mut(start..start + width) {
                    read(element, row);
                }
            }
        }
        if let Some(bad) = out.iter().position(|x| !x.is_finite()) {
            return Err(self.at.fail(format!(
                "element {} has a number that is not finite",
                bad / width
            )));
        }
        Ok(out)
    }

    /// All elements as rows of `N`; shorter elements are refused.
    pub fn rows<const N: usize>(&self) -> Result<Vec<[f32; N]>, Issue> {
        self.expect_width(N)?;
        Ok(self.numbers()?.as_chunks::<N>().0.to_vec())
    }

    pub fn expect_width(&self, width: usize) -> Result<(), Issue> {
        if self.width == width {
            Ok(())
        } else {
            Err(self.at.fail(format!(
                "elements of {} numbers where {width} are needed",
                self.width
            )))
        }
    }

    /// All elements as whole numbers.
    pub fn integers(&self) -> Result<Vec<u32>, Issue> {
        if self.component == Component::F32 || self.normalized {
            return Err(self.at.fail("fractions where whole numbers are needed"));
        }
        let mut out = vec![0u32; self.count * self.width];
        let size = self.component.size();
        let read = |bytes: &[u8], row: &mut [u32]| {
            for (number, x) in bytes.chunks_exact(size).zip(row) {
                *x = self.component.read(number, false) as u32;
            }
        };
        if let Some((view, offset)) = &self.view {
            let stride = view.stride.unwrap_or(self.element());
            let bytes = view.data.bytes().get(*offset..).unwrap_or_default();
            for (row, at) in out.chunks_exact_mut(self.width).zip((0..).step_by(stride)) {
                read(bytes.get(at..at + self.element()).unwrap_or_default(), row);
            }
        }
        if let Some(sparse) = &self.sparse {
            let bytes = sparse.values.data.bytes();
            let bytes = bytes.get(sparse.offset..).unwrap_or_default();
            for (place, element) in sparse.places.iter().zip(bytes.chunks_exact(self.element())) {
                let start = *place as usize * self.width;
                if let Some(row) = out.get_mut(start..start + self.width) {
                    read(element, row);
                }
            }
        }
        Ok(out)
    }
}

impl<'j> Gltf<'_, '_, 'j> {
    /// The accessor of that index.
    pub(super) fn accessor(&mut self, index: usize) -> Result<Accessor<'j>, Issue> {
        let Some(at) = self.root.get("accessors").and_then(|list| list.item(index)) else {
            return Err(self.root.fail(format!("there is no accessor {index}")));
        };
        let component = Component::of(&at.need("componentType")?)?;
        let kind = at.need("type")?;
        let Some(width) = width(kind.text()?) else {
            return Err(kind.fail(format!("unknown type {:?}", kind.text()?)));
        };
        let count = at.need("count")?.integer()?;
        if count == 0 {
            return Err(at.fail("an accessor without elements"));
        }
        let normalized = at.flag_or("normalized", false)?;
        let element = component.size() * width;
        let view = match at.index("bufferView", &self.root, "bufferViews")? {
            None => None,
            Some(index) => {
                let view = self.buffers.view(&self.root, index, self.cx)?;
                let offset = at.integer_or("byteOffset", 0)?;
                check(&at, &view, offset, count, element)?;
                Some((view, offset as usize))
            }
        };
        if view.is_none() && count > MAX_ZEROS {
            return Err(at.fail(format!(
                "{count} elements without a buffer; the limit is {MAX_ZEROS}"
            )));
        }
        let sparse = match at.get("sparse") {
            None => None,
            Some(sparse) => Some(self.sparse(&sparse, count, element)?),
        };
        self.work(&at, count)?;
        // Its numbers are kept elsewhere or not at all, but for a while they are there as singles.
        let size = count.saturating_mul(width as u64 * 4);
        self.cx.charge(&at.place(), size)?;
        self.cx.release(size);
        Ok(Accessor {
            at,
            component,
            normalized,
            width,
            count: count as usize,
            view,
            sparse,
        })
    }

    fn sparse(&mut self, at: &At<'j>, total: u64, element: usize) -> Result<Sparse, Issue> {
        let count = at.need("count")?.integer()?;
        if count == 0 || count > total {
            return Err(at.fail(format!("{count} of {total} elements are replaced")));
        }
        let indices = at.need("indices")?;
        let component = Component::of(&indices.need("componentType")?)?;
        if !matches!(component, Component::U8 | Component::U16 | Component::U32) {
            return Err(indices.fail("indices that are no unsigned integers"));
        }
        let (view, offset) = self.sparse_view(&indices, count, component.size())?;
        let bytes = view.data.bytes().get(offset..).unwrap_or_default();
        let places: Vec<u32> = bytes
            .chunks_exact(component.size())
            .take(count as usize)
            .map(|number| component.read(number, false) as u32)
            .collect();
        if places.iter().any(|p| u64::from(*p) >= total) {
            return Err(indices.fail(format!("an index beyond the {total} elements")));
        }
        if places.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(indices.fail("indices that do not rise"));
        }
        let values = at.need("values")?;
        let (values, offset) = self.sparse_view(&values, count, element)?;
        Ok(Sparse {
            places,
            values,
            offset,
        })
    }

    /// A tightly packed view.
    fn sparse_view(
        &mut self,
        at: &At<'j>,
        count: u64,
        element: usize,
    ) -> Result<(View, usize), Issue> {
        let index = at.need("bufferView")?.as_index(&self.root, "bufferViews")?;
        let view = self.buffers.view(&self.root, index, self.cx)?;
        let view = View {
            stride: None,
            ..view
        };
        let offset = at.integer_or("byteOffset", 0)?;
        check(at, &view, offset, count, element)?;
        Ok((view, offset as usize))
    }
}

/// Whether so many elements lie in a view.
fn check(at: &At<'_>, view: &View, offset: u64, count: u64, element: usize) -> Result<(), Issue> {
    let stride = view.stride.unwrap_or(element);
    if stride < element {
        return Err(at.fail(format!(
            "a stride of {stride} bytes for elements of {element}"
        )));
    }
    let end = (count - 1)
        .checked_mul(stride as u64)
        .and_then(|last| last.checked_add(element as u64))
        .and_then(|size| size.checked_add(offset));
    if end.is_none_or(|end| end > view.data.len() as u64) {
        return Err(at.fail(format!(
            "{count} elements of {element} bytes from byte {offset} do not lie in a view of {} bytes",
            view.data.len()
        )));
    }
    Ok(())
}
