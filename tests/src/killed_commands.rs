//! Commands that are killed at random moments, and what they leave behind.

use std::{
    collections::{BTreeMap, BTreeSet},
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use multiscopic::{Frames, Rig};
use multiscopic_reference::split_mix::Random;

use crate::program::{self, make};

/// A file of the user beside the outputs.
const OF_THE_USER: &str = "notes.txt";
/// The prefixes of names of temporary files and folders.
const TEMPORARY: &str = ".multiscopic-";
/// A quick capture, but for its folder.
const CAPTURE: &str =
    "capture --camera sim --stage sim --baseline 8 --views 2 --size 96x64 --speed 250 --acceleration 1200 --settle 0";
/// The time after which a command counts as hung.
const PATIENCE: Duration = Duration::from_secs(120);

/// A command with outputs.
#[derive(Clone, Copy, Debug)]
pub struct Victim {
    /// Its name.
    pub name: &'static str,
    /// Its arguments. Paths are relative to a folder with a capture in `rig`; outputs go to `out`.
    arguments: &'static str,
    /// Two options that make different outputs.
    variants: [&'static str; 2],
    /// The folder that it makes whole, and refuses to replace.
    new_folder: Option<&'static str>,
    /// The file without which a folder of files that are replaced is incomplete.
    seal: Option<&'static str>,
}

/// The commands that write more than one file.
pub const VICTIMS: [Victim; 5] = [
    Victim {
        name: "match",
        arguments: "match rig -o out/o.pfm --png out/p.png --raw16 out/r.png --ply out/c.ply --report out/m.html",
        variants: ["--num-disparities 9", "--num-disparities 8"],
        new_folder: None,
        seal: None,
    },
    Victim {
        name: "evaluate",
        arguments: "evaluate rig --json out/e.json --report out/e.html",
        variants: ["--num-disparities 9", "--num-disparities 8"],
        new_folder: None,
        seal: None,
    },
    Victim {
        name: "align",
        arguments: "align rig -o out/aligned --report out/a.html",
        variants: ["", ""],
        new_folder: Some("out/aligned"),
        seal: None,
    },
    Victim {
        name: "capture",
        arguments: CAPTURE,
        variants: ["-o out/rig", "-o out/rig"],
        new_folder: Some("out/rig"),
        seal: None,
    },
    Victim {
        name: "demo",
        arguments: "demo --width 96 --height 64 -o out/demo",
        variants: ["--seed 1", "--seed 2"],
        new_folder: None,
        seal: Some("out/demo/rig.toml"),
    },
];

/// The outcomes of a number of killed runs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Runs that were killed before they ended.
    pub killed: usize,
    /// Of those, how many left all of their outputs.
    pub complete: usize,
    /// Of those, how many were killed between two renames, and left the other outputs whole under temporary names.
    pub parted: usize,
    /// Of those, how many left temporary files.
    pub with_leftovers: usize,
    /// Of those, how many left a folder that was being replaced, and that did not look complete.
    pub unsealed: usize,
}

/// A lack of space for outputs.
#[derive(Clone, Copy, Debug)]
pub enum Want {
    /// No file may have more than so many blocks of the shell, of 512 or 1024 bytes.
    FileSize(u32),
    /// The disk holds so many KiB.
    Disk(u32),
    /// Nothing can be written.
    ReadOnly,
}

/// A folder in which a command is run again and again.
struct Bench {
    folder: tempfile::TempDir,
    victim: Victim,
    runs: usize,
    /// The time that the last whole run took, which changes with the load of the machine.
    length: Duration,
    /// The outputs of a whole run in an empty folder.
    outputs: BTreeSet<PathBuf>,
}

impl Victim {
    /// Kills the command at `count` random moments, runs it again after each, and checks both times what is there. Panics if
    /// anything is not as it should be.
    pub fn kill(&self, count: usize, random: &mut Random) -> Tally {
        let mut bench = Bench::new(*self);
        bench.outputs = bench.run();
        bench.clear();
        bench.run();
        let mut tally = Tally::default();
        for number in 0..count {
            // Half of the moments are in the last quarter, when outputs are written.
            let share = match number % 2 {
                0 => random.below(1000),
                _ => 750 + random.below(250),
            };
            bench.kill_after(bench.length.mul_f64(share as f64 / 1000.0), &mut tally);
        }
        tally
    }
}

impl Victim {
    /// Runs the command without space for its outputs, or for some of them. Panics unless it says so and leaves nothing,
    /// or leaves everything. Returns whether it was refused; `None` if the system does not let a user mount such a disk.
    pub fn starve(&self, want: Want) -> Option<bool> {
        let bench = Bench::new(Victim { seal: None, ..*self });
        let out = bench.folder.path().join("out");
        fs::remove_file(out.join(OF_THE_USER)).expect("a file");
        let mount = |options: String| format!("mount -t tmpfs -o {options} none out || exit 99; ");
        let setup = match want {
            Want::FileSize(blocks) => format!("ulimit -f {blocks}; "),
            Want::Disk(kib) => mount(format!("size={kib}k")),
            Want::ReadOnly => mount("ro".into()),
        };
        // The disk's contents are gone with the shell.
        let script = setup + r#""$0" "$@"; code=$?; find out -type f; exit $code"#;
        let mut command = match want {
            Want::FileSize(_) => Command::new("sh"),
            Want::Disk(_) | Want::ReadOnly => {
                let mut unshare = Command::new("unshare");
                unshare.args(["--user", "--map-root-user", "--mount", "sh"]);
                unshare
            }
        };
        command
            .arg("-c")
            .arg(script)
            .arg(program::binary())
            .args(self.arguments.split(' '))
            .args(self.variants[0].split_whitespace());
        command.current_dir(&bench.folder);
        let output = command.env("RAYON_NUM_THREADS", "2").stdin(Stdio::null()).output().ok()?;
        let [left, messages] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
        let left: Vec<&str> = left.lines().filter(|line| line.starts_with("out/")).collect();
        let what = format!("{} with {want:?}: {messages}", self.name);
        match output.status.code() {
            Some(0) => {
                assert!(!left.is_empty() && !left.iter().any(|path| path.contains(TEMPORARY)), "{what} {left:?}");
                Some(false)
            }
            Some(2) => {
                assert!(messages.contains("cannot write"), "{what}");
                assert_eq!(left, [""; 0], "{what}");
                Some(true)
            }
            Some(99 | 1) if !matches!(want, Want::FileSize(_)) && left.is_empty() => None,
            code => panic!("exit code {code:?}: {what}"),
        }
    }
}

impl Bench {
    fn new(victim: Victim) -> Bench {
        let folder = tempfile::tempdir().expect("a folder");
        make(CAPTURE, &folder.path().join("rig"));
        for place in ["out", "out/demo"] {
            let place = folder.path().join(place);
            let is_made = place.ends_with("out") || victim.seal.is_some();
            if is_made {
                fs::create_dir_all(&place).expect("a folder");
                fs::write(place.join(OF_THE_USER), "the user's").expect("a file");
            }
        }
        Bench { folder, victim, runs: 0, length: Duration::ZERO, outputs: BTreeSet::new() }
    }

    /// Starts the next run, which makes other outputs than the last one.
    fn command(&mut self) -> Command {
        self.runs += 1;
        let mut command = Command::new(program::binary());
        command.args(self.victim.arguments.split(' ')).args(self.victim.variants[self.runs % 2].split_whitespace());
        command.current_dir(&self.folder).env("RAYON_NUM_THREADS", "2");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }

    /// Runs the command to its end. It works, and leaves no temporary files.
    fn run(&mut self) -> BTreeSet<PathBuf> {
        let before = self.files();
        let start = Instant::now();
        let output = self.command().output().expect("the command runs");
        let length = start.elapsed();
        let messages = String::from_utf8_lossy(&output.stderr);
        let after = self.files();
        self.check(&after);
        assert_eq!(temporaries(&after), Vec::<&PathBuf>::new(), "after a whole run of {}", self.victim.name);
        match self.victim.new_folder {
            Some(folder) if before.keys().any(|path| path.starts_with(folder)) => {
                assert_eq!(output.status.code(), Some(2), "{}: {messages}", self.victim.name);
                assert!(messages.contains("is there already"), "{}: {messages}", self.victim.name);
            }
            _ => {
                assert_eq!(output.status.code(), Some(0), "{}: {messages}", self.victim.name);
                self.length = length;
            }
        }
        changes(&before, &after)
    }

    /// Removes what cannot be replaced.
    fn clear(&self) {
        if let Some(folder) = self.victim.new_folder {
            self.outputs.iter().for_each(|path| _ = fs::remove_file(self.folder.path().join(path)));
            let _ = fs::remove_dir(self.folder.path().join(folder));
        }
    }

    /// Kills a run after some time, then runs the command again.
    fn kill_after(&mut self, time: Duration, tally: &mut Tally) {
        self.clear();
        let name = self.victim.name;
        let before = self.files();
        let mut child = self.command().spawn().expect("the command starts");
        thread::sleep(time);
        child.kill().expect("it can be killed");
        let start = Instant::now();
        let ended_before = loop {
            if let Some(status) = child.try_wait().expect("it can be waited for") {
                break status.code().is_some();
            }
            assert!(start.elapsed() < PATIENCE, "{name} does not end");
            thread::sleep(Duration::from_millis(1));
        };
        let after = self.files();
        self.check(&after);
        let changed = changes(&before, &after);
        let is_unsealed = self.victim.seal.is_some_and(|seal| !after.contains_key(Path::new(seal)));
        if ended_before {
            // Where a folder is not replaced, no whole run follows that tells the new length.
            self.length = self.length.min(time);
        } else {
            tally.killed += 1;
            tally.with_leftovers += usize::from(!temporaries(&after).is_empty());
            tally.unsealed += usize::from(is_unsealed);
        }
        // The next run makes what the killed one would have made.
        self.runs -= 1;
        self.run();
        let expected = match self.victim.new_folder {
            Some(_) => self.outputs.clone(),
            None => changes(&before, &self.files()),
        };
        if changed.is_empty() || is_unsealed {
            return;
        }
        let missing: Vec<&PathBuf> = expected.difference(&changed).collect();
        let waits =
            |output: &Path| temporaries(&after).into_iter().any(|path| self.is_whole(output.extension(), path, &after[path]));
        assert!(changed.is_subset(&expected), "{name}, killed after {time:?}: {changed:?} instead of {expected:?}");
        assert!(
            missing.iter().all(|output| !ended_before && waits(output)),
            "{name}, killed after {time:?}: {missing:?} are missing, but outputs appear together or not at all"
        );
        tally.complete += usize::from(!ended_before && missing.is_empty());
        tally.parted += usize::from(!missing.is_empty());
    }

    /// The files below the folder of the bench, with their contents.
    fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let (mut files, mut folders) = (BTreeMap::new(), vec![PathBuf::new()]);
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(self.folder.path().join(&folder)).expect("a folder") {
                let entry = entry.expect("an entry");
                let path = folder.join(entry.file_name());
                match entry.file_type().expect("a type").is_dir() {
                    true => folders.push(path),
                    false => _ = files.insert(path, fs::read(entry.path()).expect("a file")),
                }
            }
        }
        files
    }

    /// Checks every file that does not have a temporary name: it is whole, or the user's.
    fn check(&self, files: &BTreeMap<PathBuf, Vec<u8>>) {
        let name = self.victim.name;
        for (path, contents) in files.iter().filter(|(path, _)| !is_temporary(path)) {
            let is_whole = self.is_whole(path.extension(), path, contents);
            assert!(is_whole, "{name} left {} in {} bytes", path.display(), contents.len());
        }
        let users = files.keys().filter(|path| path.ends_with(OF_THE_USER)).count();
        assert_eq!(users, if self.victim.seal.is_some() { 2 } else { 1 }, "{name}: the user's files");
        assert!(files.contains_key(Path::new("rig/rig.toml")), "{name}: the input");
    }

    /// True if the contents of the file `path` are all that a file with such an extension should have.
    fn is_whole(&self, extension: Option<&OsStr>, path: &Path, contents: &[u8]) -> bool {
        match extension.and_then(OsStr::to_str) {
            Some("png") => image::load_from_memory_with_format(contents, image::ImageFormat::Png).is_ok(),
            Some("pfm") => {
                let header = contents.splitn(4, |&byte| byte == b'\n').take(3).map(|line| line.len() + 1).sum::<usize>();
                contents.starts_with(b"Pf") && contents.len() == header + 4 * 96 * 64
            }
            Some("ply") => contents.starts_with(b"ply\n") && contents.len() > 1000,
            Some("html") => contents.trim_ascii_end().ends_with(b"</html>"),
            Some("svg") => contents.trim_ascii_end().ends_with(b"</svg>"),
            Some("json") => serde_json::from_slice::<serde_json::Value>(contents).is_ok(),
            Some("log") => contents.ends_with(b"\n"),
            Some("txt") => contents == b"the user's",
            Some("toml") => {
                let folder = self.folder.path().join(path.parent().expect("a folder"));
                // A rig that is there is complete, with all of its images.
                Rig::load(&folder).is_ok_and(|rig| Frames::load(&rig.images.within(&folder)).is_ok())
            }
            _ => false,
        }
    }
}

fn is_temporary(path: &Path) -> bool {
    path.iter().any(|part| part.to_str().is_some_and(|part| part.starts_with(TEMPORARY)))
}

fn temporaries(files: &BTreeMap<PathBuf, Vec<u8>>) -> Vec<&PathBuf> {
    files.keys().filter(|path| is_temporary(path)).collect()
}

/// The files that are new or have other contents, temporary ones aside.
fn changes(before: &BTreeMap<PathBuf, Vec<u8>>, after: &BTreeMap<PathBuf, Vec<u8>>) -> BTreeSet<PathBuf> {
    let changed = after.iter().filter(|(path, contents)| !is_temporary(path) && before.get(*path) != Some(contents));
    changed.map(|(path, _)| path.clone()).collect()
}
