//! A third-party client understands the simulated arm: `ur-rtde` reads the poses that the driver commanded.
//!
//! The client is installed into the build folder. If that is impossible, the test is reported as ignored,
//! with the reason in its name.

use std::{
    error::Error,
    io::{BufRead, BufReader, Lines, Write},
    net::Ipv4Addr,
    path::{Path, PathBuf},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use libtest_mimic::{Arguments, Failed, Trial};
use multiscopic::capture::stage::{AnyStage, Limits};
use multiscopic_core::capture::{Position, Stage};
use multiscopic_tests::simulated::{
    arm::{Fault, SimulatedArm},
    pose::{Pose, angle, distance, pose_trans},
};

/// The Python package of the client.
const PACKAGE: &str = "ur-rtde==1.6.5";

/// The client's port is fixed.
const RTDE_PORT: u16 = 30004;

/// For each line of input, waits for two more data packages and prints their contents as numbers. The limit is for a hung test.
const CLIENT: &str = "
import sys, time, rtde_receive
arm = rtde_receive.RTDEReceiveInterface(sys.argv[1])
for line in sys.stdin:
    for _ in range(2):
        last, begin = arm.getTimestamp(), time.monotonic()
        while arm.getTimestamp() == last:
            if time.monotonic() > begin + 120:
                sys.exit('no package came')
            time.sleep(0.001)
    numbers = arm.getActualTCPPose() + arm.getActualTCPSpeed()
    numbers += [arm.getRobotMode(), arm.getSafetyMode(), arm.getRuntimeState(), arm.isProtectiveStopped()]
    print(*map(float, numbers), flush=True)
";

/// A line that the client prints.
struct Reading {
    pose: Pose,
    speed: [f64; 6],
    robot_mode: f64,
    safety_mode: f64,
    runtime_state: f64,
    is_protectively_stopped: f64,
}

struct Client {
    process: Child,
    questions: ChildStdin,
    answers: Lines<BufReader<ChildStdout>>,
}

impl Client {
    fn start(python: &Path, host: Ipv4Addr) -> Result<Client, Box<dyn Error>> {
        let mut process =
            Command::new(python).args(["-c", CLIENT, &host.to_string()]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let questions = process.stdin.take().ok_or("no standard input")?;
        let answers = BufReader::new(process.stdout.take().ok_or("no standard output")?).lines();
        Ok(Client { process, questions, answers })
    }

    fn read(&mut self) -> Result<Reading, Box<dyn Error>> {
        writeln!(self.questions)?;
        let line = self.answers.next().ok_or("the client has ended")??;
        let numbers = line.split(' ').map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        let six = |first: usize| std::array::from_fn(|i| numbers[first + i]);
        let [robot_mode, safety_mode, runtime_state, is_protectively_stopped] = numbers[12..] else {
            return Err(format!("16 numbers: {line}").into());
        };
        Ok(Reading { pose: six(0), speed: six(6), robot_mode, safety_mode, runtime_state, is_protectively_stopped })
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A Python interpreter with the package, from a virtual environment made on first use.
fn python() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("ur-rtde");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| {
        let output = Command::new(program).args(arguments).output().map_err(|error| error.to_string())?;
        let words = String::from_utf8_lossy(&output.stderr);
        let last = words.lines().last().unwrap_or_default();
        if output.status.success() { Ok(()) } else { Err(format!("{}: {last}", program.display())) }
    };
    if run(&python, &["-c", "import rtde_receive"]).is_err() {
        run(Path::new("python3"), &["-m", "venv", "--clear", &folder.to_string_lossy()])?;
        run(&python, &["-m", "pip", "install", "--quiet", "--disable-pip-version-check", PACKAGE])?;
        run(&python, &["-c", "import rtde_receive"])?;
    }
    Ok(python)
}

/// An arm on a loopback address of its own, since the client's port is fixed.
fn arm(pose: Pose) -> Result<(SimulatedArm, Ipv4Addr), Box<dyn Error>> {
    let mut addresses = (2..=99).map(|last| Ipv4Addr::new(127, 0, 0, last));
    let found = addresses.find_map(|ip| Some((SimulatedArm::listen(ip.into(), [0, RTDE_PORT], pose).ok()?, ip)));
    Ok(found.ok_or("no address of this machine has a free port 30004")?)
}

/// The time limit for whatever hardware does. Only a hung test reaches it.
const PATIENCE: Duration = Duration::from_secs(120);

/// Waits until `is_over`.
fn wait(what: &str, mut is_over: impl FnMut() -> Result<bool, Box<dyn Error>>) -> Result<(), Box<dyn Error>> {
    let start = Instant::now();
    while !is_over()? {
        if start.elapsed() > PATIENCE {
            return Err(format!("it never came that {what}").into());
        }
        thread::sleep(Duration::from_millis(4));
    }
    Ok(())
}

fn arrive(stage: &mut AnyStage) -> Result<(), Box<dyn Error>> {
    wait("the arm arrives", || Ok(stage.has_arrived()?))
}

fn expect(is_right: bool, what: impl Into<String>) -> Result<(), Box<dyn Error>> {
    if is_right { Ok(()) } else { Err(what.into().into()) }
}

fn reads_what_was_commanded(python: &Path) -> Result<(), Box<dyn Error>> {
    let start = [-0.3, 0.25, 0.6, 0.3, -1.2, 0.7];
    let (arm, host) = arm(start)?;
    let mut client = Client::start(python, host)?;
    let limits = Limits {
        speed_mm_s: 100.0,
        acceleration_mm_s2: 1000.0,
        connect_timeout: PATIENCE,
        silence_timeout: PATIENCE,
        stall_timeout: PATIENCE,
        ..Limits::default()
    };
    let mut stage = arm.stage(&limits)?;

    for (x_um, y_um) in [(0, 0), (-20_000, 0), (20_000, 0), (0, -20_000), (12_345, 6_789), (0, 0)] {
        let position = Position { x_um, y_um };
        stage.move_to(position)?;
        arrive(&mut stage)?;
        let Reading { pose, speed, robot_mode, safety_mode, runtime_state, .. } = client.read()?;
        let commanded = pose_trans(start, [f64::from(x_um) * 1e-6, f64::from(y_um) * 1e-6, 0.0, 0.0, 0.0, 0.0]);
        let off = (distance(pose, commanded), angle(pose, commanded));
        expect(off.0 < 1e-6 && off.1 < 1e-6, format!("{pose:?} instead of {commanded:?}"))?;
        expect(speed == [0.0; 6], format!("at rest with {speed:?}"))?;
        expect([robot_mode, safety_mode, runtime_state] == [7.0, 1.0, 1.0], "running, normal, stopped")?;
        expect(stage.position()? == Some(position), "the driver measures what it commanded")?;
    }

    // On its way it moves at the commanded speed.
    arm.freeze_after(0.03);
    stage.move_to(Position { x_um: 90_000, y_um: 0 })?;
    wait("the arm cruises", || Ok(distance(arm.pose(), start) > 0.029))?;
    let Reading { pose, speed, runtime_state, .. } = client.read()?;
    expect((1e-3..89e-3).contains(&distance(pose, start)), format!("on its way at {pose:?}"))?;
    expect((speed[0].hypot(speed[1]).hypot(speed[2]) - 0.1).abs() < 1e-6, format!("on its way with {speed:?}"))?;
    expect(runtime_state == 2.0, "a program runs")?;
    arm.freeze_after(f64::INFINITY);
    arm.fail(Fault::ProtectiveStop { after_m: 0.0 });
    expect(client.read()?.is_protectively_stopped == 1.0, "it sees the protective stop")?;
    expect(arrive(&mut stage).is_err(), "so does the driver")
}

fn main() {
    let arguments = Arguments::from_args();
    let python = python();
    let name = match &python {
        Ok(_) => "reads_what_was_commanded".into(),
        Err(reason) => format!("reads_what_was_commanded ({PACKAGE} cannot be installed: {reason})"),
    };
    let is_absent = python.is_err();
    let run = move || reads_what_was_commanded(&python?).map_err(|error| Failed::from(error.to_string()));
    libtest_mimic::run(&arguments, vec![Trial::test(name, run).with_ignored_flag(is_absent)]).exit();
}
