//! The header of a PLY file: elements and their properties.

use super::PlyError;

/// How the numbers after the header are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Little,
    Big,
}

/// Number types; the names of both spellings in use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }
    pub fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }
    pub fn is_integer(self) -> bool {
        !matches!(self, Scalar::F32 | Scalar::F64)
    }
}

#[derive(Clone, Debug)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// Lines that it takes.
    pub lines: u32,
}

/// More than any file has; keeps the header's own memory small.
const MAX_PROPERTIES: usize = 256;
const MAX_LINE_BYTES: usize = 1024;

impl Header {
    /// The header and where it ends.
    pub fn read(bytes: &[u8]) -> Result<(Header, usize), PlyError> {
        let mut at = 0;
        let mut lines = 0;
        let mut next_line = |lines: &mut u32| -> Result<&str, PlyError> {
            *lines += 1;
            let rest = &bytes[at..];
            let end = rest.iter().take(MAX_LINE_BYTES).position(|&b| b == b'\n');
            let Some(end) = end else {
                return Err(PlyError::at_line(
                    *lines,
                    "the header does not end (no end_header line)",
                ));
            };
            at += end + 1;
            std::str::from_utf8(&rest[..end])
                .map(|line| line.trim_end_matches('\r'))
                .map_err(|_| PlyError::at_line(*lines, "the header is not text"))
        };
        match next_line(&mut lines) {
            Ok(line) if line.trim_end() == "ply" => {}
            _ => return Err(PlyError::at_line(1, "not a PLY file")),
        }
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut properties = 0;
        loop {
            let line = next_line(&mut lines)?;
            let fail = |reason: String| PlyError::at_line(lines, reason);
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words.as_slice() {
                [] | ["comment" | "obj_info", ..] => {}
                ["format", kind, _version] => {
                    encoding = Some(match *kind {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::Little,
                        "binary_big_endian" => Encoding::Big,
                        other => return Err(fail(format!("unknown format {other:?}"))),
                    });
                }
                ["element", name, count] => {
                    let count = count
                        .parse()
                        .map_err(|_| fail(format!("{count:?} is not a count")))?;
                    if elements.iter().any(|e| e.name == *name) {
                        return Err(fail(format!("element {name:?} is there twice")));
                    }
                    elements.push(Element {
                        name: (*name).to_owned(),
                        count,
                        properties: Vec::new(),
                    });
                }
                ["property", rest @ ..] => {
                    properties += 1;
                    let Some(element) = elements.last_mut() else {
                        return Err(fail("a property before the first element".into()));
                    };
                    if properties > MAX_PROPERTIES {
                        return Err(fail(format!(
                            "more properties than the limit of {MAX_PROPERTIES}"
                        )));
                    }
                    let scalar = |name: &str| {
                        Scalar::named(name).ok_or(fail(format!("unknown type {name:?}")))
                    };
                    let (name, kind) = match rest {
                        ["list", count, item, name] => {
                            let (count, item) = (scalar(count)?, scalar(item)?);
                            if !count.is_integer() {
                                return Err(fail("a list whose length is not an integer".into()));
                            }
                            (name, Kind::List { count, item })
                        }
                        [kind, name] => (name, Kind::Scalar(scalar(kind)?)),
                        _ => return Err(fail(format!("unreadable property {line:?}"))),
                    };
                    if element.properties.iter().any(|p| p.name == *name) {
                        return Err(fail(format!("property {name:?} is there twice")));
                    }
                    element.properties.push(Property {
                        name: (*name).to_owned(),
                        kind,
                    });
                }
                ["end_header"] => break,
                _ => return Err(fail(format!("unknown header line {line:?}"))),
            }
        }
        let Some(encoding) = encoding else {
            return Err(PlyError::at_line(lines, "no format line"));
        };
        Ok((
            Header {
                encoding,
                elements,
                lines,
            },
            at,
        ))
    }
}
