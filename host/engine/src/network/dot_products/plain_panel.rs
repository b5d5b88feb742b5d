//! Sums of products in plain Rust.

use std::array;

use super::panel::{PANEL, Panel, WeightLine};

/// Plain Rust.
#[derive(Clone, Copy, Debug)]
pub struct PlainPanel<const OUTPUTS: usize>;

impl<const OUTPUTS: usize> Panel for PlainPanel<OUTPUTS> {
    const OUTPUTS: usize = OUTPUTS;
    type Sums = [i32; OUTPUTS];
    /// In 16 bits: products and the sums of two do not exceed these.
    type Weights = [[i16; OUTPUTS]; 4];

    #[inline(always)]
    fn load(self, sums: &[i32; PANEL]) -> [i32; OUTPUTS] {
        array::from_fn(|output| sums[output])
    }

    #[inline(always)]
    fn store(self, sums: [i32; OUTPUTS], out: &mut [i32; PANEL]) {
        out[..OUTPUTS].copy_from_slice(&sums);
    }

    #[inline(always)]
    fn weights(self, line: &WeightLine) -> [[i16; OUTPUTS]; 4] {
        array::from_fn(|input| array::from_fn(|output| line.0[4 * output + input].into()))
    }

    #[inline(always)]
    fn add(self, mut sums: [i32; OUTPUTS], inputs: [u8; 4], weights: [[i16; OUTPUTS]; 4]) -> [i32; OUTPUTS] {
        let [a, b, c, d] = inputs.map(i16::from);
        for (output, sum) in sums.iter_mut().enumerate() {
            let first = a * weights[0][output] + b * weights[1][output];
            let second = c * weights[2][output] + d * weights[3][output];
            *sum += i32::from(first) + i32::from(second);
        }
        sums
    }
}
