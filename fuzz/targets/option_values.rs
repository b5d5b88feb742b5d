//! Values of options on the command line.

#![no_main]

use std::{fmt::Display, str::FromStr};

use libfuzzer_sys::fuzz_target;
use multiscopic::{
    Dataset,
    capture::{Accuracy, stage::StageSpec},
    evaluation::CameraSteps,
    images::{ImageRegion, Layout},
};
use multiscopic_core::View;
// Without libFuzzer, it has the entry point.
use multiscopic_fuzz as _;

/// Parses a value. What is accepted is accepted again as it is printed.
fn parse<T: FromStr + Display>(text: &str) {
    if let Ok(value) = text.parse::<T>() {
        let printed = value.to_string();
        assert!(printed.parse::<T>().is_ok_and(|again| again.to_string() == printed), "{text:?} is printed as {printed:?}");
    }
}

fuzz_target!(|text: &str| {
    parse::<View>(text);
    parse::<Dataset>(text);
    parse::<Layout>(text);
    parse::<StageSpec>(text);
    let _ = text.parse::<CameraSteps>();
    let _ = text.parse::<ImageRegion>();
    let _ = text.parse::<Accuracy>();
});
