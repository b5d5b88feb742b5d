//! Encodes lines as packets, which `multiscopic listen` turns into pictures.

use core::{ptr::NonNull, slice};
use multiscopic_core::{Disparity, Region};
use multiscopic_edge::packet::{self, BufferTooSmall, Sender};

use crate::{
    methods::{Head, lent},
    status::Status,
};

/// `multiscopic_packet`: bytes to send.
#[derive(Debug)]
#[repr(C)]
pub struct Packet {
    bytes: *const u8,
    length: usize,
}

/// See the header.
#[unsafe(no_mangle)]
pub extern "C" fn multiscopic_packet_buffer_bytes(columns: u16) -> usize {
    packet::buffer_bytes_with_confidences(columns.into())
}

/// See the header.
///
/// # Safety
/// A match that has begun, lines as wide as its region, and so many bytes of buffer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn multiscopic_encode_line(
    matcher: Option<NonNull<Head>>,
    line: u16,
    disparities: *const Option<Disparity>,
    confidences: *const u8,
    buffer: *mut u8,
    buffer_bytes: usize,
    packet: Option<&mut Packet>,
) -> Status {
    let Some(disparities) = NonNull::new(disparities.cast_mut()) else { return Status::NullPointer };
    // SAFETY: as the caller promises.
    unsafe {
        encode(matcher, buffer, buffer_bytes, packet, |sender, region| {
            let disparities = slice::from_raw_parts(disparities.as_ptr(), region.width());
            match confidences.is_null() {
                true => sender.line(region, line.into(), disparities),
                false => {
                    let confidences = slice::from_raw_parts(confidences, region.width());
                    sender.line_with_confidences(region, line.into(), disparities, confidences)
                }
            }
        })
    }
}

/// See the header.
///
/// # Safety
/// A match that has begun, and so many bytes of buffer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn multiscopic_encode_end(
    matcher: Option<NonNull<Head>>,
    stack_bytes: u32,
    buffer: *mut u8,
    buffer_bytes: usize,
    packet: Option<&mut Packet>,
) -> Status {
    let stack = Some(stack_bytes as usize).filter(|bytes| *bytes > 0);
    // SAFETY: as the caller promises.
    unsafe { encode(matcher, buffer, buffer_bytes, packet, |sender, _| sender.end(stack)) }
}

/// Encodes the next packet of the frame.
///
/// # Safety
/// A match that has begun, and so many bytes of buffer.
unsafe fn encode(
    matcher: Option<NonNull<Head>>,
    buffer: *mut u8,
    buffer_bytes: usize,
    packet: Option<&mut Packet>,
    encoded: impl for<'s> FnOnce(&'s mut Sender<'_>, &Region) -> Result<&'s [u8], BufferTooSmall>,
) -> Status {
    let (Some(mut head), Some(packet)) = (matcher, packet) else { return Status::NullPointer };
    // SAFETY: as the caller promises.
    let (head, buffer) = unsafe { (head.as_mut(), lent(buffer, buffer_bytes)) };
    let Ok(buffer) = buffer else { return Status::NullPointer };
    match encoded(&mut Sender::from_packet(head.packets, &head.search, buffer), &head.region) {
        Ok(bytes) => {
            *packet = Packet { bytes: bytes.as_ptr(), length: bytes.len() };
            head.packets += 1;
            Status::Ok
        }
        Err(error) => error.into(),
    }
}
