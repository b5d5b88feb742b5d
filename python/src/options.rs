//! The keyword arguments of matching: the options of `multiscopic match`, with `_` for `-`, as `multiscopic_options` describes
//! them.

use multiscopic::{Alignment, DisparityMap, Engine, Error, Frames, Method, RangeSource, Result, images::BitDepth};
use multiscopic_core::SearchSpace;
use multiscopic_options::{
    Keywords,
    keywords::{Keyword, Kind, in_python},
};
use pyo3::{
    exceptions::{PyOverflowError, PyTypeError, PyValueError},
    prelude::*,
    types::PyDict,
};

use crate::{arrays::PriorArray, interpreter::exception};

/// The values of the keyword arguments.
pub struct Options {
    keywords: Keywords,
    prior: Option<PriorArray>,
    confidence: Option<bool>,
    /// The names of those that differ from their defaults.
    given: Vec<String>,
}

/// Those that a sweep obeys.
const OF_SWEEPS: [&str; 9] =
    ["auto_range", "bits", "inspection", "max_memory", "min_confidence", "min_disparity", "num_disparities", "simd", "threads"];

impl Options {
    /// Reads the options that a call gives.
    pub fn new(given: Option<&Bound<'_, PyDict>>) -> PyResult<Options> {
        let all = Keyword::all();
        let (mut words, mut names, mut prior, mut confidence) = (Vec::new(), Vec::new(), None, None);
        for (name, value) in given.into_iter().flatten() {
            let name: String = name.extract()?;
            let Some(keyword) = all.iter().find(|keyword| keyword.name == name) else {
                return Err(PyTypeError::new_err(format!("there is no keyword argument {name}")));
            };
            if value.is_none() {
                continue;
            }
            let refused = |error| refusal(&name, &value, error);
            let (option, before) = (keyword.option.clone(), words.len());
            match keyword.kind {
                Kind::Array => {
                    prior = Some(value.extract().map_err(refused)?);
                    words.push(option);
                }
                Kind::Flag { given } => {
                    let flag: bool = value.extract().map_err(refused)?;
                    confidence = if name == "confidence" { Some(flag) } else { confidence };
                    words.extend((flag == given).then_some(option));
                }
                _ => {
                    let text = text(&keyword.kind, &value).map_err(refused)?;
                    words.extend((!keyword.is_default(&text)).then(|| option + "=" + &text));
                }
            }
            names.extend((words.len() > before).then_some(name));
        }
        Ok(Options { keywords: Keywords::parse(&words).map_err(exception)?, prior, confidence, given: names })
    }

    /// Returns those of a range of disparities alone.
    pub fn of_range(min_disparity: Option<i16>, num_disparities: Option<u16>) -> Result<Options> {
        let least = min_disparity.map(|least| format!("--min-disparity={least}"));
        let count = num_disparities.map(|count| format!("--num-disparities={count}"));
        let words: Vec<String> = [least, count].into_iter().flatten().collect();
        Ok(Options { keywords: Keywords::parse(&words)?, prior: None, confidence: None, given: Vec::new() })
    }

    /// Refuses those that sweeps do not obey.
    pub fn check_sweep(&self) -> Result<()> {
        let unheeded = self.given.iter().find(|name| !OF_SWEEPS.contains(&&***name));
        unheeded.map_or(Ok(()), |name| Err(Error::Usage(format!("{name} has no effect on the frames of a sweep: leave it out"))))
    }

    /// Returns the least confidence of the disparities that are kept, if it is given.
    pub fn min_confidence(&self) -> Option<u8> {
        self.keywords.matching.min_confidence()
    }

    /// Returns true if the views are rectified before they are matched.
    pub fn aligns(&self) -> bool {
        self.keywords.preparation.align
    }

    /// Returns true if the images are inspected before they are matched.
    pub fn inspects(&self) -> bool {
        !self.keywords.preparation.no_inspection
    }

    /// Returns the source of the range of disparities.
    pub fn range_source(&self) -> RangeSource {
        self.keywords.matching.search.range_source(&self.keywords.preparation)
    }

    /// Returns the number of bits of 16 that carry values, if it is given.
    pub fn bits(&self) -> Option<BitDepth> {
        self.keywords.bits.bits
    }

    /// Returns the disparities to search around.
    pub fn prior(&self) -> Option<&DisparityMap> {
        self.prior.as_ref().map(|PriorArray(map)| map)
    }

    /// Returns true if confidences are asked for.
    pub fn has_confidence(&self) -> bool {
        self.confidence.unwrap_or(true)
    }

    /// Returns the engine.
    pub fn engine(&self) -> Result<Engine> {
        self.keywords.engine.engine()
    }

    /// Refuses to align `frames` if that takes more memory than it may.
    pub fn check_alignment(&self, frames: &Frames) -> Result<()> {
        Alignment::check_memory(frames, self.keywords.engine.memory.most_bytes())
    }

    /// Returns the search in `frames`. `range` is the smallest disparity and their number, unless options override them.
    pub fn search(&self, frames: &Frames, range: (i16, u16)) -> Result<SearchSpace> {
        self.keywords.matching.search(frames.size(), frames.views(), range)
    }

    /// Returns the method, for matches with the views of `frames`.
    pub fn method(&self, frames: &Frames) -> Result<Method> {
        let method = match self.prior {
            Some(_) => self.keywords.matching.method_around_prior(frames.views()),
            None => self.keywords.matching.method(frames.views()),
        };
        method.map_err(|error| match error {
            Error::Usage(message) => Error::Usage(in_python(&message)),
            other => other,
        })
    }
}

/// Writes a value as on the command line.
fn text(kind: &Kind, value: &Bound<'_, PyAny>) -> PyResult<String> {
    let number = |value: &Bound<'_, PyAny>| value.extract::<f64>().map(|number| number.to_string());
    match kind {
        Kind::Integer | Kind::IntegerOf(_) => {
            let integer = value.py().import("operator")?.call_method1("index", (value,))?;
            Ok(integer.str()?.to_string())
        }
        Kind::Number => number(value),
        Kind::NumberOr(_) => value.extract().or_else(|_| number(value)),
        Kind::Pair => value.extract().map(|(first, second): (f64, f64)| format!("{first},{second}")),
        Kind::Text | Kind::Word(_) => value.extract(),
        Kind::Flag { .. } | Kind::Array => unreachable!("flags and arrays have no text"),
    }
}

/// Names the keyword in an error about its type. Numbers that do not fit are wrong values, as those are that are refused later.
fn refusal(keyword: &str, value: &Bound<'_, PyAny>, error: PyErr) -> PyErr {
    let py = value.py();
    if error.is_instance_of::<PyOverflowError>(py) {
        return PyValueError::new_err(format!("{keyword} is {value}, which is out of its range"));
    }
    if error.is_instance_of::<PyTypeError>(py) {
        return PyTypeError::new_err(format!("{keyword} is {value}: {}", error.value(py)));
    }
    error
}
