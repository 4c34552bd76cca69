//! Buffer views packed by EXT_meshopt_compression (and its KHR twin), after the bitstream part of
//! the extension's specification: attributes (version 0), triangles, indices, and the filters.

/// Both names of the extension: the bitstreams read here are the same.
pub(super) const EXTENSIONS: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

struct Input<'a> {
    data: &'a [u8],
    at: usize,
}

impl<'a> Input<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(count).filter(|e| *e <= self.data.len());
        let Some(end) = end else {
            return Err(format!("packed data ends too early, at byte {}", self.at));
        };
        let bytes = &self.data[self.at..end];
        self.at = end;
        Ok(bytes)
    }
    fn byte(&mut self) -> Result<u8, String> {
        Ok(self.take(1)?[0])
    }
    /// A number in groups of seven bits, the lowest first.
    fn varint(&mut self) -> Result<u32, String> {
        let mut value = 0u32;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            value |= u32::from(byte & 127).checked_shl(shift).unwrap_or(0);
            if byte < 128 {
                return Ok(value);
            }
        }
        Err("a packed number of more than 35 bits".into())
    }
}

fn unzigzag(x: u32) -> u32 {
    (x >> 1) ^ (x & 1).wrapping_neg()
}

/// Unpacks a view of `count` elements of `stride` bytes. The caller has seen that this fits.
pub(super) fn decode(
    data: &[u8],
    count: usize,
    stride: usize,
    mode: &str,
    filter: &str,
) -> Result<Vec<u8>, String> {
    let mut out = match mode {
        "ATTRIBUTES" => attributes(data, count, stride)?,
        "TRIANGLES" | "INDICES" => {
            if stride != 2 && stride != 4 {
                return Err(format!(
                    "packed indices of {stride} bytes; 2 and 4 are possible"
                ));
            }
            let indices = if mode == "TRIANGLES" {
                triangles(data, count)?
            } else {
                sequence(data, count)?
            };
            let bytes = indices
                .iter()
                .flat_map(|i| i.to_le_bytes().into_iter().take(stride));
            bytes.collect()
        }
        other => return Err(format!("unknown mode {other:?} of packed data")),
    };
    match (filter, mode) {
        ("NONE", _) => {}
        (_, "TRIANGLES" | "INDICES") => return Err(format!("a filter ({filter}) on indices")),
        ("OCTAHEDRAL", _) => octahedral(&mut out, stride)?,
        ("QUATERNION", _) => quaternions(&mut out, stride)?,
        ("EXPONENTIAL", _) => exponential(&mut out, stride)?,
        (other, _) => return Err(format!("unknown filter {other:?} of packed data")),
    }
    Ok(out)
}

fn attributes(data: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, String> {
    if stride == 0 || stride > 256 || !stride.is_multiple_of(4) {
        return Err(format!(
            "packed elements of {stride} bytes; multiples of 4 up to 256 are possible"
        ));
    }
    let mut input = Input { data, at: 0 };
    match input.byte()? {
        0xa0 => {}
        0xa1 => return Err("packed attributes of version 1, which is not read here; unpack the file with gltf-transform".into()),
        other => return Err(format!("packed attributes begin with {other:#04x}")),
    }
    // The last element that a delta refers to starts as the one at the very end of the data.
    let tail = stride.max(32);
    let first = data
        .len()
        .checked_sub(tail)
        .filter(|at| *at >= 1)
        .ok_or("packed data without its tail")?;
    let mut last = data[data.len() - stride..].to_vec();
    input.data = &data[..first];
    let block = (8192 / stride / 16 * 16).min(256);
    let mut out = vec![0u8; count * stride];
    for start in (0..count).step_by(block) {
        let elements = block.min(count - start);
        let groups = elements.div_ceil(16);
        for k in 0..stride {
            let header = input.take(groups.div_ceil(4))?;
            let mut deltas = [0u8; 256];
            for group in 0..groups {
                let bits = header[group / 4] >> (group % 4 * 2) & 3;
                let to = &mut deltas[group * 16..group * 16 + 16];
                deltas_of(&mut input, bits, to)?;
            }
            let rows = out[start * stride..].chunks_exact_mut(stride);
            for (row, delta) in rows.zip(&deltas[..elements]) {
                // Zigzag on bytes.
                let delta = (delta >> 1) ^ (delta & 1).wrapping_neg();
                last[k] = last[k].wrapping_add(delta);
                row[k] = last[k];
            }
        }
    }
    if input.at != first {
        return Err(format!(
            "{} bytes of packed data are left over",
            first.abs_diff(input.at)
        ));
    }
    Ok(out)
}

/// Sixteen deltas of 0, 2, 4 or 8 bits; the largest value of the smaller kinds stands for a byte that
/// follows.
fn deltas_of(input: &mut Input<'_>, bits: u8, to: &mut [u8]) -> Result<(), String> {
    let width = match bits {
        0 => return Ok(()),
        3 => {
            to.copy_from_slice(input.take(16)?);
            return Ok(());
        }
        1 => 2,
        _ => 4,
    };
    let packed = input.take(2 * width)?;
    let escape = (1u8 << width) - 1;
    let each = 8 / width;
    for (i, to) in to.iter_mut().enumerate() {
        // The first delta lies in the highest bits.
        let shift = 8 - width - i % each * width;
        let value = packed[i / each] >> shift & escape;
        *to = if value == escape {
            input.byte()?
        } else {
            value
        };
    }
    Ok(())
}

/// Edges and vertices that were used last.
struct Recent<T> {
    items: [T; 16],
    next: usize,
}

impl<T: Copy> Recent<T> {
    fn new(start: T) -> Self {
        Recent {
            items: [start; 16],
            next: 0,
        }
    }
    fn push(&mut self, item: T) {
        self.items[self.next] = item;
        self.next = (self.next + 1) % 16;
    }
    /// The one pushed `back` before the last, 0 being the last.
    fn get(&self, back: usize) -> T {
        self.items[(self.next + 31 - back) % 16]
    }
}

fn triangles(data: &[u8], count: usize) -> Result<Vec<u32>, String> {
    if !count.is_multiple_of(3) {
        return Err(format!("{count} packed indices are no triangles"));
    }
    let total = count / 3;
    let mut codes = Input { data, at: 0 };
    match codes.byte()? {
        0xe1 => {}
        other => return Err(format!("packed triangles begin with {other:#04x}")),
    }
    let tail = data.len().checked_sub(16).filter(|at| *at > total);
    let table = tail.ok_or("packed data without its tail")?;
    let aux_table = &data[table..];
    let mut extra = Input {
        data: &data[..table],
        at: 1 + total,
    };
    let mut edges = Recent::new((u32::MAX, u32::MAX));
    let mut vertices = Recent::new(u32::MAX);
    let (mut next, mut last) = (0u32, 0u32);
    let mut out = Vec::with_capacity(count);
    let delta = |extra: &mut Input<'_>, last: &mut u32| -> Result<u32, String> {
        *last = last.wrapping_add(unzigzag(extra.varint()?));
        Ok(*last)
    };
    let fresh = |next: &mut u32| {
        let v = *next;
        *next = next.wrapping_add(1);
        v
    };
    for _ in 0..total {
        let code = codes.byte()?;
        let (high, low) = (usize::from(code >> 4), usize::from(code & 15));
        if high < 15 {
            let (a, b) = edges.get(high);
            let c = match low {
                0 => {
                    let c = fresh(&mut next);
                    vertices.push(c);
                    c
                }
                1..=12 => vertices.get(low),
                _ => {
                    let c = match low {
                        13 => last.wrapping_sub(1),
                        14 => last.wrapping_add(1),
                        _ => delta(&mut extra, &mut last)?,
                    };
                    last = c;
                    vertices.push(c);
                    c
                }
            };
            edges.push((c, b));
            edges.push((a, c));
            out.extend([a, b, c]);
            continue;
        }
        let (a, b, c);
        if low < 14 {
            let aux = aux_table[low];
            let (kb, kc) = (usize::from(aux >> 4), usize::from(aux & 15));
            a = fresh(&mut next);
            b = if kb == 0 {
                fresh(&mut next)
            } else {
                vertices.get(kb - 1)
            };
            c = if kc == 0 {
                fresh(&mut next)
            } else {
                vertices.get(kc - 1)
            };
            vertices.push(a);
            if kb == 0 {
                vertices.push(b);
            }
            if kc == 0 {
                vertices.push(c);
            }
        } else {
            let aux = extra.byte()?;
            if aux == 0 {
                next = 0;
            }
            let (ka, kb, kc) = (
                if low == 14 { 0 } else { 15 },
                usize::from(aux >> 4),
                usize::from(aux & 15),
            );
            let a0 = if ka == 0 { fresh(&mut next) } else { 0 };
            let b0 = if kb == 0 {
                fresh(&mut next)
            } else {
                vertices.get(kb.wrapping_sub(1) % 16)
            };
            let c0 = if kc == 0 {
                fresh(&mut next)
            } else {
                vertices.get(kc.wrapping_sub(1) % 16)
            };
            a = if ka == 15 {
                delta(&mut extra, &mut last)?
            } else {
                a0
            };
            b = if kb == 15 {
                delta(&mut extra, &mut last)?
            } else {
                b0
            };
            c = if kc == 15 {
                delta(&mut extra, &mut last)?
            } else {
                c0
            };
            vertices.push(a);
            if kb == 0 || kb == 15 {
                vertices.push(b);
            }
            if kc == 0 || kc == 15 {
                vertices.push(c);
            }
        }
        edges.push((b, a));
        edges.push((c, b));
        edges.push((a, c));
        out.extend([a, b, c]);
    }
    if extra.at != table {
        return Err("bytes of packed data are left over".into());
    }
    Ok(out)
}

fn sequence(data: &[u8], count: usize) -> Result<Vec<u32>, String> {
    let mut input = Input { data, at: 0 };
    match input.byte()? {
        0xd1 => {}
        other => return Err(format!("packed indices begin with {other:#04x}")),
    }
    let end = data.len().checked_sub(4).filter(|at| *at > count);
    let end = end.ok_or("packed data without its tail")?;
    input.data = &data[..end];
    let mut last = [0u32; 2];
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let v = input.varint()?;
        let which = (v & 1) as usize;
        last[which] = last[which].wrapping_add(unzigzag(v >> 1));
        out.push(last[which]);
    }
    if input.at != end {
        return Err("bytes of packed data are left over".into());
    }
    Ok(out)
}

/// Unit vectors on an octahedron: x, y and the length of the projection in, x, y, z out.
fn octahedral(data: &mut [u8], stride: usize) -> Result<(), String> {
    let read = |row: &[u8], i: usize| -> f32 {
        if stride == 4 {
            f32::from(row[i] as i8)
        } else {
            f32::from(i16::from_le_bytes([row[2 * i], row[2 * i + 1]]))
        }
    };
    let most = match stride {
        4 => 127.0f32,
        8 => 32_767.0,
        other => return Err(format!("an octahedral filter on elements of {other} bytes")),
    };
    for row in data.chunks_exact_mut(stride) {
        let (mut x, mut y) = (read(row, 0), read(row, 1));
        let z = read(row, 2) - x.abs() - y.abs();
        let fold = z.min(0.0);
        x += if x >= 0.0 { fold } else { -fold };
        y += if y >= 0.0 { fold } else { -fold };
        let scale = most / (x * x + y * y + z * z).sqrt();
        for (i, v) in [x, y, z].into_iter().enumerate() {
            store(row, stride, i, v * scale);
        }
    }
    Ok(())
}

/// Writes a rounded number as a byte or two; what is not finite becomes 0.
fn store(row: &mut [u8], stride: usize, i: usize, value: f32) {
    let rounded = (value + if value >= 0.0 { 0.5 } else { -0.5 }) as i32;
    if stride == 4 {
        row[i] = rounded as i8 as u8;
    } else {
        row[2 * i..2 * i + 2].copy_from_slice(&(rounded as i16).to_le_bytes());
    }
}

/// Unit quaternions: the three smallest components and which one is left out.
fn quaternions(data: &mut [u8], stride: usize) -> Result<(), String> {
    if stride != 8 {
        return Err(format!("a quaternion filter on elements of {stride} bytes"));
    }
    for row in data.chunks_exact_mut(8) {
        let word = |i: usize| i16::from_le_bytes([row[2 * i], row[2 * i + 1]]);
        let range = f32::from(word(3) | 3) * std::f32::consts::SQRT_2;
        let left_out = (word(3) & 3) as usize;
        let part = [0, 1, 2].map(|i| f32::from(word(i)) / range);
        let rest = 1.0 - part[0] * part[0] - part[1] * part[1] - part[2] * part[2];
        let largest = rest.max(0.0).sqrt();
        let values = [part[0], part[1], part[2], largest];
        for (i, v) in values.into_iter().enumerate() {
            store(row, 8, (left_out + 1 + i) % 4, v * 32_767.0);
        }
    }
    Ok(())
}

/// Floats as an exponent and a mantissa.
fn exponential(data: &mut [u8], stride: usize) -> Result<(), String> {
    if !stride.is_multiple_of(4) {
        return Err(format!(
            "an exponential filter on elements of {stride} bytes"
        ));
    }
    let (words, _) = data.as_chunks_mut::<4>();
    for word in words {
        let bits = i32::from_le_bytes(*word);
        let (exponent, mantissa) = (bits >> 24, bits << 8 >> 8);
        *word = libm::scalbnf(mantissa as f32, exponent).to_le_bytes();
    }
    Ok(())
}
