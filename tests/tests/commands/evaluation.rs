//! Light fields and layouts in `evaluate`, with errors as the reference finds them.

use std::{fs, path::Path};

use multiscopic_tests::{
    program::Invocation,
    reference::{Fusion, fixed},
    split_mix::Random,
    test_images::view_set::ViewSet,
};

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
fn evaluate(folder: &Path, arguments: &[&str]) -> (Vec<serde_json::Value>, String) {
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
        let (rows, page) = evaluate(dir.path(), &["--camera-steps", steps, views]);
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
        let (rows, page) = evaluate(dir.path(), arguments);
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
    let (rows, _) = evaluate(dir.path(), &["--camera-steps", "1", "--layout", "1x9", "--views", "2"]);
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
