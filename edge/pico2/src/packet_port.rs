//! The serial port on USB that packets leave through.

use core::{
    error, fmt,
    sync::atomic::{AtomicBool, Ordering},
};
use embassy_futures::{
    join::join,
    select::{Either, select},
};
use embassy_rp::{Peri, peripherals::USB, usb::Driver};
use embassy_sync::{blocking_mutex::raw::CriticalSectionRawMutex, pipe::Pipe};
use embassy_time::{Duration, Instant};
use embassy_usb::{
    Builder, Config,
    class::cdc_acm::{CdcAcmClass, ControlChanged, Sender, State},
};
use embedded_io::{Error, ErrorKind, ErrorType, Write};

use crate::Interrupts;

/// The bytes of a USB packet.
const USB_PACKET: usize = 64;
/// The bytes on their way from the program to USB: six lines of a column tile.
const PIPE_BYTES: usize = 2048;
/// The longest time for which a program on the host may read nothing.
const STALL: Duration = Duration::from_secs(1);

static PIPE: Pipe<CriticalSectionRawMutex, PIPE_BYTES> = Pipe::new();
/// True if a program on the host has the port open.
static IS_OPEN: AtomicBool = AtomicBool::new(false);
/// True if bytes that have left the pipe are not sent yet.
static IS_SENDING: AtomicBool = AtomicBool::new(false);

type UsbSender<'d> = Sender<'d, Driver<'d, USB>>;

/// The USB device.
#[embassy_executor::task]
pub async fn serve(peripheral: Peri<'static, USB>) -> ! {
    let (mut configuration, mut objects, mut control) = ([0; 128], [0; 16], [0; USB_PACKET]);
    let mut state = State::new();
    // The numbers that are set aside for private tests. A product needs its own.
    let mut config = Config::new(0x1209, 0x0001);
    config.manufacturer = Some("multiscopic");
    config.product = Some("multiscopic Pico 2");
    let driver = Driver::new(peripheral, Interrupts);
    let mut builder = Builder::new(driver, config, &mut configuration, &mut objects, &mut [], &mut control);
    let port = CdcAcmClass::new(&mut builder, &mut state, USB_PACKET as u16);
    let (sender, _, changes) = port.split_with_control();
    join(builder.build().run(), send_packets(sender, changes)).await.0
}

/// Sends the contents of the pipe while the port is open.
async fn send_packets(mut sender: UsbSender<'_>, changes: ControlChanged<'_>) -> ! {
    loop {
        sender.wait_connection().await;
        while !sender.dtr() {
            changes.control_changed().await;
        }
        PIPE.clear();
        IS_SENDING.store(false, Ordering::Release);
        IS_OPEN.store(true, Ordering::Release);
        defmt::info!("the port is open");
        send_until_closed(&mut sender, &changes).await;
        IS_OPEN.store(false, Ordering::Release);
        defmt::info!("the port is closed");
    }
}

/// Sends the contents of the pipe until the port is closed.
///
/// A chunk is kept until it is sent. Whichever future `select` drops has done nothing yet: reading and sending are each done at
/// once, when there are bytes and when there is room.
async fn send_until_closed(sender: &mut UsbSender<'_>, changes: &ControlChanged<'_>) {
    // Shorter than a full packet, so that the host does not wait for more.
    let mut chunk = [0; USB_PACKET - 1];
    let mut bytes = 0;
    while sender.dtr() {
        if bytes == 0 {
            if let Either::First(read) = select(PIPE.read(&mut chunk), changes.control_changed()).await {
                bytes = read;
            }
        } else {
            match select(sender.write_packet(&chunk[..bytes]), changes.control_changed()).await {
                Either::First(Ok(())) => bytes = 0,
                Either::First(Err(_)) => break,
                Either::Second(()) => {}
            }
        }
        // The program does not run between this and the reading.
        IS_SENDING.store(bytes > 0, Ordering::Release);
    }
}

/// True if a program on the host has the port open.
pub fn is_open() -> bool {
    IS_OPEN.load(Ordering::Acquire)
}

/// The program's end of the port, which takes packets.
pub struct PacketPort;

impl ErrorType for PacketPort {
    type Error = PortError;
}

impl Write for PacketPort {
    /// Waits for room in the pipe.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        let start = Instant::now();
        loop {
            if !is_open() {
                return Err(PortError::Closed);
            }
            if let Ok(written) = PIPE.try_write(bytes) {
                return Ok(written);
            }
            if start.elapsed() > STALL {
                return Err(PortError::Stalled);
            }
        }
    }

    /// Waits until USB has all bytes.
    fn flush(&mut self) -> Result<(), PortError> {
        let start = Instant::now();
        while !PIPE.is_empty() || IS_SENDING.load(Ordering::Acquire) {
            if !is_open() {
                return Err(PortError::Closed);
            }
            if start.elapsed() > STALL {
                return Err(PortError::Stalled);
            }
        }
        Ok(())
    }
}

/// An error of a packet that was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortError {
    /// The program on the host closed the port.
    Closed,
    /// The program on the host reads nothing.
    Stalled,
}

impl fmt::Display for PortError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            PortError::Closed => "the host closed the port",
            PortError::Stalled => "the host reads nothing",
        })
    }
}

impl error::Error for PortError {}

impl Error for PortError {
    fn kind(&self) -> ErrorKind {
        match self {
            PortError::Closed => ErrorKind::NotConnected,
            PortError::Stalled => ErrorKind::TimedOut,
        }
    }
}
