//! Values that are chosen by name.

use std::ops::RangeInclusive;

use clap::{
    Arg,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};
use multiscopic::{Dataset, LensModel, Processor, images::Colormap};
use multiscopic_core::Fusion;

/// A type with few values, each of which has a name on the command line.
pub trait Named: Clone + Send + Sync + 'static {
    /// Every value, in the order in which `--help` lists them.
    const ALL: &'static [Self];

    /// The name on the command line.
    fn name(&self) -> &'static str;

    /// The text of `--help` about it.
    fn about(&self) -> &'static str;
}

/// Parses the name of a value. `--help` and errors list all names.
pub fn named<T: Named>() -> impl TypedValueParser<Value = T> {
    let values = T::ALL.iter().map(|value| PossibleValue::new(value.name()).help(value.about()));
    PossibleValuesParser::new(values).map(|name| {
        let value = T::ALL.iter().find(|value| value.name() == name);
        value.expect("the parser admits the listed names alone").clone()
    })
}

/// The numbers of one digit, as text.
const DIGITS: [&str; 10] = ["0", "1", "2", "3", "4", "5", "6", "7", "8", "9"];

/// Parses one of a few whole numbers below 10. Errors list all of them.
pub(crate) fn one_of(numbers: RangeInclusive<u8>) -> impl TypedValueParser<Value = u8> {
    let names = PossibleValuesParser::new(numbers.map(|number| DIGITS[usize::from(number)]));
    names.map(|name| name.parse().expect("the parser admits the listed numbers alone"))
}

/// The names of the values that an option takes. Empty if it takes others.
pub(crate) fn possible_values(arg: &Arg) -> Vec<String> {
    if !arg.get_action().takes_values() {
        return Vec::new();
    }
    arg.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect()
}

impl Named for Fusion {
    const ALL: &'static [Fusion] = &Fusion::ALL;

    fn name(&self) -> &'static str {
        Fusion::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Fusion::Min => "The least cost of the views: sharp at occlusions",
            Fusion::Mean => "The mean cost of the views: quiet",
            Fusion::Heuristic => "The mean of the two or three least costs (the paper's rule for four views)",
            Fusion::Half => "The mean of the least half of the costs, rounded up: for arrays of views",
        }
    }
}

impl Named for Colormap {
    const ALL: &'static [Colormap] = &Colormap::ALL;

    fn name(&self) -> &'static str {
        Colormap::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Colormap::Turbo => "Far is blue, near is red: shows the smallest steps",
            Colormap::Viridis => "Far is violet, near is yellow: evenly brighter, and clear to the colour-blind",
            Colormap::Gray => "Far is dark, near is white: prints well",
        }
    }
}

impl Named for Processor {
    const ALL: &'static [Processor] = &Processor::ALL;

    fn name(&self) -> &'static str {
        Processor::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Processor::CortexM4 => "Armv7E-M with DSP instructions",
            Processor::CortexM7 => "Armv7E-M with DSP instructions, two instructions at a time",
            Processor::CortexM33 => "Armv8-M with DSP instructions",
            Processor::CortexM55 => "Armv8.1-M with vectors",
        }
    }
}

impl Named for Dataset {
    const ALL: &'static [Dataset] = &Dataset::ALL;

    fn name(&self) -> &'static str {
        Dataset::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            Dataset::Middlebury2006Third => "Middlebury 2006 at a third of its size: three views in a row",
            Dataset::Middlebury2005Full => "Middlebury 2005 at full size: three views in a row",
            Dataset::Tsukuba => "Tsukuba's head and lamp: one scene, an array of 5x5 views",
            Dataset::Hci4d(_) => "The HCI's 4D light fields: arrays of 9x9 cameras, of which every fourth is used by default",
        }
    }
}

impl Named for LensModel {
    const ALL: &'static [LensModel] = &LensModel::ALL;

    fn name(&self) -> &'static str {
        LensModel::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            LensModel::PlumbBob => "Brown and Conrady's, for most lenses",
            LensModel::Rational => "With a denominator, for wide angles",
            LensModel::Equidistant => "Kannala and Brandt's, for fisheyes",
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use multiscopic::stereo::MethodName;

    fn names<T: Named>() -> Vec<&'static str> {
        T::ALL.iter().map(Named::name).collect()
    }

    #[test]
    fn no_two_values_of_a_type_share_a_name() {
        for names in [names::<Fusion>(), names::<Processor>(), names::<Dataset>(), names::<MethodName>(), names::<Colormap>()] {
            assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "{names:?}");
        }
    }
}
