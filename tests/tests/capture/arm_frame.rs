//! A cloud in the frame of an arm's base: a simulated arm that misses its targets and turns a little carries a camera with a lens,
//! turned against the tool and beside it, over a table with a ball.

use std::{
    convert::Infallible,
    f64::consts::PI,
    fs,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize},
    },
    time::Duration,
};

use multiscopic::{
    CameraModel, Lens, LensModel, Picture, Rig,
    capture::{
        BlockingCamera, ThreadedCamera, acquire_images,
        stage::{AnyStage, Limits, PosedStage, StageError, TurnedStage},
    },
    files::FrameFiles,
    images::Transform,
    lens::{HandEye, MeasuredViews},
    scene::{Finish, Lamp, Object, PinholeCamera, Placement, PosedCamera, Scene, Shape, Texture, Vec3, render_at},
};
use multiscopic_core::{
    Views,
    capture::{Plan, Policy, Position, Stage},
};
use multiscopic_reference::split_mix::Random;
use multiscopic_tests::{
    program::Invocation,
    simulated::{
        arm::SimulatedArm,
        pose::{Pose, pose_trans},
    },
};

/// A tool that looks down on the table.
const START: Pose = [0.4, -0.2, 0.5, PI, 0.0, 0.0];
/// The camera on the tool, in metres and radians: beside it, tilted by 5 degrees and rolled by 3.
const ON_TOOL: Pose = [0.03, -0.04, 0.06, 5.0 * PI / 180.0, 0.0, 3.0 * PI / 180.0];
/// The most by which the arm misses a target and turns the tool, along and about each axis.
const MISS_M: f64 = 0.05e-3;
const TURN: f64 = 0.03 * PI / 180.0;
/// The table's height and the ball, in millimetres in the frame of the base.
const TABLE_MM: f64 = -100.0;
const BALL_MM: [f64; 3] = [430.0, -160.0, -40.0];
const RADIUS_MM: f64 = 60.0;
const SIZE: [usize; 2] = [640, 480];

fn lens() -> CameraModel {
    let lens = Lens::new(LensModel::PlumbBob, &[-0.25, 0.08, 0.0, 0.0, 0.0]).expect("five coefficients");
    CameraModel { size: Some(SIZE), focal_px: [940.0; 2], principal_point: [324.0, 235.0], lens }
}

/// The true place of the tool when its drives are at a pose, as the arm measures: each place has its own error.
fn measured(arm: &SimulatedArm) -> Pose {
    let pose = arm.pose();
    let key = pose.iter().take(3).fold(0, |key: u64, metres| key.wrapping_mul(1_000_003) ^ (metres * 1e5).round() as i64 as u64);
    let mut random = Random(key);
    let mut within = |most: f64| most * (2.0 * (random.bits() >> 11) as f64 / (1_u64 << 53) as f64 - 1.0);
    pose_trans(pose, [within(MISS_M), within(MISS_M), within(MISS_M), within(TURN), within(TURN), within(TURN)])
}

/// An arm that measures by how much it misses.
struct Shaky {
    stage: AnyStage,
    arm: Arc<SimulatedArm>,
}

impl Stage for Shaky {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.stage.move_to(position)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        self.stage.has_arrived()
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        self.stage.position()
    }

    fn stop(&mut self) -> Result<(), StageError> {
        self.stage.stop()
    }
}

impl PosedStage for Shaky {
    fn pose(&mut self) -> Result<Option<Transform>, StageError> {
        let [x, y, z, rx, ry, rz] = measured(&self.arm);
        let (translation_mm, rotation_deg) = ([x, y, z].map(|metres| 1e3 * metres), [rx, ry, rz].map(f64::to_degrees));
        Ok(Some(Transform { translation_mm, rotation_deg }))
    }
}

/// A camera that the arm carries.
struct Eye(Arc<SimulatedArm>);

impl BlockingCamera for Eye {
    type Error = Infallible;

    fn take(&mut self, _: Duration, _: &AtomicBool) -> Result<Picture, Infallible> {
        let pose = pose_trans(measured(&self.0), ON_TOOL);
        let at = |offset: [f64; 3]| {
            let [x, y, z] = offset;
            let [x, y, z, ..] = pose_trans(pose, [x, y, z, 0.0, 0.0, 0.0]);
            Vec3::new(1e3 * x, 1e3 * y, 1e3 * z)
        };
        let origin = at([0.0; 3]);
        let axis = |offset: [f64; 3]| (at(offset) - origin) * 1e-3;
        let axes = [axis([1.0, 0.0, 0.0]), axis([0.0, 1.0, 0.0]), axis([0.0, 0.0, 1.0])];
        let sensor = PinholeCamera::new(SIZE[0] as u32, SIZE[1] as u32);
        let camera = PosedCamera { sensor, lens: Some(lens()), pose: multiscopic::scene::Pose { origin, axes } };
        Ok(Picture::Rgb(render_at(&scene(), &camera, 1)))
    }
}

/// The table and the ball, in light from all sides.
fn scene() -> Scene {
    let (dark, bright) = (Vec3::new(0.02, 0.02, 0.02), Vec3::new(1.0, 1.0, 1.0));
    let object = |shape, at: [f64; 3], texture| Object {
        shape,
        pose: multiscopic::scene::Pose::at(at.into()),
        texture,
        placement: Placement::IDENTITY,
        finish: Finish::Matte,
    };
    let table = Texture::Plaster { low: dark, high: bright, grain: 1.5, octaves: 4 };
    let ball = Texture::Clouds { low: dark, high: bright, grain: 1.5, octaves: 4 };
    let light = Vec3::new(0.7, 0.7, 0.7);
    Scene {
        objects: vec![
            object(Shape::Panel { half_width: 2000.0, half_height: 2000.0 }, [400.0, -200.0, TABLE_MM], table),
            object(Shape::Sphere { radius: RADIUS_MM }, BALL_MM, ball),
        ],
        lamp: Lamp {
            center: Vec3::new(0.0, 0.0, 2000.0),
            half_u: Vec3::new(0.0, 1.0, 0.0),
            half_v: Vec3::new(1.0, 0.0, 0.0),
            light: Vec3::ZERO,
        },
        sky: light,
        ground: light,
        viewpoint: multiscopic::scene::Pose::at(Vec3::ZERO),
    }
}

/// Captures with the arm, as `capture --lens --hand-eye` does.
fn capture(folder: &Path) {
    let arm = Arc::new(SimulatedArm::start(START));
    let patience = Duration::from_secs(120);
    let limits = Limits {
        speed_mm_s: 250.0,
        acceleration_mm_s2: 1200.0,
        connect_timeout: patience,
        silence_timeout: patience,
        stall_timeout: patience,
        ..Limits::default()
    };
    let [x, y, z, rx, ry, rz] = ON_TOOL;
    let hand_eye = HandEye {
        translation_mm: [x, y, z].map(|metres| 1e3 * metres),
        rotation_deg: [rx, ry, rz].map(f64::to_degrees),
        translation_deviation_mm: None,
        rotation_deviation_deg: None,
        covariance: None,
    };
    let (roll, rest) = hand_eye.mount().split_roll();
    let mut stage = TurnedStage::new(Shaky { stage: arm.stage(&limits).expect("an arm"), arm: arm.clone() }, roll);
    let seen = arm.clone();
    let mut camera = ThreadedCamera::new(move || Ok(Eye(seen.clone())), patience);
    let policy = Policy { settle: Duration::ZERO, frame_timeout: patience, move_timeout: patience, ..Policy::default() };
    let plan = Plan::new(Views::CROSS, 20_000);
    let taken = acquire_images(&mut stage, &mut camera, &plan, policy, &AtomicUsize::new(0), |_, _| ()).expect("a capture");
    let poses = taken.poses.iter().map(|(frame, pose)| (frame.to_string(), *pose)).collect();
    let frames = taken.frames();
    let mut rig = Rig {
        baseline_mm: Some(20.0),
        focal_px: Some(lens().focal_px[0]),
        principal_point: Some(lens().principal_point),
        lens: Some(CameraModel::FILE_NAME.into()),
        mount_rotation_deg: Some(rest.rotation_deg),
        mount_roll_deg: Some(roll.to_degrees()),
        sweep: Vec::new(),
        hand_eye: Some(HandEye::FILE_NAME.into()),
        poses,
        ..Rig::of_pair(None, FrameFiles::of_capture(frames.views()))
    };
    rig.baseline_mm = MeasuredViews::of_rig(&rig, Some(&hand_eye)).baseline_mm(&rig);
    fs::create_dir(folder).expect("a new folder");
    frames.save(&rig.images.within(folder)).expect("images");
    lens().save(&folder.join(CameraModel::FILE_NAME)).expect("a lens");
    hand_eye.save(&folder.join(HandEye::FILE_NAME)).expect("a place");
    rig.save(folder).expect("a rig");
}

/// The points of a PLY file in millimetres.
fn points(path: &Path) -> Vec<[f64; 3]> {
    let text = fs::read_to_string(path).expect("a PLY file");
    let (header, points) = text.split_once("end_header\n").expect("a header");
    assert!(header.contains("comment frame base\n"), "{header}");
    let point = |line: &str| {
        let mut numbers = line.split(' ').map(|number| 1e3 * number.parse::<f64>().expect("a number"));
        [(); 3].map(|()| numbers.next().expect("three coordinates"))
    };
    points.lines().map(point).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation")]
fn a_table_and_a_ball_are_where_they_are_in_the_base() {
    let dir = tempfile::tempdir().expect("a folder");
    let [rig, ply] = ["rig", "cloud.ply"].map(|name| dir.path().join(name));
    capture(&rig);
    for options in [&[][..], &["--align"]] {
        let arguments = ["match", rig.to_str().unwrap(), "--frame", "base", "--ply-ascii", "--ply", ply.to_str().unwrap()];
        Invocation::new([&arguments[..], options].concat()).assert_done();
        let points = points(&ply);
        let from_ball = |point: &[f64; 3]| {
            let [x, y, z] = [0, 1, 2].map(|axis| point[axis] - BALL_MM[axis]);
            x.hypot(y).hypot(z)
        };
        let is_beside = |[x, y, _]: &&[f64; 3]| (x - BALL_MM[0]).hypot(y - BALL_MM[1]) > 1.5 * RADIUS_MM;
        let heights: Vec<f64> = points.iter().filter(is_beside).map(|[.., z]| z - TABLE_MM).collect();
        let ball: Vec<f64> = points
            .iter()
            .filter(|point| point[2] > BALL_MM[2] + RADIUS_MM / 3.0 && from_ball(point) < 1.5 * RADIUS_MM)
            .map(|point| from_ball(point) - RADIUS_MM)
            .collect();
        assert!(heights.len() > 150_000 && ball.len() > 4_000, "{} and {} points", heights.len(), ball.len());
        let [table_off, ball_off] = [median(heights), median(ball)];
        println!("{options:?}: the table is {table_off:.3} mm off, the ball {ball_off:.3} mm");
        // 0.2 % of the distance, which is 600 mm and 500 mm.
        assert!(table_off.abs() < 1.2 && ball_off.abs() < 1.0, "{options:?}: {table_off} mm, {ball_off} mm");
    }
}
