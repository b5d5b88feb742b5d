//! The simulated arm as a server for clients in other languages: `cargo run -p multiscopic-tests --example
//! arm -- --ip 127.0.0.2`
//!
//! It prints the argument for `--stage`, then the orders it receives, until it is killed.

use std::{io, net::IpAddr, thread, time::Duration};

use clap::Parser;
use multiscopic_tests::simulated::arm::SimulatedArm;

/// A tool that looks down.
const POSE: [f64; 6] = [0.4, -0.2, 0.5, std::f64::consts::PI, 0.0, 0.0];

/// Listens like an arm of Universal Robots
#[derive(Parser)]
struct Options {
    /// The address to listen on
    #[arg(long, default_value = "127.0.0.1")]
    ip: IpAddr,

    /// The port for scripts
    #[arg(long, default_value_t = 30002)]
    script_port: u16,

    /// The port for real-time data
    #[arg(long, default_value_t = 30004)]
    rtde_port: u16,

    /// The tool's pose, in metres and radians
    #[arg(long, num_args = 6, value_names = ["X", "Y", "Z", "RX", "RY", "RZ"], default_values_t = POSE, allow_negative_numbers = true)]
    pose: Vec<f64>,
}

fn main() -> io::Result<()> {
    let options = Options::parse();
    let pose = std::array::from_fn(|i| options.pose[i]);
    let arm = SimulatedArm::listen(options.ip, [options.script_port, options.rtde_port], pose)?;
    println!("{}", arm.spec());
    loop {
        for heard in arm.heard() {
            println!("{heard:?}");
        }
        thread::sleep(Duration::from_millis(100));
    }
}
