//! The workspace's folders.

use std::{
    env,
    path::{Path, PathBuf},
};

/// The workspace's root folder.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests are a folder of the workspace")
}

/// The folder of build results.
pub fn target() -> PathBuf {
    root().join(env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

/// The folder of firmware builds, which is separate because another toolchain may build it.
pub fn edge_target() -> PathBuf {
    target().join("edge")
}

/// The set of frames that firmware has in flash.
pub fn flash_set() -> PathBuf {
    edge_target().join("flash-set")
}
