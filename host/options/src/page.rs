//! The controls of the page in the browser: options of `match`, with the values that its sliders and lists offer.

use clap::{Arg, Command, CommandFactory};
use multiscopic::{
    Error, Result,
    stereo::{
        MethodName,
        cost::mccnn::{Architecture, Weights},
    },
};
use serde::Serialize;

use crate::{
    matching::{MatchingCommand, MatchingOptions},
    methods::{GraphCutsOptions, SemiGlobalOptions},
    page_entry::{Entry, Slider},
    refinement::RefinementOptions,
    search::SearchOptions,
    value::possible_values,
};

pub use crate::page_entry::Settings;

/// An option of `match` on the page.
#[derive(Clone, Debug, Serialize)]
pub struct Control {
    option: &'static str,
    label: &'static str,
    group: &'static str,
    #[serde(flatten)]
    input: Input,
    #[serde(skip)]
    applies: fn(&Settings) -> bool,
}

/// The choice of a value.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "input", rename_all = "lowercase")]
enum Input {
    /// A number.
    Slider(Slider),
    /// One of these values. The first one is the default, and is not given.
    Choice { values: Vec<String> },
    /// Given with this value, or not at all.
    Flag { value: String },
}

/// Returns all controls, in the order in which the page shows them and the command names them.
pub fn controls() -> Vec<Control> {
    let command = MatchingCommand::command();
    let groups: [(&str, &[Entry]); 5] = [
        ("Matching", &MatchingOptions::ON_PAGE),
        ("Matching", &SearchOptions::ON_PAGE),
        ("Paths", &SemiGlobalOptions::ON_PAGE),
        ("Graph cuts", &GraphCutsOptions::ON_PAGE),
        ("Filters", &RefinementOptions::ON_PAGE),
    ];
    let entries = groups.into_iter().flat_map(|(group, entries)| entries.iter().map(move |entry| (group, entry)));
    entries.map(|(group, entry)| Control::new(group, entry, &command)).collect()
}

/// Returns true if the page can match by this method: it runs, and not only after something else has been installed.
fn is_ready(name: &str) -> bool {
    let architecture = match MethodName::ALL.into_iter().find(|method| method.name() == name) {
        Some(MethodName::MccnnFast) => Architecture::Fast,
        Some(MethodName::MccnnAccurate) => Architecture::Accurate,
        _ => return true,
    };
    Weights::installed(architecture).is_ok()
}

impl Control {
    fn new(group: &'static str, entry: &Entry, command: &Command) -> Control {
        let Entry { option, label, slider, applies } = *entry;
        let arg = command.get_arguments().find(|arg| arg.get_long() == Some(option));
        let arg = arg.unwrap_or_else(|| panic!("{option} is an option of match"));
        let input = slider.map_or_else(|| Input::of(arg), Input::Slider);
        Control { option, label, group, input, applies }
    }

    /// The option's name, without dashes.
    pub fn option(&self) -> &'static str {
        self.option
    }

    /// Returns true if it has an effect beside these settings.
    pub fn applies(&self, settings: &Settings) -> bool {
        (self.applies)(settings)
    }

    /// The words of the command line that set it. Empty if it is not set.
    fn words(&self, settings: &Settings) -> Result<Vec<String>> {
        let Some(value) = settings.get(self.option) else { return Ok(Vec::new()) };
        let refused = |expected: String| Error::Usage(format!("{} is {value:.40}, it must be {expected}", self.option));
        let word = match &self.input {
            Input::Slider(Slider { least, most, .. }) => {
                let is_within = value.parse().is_ok_and(|number: f64| (*least..=*most).contains(&number));
                if !is_within {
                    return Err(refused(format!("from {least} to {most}")));
                }
                value
            }
            Input::Choice { values } => match values.iter().position(|known| known == value) {
                None => return Err(refused(format!("one of {}", values.join(", ")))),
                Some(0) if self.option != "method" => return Ok(Vec::new()),
                Some(index) => &values[index],
            },
            Input::Flag { value } => value,
        };
        let option = format!("--{}", self.option);
        Ok(if word.is_empty() { vec![option] } else { vec![option, word.clone()] })
    }
}

impl Input {
    /// The choice that the command line offers.
    fn of(arg: &Arg) -> Input {
        let default = arg.get_default_values().first().map(|value| value.to_string_lossy().into_owned());
        let mut values = possible_values(arg);
        match (&default, &values[..]) {
            (None, []) => return Input::Flag { value: String::new() },
            (None, [only]) => return Input::Flag { value: only.clone() },
            _ => {}
        }
        values.retain(|value| Some(value) != default.as_ref() && (arg.get_id() != "method" || is_ready(value)));
        values.insert(0, default.unwrap_or("default".into()));
        Input::Choice { values }
    }
}

/// Returns the words of `match` for settings. Those that have no effect are left out.
///
/// # Errors
/// If there is no such control, or it does not offer the value.
pub fn words(controls: &[Control], settings: &Settings) -> Result<Vec<String>> {
    if let Some(unknown) = settings.keys().find(|name| controls.iter().all(|control| control.option != name.as_str())) {
        return Err(Error::Usage(format!("{unknown:.40} is none of the options on the page")));
    }
    let applying = controls.iter().filter(|control| control.applies(settings));
    Ok(applying.map(|control| control.words(settings)).collect::<Result<Vec<_>>>()?.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(pairs: &[(&str, &str)]) -> Settings {
        pairs.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
    }

    #[test]
    fn every_value_that_is_offered_is_taken() {
        for method in ["bm", "sgm", "net", "gc"] {
            let base = [("method", method), ("cost", "sad"), ("speckle-window-size", "50")];
            for control in controls().iter().filter(|control| control.option != "method") {
                let values: Vec<String> = match &control.input {
                    Input::Slider(Slider { least, most, start, .. }) => [least, start, most].map(f64::to_string).into(),
                    Input::Choice { values } => values.clone(),
                    Input::Flag { value } => vec![value.clone()],
                };
                for value in values {
                    let mut settings = settings(&base);
                    settings.insert(control.option.into(), value);
                    let words = words(&controls(), &settings).unwrap();
                    assert!(MatchingOptions::parse(&words).is_ok(), "{words:?}");
                }
            }
        }
    }

    #[test]
    fn what_has_no_effect_is_left_out() {
        let words = |pairs: &[(&str, &str)]| words(&controls(), &settings(pairs)).map(|words| words.join(" "));
        assert_eq!(words(&[("method", "net"), ("block-size", "7"), ("p1", "3")]).unwrap(), "--method net");
        let with_texture = words(&[("method", "sgm"), ("block-size", "7"), ("texture-threshold", "100")]).unwrap();
        assert_eq!(with_texture, "--method sgm --block-size 7 --texture-threshold 100");
        assert_eq!(words(&[("method", "sgm"), ("paths", "5"), ("fill", "x")]).unwrap(), "--method sgm --fill background");
    }

    #[test]
    fn only_what_is_offered_is_taken() {
        for (name, value) in [
            ("output", "/etc/passwd"),
            ("method", "--output"),
            ("num-disparities", "100000"),
            ("num-disparities", "nan"),
            ("fusion", "median"),
        ] {
            assert!(words(&controls(), &settings(&[(name, value)])).is_err(), "{name} {value}");
        }
    }

    #[test]
    fn choices_are_those_of_the_command_line_and_begin_with_the_default() {
        let values = |option: &str| {
            let control = controls().into_iter().find(|control| control.option == option).unwrap();
            match control.input {
                Input::Choice { values } => values.join(" "),
                Input::Flag { value } => format!("flag {value}"),
                Input::Slider(slider) => format!("slider from {} to {}", slider.least, slider.most),
            }
        };
        assert_eq!(values("fusion"), "default min mean heuristic half trimmed");
        assert_eq!(values("paths"), "5 4 8");
        assert_eq!(values("census"), "9x7 5x5 7x7");
        assert_eq!((values("smooth"), values("fill")), ("flag ".into(), "flag background".into()));
        assert_eq!(values("median"), "slider from 3 to 31");
        // MC-CNN is offered where its weights are installed.
        let methods = values("method").replace("mccnn-fast ", "").replace("mccnn-accurate ", "");
        assert!(methods.starts_with("net bm gc sgm"), "{methods}");
    }
}
