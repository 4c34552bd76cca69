//! The directives of a file, one after the other.

use super::lexer::{LexError, Lexer, Token};
use super::media::Sides;
use super::params::Params;
use super::spectra::ColorSpace;
use super::{
    Block, Importer, MaterialEntry, MaterialRef, PendingGroup, PendingInstance, Setting, TARGETS,
    legacy, matrix,
};
use crate::context::Issue;
use crate::diagnostic::Place;
use crate::limits::MAX_NESTING;
use crate::model::GroupId;
use glam::{DMat4, DVec3};
use std::rc::Rc;
use std::sync::Arc;

/// For suggestions.
pub(super) const DIRECTIVES: [&str; 41] = [
    "Accelerator",
    "ActiveTransform",
    "AreaLightSource",
    "Attribute",
    "AttributeBegin",
    "AttributeEnd",
    "Camera",
    "ColorSpace",
    "ConcatTransform",
    "CoordSysTransform",
    "CoordinateSystem",
    "Film",
    "Identity",
    "Import",
    "Include",
    "Integrator",
    "LightSource",
    "LookAt",
    "MakeNamedMaterial",
    "MakeNamedMedium",
    "Material",
    "MediumInterface",
    "NamedMaterial",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Option",
    "PixelFilter",
    "ReverseOrientation",
    "Rotate",
    "Sampler",
    "Scale",
    "Shape",
    "Texture",
    "Transform",
    "TransformBegin",
    "TransformEnd",
    "TransformTimes",
    "Translate",
    "WorldBegin",
    "WorldEnd",
];

/// What a shape, light, texture or instance takes until the end, about.
const KEPT_BYTES: u64 = 400;

/// One file being read.
struct Source<'l, 'b> {
    lexer: &'l mut Lexer<'b>,
    file: Arc<str>,
}

impl Source<'_, '_> {
    fn issue(&self, error: LexError) -> Issue {
        let place = Place {
            file: self.file.to_string(),
            line: Some(error.line),
            ..Place::default()
        };
        Issue {
            place,
            reason: error.reason,
        }
    }
    fn number(&mut self, what: &str) -> Result<f64, Issue> {
        self.lexer.number(what).map_err(|e| self.issue(e))
    }
    fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N], Issue> {
        let mut out = [0.0; N];
        for x in &mut out {
            *x = self.number(what)?;
        }
        Ok(out)
    }
    fn vector(&mut self, what: &str) -> Result<DVec3, Issue> {
        self.numbers(what).map(DVec3::from_array)
    }
    fn text(&mut self, what: &str) -> Result<String, Issue> {
        match self.lexer.next().map_err(|e| self.issue(e))? {
            Some((Token::Text(text), _)) => Ok(text.into_owned()),
            _ => Err(self.issue(LexError {
                line: self.lexer.line,
                reason: format!("{what} needs a quoted name"),
            })),
        }
    }
    fn text_follows(&mut self) -> Result<bool, Issue> {
        let follows = self
            .lexer
            .peek()
            .map(|token| matches!(token, Some((Token::Text(_), _))));
        follows.map_err(|e| self.issue(e))
    }
    fn matrix(&mut self, what: &str) -> Result<DMat4, Issue> {
        let bracket = |source: &mut Self, wanted: Token<'_>| match source.lexer.next() {
            Ok(Some((token, _))) if token == wanted => Ok(()),
            Err(e) => Err(source.issue(e)),
            _ => {
                let line = source.lexer.line;
                Err(source.issue(LexError {
                    line,
                    reason: format!("{what} needs 16 numbers in brackets"),
                }))
            }
        };
        bracket(self, Token::Open)?;
        let numbers = self.numbers::<16>(what)?;
        bracket(self, Token::Close)?;
        Ok(matrix::columns(&numbers))
    }
}

impl Importer<'_, '_> {
    pub(super) fn directives(
        &mut self,
        bytes: &[u8],
        path: &str,
        open: &mut Vec<String>,
    ) -> Result<(), Issue> {
        let mut lexer = Lexer::new(bytes);
        let mut source = Source {
            lexer: &mut lexer,
            file: path.into(),
        };
        loop {
            let (word, line) = match source.lexer.next().map_err(|e| source.issue(e))? {
                None => return Ok(()),
                Some((Token::Word(word), line)) => (word, line),
                Some((token, line)) => {
                    let found = match token {
                        Token::Text(text) => format!("the string {text:?}"),
                        Token::Open => "\"[\"".to_owned(),
                        _ => "\"]\"".to_owned(),
                    };
                    return Err(source.issue(LexError {
                        line,
                        reason: format!("expected a directive, found {found}"),
                    }));
                }
            };
            let place = Place {
                file: path.to_owned(),
                line: Some(line),
                ..Place::default()
            };
            if self.cx.hopeless() {
                return Err(Issue::new(&place, "too many errors: reading stops here"));
            }
            self.directive(word, place, &mut source, open)?;
        }
    }

    fn transform_by(&mut self, change: impl Fn(DMat4) -> DMat4) {
        for (m, active) in self.graphics.ctm.iter_mut().zip(self.graphics.active) {
            if active {
                *m = change(*m);
            }
        }
    }

    fn params(&mut self, source: &mut Source<'_, '_>, place: &Place) -> Result<Params, Issue> {
        let mut params = Params::read(
            source.lexer,
            &source.file,
            place.clone(),
            self.graphics.space,
        )
        .map_err(|e| source.issue(e))?;
        // A list may begin in an included file and end in the one that includes it.
        if self.trailing.is_some() && matches!(source.lexer.peek(), Ok(None)) {
            for param in self.trailing.take().into_iter().flatten() {
                params.push(param)?;
            }
        }
        Ok(params)
    }

    /// A directive that stands before or after `WorldBegin` only.
    fn only(&mut self, place: &Place, word: &str, in_world: bool) -> bool {
        if self.in_world == in_world {
            return true;
        }
        let where_to = if in_world { "after" } else { "before" };
        self.cx.error(Issue::new(
            place,
            format!("{word} belongs {where_to} WorldBegin"),
        ));
        false
    }

    /// Syntax errors are returned and end reading; others are noted, and the directive is left out.
    fn directive(
        &mut self,
        word: &str,
        place: Place,
        source: &mut Source<'_, '_>,
        open: &mut Vec<String>,
    ) -> Result<(), Issue> {
        match word {
            "Identity" => self.transform_by(|_| DMat4::IDENTITY),
            "Translate" => {
                let by = source.vector(word)?;
                self.transform_by(|m| m * DMat4::from_translation(by));
            }
            "Scale" => {
                let by = source.vector(word)?;
                self.transform_by(|m| m * DMat4::from_scale(by));
            }
            "Rotate" => {
                let degrees = source.number(word)?;
                let axis = source.vector(word)?;
                match matrix::rotate(degrees, axis) {
                    Some(by) => self.transform_by(|m| m * by),
                    None => self
                        .cx
                        .error(Issue::new(&place, "Rotate about an axis of no length")),
                }
            }
            "LookAt" => {
                let (eye, at, up) = (
                    source.vector(word)?,
                    source.vector(word)?,
                    source.vector(word)?,
                );
                match matrix::look_at(eye, at, up) {
                    Some(by) => self.transform_by(|m| m * by),
                    None => self.cx.error(Issue::new(
                        &place,
                        "LookAt: eye and target are the same point, or up points along the view",
                    )),
                }
            }
            "Transform" => {
                let to = source.matrix(word)?;
                self.transform_by(|_| to);
            }
            "ConcatTransform" => {
                let by = source.matrix(word)?;
                self.transform_by(|m| m * by);
            }
            "CoordinateSystem" => {
                let name = source.text(word)?;
                self.coordinates.insert(name, self.graphics.ctm);
            }
            "CoordSysTransform" => {
                let name = source.text(word)?;
                match self.coordinates.get(&name) {
                    Some(&ctm) => self.graphics.ctm = ctm,
                    None => {
                        let near = super::nearest(&name, self.coordinates.keys());
                        self.cx.error(Issue::new(
                            &place,
                            format!("unknown coordinate system {name:?}{near}"),
                        ));
                    }
                }
            }
            "ActiveTransform" => match source.lexer.next().map_err(|e| source.issue(e))? {
                Some((Token::Word("All"), _)) => self.graphics.active = [true, true],
                Some((Token::Word("StartTime"), _)) => self.graphics.active = [true, false],
                Some((Token::Word("EndTime"), _)) => self.graphics.active = [false, true],
                _ => {
                    return Err(Issue::new(
                        &place,
                        "ActiveTransform needs All, StartTime or EndTime",
                    ));
                }
            },
            "TransformTimes" => {
                let [start, end] = source.numbers(word)?;
                if self.only(&place, word, false) {
                    if start > end {
                        self.cx
                            .error(Issue::new(&place, "TransformTimes end before they start"));
                    } else {
                        self.times = (start, end);
                    }
                }
            }
            "ReverseOrientation" => {
                if self.only(&place, word, true) {
                    self.graphics.reverse = !self.graphics.reverse;
                }
            }
            "ColorSpace" => {
                let name = source.text(word)?;
                match ColorSpace::named(&name) {
                    Some(space) => {
                        if space != ColorSpace::Srgb {
                            self.warn_once(&place, "colours of other spaces are converted to Rec. 709; what lies outside is cut");
                        }
                        self.graphics.space = space;
                    }
                    None => self
                        .cx
                        .error(Issue::new(&place, format!("unknown colour space {name:?}"))),
                }
            }
            "Option" => {
                let name = source.text(word)?;
                let value = match source.lexer.next().map_err(|e| source.issue(e))? {
                    Some((Token::Word(value), _)) => value.to_owned(),
                    Some((Token::Text(value), _)) => value.into_owned(),
                    _ => return Err(Issue::new(&place, "Option needs a value")),
                };
                self.cx.warn(
                    &place,
                    format!("Option {name:?} ({value}) concerns pbrt itself: left out"),
                );
            }
            "Include" | "Import" => self.include(word, place, source, open)?,
            "WorldBegin" => {
                if self.only(&place, word, false) {
                    self.in_world = true;
                    self.graphics.ctm = [DMat4::IDENTITY; 2];
                    self.graphics.active = [true; 2];
                    self.coordinates.insert("world".into(), self.graphics.ctm);
                }
            }
            "AttributeBegin" | "TransformBegin" => {
                if self.only(&place, word, true) {
                    self.begin(place, false)?;
                }
            }
            "AttributeEnd" | "TransformEnd" => self.end(&place, word, false),
            "ObjectBegin" => {
                let name = source.text(word)?;
                if self.only(&place, word, true) {
                    self.begin(place.clone(), true)?;
                    if std::mem::replace(&mut self.open_group, true) {
                        return Err(Issue::new(&place, "ObjectBegin inside another object"));
                    }
                    let id = GroupId(self.groups.len() as u32);
                    if self.group_names.insert(name.clone(), id).is_some() {
                        self.cx.error(Issue::new(
                            &place,
                            format!("object {name:?} is defined twice"),
                        ));
                    }
                    self.groups.push(PendingGroup {
                        name,
                        shapes: Vec::new(),
                    });
                }
            }
            "ObjectEnd" => {
                self.end(&place, word, true);
                self.open_group = false;
            }
            "ObjectInstance" => {
                let name = source.text(word)?;
                self.cx.charge(&place, KEPT_BYTES)?;
                if self.open_group {
                    self.cx.error(Issue::new(
                        &place,
                        "ObjectInstance inside an object: pbrt has no nested instances",
                    ));
                } else if self.only(&place, word, true) {
                    let transform = matrix::motion(&self.graphics.ctm, self.times)
                        .map_err(|e| Issue::new(&place, e));
                    if let Some(transform) = self.cx.keep(transform) {
                        self.instances.push(PendingInstance {
                            name,
                            transform,
                            place,
                        });
                    }
                }
            }
            "NamedMaterial" => {
                let name = source.text(word)?;
                if self.only(&place, word, true) {
                    self.graphics.material = MaterialRef::Named(name);
                }
            }
            "MediumInterface" => {
                let inside: Arc<str> = source.text(word)?.into();
                let outside = match source.text_follows()? {
                    true => source.text(word)?.into(),
                    false => inside.clone(),
                };
                self.graphics.sides = Sides { inside, outside };
            }
            "Accelerator" | "Film" | "Camera" | "PixelFilter" | "Sampler" | "Integrator" => {
                let kind = source.text(word)?;
                let params = self.params(source, &place)?;
                if self.only(&place, word, false) {
                    self.setting(word, Setting { kind, params });
                }
            }
            "Attribute" => {
                let target = source.text(word)?;
                let params = self.params(source, &place)?;
                self.cx.charge(&place, params.bytes())?;
                match TARGETS.iter().position(|t| *t == target) {
                    Some(target) => Rc::make_mut(&mut self.graphics.attributes[target])
                        .extend(params.into_inner()),
                    None => {
                        let near = crate::suggest::did_you_mean(&target, TARGETS);
                        self.cx.error(Issue::new(
                            &place,
                            format!("Attribute for the unknown target {target:?}{near}"),
                        ));
                    }
                }
            }
            "Material" | "MakeNamedMaterial" => {
                let name = source.text(word)?;
                let mut params = self.params(source, &place)?;
                self.cx.charge(&place, params.bytes())?;
                params.add_attributes(&self.graphics.attributes[2]);
                if self.only(&place, word, true) {
                    let result = self.define_material(word == "MakeNamedMaterial", name, params);
                    self.cx.keep(result);
                }
            }
            "MakeNamedMedium" => {
                let name = source.text(word)?;
                let mut params = self.params(source, &place)?;
                self.cx.charge(&place, KEPT_BYTES)?;
                params.add_attributes(&self.graphics.attributes[3]);
                let result = if name.is_empty() {
                    params.fail("a medium with an empty name, which stands for vacuum")
                } else {
                    self.define_medium(name, &params)
                };
                self.cx.keep(result);
            }
            "Texture" => {
                let (name, kind, class) =
                    (source.text(word)?, source.text(word)?, source.text(word)?);
                let mut params = self.params(source, &place)?;
                self.cx.charge(&place, KEPT_BYTES)?;
                params.add_attributes(&self.graphics.attributes[4]);
                if self.only(&place, word, true) {
                    let result = self.define_texture(name, &kind, &class, &params);
                    self.cx.keep(result);
                }
            }
            "LightSource" => {
                let kind = source.text(word)?;
                let mut params = self.params(source, &place)?;
                self.cx.charge(&place, KEPT_BYTES)?;
                params.add_attributes(&self.graphics.attributes[1]);
                if self.only(&place, word, true) {
                    let result = self.light(&kind, &params);
                    if self.cx.keep(result).is_some() {
                        self.warn_unused(&params, &format!("light {kind:?}"));
                    }
                }
            }
            "AreaLightSource" => {
                let kind = source.text(word)?;
                let mut params = self.params(source, &place)?;
                self.cx.charge(&place, params.bytes())?;
                params.add_attributes(&self.graphics.attributes[1]);
                if kind != "diffuse" {
                    let hint = legacy::hint("light", &kind, &["diffuse"]);
                    self.cx.error(Issue::new(
                        &place,
                        format!("unknown area light {kind:?}{hint}"),
                    ));
                } else if self.only(&place, word, true) {
                    let result = self.check_area_light(&params);
                    if self.cx.keep(result).is_some() {
                        self.warn_unused(&params, "the area light");
                        self.graphics.area_light = Some(Rc::new(params));
                    }
                }
            }
            "Shape" => {
                let kind = source.text(word)?;
                let mut params = self.params(source, &place)?;
                self.cx.charge(&place, KEPT_BYTES)?;
                params.add_attributes(&self.graphics.attributes[0]);
                if self.only(&place, word, true) {
                    let result = self.shape(&kind, &params);
                    if self.cx.keep(result).is_some() {
                        self.warn_unused(&params, &format!("shape {kind:?}"));
                    }
                }
            }
            _ => {
                let hint = match legacy::directive(word) {
                    Some(hint) => format!("{word} is of an older pbrt: {hint}"),
                    None => format!(
                        "unknown directive {word:?}{}",
                        crate::suggest::did_you_mean(word, DIRECTIVES)
                    ),
                };
                return Err(Issue::new(&place, hint));
            }
        }
        Ok(())
    }

    fn begin(&mut self, place: Place, is_object: bool) -> Result<(), Issue> {
        if self.blocks.len() >= MAX_NESTING * 16 {
            return Err(Issue::new(
                &place,
                format!(
                    "blocks nested more than {} deep, the limit",
                    MAX_NESTING * 16
                ),
            ));
        }
        self.blocks.push(Block {
            is_object,
            place,
            saved: self.graphics.clone(),
        });
        Ok(())
    }

    fn end(&mut self, place: &Place, word: &str, is_object: bool) {
        match self.blocks.last() {
            Some(block) if block.is_object == is_object => {
                if let Some(block) = self.blocks.pop() {
                    self.graphics = block.saved;
                }
            }
            Some(block) => {
                let reason = format!(
                    "{word} closes the other kind of block, opened at {}",
                    block.place
                );
                self.cx.error(Issue::new(place, reason));
            }
            None => self
                .cx
                .error(Issue::new(place, format!("{word} without a beginning"))),
        }
    }

    fn setting(&mut self, word: &str, setting: Setting) {
        let slot = match word {
            "Camera" => {
                // From now on "camera" names the space of the camera.
                self.coordinates
                    .insert("camera".into(), self.graphics.ctm.map(|m| m.inverse()));
                let around = self.graphics.sides.outside.clone();
                self.settings.camera = Some((setting, self.graphics.ctm, around));
                return;
            }
            "Film" => &mut self.settings.film,
            "PixelFilter" => &mut self.settings.filter,
            "Sampler" => &mut self.settings.sampler,
            "Integrator" => &mut self.settings.integrator,
            // How rays find surfaces is ours.
            _ => return,
        };
        *slot = Some(setting);
    }

    fn define_material(&mut self, named: bool, name: String, params: Params) -> Result<(), Issue> {
        let kind = if named {
            params.text("type", "")?.to_owned()
        } else {
            name.clone()
        };
        if named && kind.is_empty() {
            return params.fail(format!("material {name:?} has no \"string type\""));
        }
        let index = self.materials.len();
        if named {
            if self.material_names.insert(name.clone(), index).is_some() {
                return params.fail(format!("material {name:?} is defined twice"));
            }
            self.materials.push(MaterialEntry { name, kind, params });
        } else {
            let name = format!(
                "{} at {}",
                if kind.is_empty() { "interface" } else { &kind },
                params.place
            );
            self.materials.push(MaterialEntry { name, kind, params });
            self.graphics.material = MaterialRef::Index(index);
        }
        Ok(())
    }

    fn include(
        &mut self,
        word: &str,
        place: Place,
        source: &mut Source<'_, '_>,
        open: &mut Vec<String>,
    ) -> Result<(), Issue> {
        let name = source.text(word)?;
        let path = self.cx.path(&place, &name)?;
        if word == "Include" {
            let outer = self.trailing.take();
            let rest = self.params(source, &place)?.into_inner();
            if rest.is_empty() && matches!(source.lexer.peek(), Ok(None)) {
                // What follows this file follows the included one.
                self.trailing = outer;
                return self.file(&place, &path, open);
            }
            self.trailing = (!rest.is_empty()).then_some(rest);
            let result = self.file(&place, &path, open);
            let left = std::mem::replace(&mut self.trailing, outer);
            result?;
            return match left.as_deref() {
                Some([first, ..]) => Err(Issue::new(
                    &first.place,
                    format!(
                        "parameter {:?} belongs to no directive: {path} does not end in a list of \
                         parameters",
                        first.name
                    ),
                )),
                _ => Ok(()),
            };
        }
        if !self.only(&place, word, true) {
            return Ok(());
        }
        // Unlike an included file, an imported one leaves the state as it was.
        let saved = self.graphics.clone();
        let depth = self.blocks.len();
        let coordinates = self.coordinates.clone();
        self.file(&place, &path, open)?;
        if self.blocks.len() != depth {
            self.cx.error(Issue::new(
                &place,
                format!("{path}: blocks that are opened in an imported file end in it"),
            ));
            self.blocks.truncate(depth);
        }
        self.graphics = saved;
        self.coordinates = coordinates;
        Ok(())
    }
}
