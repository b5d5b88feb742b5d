//! YAML documents, and errors that name the file and the field.

use std::path::Path;

use saphyr::{LoadableYamlNode, Yaml};
use saphyr_parser::{Event, Parser};

use crate::error::{Error, Result, first_line};

/// The greatest depth to which a calibration may be nested. Loading it recurses as deeply.
const MAX_DEPTH: usize = 100;

/// The first document of a YAML file.
pub struct Document<'a> {
    path: &'a Path,
    root: Yaml<'a>,
}

impl<'a> Document<'a> {
    pub fn parse(path: &'a Path, text: &'a str) -> Result<Document<'a>> {
        let is_xml = text.trim_start().starts_with('<');
        if is_xml {
            return Err(Error::format(path, "an XML file", "YAML: write the calibration to a file with the ending .yml"));
        }
        // OpenCV before version 5 begins with its own spelling of the directive, which is no YAML.
        let text = text.strip_prefix("%YAML:1.0").unwrap_or(text);
        if is_deeper_than(MAX_DEPTH, text) {
            return Err(Error::format(path, format!("more than {MAX_DEPTH} levels of YAML"), "a calibration"));
        }
        let documents = Yaml::load_from_str(text).map_err(|error| {
            let (line, cause) = (error.marker().line(), error.info());
            Error::format(path, format!("text that is not YAML (line {line}: {cause})"), "a calibration")
        })?;
        let root = documents.into_iter().next().ok_or_else(|| Error::format(path, "nothing but blanks", "a calibration"))?;
        Ok(Document { path, root })
    }

    /// The fields of the document.
    pub fn fields(&self) -> Result<Fields<'_>> {
        Fields::of(self.path, String::new(), &self.root)
    }
}

/// Returns true if a YAML text is nested more deeply than `most` levels, up to where it is damaged.
fn is_deeper_than(most: usize, text: &str) -> bool {
    let depth = Parser::new_from_str(text).map_while(|event| event.ok()).scan(0_usize, |depth, (event, _)| {
        match event {
            Event::SequenceStart(..) | Event::MappingStart(..) => *depth += 1,
            Event::SequenceEnd | Event::MappingEnd => *depth = depth.saturating_sub(1),
            _ => {}
        }
        Some(*depth)
    });
    depth.into_iter().any(|depth| depth > most)
}

/// The fields of a mapping.
pub struct Fields<'a> {
    pub path: &'a Path,
    /// The name of the mapping, with a point behind it, or nothing for the document.
    prefix: String,
    /// Names, [`plain`] and as they are, and values.
    pairs: Vec<(String, &'a str, &'a Yaml<'a>)>,
}

impl<'a> Fields<'a> {
    fn of(path: &'a Path, prefix: String, node: &'a Yaml<'a>) -> Result<Fields<'a>> {
        let Some(mapping) = node.as_mapping() else {
            let found = match prefix.strip_suffix('.') {
                None => format!("{} instead of fields", describe(node)),
                Some(name) => format!("{} in {name}", describe(node)),
            };
            return Err(Error::format(path, found, "a calibration of ROS, OpenCV or Kalibr"));
        };
        let pair = |(name, value): (&'a Yaml, &'a Yaml<'a>)| name.as_str().map(|name| (plain(name), name, value));
        let pairs = mapping.iter().filter_map(pair).collect();
        Ok(Fields { path, prefix, pairs })
    }

    /// The name of the mapping, or nothing for the document.
    pub fn name(&self) -> &str {
        self.prefix.trim_end_matches('.')
    }

    /// The fields that are mappings themselves.
    pub fn mappings(&self) -> impl Iterator<Item = Fields<'a>> {
        let of =
            |(_, name, node): &(String, &str, &'a Yaml<'a>)| Fields::of(self.path, format!("{}{name}.", self.prefix), node).ok();
        self.pairs.iter().filter_map(of)
    }

    /// The names of the fields.
    pub fn names(&self) -> impl Iterator<Item = &'a str> {
        self.pairs.iter().map(|(_, name, _)| *name)
    }

    /// The first of `names` that is a field, as [`plain`] compares them.
    pub fn field(&self, names: &[&str]) -> Option<Field<'a>> {
        let find = |name: &&str| {
            let name = plain(name);
            self.pairs.iter().find(|(other, ..)| *other == name)
        };
        let (_, name, node) = names.iter().find_map(find)?;
        Some(Field { path: self.path, name: format!("{}{name}", self.prefix), node })
    }

    /// As [`field`](Fields::field), which must exist.
    pub fn required(&self, names: &[&str]) -> Result<Field<'a>> {
        self.field(names).ok_or_else(|| {
            let found = format!("no {}{}", self.prefix, names[0]);
            Error::format(self.path, found, "a complete calibration of ROS, OpenCV or Kalibr")
        })
    }
}

/// A name without case, `_`, `-` and blanks, and without the `Camera.` that some files put before each.
pub fn plain(name: &str) -> String {
    let name = name.replace(['_', '-', ' '], "").to_lowercase();
    let bare = ["camera.", "camera1."].iter().find_map(|prefix| name.strip_prefix(prefix));
    bare.map_or_else(|| name.clone(), String::from)
}

/// A field of a mapping.
pub struct Field<'a> {
    path: &'a Path,
    pub name: String,
    node: &'a Yaml<'a>,
}

impl<'a> Field<'a> {
    /// The error that this field has `found` instead of `expected`.
    pub fn error(&self, found: impl AsRef<str>, expected: impl Into<String>) -> Error {
        Error::format(self.path, format!("{} in {}", found.as_ref(), self.name), expected)
    }

    pub fn fields(&self) -> Result<Fields<'a>> {
        Fields::of(self.path, format!("{}.", self.name), self.node)
    }

    pub fn text(&self) -> Result<&'a str> {
        self.node.as_str().ok_or_else(|| self.error(describe(self.node), "a name"))
    }

    pub fn number(&self) -> Result<f64> {
        number(self.node).ok_or_else(|| self.error(describe(self.node), "a number"))
    }

    /// A whole number of pixels.
    pub fn pixels(&self) -> Result<usize> {
        let whole = number(self.node).and_then(whole);
        whole.ok_or_else(|| self.error(describe(self.node), "a whole number of pixels"))
    }

    /// A width and a height in pixels: two numbers, a mapping with them, or text such as 640x480. `None` for a single number.
    pub fn size(&self) -> Result<Option<[usize; 2]>> {
        if number(self.node).is_some() {
            return Ok(None);
        }
        if let Ok(fields) = self.fields()
            && fields.field(&["width"]).is_some()
        {
            return Ok(Some([fields.required(&["width"])?.pixels()?, fields.required(&["height"])?.pixels()?]));
        }
        let numbers = match self.node.as_str().and_then(|text| text.split_once('x')) {
            Some((width, height)) => [width, height].iter().filter_map(|side| side.trim().parse().ok()).collect(),
            None => self.numbers()?,
        };
        match numbers[..] {
            [width, height] => whole(width).zip(whole(height)).map(|(width, height)| Some([width, height])),
            _ => None,
        }
        .ok_or_else(|| self.error("no size", "two whole numbers of pixels: width and height"))
    }

    /// The numbers of a matrix, row by row: a mapping with `rows`, `cols` and `data`, or a list of numbers or of rows. More
    /// numbers than rows and columns are taken as they are, since ROS 1 wrote `cols: 5` for eight coefficients.
    pub fn numbers(&self) -> Result<Vec<f64>> {
        if self.node.as_mapping().is_none() {
            return self.list();
        }
        let fields = self.fields()?;
        let data = fields.required(&["data"])?;
        let numbers = data.list()?;
        let [rows, cols] = [fields.required(&["rows"])?.pixels()?, fields.required(&["cols"])?.pixels()?];
        if rows.checked_mul(cols).is_none_or(|count| count > numbers.len()) {
            return Err(data.error(format!("{} numbers", numbers.len()), format!("{rows} rows of {cols}, as the file says")));
        }
        Ok(numbers)
    }

    fn list(&self) -> Result<Vec<f64>> {
        let mut numbers = Vec::new();
        match self.node.as_sequence() {
            Some(nodes) => self.flatten(nodes, &mut numbers).map(|()| numbers),
            None => Err(self.error(describe(self.node), "a list of numbers")),
        }
    }

    fn flatten(&self, nodes: &[Yaml], numbers: &mut Vec<f64>) -> Result<()> {
        nodes.iter().try_for_each(|node| match node.as_sequence() {
            Some(row) => self.flatten(row, numbers),
            None => {
                numbers.push(number(node).ok_or_else(|| self.error(describe(node), "only numbers"))?);
                Ok(())
            }
        })
    }
}

fn whole(number: f64) -> Option<usize> {
    (number >= 0.0 && number.fract() == 0.0).then_some(number as usize)
}

fn number(node: &Yaml) -> Option<f64> {
    node.as_floating_point().or_else(|| node.as_integer().map(|number| number as f64))
}

/// Describes a node in words.
fn describe(node: &Yaml) -> String {
    if let Some(text) = node.as_str() {
        return format!("{:?}", first_line(text));
    }
    match (number(node), node) {
        (Some(number), _) => number.to_string(),
        (None, Yaml::Sequence(_)) => "a list".into(),
        (None, Yaml::Mapping(_)) => "a mapping".into(),
        (None, _) => "nothing".into(),
    }
}
