//! Tests on real images, which are not in the repository: see [`multiscopic_tests::test_images::real_data`].
//! Without them, every test is reported as ignored.
#![expect(clippy::approx_constant, reason = "errors that happen to look like pi")]

use std::{error::Error, path::Path};

use libtest_mimic::{Arguments, Failed, Trial};
use multiscopic::Alignment;
use multiscopic_core::{Evened, Frame, Histogram, Matcher, Region, SearchConfig, View, kernel::Portable};
use multiscopic_reference::{
    Fusion::{self, Heuristic, Mean, Min},
    raw16,
    split_mix::Random,
};
use multiscopic_tests::{
    program::Invocation,
    test_images::{
        ViewSet,
        core_match::{matched, params},
        misaligned, read_pfm,
        real_data::{self, Dataset, Scene},
    },
};

/// The errors that `evaluate` reports: RMS and AvgErr in pixels, Bad0.5, Bad1 and Bad2 in percent.
type Errors = [f64; 5];

/// A test, given the folder of the data.
type Test = Box<dyn Fn(&Path) -> Result<(), Failed> + Send>;

/// A scene, its match, and its errors by number of views and fusion rule, computed by an independent
/// implementation.
struct Known {
    dataset: Dataset,
    scene: &'static str,
    min_disparity: i32,
    num_disparities: i32,
    block_size: i32,
    errors: &'static [(u64, Fusion, Errors)],
}

const KNOWN: [Known; 4] = [
    Known {
        dataset: Dataset::Middlebury2006Third,
        scene: "Aloe",
        min_disparity: 1,
        num_disparities: 30,
        block_size: 11,
        errors: &[(1, Min, [1.094, 0.351, 8.72, 6.70, 5.11]), (2, Min, [0.868, 0.271, 6.28, 4.88, 3.63])],
    },
    Known {
        dataset: Dataset::Middlebury2006Third,
        scene: "Lampshade1",
        min_disparity: 1,
        num_disparities: 30,
        block_size: 11,
        errors: &[(1, Min, [2.808, 1.156, 28.93, 20.43, 16.50]), (2, Min, [2.502, 0.965, 23.78, 17.48, 14.16])],
    },
    Known {
        dataset: Dataset::Tsukuba,
        scene: "tsukuba",
        min_disparity: 1,
        num_disparities: 18,
        block_size: 9,
        errors: &[
            (1, Min, [1.815, 0.761, 30.21, 13.99, 9.64]),
            (4, Min, [1.543, 0.622, 25.53, 10.79, 7.74]),
            (4, Mean, [1.365, 0.476, 15.20, 7.38, 6.06]),
            (4, Heuristic, [1.474, 0.618, 27.74, 12.30, 7.37]),
        ],
    },
    Known {
        dataset: Dataset::Hci4d,
        scene: "cotton",
        min_disparity: -8,
        num_disparities: 17,
        block_size: 9,
        errors: &[
            (1, Min, [1.361, 0.373, 6.26, 4.76, 3.84]),
            (4, Min, [0.908, 0.232, 3.55, 2.57, 1.91]),
            (4, Mean, [1.110, 0.296, 5.13, 3.84, 3.14]),
            (4, Heuristic, [0.854, 0.216, 3.39, 2.37, 1.74]),
        ],
    },
];

/// Scenes, and the top left pixel of the part that the core and the float reference match.
const PARTS: [(Dataset, &str, usize, usize); 4] = [
    (Dataset::Middlebury2006Third, "Aloe", 180, 150),
    (Dataset::Middlebury2005Full, "Art", 610, 420),
    (Dataset::Tsukuba, "tsukuba", 150, 100),
    (Dataset::Hci4d, "cotton", 230, 200),
];

fn name(fusion: Fusion) -> &'static str {
    match fusion {
        Min => "min",
        Mean => "mean",
        Heuristic => "heuristic",
        Fusion::Half => "half",
        Fusion::Trimmed => "trimmed",
    }
}

/// A row of `evaluate --json`.
#[derive(Debug)]
struct Row {
    scene: String,
    method: String,
    views: u64,
    fusion: String,
    errors: Errors,
    coverage: f64,
}

/// Runs `evaluate` on a data set, by default with block matching.
fn evaluate(root: &Path, dataset: Dataset, arguments: &[&str]) -> Result<Vec<Row>, Failed> {
    let dir = tempfile::tempdir()?;
    let json = dir.path().join("results.json");
    let folder = root.join(dataset.name());
    let paths = [folder.to_str().ok_or("a path in UTF-8")?, json.to_str().ok_or("a path in UTF-8")?];
    // As in the paper, occlusions are left as they are.
    let mut all = vec!["evaluate", paths[0], "--dataset", dataset.name(), "--json", paths[1], "--hidden", "none"];
    all.extend(arguments);
    let run = Invocation::with(&all, real_data::weights().map(|folder| ("MULTISCOPIC_WEIGHTS", folder)));
    if run.code != Some(0) {
        return Err(format!("{all:?}: {run:#?}").into());
    }
    let rows: Vec<serde_json::Value> = serde_json::from_slice(&std::fs::read(json)?)?;
    let row = |value: &serde_json::Value| -> Option<Row> {
        let number = |key: &str| value[key].as_f64();
        let text = |key: &str| value[key].as_str().map(String::from);
        let errors = [number("rms")?, number("avg_err")?, number("bad_0_5")?, number("bad_1")?, number("bad_2")?];
        let is_right = value["dataset"] == dataset.name() && number("seconds")? > 0.0;
        is_right.then_some(Row {
            scene: text("scene")?,
            method: text("method")?,
            views: value["views"].as_u64()?,
            fusion: text("fusion")?,
            errors,
            coverage: number("coverage")?,
        })
    };
    rows.iter().map(|value| row(value).ok_or_else(|| format!("a row of evaluate: {value}").into())).collect()
}

/// `evaluate` reproduces the known errors of a scene within one percent of each.
fn known_errors(root: &Path, known: &Known) -> Result<(), Failed> {
    for &(views, fusion, expected) in known.errors {
        let numbers = [known.min_disparity, known.num_disparities, known.block_size].map(|n| n.to_string());
        let views_argument = views.to_string();
        let mut arguments = vec!["--min-disparity", &numbers[0], "--num-disparities", &numbers[1], "--block-size", &numbers[2]];
        arguments.extend(["--views", &views_argument, "--fusion", name(fusion)]);
        if known.dataset != Dataset::Tsukuba {
            arguments.extend(["--scenes", known.scene]);
        }
        let rows = evaluate(root, known.dataset, &arguments)?;
        let [row] = &rows[..] else { return Err(format!("one row for {arguments:?}: {rows:?}").into()) };
        // One view needs no fusion rule.
        if row.method != "bm"
            || row.views != views
            || (views > 1 && row.fusion != name(fusion))
            || !row.scene.eq_ignore_ascii_case(known.scene)
        {
            return Err(format!("a row for {arguments:?}: {row:?}").into());
        }
        let agrees = row.errors.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= 0.01 * expected);
        if !agrees || !(0.9..=1.0).contains(&row.coverage) {
            return Err(format!("{} with {views} views, {}: {row:?} instead of {expected:?}", known.scene, name(fusion)).into());
        }
    }
    Ok(())
}

/// On Middlebury 2006, two views reduce the error of stereo by a quarter: the mean of the scenes' reductions,
/// which reach 90 % on textured scenes and nothing on plain ones.
fn reduction(root: &Path) -> Result<(), Failed> {
    let rows = evaluate(root, Dataset::Middlebury2006Third, &["--views", "1,2"])?;
    let of = |views: u64| rows.iter().filter(move |row| row.views == views && !row.scene.eq_ignore_ascii_case("mean"));
    let scenes = std::fs::read_dir(root.join(Dataset::Middlebury2006Third.name()))?.count();
    for views in [1, 2] {
        if of(views).count() != scenes {
            return Err(format!("a row with {views} views for each of {scenes} scenes: {rows:#?}").into());
        }
    }
    for (i, figure) in ["RMS", "AvgErr"].into_iter().enumerate() {
        let two = |scene: &str| of(2).find(|row| row.scene == scene).map_or(f64::NAN, |row| row.errors[i]);
        let reduction = of(1).map(|row| 100.0 * (1.0 - two(&row.scene) / row.errors[i])).sum::<f64>() / scenes as f64;
        if !(20.0..=45.0).contains(&reduction) {
            return Err(format!("{figure} falls by {reduction:.1} %: {rows:#?}").into());
        }
    }
    Ok(())
}

/// On a textured, a blank and a striped scene of Middlebury 2006, each method has lower mean AvgErr and Bad1
/// than those before it, and two views lower ones than stereo. Graph cuts are compared with block matching
/// alone. MC-CNN is left out where its weights are not installed.
fn methods(root: &Path) -> Result<(), Failed> {
    let mccnn = if real_data::weights().is_some() { ",mccnn-fast" } else { "" };
    let methods = format!("bm,sgm,gc{mccnn}");
    let rows = evaluate(root, Dataset::Middlebury2006Third, &["--scenes", "Aloe,Lampshade1,Wood1", "--methods", &methods])?;
    let mean = |method: &str, views: u64, error: usize| {
        let errors: Vec<f64> =
            rows.iter().filter(|row| row.method == method && row.views == views).map(|row| row.errors[error]).collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    let orders = [("gc", "bm"), ("sgm", "bm"), ("mccnn-fast", "sgm")];
    for (better, worse) in &orders[..if mccnn.is_empty() { 2 } else { 3 }] {
        for (error, name) in [(1, "AvgErr"), (3, "Bad1")] {
            let [stereo, two] = [1, 2].map(|views| (mean(better, views, error), mean(worse, views, error)));
            let is_better = stereo.0 < stereo.1 && two.0 < two.1 && two.0 < stereo.0;
            if !is_better {
                return Err(format!("{name} of {better} and {worse}: stereo {stereo:?}, two views {two:?}").into());
            }
        }
    }
    Ok(())
}

/// The corners of a 3x3 array lower the AvgErr of semi-global matching and of graph cuts.
fn eight_views(root: &Path, dataset: Dataset) -> Result<(), Failed> {
    let rows = evaluate(root, dataset, &["--views", "4,8", "--methods", "sgm,gc"])?;
    let error = |method: &str, views: u64| {
        rows.iter().find(|row| row.method == method && row.views == views).map_or(f64::NAN, |row| row.errors[1])
    };
    for method in ["sgm", "gc"] {
        let [four, eight] = [4, 8].map(|views| error(method, views));
        let falls = eight < four;
        if !falls {
            return Err(format!("AvgErr of {method} with four and eight views: {four}, {eight}").into());
        }
    }
    Ok(())
}

/// On Middlebury 2005, views at 3 and 5 baselines lower the errors of left and right, and AvgErr by a fifth where both
/// of them see the point.
fn longer_baselines(root: &Path, scene: &str) -> Result<(), Failed> {
    let folder = root.join(Dataset::Middlebury2005Full.name()).join(scene);
    let path = |name: &str| folder.join(name).display().to_string();
    let truth = image::open(folder.join("disp1.png"))?.into_luma8();
    let (width, truth) = (truth.width() as usize, truth.into_raw());
    let truth: Vec<Option<f64>> = truth.into_iter().map(|grey| (grey > 0).then(|| f64::from(grey) / 4.0)).collect();
    // A point is seen if it lies inside the view furthest away, and nothing nearer lies there.
    let column = |u: usize, d: f64| (u as f64 - 5.0 * d).round();
    let mut seen = vec![false; truth.len()];
    for (seen, truth) in seen.chunks_exact_mut(width).zip(truth.chunks_exact(width)) {
        let known = || truth.iter().enumerate().filter_map(|(u, d)| Some((u, (*d)?)));
        let mut nearest = vec![0_f64; width];
        for (u, d) in known().filter(|&(u, d)| column(u, d) >= 0.0) {
            let nearest = &mut nearest[column(u, d) as usize];
            *nearest = nearest.max(d);
        }
        for (u, d) in known().filter(|&(u, d)| column(u, d) >= 0.0) {
            seen[u] = nearest[column(u, d) as usize] <= d + 0.75;
        }
    }
    let dir = tempfile::tempdir()?;
    let errors = |longer: &[&str]| -> Result<[f64; 4], Failed> {
        let map = dir.path().join("map.pfm").display().to_string();
        let images = [path("view1.png"), path("view0.png"), path("view2.png")];
        let mut all = vec!["match", "--center", &images[0], "--left", &images[1], "--right", &images[2], "-o", &map];
        all.extend(["--method", "bm", "--min-disparity", "1"]);
        all.extend(longer);
        let run = Invocation::new(all);
        if run.code != Some(0) {
            return Err(format!("{run:#?}").into());
        }
        let (_, _, found) = read_pfm(Path::new(&map));
        let of = |is_counted: &dyn Fn(usize) -> bool| -> Vec<f64> {
            let known = truth.iter().zip(&found).enumerate().filter(|(i, _)| is_counted(*i));
            known.filter_map(|(_, (truth, found))| Some((f64::from(*found) - (*truth)?).abs())).collect()
        };
        let mean = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
        let all = of(&|_| true);
        let squares: Vec<f64> = all.iter().map(|error| error * error).collect();
        let bad: Vec<f64> = all.iter().map(|&error| if error > 0.5 { 1.0 } else { 0.0 }).collect();
        Ok([mean(&squares).sqrt(), mean(&all), mean(&bad), mean(&of(&|i| seen[i]))])
    };
    let short = errors(&[])?;
    let views = [format!("3,0={}", path("view4.png")), format!("5,0={}", path("view6.png"))];
    let long = errors(&["--view", &views[0], "--view", &views[1]])?;
    let is_better = long.iter().zip(short).all(|(long, short)| *long < short) && long[3] <= 0.8 * short[3];
    if !is_better {
        let message = format!("{scene}: RMS, AvgErr, Bad0.5 and AvgErr where the long views see are {long:?}, before {short:?}");
        return Err(message.into());
    }
    Ok(())
}

/// The core equals the float reference on every bit of a part of a scene.
fn part(root: &Path, dataset: Dataset, scene: &str, left: usize, top: usize) -> Result<(), Box<dyn Error>> {
    let images = dataset.read(root, scene).images.crop(left, top, 48, 32);
    let views = images.views.each_ref().map(Option::is_some);
    for fusion in [Min, Mean, Heuristic] {
        let reference = images.reference(fusion, -2, 20, 7).disparities();
        let params = params(48, 32, views, fusion, -2, 20, 7);
        let found = matched(Portable::<16, 1>, &params, &Region::whole(params.search()), &images, &mut Random(1));
        let expected: Vec<u16> = reference.into_iter().map(raw16).collect();
        if let Some(i) = (0..expected.len()).find(|&i| found[i] != expected[i]) {
            return Err(format!("{fusion:?}, pixel ({}, {}): {} instead of {}", i % 48, i / 48, found[i], expected[i]).into());
        }
    }
    Ok(())
}

/// Tables of grey values, made of the frames alone, mend a view that is darker and has another contrast.
fn tables_mend_a_dark_view(root: &Path, scene: &str) -> Result<(), Failed> {
    let Scene { images, truth } = Dataset::Middlebury2006Third.read(root, scene);
    let images = images.only([false, true, false, false]);
    let darker = |gray: &u8| (255.0 * 0.58 * (f64::from(*gray) / 255.0).powf(1.5)).round() as u8;
    let dark = images.views[1].iter().flatten().map(darker).collect();
    let dark = ViewSet { views: [None, Some(dark), None, None], ..images.clone() };
    let params = params(images.width, images.height, [false, true, false, false], Min, 1, 30, 11);
    let histogram = |image: &[u8]| {
        let mut histogram = Histogram::new();
        image.chunks(images.width).for_each(|line| histogram.count(line));
        histogram
    };
    // Bad1 of block matching by the core.
    let wrong = |images: &ViewSet, tables: &[(View, [u8; 256])]| -> Result<f64, Failed> {
        let frames = images.frames();
        let mut source = Evened::new(&frames, tables);
        let mut memory = vec![0; params.memory_words()];
        let mut matcher = Matcher::new(&params, &mut memory)?;
        let (mut line, mut estimate) = (vec![None; images.width], Vec::new());
        while matcher.next_line(&mut source, &mut line)?.is_some() {
            estimate.extend(line.iter().map(|d| d.map(|d| f64::from(f32::from(d)))));
        }
        Ok(real_data::errors(&estimate, &truth)[3])
    };
    let view = dark.views[1].as_deref().ok_or("a right view")?;
    let tables = [(View::RIGHT, histogram(view).table_to(&histogram(&dark.center)))];
    let [bright, ruined, mended] = [wrong(&images, &[])?, wrong(&dark, &[])?, wrong(&dark, &tables)?];
    if ruined < 2.0 * bright || mended > 1.1 * bright {
        let message =
            format!("{scene}: {bright:.2} % of the pixels are wrong, {ruined:.2} if it is dark, {mended:.2} with a table");
        return Err(message.into());
    }
    Ok(())
}

/// The focal length of Middlebury 2006 at third size, in pixels.
const FOCAL: f64 = 3740.0 / 3.0;

/// A matrix of three rows.
type Matrix = [[f64; 3]; 3];

fn product(a: Matrix, b: Matrix) -> Matrix {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// The difference of a view: it is turned about its optical axis and magnified, and then its image is shifted.
struct Difference {
    roll_deg: f64,
    scale: f64,
    /// To the right and down, in pixels.
    shift: [f64; 2],
}

/// The difference of the left and the right view.
const DIFFERENCES: [(&str, [Difference; 2]); 3] = [
    ("rectification", [difference(0.5, 1.01, [0.0; 2]), difference(-0.5, 0.99, [0.0; 2])]),
    ("rectification::across", [difference(0.0, 1.0, [0.0, -2.0]), difference(0.0, 1.0, [0.0, 2.5])]),
    ("rectification::along", [difference(0.0, 1.0, [1.5, 0.0]), difference(0.0, 1.0, [1.5, 0.0])]),
];

const fn difference(roll_deg: f64, scale: f64, shift: [f64; 2]) -> Difference {
    Difference { roll_deg, scale, shift }
}

/// The image of a camera that differs, in grey values: from the one of the camera that does not, by a windowed sinc (Lanczos) of
/// three lobes.
fn turned(pixels: &[u8], [width, height]: [usize; 2], Difference { roll_deg, scale, shift }: &Difference) -> Vec<u8> {
    let (sin, cos) = roll_deg.to_radians().sin_cos();
    let [cx, cy] = [width, height].map(|side| (side as f64 - 1.0) / 2.0);
    let camera = [[FOCAL, 0.0, cx], [0.0, FOCAL, cy], [0.0, 0.0, 1.0]];
    let inverse = [[1.0 / FOCAL, 0.0, -cx / FOCAL], [0.0, 1.0 / FOCAL, -cy / FOCAL], [0.0, 0.0, 1.0]];
    let rays = [[cos / scale, sin / scale, 0.0], [-sin / scale, cos / scale, 0.0], [0.0, 0.0, 1.0]];
    let homography = product(camera, product(rays, inverse));
    let sinc = |x: f64| if x == 0.0 { 1.0 } else { (std::f64::consts::PI * x).sin() / (std::f64::consts::PI * x) };
    let taps = |at: f64, side: usize| {
        let first = at.floor() as isize - 2;
        let weights = [0, 1, 2, 3, 4, 5].map(|k| sinc(at - (first + k) as f64) * sinc((at - (first + k) as f64) / 3.0));
        let sum: f64 = weights.iter().sum();
        let place = |k: isize| (first + k).clamp(0, side as isize - 1) as usize;
        [0, 1, 2, 3, 4, 5].map(|k| (place(k), weights[k as usize] / sum))
    };
    let value = |k: usize| {
        let pixel = [(k % width) as f64 - shift[0], (k / width) as f64 - shift[1], 1.0];
        let [x, y, z] = homography.map(|row| row.iter().zip(pixel).map(|(a, b)| a * b).sum::<f64>());
        let columns = taps(x / z, width);
        let row = |v: usize| columns.iter().map(|&(u, weight)| weight * f64::from(pixels[v * width + u])).sum::<f64>();
        taps(y / z, height).iter().map(|&(v, weight)| weight * row(v)).sum::<f64>().round().clamp(0.0, 255.0) as u8
    };
    (0..width * height).map(value).collect()
}

/// Rectified, views that are turned and magnified or shifted match nearly as well as those that are not: Bad1 and AvgErr of the
/// scenes together are at most `ALLOWED` times as large. Measured of turned ones: 3.72 % and 0.240 pixels instead of 3.55 % and
/// 0.233.
fn rectification(root: &Path, scenes: &[&str], differences: &[Difference; 2]) -> Result<(), Failed> {
    const ALLOWED: f64 = 1.10;
    let mut sums = [[0.0; 2]; 3];
    for scene in scenes {
        let data = Dataset::Middlebury2006Third.read(root, scene);
        let size = [data.images.width, data.images.height];
        let mut injected = data.images.clone();
        for (view, difference) in injected.views.iter_mut().flatten().zip(differences) {
            *view = turned(view, size, difference);
        }
        let errors = |images: &ViewSet, options: &[&str]| -> Result<[f64; 2], Failed> {
            let dir = tempfile::tempdir()?;
            images.write_rig(dir.path());
            let toml = std::fs::read_to_string(dir.path().join("rig.toml"))?;
            let [cx, cy] = size.map(|side| (side as f64 - 1.0) / 2.0);
            let toml = toml.replace("focal_px = 500.0", &format!("focal_px = {FOCAL}"));
            let toml = toml.replace("[1.0, 2.0]", &format!("[{cx:?}, {cy:?}]"));
            std::fs::write(dir.path().join("rig.toml"), toml)?;
            let [rig, out] = [dir.path().to_path_buf(), dir.path().join("out.pfm")].map(|path| path.display().to_string());
            let range = ["--method", "bm", "--min-disparity", "0", "--num-disparities", "24", "--fusion", "min"];
            let run = Invocation::new([&["match", &rig, "-o", &out], &range[..], options].concat());
            if run.code != Some(0) {
                return Err(format!("{run:#?}").into());
            }
            let (_, _, found) = read_pfm(Path::new(&out));
            let found: Vec<_> = found.into_iter().map(|d| d.is_finite().then(|| f64::from(d))).collect();
            let [_, average, _, bad_1, _] = real_data::errors(&found, &data.truth);
            Ok([bad_1, average])
        };
        let found = [errors(&data.images, &[])?, errors(&injected, &["--align"])?, errors(&injected, &[])?];
        for (sums, found) in sums.iter_mut().zip(found) {
            sums.iter_mut().zip(found).for_each(|(sum, found)| *sum += found / scenes.len() as f64);
        }
    }
    let [clean, rectified, injected] = sums;
    let message = format!("{scenes:?}: Bad1 and AvgErr are {clean:?} clean, {rectified:?} rectified, {injected:?} as they are");
    let is_close = rectified.iter().zip(clean).all(|(rectified, clean)| *rectified <= ALLOWED * clean);
    let matters = injected.iter().zip(clean).all(|(injected, clean)| *injected > 3.0 * clean);
    if is_close && matters { Ok(()) } else { Err(message.into()) }
}

/// The centre of views that are rectified stays where it is, with one neighbour or two.
fn rectified_views_stay(root: &Path, scenes: &[&str]) -> Result<(), Failed> {
    for scene in scenes {
        let images = Dataset::Middlebury2006Third.read(root, scene).images;
        for keep in [[true, true, false, false], [false, true, false, false]] {
            let frames = images.only(keep).frames();
            let [width, height] = frames.size().map(|side| side as u16);
            let search = SearchConfig { views: frames.views(), num_disparities: 24, ..SearchConfig::of_size(width, height) };
            let alignment = Alignment::estimate(&frames, &search.checked()?, None)?;
            let moved = alignment.border_px(Frame::Center);
            if moved > 0.1 {
                return Err(format!("{scene}: the centre moves by {moved} px: {}", alignment.summary()).into());
            }
        }
    }
    Ok(())
}

/// Scenes in whose images, at a quarter of their size, `align` recovers shifts and gains, and their number of
/// disparities.
const ALIGNED: [(Dataset, &str, usize); 3] =
    [(Dataset::Middlebury2005Full, "Art", 60), (Dataset::Middlebury2005Full, "Dolls", 60), (Dataset::Hci4d, "cotton", 16)];

fn main() {
    let arguments = Arguments::from_args();
    let root = real_data::root();
    let mut trials: Vec<Trial> = Vec::new();
    let mut add = |name: String, is_left_out: bool, run: Test| {
        let (is_absent, root) = (root.is_none(), root.clone());
        let run = move || run(&root.ok_or("the data is in neither $MULTISCOPIC_DATA nor ../shared/data")?);
        trials.push(Trial::test(name, run).with_ignored_flag(is_absent || is_left_out));
    };
    // What runs the program on whole images takes minutes without optimisation.
    add("methods_in_order".into(), cfg!(debug_assertions), Box::new(methods));
    for scene in ["Art", "Dolls"] {
        let run = move |root: &Path| longer_baselines(root, scene);
        add(format!("longer_baselines::{scene}"), cfg!(debug_assertions), Box::new(run));
    }
    for dataset in [Dataset::Tsukuba, Dataset::Hci4d] {
        let run = move |root: &Path| eight_views(root, dataset);
        add(format!("eight_views::{}", dataset.name()), cfg!(debug_assertions), Box::new(run));
    }
    for (name, differences) in &DIFFERENCES {
        let run = |root: &Path| rectification(root, &["Aloe", "Rocks1"], differences);
        add((*name).into(), cfg!(debug_assertions), Box::new(run));
    }
    let run = |root: &Path| rectified_views_stay(root, &["Aloe", "Lampshade1", "Monopoly", "Rocks1"]);
    add("rectified_views_stay".into(), cfg!(debug_assertions), Box::new(run));
    for known in KNOWN {
        let name = format!("known_errors::{}", known.scene);
        add(name, cfg!(debug_assertions), Box::new(move |root| known_errors(root, &known)));
    }
    for scene in ["Aloe", "Rocks1"] {
        let run = move |root: &Path| tables_mend_a_dark_view(root, scene);
        add(format!("tables_mend_a_dark_view::{scene}"), cfg!(debug_assertions), Box::new(run));
    }
    add("two_views_have_a_quarter_less_error".into(), cfg!(debug_assertions), Box::new(reduction));
    for (dataset, scene, left, top) in PARTS {
        let run = move |root: &Path| part(root, dataset, scene, left, top).map_err(|error| error.to_string().into());
        add(format!("bit_exact::{}", dataset.name()), false, Box::new(run));
    }
    for (dataset, scene, num_disparities) in ALIGNED {
        let run = move |root: &Path| {
            misaligned::assert_recovers(&dataset.read(root, scene).images, num_disparities, &misaligned::RANGE);
            Ok(())
        };
        add(format!("alignment::{scene}"), cfg!(debug_assertions), Box::new(run));
    }
    libtest_mimic::run(&arguments, trials).exit();
}
