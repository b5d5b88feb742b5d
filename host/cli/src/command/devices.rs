//! `multiscopic devices`: the cameras of this machine.

use std::process::ExitCode;

use clap::Args;
use multiscopic::{
    Result,
    capture::camera::{self, CameraInfo, FrameSizes},
};

use super::terminal;

/// Lists the cameras with their formats and sizes
///
/// Cameras are the V4L2 capture devices of Linux. Those that cannot be used are listed with the reason.
#[derive(Clone, Debug, Args)]
pub struct Devices {
    /// Print a JSON list of {"device","card","driver","bus","problem","formats"} instead of text
    #[arg(long)]
    json: bool,
}

impl Devices {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let cameras = camera::list()?;
        if self.json {
            let json = serde_json::to_string(&cameras).expect("names and numbers");
            terminal::print(&format!("{json}\n"))?;
        } else if cameras.is_empty() {
            terminal::complain("there are no cameras: no /dev/videoN captures images; plug in a camera or load its driver");
        } else {
            terminal::print(&cameras.iter().map(text).collect::<String>())?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// A camera as lines of text.
fn text(camera: &CameraInfo) -> String {
    let mut lines = match camera.card.as_str() {
        "" => format!("{}\n", camera.device.display()),
        card => format!("{}: {card} ({}, {})\n", camera.device.display(), camera.driver, camera.bus),
    };
    if let Some(problem) = &camera.problem {
        lines += &format!("    cannot be used: {problem}\n");
    }
    for offer in camera.formats.iter().filter(|offer| offer.is_supported) {
        let sizes = offer.sizes.iter().map(|sizes| match sizes {
            FrameSizes::One([width, height]) => format!("{width}x{height}"),
            FrameSizes::Range { min, max, step } => {
                format!("{}x{} to {}x{} in steps of {}x{}", min[0], min[1], max[0], max[1], step[0], step[1])
            }
        });
        let sizes = sizes.collect::<Vec<_>>().join(", ");
        lines += &format!("    {:<4} ({}): {sizes}\n", offer.format, offer.description);
    }
    let others: Vec<&str> = camera.formats.iter().filter(|offer| !offer.is_supported).map(|offer| &*offer.format).collect();
    if !others.is_empty() {
        lines += &format!("    not supported: {}\n", others.join(", "));
    }
    lines
}
