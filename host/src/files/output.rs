//! Files that are written whole or not at all.

use std::{
    fs::{self, File, Permissions},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use tempfile::{Builder, NamedTempFile};

use crate::error::{Error, Result};

/// Writes `path` with what `contents` writes.
///
/// The data goes to a temporary file beside `path` that takes its place only when it is complete: until then, and for ever if
/// something fails, `path` is what it was. A symbolic link is followed, and the permissions of an existing file are kept. A pipe, a
/// device or an already open file (`/dev/stdout`) has nothing to keep and is written directly; a reader that has had enough of a pipe
/// (`| head`) is no error.
///
/// # Errors
/// [`Error::Write`] for whatever the system or `contents` says.
pub fn write(path: &Path, contents: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let written = target(path).and_then(|target| match target {
        Target::Open => match append(path, contents) {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
            written => written,
        },
        Target::File { path, permissions } => replace(&path, permissions, contents),
    });
    written.map_err(|source| Error::Write { path: path.into(), source })
}

/// Makes the folder `path` with what `contents` writes into the folder it is given.
///
/// That is a temporary one beside `path`, which takes its name only when it is complete: an interrupted command leaves no folder that looks
/// so. A folder that is already there is kept, unless it is empty.
///
/// # Errors
/// [`Error::Usage`] if there is something at `path`, else what `contents` returns, or [`Error::Write`] for what the system says.
pub fn folder<T>(path: &Path, contents: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
    check_folder(path)?;
    let failed = |source| Error::Write { path: path.into(), source };
    let temporary = temporary(0o777).tempdir_in(directory_of(path)).map_err(failed)?;
    let written = contents(temporary.path())?;
    fs::rename(temporary.path(), path).map_err(failed)?;
    // It has another name now; there is nothing to remove.
    let _ = temporary.keep();
    Ok(written)
}

/// Checks, before the work whose results it takes, that [`folder()`] can make the folder `path`.
///
/// # Errors
/// [`Error::Usage`] if there is something at `path`, and [`Error::Write`] for what the system says.
pub fn check_folder(path: &Path) -> Result<()> {
    let failed = |source| Error::Write { path: path.into(), source };
    let is_free = match fs::read_dir(path) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => false,
        Err(error) if error.kind() == io::ErrorKind::NotFound => true,
        Err(error) => return Err(failed(error)),
    };
    if !is_free {
        let there = path.display();
        return Err(Error::Usage(format!("{there} is there already, and is not replaced: give another folder, or remove it")));
    }
    temporary_file_beside(path).map(drop).map_err(failed)
}

/// Checks, before the work whose results they take, that `outputs` can be written: each may be made or replaced, and none is
/// given twice or also one of `inputs`.
///
/// # Errors
/// [`Error::Write`] as [`write()`] would give it, and [`Error::Usage`] for what is given twice.
pub fn check(outputs: &[&Path], inputs: &[&Path]) -> Result<()> {
    for (i, path) in outputs.iter().enumerate() {
        let same = |other: &&&Path| place(other) == place(path);
        if outputs[..i].iter().any(|other| same(&other)) {
            return Err(Error::Usage(format!("{} is given for two outputs, give each its own file", path.display())));
        }
        if let Some(input) = inputs.iter().find(same) {
            let (output, input) = (path.display(), input.display());
            return Err(Error::Usage(format!("the output {output} would replace the input {input}, give another file")));
        }
        let checked = target(path).and_then(|target| match target {
            // Opening a pipe could not be undone.
            Target::Open => Ok(()),
            Target::File { path, .. } => temporary_file_beside(&path).map(drop),
        });
        checked.map_err(|source| Error::Write { path: path.into(), source })?;
    }
    Ok(())
}

/// Where a file is, be it there or not, whatever the way to it.
fn place(path: &Path) -> PathBuf {
    let in_its_folder = || {
        let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(in_its_folder).unwrap_or_else(|| path.into())
}

/// How an output is written.
enum Target {
    /// Directly: there is nothing to keep.
    Open,
    /// By taking the place of a file that may be there, with its permissions.
    File { path: PathBuf, permissions: Option<Permissions> },
}

fn target(path: &Path) -> io::Result<Target> {
    match fs::metadata(path) {
        Ok(old) if old.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
        Ok(old) if !old.is_file() || is_open_file(path) => Ok(Target::Open),
        // Whoever may write the directory could replace a read-only file, but its owner asked for it to stay.
        Ok(old) if old.permissions().readonly() => Err(io::ErrorKind::PermissionDenied.into()),
        Ok(old) => Ok(Target::File { path: fs::canonicalize(path)?, permissions: Some(old.permissions()) }),
        Err(_) => Ok(Target::File { path: path.into(), permissions: None }),
    }
}

/// Whether `path` names a file by this process's descriptor of it, so that replacing the name would miss the file.
fn is_open_file(path: &Path) -> bool {
    ["/dev/stdout", "/dev/stderr", "/dev/fd", "/proc"].iter().any(|open| path.starts_with(open))
}

/// Appends, so that what the shell's `>>` kept is kept.
fn append(path: &Path, contents: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    fill(&mut File::options().append(true).open(path)?, contents)
}

fn replace(
    target: &Path,
    permissions: Option<Permissions>,
    contents: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let mut file = temporary_file_beside(target)?;
    fill(file.as_file_mut(), contents)?;
    if let Some(permissions) = permissions {
        file.as_file().set_permissions(permissions)?;
    }
    file.persist(target)?;
    Ok(())
}

fn directory_of(target: &Path) -> &Path {
    target.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

/// What makes temporary files and folders with the `mode` that any program asks for; the system takes the user's umask off.
#[cfg_attr(not(unix), expect(unused_variables, reason = "there are no modes"))]
fn temporary(mode: u32) -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(".multiscopic-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(Permissions::from_mode(mode));
    }
    builder
}

fn temporary_file_beside(target: &Path) -> io::Result<NamedTempFile> {
    let directory = directory_of(target);
    // The system's message would name the temporary file, which says nothing to the user.
    temporary(0o666).tempfile_in(directory).map_err(|error| {
        let message = format!("no file can be made in directory {}: {}", directory.display(), error.kind());
        io::Error::new(error.kind(), message)
    })
}

fn fill(file: &mut File, contents: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut writer = BufWriter::new(file);
    contents(&mut writer)?;
    writer.flush()
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
    fn replaces_a_file_when_complete() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        for text in ["first", "2nd"] {
            write(&path, |w| w.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[test]
    fn a_folder_is_there_as_a_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rig");
        let one_file = |folder: &Path| write(&folder.join("a"), |w| w.write_all(b"a"));
        let broken = folder(&path, |folder| {
            one_file(folder)?;
            assert!(!path.exists());
            Err::<(), _>(Error::Usage("the camera is gone".into()))
        });
        assert!(broken.unwrap_err().to_string().contains("camera"));
        assert_eq!(names(dir.path()), [""; 0]);
        folder(&path, one_file).unwrap();
        assert_eq!((names(dir.path()), names(&path)), (vec!["rig".into()], vec!["a".into()]));
        // What is there is not replaced, unless it is nothing.
        assert!(folder(&path, one_file).unwrap_err().to_string().contains("is there already"));
        assert!(folder(&path.join("a"), one_file).unwrap_err().to_string().contains("is there already"));
        fs::remove_file(path.join("a")).unwrap();
        folder(&path, one_file).unwrap();
        assert!(matches!(folder(&dir.path().join("none/rig"), one_file), Err(Error::Write { .. })));
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_nothing_else() {
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
    fn names_the_directory_that_is_not_there() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("none/a.pfm");
        let message = write(&path, |_| Ok(())).unwrap_err().to_string();
        assert!(message.starts_with(&format!("cannot write {}: ", path.display())), "{message}");
        assert!(message.contains(&format!("directory {}", dir.path().join("none").display())), "{message}");
        assert!(!message.contains(".multiscopic-"), "{message}");
        assert!(matches!(write(dir.path(), |_| Ok(())), Err(Error::Write { .. })));
        assert!(matches!(write(Path::new(""), |_| Ok(())), Err(Error::Write { .. })));
    }

    #[test]
    fn checks_without_writing() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b, again] = ["a", "b", "./a"].map(|name| dir.path().join(name));
        fs::write(&a, "old").unwrap();
        check(&[&a, &b, Path::new("/dev/null")], &[]).unwrap();
        assert_eq!((names(dir.path()), fs::read_to_string(&a).unwrap()), (vec!["a".into()], "old".into()));

        let message = |outputs: &[&Path], inputs: &[&Path]| check(outputs, inputs).unwrap_err().to_string();
        assert!(message(&[&a, &again], &[]).contains("a is given for two outputs"));
        assert!(message(&[&b, &dir.path().join("./b")], &[]).contains("b is given for two outputs"));
        assert!(message(&[&b, &again], &[&a]).contains("a would replace the input"));
        let nowhere = dir.path().join("none/a");
        assert!(message(&[&b, &nowhere], &[]).starts_with(&format!("cannot write {}: no file can be made", nowhere.display())));
        assert!(message(&[dir.path()], &[]).starts_with(&format!("cannot write {}: ", dir.path().display())));
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_the_usual_ones() {
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
    fn follows_a_link() {
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
    fn a_device_stays_a_device() {
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
    fn a_reader_that_has_had_enough_is_no_error() {
        use std::os::fd::AsRawFd;
        let (reader, writer) = io::pipe().unwrap();
        drop(reader);
        write(Path::new(&format!("/dev/fd/{}", writer.as_raw_fd())), |w| w.write_all(b"too much")).unwrap();
    }
}
