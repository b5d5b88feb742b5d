//! The text files of COLMAP: `cameras.txt` and `images.txt`.

use std::{collections::BTreeMap, path::Path, str::FromStr};

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::{CameraModel, Lens, LensModel};
use crate::{
    error::{Error, Result},
    files::{Limits, PosedPhoto, input},
};

/// The files of a folder of COLMAP's text model.
const FILES: [&str; 2] = ["cameras.txt", "images.txt"];

/// Reads the photos and their camera from a folder in which COLMAP has written a model as text (`colmap model_converter
/// --output_type TXT`). Places are in COLMAP's unit, which no millimetres are known of.
///
/// # Errors
/// [`Error::Read`], or [`Error::Format`] that names the line, if it breaks the format, photos have different cameras, or a camera
/// has a model that no [`LensModel`] is.
pub fn read_model(folder: &Path) -> Result<(Vec<PosedPhoto>, CameraModel)> {
    let [cameras, images] = FILES.map(|name| folder.join(name));
    // Its points may take more than other text.
    let bytes = Limits::DEFAULT.read(&images)?;
    let text = String::from_utf8_lossy(&bytes);
    let (mut photos, mut ids) = (Vec::new(), BTreeMap::new());
    // Each photo has two lines, the second of which has its points and may be empty.
    let mut lines = text.lines().zip(1..).filter(|(line, _): &(&str, usize)| !line.starts_with('#'));
    while let Some((line, number)) = lines.next() {
        if line.trim().is_empty() {
            continue;
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        let wrong = || {
            let found = format!("line {number} ({line:.60})");
            Error::format(&images, found, "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME of COLMAP's images.txt")
        };
        let [_, pose @ .., camera, name] = &words[..] else { return Err(wrong()) };
        let [w, i, j, k, x, y, z] = numbers::<f64>(pose).and_then(|pose| pose.try_into().ok()).ok_or_else(wrong)?;
        let to_camera = UnitQuaternion::try_new(Quaternion::new(w, i, j, k), 1e-6).ok_or_else(wrong)?;
        let rotation = to_camera.inverse();
        let position = -(rotation * Vector3::new(x, y, z));
        photos.push(PosedPhoto { name: name.into(), position, rotation });
        ids.entry(camera.parse::<u32>().map_err(|_| wrong())?).or_insert(*name);
        lines.next();
    }
    let mut ids = ids.into_iter();
    let (id, first) = ids.next().ok_or_else(|| Error::format(&images, "no photo", "at least two"))?;
    if let Some((other, name)) = ids.next() {
        return Err(Error::format(
            &images,
            format!("the camera {id} of {first} and {other} of {name}"),
            "one camera: run COLMAP's feature_extractor with --ImageReader.single_camera 1",
        ));
    }
    Ok((photos, camera(&cameras, id)?))
}

/// The numbers in words, all of them finite.
fn numbers<T: FromStr + Into<f64> + Copy>(words: &[&str]) -> Option<Vec<T>> {
    words.iter().map(|word| word.parse().ok().filter(|number: &T| (*number).into().is_finite())).collect()
}

/// The camera of a number.
fn camera(path: &Path, id: u32) -> Result<CameraModel> {
    let text = input::read_text(path)?;
    let lines = text.lines().zip(1..).filter(|(line, _): &(&str, usize)| !line.starts_with('#'));
    let mut lines = lines.map(|(line, number)| (line, number, line.split_whitespace().collect::<Vec<_>>()));
    let (line, number, words) = lines
        .find(|(_, _, words)| words.first().is_some_and(|word| *word == id.to_string()))
        .ok_or_else(|| Error::format(path, format!("no camera {id}"), "the camera of images.txt"))?;
    let wrong = || {
        let found = format!("line {number} ({line:.60})");
        Error::format(path, found, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS of COLMAP's cameras.txt")
    };
    let [_, model, width, height, parameters @ ..] = &words[..] else { return Err(wrong()) };
    let size = [width, height].map(|side| side.parse().ok());
    let [Some(width), Some(height)] = size else { return Err(wrong()) };
    let parameters: Vec<f64> = numbers(parameters).ok_or_else(wrong)?;
    // Two focal lengths or one, and the model of the coefficients behind the principal point.
    let (focals, lens_model, coefficients): (usize, LensModel, usize) = match *model {
        "SIMPLE_PINHOLE" => (1, LensModel::PlumbBob, 0),
        "PINHOLE" => (2, LensModel::PlumbBob, 0),
        "SIMPLE_RADIAL" => (1, LensModel::PlumbBob, 1),
        "RADIAL" => (1, LensModel::PlumbBob, 2),
        "OPENCV" => (2, LensModel::PlumbBob, 4),
        "FULL_OPENCV" => (2, LensModel::Rational, 8),
        "SIMPLE_RADIAL_FISHEYE" => (1, LensModel::Equidistant, 1),
        "RADIAL_FISHEYE" => (1, LensModel::Equidistant, 2),
        "OPENCV_FISHEYE" => (2, LensModel::Equidistant, 4),
        other => {
            let known = "a pinhole, radial or OpenCV model: choose one in COLMAP, or undistort the photos there";
            return Err(Error::format(path, format!("the camera model {other:.40}"), known));
        }
    };
    if parameters.len() != focals + 2 + coefficients {
        return Err(wrong());
    }
    let (focal, rest) = parameters.split_at(focals);
    let (principal, given) = rest.split_at(2);
    let mut coefficients = vec![0.0; lens_model.coefficient_names().len()];
    coefficients[..given.len()].copy_from_slice(given);
    let lens = Lens::new(lens_model, &coefficients).map_err(|error| Error::format(path, error.to_string(), "a lens"))?;
    // COLMAP counts pixels from the corner of the image.
    let principal_point = [principal[0] - 0.5, principal[1] - 0.5];
    Ok(CameraModel { size: Some([width, height]), focal_px: [focal[0], focal[focals - 1]], principal_point, lens })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Files as COLMAP writes them.
    fn read(cameras: &str, images: &str) -> Result<(Vec<PosedPhoto>, CameraModel)> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("cameras.txt"), cameras).unwrap();
        std::fs::write(dir.path().join("images.txt"), images).unwrap();
        read_model(dir.path())
    }

    const CAMERAS: &str = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n\
                           1 OPENCV 640 480 960 961 320 240 -0.25 0.08 0.001 -0.002\n";
    /// The second photo is a unit to the right, as a camera sees it that is turned by a quarter about its optical axis.
    const IMAGES: &str = "# Image list with two lines of data per image:\n\
                          1 0.7071067811865476 0 0 0.7071067811865476 1 2 3 1 a.jpg\n10.5 20.5 -1\n\
                          2 0.7071067811865476 0 0 0.7071067811865476 0 2 3 1 b.jpg\n\n";

    #[test]
    fn photos_and_their_camera_are_read() {
        let (photos, camera) = read(CAMERAS, IMAGES).unwrap();
        assert_eq!(photos.iter().map(|photo| photo.name.to_str().unwrap()).collect::<Vec<_>>(), ["a.jpg", "b.jpg"]);
        // R takes (x, y, z) of the world to (-y, x, z). The centre is -R^T t: of (1, 2, 3) it is -(2, -1, 3).
        assert!((photos[0].position - Vector3::new(-2.0, 1.0, -3.0)).norm() < 1e-9, "{}", photos[0].position);
        let offset = photos[0].rotation.inverse() * (photos[1].position - photos[0].position);
        assert!((offset - Vector3::x()).norm() < 1e-9, "{offset}");
        assert_eq!((camera.size, camera.focal_px, camera.principal_point), (Some([640, 480]), [960.0, 961.0], [319.5, 239.5]));
        assert_eq!(camera.lens, Lens::new(LensModel::PlumbBob, &[-0.25, 0.08, 0.001, -0.002, 0.0]).unwrap());
        let (_, simple) = read("1 SIMPLE_RADIAL 640 480 960 320 240 -0.1\n", IMAGES).unwrap();
        assert_eq!(simple.focal_px, [960.0; 2]);
    }

    #[test]
    fn other_files_are_refused() {
        let message = |cameras: &str, images: &str| read(cameras, images).unwrap_err().to_string();
        for (cameras, images, problem) in [
            (CAMERAS, "# none\n", "images.txt: found no photo"),
            (CAMERAS, "1 0 0 0 0 1 2 3 1 a.jpg\n\n", "line 1 (1 0 0 0 0 1 2 3 1 a.jpg)"),
            (CAMERAS, "1 1 0 0 0 1 2 nan 1 a.jpg\n\n", "expected IMAGE_ID QW QX QY QZ"),
            (CAMERAS, "1 1 0 0 0 1 2 3 2 a.jpg\n\n", "cameras.txt: found no camera 2"),
            (CAMERAS, "1 1 0 0 0 1 2 3 1 a.jpg\n\n2 1 0 0 0 0 2 3 2 b.jpg\n\n", "--ImageReader.single_camera 1"),
            ("1 FOV 640 480 960 961 320 240 0.1\n", IMAGES, "the camera model FOV"),
            ("1 OPENCV 640 480 960 961 320 240\n", IMAGES, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS"),
        ] {
            let found = message(cameras, images);
            assert!(found.contains(problem), "{found}");
        }
    }
}
