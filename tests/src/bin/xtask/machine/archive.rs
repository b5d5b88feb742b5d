//! Archives that Linux unpacks as its first file system: cpio in its format newc.

use anyhow::{Context, Result};
use std::{
    fs,
    path::{Component, Path, PathBuf},
};

/// The kinds of entries in a file's mode.
const FOLDER: u32 = 0o040_000;
const FILE: u32 = 0o100_000;

/// An archive that is made.
#[derive(Default)]
pub struct Archive {
    bytes: Vec<u8>,
    folders: Vec<PathBuf>,
    entries: u32,
}

impl Archive {
    /// Adds an empty folder, and those that it lies in.
    pub fn folder(&mut self, path: &Path) {
        let mut parents: Vec<&Path> = path.ancestors().filter(|path| path.components().any(|part| is_name(&part))).collect();
        parents.reverse();
        for path in parents {
            if !self.folders.iter().any(|folder| folder == path) {
                self.folders.push(path.into());
                self.entry(path, FOLDER | 0o755, &[]);
            }
        }
    }

    /// Adds a file that may be run.
    pub fn file(&mut self, path: &Path, contents: &[u8]) {
        if let Some(folder) = path.parent() {
            self.folder(folder);
        }
        self.entry(path, FILE | 0o755, contents);
    }

    /// Adds a copy of the file `from`.
    pub fn copy(&mut self, from: &Path, to: &Path) -> Result<()> {
        self.file(to, &fs::read(from).with_context(|| format!("cannot read {}", from.display()))?);
        Ok(())
    }

    /// The bytes of the archive.
    pub fn finish(mut self) -> Vec<u8> {
        self.entry(Path::new("TRAILER!!!"), 0, &[]);
        self.bytes
    }

    fn entry(&mut self, path: &Path, mode: u32, contents: &[u8]) {
        let names: Vec<_> = path.components().filter(is_name).map(|name| name.as_os_str().to_string_lossy()).collect();
        let name = names.join("/");
        self.entries += 1;
        // Number, mode, user, group, links, time, size, device of the file and of what it is (two numbers each), length of its name
        // with a zero at its end, and no checksum.
        let fields = [self.entries, mode, 0, 0, 1, 0, contents.len() as u32, 0, 0, 0, 0, name.len() as u32 + 1, 0];
        self.bytes.extend(b"070701");
        self.bytes.extend(fields.iter().flat_map(|field| format!("{field:08x}").into_bytes()));
        self.bytes.extend(name.as_bytes());
        self.bytes.push(0);
        self.pad();
        self.bytes.extend(contents);
        self.pad();
    }

    fn pad(&mut self) {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}

/// Whether a part of a path is a name, as opposed to its root.
fn is_name(component: &Component) -> bool {
    matches!(component, Component::Normal(_))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_aligned_and_folders_come_first() {
        let mut archive = Archive::default();
        archive.file(Path::new("/a/b/c"), b"12345");
        archive.file(Path::new("/a/b/d"), b"");
        let bytes = archive.finish();
        let starts: Vec<usize> = (0..bytes.len() - 5).filter(|&i| &bytes[i..i + 6] == b"070701").collect();
        assert!(starts.iter().all(|start| start % 4 == 0) && bytes.len() % 4 == 0);
        let names: Vec<_> = starts
            .iter()
            .map(|start| {
                bytes[start + 110..].split(|&byte| byte == 0).next().map(|name| String::from_utf8_lossy(name).into_owned())
            })
            .collect();
        assert_eq!(names, ["a", "a/b", "a/b/c", "a/b/d", "TRAILER!!!"].map(|name| Some(name.to_owned())));
        assert_eq!(&bytes[starts[2] + 14..][..8], b"000081ed");
        assert_eq!(&bytes[starts[2] + 54..][..8], b"00000005");
    }
}
