//! The filters of `match`, and the confidences that it writes.

use std::path::Path;

use multiscopic::FloatImage;
use multiscopic_tests::program::{Invocation, make};
use tempfile::TempDir;

/// A made-up capture.
struct Capture(TempDir);

impl Capture {
    fn new() -> Capture {
        let dir = tempfile::tempdir().expect("a folder");
        make("scene --random --seed 4 --views 2 --size 96x72", dir.path());
        Capture(dir)
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().expect("a path in UTF-8").into()
    }

    fn matched(&self, options: &str) -> Invocation {
        let (rig, output) = (self.path("0000"), self.path("d.pfm"));
        let arguments = ["match", &rig, "--num-disparities", "14", "-o", &output];
        let method = if options.contains("--method") || options.contains("--prior ") { &[][..] } else { &["--method", "bm"] };
        Invocation::new(arguments.iter().chain(method).copied().chain(options.split_whitespace()))
    }

    /// The disparities, +inf where there is none.
    fn disparities(&self, options: &str) -> FloatImage {
        self.matched(options).assert_done();
        multiscopic::files::read_pfm(Path::new(&self.path("d.pfm"))).expect("the disparities")
    }

    fn valid(&self, options: &str) -> usize {
        count(&self.disparities(options))
    }
}

fn count(map: &FloatImage) -> usize {
    map.pixels().iter().filter(|d| d.is_finite()).count()
}

/// No filter is ignored: each invalidates pixels and changes none, or is refused.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn filters_act_for_every_method() {
    let capture = Capture::new();
    for method in ["bm", "bm --fusion mean", "sgm", "sgm --paths 8", "sgm --cost sad", "sgm --cost census2", "gc", "net"] {
        let of = |filter: &str| format!("--method {method} --sub-pixel none --repair none {filter}");
        let has_no_costs = ["gc", "net"].contains(&method);
        let all = capture.disparities(&of(""));
        for filter in [
            "--uniqueness-ratio 25",
            "--texture-threshold 2800",
            "--disp12-max-diff 0",
            "--speckle-window-size 30 --speckle-range 1",
            "--min-confidence 0.9",
        ] {
            let needs_costs = filter.starts_with("--uniq") || filter.starts_with("--disp12");
            if has_no_costs && needs_costs {
                capture.matched(&of(filter)).assert_refused(&[if method == "gc" { "graph cuts" } else { "network" }, "costs"]);
                continue;
            }
            let kept = capture.disparities(&of(filter));
            let stayed = |(found, before): (&f32, &f32)| found.is_infinite() || found == before;
            assert!(kept.pixels().iter().zip(all.pixels()).all(stayed), "{method} {filter}");
            // The network may leave no speckles.
            let most = count(&all) - usize::from(method != "net" || !filter.starts_with("--speckle"));
            assert!((1..=most).contains(&count(&kept)), "{method} {filter}: {} of {}", count(&kept), count(&all));
        }
        assert_ne!(capture.disparities(&of("--median 5")), all, "{method}");
        assert_ne!(capture.disparities(&of("--smooth")), all, "{method}");
        // Filtered pixels stay invalid, and all others move by half a pixel at most.
        let unique = if has_no_costs { "--texture-threshold 2800" } else { "--uniqueness-ratio 25" };
        let [coarse, fine] = ["none", "lucas-kanade"]
            .map(|step| capture.disparities(&format!("--method {method} --repair none {unique} --sub-pixel {step}")));
        let moved = |(fine, coarse): (&f32, &f32)| (fine - coarse).abs() <= 0.5 || fine == coarse;
        assert!(fine != coarse && fine.pixels().iter().zip(coarse.pixels()).all(moved), "{method}");
    }
}

/// Disparities that are probably right hardly move, whatever the method. The rest follow them, and stay unsure.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn what_is_probably_wrong_is_repaired() {
    let capture = Capture::new();
    let picture = capture.path("sure.png");
    let confidences = |options: &str| {
        capture.matched(&format!("{options} --confidence {picture}")).assert_done();
        image::open(&picture).expect("the picture").into_luma8().into_raw()
    };
    for method in ["bm", "sgm", "gc", "net"] {
        let of = |repair: &str| format!("--method {method} --repair {repair}");
        let [before, after] = ["none", "smooth"].map(|repair| capture.disparities(&of(repair)));
        let [sure, sure_after] = ["none", "smooth"].map(|repair| confidences(&of(repair)));
        let mut replaced = 0;
        for (i, (before, after)) in before.pixels().iter().zip(after.pixels()).enumerate() {
            if (before - after).abs() > 0.5 {
                assert!(sure[i] < 128 && sure_after[i] < 128, "{method}: {before} with {} became {after}", sure[i]);
                replaced += 1;
            } else {
                assert_eq!(sure[i], sure_after[i], "{method}: {before} became {after}");
            }
        }
        assert!(replaced > 0, "{method}");
        // It is not for the repair to fill holes, and what is kept is as repaired.
        let kept = capture.disparities(&format!("{} --min-confidence 0.8", of("smooth")));
        assert!(kept.pixels().iter().zip(after.pixels()).all(|(kept, after)| kept.is_infinite() || kept == after), "{method}");
        assert_eq!(count(&kept), sure_after.iter().filter(|&&sure| sure >= 204).count(), "{method}");
    }
}

/// Disparities that are known beforehand are sharpened as well.
#[test]
fn disparities_around_a_prior_are_sharpened() {
    let capture = Capture::new();
    let prior = capture.path("prior.png");
    capture.matched(&format!("--raw16 {prior}")).assert_done();
    let [coarse, fine] = ["", "--sub-pixel lucas-kanade"].map(|step| capture.disparities(&format!("--prior {prior} {step}")));
    assert!(fine != coarse && count(&fine) == count(&coarse));
    for filter in ["--method sgm", "--median 5", "--repair smooth", "--smooth", "--fill background", "--min-confidence 0.5"] {
        let option = filter.split(' ').next().expect("a name");
        capture.matched(&format!("--prior {prior} {filter}")).assert_refused(&["--prior", option]);
    }
}

#[test]
fn holes_are_filled() {
    let capture = Capture::new();
    let sure = "--min-confidence 0.95";
    assert!(capture.valid(sure) < 96 * 72);
    for fill in ["--fill background", "--smooth"] {
        assert_eq!(capture.valid(&format!("{sure} {fill}")), 96 * 72, "{fill}");
    }
}

/// Confidences are as the picture says: what `--min-confidence` keeps are the pixels from there on.
#[test]
#[cfg_attr(debug_assertions, ignore = "slow without optimisation")]
fn the_picture_of_confidences_tells_what_is_kept() {
    let capture = Capture::new();
    let picture = capture.path("sure.png");
    for method in ["bm", "sgm", "gc", "net"] {
        capture.matched(&format!("--method {method} --confidence {picture}")).assert_done();
        let confidences = image::open(&picture).expect("the picture").into_luma8();
        let expected: Vec<bool> = confidences.pixels().map(|pixel| f64::from(pixel.0[0]) >= (255.0_f64 * 0.8).round()).collect();
        let kept = capture.disparities(&format!("--method {method} --min-confidence 0.8"));
        assert_eq!(kept.pixels().iter().map(|d| d.is_finite()).collect::<Vec<_>>(), expected, "{method}");
    }
}

/// The limits of distance, precision and place: each keeps what it should, and nothing else.
#[test]
fn limits_keep_what_is_within_them() {
    let capture = Capture::new();
    let [depth, sigma] = ["z.pfm", "s.pfm"].map(|name| capture.path(name));
    let read = |path: &str| multiscopic::files::read_pfm(Path::new(path)).expect("a map");
    let all = capture.disparities(&format!("--depth {depth} --sigma {sigma}"));
    let [depth, sigma] = [depth, sigma].map(|path| read(&path));
    let middle = |map: &FloatImage| {
        let mut known: Vec<f32> = map.pixels().iter().copied().filter(|value| value.is_finite()).collect();
        known.sort_by(f32::total_cmp);
        known[known.len() / 2]
    };
    // Beside the values, of which many pixels may have the same.
    let (far, most) = (1000.1 * middle(&depth), 1.0001 * middle(&sigma));
    let within: [(String, &dyn Fn(usize) -> bool); 4] = [
        (format!("--depth-range 0,{far}"), &|at| 1000.0 * depth.pixels()[at] <= far),
        (format!("--max-sigma {most}"), &|at| sigma.pixels()[at] <= most),
        ("--region 10,20,30,40".into(), &|at| (10..40).contains(&(at % 96)) && (20..60).contains(&(at / 96))),
        ("--region 90,60,1000,1000".into(), &|at| at % 96 >= 90 && at / 96 >= 60),
    ];
    for (limit, is_within) in within {
        let kept = capture.disparities(&limit);
        // A value at a limit may round to either side of it.
        let wrong = (0..96 * 72).filter(|&at| all.pixels()[at].is_finite() && kept.pixels()[at].is_finite() != is_within(at));
        assert!(wrong.count() <= 1, "{limit}");
        assert!(kept.pixels().iter().zip(all.pixels()).all(|(kept, d)| kept.is_infinite() || kept == d), "{limit}");
        assert!((1..count(&all)).contains(&count(&kept)), "{limit}: {} of {}", count(&kept), count(&all));
    }
    let points = |options: &str| {
        let cloud = capture.path("p.ply");
        capture.matched(&format!("--ply {cloud} {options}")).assert_done();
        let bytes = std::fs::read(&cloud).expect("a cloud");
        let header = String::from_utf8_lossy(&bytes[..200]).into_owned();
        let count = header.lines().find_map(|line| line.strip_prefix("element vertex ")).expect("a number of points");
        count.parse::<usize>().expect("a number")
    };
    assert!(points("") < points("--edges keep"), "points between surfaces are dropped");
    for (options, parts) in [
        ("--region 96,0,5,5", ["--region", "96x72"]),
        ("--region 1,2,0,5", ["--region", "100,50,320,240"]),
        ("--depth-range 750,450", ["--depth-range", "450,750"]),
        ("--max-sigma 0", ["--max-sigma", "above 0"]),
        ("--edges blur", ["--edges", "keep"]),
    ] {
        capture.matched(options).assert_refused(&parts);
    }
}

/// Specks that the least confidence leaves alone are speckles, too.
#[test]
fn speckles_are_removed_from_what_is_sure() {
    let capture = Capture::new();
    let [sure, clean] =
        ["", "--speckle-window-size 40"].map(|filter| capture.disparities(&format!("--min-confidence 0.8 {filter}")));
    let mut seen = vec![false; 96 * 72];
    let mut smallest = usize::MAX;
    for start in (0..96 * 72).filter(|&at| clean.pixels()[at].is_finite()) {
        let (mut size, mut open) = (0, vec![start]);
        while let Some(at) = open.pop() {
            if std::mem::replace(&mut seen[at], true) {
                continue;
            }
            size += 1;
            let (u, v) = (at % 96, at / 96);
            let near = [(u > 0, 1), (v > 0, 96)].into_iter().filter(|(is_there, _)| *is_there).map(|(_, step)| at - step);
            let near =
                near.chain([(u < 95, 1), (v < 71, 96)].into_iter().filter(|(is_there, _)| *is_there).map(|(_, step)| at + step));
            open.extend(near.filter(|&next| (clean.pixels()[next] - clean.pixels()[at]).abs() <= 1.0));
        }
        smallest = smallest.min(if size > 0 { size } else { usize::MAX });
    }
    assert!(smallest > 40, "a patch of {smallest} pixels is left");
    assert!((1..count(&sure)).contains(&count(&clean)));
}

#[test]
fn what_has_no_effect_is_refused() {
    let capture = Capture::new();
    capture.matched("--method sgm --block-size 3").assert_refused(&["--block-size", "sgm", "--cost sad"]);
    capture.matched("--method sgm --speckle-range 2").assert_refused(&["--speckle-window-size"]);
    capture.matched("--uniqueness-ratio 101").assert_refused(&["--uniqueness-ratio", "101"]);
    capture.matched("--sub-pixel newton").assert_refused(&["--sub-pixel", "newton", "lucas-kanade"]);
    capture.matched("--min-confidence 1.5").assert_refused(&["--min-confidence", "1.5"]);
    assert!(capture.valid("--method sgm --block-size 3 --texture-threshold 60") > 0);
}
