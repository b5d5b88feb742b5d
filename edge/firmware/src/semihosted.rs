//! The board that a debugger or an emulator lends: its files, its clock, the marks where phases begin, and the errors of firmware
//! on it.

use core::{arch::asm, error, ffi::CStr, fmt, time::Duration};
use embedded_io::{Error, ErrorKind, ErrorType, Read, Seek, SeekFrom, Write};
use multiscopic_core::{Frame, SearchSpace};
use multiscopic_edge::{
    Board, Phase, PipelineError, Streams, StreamsError,
    frame_file::{self, FrameFile},
    packet::BufferTooSmall,
};
use semihosting::{
    fs::File,
    io::{self, Read as _, Seek as _, Write as _},
    sys::arm_compat::sys_clock,
};

/// A board whose frames and packets are files of the host, and whose clock is the host's.
pub struct Semihosted;

impl Board for Semihosted {
    type Frames = Streams<HostFile>;
    type Output = HostFile;
    type Error = FirmwareError;

    fn frames(&mut self, search: &SearchSpace) -> Result<Streams<HostFile>, FirmwareError> {
        let expected = (search.width() * search.height()) as u64;
        Streams::open(search.views(), |frame: Frame| {
            let cannot_open = |error| FirmwareError::Frame(frame, error);
            let file = HostFile::open(FrameFile::new(frame).name()).map_err(cannot_open)?;
            match file.bytes().map_err(cannot_open)? {
                found if found == expected => Ok(file),
                found => Err(FirmwareError::Size { frame, found, expected }),
            }
        })
    }

    fn output(&mut self) -> Result<HostFile, FirmwareError> {
        HostFile::create(frame_file::PACKETS).map_err(FirmwareError::Packets)
    }

    fn elapsed(&self) -> Duration {
        elapsed()
    }

    fn enter(phase: Phase) {
        mark(phase);
    }
}

/// The time since the start in steps of 10 ms, or zero if the host does not tell.
pub fn elapsed() -> Duration {
    Duration::from_millis(10 * sys_clock().unwrap_or_default() as u64)
}

/// An error that ends the firmware.
pub enum FirmwareError {
    /// The file of packets could not be created.
    Packets(HostError),
    /// The file of a frame could not be opened.
    Frame(Frame, HostError),
    /// A frame has the wrong size.
    Size {
        /// The frame.
        frame: Frame,
        /// Its size in bytes.
        found: u64,
        /// The size that the profile needs.
        expected: u64,
    },
    /// A line could not be read, matched or sent.
    Pipeline(PipelineError<StreamsError<HostError>, HostError>),
    /// The last packet could not be encoded.
    Packet(BufferTooSmall),
}

impl fmt::Display for FirmwareError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FirmwareError::Packets(error) => write!(f, "cannot create the file of packets: {error}"),
            FirmwareError::Frame(frame, error) => write!(f, "cannot open {frame}.gray: {error}"),
            FirmwareError::Size { frame, found, expected } => {
                write!(f, "{frame}.gray has {found} bytes, a frame of this profile has {expected}")
            }
            FirmwareError::Pipeline(error) => write!(f, "{error}"),
            FirmwareError::Packet(error) => write!(f, "{error}"),
        }
    }
}

/// An open file of the host.
pub struct HostFile(File);

impl HostFile {
    /// Opens the file at `path` for reading.
    ///
    /// # Errors
    /// The host cannot open it.
    pub fn open(path: &CStr) -> Result<HostFile, HostError> {
        File::open(path).map(HostFile).map_err(HostError)
    }

    /// Creates an empty file at `path` for writing.
    ///
    /// # Errors
    /// The host cannot create it.
    pub fn create(path: &CStr) -> Result<HostFile, HostError> {
        File::create(path).map(HostFile).map_err(HostError)
    }

    /// The size in bytes.
    ///
    /// # Errors
    /// The host does not know it.
    pub fn bytes(&self) -> Result<u64, HostError> {
        self.0.metadata().map(|metadata| metadata.len()).map_err(HostError)
    }
}

impl ErrorType for HostFile {
    type Error = HostError;
}

impl Read for HostFile {
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, HostError> {
        self.0.read(bytes).map_err(HostError)
    }
}

impl Write for HostFile {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, HostError> {
        self.0.write(bytes).map_err(HostError)
    }

    fn flush(&mut self) -> Result<(), HostError> {
        Ok(())
    }
}

impl Seek for HostFile {
    /// Semihosting knows no current position, so [`SeekFrom::Current`] is refused.
    fn seek(&mut self, to: SeekFrom) -> Result<u64, HostError> {
        let to = match to {
            SeekFrom::Start(offset) => io::SeekFrom::Start(offset),
            SeekFrom::End(offset) => io::SeekFrom::End(offset),
            SeekFrom::Current(_) => return Err(HostError(io::ErrorKind::Unsupported.into())),
        };
        self.0.seek(to).map_err(HostError)
    }
}

/// An error that the host reported.
#[derive(Debug)]
pub struct HostError(pub io::Error);

impl fmt::Display for HostError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

impl error::Error for HostError {}

impl Error for HostError {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

/// Calls the marker of `phase`, for breakpoints of a debugger or an emulator that counts.
#[inline(always)]
fn mark(phase: Phase) {
    match phase {
        Phase::Idle => phase_idle(),
        Phase::Matching => phase_matching(),
        Phase::Fetching => phase_fetching(),
        Phase::Sending => phase_sending(),
    }
}

/// The instruction that writes a number to a register.
#[cfg(target_arch = "arm")]
macro_rules! copy {
    () => {
        "movs"
    };
}
#[cfg(target_arch = "riscv32")]
macro_rules! copy {
    () => {
        "li"
    };
}

macro_rules! marker {
    ($name:ident, $number:literal) => {
        // Exported under its name, which no other symbol of the image has.
        #[expect(unsafe_code, reason = "the function needs a name for the linker, and a body that differs from the others")]
        #[unsafe(no_mangle)]
        #[inline(never)]
        extern "C" fn $name() {
            // SAFETY: the instruction writes the register that it declares, and the flags, which `asm!` takes
            // as clobbered. Bodies without it would be the same, and could be folded into one function.
            unsafe { asm!(concat!(copy!(), " {}, {}"), out(reg) _, const $number) }
        }
    };
}

marker!(phase_idle, 0);
marker!(phase_matching, 1);
marker!(phase_fetching, 2);
marker!(phase_sending, 3);
