//! The bytes of a sampled line: what `lines.pio` makes of it. A test on the host reads them too.

use multiscopic_drivers::hm01b0::DataLines;

/// The pins from the first one: PCLKO, LVLD, D0 to D7.
pub const PINS: usize = 10;
/// Bytes of a line after its pixels: one more pixel, which a line must not have, and the number of clocks that would have had
/// room, less one, the low byte first.
pub const EXTRA: usize = 3;

/// The number of the last clock of a line that there is room for, from 0: the word that asks for a line.
pub const fn last_clock(columns: usize, data_lines: DataLines) -> u32 {
    ((columns + 1) * data_lines.clocks() - 1) as u32
}

/// The number of pixels of a sampled line: fewer than `columns` if a clock is missing, and more if there is one too many.
pub fn pixels(line: &[u8], columns: usize, data_lines: DataLines) -> usize {
    let Some(&room) = line.last_chunk() else { return 0 };
    let clocks = (last_clock(columns, data_lines) as u16).wrapping_sub(u16::from_le_bytes(room)) as usize;
    match clocks <= columns * data_lines.clocks() {
        true => clocks / data_lines.clocks(),
        false => clocks.div_ceil(data_lines.clocks()),
    }
}
