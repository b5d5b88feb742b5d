//! The errors of the firmware. Ends it after an error, a panic or a fault, with a message and an exit code.
//!
//! After a panic or a fault the log may be broken, so these messages are plain text.

use core::{
    fmt::{self, Arguments, Display},
    panic::PanicInfo,
};
use multiscopic_core::Frame;
use multiscopic_edge::{PipelineError, StreamsError, packet::BufferTooSmall};
use semihosting::{eprintln, process};

use crate::host_file::HostError;

const FAILED: i32 = 1;
const PANICKED: i32 = 101;
const FAULTED: i32 = 102;
const OVERFLOWED: i32 = 103;

/// An error that ends the firmware.
pub enum FirmwareError {
    /// The host does not give the command line.
    CommandLine(HostError),
    /// The argument is not the name of a fusion.
    Fusion,
    /// The arguments are not those of a calibration.
    Calibration,
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
            FirmwareError::CommandLine(error) => write!(f, "cannot read the command line: {error}"),
            FirmwareError::Fusion => write!(f, "start it with one word: min, mean, heuristic or half"),
            FirmwareError::Calibration => write!(
                f,
                "start it with: width, height, views (1 to 4), smallest disparity, disparities, block size, fusion, columns of a tile, bm or sgm"
            ),
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

/// Ends the firmware because of `error`.
pub fn fail(error: impl Display) -> ! {
    defmt::error!("{}", defmt::Display2Format(&error));
    process::exit(FAILED)
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    eprintln!("firmware: {info}");
    process::exit(PANICKED)
}

/// Ends the firmware after a fault in which the stack pointer was beyond the stack of `bytes` bytes.
pub fn overflowed(bytes: u32, stack_pointer: u32) -> ! {
    eprintln!("firmware: stack overflow: the stack has {bytes} bytes, and the stack pointer is at {stack_pointer:#010x}");
    process::exit(OVERFLOWED)
}

/// Ends the firmware after another fault.
pub fn faulted(fault: Arguments<'_>) -> ! {
    eprintln!("firmware: {fault}");
    process::exit(FAULTED)
}
