//! The calibration of a camera, and the file that it is from.

use std::path::{Path, PathBuf};

use super::{CameraModel, Lens, Mount, Undistortion};
use crate::{
    error::{Error, Result},
    files::Rig,
};

/// A calibration and its file.
#[derive(Clone, Debug)]
pub struct LensFile {
    /// The file: that of the lens, or the rig's if only the mount is known.
    pub path: PathBuf,
    /// Its contents.
    pub camera: CameraModel,
    /// The rotation of the camera against its stage.
    pub mount: Mount,
}

/// The ratio of two focal lengths from which on they contradict each other.
const CONTRADICTION: f64 = 1.01;

impl LensFile {
    /// Reads the calibration of a lens, square to its stage.
    ///
    /// # Errors
    /// Those of [`CameraModel::read`].
    pub fn read(path: &Path) -> Result<LensFile> {
        Ok(LensFile { path: path.into(), camera: CameraModel::read(path)?, mount: Mount::SQUARE })
    }

    /// Reads the calibration that the images of the `rig` in `directory` were taken with: its lens, or another one, and its
    /// mount. `None` if the images are ideal.
    ///
    /// # Errors
    /// Those of [`CameraModel::read`].
    pub fn of_rig(rig: &Rig, directory: &Path, other: Option<&Path>) -> Result<Option<LensFile>> {
        let lens = other.map(PathBuf::from).or(rig.lens.as_ref().map(|lens| directory.join(lens)));
        let lens = lens.map(|path| LensFile::read(&path)).transpose()?;
        Ok(LensFile::with_mount(lens, rig, &directory.join(Rig::FILE_NAME)))
    }

    /// A lens together with the mount in the rig at `path`. `None` if the rig's images are ideal.
    pub fn with_mount(lens: Option<LensFile>, rig: &Rig, path: &Path) -> Option<LensFile> {
        let Some(rotation_deg) = rig.mount_rotation_deg else { return lens };
        let mount = Mount { rotation_deg, ..Mount::SQUARE };
        let pinhole = |(focal_px, principal_point)| {
            let camera = CameraModel { size: None, focal_px: [focal_px; 2], principal_point, lens: Lens::IDEAL };
            LensFile { path: path.into(), camera, mount }
        };
        match lens {
            Some(lens) => Some(LensFile { mount, ..lens }),
            None => rig.focal_px.zip(rig.principal_point).map(pinhole),
        }
    }

    /// The undistortion of images of a size.
    ///
    /// # Errors
    /// If the calibration is for another size.
    pub fn undistortion(&self, size: [usize; 2]) -> Result<Undistortion> {
        self.camera.check_size(&self.path, size)?;
        Ok(Undistortion::new(&self.camera, &self.mount, size))
    }

    /// The focal length of undistorted images, in pixels.
    pub fn focal_px(&self) -> f64 {
        self.camera.focal_px[0]
    }

    /// The principal point of undistorted images of a size.
    pub fn principal_point(&self, size: [usize; 2]) -> [f64; 2] {
        self.mount.principal_point(&self.camera, size)
    }

    /// The rig of the images, of a size, without their distortion.
    ///
    /// # Errors
    /// Those of [`check_focal`](LensFile::check_focal).
    pub fn ideal_rig(&self, rig: Rig, size: [usize; 2]) -> Result<Rig> {
        self.check_focal(rig.focal_px, Rig::FILE_NAME)?;
        let (focal_px, principal_point) = (Some(self.focal_px()), Some(self.principal_point(size)));
        Ok(Rig { lens: None, mount_rotation_deg: None, focal_px, principal_point, ..rig })
    }

    /// Refuses a focal length in pixels, if there is one, that contradicts the calibration. `origin` is where it is from.
    ///
    /// # Errors
    /// [`Error::Usage`], with both.
    pub fn check_focal(&self, focal_px: Option<f64>, origin: &str) -> Result<()> {
        let contradicts = |given: &f64| given.max(self.focal_px()) / given.min(self.focal_px()) > CONTRADICTION;
        match focal_px.filter(contradicts) {
            Some(given) => Err(Error::Usage(format!(
                "{origin} gives a focal length of {given} pixels, but {} one of {:.1}: correct one of them, or leave the first out",
                self.path.display(),
                self.focal_px()
            ))),
            None => Ok(()),
        }
    }
}
