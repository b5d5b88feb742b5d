//! The search of `match`: in the range that `--auto-range` finds, of which it warns where it does not fit, and in rigs with
//! several baselines from short to long, around a prior, as the references do.

use multiscopic::{
    Frames, Picture,
    scene::{PinholeCamera, Scene, render},
};
use multiscopic_core::{Frame, View};
use multiscopic_reference::{AroundPrior, Fusion, fixed, gradients, medians, split_mix::Random};
use multiscopic_tests::{
    program::Invocation,
    test_images::{
        ViewSet,
        faults::{FAULTS, Fault, right_frames},
        read_raw16,
    },
};
use std::{path::Path, sync::LazyLock};

/// The demo's scene, with noise, and its true disparities.
static SCENE: LazyLock<(ViewSet, Vec<f32>)> = LazyLock::new(|| {
    let shot = render(&Scene::demo(), &PinholeCamera::new(320, 240), 3);
    let gray = |frame| Picture::Rgb(shot.frame(frame).clone()).to_gray().into_raw();
    let views = View::CROSS.map(|view| Some(gray(Frame::View(view))));
    let images = ViewSet { width: 320, height: 240, center: gray(Frame::Center), views, others: Vec::new() };
    (images, shot.truth.pixels().to_vec())
});

/// Runs `match` on the images and returns what it says.
fn said(images: &ViewSet, folder: &Path, arguments: &[&str]) -> String {
    images.write_rig(folder);
    let out = folder.join("out.pfm");
    let run = Invocation::new(
        [&["match", folder.to_str().unwrap(), "--method", "bm", "-o", out.to_str().unwrap()], arguments].concat(),
    );
    run.assert_done();
    run.stderr
}

/// The images of the scene with the left and right exchanged.
fn swapped() -> ViewSet {
    let mut images = SCENE.0.clone();
    images.views.swap(0, 1);
    assert_eq!(View::CROSS[..2], [View::LEFT, View::RIGHT]);
    images
}

#[test]
fn the_range_covers_the_scene_and_little_more() {
    let folder = tempfile::tempdir().unwrap();
    let (images, truth) = &*SCENE;
    let said = said(images, folder.path(), &["--auto-range"]);
    let range = said.split(", ").find_map(|word| word.split_once(':')?.0.split_once("..=")).expect("the summary has the range");
    let [first, last] = [range.0, range.1].map(|end| end.parse::<f32>().unwrap());
    // One pixel in two hundred may be nearer or farther.
    let mut truth = truth.clone();
    truth.sort_unstable_by(f32::total_cmp);
    let [nearly_all, beyond] = [truth.len() / 200, truth.len() - 1 - truth.len() / 200];
    let (low, high) = (truth[nearly_all], truth[beyond]);
    assert!(first <= low && high <= last, "{first} to {last} of {low} to {high}");
    assert!(last - first <= 2.0 * (high - low) + 4.0, "{first} to {last} of {low} to {high}");
    assert!(!said.contains("warning"), "{said}");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn swapped_views_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let said = said(&swapped(), folder.path(), &[]);
    assert!(said.contains("warning: the left and right views look swapped"), "{said}");
    Invocation::new(["align", folder.path().to_str().unwrap()]).assert_refused(&["left and right views look swapped"]);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn ranges_that_are_cut_and_missing_texture_are_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let (images, _) = &*SCENE;
    let cut = said(images, folder.path(), &["--min-disparity", "1", "--num-disparities", "8"]);
    assert!(
        cut.contains("warning: ") && cut.contains("% of the disparities are 8") && cut.contains("--num-disparities above 8"),
        "{cut}"
    );
    let cut = said(images, folder.path(), &["--min-disparity", "14", "--num-disparities", "16"]);
    assert!(cut.contains("% of the disparities are 14") && cut.contains("--min-disparity below 14"), "{cut}");

    // No disparity stands out among two.
    let cut = said(images, folder.path(), &["--min-disparity", "1", "--num-disparities", "2"]);
    let found = cut.lines().find(|line| line.contains("% of the corners lie beyond the range 1..=2")).unwrap_or_default();
    assert!(found.contains("warning: ") && found.contains("--num-disparities") && found.contains("--auto-range"), "{cut}");

    // The upper half of the pictures is a grey wall.
    let mut plain = images.clone();
    let half = plain.center.len() / 2;
    plain.center[..half].fill(100);
    plain.views.iter_mut().flatten().for_each(|view| view[..half].fill(100));
    let said = said(&plain, folder.path(), &[]);
    assert!(said.contains("% of the centre has no texture"), "{said}");
}

/// The message for each fault is that in the guide, and images without a fault have none.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn faults_are_told_as_the_guide_says() {
    let guide = include_str!("../../../docs/faults.md");
    let folder = tempfile::tempdir().unwrap();
    let said = |frames: &Frames| {
        let file = |frame: Frame| folder.path().join(format!("{frame}.png")).to_str().unwrap().to_owned();
        let mut words = vec!["match".to_owned(), "--method".into(), "bm".into(), "-o".into(), "/dev/null".into()];
        for frame in [Frame::Center].into_iter().chain(frames.views().iter().map(Frame::View)) {
            frames.get(frame).unwrap().save(file(frame)).unwrap();
            words.extend([format!("--{frame}"), file(frame)]);
        }
        let run = Invocation::new(words);
        run.assert_done();
        run.stderr
    };
    let right = right_frames();
    let of_right = said(&right);
    assert!(!of_right.contains("warning"), "{of_right}");
    for Fault { name, spoil } in FAULTS {
        let row = guide.lines().find(|line| line.contains(&format!("faults/{name}.png"))).expect("the guide has each fault");
        let message = row.split('`').nth(1).expect("the message is in the row");
        let said = said(&spoil(&right));
        assert!(said.contains("warning: ") && said.contains(message), "{name}: {said}");
    }
}

#[test]
fn a_range_that_the_images_do_not_show_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let gray = || vec![90; 64 * 48];
    ViewSet { width: 64, height: 48, center: gray(), views: [Some(gray()), None, None, None], others: Vec::new() }
        .write_rig(folder.path());
    let rig = folder.path().to_str().unwrap();
    let out = folder.path().join("out.pfm");
    let out = out.to_str().unwrap();
    Invocation::new(["match", rig, "--auto-range", "-o", out]).assert_refused(&["too few corners", "--num-disparities"]);
    Invocation::new(["match", rig, "--auto-range", "--num-disparities", "9", "-o", out]).assert_refused(&["--auto-range"]);
}

/// The size of the images with several baselines.
const WIDTH: usize = 72;
const HEIGHT: usize = 13;
/// The search of the short views.
const RANGE: (i32, i32) = (1, 8);
/// The views, by their baselines to the right and down.
const SHORT: [(i32, i32); 2] = [(-1, 0), (1, 0)];
const LONG: [(i32, &[(i32, i32)]); 2] = [(3, &[(3, 0), (0, -3)]), (5, &[(5, 0)])];

/// A random texture with a slope of 2.5 to 5.5 pixels of disparity, seen from everywhere.
fn images() -> ViewSet {
    let mut random = Random(3);
    let texture: Vec<f64> = (0..4096).map(|_| random.below(256) as f64).collect();
    let noise = |x: f64, row: i64| {
        let at = |column: i64| texture[((column * 7 + row * 131).rem_euclid(4096)) as usize];
        let (column, rest) = (x.floor(), x - x.floor());
        (1.0 - rest) * at(column as i64) + rest * at(column as i64 + 1)
    };
    let image = |(i, j): (i32, i32)| -> Vec<u8> {
        let pixel = |k: usize| {
            let (u, v) = ((k % WIDTH) as f64, (k / WIDTH) as f64);
            // The disparity of the point of the centre that is seen here, which is (u + i d, v + j d).
            let mut d = 4.0;
            for _ in 0..30 {
                d = 2.5 + 3.0 * (u + f64::from(i) * d) / WIDTH as f64;
            }
            let y = v + f64::from(j) * d;
            let (row, rest) = (y.floor(), y - y.floor());
            let x = u + f64::from(i) * d;
            ((1.0 - rest) * noise(x, row as i64) + rest * noise(x, row as i64 + 1)).round() as u8
        };
        (0..WIDTH * HEIGHT).map(pixel).collect()
    };
    let views = [Some(image(SHORT[0])), Some(image(SHORT[1])), None, None];
    let others = LONG.iter().flat_map(|(_, offsets)| offsets.iter()).map(|&offset| (offset, image(offset))).collect();
    ViewSet { width: WIDTH, height: HEIGHT, center: image((0, 0)), views, others }
}

/// `map`, refined by the views at longer baselines, by the references.
fn refined(images: &ViewSet, map: &[Option<i32>]) -> Vec<Option<i32>> {
    let prior = medians(map, WIDTH, 21);
    let center = gradients(&images.center, WIDTH);
    let mut refined = prior.clone();
    for (multiple, offsets) in LONG {
        let of = |offset: &(i32, i32)| {
            let (_, image) = images.others.iter().find(|(other, _)| other == offset).expect("a view");
            ((offset.0 / multiple, offset.1 / multiple), gradients(image, WIDTH))
        };
        let views: Vec<_> = offsets.iter().map(of).collect();
        let found = AroundPrior {
            width: WIDTH as i32,
            height: HEIGHT as i32,
            center: &center,
            views: &views,
            multiple,
            prior: &prior,
            priors: (RANGE.0, RANGE.0 + RANGE.1 - 1),
            fusion: Fusion::Min,
            min_disparity: -4,
            num_disparities: 8,
            block_size: 11,
        };
        for ((refined, found), prior) in refined.iter_mut().zip(found.disparities()).zip(&prior) {
            if found != *prior {
                *refined = found;
            }
        }
    }
    refined
}

/// Runs `match` with the centre and the views at `offsets` in `folder`, and returns the disparities in 64ths of a pixel.
#[track_caller]
fn matched(folder: &Path, offsets: &[(i32, i32)], arguments: &[&str]) -> Vec<Option<i32>> {
    let path = |name: &str| folder.join(format!("{name}.pgm")).display().to_string();
    let mut all = vec!["match".to_owned(), "--center".into(), path("center")];
    if !arguments.contains(&"--prior") {
        all.extend(["--method", "bm"].map(String::from));
    }
    for &(right, down) in offsets {
        let name = match (right, down) {
            (-1, 0) => "left",
            (1, 0) => "right",
            _ => &format!("{right},{down}"),
        };
        all.extend(["--view".to_owned(), format!("{right},{down}={}", path(name))]);
    }
    let (raw, map) = (folder.join("raw.png"), folder.join("out.pfm"));
    all.extend(["-o", &map.display().to_string(), "--raw16", &raw.display().to_string()].map(String::from));
    all.extend(arguments.iter().copied().map(String::from));
    Invocation::new(all).assert_done();
    read_raw16(&raw).2.into_iter().map(|raw| (raw != 0).then(|| i32::from(raw) - 32768)).collect()
}

#[test]
fn views_at_longer_baselines_refine_what_short_ones_find() {
    let images = images();
    let folder = tempfile::tempdir().expect("a folder for the test");
    images.write_rig(folder.path());
    let all: Vec<(i32, i32)> = LONG.iter().flat_map(|(_, offsets)| offsets.iter().copied()).chain(SHORT).collect();

    let range = ["--min-disparity", &RANGE.0.to_string(), "--num-disparities", &RANGE.1.to_string()];
    let short = ViewSet { others: Vec::new(), ..images.clone() }.reference(Fusion::Min, RANGE.0, RANGE.1, 11).disparities();
    let short: Vec<Option<i32>> = short.into_iter().map(|d| d.map(|d| i32::from(fixed(d)))).collect();
    assert_eq!(matched(folder.path(), &SHORT, &range), short, "the short views alone");
    let expected = refined(&images, &short);
    assert_eq!(matched(folder.path(), &all, &range), expected, "all views");

    // Towards the truth: the error falls by half where it can, away from the border.
    let error = |map: &[Option<i32>]| {
        let inner = (0..WIDTH * HEIGHT).filter(|k| (36..66).contains(&(k % WIDTH)));
        let errors =
            inner.map(|k| (f64::from(map[k].expect("a disparity")) / 64.0 - 2.5 - 3.0 * (k % WIDTH) as f64 / WIDTH as f64).abs());
        errors.sum::<f64>() / (30 * HEIGHT) as f64
    };
    assert!(error(&expected) < 0.5 * error(&short), "{} with long baselines, {} without", error(&expected), error(&short));
}

#[test]
fn a_prior_from_a_file_takes_the_place_of_short_views() {
    let images = images();
    let folder = tempfile::tempdir().expect("a folder for the test");
    images.write_rig(folder.path());
    let range = ["--min-disparity", &RANGE.0.to_string(), "--num-disparities", &RANGE.1.to_string()];
    let short = matched(folder.path(), &SHORT, &range);
    let prior = folder.path().join("prior.png");
    std::fs::rename(folder.path().join("raw.png"), &prior).expect("a prior");
    let long: Vec<(i32, i32)> = LONG.iter().flat_map(|(_, offsets)| offsets.iter().copied()).collect();
    let found = matched(folder.path(), &long, &["--prior", &prior.display().to_string()]);
    // The search may reach as far as the prior's own disparities do, which no pixel's median leaves.
    assert_eq!(found, refined(&images, &short));
}

#[test]
fn a_prior_that_does_not_fit_is_refused() {
    let images = images();
    let folder = tempfile::tempdir().expect("a folder for the test");
    images.write_rig(folder.path());
    let prior = folder.path().join("prior.png").display().to_string();
    let refused = |words: &[&str]| {
        let rig = folder.path().display().to_string();
        let map = folder.path().join("out.pfm").display().to_string();
        let run = Invocation::new(["match", &rig, "-o", &map, "--prior", &prior]);
        assert_eq!(run.code, Some(2), "{run:?}");
        assert!(words.iter().all(|word| run.stderr.contains(word)), "{words:?} in {}", run.stderr);
        assert!(!folder.path().join("out.pfm").exists(), "a map in spite of {words:?}");
    };
    let write = |width: u32, height: u32, raw: u16| {
        let image = image::ImageBuffer::from_pixel(width, height, image::Luma([raw]));
        image.save(&prior).expect("the folder is there");
    };
    refused(&[&prior, "cannot read"]);
    write(10, 4, 32768);
    refused(&[&prior, "10x4", "72x13"]);
    write(WIDTH as u32, HEIGHT as u32, 0);
    refused(&[&prior, "no pixel with a disparity"]);
    std::fs::copy(folder.path().join("left.pgm"), &prior).expect("a file");
    refused(&[&prior, "16-bit grey image"]);
}
