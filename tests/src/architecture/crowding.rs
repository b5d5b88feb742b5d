//! Folders with too many files beside each other.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use super::{violation::Violation, workspace::CrateRoot};

/// The most files that may be in a folder of sources, folders excluded.
const MOST_FILES: usize = 13;

/// Finds source folders with too many files.
pub(super) fn check(root: &Path, crate_roots: &[CrateRoot]) -> io::Result<Vec<Violation>> {
    let mut unread: Vec<PathBuf> = crate_roots.iter().filter_map(|crate_root| Some(crate_root.path.parent()?.into())).collect();
    let mut folders = BTreeSet::new();
    let mut violations = Vec::new();
    while let Some(folder) = unread.pop() {
        if !folders.insert(folder.clone()) {
            continue;
        }
        let mut files = 0;
        for entry in fs::read_dir(&folder)? {
            let entry = entry?;
            if entry.file_type()?.is_dir() { unread.push(entry.path()) } else { files += 1 }
        }
        if files > MOST_FILES {
            let place = folder.strip_prefix(root).unwrap_or(&folder).display().to_string();
            violations
                .push(Violation { place, message: format!("{files} files are beside each other, at most {MOST_FILES} may be") });
        }
    }
    Ok(violations)
}
