//! Making a folder as a whole.

use std::{fs, io, path::Path};

use super::{
    file::{apart, finish},
    temporary::{Complete, Temporary, Written},
};
use crate::error::{Error, Result};

/// Makes the folder `path`; `contents` writes its files into the folder that it is given.
///
/// That is a temporary folder beside `path`, which is renamed to `path` only when it is complete. An
/// interrupted command therefore leaves nothing that looks like a result. An existing folder is never
/// replaced, unless it is empty.
///
/// # Errors
/// [`Error::Usage`] if `path` exists, the error of `contents`, or [`Error::Write`] with the error of the
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
/// [`Error::Usage`] if `path` exists, and [`Error::Write`] with the error of the system.
pub fn check_folder(path: &Path) -> Result<()> {
    let failed = |source| Error::Write { path: path.into(), source };
    let is_free = match fs::read_dir(path) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => false,
        Err(error) if error.kind() == io::ErrorKind::NotFound => true,
        Err(error) => return Err(failed(error)),
    };
    if !is_free {
        let path = path.display();
        return Err(Error::Usage(format!("{path} is there already and will not be replaced: give another folder, or remove it")));
    }
    Temporary::file_beside(path).map(drop).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::output::{write, write_together};

    fn names(dir: &Path) -> Vec<String> {
        fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
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
}
