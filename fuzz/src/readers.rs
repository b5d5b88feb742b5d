//! Readers of bytes from outside: those of files, of the values of options, and of what cameras, microcontrollers, machines and
//! robot arms send.

use std::{
    collections::BTreeMap,
    fmt::Display,
    fs::File,
    io::{self, Read, Write},
    net::{Ipv4Addr, Shutdown, TcpListener},
    os::unix::fs::FileExt,
    path::{Path, PathBuf},
    str::FromStr,
    sync::{
        Arc, Mutex, OnceLock,
        mpsc::{SyncSender, sync_channel},
    },
    thread,
    time::Duration,
};

use arbitrary::{Arbitrary, Result, Unstructured};
use multiscopic::{
    CameraModel, Dataset, Picture, Rig,
    capture::{
        Accuracy, Imperfections, SystemClock,
        camera::{FrameLayout, PixelFormat},
        stage::{self, Arm, ArmAddress, StageSpec},
    },
    evaluation::CameraSteps,
    files::{Limits, read_disparities, read_pfm},
    images::{ImageRegion, Layout},
    lens::{Mount, Undistortion},
    stereo::{
        cost::mccnn::{Architecture, Weights, checkpoint, package},
        network::DisparityNetwork,
    },
    target::reception,
};
use multiscopic_core::{
    View,
    capture::{Position, Stage},
};
use tempfile::TempDir;

/// Tries calibrations of lenses, as TOML and as the YAML of other programs.
pub fn calibrations(bytes: &[u8]) -> bool {
    for name in ["calibration.toml", "calibration.yaml"] {
        if let Ok(camera) = CameraModel::read(&file(name, bytes)) {
            // What was read can be used.
            let undistortion = Undistortion::new(
                &camera,
                &Mount { rotation_deg: [0.5, -1.0, 2.0], focal_px: None, rotation_deviation_deg: None },
                [8, 6],
            );
            let _ = (undistortion.place(3, 2), camera.direction([3.0, 2.0]), camera.pixel([0.1, -0.2]));
        }
    }
    true
}

/// Tries pictures, maps of numbers and disparity maps.
pub fn pictures(bytes: &[u8]) -> bool {
    let path = file("picture", bytes);
    let _ = Picture::read(&path);
    let _ = Picture::brightest(&[&path], Limits::DEFAULT);
    let _ = read_pfm(&path);
    let _ = read_disparities(&path, None, Limits::DEFAULT);
    true
}

/// Tries `rig.toml`, and the other TOML files of a rig.
pub fn rigs(bytes: &[u8]) -> bool {
    let path = file(Rig::FILE_NAME, bytes);
    let _ = Mount::read(&path);
    let _ = Imperfections::read(&path);
    if let Ok(rig) = Rig::load(path.parent().expect("a folder")) {
        // What was read can be used.
        let _ = (rig.geometry([640, 480]), rig.principal_point([640, 480]), rig.images.views());
    }
    true
}

/// Tries weights of networks: safetensors, wheels, files of PyTorch, and the format of our own.
pub fn weights(bytes: &[u8]) -> bool {
    let path = file("weights", bytes);
    let _ = Weights::read(&path, Architecture::Fast);
    let _ = package::read(&path);
    let _ = checkpoint::model(bytes);
    let _ = DisparityNetwork::new(bytes);
    true
}

/// Tries values of options on the command line.
pub fn option_values(bytes: &[u8]) -> bool {
    let Ok(text) = <&str>::arbitrary_take_rest(Unstructured::new(bytes)) else { return false };
    parse::<View>(text);
    parse::<Dataset>(text);
    parse::<Layout>(text);
    parse::<StageSpec>(text);
    let _ = text.parse::<CameraSteps>();
    let _ = text.parse::<ImageRegion>();
    let _ = text.parse::<Accuracy>();
    true
}

/// Parses a value. What is accepted is accepted again as it is printed.
fn parse<T: FromStr + Display>(text: &str) {
    if let Ok(value) = text.parse::<T>() {
        let printed = value.to_string();
        assert!(printed.parse::<T>().is_ok_and(|again| again.to_string() == printed), "{text:?} is printed as {printed:?}");
    }
}

/// Writes a file with this name and these contents, for readers that take a path. The next one of this name replaces it.
fn file(name: &'static str, contents: &[u8]) -> PathBuf {
    static FILES: Mutex<Option<Files>> = Mutex::new(None);
    let files = &mut *FILES.lock().expect("no failure before");
    let new = || Files { folder: tempfile::tempdir().expect("a temporary folder"), open: BTreeMap::new() };
    let Files { folder, open } = files.get_or_insert_with(new);
    let path = folder.path().join(name);
    let file = open.entry(name).or_insert_with(|| File::create(&path).expect("a temporary file"));
    file.set_len(contents.len() as u64).and_then(|()| file.write_all_at(contents, 0)).expect("a temporary file");
    path
}

/// Files of this process, by their names. They stay open: to make one again takes longer than most readers do.
///
/// libFuzzer ends the process without running destructors, so one folder stays behind.
struct Files {
    folder: TempDir,
    open: BTreeMap<&'static str, File>,
}

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
    let _ = reception::receive(bytes, path, Limits::DEFAULT, |_| ());
    let mut packets = Vec::new();
    bytes.split(|&byte| byte == SEPARATOR).for_each(|contents| append(contents, &mut packets));
    let _ = reception::receive(&packets[..], path, Limits::DEFAULT, |_| ());
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

/// Tries replies of machines with G-code.
pub fn gcode(bytes: &[u8]) -> bool {
    let timeout = Duration::from_millis(20);
    let limits =
        stage::Limits { connect_timeout: timeout, silence_timeout: timeout, stall_timeout: timeout, ..stage::Limits::default() };
    if let Ok(stage) = stage::gcode::connect(Port(bytes.to_vec()), "port", &limits) {
        exercise(stage);
    }
    true
}

/// Tries answers of a command that moves a stage.
pub fn commands(bytes: &[u8]) -> bool {
    let timeout = Duration::from_millis(20);
    let limits = stage::Limits { connect_timeout: timeout, silence_timeout: timeout, ..stage::Limits::default() };
    let port = Port(bytes.to_vec());
    if let Ok(stage) = stage::exec::connect_with_clock(port, "command", &limits, Arc::new(SystemClock)) {
        exercise(stage);
    }
    true
}

/// Sends a stage to a few places.
fn exercise(mut stage: impl Stage) {
    if stage.move_to(Position { x_um: 20_000, y_um: -10_000 }).is_ok() {
        let _ = stage.has_arrived();
    }
    if let Ok(Some(position)) = stage.position() {
        let _ = stage.move_to(position);
    }
    let _ = stage.stop();
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
    let limits = stage::Limits { connect_timeout: Duration::from_secs(5), silence_timeout: timeout, ..stage::Limits::default() };
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
