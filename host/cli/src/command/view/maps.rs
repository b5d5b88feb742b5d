//! Disparity maps for pages: those in files, and those that were just matched.

use std::{
    env, fs,
    path::{Path, PathBuf},
};

use multiscopic::{
    DisparityMap, Error, Method, Picture, Result,
    stereo::{BaselineRefinement, CostFunction, Pipeline, confidence_map::ConfidenceMap},
};
use multiscopic_core::SearchSpace;

use crate::{
    command::{limits::limits, options::SearchOptions, scene::TRUTH_FILE_NAME, terminal},
    report::{BlockCosts, ViewedMap},
};

/// A disparity map in a file.
pub struct MapFile {
    pub path: PathBuf,
    pub disparities: DisparityMap,
    pub confidences: Option<ConfidenceMap>,
}

impl MapFile {
    /// Reads a map, and its confidences if they are beside it.
    pub fn read(path: &Path) -> Result<MapFile> {
        let disparities = DisparityMap::from_float(&multiscopic::files::read_pfm_within(path, limits())?);
        let beside = path.with_file_name(format!("{}-confidence.png", stem(path)));
        let confidences = if beside.is_file() { confidences(&beside, &disparities)? } else { None };
        Ok(MapFile { path: path.into(), disparities, confidences })
    }

    /// The width and the height.
    pub fn size(&self) -> [usize; 2] {
        [self.disparities.width(), self.disparities.height()]
    }

    /// The map on a page in the folder of the file.
    pub fn viewed(&self) -> ViewedMap<'_> {
        ViewedMap {
            name: stem(&self.path),
            disparities: &self.disparities,
            confidences: self.confidences.as_ref(),
            metrics: None,
            reduction: None,
            parameters: Vec::new(),
            costs: None,
            file: self.path.file_name().map(|name| name.to_string_lossy().into_owned()),
        }
    }
}

/// The maps in a folder by name, those of `size` or of the size of the first one. Those of other sizes are named and left out.
pub fn read_all(folder: &Path, size: Option<[usize; 2]>) -> Result<Vec<MapFile>> {
    let unreadable = |source| Error::Read { path: folder.into(), source };
    let entries = fs::read_dir(folder).map_err(unreadable)?.collect::<std::io::Result<Vec<_>>>().map_err(unreadable)?;
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).filter(|path| is_map(path)).collect();
    paths.sort_unstable();
    let mut maps: Vec<MapFile> = Vec::new();
    for path in paths {
        let map = MapFile::read(&path)?;
        let [width, height] = size.or(maps.first().map(MapFile::size)).unwrap_or(map.size());
        if map.size() == [width, height] {
            maps.push(map);
        } else {
            let [w, h] = map.size();
            terminal::complain(&format!("{} is left out: it has {w}x{h} pixels, not {width}x{height}", path.display()));
        }
    }
    Ok(maps)
}

/// Returns true if a file is a disparity map other than the truth, by its name.
fn is_map(path: &Path) -> bool {
    let is_pfm = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("pfm"));
    is_pfm && !path.ends_with(TRUTH_FILE_NAME) && !stem(path).contains("depth")
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn confidences(path: &Path, map: &DisparityMap) -> Result<Option<ConfidenceMap>> {
    let gray = Picture::read_within(path, None, limits())?.to_gray();
    let (width, height) = (map.width(), map.height());
    let fits = gray.dimensions() == (width as u32, height as u32);
    Ok(fits.then(|| ConfidenceMap::new(width, height, gray.into_raw())))
}

/// A map that was matched, in a number of seconds if they were measured.
pub fn matched_map<'a>(
    name: String,
    method: (&str, &Method),
    search: &SearchSpace,
    (disparities, confidences): (&'a DisparityMap, Option<&'a ConfidenceMap>),
    seconds: Option<f64>,
) -> ViewedMap<'a> {
    let (method_name, method) = method;
    let block_size = match method.pipeline {
        Pipeline::BlockMatching { block_size } | Pipeline::SemiGlobal { cost: CostFunction::Sad { block_size }, .. } => {
            Some(block_size)
        }
        _ => None,
    };
    let is_exact =
        matches!(method.pipeline, Pipeline::BlockMatching { .. }) && BaselineRefinement::sets(search.views()).len() == 1;
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
