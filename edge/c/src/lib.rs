//! Multiscopic matching from C and C++: the functions of `include/multiscopic.h`, which documents them.
//!
//! Lines come from a callback or are pushed, and everything is in memory that the caller lends. A program links the code of the
//! methods that it names.
//!
//! | module | what it is |
//! | --- | --- |
//! | `status` | how a call ended: [`Status`] |
//! | `params` | what is searched, as C states it: [`CParams`], [`CRegion`] |
//! | `pass` | a match over a frame, by the method that it is compiled for |
//! | `methods` | the methods, each a table of functions: [`Method`] |
//! | `matcher` | begins a match, and computes its lines |
//! | `packets` | encodes lines for `multiscopic listen` |
#![cfg_attr(target_os = "none", no_std)]
#![allow(unsafe_code, reason = "C lends memory by address")]

mod matcher;
mod methods;
mod packets;
mod params;
mod pass;
mod status;

pub use matcher::{multiscopic_begin, multiscopic_memory_words, multiscopic_next_line, multiscopic_push_line};
pub use methods::Method;
pub use packets::{multiscopic_encode_end, multiscopic_encode_line, multiscopic_packet_buffer_bytes};
pub use params::{CParams, CRegion, CView};
pub use status::{Status, multiscopic_status_text};

/// A library for bare metal has to have one. Nothing here panics, so linkers drop it.
#[cfg(target_os = "none")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}
