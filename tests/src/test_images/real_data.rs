//! Real data sets and the published weights of MC-CNN, which are not in the repository.

use std::{
    env,
    path::{Path, PathBuf},
};

use multiscopic_reference::networks::file_name;

use crate::test_images::{ViewSet, read_grey, read_pfm};

/// The folder of the data: `$MULTISCOPIC_DATA`, or `../shared/data` beside the repository; `None` if neither
/// exists.
pub fn root() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    env::var_os("MULTISCOPIC_DATA").map(PathBuf::from).into_iter().chain([beside]).find(|path| path.is_dir())
}

/// A scene with its ground truth.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Its images.
    pub images: ViewSet,
    /// The true disparity of each pixel of the centre image; `None` where it is unknown.
    pub truth: Vec<Option<f64>>,
}

/// A data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dataset {
    /// Middlebury 2006 at third size.
    Middlebury2006Third,
    /// Middlebury 2005 at full size.
    Middlebury2005Full,
    /// Tsukuba's head and lamp.
    Tsukuba,
    /// The light fields of HCI.
    Hci4d,
}

impl Dataset {
    /// All data sets.
    pub const ALL: [Dataset; 4] = [Dataset::Middlebury2006Third, Dataset::Middlebury2005Full, Dataset::Tsukuba, Dataset::Hci4d];

    /// Its name on the command line and of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Dataset::Middlebury2006Third => "middlebury2006-third",
            Dataset::Middlebury2005Full => "middlebury2005-full",
            Dataset::Tsukuba => "tsukuba",
            Dataset::Hci4d => "hci4d",
        }
    }

    /// Reads a scene. Data sets of one scene ignore `scene`.
    pub fn read(self, root: &Path, scene: &str) -> Scene {
        let folder = root.join(self.name());
        match self {
            Dataset::Middlebury2006Third => middlebury(&folder.join(scene), 12.0),
            Dataset::Middlebury2005Full => middlebury(&folder.join(scene), 4.0),
            Dataset::Tsukuba => {
                let at = |row: u8, col: u8| folder.join(format!("scene1.row{row}.col{col}.ppm"));
                let views = [at(3, 2), at(3, 4), at(2, 3), at(4, 3)];
                let images = ViewSet::read(&at(3, 3), views.each_ref().map(|path| Some(path.as_path())));
                Scene { images, truth: read_truth(&folder.join("truedisp.row3.col3.pgm"), 16.0) }
            }
            Dataset::Hci4d => {
                let folder = folder.join(scene);
                let views = [36, 44, 4, 76].map(|n| folder.join(format!("input_Cam{n:03}.png")));
                let images = ViewSet::read(&folder.join("input_Cam040.png"), views.each_ref().map(|path| Some(path.as_path())));
                let truth = read_pfm(&folder.join("gt_disp_lowres.pfm")).2;
                Scene { images, truth: truth.into_iter().map(|step| Some(4.0 * f64::from(step))).collect() }
            }
        }
    }
}

fn middlebury(folder: &Path, greys_per_pixel: f64) -> Scene {
    let at = |name: &str| folder.join(name);
    let images = ViewSet::read(&at("view1.png"), [Some(&at("view0.png")), Some(&at("view2.png")), None, None]);
    Scene { images, truth: read_truth(&at("disp1.png"), greys_per_pixel) }
}

fn read_truth(path: &Path, greys_per_pixel: f64) -> Vec<Option<f64>> {
    let known = |grey| (grey > 0).then(|| f64::from(grey) / greys_per_pixel);
    read_grey(path).2.into_iter().map(known).collect()
}

/// RMS, AvgErr, Bad0.5, Bad1 and Bad2 over all pixels with known truth. An invalid
/// pixel counts as bad and as disparity 0.
pub fn errors(estimate: &[Option<f64>], truth: &[Option<f64>]) -> [f64; 5] {
    let known: Vec<(Option<f64>, f64)> = estimate.iter().zip(truth).filter_map(|(&d, &t)| Some((d, t?))).collect();
    let n = known.len() as f64;
    let error = |&(d, t): &(Option<f64>, f64)| (d.unwrap_or(0.0) - t).abs();
    let bad = |limit: f64| 100.0 * known.iter().filter(|pixel| pixel.0.is_none() || error(pixel) > limit).count() as f64 / n;
    let rms = (known.iter().map(|pixel| error(pixel).powi(2)).sum::<f64>() / n).sqrt();
    let average = known.iter().map(error).sum::<f64>() / n;
    [rms, average, bad(0.5), bad(1.0), bad(2.0)]
}

/// The folder of MC-CNN's weights: `$MULTISCOPIC_WEIGHTS`, the cache of `multiscopic weights install`, or
/// `../shared/weights` beside the repository, whichever has them first; `None` if none has.
pub fn weights() -> Option<PathBuf> {
    let given = env::var_os("MULTISCOPIC_WEIGHTS").map(PathBuf::from);
    let cache =
        env::var_os("XDG_CACHE_HOME").map(PathBuf::from).or_else(|| Some(Path::new(&env::var_os("HOME")?).join(".cache")));
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/weights");
    let folders = [given, cache.map(|cache| cache.join("multiscopic")), Some(beside)];
    let is_complete = |folder: &PathBuf| ["fast", "accurate"].iter().all(|name| folder.join(file_name(name)).is_file());
    folders.into_iter().flatten().find(is_complete)
}

/// The wheel of the Python package of MC-CNN, given by `$MULTISCOPIC_MCCNN_WHEEL`.
pub fn wheel() -> Option<PathBuf> {
    env::var_os("MULTISCOPIC_MCCNN_WHEEL").map(PathBuf::from)
}
