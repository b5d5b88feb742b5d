//! `tune`: the clients of its server, hostile ones among them, its answers, and the code that its page gives. `tuned` has the code
//! for some settings, compiled and run.

#![cfg(unix)]

mod hostile_clients;
mod page_server;
#[rustfmt::skip]
mod tuned;

use std::{env, fs, path::Path};

use multiscopic::{DisparityMap, Frames, Result, Rig};
use multiscopic_tests::program::{Invocation, make};
use page_server::PageServer;
use serde_json::{Value, json};

/// A rig of a made-up scene.
fn rig(folder: &Path) -> String {
    rig_of(folder, "160x120")
}

fn rig_of(folder: &Path, size: &str) -> String {
    let scenes = folder.join("rig");
    make(&format!("scene --random --seed 3 --size {size} --views 4"), &scenes);
    scenes.join("0000").to_str().unwrap().to_owned()
}

#[test]
fn signals_end_the_server_with_their_codes() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig(dir.path());
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let server = PageServer::start(&["tune", &rig]);
        let mut socket = server.socket();
        socket.notice("result", |_| true);
        assert_eq!(server.end(signal), Some(code));
        assert!(socket.is_closed_by_server());
    }
}

#[test]
fn a_slow_match_is_given_up_for_the_next_one() {
    let dir = tempfile::tempdir().unwrap();
    let server = PageServer::start(&["tune", &rig(dir.path())]);
    let mut socket = server.socket();
    socket.notice("result", |_| true);
    let slow = json!({ "method": "gc", "num-disparities": "120", "min-disparity": "-60" });
    socket.ask(slow.clone());
    socket.notice("progress", |_| true);
    let quick = json!({ "method": "bm", "num-disparities": "20" });
    socket.ask(quick.clone());
    let result = socket.notice("result", |_| true);
    assert_eq!(result["settings"], quick, "the graph cuts were given up");
}

#[test]
fn wrong_rigs_and_addresses_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().to_str().unwrap();
    Invocation::new(["tune", empty]).assert_refused(&["rig.toml"]);
    Invocation::new(["live"]).assert_refused(&["--camera", "RIG_DIR"]);
    Invocation::new(["live", empty, "--camera", "sim"]).assert_refused(&["cannot be used with"]);
    let rig = rig(dir.path());
    Invocation::new(["live", &rig, "--listen", "192.0.2.1:80"]).assert_refused(&["cannot listen on 192.0.2.1:80"]);
}

/// The code in a module of `tuned`.
fn code_of(module: &str) -> &'static str {
    let (_, rest) = include_str!("tuned.rs").split_once(&format!("pub mod {module} {{\n")).expect("a module");
    &rest[..rest.find("\n}\n}\n").expect("the end of a module") + "\n}\n".len()]
}

/// Settings, the module with the code that is expected for them, and this code compiled.
type Case = (Value, &'static str, fn(&Frames) -> Result<DisparityMap>);

fn cases() -> [Case; 4] {
    [
        (
            json!({
                "method": "bm", "fusion": "mean", "min-disparity": "-2", "num-disparities": "40", "block-size": "9",
                "uniqueness-ratio": "5", "disp12-max-diff": "2", "texture-threshold": "100", "median": "5",
                "speckle-window-size": "30", "speckle-range": "2", "sub-pixel": "lucas-kanade", "min-confidence": "0.3",
            }),
            "blocks",
            tuned::blocks::disparities,
        ),
        (
            json!({ "method": "sgm", "num-disparities": "40", "cost": "census2", "census": "7x7", "p1": "5", "p2": "30",
                "p2-edge": "12", "paths": "8", "smooth": "" }),
            "paths",
            tuned::paths::disparities,
        ),
        (
            json!({ "method": "gc", "num-disparities": "16", "block-size": "7", "occlusion-cost": "12", "lambda1": "4",
                "smoothness": "potts", "sweeps": "2" }),
            "cuts",
            tuned::cuts::disparities,
        ),
        (json!({ "method": "net", "num-disparities": "40", "fill": "background" }), "network", tuned::network::disparities),
    ]
}

/// With `MULTISCOPIC_BLESS` set, `tuned` is written anew.
#[test]
fn the_code_on_the_page_computes_what_the_command_computes() {
    let dir = tempfile::tempdir().unwrap();
    // Small, since it is matched without optimisation, too.
    let folder = rig_of(dir.path(), "80x60");
    let rig = Rig::load(Path::new(&folder)).unwrap();
    let (frames, _) = Frames::load(&rig.images.within(Path::new(&folder))).unwrap();
    let server = PageServer::start(&["tune", &folder]);
    let mut socket = server.page();
    for (settings, module, disparities) in cases() {
        let code = code_of(module);
        socket.ask(settings.clone());
        let plan = socket.notice("plan", |contents| contents["settings"] == settings);
        let given = plan["rust"].as_str().unwrap();
        if env::var_os("MULTISCOPIC_BLESS").is_some() {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/commands/live_view/tuned.rs");
            let tuned = fs::read_to_string(&path).unwrap();
            fs::write(&path, tuned.replace(code, given)).unwrap();
            continue;
        }
        assert_eq!(given, code, "{settings}");
        let output = dir.path().join("disparity.pfm");
        let command = plan["command"].as_str().unwrap();
        let words = command.split(' ').skip(1).map(|word| if word == "disparity.pfm" { output.to_str().unwrap() } else { word });
        Invocation::new(words).assert_done();
        let expected = DisparityMap::from_float(&multiscopic::files::read_pfm(&output).unwrap());
        assert!(disparities(&frames).unwrap() == expected, "{command}");
    }
}
