//! Made-up captures, each rendered once.

use std::{
    collections::HashMap,
    fs,
    path::{Path, PathBuf},
    sync::{Arc, LazyLock, Mutex, OnceLock},
};

use crate::program::Invocation;

/// Files by their paths in a folder.
type Files = Vec<(PathBuf, Vec<u8>)>;

/// The files that commands have made.
static MADE: LazyLock<Mutex<HashMap<String, Arc<OnceLock<Files>>>>> = LazyLock::new(Mutex::default);

/// Makes `folder`, with all that `multiscopic COMMAND -o folder` writes to it. Each command runs once: later, copies are written.
///
/// # Panics
/// If the command does not succeed.
pub fn make(command: &str, folder: &Path) {
    let made = MADE.lock().expect("no other thread panics here").entry(command.to_owned()).or_default().clone();
    for (path, contents) in made.get_or_init(|| run(command)) {
        let path = folder.join(path);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder is made");
        fs::write(path, contents).expect("a file is written");
    }
}

/// The files that a command writes.
fn run(command: &str) -> Files {
    let folder = tempfile::tempdir().expect("a folder for a command");
    let output = folder.path().join("made");
    let arguments = command.split(' ').chain(["-o", output.to_str().expect("a path in UTF-8")]);
    let run = Invocation::new(arguments);
    assert_eq!(run.code, Some(0), "{command}: {run:#?}");
    let (mut files, mut folders) = (Files::new(), vec![output.clone()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            match path.is_dir() {
                true => folders.push(path),
                false => {
                    let contents = fs::read(&path).expect("a file");
                    files.push((path.strip_prefix(&output).expect("a path within").to_owned(), contents));
                }
            }
        }
    }
    files
}
