//! The commands around the firmware as users run them: `listen`, `simulate` and `budget`.

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use multiscopic::{
    Processor,
    scene::{PinholeCamera, Scene, render_views},
};
use multiscopic_core::{Disparity, Frame, Fusion, Memory, Params, Region, SearchConfig, SemiGlobalCost, View, Views};
use multiscopic_edge::{
    Matching, Profile, WholeLines, Wide,
    packet::{Sender, buffer_bytes, buffer_bytes_with_confidences},
    profile,
};
use multiscopic_tests::{
    program::{self, Invocation},
    reference::{self, AroundPrior, gradients},
    test_images::{
        golden,
        view_set::{ViewSet, read_pfm, read_raw16},
    },
};
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder for the test")
}

/// A frame of 7 x 5 pixels, sent in tiles of 4 columns.
const SEARCH: SearchConfig =
    SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(7, 5) };
const PARAMS: Params = match SEARCH.block_matching(3) {
    Ok(params) => params,
    Err(_) => panic!("the parameters are out of range"),
};
const TILE: usize = 4;

/// The 16-bit sample of a pixel. All valid ones differ, and some are invalid.
fn sample(u: usize, v: usize) -> u16 {
    if (u + v) % 6 == 5 { 0 } else { 32768 + 64 * v as u16 + u as u16 }
}

/// The packets of the frame: its lines, then its end.
fn packets() -> Vec<Vec<u8>> {
    let mut buffer = vec![0; buffer_bytes(TILE)];
    let mut sender = Sender::new(PARAMS.search(), &mut buffer);
    let mut packets = Vec::new();
    for tile in Region::tiles(PARAMS.search(), TILE) {
        for v in 0..PARAMS.height() {
            let line: Vec<_> = tile.columns().map(|u| Disparity::from_raw16(sample(u, v))).collect();
            packets.push(sender.line(&tile, v, &line).expect("the buffer is for it").to_vec());
        }
    }
    packets.push(sender.end(Some(3000)).expect("the buffer is for it").to_vec());
    packets
}

/// The samples of the frame without those of the `lost` packets.
fn samples(lost: &[usize]) -> Vec<u16> {
    let packet = |u: usize, v: usize| u / TILE * PARAMS.height() + v;
    let pixels = (0..PARAMS.height()).flat_map(|v| (0..PARAMS.width()).map(move |u| (u, v)));
    pixels.map(|(u, v)| if lost.contains(&packet(u, v)) { 0 } else { sample(u, v) }).collect()
}

/// Runs `listen` on `bytes` in `dir`, and returns the run and the paths of its pictures.
fn listened(dir: &Path, bytes: &[u8]) -> (Invocation, [PathBuf; 3]) {
    let stream = dir.join("stream");
    fs::write(&stream, bytes).expect("a stream for the test");
    let outputs = ["out.pfm", "out.png", "out.raw16.png"].map(|name| dir.join(name));
    let [pfm, png, raw16] = outputs.each_ref().map(|path| path.to_str().expect("UTF-8"));
    let run = Invocation::new(["listen", stream.to_str().expect("UTF-8"), "-o", pfm, "--png", png, "--raw16", raw16]);
    (run, outputs)
}

/// Runs `listen` on `bytes` without the `lost` packets. It must end with exit code 1, name all `words`, and
/// write the rest.
#[track_caller]
fn assert_lost(bytes: &[u8], lost: &[usize], words: &[&str]) {
    let dir = folder();
    let (run, [_, _, raw16]) = listened(dir.path(), bytes);
    assert_eq!((run.code, run.stdout.as_str()), (Some(1), ""), "{run:#?}");
    for word in words {
        assert!(run.stderr.contains(word), "the message names `{word}`: {run:#?}");
    }
    assert_eq!(read_raw16(&raw16), (7, 5, samples(lost)));
}

#[test]
fn a_whole_stream_becomes_pictures() {
    let dir = folder();
    let (run, [pfm, png, raw16]) = listened(dir.path(), &packets().concat());
    run.assert_done();
    assert!(run.stderr.contains("7x5: 100.0 % received, ") && run.stderr.contains("3000 bytes of stack"), "{run:#?}");
    assert_eq!(read_raw16(&raw16), (7, 5, samples(&[])));
    let pixels = |raw: u16| if raw == 0 { f32::INFINITY } else { (f32::from(raw) - 32768.0) / 64.0 };
    assert_eq!(read_pfm(&pfm), (7, 5, samples(&[]).into_iter().map(pixels).collect()));
    assert_eq!(image::open(png).expect("a picture").to_rgb8().dimensions(), (7, 5));
}

#[test]
fn confidences_are_received() {
    let dir = folder();
    let (stream, pfm, png) = (dir.path().join("stream"), dir.path().join("out.pfm"), dir.path().join("out.png"));
    let listen = || Invocation::new([Path::new("listen"), &stream, Path::new("-o"), &pfm, Path::new("--confidence"), &png]);
    let confidence = |u: usize, v: usize| (40 * u + v) as u8;
    let mut buffer = vec![0; buffer_bytes_with_confidences(PARAMS.width())];
    let mut sender = Sender::new(PARAMS.search(), &mut buffer);
    let whole = Region::whole(PARAMS.search());
    let mut bytes = Vec::new();
    for v in 0..PARAMS.height() {
        let disparities: Vec<_> = whole.columns().map(|u| Disparity::from_raw16(sample(u, v))).collect();
        let confidences: Vec<_> = whole.columns().map(|u| confidence(u, v)).collect();
        bytes.extend(sender.line_with_confidences(&whole, v, &disparities, &confidences).expect("the buffer is for it"));
    }
    bytes.extend(sender.end(None).expect("the buffer is for it"));
    fs::write(&stream, bytes).expect("a stream for the test");
    let run = listen();
    run.assert_done();
    // Column 6 is sure, in every line.
    assert!(run.stderr.contains("14.3 % sure (from 0.9 on)"), "{run:#?}");
    let expected: Vec<u8> = (0..5).flat_map(|v| (0..7).map(move |u| confidence(u, v))).collect();
    assert_eq!(confidences(png.to_str().expect("UTF-8")), expected);

    // Disparities are written even if there are no confidences.
    [&pfm, &png].into_iter().for_each(|path| fs::remove_file(path).expect("it was written"));
    fs::write(&stream, packets().concat()).expect("a stream for the test");
    listen().assert_refused(&["stream: found packets of disparities alone", "--confidence", "qvga-confidence"]);
    assert!(pfm.exists() && !png.exists());
}

#[test]
fn packets_come_through_standard_input() {
    let dir = folder();
    let pfm = dir.path().join("out.pfm");
    let mut listen = Command::new(program::binary());
    listen.args(["listen", "-", "-o"]).arg(&pfm).stdin(Stdio::piped()).stderr(Stdio::null());
    let mut listen = listen.spawn().expect("the command line runs");
    // The pipe stays open. The end packet ends the run.
    let mut pipe = listen.stdin.take().expect("a pipe");
    pipe.write_all(&packets().concat()).expect("it reads");
    assert_eq!(listen.wait().expect("it ends").code(), Some(0));
    drop(pipe);
    assert_eq!(read_pfm(&pfm).0, 7);
}

#[test]
fn the_summary_is_json() {
    let dir = folder();
    let stream = dir.path().join("stream");
    let mut some = packets();
    some.remove(6);
    fs::write(&stream, some.concat()).expect("a stream for the test");
    let listen = |more: &[&str]| Invocation::new(["listen", stream.to_str().expect("UTF-8"), "--json"].iter().chain(more));
    let summary = json(&listen(&[]), 1);
    // The packet had 3 of the 35 pixels.
    let lost: Vec<u16> = samples(&[6]);
    let valid = lost.iter().filter(|sample| **sample != 0).count();
    let expected = serde_json::json!({
        "width": 7, "height": 5, "received": 32.0 / 35.0, "valid": valid as f64 / 35.0, "stack": 3000, "flaws": 1
    });
    assert_eq!(summary, expected);
    listen(&["-o", "-"]).assert_refused(&["-o - and --json both take standard output"]);
}

#[test]
fn lost_packets_are_named() {
    let mut one = packets();
    one.remove(6);
    assert_lost(&one.concat(), &[6], &["line 1 (packet 6) is lost", "91.4 % received"]);
    let mut several = packets();
    several.drain(3..7);
    let words = ["lines 3 to 4 (packets 3 to 4) are lost", "lines 0 to 1 (packets 5 to 6) are lost"];
    assert_lost(&several.concat(), &[3, 4, 5, 6], &words);
    let mut end = packets();
    end.pop();
    assert_lost(&end.concat(), &[], &["the end of the frame is lost: nothing came after line 4 (packet 9)"]);
}

#[test]
fn a_flipped_bit_is_noticed_anywhere() {
    let packets = packets();
    let whole = packets.concat();
    for (i, start) in packets.iter().scan(0, |end, packet| Some(std::mem::replace(end, *end + packet.len()))).enumerate() {
        let mut bytes = whole.clone();
        bytes[start + packets[i].len() / 2] ^= 0x10;
        let place = if i == 10 { "after line 4 (packet 9)".into() } else { format!("line {} (packet {i}) is damaged", i % 5) };
        assert_lost(&bytes, &[i], &[&place, "a damaged packet"]);
    }
}

#[test]
fn a_truncated_stream_is_reported() {
    let whole = packets().concat();
    let bytes: usize = packets()[..7].iter().map(Vec::len).sum();
    assert_lost(&whole[..bytes + 3], &[7, 8, 9], &["after line 1 (packet 6): a damaged packet", "the end of the frame is lost"]);
}

#[test]
fn foreign_packets_are_named_and_skipped() {
    let other = SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 8, ..SearchConfig::of_size(9, 2) }
        .block_matching(3)
        .expect("they are in range");
    let mut buffer = vec![0; buffer_bytes(9)];
    let line = Sender::new(other.search(), &mut buffer)
        .line(&Region::whole(other.search()), 0, &[None; 9])
        .expect("the buffer is for it")
        .to_vec();
    let mut mixed = packets();
    mixed.insert(4, line);
    let dir = folder();
    let (run, [_, _, raw16]) = listened(dir.path(), &mixed.concat());
    run.assert_done();
    assert!(run.stderr.contains("ignored a packet of another frame: 9x2 pixels instead of 7x5"), "{run:#?}");
    assert_eq!(read_raw16(&raw16).2, samples(&[]));
}

#[test]
fn other_data_is_refused() {
    for (bytes, words) in [
        (&b"not a stream of packets"[..], &["stream: found 23 bytes without a packet of disparities", "expected the packets"]),
        (b"", &["stream: found nothing", "expected the packets"]),
        (&[0; 100], &["stream: found 100 bytes without a packet of disparities", "expected the packets"]),
    ] {
        let dir = folder();
        let (run, outputs) = listened(dir.path(), bytes);
        run.assert_refused(words);
        assert!(outputs.iter().all(|path| !path.exists()), "nothing is written");
    }
    let run = Invocation::new(["listen", "no/such/device", "-o", "out.pfm"]);
    run.assert_refused(&["cannot read no/such/device"]);
    let dir = folder();
    let (stream, nowhere) = (dir.path().join("stream"), dir.path().join("none/out.pfm"));
    fs::write(&stream, packets().concat()).expect("a stream for the test");
    Invocation::new([Path::new("listen"), &stream, Path::new("-o"), &nowhere]).assert_refused(&["cannot write", "none"]);
    Invocation::new([Path::new("listen"), &stream, Path::new("-o"), &stream]).assert_refused(&["would replace the input"]);
}

/// The JSON that a command prints, without anything else.
#[track_caller]
fn json(run: &Invocation, code: i32) -> serde_json::Value {
    assert_eq!(run.code, Some(code), "{run:#?}");
    serde_json::from_str(&run.stdout).unwrap_or_else(|error| panic!("{error}: {run:#?}"))
}

/// The confidences in a picture.
fn confidences(path: &str) -> Vec<u8> {
    multiscopic_tests::test_images::view_set::read_grey(Path::new(path)).2
}

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
        let (w, h, pixels) = multiscopic_tests::test_images::view_set::read_grey(Path::new(&path(&format!("demo/{view}.png"))));
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
            format!("--block-size {}", params.block_size())
        }
        Matching::SemiGlobal(params) | Matching::WithConfidences(WholeLines::SemiGlobal(params)) => match params.cost() {
            SemiGlobalCost::Sad { block_size } => format!("--method sgm --cost sad --block-size {block_size}"),
            SemiGlobalCost::Census(census) => format!("--method sgm --census {}", census.name()),
        },
        Matching::Network(_) => "--method net --sub-pixel none --repair none".into(),
    };
    for fusion in Fusion::ALL.map(Fusion::name) {
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

        let is_predicted = !matching.has_confidences() && (fusion != "half" || search.views().len() <= 2);
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
        assert!(statics >= profile.lengths::<Wide>().bytes() as u64, "{report:#}");
        assert!(report["ram_total"].as_u64() > Some(statics), "{report:#}");
        assert!(report["ram_total"].as_u64() <= Some(profile.ram_budget as u64), "{report:#}");
    }
}

/// The profiles that are simulated in seconds without optimisation.
const SMALL: [Profile; 3] = [profile::QQVGA, profile::QQVGA_SGM, profile::QQVGA_SGM_CONFIDENCE];

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
fn what_is_not_predicted_is_not_printed() {
    let confidences = [profile::QVGA_CONFIDENCE, profile::QQVGA_SGM_CONFIDENCE].map(|profile| (profile, "min"));
    for (profile, fusion) in [(profile::QVGA, "half"), (profile::QQVGA_3X3, "mean")].into_iter().chain(confidences) {
        let options = ["--profile", profile.name, "--fusion", fusion];
        let report = json(&budget(&options), 0);
        for name in ["instructions", "instructions_per_de", "seconds", "fps"] {
            assert!(report[name].is_null(), "{name} of {}: {report:#}", profile.name);
        }
        let text = Invocation::new(["budget"].iter().chain(&options));
        assert!(text.stdout.contains("instructions and time are not predicted for this match"), "{text:#?}");
        let checked = ["budget", "--fps", "1"];
        Invocation::new(checked.iter().chain(&options)).assert_refused(&["--fps cannot be checked", "not predicted"]);
    }
}

#[test]
fn a_budget_states_what_is_searched_around_a_prior() {
    let text = Invocation::new(["budget", "--profile", "qvga-prior"]).stdout;
    assert!(text.contains("around them in views -4,0 and 4,0: disparities -4..=3, block 11"), "{text}");
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

/// Runs `budget` with options.
fn budget(options: &[&str]) -> Invocation {
    Invocation::new(["budget", "--json"].iter().chain(options))
}

#[test]
fn a_budget_has_the_bytes_of_the_matcher_and_of_the_firmware() {
    for profile in profile::ALL {
        let report = json(&budget(&["--profile", profile.name]), 0);
        let matching = profile.matching(Fusion::Min);
        let memory = match matching {
            Matching::Blocks { params, tile_width } => Memory::new::<Wide>(&params, tile_width),
            Matching::SemiGlobal(params) => Memory::semi_global::<Wide>(&params),
            Matching::WithConfidences(WholeLines::Blocks(params)) => Memory::new::<Wide>(&params, params.width()),
            Matching::WithConfidences(WholeLines::SemiGlobal(params)) => Memory::semi_global::<Wide>(&params),
            Matching::Network(params) => params.memory::<Wide>().of_matcher(),
            Matching::AroundPrior { short, long } => {
                let long = Memory::new::<Wide>(&long.around(short.search()), 320);
                Memory::new::<Wide>(&short, 320).plus(&long)
            }
        };
        assert_eq!(report["method"], matching.name(), "{}", profile.name);
        let confidence = match matching {
            // Eleven lines of disparities, six of peak ratios, and one of confidences.
            Matching::WithConfidences(_) => (2 * 11 + 6 + 1) * matching.tile_width(),
            Matching::Network(_) => matching.tile_width(),
            _ => 0,
        };
        for (buffer, bytes) in [
            ("column_sums", memory.column_sums),
            ("block_sums", memory.block_sums),
            ("masks", memory.masks),
            ("fused", memory.fused),
            ("center", memory.center),
            ("horizontal", memory.horizontal),
            ("vertical", memory.vertical),
            ("zeros", memory.zeros),
            ("prior", memory.prior),
            ("line", memory.line),
            ("costs", memory.costs),
            ("paths", memory.paths),
            ("samples", memory.samples),
            ("network", memory.network),
            ("confidence", confidence),
            ("disparities", 2 * matching.tile_width()),
        ] {
            // A buffer that the method does not have is not listed.
            let expected = (bytes > 0).then_some(bytes as u64);
            assert_eq!(report["ram"][buffer].as_u64(), expected, "{buffer} of {}", profile.name);
        }
        let bytes = |name: &str| report[name].as_u64().expect("bytes");
        let buffers = report["ram"].as_object().expect("buffers").values();
        assert_eq!(buffers.map(|bytes| bytes.as_u64().expect("bytes")).sum::<u64>(), bytes("ram_total"));
        assert_eq!(bytes("ram_static") + bytes("stack_max"), bytes("ram_total"));
        let runtime = report["ram"]["runtime"].as_u64().expect("bytes");
        assert_eq!(bytes("ram_static"), profile.lengths::<Wide>().bytes() as u64 + runtime, "{}", profile.name);
    }
    let simulated = json(&Invocation::new(["simulate", "--json", "--profile", "qqvga", "--core", "cortex-m55"]), 0);
    let budgeted = json(&budget(&["--profile", "qqvga", "--core", "cortex-m55"]), 0);
    for name in
        ["ram_static", "stack_max", "ram_total", "de", "instructions", "instructions_per_de", "lines_latency", "tile_passes"]
    {
        assert_eq!(simulated[name], budgeted[name], "{name}");
    }
}

#[test]
fn any_match_has_a_budget() {
    let given = "--width 320 --height 240 --num-disparities 32 --core cortex-m7 --tile-width 80 --fusion min";
    let mut own = json(&budget(&given.split(' ').collect::<Vec<_>>()), 0);
    let tile = profile::QVGA_TILED.matching(Fusion::Min).tile_width().to_string();
    assert_eq!((own["views"].as_u64(), own["tile_passes"].as_u64()), (Some(4), Some(4)));
    let given = given.replace("80", &tile);
    own = json(&budget(&given.split(' ').collect::<Vec<_>>()), 0);
    assert_eq!(own, json(&budget(&["--profile", "qvga-tiled", "--core", "cortex-m7", "--fusion", "min"]), 0));
    for block_size in ["", " --block-size 5"] {
        let given =
            format!("--width 320 --height 240 --num-disparities 32 --core cortex-m7 --fusion min --method sgm{block_size}");
        own = json(&budget(&given.split(' ').collect::<Vec<_>>()), 0);
        assert_eq!(own, json(&budget(&["--profile", "qvga-sgm", "--core", "cortex-m7", "--fusion", "min"]), 0));
    }
    for views in ["1", "2", "4"] {
        for (method, fusion, block) in [
            ("bm", "min", "11"),
            ("bm", "mean", "17"),
            ("bm", "heuristic", "21"),
            ("sgm", "min", "1"),
            ("sgm", "mean", "5"),
            ("sgm", "heuristic", "11"),
        ] {
            let options = ["--width", "99", "--height", "77", "--views", views, "--fusion", fusion, "--block-size", block];
            let report = json(&budget(&[&options[..], &["--method", method]].concat()), 0);
            let per_de = report["instructions_per_de"].as_f64().expect("a number");
            assert!(per_de > 1.0 && per_de < 500.0, "{report:#}");
            if method == "bm" {
                assert_eq!(report, json(&budget(&options), 0), "block matching is the default");
            }
        }
    }
}

#[test]
fn time_is_instructions_by_cycles_by_clock() {
    let report = json(&budget(&["--profile", "qvga", "--clock", "200", "--cpi", "1.25"]), 0);
    let number = |name: &str| report[name].as_f64().expect("a number");
    let seconds = number("instructions") * 1.25 / 200e6;
    assert!((number("seconds") / seconds - 1.0).abs() < 1e-9, "{report:#}");
    assert!((number("fps") * seconds - 1.0).abs() < 1e-9, "{report:#}");
    for processor in Processor::ALL {
        let (core, clock, cycles) = (processor.name(), processor.clock_mhz(), processor.cycles_per_instruction());
        let report = json(&budget(&["--profile", "qvga", "--core", core]), 0);
        assert_eq!((&report["clock_mhz"], &report["cycles_per_instruction"]), (&clock.into(), &cycles.into()), "{core}");
        let text = Invocation::new(["budget", "--profile", "qvga", "--core", core]);
        assert!(text.stdout.contains(&format!("at {clock} MHz and {cycles} cycles per instruction")), "{text:#?}");
    }
}

#[test]
fn an_exceeded_budget_fails_by_name() {
    let report = json(&budget(&["--profile", "qvga"]), 0);
    let total = report["ram_total"].as_u64().expect("bytes");
    let fps = report["fps"].as_f64().expect("a number");
    let run = |ram: u64, fps: f64| budget(&["--profile", "qvga", "--ram", &ram.to_string(), "--fps", &fps.to_string()]);
    let met = run(total, 0.99 * fps);
    assert_eq!(met.stderr, "");
    json(&met, 0);
    let short = run(total - 1, 0.99 * fps);
    json(&short, 1);
    let words = format!("RAM: {total} bytes exceed --ram {} by 1; narrower column tiles would fit: --tile-width 160", total - 1);
    assert!(short.stderr.contains(&words) && !short.stderr.contains("--fps"), "{short:#?}");
    let slow = run(total, 2.0 * fps);
    json(&slow, 1);
    assert!(slow.stderr.contains("2.00 times as fast") && !slow.stderr.contains("--ram"), "{slow:#?}");
    json(&budget(&["--profile", "qvga", "--ram", "144KiB"]), 0);
    json(&budget(&["--profile", "qvga", "--ram", "48KiB"]), 1);
    let short = budget(&["--profile", "qvga-sgm", "--ram", "48KiB"]);
    json(&short, 1);
    assert!(short.stderr.contains("exceed --ram 49152") && !short.stderr.contains("--tile-width"), "{short:#?}");
}

#[test]
fn a_budget_refuses_bad_usage() {
    let refused = |options: &[&str], words: &[&str]| budget(options).assert_refused(words);
    refused(&[], &["--width", "--height"]);
    refused(&["--width", "320"], &["--height"]);
    refused(&["--profile", "svga"], &["svga", "qvga-tiled"]);
    refused(&["--profile", "qvga", "--block-size", "5"], &["--profile", "--block-size"]);
    refused(&["--width", "64", "--height", "48", "--views", "5"], &["--views is 5"]);
    refused(&["--width", "64", "--height", "48", "--block-size", "8"], &["block size is 8"]);
    refused(&["--width", "64", "--height", "48", "--tile-width", "65"], &["--tile-width is 65", "64"]);
    refused(&["--width", "64", "--height", "48", "--tile-width", "0"], &["--tile-width is 0"]);
    refused(&["--profile", "qvga", "--method", "sgm"], &["--profile", "--method"]);
    let sgm = |options: &[&str], words: &[&str]| {
        refused(&[&["--width", "64", "--height", "48", "--method", "sgm"], options].concat(), words);
    };
    sgm(&["--tile-width", "32"], &["--tile-width", "block matching"]);
    sgm(&["--block-size", "13"], &["block size is 13", "11"]);
    sgm(&["--block-size", "4"], &["block size is 4"]);
    refused(&["--width", "64", "--height", "48", "--method", "gc"], &["gc", "bm", "sgm"]);
    refused(&["--profile", "qvga", "--core", "cortex-m0"], &["cortex-m0", "cortex-m55"]);
    refused(&["--profile", "qvga", "--ram", "12G"], &["12G", "144KiB"]);
    refused(&["--profile", "qvga", "--clock", "0"], &["--clock", "above 0"]);
    refused(&["--profile", "qvga", "--cpi", "-1"], &["--cpi", "above 0"]);
    refused(&["--profile", "qvga", "--fps", "x"], &["--fps", "above 0"]);
}

#[test]
fn the_commands_of_the_guides_run() {
    let dir = folder();
    let run = |words: &[&str]| {
        let output = Command::new(program::binary()).args(words).current_dir(dir.path()).output().expect("the command line runs");
        assert_eq!(output.status.code(), Some(0), "{words:?}: {output:?}");
    };
    run(&["demo", "-o", "out/demo", "--width", "180", "--height", "130", "--num-disparities", "1"]);
    let guides = [include_str!("../../../README.md"), include_str!("../../../docs/firmware.md")];
    let commands = || guides.iter().flat_map(|guide| guide.lines()).filter_map(|line| line.strip_prefix("multiscopic "));
    for name in ["match out/demo", "budget", "simulate", "listen"] {
        assert!(commands().any(|command| command.starts_with(name)), "the guides have no line for {name}");
        for command in commands().filter(|command| command.starts_with(name)) {
            run(&command.split(' ').collect::<Vec<_>>());
        }
    }
    assert_eq!(read_pfm(&dir.path().join("received.pfm")).0, 160);
}
