//! Values of options: numbers, checked as they are parsed, and values that are chosen by name.

use std::ops::RangeInclusive;

use clap::{
    Arg,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};
use multiscopic::{
    Dataset, Error, Geometry, LensModel, Processor, Result,
    images::{Colormap, PointFrame},
};
use multiscopic_core::Fusion;

/// Parses a finite number.
pub fn finite(text: &str) -> Result<f64> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| Error::Usage("it must be a number".into()))
}

/// Parses a positive number.
pub fn positive(text: &str) -> Result<f64> {
    finite(text).ok().filter(|number| *number > 0.0).ok_or_else(|| Error::Usage("it must be a number above 0".into()))
}

/// Parses a length of a camera or its stage, in pixels or millimetres.
pub fn length(text: &str) -> Result<f64> {
    let most = Geometry::MAX_LENGTH;
    let length = positive(text).ok().filter(|length| *length <= most);
    length.ok_or_else(|| Error::Usage(format!("it must be a number above 0 and at most {most}")))
}

/// Parses two numbers, separated by a comma.
pub fn point(text: &str) -> Result<[f64; 2]> {
    match text.split_once(',').map(|(cx, cy)| (finite(cx), finite(cy))) {
        Some((Ok(cx), Ok(cy))) => Ok([cx, cy]),
        _ => Err(Error::Usage("it must be two numbers, as 319.5,239.5".into())),
    }
}

/// Parses a width and a height in pixels.
pub fn size(text: &str) -> Result<[u32; 2]> {
    let side = |text: &str| text.parse().ok().filter(|side| *side > 0);
    let sides = text.split_once('x').and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| Error::Usage("it must be a width and a height, as 640x480".into()))
}

/// Returns a length of at least one micrometre and at most a metre in whole micrometres. `option` names it in errors.
pub fn micrometres(option: &str, millimetres: f64) -> Result<u32> {
    let micrometres = (1000.0 * millimetres).round();
    if !(1.0..=1e6).contains(&micrometres) {
        return Err(Error::Usage(format!("{option} is {millimetres} mm, it must be from 0.001 to 1000")));
    }
    Ok(micrometres as u32)
}

/// Parses a whole number above 0.
pub fn count(text: &str) -> Result<u64> {
    let number = text.trim().parse().ok().filter(|number| *number > 0);
    number.ok_or_else(|| Error::Usage("it must be a whole number above 0".into()))
}

/// Parses a probability.
pub fn probability(text: &str) -> Result<f64> {
    let probability = text.parse().ok().filter(|probability| (0.0..=1.0).contains(probability));
    probability.ok_or_else(|| Error::Usage("it must be a number from 0 to 1".into()))
}

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
            Fusion::Trimmed => "The mean of all or of the best few, for sgm with the census and net: quiet and sharp",
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
            Processor::CortexM0Plus => "Armv6-M, by the portable kernel",
            Processor::Rv32imac => "RISC-V, by the portable kernel",
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

impl Named for PointFrame {
    const ALL: &'static [PointFrame] = &[PointFrame::Camera, PointFrame::Tool, PointFrame::Base];

    fn name(&self) -> &'static str {
        PointFrame::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            PointFrame::Camera => "The camera's where it took the centre: x to the right, y down, z ahead",
            PointFrame::Tool => "That of the tool that carries the camera; needs --hand-eye",
            PointFrame::Base => "That of the arm's base; needs --hand-eye, and a rig.toml with the pose of the tool",
        }
    }
}

impl Named for LensModel {
    /// Those that `calibrate lens` finds.
    const ALL: &'static [LensModel] = &[LensModel::PlumbBob, LensModel::Rational, LensModel::Equidistant];

    fn name(&self) -> &'static str {
        LensModel::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            LensModel::PlumbBob => "Brown and Conrady's, for most lenses",
            LensModel::Rational => "With a denominator, for wide angles",
            LensModel::ThinPrism => "With a thin prism and a tilted sensor as well",
            LensModel::Equidistant => "Kannala and Brandt's, for fisheyes",
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use multiscopic::stereo::MethodName;

    use super::*;

    #[test]
    fn numbers() {
        assert_eq!(point("319.5, -2").unwrap(), [319.5, -2.0]);
        assert_eq!(positive("1e3").unwrap(), 1000.0);
        assert_eq!([probability("0").unwrap(), probability("0.9").unwrap()], [0.0, 0.9]);
        assert!(["-0.1", "1.1", "nan", "90 %"].iter().all(|text| probability(text).is_err()));
        assert_eq!(size("640x480").unwrap(), [640, 480]);
        assert!(["640", "x", "0x1", "1x-1", "axb"].iter().all(|text| size(text).is_err()));
        assert_eq!(length("1e7").unwrap(), 1e7);
        assert!(["0", "1e300", "inf"].iter().all(|text| length(text).is_err()));
        assert!(["0", "-1", "inf", "nan", "", "1x"].iter().all(|text| positive(text).is_err()));
        assert!(["1", "1,", "1,2,3", "a,b", "inf,1"].iter().all(|text| point(text).is_err()));
        assert_eq!(micrometres("--baseline", 20.0005).unwrap(), 20_001);
        assert!([0.0004, 1001.0, f64::INFINITY].iter().all(|&mm| micrometres("--baseline", mm).is_err()));
    }

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
