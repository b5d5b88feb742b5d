//! Scenes to look at on a page: pictures, disparities, depths, confidences, errors, costs and points. See
//! [`Report::viewer`](super::Report::viewer). The viewer is markup, data, and modules, which an import map gives names to.

mod compact;
mod viewed_scene;

use base64::{Engine, engine::general_purpose::STANDARD};
use maud::{Markup, PreEscaped, html};
use multiscopic::images::Colormap;
use serde_json::{Map, Value, json};

pub use self::viewed_scene::{BlockCosts, EncodedMap, SweepStep, ViewedMap, ViewedScene};

pub(super) const STYLE: &str = include_str!("page/viewer.css");
const CONTROLS: &str = include_str!("page/viewer.html");
const START: &str = r#"import { openFirst } from "viewer/app.js";

await openFirst();
"#;

/// The modules that others import, by name.
const MODULES: [(&str, &str); 9] = [
    ("viewer/app.js", include_str!("page/app.js")),
    ("viewer/cloud.js", include_str!("page/cloud.js")),
    ("viewer/color.js", include_str!("page/color.js")),
    ("viewer/costs.js", include_str!("page/costs.js")),
    ("viewer/numbers.js", include_str!("page/numbers.js")),
    ("viewer/panes.js", include_str!("page/panes.js")),
    ("viewer/plots.js", include_str!("page/plots.js")),
    ("viewer/readout.js", include_str!("page/readout.js")),
    ("viewer/slice.js", include_str!("page/slice.js")),
];

/// The viewer of scenes, of which there is at least one. `command` made the page.
pub(super) fn markup(command: &str, scenes: &[ViewedScene]) -> Markup {
    html! { (viewer(command, scenes, &[])) (start(START)) }
}

/// The viewer beside a panel, whose scripts tell it what to show. `command` started the server.
pub(super) fn live_markup(command: &str, panel: &LivePanel<'_>) -> Markup {
    html! {
        div class="workbench" {
            (PreEscaped(panel.markup))
            div class="results" { (viewer(command, &[], panel.modules)) }
        }
        script type="application/json" id="panel-data" { (script(&panel.data)) }
        (start(panel.start))
    }
}

/// The script with which a page starts.
fn start(source: &str) -> Markup {
    html! { script type="module" { (PreEscaped(source)) } }
}

/// The controls, the data and the modules, to which others may be added.
fn viewer(command: &str, scenes: &[ViewedScene], modules: &[(&str, &str)]) -> Markup {
    let address = |source: &str| Value::from(format!("data:text/javascript;base64,{}", STANDARD.encode(source)));
    let imports: Map<String, Value> =
        MODULES.iter().chain(modules).map(|(name, source)| ((*name).to_owned(), address(source))).collect();
    let palette =
        |color: &dyn Fn(f64) -> [u8; 3]| STANDARD.encode((0..256).flat_map(|i| color(f64::from(i) / 255.0)).collect::<Vec<u8>>());
    let data = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "command": command,
        "palettes": {
            "disparity": palette(&|t| Colormap::Turbo.color(t)),
            "confidence": palette(&|t| Colormap::Viridis.color(t)),
            "error": palette(&|t| colorous::INFERNO.eval_continuous(t).as_array()),
        },
        "scenes": scenes,
    });
    html! {
        (PreEscaped(CONTROLS))
        script type="importmap" { (script(&json!({ "imports": imports }))) }
        script type="application/json" id="viewer-data" { (script(&data)) }
    }
}

/// JSON that cannot end its script element.
fn script(value: &Value) -> PreEscaped<String> {
    PreEscaped(value.to_string().replace('<', "\\u003c"))
}

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
    /// The data that the scripts find in the element `panel-data`, as JSON.
    pub data: Value,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_end_their_script() {
        let scenes = [ViewedScene::new("</script><b>", [1, 1])];
        let html = markup("multiscopic view '</script>'", &scenes).into_string();
        assert_eq!(html.matches("</script>").count(), 3);
        assert!(!html.contains("<b>") && html.contains("\\u003c/script>\\u003cb>"), "{html}");
    }

    #[test]
    fn every_module_that_is_imported_is_there() {
        let names = MODULES.map(|(name, _)| name);
        for source in MODULES.map(|(_, source)| source).into_iter().chain([START]) {
            for import in source.lines().filter_map(|line| line.strip_prefix("import ")?.split('"').nth(1)) {
                assert!(names.contains(&import), "{import}");
            }
        }
        assert!(START.contains("\"viewer/app.js\"") && names.contains(&"viewer/app.js"));
    }
}
