//! Lines of the tables by which options get controls on the page.

use std::collections::BTreeMap;

use serde::Serialize;

/// The options that are set, by name without dashes, and their values as on the command line. A flag has an empty one.
pub type Settings = BTreeMap<String, String>;

/// A line of a group's table: an option with a control on the page.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub option: &'static str,
    pub label: &'static str,
    pub slider: Option<Slider>,
    /// Returns true if the option has an effect beside these settings.
    pub applies: fn(&Settings) -> bool,
}

/// A slider for a number.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Slider {
    pub least: f64,
    pub most: f64,
    step: f64,
    /// Its position at first.
    pub start: f64,
    unset: Unset,
}

/// The meaning of leaving out an option.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Unset {
    /// It is always given.
    Never,
    /// The filter is off.
    Off,
    /// The method has a default.
    Default,
}

impl Entry {
    /// A list for an option whose values have names, or a box to tick for one with a single value or none.
    pub const fn list(option: &'static str, label: &'static str) -> Entry {
        Entry { option, label, slider: None, applies: |_| true }
    }

    /// A slider for a number.
    pub const fn slider(
        option: &'static str,
        label: &'static str,
        [least, most, step]: [f64; 3],
        start: f64,
        unset: Unset,
    ) -> Entry {
        let slider = Some(Slider { least, most, step, start, unset });
        Entry { option, label, slider, applies: |_| true }
    }

    /// The same, shown only where it has an effect.
    pub const fn if_(self, applies: fn(&Settings) -> bool) -> Entry {
        Entry { applies, ..self }
    }
}

/// The method among settings.
pub(crate) fn method(settings: &Settings) -> &str {
    settings.get("method").map_or("net", String::as_str)
}
