//! Files that killed programs have left behind.
//!
//! A running program locks its temporary files and folders. The system releases the locks however the program ends, so what is
//! not locked belongs to none that runs.

use std::{
    collections::BTreeSet,
    fs::{self, DirEntry, File, TryLockError},
    io,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

/// The beginning of the names of temporary files and folders.
pub const PREFIX: &str = ".multiscopic-";
/// The number of letters and digits that follow.
pub const RANDOM_CHARACTERS: usize = 6;

/// Locks a temporary file or folder that was just made. False if another program was faster, took it for a leftover, and
/// deletes it.
pub fn lock(opened: &File, path: &Path) -> bool {
    match opened.try_lock() {
        Ok(()) => path.exists(),
        Err(TryLockError::WouldBlock) => false,
        // Where nothing can be locked, nothing is taken for a leftover either.
        Err(TryLockError::Error(_)) => true,
    }
}

/// As [`lock`], a temporary folder. `None` if another program is deleting it, or already has.
pub fn lock_folder(path: &Path) -> io::Result<Option<File>> {
    match File::open(path) {
        Ok(opened) => Ok(lock(&opened, path).then_some(opened)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// Deletes the leftovers in a directory, the first time that it is asked to. What cannot be deleted stays.
pub fn delete_in(directory: &Path) {
    static SEEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let is_first = SEEN.lock().unwrap_or_else(PoisonError::into_inner).insert(directory.into());
    if is_first && let Ok(entries) = fs::read_dir(directory) {
        entries.flatten().filter(is_temporary).for_each(|entry| delete(&entry));
    }
}

fn is_temporary(entry: &DirEntry) -> bool {
    let name = entry.file_name();
    let random = name.to_str().and_then(|name| name.strip_prefix(PREFIX));
    random.is_some_and(|random| random.len() == RANDOM_CHARACTERS && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

fn delete(entry: &DirEntry) {
    let path = entry.path();
    // The lock is kept until it is deleted, so that no other program takes it for its own meanwhile.
    let locked = |opened: File| opened.try_lock().is_ok().then_some(opened);
    match entry.file_type() {
        Ok(kind) if kind.is_file() => {
            if let Some(_lock) = File::options().read(true).write(true).open(&path).ok().and_then(locked) {
                let _ = fs::remove_file(&path);
            }
        }
        // Elsewhere, folders cannot be locked.
        Ok(kind) if kind.is_dir() && cfg!(unix) => {
            if let Some(_lock) = File::open(&path).ok().and_then(locked) {
                let _ = fs::remove_dir_all(&path);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_nobody_has_locked_is_deleted() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        for name in
            [".multiscopic-aBc123", ".multiscopic-locked", ".multiscopic-rig.toml", "multiscopic-aBc123", ".multiscopic-12345"]
        {
            fs::write(path(name), "text").unwrap();
        }
        let running = File::open(path(".multiscopic-locked")).unwrap();
        assert!(lock(&running, &path(".multiscopic-locked")));
        fs::create_dir(path(".multiscopic-000000")).unwrap();
        fs::write(path(".multiscopic-000000/center.png"), "half").unwrap();
        delete_in(dir.path());
        let mut names: Vec<_> =
            fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        let mut kept = vec![".multiscopic-12345", ".multiscopic-locked", ".multiscopic-rig.toml", "multiscopic-aBc123"];
        if !cfg!(unix) {
            kept.insert(0, ".multiscopic-000000");
        }
        assert_eq!(names, kept);
        // What another program is about to delete is not used.
        let again = File::open(path(".multiscopic-locked")).unwrap();
        assert!(!lock(&again, &path(".multiscopic-locked")));
        drop(running);
        fs::remove_file(path(".multiscopic-locked")).unwrap();
        assert!(!lock(&again, &path(".multiscopic-locked")));
    }

    #[test]
    #[cfg(unix)]
    fn a_folder_that_another_program_deletes_is_not_used() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join(".multiscopic-000000");
        fs::create_dir(&folder).unwrap();
        let other = File::open(&folder).unwrap();
        assert!(lock(&other, &folder));
        assert!(lock_folder(&folder).unwrap().is_none(), "it is being deleted");
        fs::remove_dir(&folder).unwrap();
        assert!(lock_folder(&folder).unwrap().is_none(), "it is gone");
        fs::create_dir(&folder).unwrap();
        assert!(lock_folder(&folder).unwrap().is_some());
    }
}
