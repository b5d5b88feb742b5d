//! A task of this runner that runs while others do.

use anyhow::{Context, Result, ensure};
use std::{
    env,
    fs::{self, File},
    path::PathBuf,
    process::{Child, Command},
};

use crate::system::folders;

/// `cargo xtask` with a task, in the background.
pub struct BackgroundTask {
    task: &'static str,
    child: Child,
    log: PathBuf,
}

impl BackgroundTask {
    /// Starts a task, by its name and arguments, with what others leave of the processors. Its output goes to `target/TASK.log`.
    pub fn start(arguments: &[&'static str]) -> Result<BackgroundTask> {
        let task = *arguments.first().context("a task")?;
        let log = folders::target().join(format!("{task}.log"));
        let file = File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
        let runner = env::current_exe().context("this runner's path")?;
        let mut command = if cfg!(unix) { Command::new("nice") } else { Command::new(&runner) };
        if cfg!(unix) {
            command.args(["-n", "10"]).arg(&runner);
        }
        let child = command.args(arguments).stdout(file.try_clone()?).stderr(file).spawn();
        let child = child.with_context(|| format!("cannot start {}", runner.display()))?;
        println!("{task} runs in the background: {}", log.display());
        Ok(BackgroundTask { task, child, log })
    }

    /// Waits for its end, and prints its output; fails unless it succeeded.
    pub fn finish(mut self) -> Result<()> {
        let status = self.child.wait()?;
        let output = fs::read(&self.log).with_context(|| format!("cannot read {}", self.log.display()))?;
        println!("{}", String::from_utf8_lossy(&output));
        ensure!(status.success(), "{} failed ({status})", self.task);
        Ok(())
    }
}

impl Drop for BackgroundTask {
    /// Ends it, if another step failed before.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
