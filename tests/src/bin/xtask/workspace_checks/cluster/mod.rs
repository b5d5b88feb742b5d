//! Makes clusters of this machine, shares work between their nodes, loses one in the middle, and compares the results with those
//! of one machine.
//!
//! They run the commands that docs/many-machines.md shows.

mod shared_folder;

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use self::shared_folder::{Daemon, SharedFolder, guide_block, kill_processes, parents};
use crate::{
    system::{built_program, command, free_ports, read, run},
    tools,
    workspace_checks::python_package::{PythonEnvironment, wheels},
};

/// The clusters to make.
#[derive(Args)]
pub struct Clusters {
    /// One engine alone
    #[arg(value_name = "ENGINE")]
    engine: Option<ClusterEngine>,
}

/// The software that shares work between nodes.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ClusterEngine {
    Slurm,
    Ray,
}

impl Clusters {
    /// Both clusters.
    pub const ALL: Clusters = Clusters { engine: None };

    /// Makes them. It needs Linux, and Slurm needs root.
    pub fn run(&self) -> Result<()> {
        let is_asked_for = |engine| self.engine.is_none_or(|one| one == engine);
        let folder = SharedFolder::new(built_program()?)?;
        if is_asked_for(ClusterEngine::Slurm) {
            check_slurm(&folder)?;
        }
        if is_asked_for(ClusterEngine::Ray) {
            check_ray(&folder)?;
        }
        Ok(())
    }
}

/// The nodes. The second one is lost.
const SLURM_NODES: [&str; 2] = ["one", "two"];

/// A running cluster.
struct SlurmCluster<'a> {
    shared: &'a SharedFolder,
    configuration: PathBuf,
    _controller: [Daemon; 2],
    nodes: [Daemon; 2],
}

/// Runs the guide's array job, loses a node, and compares what is left with what one machine makes.
fn check_slurm(shared: &SharedFolder) -> Result<()> {
    if read(&mut command("id", ["-u"]))? != "0" {
        println!("slurm: skipped, its daemons run as root");
        return Ok(());
    }
    let start = Instant::now();
    let mut cluster = SlurmCluster::start(shared)?;
    fs::write(shared.path("match.sh"), guide_block("#SBATCH --array")?)?;
    let submit = guide_block("sbatch --parsable")?;
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
        tools::SLURM.install()?;
        tools::MUNGE.install()?;
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
        let [one, two] = SLURM_NODES.map(|node| daemon("slurmd", &["-N", node], &format!("{node}.log")));
        let cluster =
            SlurmCluster { shared, configuration: configuration.clone(), _controller: [controller, munged], nodes: [one?, two?] };
        shared.wait("the nodes", || {
            // The controller does not answer at first.
            let states = cluster.read("sinfo", &["--noheader", "--Node", "--format=%T"]).unwrap_or_default();
            Ok(states.lines().filter(|state| *state == "idle").count() == SLURM_NODES.len())
        })?;
        Ok(cluster)
    }

    /// A program that talks to the cluster.
    fn client(&self, program: &str) -> Command {
        let mut command = self.shared.command(program);
        command.env("SLURM_CONF", &self.configuration);
        command
    }

    fn read(&self, program: &str, arguments: &[&str]) -> Result<String> {
        read(self.client(program).args(arguments))
    }

    /// Kills the second node with all that runs on it. Its tasks are no children of its daemon.
    fn lose_second_node(&mut self) -> Result<()> {
        let parents = parents()?;
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
        kill_processes(&steps)?;
        kill_processes(&tasks)?;
        self.nodes[1].kill()
    }
}

/// The daemon that authenticates the others.
fn munged(shared: &SharedFolder, folder: &Path) -> Result<Command> {
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
    let ports: [u16; 1 + SLURM_NODES.len()] = free_ports()?;
    let (host, folder) = (read(&mut command("hostname", ["-s"]))?, folder.display());
    let nodes: String = SLURM_NODES
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
        SLURM_NODES.join(","),
    ))
}

/// The versions of Ray and what it needs, with their checksums, made as those of the package's tests.
const RAY_REQUIREMENTS: &str = "python/cluster-requirements.txt";

/// Runs the guide's script on two nodes, loses one, and compares what is left with what one machine makes.
fn check_ray(shared: &SharedFolder) -> Result<()> {
    let environment = PythonEnvironment::install("ray", RAY_REQUIREMENTS)?;
    environment.install_package(&wheels()?)?;
    let start = Instant::now();
    let [port] = free_ports()?;
    let address = format!("127.0.0.1:{port}");
    let node = |arguments: &[&str], log: &str| {
        let mut ray = Command::new(environment.program("ray"));
        ray.args(["start", "--block", "--node-ip-address=127.0.0.1", "--num-cpus=1", "--object-store-memory=100000000"]);
        ray.args(["--disable-usage-stats"]).args(arguments).current_dir(shared.path(""));
        Daemon::start(&mut ray, &shared.path(log))
    };
    let temporary = shared.path("ray");
    let temporary = format!("--temp-dir={}", temporary.display());
    let head = node(&["--head", &format!("--port={port}"), "--include-dashboard=false", &temporary], "head.log")?;
    let nodes = || -> Result<usize> {
        let count = "import ray; ray.init(log_to_driver=False); print(sum(node['Alive'] for node in ray.nodes()))";
        let mut python = Command::new(environment.program("python"));
        let output = python.args(["-c", count]).env("RAY_ADDRESS", &address).output()?;
        Ok(String::from_utf8_lossy(&output.stdout).trim().parse().unwrap_or_default())
    };
    shared.wait("the first node", || Ok(nodes()? == 1))?;
    let mut second = node(&[&format!("--address={address}")], "second.log")?;
    shared.wait("the second node", || Ok(nodes()? == 2))?;

    fs::write(shared.path("match_rigs.py"), guide_block("@ray.remote")?)?;
    let script = |out: &str| {
        let mut python = Command::new(environment.program("python"));
        python.args(["match_rigs.py", "rigs.txt", out]).current_dir(shared.path("")).env("RAY_ADDRESS", &address);
        python
    };
    let out = shared.path("ray-out");
    let mut driver = Daemon::start(&mut script("ray-out"), &shared.path("driver.log"))?;
    shared.wait("the first rigs", || Ok(shared.records(&out).len() >= 4))?;
    ensure!(driver.is_running()?, "all rigs were done before a node was lost");
    second.kill()?;
    let before = shared.records(&out);
    println!("ray: the second node is lost when {} rigs are done", before.len());
    shared.wait("the script", || Ok(!driver.is_running()?))?;
    let log = fs::read_to_string(shared.path("driver.log"))?;
    let merged = fs::read_to_string(out.join("merged.json")).with_context(|| format!("the script has failed: {log}"))?;
    shared.check(&out, &before)?;

    // One machine is left.
    run(&mut script("ray-whole"))?;
    ensure!(merged == fs::read_to_string(shared.path("ray-whole/merged.json"))?, "the results are not those of one machine");
    let [found, expected] = [&merged, &shared.expected].map(|json| SharedFolder::disparities(json));
    ensure!(found? == expected?, "the disparities are not those of the program");
    drop(head);
    println!(
        "ray: no rig was lost or done twice, and the results have the bits of one machine's and of the program's, in {:.0} s",
        start.elapsed().as_secs_f64()
    );
    Ok(())
}
