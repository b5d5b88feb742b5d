//! The calibrations of rectified pairs of images, as data sets keep them.

use std::{collections::HashMap, path::Path};

use super::input;
use crate::error::{Error, Result};

/// The camera of a rectified pair: of Middlebury since 2014 (`calib.txt`) or KITTI (a file with `P2` and `P3`, or `P_rect_02` and
/// `P_rect_03`). The centre is the left image, and the camera moved to the right.
///
/// ```text
/// cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]
/// cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]
/// doffs=131.111
/// baseline=193.001
/// width=2964
/// height=1988
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairCalibration {
    /// Width and height of the images in pixels, if the file has them.
    pub size: Option<[usize; 2]>,
    /// The focal length in pixels.
    pub focal_px: f64,
    /// The pixel at which the optical axis meets the left image.
    pub principal_point: [f64; 2],
    /// The distance between the cameras in millimetres.
    pub baseline_mm: f64,
    /// The distance between the principal points in pixels: that of the right image less that of the left one.
    pub doffs: f64,
}

/// The largest error of a `doffs` that is rounded, in pixels.
const ROUNDED: f64 = 0.1;

impl PairCalibration {
    /// The name of the file of Middlebury.
    pub(super) const FILE_NAME: &str = "calib.txt";
    /// The left and the right image of Middlebury.
    pub(super) const IMAGES: [&str; 2] = ["im0.png", "im1.png"];

    /// Reads a calibration.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if it is none, is incomplete or contradicts itself.
    pub fn read(path: &Path) -> Result<PairCalibration> {
        let text = input::read_text(path)?;
        let numbers = |line| {
            let (name, value): (&str, &str) = str::split_once(line, ['=', ':'])?;
            let words = value.split(|letter: char| letter.is_whitespace() || "[],;".contains(letter));
            let numbers = words.filter(|word| !word.is_empty()).map(|word| word.parse().ok());
            Some((name.trim(), numbers.collect::<Option<Vec<f64>>>()?))
        };
        let fields: HashMap<&str, Vec<f64>> = text.lines().filter_map(numbers).collect();
        let number = |name: &str| fields.get(name).and_then(|numbers| numbers.first()).copied();
        let matrices = [("cam0", "cam1"), ("P2", "P3"), ("P_rect_02", "P_rect_03"), ("P0", "P1"), ("P_rect_00", "P_rect_01")];
        let pair = matrices.iter().find_map(|(left, right)| Some([fields.get(left)?, fields.get(right)?]));
        let (focal, point, baseline_mm, doffs) = match pair.map(|pair| pair.map(|matrix| &matrix[..])) {
            Some([&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], &[right_fx, _, right_cx, _, _, right_cy, ..]]) => {
                let Some(baseline_mm) = number("baseline") else {
                    return Err(Error::format(path, "no baseline", "a whole calib.txt of Middlebury"));
                };
                let doffs = number("doffs").unwrap_or(right_cx - cx);
                if (doffs - (right_cx - cx)).abs() > ROUNDED {
                    let expected = format!("{}, the distance between the principal points of cam0 and cam1", right_cx - cx);
                    return Err(Error::format(path, format!("doffs={doffs}"), expected));
                }
                ([fx, fy, right_fx], [cx, cy, right_cy], baseline_mm, doffs)
            }
            Some(
                [
                    &[fx, 0.0, cx, shift, 0.0, fy, cy, _, 0.0, 0.0, 1.0, _],
                    &[right_fx, _, right_cx, right_shift, _, _, right_cy, ..],
                ],
            ) => ([fx, fy, right_fx], [cx, cy, right_cy], 1000.0 * (shift - right_shift) / fx, right_cx - cx),
            _ => {
                let expected = "cam0 and cam1 of Middlebury, or P2 and P3 (P_rect_02 and P_rect_03) of KITTI";
                return Err(Error::format(path, "no calibration of a rectified pair", expected));
            }
        };
        if focal != [focal[0]; 3] || point[1] != point[2] {
            return Err(Error::format(
                path,
                "two cameras that differ",
                "those of a rectified pair, with one focal length and row",
            ));
        }
        let sides = ["width", "height"].map(number);
        let rectified = ["S_rect_02", "S_rect_00"].iter().find_map(|name| fields.get(name).map(|size| &size[..]));
        let size = match (sides, rectified) {
            ([Some(width), Some(height)], _) | (_, Some(&[width, height])) => Some([width as usize, height as usize]),
            _ => None,
        };
        Ok(PairCalibration { size, focal_px: focal[0], principal_point: [point[0], point[1]], baseline_mm, doffs })
    }

    /// Refuses images that are not as large as those of the calibration in `path`, or, if it does not tell how large those are,
    /// that do not have the principal point.
    ///
    /// # Errors
    /// [`Error::Format`].
    pub fn check_size(&self, path: &Path, [width, height]: [usize; 2]) -> Result<()> {
        let [u, v] = self.principal_point;
        let found = match self.size {
            Some([w, h]) if [w, h] != [width, height] => format!("a calibration of {w}x{h} pixels"),
            None if !(0.0..width as f64).contains(&u) || !(0.0..height as f64).contains(&v) => {
                format!("a principal point at {u}, {v}")
            }
            _ => return Ok(()),
        };
        Err(Error::format(path, found, format!("that of images of {width}x{height} pixels, as these are")))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const MIDDLEBURY: &str = "cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]\ncam1=[3997.684 0 1307.839; 0 3997.684 1011.728; \
        0 0 1]\ndoffs=131.111\nbaseline=193.001\nwidth=2964\nheight=1988\nndisp=280\nisint=0\n";

    /// With the numbers of KITTI's published example: 0.54 m apart.
    const KITTI: &str = "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\nS_rect_02: 1.242000e+03 3.750000e+02\n\
        P_rect_02: 7.215377e+02 0.0 6.095593e+02 4.485728e+01 0.0 7.215377e+02 1.728540e+02 2.163791e-01 0.0 0.0 1.0 2.745884e-03\n\
        P_rect_03: 7.215377e+02 0.0 6.095593e+02 -3.395242e+02 0.0 7.215377e+02 1.728540e+02 2.199936e+00 0.0 0.0 1.0 2.729905e-03\n";

    fn read(text: &str) -> Result<PairCalibration> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("calib.txt");
        fs::write(&path, text).unwrap();
        PairCalibration::read(&path)
    }

    #[test]
    fn the_files_of_middlebury_and_kitti_are_read() {
        let middlebury = PairCalibration {
            size: Some([2964, 1988]),
            focal_px: 3997.684,
            principal_point: [1176.728, 1011.728],
            baseline_mm: 193.001,
            doffs: 131.111,
        };
        assert_eq!(read(MIDDLEBURY).unwrap(), middlebury);
        let kitti = read(KITTI).unwrap();
        // (44.85728 + 339.5242) / 721.5377 m.
        assert!((kitti.baseline_mm - 532.725).abs() < 1e-2, "{kitti:?}");
        assert_eq!((kitti.size, kitti.focal_px, kitti.doffs), (Some([1242, 375]), 721.5377, 0.0));
        let unsized_file = KITTI.replace("S_rect_02", "S_02");
        assert_eq!(
            read(&unsized_file.replace("P_rect_02", "P2").replace("P_rect_03", "P3")).unwrap(),
            PairCalibration { size: None, ..kitti }
        );
        let refused = |text: &str| read(text).unwrap().check_size(Path::new("calib.txt"), [600, 375]).unwrap_err().to_string();
        assert!(refused(KITTI).contains("found a calibration of 1242x375 pixels, expected that of images of 600x375"));
        assert!(refused(&unsized_file).contains("found a principal point at 609.5593, 172.854"));
        for (text, expected) in [
            (MIDDLEBURY.replace("baseline", "base"), "calib.txt: found no baseline"),
            (MIDDLEBURY.replace("doffs=131", "doffs=13"), "found doffs=13.111, expected 131.11"),
            (MIDDLEBURY.replace("cam1=[3997", "cam1=[3990"), "found two cameras that differ"),
            ("a=1\n".repeat(9), "found no calibration of a rectified pair, expected cam0 and cam1"),
        ] {
            let message = read(&text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
