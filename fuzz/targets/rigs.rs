//! `rig.toml`, and the other TOML files of a rig.

#![no_main]

use libfuzzer_sys::fuzz_target;
use multiscopic::{Rig, capture::Imperfections, lens::Mount};
use multiscopic_fuzz::file;

fuzz_target!(|bytes: &[u8]| {
    let path = file(Rig::FILE_NAME, bytes);
    let _ = Mount::read(&path);
    let _ = Imperfections::read(&path);
    if let Ok(rig) = Rig::load(path.parent().expect("a folder")) {
        // What was read can be used.
        let _ = (rig.geometry([640, 480]), rig.principal_point([640, 480]), rig.images.views());
    }
});
