//! Runs the target that the variable `MULTISCOPIC_FUZZ_TARGET` names, for libFuzzer.

#![no_main]

use std::{env, sync::LazyLock};

use libfuzzer_sys::{Corpus, fuzz_target};
use multiscopic_fuzz::Target;

static TARGET: LazyLock<Target> = LazyLock::new(|| {
    let name = env::var("MULTISCOPIC_FUZZ_TARGET").expect("MULTISCOPIC_FUZZ_TARGET names a target");
    Target::named(&name).unwrap_or_else(|| panic!("no target is called {name}"))
});

fuzz_target!(|bytes: &[u8]| -> Corpus { if (TARGET.run)(bytes) { Corpus::Keep } else { Corpus::Reject } });
