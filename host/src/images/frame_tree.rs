//! The frames of coordinates of a capture with an arm, and where they are in each other.

use super::Transform;

/// A frame of coordinates for points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointFrame {
    /// The camera's optical frame where it took the centre: x to the right, y down, z along the optical axis.
    Camera,
    /// The frame of the tool that carries the camera, when it took the centre.
    Tool,
    /// The frame of the arm's base.
    Base,
}

impl PointFrame {
    /// Its name, as in `--frame`.
    pub const fn name(self) -> &'static str {
        match self {
            PointFrame::Camera => "camera",
            PointFrame::Tool => "tool",
            PointFrame::Base => "base",
        }
    }

    /// Its name in messages of ROS.
    pub const fn id(self) -> &'static str {
        match self {
            PointFrame::Camera => "camera_optical_frame",
            PointFrame::Tool => "tool",
            PointFrame::Base => "base",
        }
    }
}

/// The places of the frames of a capture in each other, as far as they are known. By default, the camera is all that there is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTree {
    /// From the camera of rectified frames, which is turned until it moved along its rows and columns, to the camera in the centre.
    pub rectified_in_camera: Transform,
    /// From the camera to the tool that carries it.
    pub camera_in_tool: Option<Transform>,
    /// From the tool to the base, when the centre was taken.
    pub tool_in_base: Option<Transform>,
}

impl Default for FrameTree {
    fn default() -> FrameTree {
        FrameTree { rectified_in_camera: Transform::IDENTITY, camera_in_tool: None, tool_in_base: None }
    }
}

impl FrameTree {
    /// The transform from the camera of rectified frames to a frame. `None` if that is not known.
    pub fn from_rectified(&self, frame: PointFrame) -> Option<Transform> {
        let in_tool = || Some(self.camera_in_tool? * self.rectified_in_camera);
        match frame {
            PointFrame::Camera => Some(self.rectified_in_camera),
            PointFrame::Tool => in_tool(),
            PointFrame::Base => Some(self.tool_in_base? * in_tool()?),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_go_from_the_camera_to_the_base() {
        // The tool looks down from 500 mm; the camera sits 100 mm along its x axis, turned by a quarter about its optical axis; rectified
        // frames look 30 degrees down against the camera.
        let transform = |translation_mm, rotation_deg| Transform { translation_mm, rotation_deg };
        let tree = FrameTree {
            rectified_in_camera: transform([0.0; 3], [30.0, 0.0, 0.0]),
            camera_in_tool: Some(transform([100.0, 0.0, 0.0], [0.0, 0.0, 90.0])),
            tool_in_base: Some(transform([400.0, -200.0, 500.0], [180.0, 0.0, 0.0])),
        };
        let at = |frame| tree.from_rectified(frame).unwrap().point([0.0, 0.0, 100.0]);
        let (sin, cos) = (50.0, 100.0 * 0.75_f64.sqrt());
        // The axis ahead goes up in the camera's frame, since the camera looks down less; its up is the tool's right.
        for (frame, expected) in [
            (PointFrame::Camera, [0.0, -sin, cos]),
            (PointFrame::Tool, [100.0 + sin, 0.0, cos]),
            (PointFrame::Base, [500.0 + sin, -200.0, 500.0 - cos]),
        ] {
            let found = at(frame);
            assert!(
                found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9),
                "{frame:?}: {found:?} instead of {expected:?}"
            );
        }
        let alone = FrameTree { camera_in_tool: None, ..tree };
        assert_eq!([PointFrame::Tool, PointFrame::Base].map(|frame| alone.from_rectified(frame)), [None; 2]);
    }
}
