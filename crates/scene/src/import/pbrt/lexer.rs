//! Bytes to tokens. Files of a hundred megabytes are mostly numbers in brackets, so those are read
//! in one loop without a token each.

use crate::limits::MAX_NUMBERS;
use crate::number::number;
use std::borrow::Cow;

/// One token.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token<'a> {
    /// A bare word: a directive, `true`, or a number.
    Word(&'a str),
    /// A quoted string, without its quotes.
    Text(Cow<'a, str>),
    /// `[`
    Open,
    /// `]`
    Close,
}

/// What is wrong, and in which line.
#[derive(Debug)]
pub(super) struct LexError {
    pub line: u32,
    pub reason: String,
}

pub(super) struct Lexer<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The line that is being read, from 1.
    pub line: u32,
    peeked: Option<(Token<'a>, u32)>,
}

fn ends_word(b: u8) -> bool {
    b.is_ascii_whitespace() || matches!(b, b'"' | b'[' | b']' | b'#')
}

impl<'a> Lexer<'a> {
    /// A byte-order mark must have been taken off.
    pub fn new(bytes: &'a [u8]) -> Self {
        Lexer {
            bytes,
            at: 0,
            line: 1,
            peeked: None,
        }
    }

    fn fail<T>(&self, reason: impl Into<String>) -> Result<T, LexError> {
        Err(LexError {
            line: self.line,
            reason: reason.into(),
        })
    }

    fn skip_blank(&mut self) {
        while let Some(&b) = self.bytes.get(self.at) {
            match b {
                b'\n' => {
                    self.line += 1;
                    self.at += 1;
                }
                b' ' | b'\t' | b'\r' | 0x0b | 0x0c => self.at += 1,
                b'#' => {
                    let rest = &self.bytes[self.at..];
                    self.at += rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
                }
                _ => return,
            }
        }
    }

    /// The next token and the line where it begins.
    pub fn next(&mut self) -> Result<Option<(Token<'a>, u32)>, LexError> {
        if let Some(token) = self.peeked.take() {
            return Ok(Some(token));
        }
        self.skip_blank();
        let line = self.line;
        let Some(&b) = self.bytes.get(self.at) else {
            return Ok(None);
        };
        let token = match b {
            b'[' => {
                self.at += 1;
                Token::Open
            }
            b']' => {
                self.at += 1;
                Token::Close
            }
            b'"' => Token::Text(self.text()?),
            _ => {
                let rest = &self.bytes[self.at..];
                let end = rest
                    .iter()
                    .position(|&b| ends_word(b))
                    .unwrap_or(rest.len());
                match std::str::from_utf8(&rest[..end]) {
                    Ok(word) if !word.contains(|c: char| c.is_control()) => {
                        self.at += end;
                        Token::Word(word)
                    }
                    _ => return self.fail("stray bytes; a scene is UTF-8 text"),
                }
            }
        };
        Ok(Some((token, line)))
    }

    /// Looks at the next token without taking it.
    pub fn peek(&mut self) -> Result<Option<&(Token<'a>, u32)>, LexError> {
        if self.peeked.is_none() {
            self.peeked = self.next()?;
        }
        Ok(self.peeked.as_ref())
    }

    fn text(&mut self) -> Result<Cow<'a, str>, LexError> {
        let start = self.at + 1;
        let mut escaped: Option<Vec<u8>> = None;
        let mut at = start;
        loop {
            match self.bytes.get(at) {
                None | Some(b'\n') => return self.fail("a string that does not end on its line"),
                Some(b'"') => break,
                Some(b'\\') => {
                    let out = escaped.get_or_insert_with(|| self.bytes[start..at].to_vec());
                    out.push(match self.bytes.get(at + 1) {
                        Some(b'n') => b'\n',
                        Some(b't') => b'\t',
                        Some(b'r') => b'\r',
                        Some(b'b') => 8,
                        Some(b'f') => 12,
                        Some(&c @ (b'"' | b'\\' | b'\'')) => c,
                        _ => return self.fail("an unknown escape in a string"),
                    });
                    at += 2;
                }
                Some(&c) => {
                    if let Some(out) = &mut escaped {
                        out.push(c);
                    }
                    at += 1;
                }
            }
        }
        self.at = at + 1;
        let text = match escaped {
            None => std::str::from_utf8(&self.bytes[start..at])
                .ok()
                .map(Cow::Borrowed),
            Some(out) => String::from_utf8(out).ok().map(Cow::Owned),
        };
        match text {
            Some(text) => Ok(text),
            None => self.fail("a string that is not UTF-8 text"),
        }
    }

    /// Numbers up to something that is none.
    pub fn numbers(&mut self, out: &mut Vec<f64>) -> Result<(), LexError> {
        if self.peeked.is_some() {
            return Ok(());
        }
        loop {
            self.skip_blank();
            let rest = &self.bytes[self.at..];
            let Some((value, used)) = number(rest) else {
                return Ok(());
            };
            if rest.get(used).is_some_and(|&b| !ends_word(b)) {
                return Ok(());
            }
            if !value.is_finite() {
                return self.fail("a number that is too large");
            }
            if out.len() >= MAX_NUMBERS {
                return self.fail(format!(
                    "more numbers than the limit of {MAX_NUMBERS}; put such a mesh into a PLY file"
                ));
            }
            self.at += used;
            out.push(value);
        }
    }

    /// One number, wherever it stands.
    pub fn number(&mut self, what: &str) -> Result<f64, LexError> {
        let found = match self.next()? {
            Some((Token::Word(word), _)) => match number(word.as_bytes()) {
                Some((value, used)) if used == word.len() && value.is_finite() => return Ok(value),
                _ => format!("{word:?}"),
            },
            Some((Token::Text(text), _)) => format!("the string {text:?}"),
            Some((Token::Open, _)) => "\"[\"".into(),
            Some((Token::Close, _)) => "\"]\"".into(),
            None => "the end of the file".into(),
        };
        self.fail(format!("{what} needs a number, found {found}"))
    }
}
