//! A simulated arm of Universal Robots that listens on the same interfaces as a real one.
//!
//! Its protocols and poses were written from the manufacturer's documentation, without any code of the
//! driver, and a third-party client must understand it too.

mod fault;
mod order;
mod rtde;
mod script;
mod script_port;
mod variables;
mod world;

use std::{
    io::{self, ErrorKind, Write},
    net::{IpAddr, Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream},
    sync::Arc,
    thread::{self, JoinHandle},
    time::Duration,
};

use crate::simulated::pose::Pose;
use world::World;

pub use fault::Fault;
pub use order::Heard;

/// A running arm. Dropping it switches it off.
pub struct SimulatedArm {
    world: Arc<World>,
    script: SocketAddr,
    rtde: SocketAddr,
    listeners: Vec<JoinHandle<()>>,
}

type Serve = fn(TcpStream, &World) -> io::Result<()>;

impl SimulatedArm {
    /// Starts an arm at a pose, on free ports of this machine.
    pub fn start(pose: Pose) -> SimulatedArm {
        SimulatedArm::listen(Ipv4Addr::LOCALHOST.into(), [0, 0], pose).expect("free ports")
    }

    /// Starts an arm at a pose, listening for scripts and RTDE on these ports of `ip`. Port 0 stands for any
    /// free one.
    pub fn listen(ip: IpAddr, [script, rtde]: [u16; 2], pose: Pose) -> io::Result<SimulatedArm> {
        let [script, rtde] = [script, rtde].map(|port| TcpListener::bind((ip, port)));
        let (script, rtde) = (script?, rtde?);
        let (script_address, rtde_address) = (script.local_addr()?, rtde.local_addr()?);
        let world = Arc::new(World::new(pose));
        let services: [(TcpListener, Serve); 2] = [(script, script_port::serve), (rtde, rtde::serve)];
        let mut listeners = Vec::new();
        for (listener, serve) in services {
            listener.set_nonblocking(true)?;
            let world = world.clone();
            listeners.push(thread::spawn(move || accept(&listener, &world, serve)));
        }
        Ok(SimulatedArm { world, script: script_address, rtde: rtde_address, listeners })
    }

    /// The argument for `--stage`.
    pub fn spec(&self) -> String {
        format!("ur10:{},{}", self.script, self.rtde.port())
    }

    /// The ports for scripts and RTDE.
    pub fn ports(&self) -> [u16; 2] {
        [self.script.port(), self.rtde.port()]
    }

    /// Its pose.
    pub fn pose(&self) -> Pose {
        self.world.now().pose
    }

    /// Whether it is moving.
    pub fn is_moving(&self) -> bool {
        self.world.now().motion.is_some()
    }

    /// The orders received since the last call.
    pub fn heard(&self) -> Vec<Heard> {
        std::mem::take(&mut self.world.now().heard)
    }

    /// Makes it fail from now on.
    pub fn fail(&self, fault: Fault) {
        self.world.now().fault = fault;
    }

    /// Sets the robot mode and the safety mode, as RTDE numbers them.
    pub fn set_modes(&self, robot: i32, safety: i32) {
        let mut arm = self.world.now();
        (arm.robot_mode, arm.safety_mode) = (robot, safety);
    }

    /// Clears all faults and halts it.
    pub fn release(&self) {
        self.world.now().release();
    }

    /// Closes all connections. New ones are accepted.
    pub fn disconnect(&self) {
        for connection in self.world.now().connections.drain(..) {
            let _ = connection.shutdown(Shutdown::Both);
        }
    }
}

impl Drop for SimulatedArm {
    fn drop(&mut self) {
        self.world.now().is_switched_off = true;
        self.disconnect();
        for listener in self.listeners.drain(..) {
            let _ = listener.join();
        }
    }
}

/// Accepts connections until the arm is switched off.
fn accept(listener: &TcpListener, world: &Arc<World>, serve: Serve) {
    loop {
        let accepted = listener.accept();
        let mut arm = world.now();
        if arm.is_switched_off {
            return;
        }
        match accepted {
            Ok((mut stream, _)) if arm.fault == Fault::OtherProtocol => {
                let _ = stream.write_all(b"SSH-2.0-OpenSSH_9.2p1 Debian-2\r\n");
                arm.connections.push(stream);
            }
            Ok((stream, _)) => {
                let (Ok(()), Ok(connection)) = (stream.set_nonblocking(false), stream.try_clone()) else { continue };
                arm.connections.push(connection);
                drop(arm);
                let world = world.clone();
                thread::spawn(move || {
                    let end = stream.try_clone();
                    // A client may disconnect at any time.
                    let _ = serve(stream, &world);
                    end.and_then(|stream| stream.shutdown(Shutdown::Both))
                });
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                drop(arm);
                thread::sleep(Duration::from_millis(5));
            }
            Err(_) => {}
        }
    }
}
