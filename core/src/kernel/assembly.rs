//! What the loops in assembly share.

/// What is at the beginning of code that directives repeat: it says how many bytes the code has at most.
///
/// The compiler takes a line for an instruction, or for as many bytes as a line with `.space` says, and does not know other directives. Where code is
/// longer than it believes, what it puts on the other side of it is further away than some of its instructions reach: the addresses of constants and
/// the entries of a jump table are then cut off, without an error.
macro_rules! at_most {
    ($bytes:literal) => {
        concat!(".if 0\n.space ", $bytes, "\n.endif")
    };
}
