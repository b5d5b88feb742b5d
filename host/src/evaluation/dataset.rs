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
/// | `middlebury2005-full` | as above, and `view3` to `view6` 2 to 5 baselines to the right | `disp1.png`, grey / 4, 0 = unknown |
/// | `tsukuba` | `scene1.rowR.colC`, R.C = 3.3 / 3.2 / 3.4 / 2.3 / 4.3, and the corners 2.2 to 4.4 | `truedisp.row3.col3.pgm`, grey / 16, 0 = unknown |
/// | `hci4d` | `input_CamN`, N = 040 / 036 / 044 / 004 / 076, and the corners 000, 008, 072 and 080 | `gt_disp_lowres.pfm`, times the 4 camera steps of the baseline |
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dataset {
    /// Middlebury 2006 at a third of its full size: three views in a row.
    Middlebury2006Third,
    /// Middlebury 2005 at full size: three views in a row.
    Middlebury2005Full,
    /// Tsukuba's head and lamp: a grid of cameras, and a single scene.
    Tsukuba,
    /// The HCI 4D light fields: a grid of 9 x 9 cameras, of which every fourth is used.
    Hci4d,
}

impl Dataset {
    /// Every supported data set.
    pub const ALL: [Dataset; 4] = [Dataset::Middlebury2006Third, Dataset::Middlebury2005Full, Dataset::Tsukuba, Dataset::Hci4d];

    /// The name of the data set.
    pub const fn name(self) -> &'static str {
        match self {
            Dataset::Middlebury2006Third => "middlebury2006-third",
            Dataset::Middlebury2005Full => "middlebury2005-full",
            Dataset::Tsukuba => "tsukuba",
            Dataset::Hci4d => "hci4d",
        }
    }

    /// The nearest neighbours in each scene.
    pub const fn views(self) -> Views {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => Views::HORIZONTAL,
            Dataset::Tsukuba | Dataset::Hci4d => Views::CROSS,
        }
    }

    /// All neighbours in each scene that can be used.
    pub fn all_views(self) -> Views {
        match self {
            Dataset::Middlebury2006Third => Views::HORIZONTAL,
            Dataset::Middlebury2005Full => {
                (2..=5).filter_map(|right| View::new(right, 0).ok()).fold(Views::HORIZONTAL, Views::with)
            }
            Dataset::Tsukuba | Dataset::Hci4d => Views::ARRAY,
        }
    }

    /// The occlusion cost for graph cuts, in grey values. The paper uses 10 for photographs. `None` estimates
    /// it from the images: rendered images have no noise, so their matching costs are lower.
    pub const fn occlusion_cost(self) -> Option<f64> {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full | Dataset::Tsukuba => Some(10.0),
            Dataset::Hci4d => None,
        }
    }

    /// The default search range, which contains the disparities of all scenes: the minimum, and the number of
    /// disparities.
    pub const fn range(self) -> (i16, u16) {
        match self {
            Dataset::Middlebury2006Third => (1, 20),
            Dataset::Middlebury2005Full => (1, 60),
            Dataset::Tsukuba => (1, 18),
            Dataset::Hci4d => (-8, 17),
        }
    }

    /// The image files of a scene, relative to its folder.
    pub(super) fn images(self) -> FrameFiles {
        let name = |right: i32, down: i32| match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => format!("view{}.png", 1 + right),
            Dataset::Tsukuba => format!("scene1.row{}.col{}.ppm", 3 + down, 3 + right),
            // Nine cameras in a row, of which every fourth is used.
            Dataset::Hci4d => format!("input_Cam{:03}.png", 40 + 4 * right + 36 * down),
        };
        let center = FrameFiles { center: name(0, 0).into(), ..FrameFiles::default() };
        self.all_views().iter().fold(center, |files, view| files.with(view, name(view.right().into(), view.down().into()).into()))
    }

    /// The ground truth file of a scene, relative to its folder.
    pub(super) const fn truth_file(self) -> &'static str {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => "disp1.png",
            Dataset::Tsukuba => "truedisp.row3.col3.pgm",
            Dataset::Hci4d => "gt_disp_lowres.pfm",
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_parses_to_its_data_set() {
        assert!(Dataset::ALL.iter().all(|dataset| dataset.to_string().parse::<Dataset>().unwrap() == *dataset));
        let message = "middlebury".parse::<Dataset>().unwrap_err().to_string();
        assert!(message.contains("middlebury2006-third, middlebury2005-full, tsukuba, hci4d"), "{message}");
        assert!(Dataset::ALL.iter().all(|dataset| dataset.images().views() == dataset.all_views()));
    }
}
