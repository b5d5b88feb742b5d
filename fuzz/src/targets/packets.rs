//! Packets of microcontrollers: as they arrive, and with valid framing and checksums around whatever they hold.

use std::path::Path;

use multiscopic::{files::Limits, target::reception};

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

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let path = Path::new("packets");
    let _ = reception::receive(bytes, path, Limits::DEFAULT, |_| ());
    let mut packets = Vec::new();
    bytes.split(|&byte| byte == SEPARATOR).for_each(|contents| append(contents, &mut packets));
    let _ = reception::receive(&packets[..], path, Limits::DEFAULT, |_| ());
    true
}
