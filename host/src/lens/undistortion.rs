//! Pictures without distortion, by a calibration and the file that it is from.

use std::path::{Path, PathBuf};

use multiscopic_core::Frame;
use nalgebra::{Rotation3, Vector3};
use rayon::prelude::*;

use super::{CameraModel, Lens, MeasuredViews, Mount};
use crate::{
    error::{Error, Result},
    files::Rig,
    images::{DisparityMap, Frames, Picture, Raster, Transform},
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
    /// The turn of the camera in each view.
    pub views: MeasuredViews,
}

/// The shift of pixels by turns of the views below which frames of an ideal lens are left as they are: resampling would do
/// more harm.
const NEGLIGIBLE_PX: f64 = 0.05;
/// The ratio of two focal lengths from which on they contradict each other.
const CONTRADICTION: f64 = 1.01;

impl LensFile {
    /// Reads the calibration of a lens, square to its stage.
    ///
    /// # Errors
    /// Those of [`CameraModel::read`].
    pub fn read(path: &Path) -> Result<LensFile> {
        let (camera, views) = (CameraModel::read(path)?, MeasuredViews::default());
        Ok(LensFile { path: path.into(), camera, mount: Mount::SQUARE, views })
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

    /// A lens together with the mount and the views in the rig at `path`. `None` if the rig's images are ideal.
    pub fn with_mount(lens: Option<LensFile>, rig: &Rig, path: &Path) -> Option<LensFile> {
        let mount = Mount { rotation_deg: rig.mount_rotation_deg.unwrap_or_default(), ..Mount::SQUARE };
        let views = MeasuredViews::of_rig(rig, None);
        let turn_px = |focal_px: f64| views.largest_turn() * focal_px;
        match lens {
            Some(lens) => Some(LensFile { mount, views, ..lens }),
            None if rig.mount_rotation_deg.is_none() && rig.focal_px.is_none_or(|px| turn_px(px) < NEGLIGIBLE_PX) => None,
            None => rig.focal_px.zip(rig.principal_point).map(|(focal_px, principal_point)| {
                let camera = CameraModel { size: None, focal_px: [focal_px; 2], principal_point, lens: Lens::IDEAL };
                LensFile { path: path.into(), camera, mount, views }
            }),
        }
    }

    /// The undistortion of images of a size.
    ///
    /// # Errors
    /// If the calibration is for another size.
    pub fn undistortion(&self, size: [usize; 2]) -> Result<Undistortion> {
        self.camera.check_size(&self.path, size)?;
        Ok(Undistortion { views: self.views.clone(), ..Undistortion::new(&self.camera, &self.mount, size) })
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
        let (mount_roll_deg, hand_eye, poses) = (None, None, Default::default());
        Ok(Rig { lens: None, mount_rotation_deg: None, mount_roll_deg, hand_eye, poses, focal_px, principal_point, ..rig })
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

/// Turns the pictures of a camera into those of an ideal one: without distortion, square to its stage, with square pixels, of
/// the same size and with the horizontal focal length `fx`; views that were turned against the centre are turned back. What
/// the camera shows in the middle of its pictures stays there, so that the principal point is the same only if the camera is
/// square to its stage.
///
/// Ideal pixels lie between those of the picture and are interpolated by cubic convolution (Keys, 1981).
#[derive(Clone, Debug)]
pub struct Undistortion {
    projection: IdealProjection,
    /// The place of each ideal pixel in the picture of the centre. `None` beyond the range of the lens model.
    places: Raster<Option<[f32; 2]>>,
    views: MeasuredViews,
}

/// From the ideal camera to the real one.
#[derive(Clone, Copy, Debug)]
struct IdealProjection {
    camera: CameraModel,
    /// From the rays of the ideal camera to those of the camera.
    to_camera: Rotation3<f64>,
    /// The pixel at which the optical axis meets the ideal picture.
    principal_point: [f64; 2],
}

impl IdealProjection {
    fn place(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        let (focal_px, [cx, cy]) = (self.camera.focal_px[0], self.principal_point);
        let ray = self.to_camera * Vector3::new((u - cx) / focal_px, (v - cy) / focal_px, 1.0);
        self.camera.pixel([ray.x / ray.z, ray.y / ray.z]).filter(|_| ray.z > 0.0)
    }
}

impl Undistortion {
    /// The undistortion of pictures of a size, in pixels, which should be that of the camera.
    ///
    /// # Panics
    /// If a side is 0.
    pub fn new(camera: &CameraModel, mount: &Mount, [width, height]: [usize; 2]) -> Undistortion {
        let principal_point = mount.principal_point(camera, [width, height]);
        let projection = IdealProjection { camera: *camera, to_camera: mount.rotation().inverse(), principal_point };
        let place = |k: usize| {
            let place = projection.place([(k % width) as f64, (k / width) as f64]);
            place.map(|place| place.map(|coordinate| coordinate as f32))
        };
        let places = Raster::new(width, height, (0..width * height).into_par_iter().map(place).collect());
        Undistortion { projection, places, views: MeasuredViews::default() }
    }

    /// The place of a point of a frame's ideal picture, which may lie between its pixels, in the picture, inside its borders or
    /// outside. `None` beyond the range of the lens model.
    pub fn place_of(&self, frame: Frame, pixel: [f64; 2]) -> Option<[f64; 2]> {
        self.projection_of(frame).unwrap_or(self.projection).place(pixel)
    }

    /// The projection of a view that is turned.
    fn projection_of(&self, frame: Frame) -> Option<IdealProjection> {
        let Frame::View(view) = frame else { return None };
        let turn = self.views.turn(view)?;
        Some(IdealProjection { to_camera: turn * self.projection.to_camera, ..self.projection })
    }

    /// The transform from the ideal camera to the camera in the centre.
    pub fn ideal_in_camera(&self) -> Transform {
        Transform::rotation(&self.projection.to_camera)
    }

    /// The place of an ideal pixel in the picture of the centre, which may be outside its borders. `None` beyond the range of
    /// the lens model.
    ///
    /// # Panics
    /// If it is outside the ideal picture.
    pub fn place(&self, u: usize, v: usize) -> Option<[f64; 2]> {
        self.places.get(u, v).map(|place| place.map(f64::from))
    }

    /// The ideal picture of a frame. Pixels outside the picture repeat its border.
    ///
    /// # Panics
    /// If the picture has another size.
    pub fn picture(&self, frame: Frame, picture: &Picture) -> Picture {
        let (width, height) = picture.dimensions();
        let size = [self.places.width(), self.places.height()];
        assert_eq!([width as usize, height as usize], size, "the size of the picture");
        match self.projection_of(frame) {
            Some(projection) => picture.resampled(|pixel| projection.place(pixel.map(|at| at as f64)), 1.0),
            None => picture.resampled(|[u, v]| self.place(u, v), 1.0),
        }
    }

    /// The ideal frames.
    ///
    /// # Panics
    /// If the frames have another size.
    pub fn frames(&self, frames: &Frames) -> Frames {
        let ideal = |frame| self.picture(frame, &frames.picture(frame).expect("it is one of the frames"));
        let center = Frames::of_picture(ideal(Frame::Center));
        frames.views().iter().fold(center, |of, view| of.with_picture(view, ideal(Frame::View(view))))
    }

    /// Marks the disparities of ideal pixels that lie outside the picture as invalid.
    ///
    /// # Panics
    /// If the map has another size.
    pub fn mask(&self, disparities: &mut DisparityMap) {
        let (width, height) = (self.places.width(), self.places.height());
        assert_eq!([disparities.width(), disparities.height()], [width, height], "the size of the disparities");
        let inside = |at: f32, size: usize| at >= -0.5 && at <= size as f32 - 0.5;
        for (disparity, place) in disparities.pixels_mut().iter_mut().zip(self.places.pixels()) {
            if !place.is_some_and(|[u, v]| inside(u, width) && inside(v, height)) {
                *disparity = None;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma, Rgb, RgbImage};
    use multiscopic_core::Disparity;

    use super::*;
    use crate::lens::LensModel;

    fn camera(lens: Lens) -> CameraModel {
        CameraModel { size: Some([320, 240]), focal_px: [300.0, 303.0], principal_point: [161.5, 118.25], lens }
    }

    #[test]
    fn pixels_lie_where_opencv_finds_them() {
        let lens = Lens::new(LensModel::PlumbBob, &[-0.25, 0.08, 0.0012, -0.0007, -0.01]).unwrap();
        let undistortion = Undistortion::new(&camera(lens), &Mount::SQUARE, [320, 240]);
        // cv2.initUndistortRectifyMap of OpenCV 5.0.0 with the camera matrix above, and 300 for both focal lengths in the new
        // one.
        for ((u, v), [x, y]) in [
            ((0, 0), [15.493_36, 10.506_149]),
            ((319, 0), [303.888_82, 10.364_406]),
            ((161, 118), [161.0, 117.997_505]),
            ((40, 200), [46.503_96, 196.450_26]),
            ((319, 239), [303.993_9, 228.818_07]),
        ] {
            let [found_x, found_y] = undistortion.places.get(u, v).unwrap();
            assert!((found_x - x).abs() < 1e-4 && (found_y - y).abs() < 1e-4, "({u}, {v}): {found_x}, {found_y}");
        }
    }

    #[test]
    fn an_ideal_lens_changes_nothing() {
        let square = CameraModel { focal_px: [300.0; 2], ..camera(Lens::IDEAL) };
        let undistortion = Undistortion::new(&square, &Mount::SQUARE, [40, 30]);
        let rgb = RgbImage::from_fn(40, 30, |u, v| Rgb([(6 * u) as u8, (8 * v) as u8, (u * v) as u8]));
        let gray = GrayImage::from_fn(40, 30, |u, v| Luma([(u * v) as u8]));
        for picture in [Picture::Rgb(rgb), Picture::Gray(gray)] {
            assert_eq!(undistortion.picture(Frame::Center, &picture), picture);
        }
    }

    #[test]
    fn colours_are_kept_and_pixels_outside_are_invalid() {
        // A pincushion: the corners of the ideal picture lie outside.
        let lens = Lens::new(LensModel::PlumbBob, &[0.3, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let undistortion = Undistortion::new(&camera(lens), &Mount::SQUARE, [320, 240]);
        let frames = Frames::of_picture(Picture::Rgb(RgbImage::from_pixel(320, 240, Rgb([200, 100, 50]))));
        let frames = undistortion.frames(&frames);
        let colors = frames.color(multiscopic_core::Frame::Center).unwrap();
        assert!(colors.pixels().all(|pixel| pixel.0 == [200, 100, 50]));
        let mut disparities = DisparityMap::filled(320, 240, Disparity::from_bits(64));
        undistortion.mask(&mut disparities);
        assert_eq!([disparities.get(0, 0), disparities.get(319, 239)], [None; 2]);
        assert!(disparities.get(160, 120).is_some());
    }
}
