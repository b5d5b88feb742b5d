//! Public data sets with ground truth.

use std::{fmt, str::FromStr};

use multiscopic_core::Views;

use crate::{
    error::{Error, Result},
    files::FrameFiles,
};

/// A data set with ground truth: its file names, views and disparities.
///
/// | name | centre / left / right / top / bottom | ground truth |
/// | --- | --- | --- |
/// | `middlebury2006-third` | `view1` / `view0` / `view2` / - / - | `disp1.png`, grey / 12, 0 = unknown |
/// | `middlebury2005-full` | as above | `disp1.png`, grey / 4, 0 = unknown |
/// | `tsukuba` | `scene1.rowR.colC`, R.C = 3.3 / 3.2 / 3.4 / 2.3 / 4.3 | `truedisp.row3.col3.pgm`, grey / 16, 0 = unknown |
/// | `hci4d` | `input_CamN`, N = 040 / 036 / 044 / 004 / 076 | `gt_disp_lowres.pfm`, times the 4 camera steps of the baseline |
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

    /// The neighbours in each scene.
    pub const fn views(self) -> Views {
        match self {
            Dataset::Middlebury2006Third | Dataset::Middlebury2005Full => Views::HORIZONTAL,
            Dataset::Tsukuba | Dataset::Hci4d => Views::ALL,
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
        assert!(Dataset::ALL.iter().all(|dataset| dataset.images().views() == dataset.views()));
    }
}
