//! The packets that carry disparities to a host, over anything that carries bytes.
//!
//! A packet holds, in this order:
//! - a [`Header`], encoded by `postcard`,
//! - the disparities of its line, two bytes each, little-endian, as
//!   [`Disparity::to_raw16`](multiscopic_core::Disparity::to_raw16) encodes them,
//! - if the content is a [`LineWithConfidences`](Content::LineWithConfidences), the confidences of these disparities, one byte
//!   each: the probability that a disparity is at most one pixel off, times 255, and 0 where it is invalid,
//! - the CRC-32 of all bytes before it, little-endian.
//!
//! COBS removes the zeros from these bytes, and a zero ends the packet. A receiver that starts late or has
//! lost bytes resumes after the next zero.
//!
//! A receiver of the same version that knows no confidences takes a packet with them for one with an invalid header.
//!
//! ```
//! use multiscopic_core::{Disparity, Fusion, Region};
//! use multiscopic_edge::packet::{Packet, Receiver, Sender, buffer_bytes};
//! use multiscopic_edge::profile::QQVGA;
//!
//! // The microcontroller: a line of disparities of 5 pixels.
//! let (matching, line) = (QQVGA.matching(Fusion::Min), [Disparity::from_bits(5 * 64); 160]);
//! let mut buffer = [0; buffer_bytes(160)];
//! let mut sender = Sender::new(matching.search(), &mut buffer);
//! let mut sent = sender.line(&Region::whole(matching.search()), 0, &line)?.to_vec();
//!
//! // The host: the bytes before a zero are a packet.
//! assert_eq!(sent.pop(), Some(0));
//! let packet = Packet::decode(&mut sent)?;
//! Receiver::default().accept(&packet.header)?; // notices packets that were lost before this one
//! assert!(packet.disparities().eq(line));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod decoder;
mod format;
mod receiver;
mod sender;

pub use decoder::{Packet, PacketError};
pub use format::{Content, Header, MAGIC, VERSION};
pub use receiver::{Lost, Receiver};
pub use sender::{BufferTooSmall, Sender, buffer_bytes, buffer_bytes_with_confidences, max_bytes};
