//! Ctrl-C, and the other signals that end the program.

use std::{
    process,
    sync::{
        Arc, LazyLock,
        atomic::{AtomicI32, AtomicUsize, Ordering},
    },
};

use multiscopic::{Error, Result, files::output};

/// The number of signals that have come.
static RECEIVED: LazyLock<Arc<AtomicUsize>> = LazyLock::new(Arc::default);
/// The last one.
static SIGNAL: AtomicI32 = AtomicI32::new(0);
/// The number of the signal that ends the program.
static LAST: AtomicUsize = AtomicUsize::new(1);

/// Lets signals end the program without half of its output.
///
/// Ctrl-C (SIGINT), SIGTERM and SIGHUP do so, with the shell's exit code of 128 plus the signal's number. One that was ignored
/// when the program started, as `nohup` ignores SIGHUP, stays ignored. Where a file grows beyond the limit of the shell, the
/// write fails, with a message, and no longer the program.
///
/// # Errors
/// The system refuses.
pub fn install() -> Result<()> {
    listen().map_err(|error| Error::Usage(format!("cannot handle Ctrl-C: {error}")))
}

/// Counts signals from now on, and lets only the `last`-th end the program.
pub fn count(last: usize) -> Arc<AtomicUsize> {
    LAST.store(last, Ordering::Relaxed);
    RECEIVED.clone()
}

/// The exit code for the last signal, if there was one.
#[cfg(feature = "live")]
pub fn exit_code() -> Option<u8> {
    match SIGNAL.load(Ordering::Relaxed) {
        0 => None,
        signal => Some(exit_code_of(signal) as u8),
    }
}

/// The shell's exit code for a signal.
fn exit_code_of(signal: i32) -> i32 {
    128 + signal
}

fn receive(signal: i32) {
    SIGNAL.store(signal, Ordering::Relaxed);
    let received = 1 + RECEIVED.fetch_add(1, Ordering::Relaxed);
    if received >= LAST.load(Ordering::Relaxed) {
        output::abandon();
        super::complain("interrupted: what was not finished is not written");
        process::exit(exit_code_of(signal));
    }
}

#[cfg(unix)]
fn listen() -> std::io::Result<()> {
    use signal_hook::{
        consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ},
        flag,
        iterator::Signals,
    };
    use std::{sync::atomic::AtomicBool, thread};

    let ignored = ignored();
    let is_ignored = |signal: i32| ignored >> (signal - 1) & 1 > 0;
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP].into_iter().filter(|&signal| !is_ignored(signal)))?;
    flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
    thread::Builder::new().name("signals".into()).spawn(move || signals.forever().for_each(receive))?;
    Ok(())
}

/// The signals that are ignored, a bit for each from 1 on. Only Linux tells: elsewhere, none.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default()
}

#[cfg(not(unix))]
fn listen() -> std::result::Result<(), ctrlc::Error> {
    const CTRL_C: i32 = 2;
    ctrlc::set_handler(|| receive(CTRL_C))
}
