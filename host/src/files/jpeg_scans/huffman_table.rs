//! The codes of symbols.

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
    /// A table with this number of codes of each length, from 1 bit on. `None` if there are more than their bits can tell apart.
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
