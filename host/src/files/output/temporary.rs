//! Temporary files and folders beside the output that they will become.

use std::{fs::Permissions, io, path::Path};

use tempfile::{Builder, NamedTempFile, TempDir};

/// A temporary file in the folder of `target`, so that it can be renamed to it.
pub fn file_beside(target: &Path) -> io::Result<NamedTempFile> {
    let directory = directory_of(target);
    // The system's own message would name the temporary file, which means nothing to the user.
    builder(0o666).tempfile_in(directory).map_err(|error| {
        let message = format!("no file can be made in directory {}: {}", directory.display(), error.kind());
        io::Error::new(error.kind(), message)
    })
}

/// A temporary folder in the folder of `target`, so that it can be renamed to it.
pub fn folder_beside(target: &Path) -> io::Result<TempDir> {
    builder(0o777).tempdir_in(directory_of(target))
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
