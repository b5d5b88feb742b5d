//! How far apart the cameras of a light field are used.

use std::{fmt, str::FromStr};

use crate::error::{Error, Result};

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

    /// What disparities at this baseline are multiplied by to be those at four steps.
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
