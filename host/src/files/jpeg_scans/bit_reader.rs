//! The bits of a scan.

use super::huffman_table::HuffmanTable;
use crate::files::jpeg_markers::next_marker;

/// What is wrong with coded data.
pub type Fault = &'static str;

/// Some cameras add bytes at the end of a scan, which decoders skip. Up to so many, hardly less damage is noticed.
const MAX_SURPLUS_BYTES: usize = 8;

/// Reads the bits between two markers.
pub struct BitReader<'a> {
    /// What is not read, beginning with coded data.
    rest: &'a [u8],
    /// Bits that are read and not used, from the highest on.
    bits: u64,
    count: usize,
}

impl<'a> BitReader<'a> {
    pub fn new(data: &'a [u8]) -> BitReader<'a> {
        BitReader { rest: data, bits: 0, count: 0 }
    }

    /// Reads the next symbol.
    pub fn symbol(&mut self, table: Option<&HuffmanTable>) -> Result<u8, Fault> {
        self.fill();
        let found = table.and_then(|table| table.find((self.bits >> 48) as u32));
        let (length, symbol) = found.ok_or("a code that is not in its table")?;
        self.skip(length)?;
        Ok(symbol)
    }

    /// Reads a number of at most 16 bits.
    pub fn number(&mut self, bits: usize) -> Result<u32, Fault> {
        self.fill();
        let number = self.bits.checked_shr(64 - bits as u32).unwrap_or(0) as u32;
        self.skip(bits)?;
        Ok(number)
    }

    fn skip(&mut self, bits: usize) -> Result<(), Fault> {
        self.count = self.count.checked_sub(bits).ok_or("data are missing in a scan")?;
        self.bits <<= bits;
        Ok(())
    }

    /// Reads bytes up to the next marker, until there are more than 56 bits.
    fn fill(&mut self) {
        while self.count <= 56
            && let Some(byte) = self.next_byte()
        {
            self.bits |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    fn next_byte(&mut self) -> Option<u8> {
        let (byte, length) = match *self.rest {
            [0xFF, 0, ..] => (0xFF, 2),
            [0xFF, ..] | [] => return None,
            [byte, ..] => (byte, 1),
        };
        self.rest = &self.rest[length..];
        Some(byte)
    }

    /// Goes on after the restart marker with this number, which must follow.
    pub fn restart(&mut self, number: usize) -> Result<(), Fault> {
        match next_marker(self.finish()?) {
            Some((marker, rest)) if usize::from(marker) == 0xD0 + number % 8 => {
                *self = BitReader::new(rest);
                Ok(())
            }
            _ => Err("a restart marker is missing in a scan"),
        }
    }

    /// Returns what follows the last code, which is a marker.
    pub fn finish(&mut self) -> Result<&'a [u8], Fault> {
        let mut surplus = self.count / 8;
        while surplus <= MAX_SURPLUS_BYTES && self.next_byte().is_some() {
            surplus += 1;
        }
        if surplus <= MAX_SURPLUS_BYTES { Ok(self.rest) } else { Err("data are left over in a scan") }
    }
}
