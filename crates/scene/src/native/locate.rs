//! Where in a JSON text something is: from line and column to a JSON pointer, and back.

enum Level {
    Object(Option<String>),
    Array(usize),
}

fn path(levels: &[Level]) -> String {
    let part = |level: &Level| match level {
        Level::Object(Some(key)) => format!("/{}", escape(key)),
        Level::Object(None) => String::new(),
        Level::Array(index) => format!("/{index}"),
    };
    levels.iter().map(part).collect()
}

/// A name as a part of a pointer.
pub(crate) fn escape(name: &str) -> String {
    name.replace('~', "~0").replace('/', "~1")
}

/// Walks over a text and calls back where values begin, until that says stop. Returns what is open at
/// the end, a name that waits for its value included.
fn walk(bytes: &[u8], mut value: impl FnMut(&[Level], usize) -> bool) -> Vec<Level> {
    let mut levels: Vec<Level> = Vec::new();
    let mut expect = true;
    let mut name: Option<String> = None;
    let mut at = 0;
    while at < bytes.len() {
        let b = bytes[at];
        if expect && !b.is_ascii_whitespace() && !matches!(b, b']' | b'}' | b',' | b':') {
            expect = false;
            if value(&levels, at) {
                return levels;
            }
        }
        match b {
            b'"' => {
                let from = at + 1;
                at = from;
                while at < bytes.len() && bytes[at] != b'"' {
                    at += if bytes[at] == b'\\' { 2 } else { 1 };
                }
                let raw = bytes.get(from..at.min(bytes.len())).unwrap_or_default();
                name = Some(String::from_utf8_lossy(raw).into_owned());
            }
            b'{' => levels.push(Level::Object(None)),
            b'[' => {
                levels.push(Level::Array(0));
                expect = true;
            }
            // At the very end, the value just closed is the one that is meant.
            b'}' | b']' if at + 1 < bytes.len() => {
                levels.pop();
            }
            b':' => {
                if let Some(Level::Object(key)) = levels.last_mut() {
                    *key = name.take();
                }
                expect = true;
            }
            b',' if at + 1 < bytes.len() => match levels.last_mut() {
                Some(Level::Array(index)) => {
                    name = None;
                    *index += 1;
                    expect = true;
                }
                Some(Level::Object(key)) => {
                    name = None;
                    *key = None;
                }
                None => {}
            },
            _ => {}
        }
        at += 1;
    }
    if let (Some(Level::Object(key @ None)), Some(name)) = (levels.last_mut(), name) {
        *key = Some(name);
    }
    levels
}

/// The pointer of the innermost value that contains a position (line and column from 1).
pub(crate) fn pointer(text: &str, line: usize, column: usize) -> String {
    let start: usize = text
        .split_inclusive('\n')
        .take(line.saturating_sub(1))
        .map(str::len)
        .sum();
    let end = (start + column).min(text.len());
    path(&walk(&text.as_bytes()[..end], |_, _| false))
}

/// Line and column of the value that a pointer names.
pub(crate) fn position(text: &str, pointer: &str) -> Option<(u32, u32)> {
    let mut found = None;
    walk(text.as_bytes(), |levels, at| {
        if path(levels) == pointer {
            found = Some(at);
        }
        found.is_some()
    });
    let before = text.get(..found?)?;
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
    Some((u32::try_from(line).ok()?, u32::try_from(column).ok()?))
}
