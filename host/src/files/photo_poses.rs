//! Photos with the poses of their cameras, and the views that they are of.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use multiscopic_core::View;
use nalgebra::{UnitQuaternion, Vector3};

use super::{frame_files::FrameFiles, input};
use crate::error::{Error, Result};

/// The largest distance of a photo from a whole number of baselines, along each axis of the centre's camera, in baselines.
const TOLERANCE: f64 = 0.05;

/// The largest turn of a camera against that of the centre, in degrees.
const MAX_TURN_DEG: f64 = 5.0;

/// A photo and the pose of its camera, whose axes point to the right of the image, down, and ahead.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedPhoto {
    /// The file, relative to the folder of all.
    pub name: PathBuf,
    /// The place of the camera, in the unit of its source.
    pub position: Vector3<f64>,
    /// The rotation that takes directions of the camera to those of the frame of all places.
    pub rotation: UnitQuaternion<f64>,
}

impl PosedPhoto {
    /// The columns of a table of positions.
    const COLUMNS: [&str; 7] = ["name", "x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"];

    /// Reads a table of comma-separated values: a line of the names of its columns, and a line for each photo. The columns
    /// `name`, `x_mm` and `y_mm` must be there. `z_mm` may follow, and `rx_deg`, `ry_deg` and `rz_deg`: an axis times an angle.
    /// Without angles, x points to the right of the images and y down.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] that names the line.
    pub fn read_table(path: &Path) -> Result<Vec<PosedPhoto>> {
        let text = input::read_text(path)?;
        let mut lines = text.lines().zip(1..).map(|(line, number): (&str, usize)| (line.trim(), number));
        let mut lines = lines.by_ref().filter(|(line, _)| !line.is_empty() && !line.starts_with('#'));
        let cells = |line: &str| line.split(',').map(|cell| cell.trim().trim_matches('"').to_owned()).collect::<Vec<_>>();
        let columns = lines.next().map(|(line, _)| cells(line.trim_start_matches('\u{feff}'))).unwrap_or_default();
        let is_known = [3, 4, 7].contains(&columns.len()) && columns.iter().zip(Self::COLUMNS).all(|(a, b)| *a == b);
        if !is_known {
            let expected = format!("{}, or the first 3 or 4 of them", Self::COLUMNS.join(","));
            return Err(Error::format(path, format!("the columns {}", columns.join(",")), expected));
        }
        let photo = |(line, number): (&str, usize)| {
            let wrong =
                |problem: String| Error::format(path, format!("line {number} ({line:.60}) with {problem}"), "a name and numbers");
            let cells = cells(line);
            if cells.len() != columns.len() {
                return Err(wrong(format!("{} cells, not {}", cells.len(), columns.len())));
            }
            let mut numbers = [0.0; 6];
            for (number, cell) in numbers.iter_mut().zip(&cells[1..]) {
                let value = cell.parse().ok().filter(|value: &f64| value.abs() <= 1e7);
                *number = value.ok_or_else(|| wrong(format!("`{cell:.20}`")))?;
            }
            let [x, y, z, a, b, c] = numbers;
            let rotation = UnitQuaternion::new(Vector3::new(a, b, c).map(f64::to_radians));
            Ok(PosedPhoto { name: cells[0].as_str().into(), position: Vector3::new(x, y, z), rotation })
        };
        lines.map(photo).collect()
    }
}

/// Photos as a centre and views, at whole multiples of a baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoGrid {
    /// The files.
    pub images: FrameFiles,
    /// The baseline, in the unit of the places: the given one, or else that which fits all places best.
    pub baseline: f64,
    /// The places of the views in baselines, to the right of the centre and below it, as they were measured.
    pub places: BTreeMap<View, [f64; 2]>,
}

impl PhotoGrid {
    /// Arranges photos around the one of the name `center`, or else the one in the middle of all. The baseline is the distance to
    /// its nearest neighbour unless it is given.
    ///
    /// # Errors
    /// [`Error::Usage`] that names the photo that stands at no whole multiple of the baseline in the plane of the centre's
    /// image, is turned by more than 5 degrees, or has the place of another.
    pub fn of(photos: &[PosedPhoto], center: Option<&Path>, baseline: Option<f64>) -> Result<PhotoGrid> {
        let center = named_or_middle(photos, center)?;
        let others: Vec<(&PosedPhoto, Vector3<f64>)> = photos
            .iter()
            .filter(|photo| !std::ptr::eq(*photo, center))
            .map(|photo| (photo, center.rotation.inverse() * (photo.position - center.position)))
            .collect();
        let nearest = others.iter().map(|(_, offset)| offset.xy().norm()).fold(f64::INFINITY, f64::min);
        let unit = baseline.unwrap_or(nearest);
        if !(unit > 0.0 && unit.is_finite()) {
            return Err(Error::Usage("two photos have the same place, or there is only one: a view needs another".into()));
        }
        let mut grid = PhotoGrid {
            images: FrameFiles { center: center.name.clone(), ..FrameFiles::default() },
            baseline: unit,
            places: BTreeMap::new(),
        };
        let mut multiples = Vec::new();
        for (photo, offset) in &others {
            let view = view_at(offset / unit, center, photo, unit)?;
            let turn = center.rotation.angle_to(&photo.rotation).to_degrees();
            if turn > MAX_TURN_DEG {
                return Err(Error::Usage(format!(
                    "{} is turned by {turn:.1} degrees against {}: views may be turned by {MAX_TURN_DEG}, which `match --align` \
                     takes out; leave it out",
                    photo.name.display(),
                    center.name.display()
                )));
            }
            if grid.places.insert(view, [offset.x, offset.y]).is_some() {
                let (name, other) =
                    (photo.name.display(), grid.images.get(multiscopic_core::Frame::View(view)).map(Path::display));
                return Err(Error::Usage(format!(
                    "{name} and {} are both at {view}: leave one of them out",
                    other.map(|other| other.to_string()).unwrap_or_default()
                )));
            }
            grid.images = grid.images.with(view, photo.name.clone());
            multiples.push(([f64::from(view.right()), f64::from(view.down())], offset));
        }
        if baseline.is_none() {
            // The least squares of all places.
            let along: f64 = multiples.iter().map(|([x, y], offset)| x * offset.x + y * offset.y).sum();
            grid.baseline = along / multiples.iter().map(|([x, y], _)| x * x + y * y).sum::<f64>();
        }
        let baseline = grid.baseline;
        grid.places.values_mut().for_each(|place| *place = place.map(|offset| offset / baseline));
        Ok(grid)
    }

    /// The largest distance of a photo from its view along an axis, in baselines.
    pub fn deviation(&self) -> f64 {
        let of_view =
            |(view, [x, y]): (&View, &[f64; 2])| (x - f64::from(view.right())).abs().max((y - f64::from(view.down())).abs());
        self.places.iter().map(of_view).fold(0.0, f64::max)
    }
}

/// Photos as a centre and the frames of a sweep, to its left and right at any distances.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoLine {
    /// The file of the centre.
    pub center: PathBuf,
    /// The files of the others, and their distances to the right of the centre, in the unit of the places, in ascending order.
    pub frames: Vec<(PathBuf, f64)>,
}

impl PhotoLine {
    /// Arranges photos around the one of the name `center`, or else the one in the middle of all. `None` unless all of them, at
    /// least two beside the centre, stand along the rows of its image and look the same way.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is no photo of this name.
    pub fn of(photos: &[PosedPhoto], center: Option<&Path>) -> Result<Option<PhotoLine>> {
        let center = named_or_middle(photos, center)?;
        let others = photos.iter().filter(|photo| !std::ptr::eq(*photo, center));
        let offset = |photo: &PosedPhoto| center.rotation.inverse() * (photo.position - center.position);
        let mut frames: Vec<(PathBuf, f64)> = others.clone().map(|photo| (photo.name.clone(), offset(photo).x)).collect();
        let farthest = frames.iter().map(|(_, right)| right.abs()).fold(0.0, f64::max);
        let is_on_line = |photo: &PosedPhoto| {
            let [_, down, ahead] = offset(photo).into();
            let turn = center.rotation.angle_to(&photo.rotation).to_degrees();
            f64::max(down.abs(), ahead.abs()) <= TOLERANCE * farthest && turn <= MAX_TURN_DEG
        };
        if frames.len() < 2 || !others.clone().all(is_on_line) {
            return Ok(None);
        }
        frames.sort_by(|(_, a), (_, b)| a.total_cmp(b));
        Ok(Some(PhotoLine { center: center.name.clone(), frames }))
    }
}

/// The photo of a name, or else the one in the middle.
fn named_or_middle<'a>(photos: &'a [PosedPhoto], name: Option<&Path>) -> Result<&'a PosedPhoto> {
    match name {
        Some(name) => photos.iter().find(|photo| photo.name == name).ok_or_else(|| {
            let names: Vec<String> = photos.iter().take(8).map(|photo| photo.name.display().to_string()).collect();
            Error::Usage(format!("no photo is named {}: there are {}", name.display(), names.join(", ")))
        }),
        None => middle(photos).ok_or_else(|| Error::Usage("there are no photos".into())),
    }
}

/// The photo nearest to the mean of all places, the first of several.
fn middle(photos: &[PosedPhoto]) -> Option<&PosedPhoto> {
    let mean = photos.iter().map(|photo| photo.position).sum::<Vector3<f64>>() / photos.len().max(1) as f64;
    let distance = |photo: &PosedPhoto| (photo.position - mean).norm();
    // Rounding must not decide between two.
    let least = photos.iter().map(distance).fold(f64::INFINITY, f64::min);
    photos.iter().find(|photo| distance(photo) <= least * (1.0 + 1e-9))
}

/// The view at an offset in baselines.
fn view_at(offset: Vector3<f64>, center: &PosedPhoto, photo: &PosedPhoto, baseline: f64) -> Result<View> {
    let [right, down] = [offset.x.round(), offset.y.round()];
    let is_near = (offset - Vector3::new(right, down, 0.0)).amax() <= TOLERANCE;
    let limit = f64::from(View::MAX_OFFSET);
    let view = (right.abs() <= limit && down.abs() <= limit).then(|| View::new(right as i8, down as i8).ok()).flatten();
    view.filter(|_| is_near).ok_or_else(|| {
        Error::Usage(format!(
            "{} stands {:.2} baselines to the right of {}, {:.2} below and {:.2} ahead, where the baseline is {baseline:.4}; only whole \
             multiples to the right and down, up to {limit}, can be matched: give the baseline, or leave it out",
            photo.name.display(),
            offset.x,
            center.name.display(),
            offset.y,
            offset.z
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Result<Vec<PosedPhoto>> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("positions.csv");
        std::fs::write(&path, text).unwrap();
        PosedPhoto::read_table(&path)
    }

    fn grid(text: &str) -> Result<PhotoGrid> {
        PhotoGrid::of(&table(text)?, None, None)
    }

    #[test]
    fn positions_become_views() {
        let text = "name,x_mm,y_mm\na.jpg,100,50\n\n# further out\nb.jpg,120.1,50.0\nc.jpg,59.9,50.1\n\"d.jpg\",100,30.2\n";
        let found = PhotoGrid::of(&table(text).unwrap(), Some("a.jpg".as_ref()), None).unwrap();
        let expected = FrameFiles { center: "a.jpg".into(), ..FrameFiles::default() }
            .with(View::RIGHT, "b.jpg".into())
            .with(View::new(-2, 0).unwrap(), "c.jpg".into())
            .with(View::TOP, "d.jpg".into());
        assert_eq!(found.images, expected);
        // Least squares of 20.1, 2 x 20.05 and 19.8.
        assert!((found.baseline - (20.1 + 2.0 * 40.1 + 19.8) / 6.0).abs() < 1e-9, "{}", found.baseline);
        assert!(found.deviation() < 0.02, "{}", found.deviation());
        // Two of a cross of three are as near to its middle.
        assert_eq!(grid("name,x_mm,y_mm\na,0,0\nb,20,0\n").unwrap().images.center, Path::new("a"));
    }

    /// A camera that looks down, whose x is the world's y: the world's offsets are turned into the image.
    #[test]
    fn poses_are_seen_from_the_centre() {
        // The axes of the camera in the world: x (0, 1, 0), y (1, 0, 0), z (0, 0, -1), a half turn about (1, 1, 0).
        let half = 180.0 / 2.0_f64.sqrt();
        let line = |name: &str, x: f64, y: f64| format!("{name},{x},{y},500,{half},{half},0\n");
        let head = "name,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n";
        let text = [head, &line("c", 0.0, 0.0), &line("r", 0.0, 20.0), &line("l", 0.0, -20.0), &line("b", 20.0, 0.0)].concat();
        let images = PhotoGrid::of(&table(&text).unwrap(), Some("c".as_ref()), Some(20.0)).unwrap().images;
        let found = [View::RIGHT, View::LEFT, View::BOTTOM].map(|view| images.get(multiscopic_core::Frame::View(view)).unwrap());
        assert_eq!(found.map(|path| path.to_str().unwrap()), ["r", "l", "b"]);
    }

    #[test]
    fn photos_along_a_row_are_a_sweep() {
        let line = |text: &str| PhotoLine::of(&table(text).unwrap(), None).unwrap();
        let found = line("name,x_mm,y_mm\na,0,0\nb,7.5,0.1\nc,-20,0\nd,13,-0.2\n").unwrap();
        assert_eq!(found.center, Path::new("a"));
        assert_eq!(found.frames, [("c".into(), -20.0), ("b".into(), 7.5), ("d".into(), 13.0)]);
        assert_eq!(line("name,x_mm,y_mm\na,0,0\nb,7.5,2\nc,-20,0\n"), None, "beside the row");
        assert_eq!(line("name,x_mm,y_mm\na,0,0\nb,7.5,0\n"), None, "two photos");
        let turned = "name,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\na,0,0,0,0,0,0\nb,7,0,0,0,6,0\nc,-9,0,0,0,0,0\n";
        assert_eq!(line(turned), None, "turned");
    }

    #[test]
    fn what_cannot_be_matched_is_refused() {
        for (text, problem) in [
            ("name,x,y\n", "the columns name,x,y, expected name,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg"),
            ("", "found an empty file"),
            ("name,x_mm,y_mm\na,0\n", "line 2 (a,0) with 2 cells, not 3"),
            ("name,x_mm,y_mm\na,0,nan\n", "line 2 (a,0,nan) with `nan`"),
            ("name,x_mm,y_mm\n", "there are no photos"),
            ("name,x_mm,y_mm\na,0,0\n", "there is only one"),
            ("name,x_mm,y_mm\na,0,0\nb,20,0\nc,50,0\n", "c stands 1.50 baselines to the right of b"),
            ("name,x_mm,y_mm\na,0,0\nb,20,0\nc,-28,0\n", "c stands -1.40 baselines to the right of a, 0.00 below"),
            ("name,x_mm,y_mm,z_mm\na,0,0,0\nb,20,0,0\nc,-20,0,3\n", "0.00 below and 0.15 ahead"),
            ("name,x_mm,y_mm\na,0,0\nb,20,0\nc,20,0.1\nd,-39,0\n", "c and b are both at right"),
            ("name,x_mm,y_mm\na,0,0\nb,20,0\nc,400,0\n", "up to 16"),
            ("name,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\na,0,0,0,0,0,0\nb,20,0,0,0,6,0\n", "b is turned by 6.0 degrees against a"),
        ] {
            let message = grid(text).unwrap_err().to_string();
            assert!(message.contains(problem), "{text}: {message}");
        }
    }
}
