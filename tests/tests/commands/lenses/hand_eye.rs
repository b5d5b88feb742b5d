//! `calibrate hand-eye` on pictures of a board and poses of an arm.

use std::{fs, path::Path};

use multiscopic::{images::Transform, lens::HandEye};
use multiscopic_reference::board_photos::{BoardPose, SIZE};
use multiscopic_tests::program::Invocation;

use super::{
    lens_calibration::{BOARD_MM, Photos, plumb_bob, poses},
    text,
};

/// The camera on the tool.
const ON_TOOL: Transform = Transform { translation_mm: [35.0, -60.0, 80.0], rotation_deg: [2.0, -3.0, 88.0] };
/// The board in the base.
const BOARD: Transform = Transform { translation_mm: [450.0, -120.0, 15.0], rotation_deg: [4.0, 176.0, 3.0] };

/// The board in the camera.
fn board_in_camera(pose: &BoardPose) -> Transform {
    let turn = |rotation_deg| Transform { translation_mm: [0.0; 3], rotation_deg };
    let [right, down] = pose.tilt_deg;
    let rotation = turn([right, 0.0, 0.0]) * turn([0.0, down, 0.0]) * turn([0.0, 0.0, pose.roll_deg]);
    let corner = Transform { translation_mm: [-BOARD_MM[0] / 2.0, -BOARD_MM[1] / 2.0, 0.0], rotation_deg: [0.0; 3] };
    Transform { translation_mm: pose.center, rotation_deg: [0.0; 3] } * rotation * corner
}

/// The pose of the tool from which a camera `on_tool` sees the board in this pose.
pub fn tool_at(pose: &BoardPose, on_tool: Transform) -> Transform {
    BOARD * (on_tool * board_in_camera(pose)).inverse()
}

/// A camera and an arm that somebody leads from pose to pose, as `--camera` and `--stage` name them: commands of which the camera
/// shows each of the pictures `00.png`, `01.png` and so on in `folder` twice, and the arm tells the pose of the last one.
pub fn led_arm(folder: &Path, tools: &[Transform]) -> [String; 2] {
    let lines = tools
        .iter()
        .map(|Transform { translation_mm: [x, y, z], rotation_deg: [rx, ry, rz] }| format!("{x} {y} {z} {rx} {ry} {rz}\n"));
    let camera = "n=-1; echo 1 > at
while read -r order path; do
    case $order in
    open) echo ok ;;
    take) n=$((n + 1)); k=$((n < 2 ? 0 : (n - 1) / 2)); echo $((k + 1)) > at; cp \"$(printf %02d.png $k)\" \"$path\"; echo ok ;;
    esac
done
";
    let arm = "while read -r order rest; do
    case $order in
    where) echo \"ok 0 0 $(sed -n \"$(cat at)p\" poses.txt)\" ;;
    *) echo ok ;;
    esac
done
";
    let poses: String = lines.collect();
    for (name, text) in [("poses.txt", &*poses), ("camera.sh", camera), ("arm.sh", arm), ("at", "1\n")] {
        fs::write(folder.join(name), text).expect("the folder is there");
    }
    ["camera", "arm"].map(|name| format!("exec:sh -c 'cd {} && . ./{name}.sh'", folder.display()))
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn the_place_of_a_camera_on_a_tool_is_found_from_pictures() {
    let camera = plumb_bob();
    let board_poses = poses(&camera, 10);
    let photos = Photos::new("charuco", &camera, &board_poses, 0);
    let [lens, table, found] = ["camera.toml", "poses.csv", "hand_eye.toml"].map(|name| photos.file(name));
    let ([fx, fy], [cx, cy]) = (camera.focal, camera.middle);
    let [width, height] = SIZE;
    let coefficients = &camera.coefficients;
    let calibration = format!(
        "size = [{width}, {height}]\nfocal_px = [{fx:?}, {fy:?}]\nprincipal_point = [{cx:?}, {cy:?}]\nmodel = \"plumb_bob\"\n\
         coefficients = {coefficients:?}\n"
    );
    fs::write(&lens, calibration).expect("the folder is there");
    let write = |order: &[usize]| {
        let mut csv = String::from("image,x_m,y_m,z_m,qx,qy,qz,qw\n");
        for (k, pose) in order.iter().map(|k| &board_poses[*k]).enumerate() {
            let tool = tool_at(pose, ON_TOOL);
            let numbers = tool.translation_mm.map(|mm| mm / 1000.0).into_iter().chain(tool.quaternion());
            csv += &format!("{k:02}.png,{}\n", numbers.map(|number| number.to_string()).collect::<Vec<_>>().join(","));
        }
        fs::write(&table, csv).expect("the folder is there");
    };
    let calibrate = || Invocation::new(["calibrate", "hand-eye", text(&table), "--lens", text(&lens), "-o", text(&found)]);
    write(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    let run = calibrate();
    assert_eq!(run.code, Some(0), "{run:#?}");
    assert!(run.stdout.contains("the arm errs by"), "{run:#?}");
    // An arm that is led by hand gives the same.
    let (taken, tools) = (photos.file("taken"), board_poses.iter().map(|pose| tool_at(pose, ON_TOOL)).collect::<Vec<_>>());
    let [led_camera, led_stage] = led_arm(photos.file("").as_path(), &tools);
    let lead = || {
        let hardware = ["--camera", &led_camera, "--stage", &led_stage, "--pictures", "10"];
        Invocation::new(
            ["calibrate", "hand-eye", text(&taken), "--lens", text(&lens), "-o", text(&found)].into_iter().chain(hardware),
        )
    };
    let led = lead();
    assert_eq!(led.code, Some(0), "{led:#?}");
    assert!(
        led.stderr.contains("turn the tool by 20 to 40 degrees about its ") && led.stderr.contains("picture 10 of 10"),
        "{led:#?}"
    );
    let numbers = |run: &Invocation| run.stdout.lines().rev().take(2).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(numbers(&led), numbers(&run), "{led:#?}");
    lead().assert_refused(&["taken", "File exists"]);
    let found_there = HandEye::read(&found).expect("a hand_eye.toml").camera_in_tool();
    let off = found_there * ON_TOOL.inverse();
    let norm = |numbers: [f64; 3]| numbers.iter().map(|number| number * number).sum::<f64>().sqrt();
    let away = norm([0, 1, 2].map(|axis| found_there.translation_mm[axis] - ON_TOOL.translation_mm[axis]));
    assert!(away < 0.5 && norm(off.rotation_deg) < 0.05, "{found_there:?}, {away} mm off");
    // Poses of other pictures.
    fs::remove_file(&found).expect("it was written");
    write(&[1, 0, 3, 2, 5, 4, 7, 6, 9, 8]);
    calibrate().assert_refused(&["poses and pictures contradict each other", "the units of the poses"]);
    write(&[0, 1, 2]);
    calibrate().assert_refused(&["3 pictures with the board and a pose, at least 5 are needed"]);
    fs::write(&table, "image,x,y,z\n").expect("the folder is there");
    calibrate().assert_refused(&["poses.csv: found the columns `image,x,y,z`"]);
    assert!(!found.exists());
}
