//! What can be set on the page: options of `match`, with the values that its sliders and lists offer.

use std::collections::BTreeMap;

use multiscopic::{
    Error, Result,
    stereo::cost::mccnn::{Architecture, Weights},
};
use serde::Serialize;

/// The options that are set, by name without dashes, and their values as on the command line. A flag has an empty one.
pub type Settings = BTreeMap<String, String>;

/// An option of `match` on the page.
#[derive(Clone, Debug, Serialize)]
pub struct Control {
    option: &'static str,
    label: &'static str,
    group: &'static str,
    #[serde(flatten)]
    input: Input,
}

/// How its value is chosen.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "input", rename_all = "lowercase")]
enum Input {
    /// A number. `start` is where the slider stands at first.
    Slider { least: f64, most: f64, step: f64, start: f64, unset: Unset },
    /// One of these values. The first one is the default, and is not given.
    Choice { values: Vec<&'static str> },
    /// Given with this value, or not at all.
    Flag { value: &'static str },
}

/// What leaving the option out means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Unset {
    /// It is always given.
    Never,
    /// The filter is off.
    Off,
    /// The method has a default.
    Default,
}

/// The groups of the page.
const MATCHING: &str = "Matching";
const PATHS: &str = "Paths";
const CUTS: &str = "Graph cuts";
const FILTERS: &str = "Filters";

/// All controls, in the order in which the page shows them and the command names them.
pub fn all() -> Vec<Control> {
    let control = |group, option, label, input| Control { option, label, group, input };
    let slider = |[least, most, step]: [f64; 3], start, unset| Input::Slider { least, most, step, start, unset };
    let choice = |values: &[&'static str]| Input::Choice { values: values.to_vec() };
    vec![
        control(MATCHING, "method", "Method", Input::Choice { values: methods() }),
        control(MATCHING, "fusion", "Fusion", choice(&["default", "min", "mean", "heuristic", "half"])),
        control(MATCHING, "min-disparity", "Smallest disparity", slider([-128.0, 255.0, 1.0], 1.0, Unset::Never)),
        control(MATCHING, "num-disparities", "Number of disparities", slider([2.0, 256.0, 1.0], 60.0, Unset::Never)),
        control(MATCHING, "block-size", "Block size", slider([1.0, 21.0, 2.0], 11.0, Unset::Default)),
        control(PATHS, "cost", "Cost", choice(&["census", "census2", "sad"])),
        control(PATHS, "census", "Census window", choice(&["9x7", "7x7", "5x5"])),
        control(PATHS, "p1", "P1", slider([0.0, 51.0, 1.0], 8.0, Unset::Default)),
        control(PATHS, "p2", "P2", slider([0.0, 51.0, 1.0], 48.0, Unset::Default)),
        control(PATHS, "p2-edge", "P2 edge", slider([1.0, 255.0, 1.0], 10.0, Unset::Default)),
        control(PATHS, "paths", "Paths", choice(&["5", "4", "8"])),
        control(CUTS, "occlusion-cost", "Occlusion cost", slider([1.0, 60.0, 0.5], 10.0, Unset::Default)),
        control(CUTS, "lambda1", "Lambda 1", slider([0.5, 40.0, 0.5], 3.0, Unset::Default)),
        control(CUTS, "smoothness", "Smoothness", choice(&["linear", "potts"])),
        control(CUTS, "sweeps", "Sweeps", slider([1.0, 20.0, 1.0], 20.0, Unset::Default)),
        control(FILTERS, "uniqueness-ratio", "Uniqueness ratio, %", slider([0.0, 60.0, 1.0], 10.0, Unset::Off)),
        control(FILTERS, "disp12-max-diff", "Left-right check, px", slider([0.0, 16.0, 1.0], 1.0, Unset::Off)),
        control(FILTERS, "texture-threshold", "Texture threshold", slider([0.0, 4000.0, 10.0], 200.0, Unset::Off)),
        control(FILTERS, "median", "Median, px", slider([3.0, 31.0, 2.0], 5.0, Unset::Off)),
        control(FILTERS, "speckle-window-size", "Speckles up to, pixels", slider([10.0, 3000.0, 10.0], 200.0, Unset::Off)),
        control(FILTERS, "speckle-range", "Speckle range, px", slider([0.0, 16.0, 1.0], 1.0, Unset::Default)),
        control(FILTERS, "sub-pixel", "Sub-pixel step", choice(&["default", "lucas-kanade", "none"])),
        control(FILTERS, "repair", "Repair", choice(&["default", "smooth", "none"])),
        control(FILTERS, "min-confidence", "Least confidence", slider([0.0, 1.0, 0.01], 0.9, Unset::Off)),
        control(FILTERS, "smooth", "Smooth", Input::Flag { value: "" }),
        control(FILTERS, "fill", "Fill from the background", Input::Flag { value: "background" }),
    ]
}

/// The methods whose weights are here.
fn methods() -> Vec<&'static str> {
    let networks = [("mccnn-fast", Architecture::Fast), ("mccnn-accurate", Architecture::Accurate)];
    let installed = networks.into_iter().filter(|(_, architecture)| Weights::installed(*architecture).is_ok());
    ["bm", "sgm", "net", "gc"].into_iter().chain(installed.map(|(name, _)| name)).collect()
}

impl Control {
    /// The option's name, without dashes.
    pub fn option(&self) -> &'static str {
        self.option
    }

    /// Whether it has an effect beside these settings.
    pub fn applies(&self, settings: &Settings) -> bool {
        let setting = |option: &str| settings.get(option).map(String::as_str);
        let method = setting("method").unwrap_or("bm");
        let cost = setting("cost").unwrap_or("census");
        match (self.group, self.option) {
            (_, "block-size") => {
                matches!(method, "bm" | "gc") || method == "sgm" && cost == "sad" || setting("texture-threshold").is_some()
            }
            (_, "census") => method == "sgm" && cost != "sad",
            (PATHS, _) => method == "sgm",
            (CUTS, _) => method == "gc",
            (_, "uniqueness-ratio" | "disp12-max-diff") => !matches!(method, "gc" | "net"),
            (_, "speckle-range") => setting("speckle-window-size").is_some(),
            _ => true,
        }
    }

    /// The words of the command line that set it. Empty if it is not set.
    fn words(&self, settings: &Settings) -> Result<Vec<String>> {
        let Some(value) = settings.get(self.option) else { return Ok(Vec::new()) };
        let refused = |expected: String| Error::Usage(format!("{} is {value:.40}, it must be {expected}", self.option));
        let word = match &self.input {
            Input::Slider { least, most, .. } => {
                let is_within = value.parse().is_ok_and(|number: f64| (*least..=*most).contains(&number));
                if !is_within {
                    return Err(refused(format!("from {least} to {most}")));
                }
                value.as_str()
            }
            Input::Choice { values } => match values.iter().position(|known| known == value) {
                None => return Err(refused(format!("one of {}", values.join(", ")))),
                Some(0) if self.option != "method" => return Ok(Vec::new()),
                Some(index) => values[index],
            },
            Input::Flag { value } => value,
        };
        let option = format!("--{}", self.option);
        Ok(if word.is_empty() { vec![option] } else { vec![option, word.into()] })
    }
}

/// The words of `match` for settings. Those that have no effect are left out.
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
    use clap::CommandFactory;

    use super::*;
    use crate::command::live::tuning::tuned_options::TunedOptions;

    fn settings(pairs: &[(&str, &str)]) -> Settings {
        pairs.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
    }

    #[test]
    fn every_control_is_an_option_of_match() {
        let command = TunedOptions::command();
        for control in all() {
            assert!(command.get_arguments().any(|arg| arg.get_long() == Some(control.option)), "{}", control.option);
        }
    }

    #[test]
    fn every_value_that_is_offered_is_taken() {
        for method in ["bm", "sgm", "net", "gc"] {
            let base = [("method", method), ("cost", "sad"), ("speckle-window-size", "50")];
            for control in all().iter().filter(|control| control.option != "method") {
                let values: Vec<String> = match &control.input {
                    Input::Slider { least, most, start, .. } => [least, start, most].map(f64::to_string).into(),
                    Input::Choice { values } => values.iter().map(|value| value.to_string()).collect(),
                    Input::Flag { value } => vec![value.to_string()],
                };
                for value in values {
                    let mut settings = settings(&base);
                    settings.insert(control.option.into(), value);
                    let words = words(&all(), &settings).unwrap();
                    assert!(TunedOptions::parse(&words).is_ok(), "{words:?}");
                }
            }
        }
    }

    #[test]
    fn what_has_no_effect_is_left_out() {
        let words = |pairs: &[(&str, &str)]| words(&all(), &settings(pairs)).map(|words| words.join(" "));
        assert_eq!(words(&[("method", "net"), ("block-size", "7"), ("p1", "3")]).unwrap(), "--method net");
        let with_texture = words(&[("method", "net"), ("block-size", "7"), ("texture-threshold", "100")]).unwrap();
        assert_eq!(with_texture, "--method net --block-size 7 --texture-threshold 100");
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
            assert!(words(&all(), &settings(&[(name, value)])).is_err(), "{name} {value}");
        }
    }
}
