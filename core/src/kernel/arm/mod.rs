//! The vector instructions of Arm's microcontrollers, and the constants and macros that all of their loops in assembly share.

/// `asm!` for code that directives repeat: its length in bytes at most, the template, and after a semicolon
/// the operands.
///
/// The compiler has to know how long the code is. It counts a line as one instruction, a line with `.space`
/// as so many bytes, and knows no other directives. Where code is longer than it believes, constants and
/// entries of jump tables end up out of the reach of instructions on the other side, and their addresses are
/// cut off without an error. So the length is stated in a `.space` that is never assembled, and the assembler
/// checks it: "invalid number of bytes" says that the code is longer. The difference is skipped in a section
/// that the linker excludes.
macro_rules! asm_up_to {
    ($bytes:literal bytes, $($template:expr),+; $($operands:tt)*) => {
        core::arch::asm!(
            concat!(".if 0\n.space ", $bytes, "\n.endif\n771:"),
            $($template,)+
            concat!("772:\n.pushsection .assembly_length, \"e\"\n.skip ", $bytes, " - (772b - 771b)\n.popsection"),
            $($operands)*
        )
    };
}

/// Instructions as text, one a line: a mnemonic and its operands.
macro_rules! instructions {
    ($($mnemonic:ident $first:tt $(, $operand:tt)*;)+) => {
        concat!($(stringify!($mnemonic), " ", $first, $(", ", $operand,)* "\n"),+)
    };
}

// After the macros, which modules see only if they stand before them.
mod dsp;
#[cfg(multiscopic_mve)]
mod mve;

use core::mem::offset_of;

use crate::kernel::{isa::Change, steps::Track};
pub use dsp::Dsp;
#[cfg(multiscopic_mve)]
pub use mve::Mve;

/// Assembly loads a track as three words: where samples enter, where they leave, and the step.
const _: () = {
    assert!(size_of::<Track>() == 12 && offset_of!(Track, samples) == 0 && offset_of!(Track, step) == 8);
    assert!(offset_of!(Change<*const u8>, entering) == 0 && offset_of!(Change<*const u8>, leaving) == 4);
};
