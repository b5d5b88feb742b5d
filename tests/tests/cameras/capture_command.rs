//! `multiscopic capture` from end to end: a simulated arm moves a loopback camera, which is fed with the
//! image that a camera would see there.

use std::{
    error::Error,
    f64::consts::FRAC_PI_2,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use image::GrayImage;
use libtest_mimic::Trial;
use multiscopic_tests::{
    program::{self, Invocation},
    simulated::{
        arm::{Fault, Heard, SimulatedArm},
        cameras::Producer,
        pose::{Pose, distance, pose_trans},
    },
    test_images::{
        ViewSet, golden,
        real_data::{self, Dataset},
    },
};
use tempfile::TempDir;

type Outcome = Result<(), Box<dyn Error>>;
/// Makes the arm fail.
type Strike = fn(&SimulatedArm);

const CAMERA: &str = "/dev/video10";
const BASELINE_MM: &str = "15";
/// The camera's first pose. It looks aside, so that its image plane is not parallel to a plane of the base's
/// axes.
const START: Pose = [0.4, -0.2, 0.5, 0.3, FRAC_PI_2, -0.2];
/// The time limit for whatever a capture does in an emulator. Only a hung capture reaches it.
const LONG: Duration = Duration::from_secs(180);
/// The tolerance of positions in metres.
const NEAR: f64 = 1e-4;

/// The pose of each frame: centre, left, right, top, bottom.
fn poses() -> [Pose; 5] {
    let b = 0.015;
    [[0.0, 0.0], [-b, 0.0], [b, 0.0], [0.0, -b], [0.0, b]].map(|[x, y]| pose_trans(START, [x, y, 0.0, 0.0, 0.0, 0.0]))
}

/// An arm with a camera that sees one image at each of five poses, and stripes elsewhere.
struct Rig {
    arm: Arc<SimulatedArm>,
    /// True if the camera is to deliver frames, and the number of times that it has begun or ceased to.
    is_on: Arc<AtomicBool>,
    switches: Arc<AtomicUsize>,
    is_over: Arc<AtomicBool>,
    world: Option<JoinHandle<()>>,
    folder: TempDir,
}

impl Rig {
    fn new(images: &ViewSet) -> Rig {
        let arm = Arc::new(SimulatedArm::start(START));
        let (is_on, is_over) = (Arc::new(AtomicBool::new(true)), Arc::new(AtomicBool::new(false)));
        let switches = Arc::new(AtomicUsize::new(0));
        let views = images.views.clone().map(|view| view.expect("all views"));
        let seen: Vec<Vec<u8>> = [images.center.clone()].into_iter().chain(views).collect();
        let (width, height) = (images.width as u32, images.height as u32);
        let elsewhere: Vec<u8> = (0..width * height).map(|i| if i / 3 % 2 == 0 { 0 } else { 255 }).collect();
        let image = |pixels: &[u8]| GrayImage::from_raw(width, height, pixels.to_vec()).expect("the pixels are as many");
        let (first, there, on, over) = (image(&seen[0]), arm.clone(), is_on.clone(), is_over.clone());
        let mut producer = Some(Producer::gray(Path::new(CAMERA), &first).expect("the loopback device can be fed"));
        let switched = switches.clone();
        let world = thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                let must_feed = on.load(Ordering::Relaxed);
                if must_feed != producer.is_some() {
                    producer =
                        must_feed.then(|| Producer::gray(Path::new(CAMERA), &first).expect("the loopback device can be fed"));
                    switched.fetch_add(1, Ordering::Relaxed);
                }
                let pose = there.pose();
                let at = poses().iter().position(|place| distance(*place, pose) < NEAR).filter(|_| !there.is_moving());
                if let Some(producer) = &producer {
                    producer.show(at.map_or(&elsewhere, |at| &seen[at]).clone());
                }
                thread::sleep(Duration::from_millis(4));
            }
        });
        Rig { arm, is_on, switches, is_over, world: Some(world), folder: tempfile::tempdir().expect("a folder") }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The command that captures into `output`.
    fn command(&self, output: &Path, arguments: &[&str]) -> Command {
        let mut command = Command::new(program::binary());
        command.args(["capture", "--camera", CAMERA, "--stage", &self.arm.spec(), "--baseline", BASELINE_MM, "--warm-up", "2"]);
        // Time-outs that only a hung capture reaches, unless it is to fail by one.
        for [option, value] in [
            ["--speed", "100"],
            ["--acceleration", "1000"],
            ["--settle", "0.1"],
            ["--move-timeout", "120"],
            ["--silence-timeout", "120"],
            ["--frame-timeout", "60"],
        ] {
            if !arguments.contains(&option) {
                command.args([option, value]);
            }
        }
        command.args(arguments).arg("-o").arg(output);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn start(&self, output: &Path, arguments: &[&str]) -> Capture {
        Capture { child: Some(self.command(output, arguments).spawn().expect("the command starts")) }
    }

    /// Captures into the folder `name`, which must succeed.
    fn capture(&self, name: &str) -> Outcome {
        let ended = self.start(&self.path(name), &[]).end()?;
        if ended.code != Some(0) || !self.path(name).join("rig.toml").is_file() {
            return Err(format!("{name}: {ended:?}").into());
        }
        self.rests(&poses()[0], name)
    }

    /// Checks that the arm rests at `pose`.
    fn rests(&self, pose: &Pose, name: &str) -> Outcome {
        let (is_moving, off) = (self.arm.is_moving(), distance(self.arm.pose(), *pose));
        if is_moving || off > NEAR {
            return Err(format!("{name}: the arm {}, {off} m off", if is_moving { "moves" } else { "stands" }).into());
        }
        Ok(())
    }

    /// Checks that a capture failed with a message that contains `words`, and left no files.
    fn failed(&self, ended: &Ended, words: &[&str]) -> Outcome {
        let left: Vec<_> =
            fs::read_dir(self.folder.path())?.map(|entry| entry.map(|entry| entry.file_name())).collect::<Result<_, _>>()?;
        let is_told = words.iter().all(|word| ended.stderr.contains(word));
        if ended.code != Some(2) || !is_told || !left.is_empty() || self.arm.is_moving() {
            return Err(format!("{words:?}: {ended:?}; left: {left:?}; moves: {}", self.arm.is_moving()).into());
        }
        Ok(())
    }

    /// Switches the camera on or off, and waits until it is.
    fn switch(&self, is_on: bool) -> Outcome {
        let before = self.switches.load(Ordering::Relaxed);
        match self.is_on.swap(is_on, Ordering::Relaxed) == is_on {
            true => Ok(()),
            false => self.wait("the camera was switched", |_| self.switches.load(Ordering::Relaxed) > before),
        }
    }

    /// Waits until `is_so`.
    fn wait(&self, what: &str, is_so: impl Fn(&SimulatedArm) -> bool) -> Outcome {
        let start = Instant::now();
        while !is_so(&self.arm) {
            if start.elapsed() > LONG {
                return Err(format!("it never came that {what}").into());
            }
            thread::sleep(Duration::from_millis(2));
        }
        Ok(())
    }

    fn wait_near(&self, index: usize) -> Outcome {
        self.wait("the arm arrived", |arm| distance(arm.pose(), poses()[index]) < NEAR && !arm.is_moving())
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let ended = self.world.take().map(JoinHandle::join);
        assert!(thread::panicking() || matches!(ended, Some(Ok(()))), "{ended:?}");
    }
}

/// A running command.
struct Capture {
    child: Option<Child>,
}

#[derive(Debug)]
struct Ended {
    code: Option<i32>,
    stderr: String,
}

impl Capture {
    /// Waits for the end.
    fn end(&mut self) -> Result<Ended, Box<dyn Error>> {
        let start = Instant::now();
        let mut child = self.child.take().expect("it ends once");
        while child.try_wait()?.is_none() {
            if start.elapsed() > LONG {
                child.kill()?;
                let output = child.wait_with_output()?;
                return Err(format!("no end after {LONG:?}: {}", String::from_utf8_lossy(&output.stderr)).into());
            }
            thread::sleep(Duration::from_millis(5));
        }
        let output = child.wait_with_output()?;
        Ok(Ended { code: output.status.code(), stderr: String::from_utf8_lossy(&output.stderr).into() })
    }

    fn interrupt(&self) {
        let id = self.child.as_ref().expect("it runs").id().to_string();
        let done = Command::new("kill").args(["-INT", &id]).status();
        assert!(done.is_ok_and(|status| status.success()), "the signal is sent");
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// The five frames are captured at their poses, and match to the same disparities as the files that were fed.
fn captures_and_matches(images: &ViewSet) -> Outcome {
    let rig = Rig::new(images);
    rig.capture("rig")?;
    let folder = rig.path("rig");
    let moves: Vec<Pose> =
        rig.arm.heard().into_iter().filter_map(|heard| if let Heard::Move(pose) = heard { Some(pose) } else { None }).collect();
    // The shortest way: centre, left, top, right, bottom, and back.
    let expected: Vec<Pose> = [0, 1, 3, 2, 4, 0].into_iter().map(|index| poses()[index]).collect();
    if moves.len() != expected.len() || moves.iter().zip(&expected).any(|(a, b)| distance(*a, *b) > 1e-6) {
        return Err(format!("the arm was sent to {moves:?} instead of {expected:?}").into());
    }
    let names = ["center", "left", "right", "top", "bottom"];
    let files = names.map(|name| folder.join(format!("{name}.png")));
    let captured = ViewSet::read(&files[0], [1, 2, 3, 4].map(|i| Some(files[i].as_path())));
    for (name, (found, fed)) in names[1..].iter().zip(captured.views.iter().zip(&images.views)) {
        if found != fed {
            return Err(format!("the {name} frame is not what the camera saw there").into());
        }
    }
    if captured.center != images.center {
        return Err("the center frame is not what the camera saw there".into());
    }
    let log = fs::read_to_string(folder.join("capture.log"))?;
    let toml = fs::read_to_string(folder.join("rig.toml"))?;
    for (text, word) in
        [(&log, "captured the bottom frame"), (&log, CAMERA), (&toml, "baseline_mm = 15"), (&toml, &rig.arm.spec())]
    {
        if !text.contains(word) {
            return Err(format!("{word} is not in {text}").into());
        }
    }

    let fed = rig.path("fed");
    fs::create_dir(&fed)?;
    images.write_rig(&fed);
    let disparities = |folder: &Path, name: &str| -> Result<Vec<u8>, Box<dyn Error>> {
        let (path, out) = (rig.path(name), rig.path("out.pfm"));
        let [folder, out, raw] = [folder, &out, &path].map(|path| path.to_str().expect("a path in UTF-8"));
        Invocation::new([
            "match",
            folder,
            "--method",
            "bm",
            "-o",
            out,
            "--raw16",
            raw,
            "--num-disparities",
            "18",
            "--block-size",
            "9",
        ])
        .assert_done();
        Ok(fs::read(path)?)
    };
    if disparities(&folder, "captured.png")? != disparities(&fed, "fed.png")? {
        return Err("the disparities of the captured frames are not those of the files".into());
    }
    Ok(())
}

fn golden_capture() -> Outcome {
    captures_and_matches(&golden::images())
}

/// A part of a real set of five views.
fn real_capture() -> Outcome {
    let root = real_data::root().ok_or("there is no data")?;
    captures_and_matches(&Dataset::Tsukuba.read(&root, "").images.crop(96, 72, 192, 144))
}

fn live_captures() -> Outcome {
    let rig = Rig::new(&golden::images());
    let ended = rig.start(&rig.path("live"), &["--views", "2", "--live", "--count", "2"]).end()?;
    let has = |name: &str| rig.path("live").join(name).exists();
    if ended.code != Some(0) || !has("0001/right.png") || !has("0002/rig.toml") || has("0002/top.png") || has("0003") {
        return Err(format!("{ended:?}").into());
    }
    Ok(())
}

/// A fault of the arm ends the capture with a message, and the arm rests. Once repaired, the next capture
/// works.
fn arm_fault(strike: Strike, while_it_moves: bool, arguments: &[&str], words: &[&str]) -> Outcome {
    let rig = Rig::new(&golden::images());
    if !while_it_moves {
        strike(&rig.arm);
    }
    let mut capture = rig.start(&rig.path("rig"), arguments);
    if while_it_moves {
        rig.wait("the arm moved", |arm| distance(arm.pose(), START) > 0.003)?;
        strike(&rig.arm);
    }
    let ended = capture.end()?;
    rig.failed(&ended, words)?;
    rig.arm.release();
    // The arm stopped on its way. The next capture is centred there, where the camera sees stripes.
    let ended = rig.start(&rig.path("next"), &["--views", "1"]).end()?;
    if ended.code != Some(0) || !rig.path("next/rig.toml").is_file() {
        return Err(format!("the next capture: {ended:?}").into());
    }
    Ok(())
}

/// If the camera stops delivering frames, the capture fails and the arm returns.
fn camera_starves() -> Outcome {
    let rig = Rig::new(&golden::images());
    let mut capture = rig.start(&rig.path("rig"), &["--frame-timeout", "10", "--retries", "1"]);
    rig.wait_near(1)?;
    rig.switch(false)?;
    let ended = capture.end()?;
    rig.failed(&ended, &[CAMERA])?;
    rig.rests(&poses()[0], "after the camera starved")?;
    rig.switch(true)?;
    rig.capture("next")
}

/// The phase of a capture in which Ctrl-C is pressed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Connecting,
    Moving,
    Settling,
    Capturing,
    Returning,
}

fn interrupted(phase: Phase) -> Outcome {
    let rig = Rig::new(&golden::images());
    let arguments: &[&str] = match phase {
        // Far longer than until the interrupt.
        Phase::Settling => &["--settle", "600"],
        Phase::Capturing => &["--frame-timeout", "600"],
        // Slow enough to be interrupted on the way.
        Phase::Moving | Phase::Returning => &["--speed", "5"],
        Phase::Connecting => &[],
    };
    if phase == Phase::Connecting {
        rig.arm.fail(Fault::Silent);
    }
    let mut capture = rig.start(&rig.path("rig"), arguments);
    match phase {
        Phase::Connecting => rig.wait("the arm was connected to", SimulatedArm::has_connections)?,
        Phase::Moving => rig.wait("the arm moved", |arm| distance(arm.pose(), START) > 0.003)?,
        Phase::Settling => {
            rig.wait("the arm was told to move", |arm| arm.heard().iter().any(|heard| matches!(heard, Heard::Move(_))))?;
            // It has arrived by then, or is interrupted on its way.
            thread::sleep(Duration::from_secs(1));
        }
        Phase::Capturing => {
            rig.wait_near(1)?;
            rig.switch(false)?;
            // It waits for a frame by then, or is interrupted before.
            thread::sleep(Duration::from_secs(2));
        }
        Phase::Returning => {
            rig.wait_near(4)?;
            rig.wait("the arm returned", |arm| distance(arm.pose(), poses()[4]) > 0.002)?;
        }
    }
    capture.interrupt();
    let ended = capture.end()?;
    let word = if phase == Phase::Connecting { "" } else { "aborted" };
    rig.failed(&ended, &[word]).map_err(|error| format!("{phase:?}: {error}"))?;
    if phase != Phase::Returning {
        rig.rests(&poses()[0], "after Ctrl-C")?;
    }
    rig.arm.release();
    rig.switch(true)?;
    let ended = rig.start(&rig.path("next"), &["--views", "1"]).end()?;
    if ended.code != Some(0) {
        return Err(format!("the next capture: {ended:?}").into());
    }
    Ok(())
}

fn disk_full() -> Outcome {
    let rig = Rig::new(&golden::images());
    let small = tempfile::tempdir()?;
    let path = small.path().to_str().ok_or("a path in UTF-8")?;
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=8k", "tmpfs", path]).status()?;
    if !mounted.success() {
        return Err("a small disk cannot be mounted".into());
    }
    let outcome = (|| -> Outcome {
        let ended = rig.start(&small.path().join("rig"), &[]).end()?;
        rig.failed(&ended, &["cannot write", "rig", "No space left"])?;
        if let Some(left) = fs::read_dir(small.path())?.next() {
            return Err(format!("{left:?} is left").into());
        }
        rig.rests(&poses()[0], "after the disk was full")?;
        rig.capture("next")
    })();
    let _ = Command::new("umount").arg(path).status();
    outcome
}

fn refusals() -> Outcome {
    let rig = Rig::new(&golden::images());
    let refused = |arguments: &[&str], words: &[&str]| -> Outcome {
        let mut all = vec!["capture", "--camera", CAMERA, "--baseline", "15", "-o"];
        let output = rig.path("rig");
        all.push(output.to_str().ok_or("a path in UTF-8")?);
        all.extend(arguments);
        Invocation::new(&all).assert_refused(words);
        if output.exists() {
            return Err(format!("{arguments:?} left files").into());
        }
        Ok(())
    };
    // Nothing listens there.
    refused(&["--stage", "ur10:127.0.0.1:9,10"], &["127.0.0.1, port 10"])?;
    refused(&["--stage", "ur10:no.such.host.invalid"], &["no.such.host.invalid"])?;
    refused(&["--stage", "gcode:/dev/none"], &["/dev/none"])?;
    refused(&["--stage", "crane"], &["crane", "kind is unknown"])?;
    // Beyond the reach.
    let spec = rig.arm.spec();
    refused(&["--stage", &spec, "--reach", "5", "--warm-up", "0"], &["5 mm"])?;
    rig.rests(&poses()[0], "after a refusal")?;
    // The output already exists.
    fs::write(rig.path("rig"), "mine")?;
    let ended = rig.start(&rig.path("rig"), &[]).end()?;
    if ended.code != Some(2) || !ended.stderr.contains("is there already") || fs::read(rig.path("rig"))? != b"mine" {
        return Err(format!("{ended:?}").into());
    }
    Ok(())
}

/// The tests, which are ignored without cameras.
pub fn trials(has_cameras: bool) -> Vec<Trial> {
    let has_data = real_data::root().is_some_and(|root| root.join(Dataset::Tsukuba.name()).is_dir());
    let mut trials = Vec::new();
    let mut test = |name: &str, is_here: bool, run: Box<dyn Fn() -> Outcome + Send>| {
        let run = move || run().map_err(|error| error.to_string().into());
        trials.push(Trial::test(format!("capture_command::{name}"), run).with_ignored_flag(!has_cameras || !is_here));
    };
    test("golden_capture", true, Box::new(golden_capture));
    test("real_capture", has_data, Box::new(real_capture));
    test("live_captures", true, Box::new(live_captures));
    test("refusals", true, Box::new(refusals));
    let short: &[&str] = &["--move-timeout", "4"];
    type Case<'a> = (&'a str, Strike, bool, &'a [&'a str], &'a [&'a str]);
    let faults: [Case; 6] = [
        ("arm_never_arrives", |arm| arm.fail(Fault::Stuck), true, short, &[]),
        ("arm_ignores_orders", |arm| arm.fail(Fault::Ignoring), false, short, &[]),
        ("arm_stops_protectively", |arm| arm.fail(Fault::ProtectiveStop { after_m: 0.004 }), false, &[], &["protective"]),
        ("arm_falls_silent", |arm| arm.fail(Fault::Silent), true, &["--silence-timeout", "3"], &[]),
        ("arm_disconnects", |arm| arm.disconnect(), true, &[], &[]),
        ("arm_is_none", |arm| arm.fail(Fault::OtherProtocol), false, &[], &[]),
    ];
    for (name, strike, while_it_moves, arguments, words) in faults {
        test(name, true, Box::new(move || arm_fault(strike, while_it_moves, arguments, words)));
    }
    test("camera_starves", true, Box::new(camera_starves));
    for phase in [Phase::Connecting, Phase::Moving, Phase::Settling, Phase::Capturing, Phase::Returning] {
        test(&format!("interrupted::{phase:?}"), true, Box::new(move || interrupted(phase)));
    }
    test("disk_full", true, Box::new(disk_full));
    trials
}
