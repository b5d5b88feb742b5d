//! What a page has beside its viewer if a server answers it.

use serde_json::Value;

/// Controls beside a viewer, whose scenes and maps come from a server.
#[derive(Clone, Debug)]
pub struct LivePanel<'a> {
    /// The controls in HTML.
    pub markup: &'a str,
    /// Their style.
    pub style: &'static str,
    /// The modules of their scripts, by the names that they are imported by. `viewer/app.js` shows scenes and maps.
    pub modules: &'a [(&'a str, &'a str)],
    /// The script that starts them.
    pub start: &'a str,
    /// What the scripts find in the element `panel-data`, as JSON.
    pub data: Value,
}
