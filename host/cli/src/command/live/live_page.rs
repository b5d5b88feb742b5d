//! The page of `tune` and `live`.

use multiscopic::Processor;
use serde_json::json;

use super::tuning::Workbench;
use crate::{
    command::{options::Named, view::command_line},
    report::{LivePanel, Report},
};

const STYLE: &str = include_str!("page/panel.css");
const CAMERA: &str = include_str!("page/camera.html");
const TUNING: &str = include_str!("page/tuning.html");
const START: &str = include_str!("page/start.js");

/// The modules that others import, by name.
const MODULES: [(&str, &str); 3] = [
    ("live/camera.js", include_str!("page/camera.js")),
    ("live/link.js", include_str!("page/link.js")),
    ("live/tuning.js", include_str!("page/tuning.js")),
];

/// What is on the page.
#[derive(Clone, Copy, Debug)]
pub struct Page<'a> {
    pub title: &'a str,
    /// Whether there is a camera beside the matching.
    pub has_camera: bool,
}

impl Page<'_> {
    /// The page in HTML.
    pub fn html(self, bench: &Workbench) -> String {
        let processor = |processor: &Processor| json!({ "name": processor.name(), "clock_mhz": processor.clock_mhz() });
        let processors: Vec<_> = Processor::ALL.iter().map(processor).collect();
        let data = json!({ "controls": bench.controls(), "processors": processors });
        let camera = if self.has_camera { CAMERA } else { "" };
        let markup = format!("<div class=\"side\">{camera}{TUNING}</div>");
        let panel = LivePanel { markup: &markup, style: STYLE, modules: &MODULES, start: START, data };
        Report::new(self.title).live_viewer(&command_line(), panel).to_html()
    }
}
