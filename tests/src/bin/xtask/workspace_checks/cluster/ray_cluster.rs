//! A cluster of Ray: two nodes on the loopback address.

use anyhow::{Context, Result, ensure};
use std::{fs, process::Command, time::Instant};

use super::{daemon::Daemon, guide, shared_folder::SharedFolder};
use crate::{
    system::{free_ports, process::run},
    workspace_checks::python_package::{PythonEnvironment, wheels},
};

/// The versions of Ray and what it needs, with their checksums, made as those of the package's tests.
const REQUIREMENTS: &str = "python/cluster-requirements.txt";

/// Runs the guide's script on two nodes, loses one, and compares what is left with what one machine makes.
pub fn check(shared: &SharedFolder) -> Result<()> {
    let environment = PythonEnvironment::install("ray", REQUIREMENTS)?;
    environment.install_package(&wheels()?)?;
    let start = Instant::now();
    let [port] = free_ports::find()?;
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

    fs::write(shared.path("match_rigs.py"), guide::block("@ray.remote")?)?;
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
