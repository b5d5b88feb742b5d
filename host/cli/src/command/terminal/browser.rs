//! Pages opened in the user's browser.

use std::{
    env,
    ffi::OsStr,
    io::{IsTerminal, stderr},
    process::{Command, Stdio},
};

/// Opens a page, a file or an address, with the program that the user has for it, if messages go to a terminal. If there is no
/// such program, a message has told where the page is.
pub fn open(page: &OsStr) {
    if !stderr().is_terminal() {
        return;
    }
    let (program, arguments): (_, &[&str]) = match env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("cmd", &["/c", "start", ""]),
        _ if env::var_os("DISPLAY").is_none() && env::var_os("WAYLAND_DISPLAY").is_none() => return,
        _ => ("xdg-open", &[]),
    };
    let null = || Stdio::null();
    let _ = Command::new(program).args(arguments).arg(page).stdin(null()).stdout(null()).stderr(null()).spawn();
}
