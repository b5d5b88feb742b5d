//! Compares whole matches, line by line.

use core::convert::Infallible;
use multiscopic_core::{Disparity, Frame, Fusion, Matcher, Params, Region, ScanlineSource, View, Views};
use multiscopic_firmware::BoardKernel;
use semihosting::eprintln;
use static_cell::ConstStaticCell;

use super::{
    twin::{Difference, Twin, same},
    xorshift::Xorshift,
};

const WIDTH: u16 = 37;
const HEIGHT: u16 = 29;
const WORDS: usize = 8000;

static MEMORY: ConstStaticCell<[[u32; WORDS]; 2]> = ConstStaticCell::new([[0; WORDS]; 2]);

/// Frames that are computed, since there is no memory to store them.
#[derive(Clone, Copy, Debug)]
enum Pattern {
    /// Random samples.
    Noise,
    /// Random samples of 0 and 255.
    Extremes,
    /// A random texture at a disparity of 3.
    Shifted,
    /// The same sample everywhere.
    Flat,
}

impl ScanlineSource for Pattern {
    type Error = Infallible;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Infallible> {
        let (seed, (du, dv)) = match (&self, frame) {
            (Pattern::Shifted, Frame::View(view)) => (0, view.shift(3)),
            (Pattern::Shifted, Frame::Center) => (0, (0, 0)),
            (_, Frame::Center) => (1, (0, 0)),
            (_, Frame::View(view)) => (2 + view as u32, (0, 0)),
        };
        for (sample, u) in line.iter_mut().zip(0..) {
            let place = seed << 16 ^ ((u - du) as u32 & 0xff) << 8 ^ (v as i32 - dv) as u32 & 0xff;
            let noise = Xorshift(place.wrapping_mul(0x9e37_79b9) | 1).number() >> 13;
            *sample = match self {
                Pattern::Noise | Pattern::Shifted => noise as u8,
                Pattern::Extremes => ((noise & 1) * 255) as u8,
                Pattern::Flat => 7,
            };
        }
        Ok(())
    }
}

/// Compares matches of every set of views with every fusion, in several sizes. Returns their number.
pub fn compare_matches() -> Result<usize, Difference> {
    let Some([memory, memory_of_twin]) = MEMORY.try_take() else { return Err(Difference) };
    let sizes: [(i16, u16, u8); 9] =
        [(0, 1, 1), (1, 5, 3), (-3, 16, 5), (1, 32, 11), (2, 17, 15), (-9, 12, 17), (1, 33, 7), (0, 8, 21), (-20, 64, 3)];
    let mut count = 0;
    for (min_disparity, num_disparities, block_size) in sizes {
        for (bits, fusion) in (1..16).flat_map(|bits| Fusion::ALL.map(|fusion| (bits, fusion))) {
            let views: Views = View::ALL.into_iter().filter(|&view| bits >> view as u32 & 1 != 0).collect();
            let pattern = [Pattern::Noise, Pattern::Extremes, Pattern::Shifted, Pattern::Flat][count % 4];
            let params = Params::new(WIDTH, HEIGHT, views, fusion, min_disparity, num_disparities, block_size);
            let Ok(params) = params else { return Err(Difference) };
            let tile_width = if count % 3 == 0 { 13 } else { WIDTH.into() };
            for tile in Region::tiles(&params, tile_width) {
                let found = Matcher::with_isa(BoardKernel::default(), &params, &tile, memory);
                let expected = Matcher::with_isa(Twin::default(), &params, &tile, memory_of_twin);
                let (Ok(mut found), Ok(mut expected)) = (found, expected) else {
                    eprintln!("kernels: {params:?} needs more memory");
                    return Err(Difference);
                };
                let mut lines: [[Option<Disparity>; WIDTH as usize]; 2] = [[None; WIDTH as usize]; 2];
                let [line, line_of_twin] = lines.each_mut().map(|line| &mut line[..tile.width()]);
                loop {
                    let next = found.next_line(&mut { pattern }, line).ok().flatten();
                    let next_of_twin = expected.next_line(&mut { pattern }, line_of_twin).ok().flatten();
                    if (next, &line) != (next_of_twin, &line_of_twin) {
                        eprintln!("kernels: {pattern:?}, {params:?}, {tile:?}:");
                    }
                    same("a line", (next, &line), (next_of_twin, &line_of_twin))?;
                    if next.is_none() {
                        break;
                    }
                }
            }
            count += 1;
        }
    }
    Ok(count)
}
