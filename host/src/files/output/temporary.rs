//! Temporary files and folders beside the output that they will become.

use std::{
    collections::BTreeSet,
    fs::{self, File, Permissions},
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
        // The system's own message would name the temporary file, which means nothing to the user.
        listed(|| builder(0o666).tempfile_in(directory), NamedTempFile::path).map_err(|error| {
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
        listed(|| builder(0o777).tempdir_in(directory_of(target)), TempDir::path)
    }

    /// The folder, to be filled.
    pub fn path(&self) -> &Path {
        self.inner.path()
    }

    /// Gives the folder its final name.
    pub fn persist(self, target: &Path) -> io::Result<()> {
        let Temporary { inner, _listed } = self;
        let guard = unfinished();
        let renamed = fs::rename(inner.path(), target);
        if renamed.is_ok() {
            // There is nothing left to delete.
            let _ = inner.keep();
        }
        drop(guard);
        renamed
    }
}

/// A file that is written, but does not have its final name yet.
#[derive(Debug)]
pub struct Complete {
    /// The file.
    pub temporary: Temporary<NamedTempFile>,
    /// Its final name.
    pub target: PathBuf,
}

/// Gives files their final names. Nothing that [`abandon`]s them comes in between.
///
/// # Errors
/// The first that cannot be renamed, with its final name. Those after it are deleted.
pub fn persist_all(files: Vec<Complete>) -> Result<(), (PathBuf, io::Error)> {
    let mut listed = Vec::with_capacity(files.len());
    let guard = unfinished();
    let renamed = files.into_iter().try_for_each(|Complete { temporary, target }| {
        listed.push(temporary._listed);
        temporary.inner.persist(&target).map(drop).map_err(|error| (target, error.error))
    });
    // What is listed takes the lock when it is dropped.
    drop(guard);
    renamed
}

/// Deletes all outputs that are not finished, and lets none be made or finished from now on: for a program that is about to end.
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

/// Makes a file or folder, and lists it.
fn listed<T>(make: impl FnOnce() -> io::Result<T>, path: impl FnOnce(&T) -> &Path) -> io::Result<Temporary<T>> {
    let mut unfinished = unfinished();
    let inner = make()?;
    let listed = Listed(path(&inner).to_owned());
    unfinished.insert(listed.0.clone());
    Ok(Temporary { inner, _listed: listed })
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
    builder.prefix(".multiscopic-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(Permissions::from_mode(mode));
    }
    builder
}
