//! Captures from Linux's V4L2 drivers. `cargo xtask v4l2` runs these tests in a virtual machine; elsewhere
//! each is reported as ignored.

#[cfg(target_os = "linux")]
mod capture_command;
#[cfg(target_os = "linux")]
mod v4l2;

#[cfg(target_os = "linux")]
fn main() {
    let has_cameras = std::env::var_os("MULTISCOPIC_CAMERAS").is_some();
    let trials = v4l2::trials(has_cameras).into_iter().chain(capture_command::trials(has_cameras)).collect();
    libtest_mimic::run(&libtest_mimic::Arguments::from_args(), trials).exit();
}

#[cfg(not(target_os = "linux"))]
fn main() {
    libtest_mimic::run(&libtest_mimic::Arguments::from_args(), Vec::new()).exit();
}
