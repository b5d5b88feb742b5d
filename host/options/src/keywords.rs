//! The keyword arguments of Python's `match`: the options of `multiscopic match`, with `_` for `-`.
//!
//! [`Keyword::all`] describes each: the types in the stub, the signature and the text of `help()` are made of these descriptions.

use std::{any::TypeId, error::Error as _};

use clap::{
    Arg, CommandFactory, Parser,
    error::{ContextKind, ContextValue, ErrorKind},
};
use multiscopic::{Error, Result};

use crate::{
    machine::EngineOptions,
    matching::{MatchingOptions, PRIOR_EXCLUDES},
    search::{BitsOption, PreparationOptions},
    value::possible_values,
};

/// The characters in a line of Python's documentation.
const LINE: usize = 120;

/// The options that Python takes.
#[derive(Clone, Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
pub struct Keywords {
    /// The method, what it searches, and its options.
    #[command(flatten)]
    pub matching: MatchingOptions,

    /// The preparation of images for matching.
    #[command(flatten)]
    pub preparation: PreparationOptions,

    /// The depth of images of 16 bits.
    #[command(flatten)]
    pub bits: BitsOption,

    /// Disparities around which all views are searched instead of over the whole range: numbers of height x width in pixels of
    /// one baseline, NaN or infinite where unknown. They are rounded to multiples of 1/64, which those of match() are. Of the
    /// filters, sub_pixel alone goes with it, and there are no confidences
    #[arg(long, conflicts_with_all = PRIOR_EXCLUDES, conflicts_with = "confidence")]
    prior: bool,

    /// Compute confidences as well, which takes time [default: True, and False with a prior]
    #[arg(long)]
    confidence: bool,

    /// Threads, vector instructions and memory.
    #[command(flatten)]
    pub engine: EngineOptions,
}

/// A keyword argument.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyword {
    /// Its name in Python.
    pub name: String,
    /// The values that it takes.
    pub kind: Kind,
    /// The option of the command line, with its dashes.
    pub option: String,
    /// Its default as Python writes it.
    default: String,
    /// The text of the command line about it.
    help: String,
    /// The text of the command line about each value that has a name.
    abouts: Vec<(String, String)>,
}

/// The values of a keyword argument.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// `True` and `False`, of which one gives the option.
    Flag {
        /// The value that gives it.
        given: bool,
    },
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// Two numbers.
    Pair,
    /// A number, or this word.
    NumberOr(&'static str),
    /// Any text.
    Text,
    /// One of these words.
    Word(Vec<String>),
    /// One of these whole numbers.
    IntegerOf(Vec<String>),
    /// Disparities, which no word of a command line can hold.
    Array,
}

impl Keywords {
    /// Reads the options that keyword arguments stand for, each with its value after `=`.
    ///
    /// # Errors
    /// If a value is out of its range, or options do not go together. The message names keywords.
    pub fn parse(words: &[String]) -> Result<Keywords> {
        Keywords::try_parse_from(words).map_err(|error| Error::Usage(refusal(&error)))
    }
}

impl Keyword {
    /// Returns all keywords, in the order of the signature.
    pub fn all() -> Vec<Keyword> {
        let mut command = Keywords::command();
        command.build();
        command.get_arguments().filter_map(Keyword::of).collect()
    }

    /// Describes an option.
    fn of(arg: &Arg) -> Option<Keyword> {
        let long = arg.get_long()?;
        let kind = Kind::of(arg);
        let default = match (&kind, arg.get_default_values()) {
            (Kind::Array, _) => "None".into(),
            _ if long == "confidence" => "None".into(),
            (Kind::Flag { given: true }, _) => "False".into(),
            (Kind::Flag { given: false }, _) => "True".into(),
            (_, []) => "None".into(),
            (Kind::Word(_) | Kind::Text, [value, ..]) => format!("'{}'", value.display()),
            (_, [value, ..]) => value.display().to_string(),
        };
        let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
        let about =
            |value: clap::builder::PossibleValue| Some((value.get_name().to_owned(), in_python(&value.get_help()?.to_string())));
        Some(Keyword {
            name: keyword_name(long),
            kind,
            option: format!("--{long}"),
            default,
            help: in_python(&help),
            abouts: if arg.is_hide_possible_values_set() {
                Vec::new()
            } else {
                arg.get_possible_values().into_iter().filter_map(about).collect()
            },
        })
    }

    /// Returns true if `value`, as the command line writes it, is the default: giving it is no different from giving nothing.
    pub fn is_default(&self, value: &str) -> bool {
        self.default.trim_matches('\'') == value
    }

    /// Its type in the stub.
    pub fn annotation(&self) -> String {
        let literals = |values: &[String], quote: &str| {
            let values: Vec<String> = values.iter().map(|value| format!("{quote}{value}{quote}")).collect();
            format!("Literal[{}]", values.join(", "))
        };
        let annotation = match &self.kind {
            Kind::Flag { .. } => "bool".into(),
            Kind::Integer => "int".into(),
            Kind::Number => "float".into(),
            Kind::Pair => "tuple[float, float]".into(),
            Kind::NumberOr(word) => format!("float | Literal[\"{word}\"]"),
            Kind::Text => "str".into(),
            Kind::Word(values) => literals(values, "\""),
            Kind::IntegerOf(values) => literals(values, ""),
            Kind::Array => "npt.ArrayLike".into(),
        };
        annotation + " | None"
    }

    /// Returns what `help()` says about it.
    fn documentation(&self) -> String {
        let help = match (&self.kind, self.help.find("[default: ")) {
            // The option turns it off.
            (Kind::Flag { given: false }, _) => {
                let (first, rest) = self.help.split_at(1);
                format!("False: {}{rest} [default: True]", first.to_lowercase())
            }
            (_, None) if !matches!(&*self.default, "None" | "False") => format!("{} [default: {}]", self.help, self.default),
            // Data sets are for the command line.
            (_, Some(at)) => match self.help[at..].split_once(", or the data set's") {
                Some((default, _)) => format!("{}{default}]", &self.help[..at]),
                None => self.help.clone(),
            },
            _ => self.help.clone(),
        };
        let mut text = wrapped(&format!("{}: {help}", self.name), 4);
        for (value, about) in &self.abouts {
            let value = if matches!(self.kind, Kind::Word(_)) { format!("\"{value}\"") } else { value.clone() };
            text += &wrapped(&format!("{value}: {about}"), 8);
        }
        text
    }
}

/// Returns the parameters of Python's signature, each with its default: `method='bm', fusion=None, ...`.
pub fn signature(keywords: &[Keyword]) -> String {
    let parameters: Vec<String> = keywords.iter().map(|keyword| format!("{}={}", keyword.name, keyword.default)).collect();
    parameters.join(", ")
}

/// Returns the lines about arguments in Python's documentation.
pub fn documentation(keywords: &[Keyword]) -> String {
    keywords.iter().map(Keyword::documentation).collect()
}

/// Returns the lines of the typed dictionary in Python's stub.
pub fn stub(keywords: &[Keyword]) -> String {
    keywords.iter().map(|keyword| format!("    {}: {}\n", keyword.name, keyword.annotation())).collect()
}

impl Kind {
    /// The values of an option.
    fn of(arg: &Arg) -> Kind {
        let long = arg.get_long().unwrap_or_default();
        if long == "prior" {
            return Kind::Array;
        }
        if !arg.get_action().takes_values() {
            return Kind::Flag { given: !long.starts_with("no-") };
        }
        let values = possible_values(arg);
        if !values.is_empty() {
            let are_numbers = values.iter().all(|value| value.parse::<u32>().is_ok());
            return if are_numbers { Kind::IntegerOf(values) } else { Kind::Word(values) };
        }
        let parsed = arg.get_value_parser().type_id();
        let is = |id: TypeId| parsed == id;
        let integers = [
            TypeId::of::<u8>(),
            TypeId::of::<u16>(),
            TypeId::of::<u32>(),
            TypeId::of::<u64>(),
            TypeId::of::<usize>(),
            TypeId::of::<i16>(),
        ];
        match () {
            () if integers.into_iter().any(is) => Kind::Integer,
            () if is(TypeId::of::<f64>()) => Kind::Number,
            () if is(TypeId::of::<[f64; 2]>()) => Kind::Pair,
            () if is(TypeId::of::<Option<f64>>()) => Kind::NumberOr("auto"),
            () => Kind::Text,
        }
    }
}

/// The keyword for an option without dashes before it.
fn keyword_name(option: &str) -> String {
    option.strip_prefix("no-").unwrap_or(option).replace('-', "_")
}

/// Names keywords where a text of the command line names options.
pub fn in_python(text: &str) -> String {
    let mut parts = text.split("--");
    let mut python = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|letter: char| !letter.is_ascii_alphanumeric() && letter != '-').unwrap_or(part.len());
        let (option, rest) = part.split_at(end);
        python += &keyword_name(option);
        python += rest;
    }
    python
}

/// Breaks text between words. All lines are indented, those after the first four columns more.
fn wrapped(text: &str, indent: usize) -> String {
    let mut lines = format!("{:indent$}", "");
    let mut used = indent;
    for (i, word) in text.split_whitespace().enumerate() {
        let length = word.chars().count();
        if i > 0 && used + 1 + length > LINE {
            used = indent + 4;
            lines += &format!("\n{:used$}", "");
        } else if i > 0 {
            lines.push(' ');
            used += 1;
        }
        lines += word;
        used += length;
    }
    lines + "\n"
}

/// Says with the names of keywords why options were refused.
fn refusal(error: &clap::Error) -> String {
    let context = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        Some(ContextValue::Strings(texts)) => texts.join(", "),
        _ => String::new(),
    };
    // Such as `--theta <N>`.
    let name = |kind| {
        let option = context(kind);
        in_python(option.split(' ').next().unwrap_or_default())
    };
    let (keyword, value) = (name(ContextKind::InvalidArg), context(ContextKind::InvalidValue));
    let reason = error.source().map(ToString::to_string).unwrap_or_default();
    match error.kind() {
        ErrorKind::InvalidValue => format!("{keyword} is {value}, it must be one of {}", context(ContextKind::ValidValue)),
        ErrorKind::ValueValidation if reason.starts_with("it ") => format!("{keyword} is {value}, {reason}"),
        ErrorKind::ValueValidation => match reason.strip_prefix(&value) {
            Some(reason) => format!("{keyword} is {value}, which{reason}"),
            None => format!("{keyword} is {value}, which is out of its range"),
        },
        ErrorKind::ArgumentConflict => format!("{keyword} cannot be used with {}", name(ContextKind::PriorArg)),
        ErrorKind::MissingRequiredArgument => format!("{keyword} is missing, which another argument needs"),
        _ => in_python(error.render().to_string().lines().next().unwrap_or_default()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(words: &[&str]) -> String {
        let words: Vec<String> = words.iter().map(ToString::to_string).collect();
        Keywords::parse(&words).unwrap_err().to_string()
    }

    fn keyword(name: &str) -> Keyword {
        Keyword::all().into_iter().find(|keyword| keyword.name == name).unwrap()
    }

    #[test]
    fn types_follow_from_options() {
        for (name, annotation, default) in [
            ("method", r#"Literal["bm", "gc", "sgm", "mccnn-fast", "mccnn-accurate", "net"]"#, "'net'"),
            ("min_disparity", "int", "None"),
            ("auto_range", "bool", "False"),
            ("bits", "Literal[10, 12, 14, 16]", "None"),
            ("paths", "Literal[4, 5, 8]", "5"),
            ("occlusion_cost", r#"float | Literal["auto"]"#, "None"),
            ("refine", "bool", "True"),
            ("upsample", "Literal[1, 2, 3, 4]", "1"),
            ("cbca_intensity", "float", "0.02"),
            ("bilateral", "tuple[float, float]", "None"),
            ("prior", "npt.ArrayLike", "None"),
            ("confidence", "bool", "None"),
            ("simd", "str", "None"),
            ("max_memory", "int", "None"),
        ] {
            let keyword = keyword(name);
            assert_eq!((keyword.annotation(), &*keyword.default), (format!("{annotation} | None"), default), "{name}");
        }
        assert!(keyword("method").is_default("net") && keyword("cbca_intensity").is_default("0.02"));
        assert!(!keyword("method").is_default("gc") && !keyword("min_disparity").is_default("0"));
    }

    #[test]
    fn documentation_names_keywords_and_values() {
        let text = documentation(&Keyword::all());
        assert!(!text.contains("--"), "{text}");
        assert!(text.contains("\n        \"gc\": Graph cuts: the least energy of matching costs and smoothness\n"), "{text}");
        let unwrapped = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(unwrapped.contains("[default: a third of lambda1]"), "{text}");
        assert!(text.contains("refine: False: keep whole disparities, without sub-pixel refinement [default: True]"), "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= LINE), "{text}");
        assert!(signature(&Keyword::all()).starts_with("method='net', fusion=None, min_disparity=None, "));
    }

    #[test]
    fn refusals_name_keywords() {
        assert_eq!(refused(&["--theta=300"]), "theta is 300, which is not in 0..=255");
        assert_eq!(refused(&["--sgm-q1=0"]), "sgm_q1 is 0, it must be a number above 0");
        assert_eq!(refused(&["--upsample=5"]), "upsample is 5, it must be one of 1, 2, 3, 4");
        assert_eq!(refused(&["--sweeps=-1"]), "sweeps is -1, which is out of its range");
        assert!(refused(&["--method=sift"]).starts_with("method is sift, it must be one of bm, gc"));
        assert_eq!(refused(&["--prior", "--method=sgm"]), "prior cannot be used with method");
        assert_eq!(refused(&["--prior", "--confidence"]), "prior cannot be used with confidence");
        assert_eq!(refused(&["--auto-range", "--num-disparities=5"]), "auto_range cannot be used with num_disparities");
        assert_eq!(refused(&["--speckle-range=2"]), "speckle_window_size is missing, which another argument needs");
        assert!(refused(&["--simd=mmx"]).starts_with("simd is mmx, it must be one of "));
    }
}
