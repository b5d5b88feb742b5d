//! `simulate` equals `match` and the references.

use std::{fs, path::Path};

use multiscopic::scene::{PinholeCamera, Scene, render_views};
use multiscopic_core::{Frame, Fusion, SemiGlobalCost, View};
use multiscopic_edge::{Matching, Profile, WholeLines, profile};
use multiscopic_reference::{self as reference, AroundPrior, gradients};
use multiscopic_tests::{
    program::Invocation,
    test_images::{ViewSet, golden, read_grey, read_pfm, read_raw16},
};

use super::{budget, confidences, folder, json};

/// `simulate` equals `match` on the centre of the demo's frames, which are larger than the profile's.
fn assert_simulated_as_matched(profile: &Profile) {
    let dir = folder();
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let matching = profile.matching(Fusion::Min);
    let search = matching.search();
    let size = [("--width", search.width() + 7), ("--height", search.height() + 4)];
    let size = size.map(|(option, side)| [option.to_owned(), side.to_string()]).concat();
    let demo = ["demo".to_owned(), "-o".into(), path("demo"), "--num-disparities".into(), "1".into()];
    assert_eq!(Invocation::new(demo.into_iter().chain(size)).code, Some(0));
    let mut views = Vec::new();
    for view in ["center", "left", "right", "top", "bottom"] {
        let (w, h, pixels) = read_grey(Path::new(&path(&format!("demo/{view}.png"))));
        let lines = pixels.chunks_exact(w).skip((h - search.height()) / 2).take(search.height());
        let left = (w - search.width()) / 2;
        let mut pgm = format!("P5 {} {} 255\n", search.width(), search.height()).into_bytes();
        pgm.extend(lines.flat_map(|line| &line[left..left + search.width()]));
        fs::write(path(&format!("{view}.pgm")), pgm).expect("a view for the test");
        if view == "center" || search.views().iter().any(|of| format!("{of:?}").to_lowercase() == view) {
            views.extend([format!("--{view}"), path(&format!("{view}.pgm"))]);
        }
    }
    let method = match matching {
        Matching::Blocks { params, .. }
        | Matching::AroundPrior { short: params, .. }
        | Matching::WithConfidences(WholeLines::Blocks(params)) => {
            format!("--method bm --block-size {}", params.block_size())
        }
        Matching::SemiGlobal(params) | Matching::WithConfidences(WholeLines::SemiGlobal(params)) => match params.cost() {
            SemiGlobalCost::Sad { block_size } => format!("--method sgm --cost sad --block-size {block_size}"),
            SemiGlobalCost::Census(census) => format!("--method sgm --census {}", census.name()),
        },
        Matching::Network(_) => "--method net --search-margin 0 --sub-pixel none --repair none --hidden none".into(),
    };
    for fusion in Fusion::OF_ANY_COSTS.map(Fusion::name) {
        let common = ["--fusion", fusion, "-o"].map(str::to_owned);
        let mut matched = vec!["match".to_owned()];
        matched.extend(views.iter().cloned().chain(common.clone()).chain([path("matched.pfm")]));
        matched.extend(["--num-disparities".into(), search.num_disparities().to_string()]);
        matched.extend(method.split(' ').map(str::to_owned));
        let confidence = |name: &str| {
            let option = matching.has_confidences().then(|| ["--confidence".to_owned(), path(name)]);
            option.into_iter().flatten()
        };
        matched.extend(confidence("matched.png"));
        Invocation::new(&matched).assert_done();
        let mut simulated = ["simulate", "--json", "--profile", profile.name].map(str::to_owned).to_vec();
        simulated.extend(common.into_iter().chain([path("simulated.pfm"), "--packets".into(), path("packets")]));
        simulated.extend(confidence("simulated.png"));
        simulated.push(path("demo"));
        let report = json(&Invocation::new(&simulated), 0);
        let expected = read_pfm(Path::new(&path("matched.pfm")));
        assert_eq!(read_pfm(Path::new(&path("simulated.pfm"))), expected, "{} with {fusion}", profile.name);
        let listen = ["listen", &path("packets"), "-o", &path("listened.pfm")].map(str::to_owned);
        Invocation::new(listen.into_iter().chain(confidence("listened.png"))).assert_done();
        assert_eq!(read_pfm(Path::new(&path("listened.pfm"))), expected, "{} with {fusion}", profile.name);
        if matching.has_confidences() {
            let [expected, others @ ..] = ["matched.png", "simulated.png", "listened.png"].map(|name| confidences(&path(name)));
            assert!(others.iter().all(|other| *other == expected), "{} with {fusion}", profile.name);
            assert!(expected.iter().any(|confidence| *confidence > 230), "{} with {fusion}", profile.name);
        }

        let is_predicted = matching.name() != "sgm" || fusion != "half" || search.views().len() <= 2;
        assert_eq!(report["instructions"].is_number(), is_predicted, "{report:#}");
        assert_eq!(report["packet_bytes"], fs::metadata(path("packets")).expect("packets").len());
        assert_eq!(report["de"], search.evaluations());
        assert_eq!(report["lines_latency"], matching.latency_lines());
        let passes = search.width().div_ceil(matching.tile_width());
        assert_eq!(report["tile_passes"], passes);
        let lines = report["lines_read"].as_object().expect("lines by frame");
        assert_eq!(lines.len(), 1 + search.views().len());
        assert!(lines.values().all(|read| *read == passes * search.height()), "{report:#}");
        let statics = report["ram_static"].as_u64().expect("bytes");
        assert!(statics >= profile.lengths().bytes() as u64, "{report:#}");
        assert!(report["ram_total"].as_u64() > Some(statics), "{report:#}");
        assert!(report["ram_total"].as_u64() <= Some(profile.ram_budget as u64), "{report:#}");
    }
}

/// The profiles that are simulated in seconds.
const SMALL: [Profile; 4] = [profile::QQVGA, profile::QVGA_TILED, profile::QQVGA_SGM, profile::QQVGA_SGM_CONFIDENCE];

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn small_profiles_are_simulated() {
    SMALL.iter().for_each(assert_simulated_as_matched);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation")]
fn every_other_profile_is_simulated() {
    let others = [&SMALL[..], &ELSEWHERE].concat();
    for profile in profile::ALL.iter().filter(|profile| others.iter().all(|other| other.name != profile.name)) {
        assert_simulated_as_matched(profile);
    }
}

/// The profiles with views elsewhere than in the cross, which the frames of `multiscopic demo` lack.
const ELSEWHERE: [Profile; 2] = [profile::QQVGA_3X3, profile::QVGA_PRIOR];

/// The demo's scene, seen from the views of a profile.
fn scene(matching: &Matching) -> ViewSet {
    let (width, height) = (matching.search().width(), matching.search().height());
    let shot = render_views(&Scene::demo(), &PinholeCamera::new(width as u32, height as u32), matching.views(), 1);
    let frames = shot.frames(matching.views());
    let image = |frame| frames.get(frame).map(|image| image.as_raw().clone());
    let others = matching.views().iter().filter(|view| !View::CROSS.contains(view));
    ViewSet {
        width,
        height,
        center: image(Frame::Center).expect("a centre"),
        views: View::CROSS.map(|view| image(Frame::View(view))),
        others: others.filter_map(|view| Some(((view.right().into(), view.down().into()), image(Frame::View(view))?))).collect(),
    }
}

/// Runs `simulate` on `images`, and returns the disparities that its packets carry, in 64ths of a pixel, and its report.
#[track_caller]
fn simulated(profile: &Profile, fusion: Fusion, images: &ViewSet) -> (Vec<Option<i32>>, serde_json::Value) {
    let dir = folder();
    images.write_rig(dir.path());
    let path = |name: &str| dir.path().join(name).to_str().expect("UTF-8").to_owned();
    let (rig, packets) = (path(""), path("packets"));
    let simulate = ["simulate", "--json", "--profile", profile.name, "--fusion", fusion.name(), "--packets", &packets, &rig];
    let report = json(&Invocation::new(simulate), 0);
    Invocation::new(["listen", &packets, "-o", &path("listened.pfm"), "--raw16", &path("raw.png")]).assert_done();
    let samples = read_raw16(Path::new(&path("raw.png"))).2;
    (samples.into_iter().map(|raw| (raw != 0).then(|| i32::from(raw) - 32768)).collect(), report)
}

/// A reference's disparities in 64ths of a pixel.
fn fixed(disparities: Vec<Option<f64>>) -> Vec<Option<i32>> {
    disparities.into_iter().map(|d| d.map(|d| i32::from(reference::fixed(d)))).collect()
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn eight_views_are_simulated_like_the_reference() {
    let profile = profile::QQVGA_3X3;
    let Matching::Blocks { params, .. } = profile.matching(Fusion::Min) else { panic!("it matches blocks") };
    let images = scene(&profile.matching(Fusion::Min));
    for (fusion, rule) in [(Fusion::Min, reference::Fusion::Min), (Fusion::Half, reference::Fusion::Half)] {
        let expected = images.reference(rule, 1, params.num_disparities() as i32, params.block_size() as i32).disparities();
        let (found, report) = simulated(&profile, fusion, &images);
        assert_eq!(found, fixed(expected), "{}", fusion.name());
        assert!(report["instructions"].is_number(), "{report:#}");
        assert_eq!(report["de"], params.evaluations());
        assert_eq!(report["lines_read"].as_object().map(serde_json::Map::len), Some(9));
    }
    assert_eq!(json(&budget(&["--profile", profile.name]), 0)["fusion"], "half", "the default of eight views");
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn long_baselines_are_simulated_like_the_references() {
    let profile = profile::QVGA_PRIOR;
    let matching = profile.matching(Fusion::Min);
    let Matching::AroundPrior { short, long } = matching else { panic!("it has long baselines") };
    let images = scene(&matching);
    let near = ViewSet { others: Vec::new(), ..images.clone() };
    let prior =
        near.reference(reference::Fusion::Min, 1, short.num_disparities() as i32, short.block_size() as i32).disparities();
    let prior = fixed(prior);
    let gradients = |image: &[u8]| gradients(image, images.width);
    let views: Vec<_> = images.others.iter().map(|((right, down), image)| ((right / 4, down / 4), gradients(image))).collect();
    let around = AroundPrior {
        width: images.width as i32,
        height: images.height as i32,
        center: &gradients(&images.center),
        views: &views,
        multiple: 4,
        prior: &prior,
        priors: (1, 32),
        fusion: reference::Fusion::Min,
        min_disparity: -4,
        num_disparities: 8,
        block_size: 11,
    };
    let (found, report) = simulated(&profile, Fusion::Min, &images);
    assert_eq!(found, around.disparities());
    assert!(found.iter().zip(&prior).filter(|(found, prior)| found != prior).count() > found.len() / 2);
    assert!(report["instructions"].is_number(), "{report:#}");
    assert_eq!(report["lines_latency"], 11);
    assert_eq!(report["de"], short.evaluations() + long.evaluations());
    let expected = serde_json::json!({ "center": 480, "left": 240, "right": 240, "-4,0": 240, "4,0": 240 });
    assert_eq!(report["lines_read"], expected);
}

#[test]
fn a_simulation_refuses_what_does_not_fit() {
    Invocation::new(["simulate", "--profile", "svga"]).assert_refused(&["svga", "qqvga", "vga-tiled"]);
    Invocation::new(["simulate"]).assert_refused(&["--profile"]);
    let [center, left, right, ..] = golden::paths().map(|path| path.to_str().expect("UTF-8").to_owned());
    let small = ["simulate", "--profile", "qqvga", "--center", &center, "--left", &left, "--right", &right];
    Invocation::new(small).assert_refused(&["center.png: found 48x32 pixels", "at least 160x120"]);
    Invocation::new(&small[..7]).assert_refused(&["profile qqvga needs the views left, right: the right one is missing"]);
    Invocation::new(&small[..5]).assert_refused(&["--left", "--top"]);
    let no_confidences = ["simulate", "--profile", "qqvga", "--confidence", "out.png"];
    Invocation::new(no_confidences).assert_refused(&["profile qqvga computes no confidences", "--confidence out.png"]);
    Invocation::new(["simulate", "--profile", "qqvga", "-o", "none/out.pfm"]).assert_refused(&["cannot write none/out.pfm"]);
}
