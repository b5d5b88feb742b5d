//! Matches in a task of RTIC at the lowest priority, which all others interrupt.
#![no_std]
#![no_main]

use semihosting as _; // Handles panics.

// The crate of your part, and an interrupt that it does not use, take the places of `lm3s6965` and `SSI0`.
#[rtic::app(device = lm3s6965, dispatchers = [SSI0])]
mod app {
    use multiscopic_core::Matcher;
    use semihosting::process;
    use start::{Camera, Match, Memory, print_line};

    #[shared]
    struct Shared {}

    #[local]
    struct Local {}

    #[init]
    fn init(_: init::Context) -> (Shared, Local) {
        matching::spawn().expect("it does not run yet");
        (Shared {}, Local {})
    }

    #[task(priority = 1, local = [memory: Memory = [0; _]])]
    async fn matching(context: matching::Context) {
        let memory = context.local.memory;
        let mut matcher = Matcher::new(&Match, memory).expect("the memory has the length that the parameters need");
        let mut line = [None; _];
        while let Ok(Some(v)) = matcher.next_line(&mut Camera, &mut line) {
            print_line(v, &line);
        }
        process::exit(0)
    }
}
