//! The published weights of MC-CNN.

use std::{
    env,
    path::{Path, PathBuf},
};

use crate::reference::networks::file_name;

/// The folder of the weights: `$MULTISCOPIC_WEIGHTS`, the cache of `multiscopic weights install`, or
/// `../shared/weights` beside the repository, whichever has them first; `None` if none has.
pub fn weights() -> Option<PathBuf> {
    let given = env::var_os("MULTISCOPIC_WEIGHTS").map(PathBuf::from);
    let cache =
        env::var_os("XDG_CACHE_HOME").map(PathBuf::from).or_else(|| Some(Path::new(&env::var_os("HOME")?).join(".cache")));
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/weights");
    let folders = [given, cache.map(|cache| cache.join("multiscopic")), Some(beside)];
    let is_complete = |folder: &PathBuf| ["fast", "accurate"].iter().all(|name| folder.join(file_name(name)).is_file());
    folders.into_iter().flatten().find(is_complete)
}

/// The wheel of the Python package, given by `$MULTISCOPIC_MCCNN_WHEEL`.
pub fn wheel() -> Option<PathBuf> {
    env::var_os("MULTISCOPIC_MCCNN_WHEEL").map(PathBuf::from)
}
