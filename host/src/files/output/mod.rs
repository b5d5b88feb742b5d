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
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_complete_file_replaces_the_old_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        for text in ["first", "2nd"] {
            write(&path, |w| w.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[test]
    fn a_failure_keeps_the_old_file_and_leaves_no_other() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        fs::write(&path, "old").unwrap();
        for target in [path.clone(), dir.path().join("b")] {
            let error = write(&target, |w| {
                w.write_all(&[0; 100_000])?;
                Err(io::Error::other("the disk is full"))
            });
            let message = error.unwrap_err().to_string();
            assert_eq!(message, format!("cannot write {}: the disk is full", target.display()));
        }
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[test]
    fn files_are_written_together_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| dir.path().join(name));
        let text = |path: &Path| write(path, |w| w.write_all(b"new"));
        let failed = write_together(|| {
            text(&a)?;
            assert_eq!(names(dir.path()).len(), 1, "a temporary file");
            write(&b, |_| Err(io::Error::other("the disk is full")))
        });
        assert!(matches!(failed, Err(Error::Write { path, .. }) if path == b));
        assert_eq!(names(dir.path()), [""; 0]);
        write_together(|| text(&a).and(text(&b))).unwrap();
        assert_eq!(names(dir.path()), ["a", "b"]);
        // Files that are written afterwards stand alone again.
        fs::remove_file(&a).unwrap();
        text(&a).unwrap();
        assert_eq!(names(dir.path()), ["a", "b"]);
    }

    #[test]
    fn the_seal_comes_last_and_is_not_there_before() {
        let dir = tempfile::tempdir().unwrap();
        let [seal, b] = ["seal", "b"].map(|name| dir.path().join(name));
        let text = |path: &Path, text: &'static str| write(path, |w| w.write_all(text.as_bytes()));
        let both = |new| replace_together(&seal, || text(&seal, new).and(text(&b, new)));
        both("1").unwrap();
        both("2").unwrap();
        assert_eq!((names(dir.path()), fs::read_to_string(&seal).unwrap()), (vec!["b".into(), "seal".into()], "2".into()));
        let failed = replace_together(&seal, || {
            text(&seal, "3")?;
            write(&b, |_| Err(io::Error::other("the disk is full")))
        });
        assert!(failed.is_err());
        assert_eq!((names(dir.path()), fs::read_to_string(&seal).unwrap()), (vec!["b".into(), "seal".into()], "2".into()));
        // Nothing can be renamed to a folder that is not empty: as if the program were killed there.
        fs::remove_file(&b).unwrap();
        let killed = replace_together(&seal, || {
            text(&seal, "4").and(text(&b, "4"))?;
            fs::create_dir_all(b.join("full")).unwrap();
            Ok(())
        });
        assert!(killed.is_err());
        assert_eq!(names(dir.path()), [".multiscopic-seal", "b"]);
        assert_eq!(fs::read_to_string(crate::files::output::broken_seal(&seal)).unwrap(), "2");
        fs::remove_dir_all(&b).unwrap();
        both("5").unwrap();
        assert_eq!((names(dir.path()), fs::read_to_string(&seal).unwrap()), (vec!["b".into(), "seal".into()], "5".into()));
    }

    #[test]
    fn the_error_names_the_missing_folder() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("none/a.pfm");
        let message = write(&path, |_| Ok(())).unwrap_err().to_string();
        assert!(message.starts_with(&format!("cannot write {}: ", path.display())), "{message}");
        assert!(message.contains(&format!("directory {}", dir.path().join("none").display())), "{message}");
        assert!(!message.contains(".multiscopic-"), "{message}");
        assert!(matches!(write(dir.path(), |_| Ok(())), Err(Error::Write { .. })));
        assert!(matches!(write(Path::new(""), |_| Ok(())), Err(Error::Write { .. })));
    }

    #[cfg(unix)]
    #[test]
    fn new_files_get_the_usual_permissions_and_old_ones_keep_theirs() {
        use std::os::unix::fs::PermissionsExt;
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let dir = tempfile::tempdir().unwrap();
        let (usual, path) = (dir.path().join("usual"), dir.path().join("a"));
        fs::write(&usual, "").unwrap();
        write(&path, |_| Ok(())).unwrap();
        assert_eq!(mode(&path), mode(&usual));
        fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        write(&path, |_| Ok(())).unwrap();
        assert_eq!(mode(&path), 0o640);
        fs::set_permissions(&path, Permissions::from_mode(0o444)).unwrap();
        assert!(write(&path, |_| Ok(())).unwrap_err().to_string().ends_with("permission denied"));
    }

    #[cfg(unix)]
    #[test]
    fn symbolic_links_are_followed() {
        let dir = tempfile::tempdir().unwrap();
        let (path, link) = (dir.path().join("a"), dir.path().join("link"));
        fs::write(&path, "old").unwrap();
        std::os::unix::fs::symlink("a", &link).unwrap();
        write(&link, |w| w.write_all(b"new")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn devices_and_open_files_are_not_replaced() {
        use std::os::{fd::AsRawFd, unix::fs::FileTypeExt};
        write(Path::new("/dev/null"), |w| w.write_all(b"gone")).unwrap();
        assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());

        let mut open = tempfile::NamedTempFile::new().unwrap();
        open.write_all(b"kept ").unwrap();
        write(Path::new(&format!("/dev/fd/{}", open.as_file().as_raw_fd())), |w| w.write_all(b"new")).unwrap();
        assert_eq!(fs::read_to_string(open.path()).unwrap(), "kept new");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_closed_pipe_is_not_an_error() {
        use std::os::fd::AsRawFd;
        let (reader, writer) = io::pipe().unwrap();
        drop(reader);
        write(Path::new(&format!("/dev/fd/{}", writer.as_raw_fd())), |w| w.write_all(b"too much")).unwrap();
    }

    #[test]
    fn a_folder_is_made_completely_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rig");
        let write_a_file = |folder: &Path| {
            fs::write(folder.join("a"), "a").unwrap();
            Ok(())
        };
        let failed = write_folder(&path, |folder| {
            write_a_file(folder)?;
            assert!(!path.exists());
            Err::<(), _>(Error::Usage("the camera is gone".into()))
        });
        assert!(failed.unwrap_err().to_string().contains("camera"));
        assert_eq!(names(dir.path()), [""; 0]);
        write_folder(&path, write_a_file).unwrap();
        assert_eq!((names(dir.path()), names(&path)), (vec!["rig".into()], vec!["a".into()]));
        // Whatever is there is kept, unless it is an empty folder.
        assert!(write_folder(&path, write_a_file).unwrap_err().to_string().contains("is there already"));
        assert!(write_folder(&path.join("a"), write_a_file).unwrap_err().to_string().contains("is there already"));
        fs::remove_file(path.join("a")).unwrap();
        write_folder(&path, write_a_file).unwrap();
        // Together with a file, or not at all.
        let (other, page) = (dir.path().join("other"), dir.path().join("none/page"));
        let together = |page: &Path| {
            write_together(|| {
                write_folder(&other, write_a_file)?;
                write(page, |_| Ok(()))
            })
        };
        together(&page).unwrap_err();
        assert_eq!(names(dir.path()), ["rig"]);
        together(&dir.path().join("page")).unwrap();
        assert_eq!((names(dir.path()).len(), names(&other)), (3, vec!["a".into()]));
        assert!(matches!(write_folder(&dir.path().join("none/rig"), write_a_file), Err(Error::Write { .. })));
    }

    #[test]
    fn checks_without_writing() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b, again] = ["a", "b", "./a"].map(|name| dir.path().join(name));
        let files = || fs::read_dir(dir.path()).unwrap().count();
        fs::write(&a, "old").unwrap();
        check(&[&a, &b, Path::new("/dev/null")], &[]).unwrap();
        assert_eq!((files(), fs::read_to_string(&a).unwrap()), (1, "old".into()));

        let message = |outputs: &[&Path], inputs: &[&Path]| check(outputs, inputs).unwrap_err().to_string();
        assert!(message(&[&a, &again], &[]).contains("a is given for two outputs"));
        assert!(message(&[&b, &dir.path().join("./b")], &[]).contains("b is given for two outputs"));
        assert!(message(&[&b, &again], &[&a]).contains("a would replace the input"));
        let nowhere = dir.path().join("none/a");
        assert!(message(&[&b, &nowhere], &[]).starts_with(&format!("cannot write {}: no file can be made", nowhere.display())));
        assert!(message(&[dir.path()], &[]).starts_with(&format!("cannot write {}: ", dir.path().display())));
        assert_eq!(files(), 1);
    }
}
