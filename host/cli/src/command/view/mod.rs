//! `multiscopic view`: a page to look at a rig, or at disparity maps.

mod maps;

use std::{
    ffi::{OsStr, OsString},
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::{Args, FromArgMatches};
use multiscopic::{
    DisparityMap, Error, FloatImage, Method, Result, Rig,
    evaluation::ground_truth,
    files::output,
    stereo::{MethodName, confidence_map::ConfidenceMap},
};
use multiscopic_core::{Frame, SearchSpace};

use self::maps::MapFile;
#[cfg(feature = "live")]
pub use self::maps::shell_line;
pub use self::maps::{command_line, matched_map};
use super::{
    advice,
    limits::limits,
    options::{
        BitsOption, EngineOptions, GeometryOptions, MethodOptions, Named, PreparationOptions, SearchOptions, Source, named,
        output_file,
    },
    preparation::{mask_unseen, prepare},
    scene::truth_file,
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
    /// Captured folder with a rig.toml, a folder with disparity maps, or a disparity map
    #[arg(value_name = "RIG_DIR|DIR|FILE.pfm")]
    path: PathBuf,

    /// The page [default: view.html in the folder, or FILE.html beside FILE.pfm]
    #[arg(short, long, value_name = "OUT.html", value_parser = output_file::html)]
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
            Some(folder) if folder.join(Rig::FILE_NAME).is_file() => self.rig(folder, &output)?,
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
        let preparation =
            prepare(&self.preparation, &source, undistortion.as_ref(), &mut frames, &mut geometry, &self.engine.memory, search)?;
        // Maps in files are of the frames as they were.
        let files = if preparation.alignment.is_some() { Vec::new() } else { maps::read_all(folder, Some(size))? };
        output::check(&[output], &files.iter().map(|map| &*map.path).collect::<Vec<_>>())?;
        let truth = truth(folder, size, &source.images.center)?.map(|truth| preparation.truth(truth));
        let methods = if self.methods.is_empty() && files.is_empty() { &[MethodName::Bm][..] } else { &self.methods };
        let engine = self.engine.engine()?;
        let mut matched = Vec::new();
        for &name in methods {
            let method = self.options.method(name, self.search.block_size, views.len())?;
            let search = preparation.search;
            let start = Instant::now();
            let (mut disparities, mut confidences) = method.disparities_and_confidences(&engine, &frames, &search, &())?;
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
    let maps = maps::read_all(folder, None)?;
    output::check(&[output], &maps.iter().map(|map| &*map.path).collect::<Vec<_>>())?;
    let Some(first) = maps.first() else {
        return Err(Error::Format {
            path: folder.into(),
            found: "a folder without disparity maps".into(),
            expected: format!("a captured folder with a {}, or PFM files as `multiscopic match -o` writes them", Rig::FILE_NAME),
        });
    };
    let truth = truth(folder, first.size(), &first.path)?;
    let scene = ViewedScene::new(title(folder), first.size()).with_truth(truth.as_ref());
    Ok(page(&title(folder), scene, maps.iter().map(MapFile::viewed)))
}

fn page<'a>(title: &str, mut scene: ViewedScene, maps: impl IntoIterator<Item = ViewedMap<'a>>) -> Report {
    maps.into_iter().for_each(|map| scene.add(map));
    Report::new(title).viewer(&command_line(), &[scene])
}

/// The true disparities in a folder, if they are there. `center` has their size.
pub fn truth(folder: &Path, size: [usize; 2], center: &Path) -> Result<Option<FloatImage>> {
    truth_file(folder).map(|path| ground_truth::read_pfm(&path, size, center, limits())).transpose()
}

/// The last part of a path, or the path.
pub fn title(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}
