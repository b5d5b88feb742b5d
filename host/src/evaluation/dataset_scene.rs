//! The scenes of a data set, found and read, and their ground truth.

use std::{
    fs,
    path::{Path, PathBuf},
};

use image::DynamicImage;
use multiscopic_core::Views;

use super::dataset::Dataset;
use crate::{
    error::{Error, Result},
    files::{FrameFiles, Limits, MatchedImages, decoded::Decoded, image_codec::CodedFile},
    images::{FloatImage, Frames, Picture},
};

/// The files of one scene of a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetScene {
    /// The data set to which the scene belongs.
    pub dataset: Dataset,
    /// The name of the scene, which is that of its folder.
    pub name: String,
    /// The folder of its files.
    pub folder: PathBuf,
}

impl DatasetScene {
    fn new(dataset: Dataset, folder: &Path) -> DatasetScene {
        // A path such as `.` has no name of its own.
        let named = folder.canonicalize().unwrap_or_else(|_| folder.into());
        let name = match dataset {
            Dataset::Tsukuba => dataset.name().into(),
            _ => named.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        };
        DatasetScene { dataset, name, folder: folder.into() }
    }

    /// The image files of the centre and `views`.
    pub fn images(&self, views: Views) -> FrameFiles {
        self.dataset.images(views).within(&self.folder)
    }

    /// The ground truth file.
    pub fn truth(&self) -> PathBuf {
        self.folder.join(self.dataset.truth_file())
    }

    /// Returns true if any of the files exists. A scene with a missing file counts, so that loading it reports the
    /// file.
    fn exists(&self) -> bool {
        self.images(self.dataset.views()).paths().chain([self.truth().as_path()]).any(Path::exists)
    }

    /// Reads the frames of `views`, the centre as the picture in its file, and the true disparities in pixels at the
    /// data set's default baseline, +inf where unknown. All have a size within `limits`.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if a file has the wrong contents, sizes differ, or no disparity
    /// is known.
    pub fn load(&self, views: Views, limits: Limits) -> Result<(Frames, Picture, FloatImage)> {
        let images = self.images(views);
        let (frames, center) = Frames::load_each(&images, limits, |_, _| Ok(None))?;
        let path = self.truth();
        let truth = read_truth(self.dataset, &path, limits)?;
        MatchedImages { center: &images.center, size: frames.size(), seen: None }.check_size(&path, &truth)?;
        match truth.pixels().iter().any(|d| d.is_finite()) {
            true => Ok((frames, center, truth)),
            false => Err(Error::format(&path, "no pixel with a disparity", "the ground truth of the centre image")),
        }
    }
}

impl Dataset {
    /// Finds the scenes in `directory`, and sorts them by name. `directory` may be the folder of the data
    /// set, which has a folder for each scene; the folder of a single scene; or the parent of a folder with
    /// the data set's name.
    ///
    /// # Errors
    /// [`Error::Read`] if a folder cannot be read, and [`Error::Format`] if there is no scene.
    pub fn scenes(self, directory: &Path) -> Result<Vec<DatasetScene>> {
        let own = DatasetScene::new(self, directory);
        if own.exists() {
            return Ok(vec![own]);
        }
        let named = directory.join(self.name());
        let folder = if named.is_dir() { &named } else { directory };
        // Tsukuba has a single scene, directly in its folder.
        let own = DatasetScene::new(self, folder);
        if own.exists() {
            return Ok(vec![own]);
        }
        let failed = |source| Error::Read { path: folder.into(), source };
        let mut scenes = Vec::new();
        for entry in fs::read_dir(folder).map_err(failed)? {
            let scene = DatasetScene::new(self, &entry.map_err(failed)?.path());
            if scene.exists() {
                scenes.push(scene);
            }
        }
        scenes.sort_by(|a, b| a.name.cmp(&b.name));
        if scenes.is_empty() {
            let files: Vec<_> = self.images(self.views()).paths().map(|path| path.display().to_string()).collect();
            let expected = format!("folders with {} and {}", files.join(", "), self.truth_file());
            return Err(Error::format(folder, format!("no scene of {self}"), expected));
        }
        Ok(scenes)
    }
}

/// Reads a ground truth file of a data set: disparities in pixels at the default baseline, +inf where unknown.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] if the file is not what the data set uses.
fn read_truth(dataset: Dataset, path: &Path, limits: Limits) -> Result<FloatImage> {
    match dataset {
        Dataset::Middlebury2006Third => read_gray(path, 12.0, limits),
        Dataset::Middlebury2005Full => read_gray(path, 4.0, limits),
        Dataset::Tsukuba => read_gray(path, 16.0, limits),
        // The file counts pixels per camera step, and the default baseline is four steps.
        Dataset::Hci4d(_) => Ok(crate::files::read_pfm_within(path, limits)?.map(|step| 4.0 * step)),
    }
}

/// Reads an 8-bit grey image of disparities times `scale`, 0 where unknown.
fn read_gray(path: &Path, scale: f32, limits: Limits) -> Result<FloatImage> {
    let gray = match CodedFile::new(path, &limits.read(path)?, limits)?.decode()? {
        Decoded::Samples(DynamicImage::ImageLuma8(gray)) => gray,
        other => {
            let found = match other {
                Decoded::Samples(image) => format!("an image of {:?}", image.color()),
                Decoded::Numbers(_) => "a map of numbers".into(),
            };
            return Err(Error::format(path, found, "disparities in an 8-bit grey image (L8)"));
        }
    };
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    let disparity = |&gray: &u8| if gray == 0 { f32::INFINITY } else { f32::from(gray) / scale };
    Ok(FloatImage::new(width, height, gray.as_raw().iter().map(disparity).collect()))
}

#[cfg(test)]
mod tests {
    use multiscopic_core::Frame;

    use super::*;
    use crate::evaluation::CameraSteps;

    fn write_gray(path: PathBuf, pixels: &[u8]) {
        fs::write(path, [format!("P5 {} 1 255\n", pixels.len()).as_bytes(), pixels].concat()).unwrap();
    }

    /// Writes a scene of `dataset` to `folder`, with images of `width` x 1 pixels.
    fn make(dataset: Dataset, folder: &Path, width: usize, truth: &[u8]) {
        fs::create_dir_all(folder).unwrap();
        for (grey, path) in dataset.images(dataset.views()).paths().enumerate() {
            write_gray(folder.join(path), &vec![grey as u8; width]);
        }
        match dataset {
            Dataset::Hci4d(_) => fs::write(folder.join(dataset.truth_file()), truth).unwrap(),
            _ => write_gray(folder.join(dataset.truth_file()), truth),
        }
    }

    fn names(dataset: Dataset, directory: &Path) -> Vec<String> {
        dataset.scenes(directory).unwrap().into_iter().map(|scene| scene.name).collect()
    }

    fn message(dataset: Dataset, directory: &Path) -> String {
        dataset.scenes(directory).and_then(|scenes| scenes[0].load(dataset.views(), Limits::DEFAULT)).unwrap_err().to_string()
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

        let none = message(Dataset::Hci4d(CameraSteps::Four), dir.path());
        assert!(none.contains("found no scene of hci4d, expected folders with input_Cam040.png, "), "{none}");
        let none = message(Dataset::Hci4d(CameraSteps::Four), &dir.path().join("none"));
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
            (Dataset::Hci4d(CameraSteps::Four), &signed, [1.0, -6.0, 0.0]),
        ];
        for (dataset, file, expected) in cases {
            let dir = tempfile::tempdir().unwrap();
            make(dataset, dir.path(), 3, file);
            let (frames, center, truth) = dataset.scenes(dir.path()).unwrap()[0].load(dataset.views(), Limits::DEFAULT).unwrap();
            assert_eq!(truth.pixels(), expected, "{dataset}");
            assert_eq!(center.dimensions(), (3, 1));
            let frame = |frame| frames.get(frame).map(|image| image.as_raw()[0]);
            assert_eq!(frame(Frame::Center), Some(0));
            let views: Vec<u8> = dataset.views().iter().filter_map(|view| frame(Frame::View(view))).collect();
            assert!(views.into_iter().eq(1..=dataset.views().len() as u8), "{dataset}");
        }
    }

    #[test]
    fn errors_name_the_file_and_what_is_wrong() {
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
