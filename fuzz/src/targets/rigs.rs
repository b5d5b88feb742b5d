//! `rig.toml`, and the other TOML files of a rig.

use multiscopic::{Rig, capture::Imperfections, lens::Mount};

use crate::support::file;

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let path = file(Rig::FILE_NAME, bytes);
    let _ = Mount::read(&path);
    let _ = Imperfections::read(&path);
    if let Ok(rig) = Rig::load(path.parent().expect("a folder")) {
        // What was read can be used.
        let _ = (rig.geometry([640, 480]), rig.principal_point([640, 480]), rig.images.views());
    }
    true
}
