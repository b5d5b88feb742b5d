//! The lines that a pass over a frame keeps: some lines of both pictures, and the equations of the lines under a block.

use super::params::SweepParams;
use crate::infallible;

/// The columns before the first of a line, and after the last: blocks need not ask for borders.
pub const PAD: usize = 8;
/// True for processors with vectors, which compute many pixels as fast as few.
pub const HAS_VECTORS: bool = cfg!(not(target_os = "none")) || cfg!(multiscopic_mve);
/// The pixels that are computed together.
pub const LANES: usize = if HAS_VECTORS { 8 } else { 1 };
/// The residual of a pixel whose match lies outside the frame.
pub const INVISIBLE: i16 = i16::MIN;

/// The last lines, each in its turn.
#[derive(Debug)]
pub struct Ring<'m, T> {
    cells: &'m mut [T],
    stride: usize,
    rows: usize,
}

impl<T: bytemuck::Pod> Ring<'_, T> {
    /// Line `v`, with its padding.
    #[inline(always)]
    pub fn row(&self, v: usize) -> &[T] {
        let start = v.checked_rem(self.rows).unwrap_or_default() * self.stride;
        self.cells.get(start..start + self.stride).unwrap_or_default()
    }

    /// Line `v` without its padding.
    #[inline(always)]
    pub fn columns(&self, v: usize) -> &[T] {
        self.row(v).get(PAD..).unwrap_or_default()
    }

    /// Line `v`, to be written, with its padding.
    #[inline(always)]
    pub fn row_mut(&mut self, v: usize) -> &mut [T] {
        let start = v.checked_rem(self.rows).unwrap_or_default() * self.stride;
        self.cells.get_mut(start..start + self.stride).unwrap_or_default()
    }
}

/// The lines of a pass.
#[derive(Debug)]
pub struct SweepLines<'m> {
    /// The lines of the centre, from two radii above that of the equations to one below it.
    pub center: Ring<'m, u8>,
    /// The lines of the frame, a radius around that of the equations.
    pub view: Ring<'m, u8>,
    /// The disparities that are believed, in steps of 1/4096 pixel at the unit baseline.
    pub disparities: Ring<'m, i32>,
    /// The shifts of their matches, in steps of 1/256 pixel of this frame.
    pub shifts: Ring<'m, i32>,
    /// The centre less the frame at the match, in quarters of a grey value, or [`INVISIBLE`].
    pub residuals: Ring<'m, i16>,
    /// The slopes of the centre along the line, in eighths of a grey value each pixel.
    pub gradients: Ring<'m, i16>,
}

impl<'m> SweepLines<'m> {
    /// The bytes of memory.
    pub const fn bytes(params: &SweepParams) -> usize {
        let [center, block] = SweepLines::rows(params);
        SweepLines::stride(params) * (center + block + 12 * block)
    }

    /// The lines of the centre, and those of a block.
    const fn rows(params: &SweepParams) -> [usize; 2] {
        [3 * params.radius() + 1, 2 * params.radius() + 1]
    }

    const fn stride(params: &SweepParams) -> usize {
        params.search().width().next_multiple_of(8) + 2 * PAD
    }

    /// No lines yet. `memory` has the [`bytes`](SweepLines::bytes).
    pub fn new(params: &SweepParams, memory: &'m mut [u32]) -> SweepLines<'m> {
        let (stride, [center, block]) = (SweepLines::stride(params), SweepLines::rows(params));
        let mut rest = memory;
        SweepLines {
            center: ring(&mut rest, stride, center),
            view: ring(&mut rest, stride, block),
            disparities: ring(&mut rest, stride, block),
            shifts: ring(&mut rest, stride, block),
            residuals: ring(&mut rest, stride, block),
            gradients: ring(&mut rest, stride, block),
        }
    }
}

/// The next lines of `rest`. Their stride is a multiple of four.
fn ring<'m, T: bytemuck::Pod>(rest: &mut &'m mut [u32], stride: usize, rows: usize) -> Ring<'m, T> {
    let words = stride * rows * size_of::<T>() / size_of::<u32>();
    let (lent, after) = core::mem::take(rest).split_at_mut_checked(words).unwrap_or_default();
    *rest = after;
    Ring { cells: infallible::cast_mut(lent), stride, rows }
}
