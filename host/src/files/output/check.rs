//! Checking outputs before the work begins.

use std::path::{Path, PathBuf};

use super::{destination::Destination, temporary::Temporary};
use crate::error::{Error, Result};

/// Checks, before the work whose results they take, that all `outputs` can be written, and that none is given
/// twice or is also one of the `inputs`.
///
/// # Errors
/// [`Error::Write`] as [`write`](super::write) would return it, and [`Error::Usage`] for a file that is given
/// twice.
pub fn check(outputs: &[&Path], inputs: &[&Path]) -> Result<()> {
    for (i, path) in outputs.iter().enumerate() {
        let is_same = |other: &&&Path| absolute(other) == absolute(path);
        if outputs[..i].iter().any(|other| is_same(&other)) {
            return Err(Error::Usage(format!("{} is given for two outputs: give each its own file", path.display())));
        }
        if let Some(input) = inputs.iter().find(is_same) {
            let (output, input) = (path.display(), input.display());
            return Err(Error::Usage(format!("the output {output} would replace the input {input}: give another file")));
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
