//! Many items on many machines: shares, records, and what `merge` makes of them.

mod listed_rigs;
mod shared_scenes;

use std::{
    fs,
    path::{Path, PathBuf},
};

use multiscopic_tests::program::Invocation;

/// A folder of a test.
struct Desk {
    folder: tempfile::TempDir,
}

impl Desk {
    fn new() -> Desk {
        Desk { folder: tempfile::tempdir().expect("a folder") }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs a command line whose words that begin with `@` are paths in the folder.
    fn run(&self, line: &str) -> Invocation {
        let word = |word: &str| word.strip_prefix('@').map_or(word.into(), |name| self.path(name).into_os_string());
        Invocation::new(line.split(' ').map(word))
    }

    /// Runs a command line that succeeds.
    #[track_caller]
    fn done(&self, line: &str) -> Invocation {
        let run = self.run(line);
        assert_eq!(run.code, Some(0), "{line}: {run:#?}");
        run
    }

    /// Merges folders of results: the table, and the text of the JSON.
    #[track_caller]
    fn merged(&self, folders: &str) -> (String, String) {
        let run = self.done(&format!("merge {folders} --json @merged.json"));
        assert_eq!(run.stderr, "", "{folders}");
        run.assert_plain();
        (run.stdout, fs::read_to_string(self.path("merged.json")).expect("the list"))
    }

    /// The items with a record in a folder of results.
    fn recorded(&self, results: &str) -> Vec<String> {
        let mut items = Vec::new();
        find_records(&self.path(results), &mut items);
        let below = |record: PathBuf| Some(record.strip_prefix(self.path(results)).ok()?.parent()?.to_str()?.to_owned());
        let mut items: Vec<String> = items.into_iter().filter_map(below).collect();
        items.sort();
        items
    }
}

fn find_records(folder: &Path, records: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.expect("an entry").path();
        let name = path.file_name().and_then(|name| name.to_str()).expect("a name");
        assert!(!name.starts_with(".multiscopic-"), "{} is temporary", path.display());
        match path.is_dir() {
            true => find_records(&path, records),
            false if name == "record.json" => records.push(path),
            false => {}
        }
    }
}
