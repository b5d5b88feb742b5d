//! A simulated arm of Universal Robots that listens on the same interfaces as a real one.
//!
//! Its protocols and poses were written from the manufacturer's documentation, without any code of the
//! driver, and a third-party client must understand it too.

mod interfaces;
mod world;

use std::{
    io::{self, ErrorKind, Read, Write},
    net::{IpAddr, Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream},
    ops::ControlFlow,
    sync::Arc,
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use multiscopic::capture::{
    SystemClock,
    stage::{self, AnyStage, Arm, ArmAddress, Limits, StageError, StageSpec},
};

use super::{
    SimulatedClock,
    network::{Service, SimulatedNetwork},
    pose::Pose,
};
use interfaces::{Rtde, Scripts};
use world::World;

pub use world::{Fault, Heard};

/// A running arm. Dropping it switches it off.
pub struct SimulatedArm {
    world: Arc<World>,
    interface: Interface,
}

/// The way to an arm.
enum Interface {
    /// Sockets of this machine, in the time of the system.
    Sockets { script: SocketAddr, rtde: SocketAddr, listeners: Vec<JoinHandle<()>> },
    /// A network in simulated time.
    Simulated { network: Arc<SimulatedNetwork>, clock: Arc<SimulatedClock> },
}

/// Makes the service of a new connection.
type Serve = fn(Arc<World>) -> Box<dyn Service>;

/// The services, for scripts and RTDE.
const SERVICES: [Serve; 2] = [|world| Box::new(Scripts::new(world)), |world| Box::new(Rtde::new(world))];

impl SimulatedArm {
    /// Starts an arm at a pose, on free ports of this machine, in the time of the system.
    pub fn start(pose: Pose) -> SimulatedArm {
        SimulatedArm::listen(Ipv4Addr::LOCALHOST.into(), [0, 0], pose).expect("free ports")
    }

    /// Starts an arm at a pose, listening for scripts and RTDE on these ports of `ip`, in the time of the system. Port 0 stands
    /// for any free one.
    pub fn listen(ip: IpAddr, [script, rtde]: [u16; 2], pose: Pose) -> io::Result<SimulatedArm> {
        let [script, rtde] = [script, rtde].map(|port| TcpListener::bind((ip, port)));
        let ports = [script?, rtde?];
        let [script, rtde] = [ports[0].local_addr()?, ports[1].local_addr()?];
        let world = Arc::new(World::new(pose, Arc::new(SystemClock)));
        let mut listeners = Vec::new();
        for (listener, service) in ports.into_iter().zip(SERVICES) {
            listener.set_nonblocking(true)?;
            let world = world.clone();
            listeners.push(thread::spawn(move || accept(&listener, &world, service)));
        }
        Ok(SimulatedArm { world, interface: Interface::Sockets { script, rtde, listeners } })
    }

    /// Starts an arm at a pose, in the time of `clock`. It has no sockets: [`stage`](SimulatedArm::stage) opens it.
    pub fn in_time_of(clock: &Arc<SimulatedClock>, pose: Pose) -> SimulatedArm {
        let world = Arc::new(World::new(pose, clock.clone()));
        let shared = world.clone();
        let network = SimulatedNetwork::new(clock, move |port| {
            let service = SERVICES[usize::from(port == ArmAddress::RTDE_PORT)];
            Some(new_service(&shared, service))
        });
        SimulatedArm { world, interface: Interface::Simulated { network, clock: clock.clone() } }
    }

    /// Opens it with the driver under test.
    ///
    /// # Errors
    /// Those of the driver.
    pub fn stage(&self, limits: &Limits) -> Result<AnyStage, StageError> {
        match &self.interface {
            Interface::Sockets { .. } => stage::open(&self.spec().parse::<StageSpec>()?, limits),
            Interface::Simulated { network, clock } => {
                let [script_port, rtde_port] = self.ports();
                let address = ArmAddress { host: "arm.simulated".into(), script_port, rtde_port };
                Arm::connect_with_clock(&address, network.client(), limits, clock.clone()).map(AnyStage::new)
            }
        }
    }

    /// The argument for `--stage`.
    pub fn spec(&self) -> String {
        match &self.interface {
            Interface::Sockets { script, rtde, .. } => format!("ur10:{script},{}", rtde.port()),
            Interface::Simulated { .. } => "ur10:arm.simulated".into(),
        }
    }

    /// The ports for scripts and RTDE.
    pub fn ports(&self) -> [u16; 2] {
        match &self.interface {
            Interface::Sockets { script, rtde, .. } => [script.port(), rtde.port()],
            Interface::Simulated { .. } => [ArmAddress::SCRIPT_PORT, ArmAddress::RTDE_PORT],
        }
    }

    /// Its pose.
    pub fn pose(&self) -> Pose {
        self.world.now().pose
    }

    /// Returns true if it is moving.
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

    /// Lets time stand still for motions that have covered this distance in metres: the arm stays there at full speed, to be
    /// looked at. An infinite distance lets them go on.
    pub fn freeze_after(&self, distance_m: f64) {
        self.world.now().freezes_after_m = distance_m;
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

    /// Returns true if somebody has connected to it over sockets, and may have left.
    pub fn has_connections(&self) -> bool {
        !self.world.now().connections.is_empty()
    }

    /// Closes all connections. New ones are accepted.
    pub fn disconnect(&self) {
        match &self.interface {
            Interface::Sockets { .. } => {
                for connection in self.world.now().connections.drain(..) {
                    let _ = connection.shutdown(Shutdown::Both);
                }
            }
            Interface::Simulated { network, .. } => network.disconnect(),
        }
    }
}

impl Drop for SimulatedArm {
    fn drop(&mut self) {
        self.world.now().is_switched_off = true;
        self.disconnect();
        if let Interface::Sockets { listeners, .. } = &mut self.interface {
            for listener in listeners.drain(..) {
                let _ = listener.join();
            }
        }
    }
}

/// Another device at the same address.
struct OtherDevice {
    has_greeted: bool,
}

impl Service for OtherDevice {
    fn serve(&mut self, _: &[u8], _: Instant, answer: &mut Vec<u8>) -> ControlFlow<()> {
        if !self.has_greeted {
            answer.extend(b"SSH-2.0-OpenSSH_9.2p1 Debian-2\r\n");
            self.has_greeted = true;
        }
        ControlFlow::Continue(())
    }
}

fn new_service(world: &Arc<World>, service: Serve) -> Box<dyn Service> {
    match world.now().fault {
        Fault::OtherProtocol => Box::new(OtherDevice { has_greeted: false }),
        _ => service(world.clone()),
    }
}

/// Accepts connections until the arm is switched off.
fn accept(listener: &TcpListener, world: &Arc<World>, service: Serve) {
    loop {
        let accepted = listener.accept();
        if world.now().is_switched_off {
            return;
        }
        match accepted {
            Ok((stream, _)) => {
                let (Ok(()), Ok(connection)) = (stream.set_nonblocking(false), stream.try_clone()) else { continue };
                world.now().connections.push(connection);
                let mut service = new_service(world, service);
                let world = world.clone();
                thread::spawn(move || {
                    let end = stream.try_clone();
                    // A client may disconnect at any time.
                    let _ = serve(stream, &mut *service, &world);
                    end.and_then(|stream| stream.shutdown(Shutdown::Both))
                });
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => thread::sleep(Duration::from_millis(5)),
            Err(_) => {}
        }
    }
}

/// Serves a client over a socket until either hangs up.
fn serve(mut stream: TcpStream, service: &mut dyn Service, world: &World) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let mut chunk = [0; 4096];
    let mut length = 0;
    loop {
        let mut answer = Vec::new();
        let flow = service.serve(&chunk[..length], Instant::now(), &mut answer);
        stream.write_all(&answer)?;
        if flow.is_break() || world.now().is_switched_off {
            return Ok(());
        }
        let until_due = service.due().map_or(Duration::MAX, |due| due.saturating_duration_since(Instant::now()));
        stream.set_read_timeout(Some(until_due.clamp(Duration::from_millis(1), Duration::from_millis(5))))?;
        length = match stream.read(&mut chunk) {
            Ok(0) => return Ok(()),
            Ok(length) => length,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => 0,
            Err(error) => return Err(error),
        };
    }
}
