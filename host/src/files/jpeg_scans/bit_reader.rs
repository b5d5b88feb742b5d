//! The bits of a scan.

use crate::files::jpeg_markers::next_marker;

/// The fault in coded data.
pub type Fault = &'static str;

/// Some cameras add bytes at the end of a scan, which decoders skip. Up to so many, hardly less damage is noticed.
const MAX_SURPLUS_BYTES: usize = 8;

/// Reads the bits between two markers.
pub struct BitReader<'a> {
    /// The bytes that are not read, beginning with coded data.
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

const LONGEST: usize = 16;
/// Codes of at most so many bits are found in a table.
const SHORT: usize = 9;

/// Codes of 1 to 16 bits: those of each length are consecutive numbers.
pub struct HuffmanTable {
    /// The length and symbol of the short code that some bits begin with. The length is 0 if there is none.
    short: Vec<(u8, u8)>,
    /// For each length, the number after its last code, and what is added to a code for the index of its symbol.
    lengths: [(u32, u32); LONGEST + 1],
    symbols: Vec<u8>,
}

impl HuffmanTable {
    /// A table with this number of codes of each length, from 1 bit on. `None` if there are more than their bits can tell
    /// apart.
    pub fn new(counts: &[u8; LONGEST], symbols: &[u8]) -> Option<HuffmanTable> {
        let mut table =
            HuffmanTable { short: vec![(0, 0); 1 << SHORT], lengths: [(0, 0); LONGEST + 1], symbols: symbols.to_vec() };
        let (mut code, mut index) = (0_u32, 0_u32);
        for (length, &count) in (1..=LONGEST).zip(counts) {
            table.lengths[length] = (code + u32::from(count), index.wrapping_sub(code));
            for _ in 0..count {
                if code >= 1 << length {
                    return None;
                }
                if length <= SHORT {
                    let free_bits = SHORT - length;
                    let start = (code as usize) << free_bits;
                    table.short[start..start + (1 << free_bits)].fill((length as u8, *symbols.get(index as usize)?));
                }
                (code, index) = (code + 1, index + 1);
            }
            code <<= 1;
        }
        Some(table)
    }

    /// The length and symbol of the code that 16 bits begin with.
    pub fn find(&self, bits: u32) -> Option<(usize, u8)> {
        let (length, symbol) = self.short[(bits >> (LONGEST - SHORT)) as usize];
        if length > 0 {
            return Some((length.into(), symbol));
        }
        (SHORT + 1..=LONGEST).find_map(|length| {
            let (code, (end, offset)) = (bits >> (LONGEST - length), self.lengths[length]);
            let symbol = self.symbols.get(code.wrapping_add(offset) as usize);
            symbol.filter(|_| code < end).map(|&symbol| (length, symbol))
        })
    }
}
