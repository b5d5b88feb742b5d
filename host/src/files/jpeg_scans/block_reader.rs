//! The codes of blocks.

use std::ops::RangeInclusive;

use super::bit_reader::{BitReader, Fault, HuffmanTable};

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

    /// Returns what follows the last block.
    pub fn finish(mut self) -> Result<&'a [u8], Fault> {
        self.bits.finish()
    }
}

const TOO_MANY: Fault = "more coefficients than a block has";
