//! The guide from the box to the picked part, its commands run as it has them: an arm that is simulated at its sockets, a machine
//! with G-code on a pseudo-terminal, and a simulated camera with a lens in place of the real ones.

use std::{collections::HashMap, f64::consts::PI, fs, path::Path, process::Command, time::Duration};

use multiscopic::{CameraModel, Rig, images::Transform, lens::HandEye};
use multiscopic_reference::board_photos::TrueCamera;
use multiscopic_tests::{
    program,
    simulated::{
        arm::SimulatedArm,
        machine::{Firmware, SimulatedMachine},
    },
    test_images::read_pfm,
};

use crate::{
    command_line::documentation::shell_lines,
    lenses::{hand_eye, lens_calibration},
};

/// The tool, which looks down.
const START: [f64; 6] = [0.4, -0.2, 0.7, PI, 0.0, 0.0];
/// The camera on the tool: square, as the simulated one is to any stage, and beside it.
const ON_TOOL: Transform = Transform { translation_mm: [35.0, -60.0, 80.0], rotation_deg: [0.0; 3] };
/// Options that make moves quick, and clouds easy to read.
const MORE: [(&str, &str); 3] = [
    ("multiscopic capture", "--speed 250 --acceleration 1200 --settle 0"),
    ("multiscopic calibrate mount", "--speed 250 --acceleration 1200 --settle 0"),
    ("multiscopic match rig --frame base", "--ply-ascii"),
];

fn camera() -> TrueCamera {
    let coefficients = vec![-0.25, 0.08, 0.0, 0.0, 0.0];
    TrueCamera { focal: [940.0, 940.0], middle: [323.0, 236.0], coefficients, is_equidistant: false }
}

/// The camera for `--camera sim:FILE`.
fn write_simulated(path: &Path) {
    let TrueCamera { focal, middle, coefficients, .. } = camera();
    let lens = format!(
        "[lens]\nfocal_px = {focal:?}\nprincipal_point = {middle:?}\nmodel = \"plumb_bob\"\ncoefficients = {coefficients:?}\n"
    );
    fs::write(path, lens).expect("the folder is there");
}

/// Checks a cloud in the frame of the base against the true disparities of its rig: points are where the camera, which is where
/// the arm was and the simulated camera on it, saw them.
fn assert_in_place(rig: &Path, cloud: &Path) {
    let lens = CameraModel::read(&rig.join(CameraModel::FILE_NAME)).expect("a lens");
    let (width, height, truth) = read_pfm(&rig.join("truth.pfm"));
    let rig = Rig::load(rig).expect("a rig.toml");
    let camera_in_base = rig.poses["center"].measured.expect("a measured pose") * ON_TOOL;
    let baseline_mm = rig.baseline_mm.expect("a baseline");
    let text = fs::read_to_string(cloud).expect("a PLY file");
    let (header, points) = text.split_once("end_header\n").expect("a header");
    assert!(header.contains("comment frame base\n"), "{header}");
    let (mut count, mut within, mut off) = (0, 0, Vec::new());
    for line in points.lines() {
        let numbers: Vec<f64> = line.split(' ').map(|number| number.parse().expect("a number")).collect();
        let [x, y, z] = camera_in_base.inverse().point([0, 1, 2].map(|axis| 1000.0 * numbers[axis]));
        let [u, v] = [x, y].map(|offset| lens.focal_px[0] * offset / z);
        let [u, v] = [u + lens.principal_point[0], v + lens.principal_point[1]].map(|at| at.round() as usize);
        // The camera's mount, which turns by hundredths of a degree, may move a point of the border out.
        if u >= width || v >= height {
            continue;
        }
        let expected = lens.focal_px[0] * baseline_mm / f64::from(truth[v * width + u]);
        off.push((z - expected) / expected);
        count += 1;
        within += usize::from((z - expected).abs() < 10.0);
    }
    off.sort_unstable_by(f64::total_cmp);
    let median = off[off.len() / 2];
    println!("{count} points, {within} of them within 10 mm, {:.2} % off in the median", 100.0 * median);
    // Two of the deviations that --max-sigma lets through.
    assert!(count > 5_000 && within * 100 > count * 95, "{within} of {count} points");
    assert!(median.abs() < 0.004, "{median}");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation")]
fn a_part_is_found_by_the_commands_of_the_guide() {
    let guide = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/picking.md")).expect("the guide");
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let arm = SimulatedArm::start(START);
    let machine = SimulatedMachine::start(Firmware::Grbl, [0.0; 2], Duration::ZERO);
    write_simulated(&at("sim.toml"));
    let poses = lens_calibration::poses(&camera(), 15);
    let photos = lens_calibration::Photos::new("charuco", &camera(), &poses, 0);
    let tools: Vec<_> = poses.iter().map(|pose| hand_eye::tool_at(pose, ON_TOOL)).collect();
    let led = hand_eye::led_arm(&photos.file(""), &tools);
    let (arm_spec, machine_spec) = (arm.spec(), machine.spec());
    let stands_in: HashMap<&str, &str> = HashMap::from([
        ("/dev/video0", "sim:sim.toml"),
        ("exec:sh camera_rpicam.sh --shutter 8000 --gain 1 --awbgains 1.8,1.6", "sim:sim.toml"),
        ("ur10:192.168.0.10", arm_spec.as_str()),
        ("gcode:/dev/ttyUSB0", machine_spec.as_str()),
    ]);
    let (arms, slides) = guide.split_once("## With an XY slide").expect("the part about slides");
    let run = |line: &String| {
        // It serves a page until it is closed.
        if line.starts_with("multiscopic live") {
            return;
        }
        let mut words = shlex::split(line).expect("closed quotations");
        assert_eq!(words.remove(0), "multiscopic", "{line}");
        words.extend(
            MORE.iter().filter(|(start, _)| line.starts_with(start)).flat_map(|(_, more)| more.split(' ')).map(Into::into),
        );
        let is_led = line.starts_with("multiscopic calibrate hand-eye");
        let words = words.iter().map(|word| match word.as_str() {
            "/dev/video0" if is_led => &led[0],
            "ur10:192.168.0.10" if is_led => &led[1],
            word => stands_in.get(word).copied().unwrap_or(word),
        });
        let output = Command::new(program::binary()).args(words).current_dir(dir.path()).output().expect("the program runs");
        let messages = String::from_utf8_lossy(&output.stderr);
        println!("{line}\n{messages}");
        assert_eq!(output.status.code(), Some(0), "{line}: {messages}");
    };
    shell_lines(arms).iter().for_each(run);
    let place = HandEye::read(&at("hand_eye.toml")).expect("a hand_eye.toml").camera_in_tool();
    let away =
        [0, 1, 2].map(|axis| (place.translation_mm[axis] - ON_TOOL.translation_mm[axis]).powi(2)).iter().sum::<f64>().sqrt();
    assert!(away < 0.5, "{place:?}");
    assert_in_place(&at("rig"), &at("cloud.ply"));

    // The guide of the slide uses the same names.
    fs::remove_dir_all(at("rig")).expect("a rig");
    fs::remove_file(at("cloud.ply")).expect("a cloud");
    shell_lines(slides).iter().for_each(run);
    assert!(fs::metadata(at("cloud.ply")).expect("a cloud").len() > 10_000);
}
