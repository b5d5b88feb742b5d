//! Commands that move stages and take pictures: the scripts of `host/examples/exec/` with stubs of what they drive, and commands that
//! do not do what they should.

use std::{
    fs,
    io::{BufRead, BufReader},
    num::NonZeroU16,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::atomic::AtomicBool,
    thread,
    time::{Duration, Instant},
};

use image::{Rgb, RgbImage};
use multiscopic::{
    Picture, Rig,
    capture::{
        camera::ExecCamera,
        stage::{self, AnyStage, Limits, PosedStage, StageError, StageSpec},
    },
    images::Transform,
};
use multiscopic_core::{
    Frame, View,
    capture::{Position, Stage},
};
use multiscopic_tests::program::Invocation;
use tempfile::TempDir;

/// A stage as a shell script: it is wherever it is sent, at once.
const STAGE: &str = r#"sh -c 'X=0 Y=0
while read -r order x y; do
    case $order in
    move) X=$x Y=$y; echo ok ;;
    where) echo "ok $X $Y" ;;
    *) echo ok ;;
    esac
done'"#;

fn script(name: &str) -> String {
    format!("{}/../host/examples/exec/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn fake(name: &str) -> String {
    format!("{}/fakes/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn limits(speed_mm_s: f64) -> Limits {
    Limits { speed_mm_s, ..Limits::default() }
}

fn open(command: &str, limits: &Limits) -> Result<AnyStage, StageError> {
    stage::open(&StageSpec::Exec(command.into()), limits)
}

fn at(x_mm: i32, y_mm: i32) -> Position {
    Position { x_um: 1000 * x_mm, y_um: 1000 * y_mm }
}

fn arrive(stage: &mut AnyStage, position: Position) -> Result<(), StageError> {
    stage.move_to(position)?;
    let start = Instant::now();
    while !stage.has_arrived()? {
        assert!(start.elapsed() < Duration::from_secs(20), "no end of the move");
    }
    Ok(())
}

fn assert_near(measured: Option<Position>, expected: Position) {
    let measured = measured.expect("a measured position");
    assert!(measured.distance_um(expected) < 150, "{measured:?} instead of {expected:?}");
}

/// The tool of the stubs looks down: it is turned by 180 degrees about the x axis.
fn assert_pose(measured: Option<Transform>, expected_mm: [f64; 3]) {
    let Transform { translation_mm, rotation_deg } = measured.expect("a measured pose");
    let off = |found: [f64; 3], expected: [f64; 3]| found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off(translation_mm, expected_mm) < 0.15 && off(rotation_deg, [180.0, 0.0, 0.0]) < 1e-3, "{measured:?}");
}

/// Moves a stage whose speed is 20 mm/s, sees that it stops on its way, and drops it. Returns what its hardware was told.
fn exercise(command: &str, events: &Path) -> Vec<String> {
    let told = || fs::read_to_string(events).unwrap_or_default().lines().map(String::from).collect::<Vec<_>>();
    let mut stage = open(command, &limits(20.0)).unwrap();
    assert_near(stage.position().unwrap(), at(0, 0));
    assert!(told().is_empty(), "nothing moves before it is sent: {:?}", told());
    assert!(matches!(stage.move_to(at(0, 101)), Err(StageError::OutOfReach { .. })));
    arrive(&mut stage, at(3, -2)).unwrap();
    assert_near(stage.position().unwrap(), at(3, -2));
    stage.move_to(at(-57, -2)).unwrap();
    thread::sleep(Duration::from_millis(600));
    assert!(!stage.has_arrived().unwrap());
    let start = Instant::now();
    stage.stop().unwrap();
    assert!(start.elapsed() < Duration::from_secs(2), "it stopped after {:?}", start.elapsed());
    let stopped = stage.position().unwrap().unwrap();
    assert!((-50_000..2500).contains(&stopped.x_um), "{stopped:?}");
    arrive(&mut stage, at(0, 0)).unwrap();
    assert_near(stage.position().unwrap(), at(0, 0));
    drop(stage);
    told()
}

/// The coordinates of the last event that has some.
fn last_target(events: &[String]) -> Vec<f64> {
    let last = events.iter().rev().find_map(|event| event.strip_prefix("to ")).expect("a move");
    last.split(' ').map(|number| number.parse().unwrap()).collect()
}

/// A stub of Moonraker that runs until it is dropped.
struct Moonraker {
    child: Child,
    url: String,
}

impl Moonraker {
    fn start(events: &Path, homed: &str) -> Moonraker {
        let mut command = Command::new("python3");
        command.arg(fake("moonraker.py")).env("EVENTS", events).env("HOMED", homed).stdout(Stdio::piped());
        let mut child = command.spawn().expect("python3 runs");
        let mut port = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut port).unwrap();
        Moonraker { child, url: format!("http://127.0.0.1:{}", port.trim()) }
    }

    fn stage(&self) -> String {
        format!("python3 '{}' {}", script("stage_moonraker.py"), self.url)
    }
}

impl Drop for Moonraker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn klipper_is_moved_over_moonraker() {
    let dir = tempfile::tempdir().unwrap();
    let events = dir.path().join("events");
    let moonraker = Moonraker::start(&events, "xyz");
    let told = exercise(&moonraker.stage(), &events);
    // To the right is +X, up is +Y, and a move has many pieces.
    assert!(told.len() > 8 && told.contains(&"to 123.0 82.0".into()), "{told:?}");
    assert_eq!(last_target(&told), [120.0, 80.0]);
    // What Klipper refuses is the error's text.
    let mut stage = open(&moonraker.stage(), &limits(250.0)).unwrap();
    let refusal = arrive(&mut stage, at(0, 90)).unwrap_err().to_string();
    assert!(refusal.contains("answered `move 0 90` with the error: Moonraker: Move out of range"), "{refusal}");
}

#[test]
fn a_machine_that_is_not_homed_does_not_move() {
    let dir = tempfile::tempdir().unwrap();
    let events = dir.path().join("events");
    let moonraker = Moonraker::start(&events, "z");
    let refusal = open(&moonraker.stage(), &limits(50.0)).map(drop).unwrap_err().to_string();
    assert!(refusal.contains("answered `open 50 100` with the error: the machine is not homed"), "{refusal}");
    assert!(!events.exists());
}

/// A script that runs with stubs of ROS 2.
fn with_ros(events: &Path, script_and_arguments: &str) -> String {
    let (name, arguments) = script_and_arguments.split_once(' ').unwrap();
    format!("env 'EVENTS={}' python3 '{}' '{}' {arguments}", events.display(), fake("with_ros.py"), script(name))
}

#[test]
fn an_arm_is_moved_by_moveit() {
    let dir = tempfile::tempdir().unwrap();
    let events = dir.path().join("events");
    let command = with_ros(&events, "stage_moveit.py manipulator base tool");
    let told = exercise(&command, &events);
    // The tool's y is the world's -y.
    assert_eq!(told[0], "to 0.4030 -0.1980 0.5000");
    assert!(told[1].starts_with("to 0.3430") && told[2] == "cancelled", "{told:?}");
    assert_eq!(last_target(&told), [0.4, -0.2, 0.5]);
    let mut stage = open(&command, &limits(20.0)).unwrap();
    assert_pose(stage.pose().unwrap(), [400.0, -200.0, 500.0]);
    let before = fs::read_to_string(&events).unwrap();
    let refusal = arrive(&mut stage, at(95, 0)).unwrap_err().to_string();
    assert!(refusal.contains("MoveIt finds 40 % of a straight way"), "{refusal}");
    assert_eq!(fs::read_to_string(&events).unwrap(), before, "half a way is not gone");
}

#[test]
fn a_tool_is_moved_by_topics() {
    let dir = tempfile::tempdir().unwrap();
    let events = dir.path().join("events");
    let command = with_ros(&events, "stage_ros2.py /target_frame /current_pose");
    let told = exercise(&command, &events);
    assert_pose(open(&command, &limits(20.0)).unwrap().pose().unwrap(), [400.0, -200.0, 500.0]);
    assert!(told.contains(&"to 0.4030 -0.1980 0.5000".into()), "{told:?}");
    assert_eq!(last_target(&told), [0.4, -0.2, 0.5]);
    // At 20 mm/s, a step of 20 ms is 0.4 mm.
    let x = |event: &String| event.split(' ').nth(1).unwrap().parse::<f64>().unwrap();
    assert!(told.windows(2).all(|two| (x(&two[1]) - x(&two[0])).abs() < 0.0011), "{told:?}");
}

fn take(camera: &mut ExecCamera) -> Result<Picture, String> {
    camera.take(Duration::from_secs(10), &AtomicBool::new(false)).map_err(|error| error.to_string())
}

#[test]
fn a_topic_has_pictures_in_colour() {
    let dir = tempfile::tempdir().unwrap();
    let command = with_ros(&dir.path().join("events"), "camera_ros2.py /camera/image_raw");
    let mut camera = ExecCamera::open(&command, NonZeroU16::MIN).unwrap();
    let row = [255, 0, 0, 0, 0, 200, 7, 8, 9];
    assert_eq!(take(&mut camera).unwrap(), Picture::Rgb(RgbImage::from_raw(3, 4, row.repeat(4)).unwrap()));
}

/// A folder of programs with a program in it, as a shell script, and the word that puts it on the path.
fn on_path(dir: &TempDir, name: &str, text: &str) -> String {
    let path = dir.path().join(name);
    fs::write(&path, format!("#!/bin/sh\n{text}")).unwrap();
    let mut permissions = fs::metadata(&path).unwrap().permissions();
    std::os::unix::fs::PermissionsExt::set_mode(&mut permissions, 0o755);
    fs::set_permissions(&path, permissions).unwrap();
    format!("env 'PATH={}:{}'", dir.path().display(), std::env::var("PATH").unwrap())
}

/// A picture in a folder.
fn picture(dir: &TempDir) -> (PathBuf, Picture) {
    let path = dir.path().join("scene.png");
    let scene = RgbImage::from_fn(23, 9, |u, v| Rgb([(u * 11) as u8, (v * 28) as u8, (u * v) as u8]));
    scene.save(&path).unwrap();
    (path, Picture::Rgb(scene))
}

#[test]
fn a_raspberry_pi_takes_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, expected) = picture(&dir);
    // It reads its input, as programs do that are stopped by a key, and fails for its third picture.
    let text = format!(
        "cat >/dev/null\n[ \"$1\" = --list-cameras ] && exit 0\necho \"$@\" >>'{0}/told'\n\
         while [ \"$1\" != --output ]; do shift; done\n\
         [ $(wc -l <'{0}/told') = 3 ] && {{ echo 'Camera frontend has timed out!' >&2; exit 1; }}\ncp '{1}' \"$2\"\n",
        dir.path().display(),
        scene.display()
    );
    let path = on_path(&dir, "rpicam-still", &text);
    let command = format!("{path} sh '{}' --shutter 8000", script("camera_rpicam.sh"));
    let mut camera = ExecCamera::open(&command, NonZeroU16::MIN).unwrap();
    assert_eq!([take(&mut camera), take(&mut camera)], [Ok(expected.clone()), Ok(expected.clone())]);
    let failure = take(&mut camera).unwrap_err();
    assert!(failure.contains("with the error: rpicam-still: Camera frontend has timed out!"), "{failure}");
    assert_eq!(take(&mut camera), Ok(expected), "it goes on");
    let told = fs::read_to_string(dir.path().join("told")).unwrap();
    assert!(told.lines().all(|line| line.starts_with("--nopreview") && line.ends_with("--shutter 8000")), "{told}");
}

#[test]
fn gstreamer_takes_pictures_from_any_source() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, expected) = picture(&dir);
    let text = format!(
        "echo \"$@\" >>'{}/told'\nfor word; do case $word in location=/*) to=${{word#location=}} ;; esac; done\ncp '{}' \"$to\"\n",
        dir.path().display(),
        scene.display()
    );
    let path = on_path(&dir, "gst-launch-1.0", &text);
    let command = format!("{path} sh '{}' aravissrc camera-name=Basler-1", script("camera_gstreamer.sh"));
    let mut camera = ExecCamera::open(&command, NonZeroU16::new(2).unwrap()).unwrap();
    assert_eq!(take(&mut camera), Ok(expected));
    let told = fs::read_to_string(dir.path().join("told")).unwrap();
    assert_eq!(told.lines().count(), 2, "two pictures make a mean");
    assert!(told.starts_with("-q aravissrc camera-name=Basler-1 ! videoconvert ! pngenc snapshot=true ! filesink"), "{told}");
}

/// Commands of stages that break the protocol, and what is said of them.
#[test]
fn commands_that_do_not_answer_as_they_should_are_named() {
    let quick =
        Limits { connect_timeout: Duration::from_millis(300), silence_timeout: Duration::from_millis(300), ..Limits::default() };
    for (command, problem) in [
        ("/no/such/command", "cannot be started"),
        ("false", "has ended (exit status: 1)"),
        ("sleep 60", "has not answered `open 50 100` for 0.3 s"),
        ("yes", "said `y`, expected "),
        ("sh -c 'read x; echo hello'", "said `hello`, expected ok or error in answer to `open 50 100`"),
        ("sh -c 'read x; echo error the door is open; cat'", "answered `open 50 100` with the error: the door is open"),
        ("sh -c 'exec cat /dev/zero'", "bytes without an end of line"),
    ] {
        let start = Instant::now();
        let error = open(command, &quick).map(drop).unwrap_err().to_string();
        assert!(error.starts_with(&format!("`{command}` ")) && error.contains(problem), "{error}");
        assert!(start.elapsed() < Duration::from_secs(5), "{command} took {:?}", start.elapsed());
    }
}

/// A command that is killed, or hangs, while it moves: the stage may still move, and says so. Its processes end.
#[test]
fn a_stage_that_cannot_be_stopped_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let pid = dir.path().join("pid");
    let quick = Limits { silence_timeout: Duration::from_millis(300), ..Limits::default() };
    let during_the_move = |action: &str| {
        let script = format!("while read -r order x; do case $order in move) {action} ;; *) echo ok ;; esac; done");
        let mut stage = open(&format!("sh -c '{script}'"), &quick).unwrap();
        stage.move_to(at(1, 0)).unwrap();
        thread::sleep(Duration::from_millis(200));
        let arrived = stage.has_arrived().map_err(|error| error.to_string());
        let stopped = stage.stop().unwrap_err().to_string();
        assert!(stopped.contains("may still move the stage"), "{stopped}");
        let after = stage.move_to(at(0, 0)).unwrap_err().to_string();
        assert_eq!(after, stopped, "it goes nowhere from then on");
        arrived
    };
    let dead = during_the_move("exit 3").unwrap_err();
    assert!(dead.contains("has ended (exit status: 3)"), "{dead}");
    // A process of its own outlives the script, unless it is killed as well.
    let hanging = during_the_move(&format!("sleep 60 & echo $! >\"{}\"; wait", pid.display()));
    assert_eq!(hanging, Ok(false));
    let process = PathBuf::from(format!("/proc/{}/stat", fs::read_to_string(&pid).unwrap().trim()));
    let is_alive = || fs::read_to_string(&process).is_ok_and(|stat| !stat.contains(") Z "));
    let start = Instant::now();
    while is_alive() {
        assert!(start.elapsed() < Duration::from_secs(5), "its process lives on");
        thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_command_that_leaves_no_picture_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let (scene, _) = picture(&dir);
    let camera = |take: &str| {
        let script = format!("while read -r order path; do case $order in take) {take} ;; esac; echo ok; done");
        ExecCamera::open(&format!("sh -c '{script}'"), NonZeroU16::MIN).unwrap()
    };
    let failure = take(&mut camera("true")).unwrap_err();
    assert!(failure.contains("with ok, but cannot read"), "{failure}");
    let failure = take(&mut camera("echo no picture >\"$path\"")).unwrap_err();
    assert!(failure.contains("with ok, but"), "{failure}");
    let mut changing =
        camera(&format!("cp \"{0}/scene.png\" \"$path\"; cp \"{0}/other.png\" \"{0}/scene.png\"", dir.path().display()));
    RgbImage::new(5, 4).save(dir.path().join("other.png")).unwrap();
    take(&mut changing).unwrap();
    let failure = take(&mut changing).unwrap_err();
    assert!(failure.contains("the picture has 5x4 pixels, expected 23x9"), "{failure}");
    assert!(scene.exists());
    // After a time-out it is started again.
    let started = dir.path().join("started");
    let script = format!("echo >>\"{0}\"; while read -r order path; do [ $order = take ] || echo ok; done", started.display());
    let mut silent = ExecCamera::open(&format!("sh -c '{script}'"), NonZeroU16::MIN).unwrap();
    for count in 1..3 {
        let failure = silent.take(Duration::from_millis(200), &AtomicBool::new(false)).unwrap_err().to_string();
        assert!(failure.contains("has not answered `take "), "{failure}");
        assert_eq!(fs::read_to_string(&started).unwrap().len(), count);
    }
}

fn capture(camera: &str, stage: &str, folder: &Path, more: &[&str]) -> Invocation {
    let quick = ["--speed", "250", "--acceleration", "1200", "--settle", "0", "--views", "1", "--baseline", "20"];
    let hardware = ["capture", "--camera", camera, "--stage", stage, "-o", folder.to_str().unwrap()];
    Invocation::new(hardware.iter().chain(&quick).chain(more))
}

/// A simulated camera sees what it would on a simulated stage, wherever a real stage says that it is.
#[test]
fn a_real_stage_is_rehearsed_with_a_simulated_camera() {
    let dir = tempfile::tempdir().unwrap();
    let [rehearsed, simulated] = ["rehearsed", "simulated"].map(|name| dir.path().join(name));
    let size = ["--size", "80x60"];
    let run = capture("sim", &format!("exec:{STAGE}"), &rehearsed, &size);
    run.assert_done();
    assert!(run.stderr.contains("the pictures are simulated"), "{run:?}");
    capture("sim", "sim", &simulated, &size).assert_done();
    for name in ["center.png", "right.png"] {
        let [a, b] = [&rehearsed, &simulated].map(|folder| Picture::read(&folder.join(name)).unwrap());
        assert!(matches!(a, Picture::Rgb(_)) && a == b, "{name}");
    }
    let notes = Rig::load(&rehearsed).unwrap().capture.notes.unwrap();
    assert!(notes.starts_with("the pictures are simulated"), "{notes}");
}

/// Pictures of a command stay in colour, from the camera to the cloud.
#[test]
fn colours_are_kept() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("rig");
    let scene = RgbImage::from_fn(64, 48, |u, v| {
        let noise = u.wrapping_mul(2_654_435_761).wrapping_add(v.wrapping_mul(40_503)) >> 7;
        Rgb([200 - (noise % 50) as u8, (noise % 50) as u8, 10])
    });
    scene.save(dir.path().join("scene.ppm")).unwrap();
    let script = format!(
        "while read -r order path; do case $order in take) cp \"{}/scene.ppm\" \"$path\" ;; esac; echo ok; done",
        dir.path().display()
    );
    let run = capture(&format!("exec:sh -c '{script}'"), "sim", &folder, &["--focal-px", "100"]);
    run.assert_done();
    assert!(run.stderr.contains("the stage is simulated: the camera does not move"), "{run:?}");
    for name in ["center.png", "right.png"] {
        assert_eq!(Picture::read(&folder.join(name)).unwrap(), Picture::Rgb(scene.clone()), "{name}");
    }
    assert!(Rig::load(&folder).unwrap().images.get(Frame::View(View::RIGHT)).is_some());
    let refused = capture(&format!("exec:sh -c '{script}'"), "sim", &dir.path().join("none"), &["--gain", "3"]);
    refused.assert_refused(&["--gain is for V4L2 cameras", "--camera exec:"]);
}
