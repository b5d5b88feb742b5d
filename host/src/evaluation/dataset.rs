//! Public data sets with ground truth.

use std::{fmt, str::FromStr};

use multiscopic_core::{View, Views};

use crate::{
    error::{Error, Result},
    files::FrameFiles,
};

/// A data set with ground truth: its file names, views and disparities.
///
/// | name | centre / left / right / top / bottom | ground truth |
/// | --- | --- | --- |
/// | `middlebury2006-third` | `view1` / `view0` / `view2` / - / - | `disp1.png`, grey / 12, 0 = unknown |
/// | `middlebury2005-full` | as above, and `view3` to `view6`, 2 to 5 baselines right | `disp1.png`, grey / 4, 0 = unknown |
/// | `tsukuba` | `scene1.rowR.colC`, R.C = 3.3 / 3.2 / 3.4 / 2.3 / 4.3 | `truedisp.row3.col3.pgm`, grey / 16, 0 = unknown |
/// | `hci4d` | `input_CamN`, N = 040 / 036 / 044 / 004 / 076 | `gt_disp_lowres.pfm`, times 4, which are camera steps |
///
/// The rest of the array has the same names: R.C from 1.1 to 5.5 in `tsukuba`, and 9 cameras a row in `hci4d`.
///
/// The cameras of `hci4d` are four steps from the centre by default, and one or two with other [`CameraSteps`].
///
/// ```
/// use multiscopic::Dataset;
/// use multiscopic_core::Views;
///
/// let dataset: Dataset = "tsukuba".parse()?;
/// assert_eq!(dataset.views(), Views::CROSS);
/// assert_eq!(dataset.range(), (1, 18));
/// # Ok::<(), multiscopic::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dataset {
    /// Middlebury 2006 at a third of its full size: three views in a row.
    Middlebury2006Third,
    /// Middlebury 2005 at full size: three views in a row.
    Middlebury2005Full,
    /// Tsukuba's head and lamp: a grid of cameras, and a single scene.
    Tsukuba,
    /// The HCI 4D light fields: a grid of 9 x 9 cameras, and how many steps of them are a baseline.
    Hci4d(CameraSteps),
}

impl Dataset {
    /// Every supported data set, with the baseline that it has by default.
    pub const ALL: [Dataset; 4] =
        [Dataset::Middlebury2006Third, Dataset::Middlebury2005Full, Dataset::Tsukuba, Dataset::Hci4d(CameraSteps::Four)];

    /// The name of the data set.
    pub const fn name(self) -> &'static str {
        match self {
            Dataset::Middlebury2006Third => "middlebury2006-third",
            Dataset::Middlebury2005Full => "middlebury2005-full",
            Dataset::Tsukuba => "tsukuba",
            Dataset::Hci4d(_) => "hci4d",
        }
    }

    /// The nearest neighbours in each scene.
    pub const fn views(self) -> Views {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => Views::HORIZONTAL,
            Dataset::Tsukuba | Dataset::Hci4d(_) => Views::CROSS,
        }
    }

    /// Returns true if the scenes have a neighbour.
    pub fn has(self, view: View) -> bool {
        let (right, down) = (view.right(), view.down());
        let in_array = |reach: u8| right.unsigned_abs() <= reach && down.unsigned_abs() <= reach;
        match self {
            Dataset::Middlebury2006Third => down == 0 && right.abs() == 1,
            Dataset::Middlebury2005Full => down == 0 && (-1..=5).contains(&right),
            Dataset::Tsukuba => in_array(2),
            Dataset::Hci4d(steps) => in_array(4 / steps.count()),
        }
    }

    /// The same data set with another baseline, in camera steps.
    ///
    /// # Errors
    /// [`Error::Usage`] if its scenes are no light fields.
    pub fn with_camera_steps(self, steps: CameraSteps) -> Result<Dataset> {
        match self {
            Dataset::Hci4d(_) => Ok(Dataset::Hci4d(steps)),
            other => Err(Error::Usage(format!("{other} has one baseline: the camera steps of a baseline are for hci4d"))),
        }
    }

    /// The baseline in camera steps, unless it is the data set's default.
    pub fn camera_steps(self) -> Option<CameraSteps> {
        match self {
            Dataset::Hci4d(steps) if steps != CameraSteps::Four => Some(steps),
            _ => None,
        }
    }

    /// The occlusion cost for graph cuts, in grey values. The paper uses 10 for photographs. `None` estimates
    /// it from the images: rendered images have no noise, so their matching costs are lower.
    pub const fn occlusion_cost(self) -> Option<f64> {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full | Dataset::Tsukuba => Some(10.0),
            Dataset::Hci4d(_) => None,
        }
    }

    /// The default search range, which contains the disparities of all scenes: the minimum, and the number of
    /// disparities.
    pub const fn range(self) -> (i16, u16) {
        match self {
            Dataset::Middlebury2006Third => (1, 20),
            Dataset::Middlebury2005Full => (1, 60),
            Dataset::Tsukuba => (1, 18),
            // -8 to 8 at four steps.
            Dataset::Hci4d(steps) => (-2 * steps.count() as i16, 4 * steps.count() as u16 + 1),
        }
    }

    /// The image files of the centre and `views` of a scene, relative to its folder.
    pub(super) fn images(self, views: Views) -> FrameFiles {
        let name = |right: i32, down: i32| match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => format!("view{}.png", 1 + right),
            Dataset::Tsukuba => format!("scene1.row{}.col{}.ppm", 3 + down, 3 + right),
            // Nine cameras in a row.
            Dataset::Hci4d(steps) => format!("input_Cam{:03}.png", 40 + i32::from(steps.count()) * (right + 9 * down)),
        };
        let center = FrameFiles { center: name(0, 0).into(), ..FrameFiles::default() };
        views.iter().fold(center, |files, view| files.with(view, name(view.right().into(), view.down().into()).into()))
    }

    /// The ground truth file of a scene, relative to its folder.
    pub(super) const fn truth_file(self) -> &'static str {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => "disp1.png",
            Dataset::Tsukuba => "truedisp.row3.col3.pgm",
            Dataset::Hci4d(_) => "gt_disp_lowres.pfm",
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
            Error::Usage(format!("unknown data set {name}: use one of {names}"))
        })
    }
}

/// The baseline in a light field: the distance from the centre to the nearest views, in steps from one camera to the next.
///
/// Errors are always in pixels of disparity at a baseline of four steps, so that they compare: see
/// [`disparity_scale`](CameraSteps::disparity_scale).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraSteps {
    /// Every camera: views at 1, 2, 3 and 4 baselines.
    One,
    /// Every second camera: views at 1 and 2 baselines.
    Two,
    /// Every fourth camera: views at 1 baseline.
    Four,
}

impl CameraSteps {
    /// Every choice.
    pub const ALL: [CameraSteps; 3] = [CameraSteps::One, CameraSteps::Two, CameraSteps::Four];

    /// The number of steps.
    pub const fn count(self) -> u8 {
        match self {
            CameraSteps::One => 1,
            CameraSteps::Two => 2,
            CameraSteps::Four => 4,
        }
    }

    /// Returns the factor by which disparities at this baseline become those at four steps.
    pub const fn disparity_scale(self) -> u8 {
        4 / self.count()
    }
}

impl fmt::Display for CameraSteps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.count().fmt(f)
    }
}

impl FromStr for CameraSteps {
    type Err = Error;

    fn from_str(text: &str) -> Result<CameraSteps> {
        let steps = CameraSteps::ALL.into_iter().find(|steps| steps.to_string() == text);
        steps.ok_or_else(|| Error::Usage(format!("a baseline of {text} camera steps: use 1, 2 or 4")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::Frame;

    #[test]
    fn a_name_parses_to_its_data_set() {
        assert!(Dataset::ALL.iter().all(|dataset| dataset.to_string().parse::<Dataset>().unwrap() == *dataset));
        let message = "middlebury".parse::<Dataset>().unwrap_err().to_string();
        assert!(message.contains("middlebury2006-third, middlebury2005-full, tsukuba, hci4d"), "{message}");
    }

    #[test]
    fn a_light_field_is_used_at_several_baselines() {
        let cameras = |steps: CameraSteps, view: View| {
            let dataset = Dataset::ALL[3].with_camera_steps(steps).unwrap();
            let file = dataset.images(Views::NONE.with(view)).get(Frame::View(view)).unwrap().to_owned();
            dataset.has(view).then(|| file.to_str().unwrap().to_owned())
        };
        let view = |right, down| View::new(right, down).unwrap();
        let expected = |number: &str| Some(format!("input_Cam{number}.png"));
        assert_eq!(cameras(CameraSteps::Four, View::LEFT), expected("036"));
        assert_eq!(cameras(CameraSteps::Four, view(1, 1)), expected("080"));
        assert_eq!(cameras(CameraSteps::Four, view(2, 0)), None);
        assert_eq!(cameras(CameraSteps::Two, view(-2, 1)), expected("054"));
        assert_eq!(cameras(CameraSteps::Two, view(0, 3)), None);
        assert_eq!(cameras(CameraSteps::One, view(-4, -4)), expected("000"));
        assert_eq!(cameras(CameraSteps::One, view(0, 1)), expected("049"));
        assert_eq!(cameras(CameraSteps::One, view(0, -5)), None);
        let ranges = CameraSteps::ALL.map(|steps| Dataset::Hci4d(steps).range());
        assert_eq!(ranges, [(-2, 5), (-4, 9), (-8, 17)], "-8 to 8 pixels at four steps");
        assert!(Dataset::Tsukuba.with_camera_steps(CameraSteps::Two).is_err());
    }
}
