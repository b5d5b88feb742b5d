//! Maps on pages, with what is known of how they were matched.

use std::env;

use multiscopic::{
    DisparityMap, Method,
    stereo::{CostFunction, LongBaselines, Optimizer, confidence_map::ConfidenceMap},
};
use multiscopic_core::Search;

use crate::{
    command::options::SearchOptions,
    report::{BlockCosts, ViewedMap},
};

/// A map that was matched, in a number of seconds if they were measured.
pub fn matched_map<'a>(
    name: String,
    method: (&str, &Method),
    search: &Search,
    (disparities, confidences): (&'a DisparityMap, Option<&'a ConfidenceMap>),
    seconds: Option<f64>,
) -> ViewedMap<'a> {
    let (method_name, method) = method;
    let block_size = match method.cost {
        CostFunction::Sad { block_size } => Some(block_size),
        _ => None,
    };
    let is_exact = method.optimizer == Optimizer::WinnerTakesAll
        && method.aggregation.is_none()
        && LongBaselines::sets(search.views()).len() == 1;
    let views: Vec<String> = search.views().iter().map(|view| view.to_string()).collect();
    let mut parameters = vec![
        ("method".to_owned(), method_name.to_owned()),
        ("views".into(), views.join(", ")),
        ("fusion".into(), search.fusion().name().into()),
        ("disparities".into(), format!("{} to {} px", search.min_disparity(), search.max_disparity())),
    ];
    parameters.extend(block_size.map(|side| ("block".into(), format!("{side} x {side}"))));
    parameters.extend(seconds.map(|seconds| ("time".into(), format!("{:.0} ms", 1e3 * seconds))));
    let costs =
        BlockCosts::new(search, block_size.unwrap_or(SearchOptions::DEFAULT_BLOCK_SIZE), is_exact && block_size.is_some());
    ViewedMap { name, disparities, confidences, metrics: None, reduction: None, parameters, costs: Some(costs), file: None }
}

/// The command line of this program, as a shell takes it.
pub fn command_line() -> String {
    shell_line(env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()))
}

/// A command line of this program with these words, as a shell takes it.
pub fn shell_line(words: impl Iterator<Item = String>) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./,=:+@%".contains(c);
    let quoted = |word: String| match !word.is_empty() && word.chars().all(is_plain) {
        true => word,
        false => format!("'{}'", word.replace('\'', r"'\''")),
    };
    std::iter::once("multiscopic".to_owned()).chain(words.map(quoted)).collect::<Vec<_>>().join(" ")
}
