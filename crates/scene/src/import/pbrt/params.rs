//! Parameter lists: `"float radius" [ 2 ]`. A list remembers which of its parameters were asked for,
//! so that the rest can be named.

use super::lexer::{LexError, Lexer, Token};
use super::spectra::ColorSpace;
use crate::context::Issue;
use crate::diagnostic::Place;
use std::cell::Cell;
use std::sync::Arc;

/// The declared type of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Float,
    Integer,
    Point2,
    Vector2,
    Point3,
    Vector3,
    Normal,
    Bool,
    String,
    Texture,
    Rgb,
    Blackbody,
    Spectrum,
}

const KINDS: [(&str, Kind); 14] = [
    ("float", Kind::Float),
    ("integer", Kind::Integer),
    ("point2", Kind::Point2),
    ("vector2", Kind::Vector2),
    ("point3", Kind::Point3),
    ("vector3", Kind::Vector3),
    ("normal3", Kind::Normal),
    ("normal", Kind::Normal),
    ("bool", Kind::Bool),
    ("string", Kind::String),
    ("texture", Kind::Texture),
    ("rgb", Kind::Rgb),
    ("blackbody", Kind::Blackbody),
    ("spectrum", Kind::Spectrum),
];

impl Kind {
    fn named(word: &str) -> Result<Kind, String> {
        if let Some((_, kind)) = KINDS.iter().find(|(name, _)| *name == word) {
            return Ok(*kind);
        }
        let v4 = match word {
            "point" => "point3",
            "vector" => "vector3",
            "color" | "xyz" => "rgb",
            _ => return Err(format!("unknown parameter type {word:?}")),
        };
        Err(format!(
            "parameter type {word:?} is of pbrt-v3; pbrt-v4 has {v4:?}"
        ))
    }
    fn name(self) -> &'static str {
        KINDS
            .iter()
            .rfind(|(_, kind)| *kind == self)
            .map_or("", |(name, _)| name)
    }
}

#[derive(Clone, Debug)]
pub(super) enum Values {
    Numbers(Vec<f64>),
    Texts(Vec<String>),
    Bools(Vec<bool>),
}

#[derive(Clone, Debug)]
pub(super) struct Param {
    pub kind: Kind,
    pub name: String,
    pub values: Values,
    pub place: Place,
    used: Cell<bool>,
    /// From an `Attribute` directive: it need not concern every shape or material.
    optional: bool,
}

impl Param {
    pub fn numbers(&self) -> &[f64] {
        match &self.values {
            Values::Numbers(numbers) => numbers,
            _ => &[],
        }
    }
    pub fn texts(&self) -> &[String] {
        match &self.values {
            Values::Texts(texts) => texts,
            _ => &[],
        }
    }
    pub fn fail<T>(&self, reason: impl std::fmt::Display) -> Result<T, Issue> {
        Err(Issue::new(
            &self.place,
            format!("parameter {:?} {reason}", self.name),
        ))
    }
    /// The only string.
    pub fn text(&self) -> Result<&str, Issue> {
        match self.texts() {
            [only] => Ok(only),
            texts => self.fail(format!("needs one string, has {}", texts.len())),
        }
    }
    /// The only number.
    pub fn one(&self) -> Result<f64, Issue> {
        match self.numbers() {
            [only] => Ok(*only),
            numbers => self.fail(format!("needs one number, has {}", numbers.len())),
        }
    }
    /// Exactly three numbers.
    pub fn three(&self) -> Result<[f64; 3], Issue> {
        match *self.numbers() {
            [a, b, c] => Ok([a, b, c]),
            ref numbers => self.fail(format!("needs three numbers, has {}", numbers.len())),
        }
    }
    /// Rows of `N` numbers, in single precision.
    pub fn rows<const N: usize>(&self) -> Result<Vec<[f32; N]>, Issue> {
        let (rows, rest) = self.numbers().as_chunks::<N>();
        if !rest.is_empty() {
            return self.fail(format!(
                "needs a multiple of {N} numbers, has {}",
                self.numbers().len()
            ));
        }
        let rows: Vec<[f32; N]> = rows.iter().map(|row| row.map(|x| x as f32)).collect();
        if !rows.as_flattened().iter().all(|x| x.is_finite()) {
            return self.fail("has a number that is too large");
        }
        Ok(rows)
    }
}

/// The parameters of one directive.
#[derive(Clone, Debug)]
pub(super) struct Params {
    /// Where the directive is.
    pub place: Place,
    /// What its `rgb` numbers refer to.
    pub space: ColorSpace,
    params: Vec<Param>,
}

impl Params {
    pub fn empty(place: Place) -> Self {
        Params {
            place,
            space: ColorSpace::default(),
            params: Vec::new(),
        }
    }

    /// Reads the list that follows a directive.
    pub fn read(
        lexer: &mut Lexer<'_>,
        file: &Arc<str>,
        place: Place,
        space: ColorSpace,
    ) -> Result<Self, LexError> {
        let mut params: Vec<Param> = Vec::new();
        while let Some((Token::Text(_), _)) = lexer.peek()? {
            let Some((Token::Text(declaration), line)) = lexer.next()? else {
                break;
            };
            let fail = |reason: String| LexError { line, reason };
            let mut words = declaration.split_ascii_whitespace();
            let (Some(kind), Some(name), None) = (words.next(), words.next(), words.next()) else {
                return Err(fail(format!(
                    "expected a declaration like \"float radius\", found {declaration:?}"
                )));
            };
            let kind = Kind::named(kind).map_err(fail)?;
            if params.iter().any(|p| p.name == name) {
                return Err(fail(format!("parameter {name:?} is given twice")));
            }
            let values = read_values(lexer, kind, name)?;
            let place = Place {
                file: file.to_string(),
                line: Some(line),
                ..Place::default()
            };
            params.push(Param {
                kind,
                name: name.to_owned(),
                values,
                place,
                used: Cell::new(false),
                optional: false,
            });
        }
        Ok(Params {
            place,
            space,
            params,
        })
    }

    /// Adds what an `Attribute` directive set; the directive's own parameters come first.
    pub fn add_attributes(&mut self, attributes: &[Param]) {
        self.params.extend(attributes.iter().map(|p| Param {
            optional: true,
            used: Cell::new(false),
            ..p.clone()
        }));
    }
    /// Adds one that stands elsewhere.
    pub fn push(&mut self, param: Param) -> Result<(), Issue> {
        if self.params.iter().any(|p| p.name == param.name) {
            return param.fail("is given twice");
        }
        self.params.push(param);
        Ok(())
    }
    /// Memory of what is kept until the end of the file.
    pub fn bytes(&self) -> u64 {
        let values = |p: &Param| match &p.values {
            Values::Numbers(numbers) => numbers.len() as u64 * 8,
            Values::Texts(texts) => texts.iter().map(|t| t.len() as u64 + 24).sum(),
            Values::Bools(bools) => bools.len() as u64,
        };
        200 + self.params.iter().map(|p| 200 + values(p)).sum::<u64>()
    }
    pub fn into_inner(self) -> Vec<Param> {
        self.params
    }

    pub fn fail<T>(&self, reason: impl Into<String>) -> Result<T, Issue> {
        Err(Issue::new(&self.place, reason))
    }

    /// The parameter of that name, which must have one of these types.
    pub fn find(&self, name: &str, kinds: &[Kind]) -> Result<Option<&Param>, Issue> {
        #[cfg(test)]
        asked::note(name);
        let Some(param) = self.params.iter().find(|p| p.name == name) else {
            return Ok(None);
        };
        param.used.set(true);
        if !kinds.contains(&param.kind) {
            let expected: Vec<_> = kinds.iter().map(|k| k.name()).collect();
            return param.fail(format!(
                "should be of type {}, not {}",
                expected.join(" or "),
                param.kind.name()
            ));
        }
        Ok(Some(param))
    }
    pub fn has(&self, name: &str) -> bool {
        self.params.iter().any(|p| p.name == name)
    }
    /// Parameters that do not matter here.
    pub fn ignore(&self, names: &[&str]) {
        self.params
            .iter()
            .filter(|p| names.contains(&p.name.as_str()))
            .for_each(|p| p.used.set(true));
        #[cfg(test)]
        names.iter().for_each(|name| asked::note(name));
    }

    pub fn float_opt(&self, name: &str) -> Result<Option<f64>, Issue> {
        self.find(name, &[Kind::Float])?.map(Param::one).transpose()
    }
    pub fn float(&self, name: &str, default: f64) -> Result<f64, Issue> {
        Ok(self.float_opt(name)?.unwrap_or(default))
    }
    /// A float that must be above zero.
    pub fn positive(&self, name: &str, default: f64) -> Result<f64, Issue> {
        let Some(param) = self.find(name, &[Kind::Float])? else {
            return Ok(default);
        };
        let value = param.one()?;
        if value > 0.0 {
            Ok(value)
        } else {
            param.fail(format!("must be above zero, is {value}"))
        }
    }
    pub fn floats(&self, name: &str) -> Result<Option<&Param>, Issue> {
        self.find(name, &[Kind::Float])
    }
    /// An integer in a range.
    pub fn count(
        &self,
        name: &str,
        default: u32,
        range: std::ops::RangeInclusive<u32>,
    ) -> Result<u32, Issue> {
        let Some(param) = self.find(name, &[Kind::Integer])? else {
            return Ok(default);
        };
        let value = param.one()?;
        if value >= f64::from(*range.start()) && value <= f64::from(*range.end()) {
            return Ok(value as u32);
        }
        param.fail(format!(
            "must be from {} to {}, is {value}",
            range.start(),
            range.end()
        ))
    }
    pub fn bool(&self, name: &str, default: bool) -> Result<bool, Issue> {
        let Some(param) = self.find(name, &[Kind::Bool])? else {
            return Ok(default);
        };
        match &param.values {
            Values::Bools(values) if values.len() == 1 => Ok(values[0]),
            _ => param.fail("needs one of true and false"),
        }
    }
    pub fn text_opt(&self, name: &str) -> Result<Option<&str>, Issue> {
        self.find(name, &[Kind::String])?
            .map(Param::text)
            .transpose()
    }
    pub fn text<'a>(&'a self, name: &str, default: &'a str) -> Result<&'a str, Issue> {
        Ok(self.text_opt(name)?.unwrap_or(default))
    }
    pub fn vector(&self, name: &str, kind: Kind, default: [f64; 3]) -> Result<[f64; 3], Issue> {
        self.find(name, &[kind])?.map_or(Ok(default), Param::three)
    }
    pub fn rows<const N: usize>(
        &self,
        name: &str,
        kinds: &[Kind],
    ) -> Result<Option<Vec<[f32; N]>>, Issue> {
        self.find(name, kinds)?.map(Param::rows).transpose()
    }
    /// Indices, none of them negative.
    pub fn indices(&self, name: &str) -> Result<Option<Vec<u32>>, Issue> {
        let Some(param) = self.find(name, &[Kind::Integer])? else {
            return Ok(None);
        };
        if let Some(bad) = param
            .numbers()
            .iter()
            .find(|&&i| !(0.0..=f64::from(i32::MAX)).contains(&i))
        {
            return param.fail(format!("has the index {bad}"));
        }
        Ok(Some(param.numbers().iter().map(|&i| i as u32).collect()))
    }

    /// What nobody asked for.
    pub fn unused(&self) -> impl Iterator<Item = &Param> {
        self.params.iter().filter(|p| !p.used.get() && !p.optional)
    }
}

fn read_values(lexer: &mut Lexer<'_>, kind: Kind, name: &str) -> Result<Values, LexError> {
    let mut numbers = Vec::new();
    let mut texts = Vec::new();
    let mut bools = Vec::new();
    let mut take = |token: Token<'_>, line: u32| -> Result<bool, LexError> {
        match token {
            Token::Text(text) => texts.push(text.into_owned()),
            Token::Word("true") => bools.push(true),
            Token::Word("false") => bools.push(false),
            Token::Word(word) => {
                return Err(LexError {
                    line,
                    reason: format!("parameter {name:?}: {word:?} is no value"),
                });
            }
            Token::Open => {
                return Err(LexError {
                    line,
                    reason: format!("parameter {name:?}: \"[\" in a list"),
                });
            }
            Token::Close => return Ok(false),
        }
        Ok(true)
    };
    let ended = |line| LexError {
        line,
        reason: format!("parameter {name:?}: the file ends before its value does"),
    };
    let start = lexer.line;
    if let Some((Token::Open, _)) = lexer.peek()? {
        lexer.next()?;
        loop {
            lexer.numbers(&mut numbers)?;
            let Some((token, line)) = lexer.next()? else {
                return Err(ended(start));
            };
            if !take(token, line)? {
                break;
            }
        }
    } else {
        match lexer.next()? {
            None => return Err(ended(start)),
            Some((Token::Word(word), _)) if word != "true" && word != "false" => {
                match crate::number::number(word.as_bytes()) {
                    Some((value, used)) if used == word.len() && value.is_finite() => {
                        numbers.push(value)
                    }
                    _ => {
                        let reason = format!("parameter {name:?}: {word:?} is no value");
                        return Err(LexError {
                            line: start,
                            reason,
                        });
                    }
                }
            }
            Some((Token::Close, line)) => {
                return Err(LexError {
                    line,
                    reason: format!("parameter {name:?}: \"]\" without \"[\""),
                });
            }
            Some((token, line)) => {
                take(token, line)?;
            }
        }
    }
    let fail = |what: &str| {
        let reason = format!("parameter {name:?} of type {} needs {what}", kind.name());
        Err(LexError {
            line: start,
            reason,
        })
    };
    let kinds = usize::from(!numbers.is_empty())
        + usize::from(!texts.is_empty())
        + usize::from(!bools.is_empty());
    if kinds > 1 {
        return fail("values of one type");
    }
    match kind {
        Kind::Bool if numbers.is_empty() && texts.is_empty() => Ok(Values::Bools(bools)),
        Kind::Bool => fail("true or false"),
        Kind::String | Kind::Texture if numbers.is_empty() && bools.is_empty() => {
            Ok(Values::Texts(texts))
        }
        Kind::String | Kind::Texture => fail("quoted strings"),
        Kind::Spectrum if !texts.is_empty() => Ok(Values::Texts(texts)),
        _ if !texts.is_empty() || !bools.is_empty() => fail("numbers"),
        Kind::Integer
            if numbers
                .iter()
                .any(|&x| libm::trunc(x) != x || libm::fabs(x) > f64::from(u32::MAX)) =>
        {
            fail("integers")
        }
        _ => Ok(Values::Numbers(numbers)),
    }
}

/// For the check of the table of features: which parameters the importer asks for.
#[cfg(test)]
pub(super) mod asked {
    use std::cell::RefCell;
    use std::collections::BTreeSet;

    thread_local! {
        static ASKED: RefCell<Option<BTreeSet<String>>> = const { RefCell::new(None) };
    }

    pub fn start() {
        ASKED.set(Some(BTreeSet::new()));
    }
    pub fn stop() -> BTreeSet<String> {
        ASKED.take().unwrap_or_default()
    }
    pub(super) fn note(name: &str) {
        ASKED.with_borrow_mut(|asked| {
            if let Some(asked) = asked {
                asked.insert(name.to_owned());
            }
        });
    }
}
