//! `multiscopic align` on captures that are misaligned by known amounts.

use image::{GrayImage, Luma};
use multiscopic::{
    Alignment, Frames, Picture, Rig,
    scene::{PinholeCamera, RandomScene, Scene, render},
};
use multiscopic_core::{Frame, Fusion, SearchConfig, View, Views};
use multiscopic_tests::{
    program::Invocation,
    test_images::{
        ViewSet,
        misaligned::{self, FACTOR, Off, align, assert_recovers, quarter, write_rig},
        read_pfm,
    },
};
use std::{fs, sync::LazyLock};

/// The demo's scene at four times the size at which it is aligned.
fn scene(baseline_mm: f64) -> ViewSet {
    let (width, height) = (160 * FACTOR + 32, 120 * FACTOR + 32);
    let camera = PinholeCamera { baseline_mm, ..PinholeCamera::new(width as u32, height as u32).ideal() };
    let shot = render(&Scene::demo(), &camera, 1);
    let gray = |frame| Picture::Rgb(shot.frame(frame).clone()).to_gray().into_raw();
    ViewSet {
        width,
        height,
        center: gray(Frame::Center),
        views: View::CROSS.map(|view| Some(gray(Frame::View(view)))),
        others: Vec::new(),
    }
}

/// All views have the same baseline.
static SCENE: LazyLock<ViewSet> = LazyLock::new(|| scene(20.0));

const SEARCH: [&str; 2] = ["--num-disparities", "18"];

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn shifts_brightness_and_baselines_are_found() {
    assert_recovers(&SCENE, 18, &misaligned::RANGE);
    let mut images = SCENE.clone();
    images.views[0] = scene(20.4).views[0].take();
    images.views[2] = scene(19.6).views[2].take();
    let folder = tempfile::tempdir().unwrap();
    write_rig(&quarter(&images, [Off::NONE; 4]), folder.path());
    for (found, expected) in align(folder.path(), &SEARCH).into_iter().zip([1.02, 1.0, 0.98, 1.0]) {
        let found = found.expect("all views are there");
        assert!((found.scale - expected).abs() < 0.005, "{found:?} instead of {expected}");
        assert!(found.across_px.abs() < 0.05 && (found.gain - 1.0).abs() < 0.005, "{found:?}");
    }
}

/// The homographies of the centre and of each view, and the alignment, in a range of 32 disparities.
fn homographies(frames: &Frames) -> (Vec<[[f64; 3]; 3]>, Alignment) {
    let [width, height] = frames.size().map(|side| side as u16);
    let search =
        SearchConfig { views: frames.views(), fusion: Fusion::Min, num_disparities: 32, ..SearchConfig::of_size(width, height) };
    let alignment = Alignment::estimate(frames, &search.checked().unwrap(), None).unwrap();
    let of_frames = std::iter::once(Frame::Center).chain(frames.views().iter().map(Frame::View));
    (of_frames.map(|frame| alignment.homography(frame)).collect(), alignment)
}

/// The frames with each view moved to the right and down by whole pixels.
fn moved(frames: &Frames, by: impl Fn(View) -> [i64; 2]) -> Frames {
    let center = Frames::new(frames.get(Frame::Center).unwrap().clone());
    frames.views().iter().fold(center, |moved, view| {
        let (image, [right, down]) = (frames.get(Frame::View(view)).unwrap(), by(view));
        let at = |at: u32, by: i64, side: u32| (i64::from(at) - by).clamp(0, i64::from(side) - 1) as u32;
        let [width, height] = [image.width(), image.height()];
        let pixel = |u, v| *image.get_pixel(at(u, right, width), at(v, down, height));
        moved.with(view, GrayImage::from_fn(width, height, pixel))
    })
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn only_what_the_images_prove_is_taken_out() {
    for views in [Views::STEREO, Views::HORIZONTAL] {
        let frames = RandomScene::new(3, 0, [320, 240]).ideal().render(views).color_frames();
        for shifts in [[[0, 0]; 2], [[0, -2], [0, 3]], [[2, 0]; 2]] {
            let by = |view| shifts[usize::from(view == View::RIGHT)];
            let (found, alignment) = homographies(&moved(&frames, by));
            // A single neighbour does not show shifts along its baseline.
            let shown = |[right, down]: [i64; 2]| if views == Views::STEREO { [0, down] } else { [right, down] };
            let expected = std::iter::once([0, 0]).chain(views.iter().map(|view| shown(by(view))));
            for (found, [right, down]) in found.into_iter().zip(expected) {
                // From rectified corners of the image to those of the file.
                for [u, v] in [[0.0, 0.0], [319.0, 0.0], [0.0, 239.0], [319.0, 239.0]] {
                    let [x, y, w] = found.map(|row| row[0] * u + row[1] * v + row[2]);
                    let off = (x / w - u - right as f64).hypot(y / w - v - down as f64);
                    assert!(off < 0.1, "{views:?} moved by {shifts:?}: off by {off} px: {found:?}");
                }
            }
            assert_eq!(alignment.border_px(Frame::Center), 0.0);
            assert!(alignment.not_shown().is_some_and(|text| text.contains("all disparities alike")));
            let is_right = expected_summary(&alignment.summary(), shown(shifts[1]));
            assert!(is_right, "{shifts:?}: {}", alignment.summary());
        }
    }
}

/// Returns true if a summary tells a shift of the right view, or that there is none.
fn expected_summary(summary: &str, [right, down]: [i64; 2]) -> bool {
    match [right, down] {
        [0, 0] => summary == "the images show no misalignment",
        _ => summary.ends_with("px, and takes out: shift") && summary.contains("right"),
    }
}

/// A pattern of waves, in grey values.
fn waves(x: f64, y: f64) -> f64 {
    let wave = |(k, (a, b)): (usize, (f64, f64))| (a * x + b * y + k as f64).sin();
    let directions = [(0.31, 0.17), (-0.23, 0.41), (0.52, -0.29), (0.13, 0.61), (0.71, 0.37), (-0.43, 0.55)];
    120.0 + 18.0 * directions.into_iter().enumerate().map(wave).sum::<f64>()
}

/// The numbers in the attributes `x1 y1 x2 y2` of the lines in a group of an SVG.
fn strokes(group: &str) -> Vec<[f64; 4]> {
    let number = |line: &str, name: &str| -> f64 {
        let (_, rest) = line.split_once(&format!(" {name}=\"")).expect("the attribute");
        rest.split_once('"').expect("its end").0.parse().expect("a number")
    };
    group.split("<line").skip(1).map(|line| ["x1", "y1", "x2", "y2"].map(|name| number(line, name))).collect()
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn a_page_shows_the_epipolar_errors_of_a_known_roll() {
    // A plane at one disparity, and cameras that are turned about the middle of the image.
    const DISPARITY: f64 = 4.25;
    let (width, height, cx, cy) = (144, 108, 71.5, 53.5);
    let turned = |degrees: f64, [x, y]: [f64; 2]| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [cx + cos * (x - cx) - sin * (y - cy), cy + sin * (x - cx) + cos * (y - cy)]
    };
    let image = |right: f64, degrees: f64| {
        let pixel = |k: usize| {
            let [x, y] = turned(-degrees, [(k % width) as f64, (k / width) as f64]);
            waves(x + right * DISPARITY, y).round() as u8
        };
        (0..width * height).map(pixel).collect()
    };
    let rolls = [("left", -1.0, 1.5), ("right", 1.0, -1.0)];
    let [left, right] = rolls.map(|(_, right, degrees)| Some(image(right, degrees)));
    let images = ViewSet { width, height, center: image(0.0, 0.0), views: [left, right, None, None], others: Vec::new() };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("rig")).unwrap();
    write_rig(&images, &path("rig"));
    let [rig, page, aligned] = ["rig", "page.html", "aligned"].map(|name| path(name).to_str().unwrap().to_owned());
    let run = Invocation::new(["align", &rig, "--num-disparities", "8", "--report", &page, "-o", &aligned]);
    assert!(run.code == Some(0) && run.stdout.contains("epipolar (Sampson) px before, after"), "{run:#?}");

    let (html, scale) = (fs::read_to_string(&page).unwrap(), 760.0 / width as f64);
    let record = Rig::load(&path("aligned")).unwrap().alignment.expect("what was found");
    assert!(record.common_rotation_deviation_deg[0].is_nan(), "turns about the only baseline do not show");
    for (name, right, degrees) in rolls {
        let (_, svg) = html.split_once(&format!("<title>{name} view: epipolar (Sampson) errors")).expect("a picture");
        let (svg, _) = svg.split_once("</svg>").unwrap();
        let times: f64 = svg.split_once(" times as long").unwrap().0.rsplit_once(' ').unwrap().1.parse().unwrap();
        let groups: Vec<Vec<[f64; 4]>> = svg.split("<g class=\"series").skip(1).map(strokes).collect();
        let [before, after] = &groups[..] else { panic!("{} groups", groups.len()) };
        assert!(before.len() > 100 && before.len() == after.len());
        let errors = |[x1, y1, x2, y2]: [f64; 4]| {
            assert_eq!(x1, x2, "strokes lead across the baseline");
            let [u, v] = [x1 / scale - 0.5, y1 / scale - 0.5];
            // The first-order distance of both points to the constraint v' - v = 0.
            let expected = (turned(degrees, [u - right * DISPARITY, v])[1] - v) / 2.0_f64.sqrt();
            ((y2 - y1) / scale / times, expected)
        };
        let (mut lengths, mut wrong) = (Vec::new(), 0);
        for (before, after) in before.iter().zip(after) {
            let ((shown, expected), (left, _)) = (errors(*before), errors(*after));
            wrong += usize::from((shown - expected).abs() > 0.05 || left.abs() > 0.05);
            lengths.push(expected.abs());
        }
        // Those at the border of the image.
        assert!(wrong <= lengths.len() / 50, "{wrong} of {} strokes of the {name} view are wrong", lengths.len());
        lengths.sort_by(f64::total_cmp);
        let [median, found] = [lengths[lengths.len() / 2], record.views[name].sampson_px];
        assert!(
            (median - found).abs() < 0.02 && record.views[name].rectified_sampson_px < 0.02,
            "{median}: {:?}",
            record.views[name]
        );
        assert!(svg.contains(&format!("before rectification: median {found:.2} px")), "{svg:.2000}");
        let [.., ahead] = record.views[name].rotation_deg;
        assert!((ahead.abs() - degrees.abs()).abs() < 0.02, "{ahead} degrees");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn views_of_arrays_are_aligned() {
    // A plane at one disparity, painted with waves, each view turned so that it is shifted across its baseline, and brightened.
    const DISPARITY: f64 = 4.25;
    let image =
        |value: &dyn Fn(f64, f64) -> f64| GrayImage::from_fn(144, 108, |u, v| Luma([value(u.into(), v.into()).round() as u8]));
    // The view, the direction in which its image is shifted, by how much at the middle, and the gain.
    let (diagonal, knight) = (0.5_f64.sqrt(), 0.2_f64.sqrt());
    let cases = [
        ((1, 1), (-diagonal, diagonal), 1.3, 1.04),
        ((-1, 1), (diagonal, diagonal), -0.7, 0.97),
        ((-1, -1), (-diagonal, diagonal), -2.2, 1.0),
        ((2, -1), (knight, 2.0 * knight), 0.4, 0.95),
        ((3, 0), (0.0, 1.0), 1.6, 1.02),
        ((0, -2), (1.0, 0.0), -1.1, 1.0),
    ];
    // The focal length that is taken where none is known.
    let (focal, cx, cy) = (1.2 * 144.0, 71.5, 53.5);
    let mut frames = Frames::new(image(&waves));
    for ((i, j), (nx, ny), shift, gain) in cases {
        let (i, j): (i8, i8) = (i, j);
        let (sin, cos) = f64::atan2(shift, focal).sin_cos();
        // The place in the view where its pixel would be seen if the camera had not been turned.
        let unturned = |u: f64, v: f64| {
            let along = nx * (u - cx) + ny * (v - cy);
            let (turned, ahead) = (along * cos - focal * sin, along * sin / focal + cos);
            let [u, v] = [u - cx + (turned - along) * nx, v - cy + (turned - along) * ny];
            (u / ahead + cx, v / ahead + cy)
        };
        let view = |u: f64, v: f64| {
            let (u, v) = unturned(u, v);
            gain * waves(u + f64::from(i) * DISPARITY, v + f64::from(j) * DISPARITY)
        };
        frames = frames.with(View::new(i, j).unwrap(), image(&view));
    }
    let search =
        SearchConfig { views: frames.views(), fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(144, 108) }
            .checked()
            .unwrap();
    let alignment = Alignment::estimate(&frames, &search, None).unwrap();
    let aligned = Alignment::estimate(&alignment.compensate(&frames), &search, None).unwrap();
    for ((i, j), _, shift, gain) in cases {
        let view = View::new(i, j).unwrap();
        let (found, left) = (alignment.of(view).unwrap(), aligned.of(view).unwrap());
        // Perspective makes the shift larger towards the borders.
        assert!(
            (found.across_px - shift).abs() < 0.03 + 0.02 * shift.abs() && (found.gain - gain).abs() < 0.003,
            "{view}: {found:?}"
        );
        assert!((found.baseline_scale - 1.0).abs() < 0.005, "{view}: {found:?}");
        assert!(left.across_px.abs() < 0.03 && (left.gain - 1.0).abs() < 0.003, "{view}: {left:?}");
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn misalignment_is_corrected() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("off")).unwrap();
    fs::create_dir(path("right")).unwrap();
    write_rig(&quarter(&SCENE, misaligned::RANGE[0]), &path("off"));
    write_rig(&quarter(&SCENE, [Off::NONE; 4]), &path("right"));
    let new = path("new");
    align(&path("off"), &[&SEARCH[..], &["-o", new.to_str().unwrap()]].concat());
    for found in align(&new, &SEARCH).into_iter().flatten() {
        assert!(found.across_px.abs() < 0.05 && (found.gain - 1.0).abs() < 0.005, "{found:?}");
    }
    // Aligned, the disparities are those of a perfect capture. Otherwise they are far from it.
    let disparities = |rig: &str, arguments: &[&str]| {
        let (rig, out) = (path(rig), path("out.pfm"));
        let run = Invocation::new(
            [
                &["match", rig.to_str().unwrap(), "--method", "bm", "-o", out.to_str().unwrap(), "--num-disparities", "24"],
                arguments,
            ]
            .concat(),
        );
        run.assert_done();
        read_pfm(&out).2
    };
    let expected = disparities("right", &[]);
    let far = |found: Vec<f32>| {
        let far = found.iter().zip(&expected).filter(|(a, b)| (**a - **b).abs() > 1.0).count();
        far as f64 / expected.len() as f64
    };
    let [as_it_is, put_right, on_the_way] =
        [disparities("off", &[]), disparities("new", &[]), disparities("off", &["--align"])].map(far);
    // At this size, resampling alone changes matches where there is little texture.
    assert!(as_it_is > 0.4 && put_right < 0.1, "{as_it_is}, {put_right}");
    assert_eq!(put_right, on_the_way);
}

#[test]
fn what_cannot_be_aligned_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let gray = || vec![90; 64 * 48];
    let plain = ViewSet { width: 64, height: 48, center: gray(), views: [Some(gray()), None, None, None], others: Vec::new() };
    plain.write_rig(folder.path());
    let rig = folder.path().to_str().unwrap();
    Invocation::new(["align", rig]).assert_refused(&["left", "0 textured blocks", "range of disparities"]);
    Invocation::new(["align"]).assert_refused(&["RIG_DIR", "--center"]);
    let files = ["center.pgm", "left.pgm"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    Invocation::new(["align", "--center", &files[0], "--left", &files[1], "-o", "new"]).assert_refused(&["-o", "rig.toml"]);
    // An existing folder is not touched.
    let (width, height) = (144, 108);
    let image = |right: f64| -> Vec<u8> {
        (0..width * height).map(|k| waves((k % width) as f64 + 4.25 * right, (k / width) as f64).round() as u8).collect()
    };
    let views = [Some(image(-1.0)), Some(image(1.0)), None, None];
    write_rig(&ViewSet { width, height, center: image(0.0), views, others: Vec::new() }, folder.path());
    Invocation::new(["align", rig, "--num-disparities", "8", "-o", rig]).assert_refused(&[rig, "is there already"]);
}
