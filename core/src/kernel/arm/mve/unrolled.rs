//! Paths through pixels of 32 disparities, unrolled.

use super::winner::AT_ONCE;
use crate::kernel::bytes::Slot;

/// Disparities of a pixel: two vectors of 16.
pub(super) const DEPTH: usize = 32;

/// Bytes of a slot.
pub(super) const STRIDE: usize = Slot::bytes(DEPTH);

const _: () = assert!(DEPTH == AT_ONCE);

/// Extends a path by a pixel, from the slot at `$slot` to the one `$to` bytes from there, which may be the
/// same.
///
/// P2 is in q0. The least cost is in the register `$least` before and after. What the path adds to the costs
/// goes through `$first` and `$second`, which leave the path's costs in q5 and q7.
#[rustfmt::skip]
macro_rules! extend_unrolled {
    ($slot:literal, $to:literal, $least:literal, $first:expr, $second:expr) => {
        concat!(
            "vldrb.u8 q5, [", $slot, ", #({lead} - 1)]\n",
            "vldrb.u8 q6, [", $slot, ", #({lead} + 1)]\n",
            "vmin.u8 q5, q5, q6\n",
            "vqadd.u8 q5, q5, {p1}\n",
            "vldrb.u8 q6, [", $slot, ", #{lead}]\n",
            "vmin.u8 q5, q5, q6\n",
            // The least is taken away first, so that P2 does not have to be added to it.
            "vqsub.u8 q5, q5, ", $least, "\n",
            $first,
            // The last of the first vector's costs is read before they are overwritten.
            "vldrb.u8 q7, [", $slot, ", #({lead} + 15)]\n",
            "vstrb.8 q5, [", $slot, ", #({lead} + ", $to, ")]\n",
            "vldrb.u8 q6, [", $slot, ", #({lead} + 17)]\n",
            "vmin.u8 q7, q7, q6\n",
            "vqadd.u8 q7, q7, {p1}\n",
            "vldrb.u8 q6, [", $slot, ", #({lead} + 16)]\n",
            "vmin.u8 q7, q7, q6\n",
            "vqsub.u8 q7, q7, ", $least, "\n",
            $second,
            "vstrb.8 q7, [", $slot, ", #({lead} + 16 + ", $to, ")]\n",
            "vmin.u8 q7, q7, q5\n",
            "mov ", $least, ", #255\n",
            "vminv.u8 ", $least, ", q7\n",
        )
    };
}
