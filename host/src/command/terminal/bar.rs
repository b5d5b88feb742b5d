//! Progress bars.

use indicatif::{ProgressBar, ProgressStyle};

/// A progress bar on standard error for `length` `steps` (a plural noun). It is hidden unless standard error is a terminal.
pub fn progress(length: u64, steps: &str) -> ProgressBar {
    ProgressBar::new(length).with_style(style(steps))
}

/// The style of a bar that counts `steps`.
pub fn style(steps: &str) -> ProgressStyle {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {steps}, {{eta}} left {{msg}}");
    ProgressStyle::with_template(&template).expect("the template is valid")
}
