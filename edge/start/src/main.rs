//! Matches without a runtime: one program, from the first line to the last.
#![no_std]
#![no_main]

use multiscopic_core::Matcher;
use semihosting::process;
use start::{Camera, Match, Memory, print_line};
use static_cell::ConstStaticCell;

static MEMORY: ConstStaticCell<Memory> = ConstStaticCell::new([0; _]);

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut matcher = Matcher::new(&Match, MEMORY.take()).expect("the memory has the length that the parameters need");
    let mut line = [None; _];
    while let Ok(Some(v)) = matcher.next_line(&mut Camera, &mut line) {
        print_line(v, &line);
    }
    process::exit(0)
}
