//! `evaluate`: light fields and layouts, with errors as the reference finds them; and captured folders, against the truth,
//! against a plane, and over several captures.

use std::{fs, path::Path};

use multiscopic::{
    Rig,
    files::{FrameFiles, Provenance},
    scene::{Finish, Object, PinholeCamera, Placement, Scene, Shape, Texture, Vec3, render_views},
};
use multiscopic_core::Views;
use multiscopic_reference::{Fusion, fixed, split_mix::Random};
use multiscopic_tests::{
    program::Invocation,
    test_images::{ViewSet, read_pfm},
};
use serde_json::Value;

const WIDTH: usize = 26;
const HEIGHT: usize = 17;

/// A light field of 9 x 9 cameras with random images, and its truth in pixels per camera step.
struct LightField {
    images: Vec<Vec<u8>>,
    truth: Vec<f32>,
}

impl LightField {
    fn new() -> LightField {
        let mut random = Random(4);
        let images = (0..81).map(|_| (0..WIDTH * HEIGHT).map(|_| random.below(256) as u8).collect()).collect();
        let truth = (0..WIDTH * HEIGHT).map(|_| random.below(97) as f32 / 32.0 - 1.5).collect();
        LightField { images, truth }
    }

    /// Writes the files of a scene of `hci4d`. Readers go by the contents of a file, not by its name.
    fn write(&self, folder: &Path) {
        fs::create_dir_all(folder).expect("a folder for the scene");
        for (camera, pixels) in self.images.iter().enumerate() {
            let file = [format!("P5 {WIDTH} {HEIGHT} 255\n").as_bytes(), pixels].concat();
            fs::write(folder.join(format!("input_Cam{camera:03}.png")), file).expect("an image");
        }
        let rows = self.truth.chunks(WIDTH).rev().flatten().flat_map(|d| d.to_le_bytes());
        let file = format!("Pf\n{WIDTH} {HEIGHT}\n-1\n").into_bytes().into_iter().chain(rows).collect::<Vec<u8>>();
        fs::write(folder.join("gt_disp_lowres.pfm"), file).expect("the truth");
    }

    /// The centre and the views at `offsets`, of which a baseline is `steps` cameras.
    fn views(&self, steps: i32, offsets: &[(i32, i32)]) -> ViewSet {
        let image = |(right, down): (i32, i32)| self.images[(40 + steps * (right + 9 * down)) as usize].clone();
        let nearest = [(-1, 0), (1, 0), (0, -1), (0, 1)];
        let views = nearest.map(|offset| offsets.contains(&offset).then(|| image(offset)));
        let others = offsets.iter().filter(|offset| !nearest.contains(offset)).map(|&offset| (offset, image(offset))).collect();
        ViewSet { width: WIDTH, height: HEIGHT, center: image((0, 0)), views, others }
    }

    /// RMS and AvgErr of `disparities` at `steps`, in pixels at four steps.
    fn errors(&self, disparities: &[Option<f64>], steps: f64) -> [f64; 2] {
        let error = |(d, truth): (&Option<f64>, &f32)| {
            let pixels = d.map_or(0.0, |d| f64::from(fixed(d)) / 64.0) * 4.0 / steps;
            (pixels - 4.0 * f64::from(*truth)).abs()
        };
        let errors: Vec<f64> = disparities.iter().zip(&self.truth).map(error).collect();
        let mean = |of: fn(f64) -> f64| errors.iter().map(|&error| of(error)).sum::<f64>() / errors.len() as f64;
        [mean(|error| error * error).sqrt(), mean(|error| error)]
    }
}

/// The offsets of an array, without its centre.
fn array(rows: i32, columns: i32) -> Vec<(i32, i32)> {
    let all = (-rows / 2..=rows / 2).flat_map(|down| (-columns / 2..=columns / 2).map(move |right| (right, down)));
    all.filter(|&offset| offset != (0, 0)).collect()
}

/// Runs `evaluate` with a JSON list and a report, and returns both.
#[track_caller]
fn evaluate_light_field(folder: &Path, arguments: &[&str]) -> (Vec<serde_json::Value>, String) {
    let [json, page] = ["rows.json", "page.html"].map(|name| folder.join(name).display().to_string());
    let folder = folder.display().to_string();
    let mut all = vec!["evaluate", &folder, "--dataset", "hci4d", "--json", &json, "--report", &page, "--block-size", "3"];
    all.extend(arguments);
    let run = Invocation::new(all);
    assert_eq!(run.code, Some(0), "{run:#?}");
    let rows = serde_json::from_slice(&fs::read(json).expect("rows")).expect("a list in JSON");
    (rows, fs::read_to_string(page).expect("a page"))
}

#[test]
fn a_light_field_is_matched_at_any_baseline_and_in_any_layout() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let field = LightField::new();
    field.write(&dir.path().join("hci4d/noise"));
    let cross = vec![(-1, 0), (1, 0), (0, -1), (0, 1)];
    let cases = [
        ("4", "--views=4", cross.clone(), Fusion::Heuristic),
        ("2", "--views=4", cross.clone(), Fusion::Heuristic),
        ("1", "--layout=cross", cross, Fusion::Heuristic),
        ("4", "--layout=3x3", array(3, 3), Fusion::Half),
        ("2", "--layout=5x5", array(5, 5), Fusion::Half),
        ("1", "--layout=3x7", array(3, 7), Fusion::Half),
    ];
    for (steps, views, offsets, fusion) in cases {
        let count: i32 = steps.parse().expect("a number");
        let (rows, page) = evaluate_light_field(dir.path(), &["--camera-steps", steps, views]);
        let [row] = &rows[..] else { panic!("{rows:?}") };
        let (least, disparities) = (-2 * count, 4 * count + 1);
        let expected = field.views(count, &offsets).reference(fusion, least, disparities, 3).disparities();
        let found = ["rms", "avg_err"].map(|key| row[key].as_f64().expect("a number"));
        let expected = field.errors(&expected, count.into());
        let is_equal = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6);
        assert!(is_equal, "{steps} steps, {views}: {found:?} instead of {expected:?}");
        assert_eq!(row["views"], offsets.len());
        assert_eq!(row["camera_steps"].as_i64(), (count != 4).then_some(i64::from(count)), "{row}");
        let is_named = matches!(views, "--layout=5x5" | "--layout=3x7");
        assert_eq!(row["layout"].as_str(), views.strip_prefix("--layout=").filter(|_| is_named), "{row}");
        assert_eq!(page.matches("<polyline").count(), SPARSIFICATION_LINES, "a single result has no other chart");
    }
}

/// The sparsification of a result is drawn as a curve and its optimum.
const SPARSIFICATION_LINES: usize = 2;

#[test]
fn charts_show_several_views_and_baselines() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    LightField::new().write(&dir.path().join("noise"));
    let charts = |arguments: &[&str]| {
        let (rows, page) = evaluate_light_field(dir.path(), arguments);
        let titles = ["Error over the number of views", "Error over the longest baseline"];
        let lines = page.matches("<polyline").count() - SPARSIFICATION_LINES * rows.len();
        (rows.len(), titles.map(|title| page.contains(title)), lines)
    };
    // One line for each method, and for each rule if rules are compared.
    assert_eq!(charts(&["--views", "1,2,4,8", "--methods", "bm,sgm"]), (8, [true, false], 2));
    assert_eq!(charts(&["--views", "1,4,8", "--fusion", "min,half"]), (5, [true, false], 2));
    // Left and right at 1, 1 and 2, and 1 to 4 baselines; the cross besides.
    let baselines = ["--camera-steps", "1", "--baselines", "2,3,4"];
    assert_eq!(charts(&[&baselines[..], &["--views", "2"]].concat()), (4, [false, true], 1));
    assert_eq!(charts(&[&baselines[..], &["--views", "2,4"]].concat()), (8, [true, true], 1 + 2));
    // A row of cameras is left and right at several baselines.
    let (rows, _) = evaluate_light_field(dir.path(), &["--camera-steps", "1", "--layout", "1x9", "--views", "2"]);
    assert_eq!(rows[1]["baselines"], serde_json::json!([1, 2, 3, 4]));
}

#[test]
fn what_a_data_set_does_not_have_is_refused() {
    let dir = tempfile::tempdir().expect("a folder for the test");
    let folder = dir.path().join("noise");
    LightField::new().write(&folder);
    let path = dir.path().display().to_string();
    let refused = |dataset: &str, arguments: &[&str], words: &[&str]| {
        let all = [&["evaluate", &path, "--dataset", dataset][..], arguments].concat();
        Invocation::new(all).assert_refused(words);
    };
    refused("hci4d", &["--layout", "5x5"], &["--layout", "5x5", "4 camera steps"]);
    refused("hci4d", &["--layout", "4x4"], &["4x4", "odd"]);
    refused("hci4d", &["--layout", "7x5"], &["7x5", "34 neighbours"]);
    refused("hci4d", &["--camera-steps", "3"], &["3 camera steps", "1, 2 or 4"]);
    refused("hci4d", &["--baselines", "2"], &["--baselines", "--camera-steps"]);
    refused("hci4d", &["--camera-steps", "1", "--layout", "5x5", "--baselines", "3"], &["24 views", "--baselines"]);
    refused("tsukuba", &["--camera-steps", "2"], &["tsukuba", "hci4d"]);
    fs::remove_file(folder.join("input_Cam049.png")).expect("a file");
    refused("hci4d", &["--camera-steps", "1"], &["input_Cam049.png"]);
}

const SIZE: [usize; 2] = [160, 120];
const WALL_MM: f64 = 400.0;

/// A camera that is 240 pixels long, on a baseline of 20 mm.
fn camera() -> PinholeCamera {
    PinholeCamera::new(SIZE[0] as u32, SIZE[1] as u32)
}

/// Captures a textured wall at [`WALL_MM`], turned by these angles in degrees about the axes to the right and down. Returns its
/// normal in the axes of the camera.
fn capture_wall(folder: &Path, camera: &PinholeCamera, turned: [f64; 2], seed: u64) -> [f64; 3] {
    let demo = Scene::demo();
    let pose = demo.viewpoint.moved([0.0, 0.0, WALL_MM]).rotated([turned[0].to_radians(), turned[1].to_radians(), 0.0]);
    let [low, high] = [0.05, 0.9].map(|light| Vec3 { x: light, y: light, z: light });
    let wall = Object {
        shape: Shape::Panel { half_width: 2000.0, half_height: 2000.0 },
        pose,
        texture: Texture::Plaster { low, high, grain: 3.0, octaves: 3 },
        placement: Placement::IDENTITY,
        finish: Finish::Matte,
    };
    let normal = demo.viewpoint.local_direction(pose.axes[2]);
    let shot = render_views(&Scene { objects: vec![wall], ..demo }, camera, Views::HORIZONTAL, seed);
    fs::create_dir(folder).expect("a folder");
    let mut images = FrameFiles { center: "center.png".into(), ..FrameFiles::default() };
    shot.center.save(folder.join(&images.center)).expect("the centre");
    for (view, image) in &shot.neighbors {
        let name = format!("{view}.png");
        image.save(folder.join(&name)).expect("a view");
        images = images.with(*view, name.into());
    }
    let rig = Rig {
        baseline_mm: Some(camera.baseline_mm),
        focal_px: Some(camera.focal_px),
        principal_point: None,
        doffs: 0.0,
        lens: None,
        mount_rotation_deg: None,
        mount_roll_deg: None,
        sweep: Vec::new(),
        hand_eye: None,
        poses: Default::default(),
        images,
        alignment: None,
        capture: Provenance::default(),
    };
    rig.save(folder).expect("a rig.toml");
    [normal.x, normal.y, normal.z]
}

/// Captures the scene of the demo quickly with simulated hardware.
fn capture(camera: &str, folder: &Path, more: &[&str]) {
    let (folder, size) = (folder.to_str().expect("a path in UTF-8"), "96x72");
    let quick = ["--speed", "250", "--acceleration", "1200", "--settle", "0", "--size", size];
    let arguments = ["capture", "--camera", camera, "--stage", "sim", "--baseline", "20", "--views", "2", "-o", folder];
    Invocation::new(arguments.iter().chain(&quick).chain(more)).assert_done();
}

fn evaluate(folders: &[&Path], more: &[&str]) -> Invocation {
    let folders = folders.iter().map(|folder| folder.to_str().expect("a path in UTF-8"));
    Invocation::new(["evaluate"].into_iter().chain(folders).chain(["--num-disparities", "30"]).chain(more.iter().copied()))
}

/// The records of an evaluation, and its tables.
#[track_caller]
fn records(folders: &[&Path], more: &[&str]) -> (Vec<Value>, String) {
    let json = folders[0].with_extension("json");
    let run = evaluate(folders, &[&["--json", json.to_str().expect("a path in UTF-8")], more].concat());
    assert_eq!(run.code, Some(0), "{run:#?}");
    (serde_json::from_slice(&fs::read(&json).expect("records")).expect("a list in JSON"), run.stdout)
}

/// The disparities that `match` finds.
fn matched(folder: &Path) -> Vec<f64> {
    let output = folder.with_extension("pfm");
    let paths = [folder, &output].map(|path| path.to_str().expect("a path in UTF-8"));
    Invocation::new(["match", paths[0], "--method", "bm", "--num-disparities", "30", "-o", paths[1]]).assert_done();
    read_pfm(&output).2.into_iter().map(f64::from).collect()
}

#[track_caller]
fn assert_near(found: &Value, expected: f64, tolerance: f64) {
    let found = found.as_f64().expect("a number");
    assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// The distance of a wall in millimetres, and by how many degrees it recedes to the right and down: by least squares over all
/// disparities in the middle half of both sides, whose coordinates are not correlated.
fn least_squares(disparities: &[f64], [width, height]: [usize; 2], focal_px: f64) -> [f64; 3] {
    let [mut count, mut sum, mut squares, mut products] = [0.0, 0.0, 0.0, 0.0].map(|zero| [zero; 2]);
    for v in height / 4..height * 3 / 4 {
        for u in width / 4..width * 3 / 4 {
            let d = disparities[v * width + u];
            let place = [(u, width), (v, height)].map(|(at, side)| (at as f64 - (side as f64 - 1.0) / 2.0) / focal_px);
            for (axis, place) in place.into_iter().enumerate() {
                count[axis] += 1.0;
                sum[axis] += d;
                squares[axis] += place * place;
                products[axis] += place * d;
            }
        }
    }
    let ahead = sum[0] / count[0];
    let recedes = |axis: usize| (-products[axis] / squares[axis] / ahead).atan().to_degrees();
    [focal_px * 20.0 / ahead, recedes(0), recedes(1)]
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_slanted_wall_is_measured() {
    let dir = tempfile::tempdir().expect("a folder");
    let folder = dir.path().join("wall");
    // At 18 pixels of disparity.
    let [x, y, z] = capture_wall(&folder, &PinholeCamera::new(240, 180).ideal(), [-12.0, 20.0], 1);
    let page = dir.path().join("page.html");
    let (records, table) =
        records(&[&folder], &["--plane", "390", "--views", "1,2", "--report", page.to_str().expect("a path in UTF-8")]);
    assert_eq!(records.len(), 2);
    for record in &records {
        let plane = &record["plane"];
        assert_near(&plane["distance_mm"], WALL_MM, 2.0);
        assert_near(&plane["z_accuracy_percent"], 100.0 * (WALL_MM - 390.0) / 390.0, 0.6);
        // In the region, a degree changes disparities by 0.1 pixels, which block matching pulls towards whole pixels.
        assert_near(&plane["tilt_deg"], z.acos().to_degrees(), 1.0);
        // A plane with the normal n has n (X, Y, Z) = constant.
        assert_near(&plane["recedes_right_deg"], (-x / z).atan().to_degrees(), 1.0);
        assert_near(&plane["recedes_down_deg"], (-y / z).atan().to_degrees(), 1.0);
        assert_near(&plane["fill_rate"], 100.0, 1.0);
        assert_near(&plane["outliers"], 0.0, 1.0);
        assert_near(&plane["rms_px"], 0.0, 0.2);
        // At 400 mm, a pixel is Z^2 / (f B) = 22 mm.
        assert_near(&plane["rms_mm"], 22.2 * plane["rms_px"].as_f64().expect("a number"), 1.0);
        assert!(record.get("rms").is_none() && record.get("noise").is_none() && record.get("depth").is_none(), "{record}");
    }
    let [distance, right, down] = least_squares(&matched(&folder), [240, 180], 360.0);
    assert_near(&records[1]["plane"]["distance_mm"], distance, 0.5);
    assert_near(&records[1]["plane"]["recedes_right_deg"], right, 0.2);
    assert_near(&records[1]["plane"]["recedes_down_deg"], down, 0.2);
    assert!(table.starts_with("A flat wall\n") && table.contains("stereo bm") && table.contains("(2 views, min)"), "{table}");
    let page = fs::read_to_string(page).expect("a page");
    assert!(page.contains("A flat wall"), "{}", page.len());
    let (_, planes) = page.split_once("Distance from the plane").expect("pictures");
    assert_eq!(planes.matches("</figcaption>").count(), 2);
}

#[test]
fn noise_is_that_of_the_maps() {
    let dir = tempfile::tempdir().expect("a folder");
    let folders = ["a", "b", "c"].map(|name| dir.path().join(name));
    // A sensor with few electrons, which is noisy.
    let camera = PinholeCamera { repeatability_mm: 0.0, full_well: 400.0, focal_px: 240.0, ..PinholeCamera::new(96, 72) };
    for (folder, seed) in folders.iter().zip(1..) {
        capture_wall(folder, &camera, [-12.0, 20.0], seed);
    }
    let (records, table) = records(&folders.each_ref().map(|folder| folder.as_path()), &[]);
    assert_eq!(records.len(), 3);
    let maps = folders.each_ref().map(|folder| matched(folder));
    let pixels: Vec<[f64; 3]> = (0..maps[0].len()).map(|k| [0, 1, 2].map(|map: usize| maps[map][k])).collect();
    let valid: Vec<[f64; 3]> = pixels.into_iter().filter(|pixel| pixel.iter().all(|d| d.is_finite())).collect();
    // The median of the standard deviation of three numbers is the root of ln 2: half of chi-squared with two degrees of freedom.
    let deviation = |[a, b, c]: [f64; 3]| {
        let mean = (a + b + c) / 3.0;
        (((a - mean).powi(2) + (b - mean).powi(2) + (c - mean).powi(2)) / 2.0).sqrt() / 2.0f64.ln().sqrt()
    };
    let depths = |pixel: &[f64; 3]| pixel.map(|d| 240.0 * 20.0 / d);
    let px = median(valid.iter().map(|pixel| deviation(*pixel)).collect());
    let mm = median(valid.iter().map(|pixel| deviation(depths(pixel))).collect());
    let relative = |pixel: &[f64; 3]| 100.0 * deviation(depths(pixel)) * 3.0 / depths(pixel).iter().sum::<f64>();
    let percent = median(valid.iter().map(relative).collect());
    assert!(px > 0.005, "the sensor is noisy: {px}");
    for record in &records {
        assert_eq!(record["noise"]["captures"], 3);
        assert_near(&record["noise"]["valid"], 100.0 * valid.len() as f64 / maps[0].len() as f64, 1e-6);
        assert_near(&record["noise"]["px"], px, 0.01 * px);
        assert_near(&record["noise"]["mm"], mm, 0.01 * mm);
        assert_near(&record["noise"]["percent"], percent, 0.01 * percent);
    }
    assert!(table.starts_with("Noise over the captures\n") && table.lines().count() == 5, "{table}");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_simulated_rig_is_compared_with_its_truth() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let lens = "focal_px = [141.0, 141.0]\nprincipal_point = [48.5, 35.25]\nmodel = \"plumb_bob\"\n\
                coefficients = [-0.25, 0.08, 0.0, 0.0, 0.0]\n";
    fs::write(at("errors.toml"), format!("[lens]\n{lens}[mount]\nrotation_deg = [1.5, -2.0, 2.5]\n")).expect("a file");
    fs::write(at("camera.toml"), lens).expect("a file");
    fs::write(at("mount.toml"), "rotation_deg = [1.5, -2.0, 2.5]\n").expect("a file");
    let [errors, camera, mount] = ["errors.toml", "camera.toml", "mount.toml"].map(|name| at(name).display().to_string());
    capture(&format!("sim:{errors}"), &at("live"), &["--lens", &camera, "--mount", &mount, "--live", "--count", "2"]);
    let [first, second] = ["live/0001", "live/0002"].map(at);
    let (records, table) = records(&[&first, &second], &[]);
    for (record, folder) in records.iter().zip([&first, &second]) {
        let (found, truth) = (matched(folder), read_pfm(&folder.join("truth.pfm")).2);
        let known: Vec<[f64; 2]> =
            found.iter().zip(truth).map(|(d, truth)| [*d, f64::from(truth)]).filter(|[_, truth]| truth.is_finite()).collect();
        let error = |[d, truth]: &[f64; 2]| if d.is_finite() { d - truth } else { -truth };
        let rms = (known.iter().map(|pair| error(pair).powi(2)).sum::<f64>() / known.len() as f64).sqrt();
        assert_near(&record["rms"], rms, 1e-4 * rms);
        let valid = found.iter().filter(|d| d.is_finite()).count() as f64;
        assert_near(&record["fill_rate"], 100.0 * valid / found.len() as f64, 1e-6);
        let relative: Vec<f64> =
            known.iter().filter(|[d, _]| d.is_finite() && *d > 0.0).map(|[d, truth]| 100.0 * (truth / d - 1.0)).collect();
        assert_near(&record["depth"]["bias_percent"], median(relative.clone()), 1e-3);
        assert_near(&record["depth"]["median_percent"], median(relative.iter().map(|error| error.abs()).collect()), 1e-3);
        let squares: f64 = relative.iter().map(|error| error * error).sum();
        let rms = (squares / relative.len() as f64).sqrt();
        assert_near(&record["depth"]["rms_percent"], rms, 1e-3 * rms);
        assert_eq!((&record["dataset"], record["views"].as_u64()), (&Value::from("rig"), Some(2)));
    }
    assert_eq!(records[1]["noise"]["captures"], 2);
    let [first, second] = [first, second].map(|folder| fs::read(folder.join("center.png")).expect("the centre"));
    assert!(first != second, "each capture has noise of its own");
    let titles = ["Disparities against the truth", "Depth against the truth", "Noise over the captures"];
    assert!(titles.iter().all(|title| table.contains(title)), "{table}");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn what_cannot_be_compared_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let (wall, small) = (dir.path().join("wall"), dir.path().join("small"));
    capture_wall(&wall, &camera(), [0.0, 0.0], 1);
    capture_wall(&small, &PinholeCamera::new(80, 60), [0.0, 0.0], 1);
    let wall_and = |more: &[&str]| evaluate(&[&wall], more);
    wall_and(&[]).assert_refused(&["nothing to compare", "--truth, --plane, or several captures"]);
    evaluate(&[dir.path()], &["--plane"]).assert_refused(&["has no rig.toml", "--dataset"]);
    wall_and(&["--truth", "no.pfm"]).assert_refused(&["cannot read no.pfm"]);
    let truth = dir.path().join("truth.pfm");
    fs::write(&truth, [b"Pf\n2 1\n-1\n".as_slice(), &[0; 8]].concat()).expect("a file");
    let truth = truth.to_str().expect("a path in UTF-8");
    wall_and(&["--truth", truth]).assert_refused(&["truth.pfm: found disparities of 2x1 pixels", "160x120", "center.png"]);
    wall_and(&["--plane", "--region", "0,0,9,11"]).assert_refused(&["wall: only 99 pixels", "at least 100"]);
    wall_and(&["--plane", "--region", "0,0,161,11"]).assert_refused(&["wall: the region 0,0,161,11", "160x120"]);
    wall_and(&["--plane", "near"]).assert_refused(&["--plane", "a number above 0"]);
    wall_and(&["--region", "0,0,20,20"]).assert_refused(&["--plane"]);
    wall_and(&["--views", "8", "--plane"]).assert_refused(&["--views includes 8", "no -1,-1 view"]);
    wall_and(&["--scenes", "Art", "--plane"]).assert_refused(&["--dataset"]);
    wall_and(&["--dataset", "tsukuba", "--plane"]).assert_refused(&["'--dataset <NAME>' cannot be used with", "--plane"]);
    wall_and(&["--dataset", "tsukuba", "--align"]).assert_refused(&["cannot be used with", "--align"]);
    evaluate(&[&wall, &small], &["--dataset", "tsukuba"]).assert_refused(&["--dataset tsukuba takes one folder, not 2"]);
    evaluate(&[&wall, &small], &[]).assert_refused(&["small has images of 80x60 pixels", "160x120"]);
    // Without the focal length, a distance means nothing; a plane in pixels does.
    let rig = Rig { focal_px: None, ..Rig::load(&wall).expect("a rig") };
    rig.save(&wall).expect("a rig.toml");
    wall_and(&["--plane", "400"]).assert_refused(&["--plane with a distance needs the focal length", "--focal-px"]);
    let (records, _) = records(&[&wall], &["--plane"]);
    assert!(records[0]["plane"].get("distance_mm").is_none(), "{records:?}");
    assert_near(&records[0]["plane"]["rms_px"], 0.0, 0.3);
}
