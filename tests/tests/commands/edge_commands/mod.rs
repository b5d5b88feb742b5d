//! The commands around the firmware as users run them: `listen`, `simulate` and `budget`.

mod packet_streams;
mod simulations;
mod sweeps;

use std::{fs, path::Path, process::Command};

use multiscopic::Processor;
use multiscopic_core::{Fusion, Memory, kernel::Native};
use multiscopic_edge::{Matching, WholeLines, profile};
use multiscopic_tests::{
    program::{self, Invocation},
    test_images::{read_grey, read_pfm},
};
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().expect("a folder for the test")
}

/// The JSON that a command prints, without anything else.
#[track_caller]
fn json(run: &Invocation, code: i32) -> serde_json::Value {
    assert_eq!(run.code, Some(code), "{run:#?}");
    serde_json::from_str(&run.stdout).unwrap_or_else(|error| panic!("{error}: {run:#?}"))
}

/// The confidences in a picture.
fn confidences(path: &str) -> Vec<u8> {
    read_grey(Path::new(path)).2
}

#[test]
#[cfg_attr(debug_assertions, ignore = "takes a minute without optimisation")]
fn the_commands_of_the_guides_run() {
    let dir = folder();
    let run = |words: &[&str]| {
        let output = Command::new(program::binary()).args(words).current_dir(dir.path()).output().expect("the command line runs");
        assert_eq!(output.status.code(), Some(0), "{words:?}: {output:?}");
    };
    run(&["demo", "-o", "out/demo", "--width", "180", "--height", "130", "--num-disparities", "1"]);
    let guides = [
        include_str!("../../../../README.md"),
        include_str!("../../../../docs/firmware.md"),
        include_str!("../../../../docs/first-map.md"),
    ];
    let commands = || guides.iter().flat_map(|guide| guide.lines()).filter_map(|line| line.strip_prefix("multiscopic "));
    for name in ["demo --width", "match out/demo", "budget", "simulate", "listen"] {
        assert!(commands().any(|command| command.starts_with(name)), "the guides have no line for {name}");
        for command in commands().filter(|command| command.starts_with(name)) {
            run(&command.split(' ').collect::<Vec<_>>());
        }
    }
    assert_eq!(read_pfm(&dir.path().join("received.pfm")).0, 160);
}

/// Runs `budget` with options.
fn budget(options: &[&str]) -> Invocation {
    Invocation::new(["budget", "--json"].iter().chain(options))
}

#[test]
fn what_is_not_predicted_is_not_printed() {
    for (profile, fusion) in [(profile::QVGA_SGM, "half")] {
        let options = ["--profile", profile.name, "--fusion", fusion];
        let report = json(&budget(&options), 0);
        for name in ["instructions", "instructions_per_de", "seconds", "fps", "joules"] {
            assert!(report[name].is_null(), "{name} of {}: {report:#}", profile.name);
        }
        let text = Invocation::new(["budget"].iter().chain(&options));
        assert!(text.stdout.contains("instructions, time and energy are not predicted for this match"), "{text:#?}");
        let checked = ["budget", "--fps", "1"];
        Invocation::new(checked.iter().chain(&options)).assert_refused(&["--fps cannot be checked", "not predicted"]);
    }
}

#[test]
fn a_header_for_c_has_the_match() {
    let dir = folder();
    let path = dir.path().join("depth.h");
    let header = |options: &[&str]| {
        let run = Invocation::new(["budget", "--header", path.to_str().expect("a name")].iter().chain(options));
        assert_eq!(run.code, Some(0), "{run:#?}");
        fs::read_to_string(&path).expect("the header")
    };
    // Programs in C that the firmware's tests run have it.
    assert_eq!(header(&["--profile", "qqvga"]), include_str!("../../../../edge/c/examples/depth.h"));
    let large = header(&["--width", "80", "--height", "60", "--views", "4", "--block-size", "17", "--tile-width", "20"]);
    assert!(large.contains("DEPTH_METHOD multiscopic_bm\n") && large.contains("DEPTH_COLUMNS 20 "), "{large}");
    let confidence = header(&["--profile", "qqvga-sgm-confidence"]);
    assert!(confidence.contains("DEPTH_METHOD multiscopic_sgm2_confidence\n"), "{confidence}");
    let refused = ["budget", "--profile", "qqvga-net", "--header", "depth.h"];
    Invocation::new(refused).assert_refused(&["--header", "neither the network"]);
}

#[test]
fn a_budget_states_what_is_searched_around_a_prior() {
    let text = Invocation::new(["budget", "--profile", "qvga-prior"]).stdout;
    assert!(text.contains("around them in views -4,0 and 4,0: disparities -4..=3, block 11"), "{text}");
}

#[test]
fn a_budget_has_the_bytes_of_the_matcher_and_of_the_firmware() {
    for profile in profile::ALL {
        let report = json(&budget(&["--profile", profile.name]), 0);
        let matching = profile.matching(Fusion::Min);
        let memory = match matching {
            Matching::Blocks { params, tile_width } => Memory::new::<Native>(&params, tile_width),
            Matching::SemiGlobal(params) => Memory::semi_global::<Native>(&params),
            Matching::WithConfidences(WholeLines::Blocks(params)) => Memory::new::<Native>(&params, params.width()),
            Matching::WithConfidences(WholeLines::SemiGlobal(params)) => Memory::semi_global::<Native>(&params),
            Matching::Network(params) => params.memory::<Native>().of_matcher(),
            Matching::AroundPrior { short, long } => {
                let long = Memory::new::<Native>(&long.around(short.search()), 320);
                Memory::new::<Native>(&short, 320).plus(&long)
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
        assert_eq!(bytes("ram_static"), profile.lengths().bytes() as u64 + runtime, "{}", profile.name);
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
        let Some(cycles) = cycles else {
            let text = Invocation::new(["budget", "--profile", "qvga-tiled", "--core", core]);
            assert!(text.stdout.contains(&format!("no cycles per instruction are known for {core}")), "{text:#?}");
            budget(&["--profile", "qvga-tiled", "--core", core, "--fps", "1"]).assert_refused(&["--fps", core, "--cpi"]);
            continue;
        };
        let report = json(&budget(&["--profile", "qvga", "--core", core]), 0);
        assert_eq!((&report["clock_mhz"], &report["cycles_per_instruction"]), (&clock.into(), &cycles.into()), "{core}");
        let text = Invocation::new(["budget", "--profile", "qvga", "--core", core]);
        assert!(text.stdout.contains(&format!("at {clock} MHz and {cycles} cycles per instruction")), "{text:#?}");
    }
}

#[test]
fn energy_is_cycles_by_the_energy_of_one() {
    let options = ["--profile", "qvga", "--cpi", "1.5", "--nanojoules-per-cycle", "2"];
    let report = json(&budget(&options), 0);
    let joules = report["joules"].as_f64().expect("a number");
    let expected = report["instructions"].as_f64().expect("a number") * 1.5 * 2e-9;
    assert!((joules / expected - 1.0).abs() < 1e-9, "{report:#}");
    let text = Invocation::new(["budget"].iter().chain(&options));
    assert!(text.stdout.contains(&format!("{:.3}  mJ a frame at 2 nJ a cycle", 1e3 * joules)), "{text:#?}");
    json(&budget(&[&options[..], &["--joules", &(1.01 * joules).to_string()]].concat()), 0);
    let spent = budget(&[&options[..], &["--joules", &(joules / 2.0).to_string()]].concat());
    json(&spent, 1);
    assert!(spent.stderr.contains("2.00 times as frugal"), "{spent:#?}");
    for processor in Processor::ALL {
        let options = ["--profile", "qvga-tiled", "--core", processor.name()];
        let report = json(&budget(&options), 0);
        assert_eq!(report["nanojoules_per_cycle"].as_f64(), processor.nanojoules_per_cycle());
        let text = Invocation::new(["budget"].iter().chain(&options));
        let is_unknown = text.stdout.contains("no energy per cycle is known");
        assert_eq!(is_unknown, processor.nanojoules_per_cycle().is_none(), "{text:#?}");
    }
    budget(&["--profile", "qvga", "--core", "cortex-m55", "--joules", "1"]).assert_refused(&[
        "--joules cannot be checked",
        "cortex-m55",
        "--nanojoules-per-cycle",
    ]);
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
