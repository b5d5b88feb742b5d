//! `tune`: who may talk to its server, what happens to those who may not, and what it says of a match.

#![cfg(unix)]

mod hostile_clients;
mod page_server;
mod rust_code;

use std::{path::Path, time::Instant};

use multiscopic_tests::program::Invocation;
use page_server::PageServer;
use serde_json::json;

/// A rig of a made-up scene.
fn rig(folder: &Path) -> String {
    let scenes = folder.join("rig").to_str().unwrap().to_owned();
    let size = ["--random", "--seed", "3", "--size", "160x120", "--views", "4"];
    Invocation::new(["scene"].into_iter().chain(size).chain(["-o", &scenes])).assert_done();
    scenes + "/0000"
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
    let start = Instant::now();
    socket.ask(slow.clone());
    socket.notice("progress", |_| true);
    let quick = json!({ "method": "bm", "num-disparities": "20" });
    socket.ask(quick.clone());
    let result = socket.notice("result", |_| true);
    assert_eq!(result["settings"], quick, "the graph cuts were given up after {:?}", start.elapsed());
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
