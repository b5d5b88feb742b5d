//! Many items on many machines: shares, records, and `merge`. Here are the scenes of `evaluate --results`.

mod listed_rigs;

use std::{
    fs,
    path::{Path, PathBuf},
};

use image::GrayImage;
use multiscopic_reference::split_mix::Random;
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

/// A data set of random images, with random truth that is known in most places.
fn data_set(scenes: &[&str]) -> Desk {
    let desk = Desk::new();
    let mut random = Random(5);
    for scene in scenes {
        let folder = desk.path("data/middlebury2006-third").join(scene);
        fs::create_dir_all(&folder).expect("a folder");
        for name in ["view0.png", "view1.png", "view2.png", "disp1.png"] {
            GrayImage::from_fn(40, 30, |_, _| [random.byte()].into()).save(folder.join(name)).expect("a picture");
        }
    }
    desk
}

const EVALUATE: &str = "evaluate @data --dataset middlebury2006-third --methods bm,sgm --fusion min,mean --views 1,2";

/// A list of results without the times, which are the last line of each.
fn without_times(json: &str) -> String {
    let mut lines: Vec<&str> = Vec::new();
    for line in json.lines() {
        if line.trim_start().starts_with("\"seconds\": ") {
            let last = lines.last_mut().expect("a line before");
            *last = last.strip_suffix(',').expect("a comma between them");
        } else {
            lines.push(line);
        }
    }
    lines.join("\n") + "\n"
}

#[test]
fn shares_of_scenes_merge_to_the_bits_of_one_machine() {
    let desk = data_set(&["Aloe", "Baby", "Cloth", "Flowerpots", "Rocks"]);
    let whole = desk.done(&format!("{EVALUATE} --json @whole.json"));
    let json = fs::read_to_string(desk.path("whole.json")).expect("a list");
    assert_eq!(json.matches("\"seconds\"").count(), 5 * 2 * 3);

    let first = desk.done(&format!("{EVALUATE} --results @a --shard 1/3"));
    assert_eq!(first.stdout, "", "the table is of all scenes");
    assert!(first.stderr.contains("2 of 5 items in shard 1/3: 2 done, 0 done before"), "{first:#?}");
    assert_eq!(desk.recorded("a"), ["Aloe", "Flowerpots"]);
    desk.done(&format!("{EVALUATE} --results @b --shard 2/3 --threads 1"));
    desk.run("merge @a @b").assert_refused(&["1 of 5 items are missing: Cloth"]);
    desk.done(&format!("{EVALUATE} --results @b --shard 3/3"));
    assert_eq!(desk.merged("@b @a"), (whole.stdout.clone(), without_times(&json)));
    // The times are kept where they were measured.
    let record = fs::read_to_string(desk.path("a/Aloe/record.json")).expect("a record");
    let record: serde_json::Value = serde_json::from_str(&record).expect("JSON");
    assert!(record["seconds"].as_f64().is_some_and(|seconds| seconds > 0.0), "{record}");
    assert_eq!(record["run"]["parameters"]["methods"], serde_json::json!(["bm", "sgm"]));

    // Again, on the machine that had a third, and in one folder.
    let again = desk.done(&format!("{EVALUATE} --results @a"));
    assert!(again.stderr.contains("5 of 5 items in shard 1/1: 3 done, 2 done before"), "{again:#?}");
    assert_eq!(desk.merged("@a"), (whole.stdout, without_times(&json)));
    desk.run("merge @a @b").assert_refused(&["Baby is in both"]);
}

#[test]
fn scenes_that_changed_are_measured_again() {
    let desk = data_set(&["Aloe", "Baby"]);
    let command = format!("{EVALUATE} --results @out");
    let counts = |line: &str, expected: &str| {
        let run = desk.done(line);
        assert!(run.stderr.contains(expected), "{line}: {run:#?}");
    };
    counts(&format!("{command} --scenes Baby"), "1 of 1 items in shard 1/1: 1 done, 0 done before");
    counts(&command, "1 done, 1 done before");
    let baby = desk.path("data/middlebury2006-third/Baby");
    fs::copy(baby.join("view0.png"), baby.join("disp1.png")).expect("a picture");
    counts(&command, "1 done, 1 done before");
    counts(&format!("{command} --block-size 9"), "2 done, 0 done before");
    desk.run(&format!("{command} --report @page.html")).assert_refused(&["--report", "cannot be used"]);
    desk.run(&format!("{command} --json @list.json")).assert_refused(&["--json", "cannot be used"]);
    desk.run("evaluate @data --results @other").assert_refused(&["--results is for data sets", "--dataset"]);
    // A scene that cannot be read does not stop the other.
    fs::write(desk.path("data/middlebury2006-third/Aloe/view1.png"), "").expect("a file");
    let run = desk.run(&format!("{command} --block-size 7"));
    assert_eq!(run.code, Some(1), "{run:#?}");
    assert!(run.stderr.contains("1 done, 0 done before, 1 failed: Aloe"), "{run:#?}");
}
