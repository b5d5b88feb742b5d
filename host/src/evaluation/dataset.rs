//! Public data sets with known disparities.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
    str::FromStr,
};

use image::DynamicImage;
use multiscopic_core::Views;

use crate::{
    error::{Error, Result},
    files::{FrameFiles, image_codec, input},
    images::{FloatImage, Frames, Picture},
};

/// A data set: where its images are, how its ground truth is written, and what disparities it has.
///
/// | name | centre / left / right / top / bottom | ground truth |
/// | --- | --- | --- |
/// | `middlebury2006-third` | `view1` / `view0` / `view2` / - / - | `disp1.png`, grey / 12, 0 = unknown |
/// | `middlebury2005-full` | the same | `disp1.png`, grey / 4, 0 = unknown |
/// | `tsukuba` | `scene1.rowR.colC`, R.C = 3.3 / 3.2 / 3.4 / 2.3 / 4.3 | `truedisp.row3.col3.pgm`, grey / 16, 0 = unknown |
/// | `hci4d` | `input_CamN`, N = 040 / 036 / 044 / 004 / 076 | `gt_disp_lowres.pfm`, per camera step, and there are 4 |
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dataset {
    /// Middlebury 2006 at a third of its size: three views in a row.
    Middlebury2006Third,
    /// Middlebury 2005 at its full size: three views in a row.
    Middlebury2005Full,
    /// The head and lamp of Tsukuba: a grid of cameras, and one scene.
    Tsukuba,
    /// The 4D light fields of the HCI: a grid of 9 x 9 cameras, of which every fourth is used.
    Hci4d,
}

impl Dataset {
    /// All that are known.
    pub const ALL: [Dataset; 4] = [Dataset::Middlebury2006Third, Dataset::Middlebury2005Full, Dataset::Tsukuba, Dataset::Hci4d];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Dataset::Middlebury2006Third => "middlebury2006-third",
            Dataset::Middlebury2005Full => "middlebury2005-full",
            Dataset::Tsukuba => "tsukuba",
            Dataset::Hci4d => "hci4d",
        }
    }

    /// The neighbours that each of its scenes has.
    pub const fn views(self) -> Views {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => Views::HORIZONTAL,
            Dataset::Tsukuba | Dataset::Hci4d => Views::ALL,
        }
    }

    /// The cost of an occlusion in graph cuts, in intensities: 10 for good photographs (the paper). It is found from the images where they are
    /// rendered, without noise: what is wrong there costs less.
    pub const fn occlusion_cost(self) -> Option<f64> {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full | Dataset::Tsukuba => Some(10.0),
            Dataset::Hci4d => None,
        }
    }

    /// The range that holds its disparities: a minimum and a number.
    pub const fn range(self) -> (i16, u16) {
        match self {
            Dataset::Middlebury2006Third => (1, 20),
            Dataset::Middlebury2005Full => (1, 60),
            Dataset::Tsukuba => (1, 18),
            Dataset::Hci4d => (-8, 17),
        }
    }

    /// The scenes in `directory`, by name: the data set's own folder with a folder for each scene, one of these, or the folder that
    /// has the data set's under its name.
    ///
    /// # Errors
    /// If a folder cannot be read or there is no scene.
    pub fn scenes(self, directory: &Path) -> Result<Vec<Scene>> {
        let own = Scene::new(self, directory);
        if own.exists() {
            return Ok(vec![own]);
        }
        let named = directory.join(self.name());
        let folder = if named.is_dir() { &named } else { directory };
        // Tsukuba's one scene is its folder.
        let own = Scene::new(self, folder);
        if own.exists() {
            return Ok(vec![own]);
        }
        let failed = |source| Error::Read { path: folder.into(), source };
        let mut scenes = Vec::new();
        for entry in fs::read_dir(folder).map_err(failed)? {
            let scene = Scene::new(self, &entry.map_err(failed)?.path());
            if scene.exists() {
                scenes.push(scene);
            }
        }
        scenes.sort_by(|a, b| a.name.cmp(&b.name));
        if scenes.is_empty() {
            let files: Vec<_> = self.images().paths().map(|path| path.display().to_string()).collect();
            let expected = format!("folders with {} and {}", files.join(", "), self.truth_file());
            return Err(Error::format(folder, format!("no scene of {self}"), expected));
        }
        Ok(scenes)
    }

    /// The images of a scene, in its folder.
    fn images(self) -> FrameFiles {
        let [center, left, right, top, bottom] = match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => ["view1.png", "view0.png", "view2.png", "", ""],
            Dataset::Tsukuba => [
                "scene1.row3.col3.ppm",
                "scene1.row3.col2.ppm",
                "scene1.row3.col4.ppm",
                "scene1.row2.col3.ppm",
                "scene1.row4.col3.ppm",
            ],
            Dataset::Hci4d => {
                ["input_Cam040.png", "input_Cam036.png", "input_Cam044.png", "input_Cam004.png", "input_Cam076.png"]
            }
        };
        let file = |name: &str| (!name.is_empty()).then(|| name.into());
        FrameFiles { center: center.into(), left: file(left), right: file(right), top: file(top), bottom: file(bottom) }
    }

    /// The ground truth of a scene, in its folder.
    const fn truth_file(self) -> &'static str {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => "disp1.png",
            Dataset::Tsukuba => "truedisp.row3.col3.pgm",
            Dataset::Hci4d => "gt_disp_lowres.pfm",
        }
    }

    /// Reads disparities as this data set writes them.
    fn read_truth(self, path: &Path) -> Result<FloatImage> {
        match self {
            Dataset::Middlebury2006Third => read_gray(path, 12.0),
            Dataset::Middlebury2005Full => read_gray(path, 4.0),
            Dataset::Tsukuba => read_gray(path, 16.0),
            // Between the cameras of this grid there are four steps.
            Dataset::Hci4d => Ok(FloatImage::read_pfm(path)?.map(|step| 4.0 * step)),
        }
    }
}

impl fmt::Display for Dataset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Dataset {
    type Err = Error;

    fn from_str(name: &str) -> Result<Dataset> {
        Dataset::ALL.into_iter().find(|dataset| dataset.name() == name).ok_or_else(|| {
            let names = Dataset::ALL.map(Dataset::name).join(", ");
            Error::Usage(format!("{name} is no data set that is known, these are: {names}"))
        })
    }
}

/// A scene of a data set: its files.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The data set that it is of.
    pub dataset: Dataset,
    /// Its name, which is that of its folder.
    pub name: String,
    /// Its images.
    pub images: FrameFiles,
    /// Its ground truth.
    pub truth: PathBuf,
}

impl Scene {
    fn new(dataset: Dataset, folder: &Path) -> Scene {
        // The folder's own name, even if it is given as `.`.
        let named = folder.canonicalize().unwrap_or_else(|_| folder.into());
        let name = match dataset {
            Dataset::Tsukuba => dataset.name().into(),
            _ => named.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        };
        Scene { dataset, name, images: dataset.images().within(folder), truth: folder.join(dataset.truth_file()) }
    }

    /// Whether any file of it is there, so that one that is missing is noticed.
    fn exists(&self) -> bool {
        self.images.paths().chain([self.truth.as_path()]).any(Path::exists)
    }

    /// Reads its images, with the centre in its colours, and the true disparities in pixels, +inf where they are not known.
    ///
    /// # Errors
    /// If a file cannot be read or is not what it should be, if sizes differ, or if no disparity is known.
    pub fn load(&self) -> Result<(Frames, Picture, FloatImage)> {
        let (frames, center) = Frames::load(&self.images)?;
        let truth = self.dataset.read_truth(&self.truth)?;
        let ((w, h), (width, height)) = ((truth.width(), truth.height()), (frames.width(), frames.height()));
        if (w, h) != (width, height) {
            let expected = format!("{width}x{height} as in {}", self.images.center.display());
            return Err(Error::format(&self.truth, format!("disparities of {w}x{h} pixels"), expected));
        }
        if !truth.pixels().iter().any(|d| d.is_finite()) {
            return Err(Error::format(&self.truth, "no pixel with a disparity", "the ground truth of the centre image"));
        }
        Ok((frames, center, truth))
    }
}

/// Disparities times `scale` in a grey image of 8 bits, 0 where they are not known.
fn read_gray(path: &Path, scale: f32) -> Result<FloatImage> {
    let gray = match image_codec::decode(path, &input::read(path)?)? {
        DynamicImage::ImageLuma8(gray) => gray,
        other => {
            let found = format!("an image of {:?}", other.color());
            return Err(Error::format(path, found, "disparities in a grey image of 8 bits (L8)"));
        }
    };
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    let disparity = |&gray: &u8| if gray == 0 { f32::INFINITY } else { f32::from(gray) / scale };
    Ok(FloatImage::new(width, height, gray.as_raw().iter().map(disparity).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::{Frame, View};

    fn write_gray(path: PathBuf, pixels: &[u8]) {
        fs::write(path, [format!("P5 {} 1 255\n", pixels.len()).as_bytes(), pixels].concat()).unwrap();
    }

    /// A scene of `dataset` in `folder` with images of `width` x 1 pixels.
    fn make(dataset: Dataset, folder: &Path, width: usize, truth: &[u8]) {
        fs::create_dir_all(folder).unwrap();
        for (grey, path) in dataset.images().paths().enumerate() {
            write_gray(folder.join(path), &vec![grey as u8; width]);
        }
        match dataset {
            Dataset::Hci4d => fs::write(folder.join(dataset.truth_file()), truth).unwrap(),
            _ => write_gray(folder.join(dataset.truth_file()), truth),
        }
    }

    fn names(dataset: Dataset, directory: &Path) -> Vec<String> {
        dataset.scenes(directory).unwrap().into_iter().map(|scene| scene.name).collect()
    }

    fn message(dataset: Dataset, directory: &Path) -> String {
        dataset.scenes(directory).and_then(|scenes| scenes[0].load()).unwrap_err().to_string()
    }

    #[test]
    fn names_are_read_as_they_are_written() {
        assert!(Dataset::ALL.iter().all(|dataset| dataset.to_string().parse::<Dataset>().unwrap() == *dataset));
        let message = "middlebury".parse::<Dataset>().unwrap_err().to_string();
        assert!(message.contains("middlebury2006-third, middlebury2005-full, tsukuba, hci4d"), "{message}");
        assert!(Dataset::ALL.iter().all(|dataset| dataset.images().views() == dataset.views()));
    }

    #[test]
    fn scenes_are_found_from_any_folder() {
        let dir = tempfile::tempdir().unwrap();
        let third = dir.path().join("middlebury2006-third");
        make(Dataset::Middlebury2006Third, &third.join("Wood1"), 2, &[0, 12]);
        make(Dataset::Middlebury2006Third, &third.join("Aloe"), 2, &[0, 12]);
        fs::create_dir(third.join("results")).unwrap();
        fs::write(third.join("README"), "").unwrap();
        make(Dataset::Tsukuba, &dir.path().join("tsukuba"), 2, &[16, 0]);

        assert_eq!(names(Dataset::Middlebury2006Third, &third), ["Aloe", "Wood1"]);
        assert_eq!(names(Dataset::Middlebury2006Third, dir.path()), ["Aloe", "Wood1"]);
        assert_eq!(names(Dataset::Middlebury2006Third, &third.join("Aloe")), ["Aloe"]);
        assert_eq!(names(Dataset::Middlebury2006Third, &third.join("Aloe/../Wood1/.")), ["Wood1"]);
        assert_eq!(names(Dataset::Tsukuba, dir.path()), ["tsukuba"]);
        assert_eq!(names(Dataset::Tsukuba, &dir.path().join("tsukuba")), ["tsukuba"]);

        let none = message(Dataset::Hci4d, dir.path());
        assert!(none.contains("found no scene of hci4d, expected folders with input_Cam040.png, "), "{none}");
        let none = message(Dataset::Hci4d, &dir.path().join("none"));
        assert!(none.starts_with(&format!("cannot read {}: ", dir.path().join("none").display())), "{none}");
    }

    #[test]
    fn ground_truth_is_in_pixels() {
        let signed = [&b"Pf 3 1 -1\n"[..], [0.25f32, -1.5, 0.0].map(f32::to_le_bytes).as_flattened()].concat();
        let inf = f32::INFINITY;
        let cases: [(Dataset, &[u8], [f32; 3]); 4] = [
            (Dataset::Middlebury2006Third, &[0, 12, 255], [inf, 1.0, 21.25]),
            (Dataset::Middlebury2005Full, &[0, 1, 240], [inf, 0.25, 60.0]),
            (Dataset::Tsukuba, &[0, 80, 224], [inf, 5.0, 14.0]),
            (Dataset::Hci4d, &signed, [1.0, -6.0, 0.0]),
        ];
        for (dataset, file, expected) in cases {
            let dir = tempfile::tempdir().unwrap();
            make(dataset, dir.path(), 3, file);
            let (frames, center, truth) = dataset.scenes(dir.path()).unwrap()[0].load().unwrap();
            assert_eq!(truth.pixels(), expected, "{dataset}");
            assert_eq!(center.dimensions(), (3, 1));
            let frame = |frame| frames.get(frame).map(|image| image.as_raw()[0]);
            assert_eq!(frame(Frame::Center), Some(0));
            let views: Vec<u8> = View::ALL.into_iter().filter_map(|view| frame(Frame::View(view))).collect();
            assert!(views.into_iter().eq(1..=dataset.views().len() as u8), "{dataset}");
        }
    }

    #[test]
    fn says_what_is_wrong_with_a_scene() {
        let dir = tempfile::tempdir().unwrap();
        let dataset = Dataset::Middlebury2005Full;
        make(dataset, dir.path(), 3, &[0, 4]);
        let wrong = message(dataset, dir.path());
        assert!(wrong.contains("disp1.png: found disparities of 2x1 pixels, expected 3x1 as in"), "{wrong}");
        make(dataset, dir.path(), 3, &[0, 0, 0]);
        assert!(message(dataset, dir.path()).contains("disp1.png: found no pixel with a disparity"));
        fs::write(dir.path().join("disp1.png"), b"P6 1 1 255\n123").unwrap();
        assert!(message(dataset, dir.path()).contains("disp1.png: found an image of Rgb8"));
        fs::remove_file(dir.path().join("view2.png")).unwrap();
        assert!(message(dataset, dir.path()).contains("view2.png"));
    }
}
