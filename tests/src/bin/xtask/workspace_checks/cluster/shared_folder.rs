//! The things that the nodes of a cluster share: the folder that all of them see, daemons on this machine, and the programs in
//! docs/many-machines.md.

use anyhow::{Context, Result, ensure};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::system::{self, command, read, run};

/// The number of rigs in the list.
const RIGS: usize = 24;
/// The most time that a cluster may take.
const PATIENCE: Duration = Duration::from_secs(540);

/// The folder, with rigs and their list.
pub struct SharedFolder {
    folder: tempfile::TempDir,
    /// The folder of the program.
    programs: PathBuf,
    /// The result of the list on one machine.
    pub expected: String,
}

/// The records of the items that are done, by their names.
pub type Records = BTreeMap<String, Vec<u8>>;

impl SharedFolder {
    /// Makes rigs and their list, and matches them on one machine.
    pub fn new(program: PathBuf) -> Result<SharedFolder> {
        let programs = program.parent().context("the program is in a folder")?.into();
        let mut shared = SharedFolder { folder: tempfile::tempdir()?, programs, expected: String::new() };
        let scenes = ["scene", "--random", "--count", &RIGS.to_string(), "--size", "160x120", "-o", "rigs"];
        run(shared.command(&program.to_string_lossy()).args(scenes))?;
        let list: String = (0..RIGS).map(|number| format!("rigs/{number:04}\n")).collect();
        fs::write(shared.path("rigs.txt"), list)?;
        run(shared.command("sh").args(["-e", "-c", &guide_block("--results whole")?]))?;
        shared.expected = fs::read_to_string(shared.path("whole.json"))?;
        Ok(shared)
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A command that runs in the folder, and finds the program.
    pub fn command(&self, program: &str) -> Command {
        let mut command = command(program, [""; 0]);
        let path = std::env::var("PATH").unwrap_or_default();
        command.current_dir(&self.folder).env("PATH", format!("{}:{path}", self.programs.display()));
        command
    }

    /// The records in a folder of results.
    pub fn records(&self, results: &Path) -> Records {
        let path = |name: &String| results.join(name).join("record.json");
        let names = (0..RIGS).map(|number| format!("rigs/{number:04}"));
        names.filter_map(|name| Some((name.clone(), fs::read(path(&name)).ok()?))).collect()
    }

    /// Waits until a condition holds.
    pub fn wait(&self, what: &str, mut holds: impl FnMut() -> Result<bool>) -> Result<()> {
        let start = Instant::now();
        while !holds()? {
            ensure!(start.elapsed() < PATIENCE, "{what} took more than {} s", PATIENCE.as_secs());
            thread::sleep(Duration::from_millis(20));
        }
        Ok(())
    }

    /// Checks that all rigs are done, and that none of those that were done `before` was done again.
    pub fn check(&self, results: &Path, before: &Records) -> Result<()> {
        let records = self.records(results);
        ensure!(records.len() == RIGS, "{} of {RIGS} rigs are done", records.len());
        for (name, record) in before {
            ensure!(records.get(name) == Some(record), "{name} was done twice: its record is another one");
        }
        Ok(())
    }

    /// The SHA-256 of the disparities of each rig, in JSON that one machine or a cluster wrote.
    pub fn disparities(json: &str) -> Result<Vec<(String, String)>> {
        let rigs: Vec<serde_json::Value> = serde_json::from_str(json)?;
        let pair = |rig: &serde_json::Value| {
            let output = rig["outputs"].as_array()?.iter().find(|output| output["file"] == "disparity.pfm")?;
            Some((rig["rig"].as_str()?.to_owned(), output["sha256"].as_str()?.to_owned()))
        };
        rigs.iter().map(|rig| pair(rig).context("a rig without disparities")).collect()
    }
}

/// A running program, which ends with its descendants when it is dropped.
pub struct Daemon(Child);

impl Daemon {
    /// Starts a program that writes to a log.
    pub fn start(command: &mut Command, log: &Path) -> Result<Daemon> {
        let file = fs::File::create(log).with_context(|| format!("cannot write {}", log.display()))?;
        command.stdin(Stdio::null()).stdout(file.try_clone()?).stderr(file);
        let program = command.get_program().to_string_lossy().into_owned();
        command.spawn().map(Daemon).with_context(|| format!("cannot start {program}"))
    }

    /// Returns true if it still runs.
    pub fn is_running(&mut self) -> Result<bool> {
        Ok(self.0.try_wait()?.is_none())
    }

    /// The program and its descendants.
    pub fn processes(&self) -> Result<Vec<u32>> {
        let parents = parents()?;
        let mut processes = vec![self.0.id()];
        for index in 0.. {
            let Some(&parent) = processes.get(index) else { break };
            processes.extend(parents.iter().filter(|(_, of)| *of == parent).map(|(process, _)| *process));
        }
        Ok(processes)
    }

    /// Kills it with its descendants at once, as when its machine fails.
    pub fn kill(&mut self) -> Result<()> {
        kill_processes(&self.processes()?)?;
        self.0.wait()?;
        Ok(())
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // It may have ended, and there is nobody to tell.
        let _ = self.kill();
    }
}

/// Kills processes. Those that have ended meanwhile are no error.
pub fn kill_processes(processes: &[u32]) -> Result<()> {
    let processes = processes.iter().map(u32::to_string);
    command("kill", ["-9".to_owned()].into_iter().chain(processes)).stderr(Stdio::null()).status()?;
    Ok(())
}

/// All processes with their parents.
pub fn parents() -> Result<Vec<(u32, u32)>> {
    let list = read(&mut command("ps", ["-e", "-o", "pid=,ppid="]))?;
    let pair = |line: &str| {
        let mut numbers = line.split_whitespace().map(str::parse);
        Some((numbers.next()?.ok()?, numbers.next()?.ok()?))
    };
    Ok(list.lines().filter_map(pair).collect())
}

const GUIDE: &str = "docs/many-machines.md";

/// The block of code in the guide that contains some words.
pub fn guide_block(words: &str) -> Result<String> {
    let text = fs::read_to_string(system::root().join(GUIDE)).with_context(|| format!("cannot read {GUIDE}"))?;
    let blocks = text.split("```").skip(1).step_by(2).filter_map(|block| Some(block.split_once('\n')?.1));
    let found = blocks.map(str::to_owned).find(|block| block.contains(words));
    found.with_context(|| format!("{GUIDE} has no block of code with {words}"))
}
