//! How a path given as output is to be written.

use std::{
    fs::{self, Permissions},
    io,
    path::{Path, PathBuf},
};

/// How an output is written.
pub enum Destination {
    /// A pipe, a device or an open file: written directly, as there is nothing to preserve.
    Stream,
    /// A regular file, new or existing: replaced as a whole, with the permissions of the existing one.
    File { path: PathBuf, permissions: Option<Permissions> },
}

impl Destination {
    /// What `path` stands for. Symbolic links are followed.
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

/// Whether `path` names a file through one of this process's descriptors. Replacing that name would not
/// replace the file.
fn is_open_file(path: &Path) -> bool {
    ["/dev/stdout", "/dev/stderr", "/dev/fd", "/proc"].iter().any(|open| path.starts_with(open))
}
