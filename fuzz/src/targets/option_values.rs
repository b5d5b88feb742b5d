//! Values of options on the command line.

use arbitrary::{Arbitrary, Unstructured};
use std::{fmt::Display, str::FromStr};

use multiscopic::{
    Dataset,
    capture::{Accuracy, stage::StageSpec},
    evaluation::CameraSteps,
    images::{ImageRegion, Layout},
};
use multiscopic_core::View;

/// Parses a value. What is accepted is accepted again as it is printed.
fn parse<T: FromStr + Display>(text: &str) {
    if let Ok(value) = text.parse::<T>() {
        let printed = value.to_string();
        assert!(printed.parse::<T>().is_ok_and(|again| again.to_string() == printed), "{text:?} is printed as {printed:?}");
    }
}

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let Ok(text) = <&str>::arbitrary_take_rest(Unstructured::new(bytes)) else { return false };
    parse::<View>(text);
    parse::<Dataset>(text);
    parse::<Layout>(text);
    parse::<StageSpec>(text);
    let _ = text.parse::<CameraSteps>();
    let _ = text.parse::<ImageRegion>();
    let _ = text.parse::<Accuracy>();
    true
}
