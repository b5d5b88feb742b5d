//! A cluster of Slurm: a controller and two nodes, all on the loopback address.

use anyhow::{Result, ensure};
use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use super::{
    daemon::{self, Daemon},
    guide,
    shared_folder::SharedFolder,
};
use crate::{
    system::{
        free_ports,
        process::{command, read},
    },
    tools::tool,
};

/// The nodes. The second one is lost.
const NODES: [&str; 2] = ["one", "two"];

/// A running cluster.
struct SlurmCluster<'a> {
    shared: &'a SharedFolder,
    configuration: PathBuf,
    _controller: [Daemon; 2],
    nodes: [Daemon; 2],
}

/// Runs the guide's array job, loses a node, and compares what is left with what one machine makes.
pub fn check(shared: &SharedFolder) -> Result<()> {
    if read(&mut command("id", ["-u"]))? != "0" {
        println!("slurm: skipped, its daemons run as root");
        return Ok(());
    }
    let start = Instant::now();
    let mut cluster = SlurmCluster::start(shared)?;
    fs::write(shared.path("match.sh"), guide::block("#SBATCH --array")?)?;
    let submit = guide::block("sbatch --parsable")?;
    cluster.read("sh", &["-e", "-c", &submit])?;
    let out = shared.path("out");
    shared.wait("the first rigs", || {
        let is_busy = || cluster.read("squeue", &["--noheader", "--states=RUNNING", "--nodelist=two"]);
        Ok(shared.records(&out).len() >= 3 && !is_busy()?.is_empty())
    })?;
    cluster.lose_second_node()?;
    let before = shared.records(&out);
    println!("slurm: node two is lost when {} rigs are done", before.len());
    shared.wait("the array job", || Ok(cluster.read("squeue", &["--noheader"])?.is_empty()))?;
    let jobs = cluster.read("scontrol", &["--oneliner", "show", "job"])?;
    let restarts = jobs.lines().filter(|job| job.contains(" Restarts=1 ")).count();
    ensure!(restarts > 0, "no task was started again: none ran on the node that was lost");
    shared.check(&out, &before)?;
    let merged = fs::read_to_string(shared.path("merged.json"))?;
    ensure!(merged == shared.expected, "the merged results are not those of one machine");
    println!(
        "slurm: {restarts} task started again on the other node; no rig was lost or done twice, and the merged results have the bits \
         of one machine's, in {:.0} s",
        start.elapsed().as_secs_f64()
    );
    Ok(())
}

impl SlurmCluster<'_> {
    /// Starts the daemons, and waits until the nodes are idle.
    fn start(shared: &SharedFolder) -> Result<SlurmCluster<'_>> {
        tool::SLURM.install()?;
        tool::MUNGE.install()?;
        let folder = shared.path("slurm");
        for place in ["", "state", "one", "two"] {
            fs::create_dir_all(folder.join(place))?;
        }
        let configuration = folder.join("slurm.conf");
        fs::write(&configuration, configured(&folder)?)?;
        let munged = Daemon::start(&mut munged(shared, &folder)?, &folder.join("munged.log"))?;
        shared.wait("munged", || Ok(folder.join("munge.socket").exists()))?;
        let daemon = |program: &str, arguments: &[&str], log: &str| {
            let mut command = shared.command(program);
            Daemon::start(command.arg("-D").args(arguments).env("SLURM_CONF", &configuration), &folder.join(log))
        };
        let controller = daemon("slurmctld", &[], "slurmctld.log")?;
        let [one, two] = NODES.map(|node| daemon("slurmd", &["-N", node], &format!("{node}.log")));
        let cluster =
            SlurmCluster { shared, configuration: configuration.clone(), _controller: [controller, munged], nodes: [one?, two?] };
        shared.wait("the nodes", || {
            // The controller does not answer at first.
            let states = cluster.read("sinfo", &["--noheader", "--Node", "--format=%T"]).unwrap_or_default();
            Ok(states.lines().filter(|state| *state == "idle").count() == NODES.len())
        })?;
        Ok(cluster)
    }

    /// A program that talks to the cluster.
    fn client(&self, program: &str) -> std::process::Command {
        let mut command = self.shared.command(program);
        command.env("SLURM_CONF", &self.configuration);
        command
    }

    fn read(&self, program: &str, arguments: &[&str]) -> Result<String> {
        read(self.client(program).args(arguments))
    }

    /// Kills the second node with all that runs on it. Its tasks are no children of its daemon.
    fn lose_second_node(&mut self) -> Result<()> {
        let parents = daemon::parents()?;
        let configuration = format!("SLURM_CONF={}", self.configuration.display());
        let is_task = |process: &u32| {
            let environment = fs::read(format!("/proc/{process}/environ")).unwrap_or_default();
            let has = |variable: &str| environment.split(|&byte| byte == 0).any(|found| found == variable.as_bytes());
            has("SLURMD_NODENAME=two") && has(&configuration)
        };
        let tasks: Vec<u32> = parents.iter().map(|(process, _)| *process).filter(is_task).collect();
        let is_step =
            |process: &u32| fs::read_to_string(format!("/proc/{process}/comm")).is_ok_and(|name| name.trim_end() == "slurmstepd");
        let steps = parents.iter().filter(|(process, _)| tasks.contains(process)).map(|(_, parent)| *parent).filter(is_step);
        let steps: Vec<u32> = steps.collect();
        ensure!(!steps.is_empty(), "nothing runs on the node");
        // The steps would tell that their tasks have ended.
        daemon::kill(&steps)?;
        daemon::kill(&tasks)?;
        self.nodes[1].kill()
    }
}

/// The daemon that authenticates the others.
fn munged(shared: &SharedFolder, folder: &Path) -> Result<std::process::Command> {
    use std::os::unix::fs::PermissionsExt;
    let key = folder.join("munge.key");
    let random: Vec<u8> = fs::read("/proc/sys/kernel/random/uuid")?.repeat(4);
    fs::write(&key, random)?;
    fs::set_permissions(&key, fs::Permissions::from_mode(0o600))?;
    let option = |name: &str, file: &str| format!("--{name}={}", folder.join(file).display());
    let mut munged = shared.command("munged");
    // It would refuse a temporary folder.
    munged.args(["--foreground", "--force"]).args([
        option("key-file", "munge.key"),
        option("socket", "munge.socket"),
        option("pid-file", "munge.pid"),
        option("seed-file", "munge.seed"),
    ]);
    Ok(munged)
}

/// The configuration of a cluster whose files are in a folder.
fn configured(folder: &Path) -> Result<String> {
    let ports: [u16; 1 + NODES.len()] = free_ports::find()?;
    let (host, folder) = (read(&mut command("hostname", ["-s"]))?, folder.display());
    let nodes: String = NODES
        .iter()
        .zip(&ports[1..])
        .map(|(node, port)| format!("NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=1 State=UNKNOWN\n"))
        .collect();
    Ok(format!(
        "ClusterName=loopback\n\
         SlurmctldHost={host}(127.0.0.1)\n\
         SlurmctldPort={}\n\
         SlurmUser=root\n\
         AuthType=auth/munge\n\
         # A job of a node that failed starts again when its credential has expired.\n\
         AuthInfo=socket={folder}/munge.socket,cred_expire=5\n\
         SlurmctldPidFile={folder}/slurmctld.pid\n\
         SlurmdPidFile={folder}/%n.pid\n\
         StateSaveLocation={folder}/state\n\
         SlurmdSpoolDir={folder}/%n\n\
         ProctrackType=proctrack/linuxproc\n\
         TaskPlugin=task/none\n\
         MpiDefault=none\n\
         SelectType=select/cons_tres\n\
         SelectTypeParameters=CR_Core\n\
         SlurmdParameters=config_overrides\n\
         # The seconds until a node that does not answer counts as lost.\n\
         SlurmdTimeout=10\n\
         MessageTimeout=5\n\
         SchedulerParameters=sched_interval=2\n\
         {nodes}\
         PartitionName=main Nodes={} Default=YES MaxTime=INFINITE State=UP\n",
        ports[0],
        NODES.join(","),
    ))
}
