//! Writing files and folders as a whole: an output is complete, or it is not there.

mod temporary;

use std::{
    cell::RefCell,
    fs::{self, File, Permissions},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use serde::Serialize;

use crate::error::{Error, Result};

use temporary::{Complete, Temporary, Written, persist_all, persist_sealed};

pub use temporary::{abandon, broken_seal};

/// Writes the file `path`; `contents` writes its data.
///
/// The data goes to a temporary file in the same folder, which replaces `path` only when it is complete. If
/// anything fails, `path` is unchanged. Symbolic links are followed, and an existing file keeps its
/// permissions. A pipe, a device or an open file (`/dev/stdout`) is written directly; a reader that closes
/// its pipe early (`| head`) is not an error.
///
/// # Errors
/// [`Error::Write`] with the error of the system or of `contents`.
pub fn write(path: &Path, contents: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let written = Destination::of(path).and_then(|destination| match destination {
        Destination::Stream => match append(path, contents) {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            written => written,
        },
        Destination::File { path, permissions } => replace(&path, permissions, contents),
    });
    written.map_err(|source| Error::Write { path: path.into(), source })
}

/// Writes `value` to `path`. Any previous version of the file is unchanged if this fails.
pub(crate) fn write_toml(path: &Path, value: &impl Serialize) -> Result<()> {
    // This fails only for a path that is not Unicode.
    let text = toml::to_string(value).map_err(|error| Error::format(path, error.to_string(), "file names in UTF-8"))?;
    write(path, |writer| writer.write_all(text.as_bytes()))
}

/// Writes several outputs as one: all that `contents` [writes](write()) on this thread, files and
/// [folders](write_folder()), or none if it fails. Pipes and devices are written directly.
///
/// # Errors
/// Those of `contents`, or [`Error::Write`] if a complete output cannot get its final name.
pub fn write_together<T>(contents: impl FnOnce() -> Result<T>) -> Result<T> {
    let (complete, written) = collect(contents)?;
    persist_all(complete).map_err(|(path, source)| Error::Write { path, source })?;
    Ok(written)
}

/// As [`write_together`], for files in a folder that one of them, the `seal`, makes look complete. It is not there while the
/// others are replaced, so that a program that is killed meanwhile leaves nothing that looks complete.
/// [`broken_seal`] is the name that it then has.
///
/// # Errors
/// Those of [`write_together`].
pub fn replace_together<T>(seal: &Path, contents: impl FnOnce() -> Result<T>) -> Result<T> {
    let (complete, written) = collect(contents)?;
    let failed = |source| Error::Write { path: seal.into(), source };
    let seal = match Destination::of(seal).map_err(failed)? {
        Destination::File { path, .. } => path,
        Destination::Stream => seal.into(),
    };
    persist_sealed(complete, Some(&seal)).map_err(|(path, source)| Error::Write { path, source })?;
    Ok(written)
}

/// Collects what `contents` writes, still without final names.
fn collect<T>(contents: impl FnOnce() -> Result<T>) -> Result<(Vec<Complete>, T)> {
    let before = COMPLETE.replace(Some(Vec::new()));
    let written = contents();
    let complete = COMPLETE.replace(before).unwrap_or_default();
    Ok((complete, written?))
}

/// Runs `contents`, whose files get their final names at once, within [`write_together`] too.
fn apart<T>(contents: impl FnOnce() -> T) -> T {
    let before = COMPLETE.replace(None);
    let written = contents();
    COMPLETE.set(before);
    written
}

/// Gives a complete output its final name, now or together with others.
fn finish(complete: Complete) -> io::Result<()> {
    let alone = COMPLETE.with_borrow_mut(|waiting| match waiting {
        Some(waiting) => {
            waiting.push(complete);
            None
        }
        None => Some(complete),
    });
    persist_all(alone.into_iter().collect()).map_err(|(_, error)| error)
}

thread_local! {
    /// The complete outputs of this thread that wait for the others.
    static COMPLETE: RefCell<Option<Vec<Complete>>> = const { RefCell::new(None) };
}

/// Opens for appending, so that the shell's `>>` keeps what is in the file.
fn append(path: &Path, contents: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    fill(&mut File::options().append(true).open(path)?, contents)
}

fn replace(
    target: &Path,
    permissions: Option<Permissions>,
    contents: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let mut temporary = Temporary::file_beside(target)?;
    fill(temporary.file(), contents)?;
    if let Some(permissions) = permissions {
        temporary.file().set_permissions(permissions)?;
    }
    finish(Complete { output: Written::File(temporary), target: target.to_owned() })
}

fn fill(file: &mut File, contents: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut writer = BufWriter::new(file);
    contents(&mut writer)?;
    writer.flush()
}

/// Makes the folder `path`; `contents` writes its files into the folder that it is given.
///
/// That is a temporary folder beside `path`, which is renamed to `path` only when it is complete. An
/// interrupted command therefore leaves nothing that looks like a result. An existing folder is never
/// replaced, unless it is empty.
///
/// # Errors
/// [`Error::FolderExists`] if `path` exists, the error of `contents`, or [`Error::Write`] with the error of the
/// system.
pub fn write_folder<T>(path: &Path, contents: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
    check_folder(path)?;
    let failed = |source| Error::Write { path: path.into(), source };
    let temporary = Temporary::folder_beside(path).map_err(failed)?;
    let written = apart(|| contents(temporary.path()))?;
    finish(Complete { output: Written::Folder(temporary), target: path.into() }).map_err(failed)?;
    Ok(written)
}

/// Checks that [`write_folder`] can make the folder `path`, before the work whose results it takes.
///
/// # Errors
/// [`Error::FolderExists`] if `path` exists, and [`Error::Write`] with the error of the system.
pub fn check_folder(path: &Path) -> Result<()> {
    let failed = |source| Error::Write { path: path.into(), source };
    let is_free = match fs::read_dir(path) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => false,
        Err(error) if error.kind() == io::ErrorKind::NotFound => true,
        Err(error) => return Err(failed(error)),
    };
    if !is_free {
        return Err(Error::FolderExists { path: path.to_path_buf() });
    }
    Temporary::file_beside(path).map(drop).map_err(failed)
}

/// The way in which an output is written.
enum Destination {
    /// A pipe, a device or an open file: written directly, as there is nothing to preserve.
    Stream,
    /// A regular file, new or existing: replaced as a whole, with the permissions of the existing one.
    File { path: PathBuf, permissions: Option<Permissions> },
}

impl Destination {
    /// Returns the destination for which `path` stands. Symbolic links are followed.
    fn of(path: &Path) -> io::Result<Destination> {
        match fs::metadata(path) {
            Ok(old) if old.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
            Ok(old) if !old.is_file() || is_open_file(path) => Ok(Destination::Stream),
            // Replacing a read-only file takes no more than write access to its folder, but its owner wants
            // it kept.
            Ok(old) if old.permissions().readonly() => Err(io::ErrorKind::PermissionDenied.into()),
            Ok(old) => Ok(Destination::File { path: fs::canonicalize(path)?, permissions: Some(old.permissions()) }),
            Err(_) => Ok(Destination::File { path: path.into(), permissions: None }),
        }
    }
}

/// Returns true if `path` names a file through one of this process's descriptors. Replacing that name would not
/// replace the file.
fn is_open_file(path: &Path) -> bool {
    ["/dev/stdout", "/dev/stderr", "/dev/fd", "/proc"].iter().any(|open| path.starts_with(open))
}

/// Checks, before the work whose results they take, that all `outputs` can be written, and that none is given
/// twice or is also one of the `inputs`.
///
/// # Errors
/// [`Error::Write`] as [`write`](write()) would return it, [`Error::SharedOutput`] for a file that is given
/// twice, and [`Error::OutputIsInput`].
pub fn check(outputs: &[&Path], inputs: &[&Path]) -> Result<()> {
    for (i, path) in outputs.iter().enumerate() {
        let is_same = |other: &&&Path| absolute(other) == absolute(path);
        if outputs[..i].iter().any(|other| is_same(&other)) {
            return Err(Error::SharedOutput { path: path.to_path_buf() });
        }
        if let Some(input) = inputs.iter().find(is_same) {
            return Err(Error::OutputIsInput { output: path.to_path_buf(), input: input.to_path_buf() });
        }
        let checked = Destination::of(path).and_then(|destination| match destination {
            // Opening a pipe could not be undone.
            Destination::Stream => Ok(()),
            Destination::File { path, .. } => Temporary::file_beside(&path).map(drop),
        });
        checked.map_err(|source| Error::Write { path: path.into(), source })?;
    }
    Ok(())
}

/// The absolute path of a file, whether it exists or not, with links and `..` resolved.
fn absolute(path: &Path) -> PathBuf {
    let in_its_folder = || {
        let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(in_its_folder).unwrap_or_else(|| path.into())
}

#[cfg(test)]
mod tests;
