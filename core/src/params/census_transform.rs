//! The census transform: which pixels of a window are brighter than their opposites.

/// The window of the centre-symmetric census transform.
///
/// A descriptor has one bit for each pair of opposite pixels in the window, set if the pixel above or to the
/// left is the darker one (Spangenberg, Langner and Rojas, "Weighted semi-global matching and
/// center-symmetric census transform for robust driver assistance", 2013). Beyond the frame's borders, pixels
/// repeat the border's. The cost of a match is the Hamming distance of the two descriptors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Census {
    /// 5 x 5 pixels, 12 bits.
    Window5x5,
    /// 7 x 7 pixels, 24 bits.
    Window7x7,
    /// 9 x 7 pixels, 31 bits.
    #[default]
    Window9x7,
}

impl Census {
    /// Every window, the smallest first.
    pub const ALL: [Census; 3] = [Census::Window5x5, Census::Window7x7, Census::Window9x7];

    /// The most bits of any window, which is also the greatest cost.
    pub const MAX_BITS: usize = 31;

    /// The window's size, as command lines name it.
    pub const fn name(self) -> &'static str {
        match self {
            Census::Window5x5 => "5x5",
            Census::Window7x7 => "7x7",
            Census::Window9x7 => "9x7",
        }
    }

    /// The reach of the window: to each side, and up and down, in pixels.
    pub const fn radius(self) -> [usize; 2] {
        match self {
            Census::Window5x5 => [2, 2],
            Census::Window7x7 => [3, 3],
            Census::Window9x7 => [4, 3],
        }
    }

    /// Bits of a descriptor, one for each pair of opposite pixels.
    pub const fn bits(self) -> usize {
        let [rx, ry] = self.radius();
        ((2 * rx + 1) * (2 * ry + 1) - 1) / 2
    }

    /// Bytes of a descriptor.
    pub const fn bytes(self) -> usize {
        self.bits().div_ceil(8)
    }

    /// The offsets `[dx, dy]` of the pixels that are compared with their opposites, in the order of the bits:
    /// line by line from the top left.
    pub fn offsets(self) -> impl Iterator<Item = [isize; 2]> {
        let [rx, ry] = self.radius().map(|radius| radius as isize);
        let all = (-ry..=0).flat_map(move |dy| (-rx..=rx).map(move |dx| [dx, dy]));
        all.take(self.bits())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn each_pair_of_opposite_pixels_has_a_bit() {
        for (window, size, bits) in [(Census::Window5x5, 25, 12), (Census::Window7x7, 49, 24), (Census::Window9x7, 63, 31)] {
            assert_eq!((window.bits(), window.offsets().count()), (bits, bits), "{}", window.name());
            let with_opposites = window.offsets().flat_map(|[dx, dy]| [[dx, dy], [-dx, -dy]]);
            let pixels: BTreeSet<_> = with_opposites.chain([[0, 0]]).collect();
            assert_eq!(pixels.len(), size, "{}", window.name());
        }
    }
}
