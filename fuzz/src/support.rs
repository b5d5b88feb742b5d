//! Files that hold an input, and comparisons.

use std::{collections::BTreeMap, fs::File, os::unix::fs::FileExt, path::PathBuf, sync::Mutex};

use multiscopic::{Simd, stereo::Task};
use multiscopic_core::kernel::Portable;
use tempfile::TempDir;

/// Files of this process, by their names. They stay open: to make one again takes longer than most readers do.
///
/// libFuzzer ends the process without running destructors, so one folder stays behind.
struct Files {
    folder: TempDir,
    open: BTreeMap<&'static str, File>,
}

/// Writes a file with this name and these contents, for readers that take a path. The next one of this name replaces it.
pub fn file(name: &'static str, contents: &[u8]) -> PathBuf {
    static FILES: Mutex<Option<Files>> = Mutex::new(None);
    let files = &mut *FILES.lock().expect("no failure before");
    let new = || Files { folder: tempfile::tempdir().expect("a temporary folder"), open: BTreeMap::new() };
    let Files { folder, open } = files.get_or_insert_with(new);
    let path = folder.path().join(name);
    let file = open.entry(name).or_insert_with(|| File::create(&path).expect("a temporary file"));
    file.set_len(contents.len() as u64).and_then(|()| file.write_all_at(contents, 0)).expect("a temporary file");
    path
}

/// Runs a task with every instruction set of this processor, and with vectors of four lanes in plain Rust: the results by name.
pub fn with_every_kernel<T: Task>(task: impl Fn() -> T) -> impl Iterator<Item = (String, T::Output)> {
    let four_lanes = ("4 lanes".into(), task().run(Portable::<4>));
    Simd::available().into_iter().map(move |simd| (simd.to_string(), simd.run(task()))).chain([four_lanes])
}

/// Panics with the first place where `found` is not what was `expected`.
pub fn assert_same<T: PartialEq + std::fmt::Debug>(found: &[T], expected: &[T], what: &str) {
    if let Some(place) = (0..expected.len()).find(|&place| found.get(place) != Some(&expected[place])) {
        panic!("{what}, pixel {place}: found {:?}, expected {:?}", found.get(place), expected[place]);
    }
    assert_eq!(found.len(), expected.len(), "{what}: pixels");
}
