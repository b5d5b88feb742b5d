//! The checksum of a packet.

use crc::{CRC_32_ISO_HDLC, Crc, Table};

/// The size of the checksum.
pub(super) const CHECKSUM_BYTES: usize = 4;

/// With one table of 1 KiB, as flash is scarce on a microcontroller.
const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// The CRC-32 of `bytes`, as in Ethernet and zip.
pub(super) fn checksum(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}
