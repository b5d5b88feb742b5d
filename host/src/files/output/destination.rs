//! The ways in which outputs are written, and outputs that cannot be.

use std::{
    fs::{self, Permissions},
    io,
    path::{Path, PathBuf},
};

use super::temporary::Temporary;
use crate::error::{Error, Result};

/// The way in which an output is written.
pub enum Destination {
    /// A pipe, a device or an open file: written directly, as there is nothing to preserve.
    Stream,
    /// A regular file, new or existing: replaced as a whole, with the permissions of the existing one.
    File { path: PathBuf, permissions: Option<Permissions> },
}

impl Destination {
    /// Returns the destination for which `path` stands. Symbolic links are followed.
    pub fn of(path: &Path) -> io::Result<Destination> {
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
/// [`Error::Write`] as [`write`](super::write) would return it, [`Error::SharedOutput`] for a file that is given
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
    use std::fs;

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
