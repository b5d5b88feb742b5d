//! A simulated arm of Universal Robots, which listens on sockets as a real one does and has faults on demand.
//!
//! It shares no code with what drives it: its packages, its script and its poses are written from the documentation a second time, and a
//! client that others wrote must understand it.

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

/// An arm, until it is dropped.
pub struct SimulatedArm {
    world: Arc<World>,
    script: SocketAddr,
    rtde: SocketAddr,
    listeners: Vec<JoinHandle<()>>,
}

type Serve = fn(TcpStream, &World) -> io::Result<()>;

impl SimulatedArm {
    /// An arm at a pose, on ports of this machine that are free.
    pub fn start(pose: Pose) -> SimulatedArm {
        SimulatedArm::listen(Ipv4Addr::LOCALHOST.into(), [0, 0], pose).expect("free ports")
    }

    /// An arm at a pose, on an address of this machine and its ports for scripts and RTDE; 0 is any that is free.
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

    /// Its name for `--stage`.
    pub fn spec(&self) -> String {
        format!("ur10:{},{}", self.script, self.rtde.port())
    }

    /// Its ports for scripts and RTDE.
    pub fn ports(&self) -> [u16; 2] {
        [self.script.port(), self.rtde.port()]
    }

    /// Where it is.
    pub fn pose(&self) -> Pose {
        self.world.now().pose
    }

    /// Whether it moves.
    pub fn is_moving(&self) -> bool {
        self.world.now().motion.is_some()
    }

    /// What it was told since it was asked last.
    pub fn heard(&self) -> Vec<Heard> {
        std::mem::take(&mut self.world.now().heard)
    }

    /// Breaks it.
    pub fn fail(&self, fault: Fault) {
        self.world.now().fault = fault;
    }

    /// Sets its modes as RTDE numbers them: the robot's and the safety's.
    pub fn set_modes(&self, robot: i32, safety: i32) {
        let mut arm = self.world.now();
        (arm.robot_mode, arm.safety_mode) = (robot, safety);
    }

    /// Mends it: whatever was wrong is not any more, and it stands.
    pub fn release(&self) {
        self.world.now().release();
    }

    /// Breaks all connections. New ones can be made.
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

/// Takes connections until the arm is switched off.
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
                    // A client that is gone is no matter.
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
