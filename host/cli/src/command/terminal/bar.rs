//! Progress bars.

use indicatif::{ProgressBar, ProgressStyle};

use super::messages;

/// A progress bar on standard error for `length` `steps` (a plural noun). It is hidden unless standard error is a terminal,
/// and if notes are left out.
pub fn progress(length: u64, steps: &str) -> ProgressBar {
    let bar = if messages::is_quiet() { ProgressBar::hidden() } else { ProgressBar::new(length) };
    bar.with_style(style(steps))
}

/// The style of a bar that counts `steps`.
pub fn style(steps: &str) -> ProgressStyle {
    let template = format!("{{bar:40}} {{pos}}/{{len}} {steps}, {{eta}} left {{msg}}");
    ProgressStyle::with_template(&template).expect("the template is valid")
}
