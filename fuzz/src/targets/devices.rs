//! Readers of the bytes that cameras, microcontrollers, machines and robot arms send.

use std::{
    io::{self, Read, Write},
    net::{Ipv4Addr, Shutdown, TcpListener},
    path::Path,
    sync::{
        OnceLock,
        mpsc::{SyncSender, sync_channel},
    },
    thread,
    time::Duration,
};

use arbitrary::{Result, Unstructured};
use multiscopic::{
    capture::{
        camera::{FrameLayout, PixelFormat},
        stage::{self, Arm, ArmAddress, Limits},
    },
    files,
    target::reception,
};
use multiscopic_core::capture::{Position, Stage};

/// Tries buffers of cameras, in every format.
pub fn camera_frames(bytes: &[u8]) -> bool {
    let _ = convert(&mut Unstructured::new(bytes));
    true
}

/// Converts a buffer with a layout as a driver describes it.
fn convert(input: &mut Unstructured) -> Result<()> {
    let layout = FrameLayout {
        format: *input.choose(&PixelFormat::ALL)?,
        // Sizes that a buffer of libFuzzer's length can have, and any.
        size: match input.arbitrary()? {
            true => [input.int_in_range(1..=40)?, input.int_in_range(1..=40)?],
            false => [input.arbitrary()?, input.arbitrary()?],
        },
        stride: match input.arbitrary()? {
            true => input.int_in_range(0..=130)?,
            false => input.arbitrary()?,
        },
    };
    let buffer = input.bytes(input.len())?;
    if let Ok(image) = layout.to_gray(buffer) {
        assert_eq!([image.width(), image.height()], layout.size, "the size that the driver said");
    }
    Ok(())
}

/// Tries packets of microcontrollers: as they arrive, and with valid framing and checksums around whatever they hold.
pub fn packets(bytes: &[u8]) -> bool {
    let path = Path::new("packets");
    let _ = reception::receive(bytes, path, files::Limits::DEFAULT, |_| ());
    let mut packets = Vec::new();
    bytes.split(|&byte| byte == SEPARATOR).for_each(|contents| append(contents, &mut packets));
    let _ = reception::receive(&packets[..], path, files::Limits::DEFAULT, |_| ());
    true
}

/// The separator of the packets of an input. It is rare in them.
const SEPARATOR: u8 = 0xA5;
/// The most bytes of a block of COBS, without the byte before them.
const MAX_BLOCK: usize = 254;

/// Appends a packet, without its zeros (consistent overhead byte stuffing), and a zero.
fn append(contents: &[u8], packets: &mut Vec<u8>) {
    let packet = [contents, &crc32fast::hash(contents).to_le_bytes()].concat();
    for block in packet.split(|&byte| byte == 0) {
        let (chunks, rest) = block.as_chunks::<MAX_BLOCK>();
        for chunk in chunks {
            packets.push(0xFF);
            packets.extend(chunk);
        }
        packets.push(rest.len() as u8 + 1);
        packets.extend(rest);
    }
    packets.push(0);
}

/// Tries replies of machines with Grbl or Marlin.
pub fn gcode(bytes: &[u8]) -> bool {
    let timeout = Duration::from_millis(20);
    let limits = Limits { connect_timeout: timeout, silence_timeout: timeout, stall_timeout: timeout, ..Limits::default() };
    let Ok(mut stage) = stage::gcode::connect(Port(bytes.to_vec()), "port", &limits) else { return true };
    if stage.move_to(Position { x_um: 20_000, y_um: -10_000 }).is_ok() {
        let _ = stage.has_arrived();
    }
    if let Ok(Some(position)) = stage.position() {
        let _ = stage.move_to(position);
    }
    let _ = stage.stop();
    true
}

/// A port that brings the input, in pieces of a few bytes, and is then unplugged.
struct Port(Vec<u8>);

impl Read for Port {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // A zero is a pause.
        if self.0.first() == Some(&0) {
            self.0.remove(0);
            return Err(io::ErrorKind::TimedOut.into());
        }
        let piece = self.0.iter().position(|&byte| byte == 0).unwrap_or(self.0.len()).min(buffer.len());
        buffer[..piece].copy_from_slice(&self.0[..piece]);
        self.0.drain(..piece);
        Ok(piece)
    }
}

impl Write for Port {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Tries replies of a robot arm, over sockets of this machine.
pub fn robot_arm(bytes: &[u8]) -> bool {
    static ARM: OnceLock<TalkingArm> = OnceLock::new();
    let arm = ARM.get_or_init(TalkingArm::start);
    arm.replies.send(bytes.to_vec()).expect("the arm listens");
    let timeout = Duration::from_millis(5);
    // The connection itself must not be what fails: each reply is for one.
    let limits = Limits { connect_timeout: Duration::from_secs(5), silence_timeout: timeout, ..Limits::default() };
    if let Ok(mut stage) = Arm::connect(&arm.address, &limits) {
        let _ = stage.position();
        let _ = stage.has_arrived();
    }
    true
}

/// An arm that says the input on its port of the Real-Time Data Exchange, and hangs up.
struct TalkingArm {
    address: ArmAddress,
    replies: SyncSender<Vec<u8>>,
}

impl TalkingArm {
    fn start() -> TalkingArm {
        let listen = || TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a free port");
        let (data, script) = (listen(), listen());
        let [rtde_port, script_port] = [&data, &script].map(|listener| listener.local_addr().expect("an address").port());
        let (replies, to_say) = sync_channel::<Vec<u8>>(1);
        thread::spawn(move || {
            for reply in to_say {
                let (mut stream, _) = data.accept().expect("a connection");
                // The other end may have heard enough.
                let _ = stream.write_all(&reply);
                let _ = stream.shutdown(Shutdown::Write);
            }
        });
        thread::spawn(move || script.incoming().for_each(drop));
        TalkingArm { address: ArmAddress { host: "127.0.0.1".into(), script_port, rtde_port }, replies }
    }
}
