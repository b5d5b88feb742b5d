//! What the targets share.

mod small_match;
#[cfg(not(feature = "libfuzzer"))]
mod standalone;

use std::{fs, path::PathBuf, sync::OnceLock};

use tempfile::TempDir;

pub use small_match::SmallMatch;

/// A folder of this process. libFuzzer ends it without running destructors, so one such folder stays behind.
fn folder() -> &'static TempDir {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER.get_or_init(|| tempfile::tempdir().expect("a temporary folder"))
}

/// Writes a file with this name and these contents, for readers that take a path. The next one of this name replaces it.
pub fn file(name: &str, contents: &[u8]) -> PathBuf {
    let path = folder().path().join(name);
    fs::write(&path, contents).expect("a temporary file");
    path
}

/// Panics with the first place where `found` is not what was `expected`.
pub fn assert_same<T: PartialEq + std::fmt::Debug>(found: &[T], expected: &[T], what: &str) {
    if let Some(place) = (0..expected.len()).find(|&place| found.get(place) != Some(&expected[place])) {
        panic!("{what}, pixel {place}: found {:?}, expected {:?}", found.get(place), expected[place]);
    }
    assert_eq!(found.len(), expected.len(), "{what}: pixels");
}
