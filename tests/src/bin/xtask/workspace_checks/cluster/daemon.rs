//! Programs that run until they are ended.

use anyhow::{Context, Result};
use std::{
    fs,
    path::Path,
    process::{Child, Command, Stdio},
};

use crate::system::process::{command, read};

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
        kill(&self.processes()?)?;
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
pub fn kill(processes: &[u32]) -> Result<()> {
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
