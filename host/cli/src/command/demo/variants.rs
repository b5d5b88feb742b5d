//! The variants that the demo compares, and their names.

use multiscopic::{
    Error, Result,
    images::Layout,
    stereo::{BaselineRefinement, MethodName},
};
use multiscopic_core::{Fusion, View, Views};

use crate::command::{options::views_of_count, variant::Variant};

/// Stereo, and all rules for two and four views. The heuristic rule is left out for two views, where it equals the mean.
const NEAREST: [(Views, Fusion); 6] = [
    (Views::STEREO, Fusion::Min),
    (Views::HORIZONTAL, Fusion::Min),
    (Views::HORIZONTAL, Fusion::Mean),
    (Views::CROSS, Fusion::Min),
    (Views::CROSS, Fusion::Mean),
    (Views::CROSS, Fusion::Heuristic),
];

/// Returns the variants of a layout that also stands at longer `baselines`: stereo first, the default for all views last.
pub fn variants(layout: Layout, baselines: &[u8]) -> Result<Vec<Variant>> {
    let nearest = layout.views();
    if !nearest.contains(View::RIGHT) {
        return Err(Error::Usage(format!("--layout is {layout}: it needs a view to the right, for the comparison with stereo")));
    }
    let variant = |layout: Option<Layout>, views: Views, fusion| Variant { method: MethodName::Bm, layout, views, fusion };
    let mut variants: Vec<Variant> = NEAREST
        .into_iter()
        .filter(|(views, _)| views.iter().all(|view| nearest.contains(view)))
        .map(|(views, fusion)| variant(None, views, fusion))
        .collect();
    let named = (!views_of_count(nearest.len()).is_ok_and(|same| same == nearest)).then_some(layout);
    let mut longer = baselines.to_vec();
    longer.sort_unstable();
    longer.dedup();
    longer.retain(|multiple| *multiple != 1);
    for count in 0..=longer.len() {
        let mut views = nearest;
        for (view, &multiple) in nearest.iter().flat_map(|view| longer[..count].iter().map(move |multiple| (view, multiple))) {
            let most = View::MAX_OFFSET;
            let further = view.times(multiple).ok_or_else(|| {
                Error::Usage(format!("--baselines includes {multiple}, at which {layout} leaves 1 to {most} baselines"))
            })?;
            if !views.contains(further) && views.len() == Views::MAX {
                let most = Views::MAX;
                return Err(Error::Usage(format!("the layout {layout} has more than {most} views at all of --baselines")));
            }
            views = views.with(further);
        }
        let default = variant(named, views, default_fusion(MethodName::Bm, views));
        variants.retain(|variant| *variant != default);
        variants.push(default);
    }
    Ok(variants)
}

/// The other methods, with all views at the shortest baseline. Graph cuts do not take as many as the others.
pub fn other_methods(layout: Layout) -> Vec<Variant> {
    let views = layout.views();
    let takes_all = |method: &MethodName| *method != MethodName::Gc || views.len() <= Views::MAX_MATCHED;
    let methods = [MethodName::Net, MethodName::Sgm, MethodName::Gc].into_iter().filter(takes_all);
    methods.map(|method| Variant { method, layout: None, views, fusion: default_fusion(method, views) }).collect()
}

/// Returns true if a variant has the rule that its views have by default.
pub fn is_default(variant: &Variant) -> bool {
    variant.fusion == default_fusion(variant.method, variant.views)
}

fn default_fusion(method: MethodName, views: Views) -> Fusion {
    method.default_fusion(BaselineRefinement::shortest(views).len())
}

/// The stem of a variant's files.
pub fn stem(variant: &Variant) -> String {
    let (layout, baselines) = (variant.layout.map(|layout| format!("-{layout}")).unwrap_or_default(), baselines(variant, "-"));
    match variant.views.len() {
        _ if variant.method != MethodName::Bm => variant.method.name().into(),
        1 => "stereo".into(),
        views => format!("{views}-views-{}{layout}{}", variant.fusion.name(), prefixed("-baselines-", &baselines)),
    }
}

/// The caption of a variant's pictures.
pub fn caption(variant: &Variant) -> String {
    match variant.views.len() {
        views if variant.method != MethodName::Bm => {
            format!("{}: {views} views, {}", variant.method.name(), variant.fusion.name())
        }
        1 => "stereo: centre and right".into(),
        views => format!("multiscopic: {views} views, {}{}", variant.fusion.name(), place(variant)),
    }
}

/// The variant's method and views in a few words.
pub fn label(variant: &Variant) -> String {
    format!("{} {}", variant.method.name(), heading(variant))
}

/// The variant's views in a few words.
pub fn heading(variant: &Variant) -> String {
    match variant.views.len() {
        1 => "stereo".into(),
        views => format!("{views} views{}", place(variant)),
    }
}

/// Describes the places of the views, if they are not clear from their number.
fn place(variant: &Variant) -> String {
    let layout = variant.layout.map(|layout| format!(", {layout}")).unwrap_or_default();
    layout + &prefixed(", baselines ", &baselines(variant, " "))
}

fn baselines(variant: &Variant, separator: &str) -> String {
    variant.baselines().iter().map(u8::to_string).collect::<Vec<_>>().join(separator)
}

/// `text` after `prefix`, unless there is no text.
fn prefixed(prefix: &str, text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("{prefix}{text}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stems(layout: &str, baselines: &[u8]) -> Vec<String> {
        variants(layout.parse().unwrap(), baselines).unwrap().iter().map(stem).collect()
    }

    #[test]
    fn the_default_of_all_views_is_last() {
        let nearest = ["stereo", "2-views-min", "2-views-mean", "4-views-min", "4-views-mean", "4-views-heuristic"];
        assert_eq!(stems("cross", &[]), nearest);
        assert_eq!(stems("cross", &[1]), nearest);
        assert_eq!(stems("3x3", &[])[..6], nearest);
        assert_eq!(stems("3x3", &[])[6..], ["8-views-half"]);
        assert_eq!(stems("1x3", &[]), ["stereo", "2-views-mean", "2-views-min"]);
        assert_eq!(stems("1x3", &[5, 1, 3, 3])[3..], ["4-views-min-baselines-1-3", "6-views-min-baselines-1-3-5"]);
        assert_eq!(stems("3x3", &[2])[7..], ["16-views-half-baselines-1-2"]);
        assert_eq!(stems("3x5", &[])[6..], ["14-views-half-3x5"]);
        assert_eq!(stems("1x5", &[])[3..], ["4-views-min-1x5-baselines-1-2"]);
    }

    #[test]
    fn what_cannot_be_rendered_or_compared_is_refused() {
        let refused = |layout: &str, baselines: &[u8]| variants(layout.parse().unwrap(), baselines).unwrap_err().to_string();
        assert!(refused("5x1", &[]).contains("to the right"));
        assert!(refused("cross", &[17]).contains("--baselines includes 17"));
        assert!(refused("cross", &[0]).contains("--baselines includes 0"));
        assert!(refused("1x5", &[9]).contains("leaves 1 to 16"));
        assert!(refused("5x5", &[3]).contains("more than 24"));
    }
}
