//! The poses of views, as the stage that moved the camera measured them.

use std::collections::BTreeMap;

use multiscopic_core::{Frame, View};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{HandEye, Mount};
use crate::files::Rig;

/// The pose of the camera in each view, in the frame of the camera in the centre, in millimetres, as far as the stage measured it.
///
/// A stage that only counts its moves gives the place alone. What it measured is nearer to the truth than what it was asked for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasuredViews(BTreeMap<View, Isometry3<f64>>);

impl MeasuredViews {
    /// The views of a rig. Without the camera's place on the tool, it is where the tool is: turns of the tool then do not move it.
    pub fn of_rig(rig: &Rig, hand_eye: Option<&HandEye>) -> MeasuredViews {
        let Some(center) = rig.pose(Frame::Center) else { return MeasuredViews::default() };
        let camera = match hand_eye {
            Some(hand_eye) => hand_eye.camera_in_tool().isometry(),
            None => Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_rotation_matrix(&mount(rig))),
        };
        let pose = |view: View| {
            let pose = rig.pose(Frame::View(view))?;
            if let (Some(center), Some(tool)) = (center.measured, pose.measured) {
                return Some((center.isometry() * camera).inverse() * (tool.isometry() * camera));
            }
            let ([x, y], [from_x, from_y]) = (pose.counted_mm?, center.counted_mm?);
            let moved = rows_and_columns(rig).inverse() * Vector3::new(x - from_x, y - from_y, 0.0);
            Some(Isometry3::from_parts(moved.into(), UnitQuaternion::identity()))
        };
        MeasuredViews(rig.images.views().iter().filter_map(|view| Some((view, pose(view)?))).collect())
    }

    /// The mean length of a rig's baselines in millimetres, along the directions in which its views should stand. `None` unless
    /// the place of every view was measured.
    pub fn baseline_mm(&self, rig: &Rig) -> Option<f64> {
        let (mut lengths, mut squares) = (0.0, 0.0);
        for view in rig.images.views().iter() {
            let nominal = Vector3::new(view.right().into(), view.down().into(), 0.0);
            lengths += nominal.dot(&(rows_and_columns(rig) * self.0.get(&view)?.translation.vector));
            squares += nominal.norm_squared();
        }
        Some(lengths / squares).filter(|mm| *mm > 0.0)
    }

    /// The rotation from rays of the camera in the centre to those of the camera in a view, if it was measured.
    pub(crate) fn turn(&self, view: View) -> Option<Rotation3<f64>> {
        self.0.get(&view).map(|pose| pose.rotation.inverse().to_rotation_matrix())
    }

    /// The largest turn of a view, in radians.
    pub(crate) fn largest_turn(&self) -> f64 {
        self.0.values().map(|pose| pose.rotation.angle()).fold(0.0, f64::max)
    }
}

/// From the camera's axes to those along which it was moved, which are the rows and columns of rectified frames.
fn rows_and_columns(rig: &Rig) -> Rotation3<f64> {
    Mount { rotation_deg: rig.mount_rotation_deg.unwrap_or_default(), ..Mount::SQUARE }.rotation()
}

/// From the camera's axes to those of the stage.
fn mount(rig: &Rig) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), rig.mount_roll_deg.unwrap_or_default().to_radians()) * rows_and_columns(rig)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        files::{FrameFiles, FramePose},
        images::Transform,
    };

    /// A camera that looks 5 degrees up on a tool that looks down, 100 mm beside its axis. The tool is turned by a tenth of a degree
    /// about its own axis on the way to the view on the right, which carries the camera 100 mm * 0.1 degrees forwards.
    #[test]
    fn turns_of_the_tool_move_a_camera_beside_it() {
        let angle: f64 = 0.1;
        let pose = |translation_mm: [f64; 3], rotation: UnitQuaternion<f64>| FramePose {
            asked_mm: [0.0; 2],
            counted_mm: None,
            exposed: None,
            measured: Some(Isometry3::from_parts(translation_mm.into(), rotation).into()),
        };
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let turned = down * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle.to_radians());
        let images = FrameFiles { right: Some("r.png".into()), ..FrameFiles::default() };
        let rig = Rig {
            mount_rotation_deg: Some([5.0, 0.0, 0.0]),
            poses: [("center".into(), pose([400.0, 0.0, 300.0], down)), ("right".into(), pose([420.0, 0.0, 300.0], turned))]
                .into(),
            ..Rig::of_pair(None, images)
        };
        let of = |hand_eye: Option<HandEye>| MeasuredViews::of_rig(&rig, hand_eye.as_ref());
        let alone = of(None);
        assert!((alone.baseline_mm(&rig).unwrap() - 20.0).abs() < 1e-9);
        // In the camera's frame, the tool's axis is 5 degrees off its own.
        let turn = alone.turn(View::RIGHT).unwrap().scaled_axis().map(f64::to_degrees);
        let (sin, cos) = 5.0_f64.to_radians().sin_cos();
        assert!((turn - Vector3::new(0.0, -angle * sin, -angle * cos)).norm() < 1e-9, "{turn}");
        let hand_eye = |translation_mm| HandEye {
            translation_mm,
            rotation_deg: [5.0, 0.0, 0.0],
            translation_deviation_mm: None,
            rotation_deviation_deg: None,
            covariance: None,
        };
        // To the tool's y, a turn about z moves the camera against x.
        let beside = of(Some(hand_eye([0.0, 100.0, 50.0])));
        let expected = 20.0 - 100.0 * angle.to_radians().sin();
        assert!((beside.baseline_mm(&rig).unwrap() - expected).abs() < 1e-9, "{:?}", beside.baseline_mm(&rig));
        assert_eq!(MeasuredViews::of_rig(&Rig::of_pair(None, FrameFiles::default()), None), MeasuredViews::default());
        assert_eq!(Transform::from(Isometry3::identity()), Transform::IDENTITY);
    }

    #[test]
    fn counted_moves_are_along_rows_and_columns() {
        let pose = |counted_mm| FramePose { asked_mm: [0.0; 2], counted_mm, exposed: None, measured: None };
        let images = FrameFiles { left: Some("l.png".into()), bottom: Some("b.png".into()), ..FrameFiles::default() };
        let mut rig = Rig {
            mount_rotation_deg: Some([0.0, 3.0, 0.0]),
            mount_roll_deg: Some(30.0),
            sweep: Vec::new(),
            poses: [
                ("center".into(), pose(Some([0.1, 0.0]))),
                ("left".into(), pose(Some([-19.9, 0.05]))),
                ("bottom".into(), pose(Some([0.1, 20.1]))),
            ]
            .into(),
            ..Rig::of_pair(None, images)
        };
        let views = MeasuredViews::of_rig(&rig, None);
        assert!((views.baseline_mm(&rig).unwrap() - 20.05).abs() < 1e-9);
        assert_eq!(views.largest_turn(), 0.0);
        rig.poses.remove("left");
        assert_eq!(MeasuredViews::of_rig(&rig, None).baseline_mm(&rig), None, "a view is unknown");
    }
}
