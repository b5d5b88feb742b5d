//! `multiscopic view`: a page to look at a rig, or at disparity maps.

use std::{
    env,
    ffi::{OsStr, OsString},
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::{Args, FromArgMatches};
use multiscopic::{
    DisparityMap, Error, FloatImage, Method, Picture, Result, Rig,
    files::{MatchedImages, output},
    stereo::{BaselineRefinement, CostFunction, MethodName, Pipeline, confidence_map::ConfidenceMap},
};
use multiscopic_core::{Frame, SearchSpace};

use super::{
    advice, limits,
    options::{
        BitsOption, EngineOptions, GeometryOptions, MethodOptions, Named, PreparationOptions, SearchOptions, Source, named,
        output_file,
    },
    preparation::{mask_unseen, prepare, read_disparities},
    scene::{TRUTH_FILE_NAME, truth_file},
    terminal,
};
use crate::report::{BlockCosts, Report, ViewedMap, ViewedScene};

/// Writes a page to look at a rig or at disparity maps, and opens it in a browser
///
/// The page has the pictures, the disparities in colour, depths, confidences, errors where the truth is known, the matching costs
/// of each view at a pixel, and the point cloud, to measure in. It is one file, which needs no network.
///
/// A captured folder is shown with the maps that are in it, OUT.pfm of `match` and its like; if there are none, it is matched.
/// NAME-confidence.png has the confidences of NAME.pfm, and truth.pfm is the truth. Files with "depth" in their names are left
/// out.
#[derive(Debug, Args)]
pub struct View {
    /// Captured folder with a rig.toml, a folder with disparity maps, or a disparity map: PFM, NPY, NPZ, TIFF, or 16-bit PNG
    #[arg(value_name = "RIG_DIR|DIR|FILE")]
    path: PathBuf,

    /// The page [default: view.html in the folder, or FILE.html beside FILE.pfm]
    #[arg(short, long, value_name = "OUT.html", value_parser = output_file::html())]
    output: Option<PathBuf>,

    /// Write the page, and do not open it; it is never opened unless messages go to a terminal
    #[arg(long)]
    no_open: bool,

    /// Methods by which a captured folder is matched [default: bm, if there are no maps in it]
    #[arg(long, value_parser = named::<MethodName>(), value_delimiter = ',', help_heading = "Matching")]
    methods: Vec<MethodName>,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    options: MethodOptions,

    #[command(flatten)]
    preparation: PreparationOptions,

    #[command(flatten)]
    geometry: GeometryOptions,

    #[command(flatten)]
    bits: BitsOption,

    #[command(flatten)]
    engine: EngineOptions,
}

/// A map that was matched for the page.
struct Matched {
    name: MethodName,
    method: Method,
    search: SearchSpace,
    disparities: DisparityMap,
    confidences: ConfidenceMap,
    seconds: f64,
}

impl View {
    /// The command that shows a folder that has just been captured, matched by blocks.
    pub fn of_capture(folder: &Path, page: &Path, search: &SearchOptions) -> View {
        let output = OsString::from_iter([OsStr::new("--output="), page.as_os_str()]);
        let words = [OsStr::new("view"), OsStr::new("--no-open"), &output, OsStr::new("--"), folder.as_os_str()];
        let matches = View::augment_args(clap::Command::new("view")).get_matches_from(words);
        let view = View::from_arg_matches(&matches).expect("the options have defaults");
        View { search: search.clone(), ..view }
    }

    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let folder = if self.path.ends_with(Rig::FILE_NAME) { self.path.parent() } else { Some(&*self.path) };
        let folder = folder.filter(|folder| folder.is_dir() || folder.as_os_str().is_empty());
        let output = self.output.clone().unwrap_or_else(|| match folder {
            Some(folder) => folder.join("view.html"),
            None => self.path.with_extension("html"),
        });
        let page = match folder {
            Some(folder) if Rig::file_in(folder).is_some() => self.rig(folder, &output)?,
            _ if !self.methods.is_empty() => {
                let path = self.path.display();
                return Err(Error::Usage(format!("--methods matches a captured folder, and {path} has no {}", Rig::FILE_NAME)));
            }
            Some(folder) => maps_page(folder, &output)?,
            None => {
                output::check(&[&output], &[&self.path])?;
                let map = MapFile::read(&self.path)?;
                let scene = ViewedScene::new(title(&self.path), map.size());
                page(&title(&self.path), scene, [map.viewed()])
            }
        };
        output::write(&output, |writer| writer.write_all(page.to_html().as_bytes()))?;
        terminal::say(&format!("open {}", output.display()));
        if !self.no_open {
            terminal::open(output.as_os_str());
        }
        Ok(ExitCode::SUCCESS)
    }

    /// The page of a captured folder.
    fn rig(&self, folder: &Path, output: &Path) -> Result<Report> {
        let mut source = Source::of_rig(folder, None, &self.bits)?;
        output::check(&[output], &source.paths().collect::<Vec<_>>())?;
        let (mut frames, _, undistortion) = source.load()?;
        let mut geometry = self.geometry.geometry(source.rig.as_ref(), source.lens.as_ref(), &frames)?;
        let (size, views) = (frames.size(), frames.views());
        let search = |range| self.search.search(size, views, None, range);
        let ways = (&self.preparation, self.search.range_source(&self.preparation));
        let preparation = prepare(ways, &source, undistortion.as_ref(), &mut frames, &mut geometry, &self.engine.memory, search)?;
        // Maps in files are of the frames as they were.
        let files = if preparation.alignment.is_some() { Vec::new() } else { read_maps(folder, Some(size))? };
        output::check(&[output], &files.iter().map(|map| &*map.path).collect::<Vec<_>>())?;
        let images = MatchedImages { center: &source.images.center, size, seen: preparation.inspection.corner_disparities() };
        let truth = truth(folder, &images)?.map(|truth| preparation.truth(truth));
        let methods = if self.methods.is_empty() && files.is_empty() { &[MethodName::Bm][..] } else { &self.methods };
        let engine = self.engine.engine()?;
        let mut matched = Vec::new();
        for &name in methods {
            let search = preparation.search;
            let method = self.options.method(name, self.search.block_size, views.len())?;
            let start = Instant::now();
            let (method, seen) = preparation.suited(method, frames.clone());
            let (mut disparities, mut confidences) = method.disparities_and_confidences(&engine, &seen, &search, &())?;
            let seconds = start.elapsed().as_secs_f64();
            mask_unseen(undistortion.as_ref(), &mut disparities, Some(&mut confidences));
            for warning in advice::warnings(&preparation, &disparities, &search) {
                terminal::warn(&format!("{}: {warning}", name.name()));
            }
            matched.push(Matched { name, method, search, disparities, confidences, seconds });
        }
        let scene = ViewedScene::new(title(folder), size)
            .with_geometry(geometry.as_ref())
            .with_frames(&frames, frames.color(Frame::Center))
            .with_truth(truth.as_ref());
        let maps = matched.iter().map(|Matched { name, method, search, disparities, confidences, seconds }| {
            matched_map(name.name().into(), (name.name(), method), search, (disparities, Some(confidences)), Some(*seconds))
        });
        let blocks = self.search.block_size.unwrap_or(SearchOptions::DEFAULT_BLOCK_SIZE);
        let costs = BlockCosts::new(&preparation.search, blocks, false);
        let files = files.iter().map(|file| ViewedMap { costs: Some(costs.clone()), ..file.viewed() });
        Ok(page(&title(folder), scene, maps.chain(files)))
    }
}

/// The page of a folder with maps.
fn maps_page(folder: &Path, output: &Path) -> Result<Report> {
    let maps = read_maps(folder, None)?;
    output::check(&[output], &maps.iter().map(|map| &*map.path).collect::<Vec<_>>())?;
    let Some(first) = maps.first() else {
        return Err(Error::Format {
            path: folder.into(),
            found: "a folder without disparity maps".into(),
            expected: format!("a captured folder with a {}, or files that `multiscopic match -o` writes", Rig::FILE_NAME),
        });
    };
    let truth = truth(folder, &MatchedImages { center: &first.path, size: first.size(), seen: None })?;
    let scene = ViewedScene::new(title(folder), first.size()).with_truth(truth.as_ref());
    Ok(page(&title(folder), scene, maps.iter().map(MapFile::viewed)))
}

fn page<'a>(title: &str, mut scene: ViewedScene, maps: impl IntoIterator<Item = ViewedMap<'a>>) -> Report {
    maps.into_iter().for_each(|map| scene.add(map));
    Report::new(title).viewer(&command_line(), &[scene])
}

/// The true disparities of images in a folder, if they are there.
pub fn truth(folder: &Path, images: &MatchedImages<'_>) -> Result<Option<FloatImage>> {
    truth_file(folder).map(|path| read_disparities(&path, Some(images))).transpose()
}

/// The last part of a path, or the path.
pub fn title(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// A disparity map in a file.
struct MapFile {
    path: PathBuf,
    disparities: DisparityMap,
    confidences: Option<ConfidenceMap>,
}

impl MapFile {
    /// Reads a map, and its confidences if they are beside it.
    fn read(path: &Path) -> Result<MapFile> {
        let disparities = DisparityMap::from_float(&read_disparities(path, None)?);
        let beside = path.with_file_name(format!("{}-confidence.png", stem(path)));
        let confidences = if beside.is_file() { confidences(&beside, &disparities)? } else { None };
        Ok(MapFile { path: path.into(), disparities, confidences })
    }

    /// The width and the height.
    fn size(&self) -> [usize; 2] {
        [self.disparities.width(), self.disparities.height()]
    }

    /// The map on a page in the folder of the file.
    fn viewed(&self) -> ViewedMap<'_> {
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
fn read_maps(folder: &Path, size: Option<[usize; 2]>) -> Result<Vec<MapFile>> {
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
    let is_written = ["pfm", "npy", "npz"].iter().any(|end| output_file::ends_in(path, end));
    is_written && !path.ends_with(TRUTH_FILE_NAME) && !stem(path).contains("depth")
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
