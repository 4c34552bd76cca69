//! Server-sent events: bytes to events [HTML standard, section 9.2].

/// The longest event that is kept; a longer one ends the stream.
const EVENT_BYTES_MAX: usize = 4 << 20;

/// One event with data.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct RawEvent {
    pub id: Option<String>,
    pub data: String,
}

/// Feeds on pieces of the stream, however they are cut.
#[derive(Debug, Default)]
pub(crate) struct Parser {
    line: Vec<u8>,
    event: RawEvent,
    skip_newline: bool,
}

/// An event that is too long.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct TooLong;

impl Parser {
    /// Takes a piece and returns the events that it completes.
    pub fn push(&mut self, bytes: &[u8]) -> Result<Vec<RawEvent>, TooLong> {
        let mut done = Vec::new();
        for &byte in bytes {
            let skip = std::mem::take(&mut self.skip_newline);
            match byte {
                b'\n' if skip => {}
                b'\n' | b'\r' => {
                    self.skip_newline = byte == b'\r';
                    let line = std::mem::take(&mut self.line);
                    self.end_line(&line, &mut done);
                }
                _ => self.line.push(byte),
            }
            if self.line.len() + self.event.data.len() > EVENT_BYTES_MAX {
                return Err(TooLong);
            }
        }
        Ok(done)
    }

    fn end_line(&mut self, line: &[u8], done: &mut Vec<RawEvent>) {
        if line.is_empty() {
            let mut event = std::mem::take(&mut self.event);
            if event.data.pop().is_some() {
                done.push(event);
            }
            return;
        }
        let line = String::from_utf8_lossy(line);
        let (field, value) = line.split_once(':').unwrap_or((&line, ""));
        let value = value.strip_prefix(' ').unwrap_or(value);
        match field {
            "data" => {
                self.event.data.push_str(value);
                self.event.data.push('\n');
            }
            "id" => self.event.id = Some(value.to_owned()),
            _ => {} // comments keep the connection alive; the tag is in the data as well
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_cut_gives_the_same_events() {
        let text =
            ": hello\r\n\r\nid: 7\nevent: job\ndata: {\"a\":\ndata: 1}\n\ndata:x\r\r\nid\n\n";
        let expect = vec![
            RawEvent {
                id: Some("7".into()),
                data: "{\"a\":\n1}".into(),
            },
            RawEvent {
                id: None,
                data: "x".into(),
            },
        ];
        for size in 1..text.len() {
            let mut parser = Parser::default();
            let events: Vec<_> = text
                .as_bytes()
                .chunks(size)
                .flat_map(|piece| parser.push(piece).unwrap())
                .collect();
            assert_eq!(events, expect, "pieces of {size}");
        }
    }

    #[test]
    fn an_endless_line_is_refused() {
        let mut parser = Parser::default();
        assert_eq!(parser.push(&vec![b'x'; EVENT_BYTES_MAX + 1]), Err(TooLong));
    }
}
