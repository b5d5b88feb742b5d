//! The firmware: matches five frames that come in by the line, and writes disparity lines as they are done.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod arm;

/// The firmware runs on Arm; here it can only say so.
#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    eprintln!("the firmware runs on Arm: `cargo xtask edge` builds it and runs it in the emulator");
    std::process::ExitCode::from(2)
}
