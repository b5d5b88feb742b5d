//! Temporary files and folders beside the output that they will become, and those that killed programs have left behind.
//!
//! A running program locks its temporary files and folders. The system releases the locks however the program ends, so what is
//! not locked belongs to none that runs.

use std::{
    collections::BTreeSet,
    ffi::OsString,
    fs::{self, DirEntry, File, Permissions, TryLockError},
    io, mem,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use tempfile::{Builder, NamedTempFile, TempDir};

/// The temporary files and folders that are there. Who holds the lock may make, rename and delete them.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// A temporary file or folder, which is deleted unless it gets its final name.
#[derive(Debug)]
pub struct Temporary<T> {
    // Deleted before it is no longer listed.
    inner: T,
    _listed: Listed,
    /// The file that keeps the lock of a folder. A file keeps its own.
    _folder: Option<File>,
}

/// Keeps a path in the list of what is unfinished.
#[derive(Debug)]
struct Listed(PathBuf);

impl Drop for Listed {
    fn drop(&mut self) {
        unfinished().remove(&self.0);
    }
}

impl Temporary<NamedTempFile> {
    /// A temporary file in the folder of `target`, so that it can be renamed to it.
    pub fn file_beside(target: &Path) -> io::Result<Temporary<NamedTempFile>> {
        let directory = directory_of(target);
        delete_in(directory);
        let make = || {
            let file = builder(0o666).tempfile_in(directory)?;
            Ok(lock(file.as_file(), file.path()).then_some((file, None)))
        };
        // The system's own message would name the temporary file, which means nothing to the user.
        listed(make, NamedTempFile::path).map_err(|error| {
            let message = format!("no file can be made in directory {}: {}", directory.display(), error.kind());
            io::Error::new(error.kind(), message)
        })
    }

    /// The file, to be written.
    pub fn file(&mut self) -> &mut File {
        self.inner.as_file_mut()
    }
}

impl Temporary<TempDir> {
    /// A temporary folder in the folder of `target`, so that it can be renamed to it.
    pub fn folder_beside(target: &Path) -> io::Result<Temporary<TempDir>> {
        let directory = directory_of(target);
        delete_in(directory);
        let make = || {
            let folder = builder(0o777).tempdir_in(directory)?;
            if !cfg!(unix) {
                return Ok(Some((folder, None)));
            }
            let locked = lock_folder(folder.path())?;
            Ok(locked.map(|locked| (folder, Some(locked))))
        };
        listed(make, TempDir::path)
    }

    /// The folder, to be filled.
    pub fn path(&self) -> &Path {
        self.inner.path()
    }
}

/// A file or folder that is written, but does not have its final name yet.
#[derive(Debug)]
pub struct Complete {
    /// The output that is written.
    pub output: Written,
    /// Its final name.
    pub target: PathBuf,
}

/// The kinds of [`Complete`] output.
#[derive(Debug)]
pub enum Written {
    /// A file.
    File(Temporary<NamedTempFile>),
    /// A folder.
    Folder(Temporary<TempDir>),
}

impl Written {
    fn path(&self) -> &Path {
        match self {
            Written::File(file) => file.inner.path(),
            Written::Folder(folder) => folder.path(),
        }
    }

    /// Gives it its final name. What is returned takes the lock of the list when it is dropped.
    fn persist(self, target: &Path) -> (Listed, io::Result<()>) {
        match self {
            Written::File(Temporary { inner, _listed, .. }) => {
                (_listed, inner.persist(target).map(drop).map_err(|error| error.error))
            }
            Written::Folder(Temporary { inner, _listed, _folder }) => {
                let renamed = fs::rename(inner.path(), target);
                if renamed.is_ok() {
                    // There is nothing left to delete.
                    let _ = inner.keep();
                }
                (_listed, renamed)
            }
        }
    }
}

/// Gives outputs their final names, in their order. Nothing that [`abandon`]s them comes in between.
///
/// # Errors
/// The first that cannot be renamed, with its final name. Those after it are deleted.
pub fn persist_all(outputs: Vec<Complete>) -> Result<(), (PathBuf, io::Error)> {
    persist_sealed(outputs, None)
}

/// As [`persist_all`], but the `seal` comes last. While the others are renamed, it is not there, but under another name, which
/// [`broken_seal`] tells.
///
/// # Errors
/// As [`persist_all`]. The seal is then not put back.
pub fn persist_sealed(mut outputs: Vec<Complete>, seal: Option<&Path>) -> Result<(), (PathBuf, io::Error)> {
    let mut listed = Vec::with_capacity(outputs.len());
    let guard = unfinished();
    let broken = match seal {
        Some(seal) => {
            outputs.sort_by_key(|complete| complete.target == seal);
            break_seal(seal, outputs.last()).map_err(|error| (seal.into(), error))?;
            Some(broken_seal(seal))
        }
        None => None,
    };
    let mut outputs = outputs.into_iter();
    let renamed = outputs.try_for_each(|Complete { output, target }| {
        let (of_output, renamed) = output.persist(&target);
        listed.push(of_output);
        renamed.map_err(|error| (target, error))
    });
    if let Some(broken) = broken.filter(|_| renamed.is_ok()) {
        // Nobody reads it while there is a seal.
        let _ = fs::remove_file(broken);
    }
    // What is listed takes the lock when it is dropped, as do the outputs that are left.
    drop(guard);
    renamed
}

/// The name of a seal while what it seals is replaced.
pub fn broken_seal(seal: &Path) -> PathBuf {
    let mut name = OsString::from(PREFIX);
    name.push(seal.file_name().unwrap_or_default());
    seal.with_file_name(name)
}

/// Gives a seal that is there another name. If there is none, one is made of its new version.
fn break_seal(seal: &Path, new: Option<&Complete>) -> io::Result<()> {
    match fs::rename(seal, broken_seal(seal)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => match new {
            Some(Complete { output, .. }) => fs::copy(output.path(), broken_seal(seal)).map(drop),
            None => Ok(()),
        },
        renamed => renamed,
    }
}

/// Deletes all outputs that are not finished, and lets none be made or finished from now on: for a program that is about to
/// end.
///
/// Threads that write outputs wait until it has ended.
pub fn abandon() {
    let unfinished = unfinished();
    for path in &*unfinished {
        // It may be neither, or gone. There is nobody left to tell.
        let _ = fs::remove_file(path).or_else(|_| fs::remove_dir_all(path));
    }
    mem::forget(unfinished);
}

/// Makes a file or folder, and lists it. `make` returns `None` to be called again.
fn listed<T>(
    mut make: impl FnMut() -> io::Result<Option<(T, Option<File>)>>,
    path: impl FnOnce(&T) -> &Path,
) -> io::Result<Temporary<T>> {
    let mut unfinished = unfinished();
    let (inner, folder) = loop {
        if let Some(made) = make()? {
            break made;
        }
    };
    let listed = Listed(path(&inner).to_owned());
    unfinished.insert(listed.0.clone());
    Ok(Temporary { inner, _listed: listed, _folder: folder })
}

fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

fn directory_of(target: &Path) -> &Path {
    target.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

/// `tempfile` makes its files private. These become the user's own, so they get the usual `mode`, less the
/// umask.
#[cfg_attr(not(unix), expect(unused_variables, reason = "only Unix has modes"))]
fn builder(mode: u32) -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(PREFIX).rand_bytes(RANDOM_CHARACTERS);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(Permissions::from_mode(mode));
    }
    builder
}

/// The beginning of the names of temporary files and folders.
const PREFIX: &str = ".multiscopic-";
/// The number of letters and digits that follow.
const RANDOM_CHARACTERS: usize = 6;

/// Locks a temporary file or folder that was just made. False if another program was faster, took it for a leftover, and
/// deletes it.
fn lock(opened: &File, path: &Path) -> bool {
    match opened.try_lock() {
        Ok(()) => path.exists(),
        Err(TryLockError::WouldBlock) => false,
        // Where nothing can be locked, nothing is taken for a leftover either.
        Err(TryLockError::Error(_)) => true,
    }
}

/// As [`lock`], a temporary folder. `None` if another program is deleting it, or already has.
fn lock_folder(path: &Path) -> io::Result<Option<File>> {
    match File::open(path) {
        Ok(opened) => Ok(lock(&opened, path).then_some(opened)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// Deletes the leftovers in a directory, the first time that it is asked to. What cannot be deleted stays.
fn delete_in(directory: &Path) {
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
