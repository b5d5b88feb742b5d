//! Calibration of a lens from the corners of a board in several images.

use nalgebra::Vector3;

use super::{
    board_detection::{BoardCorner, LEAST_CORNERS},
    camera_fit::{CameraFit, Corners},
};
use crate::lens::{CameraModel, LensModel};

/// The least number of images.
pub const LEAST_IMAGES: usize = 3;
/// A corner is dropped if its error is above this multiple of the standard deviation of all, and above this many pixels.
const OUTLIER: f64 = 5.0;
const OUTLIER_PX: f64 = 0.3;
const MOST_ROUNDS: usize = 6;
/// The largest error with which images are taken to agree, in pixels (RMS).
const LARGEST_RMS_PX: f64 = 1.0;
/// The smallest angle between the boards of two images, in degrees, and the largest relative deviation of the focal length.
const SMALLEST_ANGLE_DEG: f64 = 10.0;
const LARGEST_FOCAL_DEVIATION: f64 = 0.01;

/// The corners of a board in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardImage {
    /// The name of the image for messages.
    pub name: String,
    /// The corners it shows.
    pub corners: Vec<BoardCorner>,
}

/// A calibrated lens.
#[derive(Clone, Debug)]
pub struct LensCalibration {
    /// The camera.
    pub camera: CameraModel,
    /// The standard deviations of `fx`, `fy`, `cx`, `cy` in pixels and of the lens's coefficients, as far as they follow from
    /// the scatter of the corners.
    pub deviations: Vec<f64>,
    /// The images that were used.
    pub images: Vec<BoardReprojection>,
    /// The names of images that were left out, as most of their corners disagree with the others.
    pub rejected: Vec<String>,
    /// The parts of the image that have corners.
    pub coverage: Coverage,
}

/// The corners of an image after the calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardReprojection {
    /// The name of the image.
    pub name: String,
    /// The corners that were used: the pixel, and the error from where the camera should see the corner, in pixels.
    pub corners: Vec<([f64; 2], [f64; 2])>,
    /// The number of corners that were dropped.
    pub dropped: usize,
    /// The angle between the board and the image plane in degrees.
    pub tilt_deg: f64,
    /// The distance of the board along the optical axis in millimetres.
    pub distance_mm: f64,
}

/// The reason why images do not determine a lens, and what to photograph next.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LensCalibrationError {
    /// There are too few images.
    #[error(
        "{} with the board, at least {LEAST_IMAGES} are needed and 10 to 20 are better: photograph it tilted to all sides, near and \
         far, and in all parts of the image",
        if *found == 1 { "1 image".into() } else { format!("{found} images") }
    )]
    TooFewImages {
        /// The number of images with the board.
        found: usize,
    },
    /// No camera sees the board as the images show it.
    #[error(
        "no {model} lens explains the images: check the squares of the board, and that {first} and the others are from one camera"
    )]
    NoFit {
        /// The model.
        model: LensModel,
        /// The first image.
        first: String,
    },
    /// The images contradict each other.
    #[error(
        "the images contradict each other: corners are {rms_px:.2} px off (RMS), {LARGEST_RMS_PX} px at most are expected, and \
         {worst_px:.2} px in {worst}: use images of one camera with fixed zoom and focus, a flat board with the right squares, or \
         another model"
    )]
    Contradiction {
        /// The error of all corners.
        rms_px: f64,
        /// The image with the largest error.
        worst: String,
        /// Its error.
        worst_px: f64,
    },
    /// The boards are parallel to each other.
    #[error(
        "the images do not tell the focal length, as the boards in them are within {angle_deg:.0} degrees of each other (the focal length \
         is known to {focal_percent:.1} %): photograph the board tilted by 20 to 40 degrees to the left, right, top and bottom"
    )]
    Parallel {
        /// The largest angle between two boards.
        angle_deg: f64,
        /// The standard deviation of the focal length in percent.
        focal_percent: f64,
    },
    /// The corners do not determine the focal length.
    #[error(
        "{corners} corners of {images} images tell the focal length to {focal_percent:.1} % only, {:.0} % is needed: take more pictures, with \
         more of the board in view, tilted by 20 to 40 degrees to the left, right, top and bottom",
        100.0 * LARGEST_FOCAL_DEVIATION
    )]
    Uncertain {
        /// The corners that were seen.
        corners: usize,
        /// The images that have them.
        images: usize,
        /// The standard deviation of the focal length in percent.
        focal_percent: f64,
    },
    /// Large parts of the image have no corners.
    #[error(
        "corners cover {covered_percent:.0} % of the image, {needed_percent:.0} % are needed: photograph the board in these parts of \
         the image: {}",
        missing.join(", ")
    )]
    Uncovered {
        /// The share of the image's cells with corners in percent.
        covered_percent: f64,
        /// The least share.
        needed_percent: f64,
        /// The parts of the image without.
        missing: Vec<&'static str>,
    },
}

impl LensCalibration {
    /// Calibrates from images of `size` pixels. Corners that disagree with the others are dropped.
    ///
    /// # Errors
    /// [`LensCalibrationError`] if the images do not determine the lens, or their corners cover less than the share
    /// `least_coverage` of the image.
    pub fn estimate(
        images: &[BoardImage],
        size: [usize; 2],
        model: LensModel,
        least_coverage: f64,
    ) -> Result<LensCalibration, LensCalibrationError> {
        let mut rejected = Vec::new();
        let mut names: Vec<(&str, usize)> = images.iter().map(|image| (image.name.as_str(), image.corners.len())).collect();
        let mut corners: Vec<Corners> = images.iter().map(|image| image.corners.clone()).collect();
        if corners.len() < LEAST_IMAGES {
            return Err(LensCalibrationError::TooFewImages { found: corners.len() });
        }
        let no_fit = || LensCalibrationError::NoFit { model, first: images[0].name.clone() };
        let mut fit = CameraFit::first(&corners, size, model).ok_or_else(no_fit)?.adjusted(&corners);
        for _ in 0..MOST_ROUNDS {
            let errors: Vec<Vec<f64>> = all_residuals(&fit, &corners).ok_or_else(no_fit)?.iter().map(|of| lengths(of)).collect();
            let limit = (OUTLIER * deviation(errors.iter().flatten().copied())).max(OUTLIER_PX);
            if errors.iter().flatten().all(|error| *error <= limit) {
                break;
            }
            for (corners, errors) in corners.iter_mut().zip(&errors) {
                let mut errors = errors.iter();
                corners.retain(|_| errors.next().is_some_and(|error| *error <= limit));
            }
            for index in (0..corners.len()).rev().filter(|&index| corners[index].len() < LEAST_CORNERS).collect::<Vec<_>>() {
                rejected.push(names.remove(index).0.to_owned());
                corners.remove(index);
                fit.poses.remove(index);
            }
            if corners.len() < LEAST_IMAGES {
                return Err(contradiction(images, size, model).unwrap_or_else(no_fit));
            }
            fit = fit.descended(&corners, &|_| true);
        }
        let residuals = all_residuals(&fit, &corners).ok_or_else(no_fit)?;
        let reprojections =
            names.iter().zip(&corners).zip(&residuals).zip(&fit.poses).map(|(((name, corners), residuals), pose)| {
                let (name, found) = *name;
                let normal = pose.rotation * Vector3::z();
                BoardReprojection {
                    name: name.into(),
                    corners: corners.iter().map(|corner| corner.pixel).zip(residuals.iter().copied()).collect(),
                    dropped: found - corners.len(),
                    tilt_deg: normal.z.abs().min(1.0).acos().to_degrees(),
                    distance_mm: pose.translation.vector.z,
                }
            });
        let pixels = corners.iter().flatten().map(|corner| corner.pixel);
        let mut calibration = LensCalibration {
            camera: fit.camera,
            deviations: Vec::new(),
            images: reprojections.collect(),
            rejected,
            coverage: Coverage::new(size, pixels),
        };
        let rms_px = calibration.rms_px();
        if rms_px > LARGEST_RMS_PX {
            return Err(calibration.contradiction());
        }
        let covariance = fit.covariance(&corners);
        let unknowns = covariance.as_ref().map_or(0, |covariance| covariance.nrows()) + 6 * corners.len();
        let observed = 2 * corners.iter().map(Vec::len).sum::<usize>();
        // The residuals follow some of the noise.
        let variance = rms_px * rms_px * (observed / 2) as f64 / observed.saturating_sub(unknowns).max(1) as f64;
        calibration.deviations = covariance
            .map(|covariance| covariance.diagonal().iter().map(|v| (v * variance).sqrt()).collect())
            .unwrap_or_default();
        let angle_deg = largest_angle_deg(&fit);
        let focal_deviation =
            calibration.deviations.first().map_or(f64::INFINITY, |deviation| deviation / fit.camera.focal_px[0]);
        let focal_percent = 100.0 * focal_deviation;
        if angle_deg < SMALLEST_ANGLE_DEG {
            return Err(LensCalibrationError::Parallel { angle_deg, focal_percent });
        }
        let share = calibration.coverage.share();
        if share < least_coverage {
            let missing = calibration.coverage.missing();
            let [covered_percent, needed_percent] = [share, least_coverage].map(|share| 100.0 * share);
            return Err(LensCalibrationError::Uncovered { covered_percent, needed_percent, missing });
        }
        if focal_deviation > LARGEST_FOCAL_DEVIATION {
            return Err(LensCalibrationError::Uncertain { corners: observed / 2, images: corners.len(), focal_percent });
        }
        Ok(calibration)
    }

    /// The root of the mean squared distance between where corners are seen and where the camera should see them, in pixels.
    pub fn rms_px(&self) -> f64 {
        rms(self.images.iter().flat_map(BoardReprojection::errors))
    }

    /// The largest of these distances.
    pub fn max_px(&self) -> f64 {
        self.images.iter().flat_map(BoardReprojection::errors).fold(0.0, f64::max)
    }

    fn contradiction(&self) -> LensCalibrationError {
        let worst = self.images.iter().max_by(|a, b| a.rms_px().total_cmp(&b.rms_px()));
        let (worst, worst_px) = worst.map(|worst| (worst.name.clone(), worst.rms_px())).unwrap_or_default();
        LensCalibrationError::Contradiction { rms_px: self.rms_px(), worst, worst_px }
    }
}

impl BoardReprojection {
    /// The root of the mean squared error, in pixels.
    pub fn rms_px(&self) -> f64 {
        rms(self.errors())
    }

    /// The largest error, in pixels.
    pub fn max_px(&self) -> f64 {
        self.errors().fold(0.0, f64::max)
    }

    fn errors(&self) -> impl Iterator<Item = f64> {
        self.corners.iter().map(|(_, [u, v])| u.hypot(*v))
    }
}

fn all_residuals(fit: &CameraFit, corners: &[Corners]) -> Option<Vec<Vec<[f64; 2]>>> {
    corners.iter().enumerate().map(|(image, corners)| fit.residuals(image, corners)).collect()
}

fn lengths(residuals: &[[f64; 2]]) -> Vec<f64> {
    residuals.iter().map(|[u, v]| u.hypot(*v)).collect()
}

fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = errors.fold((0.0, 0), |(sum, count), error| (sum + error * error, count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

/// The standard deviation on each axis of errors in the plane, from the median of their lengths.
fn deviation(errors: impl Iterator<Item = f64>) -> f64 {
    let mut errors: Vec<f64> = errors.collect();
    errors.sort_by(f64::total_cmp);
    // The median of Rayleigh's distribution.
    errors.get(errors.len() / 2).copied().unwrap_or_default() / (2.0 * 2.0_f64.ln()).sqrt()
}

/// The largest angle between the boards of two images.
fn largest_angle_deg(fit: &CameraFit) -> f64 {
    let normals: Vec<Vector3<f64>> = fit.poses.iter().map(|pose| pose.rotation * Vector3::z()).collect();
    let pairs = normals.iter().flat_map(|a| normals.iter().map(move |b| a.angle(b)));
    pairs.fold(0.0, f64::max).to_degrees()
}

/// Returns the contradiction between the images if no corner is dropped.
fn contradiction(images: &[BoardImage], size: [usize; 2], model: LensModel) -> Option<LensCalibrationError> {
    let corners: Vec<Corners> = images.iter().map(|image| image.corners.clone()).collect();
    let fit = CameraFit::first(&corners, size, model)?.adjusted(&corners);
    let of_images: Vec<Vec<f64>> = all_residuals(&fit, &corners)?.iter().map(|of| lengths(of)).collect();
    let errors = images.iter().zip(&of_images).map(|(image, errors)| (rms(errors.iter().copied()), &image.name));
    let (worst_px, worst) = errors.max_by(|(a, _), (b, _)| a.total_cmp(b))?;
    let rms_px = rms(of_images.iter().flatten().copied());
    Some(LensCalibrationError::Contradiction { rms_px, worst: worst.clone(), worst_px })
}

/// The number of cells along the longer side of the image.
const CELLS: usize = 8;

/// The image in cells of about the same sides, and the number of corners in each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// The number of cells in a row and in a column.
    pub cells: [usize; 2],
    /// The number of corners in each cell, row by row.
    pub counts: Vec<usize>,
}

impl Coverage {
    /// The coverage of an image of `size` pixels with corners at `pixels`.
    pub fn new(size: [usize; 2], pixels: impl IntoIterator<Item = [f64; 2]>) -> Coverage {
        let longer = size[0].max(size[1]).max(1);
        let cells = size.map(|side| ((CELLS * side + longer / 2) / longer).max(1));
        let mut counts = vec![0; cells[0] * cells[1]];
        for pixel in pixels {
            let cell = |axis: usize| ((pixel[axis] + 0.5) / size[axis] as f64 * cells[axis] as f64).max(0.0) as usize;
            let [column, row] = [0, 1].map(|axis| cell(axis).min(cells[axis] - 1));
            counts[row * cells[0] + column] += 1;
        }
        Coverage { cells, counts }
    }

    /// The share of cells with a corner, 0 to 1.
    pub fn share(&self) -> f64 {
        self.counts.iter().filter(|count| **count > 0).count() as f64 / self.counts.len() as f64
    }

    /// The ninths of the image where fewer than half of the cells have a corner, as "top left".
    pub fn missing(&self) -> Vec<&'static str> {
        const NAMES: [&str; 9] =
            ["top left", "top", "top right", "left", "middle", "right", "bottom left", "bottom", "bottom right"];
        let [columns, rows] = self.cells;
        let third = |index: usize, count: usize| (6 * index + 3) / (2 * count).max(1);
        let mut seen = [[0; 2]; 9];
        for (index, count) in self.counts.iter().enumerate() {
            let ninth = 3 * third(index / columns, rows).min(2) + third(index % columns, columns).min(2);
            seen[ninth][0] += usize::from(*count > 0);
            seen[ninth][1] += 1;
        }
        let is_missing = |[seen, all]: [usize; 2]| 2 * seen < all;
        NAMES.into_iter().zip(seen).filter(|(_, seen)| is_missing(*seen)).map(|(name, _)| name).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_counted() {
        let coverage = Coverage::new([640, 480], [[0.0, 0.0], [79.0, 0.0], [80.0, 0.0], [639.4, 479.4]]);
        assert_eq!(coverage.cells, [8, 6]);
        assert_eq!((coverage.counts[0], coverage.counts[1], coverage.counts[47]), (2, 1, 1));
        assert_eq!(coverage.share(), 3.0 / 48.0);
        assert_eq!(coverage.missing().len(), 9);
    }

    #[test]
    fn missing_ninths_are_named() {
        let everywhere = || (0..640).step_by(20).flat_map(|u| (0..480).step_by(20).map(move |v| [f64::from(u), f64::from(v)]));
        assert_eq!(Coverage::new([640, 480], everywhere()).share(), 1.0);
        assert!(Coverage::new([640, 480], everywhere()).missing().is_empty());
        let coverage = Coverage::new([640, 480], everywhere().filter(|[u, v]| *u < 400.0 && *v > 200.0));
        assert_eq!(coverage.missing(), ["top left", "top", "top right", "right", "bottom right"]);
    }
}
