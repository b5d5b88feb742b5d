//! Temporary files and folders beside the output that they will become.

use std::{
    collections::BTreeSet,
    ffi::OsString,
    fs::{self, File, Permissions},
    io, mem,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use tempfile::{Builder, NamedTempFile, TempDir};

use super::leftovers;

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
        leftovers::delete_in(directory);
        let make = || {
            let file = builder(0o666).tempfile_in(directory)?;
            Ok(leftovers::lock(file.as_file(), file.path()).then_some((file, None)))
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
        leftovers::delete_in(directory);
        let make = || {
            let folder = builder(0o777).tempdir_in(directory)?;
            if !cfg!(unix) {
                return Ok(Some((folder, None)));
            }
            let locked = leftovers::lock_folder(folder.path())?;
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
    let mut name = OsString::from(leftovers::PREFIX);
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
    builder.prefix(leftovers::PREFIX).rand_bytes(leftovers::RANDOM_CHARACTERS);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(Permissions::from_mode(mode));
    }
    builder
}
