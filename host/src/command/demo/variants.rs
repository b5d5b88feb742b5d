//! What the demo compares, and what it calls it.

use multiscopic_core::{Fusion, Views};

use crate::command::{options::MethodName, variant::Variant};

/// Stereo first, the default for four views last. The heuristic rule is left out for two views, where it equals the mean.
pub static VARIANTS: [Variant; 6] = [
    variant(Views::STEREO, Fusion::Min),
    variant(Views::HORIZONTAL, Fusion::Min),
    variant(Views::HORIZONTAL, Fusion::Mean),
    variant(Views::CROSS, Fusion::Min),
    variant(Views::CROSS, Fusion::Mean),
    variant(Views::CROSS, Fusion::Heuristic),
];

const fn variant(views: Views, fusion: Fusion) -> Variant {
    Variant { method: MethodName::Bm, views, fusion }
}

/// The stem of a variant's files.
pub fn stem(variant: &Variant) -> String {
    match variant.views.len() {
        1 => "stereo".into(),
        views => format!("{views}-views-{}", variant.fusion.name()),
    }
}

/// The caption of a variant's pictures.
pub fn caption(variant: &Variant) -> String {
    match variant.views.len() {
        1 => "stereo: centre and right".into(),
        views => format!("multiscopic: {views} views, {}", variant.fusion.name()),
    }
}
