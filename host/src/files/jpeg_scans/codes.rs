//! The coded data of a scan: the codes of blocks, their bits, and the markers and segments around them.

use std::ops::RangeInclusive;

/// Reads blocks of 64 coefficients, or what a scan has of them.
pub struct BlockReader<'a> {
    bits: BitReader<'a>,
    coefficients: RangeInclusive<u32>,
    is_refinement: bool,
    /// The blocks that follow without a new coefficient.
    empty_blocks: u32,
}

impl<'a> BlockReader<'a> {
    pub fn new(bits: BitReader<'a>, coefficients: RangeInclusive<u32>, is_refinement: bool) -> BlockReader<'a> {
        BlockReader { bits, coefficients, is_refinement, empty_blocks: 0 }
    }

    /// Reads a block as a whole.
    pub fn read(&mut self, [first, others]: [Option<&HuffmanTable>; 2]) -> Result<(), Fault> {
        self.read_first(first)?;
        let mut k = 1;
        while k < 64 {
            let (zeros, bits) = self.run(others)?;
            if bits == 0 && zeros < 15 {
                break;
            }
            k += zeros + 1;
            if k > 64 {
                return Err(TOO_MANY);
            }
            self.bits.number(bits)?;
        }
        Ok(())
    }

    /// Reads the first coefficient of a block.
    pub fn read_first(&mut self, table: Option<&HuffmanTable>) -> Result<(), Fault> {
        let bits = if self.is_refinement { 1 } else { self.bits.symbol(table)? };
        self.bits.number(usize::from(bits & 15)).map(drop)
    }

    /// Reads the other coefficients of a block in a progressive scan. `nonzero` has a bit for each that is not 0.
    pub fn read_others(&mut self, table: Option<&HuffmanTable>, nonzero: &mut u64) -> Result<(), Fault> {
        let (mut k, last) = self.coefficients.clone().into_inner();
        while self.empty_blocks == 0 && k <= last {
            let (mut zeros, bits) = self.run(table)?;
            if bits == 0 && zeros < 15 {
                self.empty_blocks = (1 << zeros) + self.bits.number(zeros as usize)?;
                break;
            }
            self.bits.number(bits)?;
            if self.is_refinement {
                while k <= last && (zeros > 0 || *nonzero >> k & 1 == 1) {
                    match *nonzero >> k & 1 {
                        0 => zeros -= 1,
                        _ => _ = self.bits.number(1)?,
                    }
                    k += 1;
                }
            } else {
                k += zeros;
            }
            if k > last {
                return Err(TOO_MANY);
            }
            *nonzero |= u64::from(bits > 0) << k;
            k += 1;
        }
        if self.empty_blocks > 0 {
            self.empty_blocks -= 1;
            if self.is_refinement {
                (k..=last).filter(|k| *nonzero >> k & 1 == 1).try_for_each(|_| self.bits.number(1).map(drop))?;
            }
        }
        Ok(())
    }

    /// Reads how many coefficients are 0, and the bits of the one after them.
    fn run(&mut self, table: Option<&HuffmanTable>) -> Result<(u32, usize), Fault> {
        let symbol = self.bits.symbol(table)?;
        Ok((u32::from(symbol >> 4), usize::from(symbol & 15)))
    }

    /// Goes on after the restart marker with this number.
    pub fn restart(&mut self, number: usize) -> Result<(), Fault> {
        self.empty_blocks = 0;
        self.bits.restart(number)
    }

    /// Ends the scan, as [`BitReader::finish`] does.
    pub fn finish(self, is_last: bool) -> Result<(&'a [u8], Vec<Surplus<'a>>), Fault> {
        self.bits.finish(is_last)
    }
}

const TOO_MANY: Fault = "more coefficients than a block has";

/// The fault in coded data.
pub type Fault = &'static str;

/// Bytes that no code needs, to the end of the file, and their number.
pub type Surplus<'a> = (&'a [u8], usize);

/// Some cameras add bytes at the end of a scan, which decoders skip. Up to so many, hardly less damage is noticed.
const MAX_SURPLUS_BYTES: usize = 8;

const LEFT_OVER: Fault = "data are left over in a scan";

/// Reads the bits between two markers.
pub struct BitReader<'a> {
    /// All bytes from the start of the scan on.
    data: &'a [u8],
    /// The bytes that are not read, beginning with coded data.
    rest: &'a [u8],
    /// Bits that are read and not used, from the highest on.
    bits: u64,
    count: usize,
    surplus: Vec<Surplus<'a>>,
}

impl<'a> BitReader<'a> {
    pub fn new(data: &'a [u8]) -> BitReader<'a> {
        BitReader { data, rest: data, bits: 0, count: 0, surplus: Vec::new() }
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
        // Damage rarely leaves both codes that end at a byte and the marker that is due.
        let most = if self.is_at_end_of_byte() { usize::MAX } else { MAX_SURPLUS_BYTES };
        match next_marker(self.end(most)?) {
            Some((marker, rest)) if usize::from(marker) == 0xD0 + number % 8 => {
                (self.rest, self.bits, self.count) = (rest, 0, 0);
                Ok(())
            }
            _ => Err("a restart marker is missing in a scan"),
        }
    }

    /// Returns what follows the last code, which is a marker, and all surplus. After the last scan of a picture without a marker
    /// at its end, all is surplus.
    pub fn finish(mut self, is_last: bool) -> Result<(&'a [u8], Vec<Surplus<'a>>), Fault> {
        let after = self.after_codes();
        let has_end = after.windows(2).any(|pair| pair == [0xFF, END_OF_IMAGE]);
        let rest = if is_last && !has_end && self.is_at_end_of_byte() {
            self.surplus.push((after, after.len()));
            &[]
        } else {
            self.end(MAX_SURPLUS_BYTES)?
        };
        Ok((rest, self.surplus))
    }

    /// Returns the next marker and what follows it, after at most so many bytes of surplus.
    fn end(&mut self, most: usize) -> Result<&'a [u8], Fault> {
        let after = self.after_codes();
        let surplus = after.windows(2).position(|pair| pair[0] == 0xFF && pair[1] != 0).unwrap_or(after.len());
        if surplus > most {
            return Err(LEFT_OVER);
        }
        self.surplus.push((after, surplus));
        Ok(&after[surplus..])
    }

    /// Returns true if the bits between the last code and the end of its byte are 1, as they should be.
    fn is_at_end_of_byte(&self) -> bool {
        self.bits.leading_ones() as usize >= self.count % 8
    }

    /// Returns the bytes after the one in which the last code ends.
    fn after_codes(&self) -> &'a [u8] {
        let mut end = self.data.len() - self.rest.len();
        for _ in 0..self.count / 8 {
            // 0 follows 0xFF in coded data.
            end -= if self.data[..end].ends_with(&[0xFF, 0]) { 2 } else { 1 };
        }
        &self.data[end..]
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

pub const START_OF_SCAN: u8 = 0xDA;
pub const END_OF_IMAGE: u8 = 0xD9;

/// Returns true if no segment follows a marker: a restart, or the start of the image.
pub fn is_bare(marker: u8) -> bool {
    matches!(marker, 0x01 | 0xD0..=0xD8)
}

/// The next marker, and what follows it.
pub fn next_marker(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let start = bytes.windows(2).position(|pair| pair[0] == 0xFF && !matches!(pair[1], 0 | 0xFF))?;
    Some((bytes[start + 1], &bytes[start + 2..]))
}

/// The data of a segment without its length, and what follows it.
pub fn segment(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = u16::from_be_bytes(*bytes.first_chunk()?);
    let (segment, rest) = bytes.split_at_checked(length.into())?;
    Some((segment.get(2..).unwrap_or_default(), rest))
}
