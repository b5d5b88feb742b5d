//! Lists of captured folders.

use std::{
    collections::BTreeMap,
    path::{Component, Path, PathBuf},
};

use super::{input, rig_file::Rig};
use crate::error::{Error, Result};

/// A captured folder in a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedRig {
    /// Its name, which no other rig in the list has: its path as the list has it, with `/` between folders.
    pub name: String,
    /// The folder.
    pub directory: PathBuf,
}

impl ListedRig {
    /// Reads a list: the path of a captured folder on each line. Blank lines and those that begin with `#` are left out. Relative
    /// paths are relative to the folder of the list.
    ///
    /// A rig is named as `tar` names members: by its path without a leading `/`, and without all up to the last `..`.
    ///
    /// # Errors
    /// [`Error::Read`], and [`Error::Format`] if there is no rig, if one has no name or the name of another, or if it lies in the
    /// folder of another.
    pub fn read_all(list: &Path) -> Result<Vec<ListedRig>> {
        let text = input::read_text(list)?;
        let folder = list.parent().unwrap_or(Path::new(""));
        let mut rigs = Vec::new();
        let mut lines = BTreeMap::new();
        for (line, number) in text.lines().map(str::trim).zip(1..) {
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let wrong = |found: String, expected: &str| Error::format(list, format!("{found} in line {number}"), expected);
            let name = name(Path::new(line));
            if name.is_empty() {
                return Err(wrong(line.into(), "the path of a captured folder, which names its results"));
            }
            if let Some(other) = lines.insert(name.clone(), number) {
                let found = format!("{line}, which has the same name as the rig in line {other}, {name},");
                return Err(wrong(found, "each rig once, with a name of its own"));
            }
            rigs.push(ListedRig { name, directory: folder.join(line) });
        }
        if rigs.is_empty() {
            return Err(Error::format(list, "no rig", "the path of a captured folder on each line"));
        }
        // The results of a rig are in a folder of its name.
        for (name, number) in &lines {
            let outer = Path::new(name).ancestors().skip(1).find_map(|outer| lines.get(outer.to_str()?));
            if let Some(outer) = outer {
                let found = format!("{name} in line {number}, which is in the folder of the rig in line {outer}");
                return Err(Error::format(list, found, "rigs beside each other"));
            }
        }
        Ok(rigs)
    }
}

/// The parts of a path that name what is there.
fn name(path: &Path) -> String {
    let mut parts: Vec<_> = path.components().collect();
    if parts.last() == Some(&Component::Normal(Rig::FILE_NAME.as_ref())) {
        parts.pop();
    }
    let after = parts.iter().rposition(|part| *part == Component::ParentDir).map_or(0, |last| last + 1);
    let normal = parts[after..].iter().filter_map(|part| match part {
        Component::Normal(part) => Some(part.to_string_lossy()),
        _ => None,
    });
    normal.collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_list(text: &str) -> (String, Result<Vec<ListedRig>>) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rigs.txt");
        std::fs::write(&path, text).unwrap();
        (dir.path().display().to_string(), ListedRig::read_all(&path))
    }

    #[test]
    fn a_line_is_a_rig_with_a_name() {
        let (folder, rigs) = read_list("# Monday\r\n./a\n\n  /data/b c/ \n../../d/e\nf/rig.toml\n");
        let rigs = rigs.unwrap();
        let names: Vec<&str> = rigs.iter().map(|rig| rig.name.as_str()).collect();
        assert_eq!(names, ["a", "data/b c", "d/e", "f"]);
        assert_eq!(rigs[0].directory, Path::new(&folder).join("a"));
        assert_eq!(rigs[1].directory, Path::new("/data/b c"));
        assert_eq!(rigs[2].directory, Path::new(&folder).join("../../d/e"));
    }

    #[test]
    fn names_are_those_of_one_rig_each() {
        let message = |text: &str| read_list(text).1.unwrap_err().to_string();
        assert!(message("# none\n").contains("rigs.txt: found no rig, expected the path"));
        assert!(message("a\n..\n").contains("found .. in line 2, expected the path of a captured folder"));
        assert!(message("a/b\n#\n/a/b\n").contains("found /a/b, which has the same name as the rig in line 1, a/b, in line 3"));
        assert!(message("a/b\nc\na\n").contains("found a/b in line 1, which is in the folder of the rig in line 3"));
        assert!(message("").contains("an empty file"));
    }
}
