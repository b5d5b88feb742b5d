//! A match as a function in Rust.

use std::fmt::Write as _;

use multiscopic::{
    GraphCuts, SemiGlobal,
    stereo::{
        CostFunction, Pipeline,
        aggregation::Aggregation,
        cost::BirchfieldTomasi,
        refinement::{Refinement, Smoother, Speckles, TextureThreshold},
    },
};

use super::tuned_rig::TunedMatch;

/// A function that matches frames like `plan`. It needs the crates `multiscopic` and `multiscopic-core`.
pub fn of_match(plan: &TunedMatch) -> String {
    let TunedMatch { name, method, search } = plan;
    let refinement = method.refinement;
    let lines = refinement_lines(&refinement);
    let mut code = String::new();
    let mut line = |text: &str| {
        let _ = writeln!(code, "{text}");
    };
    let stereo = match (name, lines.iter().any(|line| line.contains("refinement::"))) {
        (&"net", false) => "",
        (&"net", true) => ", stereo::refinement",
        (_, false) => ", stereo",
        (_, true) => ", stereo, stereo::refinement",
    };
    line(&format!("use multiscopic::{{DisparityMap, Engine, Frames, Method, Result{stereo}}};"));
    line("use multiscopic_core::{Fusion, SearchConfig};");
    line("");
    line("/// The disparities of frames without distortion, by what `multiscopic tune` found.");
    line("pub fn disparities(frames: &Frames) -> Result<DisparityMap> {");
    line("    let [width, height] = frames.size().map(|side| side as u16);");
    let (fusion, least, count) = (search.fusion(), search.min_disparity(), search.num_disparities());
    let range = format!("min_disparity: {least}, num_disparities: {count}, ..SearchConfig::of_size(width, height)");
    line(&format!("    let range = SearchConfig {{ {range} }};"));
    line(&format!("    let search = SearchConfig {{ views: frames.views(), fusion: Fusion::{fusion:?}, ..range }}.checked()?;"));
    let mutable = if lines.is_empty() { "" } else { "mut " };
    pipeline(&method.pipeline).iter().for_each(|text| line(&format!("    {text}")));
    let made = if *name == "net" { "Method::net()" } else { "Method::new(pipeline)" };
    line(&format!("    let {mutable}method = {made};"));
    lines.iter().for_each(|text| line(&format!("    method.refinement.{text};")));
    line("    method.disparities(&Engine::new(None, 0)?, frames, &search, &())");
    line("}");
    code
}

/// The lines that make the pipeline: none for the network.
fn pipeline(pipeline: &Pipeline) -> Vec<String> {
    match pipeline {
        Pipeline::BlockMatching { block_size } => {
            vec![format!("let pipeline = stereo::Pipeline::BlockMatching {{ block_size: {block_size} }};")]
        }
        Pipeline::SemiGlobal { cost, paths: SemiGlobal { paths, penalties } } => {
            let cost = match cost {
                CostFunction::Sad { block_size } => format!("Sad {{ block_size: {block_size} }}"),
                CostFunction::Census(census) => format!("Census(multiscopic_core::Census::{census:?})"),
                CostFunction::TwoScaleCensus(census) => format!("TwoScaleCensus(multiscopic_core::Census::{census:?})"),
            };
            let (p1, p2, edge) = (penalties.p1(), penalties.p2(0), penalties.p2_edge());
            vec![
                format!("let penalties = multiscopic_core::PathPenalties::new({p1}, {p2}, {edge:?})?;"),
                format!("let paths = multiscopic::SemiGlobal {{ paths: stereo::Paths::{paths:?}, penalties }};"),
                format!("let cost = stereo::CostFunction::{cost};"),
                "let pipeline = stereo::Pipeline::SemiGlobal { cost, paths };".into(),
            ]
        }
        Pipeline::McCnn { network, aggregation: Aggregation { region, iterations }, penalties } => vec![
            "use stereo::{aggregation::*, cost::mccnn::*, optimization::edge_aware::Penalties};".into(),
            format!("let network = Box::new(Network::load(Architecture::{:?})?);", network.architecture()),
            format!("let aggregation = Aggregation {{ region: {region:?}, iterations: {iterations:?} }};"),
            format!("let penalties = {penalties:?};"),
            "let pipeline = stereo::Pipeline::McCnn { network, aggregation, penalties };".into(),
        ],
        Pipeline::GraphCuts { cost: BirchfieldTomasi { color }, cuts } => {
            let changes = graph_cuts_lines(cuts);
            let mut lines = vec![format!("let cost = stereo::cost::BirchfieldTomasi {{ color: {color} }};")];
            if changes.is_empty() {
                lines.push("let cuts = multiscopic::GraphCuts::default();".into());
            } else {
                lines.push("let cuts = multiscopic::GraphCuts {".into());
                lines.extend(changes.into_iter().map(|change| format!("    {change},")));
                lines.push("    ..multiscopic::GraphCuts::default()".into());
                lines.push("};".into());
            }
            lines.push("let pipeline = stereo::Pipeline::GraphCuts { cost, cuts };".into());
            lines
        }
        Pipeline::Network(_) => Vec::new(),
    }
}

/// The fields that differ from the defaults of graph cuts.
fn graph_cuts_lines(cuts: &GraphCuts) -> Vec<String> {
    let default = GraphCuts::default();
    let smoothness = format!("smoothness: stereo::optimization::graph_cuts::Smoothness::{:?}", cuts.smoothness);
    [
        (cuts.occlusion != default.occlusion).then(|| format!("occlusion: {:?}", cuts.occlusion)),
        (cuts.lambda != default.lambda).then(|| format!("lambda: {:?}", cuts.lambda)),
        (cuts.smoothness != default.smoothness).then_some(smoothness),
        (cuts.start_block_size != default.start_block_size).then(|| format!("start_block_size: {}", cuts.start_block_size)),
        (cuts.sweeps != default.sweeps).then(|| format!("sweeps: {}", cuts.sweeps)),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// A smoother that a method has.
fn smoother_code(smoother: Smoother) -> String {
    let values = if smoother == Smoother::REGIONAL { "REGIONAL" } else { "DEFAULT" };
    format!("Some(refinement::Smoother::{values})")
}

/// The fields of the refinement that are set.
fn refinement_lines(refinement: &Refinement) -> Vec<String> {
    let Refinement {
        uniqueness,
        left_right,
        texture,
        median,
        bilateral,
        speckles,
        sub_pixel,
        repair,
        min_confidence,
        smoother,
        fill,
    } = refinement;
    debug_assert!(bilateral.is_none(), "the page has no control of the bilateral filter");
    let texture = texture.map(|TextureThreshold { threshold, block_size }| {
        format!("texture = Some(refinement::TextureThreshold {{ threshold: {threshold}, block_size: {block_size} }})")
    });
    let speckles = speckles.map(|Speckles { window_size, range }| {
        format!("speckles = Some(refinement::Speckles {{ window_size: {window_size}, range: {range} }})")
    });
    [
        uniqueness.map(|percent| format!("uniqueness = Some({percent})")),
        left_right.map(|tolerance| format!("left_right = Some({tolerance})")),
        texture,
        median.map(|median| format!("median = Some(refinement::Median::new({})?)", median.size())),
        speckles,
        sub_pixel.map(|_| "sub_pixel = Some(refinement::LucasKanade)".into()),
        repair.map(|smoother| format!("repair = {}", smoother_code(smoother))),
        min_confidence.map(|least| format!("min_confidence = Some({least})")),
        smoother.map(|smoother| format!("smoother = {}", smoother_code(smoother))),
        fill.map(|_| "fill = Some(refinement::BackgroundFill)".into()),
    ]
    .into_iter()
    .flatten()
    .collect()
}
