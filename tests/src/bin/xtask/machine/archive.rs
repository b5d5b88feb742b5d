//! The initial file system of a Linux machine, as a cpio archive.

use anyhow::{Context, Result};
use cpio::{
    NewcBuilder,
    newc::{self, ModeFileType},
};
use std::{
    collections::BTreeMap,
    fs,
    io::Write,
    path::{Component, Path},
};

/// Everybody may read and execute every file.
const PERMISSIONS: u32 = 0o755;

/// Files and folders by their path without a leading slash. In alphabetical order, folders come before their
/// contents.
#[derive(Default)]
pub struct Archive {
    entries: BTreeMap<String, Entry>,
}

enum Entry {
    Folder,
    File(Vec<u8>),
}

impl Archive {
    /// Adds an empty folder and its parents.
    pub fn folder(&mut self, path: &Path) {
        for folder in path.ancestors().map(name).filter(|name| !name.is_empty()) {
            self.entries.entry(folder).or_insert(Entry::Folder);
        }
    }

    /// Adds an executable file and its parent folders.
    pub fn file(&mut self, path: &Path, contents: &[u8]) {
        if let Some(folder) = path.parent() {
            self.folder(folder);
        }
        self.entries.insert(name(path), Entry::File(contents.into()));
    }

    /// Adds a copy of the file `from`.
    pub fn copy(&mut self, from: &Path, to: &Path) -> Result<()> {
        self.file(to, &fs::read(from).with_context(|| format!("cannot read {}", from.display()))?);
        Ok(())
    }

    /// The archive in cpio's newc format.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        for (index, (name, entry)) in self.entries.iter().enumerate() {
            let (kind, contents) = match entry {
                Entry::Folder => (ModeFileType::Directory, [].as_slice()),
                Entry::File(contents) => (ModeFileType::Regular, contents.as_slice()),
            };
            // Linux treats entries with equal inode numbers as links to one file.
            let header = NewcBuilder::new(name).ino(index as u32 + 1).mode(PERMISSIONS).set_mode_file_type(kind).nlink(1);
            let mut writer = header.write(&mut bytes, contents.len() as u32);
            writer.write_all(contents)?;
            writer.finish()?;
        }
        newc::trailer(&mut bytes)?;
        Ok(bytes)
    }
}

/// A path as archives write it: relative to the root.
fn name(path: &Path) -> String {
    let names = path.components().filter(|component| matches!(component, Component::Normal(_)));
    names.map(|name| name.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;
    use cpio::NewcReader;
    use std::io::Read;

    #[test]
    fn folders_come_before_what_they_contain() {
        let mut archive = Archive::default();
        archive.file(Path::new("/a/b/d"), b"");
        archive.file(Path::new("/a/b/c"), b"12345");
        let mut bytes: &[u8] = &archive.to_bytes().unwrap();
        let mut entries = Vec::new();
        loop {
            let mut reader = NewcReader::new(&mut bytes).unwrap();
            if reader.entry().is_trailer() {
                break;
            }
            let mut contents = String::new();
            reader.read_to_string(&mut contents).unwrap();
            entries.push((reader.entry().name().to_owned(), reader.entry().mode(), contents));
            reader.finish().unwrap();
        }
        let entry = |name: &str, mode, contents: &str| (name.to_owned(), mode, contents.to_owned());
        let (folder, file) = (0o040_755, 0o100_755);
        let expected =
            [entry("a", folder, ""), entry("a/b", folder, ""), entry("a/b/c", file, "12345"), entry("a/b/d", file, "")];
        assert_eq!(entries, expected);
    }
}
