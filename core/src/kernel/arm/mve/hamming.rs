//! Hamming distances in MVE.
#![allow(unsafe_code)]

/// The number of set bits of each byte.
static ONES: [u8; 256] = {
    let mut ones = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        ones[byte] = (byte as u8).count_ones() as u8;
        byte += 1;
    }
    ones
};

/// The number of bits in which a descriptor differs from others, whose bytes are in planes: at most four.
#[inline(always)]
pub(super) fn distances<const N: usize>(descriptor: [u8; N], others: [&[u8; 8]; N]) -> [u8; 8] {
    const { assert!(N <= 4) };
    let mut distances = [0; 8];
    // SAFETY: reads the descriptor, a vector of each plane and the table at bytes, and writes a vector. Every
    // register that changes is an output.
    unsafe {
        asm_up_to!(140 bytes,
            "vmov.i16 q0, #0",
            ".irp k, 0, 1, 2, 3",
            ".if \\k < {planes}",
            "ldr r0, [{others}, #(4 * \\k)]",
            "vldrb.u16 q1, [r0]",
            "ldrb r0, [{descriptor}, #\\k]",
            "vdup.16 q2, r0",
            "veor q1, q1, q2",
            "vldrb.u16 q2, [{ones}, q1]",
            "vadd.i16 q0, q0, q2",
            ".endif",
            ".endr",
            "vstrb.16 q0, [r1]";
            others = in(reg) others.as_ptr(),
            descriptor = in(reg) descriptor.as_ptr(),
            ones = in(reg) ONES.as_ptr(),
            // Loads that widen and stores that narrow take their addresses from low registers.
            out("r0") _,
            in("r1") distances.as_mut_ptr(),
            out("q0") _, out("q1") _, out("q2") _,
            planes = const N,
            options(nostack, preserves_flags),
        );
    }
    distances
}

/// Lowers the costs of candidates to their Hamming distances, from those of `costs` on.
///
/// # Safety
/// Each plane has as many bytes as there are costs, not 0, and planes are at most four.
#[inline(always)]
pub(super) unsafe fn lower<const N: usize>(descriptor: [u8; N], planes: [&[u8]; N], costs: &mut [u8]) {
    let plane = |k: usize| planes.get(k).map_or(costs.as_ptr(), |plane| plane.as_ptr());
    let mut bytes = [0; 4];
    bytes.iter_mut().zip(descriptor).for_each(|(to, byte)| *to = byte);
    // SAFETY: reads the planes and the table at bytes, and reads and writes as many costs. Every register that
    // changes is an output.
    unsafe {
        asm_up_to!(160 bytes,
            ".irp q, 4, 5, 6, 7",
            ".if \\q - 4 < {planes}",
            "vdup.8 q\\q, {bytes}",
            "lsr {bytes}, {bytes}, #8",
            ".endif",
            ".endr",
            "dlstp.8 lr, {n}",
            "2:",
            "vldrb.u8 q1, [{a}], #16",
            "veor q1, q1, q4",
            "vldrb.u8 q0, [{ones}, q1]",
            ".if {planes} > 1",
            "vldrb.u8 q1, [{b}], #16",
            "veor q1, q1, q5",
            "vldrb.u8 q2, [{ones}, q1]",
            "vadd.i8 q0, q0, q2",
            ".endif",
            ".if {planes} > 2",
            "vldrb.u8 q1, [{c}], #16",
            "veor q1, q1, q6",
            "vldrb.u8 q2, [{ones}, q1]",
            "vadd.i8 q0, q0, q2",
            ".endif",
            ".if {planes} > 3",
            "vldrb.u8 q1, [{d}], #16",
            "veor q1, q1, q7",
            "vldrb.u8 q2, [{ones}, q1]",
            "vadd.i8 q0, q0, q2",
            ".endif",
            "vldrb.u8 q1, [{costs}]",
            "vmin.u8 q0, q0, q1",
            "vstrb.8 q0, [{costs}], #16",
            "letp lr, 2b";
            n = in(reg) costs.len(),
            bytes = inout(reg) u32::from_le_bytes(bytes) => _,
            a = inout(reg) plane(0) => _,
            b = inout(reg) plane(1) => _,
            c = inout(reg) plane(2) => _,
            d = inout(reg) plane(3) => _,
            ones = in(reg) ONES.as_ptr(),
            costs = inout(reg) costs.as_mut_ptr() => _,
            out("lr") _,
            out("q0") _, out("q1") _, out("q2") _, out("q4") _, out("q5") _, out("q6") _, out("q7") _,
            planes = const N,
            options(nostack, preserves_flags),
        );
    }
}
