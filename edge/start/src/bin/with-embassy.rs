//! Matches in a task of embassy. Others run between two lines: here one that counts them, in yours the camera's and the port's.
#![no_std]
#![no_main]

use core::sync::atomic::{AtomicUsize, Ordering};
use embassy_executor::Spawner;
use embassy_futures::yield_now;
use multiscopic_core::Matcher;
use semihosting::process;
use start::{Camera, Match, Memory, print_line};
use static_cell::ConstStaticCell;

static MEMORY: ConstStaticCell<Memory> = ConstStaticCell::new([0; _]);
static TURNS: AtomicUsize = AtomicUsize::new(0);

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    spawner.spawn(other_work().expect("the only one"));
    let mut matcher = Matcher::new(&Match, MEMORY.take()).expect("the memory has the length that the parameters need");
    let mut line = [None; _];
    while let Ok(Some(v)) = matcher.next_line(&mut Camera, &mut line) {
        print_line(v, &line);
        // A line is computed without a pause. Interrupts and their executors need not wait for this.
        yield_now().await;
    }
    process::exit(i32::from(TURNS.load(Ordering::Relaxed) < Match::PARAMS.height()))
}

#[embassy_executor::task]
async fn other_work() {
    loop {
        TURNS.fetch_add(1, Ordering::Relaxed);
        yield_now().await;
    }
}
